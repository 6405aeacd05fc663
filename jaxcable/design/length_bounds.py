"""Default bounds of the lengths that `tune` varies: no element changes by more than its length."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from ..analysis.phase_inputs import values_of_elements
from ..common import checks
from ..common.tree import copy_with
from ..common.types import ArrayLike, Float, PyTree
from ..elements.abilities import component_names
from ..model.plausibility import array_or_none, drawn_or_given_lengths
from ..model.structure import Structure
from .bounds import BoxBounds, entry_names, flat_vector, unflatten_params

_RANGES = {
    "shortening": (-1.0, 1.0),
    "rest_length": (0.0, 2.0),
    "sag": (0.0, 1.0),
    "built_sag": (0.0, 1.0),
    "prestrain": (-0.5, 1.0),
}
"""Allowed range of each length, over the length of the element; a prestrain is a ratio itself."""
_DEFAULT = (
    "the default bound, the length of the element, which is more than a turnbuckle can do; what "
    "hangs slack may act as ballast. Give `bounds`, other targets or further unknowns"
)


def add_default_bounds(
    box: BoxBounds,
    structure: Structure,
    unknowns: Sequence[tuple[int, str]],
    values: list[PyTree[Float[ArrayLike, " ..."]]],
) -> BoxBounds:
    """Return bounds of the unknowns of `tune` with default ones where `box` has none.

    The start is always within the default bounds: they are moved to it where it is outside. There
    are none where nodes or unstressed lengths are traced.
    """
    start, nodes = flat_vector(values), array_or_none(structure.nodes)
    low, high = np.full(start.size, -np.inf), np.full(start.size, np.inf)
    numbers = unflatten_params(np.arange(start.size), values)
    for (_, name), given in zip(unknowns, numbers, strict=True):
        if name not in _RANGES or nodes is None:
            continue
        expanded = values_of_elements(given, structure, name)
        for group, stated in zip(structure.groups, expanded, strict=True):
            if stated is None or component_names(group, name):
                continue
            # a number for several elements keeps to the bounds of the shortest
            own = drawn_or_given_lengths(group, nodes) if name != "prestrain" else 1.0
            mask, own = stated.element_mask(), np.broadcast_to(own, len(group.links))
            which = np.asarray(stated.values).astype(int)[mask]
            np.maximum.at(low, which, _RANGES[name][0] * own[mask])
            np.minimum.at(high, which, _RANGES[name][1] * own[mask])
    xp = checks.numpy_or_jax((box, start))
    lower = xp.where(box.lower == -np.inf, xp.minimum(low, start), box.lower)
    upper = xp.where(box.upper == np.inf, xp.maximum(high, start), box.upper)
    return copy_with(box, lower=lower, upper=upper)


def describe_bounds_reached(
    unknowns: Sequence[tuple[int, str]],
    values: list[PyTree[Float[ArrayLike, " ..."]]],
    asked: BoxBounds,
    used: BoxBounds,
) -> tuple[tuple[str, ...], tuple[str, ...]]:
    """Describe unknowns that end at a default bound, and those at a bound of the user.

    Both are a tuple of one sentence, or of none.

    Args:
        unknowns, values: as of `tune`; at their end.
        asked, used: bounds of the user, and those with default ones. Nothing is said where numbers
            are traced.
    """
    if checks.numpy_or_jax((values, asked, used)) is not np:
        return (), ()
    x, low, high = (np.asarray(v) for v in (flat_vector(values), used.lower, used.upper))
    by_default = (x <= low) & (asked.lower < low) | (x >= high) & (asked.upper > high)
    given = ((x <= low) | (x >= high)) & ~by_default
    sizes = [flat_vector(own).size for own in values]
    places = np.repeat(np.arange(len(sizes)), sizes)

    def sentence(mask, text):
        if not mask.any():
            return ()
        first, more = int(mask.argmax()), int(mask.sum()) - 1
        where = f"unknowns{entry_names(values)[first]} ({unknowns[places[first]][1]})"
        return (f"{where} = {x[first]:.6g}{f' and {more} more' * (more > 0)}: at {text}",)

    return sentence(by_default, _DEFAULT), sentence(given, "a bound that was given")
