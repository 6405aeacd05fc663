"""What an analysis returns, and how good it is."""

from __future__ import annotations

from collections.abc import Sequence
from typing import overload

import jax
import numpy as np

from ..common.tree import Indices, computed, copy, pytree
from ..common.types import Array, Bool, Float, Int, PyTree
from ..mechanics.ramp import Carry
from ..model.supports import Fixed
from ..model.topology import Topology
from .told import Told

PER_PHASE = (
    "displacement",
    "positions",
    "tension",
    "peak_tension",
    "rest_length",
    "reactions",
    "rotation",
    "reaction_moments",
    "section_forces",
    "results",
)
"""Results that a state, a phase and a solution have in common."""


@pytree(static=("fixed", "topology"))
class State(Told):
    """A converged state: the end of an analysis, or where it stopped.

    NaN only if the structure's own numbers are not finite: then there is no state.

    Attributes:
        displacement: from the initial nodes, over all phases, [n_node, 3], m.
        positions: [n_node, 3], m.
        tension: axial force per element in the shape of `elements`, each [n_elem], N; of catenaries
            the mean of both ends.
        peak_tension: the axial force of largest size along each element, likewise: what strength is
            judged by. Of catenaries the larger end tension (its derivative jumps where both ends
            are equal), of all others `tension`.
        rest_length: unstressed length per element at the temperature of the moment, likewise, m.
        reactions: forces of the supports on the structure, [n_node, 3], N.
        load: all loads that act, [n_node, 3], N.
        phase: number of the phase it belongs to, from 0; -1 before the first increment.
        load_factor: load factor of that phase.
        carry: what a further phase starts from.
        fixed: supported freedoms before the first phase and in each phase, `Fixed` [n_node, 3]
            each (with beams 6, and more rows for hinged ends and inner numbers of elements).
        rotation: unit quaternion of every node, scalar first, [n_node, 4]; None without beams.
        reaction_moments: moments of the supports on the structure, [n_node, 3], N m, likewise.
        section_forces: ``N, Vy, Vz, T, My, Mz`` at `points` places of beams from end to end, in the
            shape of `elements`, each [n_elem, n_point, 6] or None for other groups, N and N m; None
            without beams. `section_forces` has their signs, and gives them at any place.
        topology: `Topology` of the structure; one that goes on from here must have the same.

    Example:
        Where an analysis stopped that did not converge:

        >>> structure, phases = jc.scenes.flat_net(load=15.0)
        >>> failed = jc.solve(structure, phases, jc.Newton(max_steps=1))
        >>> jc.describe(failed.status)[:20]
        'no equilibrium found'
        >>> last = failed.last  # the end of phase 0, prestress
        >>> print(last.phase, last.load_factor, jnp.round(last.tension[0], 6))
        0 1.0 200.0
    """

    displacement: Float[Array, "n_node 3"]
    positions: Float[Array, "n_node 3"]
    tension: PyTree[Float[Array, " n_elem"]]
    rest_length: PyTree[Float[Array, " n_elem"]]
    reactions: Float[Array, "n_node 3"]
    load: Float[Array, "n_node 3"]
    phase: Int[Array, ""]
    load_factor: Float[Array, ""]
    carry: Carry
    fixed: tuple[Fixed, ...]
    rotation: Float[Array, "n_node 4"] | None = None
    reaction_moments: Float[Array, "n_node 3"] | None = None
    section_forces: PyTree[Float[Array, "n_elem n_point 6"]] | None = None
    peak_tension: PyTree[Float[Array, " n_elem"]] = None
    topology: Topology | None = None
    results: dict[str, PyTree[Float[Array, "n_elem ..."]]] | None = None


@pytree
class Path(Told):
    """The increments of a phase, one row each.

    Attributes:
        load_factor: [n_inc].
        displacement: from the geometry in which the phase began, [n_inc, n_node, 3], m; NaN from a
            failure on.
        tension: in the shape of `elements`, each [n_inc, n_elem], N; NaN from a failure on.
        peak_tension: likewise, as in `State`.
        status: codes, [n_inc]; from a failure on its code.
        iterations: linear solves, [n_inc].
        factorizations: factorisations of the stiffness, [n_inc]; with sparse matrices an earlier
            factor often serves several solves.
        residual: largest unbalanced force at a free freedom, [n_inc], N.
        relative_residual: the same over the force it is judged by (see `Newton.tol`), [n_inc].
        n_slack: number of slack elements, [n_inc]; -1 from a failure on.
        n_loose: number of nodes that touch only slack elements, [n_inc]; -1 from a failure on.
        equilibrated: whether `Incremental` solved this increment to equilibrium, [n_inc].
        strain: strains of the fibres in the shape of `elements`, NaN from a failure on: of bars and
            cables with a law or section [n_inc, n_elem]; of beams ``e0, ky, kz`` at the integration
            points, [n_inc, n_elem, n_point, 3], with what loads along them do. None for a group
            with a mere stiffness, and None altogether if there is nothing else. `fibre_stress`
            makes stresses of them.
        stable: whether each increment is stable, as in `PhaseResult`, [n_inc] bool; None unless
            `Newton(watch=True)` asks for it.
        motion: of structures with beams, the motion of every row (nodes, hinged ends, inner numbers
            of elements) from the initial geometry, displacement and unit quaternion,
            [n_inc, n_row, 7]; NaN from a failure on; None without beams, whose displacements say it
            all. `energy_balance` reads it; files of results do not have it.

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

    load_factor: Float[Array, " n_inc"]
    displacement: Float[Array, "n_inc n_node 3"]
    tension: PyTree[Float[Array, "n_inc n_elem"]]
    status: Int[Array, " n_inc"]
    iterations: Int[Array, " n_inc"]
    factorizations: Int[Array, " n_inc"]
    residual: Float[Array, " n_inc"]
    relative_residual: Float[Array, " n_inc"]
    n_slack: Int[Array, " n_inc"]
    n_loose: Int[Array, " n_inc"]
    equilibrated: Bool[Array, " n_inc"]
    strain: PyTree[Float[Array, "n_inc n_elem ..."]] | None = None
    peak_tension: PyTree[Float[Array, "n_inc n_elem"]] = None
    stable: Bool[Array, " n_inc"] | None = None
    motion: Float[Array, "n_inc n_row 7"] | None = None
    results: dict[str, PyTree[Float[Array, "n_inc n_elem ..."]]] | None = None


@pytree
class PhaseResult(Told):
    """The end of a phase and its path; NaN if it, or a phase before it, failed.

    Attributes:
        status: code at the end of the phase.
        stable: whether the tangent stiffness at the end of the phase has no negative eigenvalue (to
            rounding): a structure that is pushed aside a little comes back. True without being
            asked in cable nets under dead load, whose energy is convex; False where the phase has
            not been reached. Where nodal moments or following loads make the tangent unsymmetric,
            that of its symmetric part, which is on the safe side (Hill 1958).
        displacement: from the geometry in which the phase began, [n_node, 3], m.
        positions, tension, peak_tension, rest_length, reactions: as in `State`.
        rotation, reaction_moments, section_forces: of structures with beams, as in `State`.
        path: `Path`.
        began: what laws remembered when the phase began (plastic strains), in the shape of
            `elements`, or None.

    Example:
        >>> structure, phases = jc.scenes.flat_net(load=15.0)
        >>> prestress, loading = jc.solve(structure, phases).phases
        >>> int(prestress.status), int(loading.status)
        (0, 0)
        >>> print(f"{prestress.tension[0]:.3f} N, {loading.tension[0]:.3f} N")
        200.000 N, 233.760 N
        >>> print(f"{1e3 * loading.displacement[3, 2]:.3f} mm")
        -12.838 mm
    """

    status: Int[Array, ""]
    displacement: Float[Array, "n_node 3"]
    positions: Float[Array, "n_node 3"]
    tension: PyTree[Float[Array, " n_elem"]]
    rest_length: PyTree[Float[Array, " n_elem"]]
    reactions: Float[Array, "n_node 3"]
    path: Path
    rotation: Float[Array, "n_node 4"] | None = None
    reaction_moments: Float[Array, "n_node 3"] | None = None
    section_forces: PyTree[Float[Array, "n_elem n_point 6"]] | None = None
    began: PyTree[Array] | None = None
    peak_tension: PyTree[Float[Array, " n_elem"]] = None
    stable: Bool[Array, ""] = None  # type: ignore[assignment]  # an analysis puts it in
    results: dict[str, PyTree[Float[Array, "n_elem ..."]]] | None = None


LOG = (
    "status",
    "iterations",
    "factorizations",
    "residual",
    "scale",
    "equilibrated",
    "stable",
    "n_slack",
    "n_loose",
)
"""What is noted of an increment, numbers side by side: many small arrays take long to compile."""

_KINDS = {"residual": None, "scale": None, "equilibrated": bool, "stable": bool}  # others int32


@pytree(static=("increments", "watched"))
class PhaseResults(Sequence[PhaseResult]):
    """The results of all phases, a sequence of `PhaseResult`, kept as they were computed: stacked.

    Attributes:
        ends: a `PhaseResult` without path, its arrays with an axis [n_phase] after those of
            batches.
        paths: a `Path` of what is not in the log, likewise [n_phase, n_inc], phases of fewer
            increments filled up.
        log: the numbers `LOG` of every increment, [n_phase, n_inc, 9].
        increments: of every phase, a tuple.
        watched: whether the stability of every increment was asked for.

    Example:
        >>> structure, phases = jc.scenes.flat_net(load=15.0)
        >>> results = jc.solve(structure, phases).phases
        >>> len(results), [phase.path.load_factor.shape for phase in results]
        (2, [(1,), (10,)])
    """

    ends: PhaseResult
    paths: Path
    log: Float[Array, "n_phase n_inc 9"]
    increments: tuple[int, ...]
    watched: bool

    def __len__(self) -> int:
        return len(self.increments)

    @overload
    def __getitem__(self, number: int) -> PhaseResult: ...
    @overload
    def __getitem__(self, number: slice) -> tuple[PhaseResult, ...]: ...
    def __getitem__(self, number):
        if isinstance(number, slice):
            return tuple(self[k] for k in range(*number.indices(len(self))))
        k = range(len(self))[number]
        batch, count = (slice(None),) * (self.log.ndim - 3), self.increments[k]
        rows = (*batch, k, slice(count))
        end, path = _taken(self.ends, (*batch, k)), _taken(self.paths, rows)
        noted = {name: self._noted(name, rows) for name in LOG if name != "scale"}
        noted["stable"] = noted["stable"] if self.watched else None
        path = copy(
            path,
            load_factor=computed(lambda np, log: _factors(np, log[rows]), self.log),
            relative_residual=computed(lambda np, log: _relative(np, log[rows]), self.log),
            **noted,
        )
        last = (*batch, k, count - 1)
        status, stable = self._noted("status", last), self._noted("stable", last)
        return copy(end, status=status, stable=stable, path=path)

    def _noted(self, name, rows):
        kind, column = _KINDS.get(name, "int32"), LOG.index(name)

        def read(np, log):
            values = log[rows][..., column]
            return values if kind is None else values.astype(kind)

        return computed(read, self.log)

    @property
    def verdicts(self) -> tuple[Int[Array, " n_phase"], Bool[Array, " n_phase"]]:
        """Status and stability of every phase, two arrays [n_phase], of one analysis."""
        last = np.arange(len(self)), np.array(self.increments) - 1
        return self._noted("status", last), self._noted("stable", last)


def _taken(tree, at):
    """A part of every array in a tree; an array that stands in two places stays one."""
    found = {}

    def take(x):
        if id(x) not in found:
            found[id(x)] = computed(lambda np, x: x[at], x)
        return found[id(x)]

    return jax.tree.map(take, tree)


def _factors(np, log):
    """Load factors of increments, from their log [..., n_inc, 9]."""
    count = log.shape[-2]
    return np.broadcast_to(np.arange(1, count + 1, dtype=log.dtype) / count, log.shape[:-1])


def _relative(np, log):
    """Residuals over the forces that they are judged by."""
    scale = log[..., LOG.index("scale")]
    return log[..., LOG.index("residual")] / np.where(scale > 0, scale, 1.0)


@pytree(static=("links",))
class Solution(Told):
    """Result of `solve`.

    Everything but `status`, `last` and the counts in `phases` is NaN, with NaN derivatives, unless
    the status is OK. In a batch, compute from `last` first and select by status after that:
    ``jnp.where(s.status == 0, f(s.last), 0.0)``. (Selecting between values of the solution itself
    works only while ``f`` is linear; a derivative of ``f`` at NaN, times zero, is NaN.)

    Attributes:
        status: code of the first failure, or 0; `describe` has the texts.
        stable: whether the end is stable, as in `PhaseResult`. An unstable equilibrium is one: the
            status says OK.
        displacement: from the initial nodes, over all phases, [n_node, 3], m.
        positions: [n_node, 3], m.
        tension: axial force per element in the shape of `elements`, each [n_elem], N.
        peak_tension: the force of largest size along each element, as in `State`.
        rest_length: unstressed lengths at the end: the cutting list, likewise, m; at the
            temperature of the end (`report` has them at that before the first phase).
        reactions: forces of the supports on the structure, [n_node, 3], N.
        load: all loads that act at the end, [n_node, 3], N.
        last: the last converged `State`.
        phases: one `PhaseResult` per phase, a sequence (`PhaseResults`).
        links: node numbers of the elements, one [n_elem, n_end] per group.
        rotation, reaction_moments, section_forces: of structures with beams, as in `State`.

    Example:
        >>> structure, phases = jc.scenes.flat_net(load=15.0)
        >>> solution = jc.solve(structure, phases)
        >>> jc.describe(solution.status)
        'converged'
        >>> print(f"{solution.displacement[3, 2]:.9f} m")
        -0.012838093 m
        >>> print(f"{solution.rest_length[0]:.6f} m")  # 0.4 / (1 + 200 / 97970)
        0.399185 m
        >>> print(f"{solution.reactions[:, 2].sum():.6f} N")  # four loads of 15 N
        60.000000 N
    """

    status: Int[Array, ""]
    displacement: Float[Array, "n_node 3"]
    positions: Float[Array, "n_node 3"]
    tension: PyTree[Float[Array, " n_elem"]]
    rest_length: PyTree[Float[Array, " n_elem"]]
    reactions: Float[Array, "n_node 3"]
    load: Float[Array, "n_node 3"]
    last: State
    phases: PhaseResults
    links: tuple[Indices, ...] = ()
    rotation: Float[Array, "n_node 4"] | None = None
    reaction_moments: Float[Array, "n_node 3"] | None = None
    section_forces: PyTree[Float[Array, "n_elem n_point 6"]] | None = None
    peak_tension: PyTree[Float[Array, " n_elem"]] = None
    stable: Bool[Array, ""] = None  # type: ignore[assignment]  # an analysis puts it in
    results: dict[str, PyTree[Float[Array, "n_elem ..."]]] | None = None
