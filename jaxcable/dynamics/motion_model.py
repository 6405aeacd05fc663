"""`MotionModel`: the systems of a structure in motion, step by step, and what is recorded."""

from __future__ import annotations

from typing import Any

import jax
import jax.numpy as jnp

from ..common.tree import copy_with, pytree
from ..common.types import Array, ArrayLike, Bool, Float, Int
from ..equilibrium.newton import Newton
from ..mechanics.assembly import System
from ..mechanics.load_ramp import LoadRamp
from ..spaces import space_class
from ..spaces.space import Forces, Motion
from .conserving_system import ConservingSystem
from .damping import Dashpots, ModalDamping, modal_damping_matrix, rayleigh_damping_matrices
from .generalized_alpha import AlphaParameters, TimeStep, to_space_axes
from .inertial_system import Inertia, InertialSystem
from .march import MarchState, StepSettings, advance_one_step
from .masses import element_mass_matrices, mass_times_acceleration, rotary_inertia, sum_at_nodes
from .motion_plan import NODAL_HISTORIES, MotionData, MotionHistories, MotionPlan
from .time_loads import set_moving_loads


@pytree(static=("plan",))
class MotionModel:
    """A structure in motion: makes its system at a time, and records histories.

    Attributes:
        ramp: `LoadRamp`, whose parameter is time over the whole duration.
        data: `MotionData`.
        method: `Newton`.
        inertia: `Inertia` of the elements that are present, without dampers.
        released_forces: forces that removed elements exerted, and the loads on them, before they
            are ramped to zero, [n_row, n_freedom], N and N m; None without removal.
        plan: `MotionPlan`.
    """

    ramp: LoadRamp
    data: MotionData
    method: Newton
    inertia: Inertia
    released_forces: Forces | None
    plan: MotionPlan

    @classmethod
    def build(
        cls,
        ramp: LoadRamp,
        data: MotionData,
        method: Newton,
        plan: MotionPlan,
        entry: dict[str, Any],
        x: Motion,
    ) -> MotionModel:
        """Return the model with masses and damping of the elements that are present.

        `entry` has the loads of one time, `x` is the motion of all rows then.
        """
        bare = ramp.system_at(entry["parameter"], ramp.memory)
        masses = element_mass_matrices(bare, x, data.gravity, plan.distribution)
        nodal = values_at_rows(ramp, data.masses, width=1)[:, 0]
        rotary = rotary_inertia(bare, x, data.gravity)
        damping, nodal_damping = rayleigh_damping_matrices(data.dampings, bare, masses, nodal, x)
        inertia = Inertia(masses, nodal, rotary, damping, nodal_damping, [])
        return cls(ramp, data, method, inertia, None, plan)

    @property
    def settings(self) -> StepSettings:
        """What is the same in all steps, `StepSettings`."""
        parameters = AlphaParameters.from_spectral_radius(self.data.spectral_radius)
        given = self.inertia, parameters, self.data.duration, self.method, self.plan.halvings
        moves_supports = self.ramp.moved is not None
        return StepSettings(*given, self._make_system, moves_supports=moves_supports)

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
            load = load - self._force_of_acceleration(system, base)
        if "released" in entry:
            load = load + entry["released"] * self.released_forces
        return copy_with(system, load=load)

    def _force_of_acceleration(self, system, acceleration):
        """Return mass times the accelerations of all rows, [n_row, 3], as nodal forces, N."""
        masses = self.inertia.masses, self.inertia.nodal_mass
        return mass_times_acceleration(system, masses, acceleration)

    def _make_system(self, system, inertia, step, load_before=None):
        """Make the system of a step, as `InertialSystem.from_system`."""
        # a state alone, without a step to it, has no other forces
        conserves = self.plan.conserves and load_before is not None
        kind = ConservingSystem if conserves else InertialSystem
        own = copy_with(inertia, dampers=self._damper_matrices(system, step))
        return kind.from_system(system, own, step, load_before)

    def _damper_matrices(self, system, step: TimeStep):
        """Return the `DamperMatrices` of dashpots and modal damping, a list.

        Dashpots have their directions at the predicted end of the step.
        """
        count = self.plan.n_node

        def momentum(shape):
            rows = jnp.zeros((len(system.nodes), 3), shape.dtype).at[:count].set(shape)
            if system.dof_map.node_of_row is not None:
                rows = rows[system.dof_map.node_of_row]
            return sum_at_nodes(system, self._force_of_acceleration(system, rows)[:, :3], count)

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

    def advance(
        self, current: MarchState, before: dict[str, Any], entry: dict[str, Any]
    ) -> tuple[MarchState, MotionHistories]:
        """Return the state after one step, and its record, without the axis of time.

        `before` and `entry` have the loads at the start and at the end of the step.
        """
        found, parts = advance_one_step(current, self.system_at, entry, before, self.settings)
        return found, self.make_record(found, entry, parts)

    def make_record(
        self, current: MarchState, entry: dict[str, Any], parts: Int[Array, ""]
    ) -> MotionHistories:
        """Return the record of one time, `MotionHistories` without the axis of time."""
        plan, state, settings = self.plan, current.state, self.settings
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
