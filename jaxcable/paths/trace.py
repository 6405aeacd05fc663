"""`trace_path`: follow a phase by arc length, through limit points, and locate its events."""

from __future__ import annotations

import functools
import itertools
from collections.abc import Sequence

import jax
import jax.numpy as jnp
import numpy as np
from jax import lax

from ..analysis.as_built_inputs import refuse_as_built
from ..analysis.phase_checks import before_phases
from ..analysis.phases import Phase, as_phases
from ..analysis.preparation import complete_input, prepare, traced_input_status
from ..analysis.results import fields_of_element_results, fill_peak_tensions, map_element_fields
from ..analysis.solution import Solution, State
from ..analysis.solver import solve
from ..analysis.states import without_extra_rows
from ..common import checks, status
from ..common.rules import refuse_if_broken
from ..common.tree import apply_numpy_or_jax, copy_with, merge_indices
from ..common.types import ArrayLike, Bool, Float
from ..equilibrium.newton import Newton
from ..loads import Varying, as_list
from ..mechanics.load_ramp import LoadRamp
from ..model.structure import Structure
from ..numerics import implicit, scaled
from ..programs.program_calls import as_program
from .continuation import follow_path
from .events import BIFURCATION, LIMIT_POINT, Events
from .negative_eigenvalues import load_mode_alignment
from .path_state import PathSettings
from .result import TracedPath

_MOVES = "displacement", "displacement_in_phase"


def trace_path(
    structure: Structure,
    phases: Phase | Sequence[Phase] | None = None,
    method: Newton | None = None,
    *,
    start: Solution | State | None = None,
    until: Float[ArrayLike, ""] = 1.0,
    down_to: Float[ArrayLike, ""] = -1.0,
    step: Float[ArrayLike, ""] = 0.02,
    largest: Float[ArrayLike, ""] = 0.1,
    steps: int = 200,
    events: int = 32,
    tol: Float[ArrayLike, ""] | None = None,
    through: Bool[ArrayLike, ""] = True,
) -> TracedPath:
    """Follow the equilibrium path of the last phase by arc length; earlier phases are solved first.

    The load factor scales what the last phase adds (loads, changes of unstressed length, movements
    of supports); the number of increments of this phase is not used. The load factor starts at 0;
    the path ends where it reaches `until` or falls to `down_to`, or at a failure. Limit points,
    bifurcations, slackening and tightening of cables, places where cables with friction begin to
    slip, and material failure are located along the path to `tol`. Limit points and bifurcations
    differ in ``phi.F``: the load F does work on the null vector phi of the tangent at a limit
    point, and none at a bifurcation.

    The path is the one through the start; at a bifurcation it goes straight on. Where it bends
    sharply steps are shortened. As in any continuation, a neighbouring path can be mistaken for it:
    look at `TracedPath.rise`, or repeat with smaller steps.

    A state that is unstable from the start counts as a bifurcation at load factor 0. Events that
    cancel each other within one step are not seen: take a smaller `largest` where that may happen.

    A pure function. Derivatives: only of the load factor at smooth limit points, with respect to
    all parameters, by ``df/dp = -phi.R_p / (phi.R_f)``, first order only. All others are NaN, also
    at corners of laws and in structures whose laws have history variables.

    Args:
        structure: `Structure`.
        phases: list of `Phase`, or one.
        method: `Newton` (default); its `tol` holds at every point.

    Options:
        start: `Solution` or its `.last` to start from; default: the initial structure.
        until, down_to: load factors at which the path ends, ``down_to < 0 < until``; 1 and -1.
        step, largest: first and largest step, as changes of the load factor on a straight path;
            0.02 and 0.1. Arc length gives load factor and displacement the same weight, as they
            change at the start. Where little stiffness is left and the path is straight, as in
            plastic collapse, steps are longer: `largest` in load, or 2 % of the structure's size in
            displacement.
        steps: largest number of points of the path; 200.
        events: largest number of events; 32.
        tol: length of path within which events are located, in units of `step`; default 1e-9, in
            float32 1e-5. At a smooth limit point the error of the load factor is of the order of
            its square.
        through: True (default) to go on beyond limit points and bifurcations, False to end at the
            first of them with its status.

    Returns:
        `TracedPath`; `path.failure_load` is the load factor of the first failure.

    Raises:
        ValueError: wrong input, naming argument and rule.

    Source: Riks, Int. J. Solids Structures 15 (1979); Keller, in Applications of Bifurcation Theory
    (1977); Crisfield, Non-linear Finite Element Analysis of Solids and Structures 1 (1991), ch. 9.

    Example:
        A shallow truss of von Mises: limit point at ``l = (b^2 l0)^(1/3)``.

        >>> structure, phases = jc.scenes.von_mises_truss(rise=0.1, load=500.0)
        >>> path = jc.trace_path(structure, phases)
        >>> print(path.status, path.events.names[0])
        0 limit point
        >>> start, limit = np.sqrt(1.01), 1.01 ** (1 / 6)  # lengths l0 and l
        >>> load = 2 * 1e6 * (start - limit) / start * np.sqrt(limit**2 - 1) / limit
        >>> print(f"{500 * path.failure_load:.6f} N, {load:.6f} N")
        381.087190 N, 381.087190 N
    """
    phases = as_phases(structure, phases)
    method = Newton() if method is None else method
    if not isinstance(method, Newton):
        raise ValueError(f"method: expected Newton, got {type(method).__name__}")
    settings = check_path_settings(structure, until, down_to, step, largest, tol, through)
    if phases[-1].adds is not None or phases[-1].removes is not None:
        raise ValueError(
            "phases: the last phase, whose path is followed, must not add or remove elements; let "
            "a separate phase before it do so"
        )
    for k, load in enumerate(as_list(phases[-1].loads)):
        if isinstance(load, Varying):
            raise ValueError(
                f"phases[{len(phases) - 1}].loads[{k}]: has an amplitude; the path of the last "
                "phase is that of loads proportional to the load factor, let an earlier one add it"
            )
    for name, count in (("steps", steps), ("events", events)):
        checks.require_whole_number(count, name, least=2)
    if len(phases) > 1:
        with before_phases(phases[-1:]):
            start = solve(structure, phases[:-1], method, start=start)
    refuse_as_built(structure, phases[-1:], "trace_path", len(phases) - 1)
    task = prepare(structure, phases[-1:], method, start, len(phases) - 1)
    core = task.without_indices, task.arrays, task.method, settings, task.code
    path, n_point, n_event = _trace_as_program(
        *core, capacity=(int(steps), int(events)), bundles=task.bundles
    )
    path = map_element_fields(
        fill_peak_tensions(without_extra_rows(structure, path, _MOVES)), structure.arrange
    )
    happened = without_extra_rows(structure, path.events, ("displacement", "mode"))
    happened = copy_with(happened, elements=structure.arrange(happened.elements))
    if not isinstance(n_point, jax.core.Tracer):
        happened = _first_entries(happened, count=int(n_event))
        reached = _first_entries(copy_with(path, status=None, events=None), count=int(n_point))
        path = copy_with(reached, status=path.status)
    return copy_with(path, events=happened)


def _first_entries(tree, count):
    """Return a pytree of arrays, each cut to its first `count` entries, known ones by NumPy."""
    return jax.tree.map(lambda a: apply_numpy_or_jax(lambda _, x: x[:count], a), tree)


def check_path_settings(structure, until, down_to, step, largest, tol, through):
    """Return the options of `trace_path` as `PathSettings`, in the dtype of the structure's nodes.

    Raises ValueError for known numbers that break a rule.
    """
    dtype = jnp.result_type(structure.nodes)
    if tol is None:
        tol = 1e-9 if jnp.finfo(dtype).eps < 1e-12 else 1e-5
    numbers = until, down_to, step, largest, tol
    refuse_if_broken(PathSettings(*numbers, through).rules())
    numbers = (checks.numpy_or_jax(v).asarray(v, dtype) for v in numbers)
    return PathSettings(*numbers, checks.numpy_or_jax(through).asarray(through, bool))


@functools.partial(as_program, static=("capacity", "bundles"))
def _trace_as_program(without_indices, index_arrays, method, settings, code, capacity, bundles):
    """Return the `TracedPath` of full length, and the numbers of points and events in it.

    Args:
        without_indices, index_arrays, bundles: structure and phases, from `preparation.prepare`.
        method, settings: `Newton` and `PathSettings`.
        code: status of the phases before.
        capacity: largest numbers of points and events.
    """
    parameters = merge_indices(without_indices, index_arrays)
    code = status.first_failure(code, traced_input_status(parameters, method, settings)[1][0])
    nodes, groups, restart, schedule = complete_input(parameters, bundles)
    # rounding limits how short a bracket can be
    closest = 64 * jnp.finfo(settings.tol.dtype).eps
    settings = copy_with(settings, tol=jnp.maximum(settings.tol * settings.step, closest))
    problem = nodes, groups, restart, schedule.phase(0)
    ramp = LoadRamp.build(*lax.stop_gradient(problem))
    method, settings = lax.stop_gradient((method, settings))
    final = lax.stop_gradient(follow_path(ramp, method, settings, code, capacity))
    happened = jnp.arange(capacity[1]) < final.n_event
    reached = jnp.arange(capacity[0]) < final.n_point
    rows, event_records = (
        _nan_where_unreached(final.point_records, reached),
        dict(final.event_records),
    )
    found = {name: bundles.split(value, axis=1) for name, value in rows.pop("found").items()}
    point, has_null_vector, factor, elements = (
        event_records.pop(name) for name in ("point", "null", "load_factor", "elements")
    )
    between = {name: event_records.pop(name) for name in ("lower", "upper", "row")}
    between["displacement"] = point.x[..., :3]
    modes = {"mode": jax.vmap(lambda p: _mode_shape(ramp, p))(point)}
    modes["alignment"] = jax.vmap(load_mode_alignment)(point)
    critical = (event_records["kind"] == LIMIT_POINT) | (event_records["kind"] == BIFURCATION)
    known = _nan_where_unreached(between, happened) | _nan_where_unreached(modes, critical)
    path = TracedPath(
        displacement_in_phase=rows["displacement"] - ramp.start.motion[None, :, :3],
        status=final.code,
        factorizations=None,
        equilibrated=None,
        relative_residual=scaled.relative_residual(rows["residual"], rows.pop("scale")),
        events=Events(load_factor=None, elements=None, **event_records, **known),
        **rows,
        **fields_of_element_results(found),
    )
    path = implicit.with_nan_derivative(path, parameters)
    located = jax.vmap(
        lambda *event: _differentiable_event_load_factor(*event, ramp, problem, parameters)
    )
    counts = np.cumsum([0, *(len(group.links) for group in ramp.groups)])
    parts = [elements[:, a:b] for a, b in itertools.pairwise(counts)]
    events = copy_with(
        path.events,
        load_factor=_nan_where_unreached(
            located(event_records["kind"], factor, point, has_null_vector), happened
        ),
        elements=bundles.split(parts, axis=1),
    )
    return copy_with(path, events=events), final.n_point, final.n_event


def _nan_where_unreached(values, reached):
    """Replace entries of arrays [n, ...] where `reached` [n] is False, by NaN, or -1 in counts."""

    def one(a):
        missing = jnp.nan if jnp.issubdtype(a.dtype, jnp.floating) else -1
        mask = reached.reshape(-1, *(1,) * (a.ndim - 1))
        return jnp.where(mask, a, jnp.asarray(missing, a.dtype))

    return jax.tree.map(one, values)


def _mode_shape(ramp, point):
    """Return the null vector at a point as displacements of all nodes, [n_node, 3], scaled to 1."""
    space = ramp.system_at(point.load_factor, point.memory).space

    def moved(step):
        return space.prolong(point.x, step)[:, :3]

    shape = jax.jvp(moved, (jnp.zeros_like(point.phi),), (point.phi,))[1]
    return scaled.normalize_mode_shapes(shape[None], point.phi[None])[0]


def _differentiable_event_load_factor(
    kind, factor, point, has_null_vector, ramp, problem, parameters
):
    """Return the load factor of an event, with derivatives if it is a smooth limit point, else NaN.

    At a limit point the left null vector phi of the tangent eliminates the unknowns from the
    derivative of R(u, f, p) = 0: ``phi.R_f df + phi.R_p dp = 0``. `kind`, `factor` and `point` are
    those of the event; `problem` has the arguments of `LoadRamp.build`, and `parameters` everything
    that the path depends on.
    """
    factor = implicit.with_nan_derivative(factor, parameters)
    if ramp.memory is not None:  # history variables depend on all points before
        return factor
    system = LoadRamp.build(*implicit.first_derivative_only(problem)).system_at(
        point.load_factor, point.memory
    )
    function, numbers, _ = system.local_residual(system.with_support_rotations(point.x))
    work = point.left_phi @ function(lax.stop_gradient(numbers))
    along = point.left_phi @ point.residual_by_factor
    smooth = (kind == LIMIT_POINT) & has_null_vector & (along != 0)
    change = work / jnp.where(smooth, along, 1.0)
    exact = point.load_factor - (change - lax.stop_gradient(change))
    return jnp.where(smooth, exact, factor)
