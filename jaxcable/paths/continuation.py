"""The loop of a continuation: arc-length steps along the path, and events located between them.

Every iteration tries a step from the last accepted point, the `anchor`: a predictor along the
tangent there, and a corrector onto the path (`corrector`). Between events, these stay the same from
point to point: the sign of the tangent's load factor, the number of negative eigenvalues, which
elements are slack or slip, and whether any has failed. If one of them differs at the end of a step,
an event lies in the step. The step is then not accepted, and the event is located: shorter steps
are tried, their lengths by secants of quantities that are smooth, and by bisection. Those that end
before the event are accepted, until the event lies in a step as short as the tolerance. Then it is
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
from ..common.tree import copy_with
from ..common.types import ArrayLike, Int
from ..equilibrium.newton import Newton
from ..mechanics.load_ramp import LoadRamp
from ..mechanics.slips import slipping_places
from .path_state import BracketEnd, PathPoint, PathSettings, PathState
from .records import allocate_records, make_point_record, record_events, record_point
from .step_decision import StepDecision
from .trial_step import LOAD, PathProblem


def follow_path(
    ramp: LoadRamp,
    method: Newton,
    settings: PathSettings,
    code: Int[ArrayLike, ""],
    capacity: tuple[int, int],
) -> PathState:
    """Follow the equilibrium path of a phase to its end; return the last `PathState` with records.

    Args:
        ramp: the phase as a function of its load factor; not differentiated.
        method: `Newton`.
        settings: `PathSettings`.
        code: status of the earlier phases and the input; unless it is OK nothing is done.
        capacity: largest number of recorded points, and of recorded events.
    """
    problem = PathProblem(ramp, method, settings, capacity)

    def advance(current):
        step = StepDecision(problem, current)
        (rows, n_point), (event_records, n_event) = record_point(step), record_events(step)
        after = copy_with(
            step.state_after_step(),
            point_records=rows,
            n_point=n_point,
            event_records=event_records,
            n_event=n_event,
        )
        return step.with_status(after)

    return lax.while_loop(lambda current: ~current.done, advance, _initial_state(problem, code))


def _initial_state(problem, code):
    """Return the `PathState` before the first step, at load factor 0, with empty records.

    `problem` is the `PathProblem`; `code` the status so far: the path is done unless it is OK.
    """
    ramp, begin, settings = problem.ramp, problem.begin, problem.settings
    n_point, n_event = problem.capacity
    dtype = ramp.start.motion.dtype
    zero, no, number = jnp.zeros((), dtype), jnp.zeros((), bool), jnp.int32(0)
    x = begin.impose_supports(ramp.start.motion)
    no_element = jnp.zeros(sum(len(group.links) for group in ramp.groups), bool)
    still = jnp.zeros(begin.dof_map.free.shape[0], dtype)
    tangent = still, zero + 1
    slipping = slipping_places(begin, x)
    slipping = None if slipping is None else jnp.zeros_like(slipping)
    numbers = number, zero, still, still, still
    point = PathPoint(x, zero, *tangent, ramp.memory, *numbers, no_element, slipping)
    row = jax.eval_shape(lambda: make_point_record(ramp, point, ramp.memory))
    row |= {"iterations": number, "residual": zero, "scale": zero, "rounding": zero}
    event = dict.fromkeys(("kind", "row", "multiplicity"), number)
    event |= dict.fromkeys(("load_factor", "lower", "upper"), zero)
    event |= {"point": point, "null": no, "elements": no_element}
    return PathState(
        anchor=point,
        step_kind=jnp.int32(LOAD),
        ds=zero,
        nominal_ds=jnp.sqrt(2.0).astype(dtype) * settings.step,
        first_stiffness=zero,
        displacement_scale=zero,
        locating=no,
        bracket=zero,
        bracket_end=BracketEnd(zero, zero, number, no, no),
        tol=settings.tol,
        n_tried=number,
        point_records=allocate_records(n_point, row),
        n_point=number,
        event_records=allocate_records(n_event, event),
        n_event=number,
        code=code,
        done=code != status.OK,
    )
