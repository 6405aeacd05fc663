"""Along the path: arc-length steps, and events caught between two of them.

Every turn of one loop tries a step from the last point, the `anchor`, along the tangent there. What
a point is told by is its state: the sign of the tangent's load factor, the number of negative
eigenvalues, which elements are slack, whether any has failed. A step that ends in another state is
not taken but hunted: it is shortened by secants of what is smooth and by halves, while steps that
end in the old state are taken, until the event lies in a step as short as the tolerance. Then it
is noted, and the path goes on beyond it.

In a structure whose equilibrium is unique (`System.convex`), a step of the load factor is made by
Newton's method where the tangent does not exist (slack cables at the start, a mechanism before its
first load) and where corrections fail. In others such a step could end anywhere: there a start
without a tangent is refused (SINGULAR).
"""

import jax
import jax.numpy as jnp
from jax import lax

from .. import equilibrium, linear, status
from .._tree import copy
from ..elementwise import each
from ..results import row_of
from . import events
from .correction import Condition, by_load, correct, loose_unknowns
from .inertia import alignment, crossed, multiplicity, unstable
from .run import Beyond, Noted, Point, Run
from .steps import cosine, guess_ahead, scale_of, stride

ARC, FINISH, LOAD = 0, 1, 2  # ways to step: along the path, onto the last load factor, by load
_BEND = 0.9  # cosine of the largest angle between tangents of neighbouring points
_SHORT = 1e-3  # steps of this part of the first one are taken round any corner
_LEAP = 4.0  # longest steps that a correction may go; further off is another part of the path
_EASY = 3  # iterations of a step that may be followed by one as long
_STRAIGHT = 0.999  # cosine of the angle between tangents where a soft path counts as straight
_SOFT = 0.05  # stiffness along the path over that at its start which little is left of
_ALIGNED = 1e-4  # phi.F / |phi||F| above this is not zero
_FLAT = 1e-3  # rise of a unit tangent this small is that of a limit point
_NEAR = 5e-4  # part of the first step within which a bifurcation is interpolated
_LOW = 1e-3  # stiffness beside an event over that where it was first seen; else it jumps
_UNSURE = 64  # roundings in a strain, which tell neither taut nor slack
_FAR = 100.0  # displacement, in structure sizes, of a structure that nothing holds
_TURNS = 30  # tries for each row of the path, on average, before giving up


def march(ramp, method, settings, code, capacity):
    """Follow the path of a phase; returns the last `Run`.

    Args:
        ramp: the phase; not differentiated.
        method: `Newton`.
        settings: `Settings`.
        code: status so far; nothing is done if it is a failure.
        capacity: (rows, events) that there is room for.
    """
    dtype = ramp.begin.motion.dtype
    tol = equilibrium.limit(method, dtype)
    n_row, n_event = capacity
    begin = ramp.at(jnp.zeros((), dtype))
    x = begin.place(begin.unknowns(ramp.begin.motion))
    extent = begin.extent()

    def attempt(run):
        """Try a step: what it led to, whether it is usable, and what it tells about scales."""
        a, ds = run.anchor, run.ds
        fresh = run.n_row == 0
        by_newton = run.mode == LOAD
        factor = a.factor + ds * jnp.where(by_newton, 1.0, a.rise)
        factor = jnp.where(by_newton, jnp.minimum(factor, settings.until), factor)
        end = jnp.where(a.rise > 0, settings.until, settings.down_to)
        factor = jnp.where(run.mode == FINISH, end, factor)
        along = jnp.where(by_newton, 0.0, ds * a.turn * run.weight)
        guess, newton_code = ramp.at(factor, a.plastic).move(a.x, along), jnp.int32(status.OK)
        if begin.always_convex:  # else equilibrium is not unique, and it might go anywhere
            found, newton_code = by_load(ramp, a.plastic, a.x, factor, method, by_newton)
            guess = jnp.where(by_newton, found, guess)
        free = run.mode == ARC
        sense = jnp.where(a.rise < 0, -1.0, 1.0)  # the tangent at the end points onward, too
        condition = Condition(
            jnp.where(free, a.turn / jnp.where(free, run.weight, 1.0), 0.0),
            jnp.where(free, a.rise, sense),
            jnp.where(free, ds, sense * (factor - a.factor)),
        )
        active = ~by_newton | (newton_code == status.OK)
        found = correct(ramp, a.plastic, guess, along, factor, a.factor, condition, tol, active)
        weight = jnp.where(run.weight > 0, run.weight, scale_of(found, begin))
        turn, rise = found.turn / weight, found.rise
        size = jnp.sqrt(turn @ turn + rise**2)
        size = jnp.where((size > 0) & jnp.isfinite(size), size, 1.0)
        closing = run.hunting & run.beyond.branch
        point = _point(ramp, a, found, turn / size, rise / size, closing)
        bent = (cosine(a, point) < _BEND) & free
        far = jnp.max(jnp.abs(found.x), initial=0.0) > _FAR * extent
        regular = found.regular | (by_newton & begin.always_convex)
        gone = jnp.sqrt(jnp.sum((found.moved / weight) ** 2) + (found.factor - a.factor) ** 2)
        leapt = free & ~fresh & (gone > _LEAP * jnp.maximum(jnp.sqrt(2.0) * settings.largest, ds))
        sound = found.converged & regular & ~far & ~leapt
        weight = jnp.where(found.regular, weight, run.weight)
        return found, point, sound, bent & ~fresh, newton_code, weight, far

    def turn(run):
        a, ds = run.anchor, run.ds
        found, p, sound, bent, newton_code, weight, far = attempt(run)
        fresh, by_newton = run.n_row == 0, run.mode == LOAD
        system = ramp.at(p.factor, a.plastic)
        broken = system.beyond(system.motion(p.x)) if system.breaks else jnp.zeros((), bool)

        # --- what has changed since the anchor
        # close to a bifurcation corrections can end on the other branch: no point to go on from
        astray = sound & bent & run.hunting & run.beyond.branch
        usable = sound & ~(bent & ~astray & (ds > _SHORT * settings.step))
        known = usable & ~fresh & ~astray
        limit = known & ~by_newton & ((p.rise > 0) != (a.rise > 0))
        # the inertia changes at a limit point too, a hair before or after the load factor turns
        aligned = alignment(p) > _ALIGNED
        of_limit = (jnp.abs(p.rise) < _FLAT) & aligned
        branch = known & found.regular & crossed(p, a) & ~of_limit
        branch = branch | (usable & fresh & unstable(p))  # unstable from the start
        slackened = known & jnp.any(p.slack & ~a.slack)
        tightened = known & jnp.any(a.slack & ~p.slack)
        failed = usable & broken & ~astray
        smooth = (limit | branch) & ~(slackened | tightened | failed)
        crossing = limit | branch | slackened | tightened | failed | astray
        # Too near to a bifurcation the tangent is lost in rounding; at some distance its stiffness
        # is a straight line through zero.
        near = ds <= _NEAR * settings.step
        both = jnp.maximum(jnp.abs(p.stiffness), jnp.abs(a.stiffness))
        low = run.hunting & (both <= _LOW * run.reference) & (p.stiffness * a.stiffness < 0)
        line = ((branch & smooth) | astray) & ~limit & low & near
        # on the other branch already, and as near as one gets
        stray = astray & near
        wide = crossing & (ds > run.tol) & ~line & ~fresh & ~stray
        hit = crossing & ~wide

        forks = smooth & branch & ~limit & (low | ~near)  # or else the stiffness jumps
        now = Beyond(p.rise, p.stiffness, p.negative, smooth, forks)

        # --- what to do with the step
        outside = usable & ~crossing & (run.mode == ARC) & ~fresh
        outside = outside & ((p.factor >= settings.until) | (p.factor <= settings.down_to))
        fatal = hit & failed
        accept = usable & ~outside & ~wide & ~fatal & ~astray
        last = accept & ((run.mode == FINISH) | (by_newton & (p.factor >= settings.until)))
        record = (accept & (~run.hunting | hit | last)) | (fatal & run.hunting)

        # --- events
        kinds = (
            (limit & ~failed, events.LIMIT_POINT),
            ((branch | astray) & ~limit & ~failed, events.BIFURCATION),
            (slackened, events.SLACKENING),
            (tightened, events.TIGHTENING),
            (failed, events.MATERIAL_FAILURE),
        )
        noted, count = run.noted, run.n_event
        beside = jax.tree.map(lambda far, new: jnp.where(astray, far, new), run.beyond, now)
        many = multiplicity(beside, a, fresh)
        for happened, kind in kinds:
            own = jnp.where(kind == events.SLACKENING, p.slack & ~a.slack, a.slack & ~p.slack)
            if kind == events.MATERIAL_FAILURE:
                own = system.broken(system.motion(p.x)) if system.breaks else own & False
            elif kind not in (events.SLACKENING, events.TIGHTENING):
                own = own & False
            note = hit & happened & (count < n_event)
            null = run.hunting & (both <= _LOW * run.reference)
            at = jnp.where(line & (kind == events.BIFURCATION), _zero_between(a, p), p.factor)
            number = many[kind == events.LIMIT_POINT] if kind in events.CRITICAL else jnp.int32(0)
            entry = Noted(jnp.int32(kind), at, a.factor, p.factor, run.n_row, p, own, null, number)
            noted = _put(noted, count, entry, note)
            count = count + (hit & happened)
        stopping = hit & (limit | branch | astray) & ~failed & ~settings.through

        # --- the row
        shown = jax.tree.map(lambda new, old: jnp.where(fatal, old, new), p, a)
        row = _row(ramp, shown, a.plastic, found)
        n_rows = run.n_row + record
        rows = _put(run.rows, run.n_row, row, record)

        # --- the next step
        anchor = jax.tree.map(lambda new, old: jnp.where(accept, new, old), settled(p, a), a)
        # the path itself goes straight on, beyond the bifurcation that has been noted
        passed = [
            jnp.where(hit & astray, getattr(run.beyond, of), getattr(anchor, of))
            for of in ("negative", "stiffness")
        ]
        anchor = copy(anchor, negative=passed[0], stiffness=passed[1])
        ease = jnp.sqrt(_EASY / jnp.maximum(found.steps, 1).astype(dtype))
        plain = accept & ~run.hunting & ~hit & (run.mode == ARC)
        # steers the length of steps, no part of the result
        nominal = run.nominal * jnp.where(plain, jnp.clip(ease, 0.5, 2.0), 1.0)
        first = fresh | (run.weight == 0)
        nominal = jnp.where(accept & first, jnp.sqrt(2.0) * settings.step, nominal)
        longest = jnp.sqrt(2.0) * settings.largest
        soft = (p.rise > 0) & (p.rise < _SOFT) & (p.negative == 0)
        straight = plain & soft & (cosine(a, p) > _STRAIGHT)
        wide_step = stride(p, weight, extent, settings.largest)
        longest = jnp.where(straight, jnp.maximum(longest, wide_step), longest)
        nominal = jnp.minimum(nominal, longest)
        bracket = jnp.where(
            wide, ds, jnp.where(accept & run.hunting, run.bracket - ds, run.bracket)
        )
        far_end = jax.tree.map(
            lambda new, old: jnp.where(wide & ~astray, new, old), now, run.beyond
        )
        close = run.tol
        close = jnp.where(far_end.branch, _NEAR * settings.step, close)
        over = accept & run.hunting & (bracket <= close)
        hunting = (run.hunting | wide) & ~hit & ~over & ~last
        ahead = guess_ahead(anchor, far_end, bracket, run.turns, close)
        ds_next = jnp.where(hunting, ahead, nominal)

        # a step that fails is tried again, shorter; where equilibrium is unique, by load at last
        again = ~usable & ~far
        shorter = 0.25 * ds
        exhausted = again & (shorter < 0.1 * settings.tol)
        rescue = exhausted & (run.mode != LOAD) & begin.always_convex
        ds_next = jnp.where(again, shorter, ds_next)
        mode = jnp.where(outside, FINISH, ARC)
        mode = jnp.where(accept & ~found.regular, LOAD, mode)
        mode = jnp.where((again | wide) & by_newton, LOAD, mode)
        mode = jnp.where(rescue, LOAD, mode)
        reach = jnp.where(p.factor >= settings.until, settings.until, settings.down_to)
        span = (reach - a.factor) / jnp.where(a.rise == 0, 1.0, a.rise)
        ds_next = jnp.where(outside, jnp.abs(span), ds_next)
        ds_next = jnp.where(rescue | ((mode == LOAD) & accept & ~hunting), settings.step, ds_next)
        hunting = hunting & ~rescue

        # --- the outcome
        done = last | stopping | fatal
        code = jnp.int32(status.OK)
        full = ~done & ((n_rows >= n_row) | (count > n_event))
        lost = ~done & (run.turns >= _TURNS * n_row)
        stopped = jnp.where(limit, status.LIMIT_POINT, status.BIFURCATION)
        outcomes = (
            (stopping, stopped),
            (fatal, status.MATERIAL_FAILURE),
            (usable & ~accept & fresh & failed, status.MATERIAL_FAILURE),
            (~usable & far, status.MECHANISM),
            (exhausted & ~rescue & by_newton & (newton_code != status.OK), newton_code),
            (again & fresh & ~jnp.isfinite(found.scale), status.NONFINITE),
            (again & fresh & found.converged & ~found.regular, status.SINGULAR),
            (exhausted & ~rescue, status.NOT_CONVERGED),
            (by_newton & fresh & (newton_code != status.OK), newton_code),
            (lost, status.NOT_CONVERGED),
            (full & soft & (count == 0), status.EXCESSIVE_DEFORMATION),
            (full, status.OUT_OF_STEPS),
        )
        for happened, own in reversed(outcomes):
            code = jnp.where(happened, own, code)
        return Run(
            anchor=anchor,
            mode=mode.astype(jnp.int32),
            ds=ds_next,
            nominal=nominal,
            reference=jnp.where(wide & ~run.hunting, both, run.reference),
            weight=weight,
            hunting=hunting,
            bracket=bracket,
            beyond=far_end,
            # rounding moves events by more than the tolerance: be content with a larger one
            tol=jnp.where(hit, settings.tol, run.tol * jnp.where(over, 4.0, 1.0)),
            turns=run.turns + 1,
            rows=rows,
            n_row=n_rows,
            noted=noted,
            n_event=jnp.minimum(count, n_event),
            code=code.astype(jnp.int32),
            done=done,
        )

    def settled(p, a):
        system = ramp.at(p.factor, a.plastic)
        return copy(p, plastic=ramp.settle(system, p.x, jnp.ones((), bool), a.plastic))

    zero = jnp.zeros((), dtype)
    nobody = jnp.zeros(sum(len(group.links) for group in ramp.groups), bool)
    still = jnp.zeros(begin.freedoms.free.shape[0], dtype)
    nowhere = Point(
        *(x, zero, still, zero + 1, ramp.plastic, jnp.int32(0), zero, still, still, still),
        nobody,
    )
    no = jnp.zeros((), bool)
    entry = Noted(jnp.int32(0), zero, zero, zero, jnp.int32(0), nowhere, nobody, no, jnp.int32(0))
    unknown = jax.eval_shape(lambda p: _row(ramp, p, ramp.plastic, _nothing(p)), nowhere)
    start = Run(
        anchor=nowhere,
        mode=jnp.int32(LOAD),
        ds=zero,
        nominal=jnp.sqrt(2.0).astype(dtype) * settings.step,
        reference=zero,
        weight=zero,
        hunting=jnp.zeros((), bool),
        bracket=zero,
        beyond=Beyond(zero, zero, jnp.int32(0), jnp.zeros((), bool), jnp.zeros((), bool)),
        tol=settings.tol,
        turns=jnp.int32(0),
        rows=jax.tree.map(lambda a: jnp.zeros((n_row, *a.shape), a.dtype), unknown),
        n_row=jnp.int32(0),
        noted=jax.tree.map(lambda a: jnp.zeros((n_event, *jnp.shape(a)), a.dtype), entry),
        n_event=jnp.int32(0),
        code=code,
        done=jnp.zeros((), bool),
    )
    return lax.while_loop(lambda run: (run.code == status.OK) & ~run.done, turn, start)


def _point(ramp, a, found, turn, rise, closing):
    """The `Point` that an iteration from `a` ended in; `closing` in on a bifurcation."""
    system = ramp.at(found.factor, a.plastic)
    loose = loose_unknowns(system, found.x)
    # loads that follow and moments of frames can make the tangent unsymmetric
    general = system.followers is not None or system.turning
    found_out = linear.spectrum(found.matrix, loose, general, closing)
    slack = _slack(system, system.motion(found.x), a.slack)
    return Point(found.x, found.factor, turn, rise, a.plastic, *found_out, found.pull, slack)


def _slack(system, motion, before):
    """Slack elements, all groups one after the other; as before where strain is all rounding."""
    rows, at = [], 0
    for group, state, own in zip(system.groups, system.states, system.slack(motion), strict=True):
        was, at = before[at : at + len(own)], at + len(own)
        if group.tension_only and hasattr(group, "strain"):
            strain = each("strain", group, state, system.nodes, motion)
            unsure = jnp.abs(strain) <= _UNSURE * jnp.finfo(strain.dtype).eps
            own = jnp.where(unsure, was, own)
        rows.append(own)
    return jnp.concatenate(rows)


def _zero_between(a, p):
    """Load factor at which the stiffness is zero, on the line between two points."""
    part = a.stiffness / jnp.where(a.stiffness == p.stiffness, 1.0, a.stiffness - p.stiffness)
    return a.factor + part * (p.factor - a.factor)


def _row(ramp, p, plastic, found):
    """What is recorded of a point."""
    system = ramp.at(p.factor, plastic)
    return (
        p.factor,
        row_of(ramp, system, p.x),
        p.negative,
        p.stiffness,
        p.rise,
        found.steps,
        found.residual,
        found.scale,
    )


def _nothing(p):
    """Stands for `Corrected` where only shapes are asked for."""
    zero = jnp.zeros((), p.rise.dtype)

    class Shapes:
        steps, residual, scale = jnp.int32(0), zero, zero

    return Shapes


def _put(rows, number, row, wanted):
    """Write `row` at `number` where `wanted`."""

    def one(column, value):
        at = jnp.minimum(number, len(column) - 1)
        return column.at[at].set(jnp.where(wanted, value, column[at]))

    return jax.tree.map(one, rows, row)
