"""Restart state that a phase hands to the next one, and the system of equations made of it."""

from __future__ import annotations

import jax.numpy as jnp

from ..common.tree import copy_with, pytree
from ..common.types import Array, ArrayLike, Float, Int
from ..elements.element import Element
from ..elements.element_state import ElementState, with_fields
from ..spaces import space_of
from ..spaces.dof_map import DofMap
from ..spaces.space import Motion
from . import load_stacks
from .assembly import System


@pytree
class RestartState:
    """What a phase hands to the next one, and from which another analysis can continue.

    Attributes:
        motion: motion of all nodes (rows) from the initial nodes, [n_row, n_motion]; see `spaces`.
        states: element states, one per group.
        nodal_load: sum of the nodal loads so far, [n_row, n_freedom], N and N m.
        loads: element loads of all phases, a list of `LoadStack`.
        load_factors: factors of these loads, a list of `LoadFactors`.
        support_rotation: rotation of every row when its support was set, see
            `RotatingNodes.support_rotation`.
    """

    motion: Float[Array, "n_row n_motion"]
    states: list[ElementState]
    nodal_load: Float[Array, "n_row n_freedom"]
    loads: list[load_stacks.LoadStack]
    load_factors: list[load_stacks.LoadFactors]
    support_rotation: Float[Array, "n_row 4"] | None = None


def initial_restart_state(nodes: Float[Array, "n_row 3"], groups: list[Element]) -> RestartState:
    """Return the `RestartState` of a structure before its first phase."""
    states = [group.start(nodes[group.links]) for group in groups]
    space = space_of(groups)
    return RestartState(
        space.at_rest(nodes), states, space.pad_moments(jnp.zeros_like(nodes)), [], []
    )


def with_loads_until(
    restart: RestartState, loads: list[load_stacks.LoadStack], phase: Int[ArrayLike, ""]
) -> RestartState:
    """Return the `RestartState` with `loads`, but zero (also for NaN) in phases after `phase`."""
    return copy_with(restart, loads=[stack.up_to_phase(phase) for stack in loads])


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
        load = load_stacks.dead_load(nodes, groups, restart)
    states = [
        with_fields(
            state, element_load=load_stacks.element_load(number, group, state, nodes, restart)
        )
        if group.shaped_by_load
        else state
        for number, (group, state) in enumerate(zip(groups, restart.states, strict=True))
    ]
    space = space_of(groups).of(nodes, groups, dof_map, prescribed, restart.support_rotation)
    return System(nodes, groups, states, load, space, load_stacks.active_followers(restart))
