"""The matrix of a Newton step of a structure that is no net of cables.

It is the tangent stiffness with three changes: elements with a chord have the geometric stiffness
of their predicted axial forces (`predicted_forces`), cables beside other elements have the
stiffness of the interior-point method in its steps (`partial_net`), and the diagonal is shifted.
"""

from __future__ import annotations

from typing import NamedTuple

import jax.numpy as jnp

from ..common.types import Array, Bool, Float
from ..linear import Matrix
from ..mechanics.assembly import System
from .interior_point import LengthBoundEquations
from .newton_state import NewtonState
from .newton_step import max_abs, zero_eigenvalue_bound
from .partial_net import PartialNet
from .predicted_forces import is_prediction_step


class StepMatrix(NamedTuple):
    """The matrix of a Newton step, and what the evaluation of the step needs of it.

    Attributes:
        matrix: the matrix without the shift of its diagonal, [n_free, n_free], N/m.
        shift: number to add to its diagonal, N/m.
        predicting: whether it has the geometric stiffness of predicted axial forces; None where no
            element has a chord.
        slopes: derivatives of the axial forces by the lengths of elements with a chord, [n], N/m;
            None where there is no such element.
        cable_equations: linear equations of the cables beside other elements, whose slopes the
            matrix has; None where there is no such cable.
    """

    matrix: Matrix
    shift: Float[Array, ""]
    predicting: Bool[Array, ""] | None
    slopes: Float[Array, " n"] | None
    cable_equations: LengthBoundEquations | None


def step_matrix(
    system: System,
    partial_net: PartialNet | None,
    state: NewtonState,
    length: Float[Array, ""],
    is_full: Bool[Array, ""],
    converged: Bool[Array, ""],
) -> StepMatrix:
    """Assemble the matrix of the next Newton step from the point `state.x`.

    Args:
        system: `System` of the whole structure, no net.
        partial_net: its cables beside other elements; None if it has none.
        state: `NewtonState`.
        length: mean length of elements, m.
        is_full: whether the step is one of the full steps with which an iteration may begin, which
            have no predicted forces.
        converged: whether the point is an equilibrium. The matrix is then the tangent itself, with
            a shift down by rounding only, so that it tells whether the equilibrium is stable.
    """
    tangents, chords = state.elements
    size, predicting, slopes, cables = max_abs(state.residual), None, None, None
    if partial_net is not None:
        unknowns = state.tension_unknowns.with_mixed_mode_if(converged)
        cables = partial_net.equations(state.x, tangents, unknowns, state.residual, length)
        tangents = partial_net.tangents(state.x, tangents, cables)
    if state.predicted is not None:
        predicting = is_prediction_step(state.steps) & ~is_full & ~converged
        if partial_net is not None:
            predicting = predicting | (unknowns.takes_interior_or_finishing_steps & ~converged)
        forces = state.predicted.geometric_forces(chords, predicting)
        if partial_net is not None:
            forces = partial_net.geometric_forces(forces, chords.force, unknowns)
        tangents = system.tangents(state.x, tangents)
        slopes = chords.axial_stiffness(system, tangents)
        tangents = chords.with_geometric_stiffness(system, tangents, forces)
        # after a step sideways R is that of EA, and so would be the shift
        size = jnp.minimum(size, jnp.max(jnp.abs(forces)) + state.start_residual)
    shift = state.shift.value(size, length)
    matrix = system.tangent(state.x, tangents)
    if system.space.rotates:
        shift = jnp.where(is_full, 0.0, shift)
    if partial_net is not None or not system.always_convex:
        least = zero_eigenvalue_bound(matrix)
        shift = jnp.where(converged, -least, shift)
    if partial_net is not None:
        damping = jnp.maximum(cables.unknowns.interior_point.damping, least)
        shift = jnp.where(unknowns.uses_interior_point, damping, shift)
    return StepMatrix(matrix, shift, predicting, slopes, cables)
