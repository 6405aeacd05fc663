"""The matrix of a step of a structure that is no net of cables: tangent and predicted forces."""

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
    """Matrix of a step, and what it is made from.

    Attributes:
        matrix: without the shift, N/m.
        shift: of its diagonal, N/m.
        predicting: whether it has predicted forces; None where no element has a chord.
        slopes: derivatives of axial forces by lengths, [n], N/m, or None likewise.
        cables: equations of cables beside other elements, or None.
    """

    matrix: Matrix
    shift: Float[Array, ""]
    predicting: Bool[Array, ""] | None
    slopes: Float[Array, " n"] | None
    cables: LengthBoundEquations | None


def step_matrix(
    system: System,
    partial: PartialNet | None,
    state: NewtonState,
    length: Float[Array, ""],
    is_full: Bool[Array, ""],
    converged: Bool[Array, ""],
) -> StepMatrix:
    """Return the matrix of a step.

    Args:
        system: `System`.
        partial: its cables beside other elements.
        state: `NewtonState`.
        length: of elements, m.
        is_full: whether the step is a full one, without line search.
        converged: whether its point is an equilibrium, which is judged by the tangent.
    """
    tangents, chords = state.elements
    size, predicting, slopes, cables = max_abs(state.residual), None, None, None
    if partial is not None:
        unknowns = state.tension_unknowns.with_mixed_steps_if(converged)
        cables = partial.equations(state.x, tangents, unknowns, state.residual, length)
        tangents = partial.tangents(state.x, tangents, cables)
    if state.predicted is not None:
        predicting = is_prediction_step(state.steps) & ~is_full & ~converged
        if partial is not None:
            predicting = predicting | (unknowns.takes_whole_steps & ~converged)
        forces = state.predicted.geometric_forces(chords, predicting)
        if partial is not None:
            forces = partial.geometric_forces(forces, chords.force, unknowns)
        tangents = system.tangents(state.x, tangents)
        slopes = chords.axial_stiffness(system, tangents)
        tangents = chords.with_geometric_stiffness(system, tangents, forces)
        # after a step sideways R is that of EA, and so would be the shift
        size = jnp.minimum(size, jnp.max(jnp.abs(forces)) + state.start_residual)
    shift = state.shift.value(size, length)
    matrix = system.tangent(state.x, tangents)
    if system.space.rotates:
        shift = jnp.where(is_full, 0.0, shift)
    if partial is not None or not system.always_convex:
        least = zero_eigenvalue_bound(matrix)
        shift = jnp.where(converged, least, shift)
    if partial is not None:
        damping = jnp.maximum(cables.unknowns.interior_point.damping, least)
        shift = jnp.where(unknowns.is_interior, damping, shift)
    return StepMatrix(matrix, shift, predicting, slopes, cables)
