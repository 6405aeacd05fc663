"""A structure and its results in parts: groups by name, values per group, straight pieces."""

import jax
import numpy as np

from .structure import is_group


def groups_by_name(structure):
    """Pairs (name, group); the name is the key in the structure's elements, "" of a single one."""
    leaves = jax.tree_util.tree_leaves_with_path(structure.elements, is_leaf=is_group)
    return [(".".join(_word(key) for key in path), group) for path, group in leaves]


def _word(key):
    return str(getattr(key, "key", getattr(key, "idx", getattr(key, "name", key))))


def per_group(structure, values):
    """Values in the shape of the elements as a list of NumPy arrays or None, one per group."""
    numbers = structure.arrange(list(range(len(structure.groups))))
    found = [None] * len(structure.groups)

    def put(number, value):
        found[number] = None if value is None else np.asarray(value)

    jax.tree.map(put, numbers, values, is_leaf=lambda x: x is None)
    return found


def pieces(links):
    """Straight pieces of all elements.

    Args:
        links: node numbers per group, `Indices` [n_elem, n_end], as of a `Solution`.

    Returns:
        ends: their node numbers, [n_piece, 2].
        element: number of their element, counted through all groups, [n_piece].
        group: number of their group, [n_piece].
    """
    ends, element, owner, count = [], [], [], 0
    for number, own in enumerate(links):
        chain = own.array
        pairs = np.stack([chain[:, :-1], chain[:, 1:]], axis=2)
        which = np.arange(count, count + len(chain))[:, None] + np.zeros_like(pairs[..., 0])
        real = pairs[..., 0] != pairs[..., 1]  # chains are filled up with their last node
        ends.append(pairs[real])
        element.append(which[real])
        owner.append(np.full(int(real.sum()), number))
        count += len(chain)
    return np.concatenate(ends), np.concatenate(element), np.concatenate(owner)


def first_and_last(group):
    """First and last node of every element of a group, [n_elem, 2]."""
    return group.links.array[:, [0, -1]]


def one_case(solution):
    """Raise ValueError if `solution` is none, a batch, or is being traced."""
    if not hasattr(solution, "status"):
        raise ValueError(f"solution: expected a Solution, got {type(solution).__name__}")
    if isinstance(solution.status, jax.core.Tracer):
        raise ValueError("solution: is being traced; write files outside of jit")
    if np.ndim(solution.status) != 0:
        raise ValueError(
            "solution: is a batch; take one case: jax.tree.map(lambda x: x[k], solution)"
        )
