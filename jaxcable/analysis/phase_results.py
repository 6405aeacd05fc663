"""What an analysis returns of its phases: their ends, and the increments on the way."""

from __future__ import annotations

from collections.abc import Sequence
from typing import ClassVar, overload

import jax
import numpy as np

from ..common.tree import apply_numpy_or_jax, copy_with, pytree
from ..common.types import Array, Bool, Float, Int, PyTree
from .results import ElementResults, StateResults


@pytree
class Path(ElementResults):
    """The increments of a phase, one entry each.

    Attributes:
        load_factor: load factors, [n_inc].
        displacement: from the initial nodes, over all phases, [n_inc, n_node, 3], m; NaN from a
            failure on.
        displacement_in_phase: from the geometry in which the phase began, likewise.
        tension: axial forces in the shape of `elements`, each [n_inc, n_elem], N; NaN from a
            failure on.
        peak_tension: likewise, as of `Solution`.
        status: codes, [n_inc]; from a failure on the code of this failure.
        iterations: linear solves, [n_inc].
        factorizations: factorisations of the stiffness, [n_inc]; with sparse matrices an earlier
            factor often serves several solves.
        residual: largest unbalanced force at a free freedom, [n_inc], N.
        relative_residual: `residual` over the force that it is judged by (see `Newton.tol`),
            [n_inc].
        rounding: largest residual that the rounding of displacements leaves, [n_inc], N (0 where no
            element states any): of those at the end or, if more, at the start; see `Newton.tol`.
        n_slack: number of slack cables and open contacts, [n_inc]; -1 from a failure on.
        n_loose: number of nodes that touch only slack elements, [n_inc]; -1 from a failure on.
        equilibrated: whether `Incremental` solved this increment to equilibrium, [n_inc].
        strain: strains of the fibres in the shape of `elements`, NaN from a failure on: of bars and
            cables with a law or section [n_inc, n_elem]; of beams ``e0, ky, kz`` at the integration
            points, [n_inc, n_elem, n_point, 3], including the bending by loads along them. None for
            a group that has a stiffness only, and None altogether if all groups are such.
            `fibre_stress` makes stresses of them.
        stable: whether each increment is stable, as in `PhaseResult`, [n_inc] bool; None unless
            `Newton(watch=True)` asks for it.
        motion: of structures with beams, the motion of every row (nodes, hinged ends, inner numbers
            of elements) from the initial geometry, displacement and unit quaternion,
            [n_inc, n_row, 7]; NaN from a failure on. None without beams, where displacements are
            the whole motion. `energy_balance` reads it; files of results do not have it.

    Example:
        >>> structure, phases = jc.scenes.flat_net(load=15.0)
        >>> solution = jc.solve(structure, phases)
        >>> int(solution.status)
        0
        >>> path = solution.phases[1].path
        >>> for k in (0, 4, 9):
        ...     print(f"{path.load_factor[k]:.1f} {1e3 * path.displacement[k, 3, 2]:.3f} mm")
        0.1 -1.497 mm
        0.5 -7.130 mm
        1.0 -12.838 mm
        >>> int(path.n_slack.max()), bool(path.relative_residual.max() < 1e-10)
        (0, True)
    """

    _shown: ClassVar[str] = "load_factor, displacement m, tension N, residual N, iterations"

    load_factor: Float[Array, " n_inc"]
    displacement: Float[Array, "n_inc n_node 3"]
    tension: PyTree[Float[Array, "n_inc n_elem"]]
    status: Int[Array, " n_inc"]
    iterations: Int[Array, " n_inc"]
    factorizations: Int[Array, " n_inc"]
    residual: Float[Array, " n_inc"]
    relative_residual: Float[Array, " n_inc"]
    rounding: Float[Array, " n_inc"]
    n_slack: Int[Array, " n_inc"]
    n_loose: Int[Array, " n_inc"]
    equilibrated: Bool[Array, " n_inc"]
    strain: PyTree[Float[Array, "n_inc n_elem ..."]] | None = None
    peak_tension: PyTree[Float[Array, "n_inc n_elem"]] = None
    stable: Bool[Array, " n_inc"] | None = None
    motion: Float[Array, "n_inc n_row 7"] | None = None
    displacement_in_phase: Float[Array, "n_inc n_node 3"] = None  # type: ignore[assignment]  # `PhaseResults` adds it
    results: dict[str, PyTree[Float[Array, "n_inc n_elem ..."]]] | None = None


@pytree(kw_only=True)
class PhaseResult(StateResults):
    """The end of a phase and its path; NaN if this phase or an earlier one has failed.

    Attributes:
        status: code at the end of the phase.
        stable: whether the tangent stiffness at the end of the phase is positive definite (to
            rounding): a structure that is pushed aside a little comes back. False for one that
            turns or moves freely, too; nodes that only slack elements hold do not count, nor do
            straight lines of beams that spin about themselves. In cable nets under dead load it is
            True without a check, because their energy is convex. False where the phase has not been
            reached. Where nodal moments, following loads or elements make the
            tangent unsymmetric, its symmetric part is judged (Hill 1958): True excludes that the
            structure diverges, for all eigenvalues have positive real parts, but not that it
            flutters; False does not prove that it is unstable.
        displacement: from the initial nodes, over all phases so far, [n_node, 3], m.
        displacement_in_phase: from the geometry in which the phase began, [n_node, 3], m.
        positions, tension, peak_tension, rest_length, reactions, load, rotation,
            reaction_moments, section_forces: as of `Solution`.
        path: `Path`.
        began: memory of the laws when the phase began (such as plastic strains), in the shape of
            `elements`, or None.

    Example:
        >>> structure, phases = jc.scenes.flat_net(load=15.0)
        >>> prestress, loading = jc.solve(structure, phases).phases
        >>> int(prestress.status), int(loading.status)
        (0, 0)
        >>> print(f"{prestress.tension[0]:.3f} N, {loading.tension[0]:.3f} N")
        200.000 N, 233.760 N
        >>> print(f"{1e3 * loading.displacement_in_phase[3, 2]:.3f} mm")
        -12.838 mm
        >>> print(prestress.load[:, 2].sum(), loading.load[:, 2].sum())  # N
        0.0 -60.0
    """

    _shown: ClassVar[str] = "stable, displacement m, tension N, reactions N, path"

    status: Int[Array, ""]
    path: Path
    began: PyTree[Array] | None = None
    stable: Bool[Array, ""]
    displacement_in_phase: Float[Array, "n_node 3"] = None  # type: ignore[assignment]  # `PhaseResults` adds it


LOG_COLUMNS = (
    "status",
    "iterations",
    "factorizations",
    "residual",
    "scale",
    "rounding",
    "equilibrated",
    "stable",
    "n_slack",
    "n_loose",
)
"""Columns of the log of increments: one array, because many small ones take long to compile."""

_COLUMN_TYPES = dict.fromkeys(("residual", "scale", "rounding")) | {
    "equilibrated": bool,
    "stable": bool,
}
"""Types of the columns that are not int32; None: float, as in the log."""


@pytree(static=("increments", "watched"))
class PhaseResults(Sequence[PhaseResult]):
    """The results of all phases: a sequence of `PhaseResult`, stored as stacked arrays.

    Attributes:
        ends: one `PhaseResult` without path, whose arrays have an axis [n_phase] after those of
            batches.
        moved_before: displacements from the initial nodes to the geometry in which each phase
            began, likewise [n_phase, n_node, 3], m.
        paths: one `Path` of all that is not in the log, likewise with axes [n_phase, n_inc]; phases
            with fewer increments are padded.
        log: the numbers `LOG_COLUMNS` of every increment, [n_phase, n_inc, 10].
        increments: number of increments of every phase, a tuple.
        watched: whether the stability of every increment was judged (`Newton.watch`).

    Example:
        >>> structure, phases = jc.scenes.flat_net(load=15.0)
        >>> results = jc.solve(structure, phases).phases
        >>> len(results), [phase.path.load_factor.shape for phase in results]
        (2, [(1,), (10,)])
    """

    _shown: ClassVar[str] = "increments"

    ends: PhaseResult
    moved_before: Float[Array, "n_phase n_node 3"]
    paths: Path
    log: Float[Array, "n_phase n_inc 10"]
    increments: tuple[int, ...]
    watched: bool

    def __len__(self) -> int:
        return len(self.increments)

    @overload
    def __getitem__(self, number: int) -> PhaseResult: ...  # one phase, from 0 or from the end
    @overload
    def __getitem__(self, number: slice) -> tuple[PhaseResult, ...]: ...  # several phases
    def __getitem__(self, number):
        if isinstance(number, slice):
            return tuple(self[k] for k in range(*number.indices(len(self))))
        k = range(len(self))[number]
        batch, count = (slice(None),) * (self.log.ndim - 3), self.increments[k]
        increments = (*batch, k, slice(count))
        end, path = _index_tree(self.ends, (*batch, k)), _index_tree(self.paths, increments)
        noted = {
            name: self._log_column(name, increments) for name in LOG_COLUMNS if name != "scale"
        }
        noted["stable"] = noted["stable"] if self.watched else None
        moved_before = self.moved_before
        end, path = (
            copy_with(
                part,
                displacement_in_phase=apply_numpy_or_jax(
                    lambda _, there, before, at=at: there - before[at],
                    part.displacement,
                    moved_before,
                ),
            )
            for part, at in ((end, (*batch, k)), (path, (*batch, k, None)))
        )
        path = copy_with(
            path,
            load_factor=apply_numpy_or_jax(
                lambda np, log: _load_factors(np, log[increments]), self.log
            ),
            relative_residual=apply_numpy_or_jax(
                lambda np, log: _relative_residuals(np, log[increments]), self.log
            ),
            **noted,
        )
        last = (*batch, k, count - 1)
        status, stable = self._log_column("status", last), self._log_column("stable", last)
        return copy_with(end, status=status, stable=stable, path=path)

    def _log_column(self, name, at):
        """Return column `name` of the log in its dtype, at an index `at` of the leading axes."""
        kind, column = _COLUMN_TYPES.get(name, "int32"), LOG_COLUMNS.index(name)

        def read(np, log):
            values = log[at][..., column]
            return values if kind is None else values.astype(kind)

        return apply_numpy_or_jax(read, self.log)

    @property
    def status_and_stability(self) -> tuple[Int[Array, " n_phase"], Bool[Array, " n_phase"]]:
        """Status of every phase, and whether its end is stable: two arrays [n_phase]."""
        last = np.arange(len(self)), np.array(self.increments) - 1
        return self._log_column("status", last), self._log_column("stable", last)


def _index_tree(tree, at):
    """Return a pytree with ``x[at]`` for every array x, of NumPy where x is.

    An array that occurs twice is indexed once.
    """
    found = {}

    def take(x):
        if id(x) not in found:
            found[id(x)] = apply_numpy_or_jax(lambda np, x: x[at], x)
        return found[id(x)]

    return jax.tree.map(take, tree)


def _load_factors(np, log):
    """Return the load factors 1/n, 2/n, ..., 1 of n increments, [..., n].

    `np` is the module to compute with, `log` that of the increments, [..., n, 10].
    """
    count = log.shape[-2]
    return np.broadcast_to(np.arange(1, count + 1, dtype=log.dtype) / count, log.shape[:-1])


def _relative_residuals(np, log):
    """Return ``residual / scale`` of increments, [..., n], from their `log`, [..., n, 10].

    It is the residual itself where the scale is zero; `np` is the module to compute with.
    """
    scale = log[..., LOG_COLUMNS.index("scale")]
    return log[..., LOG_COLUMNS.index("residual")] / np.where(scale > 0, scale, 1.0)
