"""One iteration of Newton's method: evaluate, decide, compute a step; `newton` has the whole."""

from __future__ import annotations

import jax
import jax.numpy as jnp

from .. import linear
from ..common import status
from ..common.batch_conditions import cond_in_batch
from ..common.tree import copy_with, select_tree
from ..common.types import Array, ArrayLike, Bool, Float, Int
from ..linear.sparse import FactoredMatrix
from ..mechanics.assembly import System
from ..mechanics.chords import Chords, any_chords, relative_to_first_end
from ..mechanics.tension_responses import TensionResponses, has_load
from ..numerics.line_search import LineSearch
from .convergence import AddedLoadCriterion, IterationSettings, is_stagnant, residual_tolerance
from .globalization import ASTRAY, FullStepPhase, LevenbergShift
from .newton_state import NewtonState
from .newton_step import max_abs, newton_direction, with_loose_nodes_held
from .partial_net import PartialNet
from .predicted_forces import PredictedForces
from .step_matrix import step_matrix
from .tension_unknowns import TensionUnknowns

# Residual allowed without load, in roundings (eps) of the forces at the start.
_RELEASED_ROUNDINGS = 2.0
# Rounding of plain displacements over the tolerance, from which displacements get a fine part: well
# below 1, because the next point may need it more than this one.
_FINE_PART_FROM = 0.05
# Rounding of a residual over the forces up to which it excuses the residual: above it, the forces
# would not be known to two digits.
_MAX_ROUNDING = 1e-2
_RUNAWAY = 1e6  # displacement, in structure sizes, that no anchored structure reaches
_NET_RUNAWAY = 1e4  # the same for nets, whose mixed steps end at a part of it


class EquilibriumSearch:
    """Newton's iteration to the equilibrium of a system: its constants, start, and one iteration.

    Args:
        system: `System` of one load factor.
        x: motion to start from.
        method: `IterationSettings`.
        judges_stability: whether to find out if the equilibrium is stable.
        criterion: `AddedLoadCriterion` of the increment; None, as in float32: the residual is
            only compared with forces.
        only_evaluates: whether to evaluate the start only.
    """

    def __init__(
        self,
        system: System,
        x: Float[Array, "n_row n_motion"],
        method: IterationSettings,
        judges_stability: Bool[ArrayLike, ""],
        criterion: AddedLoadCriterion | None = None,
        only_evaluates: Bool[ArrayLike, ""] = False,
    ):
        self.system, self.method = system, method
        self.judges_stability, self.only_evaluates = judges_stability, only_evaluates
        self.criterion = criterion if jnp.finfo(x.dtype).eps < 1e-12 else None
        self.begin = system.impose_supports(system.with_low_order_part(x))
        self.tol = residual_tolerance(method, x.dtype)
        self.length, self.extent = system.length_scale(), system.extent()
        self.is_net = system.is_net
        self.partial_net = None if self.is_net else PartialNet.of(system)
        self.is_loaded = has_load(system, self.begin) if self.is_net else None
        # a net beyond the peak of a law finds where its curve ends by the true forces
        softens = not self.is_net and system.without_softening().is_net
        self.predicts = not self.is_net and not softens and any_chords(system.groups)
        self.convex = system.convex
        tension_only = system.may_be_convex and not self.is_net
        self.has_full_steps = tension_only or system.may_be_unsymmetric

    def initial_state(self, factored: FactoredMatrix | None) -> NewtonState:
        """Return the `NewtonState` before the first evaluation, which is at the start itself."""
        zero = jnp.zeros((), self.begin.dtype)
        still = jnp.zeros(self.system.dof_map.free.shape[0], zero.dtype)
        no = jnp.zeros((), bool)
        *_, rounding, elements = jax.tree.map(
            lambda a: jnp.zeros(a.shape, a.dtype),
            jax.eval_shape(lambda x: self._evaluate_forces(x, jnp.int32(0)), self.begin),
        )
        full_steps = unknowns = None
        if self.is_net or self.partial_net is not None:
            net = self.system if self.is_net else self.partial_net.net
            unknowns = TensionUnknowns.initial(net, self.begin, not self.is_net)
        if self.has_full_steps:
            full_steps = FullStepPhase.initial(self.system.may_be_unsymmetric)
        return NewtonState(
            x=self.begin,
            residual=still,
            scale=zero,
            rounding=rounding,
            elements=elements,
            step=still,
            search=LineSearch.init(zero),
            stays_at_x=~no,
            has_no_step=no,
            shift=LevenbergShift.initial(zero.dtype),
            full_steps=full_steps,
            tension_unknowns=unknowns,
            predicted=PredictedForces.initial(self.system, zero.dtype) if self.predicts else None,
            start_residual=zero,
            stagnant_steps=jnp.int32(0),
            steps=jnp.int32(0),
            code=jnp.int32(-1),  # nothing evaluated yet
            factored=factored,
            released=zero if self.is_net else None,
            start_rounding=None if self.is_net else rounding,
            stable=self.convex,
            done=no,
        )

    def iterate(self, state: NewtonState) -> NewtonState:
        """Evaluate the trial point, decide whether to accept it, and compute the next step."""
        exact, residual_before = self._needs_low_order_part(state), max_abs(state.residual)
        state, fraction, accepted, search_over = self._evaluate_trial(state, exact)
        state, converged = self._check_convergence(state, search_over, residual_before)
        if self.is_net:  # a long step may lead to where the fine part matters after all
            converged = converged & (exact | ~self._needs_low_order_part(state))
        given = fraction, accepted, search_over, converged
        state, reevaluate = self._update_strategies(state, *given)
        return self._compute_step(state, search_over & ~state.done & ~reevaluate, converged)

    def _evaluate_trial(self, state, exact):
        """Evaluate forces at the trial point of the line search, and decide whether to accept it.

        Returns:
            state: `NewtonState`, with the point if it is accepted, and the next trial length.
            fraction: the fraction of the step that was tried.
            accepted: whether a step was taken.
            search_over: whether the search along the step has ended.
        """
        x = select_tree(
            state.stays_at_x, state.x, self.system.move(state.x, state.search.length * state.step)
        )
        residual, scale, rounding, elements = self._evaluate_forces(x, state.steps, exact)
        finite = jnp.isfinite(scale)
        slope = self._energy_slope(state, x, residual, elements)
        search, fine, again = state.search.update(jnp.where(finite, slope, jnp.inf))
        if self.has_full_steps:
            fine, again = state.full_steps.accept((fine, again), finite, (state.residual, residual))
        if self.is_net:
            searching = state.tension_unknowns.uses_line_search
            fine, again = jnp.where(searching, fine, finite), again & searching
        if self.partial_net is not None:
            whole = state.tension_unknowns.takes_interior_or_finishing_steps
            fine, again = jnp.where(whole, finite, fine), again & ~whole
        fine, again = fine | state.stays_at_x, again & ~state.stays_at_x

        new = copy_with(
            state,
            x=select_tree(fine, x, state.x),
            residual=select_tree(fine, residual, state.residual),
            scale=select_tree(fine, scale, state.scale),
            rounding=select_tree(fine, rounding, state.rounding),
            elements=select_tree(fine, elements, state.elements),
            search=search,
        )
        return new, state.search.length, fine & ~state.has_no_step, ~again

    def _evaluate_forces(self, x, steps, exact=True):
        """Return residual less the carried one, scale, rounding, `NewtonState.elements` at x."""
        if self.is_net:
            elements = TensionResponses.of(self.system, x, exact)
            residual, scale, rounding = elements.residual_scale_and_rounding(self.system, x)
        else:
            if self.partial_net is None:
                end_forces, tangents = self.system.forces_and_tangents(x)
            else:
                tangents = self.partial_net.evaluate(x)
                end_forces = self.partial_net.merge(tangents[0].forces, tangents[1][0])
            rounding = self.system.rounding_error(x) if self.system.estimates_rounding else None
            chords = Chords.of(self.system, x, end_forces) if self.predicts else None
            residual, scale = self.system.residual_and_scale(x, end_forces)
            elements = tangents, chords
        return residual - self.carried_residual(scale, steps), scale, rounding, elements

    def carried_residual(
        self, scale: Float[Array, ""], steps: Int[Array, ""]
    ) -> Float[ArrayLike, " n_free"]:
        """Return the earlier residual that counts as a load (`convergence`), [n_free], N."""
        if self.criterion is None:
            return 0.0
        return self.criterion.carried_residual(scale, self.tol, steps)

    def _energy_slope(self, state, x, residual, elements):
        """Return the derivative of the energy at `x` along the step of `state`, J.

        Axial forces beyond the cut-off of `PredictedForces` are left out.
        """
        slope = residual @ state.step
        if state.predicted is None:
            return slope
        chords, spread = elements[1], self.system.space.prolong(x, state.step)
        longer = chords.elongation(relative_to_first_end(self.system, spread))
        return slope - state.predicted.excess_force(chords.force) @ longer

    def _needs_low_order_part(self, state):
        """Return whether the next point of a net needs the low-order part of displacements."""
        if not self.is_net:
            return False
        # rounding is that of a fine part, of eps times the displacement and not eps^2
        eps, least = jnp.finfo(state.scale.dtype).eps, state.scale
        if self.criterion is not None:
            least = jnp.minimum(least, self.criterion.added_load)
        return (state.code < 0) | (
            max_abs(state.rounding) > _FINE_PART_FROM * eps * self.tol * least
        )

    def _check_convergence(self, state, search_over, residual_before):
        """Return `state` with its status, and whether its residual is within the tolerances.

        `residual_before` is the largest residual at the point before, N.
        """
        first = state.code < 0
        finite = jnp.all(jnp.isfinite(state.residual)) & jnp.isfinite(state.scale)
        code = jnp.where(first, jnp.where(finite, status.OK, status.NONFINITE), state.code)
        start_residual = jnp.where(first, max_abs(state.residual), state.start_residual)
        state = copy_with(state, code=code.astype(jnp.int32), start_residual=start_residual)
        if self.is_net:
            # forces that rounding hides are not found; without any load they may all be lost
            known = jnp.where(self.is_loaded, _MAX_ROUNDING * state.scale, jnp.inf)
            # a net that is under load has others to be judged by
            released = _RELEASED_ROUNDINGS * jnp.finfo(state.scale.dtype).eps * state.scale
            released = jnp.where(first & ~self.is_loaded, released, state.released)
            state = copy_with(state, released=released)
            granted = jnp.maximum(jnp.minimum(state.rounding, known), state.released)
        elif state.rounding is not None:
            rounding = jnp.where(first, state.rounding, state.start_rounding)
            state = copy_with(state, start_rounding=rounding)
            granted = jnp.maximum(state.rounding, state.start_rounding)
        else:
            granted = jnp.zeros_like(state.residual)
        balanced = state.residual + self.carried_residual(state.scale, state.steps)
        converged = jnp.all(jnp.abs(balanced) <= jnp.maximum(self.tol * state.scale, granted))
        if self.criterion is None:
            return state, converged
        halved = max_abs(state.residual) < 0.5 * residual_before
        stagnant = state.stagnant_steps + (converged & search_over & ~halved)
        given = state.residual, granted, state.scale, state.start_residual, self.tol
        met, lost = self.criterion.compare_with_load(*given)
        ends = converged & (met | is_stagnant(stagnant) | (state.steps >= self.method.max_steps))
        code = jnp.where(ends & lost, status.AT_ROUNDING, state.code)
        return copy_with(state, stagnant_steps=stagnant, code=code.astype(jnp.int32)), ends

    def _update_strategies(self, state, fraction, accepted, search_over, converged):
        """Choose how the next step is made, and set the status, after an evaluation.

        That is: the Levenberg shift of the stiffness, whether full steps go on without a line
        search, and the mode of the tension unknowns.

        Arguments are those that `_evaluate_trial` and `_check_convergence` return.

        Returns:
            The `NewtonState`; whether forces are to be evaluated before the next step, because
            the iteration goes on from another point.
        """
        moved = search_over & (~state.stays_at_x | state.has_no_step)
        spent = search_over & ~converged & (state.steps >= self.method.max_steps)
        again = jnp.zeros((), bool)
        shift = select_tree(moved, state.shift.update(accepted, fraction), state.shift)
        x, full_steps = state.x, state.full_steps
        reach = self.system.largest_displacement(x)
        if self.has_full_steps:
            given = accepted, reach, state.steps, self.extent, converged
            new, again = full_steps.update(*given)
            full_steps, again = select_tree(moved, new, full_steps), moved & again
            x, shift = select_tree(again, (self.begin, LevenbergShift.initial(x.dtype)), (x, shift))
        unknowns = state.tension_unknowns
        if self.is_net:
            shift = select_tree(unknowns.uses_line_search, shift, LevenbergShift.initial(x.dtype))
            given = state, x, accepted, moved & ~converged, reach
            unknowns, x, again = self._switch_mode(*given)
        elif self.partial_net is not None:
            given = state, x, accepted, moved & ~converged, reach, again
            unknowns, x, elsewhere = self._switch_mode(*given)
            again, changed = again | elsewhere, unknowns.mode != state.tension_unknowns.mode
            shift = select_tree(changed, LevenbergShift.initial(x.dtype), shift)
            if self.has_full_steps:
                full_steps = copy_with(full_steps, is_on=full_steps.is_on & ~changed)
            if self.predicts:
                known = state.predicted.is_known & ~elsewhere
                state = copy_with(state, predicted=copy_with(state.predicted, is_known=known))
        farthest = _NET_RUNAWAY if self.is_net else _RUNAWAY
        runaway = search_over & (reach > farthest * self.extent) & ~again
        code = jnp.where((state.code == status.OK) & runaway, status.MECHANISM, state.code)
        stop = search_over & ((code != status.OK) | spent)
        reevaluate = again & ~stop
        stuck = stop & (code == status.OK)
        judging = converged & self.judges_stability & ~self.convex
        after = copy_with(
            state,
            x=x,
            stays_at_x=reevaluate,
            has_no_step=jnp.zeros((), bool),
            shift=shift,
            full_steps=full_steps,
            tension_unknowns=unknowns,
            code=jnp.where(stuck, status.NOT_CONVERGED, code).astype(jnp.int32),
            done=stop | self.only_evaluates | (search_over & converged & ~judging & ~reevaluate),
        )
        return after, reevaluate

    def _switch_mode(self, state, x, accepted, may_switch, reach, full_steps_failed=None):
        """Return `TensionUnknowns` after a step, the point to go on from, whether it is not `x`.

        See `TensionUnknowns.switch_mode`. The mode changes only if it `may_switch`. `accepted` says
        whether a step was taken; `reach` is the largest displacement at `x`, m.
        """
        unknowns, astray = state.tension_unknowns, reach > ASTRAY * self.extent
        size = max_abs(state.residual), state.scale
        given = x, self.begin, accepted, *size, astray, self.length, full_steps_failed
        new, point, elsewhere = unknowns.switch_mode(*given)
        may_switch = may_switch & ~unknowns.uses_line_search
        unknowns = select_tree(may_switch, new, unknowns)
        return unknowns, select_tree(may_switch, point, x), may_switch & elsewhere

    def _compute_step(self, state, wanted, converged):
        """Return `state` with its next step if `wanted`; at an equilibrium only judge stability."""

        def compute(state):
            unknowns, predicted, fraction = state.tension_unknowns, state.predicted, 1.0
            if self.is_net:
                known, size = (state.elements, state.residual, self.length), max_abs(state.residual)
                equations = unknowns.step_equations(self.system, state.x, *known)
                state = copy_with(state, tension_unknowns=equations.unknowns)
                rhs, is_full = equations.rhs, ~unknowns.uses_line_search
                matrix = equations.matrix(self.system, state.x, size)
                shift = jnp.where(is_full, 0.0, state.shift.value(size, self.length))
            else:
                rhs, is_full = -state.residual, jnp.zeros((), bool)
                if self.has_full_steps:
                    is_full = state.full_steps.is_on & ~converged
                given = state, self.length, is_full, converged
                found = step_matrix(self.system, self.partial_net, *given)
                matrix, shift, predicting, slopes, equations = found
                if equations is not None:
                    rhs = equations.rhs
                    is_full = is_full | unknowns.takes_interior_or_finishing_steps
            matrix = linear.add_to_diagonal(matrix, shift)
            if not self.is_net:
                matrix = cond_in_batch(
                    converged, lambda m: with_loose_nodes_held(self.system, m, state.x), matrix
                )
            given = self.system, matrix, state, rhs, self.tol, wanted
            step, definite, factored = newton_direction(*given)
            again, stays = jnp.zeros((), bool), converged
            if self.is_net:
                given = self.system, state.x, step, definite
                after, fraction, predictor = equations.take_step(*given)
                if factored is not None:  # a corrector has the factor of its predictor
                    waits = state.tension_unknowns.awaits_corrector
                    count = select_tree(waits, state.factored.count, factored.count)
                    factored = copy_with(factored, count=count)
                stays = converged | predictor
                unknowns, again = state.tension_unknowns.repeat_if_indefinite(after, definite)
                again = again | predictor
            slope = state.residual @ step
            if self.predicts:
                given = self.system, state.elements[1], self.system.space.prolong(state.x, step)
                given = *given, slopes, predicting
                predicted, fraction, cut = state.predicted.after_step(*given)
                slope = slope - cut
            if self.partial_net is not None:
                given = state.x, step, definite, equations
                unknowns, part = self.partial_net.take_step(*given)
                again = unknowns.indefinite_count > 0
                fraction = jnp.minimum(fraction, part)
                if self.predicts:
                    force = self.partial_net.predicted_forces(predicted.force, unknowns)
                    predicted = copy_with(predicted, force=force)
            step, slope = fraction * step, fraction * slope
            usable, full_steps = definite & ((slope < 0) | is_full), state.full_steps
            if self.system.may_be_unsymmetric:
                unsure = self.system.unsymmetric() & ~definite
                usable = usable | unsure
                full_steps = copy_with(full_steps, may_go_uphill=unsure & ~is_full)
            usable = usable & jnp.isfinite(slope) & ~stays
            return copy_with(
                state,
                step=jnp.where(usable, step, 0.0),
                search=LineSearch.init(slope),
                stays_at_x=~usable,
                has_no_step=~usable & ~again,
                full_steps=full_steps,
                tension_unknowns=unknowns,
                predicted=select_tree(usable, predicted, state.predicted),
                steps=state.steps + ~stays,
                factored=factored,
                stable=state.stable | (converged & definite),
                done=converged,
            )

        return cond_in_batch(wanted, compute, state)
