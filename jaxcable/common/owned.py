"""Arrays and containers that an object owns: what its user does with his own changes nothing.

An array that is shared with a user can change after it has been checked, and what was worked out
from it does not follow. Objects therefore keep copies, which nobody can write to: an attempt is
NumPy's error instead of half a change.
"""

from __future__ import annotations

from typing import Any

import jax
import numpy as np

_IMMUTABLE = (type(None), bool, int, float, complex, str, bytes, jax.Array, np.generic)


def owned_copy(value: Any, is_owner: type | tuple[type, ...] = ()) -> Any:
    """Copy the NumPy arrays, lists and dicts in a pytree; the copied arrays are read-only.

    Arrays of jax, and NumPy arrays that are read-only already, are returned without a copy.

    Args:
        value: array, number, or pytree.
        is_owner: classes whose objects have copied their contents before; they are not copied.
    """
    kind = type(value)
    if kind is np.ndarray:
        return value if _is_read_only(value) else _read_only_copy(value)
    if isinstance(value, _IMMUTABLE) or hasattr(kind, "_all_fields") or isinstance(value, is_owner):
        return value
    if kind is dict:
        return {key: owned_copy(item, is_owner) for key, item in value.items()}
    if kind is list or kind is tuple:
        return kind([owned_copy(item, is_owner) for item in value])
    if isinstance(value, np.ndarray):  # a subclass, such as a file in memory
        return _read_only_copy(value)
    leaves, tree = jax.tree.flatten(value, is_leaf=lambda x: x is not value)
    if len(leaves) == 1 and leaves[0] is value:
        return value
    return jax.tree.unflatten(tree, [owned_copy(leaf, is_owner) for leaf in leaves])


def _is_read_only(array):
    """Tell whether an array, and every array that it is a view of, is read-only."""
    while type(array) is np.ndarray and not array.flags.writeable:
        if array.base is None:
            return True
        array = array.base
    return False


def _read_only_copy(array):
    """Return a read-only copy of an array."""
    array = np.array(array)
    array.setflags(write=False)
    return array
