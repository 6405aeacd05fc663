"""The search of `minimize`: accept a trial point or shorten the step, and propose the next one.

Where no optimizer is given, this is L-BFGS with a backtracking line search (Armijo). Parameters are
one flat vector here; only the optimizer gets them in the shape that users gave.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Callable
from typing import NamedTuple

import jax
import jax.numpy as jnp
import optax
from jax import lax
from jax.flatten_util import ravel_pytree

from ..common import status
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
    """History of the points that `minimize` accepted, the start first; padded with NaN or -1.

    Attributes:
        loss: loss at the point, [steps + 1].
        gradient_norm: dimensionless size of the gradient, which `tol` limits (`minimize` has the
            formula), [steps + 1].
        status: 0, or the code of the last analysis that failed in the step to the point and so
            shortened the step, [steps + 1].
        failures: number of such failures in the step to the point, [steps + 1].
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
    """A point that the search of `minimize` has accepted.

    Attributes:
        x: flat parameters, [n].
        loss, gradient: loss, and its gradient, [n].
        inside: gradient with zeros where a bound blocks the parameter, [n].
        measure: dimensionless size of the gradient, which `tol` bounds (`minimize`).
        at_rest: whether the gradient is small enough for the point to be a minimum, provided that
            no step from it lowers the loss.
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
        trial: point to be evaluated next: ``current.x + length step``, projected into the bounds.
        step, length: step that the optimizer has proposed, [n], and the fraction of it that is
            tried.
        current, best: the last accepted point, and the accepted point of lowest loss.
        blocked: entries at a bound that this step must not move, [n] bool.
        optimizer: state of the optax optimizer.
        memory_is_fresh: whether the optimizer has forgotten all earlier steps before this one.
        loss_factor: the optimizer gets the loss times this factor.
        first_loss: loss at the start.
        largest_gradient: largest absolute value that each entry of the gradient has had, [n].
        longest_step: largest norm of a step over `Descent.scale`, since longer ones have failed.
        n_accepted: number of accepted steps; -1 before the start is evaluated.
        evaluations: number of evaluations of the loss and its gradient.
        n_refused: number of trial points of this step that were not accepted.
        failures, last_failure: number of trial points of this step at which the analysis failed,
            and the status code of the last failure.
        history: `History`.
        code, running: status, and whether the search goes on.
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


def is_logged(before: DescentState, after: DescentState) -> Bool[Array, ""]:
    """Return whether the step from one state to the next has an entry in the history of its own.

    It has if the trial point was accepted, and if it is the start.
    """
    return (before.n_accepted < 0) | (after.n_accepted > before.n_accepted)


def progress_numbers(s: DescentState) -> dict[str, Array]:
    """Return the fields of a `progress.Step` by name, for the point that was accepted last."""
    number = s.n_accepted.clip(0)
    names = "loss", "gradient_norm", "failures"
    return {"number": number} | {name: getattr(s.history, name)[number] for name in names}


@dataclasses.dataclass(frozen=True)
class Descent:
    """The search of `minimize` for a minimum of one loss, as a function from state to state.

    Args:
        loss: function of flat parameters [n] to (value, status code), for optimizers that evaluate
            it; None for the default one.
        back: function from the flat vector of parameters [n] to their pytree.
        optimizer: optax transformation, or None for L-BFGS with a line search.
        steps: largest number of accepted steps.
        box: `BoxBounds` of the flat parameters.
        criteria: `MinimumCriteria`, which decide on convergence.
        scale: the optimizer gets the parameters divided by this, [n].
    """

    loss: Callable[[Float[Array, " n"]], tuple[Float[Array, ""], Int[Array, ""]]] | None
    back: Callable[[Float[Array, " n"]], PyTree[Float[Array, " ..."]]]
    optimizer: optax.GradientTransformation | None
    steps: int
    box: BoxBounds
    criteria: MinimumCriteria
    scale: Float[Array, " n"]

    @property
    def has_line_search(self) -> bool:
        """Whether steps must lower the loss: with L-BFGS, but not with a user's optimizer."""
        return self.optimizer is None

    @property
    def effective_optimizer(self) -> optax.GradientTransformationExtraArgs:
        """The optax optimizer that proposes steps: the user's, or L-BFGS without line search."""
        return optax.with_extra_args_support(_LBFGS if self.has_line_search else self.optimizer)

    @property
    def relative_loss_noise(self) -> float:
        """Relative change of the loss below which it counts as numerical noise."""
        return max(_NOISE, 64 * float(jnp.finfo(self.scale.dtype).eps))

    def initial_state(self, x: Float[Array, " n"]) -> DescentState:
        """Return the state of the search before the start `x`, [n], has been evaluated."""
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
        """Accept or refuse the trial point, evaluated as `found`; return the next state.

        It has the next trial point, or `running` False and the final status.
        """
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
        lowest = value <= best.loss + self.relative_loss_noise * jnp.abs(best.loss)
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
        """Return the state with the next trial point: on a new step, or nearer on the same step.

        `accepted` says whether the trial point was, `logged` whether it was or is the start,
        `restart` whether the optimizer must forget earlier steps, `small` whether gradient and loss
        meet the criteria of a minimum. There are `tries` refused points; `factor` shortens the
        step.
        """
        new = accepted | restart
        step, state, fresh = lax.cond(
            s.running & new,
            self._propose_step,
            lambda s: (s.step, s.optimizer, s.memory_is_fresh),
            s,
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

    def _judge_trial(self, s, value, gradient, sound, begun):
        """Return whether to accept the trial point, and the factor to shorten the step by if not.

        With the line search the loss has to fall by a part of what its slope predicts (Armijo).
        Where rounding hides such a decrease, the loss must not rise, and its slope must have become
        flatter. With the user's optimizer every point at which the analysis succeeds (`sound`) is
        accepted, and with both the start (not `begun`).
        """
        if not self.has_line_search:
            return sound, 0.5
        moved = s.trial - s.current.x
        promised = s.current.inside @ moved
        rise = value - s.current.loss
        level = rise <= self.relative_loss_noise * jnp.abs(s.current.loss)
        level &= gradient @ moved <= -_FLATTER * promised
        falls = (promised < 0) & ((rise <= _ARMIJO * promised) | level)
        # curvature of the parabola through loss, slope and trial; the next trial is its minimum
        bend = rise - promised
        shorter = jnp.clip(-0.5 * promised / jnp.where(bend > 0, bend, 1.0), 0.1, 0.5)
        return sound & (falls | ~begun), jnp.where(sound & (bend > 0), shorter, 0.5)

    def _fresh_optimizer_state(self, x):
        """Return the optimizer's state for a start at `x`, [n], without memory of earlier steps."""
        return self.effective_optimizer.init(self.back(x / self.scale))

    def _propose_step(self, s):
        """Let the optimizer propose the next step, without its memory if that leads upward.

        Returns the step [n], the optimizer's state, and whether it was without memory of earlier
        steps.
        """
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
        """Return the optimizer's step [n], zero where blocked, and its new state after `state`."""

        def value_of(scaled):  # for optimizers with a line search: infinite for a failed analysis
            value, code = self.loss(self.box.project(ravel_pytree(scaled)[0] * self.scale))
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
