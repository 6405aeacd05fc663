"""Warnings of natural modes: weights without mass, modes within spans, nodes left out."""

from __future__ import annotations

from typing import Any

import jax.numpy as jnp
import numpy as np

from ..analysis.solution import Solution, State
from ..common import checks
from ..common.types import ArrayLike, Bool, Float
from ..elements.abilities import Hanging
from ..mechanics.elementwise import evaluate_elements
from ..mechanics.restart_state import make_system
from ..model.structure import Structure
from ..spaces.dof_map import DofMap
from ..stiffness.tangent import merge_solution_state


def warn_of_nodes_without_stiffness(loose: Bool[ArrayLike, " n_node"]) -> None:
    """Warn of nodes without stiffness, [n_node] bool, which modes leave out; not while traced."""
    known = checks.array_if_known(loose)
    if known is None or not known.any():
        return
    number = int(known.sum())
    nodes = "node is" if number == 1 else "nodes are"
    checks.warn_user(
        f"state: {number} {nodes} held by slack cables only, such as node {int(known.argmax())}, "
        "and left out of all modes: without stiffness they have no vibration; tighten these "
        "cables, or hold the nodes by `fixed`"
    )


def warn_of_freed_supports(state: Solution | State, fixed: Bool[ArrayLike, "n_row n"]) -> None:
    """Warn if a degree of freedom that a support of the state holds is not in `fixed`.

    `fixed` is that of `modes`. If it holds nothing, a free body is meant, without a warning.
    """
    last = state.last if isinstance(state, Solution) else state
    phase = checks.array_if_known(last.phase)
    if phase is None:
        return
    freed = last.fixed[int(phase) + 1].array & ~np.asarray(fixed, bool)
    if freed.any() and np.any(fixed):
        row, k = (int(i) for i in np.argwhere(freed)[0])
        along = f"{'rotation ' * (k > 2)}{'xyz'[k % 3]}"
        checks.warn_user(
            f"fixed: leaves free what supports hold, such as node {row} along {along}: it replaces "
            "the supports; give what they hold, too"
        )


def warn_of_weights_without_mass(
    structure: Structure, state: Solution | State, dof_map: DofMap
) -> None:
    """Warn if downward nodal loads of a state, which have no mass, exceed weights of elements.

    Loads and weights count at nodes that can move vertically, weights in equal shares at the ends
    of an element. `dof_map` has the unknowns of the modes.
    """
    restart = (state.last if isinstance(state, Solution) else state).restart
    weights = [
        None if group.weight is None else group.weights(own)
        for group, own in zip(structure.groups, restart.states, strict=True)
    ]
    mobility = vertical_mobility(dof_map)
    known: list[Any] = [checks.array_if_known(x) for x in (restart.nodal_load, mobility)]
    parts: list[Any] = [checks.array_if_known(x) for x in weights if x is not None]
    if any(x is None for x in (*known, *parts)) or not parts:
        return
    n_node = structure.n_node
    load, mobility = known[0][:n_node, 2], known[1][:n_node]
    down, weight = -np.sum(np.minimum(load, 0.0) * mobility), 0.0
    for group, own in zip(structure.groups, weights, strict=True):
        if own is not None:
            weight += float(np.sum(np.asarray(own) * mobility[group.links.array].mean(axis=1)))
    if down > weight and any(np.any(own > 0) for own in parts):
        checks.warn_user(
            f"masses: nodal loads of {down:.4g} N downwards have no mass here; of the elements, "
            f"{weight:.4g} N can move vertically; give masses=..., such as the PointMasses of the "
            "analysis, or masses=0.0 if these loads are no weights"
        )


def vertical_mobility(dof_map: DofMap) -> Float[ArrayLike, " n_row"]:
    """Return how far rows can move vertically, [n_row]: 1 where freely, 0 where they are held.

    Where a direction that is held is inclined, it is its squared sine to the vertical.
    """
    free = dof_map.movable_dofs()[:, :3]
    if dof_map.axes is None:
        return free[:, 2].astype(float)
    return (free * dof_map.axes[:, :3, 2] ** 2).sum(axis=1)


def warn_of_modes_within_spans(
    structure: Structure, split: Any, gravity: ArrayLike, frequency: Float[ArrayLike, " n"]
) -> None:
    """Warn if a catenary has a mode within its span that is slower than the highest `frequency`.

    Traced frequencies, Hz, are not tested. `split` is from `split_state_for_modes`; weights are
    divided by `gravity`, m/s2.
    """
    known = checks.array_if_known(frequency)
    if known is None or not any(isinstance(group, Hanging) for group in structure.groups):
        return
    highest = np.nanmax(np.append(known, -np.inf))
    nodes, groups, restart = merge_solution_state(*split[:2])
    no_unknowns: Any = None
    named = structure.named_groups()
    for index, (group, state) in enumerate(zip(groups, restart.states, strict=True)):
        where = named[index][0]
        if not isinstance(group, Hanging) or group.weight is None:
            continue
        system = make_system(nodes, groups, restart, None, no_unknowns)
        tension = evaluate_elements("tension", group, system.states[index], nodes, restart.motion)
        # first frequency of a taut string with the mass of the catenary: exact across a shallow one
        mass = group.weights(state) / gravity
        mass = jnp.where(mass > 0, mass, jnp.nan)
        found = checks.array_if_known(jnp.sqrt(tension / mass / state.rest_length) / 2)
        if found is None:
            return
        slow = np.flatnonzero(found < highest)
        if len(slow):
            k = int(slow[np.argmin(found[slow])])
            checks.warn_user(
                f"structure: catenary {k} of elements{where} vibrates within its span at about "
                f"{found[k]:.3g} Hz, slower than a mode that is returned "
                f"({highest:.3g} Hz); modes within a span are not found: use a chain of Cables, or "
                "ask for fewer modes"
            )
