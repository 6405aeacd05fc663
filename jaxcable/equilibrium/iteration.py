"""One iteration of Newton's method: evaluate, decide, compute a step; `newton` has the whole."""

from __future__ import annotations

import jax
import jax.numpy as jnp

from ..common import status
from ..common.batch_conditions import cond_in_batch
from ..common.tree import copy_with, select_tree
from ..common.types import Array, ArrayLike, Bool, Float, Int
from ..linear.sparse import FactorRecord
from ..mechanics.assembly import System
from .convergence import AddedLoadCriterion, Convergence, IterationSettings, Progress
from .net_steps import NetSteps
from .newton_state import NewtonState
from .newton_step import max_abs
from .step_method import StepMethod, Trial
from .structure_steps import StructureSteps


class NewtonIteration:
    """Newton's iteration to the equilibrium of a system: its constants, start, and one iteration.

    Args:
        system: `System` of one load factor.
        x: motion to start from.
        settings: `IterationSettings`.
        judges_stability: whether to find out if the equilibrium is stable.
        criterion: `AddedLoadCriterion` of the increment; None, as in float32: the residual is
            only compared with forces.
        only_evaluates: whether to evaluate the start only.
    """

    def __init__(
        self,
        system: System,
        x: Float[Array, "n_row n_motion"],
        settings: IterationSettings,
        judges_stability: Bool[ArrayLike, ""],
        criterion: AddedLoadCriterion | None = None,
        only_evaluates: Bool[ArrayLike, ""] = False,
    ):
        self.system = system
        self.judges_stability = judges_stability & ~system.convex
        self.only_evaluates = only_evaluates
        self.convergence = Convergence(settings, criterion, x.dtype)
        self.begin = system.impose_supports(system.with_zero_low_order_part(x))
        kind = NetSteps if system.is_net else StructureSteps
        self.method: StepMethod = kind(system, self.begin, self.convergence)

    def initial_state(self, factored: FactorRecord | None, steps: Int[Array, ""]) -> NewtonState:
        """Return the state before the first evaluation, which is at the start itself.

        `steps` are those that count already; `factored` is as in `NewtonState`.
        """
        zero, no = jnp.zeros((), self.begin.dtype), jnp.zeros((), bool)
        shapes = jax.eval_shape(lambda x: self.method.evaluate_at(x, True), self.begin)
        nowhere = jax.tree.map(lambda a: jnp.zeros(a.shape, a.dtype), shapes)
        return NewtonState(
            point=copy_with(nowhere, x=self.begin),
            step=jnp.zeros_like(nowhere.residual),
            stays_at_point=~no,
            has_no_step=no,
            strategy=self.method.initial(),
            progress=Progress(no, zero, self.method.start_rounding(nowhere), jnp.int32(0)),
            steps=steps,
            code=jnp.int32(status.OK),
            factored=factored,
            stable=self.system.convex,
            done=no,
        )

    def iterate(self, state: NewtonState) -> NewtonState:
        """Evaluate the trial point, decide whether to accept it, and compute the next step."""
        before = max_abs(state.point.residual)
        state, trial = self._try_step(state)
        state, converged = self._check_convergence(state, trial, before)
        state, reevaluates = self._choose(state, trial, converged)
        wanted = trial.search_over & ~state.done & ~reevaluates
        return cond_in_batch(
            wanted, lambda state: self._with_next_step(state, wanted, converged), state
        )

    def _try_step(self, state):
        """Evaluate forces where the step leads; return the state, and what became of the trial."""
        method = self.method
        x = select_tree(state.stays_at_point, state.point.x, method.trial_point(state))
        tried = method.evaluate(state, x)
        carried = self.convergence.carried_residual(tried.scale, state.steps)
        tried = copy_with(tried, residual=tried.residual - carried)
        strategy, length, fine, again = method.judge(state, tried)
        fine, again = fine | state.stays_at_point, again & ~state.stays_at_point
        point = select_tree(fine, tried, state.point)
        state = copy_with(state, point=point, strategy=strategy)
        return state, Trial(fine & ~state.has_no_step, length, ~again)

    def _check_convergence(self, state, trial, before):
        """Return the state with its status, and whether its residual is within the tolerances.

        `before` is the largest residual at the point before, N.
        """
        point, progress, method = state.point, state.progress, self.method
        first, residual = ~progress.has_begun, max_abs(point.residual)
        finite = jnp.isfinite(residual) & jnp.isfinite(point.scale)
        code = jnp.where(first & ~finite, status.NONFINITE, state.code)
        progress = copy_with(
            progress,
            has_begun=jnp.ones((), bool),
            start_residual=jnp.where(first, residual, progress.start_residual),
            start_rounding=select_tree(
                first, method.start_rounding(point), progress.start_rounding
            ),
        )
        residuals, granted = (point.residual, before), jnp.zeros_like(point.residual)
        if point.rounding is not None:
            given = point.rounding, progress.start_rounding, point.scale
            granted = method.granted_residual(*given)
        given = progress, residuals, point.scale, granted, state.steps, trial.search_over
        progress, converged, lost = self.convergence.compare(*given)
        exact = method.is_exact_enough(point)
        code = jnp.where(lost & exact, status.AT_ROUNDING, code).astype(jnp.int32)
        converged = converged & exact
        return copy_with(state, progress=progress, code=code), converged

    def _choose(self, state, trial, converged):
        """Choose how the next step is made, and whether the iteration ends.

        Returns:
            The `NewtonState`; whether forces are to be evaluated before the next step, because
            the iteration goes on from another point.
        """
        over, moved = trial.search_over, ~state.stays_at_point | state.has_no_step
        reach = self.system.largest_displacement(state.point.x)
        given = state, trial, over & moved, converged
        strategy, x, elsewhere = self.method.choose(*given)
        spent = ~converged & (state.steps >= self.convergence.max_steps)
        runaway = over & (reach > self.method.farthest * self.method.extent) & ~elsewhere
        code = jnp.where((state.code == status.OK) & runaway, status.MECHANISM, state.code)
        stop = over & ((code != status.OK) | spent)
        reevaluates = elsewhere & ~stop
        code = jnp.where(stop & (code == status.OK), status.NOT_CONVERGED, code)
        ends = over & converged & ~self.judges_stability
        after = copy_with(
            state,
            point=copy_with(state.point, x=x),
            stays_at_point=reevaluates,
            has_no_step=jnp.zeros((), bool),
            strategy=strategy,
            code=code.astype(jnp.int32),
            done=stop | self.only_evaluates | ends,
        )
        return after, reevaluates

    def _with_next_step(self, state, wanted, converged):
        """Return the state with its next step; at an equilibrium only judge stability."""
        found = self.method.make_step(state, converged, wanted)
        return copy_with(
            state,
            step=jnp.where(found.usable, found.step, 0.0),
            stays_at_point=~found.usable,
            has_no_step=~found.usable & ~found.repeats,
            strategy=found.strategy,
            steps=state.steps + found.counts,
            factored=found.factored,
            stable=state.stable | (converged & found.definite),
            done=converged,
        )
