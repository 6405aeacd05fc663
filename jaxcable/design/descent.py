"""The search of `minimize`: accept a trial point or shorten the step, and propose the next one.

Where no optimizer is given, this is L-BFGS with a backtracking line search (Armijo). Parameters are
one flat vector here; only the optimizer gets them in the shape that users gave.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Callable
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
import optax
from jax import lax
from jax.flatten_util import ravel_pytree

from ..common import status
from ..common.progress import Step, report_progress
from ..common.tree import pytree, select_tree
from ..common.types import Array, Bool, Float, Int, PyTree
from .bounds import BoxBounds
from .minimum_criteria import MinimumCriteria
from .trials import Evaluation, final_status

_LBFGS = optax.lbfgs(linesearch=None)  # without a line search: the loop has one
_MAX_SHORTENED = 40  # how often a step is shortened before the search stalls: to below 1e-12 of it
_PATIENCE = 10  # how often a step is shortened before L-BFGS starts again without its memory
_ARMIJO = 1e-4  # least decrease of the loss over that predicted by the slope, the usual value
# Slope at the end of a step over that at its beginning, at most, where the loss has no digits left
# to show a decrease (Hager and Zhang 2006, with delta = 0.1: 2 delta - 1 = -0.8).
_FLATTER = 0.8
_GROWTH = 4.0  # factor on the longest step allowed, from step to step, after a failed analysis
_NOISE = 1e-9  # changes of the loss, relative to it, within the tolerance of an analysis (1e-10)


@pytree
class History:
    """History of the accepted points, the start first; NaN or -1 after the last one.

    Attributes:
        loss: loss at the point, [steps + 1].
        gradient_norm: measure of the gradient, which `tol` bounds (see `minimize`), [steps + 1].
        status: 0, or the code of the last analysis that failed on the way to the point and so
            shortened the step, [steps + 1].
        failures: number of such failures on the way to the point, [steps + 1].
        shortened: how often the step was shortened, because an analysis failed or because the loss
            did not fall, [steps + 1].

    Example:
        >>> loss = lambda x: (x[0] - 3.0) ** 2 + 10.0 * (x[1] - 1.0) ** 2 + 5.0
        >>> found = jc.minimize(loss, jnp.array([0.0, 0.0]), bounds=(0.0, 2.0))
        >>> losses = np.asarray(found.history.loss[: found.steps + 1])
        >>> print(found.status, losses[0], losses[-1].round(4), (np.diff(losses) < 0).all())
        0 24.0 6.0 True
    """

    loss: Float[Array, " steps+1"]
    gradient_norm: Float[Array, " steps+1"]
    status: Int[Array, " steps+1"]
    failures: Int[Array, " steps+1"]
    shortened: Int[Array, " steps+1"]


class AcceptedPoint(NamedTuple):
    """An accepted point of the search.

    Attributes:
        x: parameters.
        loss, gradient: loss and its gradient.
        inside: gradient without entries that a bound blocks.
        measure: measure of the gradient, see `MinimumCriteria.measure_gradient`.
        at_rest: whether the gradient is small enough for a minimum if no step lowers the loss.
    """

    x: Float[Array, " n"]
    loss: Float[Array, ""]
    gradient: Float[Array, " n"]
    inside: Float[Array, " n"]
    measure: Float[Array, ""]
    at_rest: Bool[Array, ""]


class DescentState(NamedTuple):
    """State of the search of `minimize` between two evaluations.

    Attributes:
        trial: point to be evaluated: ``current.x + length step``, projected into the bounds.
        step, length: step that the optimizer proposed, and the part of it that is tried.
        current, best: last accepted point, and the accepted point of lowest loss.
        blocked: entries at a bound that this step must not move.
        optimizer: state of the optimizer.
        memory_is_fresh: whether the optimizer has started without memory in this step.
        loss_factor: factor on the loss that the optimizer gets.
        first_loss: loss at the start.
        largest_gradient: largest size that each entry of the gradient has had, [n].
        longest_step: longest step allowed for now, over `scale`: an analysis has failed beyond.
        n_accepted: number of accepted steps; -1 before the start is evaluated.
        evaluations: number of evaluations of the loss and its gradient.
        n_refused: number of trial points of this step that were not accepted.
        failures, last_failure: number of trial points of this step at which the analysis failed,
            and the status code of the last failure.
        history: `History`.
        code: status.
        running: whether the search goes on.
    """

    trial: Float[Array, " n"]
    step: Float[Array, " n"]
    length: Float[Array, ""]
    current: AcceptedPoint
    best: AcceptedPoint
    blocked: Bool[Array, " n"]
    optimizer: optax.OptState
    memory_is_fresh: Bool[Array, ""]
    loss_factor: Float[Array, ""]
    first_loss: Float[Array, ""]
    largest_gradient: Float[Array, " n"]
    longest_step: Float[Array, ""]
    n_accepted: Int[Array, ""]
    evaluations: Int[Array, ""]
    n_refused: Int[Array, ""]
    failures: Int[Array, ""]
    last_failure: Int[Array, ""]
    history: History
    code: Int[Array, ""]
    running: Bool[Array, ""]


@dataclasses.dataclass(frozen=True)
class Descent:
    """Search for the minimum of one loss: evaluate, accept or shorten, propose the next step.

    Args:
        loss: function of the parameters, in the shape that users gave, to (value, status code).
        back: function from the flat vector to parameters in that shape.
        optimizer: optax transformation, or None for L-BFGS with a line search.
        steps: largest number of accepted steps.
        box: `BoxBounds` of flat bounds.
        criteria: `MinimumCriteria`, the criteria of convergence.
        scale: the optimizer gets the parameters divided by it, [n].
        listen: function of a `progress.Step`, called after every accepted step, or None.
    """

    loss: Callable[[PyTree[Float[Array, " ..."]]], tuple[Float[Array, ""], Int[Array, ""]]]
    back: Callable[[Float[Array, " n"]], PyTree[Float[Array, " ..."]]]
    optimizer: optax.GradientTransformation | None
    steps: int
    box: BoxBounds
    criteria: MinimumCriteria
    scale: Float[Array, " n"]
    listen: Callable[[Step], Any] | None = None

    @property
    def has_line_search(self) -> bool:
        """Whether steps are accepted only if they lower the loss: where no optimizer is given."""
        return self.optimizer is None

    @property
    def effective_optimizer(self) -> optax.GradientTransformationExtraArgs:
        """The optimizer that was given, or L-BFGS."""
        return optax.with_extra_args_support(_LBFGS if self.has_line_search else self.optimizer)

    @property
    def loss_noise(self) -> float:
        """Relative changes of the loss that are within its numerical noise."""
        return max(_NOISE, 64 * float(jnp.finfo(self.scale.dtype).eps))

    def initial_state(self, x: Float[Array, " n"]) -> DescentState:
        """Return the state before the start `x`, [n], is evaluated."""
        nothing, none = jnp.zeros_like(x), jnp.int32(0)
        unknown, one = jnp.asarray(jnp.nan, x.dtype), jnp.ones((), x.dtype)
        start = AcceptedPoint(x, unknown, nothing, nothing, unknown, jnp.zeros((), bool))
        reals, integers = jnp.full(self.steps + 1, unknown), jnp.full(self.steps + 1, jnp.int32(-1))
        return DescentState(
            trial=x,
            step=nothing,
            length=one,
            current=start,
            best=start,
            blocked=jnp.zeros(x.shape, bool),
            optimizer=self._fresh_optimizer_state(x),
            memory_is_fresh=jnp.ones((), bool),
            loss_factor=one,
            first_loss=one,
            largest_gradient=nothing,
            longest_step=jnp.inf * one,
            n_accepted=jnp.int32(-1),
            evaluations=none,
            n_refused=none,
            failures=none,
            last_failure=none,
            history=History(reals, reals, integers, integers, integers),
            code=none,
            running=jnp.ones((), bool),
        )

    def advance(self, s: DescentState, found: Evaluation) -> DescentState:
        """Accept or refuse the trial point, given its evaluation `found`; choose the next one."""
        value, gradient, code = found.mark_nonfinite()
        sound, begun = code == status.OK, s.n_accepted >= 0
        accepted, factor = self._judge_trial(s, value, gradient, sound, begun)

        first_loss = jnp.where(begun, s.first_loss, value)
        blocked = self.box.blocked_entries(s.trial, gradient)
        inside = jnp.where(blocked, 0.0, gradient)
        steepest = jnp.where(
            sound, jnp.maximum(s.largest_gradient, jnp.abs(gradient)), s.largest_gradient
        )
        measure, level, at_rest = self.criteria.measure_gradient(
            s.trial, inside, value, first_loss, steepest
        )
        moved = s.trial - s.current.x
        along = jnp.where(blocked, 0.0, moved)
        slopes = gradient @ along, s.current.gradient @ along
        near = self.criteria.minimum_is_near(s.trial, along, *slopes, value, first_loss)
        near |= measure == 0
        was_short = self.criteria.step_is_short(moved, s.current.x)
        point = AcceptedPoint(s.trial, value, gradient, inside, measure, at_rest)
        current = select_tree(accepted, point, s.current)
        best = select_tree(accepted & ~(current.loss >= s.best.loss), current, s.best)
        s = s._replace(
            current=current,
            best=best,
            first_loss=first_loss,
            largest_gradient=steepest,
            n_accepted=s.n_accepted + accepted,
            evaluations=s.evaluations + 1,
            failures=s.failures + ~sound,
            last_failure=jnp.where(sound, s.last_failure, code),
        )
        logged = accepted | ~begun
        beyond = self.steps + 1  # where entries are dropped
        entry = jnp.where(logged, jnp.maximum(s.n_accepted, 0), beyond)
        entries = History(value, measure, s.last_failure, s.failures, s.n_refused)
        log = jax.tree.map(lambda h, e: h.at[entry].set(e, mode="drop"), s.history, entries)
        listen, known = self.listen, {"count": self.steps}
        if listen is not None:
            news = {"number": jnp.maximum(s.n_accepted, 0), "failures": s.failures}
            news |= {"loss": value, "gradient_norm": measure}
            lax.cond(logged, lambda: report_progress(listen, Step, known, news), lambda: None)

        tries = jnp.where(accepted, 0, s.n_refused + 1)
        # restart the optimizer when its step leads nowhere, or when other entries are blocked than
        # those with which its memory was made
        restart = self.has_line_search & ~accepted & begun & ~s.memory_is_fresh
        restart &= tries >= _PATIENCE
        changed = self.has_line_search & begun & jnp.any(blocked != s.blocked)
        if self.has_line_search:
            norm = jnp.linalg.norm(inside * self.scale)
            s = s._replace(loss_factor=jnp.where(begun | (norm == 0), s.loss_factor, 1 / norm))

        # At the start the sizes of the parameters may be meaningless, and a small measure with
        # them: ask for one accepted step. A point above the best one is no minimum.
        lowest = value <= best.loss + self.loss_noise * jnp.abs(best.loss)
        small = accepted & level & lowest & ((s.n_accepted > 0) | (measure == 0))
        converged = small & (measure == 0 if self.has_line_search else near)
        used_up = s.n_accepted >= self.steps
        at_rest = current.at_rest & was_short  # if no step lowers the loss then, it is a minimum
        # where no entry was ever anything but zero, nothing has been learned of the loss
        blind = converged & (s.n_accepted == 0) & jnp.any(~blocked & (gradient == 0))
        spent = (tries > jnp.where(at_rest, _PATIENCE, _MAX_SHORTENED)) & ~restart
        s = s._replace(
            blocked=jnp.where(accepted, blocked, s.blocked),
            history=log,
            code=final_status(begun | sound, blind, converged | (spent & at_rest), ~used_up),
            running=~converged & (begun | sound) & (~used_up | small) & ~spent,
            memory_is_fresh=jnp.where(accepted, changed, s.memory_is_fresh) | restart,
        )
        return self._next_trial(s, accepted, logged, restart, small, tries, factor)

    def _next_trial(self, s, accepted, logged, restart, small, tries, factor):
        """Return the state with the next trial point: a new step, or a shorter part of this one."""
        new = accepted | restart
        step, state, fresh = lax.cond(
            s.running & new, self._new_step, lambda s: (s.step, s.optimizer, s.memory_is_fresh), s
        )
        if self.has_line_search:  # the whole step, by the curvature, must promise little, too
            promised = -(s.current.inside @ step)
            small &= ~fresh & self.criteria.decrease_is_small(
                promised, s.current.loss, s.first_loss
            )
            small &= self.criteria.step_is_short(
                self.box.project(s.current.x + step) - s.current.x, s.current.x
            )
            s = s._replace(
                code=jnp.where(s.running & small, status.OK, s.code),
                running=s.running & ~small & (s.n_accepted < self.steps),
            )
        # an analysis will fail again where it has failed: bound steps by the last accepted length
        length_before = s.length * jnp.linalg.norm(s.step / self.scale)
        reach = _GROWTH * jnp.where(s.failures > 0, length_before, s.longest_step)
        reach = jnp.where(accepted, reach, s.longest_step)
        whole_length = jnp.linalg.norm(step / self.scale)
        whole = jnp.minimum(1.0, reach / jnp.where(whole_length > 0, whole_length, 1.0))
        length = jnp.where(new, whole, s.length * factor)
        return s._replace(
            trial=self.box.project(s.current.x + length * step),
            step=step,
            length=length,
            optimizer=state,
            memory_is_fresh=fresh,
            longest_step=reach,
            n_refused=jnp.where(restart, 0, tries),
            failures=jnp.where(logged, 0, s.failures),
            last_failure=jnp.where(logged, 0, s.last_failure),
        )

    def _loss_and_status(self, x):
        """Return the loss at a flat vector, and the status of the analysis."""
        value, code = self.loss(self.back(x))
        return value.astype(x.dtype), code

    def evaluate(self, x: Float[Array, " n"]) -> Evaluation:
        """Evaluate loss, gradient and status at a point."""
        (value, code), gradient = jax.value_and_grad(self._loss_and_status, has_aux=True)(x)
        return Evaluation(value, gradient, code)

    def _judge_trial(self, s, value, gradient, sound, begun):
        """Judge whether to accept the trial point; return also the factor to shorten the step by.

        With the line search the loss has to fall by a part of what the slope predicts (Armijo).
        Where the loss has no digits left for that, it must not rise, and the slope must have become
        flatter. With a given optimizer every point at which the analysis succeeds is accepted.
        """
        if not self.has_line_search:
            return sound, 0.5
        moved = s.trial - s.current.x
        promised = s.current.inside @ moved
        rise = value - s.current.loss
        level = rise <= self.loss_noise * jnp.abs(s.current.loss)
        level &= gradient @ moved <= -_FLATTER * promised
        falls = (promised < 0) & ((rise <= _ARMIJO * promised) | level)
        # curvature of the parabola through loss, slope and trial; the next trial is its minimum
        bend = rise - promised
        shorter = jnp.clip(-0.5 * promised / jnp.where(bend > 0, bend, 1.0), 0.1, 0.5)
        return sound & (falls | ~begun), jnp.where(sound & (bend > 0), shorter, 0.5)

    def _fresh_optimizer_state(self, x):
        """Return the optimizer's state for a start at `x`, without memory of earlier steps."""
        return self.effective_optimizer.init(self.back(x / self.scale))

    def _new_step(self, s):
        """Propose a new step; return it, the optimizer's state, and whether its memory is fresh."""
        if not self.has_line_search:
            return *self._optimizer_step(s, s.optimizer), s.memory_is_fresh
        anew = self._fresh_optimizer_state(s.current.x)
        step, state = self._optimizer_step(s, select_tree(s.memory_is_fresh, anew, s.optimizer))
        downward = s.current.inside @ step < 0  # if not, the memory of the curvature is misleading
        step, state = lax.cond(
            downward, lambda: (step, state), lambda: self._optimizer_step(s, anew)
        )
        return step, state, s.memory_is_fresh | ~downward

    def _optimizer_step(self, s, state):
        """Return the optimizer's step [n] and its new state."""

        def value_of(scaled):  # for optimizers with a line search: infinite for a failed analysis
            value, code = self._loss_and_status(
                self.box.project(ravel_pytree(scaled)[0] * self.scale)
            )
            sound = (code == status.OK) & jnp.isfinite(value)
            return jnp.where(sound, s.loss_factor * value, jnp.inf)

        gradient = self.back(s.loss_factor * self.scale * s.current.inside)
        update, new = self.effective_optimizer.update(
            gradient,
            state,
            self.back(s.current.x / self.scale),
            value=s.loss_factor * s.current.loss,
            grad=gradient,
            value_fn=value_of,
        )
        # the loop needs the same float types in every iteration
        new = jax.tree.map(lambda a, b: jnp.asarray(b, jnp.asarray(a).dtype), state, new)
        step = ravel_pytree(update)[0].astype(self.scale.dtype)
        return jnp.where(s.blocked, 0.0, step * self.scale), new
