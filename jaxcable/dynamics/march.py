"""The steps of a motion in time, one after the other, in a `lax.scan` of checkpointed blocks.

A block has about as many steps as there are blocks, so that the memory of a gradient grows with the
square root of the number of steps: of the forward pass only the state at the start of every block
is kept, and the backward pass solves each block once more.
"""

from __future__ import annotations

import functools
import math
from collections.abc import Callable
from typing import Any, NamedTuple, TypeAlias

import jax
import jax.numpy as jnp
from jax import lax

from .. import linear
from ..common import status
from ..common.tree import copy_with, pytree, select_tree
from ..common.types import Array, Float, Int
from ..equilibrium.newton import Newton, adjoint_cg_settings, equilibrate
from ..linear.sparse import FactorRecord
from ..mechanics.assembly import System
from ..mechanics.elementwise import Memory
from ..numerics import implicit
from ..spaces.space import Forces
from .energy_balance import EnergyBalance
from .generalized_alpha import AlphaNumbers, MotionState, TimeStep, to_body_axes
from .inertial_system import Inertia, InertialSystem, initial_acceleration

# largest displacement from the start of a step to the start of its iteration, in mean lengths of
# elements
_FARTHEST = 0.1

SystemAt: TypeAlias = Callable[[Any, "Memory | None"], System]
"""Function from the entry of a time in the histories of loads, and history variables, to a system
without inertia."""


@pytree
class Running:
    """What a step in time hands to the next one.

    Attributes:
        state: `MotionState`.
        memory: history variables of the elements, per group; None without any.
        energy: `EnergyBalance` so far.
        forces: loads, and forces of dampers, on all rows, N and N m.
        code: status so far.
        factored: last matrix that a sparse solve has factorised.
    """

    state: MotionState
    memory: Memory | None
    energy: EnergyBalance
    forces: tuple[Forces, Forces]
    code: Int[Array, ""]
    factored: FactorRecord | None


class StepSettings(NamedTuple):
    """What is the same in all steps.

    Attributes:
        inertia: `Inertia`.
        numbers: `AlphaNumbers`.
        duration: duration of a step, s.
        method: `Newton`.
        halvings: how often a step that fails may be halved.
        make_system: function that makes the system of a step, as `InertialSystem.from_system`.
        moves_supports: whether supports move, so that their reactions do work.
    """

    inertia: Inertia
    numbers: AlphaNumbers
    duration: Float[Array, ""]
    method: Newton
    halvings: int
    make_system: Callable[..., InertialSystem]
    moves_supports: bool


def begin_motion(
    system: System, velocity: Forces, settings: StepSettings, code: Int[Array, ""], x: Any
) -> Running:
    """Return the state at the start, whose accelerations balance the forces there.

    Args:
        system: the system at the start, under the loads that act from then on.
        velocity: velocities of all rows, along x, y, z, [n_row, n_freedom].
        settings: `StepSettings`.
        code: status so far.
        x: motion of all rows.
    """
    zero = jnp.zeros_like(velocity)
    at_rest = MotionState(x, to_body_axes(system.space, x, velocity), zero, zero)
    step = TimeStep(at_rest, jnp.ones((), x.dtype), settings.numbers)
    own = settings.make_system(system, settings.inertia, step)
    found, load = initial_acceleration(system, own, at_rest)
    acceleration = to_body_axes(system.space, x, found)
    state = copy_with(at_rest, acceleration=acceleration, lagging=acceleration)
    forces = load, own.damping_force(state)
    memory = [s.memory for s in system.states] if system.has_memory else None
    energy = EnergyBalance.initial(own, state)
    factored = linear.no_factored_matrix(system.dof_map.pattern, x.dtype)
    return Running(state, memory, energy, forces, code, factored)


def advance(
    running: Running, system_at: SystemAt, here: Any, before: Any, settings: StepSettings
) -> tuple[Running, Int[Array, ""]]:
    """Return the state after a step, and the number of parts into which it was divided.

    A step that fails is divided in two, these again and so on, `StepSettings.halvings` times; the
    loads in it are then interpolated.

    Args:
        running: `Running` before it.
        system_at: `SystemAt`.
        here, before: entries of the histories of loads at both ends of the step.
        settings: `StepSettings`.
    """
    whole = _advance_once(running, system_at, here, settings, settings.duration)
    if not settings.halvings:
        return whole, jnp.int32(1)

    def part(run, number, parts):
        at = number.astype(settings.duration.dtype) / parts
        entry = jax.tree.map(lambda a, b: (1 - at) * a + at * b, before, here)
        stepped = _advance_once(run, system_at, entry, settings, settings.duration / parts)
        return select_tree(number <= parts, stepped, run)

    most = 2**settings.halvings

    def halve(found, parts):
        def again(_):
            def one(run, number):
                skip = (number > parts) | (run.code != status.OK)
                return lax.cond(skip, lambda r: r, lambda r: part(r, number, parts), run), None

            return lax.scan(one, running, jnp.arange(1, most + 1))[0], parts

        failed = (found[0].code != status.OK) & (running.code == status.OK)
        return lax.cond(failed, again, lambda f: f, found), None

    sizes = jnp.asarray([2**k for k in range(1, settings.halvings + 1)], jnp.int32)
    return lax.scan(halve, (whole, jnp.int32(1)), sizes)[0]


def _advance_once(running, system_at, here, settings, duration):
    """Return `Running` after a step of a `duration`, s, at whose end the loads are those `here`.

    The iteration is outside of the checkpoint: a backward pass has the motion that it has found.
    """

    def systems(running, here):
        bare = system_at(here, running.memory)
        step = TimeStep(running.state, duration, settings.numbers)
        return bare, settings.make_system(bare, settings.inertia, step, running.forces[0])

    method, active = settings.method, running.code == status.OK
    _, frozen = lax.stop_gradient(systems(*lax.stop_gradient((running, here))))
    farthest = _FARTHEST * frozen.length_scale()
    guess = frozen.impose_supports(frozen.step.predicted_motion(frozen.space, farthest))
    outcome, factored = equilibrate(frozen, guess, method, active, running.factored)
    known = outcome.x, outcome.equilibrated, lax.stop_gradient(factored)

    @functools.partial(jax.checkpoint, prevent_cse=False)
    def finish(running, here, known):
        (bare, system), (x, ok, factored) = systems(running, here), known
        given = factored, *adjoint_cg_settings(method, system, x.dtype)
        sound = implicit.stop_gradient_unless(ok, system)
        x = implicit.attach_derivative_with_marks(sound, x, ok, *given)[0]
        end = system.step.end_state(system.space, x)
        load = bare.external_force(x)
        if settings.moves_supports:
            resisting = bare.unbalanced(x) + system.inertia_force(end) + system.damping_force(end)
            load = load + system.space.reactions(resisting, x)
        forces = load, system.damping_force(end)
        ends = running.state, end
        memory, settled = running.memory, bare
        if memory is not None:
            memory = bare.commit_memory(x, duration=duration)
            settled = system_at(here, memory)  # what a step dissipates is stored no more
        stored = settled.stored_energy(x)
        energy = running.energy.after_step(system, ends, running.forces, forces, stored)
        after = Running(end, memory, energy, forces, running.code, running.factored)
        return select_tree(ok, after, running)

    code = status.first_failure(running.code, outcome.code)
    return copy_with(finish(running, here, known), code=code, factored=factored)


def run_steps(
    running: Running,
    advance_step: Callable[[Running, Any], tuple[Running, Any]],
    entries: Any,
    count: int,
) -> tuple[Running, Any]:
    """Run `count` steps: return the state after them, and what they give, stacked.

    Args:
        running: `Running`.
        advance_step: function from it and an entry of `entries` to the next one and results.
        entries: pytree of arrays [count, ...].
        count: number of steps.
    """
    size = max(1, math.isqrt(count - 1) + 1) if count else 1
    blocks = -(-count // size)
    padded = blocks * size

    def fill(x):
        more = jnp.broadcast_to(x[-1:], (padded - count, *x.shape[1:]))
        return jnp.concatenate([x, more]).reshape(blocks, size, *x.shape[1:])

    entries = jax.tree.map(fill, entries)
    live = (jnp.arange(padded) < count).reshape(blocks, size)

    def one(run, entry):
        own, alive = entry
        shapes = jax.eval_shape(advance_step, run, own)[1]
        nothing = jax.tree.map(lambda s: jnp.zeros(s.shape, s.dtype), shapes)
        return lax.cond(alive, advance_step, lambda run, _: (run, nothing), run, own)

    @functools.partial(jax.checkpoint, prevent_cse=False)
    def block(run, entries):
        return lax.scan(one, run, entries)

    running, found = lax.scan(block, running, (entries, live))
    return running, jax.tree.map(lambda x: x.reshape(padded, *x.shape[2:])[:count], found)
