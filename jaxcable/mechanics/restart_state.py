"""Restart state that a phase hands to the next one, and the system of equations made of it."""

from __future__ import annotations

import jax.numpy as jnp

from ..common.tree import copy_with, pytree
from ..common.types import Array, ArrayLike, Float, Int
from ..elements.element import Element
from ..elements.element_state import ElementState, with_fields
from ..spaces import space_class
from ..spaces.dof_map import DofMap
from ..spaces.space import Motion
from .assembly import System
from .load_stacks import LoadStack, dead_load, element_load


@pytree
class RestartState:
    """State of a structure after a phase, from which the next one or another analysis continues.

    Attributes:
        motion: motion of all nodes (rows) from the initial nodes, [n_row, n_motion]; see `spaces`.
        states: element states, one per group.
        nodal_load: sum of the nodal loads so far, [n_row, n_freedom], N and N m.
        loads: element loads of all phases with their present factors, a list of `LoadStack`.
        support_rotation: rotation of every row when its support was set, see
            `RotatingNodes.support_rotation`.
    """

    motion: Float[Array, "n_row n_motion"]
    states: list[ElementState]
    nodal_load: Float[Array, "n_row n_freedom"]
    loads: list[LoadStack]
    support_rotation: Float[Array, "n_row 4"] | None = None

    def with_factors_alone(self) -> RestartState:
        """Return a copy whose loads have only factors and start positions, which phases change.

        Their numbers, phases and amplitudes are None.
        """
        bare = {"load": None, "phase": None, "amplitude": None}
        return copy_with(self, loads=[copy_with(stack, **bare) for stack in self.loads])

    def with_loads(self, loads: list[LoadStack]) -> RestartState:
        """Return a copy with the numbers of `loads`, and with its own factors and start positions.

        It undoes `with_factors_alone`.
        """
        pairs = zip(loads, self.loads, strict=True)
        return copy_with(
            self, loads=[copy_with(new, factors=own.factors, begun=own.begun) for new, own in pairs]
        )


def initial_restart_state(nodes: Float[Array, "n_row 3"], groups: list[Element]) -> RestartState:
    """Return the `RestartState` of a structure before its first phase."""
    states = [group.start(nodes[group.links]) for group in groups]
    space = space_class(groups)
    return RestartState(space.at_rest(nodes), states, space.pad_moments(jnp.zeros_like(nodes)), [])


def with_loads_until(
    restart: RestartState, loads: list[LoadStack], phase: Int[ArrayLike, ""]
) -> RestartState:
    """Return a `RestartState` with the numbers of `loads`; those of phases after `phase` are zero.

    They are zero also where they are NaN. `restart` has factors of the loads alone
    (`RestartState.with_factors_alone`).
    """
    return restart.with_loads([stack.up_to_phase(phase) for stack in loads])


def state_under_load(
    number: int,
    group: Element,
    state: ElementState,
    nodes: Float[Array, "n_row 3"],
    restart: RestartState,
) -> ElementState:
    """Return a state of the group with index `number`, with the loads along its elements."""
    if not group.shaped_by_load:
        return state
    return with_fields(state, element_load=element_load(number, group, state, nodes, restart))


def make_system(
    nodes: Float[Array, "n_row 3"],
    groups: list[Element],
    restart: RestartState,
    prescribed: Motion | None,
    dof_map: DofMap,
    load: Float[Array, "n_row n_freedom"] | None = None,
) -> System:
    """Make the `System` of a `RestartState`, with the loads along elements in their states.

    Args:
        nodes, groups: initial positions, [n_row, 3], m, and element groups.
        restart: `RestartState`.
        prescribed: motion that supports prescribe, of all rows; None without supports.
        dof_map: map of the degrees of freedom.
        load: dead load, [n_row, n_freedom]; None: it is computed.
    """
    if load is None:
        load = dead_load(nodes, groups, restart)
    states = [
        state_under_load(number, group, state, nodes, restart)
        for number, (group, state) in enumerate(zip(groups, restart.states, strict=True))
    ]
    space = space_class(groups).build(nodes, groups, dof_map, prescribed, restart.support_rotation)
    followers = [stack for stack in restart.loads if stack.follows] or None
    return System(nodes, groups, states, load, space, followers)
