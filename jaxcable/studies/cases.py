"""The cases of a study, named along dimensions: all combinations, rows of a table, or samples.

Cases have a shape, one length for each dimension, and a number, which counts through them with the
last dimension first. What a case is, the argument of the function, follows from its number.
"""

from __future__ import annotations

import abc
import dataclasses
import math
from collections.abc import Callable, Mapping, Sequence
from typing import TypeAlias

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
class Cases(abc.ABC):
    """Cases along named dimensions; made by `product`, `table` and `samples`.

    Attributes:
        dims: names of the dimensions.
        shape: number of cases along each of them.

    Example:
        The cases with numbers 1 and 5, as the function of a study gets them:

        >>> cases = jc.studies.product(force=[100.0, 200.0], wind=[0.0, 5.0, 10.0])
        >>> block = cases.block(np.array([1, 5]))
        >>> block["force"].tolist(), block["wind"].tolist()
        ([100.0, 200.0], [5.0, 10.0])
    """

    dims: tuple[str, ...]
    shape: tuple[int, ...]

    @property
    def n_case(self) -> int:
        """Number of all cases."""
        return math.prod(self.shape)

    @abc.abstractmethod
    def block(self, numbers: Numbers) -> Block:
        """Return the cases with these numbers, a pytree of arrays [n, ...]."""

    @abc.abstractmethod
    def coordinates(self) -> dict[str, tuple[tuple[str, ...], np.ndarray]]:
        """Return what is known of all cases: pairs (names of dimensions, values), by name."""

    @abc.abstractmethod
    def digests(self) -> dict[str, str | None]:
        """Return texts that differ if the cases do, by name."""

    def for_workers(self) -> Cases | None:
        """Return what a worker needs to make its cases itself; None if they are sent to it."""
        return self


@dataclasses.dataclass(frozen=True, eq=False)
class _Product(Cases):
    """All combinations of values along several dimensions, `values` by name of the dimension."""

    values: dict[str, np.ndarray]

    def block(self, numbers):
        where = np.unravel_index(numbers, self.shape)
        return {name: self.values[name][k] for name, k in zip(self.dims, where, strict=True)}

    def coordinates(self):
        return {name: ((name,), value) for name, value in self.values.items() if value.ndim == 1}

    def digests(self):
        return {"cases": digest.of_arrays(self.values), "cases_function": None}


@dataclasses.dataclass(frozen=True, eq=False)
class _Table(Cases):
    """Rows of arrays with one common leading axis; `labels` are texts [n_case], or None."""

    rows: PyTree[np.ndarray]
    labels: np.ndarray | None

    def block(self, numbers):
        return jax.tree.map(lambda leaf: leaf[numbers], self.rows)

    def coordinates(self):
        (dim,) = self.dims
        known = {} if self.labels is None else {dim: self.labels}
        if isinstance(self.rows, dict):
            known |= {
                name: value
                for name, value in self.rows.items()
                if isinstance(value, np.ndarray) and value.ndim == 1
            }
        return {name: ((dim,), value) for name, value in known.items()}

    def digests(self):
        labels = () if self.labels is None else (digest_of_values(self.labels),)
        return {"cases": "-".join((digest.of_arrays(self.rows), *labels)), "cases_function": None}

    def for_workers(self):
        return None


@dataclasses.dataclass(frozen=True, eq=False)
class _Samples(Cases):
    """Cases that the function `draw` makes from their numbers."""

    draw: Callable[[Numbers], Block]

    def block(self, numbers):
        drawn = jax.tree.map(np.asarray, self.draw(numbers))
        if axis_lengths(drawn) != {len(numbers)}:
            raise ValueError(
                f"draw: expected arrays [{len(numbers)}, ...] for {len(numbers)} numbers, got "
                f"{[leaf.shape for leaf in jax.tree.leaves(drawn)]}"
            )
        return drawn

    def coordinates(self):
        return {}

    def digests(self):
        few = min(self.n_case, _N_PROBED)
        numbers = np.unique(np.linspace(0, self.n_case - 1, few).astype(int))
        known = digest.of_arrays(self.block(numbers))
        all_known = self.n_case <= _N_PROBED
        made_by = None if all_known else digest.of_host_function(self.draw)
        return {"cases": known, "cases_function": made_by}


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
        _require_numbers(value, f"product: {name}")
    return _Product(tuple(given), tuple(map(len, given.values())), given)


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
    counts = axis_lengths(rows)
    count = counts.pop() if len(counts) == 1 else None
    if not count:
        raise ValueError("cases: expected arrays with one common leading axis, [n_case, ...]")
    for path, leaf in jax.tree_util.tree_leaves_with_path(rows):
        _require_numbers(leaf, f"cases{jax.tree_util.keystr(path)}")
    for name in rows if isinstance(rows, dict) else ():
        require_name(name, "cases")
    if labels is not None and len(labels) != count:
        raise ValueError(f"labels: {len(labels)} labels for {count} cases")
    if labels is not None and len({*map(str, labels)}) < count:
        raise ValueError("labels: expected different names, since they select cases")
    if isinstance(rows, dict) and labels is not None and dim in rows:
        raise ValueError(f"dim = {dim!r}: is the name of an array in the cases, too")
    texts = None if labels is None else np.asarray([str(label) for label in labels])
    return _Table((dim,), (count,), rows, texts)


def samples(draw: Callable[[Numbers], Block], n_case: int, *, dim: str = "sample") -> Cases:
    """Draw cases by a function of their numbers, where not all of them should be in memory.

    Args:
        draw: function from numbers of cases, [n], NumPy, to these cases, a pytree of arrays
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
    return _Samples((dim,), (n_case,), draw)


def require_name(name: object, argument: str) -> None:
    """Raise ValueError unless `name` can name an array of a store: printable, without slashes."""
    if (
        not isinstance(name, str)
        or not name.isprintable()
        or not name.strip(".")
        or "/" in name
        or "\\" in name
        or name.startswith("__")
        or name in RESERVED
    ):
        raise ValueError(
            f"{argument}: {name!r} cannot be the name of an array; expected a text of printable "
            "characters without slashes that does not begin with two underscores, other than "
            f"{', '.join(sorted(RESERVED))}"
        )


def digest_of_values(values: np.ndarray) -> str:
    """Return a digest of an array of numbers, truth values or texts; ValueError for others."""
    if values.dtype.kind == "U":
        return digest.of_arrays(np.frombuffer("\0".join(values.tolist()).encode(), np.uint8))
    _require_numbers(values, "coords")
    return digest.of_arrays(values)


def axis_lengths(tree: PyTree[np.ndarray]) -> set[int | None]:
    """Return the set of lengths of the leading axes of all arrays; None for one without axes."""
    return {len(leaf) if leaf.ndim else None for leaf in jax.tree.leaves(tree)}


def _as_arrays(rows):
    """Return a pytree with NumPy arrays as leaves; a list of plain numbers is one array."""

    def is_list_of_numbers(part):
        return isinstance(part, list) and all(
            isinstance(leaf, bool | int | float | complex) for leaf in jax.tree.leaves(part)
        )

    return jax.tree.map(np.asarray, rows, is_leaf=is_list_of_numbers)


def _require_numbers(values, name):
    """Raise ValueError unless an array has numbers or truth values, which a function can get."""
    if values.dtype.kind not in "biufc":
        raise ValueError(
            f"{name}: is of {values.dtype}, expected numbers; names of cases are `labels` of "
            "`studies.table`"
        )
