"""Energy balance of an analysis: work against stored and dissipated energy.

Loads, supports, prestress and temperature do work on a structure:

    work of dead and follower loads, of moved and released supports, of prestress and temperature
        = change of stored energy + dissipated energy + imbalance.

The left side comes from forces and displacements at the ends of the increments, by the trapezoidal
rule. The energies are those of the elements, by formulas that do not use their forces. If the
structure is in equilibrium all along, the imbalance is the error of the trapezoidal rule, of second
order in the increment. An imbalance that does not fall in this way shows that forces, loads and
energies do not fit together, or that the state has jumped: a phase began out of balance, or the
structure snapped between two increments.
"""

from __future__ import annotations

from collections.abc import Sequence

import jax
import numpy as np

from ..analysis.as_built import with_lengths_as_built
from ..analysis.phases import Phase
from ..analysis.preparation import prepare
from ..analysis.solution import Solution, State
from ..analysis.solver import solve
from ..common.checks import without_warnings
from ..common.tree import pytree
from ..common.types import Float
from ..equilibrium.incremental import Incremental
from ..equilibrium.newton import Newton
from ..model.result_parts import require_single_case
from ..model.structure import Structure
from ..model.topology import require_same_topology
from .increment_works import end_fingerprint, increment_works

WORKS = ("dead", "following", "supports", "prestress")
"""Names of the fields of `EnergyBalance` with work."""

# Part of the stored energy below which all terms of a phase count as rounding: they are differences
# of it, and Newton's residual is 1e-10 of the forces.
_ROUNDING = 1e-9


@pytree
class EnergyBalance:
    """Work and energy in each phase of an analysis, J; the result of `energy_balance`.

    Attributes:
        dead: work of dead loads, on the displacements of nodes, on deflections within elements, and
            on the sliding of ropes, [n_phase].
        following: work of follower loads, [n_phase].
        supports: work of supports that are moved, and of the reactions of released supports, which
            decrease to zero in the phase, [n_phase].
        prestress: work of jacks and turnbuckles, of heat, and of all other changes of unstressed
            lengths, on the elements, [n_phase].
        stored: change of the stored energy of the elements, [n_phase]. It does not include the
            potential of weight, which counts as work.
        dissipated: energy dissipated by laws with history variables (plasticity), [n_phase].
        level: stored energy at the end of each phase, or where the phase failed, [n_phase].
        increments: work minus stored and dissipated energy in every increment, a tuple with an
            array [n_inc] for each phase.

    Example:
        600 N on a cable of 5 m and EA = 100 kN, whose force is linear in the displacement, so that
        the trapezoidal rule is exact with a single increment:

        >>> cable = jc.Cables([[0, 1]], axial_stiffness=1e5)
        >>> held = np.array([[True, True, True], [True, True, False]])
        >>> nodes = [[0.0, 0.0, 5.0], [0.0, 0.0, 0.0]]
        >>> structure = jc.Structure(nodes, cable, supports=jc.Supports(held))
        >>> phases = [jc.Phase(loads=jc.NodalLoads([1], (0.0, 0.0, -600.0)))]
        >>> balance = jc.energy_balance(structure, phases, jc.solve(structure, phases))
        >>> print(f"{balance.dead[0]:.3f} J, {balance.stored[0]:.3f} J")  # F^2 L0 / 2 EA
        9.000 J, 9.000 J
    """

    dead: Float[np.ndarray, " n_phase"]
    following: Float[np.ndarray, " n_phase"]
    supports: Float[np.ndarray, " n_phase"]
    prestress: Float[np.ndarray, " n_phase"]
    stored: Float[np.ndarray, " n_phase"]
    dissipated: Float[np.ndarray, " n_phase"]
    level: Float[np.ndarray, " n_phase"]
    increments: tuple[Float[np.ndarray, " n_inc"], ...]

    @property
    def work(self) -> Float[np.ndarray, " n_phase"]:
        """Work of dead and follower loads, supports and prestress together, [n_phase], J."""
        return sum(getattr(self, name) for name in WORKS)

    @property
    def imbalance(self) -> Float[np.ndarray, " n_phase"]:
        """Work minus stored and dissipated energy, [n_phase], J."""
        return self.work - self.stored - self.dissipated

    @property
    def relative_imbalance(self) -> Float[np.ndarray, " n_phase"]:
        """Absolute imbalance over the largest of all terms of the phase, [n_phase], -.

        The divisor is at least 1e-9 of the stored energy: smaller terms are rounding.
        """
        terms = [*(getattr(self, name) for name in WORKS), self.stored, self.dissipated]
        largest = np.max(np.abs([*terms, _ROUNDING * self.level]), axis=0)
        return np.abs(self.imbalance) / np.where(largest > 0, largest, 1.0)


def energy_balance(
    structure: Structure,
    phases: Phase | Sequence[Phase],
    solution: Solution,
    start: Solution | State | None = None,
    method: Newton | Incremental | None = None,
) -> EnergyBalance:
    """Balance the work of loads, supports and prestress with stored and dissipated energy.

    The balance is computed from the increments of the solution, without another analysis (but
    lengths that follow from prestress as built, such as `end_tension`, are found again). If a
    phase failed, it has the increments before the failure, and later phases have zero terms.

    Args:
        structure: `Structure` that was analysed.
        phases: phases of the analysis, as given to `solve`.
        solution: the `Solution`.
        start: solution or state that the analysis was started from, as given to `solve`.
        method: as given to `solve`; for prestress as built only.

    Returns:
        `EnergyBalance`, NumPy; not for use in transformations.

    Raises:
        ValueError: `solution` is a batch or being traced, has another number of phases, or does not
            end where these phases end (as if `start` were missing); phases add or remove elements;
            those of `solve`.

    Example:
        200 N of pretension in all cables of a net, then 15 N on each of its four free nodes:

        >>> structure, phases = jc.scenes.flat_net(load=15.0)
        >>> balance = jc.energy_balance(structure, phases, jc.solve(structure, phases))
        >>> print(f"{balance.prestress[0]:.4f} J of prestress, {balance.dead[1]:.4f} J of load")
        0.9779 J of prestress, 0.3576 J of load
        >>> bool(balance.relative_imbalance.max() < 0.01)
        True
    """
    require_single_case(solution)
    require_same_topology(structure, solution.last.topology, "solution")
    with without_warnings():  # the analysis has issued them
        phases, _ = with_lengths_as_built(structure, phases, method, start, solve)
        task = prepare(structure, phases, None, start)
    if task.without_indices[3].present_at_start is not None:
        raise ValueError("phases: there is no energy balance where phases add or remove elements")
    counts = task.without_indices[3].increments
    if len(counts) != len(solution.phases):
        raise ValueError(f"phases: got {len(counts)}, the solution has {len(solution.phases)}")
    paths = [phase.path for phase in solution.phases]
    for k, (count, path) in enumerate(zip(counts, paths, strict=True)):
        if count != len(path.status):
            raise ValueError(
                f"phases[{k}]: has {count} increments, in the solution {len(path.status)}"
            )
    records = [(p.status, p.displacement if p.motion is None else p.motion) for p in paths]
    arguments = task.without_indices, task.arrays, records
    found = increment_works(*arguments, bundles=task.bundles)
    phase_terms, end = jax.tree.map(np.asarray, found)
    for computed, given in zip(end, end_fingerprint(solution.last.restart), strict=True):
        difference = np.abs(computed - np.asarray(given)).max()
        if difference > np.sqrt(np.finfo(computed.dtype).eps) * np.abs(computed).max():
            raise ValueError(
                "solution: does not end where these phases end; if its analysis was started from "
                "another solution or state, give that as start"
            )
    sums = np.array([[*terms.sum(axis=1), level] for terms, level in phase_terms]).T
    n = len(WORKS)
    increments = tuple(terms[:n].sum(axis=0) - terms[n:].sum(axis=0) for terms, _ in phase_terms)
    return EnergyBalance(*sums, increments)  # type: ignore[call-arg]  # `sums` has seven entries
