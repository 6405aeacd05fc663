"""The loop of `minimize`: evaluate a trial point, accept it or shorten the step, ask for the next.

The loss is evaluated in one place of the program, once a turn. Whether a line search is going on, a
failed analysis is being avoided or the optimizer is asked for its next step is a matter of state.
"""

from typing import NamedTuple

import jax
import jax.numpy as jnp
import optax
from jax import lax

from .. import status

_LBFGS = optax.lbfgs(linesearch=None)  # the loop searches
_SHORTEST = 40  # halvings before a direction is given up
_PATIENCE = 10  # of them before an optimizer with a memory starts anew
_DECREASE = 1e-4  # part of the decrease that the slope promises
_FLAT = 0.8  # slope at the end of a step over that at its beginning, at most, near the minimum
_GROWTH = 4.0  # of the reach from step to step
_NOISE = 1e-9  # changes of the loss, relative to it, that the tolerance of an analysis may hide


class Point(NamedTuple):
    """Parameters, loss, gradient, the gradient inside the bounds, and its measure."""

    params: object
    loss: object
    gradient: object
    inside: object
    measure: object


class Search(NamedTuple):
    """State of the loop.

    `n` counts accepted steps from -1, before the start is known; `blocked` are the entries at a
    bound that may not move in this step; `fresh` says that the optimizer began anew with it;
    `reach` is how far a step may lead for now because an analysis has failed beyond.
    """

    trial: object
    step: object
    length: object
    at: object
    best: object
    blocked: object
    optimizer: object
    unit: object
    reference: object
    reach: object
    fresh: object
    n: object
    evaluations: object
    tries: object
    failures: object
    failure: object
    history: object
    code: object
    running: object


def descend(loss, optimizer, steps, params, args, box, sizes, scale, tol):
    """Run the loop; see `minimize` for the arguments, all arrays of the shape of `params`.

    Args:
        loss: function of (params, *args).
        optimizer: optax transformation, or None for L-BFGS with a search for a lower loss.
        steps: number of accepted steps, at most.
        params, args, box, sizes, scale, tol: see `minimize`; `sizes` are scalars.

    Returns:
        The final `Search`; its history is (loss, measure, status, failures, shortened).
    """
    searched = optimizer is None
    optimizer = optax.with_extra_args_support(_LBFGS if searched else optimizer)
    dtype = jnp.result_type(*jax.tree.leaves(params))
    noise = jnp.maximum(_NOISE, 64 * jnp.finfo(dtype).eps).astype(dtype)

    def valued(params):
        value, code = outcome(loss(params, *args))
        return value, jnp.where((code == status.OK) & ~jnp.isfinite(value), status.NONFINITE, code)

    def evaluate(trial):
        (value, code), gradient = jax.value_and_grad(valued, has_aux=True)(trial)
        sound = jnp.stack([jnp.all(jnp.isfinite(g)) for g in jax.tree.leaves(gradient)]).all()
        return value, gradient, jnp.where((code == status.OK) & ~sound, status.NONFINITE, code)

    def propose(at, blocked, unit, state):
        """The optimizer's next step in the units of the parameters, entries that may not move 0."""

        def value_of(scaled):  # for a line search of the optimizer: no step to where there is none
            value, code = valued(box.project(_times(scaled, scale)))
            return jnp.where(code == status.OK, unit * value, jnp.inf)

        gradient = jax.tree.map(lambda g, s: unit * s * g, at.inside, scale)
        update, state = optimizer.update(
            gradient,
            state,
            jax.tree.map(jnp.divide, at.params, scale),
            value=unit * at.loss,
            grad=gradient,
            value_fn=value_of,
        )
        return _hide(_times(update, scale), blocked), state

    def begin(params):
        return optimizer.init(jax.tree.map(jnp.divide, params, scale))

    def advance(at, blocked, unit, state, fresh):
        """A step, the optimizer's state after it, and whether it began anew."""
        if not searched:
            return *propose(at, blocked, unit, state), fresh
        anew = begin(at.params)
        state = _select(fresh, anew, state)
        step, after = propose(at, blocked, unit, state)
        downward = _dot(at.inside, step) < 0  # else the memory of curvature misleads
        again, after_again = propose(at, blocked, unit, anew)
        return *_select(downward, (step, after), (again, after_again)), fresh | ~downward

    def falls(s, value, gradient):
        """Whether the loss has fallen enough, and by what to shorten the step if not."""
        moved = jax.tree.map(jnp.subtract, s.trial, s.at.params)
        promised = _dot(s.at.inside, moved)
        enough = value <= s.at.loss + _DECREASE * promised
        level = value <= s.at.loss + noise * jnp.abs(s.at.loss)
        flat = _dot(gradient, moved) <= -_FLAT * promised
        bend = value - s.at.loss - promised
        factor = jnp.clip(-0.5 * promised / jnp.where(bend > 0, bend, 1.0), 0.1, 0.5)
        return (promised < 0) & (enough | (level & flat)), jnp.where(bend > 0, factor, 0.5)

    def turn(s):
        value, gradient, code = evaluate(s.trial)
        sound, begun = code == status.OK, s.n >= 0
        good, factor = sound, jnp.asarray(0.5, dtype)
        if searched:
            fell, shorter = falls(s, value, gradient)
            good, factor = sound & (fell | ~begun), jnp.where(sound, shorter, factor)
        blocked = box.blocked(s.trial, gradient)
        inside = _hide(gradient, blocked)
        reference = jnp.where(begun, s.reference, jnp.abs(value))
        largest = [
            jnp.max(jnp.abs(g), initial=0.0) * size
            for g, size in zip(jax.tree.leaves(inside), jax.tree.leaves(sizes), strict=True)
        ]
        against = jnp.maximum(jnp.abs(value), reference)
        largest = jnp.max(jnp.stack(largest))
        measure = jnp.where(largest > 0, largest / against, 0.0).astype(dtype)
        at = _select(good, Point(s.trial, value, gradient, inside, measure), s.at)
        best = _select(good & ~(at.loss >= s.best.loss), at, s.best)

        n = s.n + good
        failures = s.failures + ~sound
        failure = jnp.where(sound, s.failure, code)
        row = jnp.where(good, n, steps + 1)  # beyond the end: dropped
        entries = (value, measure, failure, failures, s.tries)
        history = [
            h.at[row].set(e.astype(h.dtype), mode="drop")
            for h, e in zip(s.history, entries, strict=True)
        ]
        failures, failure = (jnp.where(good, 0, v) for v in (failures, failure))

        tries = jnp.where(good, 0, s.tries + 1)
        changed = jnp.any(
            jnp.stack(
                [
                    jnp.any(a != b)
                    for a, b in zip(
                        jax.tree.leaves(blocked), jax.tree.leaves(s.blocked), strict=True
                    )
                ]
            )
        )
        blocked = _select(good, blocked, s.blocked)
        lost = jnp.zeros((), bool)
        unit = s.unit
        if searched:
            lost = ~good & begun & ~s.fresh & (tries >= _PATIENCE)
            norm = jnp.sqrt(_dot(*[_times(inside, scale)] * 2))
            unit = jnp.where(begun | (norm == 0), s.unit, 1 / norm)
        converged = good & (measure <= tol)
        code = jnp.where(
            converged,
            status.OK,
            jnp.where(
                ~begun & ~sound,
                status.BAD_START,
                jnp.where(n >= steps, status.OUT_OF_STEPS, status.STALLED),
            ),
        )
        running = ~converged & (begun | sound) & (n < steps) & ((tries <= _SHORTEST) | lost)
        fresh = jnp.where(good, (changed & begun) if searched else False, s.fresh) | lost
        step, state, fresh = lax.cond(
            running & (good | lost),
            lambda: advance(at, blocked, unit, s.optimizer, fresh),
            lambda: (s.step, s.optimizer, fresh),
        )
        # what failed a step ago will fail again: approach it from the last good length
        gone = s.length * _norm(s.step, scale)
        reach = jnp.where(s.failures > 0, _GROWTH * gone, _GROWTH * s.reach)
        reach = jnp.where(good, reach, s.reach)
        far = _norm(step, scale)
        whole = jnp.minimum(1.0, reach / jnp.where(far > 0, far, 1.0))
        length = jnp.where(good | lost, whole, s.length * factor).astype(dtype)
        trial = box.project(
            jax.tree.map(lambda x, d: x + length.astype(x.dtype) * d, at.params, step)
        )
        return Search(
            trial,
            step,
            length,
            at,
            best,
            blocked,
            state,
            unit,
            reference,
            reach,
            fresh,
            n,
            s.evaluations + 1,
            jnp.where(lost, 0, tries),
            failures,
            failure,
            history,
            code.astype(jnp.int32),
            running,
        )

    nothing = jax.tree.map(jnp.zeros_like, params)
    unknown = jnp.asarray(jnp.nan, dtype)
    start = Point(params, unknown, nothing, nothing, unknown)
    empty = jnp.full(steps + 1, jnp.nan, dtype)
    count = jnp.full(steps + 1, -1, jnp.int32)
    zero = jnp.int32(0)
    search = Search(
        trial=params,
        step=nothing,
        length=jnp.ones((), dtype),
        at=start,
        best=start,
        blocked=jax.tree.map(lambda x: jnp.zeros(x.shape, bool), params),
        optimizer=begin(params),
        unit=jnp.ones((), dtype),
        reference=jnp.zeros((), dtype),
        reach=jnp.asarray(jnp.inf, dtype),
        fresh=jnp.ones((), bool),
        n=jnp.int32(-1),
        evaluations=zero,
        tries=zero,
        failures=zero,
        failure=zero,
        history=[empty, empty, count, count, count],
        code=zero,
        running=jnp.ones((), bool),
    )
    return lax.while_loop(lambda s: s.running, turn, search)


def outcome(result):
    """Value and status of what a loss returns: a scalar, or (scalar, what carries the status)."""
    value, told = result if isinstance(result, tuple) and len(result) == 2 else (result, ())
    value = jnp.asarray(value)
    if value.shape != () or not jnp.issubdtype(value.dtype, jnp.floating):
        raise ValueError(
            f"loss: expected a scalar float, or (scalar, solution), got {value.dtype}"
            f"{list(value.shape)}"
        )
    return value, worst_code(told, "loss")


def worst_code(told, name):
    """The largest status code in a pytree of solutions and arrays of codes; OK if it is empty."""
    code = jnp.int32(status.OK)
    for item in jax.tree.leaves(told, is_leaf=lambda item: hasattr(item, "status")):
        codes = jnp.asarray(getattr(item, "status", item))
        if not jnp.issubdtype(codes.dtype, jnp.integer):
            raise ValueError(f"{name}: beside the value expected solutions or status codes")
        code = jnp.maximum(code, jnp.max(codes, initial=status.OK))
    return code.astype(jnp.int32)


def _select(which, new, old):
    return jax.tree.map(lambda a, b: jnp.where(which, a, b), new, old)


def _times(tree, other):
    return jax.tree.map(jnp.multiply, tree, other)


def _norm(tree, scale):
    """Length of a step in units of the scale."""
    over = jax.tree.map(jnp.divide, tree, scale)
    return jnp.sqrt(_dot(over, over))


def _hide(tree, blocked):
    return jax.tree.map(lambda x, b: jnp.where(b, jnp.zeros_like(x), x), tree, blocked)


def _dot(a, b):
    return sum(jnp.sum(x * y) for x, y in zip(jax.tree.leaves(a), jax.tree.leaves(b), strict=True))
