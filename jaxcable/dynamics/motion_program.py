"""The programs of a motion in time: from prepared arguments to histories.

Steps run in blocks. Outside of `jax.jit` a block of 32 steps is a program, and the loop over blocks
runs on the host: all motions of a structure share this program, whatever their number of steps, and
a long motion goes on compiled where compiling pays. Within a program of the user, the blocks are a
`lax.scan`, as many as a block has steps.

Blocks are checkpointed: of the forward pass a gradient keeps only the state at the start of every
block, and the backward pass computes each block once more.
"""

from __future__ import annotations

import functools
import math

import jax
import jax.numpy as jnp
import numpy as np
from jax import lax

from ..analysis.preparation import complete_input, traced_input_status
from ..common import jax_internals as internals
from ..common import status
from ..common.rules import are_rules_kept, collect_rules
from ..common.tree import copy_with, merge_indices, split_indices
from ..mechanics.load_ramp import LoadRamp
from ..mechanics.restart_state import with_loads_until
from ..numerics import implicit
from ..programs.program_calls import as_program
from .generalized_alpha import to_space_axes
from .march import start_march
from .motion_model import MotionModel, values_at_rows, with_elements_present
from .motion_plan import NODAL_HISTORIES, MotionHistories

BLOCK = 32
"""Steps of a block outside of `jax.jit`. Steps beyond the end of a motion are skipped."""


def compute_motion(
    without_indices, arrays, method, code, data, loads, plan, steps, steps_before_removal
):
    """Compute all steps of a motion in time.

    Args:
        without_indices, arrays, method, code: as in `preparation.PreparedAnalysis`.
        data: `MotionData`.
        loads: `LoadsInTime`.
        plan: `MotionPlan`.
        steps: number of steps.
        steps_before_removal: number of steps before elements are removed; `steps` without removal.

    Returns:
        `MotionHistories`.
    """
    entries = _entries_in_time(loads, without_indices[0], steps=steps)
    first = _entry(entries, np.int32(0))
    begun = _begin_motion(without_indices, arrays, method, code, data, first, plan=plan)
    model, (current, record), touched = begun
    carry, found = _run_steps(model, (current, record), entries, 0, steps_before_removal)
    ranges = [(steps_before_removal, found)]
    if steps_before_removal < steps:
        at = np.int32(steps_before_removal)
        entries = _with_release(entries, data.duration, data.release_duration, at)
        model, current = _remove_elements(model, carry[0], _entry(entries, at))
        carry, found = _run_steps(model, (current, carry[1]), entries, steps_before_removal, steps)
        ranges.append((steps - steps_before_removal, found))
    counts, parts = zip(*ranges, strict=True)
    given = record, list(parts), carry, loads, touched
    return _join_records(*given, counts=counts, bundles=plan.bundles)


@functools.partial(as_program, static=("plan",))
def _begin_motion(without_indices, arrays, method, code, data, entry, plan):
    """Compute the start of a motion, under the loads of its first time, `entry`.

    Returns:
        `MotionModel`, as `_split` returns it; pair of `MarchState` and its record; probe of the
        gradient by all arguments.
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
    touched = implicit.gradient_probe((parameters, data, entry))
    x = ramp.start.motion
    model = MotionModel.build(ramp, data, method, plan, entry, x)
    velocity = values_at_rows(ramp, data.velocity)
    current = start_march(model.system_at(entry, ramp.memory), velocity, model.settings, code, x)
    # all of the state depends on the arguments, so that all blocks share a program of derivatives
    state = {name: getattr(current, name) for name in ("state", "memory", "energy", "forces")}
    state = jax.tree.map(
        lambda x: x + (0.0 * touched).astype(x.dtype) if _is_float(x) else x, state
    )
    current = copy_with(current, **state)
    record = model.make_record(current, entry, jnp.int32(1))
    return _split(model), (current, record), touched


@as_program
def _remove_elements(split_model, current, entry):
    """Remove elements, as `MotionData` has it; `entry` has the loads of this time.

    The forces that they exert, and the loads on them, act on as loads that end over the duration of
    the removal.

    Returns:
        `MotionModel`, as `_split` returns it, and `MarchState` afterwards.
    """
    model = _merge(*split_model)
    data, x = model.data, current.state.motion
    still = {name: value for name, value in entry.items() if name != "released"}
    whole = model.system_at(still, current.memory)
    ramp = with_elements_present(model.ramp, data.remaining)
    # masses and damping of the elements that stay are those of the start
    left = MotionModel.build(ramp, data, model.method, model.plan, entry, ramp.start.motion)
    released = left.system_at(still, current.memory).unbalanced(x) - whole.unbalanced(x)
    left = copy_with(left, released_forces=released)
    velocity = to_space_axes(whole.space, x, current.state.velocity)
    system = left.system_at(entry, current.memory)
    begun = start_march(system, velocity, left.settings, current.code, x)
    energy = current.energy.go_on_from(begun.energy)
    return _split(left), copy_with(begun, energy=energy, memory=current.memory)


def _split(model):
    """Return a `MotionModel` with the indices of its ramp split off, as `split_indices`."""
    ramp, arrays = split_indices(model.ramp)
    return copy_with(model, ramp=ramp), arrays


def _merge(model, arrays):
    """Undo `_split`."""
    return copy_with(model, ramp=merge_indices(model.ramp, arrays))


# --- steps


def _run_steps(split_model, carry, entries, first, last):
    """Run the steps from the time `first` to the time `last`, both indices of times.

    Args:
        split_model: `MotionModel`, as `_split` returns it.
        carry: `MarchState` and its record before the first step.
        entries: loads at all times.

    Returns:
        The same pair after the last step; records of the steps, a list of blocks of arrays
        [n, ...], of which the last may be longer than there are steps.
    """
    count = last - first

    def advance(carry, begin, size):
        live = begin + np.arange(size) < last
        own = _entries_of_block(entries, begin, np.int32(last), size=size)
        return _run_block(split_model, carry, own, live)

    if internals.is_tracing() and count:
        size = math.isqrt(count - 1) + 1  # memory grows with the square root of the steps
        begins = first + size * jnp.arange(-(-count // size))
        carry, found = lax.scan(lambda run, at: advance(run, at, size), carry, begins)
        return carry, [jax.tree.map(lambda x: x.reshape(-1, *x.shape[2:]), found)]
    found = []
    for begin in range(first, last, BLOCK):
        carry, block = advance(carry, np.int32(begin), BLOCK)
        found.append(block)
    return carry, found


@as_program
def _run_block(split_model, carry, entries, live):
    """Run the steps of a block, as far as they are `live`, bool [n].

    `entries` are the loads at the start and after every step, [n + 1, ...]; other arguments and
    results are those of `_run_steps`.
    """
    model = _merge(*split_model)

    def one(carry, entry):
        before, here, alive = entry
        carry = lax.cond(alive, lambda c: model.advance(c[0], before, here), lambda c: c, carry)
        return carry, carry[1]

    @functools.partial(jax.checkpoint, prevent_cse=False)
    def block(carry, entries):
        return lax.scan(one, carry, entries)

    ends = [jax.tree.map(lambda x, part=part: x[part], entries) for part in (_BEFORE, _AFTER)]
    return block(carry, (*ends, live))


_BEFORE, _AFTER = slice(None, -1), slice(1, None)


# --- loads in time, and records


@functools.partial(as_program, static=("steps",))
def _entries_in_time(loads, nodes, steps):
    """Return the loads at all times by kind, a dict of arrays [steps + 1, ...].

    They have the dtype of the `nodes`.
    """
    dtype = jnp.asarray(nodes).dtype
    parameter = jnp.arange(steps + 1, dtype=dtype) / max(steps, 1)
    # at the start loads are those that act from then on
    entries = {"parameter": jnp.maximum(parameter, jnp.finfo(dtype).tiny)}
    given = {"forces": loads.forces, "base": loads.base_acceleration}
    entries |= {name: values for name, values in given.items() if values is not None}
    entries |= {"moving": loads.moving_loads} if loads.moving_loads else {}
    return jax.tree.map(lambda x: jnp.asarray(x, dtype) if _is_float(x) else x, entries)


@as_program
def _entry(entries, at):
    """Return the loads of one time, `at` its index."""
    return jax.tree.map(lambda x: jnp.asarray(x)[at], entries)


@functools.partial(as_program, static=("size",))
def _entries_of_block(entries, begin, last, size):
    """Return the loads of `size` steps from a time on, [size + 1, ...].

    Loads of times after the time `last` are those at this time.
    """
    which = jnp.minimum(begin + jnp.arange(size + 1), last)
    return jax.tree.map(lambda x: jnp.asarray(x)[which], entries)


@as_program
def _with_release(entries, duration, release, first):
    """Add to the loads in time what is left of the forces of elements that are removed.

    It is a share, which begins at 1 at the time with index `first`, and ends after `release`, s;
    `duration` is that of a step, s.
    """
    dtype = entries["parameter"].dtype
    duration, release = (jnp.asarray(x, dtype) for x in (duration, release))
    passed = (jnp.arange(len(entries["parameter"])) - first) * duration
    sudden = release <= 0
    share = jnp.where(sudden, 0.0, 1 - passed / jnp.where(sudden, 1.0, release))
    # nothing is released before the removal; after the duration of the release nothing is left
    share = jnp.where(passed < 0, 0.0, jnp.clip(share, 0.0, 1.0))
    return {**entries, "released": share.astype(dtype)}


@functools.partial(as_program, static=("counts", "bundles"))
def _join_records(first, ranges, last, loads, touched, counts, bundles):
    """Return the `MotionHistories` of the start and of all steps, NaN where a step has failed.

    Args:
        first: record of the start.
        ranges: records of the steps before and after a removal, each a list of blocks.
        last: `MarchState` and record after the last step.
        loads: `LoadsInTime`.
        touched: probe of the gradient by all other arguments of the motion.
        counts: number of steps in each range.
        bundles: which groups are evaluated together.
    """

    def whole(start, *blocks):
        parts = iter(blocks)
        joined = [
            jnp.concatenate([next(parts) for _ in own])[:count]
            for own, count in zip(ranges, counts, strict=True)
            if own
        ]
        return jnp.concatenate([jnp.asarray(start)[None], *joined])

    blocks = [block for own in ranges for block in own]
    codes, parts, histories, energy = jax.tree.map(whole, first, *blocks)
    # nothing depends on the last state: by its zero cotangents the last block is as all others
    touched = touched + implicit.gradient_probe(loads) + 0.0 * implicit.gradient_probe(last)
    ok = codes == status.OK
    histories, energy = implicit.nan_unless_probed(ok, (histories, energy), touched)
    names = {k: v for k, v in histories.items() if k not in NODAL_HISTORIES}
    histories |= {k: bundles.split(v, axis=1) for k, v in names.items()}
    return MotionHistories(codes, parts, histories, energy)


def _is_float(x):
    """Return whether an array or number has a float dtype."""
    return jnp.issubdtype(jnp.result_type(x), jnp.floating)
