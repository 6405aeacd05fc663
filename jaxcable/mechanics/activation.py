"""Activation and deactivation of elements between two phases (element birth and death).

An activated element is without stress between the present positions of its ends. The unbalanced
force of a change (end forces of deactivated elements, weight of activated ones) acts as a load that
the phase reduces to zero.
"""

from __future__ import annotations

from typing import Any, NamedTuple, TypeAlias

import jax
import jax.numpy as jnp
from jax import lax

from ..common.tree import copy_with
from ..common.types import Array, Bool, Float
from ..elements.element import Element
from ..elements.element_state import ElementState
from ..spaces import space_class
from ..spaces.dof_map import DofMap, to_global, to_local
from ..spaces.space import Forces, Motion
from .assembly import EndForces
from .elementwise import evaluate_elements
from .restart_state import RestartState, make_system

Present: TypeAlias = 'list[Bool[Array, " n_elem"]]'
"""For every group, which of its elements are active."""


class ActivatedElements(NamedTuple):
    """State of a structure after elements have been activated and deactivated.

    Attributes:
        motion: motion of all rows after it.
        states: states of elements after it, per group.
        end_forces_before: end forces before it, per group.
        unbalanced: unbalanced forces of the change, [n_row, n_freedom], N and N m.
    """

    motion: Motion
    states: list[ElementState]
    end_forces_before: EndForces
    unbalanced: Forces


def apply_activation(
    nodes: Float[Array, "n_row 3"],
    groups: list[Element],
    restart: RestartState,
    present: Present,
    before: DofMap,
    now: DofMap,
    attached: Bool[Array, ""] | None,
) -> ActivatedElements:
    """Activate and deactivate elements at the start of a phase.

    Args:
        nodes, groups, restart: structure, and `RestartState` of the phase before.
        present: which elements are active in this phase, per group [n_elem] bool.
        before, now: `DofMap` with the supports and inactive nodes of both phases.
        attached: whether inactive nodes move rigidly with the node to which their first element
            joins them; None if this is so in no phase.
    """
    motion: Motion = restart.motion
    was: Any = [state.present for state in restart.states]  # all groups have it here
    new = [there & ~earlier for there, earlier in zip(present, was, strict=True)]
    if attached is not None:
        placed = _attach_nodes(nodes, groups, motion, new, before, now)
        motion = jnp.where(attached, placed, motion)
    states, either = [], []
    given = zip(groups, restart.states, was, present, new, strict=True)
    for group, state, earlier, there, coming in given:
        begins, fresh = copy_with(state, present=coming), group.initial_memory()
        if fresh is not None:
            begins = copy_with(begins, memory=fresh)
        found = evaluate_elements("state_at_activation", group, begins, nodes, motion)
        state = jax.tree.map(
            lambda a, b, own=coming: jnp.where(own.reshape(-1, *(1,) * (a.ndim - 1)), a, b),
            copy_with(found, present=there),
            copy_with(state, present=there | earlier),
        )
        either.append(state)
        states.append(copy_with(state, present=there))

    def system(motion, states, dof_map):
        given = copy_with(restart, motion=motion, states=states)
        return make_system(nodes, groups, given, motion, dof_map)

    # Of all elements that are there before or after: the nodes that are moved are touched by those
    # only that come.
    together = system(motion, either, now)
    forces = together.results_by_name(motion, "end_forces")["end_forces"]
    forces_before = [_mask(earlier, force) for earlier, force in zip(was, forces, strict=True)]
    changes = [
        together.space.pad_moments(_mask(there, force) - before_it)
        for there, force, before_it in zip(present, forces, forces_before, strict=True)
    ]
    load = system(motion, states, now).external_force(motion)
    load_before = system(restart.motion, restart.states, before).external_force(restart.motion)
    unbalanced = together.sum_at_rows(changes) - (load - load_before)
    return ActivatedElements(motion, states, forces_before, unbalanced)


def _mask(there, force):
    """Return end forces `force`, [n_elem, n_end, n], or zero where `there`, [n_elem], is false."""
    return jnp.where(there[:, None, None], force, 0.0)


def _attach_nodes(nodes, groups, motion, new, before, now):
    """Return the motion in which newly activated nodes have moved rigidly with active ones.

    Each goes with the active node to which a chain of activated elements joins it
    (`_connected_active_rows`), but not along directions that supports hold.

    Args:
        nodes, groups, before, now: as for `apply_activation`.
        motion: motion of all rows at the end of the phase before.
        new: which elements are activated, per group [n_elem] bool.
    """
    owner = _displacement_rows(len(nodes), now)
    # held before, because nothing touched them, and now not by a support
    waiting = jnp.all(before.fixed[:, :3], axis=1) & ~jnp.all(now.fixed[:, :3], axis=1)
    root = _connected_active_rows(groups, new, owner, waiting[owner])
    moved = space_class(groups).rigid_link_motion(motion[root], nodes[owner] - nodes[root])
    brought = waiting[owner] & (root != owner)
    if now.inner is not None:
        brought = brought & ~now.inner
    moved = moved.at[:, :3].set(_displacements_where_free(moved[:, :3], motion[:, :3], now))
    return jnp.where(brought[:, None], moved, motion)


def _displacement_rows(n_row, dof_map):
    """Return the index of the row whose displacement each row has, [n_row].

    It is the row itself for nodes; a hinged end of a beam has the displacement of its node.
    """
    rows = jnp.arange(n_row)
    return rows if dof_map.node_of_row is None else jnp.asarray(dof_map.node_of_row, rows.dtype)


def _connected_active_rows(groups, new, owner, waiting):
    """Find for each inactive row the active row to which a chain of activated elements joins it.

    Of several active rows the one with the fewest elements between counts, of several elements that
    with the lowest index.

    Args:
        groups: element groups.
        new: which elements are activated, per group [n_elem] bool.
        owner: row with the displacement of each row, [n_row], from `_displacement_rows`.
        waiting: which rows have been inactive and become active, [n_row] bool.

    Returns:
        Indices of the active rows, [n_row]; those of `owner` for rows that are active themselves,
        and where no chain leads to an active one.
    """
    pairs, comes = [], []
    for group, coming in zip(groups, new, strict=True):
        n_end = group.links.shape[1] - group.n_inner_row
        for k in range(n_end - 1):
            pairs.append(owner[group.links[:, k : k + 2]])
            comes.append(coming)
    pairs, comes = jnp.concatenate(pairs), jnp.concatenate(comes)
    number = jnp.arange(len(pairs))
    none = len(pairs)
    count = len(waiting)

    def further(state):
        root, _ = state
        known = root >= 0
        to = jnp.full(count, none)
        for k in (0, 1):
            joins = comes & known[pairs[:, 1 - k]] & ~known[pairs[:, k]]
            to = to.at[pairs[:, k]].min(jnp.where(joins, number, none))
        other = pairs[jnp.minimum(to, none - 1)]
        other = jnp.where(known[other[:, 0]], other[:, 0], other[:, 1])
        found = (to < none) & ~known
        return jnp.where(found, root[other], root), jnp.any(found)

    start = jnp.where(waiting, -1, jnp.arange(count))
    root, _ = lax.while_loop(lambda state: state[1], further, (start, jnp.ones((), bool)))
    return jnp.where(root < 0, owner, root[owner])


def _displacements_where_free(moved, still, dof_map):
    """Return displacements, `moved` along free and `still` along fixed directions, [n_row, 3], m.

    `dof_map` says which directions supports fix, and along which axes.
    """
    fixed = dof_map.fixed[:, :3]
    if dof_map.axes is None:
        return jnp.where(fixed, still, moved)
    axes = dof_map.axes
    return to_global(axes, jnp.where(fixed, to_local(axes, still), to_local(axes, moved)))
