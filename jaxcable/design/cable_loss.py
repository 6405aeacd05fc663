"""The sudden loss of cables: an accidental action with forces for its dynamic effect."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np

from ..analysis.activation import element_masks
from ..analysis.group_values import value_per_group
from ..analysis.phases import keys_as_whole_groups
from ..analysis.solution import Solution, State
from ..common import checks, status
from ..common.rules import Rule, nan_if_broken
from ..common.selection import Selection, WholeGroups
from ..common.tree import copy_with
from ..common.types import Array, ArrayLike, Bool, Float, Int, PyTree
from ..loads import NodalLoads
from ..mechanics.restart_state import make_system
from ..model.result_parts import named_groups_of
from ..model.structure import Structure
from ..model.topology import require_same_topology
from ..programs.program_calls import as_program
from ..stiffness.tangent import merge_solution_state, split_solution_state
from .actions import Action
from .arguments import require_structure

_MOST_LISTED = 8  # indices of elements in a name


def loss_of_cable(
    structure: Structure,
    solution: Solution | State,
    elements: str | Sequence[str] | PyTree[Int[ArrayLike, " n"] | Bool[ArrayLike, " n_elem"]],
    *,
    dynamic_factor: Float[ArrayLike, ""] = 2.0,
    name: str | None = None,
) -> Action:
    """Return the sudden loss of cables as an accidental action, with its dynamic effect.

    The action removes the elements, and loads the nodes that they were attached to with the forces
    that they exert on them in `solution`, reversed, times ``dynamic_factor - 1``. In a linear
    structure every effect beside them, be it a displacement, a force or a reaction, is then::

        E = E_before + dynamic_factor (E_after - E_before)

    with the static states before and after the loss. Supports that held the elements have a part of
    their reversed forces as reactions by this rule, though nothing swings there. Nonlinear
    structures are analysed as they are: remaining cables may become slack. A structure that needs
    the elements to keep its shape takes a transient analysis instead.

    The forces are those at the ends of the deformed elements: tensions of cables and sliding
    cables, end forces of catenaries, forces and moments of beams, moments of saddles. Loads on the
    elements, weight included, go with them: the forces contain their shares at the nodes.

    One mass on springs without damping swings to twice its new displacement, hence 2.0, which
    recommendations on stay cables have, too (Mozos and Aparicio 2010). Standards have factors from
    1.5 to 2.0; EN 1993-1-11, 2.3.6, leaves it to the National Annex. It is no upper bound: with
    many modes of vibration moments of a deck can be amplified more. Take 1.0 for elements that are
    taken out slowly.

    Args:
        structure: the `Structure` that was analysed.
        solution: `Solution`, or `State`, of the intact structure under all that acts when the
            elements are lost, accompanying variable actions included.
        elements: elements that are lost together: by group, such as ``{"stays": [1]}``, indices,
            booleans [n_elem], `only` or True for all; without groups by name these alone; or names
            of whole groups.

    Options:
        dynamic_factor: by which the static change is multiplied, at least 1, -. With 1 the action
            has no forces: the loss is static.
        name: of the action; default "loss of " and the elements.

    Returns:
        `Action` of the kind "accidental". Its forces are differentiable in `solution`; they are NaN
        if a traced solution has failed.

    Raises:
        ValueError: unknown groups or elements, none, or some that are not there in `solution`; a
            batch, or a solution that has failed; a `dynamic_factor` below 1 or not finite.

    Source:
        Mozos and Aparicio, Parametric study on the dynamic response of cable stayed bridges to the
        sudden failure of a stay, Eng. Struct. 32 (2010) 3288.

    Example:
        Two cables carry 20 kN, each with 12.5 kN. One breaks: the other one has 25 kN after that,
        and ``12.5 + 2 (25 - 12.5)`` while the load swings.

        >>> cables = jc.Cables([[0, 2], [1, 2]], axial_stiffness=1e9)
        >>> held = jc.pinned([0, 1]) + jc.restrained([2], "xy")
        >>> nodes = [[-3.0, 0.0, 4.0], [3.0, 0.0, 4.0], [0.0, 0.0, 0.0]]
        >>> structure = jc.Structure(nodes, {"stays": cables}, supports=held)
        >>> load = jc.NodalLoads([2], (0.0, 0.0, -20e3))
        >>> intact = jc.solve(structure, jc.Phase(loads=load))
        >>> loss = jc.design.loss_of_cable(structure, intact, {"stays": [1]})
        >>> dead = jc.design.Action("dead load", "permanent", load, in_phases=True)
        >>> found = jc.design.combinations([dead, loss], which=["ACC 6.11"])
        >>> print(found)
        ACC 6.11-1  1 dead load + 1 loss of stays 1
        >>> case = jc.design.solve_cases(structure, None, found, start=intact)
        >>> print(case.status, jnp.round(case.tension["stays"], -1))
        [0] [[37500.     0.]]
    """
    require_structure(structure)
    state, sound = _checked_state(solution)
    require_same_topology(structure, state.topology, "solution")
    lost = _masks_of_lost_elements(elements, structure)
    _require_active(structure, state, lost)
    text = "expected a finite number of at least 1"
    rule = Rule(
        "dynamic_factor",
        checks.as_scalar(dynamic_factor, "dynamic_factor"),
        lambda v: ~((v >= 1) & (v < np.inf)),
        text,
    )
    factor = nan_if_broken(rule)
    known = checks.array_if_known(factor)
    loads = None
    if known is None or known != 1:
        loads = _loads_of_loss(structure, state, lost, sound * (factor - 1))
    name = _default_name(structure, lost) if name is None else name
    return Action(name, "accidental", loads, removes=structure.arrange(lost))


def _masks_of_lost_elements(elements, structure):
    """Return which elements are lost, a list of bool arrays [n_elem] of NumPy, one for each group.

    Raises ValueError for unknown, traced or no elements.
    """
    chosen = keys_as_whole_groups(elements)
    if any(isinstance(leaf, jax.core.Tracer) for leaf in jax.tree.leaves(chosen)):
        raise ValueError(
            "elements: are topology and cannot be traced; give indices or NumPy booleans"
        )
    if not isinstance(chosen, WholeGroups):
        _require_groups(chosen, structure)
        pairs = zip(
            structure.named_groups(), value_per_group(chosen, structure, "elements"), strict=True
        )
        selected = [_as_selection(given, f"elements{key}") for (key, _), given in pairs]
        chosen = structure.arrange(selected)
    masks = [np.asarray(mask) for mask in element_masks(chosen, structure, "elements")]
    if not any(mask.any() for mask in masks):
        raise ValueError("elements: no element is lost; name at least one")
    return masks


def _require_groups(chosen, structure):
    """Raise ValueError if a structure has several groups, and `chosen` elements are not by group.

    `chosen` is the user's choice; None, and names of groups, are by group.
    """
    kinds = [dict] if isinstance(structure.elements, dict) else [list, tuple]
    kinds.append(type(structure.elements))
    if len(structure.groups) > 1 and chosen is not None and not isinstance(chosen, tuple(kinds)):
        keys = ", ".join(key for key, _ in structure.named_groups())
        raise ValueError(
            f"elements: expected a choice by group, such as {{'stays': [1]}}, or names of groups; "
            f"the structure has {keys}"
        )


def _as_selection(given, where):
    """Return the choice of elements of one group, indices as a `Selection`, else unchanged.

    None, one bool, masks [n_elem] and selections pass; others raise ValueError, which names
    `where`.
    """
    if given is None or isinstance(given, Selection | bool | np.bool_):
        return given
    if checks.as_boolean_mask(given) is not None and np.size(given):
        return np.asarray(given)
    if not isinstance(given, list | tuple | np.ndarray | jax.Array) or np.ndim(given) != 1:
        raise ValueError(
            f"{where}: expected indices such as [1], booleans [n_elem], only(elements) or True, "
            f"got {given!r}"
        )
    return Selection(checks.as_indices(given, where, things="element"))


def _checked_state(solution):
    """Return the last `State` of a solution, and the factor 1.0, NaN where a traced one has failed.

    Raises ValueError for a batch, a solution that is known to have failed, and other objects.
    """
    state = solution.last if isinstance(solution, Solution) else solution
    if not isinstance(state, State):
        got = checks.describe_type(solution, "solve(structure, phases)")
        raise ValueError(f"solution: expected a Solution or its .last, got {got}")
    if np.ndim(state.phase) != 0:
        raise ValueError(
            "solution: is a batch; take one case k: jax.tree.map(lambda x: x[k], solution)"
        )
    if state is solution:
        return state, 1.0
    code = checks.array_if_known(solution.status)
    if code is not None and code != status.OK:
        raise ValueError(
            f"solution: has failed ({status.describe(int(code))}); the forces of the elements are "
            "not known"
        )
    return state, 1.0 if code is not None else jnp.where(solution.status == status.OK, 1.0, jnp.nan)


def _require_active(structure, state, lost):
    """Raise ValueError if an element of the masks `lost`, by group, is inactive in a state.

    Traced activity is not checked.
    """
    for (key, _), mask, own in zip(
        structure.named_groups(), lost, state.restart.states, strict=True
    ):
        there = checks.array_if_known(own.present)
        if there is not None and (mask & ~there).any():
            k = int((mask & ~there).argmax())
            raise ValueError(f"elements: element {k} of elements{key} is not there in the solution")


def _loads_of_loss(structure, state, lost, factor):
    """Return `NodalLoads` that replace lost elements: their end forces on nodes, reversed.

    Forces, N, and moments of beams and saddles, N m, are multiplied by `factor`; `lost` has masks
    by group.
    """
    split = split_solution_state(structure, state, unknowns=False)
    total = _reversed_forces(*split, lost)
    n_node, (rows, groups) = structure.n_node, structure.motion_rows()
    forces = total[:, :3]
    if rows is not None:  # a hinged end passes its force to its node; inner unknowns are no ends
        forces = jnp.where(rows.inner[:, None], 0.0, forces)
        forces = jnp.zeros((n_node, 3), forces.dtype).at[rows.node_of_row].add(forces)
    pairs = list(zip(structure.groups, lost, strict=True))
    nodes = _nodes_of_elements(pairs)
    loads = [NodalLoads(nodes, factor * forces[nodes])]
    own = zip(pairs, groups, strict=True)  # saddles rotate with nodes, too
    turned = _nodes_of_elements([pair for pair, group in own if group.rotates])
    turned = turned[structure.rotating_nodes()[turned]]
    if len(turned):
        loads.append(NodalLoads(turned, np.zeros(3), factor * total[turned, 3:]))
    return loads


def _nodes_of_elements(pairs):
    """Return the sorted indices of all nodes that chosen elements touch, each once, [n].

    `pairs` are (group, mask [n_elem] of its chosen elements).
    """
    links = [group.links.array[mask].ravel() for group, mask in pairs]
    return np.unique(np.concatenate(links)) if links else np.zeros(0, int)


@as_program
def _reversed_forces(
    without_indices: Any, index_arrays: Any, dof_map: Any, lost: list[Bool[Array, " n_elem"]]
) -> Float[Array, "n_row n_freedom"]:
    """Return the forces that lost elements and loads on them exert on rows, reversed, N and N m."""
    nodes, groups, restart = merge_solution_state(without_indices, index_arrays)
    motion = restart.motion

    def system(lost_of_group):
        """Return the system without the elements `lost_of_group`, masks by group."""
        states = []
        for group, state, mask in zip(groups, restart.states, lost_of_group, strict=True):
            there = ~mask if state.present is None else state.present & ~mask
            states.append(group.with_activation(state, there))
        return make_system(nodes, groups, copy_with(restart, states=states), motion, dof_map)

    before = system([jnp.zeros_like(mask) for mask in lost])
    ends = [
        before.space.pad_moments(jnp.where(mask[:, None, None], forces, 0.0))
        for mask, forces in zip(
            lost, before.results_by_name(motion, "end_forces")["end_forces"], strict=True
        )
    ]
    loads_on_lost = before.external_force(motion) - system(lost).external_force(motion)
    return before.sum_at_rows(ends) - loads_on_lost


def _default_name(structure, lost):
    """Return the name of an action from the lost elements, masks by group: "loss of stays 1, 4"."""
    parts = []
    for (label, _), mask in zip(named_groups_of(structure), lost, strict=True):
        numbers = [str(k) for k in np.flatnonzero(mask)]
        if mask.all():
            parts.append(label or "all elements")
        elif len(numbers) > _MOST_LISTED:
            parts.append(f"{len(numbers)} of {label or 'the elements'}")
        elif numbers:
            parts.append(f"{label or 'elements'} {', '.join(numbers)}")
    return f"loss of {'; '.join(parts)}"
