"""Named random quantities together, and their transformation to independent standard normals."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any, ClassVar

import jax
import jax.numpy as jnp
import numpy as np

from ..common import checks
from ..common.rules import Rule, are_rules_kept, collect_rules, refuse_if_broken
from ..common.tree import pytree, set_fields
from ..common.types import Array, ArrayLike, Bool, Float
from ..linear import unbatched
from .distributions import Distribution

Layout = tuple[tuple[str, tuple[int, ...]], ...]
"""Names and shapes of quantities, in their order."""


@pytree(static=("layout",))
class Quantities:
    """Random quantities by name, independent or correlated (Gaussian copula, Nataf 1962).

    Attributes:
        distributions: `Distribution` objects by name. One of an array stands for all its entries.
        correlation: None for independent quantities; or the correlation matrix [n, n] of the
            standard normal variables ``z_i = Phi^-1(F_i(x_i))`` that belong to the quantities, in
            the order of `layout`; or a dict with a number for pairs of names, such as
            ``{("wind", "ice"): 0.3}``. For normal quantities these are the correlations of the
            quantities themselves; for others `normal_correlation` computes them from those.
        layout: names and shapes of the quantities in the order of the dict, whatever becomes of
            the dict in transformations of jax; arrays are counted row by row. Set by the
            constructor.

    Raises:
        ValueError: no quantity, an entry that is no distribution, a pair with an unknown name or
            an array, or a matrix of another shape, which is not symmetric with a unit diagonal,
            or not positive definite. A traced one of those leads to NaN.

    The independent standard normal variables u follow from ``z = L u``, with Cholesky's factor L
    of the matrix.

    Example:
        >>> quantities = jc.reliability.Quantities(
        ...     {
        ...         "wind": jc.reliability.Gumbel(mean=300.0, variation=0.25),  # Pa
        ...         "error": jc.reliability.Normal(mean=np.zeros(2), deviation=1e-3),  # m
        ...         "ice": jc.reliability.Lognormal(mean=10e-3, variation=0.5),  # m
        ...     },
        ...     correlation={("wind", "ice"): 0.3},
        ... )
        >>> print(quantities.size, quantities.layout)
        4 (('wind', ()), ('error', (2,)), ('ice', ()))
        >>> values = quantities.values_at_normals(jnp.array([0.0, 1.0, 0.0, 0.0]))
        >>> print(values["error"], bool(abs(quantities.normal_at_value(values)[1] - 1.0) < 1e-12))
        [0.001 0.   ] True
    """

    _shown: ClassVar[str] = "distributions, correlation"

    distributions: Mapping[str, Distribution]
    correlation: Float[ArrayLike, "n n"] | Mapping[tuple[str, str], Any] | None = None
    layout: Layout = ()

    def __post_init__(self) -> None:
        if not isinstance(self.distributions, Mapping) or not self.distributions:
            raise ValueError("quantities: expected a dict of distributions by name")
        for name, one in self.distributions.items():
            if not isinstance(name, str):
                raise ValueError(f"quantities: expected names, got {name!r}")
            if not isinstance(one, Distribution):
                got = checks.describe_type(one, "Normal(mean, deviation)")
                raise ValueError(f"quantities[{name!r}]: expected a distribution, got {got}")
        # `replace` hands on the order that the quantities had; the dict may be sorted by now
        names = [name for name, _ in self.layout]
        if set(names) != set(self.distributions):
            names = list(self.distributions)
        layout = tuple((name, tuple(self.distributions[name].shape)) for name in names)
        set_fields(self, layout=layout)
        if isinstance(self.correlation, Mapping):
            set_fields(self, correlation=_matrix_of_pairs(self.correlation, layout))
        elif self.correlation is not None:
            matrix = checks.floats_of_shape(self.correlation, "correlation", (self.size, self.size))
            set_fields(self, correlation=matrix)
        refuse_if_broken(self.rules())

    def rules(self) -> list[Rule]:
        """Return the rule that the correlation matrix is one (`_is_correlation`), a list."""
        text = "must be symmetric and positive definite, with ones on its diagonal"
        return [
            Rule("correlation", self.correlation, lambda matrix: ~_is_correlation(matrix), text)
        ]

    @property
    def size(self) -> int:
        """Number of random variables: all entries of all quantities."""
        return sum(int(np.prod(shape)) for _, shape in self.layout)

    def are_valid(self) -> Bool[Array, ""]:
        """Return whether all numbers, which may be traced, keep their rules; scalar bool."""
        return are_rules_kept(collect_rules(self))

    def factor(self) -> Float[Array, "n n"] | None:
        """Return the lower Cholesky factor of the correlation matrix; None if there is none."""
        return (
            None if self.correlation is None else unbatched.cholesky(jnp.asarray(self.correlation))
        )

    def values_at_normals(self, u: Float[ArrayLike, " n"]) -> dict[str, Float[Array, " ..."]]:
        """Return the values of all quantities by name, of independent standard normal values u."""
        u, factor = jnp.asarray(u), self.factor()
        return self.values_at_correlated(u if factor is None else factor @ u)

    def values_at_correlated(self, z: Float[Array, " n"]) -> dict[str, Float[Array, " ..."]]:
        """Return the values of all quantities by name, of their own standard normal values z."""
        parts = split_by_name(self.layout, z)
        return {name: self.distributions[name].value_at_normal(u) for name, u in parts.items()}

    def normal_at_value(self, values: Mapping[str, Float[ArrayLike, " ..."]]) -> Float[Array, " n"]:
        """Return the independent standard normal values u of values by name, [n].

        Quantities that `values` does not name are at their medians.
        """
        for name in values:
            if name not in self.distributions:
                there = checks.suggest_names(name, [known for known, _ in self.layout])
                raise ValueError(f"values: no quantity {name!r}{there}")
        parts = {}
        for name, shape in self.layout:
            if name in values:
                value = checks.floats_of_shape(values[name], f"values[{name!r}]", shape)
                parts[name] = self.distributions[name].normal_at_value(value)
            else:
                parts[name] = jnp.zeros(shape)
        z, factor = join_by_name(self.layout, parts), self.factor()
        return z if factor is None else unbatched.solve_triangular(factor, z)


def as_quantities(quantities: Quantities | Mapping[str, Distribution]) -> Quantities:
    """Return `Quantities` unchanged, or those of a dict of independent distributions by name."""
    return quantities if isinstance(quantities, Quantities) else Quantities(quantities)


def split_by_name(layout: Layout, flat: Float[Array, "... n"]) -> dict[str, Float[Array, " ..."]]:
    """Return the entries of a vector, [..., n], by the names of the quantities, in their shapes.

    Leading axes are kept.
    """
    parts, begin = {}, 0
    for name, shape in layout:
        end = begin + int(np.prod(shape))
        parts[name] = flat[..., begin:end].reshape(*flat.shape[:-1], *shape)
        begin = end
    return parts


def join_by_name(
    layout: Layout, parts: Mapping[str, Float[ArrayLike, " ..."]]
) -> Float[Array, "... n"]:
    """Return values by name as one vector, [..., n], in the order of `layout`."""
    flat = []
    for name, shape in layout:
        part = jnp.asarray(parts[name])
        leading = part.shape[: part.ndim - len(shape)]
        flat.append(part.reshape(*leading, int(np.prod(shape))))
    return jnp.concatenate(flat, axis=-1)


def _matrix_of_pairs(pairs, layout):
    """Return the correlation matrix [n, n] with numbers for pairs of names; zero for other pairs.

    Raises ValueError for an unknown name, or that of an array.
    """
    first, begin = {}, 0
    for name, shape in layout:
        first[name] = begin if shape == () else None
        begin += int(np.prod(shape))
    traced = any(isinstance(value, jax.Array) for value in pairs.values())
    matrix: Any = jnp.eye(begin) if traced else np.eye(begin)
    for pair, value in pairs.items():
        for name in pair:
            if name not in first:
                there = checks.suggest_names(name, first)
                raise ValueError(f"correlation[{pair!r}]: no quantity {name!r}{there}")
            if first[name] is None:
                raise ValueError(
                    f"correlation[{pair!r}]: {name!r} is an array; give a matrix [n, n]"
                )
        i, j = (first[name] for name in pair)
        if i == j:
            raise ValueError(f"correlation[{pair!r}]: expected two quantities")
        value = checks.as_scalar(value, f"correlation[{pair!r}]")
        if traced:
            matrix = matrix.at[i, j].set(value).at[j, i].set(value)
        else:
            matrix[i, j] = matrix[j, i] = value
    return matrix


def _is_correlation(matrix):
    """Return whether a matrix is symmetric, with a unit diagonal, and positive definite; bool."""
    near = 1e-6 if matrix.dtype == np.float32 else 1e-12
    shaped = (abs(matrix - matrix.T) <= near).all() & (abs(matrix.diagonal() - 1) <= near).all()
    if isinstance(matrix, np.ndarray):
        return (
            shaped & bool(np.linalg.eigvalsh(matrix)[0] > near)
            if np.isfinite(matrix).all()
            else shaped
        )
    return shaped & ~jnp.isnan(unbatched.cholesky(matrix)).any()
