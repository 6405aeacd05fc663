"""Values by group: one number for a structure, or values in the shape of its elements."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import jax
import numpy as np

from ..common import checks
from ..common.selection import Only, Selection, WholeGroups
from ..common.types import PyTree
from ..elements.abilities import component_names
from ..model.structure import Structure


def is_single_number(value: Any) -> bool:
    """Return whether a value that a user gives is one number for the whole structure."""
    leaf = jax.tree_util.treedef_is_leaf(jax.tree.structure(value))
    return leaf and not isinstance(value, dict | None) and np.ndim(value) == 0


def value_per_group(value: PyTree[Any], structure: Structure, name: str) -> list[Any]:
    """Assign values to the groups; return a list with one item per group, None if not given.

    Args:
        value: one number, or a pytree with the upper levels of the structure's elements (a prefix),
            such as a dict by group. Groups that a dict leaves out have None.
        structure: `Structure`.
        name: what messages call the value.

    Raises:
        ValueError: keys that no group has, or another shape.
    """
    if value is None or is_single_number(value):
        return [value] * len(structure.groups)
    numbers = structure.arrange(list(range(len(structure.groups))))
    value = _fill_missing_groups(value, numbers, name)
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
    label, numbers, value = _first_mismatch(name, numbers, value)
    phase_input = name.rpartition(".")[2].removeprefix("own['").removesuffix("']")
    known = [component_names(group, phase_input) for group in structure.groups]
    columns = [f"; {describe_columns(names)}" for names in known if names]
    expected = "one number, or numbers [n_elem] of the group"
    if not isinstance(numbers, int):
        expected = f"one number, or numbers by group: the structure has {_describe_tree(numbers)}"
    hint = "".join(dict.fromkeys(columns))
    raise ValueError(f"{label}: expected {expected}, got {_describe_tree(value)}{hint}")


def describe_columns(components: Sequence[str]) -> str:
    """Return in words what the columns of values [n_elem, n_component] are, for messages."""
    some = components if len(components) <= 4 else (components[0], "...", components[-1])
    return f"a row for each element and the columns {', '.join(some)}"


def _first_mismatch(label, numbers, value):
    """Find the first part of `value` that does not fit the tree of `numbers` (indices of groups).

    Returns:
        The part as a user writes it, the indices of groups there, and the value there.
    """
    if isinstance(numbers, dict) and isinstance(value, dict):
        for key, own in numbers.items():
            given = value.get(key)
            if isinstance(given, dict) or (isinstance(own, dict) and isinstance(given, list)):
                return _first_mismatch(f"{label}[{key!r}]", own, given)
    return label, numbers, value


def _fill_missing_groups(value, numbers, name):
    """Return `value` with None for groups that its dicts leave out; refuse unknown keys.

    Args:
        value: prefix pytree of the elements; its lists and tuples have all of their items.
        numbers: indices of the groups, in the shape of the elements.
        name: what messages call the value.
    """
    if type(numbers) is dict and isinstance(value, dict):
        for key in value:
            if key not in numbers:
                raise ValueError(
                    f"{name}: no group {key!r} in the structure's elements"
                    f"{checks.suggest_names(key, numbers)}"
                )
        return {
            key: _fill_missing_groups(value.get(key), own, name) for key, own in numbers.items()
        }
    if type(value) in (list, tuple) and type(value) is type(numbers) and len(value) == len(numbers):
        return type(value)(
            _fill_missing_groups(*pair, name) for pair in zip(value, numbers, strict=True)
        )
    rows = value if isinstance(numbers, int) and isinstance(value, list | tuple) else ()
    if rows and all(isinstance(row, list | tuple) for row in rows):
        return checks.as_floats(value, name)  # [n_elem, n_component]: no branch of the elements
    return value


def _describe_tree(tree):
    """Return the top level of a tree in words: names of groups, length of a list, or type."""
    if isinstance(tree, dict):
        return f"groups by name: {', '.join(map(repr, tree))}" if tree else "no group"
    if isinstance(tree, list | tuple):
        return f"a list of {len(tree)}"
    if isinstance(tree, int):
        return "one group without a name"
    shape = f" of shape {np.shape(tree)}" if isinstance(tree, np.ndarray | jax.Array) else ""
    return f"{type(tree).__name__}{shape}"
