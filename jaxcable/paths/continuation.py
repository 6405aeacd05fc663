"""Along the path: arc-length steps, and events caught between two of them.

Every iteration of one loop tries a step from the last point, the `anchor`, along the tangent there.
What a point is told by is its state: the sign of the tangent's load factor, the number of negative
eigenvalues, which elements are slack, whether any has failed. A step that ends in another state is
not taken but hunted: it is shortened by secants of what is smooth and by halves, while steps that
end in the old state are taken, until the event lies in a step as short as the tolerance. Then it
is noted, and the path goes on beyond it.

In a structure whose equilibrium is unique (`System.always_convex`), a step of the load factor is
made by Newton's method where the tangent does not exist (slack cables at the start, a mechanism
before its first load) and where corrections fail. In others such a step could end anywhere: there a
start without a tangent is refused (SINGULAR).
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
        code: status so far; nothing is done if it is a failure.
        capacity: (rows, events) that there is room for.
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
    nobody = jnp.zeros(sum(len(group.links) for group in ramp.groups), bool)
    still = jnp.zeros(begin.freedoms.free.shape[0], dtype)
    tangent = still, zero + 1
    nowhere = Point(x, zero, *tangent, ramp.memory, number, zero, still, still, still, nobody)
    entry = Noted(number, zero, zero, zero, number, nowhere, nobody, no, number)
    row = jax.eval_shape(lambda p: row_at(ramp, p, ramp.memory, nothing(p)), nowhere)
    return Run(
        anchor=nowhere,
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
