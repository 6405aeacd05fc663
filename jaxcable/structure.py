"""Nodes, element groups and supports; host-side validation; freedom numbering."""

import functools

import jax
import numpy as np

from . import _check
from ._tree import Indices, pytree

N_FREEDOM = 3
"""Freedoms of a node that only bars and cables touch: three displacements."""


def is_group(x):
    """Whether `x` is an element group, a leaf of the `elements` pytree."""
    return hasattr(x, "links")


@pytree(indices=("mask", "nodes"))
class Supports:
    """Which freedoms are held.

    Args:
        mask: True where a freedom is fixed, [n_node, 3].
    """

    mask: object = None
    nodes: object = None

    def __post_init__(self):
        if (self.mask is None) == (self.nodes is None):
            raise ValueError("Supports: give a mask [n_node, 3]; for node numbers use pinned(...)")
        if self.nodes is not None and not isinstance(self.nodes, Indices):
            nodes = _check.integers(self.nodes, "pinned nodes")
            object.__setattr__(self, "nodes", Indices(nodes))
        if self.mask is not None and not isinstance(self.mask, Indices):
            mask = np.asarray(self.mask)
            if mask.dtype != bool or mask.ndim != 2 or mask.shape[1] != N_FREEDOM:
                raise ValueError(
                    f"supports mask: expected booleans [n_node, {N_FREEDOM}], "
                    f"got {mask.dtype} {mask.shape}"
                )
            object.__setattr__(self, "mask", Indices(mask))

    def fixed(self, n_node):
        """True where a freedom is fixed, [n_node, 3], NumPy."""
        if self.mask is not None:
            if self.mask.shape[0] != n_node:
                raise ValueError(
                    f"supports mask: has {self.mask.shape[0]} rows, the structure {n_node} nodes"
                )
            return self.mask.array
        unknown = self.nodes.array >= n_node
        if unknown.any():
            k = int(unknown.argmax())
            raise ValueError(
                f"pinned nodes[{k}] = {self.nodes[k]}: the structure has nodes 0 to {n_node - 1}"
            )
        fixed = np.zeros((n_node, N_FREEDOM), bool)
        fixed[self.nodes.array] = True
        return fixed


def pinned(nodes):
    """Supports that hold the position of the given nodes, node numbers [n]."""
    return Supports(nodes=nodes)


@pytree
class Structure:
    """A structure: initial geometry, element groups, supports.

    Args:
        nodes: initial positions, [n_node, 3], m.
        elements: one group (`Cables`, `Bars`, ...) or any pytree of groups; results per element
            come back in its shape.
        supports: `pinned(...)` or `Supports(mask)`.

    Raises:
        ValueError: wrong shapes, unknown nodes, zero-length elements, no supports, or a free node
            that no element touches; names the argument and the index.
    """

    nodes: object
    elements: object
    supports: Supports = None

    def __post_init__(self):
        nodes = _check.floats(self.nodes, "nodes")
        if nodes.ndim != 2 or nodes.shape[1] != 3:
            raise ValueError(f"nodes: expected shape [n_node, 3], got {nodes.shape}")
        object.__setattr__(self, "nodes", nodes)
        if not isinstance(self.supports, Supports):
            raise ValueError(
                "supports: missing; a structure needs supports=pinned(nodes) or Supports(mask)"
            )
        for where, group in self._named_groups():
            if not is_group(group):
                raise ValueError(f"elements{where}: {type(group).__name__} is not an element group")
            unknown = (group.links.array >= len(nodes)).any(axis=1)
            if unknown.any():
                k = int(unknown.argmax())
                raise ValueError(
                    f"elements{where}.links[{k}] = {group.links[k].tolist()}: "
                    f"the structure has nodes 0 to {len(nodes) - 1}"
                )
            positions = _check.concrete(nodes)
            if positions is not None:
                ends = positions[group.links.array]
                zero = (ends[:, 0] == ends[:, -1]).all(axis=-1)
                if zero.any():
                    k = int(zero.argmax())
                    raise ValueError(
                        f"elements{where}.links[{k}] = {group.links[k].tolist()}: zero length; "
                        "its two nodes coincide"
                    )
        if not self.groups:
            raise ValueError("elements: a structure needs at least one element group")
        self.fixed(self.supports)

    def _named_groups(self):
        leaves = jax.tree_util.tree_leaves_with_path(self.elements, is_leaf=is_group)
        return [(jax.tree_util.keystr(path), group) for path, group in leaves]

    @property
    def groups(self):
        """The element groups, a list in pytree order."""
        return jax.tree.leaves(self.elements, is_leaf=is_group)

    @property
    def n_node(self):
        """Number of nodes."""
        return self.nodes.shape[0]

    def arrange(self, per_group):
        """Put a list with one item per group into the shape of `elements`."""
        return jax.tree.unflatten(jax.tree.structure(self.elements, is_leaf=is_group), per_group)

    def fixed(self, supports):
        """Fixed freedoms under `supports`, [n_node, 3] bool; checks that the set makes sense."""
        fixed = supports.fixed(self.n_node)
        if not fixed.any():
            raise ValueError("supports: no freedom is fixed; the structure would float away")
        touched = np.zeros(self.n_node, bool)
        for group in self.groups:
            touched[group.links.array] = True
        idle = ~touched & ~fixed.all(axis=1)
        if idle.any():
            raise ValueError(
                f"nodes[{int(idle.argmax())}]: no element touches this node and it is not "
                "supported; connect it, support it or remove it"
            )
        return fixed


@pytree
class Freedoms:
    """Numbering of the unknowns of a phase; the only freedoms that are solved for.

    Attributes:
        free: free freedoms as flat numbers 3 node + direction, [n_free].
        source: where each freedom finds its value in (unknowns, held values), [3 n_node].
        number: unknown's number, or n_free for a held freedom, [n_node, 3].
        fixed: True where held, [n_node, 3].
    """

    free: object
    source: object
    number: object
    fixed: object


@functools.lru_cache(maxsize=64)
def number_freedoms(fixed):
    """Number the free freedoms of `fixed` (an `Indices` of booleans [n_node, 3])."""
    mask = fixed.array
    free = np.flatnonzero(~mask.ravel()).astype(np.int32)
    n_free = len(free)
    number = np.full(mask.size, n_free, np.int32)
    number[free] = np.arange(n_free, dtype=np.int32)
    source = np.where(mask.ravel(), n_free + np.arange(mask.size), number).astype(np.int32)
    return Freedoms(free, source, number.reshape(mask.shape), mask)
