"""What a phase hands to the next one, and the system of forces that belongs to it."""

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
class Carry:
    """What a phase hands to the next one.

    Attributes:
        motion: of all rows since the initial nodes, [n_row, n_motion]; see `spaces`.
        states: element states, one per group.
        nodal_load: sum of the nodal loads so far, [n_row, n_freedom], N and N m.
        loads: element loads of all phases, a list of `LoadStack`.
        amounts: how much of these loads acts, a list of `Amounts`.
        support_rotation: `RotatingNodes.support_rotation`: rotation of every row when its support
            was set.
    """

    motion: Float[Array, "n_row n_motion"]
    states: list[ElementState]
    nodal_load: Float[Array, "n_row n_freedom"]
    loads: list[load_stacks.LoadStack]
    amounts: list[load_stacks.Amounts]
    support_rotation: Float[Array, "n_row 4"] | None = None


def unloaded(nodes: Float[Array, "n_row 3"], groups: list[Element]) -> Carry:
    """The `Carry` of a structure before its first phase."""
    states = [group.start(nodes[group.links]) for group in groups]
    space = space_of(groups)
    return Carry(space.at_rest(nodes), states, space.pad_moments(jnp.zeros_like(nodes)), [], [])


def knowing(carry: Carry, loads: list[load_stacks.LoadStack], phase: Int[ArrayLike, ""]) -> Carry:
    """A `Carry` with the `loads` that a phase knows; later ones, which may be NaN, are zero."""
    return copy_with(carry, loads=[stack.until(phase) for stack in loads])


def make_system(
    nodes: Float[Array, "n_row 3"],
    groups: list[Element],
    carry: Carry,
    prescribed: Motion | None,
    dof_map: DofMap,
    load: Float[Array, "n_row n_freedom"] | None = None,
) -> System:
    """The system of a `Carry`; sets the loads that shape its elements.

    `prescribed` is the motion of all rows as supports prescribe it, None if supports are not
    needed; `load` is the dead load of the carry, if it is known already.
    """
    if load is None:
        load = load_stacks.dead_load(nodes, groups, carry)
    states = [
        with_fields(
            state, element_load=load_stacks.element_load(number, group, state, nodes, carry)
        )
        if group.shaped_by_load
        else state
        for number, (group, state) in enumerate(zip(groups, carry.states, strict=True))
    ]
    space = space_of(groups).of(nodes, groups, dof_map, prescribed, carry.support_rotation)
    return System(nodes, groups, states, load, space, load_stacks.following(carry))
