"""A phase as a function of its load factor: the system that has to be in equilibrium.

The parameter is the load factor, from 0 to 1. Prestress and loads are proportional to it, except
loads with an amplitude (`loads.varying`).

The phase begins with the restart state of earlier phases (`restart_state.RestartState`) and adds
its own data (`PhaseData`), both with index arrays in place of topology. `LoadRamp.build` converts
what the phase states of elements (pretension, temperature, ...) into start and end states once;
`LoadRamp.system_at` interpolates.
"""

from __future__ import annotations

from typing import Any

import jax
import jax.numpy as jnp
from jax import lax

from ..common.tree import copy_with, pytree, select_tree
from ..common.types import Array, ArrayLike, Bool, Float, Int
from ..elements.abilities import accepted_inputs, interpolate
from ..elements.element import Element
from ..elements.element_state import ElementState, with_fields
from ..elements.phase_input import InputValues
from ..loads.varying import Amplitude
from ..spaces import space_class
from ..spaces.dof_map import DofMap, to_global, to_local
from ..spaces.space import Motion
from . import activation
from .assembly import System
from .elementwise import Memory, PerGroup, evaluate_elements
from .restart_state import RestartState, make_system, state_under_load


@pytree
class NodalIncrement:
    """Loads on nodes, or movements of supports, that a phase adds.

    Attributes:
        values: their sum, [n_row, 3 or 6], N and N m, or m and rad. With an amplitude
            [m, n_row, 3 or 6]: the sum of those that are proportional to the load factor, then each
            of the others.
        amplitude: amplitudes of these m arrays; None if all are proportional to the load factor.
    """

    values: Float[ArrayLike, "... n_row n_freedom"]
    amplitude: Amplitude | None = None

    def added_at(self, parameter: Float[ArrayLike, ""]) -> Float[Array, "n_row n_freedom"]:
        """Return the loads or movements that the phase has added at a load factor (`parameter`).

        They are [n_row, 3 or 6], in the units of `values`.
        """
        if self.amplitude is None:
            return parameter * self.values
        return jnp.sum(self.amplitude.factor_at(parameter)[:, None, None] * self.values, axis=0)


@pytree
class PhaseData:
    """Data of a phase as arrays, prepared on the host.

    Attributes:
        number: index of the phase.
        inputs: what it states of elements, such as pretension: for every group a dict from name
            to `InputValues`.
        added_load: nodal loads that it adds, or None.
        moved: movements of supports in it, or None.
        dof_map: map of the degrees of freedom, with the supports of this phase. (In a `Schedule`
            the fields of it that change, by name; so of the next one.)
        dof_map_before: the same with the supports of the phase before, if supports change in any
            phase, else None.
        present: active elements of this phase, per group; None if all are active in all phases.
        attached: whether newly activated nodes move rigidly with active ones, see
            `activation.apply_activation`; None if this is so in no phase.
    """

    number: Int[ArrayLike, ""]
    inputs: list[dict[str, InputValues]]
    added_load: NodalIncrement | None
    moved: NodalIncrement | None
    dof_map: DofMap
    dof_map_before: DofMap | None
    present: activation.Present | None = None
    attached: Bool[ArrayLike, ""] | None = None


@pytree
class LoadRamp:
    """A phase (load step) as a function of its load factor from 0 to 1.

    Attributes:
        nodes, groups: the structure.
        start: `RestartState` at the start of the phase (without loads on newly supported freedoms).
        end_states: element states at the end; None for a group that does not change.
        jacks: (force at the start, `InputValues` at the end) for a jacked group, else None.
        added_load: nodal loads that this phase adds, or None.
        added: which loads of every stack in `start` this phase adds, list of [m] bool.
        moved: movements of the supports in this phase, or None.
        released: reactions of released supports and unbalanced forces of (de)activated elements,
            which this phase reduces to zero, as `RestartState.nodal_load`, or None.
        dof_map: map of the degrees of freedom.
    """

    nodes: Float[Array, "n_row 3"]
    groups: list[Element]
    start: RestartState
    end_states: list[ElementState | None]
    jacks: list[tuple[Float[Array, " n_elem"], InputValues] | None]
    added_load: NodalIncrement | None
    added: list[Bool[Array, " m"]]
    moved: NodalIncrement | None
    released: Float[Array, "n_row n_freedom"] | None
    dof_map: DofMap

    @classmethod
    def build(
        cls,
        nodes: Float[Array, "n_row 3"],
        groups: list[Element],
        restart: RestartState,
        data: PhaseData,
    ) -> LoadRamp:
        """Build the ramp of a phase from its data and the `RestartState` of the phase before."""
        added = [stack.phase == data.number for stack in restart.loads]
        moved = nodes + restart.motion[:, :3]
        pairs = zip(restart.loads, added, strict=True)
        loads = [stack.with_start_positions(which, moved) for stack, which in pairs]
        restart = copy_with(restart, loads=loads)
        released = None
        if data.dof_map_before is not None:
            changed = None
            if data.present is not None:
                at = data.present, data.dof_map_before, data.dof_map, data.attached
                changed = activation.apply_activation(nodes, groups, restart, *at)
            end_forces = None if changed is None else changed.end_forces_before
            restart, released = _change_supports(nodes, groups, restart, data, end_forces)
            if changed is not None:
                restart = copy_with(restart, motion=changed.motion, states=changed.states)
                released = released + jnp.where(data.dof_map.fixed, 0.0, changed.unbalanced)
        states, end_states, jacks = [], [], []
        parts = zip(groups, restart.states, data.inputs, strict=True)
        for number, (group, state, inputs) in enumerate(parts):
            end_state = jack = None
            known = accepted_inputs(group)
            state = state.reset_load_bearing_length()
            if "jacking" in inputs:
                under = state_under_load(number, group, state, nodes, restart)
                force = evaluate_elements("tension", group, under, nodes, restart.motion)
                jack = (force, inputs["jacking"])
            stateable: Any = group  # a `Prestressable`: other groups accept no input
            sudden = {n: stated for n, stated in inputs.items() if not known[n].ramped}
            if sudden:
                state = stateable.apply_phase_inputs(state, nodes[group.links], sudden)
            ramped = {n: stated for n, stated in inputs.items() if n not in ("jacking", *sudden)}
            if ramped:
                end_state = stateable.apply_phase_inputs(state, nodes[group.links], ramped)
            states.append(state)
            end_states.append(end_state)
            jacks.append(jack)
        restart = copy_with(restart, states=states)
        steps = None if data.moved is None else _restrict_to_supports(data.moved, data.dof_map)
        return cls(
            *(nodes, groups, restart, end_states, jacks, data.added_load, added, steps, released),
            data.dof_map,
        )

    @property
    def has_amplitudes(self) -> bool:
        """Whether any load follows an amplitude instead of the load factor itself."""
        parts = [self.added_load, self.moved, *self.start.loads]
        return any(part is not None and part.amplitude is not None for part in parts)

    @property
    def memory(self) -> Memory | None:
        """History variables at the start of the phase, per group; None if no group has any."""
        if not any(group.has_memory for group in self.groups):
            return None
        return [state.memory for state in self.start.states]

    def states(
        self, parameter: Float[ArrayLike, ""], memory: Memory | None = None
    ) -> list[ElementState]:
        """Return element states at a load factor (`parameter`), one per group.

        `memory`, history variables per group, replaces that of the start of the phase.
        """
        now = []
        groups: list[Any] = self.groups  # `Prestressable` where there is an end state
        parts = groups, self.start.states, self.end_states, self.jacks
        for group, start, end, jack in zip(*parts, strict=True):
            state = start if end is None else group.interpolate_states(start, end, parameter)
            if jack is not None:
                force, stated = jack
                force = interpolate(force, stated.values, parameter)
                state = with_fields(state, jack_force=force, jacked=stated.chosen)
            now.append(state)
        if memory is not None:
            now = [
                state if remembered is None else with_fields(state, memory=remembered)
                for state, remembered in zip(now, memory, strict=True)
            ]
        return now

    def nodal_load(self, parameter: Float[ArrayLike, ""]) -> Float[Array, "n_row n_freedom"]:
        """Return nodal loads and remaining released forces at a load factor, [n_row, n_freedom]."""
        load = self.start.nodal_load
        if self.added_load is not None:
            load = load + self.added_load.added_at(parameter)
        if self.released is not None:
            load = load + (1 - parameter) * self.released
        return load

    def prescribed_motion(self, parameter: Float[ArrayLike, ""]) -> Motion:
        """Return the motion of all nodes (rows) that supports prescribe at a load factor."""
        begin = self.start.motion
        if self.moved is None:
            return begin
        return space_class(self.groups).motion_after_row_step(begin, self.moved.added_at(parameter))

    def system_at(self, parameter: Float[ArrayLike, ""], memory: Memory | None = None) -> System:
        """Return the equations of the structure, `System`, at a load factor (`parameter`)."""
        now = self._restart_at(self.start.motion, self.states(parameter, memory), parameter)
        return make_system(
            self.nodes, self.groups, now, self.prescribed_motion(parameter), self.dof_map
        )

    def largest_added_load(self, begun: System, parameters: Float[Array, " n"]) -> Float[Array, ""]:
        """Return the largest dead load that the phase adds to a node at any of the load factors, N.

        `begun` is the system at the start of the phase, `parameters` are the load factors, [n].
        """

        def added(parameter):
            system = self.system_at(parameter)
            return jnp.max(system.space.force_norm(system.load - begun.load))

        return jnp.max(lax.map(added, parameters))

    def commit_memory(
        self,
        system: System,
        motion: Motion,
        strains: PerGroup | None,
        ok: Bool[Array, ""],
        memory: Memory,
    ) -> Memory:
        """Return the history variables after an increment, or the old ones unless `ok`.

        Args:
            system, motion: system and motion at the end of the increment.
            strains: section strains there; None: they are evaluated.
            ok: whether the increment has converged.
            memory: history variables before it, per group.
        """
        return select_tree(ok, system.commit_memory(motion, strains), memory)

    def initial_system(self) -> System:
        """Return the `System` at the start of the phase, with nothing prescribed by supports."""
        return make_system(self.nodes, self.groups, self.start, None, self.dof_map)

    def commit(
        self, parameter: Float[ArrayLike, ""], motion: Motion, memory: Memory | None = None
    ) -> RestartState:
        """Return the `RestartState` at a load factor (`parameter`), with jacks locked off.

        `motion` is that of all rows in equilibrium; `memory` are history variables there, per
        group.
        """
        now = self._restart_at(motion, self.states(parameter, memory), parameter)
        states = []
        for number, (group, state) in enumerate(zip(self.groups, now.states, strict=True)):
            if state.jack_force is not None:
                # hanging elements have their lengths under load
                state = state_under_load(number, group, state, self.nodes, now)
                state = evaluate_elements("lock_off", group, state, self.nodes, motion)
                state = copy_with(state, element_load=None) if group.shaped_by_load else state
            states.append(state)
        return copy_with(now, states=states)

    def _restart_at(
        self, motion: Motion, states: list[ElementState], parameter: Float[ArrayLike, ""]
    ) -> RestartState:
        """Return the `RestartState` at a load factor (`parameter`), from its motion and states.

        Nodal loads and factors of element loads are those of the load factor.
        """
        pairs = zip(self.start.loads, self.added, strict=True)
        loads = [stack.at_load_factor(which, parameter) for stack, which in pairs]
        nodal = self.nodal_load(parameter)
        return RestartState(motion, states, nodal, loads, self.start.support_rotation)


def _restrict_to_supports(added, dof_map):
    """Return the prescribed movements `added` on all rows; NaN if one moves a free direction.

    A support cannot move a degree of freedom that it does not hold.
    """
    if added.amplitude is not None:
        one_by_one = jax.vmap(
            lambda moved: _restrict_to_supports(NodalIncrement(moved), dof_map).values
        )
        return copy_with(added, values=one_by_one(added.values))
    moved = added.values
    if dof_map.node_of_row is not None:
        moved = moved[dof_map.node_of_row]
    if dof_map.inner is not None:
        moved = jnp.where(dof_map.inner[:, None], 0.0, moved)
    shift = moved[:, :3]
    if dof_map.axes is not None:
        rounding = 8 * jnp.finfo(shift.dtype).eps * jnp.max(jnp.abs(shift))
        shift = to_local(dof_map.axes, shift)
        shift = jnp.where(jnp.abs(shift) <= rounding, 0.0, shift)
    loose = ~dof_map.fixed[:, :3] & (shift != 0)
    return NodalIncrement(jnp.where(jnp.any(loose), jnp.nan, moved))


def _change_supports(nodes, groups, restart, data, end_forces):
    """Apply the supports of a phase to the `RestartState` before it.

    Loads on newly supported degrees of freedom end. Reactions of released ones are returned: the
    caller applies them as loads, which the phase reduces to zero. Nodes whose rotations are newly
    fixed or released keep their present rotation as that of the support. A load on an inactive
    degree of freedom stays, and acts once an element activates it. A node that is partly supported
    before and after has the same directions in both (`preparation`). `end_forces` are those of all
    groups there; None: they are evaluated.

    Returns:
        The `RestartState`, and the reactions of released supports, [n_row, n_freedom], N and N m.
    """
    before = make_system(nodes, groups, restart, restart.motion, data.dof_map_before)
    was, now = data.dof_map_before.fixed, data.dof_map.fixed
    newly = data.dof_map.fixed_by_supports & ~data.dof_map_before.fixed_by_supports
    if data.dof_map.axes is None:
        unbalanced = before.unbalanced(restart.motion, end_forces)
        released = jnp.where(was & ~now, unbalanced, 0.0)
        return copy_with(restart, nodal_load=jnp.where(newly, 0.0, restart.nodal_load)), released
    reaction, load = before.reactions(restart.motion, end_forces), restart.nodal_load
    if restart.support_rotation is not None:
        turned_anew = jnp.any((was != now)[:, 3:], axis=1, keepdims=True)
        bearing = jnp.where(turned_anew, restart.motion[:, 3:], restart.support_rotation)
        restart = copy_with(restart, support_rotation=bearing)
    after = make_system(nodes, groups, restart, restart.motion, data.dof_map)
    released, left = [], []
    pairs = zip(
        *(system.space.dof_directions(restart.motion) for system in (after, before)), strict=True
    )
    for k, (axes, axes_before) in enumerate(pairs):
        part = slice(3 * k, 3 * k + 3)
        gone = jnp.where(now[:, part], 0.0, to_local(axes, reaction[:, part]))
        released.append(to_global(axes, gone))
        whole = jnp.all(now[:, part], axis=1)[:, None, None]
        axes = jnp.where(whole, axes_before, axes)
        ended = newly[:, part]
        left.append(to_global(axes, jnp.where(ended, 0.0, to_local(axes, load[: len(was), part]))))
    # without a change the load itself, which `to_local` and `to_global` would round
    left = jnp.where(jnp.any(was != now), jnp.concatenate(left, axis=1), load)
    return copy_with(restart, nodal_load=left), jnp.concatenate(released, axis=1)
