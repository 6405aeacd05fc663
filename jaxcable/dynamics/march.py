"""A step of a motion in time, and the state between two steps.

A step is iterated to balance by the solvers of equilibrium. If it fails, it may be halved.
"""

from __future__ import annotations

import functools
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
from ..spaces.translations import drop_low_part
from .energy_balance import EnergyBalance
from .generalized_alpha import AlphaParameters, MotionState, TimeStep, to_body_axes
from .inertial_system import Inertia, InertialSystem, initial_acceleration_and_load

# largest displacement from the start of a step to the start of its iteration, in mean lengths of
# elements
_MAX_PREDICTED_DISPLACEMENT = 0.1

SystemAt: TypeAlias = Callable[[Any, "Memory | None"], System]
"""Function from the entry of a time in the histories of loads, and history variables, to a system
without inertia."""


@pytree
class MarchState:
    """State of time marching between two steps.

    Attributes:
        state: `MotionState`.
        memory: history variables of the elements, per group; None without any.
        energy: `EnergyBalance` so far.
        forces: loads and damping forces on all rows, a pair of [n_row, n_freedom], N and N m.
        code: status so far: OK, or that of the first step that failed.
        factored: matrix that a sparse solver factorised last, to start the next step from.
    """

    state: MotionState
    memory: Memory | None
    energy: EnergyBalance
    forces: tuple[Forces, Forces]
    code: Int[Array, ""]
    factored: FactorRecord | None


class StepSettings(NamedTuple):
    """Data that are the same in all steps in time.

    Attributes:
        inertia: `Inertia`.
        parameters: `AlphaParameters`.
        duration: duration of a step, s.
        method: `Newton`.
        halvings: how often a step that fails may be halved.
        make_system: function that makes the system of a step, as `InertialSystem.from_system`.
        moves_supports: whether supports move, so that their reactions do work.
    """

    inertia: Inertia
    parameters: AlphaParameters
    duration: Float[Array, ""]
    method: Newton
    halvings: int
    make_system: Callable[..., InertialSystem]
    moves_supports: bool


def start_march(
    system: System, velocity: Forces, settings: StepSettings, code: Int[Array, ""], x: Any
) -> MarchState:
    """Return the state at the start of a motion, with the accelerations that balance its forces.

    Args:
        system: the system at the start, under the loads that act from then on.
        velocity: velocities of all rows, along x, y, z, [n_row, n_freedom].
        settings: `StepSettings`.
        code: status so far.
        x: motion of all rows.
    """
    zero = jnp.zeros_like(velocity)
    at_rest = MotionState(x, to_body_axes(system.space, x, velocity), zero, zero)
    step = TimeStep(at_rest, jnp.ones((), x.dtype), settings.parameters)
    own = settings.make_system(system, settings.inertia, step)
    found, load = initial_acceleration_and_load(system, own, at_rest)
    acceleration = to_body_axes(system.space, x, found)
    state = copy_with(at_rest, acceleration=acceleration, auxiliary_acceleration=acceleration)
    forces = load, own.damping_force(state)
    memory = [s.memory for s in system.states] if system.has_memory else None
    energy = EnergyBalance.initial(own, state)
    factored = linear.no_factored_matrix(system.dof_map.pattern, x.dtype)
    return MarchState(state, memory, energy, forces, code, factored)


def advance_one_step(
    current: MarchState, system_at: SystemAt, entry: Any, before: Any, settings: StepSettings
) -> tuple[MarchState, Int[Array, ""]]:
    """Return the state after one step, and the number of parts into which it was divided.

    A step that fails is halved up to `StepSettings.halvings` times, which gives 2, 4, 8 ...
    parts; loads at the ends of parts are interpolated.

    Args:
        current: `MarchState` before the step.
        system_at: `SystemAt`.
        entry, before: loads at the end and at the start of the step, entries of their
            histories.
        settings: `StepSettings`.
    """
    whole = _advance_undivided(current, system_at, entry, settings, settings.duration)
    if not settings.halvings:
        return whole, jnp.int32(1)

    def part(run, number, parts):
        at = number.astype(settings.duration.dtype) / parts
        between = jax.tree.map(lambda a, b: (1 - at) * a + at * b, before, entry)
        stepped = _advance_undivided(run, system_at, between, settings, settings.duration / parts)
        return select_tree(number <= parts, stepped, run)

    most = 2**settings.halvings

    def halve(found, parts):
        def again(_):
            def one(run, number):
                skip = (number > parts) | (run.code != status.OK)
                return lax.cond(skip, lambda r: r, lambda r: part(r, number, parts), run), None

            return lax.scan(one, current, jnp.arange(1, most + 1))[0], parts

        failed = (found[0].code != status.OK) & (current.code == status.OK)
        return lax.cond(failed, again, lambda f: f, found), None

    sizes = jnp.asarray([2**k for k in range(1, settings.halvings + 1)], jnp.int32)
    return lax.scan(halve, (whole, jnp.int32(1)), sizes)[0]


def _advance_undivided(current, system_at, entry, settings, duration):
    """Return the state after an undivided step of `duration`, s; `entry` has the loads at its end.

    The iteration is outside of the checkpoint: a backward pass has the motion that it has found.
    """

    def systems(current, entry):
        bare = system_at(entry, current.memory)
        step = TimeStep(current.state, duration, settings.parameters)
        return bare, settings.make_system(bare, settings.inertia, step, current.forces[0])

    method, active = settings.method, current.code == status.OK
    _, frozen = lax.stop_gradient(systems(*lax.stop_gradient((current, entry))))
    farthest = _MAX_PREDICTED_DISPLACEMENT * frozen.length_scale()
    guess = frozen.impose_supports(frozen.step.predicted_motion(frozen.space, farthest))
    guess = frozen.with_zero_low_order_part(guess)
    outcome, factored = equilibrate(frozen, guess, method, active, current.factored)
    known = outcome.x, outcome.equilibrated, lax.stop_gradient(factored)

    @functools.partial(jax.checkpoint, prevent_cse=False)
    def finish(current, entry, known):
        (bare, system), (x, ok, factored) = systems(current, entry), known
        given = factored, *adjoint_cg_settings(method, system, x.dtype)
        sound = implicit.stop_gradient_unless(ok, system)
        x = implicit.attach_derivative_with_marks(sound, x, ok, *given)[0]
        end = system.step.end_state(system.space, x)
        x = drop_low_part(x)  # rates have the digits of the displacement in the step
        end = copy_with(end, motion=x)
        load = bare.external_force(x)
        if settings.moves_supports:
            resisting = bare.unbalanced(x) + system.inertia_force(end) + system.damping_force(end)
            load = load + system.space.reactions(resisting, x)
        forces = load, system.damping_force(end)
        ends = current.state, end
        memory, settled = current.memory, bare
        if memory is not None:
            memory = bare.commit_memory(x, duration=duration)
            settled = system_at(entry, memory)  # what a step dissipates is stored no more
        stored = settled.stored_energy(x)
        energy = current.energy.after_step(system, ends, current.forces, forces, stored)
        after = MarchState(end, memory, energy, forces, current.code, current.factored)
        return select_tree(ok, after, current)

    code = status.first_failure(current.code, outcome.code)
    return copy_with(finish(current, entry, known), code=code, factored=factored)
