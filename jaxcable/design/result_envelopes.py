"""Envelopes over all results of load cases, with the names of the cases that govern."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from typing import Literal

import jax
import jax.numpy as jnp
import numpy as np

from ..analysis.element_shapes import CATENARIES
from ..analysis.solution import Solution
from ..common import checks, status
from ..common.tree import pytree
from ..common.types import Array, ArrayLike, Float, Int, PyTree
from ..elements.abilities import Bending
from ..model.structure import Structure
from ..model.topology import require_same_topology
from ..programs.traced_function import evaluate_at_once
from ..results import fibre_stress, rotation_vectors, sags, section_forces

_SECTION_FORCES = "N", "Vy", "Vz", "T", "My", "Mz"
Side = Literal["low", "high"]


@pytree(static=("names",))
class ResultEnvelope:
    """Smallest and largest of every result over load cases: what `envelope` gives for solutions.

    Attributes:
        low, high: smallest and largest values by the name of a result, each in the shape of one
            case; NaN where no case has a value.
        low_case, high_case: indices of the cases in which these occur.
        values: all values, with a leading axis [n_case]; NaN in cases that have failed.
        status: status codes of the cases, [n_case].
        names: names of the cases.

    Example:
        >>> rope = jc.Cables([[0, 1]], axial_stiffness=1e6)
        >>> structure = jc.Structure([[0, 0, 0], [0, 0, -2.0]], rope, supports=jc.pinned([0]))
        >>> cases = [jc.Phase(loads=jc.NodalLoads([1], (0, 0, -p))) for p in (300.0, 500.0)]
        >>> hung = jc.Phase(loads=jc.NodalLoads([1], (0.0, 0.0, -100.0)))
        >>> solutions = jc.design.solve_cases(structure, hung, cases)
        >>> found = jc.design.envelope(structure, solutions, names=["snow", "ice"])
        >>> print(found.high["tension"].round(6), found.governing("tension"), found.failed)
        [600.] ['ice'] {}
    """

    low: dict[str, PyTree[Float[Array, " ..."]]]
    high: dict[str, PyTree[Float[Array, " ..."]]]
    low_case: dict[str, PyTree[Int[Array, " ..."]]]
    high_case: dict[str, PyTree[Int[Array, " ..."]]]
    values: dict[str, PyTree[Float[Array, "n_case ..."]]]
    status: Int[Array, " n_case"]
    names: tuple[str, ...]

    @property
    def failed(self) -> dict[str, int]:
        """Status codes of the cases that have failed, by name; they have no part in extremes."""
        codes = zip(self.names, np.asarray(self.status).tolist(), strict=True)
        return {name: code for name, code in codes if code != status.OK}

    def governing(self, result: str, side: Side = "high") -> PyTree[np.ndarray]:
        """Return the names of the cases that govern a result, in its shape; "" without a value."""
        which, extreme = self._cases_and_extremes(result, side)
        names = np.array([*self.names, ""], object)
        return jax.tree.map(
            lambda k, x: names[np.where(np.isnan(np.asarray(x)), -1, np.asarray(k))], which, extreme
        )

    def concomitant(
        self, result: str, other: str, side: Side = "high"
    ) -> PyTree[Float[Array, " ..."]]:
        """Return the values of another result in the cases that govern `result`.

        Raises ValueError if the two have different shapes, as those of elements and of nodes.
        """
        which, _ = self._cases_and_extremes(result, side)
        values = self._values_of_result(other, self.values)
        if [np.shape(x)[1:] for x in jax.tree.leaves(values)] != [
            np.shape(k) for k in jax.tree.leaves(which)
        ]:
            raise ValueError(f"other = {other!r}: has another shape than {result!r}")
        return jax.tree.map(_values_in_cases, values, which)

    def _cases_and_extremes(self, result, side):
        """Return the indices of the governing cases of a result, and its extreme values.

        Both are pytrees like the result; `side` is "low" or "high".
        """
        checks.require_one_of(side, "side", ("low", "high"))
        cases = self.low_case if side == "low" else self.high_case
        return self._values_of_result(result, cases), (self.low if side == "low" else self.high)[
            result
        ]

    def _values_of_result(self, result, values):
        """Return `values[result]`; ValueError, which suggests names, for an unknown one."""
        if result not in values:
            hint = checks.suggest_names(result, values)
            raise ValueError(f"result = {result!r}: is no result of the envelope{hint}")
        return values[result]


def _values_in_cases(values, which):
    """Return from `values` [n_case, ...] each entry in its own case, of index `which` [...]."""
    return jnp.take_along_axis(values, which[None], axis=0)[0]


def extreme_cases(values: Float[ArrayLike, "n_case ..."], sign: int) -> Int[Array, " ..."]:
    """Return for each entry the index of the case of largest value (`sign` 1) or smallest (-1).

    NaN does not count; without any value the index is 0.
    """
    sizes = jax.lax.stop_gradient(sign * jnp.asarray(values))
    return jnp.argmax(jnp.where(jnp.isnan(sizes), -jnp.inf, sizes), axis=0)


def values_of_cases(
    function: Callable[..., PyTree[Array]], solutions: Solution, *beside: Array
) -> PyTree[Float[Array, "n_case ..."]]:
    """Return the values of a function in all cases, [n_case, ...]; NaN in cases that have failed.

    It takes the solution of one case, and its entries of the arrays `beside`, [n_case, ...]. A
    failed case does not make derivatives of the others NaN; if all have failed, all are NaN.
    """
    good = jnp.asarray(solutions.status) == status.OK
    taken, factor = good | ~good.any(), jnp.where(good.any(), 1.0, jnp.nan)

    def of_one(is_taken, *given):
        return jax.tree.map(lambda x: factor * jnp.where(is_taken, x, jnp.nan), function(*given))

    return jax.vmap(of_one)(taken, solutions, *beside)


def result_envelope(
    structure: Structure,
    solutions: Solution,
    names: Sequence[str] | None,
    also: Mapping[str, Callable[[Solution], PyTree[Array]]] | None,
    places: int,
) -> ResultEnvelope:
    """Return the `ResultEnvelope` of solutions with a leading axis; arguments as of `envelope`."""
    if not isinstance(solutions, Solution) or np.ndim(solutions.status) != 1:
        kind = checks.describe_type(solutions, "solve_cases(structure, phases, cases)")
        raise ValueError(f"solutions: expected a Solution with a leading axis [n_case], got {kind}")
    require_same_topology(structure, solutions.last.topology, "solutions")
    count = len(solutions.status)
    names = [f"case {k}" for k in range(count)] if names is None else list(map(str, names))
    if len(names) != count or len(set(names)) < count:
        raise ValueError(f"names: expected {count} different ones, one for each case")

    def of_one(solution):
        found = _results_of_case(structure, solution, places)
        for name, function in (also or {}).items():
            if name in found:
                raise ValueError(f"also: {name!r} is the name of another result")
            found[name] = function(solution)
        return found

    def extremes(solutions):
        values = values_of_cases(of_one, solutions)
        cases = [jax.tree.map(lambda x, s=s: extreme_cases(x, s), values) for s in (-1, 1)]
        ends = [jax.tree.map(_values_in_cases, values, which) for which in cases]
        return ends, cases, values

    (low, high), (low_case, high_case), values = evaluate_at_once(extremes, solutions)
    return ResultEnvelope(low, high, low_case, high_case, values, solutions.status, tuple(names))


def _nan_where_inactive(values, present):
    """Return results [n_elem] by group, NaN where elements are inactive.

    `present` is 1 where they are active, [n_elem] by group; None: all are.
    """
    if present is None:
        return values
    return jax.tree.map(
        lambda x, there: None if x is None else jnp.where(there > 0, x, jnp.nan),
        values,
        present,
        is_leaf=lambda x: x is None,
    )


def _results_of_case(structure, solution, places):
    """Return the results of one case that an envelope covers, by name.

    Section forces are those at as many `places` along each beam.
    """
    found = {
        "tension": _nan_where_inactive(solution.peak_tension, solution.present),
        "displacement": solution.displacement,
        "reactions": solution.reactions,
    }
    if solution.reaction_moments is not None:
        found["reaction_moments"] = solution.reaction_moments
        found["rotation"] = rotation_vectors(structure, solution)
    if any(isinstance(group, Bending) for group in structure.groups):
        forces = section_forces(structure, solution, places)
        for k, name in enumerate(_SECTION_FORCES):
            found[name] = jax.tree.map(lambda x, k=k: x[..., k], forces)
    if any(isinstance(group, CATENARIES) for group in structure.groups):
        found["sag"] = jax.tree.map(
            lambda x: x.midspan, sags(structure, solution), is_leaf=lambda x: hasattr(x, "midspan")
        )
    stress = jax.tree.map(lambda x: x[-1], fibre_stress(structure, solution.phases[-1]))
    if jax.tree.leaves(stress):
        found["stress"] = stress
    return found
