"""Values by group: one number for a structure, or values in the shape of its elements."""

from __future__ import annotations

from typing import Any

import jax
import numpy as np

from ..common import checks
from ..common.selection import Only, Selection, WholeGroups
from ..common.types import PyTree
from ..elements.abilities import components_of
from ..model.structure import Structure


def is_scalar(value: Any) -> bool:
    """Whether a statement is one number for the whole structure."""
    leaf = jax.tree_util.treedef_is_leaf(jax.tree.structure(value))
    return leaf and not isinstance(value, dict | None) and np.ndim(value) == 0


def spread(value: PyTree[Any], structure: Structure, name: str) -> list[Any]:
    """A prefix pytree of the elements as a list with one entry per group, None if not stated.

    Groups that a dict leaves out have no entry.

    Raises:
        ValueError: keys that no group has, or another shape.
    """
    if value is None or is_scalar(value):
        return [value] * len(structure.groups)
    numbers = structure.arrange(list(range(len(structure.groups))))
    value = _filled(value, numbers, name)
    if isinstance(numbers, int) and isinstance(value, list | tuple):
        return [value]  # the values of the only group

    def is_values(x):
        return isinstance(x, list | tuple) and not any(
            isinstance(v, list | tuple | dict | Only | Selection) for v in x
        )

    def is_one(x):
        return x is None or isinstance(x, WholeGroups | Only | Selection)

    # a list is first taken as a branch of the tree of groups, then as the values of one group
    for is_leaf in (is_one, lambda x: is_one(x) or is_values(x)):
        values = [None] * len(structure.groups)

        def assign(v, subtree, values=values):
            for number in jax.tree.leaves(subtree):
                values[number] = v

        try:
            jax.tree.map(assign, value, numbers, is_leaf=is_leaf)
        except (ValueError, TypeError, KeyError):
            continue
        return values
    known = [components_of(group, name) for group in structure.groups]
    columns = [
        f"; components are the columns of [n_elem, {len(names)}]: {', '.join(names)}"
        for names in known
        if names
    ]
    raise ValueError(
        f"{name}: expected one number, numbers [n_elem] of the only group, or these by group: "
        f"the structure has {_told(numbers)}, got {_told(value)}{''.join(dict.fromkeys(columns))}"
    )


def _filled(value, numbers, name):
    """`value` with nothing for the groups that its dicts leave out; ValueError for unknown keys.

    Args:
        value: prefix pytree of the elements; its lists and tuples have all of their items.
        numbers: numbers of the groups, in the shape of the elements.
        name: of what is stated, for messages.
    """
    if type(numbers) is dict and isinstance(value, dict):
        for key in value:
            if key not in numbers:
                raise ValueError(
                    f"{name}: no group {key!r} in the structure's elements"
                    f"{checks.suggest_names(key, numbers)}"
                )
        return {key: _filled(value.get(key), own, name) for key, own in numbers.items()}
    if type(value) in (list, tuple) and type(value) is type(numbers) and len(value) == len(numbers):
        return type(value)(_filled(*pair, name) for pair in zip(value, numbers, strict=True))
    return value


def _told(tree):
    """What a tree is at its top, in words."""
    if isinstance(tree, dict):
        return f"groups by name: {', '.join(map(repr, tree))}" if tree else "no group"
    if isinstance(tree, list | tuple):
        return f"a list of {len(tree)}"
    if isinstance(tree, int):
        return "one group without a name"
    shape = f" of shape {np.shape(tree)}" if isinstance(tree, np.ndarray | jax.Array) else ""
    return f"{type(tree).__name__}{shape}"
