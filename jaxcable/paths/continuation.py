"""The loop of a continuation: arc-length steps along the path, and events located between them.

Every iteration tries a step from the last point, the `anchor`, along the tangent there. Between
events, these stay the same from point to point: the sign of the tangent's load factor, the number
of negative eigenvalues, which elements are slack, and whether any has failed. If one of them
differs at the end of a step, an event lies in the step. The step is not taken; the event is hunted:
shorter steps are tried, by secants of quantities that are smooth and by bisection. Those that end
before the event are taken, until the event lies in a step as short as the tolerance. Then it is
recorded, and the path goes on beyond it.

In a structure whose equilibrium is unique (`System.always_convex`), a step of the load factor is
made by Newton's method where the tangent does not exist (slack cables at the start, a mechanism
before its first load) and where corrections fail. In other structures such a step could end on any
path: there a start without a tangent is refused (SINGULAR).
"""

from __future__ import annotations

import jax
import jax.numpy as jnp
from jax import lax

from ..common import status
from ..common.tree import copy
from ..common.types import ArrayLike, Int
from ..equilibrium.newton import Newton
from ..mechanics.ramp import Ramp
from .attempt import LOAD, Course, attempt
from .decision import decide, outcome, proceed
from .detection import detect
from .records import note, nothing, record, row_at
from .run import Beyond, Noted, Point, Run, Settings


def march(
    ramp: Ramp,
    method: Newton,
    settings: Settings,
    code: Int[ArrayLike, ""],
    capacity: tuple[int, int],
) -> Run:
    """Follow the path of a phase; returns the last `Run`.

    Args:
        ramp: the phase; not differentiated.
        method: `Newton`.
        settings: `Settings`.
        code: status so far; after a failure nothing is done.
        capacity: numbers of points and of events that there is room for.
    """
    course = Course.of(ramp, method, settings, capacity)

    def advance(run):
        tried = attempt(course, run)
        seen = detect(course, run, tried)
        decided = decide(course, run, tried, seen)
        rows, n_row = record(course, run, tried, seen, decided)
        noted, count = note(course, run, tried, seen)
        after = copy(proceed(course, run, tried, seen, decided), rows=rows, n_row=n_row)
        code, done = outcome(course, after, tried, seen, decided, count)
        n_event = jnp.minimum(count, capacity[1])
        return copy(after, noted=noted, n_event=n_event, code=code, done=done)

    start = _start(course, code)
    return lax.while_loop(lambda run: (run.code == status.OK) & ~run.done, advance, start)


def _start(course, code):
    """The `Run` before the first step."""
    ramp, begin, settings = course.ramp, course.begin, course.settings
    n_row, n_event = course.capacity
    dtype = ramp.begin.motion.dtype
    zero, no, number = jnp.zeros((), dtype), jnp.zeros((), bool), jnp.int32(0)
    x = begin.place(ramp.begin.motion)
    no_element = jnp.zeros(sum(len(group.links) for group in ramp.groups), bool)
    still = jnp.zeros(begin.freedoms.free.shape[0], dtype)
    tangent = still, zero + 1
    point = Point(x, zero, *tangent, ramp.memory, number, zero, still, still, still, no_element)
    entry = Noted(number, zero, zero, zero, number, point, no_element, no, number)
    row = jax.eval_shape(lambda p: row_at(ramp, p, ramp.memory, nothing(p)), point)
    return Run(
        anchor=point,
        mode=jnp.int32(LOAD),
        ds=zero,
        nominal=jnp.sqrt(2.0).astype(dtype) * settings.step,
        reference=zero,
        weight=zero,
        hunting=no,
        bracket=zero,
        beyond=Beyond(zero, zero, number, no, no),
        tol=settings.tol,
        tries=number,
        rows=jax.tree.map(lambda a: jnp.zeros((n_row, *a.shape), a.dtype), row),
        n_row=number,
        noted=jax.tree.map(lambda a: jnp.zeros((n_event, *jnp.shape(a)), a.dtype), entry),
        n_event=number,
        code=code,
        done=no,
    )
