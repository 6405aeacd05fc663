"""The compiled core of a motion in time: from prepared arguments to histories."""

from __future__ import annotations

import functools

import jax
import jax.numpy as jnp

from ..analysis.preparation import complete_input, traced_input_status
from ..common import status
from ..common.rules import are_rules_kept, collect_rules
from ..common.tree import copy_with, merge_indices
from ..mechanics.load_ramp import LoadRamp
from ..mechanics.restart_state import with_loads_until
from ..numerics import implicit
from ..programs.program_calls import as_program
from .generalized_alpha import to_space_axes
from .march import start_march
from .motion_model import MotionModel, values_at_rows, with_elements_present
from .motion_plan import NODAL_HISTORIES, MotionHistories


@functools.partial(as_program, static=("plan",))
def compute_motion(without_indices, arrays, method, code, data, plan):
    """Compute all steps of a motion in time as one program.

    Args:
        without_indices, arrays, method, code: as in `preparation.PreparedAnalysis`.
        data: `MotionData`.
        plan: `MotionPlan`.

    Returns:
        `MotionHistories`.
    """
    parameters = merge_indices(without_indices, arrays)
    structure_ok, codes = traced_input_status(parameters, method, data.dampings)
    nodes, groups, restart, schedule = complete_input(parameters, plan.bundles)
    data = jax.tree.map(lambda x: jnp.asarray(x, nodes.dtype) if _is_float(x) else x, data)
    sound = structure_ok & are_rules_kept(collect_rules(data.dampings))
    code = status.first_failure(code, jnp.where(sound, codes[0], status.INVALID_INPUT))
    phase = schedule.phase(0)
    before = with_loads_until(restart, restart.loads, phase.number)
    ramp = LoadRamp.build(nodes, groups, before, phase)
    if data.remaining is not None:
        ramp = with_elements_present(ramp, [jnp.ones(len(g.links), bool) for g in groups])
    touched = implicit.gradient_probe((parameters, data))
    entries = _load_histories(ramp, data, plan)
    model = MotionModel(ramp, data, plan, method)
    x = ramp.start.motion
    first = jax.tree.map(lambda a: a[0], entries)
    settings = model.time_step_settings(first, x)
    current = start_march(
        model.system_at(first, ramp.memory), values_at_rows(ramp, data.velocity), settings, code, x
    )
    found = [_with_time_axis(model.make_record(current, first, settings, jnp.int32(1)))]
    current, part = model.run(current, entries, settings, 0, plan.steps_before_removal)
    found.append(part)
    if plan.steps_before_removal < plan.steps:
        current, part = _run_after_removal(model, current, entries, plan)
        found.append(part)
    whole = jax.tree.map(lambda *parts: jnp.concatenate(parts), *found)
    codes, parts, histories, energy = whole
    ok = codes == status.OK
    histories, energy = implicit.nan_unless_probed(ok, (histories, energy), touched)
    names = {k: v for k, v in histories.items() if k not in NODAL_HISTORIES}
    histories |= {k: plan.bundles.split(v, axis=1) for k, v in names.items()}
    return MotionHistories(codes, parts, histories, energy)


def _run_after_removal(model, current, entries, plan):
    """Return the last `MarchState` and the histories of the steps after the removal.

    The forces that the removed elements exert, and the loads on them, act on as loads that end over
    the duration of the removal.
    """
    data, first = model.data, plan.steps_before_removal
    at = jax.tree.map(lambda a: a[first], entries)
    whole, x = model.system_at(at, current.memory), current.state.motion
    left = MotionModel(with_elements_present(model.ramp, data.remaining), data, plan, model.method)
    settings = left.time_step_settings(at, x)
    left.released_forces = left.system_at(at, current.memory).unbalanced(x) - whole.unbalanced(x)
    passed = jnp.arange(plan.steps + 1 - first) * data.duration
    sudden = data.release_duration <= 0
    share = jnp.where(sudden, 0.0, 1 - passed / jnp.where(sudden, 1.0, data.release_duration))
    # nothing is released before the removal; after the duration of the release nothing is left
    share = jnp.concatenate([jnp.zeros(first, share.dtype), jnp.clip(share, 0.0, 1.0)])
    entries = {**entries, "released": share}
    at = jax.tree.map(lambda a: a[first], entries)
    velocity = to_space_axes(whole.space, x, current.state.velocity)
    begun = start_march(left.system_at(at, current.memory), velocity, settings, current.code, x)
    energy = current.energy.go_on_from(begun.energy)
    begun = copy_with(begun, energy=energy, memory=current.memory)
    return left.run(begun, entries, settings, first, plan.steps - first)


def _load_histories(ramp, data, plan):
    """Return the loads at all times by kind, a dict of arrays [steps + 1, ...]."""
    dtype = ramp.nodes.dtype
    parameter = jnp.arange(plan.steps + 1, dtype=dtype) / max(plan.steps, 1)
    # at the start loads are those that act from then on
    entries = {"parameter": jnp.maximum(parameter, jnp.finfo(dtype).tiny)}
    entries |= {} if data.forces is None else {"forces": data.forces}
    entries |= {"moving": data.moving_loads} if data.moving_loads else {}
    return entries | ({} if data.base_acceleration is None else {"base": data.base_acceleration})


def _with_time_axis(record):
    """Return a record of one time with a leading axis of time, arrays [1, ...]."""
    return jax.tree.map(lambda x: jnp.asarray(x)[None], record)


def _is_float(x):
    """Return whether an array or number has a float dtype."""
    return jnp.issubdtype(jnp.result_type(x), jnp.floating)
