"""Forces of all elements at one instant, and the values that colour them."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import jax
import numpy as np

from .. import design
from ..common.types import Float
from ..elements.element import PRESENT, Element
from ..model.parts import Column, columns, slack_cables
from ..model.structure import Structure
from ..model.topology import Part

_NOTHING = 1e-9  # compression over the largest force up to which it is rounding


class Forces:
    """Forces of all elements at one instant, group after group, and the values that colour them.

    Args:
        told: what elements tell, by name, each in the shape of the elements, as of `Results.told`.
        parts: element groups, or the parts of a `Topology`.
        structure: `Structure`, or None; it says which elements are cables.
        colour: "tension", "utilisation", or the label of another `parts.Column`.

    Attributes:
        tension: axial forces of all elements, [n_elem], N; NaN for groups without them.
        present: which elements are there, [n_elem] bool.
        slack, compressed: which elements are slack, and which in compression, [n_elem] bool.
        value: values that colour the elements, [n_elem]; NaN where they are not known.
        colour, unit: name and unit of these values.

    Raises:
        ValueError: the colour is "utilisation", and there is no structure, or no strength.
    """

    def __init__(
        self,
        told: Mapping[str, Any],
        parts: Sequence[Element | Part],
        structure: Structure | None = None,
        colour: str = "tension",
    ):
        self.tension = joined(told.get("tension"), parts)
        self.present = joined(told.get(PRESENT.name), parts, 1.0) > 0
        self.slack = self.present & (self.tension == 0.0)
        if structure is not None:
            ends = np.cumsum([len(part.links.array) for part in parts])[:-1]
            own = (np.split(values, ends) for values in (self.tension, self.present))
            found = zip(structure.groups, *own, strict=True)
            self.slack = np.concatenate([slack_cables(*each) for each in found])
        largest = np.nanmax(np.abs(self.tension), initial=0.0)
        self.compressed = ~self.slack & (self.tension < -_NOTHING * largest)
        if colour == "utilisation":
            column = _utilisation(structure, told)
        else:
            labelled = {each.label: each for each in columns(parts, told)}
            column = labelled.get(colour, Column(colour, "N", [None] * len(parts)))
        self.value = np.where(self.present, joined(column.values, parts), np.nan)
        self.colour, self.unit = colour, column.unit


def results(
    told: Mapping[str, Any], parts: Sequence[Element | Part], structure: Structure | None
) -> list[Column]:
    """Results of all elements, see `columns`, with utilisation and the largest moments of beams."""
    found = columns(parts, {name: tree for name, tree in told.items() if name != PRESENT.name})
    if structure is not None:
        try:
            found.append(_utilisation(structure, told))
        except ValueError:  # no group has a strength
            pass
    forces = leaves(told.get("section_forces"), len(parts))
    if any(values is not None for values in forces):
        for k, name in ((4, "My"), (5, "Mz")):
            most = [None if x is None else _extreme(np.asarray(x)[..., k]) for x in forces]
            found.append(Column(f"largest {name}", "N m", most))
    return found


def leaves(tree: Any, count: int) -> list[Any]:
    """What a pytree in the shape of the elements has for every group, arrays or None; a list."""
    return [None] * count if tree is None else jax.tree.leaves(tree, is_leaf=lambda x: x is None)


def joined(
    tree: Any, parts: Sequence[Element | Part], otherwise: float = np.nan
) -> Float[np.ndarray, " n_elem"]:
    """Values of all groups, group after group, [n_elem].

    Args:
        tree: arrays in the shape of the elements, or None.
        parts: element groups, or the parts of a `Topology`.
        otherwise: value of groups that have None.
    """
    pairs = zip(leaves(tree, len(parts)), parts, strict=True)
    return np.concatenate(
        [
            np.full(len(part.links.array), otherwise) if x is None else np.asarray(x, float)
            for x, part in pairs
        ]
    )


def _utilisation(structure, told):
    """Utilisation as a `Column`; ValueError without a structure, or if no group has a strength."""
    if structure is None:
        raise ValueError('structure: needed for colour = "utilisation"; the strengths are in it')
    used = design.utilization(structure, told.get("peak_tension", told.get("tension")))
    return Column("utilisation", "-", leaves(used, len(structure.groups)))


def _extreme(values):
    """The number of largest size in each row [n_elem, n_point], with its sign, [n_elem]."""
    at = np.abs(values).argmax(axis=1)
    return np.take_along_axis(values, at[:, None], axis=1)[:, 0]
