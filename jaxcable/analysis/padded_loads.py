"""Loads of a padded analysis (`common_sizes`): on bundles, with padded faces."""

from __future__ import annotations

from collections.abc import Iterable
from typing import Any

import jax
import numpy as np

from ..common.tree import copy_with
from ..loads.faces import OnFaces
from ..mechanics.bundles import Bundles
from ..mechanics.load_stacks import LoadStack
from .padding import common_size, fill, repeat_last


def pad_faces(stacks: Iterable[LoadStack], arrays: list[Any], node: int) -> dict[int, np.ndarray]:
    """Return the padded faces of loads, by their numbers among the index `arrays`.

    All corners of a face that is added are one `node`: it has no area.
    """
    found = {}
    loads: list[Any] = [stack.load for stack in stacks]
    slots = [own.faces for own in loads if _is_on_faces(own)]
    for slot in slots:
        own = arrays[slot.number]
        found[slot.number] = fill(own, common_size(len(own)), 0, node)
    return found


def _is_on_faces(acting):
    """Return whether a load has faces of its own, not those of element groups."""
    return isinstance(acting, OnFaces) and acting.faces is not None


def pad_loads(
    stacks: list[LoadStack], bundles: Bundles, elements: tuple[int, ...]
) -> list[LoadStack]:
    """Return every `LoadStack` on bundles of so many elements, whose factors are zero if added.

    Forces of faces that are added (`pad_faces`) are those of the last one.
    """
    padded = []
    stack: Any
    for stack in stacks:
        if not bundles.are_groups:
            stack = _load_on_bundles(stack, bundles)
        if _is_on_faces(stack.load) and np.ndim(stack.load.forces) == 3:
            forces = stack.load.forces  # of each face
            forces = repeat_last(forces, common_size(np.shape(forces)[1]), axis=1)
            stack = copy_with(stack, load=copy_with(stack.load, forces=forces))
        factors = stack.load.element_factors
        if factors is not None:
            larger = {k: fill(own, elements[k], 1, 0.0) for k, own in factors.items()}
            stack = copy_with(stack, load=copy_with(stack.load, element_factors=larger))
        padded.append(stack)
    return padded


def _load_on_bundles(stack, bundles):
    """Return a `LoadStack` with loads on bundles in place of groups, by NumPy."""
    leaves, tree = jax.tree.flatten(stack.load)
    each = [
        jax.tree.unflatten(tree, [np.asarray(x)[k] for x in leaves]).on_bundles(bundles)
        for k in range(len(stack.phase))
    ]
    return copy_with(stack, load=jax.tree.map(lambda *parts: np.stack(parts), *each))
