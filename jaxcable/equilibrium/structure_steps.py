"""Steps of structures that are no nets of cables: Newton's, with predicted axial forces.

The matrix is the tangent stiffness with three changes: elements with a chord have the geometric
stiffness of their predicted axial forces (`predicted_forces`), cables beside other elements have
the stiffness of the interior-point method in its steps (`partial_net`), and the diagonal is
shifted. `globalization` lists all shifts, and decides which steps are accepted: full ones first
where they pay, then those of a line search.
"""

from __future__ import annotations

from typing import Any, NamedTuple

import jax.numpy as jnp

from .. import linear
from ..common.batch_conditions import cond_in_batch
from ..common.tree import copy_with, pytree, select_tree
from ..common.types import Array, ArrayLike, Bool, Float
from ..linear import Matrix
from ..mechanics.assembly import System
from ..mechanics.chords import Chords, any_chords, second_minus_first_end
from ..numerics.line_search import LineSearch
from ..spaces.space import Motion
from .convergence import Convergence
from .globalization import ASTRAY, FullStepPhase, LevenbergShift
from .interior_point import TensionStepEquations
from .newton_state import Evaluation, NewtonState
from .newton_step import (
    max_abs,
    newton_direction,
    stability_shift,
    with_loose_nodes_held,
    zero_eigenvalue_bound,
)
from .partial_net import PartialNet
from .predicted_forces import PredictedForces, is_prediction_step
from .step_method import Choice, NextStep, StepMethod, Trial, Verdict
from .tension_unknowns import TensionUnknowns


@pytree
class StructureStrategy:
    """State of `StructureSteps`.

    Attributes:
        search: which length of the step is tried next (`line_search.LineSearch`).
        shift: Levenberg shift of the tangent.
        full_steps: `FullStepPhase` of structures that begin with full steps, else None.
        unknowns: tensions as unknowns, of cables beside other elements; None without such cables.
        predicted: predicted axial forces; None where no element has a chord.
    """

    search: LineSearch
    shift: LevenbergShift
    full_steps: FullStepPhase | None
    unknowns: TensionUnknowns | None
    predicted: PredictedForces | None


class StepMatrix(NamedTuple):
    """The matrix of a Newton step, and what the evaluation of the step needs of it.

    Attributes:
        matrix: the matrix with the shift of its diagonal, [n_free, n_free], N/m.
        predicting: whether it has the geometric stiffness of predicted axial forces; None where no
            element has a chord.
        tangents: matrices of all elements, [n_elem, d, d] per group, N/m, which say how axial
            forces change in the step; None where no element has a chord.
        cable_equations: linear equations of the cables beside other elements, whose slopes the
            matrix has; None where there is no such cable.
        chords: `Chords` with the forces of the springs that hold contacts closed
            (`predicted_forces`); None where no element has a chord.
        springs: internal force of these springs at every unknown, [n_free], N; None where there are
            no contacts.
    """

    matrix: Matrix
    predicting: Bool[Array, ""] | None
    tangents: list[Float[Array, "n_elem d d"]] | None
    cable_equations: TensionStepEquations | None
    chords: Chords | None
    springs: Float[Array, " n_free"] | None


class StructureSteps(StepMethod):
    """The method of structures that are no nets of cables."""

    farthest = 1e6  # no anchored structure reaches it

    def __init__(self, system: System, begin: Motion, convergence: Convergence):
        super().__init__(system, begin, convergence)
        predicts = system.predicts_axial_forces
        self.partial_net = PartialNet.from_system(system) if predicts else None
        # a net beyond the peak of a law finds where its curve ends by the true forces
        softens = system.without_softening().is_net
        self.predicts = predicts and not softens and any_chords(system.groups)

    def initial(self) -> StructureStrategy:
        """Return the state of the method before the first evaluation."""
        zero, unknowns = jnp.zeros((), self.begin.dtype), None
        if self.partial_net is not None:
            net = self.partial_net.net
            unknowns = TensionUnknowns.initial(net, self.begin, is_partial_net=True)
        begins_with_full_steps = self.system.may_be_unsymmetric
        return StructureStrategy(
            search=LineSearch.init(zero),
            shift=LevenbergShift.initial(zero.dtype),
            full_steps=FullStepPhase.initial() if begins_with_full_steps else None,
            unknowns=unknowns,
            predicted=PredictedForces.initial(self.system, zero.dtype) if self.predicts else None,
        )

    def evaluate_at(self, x: Motion, exact: Bool[ArrayLike, ""]) -> Evaluation:
        """Return the `Evaluation` at `x`; there are no low-order parts of displacements."""
        system, net = self.system, self.partial_net
        tangents: Any
        if net is None:
            end_forces, tangents = system.forces_and_tangents(x)
        else:
            tangents = net.evaluate(x)
            end_forces = net.merge(tangents[0].forces, tangents[1][0])
        rounding = system.rounding_error(x) if system.estimates_rounding else None
        chords = Chords.at_motion(system, x, end_forces) if self.predicts else None
        residual, scale = system.residual_and_scale(x, end_forces)
        return Evaluation(x, residual, scale, rounding, (tangents, chords))

    def accept(self, state: NewtonState, tried: Evaluation, searched: Verdict) -> Verdict:
        """Accept what the line search accepts, but whole steps where their forces are finite."""
        (fine, again), finite = searched, jnp.isfinite(tried.scale)
        full_steps, unknowns = state.strategy.full_steps, state.strategy.unknowns
        if full_steps is not None:
            residuals = state.point.residual, tried.residual
            fine, again = full_steps.accept((fine, again), finite, residuals)
        if unknowns is not None:
            whole = unknowns.takes_interior_or_finishing_steps
            fine, again = jnp.where(whole, finite, fine), again & ~whole
        return fine, again

    def energy_slope(self, state: NewtonState, tried: Evaluation) -> Float[Array, ""]:
        """Return the derivative of the energy at the point `tried` along the step, J.

        Axial forces beyond the cut-off of `PredictedForces` are left out.
        """
        slope, predicted = super().energy_slope(state, tried), state.strategy.predicted
        if predicted is None:
            return slope
        chords, row_step = tried.elements[1], self.system.space.prolong(tried.x, state.step)
        longer = chords.linearized_elongation(second_minus_first_end(self.system, row_step))
        return slope - predicted.excess_force(chords.force) @ longer

    def choose(
        self, state: NewtonState, trial: Trial, moved: Bool[Array, ""], converged: Bool[Array, ""]
    ) -> Choice:
        """Choose the shift, whether full steps go on, and whether cables get interior steps."""
        own, x, no = state.strategy, state.point.x, jnp.zeros((), bool)
        reach = self.system.largest_displacement(x)
        first_shift, restarts = LevenbergShift.initial(x.dtype), no
        shift = own.shift.update(trial.accepted, trial.step_length)
        shift, full_steps = select_tree(moved, shift, own.shift), own.full_steps
        predicted = own.predicted
        if predicted is not None:
            predicted = predicted.after_trial(trial.accepted, moved)
        if full_steps is not None:
            given = trial.accepted, reach, state.steps, self.extent, converged
            new, restarts = full_steps.update(*given)
            full_steps, restarts = select_tree(moved, new, full_steps), moved & restarts
            x, shift = select_tree(restarts, (self.begin, first_shift), (x, shift))
        unknowns = own.unknowns
        if unknowns is not None:
            may_switch = moved & ~converged & ~unknowns.uses_line_search
            astray = reach > ASTRAY * self.extent
            at = copy_with(state.point, x=x), self.begin
            new, start, elsewhere = unknowns.switch_mode(
                *at, trial.accepted, astray, self.length, full_steps_failed=restarts
            )
            unknowns, x = select_tree(may_switch, (new, start), (unknowns, x))
            elsewhere = may_switch & elsewhere
            restarts, changed = restarts | elsewhere, unknowns.mode != own.unknowns.mode
            shift = select_tree(changed, first_shift, shift)
            if full_steps is not None:
                full_steps = copy_with(full_steps, is_on=full_steps.is_on & ~changed)
            if predicted is not None:
                predicted = copy_with(predicted, is_known=predicted.is_known & ~elsewhere)
        after = StructureStrategy(own.search, shift, full_steps, unknowns, predicted)
        return Choice(after, x, restarts)

    def make_step(
        self, state: NewtonState, converged: Bool[Array, ""], wanted: Bool[Array, ""]
    ) -> NextStep:
        """Propose the next step, of displacements; arguments as of `StepMethod.make_step`."""
        own, system, point = state.strategy, self.system, state.point
        is_full, repeats = jnp.zeros((), bool), jnp.zeros((), bool)
        fraction: Float[ArrayLike, ""] = 1.0
        if own.full_steps is not None:
            is_full = own.full_steps.is_on & ~converged
        given = self._matrix(state, is_full, converged)
        matrix, predicting, tangents, equations, chords, springs = given
        rhs, unknowns, predicted = -point.residual, own.unknowns, own.predicted
        similar, without_search = system.convex, is_full
        if unknowns is not None:
            rhs, similar = equations.rhs, similar & ~unknowns.has_interior_matrix
            without_search = is_full | unknowns.takes_interior_or_finishing_steps
        if springs is not None:
            rhs = rhs - springs
        matrix = cond_in_batch(
            converged, lambda m: with_loose_nodes_held(system, m, point.x), matrix
        )
        given = system, matrix, rhs, max_abs(point.residual) / point.scale, self.convergence.tol
        step, definite, factored = newton_direction(*given, state.factored, wanted, similar)
        slope, full_steps = point.residual @ step, own.full_steps
        if predicted is not None:
            row_step = system.space.prolong(point.x, step)
            predicted, fraction, cut = predicted.after_step(
                system, chords, row_step, tangents, predicting
            )
            slope = slope - cut
        if full_steps is not None:
            unsure = system.unsymmetric() & ~definite
        if unknowns is not None:
            sound = definite
            if full_steps is not None:  # a singular unsymmetric matrix gives NaN
                sound = definite | (unsure & jnp.isfinite(slope))
            unknowns, part = self.partial_net.take_step(point.x, step, sound, equations)
            repeats, fraction = unknowns.indefinite_count > 0, jnp.minimum(fraction, part)
            if predicted is not None:
                force = self.partial_net.predicted_forces(predicted.force, unknowns)
                predicted = copy_with(predicted, force=force)
        step, slope = fraction * step, fraction * slope
        usable = definite & ((slope < 0) | without_search)
        if full_steps is not None:
            usable = usable | unsure
            full_steps = copy_with(full_steps, may_go_uphill=unsure & ~without_search)
        usable = usable & jnp.isfinite(slope) & ~converged
        predicted = select_tree(usable, predicted, own.predicted)
        after = StructureStrategy(
            LineSearch.init(slope), own.shift, full_steps, unknowns, predicted
        )
        return NextStep(after, step, usable, repeats, ~converged, definite, factored)

    def _matrix(self, state, is_full, converged):
        """Assemble the matrix of the next step from the point of `state`.

        Args:
            state: `NewtonState`.
            is_full: whether the step is one of the full steps with which an iteration may begin,
                which have no predicted forces.
            converged: whether the point is an equilibrium. The matrix is then the tangent itself,
                with a shift down by rounding only, so that it tells whether it is stable.
        """
        system, own, x, partial_net = self.system, state.strategy, state.point.x, self.partial_net
        tangents, chords = state.point.elements
        size, predicting, known = max_abs(state.point.residual), None, None
        cables, springs = None, None
        if partial_net is not None:
            unknowns = own.unknowns.with_first_mode_if(converged)
            given = x, tangents, unknowns, state.point.residual, self.length
            cables = partial_net.equations(*given)
            tangents = partial_net.tangents(x, tangents, cables)
        if own.predicted is not None:
            predicting = is_prediction_step(state.steps) & ~is_full & ~converged
            if partial_net is not None:
                predicting = predicting | (unknowns.takes_interior_or_finishing_steps & ~converged)
            forces = own.predicted.geometric_forces(chords, predicting)
            if partial_net is not None:
                forces = partial_net.geometric_forces(forces, chords.force, unknowns)
            tangents = system.tangents(x, tangents)
            given = system, x, chords, tangents, predicting
            chords, tangents, springs = own.predicted.hold_contacts_closed(*given)
            known = tangents
            tangents = chords.tangents_with_geometric_stiffness(system, tangents, forces)
            # after a step sideways R is that of EA, and so would be the shift
            size = jnp.minimum(size, jnp.max(jnp.abs(forces)) + state.progress.start_residual)
        shift = own.shift.value(size, self.length)
        matrix = system.tangent(x, tangents)
        if system.space.rotates:
            shift = jnp.where(is_full, 0.0, shift)
        if partial_net is not None or not system.always_convex:
            least = zero_eigenvalue_bound(matrix)
            shift = jnp.where(converged, stability_shift(least), shift)
        if partial_net is not None:
            damping = jnp.maximum(cables.unknowns.interior_point.damping, least)
            shift = jnp.where(unknowns.uses_interior_point, damping, shift)
        matrix = linear.add_to_diagonal(matrix, shift)
        return StepMatrix(matrix, predicting, known, cables, chords, springs)
