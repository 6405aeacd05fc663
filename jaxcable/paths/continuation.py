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
from .attempt import LOAD, Course
from .decision import Decision
from .records import note, record, room_for, row_of
from .run import Beyond, Point, Run, Settings


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
    course = Course(ramp, method, settings, capacity)

    def advance(run):
        step = Decision(course, run)
        (rows, n_row), (noted, n_event) = record(step), note(step)
        after = copy(step.proceed(), rows=rows, n_row=n_row, noted=noted, n_event=n_event)
        return step.ended(after)

    return lax.while_loop(lambda run: ~run.done, advance, _start(course, code))


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
    row = jax.eval_shape(lambda: row_of(ramp, point, ramp.memory))
    row |= {"iterations": number, "residual": zero, "scale": zero, "rounding": zero}
    event = dict.fromkeys(("kind", "row", "multiplicity"), number)
    event |= dict.fromkeys(("load_factor", "lower", "upper"), zero)
    event |= {"point": point, "null": no, "elements": no_element}
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
        rows=room_for(n_row, row),
        n_row=number,
        noted=room_for(n_event, event),
        n_event=number,
        code=code,
        done=code != status.OK,
    )
