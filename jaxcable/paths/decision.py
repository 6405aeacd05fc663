"""Decides after a step of a continuation: whether it is taken, the next step, and the end."""

from __future__ import annotations

import jax
import jax.numpy as jnp

from ..common import status
from ..common.tree import copy, pytree, where
from ..common.types import Array, Bool, Int
from .attempt import ARC, FINISH, LOAD, Course, Tried
from .detection import NEAR, Seen
from .run import Run
from .steps import cosine, guess_ahead, stride

_EASY = 3  # iterations after which the next step has the same length
_STRAIGHT = 0.999  # cosine of the angle between tangents where a soft path counts as straight
_SOFT = 0.05  # part of the load factor in the tangent below which a path counts as soft
_TRIES = 30  # tries per point of the path, on average, before giving up


@pytree
class Decided:
    """What is decided about a step that was tried, all bool.

    Attributes:
        outside: it passes the last load factor; next, a step onto that load factor is tried.
        accept: it is taken, and its end is the next anchor.
        last: with this step the path is complete.
        stopping: the path stops at the event in this step.
        record: a point is recorded: the end of the step, or its start if an element fails in it.
        again: it has failed, and a shorter one is tried next.
        exhausted: it has failed and cannot be shortened any more.
        rescue: it is exhausted, and a step of the load factor is tried next.
        soft: little stiffness along the path is left.
    """

    outside: Bool[Array, ""]
    accept: Bool[Array, ""]
    last: Bool[Array, ""]
    stopping: Bool[Array, ""]
    record: Bool[Array, ""]
    again: Bool[Array, ""]
    exhausted: Bool[Array, ""]
    rescue: Bool[Array, ""]
    soft: Bool[Array, ""]


def decide(course: Course, run: Run, tried: Tried, seen: Seen) -> Decided:
    """The `Decided` of a step that was tried, from what was `Seen` in it."""
    settings, p = course.settings, tried.point
    outside = seen.usable & ~seen.crossing & (run.mode == ARC) & ~tried.fresh
    outside = outside & ((p.factor >= settings.until) | (p.factor <= settings.down_to))
    accept = seen.usable & ~outside & ~seen.wide & ~seen.fatal & ~seen.astray
    reached = tried.by_newton & (p.factor >= settings.until)
    last = accept & ((run.mode == FINISH) | reached)
    record = (accept & (~run.hunting | seen.hit | last)) | (seen.fatal & run.hunting)
    critical = seen.limit | seen.branch | seen.astray
    stopping = seen.hit & critical & ~seen.failed & ~settings.through
    # a failed step is tried again, shorter; at last by load, where equilibrium is unique
    again = ~seen.usable & ~tried.far
    exhausted = again & (0.25 * run.ds < 0.1 * settings.tol)
    rescue = exhausted & (run.mode != LOAD) & course.begin.always_convex
    soft = (p.rise > 0) & (p.rise < _SOFT) & (p.negative == 0)
    return Decided(outside, accept, last, stopping, record, again, exhausted, rescue, soft)


def proceed(course: Course, run: Run, tried: Tried, seen: Seen, decided: Decided) -> Run:
    """The `Run` after a step, without its records, status and end."""
    settings, a, p, accept = course.settings, run.anchor, tried.point, decided.accept
    anchor = where(accept, _settled(course, p, a), a)
    # the anchor stays on the path, but counts as beyond the bifurcation that was recorded
    passed = {
        of: jnp.where(seen.hit & seen.astray, getattr(run.beyond, of), getattr(anchor, of))
        for of in ("negative", "stiffness")
    }
    anchor = copy(anchor, **passed)
    nominal = _nominal(course, run, tried, seen, decided)
    bracket = jnp.where(accept & run.hunting, run.bracket - run.ds, run.bracket)
    bracket = jnp.where(seen.wide, run.ds, bracket)
    beyond = jax.tree.map(
        lambda new, old: jnp.where(seen.wide & ~seen.astray, new, old), seen.now, run.beyond
    )
    close = jnp.where(beyond.branch, NEAR * settings.step, run.tol)
    over = accept & run.hunting & (bracket <= close)
    hunting = (run.hunting | seen.wide) & ~seen.hit & ~over & ~decided.last
    ahead = guess_ahead(anchor, beyond, bracket, run.tries, close)
    ds = jnp.where(decided.again, 0.25 * run.ds, jnp.where(hunting, ahead, nominal))
    mode = jnp.where(decided.outside, FINISH, ARC)
    mode = jnp.where(accept & ~tried.found.regular, LOAD, mode)
    mode = jnp.where((decided.again | seen.wide) & tried.by_newton, LOAD, mode)
    mode = jnp.where(decided.rescue, LOAD, mode)
    reach = jnp.where(p.factor >= settings.until, settings.until, settings.down_to)
    span = (reach - a.factor) / jnp.where(a.rise == 0, 1.0, a.rise)
    ds = jnp.where(decided.outside, jnp.abs(span), ds)
    onward_by_load = (mode == LOAD) & accept & ~hunting
    return copy(
        run,
        anchor=anchor,
        mode=mode.astype(jnp.int32),
        ds=jnp.where(decided.rescue | onward_by_load, settings.step, ds),
        nominal=nominal,
        reference=jnp.where(seen.wide & ~run.hunting, seen.stiffness, run.reference),
        weight=tried.weight,
        hunting=hunting & ~decided.rescue,
        bracket=bracket,
        beyond=beyond,
        # rounding has moved the event out of its bracket: enlarge the tolerance
        tol=jnp.where(seen.hit, settings.tol, run.tol * jnp.where(over, 4.0, 1.0)),
        tries=run.tries + 1,
    )


def _settled(course, p, a):
    """The point `p` with the memory of laws after the increment from `a` to it."""
    if a.memory is None:
        return p
    system = course.ramp.at(p.factor, a.memory)
    return copy(p, memory=system.settle(p.x))


def _nominal(course, run, tried, seen, decided):
    """Length of an ordinary step, longer after few iterations; it affects no result."""
    settings, a, p, accept = course.settings, run.anchor, tried.point, decided.accept
    ease = jnp.sqrt(_EASY / jnp.maximum(tried.found.steps, 1).astype(run.ds.dtype))
    plain = accept & ~run.hunting & ~seen.hit & (run.mode == ARC)
    nominal = run.nominal * jnp.where(plain, jnp.clip(ease, 0.5, 2.0), 1.0)
    first = tried.fresh | (run.weight == 0)
    nominal = jnp.where(accept & first, jnp.sqrt(2.0) * settings.step, nominal)
    longest = jnp.sqrt(2.0) * settings.largest
    straight = plain & decided.soft & (cosine(a, p) > _STRAIGHT)
    wide_step = stride(p, tried.weight, course.extent, settings.largest)
    longest = jnp.where(straight, jnp.maximum(longest, wide_step), longest)
    return jnp.minimum(nominal, longest)


def outcome(
    course: Course, run: Run, tried: Tried, seen: Seen, decided: Decided, count: Int[Array, ""]
) -> tuple[Int[Array, ""], Bool[Array, ""]]:
    """Status after a step, and whether the path has ended.

    Args:
        course, tried, seen, decided: those of the step.
        run: the `Run` after the step, with its records.
        count: number of events, including those that there is no room for.
    """
    n_row, n_event = course.capacity
    found, code = tried.found, tried.newton_code
    done = decided.last | decided.stopping | seen.fatal
    full = ~done & ((run.n_row >= n_row) | (count > n_event))
    lost = ~done & (run.tries > _TRIES * n_row)
    stopped = jnp.where(seen.limit, status.LIMIT_POINT, status.BIFURCATION)
    given_up, by_newton = decided.exhausted & ~decided.rescue, tried.by_newton & (code != status.OK)
    first = decided.again & tried.fresh
    outcomes = (
        (decided.stopping, stopped),
        (seen.fatal, status.MATERIAL_FAILURE),
        (~seen.usable & tried.far, status.MECHANISM),
        (given_up & by_newton, code),
        (first & ~jnp.isfinite(found.scale), status.NONFINITE),
        (first & found.converged & ~found.regular, status.SINGULAR),
        (given_up | lost, status.PATH_LOST),
        (full & decided.soft & (count == 0), status.EXCESSIVE_DEFORMATION),
        (full & (count > n_event), status.OUT_OF_EVENTS),
        (full, status.OUT_OF_POINTS),
    )
    code = jnp.int32(status.OK)
    for happened, new in reversed(outcomes):
        code = jnp.where(happened, new, code)
    return code.astype(jnp.int32), done
