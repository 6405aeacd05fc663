"""`MotionModel`: the systems of a structure in motion, step by step, and what is recorded."""

from __future__ import annotations

from typing import Any

import jax
import jax.numpy as jnp

from ..common.tree import copy_with
from ..common.types import Array, ArrayLike, Bool, Float, Int
from ..mechanics.assembly import System
from ..mechanics.load_ramp import LoadRamp
from ..spaces import space_class
from .conserving_system import ConservingSystem
from .damping import Dashpots, ModalDamping, modal_damping_matrix, rayleigh_damping_matrices
from .generalized_alpha import AlphaParameters, TimeStep, to_space_axes
from .inertial_system import Inertia, InertialSystem
from .march import MarchState, StepSettings, advance_one_step, run_steps
from .masses import element_mass_matrices, mass_times_acceleration, rotary_inertia, sum_at_nodes
from .motion_plan import NODAL_HISTORIES, MotionHistories
from .time_loads import set_moving_loads


class MotionModel:
    """A structure in motion: makes its system at a time, runs the steps, and records histories.

    Args:
        ramp: `LoadRamp`, whose parameter is time over the whole duration.
        data: `MotionData`.
        plan: `MotionPlan`.
        method: `Newton`.

    Attributes:
        released_forces: forces that removed elements exerted, and the loads on them, before they
            are ramped to zero, [n_row, n_freedom], N and N m; None without removal.
    """

    def __init__(self, ramp, data, plan, method):
        self.ramp, self.data, self.plan, self.method = ramp, data, plan, method
        self.released_forces = self.masses = None

    def system_at(self, entry: dict[str, Any], memory: Any) -> System:
        """Return the `System` without inertia under the loads of one time, `entry`.

        `memory` has the history variables of the elements, or None.
        """
        ramp = self.ramp
        if "moving" in entry:
            loads = set_moving_loads(ramp.start.loads, self.plan.moving_loads, entry["moving"])
            ramp = copy_with(ramp, start=copy_with(ramp.start, loads=loads))
        system = ramp.system_at(entry["parameter"], memory)
        load = system.load
        if "forces" in entry:
            load = load + values_at_rows(self.ramp, entry["forces"])
        if "base" in entry:
            base = jnp.broadcast_to(entry["base"], (len(system.nodes), 3))
            load = load - mass_times_acceleration(system, self.masses, base)
        if "released" in entry:
            load = load + entry["released"] * self.released_forces
        return copy_with(system, load=load)

    def time_step_settings(self, entry: dict[str, Any], x: Any) -> StepSettings:
        """Return the `StepSettings`, with masses and damping of the elements that are present.

        `entry` has the loads of one time, `x` is the motion of all rows then; also sets `masses`.
        """
        bare = self.ramp.system_at(entry["parameter"], self.ramp.memory)
        data, gravity = self.data, self.data.gravity
        masses = element_mass_matrices(bare, x, gravity, self.plan.distribution)
        nodal = values_at_rows(self.ramp, self.data.masses, width=1)[:, 0]
        self.masses = masses, nodal
        rotary = rotary_inertia(bare, x, gravity)
        damping, nodal_damping = rayleigh_damping_matrices(data.dampings, bare, masses, nodal, x)
        inertia = Inertia(masses, nodal, rotary, damping, nodal_damping, [])

        def momentum(shape):
            rows = jnp.zeros((len(bare.nodes), 3), x.dtype).at[: self.plan.n_node].set(shape)
            if bare.dof_map.node_of_row is not None:
                rows = rows[bare.dof_map.node_of_row]
            force = mass_times_acceleration(bare, self.masses, rows)[:, :3]
            return sum_at_nodes(bare, force, self.plan.n_node)

        def make_system(system, inertia, step, load_before=None):
            # a state alone, without a step to it, has no other forces
            conserves = self.plan.conserves and load_before is not None
            kind = ConservingSystem if conserves else InertialSystem
            dampers = self._damper_matrices(system, step, momentum)
            own = copy_with(inertia, dampers=dampers)
            return kind.from_system(system, own, step, load_before)

        parameters = AlphaParameters.from_spectral_radius(self.data.spectral_radius)
        method, halvings = self.method, self.plan.halvings
        given = inertia, parameters, self.data.duration, method, halvings, make_system
        return StepSettings(*given, moves_supports=self.ramp.moved is not None)

    def _damper_matrices(self, system, step: TimeStep, momentum):
        """Return the `DamperMatrices` of dashpots and modal damping, a list.

        Dashpots have their directions at the predicted end of the step.
        """
        found: list[Any] = []
        motion: Any = None
        for one in self.data.dampings:
            if isinstance(one, Dashpots):
                if motion is None and not one.is_grounded:
                    motion = step.predicted_motion(system.space, jnp.asarray(jnp.inf))
                found.append(one.matrices(system.nodes, motion))
            elif isinstance(one, ModalDamping):
                found.append(modal_damping_matrix(one, jax.vmap(momentum)(one.shapes)))
        return found

    def run(
        self, current: MarchState, entries: dict[str, Any], settings: StepSettings, at: int, n: int
    ) -> tuple[MarchState, MotionHistories]:
        """Run `n` steps from step `at` on: return the last `MarchState`, and histories."""

        def one(run, entry):
            before, here = entry
            after, parts = advance_one_step(run, self.system_at, here, before, settings)
            return after, self.make_record(after, here, settings, parts)

        ends = [jax.tree.map(lambda a, k=k: a[at + k : at + k + n], entries) for k in (0, 1)]
        return run_steps(current, one, tuple(ends), n)

    def make_record(
        self, current: MarchState, entry: Any, settings: StepSettings, parts: Int[Array, ""]
    ) -> MotionHistories:
        """Return the record of one time, `MotionHistories` without the axis of time."""
        plan, state = self.plan, current.state
        x, count = state.motion, plan.n_node
        space: Any = space_class(self.ramp.groups)
        velocity, acceleration = (
            to_space_axes(space, x, rates) for rates in (state.velocity, state.acceleration)
        )
        found: dict[str, Any] = {}
        values = {"displacement": x[:, :3], "velocity": velocity, "acceleration": acceleration}
        values["rotation"] = space.rotations(x)
        which = slice(count) if plan.nodes is None else plan.nodes.array
        wanted = [name for name in plan.histories if name not in NODAL_HISTORIES]
        if wanted or "reactions" in plan.histories:
            system = self.system_at(entry, current.memory)
            output = system.results_by_name(x, *wanted, "end_forces")
            if "reactions" in plan.histories:
                step = TimeStep(state, settings.duration, settings.parameters)
                own = settings.make_system(system, settings.inertia, step)
                force = own.inertia_force(state) + own.damping_force(state)
                bare = system.unbalanced(x, output["end_forces"]) + force
                values["reactions"] = sum_at_nodes(system, system.space.reactions(bare, x), count)
            found = {name: output[name] for name in wanted}
        found |= {n: values[n][which] for n in plan.histories if n in values}
        return MotionHistories(current.code, parts, found, current.energy)


def values_at_rows(
    ramp: LoadRamp, values: Float[ArrayLike, "n_node ..."] | None, width: int | None = None
) -> Float[Array, "n_row n"]:
    """Return values of nodes, [n_node, n] or [n_node], as an array of all rows, [n_row, width].

    It is zero in rows that are no nodes, in columns beyond n, and for None. The default `width` is
    the number of degrees of freedom of a node.
    """
    n_row, width = len(ramp.nodes), ramp.start.nodal_load.shape[1] if width is None else width
    found = jnp.zeros((n_row, width), ramp.nodes.dtype)
    if values is None:
        return found
    values = values.reshape(len(values), -1)
    return found.at[: len(values), : values.shape[1]].set(values)


def with_elements_present(ramp: LoadRamp, present: list[Bool[Array, " n_elem"]]) -> LoadRamp:
    """Return the `LoadRamp` with only those elements active that are `present`, too.

    `present` has booleans per group, [n_elem].
    """
    groups, start = ramp.groups, ramp.start
    there = [
        own if state.present is None else own & state.present
        for state, own in zip(start.states, present, strict=True)
    ]
    triples = zip(groups, start.states, there, strict=True)
    states = [group.with_activation(state, own) for group, state, own in triples]
    return copy_with(ramp, start=copy_with(start, states=states))
