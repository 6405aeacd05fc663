"""What an analysis returns, and how good it is."""

from __future__ import annotations

from typing import Any, ClassVar

import jax
import jax.numpy as jnp

from ..common import checks, status
from ..common.tree import Indices, apply_numpy_or_jax, pytree
from ..common.types import Array, Bool, Float, Int
from ..mechanics.restart_state import RestartState
from ..model.supports import FixedDofs
from ..model.topology import Topology
from ..numerics import implicit
from .phase_results import PhaseResults
from .results import StateResults


@pytree(static=("fixed", "topology"), kw_only=True)
class State(StateResults):
    """The state at the end of the last converged increment; another analysis can start from it.

    An increment has converged if its status is OK. `phase` and `load_factor` say which one it is:

    - If the analysis has converged: the end of its last phase.
    - If it has failed in the middle of a phase: the last increment of that phase that converged.
    - If no increment of that phase converged: the end of the phase before it.
    - If no increment has converged at all (`phase` is -1, `load_factor` 0): the state that `start`
      gave, else the initial structure without loads, which need not be in equilibrium.

    In the middle of a phase, at the load factor f:

    - Loads of the phase act, and its movements of supports have taken place, by f.
    - Inputs of prestress and changes of temperature have gone the part f of the way: every
      unstressed length is between those at the beginning and at the end of the phase.
    - A jack has the force between that at the beginning of the phase and the stated one. It is
      anchored: `rest_length` and `restart` have the unstressed length that gives this force here.
    - The supports are those of the phase. Reactions of freedoms that it frees still act by 1 - f,
      as nodal loads: `load` includes them, and a further phase keeps them.
    - Laws remember what they did at the end of this increment (`memory` of `restart.states`, a
      state for each element group).

    A further phase (``solve(..., start=state)``) adds to all this; it does not complete the phase
    that failed.

    Its results are NaN only if numbers of the structure itself are not finite or break their
    rules: then there is no state.

    Attributes:
        displacement, positions, tension, peak_tension, rest_length, reactions, load, rotation,
            reaction_moments, section_forces: as of `Solution`.
        phase: number of the phase that the state belongs to, from 0 in every analysis; -1 before
            the first increment.
        load_factor: load factor of that phase.
        restart: `RestartState`, what a further phase starts from.
        fixed: supported freedoms before the first phase and in each phase, `FixedDofs` [n_node, 3]
            each (with beams 6, and more rows for hinged ends and inner numbers of elements).
        topology: `Topology` of the structure; a structure that starts from here must have the same.

    Example:
        The last converged state of an analysis that failed in its second phase:

        >>> structure, phases = jc.scenes.flat_net(load=15.0)
        >>> failed = jc.solve(structure, phases, jc.Newton(max_steps=1))
        >>> jc.describe(failed.status)[:20]
        'no equilibrium found'
        >>> last = failed.last  # the end of phase 0, prestress
        >>> print(last.phase, last.load_factor, jnp.round(last.tension[0], 6))
        0 1.0 200.0
    """

    _shown: ClassVar[str] = "phase, load_factor, displacement m, tension N, reactions N"

    phase: Int[Array, ""]
    load_factor: Float[Array, ""]
    restart: RestartState
    fixed: tuple[FixedDofs, ...]
    topology: Topology | None = None


@pytree(static=("links",), kw_only=True)
class Solution(StateResults):
    """Result of `solve`.

    Everything but `status`, `last` and the counts in `phases` is NaN, with NaN derivatives, unless
    the status is OK. In a batch, compute from `last` first and select by status after that:
    ``jnp.where(s.status == 0, f(s.last), 0.0)``. (Selecting between values of the solution itself
    works only if ``f`` is linear: the derivative of another ``f`` at NaN is NaN, also times zero.)

    Its arrays are JAX arrays, also outside of jit: read-only, indexed by numbers (out of range they
    mean the nearest one), slices, masks, ``reactions[np.array([0, 10])]``, but by no list. NumPy's
    rules are those of ``np.asarray(reactions)``; ``np.array(reactions)`` is a copy to write to.

    Attributes:
        status: code of the first failure, or 0; `describe` has the texts.
        stable: whether the end is stable, as in `PhaseResult`; if not, the status may be OK, too.
        displacement: from the initial nodes, over all phases, [n_node, 3], m.
        positions: of the nodes, [n_node, 3], m.
        tension: axial force per element in the shape of `elements`, each [n_elem], N; of catenaries
            the mean of both ends.
        peak_tension: the axial force of largest size along each element, likewise: what strength is
            judged by. Of catenaries the larger end tension (its derivative jumps where both ends
            are equal), of all others `tension`.
        rest_length: unstressed length per element at its present temperature, likewise, m: at the
            end the cutting list (`report` gives it at the temperature before the first phase).
        reactions: forces of the supports on the structure, [n_node, 3], N.
        load: all loads that act, those of earlier phases included, [n_node, 3], N.
        rotation: unit quaternion of every node, scalar first, [n_node, 4]; None without beams.
        reaction_moments: moments of the supports on the structure, [n_node, 3], N m, likewise.
        section_forces: ``N, Vy, Vz, T, My, Mz`` at the `points` of beams from end to end
            (Gauss-Lobatto points: the ends and the middle of 3), in the shape of `elements`, each
            [n_elem, n_point, 6] or None for other groups, N and N m; None without beams.
            `section_forces` has their signs, and gives them at any place.
        results: further results of elements by name, each in the shape of `elements`: those that
            elements of your own state, and `present` where elements come and go. `element_results`
            has all.
        last: `State` at the end of the last converged increment. If the analysis has converged, the
            end of the last phase; if it has failed, the state before that, as `State` says.
        phases: one `PhaseResult` per phase, a sequence (`PhaseResults`).
        links: node numbers of the elements, one [n_elem, n_end] per group.

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

    _shown: ClassVar[str] = "stable, phases, displacement m, tension N, reactions N"

    status: Int[Array, ""]
    last: State
    phases: PhaseResults
    links: tuple[Indices, ...] = ()
    stable: Bool[Array, ""]

    def displacement_since(self, phase: int) -> Float[Array, "n_node 3"]:
        """Return the displacements from the geometry in which a phase began, to the end, m.

        Args:
            phase: number of the phase, from 0; negative numbers count from the end.

        Returns:
            [n_node, 3], NaN if the analysis has failed. Since phase 0 of an analysis with ``start``
            these are the displacements without those of the earlier analysis. Where later phases
            put new nodes into place (``placed="attached"``), this counts as a displacement.

        Example:
            >>> structure, phases = jc.scenes.flat_net(load=15.0)
            >>> solution = jc.solve(structure, [*phases, jc.Phase(shortening=1e-4)])
            >>> for moved in (solution.displacement, solution.displacement_since(2)):
            ...     print(solution.status, f"{1e3 * moved[3, 2]:.3f} mm")
            0 -11.845 mm
            0 0.993 mm
        """
        at = ..., range(len(self.phases))[phase], slice(None), slice(None)
        ends = self.displacement, self.phases.moved_before
        return apply_numpy_or_jax(lambda _, there, before: there - before[at], *ends)


def last_state_or_nan(of: Any) -> Any:
    """Return the last `State` of a `Solution`, with NaN for all its floats if the analysis failed.

    Derivatives are NaN then, too, and an InputWarning tells how to give the last converged state
    instead. What is no `Solution` is returned as it is.
    """
    if not isinstance(of, Solution):
        return of
    code = checks.array_if_known(of.status)
    if code is not None and (code == status.OK).all():
        return of.last
    if code is not None and code.ndim == 0:
        checks.warn_user(
            f"state: the analysis has failed ({status.describe(int(code))}), results are NaN; give "
            "solution.last for its last converged state"
        )
    tree: Any
    leaves, tree = jax.tree.flatten(of.last)
    floats = [k for k, x in enumerate(leaves) if jnp.issubdtype(jnp.result_type(x), jnp.floating)]
    known = [jnp.asarray(leaves[k]) for k in floats]
    # the last state need not depend on what failed, but results of the solution do
    by = known, of.displacement
    marked = implicit.nan_unless(jnp.asarray(of.status) == status.OK, known, by)
    for k, x in zip(floats, marked, strict=True):
        leaves[k] = x
    return tree.unflatten(leaves)
