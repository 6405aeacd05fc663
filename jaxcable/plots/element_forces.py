"""Forces of all elements at one instant, and the values that color the elements."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any, NamedTuple

import jax
import numpy as np

from .. import design
from ..common.negligible import NEGLIGIBLE
from ..common.types import Float, Int
from ..elements.element import PRESENT, Element
from ..elements.friction_state import SEGMENT_TENSION
from ..elements.sliding_catenaries import SEGMENT_PULL
from ..model.result_parts import ResultColumn, result_columns, slack_elements, straight_pieces
from ..model.structure import Structure
from ..model.topology import GroupTopology

_PLACES = 12
"""Places in an element up to which the page shows a result there."""


class ColoredValues(NamedTuple):
    """Values that color elements of an envelope, or pieces of elements.

    Attributes:
        value: values of all elements (or pieces), [n_elem], SI; NaN where they are not known.
        color, unit: name and SI unit of these values.
        group: index of the group of each element, [n_elem].
        labels: names of the groups.
    """

    value: Float[np.ndarray, " n_elem"]
    color: str
    unit: str
    group: Int[np.ndarray, " n_elem"]
    labels: list[str]


class ElementForces:
    """Forces of all elements at one instant, group after group, and the values that color them.

    Args:
        element_results: results of elements by name, each in the shape of the elements, as in
            `StateResults.element_results`.
        parts: the parts of a `Topology`.
        structure: `Structure`, or None; it says which elements are cables.
        color: "tension", "utilization", or the label of another `parts.ResultColumn`.

    Attributes:
        tension: axial forces of all elements, [n_elem], N; NaN for groups without them.
        present: which elements are active, [n_elem] bool.
        slack, compressed: which elements are slack, and which in compression, [n_elem] bool.
        value: values that color the elements, [n_elem]; NaN where they are not known.
        color, unit: name and unit of these values.
        group, labels: index of the group of each element, [n_elem], and what each group is called.
        segment_tension: tensions of the segments of cables with friction, N, in an array of all
            straight pieces, [n_piece], with NaN for other pieces; None without such cables.
        segments: `ColoredValues` of these pieces, if tension is the color; else None.

    Raises:
        ValueError: the color is "utilization", and there is no structure, or no strength.
    """

    def __init__(
        self,
        element_results: Mapping[str, Any],
        parts: Sequence[GroupTopology],
        structure: Structure | None = None,
        color: str = "tension",
    ):
        self.tension = concatenate_values(element_results.get("tension"), parts)
        self.present = concatenate_values(element_results.get(PRESENT.name), parts, 1.0) > 0
        self.slack = self.present & (self.tension == 0.0)
        if structure is not None:
            ends = np.cumsum([len(part.links.array) for part in parts])[:-1]
            own = (np.split(values, ends) for values in (self.tension, self.present))
            found = zip(structure.groups, *own, strict=True)
            self.slack = np.concatenate([slack_elements(*each) for each in found])
        largest = np.nanmax(np.abs(self.tension), initial=0.0)
        self.compressed = ~self.slack & (self.tension < -NEGLIGIBLE * largest)
        if color == "utilization":
            column = _utilization_column(structure, element_results)
        else:
            labelled = {each.label: each for each in result_columns(parts, element_results)}
            column = labelled.get(color, ResultColumn(color, "N", [None] * len(parts)))
        self.value = np.where(self.present, concatenate_values(column.values, parts), np.nan)
        self.color, self.unit = color, column.unit
        self.group = np.repeat(np.arange(len(parts)), [len(part.links.array) for part in parts])
        self.labels = [part.name.strip("[]'") for part in parts]
        self.segment_tension = self.segments = None
        tensions = values_by_group(element_results.get(SEGMENT_TENSION.name), len(parts))
        if any(own is not None for own in tensions):
            _, element, owner = straight_pieces(parts)
            of_pieces = np.full(len(owner), np.nan)
            for k, tension in enumerate(tensions):
                if tension is not None:
                    links = parts[k].links.array
                    of_pieces[owner == k] = np.asarray(tension)[links[:, 1:] != links[:, :-1]]
            of_pieces[~self.present[element]] = np.nan
            self.segment_tension = of_pieces
            if color == "tension":
                self.segments = ColoredValues(of_pieces, color, self.unit, owner, self.labels)


def all_result_columns(
    element_results: Mapping[str, Any],
    parts: Sequence[Element | GroupTopology],
    structure: Structure | None,
) -> list[ResultColumn]:
    """Return the results of all elements as `ResultColumn`s, a list.

    It has the utilization, if breaking forces are known, and the largest moments of beams. Results
    at very many places, such as the deviators of a tendon, are left out, and so are the tensions of
    segments, which pieces have, and the forces of hanging segments on their nodes.
    """
    left_out = [PRESENT.name, SEGMENT_TENSION.name, SEGMENT_PULL.name]
    for name, tree in element_results.items():
        if any(np.shape(x)[1:2] > (_PLACES,) for x in jax.tree.leaves(tree)):
            left_out.append(name)
    shown = {name: tree for name, tree in element_results.items() if name not in left_out}
    found = result_columns(parts, shown)
    if structure is not None:
        try:
            found.append(_utilization_column(structure, element_results))
        except ValueError:  # no group has a strength
            pass
    forces = values_by_group(element_results.get("section_forces"), len(parts))
    if any(values is not None for values in forces):
        for k, name in ((4, "My"), (5, "Mz")):
            most = [
                None if x is None else _value_of_largest_size(np.asarray(x)[..., k]) for x in forces
            ]
            found.append(ResultColumn(f"largest {name}", "N m", most))
    return found


def values_by_group(tree: Any, count: int) -> list[Any]:
    """Return the leaves of a pytree, arrays or None by group, as a list of length `count`.

    A tree that is None gives None for each group.
    """
    return [None] * count if tree is None else jax.tree.leaves(tree, is_leaf=lambda x: x is None)


def concatenate_values(
    tree: Any, parts: Sequence[Element | GroupTopology], otherwise: float = np.nan
) -> Float[np.ndarray, " n_elem"]:
    """Concatenate the values of all groups, [n_elem].

    Args:
        tree: pytree of arrays [n_elem] of each group, or None.
        parts: element groups, or the parts of a `Topology`.
        otherwise: value of the elements of groups that have None.
    """
    pairs = zip(values_by_group(tree, len(parts)), parts, strict=True)
    return np.concatenate(
        [
            np.full(len(part.links.array), otherwise) if x is None else np.asarray(x, float)
            for x, part in pairs
        ]
    )


def _utilization_column(structure, element_results):
    """Return the utilization of all elements, force over breaking force, as a `ResultColumn`.

    Raise ValueError without a structure, or if it has no breaking forces.
    """
    if structure is None:
        raise ValueError(
            'structure: needed for color = "utilization", which the breaking forces in it give'
        )
    force = element_results.get("peak_tension", element_results.get("tension"))
    used = design.utilization(structure, force)
    return ResultColumn("utilization", "-", values_by_group(used, len(structure.groups)))


def _value_of_largest_size(values):
    """Return the value of largest magnitude, with its sign, of each row of [n_elem, n_point]."""
    at = np.abs(values).argmax(axis=1)
    return np.take_along_axis(values, at[:, None], axis=1)[:, 0]
