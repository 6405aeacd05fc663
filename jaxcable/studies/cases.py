"""The cases of a study, named along dimensions: all combinations, rows of a table, or samples.

Cases have a shape, one length for each dimension, and a number, which counts through them with the
last dimension first. What a case is, the argument of the function, follows from its number.
"""

from __future__ import annotations

import dataclasses
import functools
import math
from collections.abc import Callable, Mapping, Sequence
from typing import Any, TypeAlias

import jax
import numpy as np

from ..common import checks, digest
from ..common.types import ArrayLike, Int, PyTree

Numbers: TypeAlias = 'Int[np.ndarray, " n"]'
"""Numbers of cases, from 0."""
Block: TypeAlias = "PyTree[ArrayLike]"
"""Cases with their numbers on the first axis: arrays [n, ...]."""

RESERVED = {"cause", "completed", "zarr.json"}
"""Names that a store needs itself."""
_N_PROBED = 16  # cases that are computed to tell one drawing function from another


@dataclasses.dataclass(frozen=True, eq=False)
class Cases:
    """Cases along named dimensions; made by `product`, `table` and `samples`.

    Attributes:
        dims: names of the dimensions.
        shape: number of cases along each of them.
        draw: function from indices of cases, [n], to these cases, a pytree of arrays [n, ...].
        coordinates: what is known of all cases: pairs (names of dimensions, values), by name.
        stated: arrays that make all cases, a pytree; None if a user's function draws them.

    Example:
        The cases with numbers 1 and 5, as the function of a study gets them:

        >>> cases = jc.studies.product(force=[100.0, 200.0], wind=[0.0, 5.0, 10.0])
        >>> block = cases.block(np.array([1, 5]))
        >>> block["force"].tolist(), block["wind"].tolist()
        ([100.0, 200.0], [5.0, 10.0])
    """

    dims: tuple[str, ...]
    shape: tuple[int, ...]
    draw: Callable[[Numbers], Block]
    coordinates: Mapping[str, tuple[tuple[str, ...], np.ndarray]]
    stated: PyTree[np.ndarray] | None

    @property
    def n_case(self) -> int:
        """Number of all cases."""
        return math.prod(self.shape)

    def block(self, numbers: Numbers) -> Block:
        """Return the cases with indices `numbers`, [n], a pytree of arrays [n, ...].

        Raises ValueError if a user's function draws another number of cases.
        """
        drawn = jax.tree.map(np.asarray, self.draw(numbers))
        if _axis_lengths(drawn) != {len(numbers)}:
            raise ValueError(
                f"draw: expected arrays [{len(numbers)}, ...] for {len(numbers)} numbers, got "
                f"{[leaf.shape for leaf in jax.tree.leaves(drawn)]}"
            )
        return drawn

    def digest(self) -> str:
        """Return a digest of the arrays that are stated, or of sixteen cases that are drawn."""
        if self.stated is not None:
            return digest.arrays_digest(self.stated)
        few = min(self.n_case, _N_PROBED)
        return digest.arrays_digest(
            self.block(np.unique(np.linspace(0, self.n_case - 1, few).astype(int)))
        )

    def digest_of_code(self) -> str | None:
        """Return a digest of the function that draws the cases; None if `digest` covers all."""
        covered = self.stated is not None or self.n_case <= _N_PROBED
        return None if covered else digest.host_function_digest(self.draw)


def _combinations_at(values, shape, numbers):
    """Return the combinations with indices `numbers`, [n], of `values`, arrays by name.

    `shape` has the number of values of each; the last one counts first.
    """
    places = np.unravel_index(numbers, shape)
    return {name: value[k] for (name, value), k in zip(values.items(), places, strict=True)}


def _rows_at(rows, numbers):
    """Return the rows with indices `numbers`, [n], of all arrays of a pytree."""
    return jax.tree.map(lambda leaf: leaf[numbers], rows)


def product(values: Mapping[str, ArrayLike] | None = None, /, **more: ArrayLike) -> Cases:
    """Combine all values of several quantities: one dimension for each, named by it.

    Args:
        values: arrays [n] (or [n, ...]: n vectors) by name; or give them as keywords.

    Returns:
        `Cases`; the function of a study gets a dict with one value (or vector) for each name.

    Raises:
        ValueError: no values, or an array without values.

    Example:
        >>> cases = jc.studies.product(force=[100.0, 200.0], wind=[0.0, 5.0, 10.0])
        >>> cases.dims, cases.shape, cases.n_case
        (('force', 'wind'), (2, 3), 6)
    """
    if values is not None and not isinstance(values, Mapping):
        raise ValueError(f"product: expected values by name, got {type(values).__name__}")
    given = {name: np.asarray(value) for name, value in (dict(values or {}) | dict(more)).items()}
    if not given:
        raise ValueError("product: expected values by name, got none")
    for name, value in given.items():
        require_name(name, "product")
        if value.ndim == 0 or not len(value):
            raise ValueError(f"product: {name} has shape {value.shape}, expected values [n, ...]")
        require_numbers(value, f"product: {name}")
    shape = tuple(map(len, given.values()))
    named = {name: ((name,), value) for name, value in given.items() if value.ndim == 1}
    draw = functools.partial(_combinations_at, given, shape)
    return Cases(tuple(given), shape, draw, named, given)


def table(
    rows: PyTree[ArrayLike], *, dim: str = "case", labels: Sequence[str] | None = None
) -> Cases:
    """Take the rows of arrays as cases, along one dimension.

    Args:
        rows: pytree of arrays [n_case, ...]; in a dict, those of shape [n_case] become coordinates
            of the results.

    Options:
        dim: name of the dimension.
        labels: names of the cases, [n_case] texts.

    Returns:
        `Cases`; the function of a study gets one row: the same pytree without the leading axes.

    Raises:
        ValueError: the arrays have no common leading axis, or the labels are not as many.

    Example:
        >>> rows = {"force": [100.0, 200.0], "load": np.zeros((2, 4, 3))}
        >>> jc.studies.table(rows, labels=["snow", "wind"]).shape
        (2,)
    """
    require_name(dim, "dim")
    if callable(rows):
        raise ValueError("cases: got a function; give studies.samples(function, n_case)")
    rows = _as_arrays(rows)
    counts = _axis_lengths(rows)
    count = counts.pop() if len(counts) == 1 else None
    if not count:
        raise ValueError("cases: expected arrays with one common leading axis, [n_case, ...]")
    for path, leaf in jax.tree_util.tree_leaves_with_path(rows):
        require_numbers(leaf, f"cases{jax.tree_util.keystr(path)}")
    named = rows if isinstance(rows, dict) else {}
    for name in named:
        require_name(name, "cases")
    named = {
        name: value
        for name, value in named.items()
        if isinstance(value, np.ndarray) and value.ndim == 1
    }
    if labels is not None:
        texts = np.asarray([str(label) for label in labels])
        if len(texts) != count:
            raise ValueError(f"labels: {len(texts)} labels for {count} cases")
        if len({*texts}) < count:
            raise ValueError("labels: expected different names, since they select cases")
        if isinstance(rows, dict) and dim in rows:
            raise ValueError(f"dim = {dim!r}: is the name of an array in the cases, too")
        named[dim] = texts
    coordinates = {name: ((dim,), value) for name, value in named.items()}
    stated = rows, None if labels is None else texts
    return Cases((dim,), (count,), functools.partial(_rows_at, rows), coordinates, stated)


def samples(draw: Callable[[Numbers], Block], n_case: int, *, dim: str = "sample") -> Cases:
    """Draw cases by a function of their numbers, where not all of them should be in memory.

    Args:
        draw: function from indices of cases, [n], NumPy, to these cases, a pytree of arrays
            [n, ...]. It has to return the same for a number whenever it is called, and to change
            nothing that it uses: seed a generator with the number.
        n_case: number of cases.

    Options:
        dim: name of the dimension.

    Returns:
        `Cases`.

    Raises:
        ValueError: `n_case` is no positive integer.

    Example:
        >>> def draw(numbers):
        ...     return np.array([np.random.default_rng(k).normal(200.0, 5.0) for k in numbers])
        >>> jc.studies.samples(draw, 1_000_000).shape
        (1000000,)
    """
    checks.require_whole_number(n_case, "n_case")
    require_name(dim, "dim")
    if not callable(draw):
        raise ValueError(f"draw: expected a function of numbers of cases, got {draw!r:.60}")
    return Cases((dim,), (n_case,), draw, {}, None)


def require_name(name: Any, argument: str) -> None:
    """Raise ValueError unless `name` can name an array of a store: printable, without slashes."""
    is_text = isinstance(name, str) and name.isprintable() and name.strip(".")
    if not is_text or {*"/\\"} & {*name} or name.startswith("__") or name in RESERVED:
        raise ValueError(
            f"{argument}: {name!r} cannot be the name of an array; expected a text of printable "
            "characters without slashes that does not begin with two underscores, other than "
            f"{', '.join(sorted(RESERVED))}"
        )


def _axis_lengths(tree):
    """Return the set of lengths of the leading axes of all arrays; None for one without axes."""
    return {len(leaf) if leaf.ndim else None for leaf in jax.tree.leaves(tree)}


def _as_arrays(rows):
    """Return a pytree with NumPy arrays as leaves; a list of plain numbers is one array."""

    def is_list_of_numbers(part):
        return isinstance(part, list) and all(
            isinstance(leaf, bool | int | float | complex) for leaf in jax.tree.leaves(part)
        )

    return jax.tree.map(np.asarray, rows, is_leaf=is_list_of_numbers)


def require_numbers(values: np.ndarray, name: str) -> None:
    """Raise ValueError unless an array has numbers or truth values, which a function can get."""
    if values.dtype.kind not in "biufc":
        raise ValueError(
            f"{name}: is of {values.dtype}, expected numbers; names of cases are `labels` of "
            "`studies.table`"
        )
