"""The search of `minimize`: accept a trial point or shorten the step, and ask for the next one.

The state says whether the search shortens the present step, avoids a failed analysis or asks the
optimizer for the next step. Parameters are one flat vector here; only the optimizer gets them in
the shape that users gave.
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
from ..common.progress import Step, tell
from ..common.tree import pytree, where
from ..common.types import Array, Bool, Float, Int, PyTree
from .box import Box
from .criteria import Criteria
from .trials import Evaluation, ending

_LBFGS = optax.lbfgs(linesearch=None)  # without a line search: the loop has one
_SHORTEST = 40  # how often a step is shortened before the loop gives up
_PATIENCE = 10  # how often a step is shortened before the default optimizer forgets its memory
_DECREASE = 1e-4  # least decrease of the loss over the one that the slope promises
_FLAT = 0.8  # slope at the end of a step over that at its beginning, at most, near the minimum
_GROWTH = 4.0  # factor on the longest step allowed, from step to step
_NOISE = 1e-9  # changes of the loss, relative to it, within the tolerance of an analysis


@pytree
class History:
    """Record of the accepted points, the start first; NaN or -1 after the last one.

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


class Point(NamedTuple):
    """Parameters, loss, gradient, the same without blocked entries, and its measure.

    `at_rest` is True if the gradient is small enough for a minimum, if no step lowers the loss.
    """

    x: Float[Array, " n"]
    loss: Float[Array, ""]
    gradient: Float[Array, " n"]
    inside: Float[Array, " n"]
    measure: Float[Array, ""]
    at_rest: Bool[Array, ""]


class State(NamedTuple):
    """State of the search.

    Attributes:
        trial: point to be evaluated: ``at.x + length step``, projected into the bounds.
        step, length: step that the optimizer proposed, and the part of it that is tried.
        at, best: last accepted point, and the accepted point of lowest loss.
        blocked: entries at a bound that this step must not move.
        optimizer: state of the optimizer.
        fresh: whether the optimizer has started without memory in this step.
        unit: factor on the loss that the optimizer gets.
        first: loss at the start.
        steepest: largest size that each entry of the gradient has had, [n].
        reach: longest step allowed for now, over `scale`, because an analysis has failed beyond.
        n: number of accepted steps; -1 before the start is evaluated.
        evaluations: number of evaluations of the loss and its gradient.
        tries: number of trial points of this step that were not accepted.
        failures, failure: number of trial points of this step at which the analysis failed, and the
            status code of the last failure.
        log: `History`.
        code: status.
        running: whether the search goes on.
    """

    trial: Float[Array, " n"]
    step: Float[Array, " n"]
    length: Float[Array, ""]
    at: Point
    best: Point
    blocked: Bool[Array, " n"]
    optimizer: optax.OptState
    fresh: Bool[Array, ""]
    unit: Float[Array, ""]
    first: Float[Array, ""]
    steepest: Float[Array, " n"]
    reach: Float[Array, ""]
    n: Int[Array, ""]
    evaluations: Int[Array, ""]
    tries: Int[Array, ""]
    failures: Int[Array, ""]
    failure: Int[Array, ""]
    log: History
    code: Int[Array, ""]
    running: Bool[Array, ""]


@dataclasses.dataclass(frozen=True)
class Descent:
    """The search for one problem.

    Args:
        loss: function of the parameters, in the shape that users gave, to (value, status code).
        back: function from the flat vector to that shape.
        optimizer: optax transformation, or None for L-BFGS with a search for a lower loss.
        steps: largest number of accepted steps.
        box: `Box` of flat bounds.
        criteria: the `Criteria` of convergence.
        scale: the optimizer gets the parameters divided by it, [n].
        listen: function of a `progress.Step`, called after every accepted step, or None.
    """

    loss: Callable[[PyTree[Float[Array, " ..."]]], tuple[Float[Array, ""], Int[Array, ""]]]
    back: Callable[[Float[Array, " n"]], PyTree[Float[Array, " ..."]]]
    optimizer: optax.GradientTransformation | None
    steps: int
    box: Box
    criteria: Criteria
    scale: Float[Array, " n"]
    listen: Callable[[Step], Any] | None = None

    @property
    def searched(self) -> bool:
        """Whether the loop searches for a lower loss: where no optimizer is given."""
        return self.optimizer is None

    @property
    def method(self) -> optax.GradientTransformationExtraArgs:
        """The optimizer, given or not."""
        return optax.with_extra_args_support(_LBFGS if self.searched else self.optimizer)

    @property
    def noise(self) -> float:
        """Changes of the loss, relative to it, that cannot be judged."""
        return max(_NOISE, 64 * float(jnp.finfo(self.scale.dtype).eps))

    def begin(self, x: Float[Array, " n"]) -> State:
        """The state before the start `x`, [n], is evaluated."""
        nothing, none = jnp.zeros_like(x), jnp.int32(0)
        unknown, one = jnp.asarray(jnp.nan, x.dtype), jnp.ones((), x.dtype)
        start = Point(x, unknown, nothing, nothing, unknown, jnp.zeros((), bool))
        reals, integers = jnp.full(self.steps + 1, unknown), jnp.full(self.steps + 1, jnp.int32(-1))
        return State(
            trial=x,
            step=nothing,
            length=one,
            at=start,
            best=start,
            blocked=jnp.zeros(x.shape, bool),
            optimizer=self._anew(x),
            fresh=jnp.ones((), bool),
            unit=one,
            first=one,
            steepest=nothing,
            reach=jnp.inf * one,
            n=jnp.int32(-1),
            evaluations=none,
            tries=none,
            failures=none,
            failure=none,
            log=History(reals, reals, integers, integers, integers),
            code=none,
            running=jnp.ones((), bool),
        )

    def advance(self, s: State, found: Evaluation) -> State:
        """Accept the trial point, at which `found` was evaluated, or not, and find the next one."""
        value, gradient, code = found.judged()
        sound, begun = code == status.OK, s.n >= 0
        accepted, factor = self._judged(s, value, gradient, sound, begun)

        first = jnp.where(begun, s.first, value)
        blocked = self.box.blocked(s.trial, gradient)
        inside = jnp.where(blocked, 0.0, gradient)
        steepest = jnp.where(sound, jnp.maximum(s.steepest, jnp.abs(gradient)), s.steepest)
        measure, level, at_rest = self.criteria.measured(s.trial, inside, value, first, steepest)
        moved = s.trial - s.at.x
        along = jnp.where(blocked, 0.0, moved)
        slopes = gradient @ along, s.at.gradient @ along
        near = (measure == 0) | self.criteria.near(s.trial, along, *slopes, value, first)
        last = self.criteria.short(moved, s.at.x)  # whether the trial was next to the point
        at = where(accepted, Point(s.trial, value, gradient, inside, measure, at_rest), s.at)
        best = where(accepted & ~(at.loss >= s.best.loss), at, s.best)
        s = s._replace(
            at=at,
            best=best,
            first=first,
            steepest=steepest,
            n=s.n + accepted,
            evaluations=s.evaluations + 1,
            failures=s.failures + ~sound,
            failure=jnp.where(sound, s.failure, code),
        )
        logged = accepted | ~begun
        entry = jnp.where(logged, jnp.maximum(s.n, 0), self.steps + 1)  # beyond the end: dropped
        entries = History(value, measure, s.failure, s.failures, s.tries)
        log = jax.tree.map(lambda h, e: h.at[entry].set(e, mode="drop"), s.log, entries)
        listen, known = self.listen, {"count": self.steps}
        if listen is not None:
            news = {"number": jnp.maximum(s.n, 0), "failures": s.failures}
            news |= {"loss": value, "gradient_norm": measure}
            lax.cond(logged, lambda: tell(listen, Step, known, news), lambda: None)

        tries = jnp.where(accepted, 0, s.tries + 1)
        # restart the optimizer when its step leads nowhere, or when other entries are blocked than
        # those with which its memory was made
        restart = self.searched & ~accepted & begun & ~s.fresh & (tries >= _PATIENCE)
        changed = self.searched & begun & jnp.any(blocked != s.blocked)
        if self.searched:
            norm = jnp.linalg.norm(inside * self.scale)
            s = s._replace(unit=jnp.where(begun | (norm == 0), s.unit, 1 / norm))

        # At the start the sizes of the parameters may be meaningless, and a small measure with
        # them: ask for one accepted step. A point above the best one is no minimum.
        lowest = value <= best.loss + self.noise * jnp.abs(best.loss)
        small = accepted & level & lowest & ((s.n > 0) | (measure == 0))
        converged = small & (measure == 0 if self.searched else near)
        used_up = s.n >= self.steps
        at_rest = at.at_rest & last  # if no step lowers the loss then, this is the minimum
        # where no entry was ever anything but zero, nothing has been learned of the loss
        blind = converged & (s.n == 0) & jnp.any(~blocked & (gradient == 0))
        spent = (tries > jnp.where(at_rest, _PATIENCE, _SHORTEST)) & ~restart
        s = s._replace(
            blocked=jnp.where(accepted, blocked, s.blocked),
            log=log,
            code=ending(begun | sound, blind, converged | (spent & at_rest), ~used_up),
            running=~converged & (begun | sound) & (~used_up | small) & ~spent,
            fresh=jnp.where(accepted, changed, s.fresh) | restart,
        )
        return self._next(s, accepted, logged, restart, small, tries, factor)

    def _next(self, s, accepted, logged, restart, small, tries, factor):
        """The state with the next trial point: a new step, or a shorter part of the present one."""
        new = accepted | restart
        step, state, fresh = lax.cond(
            s.running & new, self._advance, lambda s: (s.step, s.optimizer, s.fresh), s
        )
        if self.searched:  # the whole step, made with the curvature, must promise little, too
            promised = -(s.at.inside @ step)
            small &= ~fresh & self.criteria.little(promised, s.at.loss, s.first)
            small &= self.criteria.short(self.box.project(s.at.x + step) - s.at.x, s.at.x)
            s = s._replace(
                code=jnp.where(s.running & small, status.OK, s.code),
                running=s.running & ~small & (s.n < self.steps),
            )
        # an analysis will fail again where it has failed: bound steps by the last accepted length
        length_before = s.length * jnp.linalg.norm(s.step / self.scale)
        reach = _GROWTH * jnp.where(s.failures > 0, length_before, s.reach)
        reach = jnp.where(accepted, reach, s.reach)
        whole_length = jnp.linalg.norm(step / self.scale)
        whole = jnp.minimum(1.0, reach / jnp.where(whole_length > 0, whole_length, 1.0))
        length = jnp.where(new, whole, s.length * factor)
        return s._replace(
            trial=self.box.project(s.at.x + length * step),
            step=step,
            length=length,
            optimizer=state,
            fresh=fresh,
            reach=reach,
            tries=jnp.where(restart, 0, tries),
            failures=jnp.where(logged, 0, s.failures),
            failure=jnp.where(logged, 0, s.failure),
        )

    def _value(self, x):
        """The loss, and the status of the analysis."""
        value, code = self.loss(self.back(x))
        return value.astype(x.dtype), code

    def evaluate(self, x: Float[Array, " n"]) -> Evaluation:
        """Loss, gradient and status at a point."""
        (value, code), gradient = jax.value_and_grad(self._value, has_aux=True)(x)
        return Evaluation(value, gradient, code)

    def _judged(self, s, value, gradient, sound, begun):
        """Whether to accept the trial point, and the factor that shortens the step if not.

        The default optimizer asks for a loss that falls by a part of what the slope promises
        (Armijo). Where the loss has no digits left for that, it must not rise, and the slope must
        have become flatter. Other optimizers accept every point at which the analysis succeeds.
        """
        if not self.searched:
            return sound, 0.5
        moved = s.trial - s.at.x
        promised = s.at.inside @ moved
        rise = value - s.at.loss
        level = rise <= self.noise * jnp.abs(s.at.loss)
        level &= gradient @ moved <= -_FLAT * promised
        falls = (promised < 0) & ((rise <= _DECREASE * promised) | level)
        # curvature of the parabola through loss, slope and trial; the next trial is its minimum
        bend = rise - promised
        shorter = jnp.clip(-0.5 * promised / jnp.where(bend > 0, bend, 1.0), 0.1, 0.5)
        return sound & (falls | ~begun), jnp.where(sound & (bend > 0), shorter, 0.5)

    def _anew(self, x):
        """State of an optimizer that starts at `x`."""
        return self.method.init(self.back(x / self.scale))

    def _advance(self, s):
        """A new step from `s.at`, the optimizer's state, and whether it started without memory."""
        if not self.searched:
            return *self._propose(s, s.optimizer), s.fresh
        anew = self._anew(s.at.x)
        step, state = self._propose(s, where(s.fresh, anew, s.optimizer))
        downward = s.at.inside @ step < 0  # if not, the memory of the curvature is misleading
        step, state = lax.cond(downward, lambda: (step, state), lambda: self._propose(s, anew))
        return step, state, s.fresh | ~downward

    def _propose(self, s, state):
        """The optimizer's step [n] and its state."""

        def value_of(scaled):  # for optimizers with a line search: infinite for a failed analysis
            value, code = self._value(self.box.project(ravel_pytree(scaled)[0] * self.scale))
            sound = (code == status.OK) & jnp.isfinite(value)
            return jnp.where(sound, s.unit * value, jnp.inf)

        gradient = self.back(s.unit * self.scale * s.at.inside)
        update, new = self.method.update(
            gradient,
            state,
            self.back(s.at.x / self.scale),
            value=s.unit * s.at.loss,
            grad=gradient,
            value_fn=value_of,
        )
        # the loop needs the same float types in every iteration
        new = jax.tree.map(lambda a, b: jnp.asarray(b, jnp.asarray(a).dtype), state, new)
        step = ravel_pytree(update)[0].astype(self.scale.dtype)
        return jnp.where(s.blocked, 0.0, step * self.scale), new
