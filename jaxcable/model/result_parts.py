"""A structure and its results in parts: groups by name, values per group, straight pieces."""

from __future__ import annotations

import functools
import math
from collections.abc import Mapping, Sequence
from typing import Any, NamedTuple

import jax
import numpy as np

from ..common.checks import as_numpy_if_known
from ..common.types import Array, Bool, Float, Int, PyTree
from ..elements.abilities import POINT_LOADS, is_one_sided
from ..elements.element import (
    PEAK_TENSION,
    PRESENT,
    SECTION_FORCES,
    SECTION_STRAIN,
    TENSION,
    Element,
)
from .structure import Structure, is_group
from .topology import GroupTopology, nodes_with_elements


def named_groups_of(structure: Structure) -> list[tuple[str, Element]]:
    """Return pairs (name, element group) in pytree order: keys of the elements joined by ".".

    The name of a single group is "".
    """
    leaves = jax.tree_util.tree_leaves_with_path(structure.elements, is_leaf=is_group)
    keystr = functools.partial(jax.tree_util.keystr, simple=True, separator=".")
    return [(keystr(path), group) for path, group in leaves]


def group_path(structure: Structure, k: int) -> str:
    """Return how a user writes the group with index `k`, for messages: ``elements['net']``."""
    return f"elements{structure.named_groups()[k][0]}"


def values_per_group(
    structure: Structure, values: PyTree[Float[Array, "n_elem ..."]]
) -> list[Float[np.ndarray, "n_elem ..."] | None]:
    """Return results in the shape of ``structure.elements`` as a list with an item per group.

    Items are arrays [n_elem, ...], of NumPy unless they are traced, or None for a group without
    this result.
    """
    return [
        None if value is None else as_numpy_if_known(value)
        for value in items_per_group(structure, values)
    ]


def items_per_group(structure: Structure, values: PyTree[Any] | None) -> list[Any]:
    """Flatten a pytree in the shape of ``structure.elements`` to a list with one item per group.

    The items are not changed; all are None if there are no values.
    """
    if values is None:
        return [None] * len(structure.groups)
    return structure.group_tree.flatten_up_to(values)


def present_elements(
    structure: Structure, present: PyTree[Float[Array, " n_elem"]] | None
) -> list[Bool[np.ndarray, " n_elem"]]:
    """Return per group which elements are active, [n_elem] bool.

    `present` is `ElementResults.present`, above 0 for active elements; None: all are active.
    """
    if present is None:
        return [np.ones(len(group.links), bool) for group in structure.groups]
    return [as_numpy_if_known(found) > 0 for found in items_per_group(structure, present)]


def active_nodes(
    structure: Structure, present: PyTree[Float[Array, " n_elem"]] | None
) -> Bool[np.ndarray, " n_node"]:
    """Return which nodes have an active element, or no element at all, [n_node] bool.

    `present` is `ElementResults.present`, above 0 for active elements; None: all are active.
    """
    known = structure.groups, structure.n_node, structure.rigid
    active = nodes_with_elements(*known, present_elements(structure, present))
    return active | ~nodes_with_elements(*known)


def loose_nodes(
    structure: Structure, state: Any, fixed: Bool[np.ndarray, "n_node n_freedom"]
) -> Bool[np.ndarray, " n_node"]:
    """Return which nodes are attached to slack elements only, [n_node] bool: no definite position.

    Slack are cables without tension, and open contacts and bearings. Nodes that supports hold, and
    inactive ones, do not count.

    Args:
        structure: `Structure`.
        state: `State`, `PhaseResult` or `Solution` with its results.
        fixed: degrees of freedom that supports fix in this state, [n_node, 3 or 6].
    """
    present = present_elements(structure, state.present)
    tensions = values_per_group(structure, state.tension)
    parts = zip(structure.groups, tensions, present, strict=True)
    taut = [there & ~slack_elements(group, force, there) for group, force, there in parts]
    known = structure.groups, structure.n_node, structure.rigid
    held = nodes_with_elements(*known, taut) | fixed[: structure.n_node, :3].all(axis=1)
    return nodes_with_elements(*known, present) & ~held


def slack_elements(
    group: Element,
    tension: Float[np.ndarray, " n_elem"] | None,
    present: Bool[np.ndarray, " n_elem"],
) -> Bool[np.ndarray, " n_elem"]:
    """Return which active elements of a group are slack: cables without tension, open contacts.

    What reports and pictures call slack, [n_elem] bool. An analysis asks the elements
    (`Element.is_slack`), whose forces are zero then.
    """
    if tension is None or not is_one_sided(group):
        return np.zeros(len(group.links), bool)
    return (tension >= 0 if group.compression_only else tension <= 0) & present


def count_and_names_of_slack_elements(
    structure: Structure, state: Any, most: int = 6
) -> tuple[int, str]:
    """Return how many elements are slack, and which: "stays 0, 4; ties 2 and 12 more", or "".

    `state` is a `State`, `PhaseResult` or `Solution`, `most` the largest number that is named.
    """
    tensions = values_per_group(structure, state.tension)
    masks = present_elements(structure, state.present)
    parts, left, count = [], most, 0
    for (name, group), tension, mask in zip(
        named_groups_of(structure), tensions, masks, strict=True
    ):
        slack = np.flatnonzero(slack_elements(group, tension, mask))
        count, shown = count + len(slack), slack[:left]
        left -= len(shown)
        if len(shown):
            parts.append(f"{name or 'elements'} {', '.join(map(str, shown))}")
    return count, "; ".join(parts) + f" and {count - most} more" * (count > most)


class ResultColumn(NamedTuple):
    """A table column: one number per element of a result, at one place and of one component.

    Attributes:
        label: name of the result, of its place if it has several, and of its component if it has
            some: ``membrane_forces xx``, ``bending 0 xx``.
        unit: of the numbers.
        values: for every group an array [n_elem], NumPy, or None; a list.
        place, component: in the element, and of the result; "" if there is only one.
    """

    label: str
    unit: str
    values: list[Float[np.ndarray, " n_elem"] | None]
    place: str = ""
    component: str = ""


def result_columns(
    groups: Sequence[Element | GroupTopology],
    by_name: Mapping[str, PyTree[Float[Array, "n_elem ..."]]],
) -> list[ResultColumn]:
    """Split results of elements into columns, one for every place and component.

    Section forces and strains at several positions along an element, which have tables and pictures
    of their own, are left out, and so are concentrated loads.

    Args:
        groups: element groups, or the parts of a `Topology`.
        by_name: results by name, each in the shape of the elements, as in `ElementResults`.

    Returns:
        List of `ResultColumn`.
    """
    every = [result for group in groups for result in group.results]
    results = {result.name: result for result in (TENSION, PEAK_TENSION, PRESENT, *every)}
    found = []
    for name, tree in by_name.items():
        result = results[name]
        values = jax.tree.leaves(tree, is_leaf=lambda x: x is None)
        values = [None if x is None else np.asarray(x) for x in values]
        if result == POINT_LOADS:  # loads
            continue
        if result in (SECTION_FORCES, SECTION_STRAIN):
            if any(x is not None and x.ndim > 1 for x in values):
                continue
        parts = [{} if x is None else _split_by_place_and_component(result, x) for x in values]
        # in the order of places, also where groups have different numbers of them
        for place, component in dict.fromkeys(key for part in parts for key in part):
            label = " ".join(word for word in (name, place, component) if word)
            own = [part.get((place, component)) for part in parts]
            found.append(ResultColumn(label, result.unit, own, place, component))
    return found


def _split_by_place_and_component(result, values):
    """Split a group's result [n_elem, ...] into a dict of arrays [n_elem] by (place, component).

    `result` describes it: names of places and components, "" where there is only one; places
    without a name are "0", "1" and so on.
    """
    components = result.components or ("",)
    count = math.prod(values.shape[1:]) // len(components)
    one = values.ndim == 1 + bool(result.components)
    places = ("",) if one else result.places or tuple(map(str, range(count)))
    values = values.reshape(len(values), count, len(components))
    names = ((place, component) for place in places for component in components)
    return {
        key: values[:, k // len(components), k % len(components)] for k, key in enumerate(names)
    }


def straight_pieces(
    groups: Sequence[Element | GroupTopology],
) -> tuple[Int[np.ndarray, "n_piece 2"], Int[np.ndarray, " n_piece"], Int[np.ndarray, " n_piece"]]:
    """Return the straight lines between nodes by which pictures draw all elements.

    Args:
        groups: element groups, or the parts of a `Topology`.

    Returns:
        ends: node numbers of the pieces, [n_piece, 2].
        element: number of the element of each piece, counted through all groups, [n_piece].
        group: number of the group of each piece, [n_piece].
    """
    ends, element, owner, count = [], [], [], 0
    for number, group in enumerate(groups):
        chain = group.links.array
        around = None if group.face is None else (*group.face, group.face[0])
        if (outline := group.outline or around) is not None:
            chain = chain[:, outline]
        pairs = np.stack([chain[:, :-1], chain[:, 1:]], axis=2)
        which = np.arange(count, count + len(chain))[:, None] + np.zeros_like(pairs[..., 0])
        real = pairs[..., 0] != pairs[..., 1]  # shorter chains are padded with their last node
        ends.append(pairs[real])
        element.append(which[real])
        owner.append(np.full(int(real.sum()), number))
        count += len(chain)
    return np.concatenate(ends), np.concatenate(element), np.concatenate(owner)


def element_faces(
    groups: Sequence[Element | GroupTopology],
) -> tuple[Int[np.ndarray, "n_face 4"], Int[np.ndarray, " n_face"], Int[np.ndarray, " n_face"]]:
    """Return the faces of all elements that have one.

    Args:
        groups: element groups, or the parts of a `Topology`.

    Returns:
        corners: node numbers in order around the faces, [n_face, 4]; triangles name their last node
            twice.
        element: number of the element of each face, counted through all groups, [n_face].
        group: number of the group of each face, [n_face].
    """
    corners, element, owner, count = [np.zeros((0, 4), int)], [], [], 0
    for number, group in enumerate(groups):
        if group.face is not None:
            corners.append(group.links.array[:, [*group.face, group.face[-1]][:4]])
            element += range(count, count + len(group.links))
            owner += [number] * len(group.links)
        count += len(group.links)
    return np.concatenate(corners), np.array(element, int), np.array(owner, int)


def end_nodes(group: Element | GroupTopology) -> Int[np.ndarray, "n_elem 2"]:
    """Return first and last node of every element of a group, [n_elem, 2]."""
    return group.links.array[:, [0, -1]]


def require_single_case(solution: Any) -> None:
    """Raise ValueError if `solution` is a batch, is being traced, or is no solution."""
    if not hasattr(solution, "status"):
        raise ValueError(f"solution: expected a Solution, got {type(solution).__name__}")
    if isinstance(solution.status, jax.core.Tracer):
        raise ValueError("solution: is being traced; call this outside of jit, vmap and grad")
    if np.ndim(solution.status) != 0:
        raise ValueError(
            "solution: is a batch; take one case k: jax.tree.map(lambda x: x[k], solution)"
        )
