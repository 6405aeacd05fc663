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
from .march import begin_motion
from .motion_model import MotionModel, row_values, with_presence
from .motion_plan import NODAL_HISTORIES, MotionHistories


@functools.partial(as_program, static=("plan",))
def compute_motion(without_indices, arrays, method, code, data, plan):
    """Compute a motion in time as one program.

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
    if data.stays is not None:
        ramp = with_presence(ramp, [jnp.ones(len(g.links), bool) for g in groups])
    touched = implicit.gradient_probe((parameters, data))
    entries = _load_entries(ramp, data, plan)
    model = MotionModel(ramp, data, plan, method)
    x = ramp.start.motion
    first = jax.tree.map(lambda a: a[0], entries)
    settings = model.settings(first, x)
    running = begin_motion(
        model.system_at(first, ramp.memory), row_values(ramp, data.velocity), settings, code, x
    )
    found = [_at_start(model.record(running, first, settings, jnp.int32(1)))]
    running, part = model.run(running, entries, settings, 0, plan.first)
    found.append(part)
    if plan.first < plan.steps:
        running, part = _go_on_after_removal(model, running, entries, plan)
        found.append(part)
    whole = jax.tree.map(lambda *parts: jnp.concatenate(parts), *found)
    codes, parts, histories, energy = whole
    ok = codes == status.OK
    histories, energy = implicit.nan_unless_probed(ok, (histories, energy), touched)
    names = {k: v for k, v in histories.items() if k not in NODAL_HISTORIES}
    histories |= {k: plan.bundles.split(v, axis=1) for k, v in names.items()}
    return MotionHistories(codes, parts, histories, energy)


def _go_on_after_removal(model, running, entries, plan):
    """Return `Running` and histories of the steps after elements have been removed.

    The forces that the removed elements exert, and the loads on them, act on as loads that end over
    the duration of the removal.
    """
    data, at = model.data, jax.tree.map(lambda a: a[plan.first], entries)
    whole, x = model.system_at(at, running.memory), running.state.motion
    left = MotionModel(with_presence(model.ramp, data.stays), data, plan, model.method)
    settings = left.settings(at, x)
    left.released = left.system_at(at, running.memory).unbalanced(x) - whole.unbalanced(x)
    passed = jnp.arange(plan.steps + 1 - plan.first) * data.duration
    sudden = data.release <= 0
    share = jnp.where(sudden, 0.0, 1 - passed / jnp.where(sudden, 1.0, data.release))
    share = jnp.concatenate([jnp.zeros(plan.first, share.dtype), jnp.clip(share, 0.0, 1.0)])
    entries = {**entries, "released": share}
    at = jax.tree.map(lambda a: a[plan.first], entries)
    space = whole.space
    velocity = to_space_axes(space, x, running.state.velocity)
    begun = begin_motion(left.system_at(at, running.memory), velocity, settings, running.code, x)
    energy = running.energy.go_on_from(begun.energy)
    begun = copy_with(begun, energy=energy, memory=running.memory)
    return left.run(begun, entries, settings, plan.first, plan.steps - plan.first)


def _load_entries(ramp, data, plan):
    """Return the histories of loads, a dict of arrays [steps + 1, ...]."""
    dtype = ramp.nodes.dtype
    parameter = jnp.arange(plan.steps + 1, dtype=dtype) / max(plan.steps, 1)
    # at the start loads are those that act from then on
    entries = {"parameter": jnp.maximum(parameter, jnp.finfo(dtype).tiny)}
    entries |= {} if data.forces is None else {"forces": data.forces}
    entries |= {"moving": data.moving} if data.moving else {}
    return entries | ({} if data.base is None else {"base": data.base})


def _at_start(record):
    """Return what is kept of the start with an axis of time, [1, ...]."""
    return jax.tree.map(lambda x: jnp.asarray(x)[None], record)


def _is_float(x):
    """Return whether a leaf of numbers is a float."""
    return jnp.issubdtype(jnp.result_type(x), jnp.floating)
