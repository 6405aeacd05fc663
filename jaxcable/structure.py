"""Nodes, element groups and supports; host-side validation; freedom numbering."""

import functools

import jax
import numpy as np
from scipy import sparse

from . import _check, linear, plausibility
from ._tree import Indices, copy, pytree

N_FREEDOM = 3
"""Freedoms of a node in a structure of bars and cables: three displacements."""


def is_group(x):
    """Whether `x` is an element group, a leaf of the `elements` pytree."""
    return hasattr(x, "links")


@pytree(indices=("mask", "nodes", "clamps"))
class Supports:
    """Which freedoms are held; `pinned` and `clamped` make them from node numbers, ``+`` joins.

    Of a node's three rotations none, two (a hinge about the third axis) or all can be held: what
    one held component alone means would depend on the way that led there.

    Args:
        mask: True where a freedom is fixed, [n_node, 3] displacements, or [n_node, 6] with
            rotations about x, y, z.
        nodes: nodes whose position is held, [n].
        clamps: nodes whose position and rotation are held, [n].

    Raises:
        ValueError: nothing given, a mask of the wrong shape or type; in a structure, unknown nodes
            or one rotation held alone.

    Example:
        >>> mask = np.zeros((3, 3), bool)
        >>> mask[:, 1] = True  # all nodes held in the plane y = 0
        >>> (jc.pinned([0, 2]) + jc.Supports(mask)).fixed(3)[1, :3]
        array([False,  True, False])
    """

    mask: object = None
    nodes: object = None
    clamps: object = None

    def __post_init__(self):
        if self.mask is None and self.nodes is None and self.clamps is None:
            raise ValueError("Supports: give a mask [n_node, 3]; for node numbers use pinned(...)")
        for name in ("nodes", "clamps"):
            value = getattr(self, name)
            if value is not None and not isinstance(value, Indices):
                value = _check.integers(
                    value, {"nodes": "pinned", "clamps": "clamped"}[name] + " nodes"
                )
                object.__setattr__(self, name, Indices(value))
        if self.mask is not None and not isinstance(self.mask, Indices):
            mask = np.asarray(self.mask)
            if mask.dtype != bool or mask.ndim != 2 or mask.shape[1] not in (N_FREEDOM, 6):
                raise ValueError(
                    f"supports mask: expected booleans [n_node, {N_FREEDOM}] or [n_node, 6], "
                    f"got {mask.dtype} {mask.shape}; for node numbers use pinned(nodes)"
                )
            object.__setattr__(self, "mask", Indices(mask))

    def __add__(self, other):
        if not isinstance(other, Supports):
            return NotImplemented
        joined = {}
        for name in ("nodes", "clamps"):
            parts = [getattr(s, name) for s in (self, other) if getattr(s, name) is not None]
            joined[name] = np.concatenate([p.array for p in parts]) if parts else None
        masks = [s.mask.array for s in (self, other) if s.mask is not None]
        if len(masks) == 2:
            if len(masks[0]) != len(masks[1]):
                raise ValueError(
                    f"supports: masks of {len(masks[0])} and {len(masks[1])} nodes cannot be joined"
                )
            masks = [np.pad(m, ((0, 0), (0, 6 - m.shape[1]))) for m in masks]
            masks = [masks[0] | masks[1]]
        return Supports(mask=masks[0] if masks else None, **joined)

    def fixed(self, n_node):
        """True where a freedom is fixed, [n_node, 6], NumPy."""
        fixed = np.zeros((n_node, 6), bool)
        if self.mask is not None:
            if self.mask.shape[0] != n_node:
                raise ValueError(
                    f"supports mask: has {self.mask.shape[0]} rows, the structure {n_node} nodes"
                )
            fixed[:, : self.mask.shape[1]] = self.mask.array
        for name, nodes, width in (("pinned", self.nodes, 3), ("clamped", self.clamps, 6)):
            if nodes is None:
                continue
            _check.known(nodes.array, n_node, f"{name} nodes")
            fixed[nodes.array, :width] = True
        return fixed


def pinned(nodes):
    """Supports that hold the position of the given nodes, node numbers [n].

    Example:
        >>> jc.pinned([0, 2]).fixed(3)[:, :3].all(axis=1)
        array([ True, False,  True])
    """
    return Supports(nodes=nodes)


def clamped(nodes):
    """Supports that hold position and rotation of the given nodes, node numbers [n].

    Example:
        >>> jc.clamped([0]).fixed(2).all(axis=1)
        array([ True, False])
        >>> (jc.clamped([0]) + jc.pinned([1])).fixed(2).sum(axis=1)
        array([6, 3])
    """
    return Supports(clamps=nodes)


@pytree
class Structure:
    """A structure: initial geometry, element groups, supports.

    Args:
        nodes: initial positions, [n_node, 3], m.
        elements: one group (`Cables`, `Bars`, ...) or any pytree of groups; results per element
            come back in its shape.
        supports: `pinned(...)` or `Supports(mask)`.

    Raises:
        ValueError: wrong shapes, unknown nodes, zero-length elements, no supports, a part
            without any, or a free node that no element touches; names the argument and the index.

    Example:
        >>> nodes = [[-4.0, 0.0, 3.0], [0.0, 0.0, 0.0], [4.0, 0.0, 3.0]]  # m
        >>> cables = jc.Cables([[0, 1], [1, 2]], axial_stiffness=1e5)  # N
        >>> structure = jc.Structure(nodes, cables, supports=jc.pinned([0, 2]))
        >>> structure.n_node
        3
        >>> try:
        ...     jc.Structure(nodes, cables, supports=jc.pinned([0, 3]))
        ... except ValueError as error:
        ...     print(error)
        pinned nodes[1] = 3: the structure has nodes 0 to 2
    """

    nodes: object
    elements: object
    supports: Supports = None

    def __post_init__(self):
        nodes = _check.floats(self.nodes, "nodes")
        if nodes.ndim != 2 or nodes.shape[1] != 3:
            hint = ""
            if nodes.ndim == 2 and nodes.shape[1] == 2:
                hint = "; a plane structure has z = 0, and supports that hold z"
            elif nodes.ndim == 2 and nodes.shape[0] == 3:
                hint = "; transpose it"
            raise ValueError(f"nodes: expected shape [n_node, 3], got {nodes.shape}{hint}")
        if nodes.dtype not in (np.float32, np.float64):  # the dtype of the whole analysis
            raise ValueError(f"nodes: expected float32 or float64, got {nodes.dtype}")
        object.__setattr__(self, "nodes", nodes)
        if not isinstance(self.supports, Supports):
            got = f", got {_check.kind(self.supports, 'pinned(nodes)')}"
            raise ValueError(
                "supports: missing; a structure needs supports=pinned(nodes) or Supports(mask)"
                f"{'' if self.supports is None else got}"
            )
        positions = _check.concrete(nodes)
        for where, group in self.named_groups():
            if not is_group(group):
                raise ValueError(
                    f"elements{where}: {type(group).__name__} is not an element group such as "
                    "Cables(links, axial_stiffness=...)"
                )
            _check.known(group.links.array, len(nodes), f"elements{where}.links")
            if positions is not None:
                ends = positions[group.links.array]
                zero = (ends == ends[:, :1]).all(axis=(1, 2))
                if zero.any():
                    k = int(zero.argmax())
                    raise ValueError(
                        f"elements{where}.links[{k}] = {group.links[k].tolist()}: zero length; "
                        "its nodes coincide"
                    )
                if hasattr(group, "check"):
                    group.check(positions)
                plausibility.members(group, where, positions)
        if not self.groups:
            raise ValueError("elements: a structure needs at least one element group")
        fixed = self.fixed(self.supports)
        if positions is not None:
            plausibility.places(positions, self.groups, fixed)

    def named_groups(self):
        """Pairs of (key in `elements` as text, element group), in pytree order."""
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

    @property
    def turning(self):
        """Whether any group gives its nodes rotations."""
        return any(group.n_freedom == 6 for group in self.groups)

    def turns(self):
        """Whether a node has rotations: a beam is joined to it rigidly, [n_node] bool."""
        turns = np.zeros(self.n_node, bool)
        for group in self.groups:
            if group.n_freedom == 6:
                hinges = group.hinges
                rigid = np.ones(group.links.shape, bool) if hinges is None else ~hinges.array
                turns[group.links.array[rigid]] = True
        return turns

    def rows(self):
        """Rows of motion: one a node, then one for every hinged end of a beam, which turns alone.

        Returns:
            rows: the node of every row, `Indices` [n_row], or None if there are no hinged ends.
            groups: element groups whose links name rows.
        """
        rows, groups = list(range(self.n_node)), []
        for group in self.groups:
            hinges = getattr(group, "hinges", None)
            if hinges is not None:
                links = group.links.array.copy()
                for k, end in np.argwhere(hinges.array):
                    rows.append(int(links[k, end]))
                    links[k, end] = len(rows) - 1
                group = copy(group, links=Indices(links), hinges=None)
            groups.append(group)
        return Indices(np.array(rows, np.int32)) if len(rows) > self.n_node else None, groups

    def fixed(self, supports):
        """Fixed freedoms under `supports`, [n_row, 3 or 6] bool; checks that the set makes sense.

        Rotations exist where a beam is joined rigidly; elsewhere they count as fixed.
        """
        fixed = supports.fixed(self.n_node)
        if not fixed[:, :3].any():
            raise ValueError("supports: no freedom is fixed; the structure would float away")
        touched = np.zeros(self.n_node, bool)
        for group in self.groups:
            touched[group.links.array] = True
        idle = ~touched & ~fixed[:, :3].all(axis=1)
        if idle.any():
            raise ValueError(
                f"nodes[{int(idle.argmax())}]: no element touches this node and it is not "
                "supported; connect it, support it or remove it"
            )
        self._require_held(fixed[:, :3].any(axis=1), touched)
        if not self.turning:
            if supports.mask is not None and supports.mask.shape[1] != N_FREEDOM:
                raise ValueError(
                    "supports mask: expected [n_node, 3]; no element of the structure has rotations"
                )
            return fixed[:, :3]
        rows, _ = self.rows()
        node = np.arange(self.n_node) if rows is None else rows.array
        fixed = fixed[node]
        fixed[self.n_node :, 3:] = False  # a support acts on the node, not beyond the hinge
        fixed[: self.n_node, 3:] |= ~self.turns()[:, None]
        one = fixed[:, 3:].sum(axis=1) == 1
        if one.any():
            k = int(node[one.argmax()])
            raise ValueError(
                f"supports of node {k}: one rotation alone is held; hold none, two (a hinge about "
                "the third axis) or all three"
            )
        return fixed

    def _require_held(self, held, touched):
        """Raise ValueError if a part has no support at all; booleans [n_node]."""
        part = _parts(tuple(group.links for group in self.groups), self.n_node)
        if not part.any():  # all joined, and something is held
            return
        anchored = np.zeros(self.n_node, bool)
        anchored[part[held]] = True
        adrift = touched & ~anchored[part]
        if adrift.any():
            node = int(adrift.argmax())
            count = int((part == part[node]).sum())
            raise ValueError(
                f"supports: node {node} is in a part of {count} nodes that no element joins to a "
                "support; the part would float away: support it or connect it"
            )


@functools.lru_cache(maxsize=16)
def _parts(links, n_node):
    """Number of the connected part that a node belongs to, [n_node], for links of all groups."""
    pairs = [np.stack([own.array[:, :-1].ravel(), own.array[:, 1:].ravel()]) for own in links]
    ends = np.concatenate(pairs, axis=1)
    graph = sparse.coo_array((np.ones(ends.shape[1], bool), ends), shape=(n_node, n_node))
    return sparse.csgraph.connected_components(graph, directed=False)[1]


@pytree
class Freedoms:
    """Numbering of the unknowns of a phase; the only freedoms that are solved for.

    A node has three freedoms, or six in a structure with beams. Hinged ends of beams follow the
    nodes as rows of their own (see `Structure.rows`), whose translations are those of the node.

    Attributes:
        free: free freedoms as flat numbers n_freedom node + direction, [n_free].
        source: where each freedom finds its value in (unknowns, held values), [3 n_node]; None in a
            structure with beams.
        number: unknown's number, or n_free for a held freedom, [n_node, n_freedom].
        fixed: True where held, [n_node, n_freedom].
        rows: the node that every row belongs to, or None if there are no hinged ends.
        pattern: `linear.Pattern` of sparse matrices; None if they are dense.
    """

    free: object
    source: object
    number: object
    fixed: object
    rows: object = None
    pattern: object = None


@functools.lru_cache(maxsize=16)
def number_freedoms(fixed, rows=None, links=None, solver=None, symmetric=True):
    """Number the free freedoms and find the pattern of the tangent; kept for the next analysis.

    Args:
        fixed: True where a freedom is held, `Indices` [n_row, 3 or 6].
        rows: the node of every row of `fixed`, `Indices` [n_row], or None.
        links: (`Indices` of links, freedoms of a node) for every group and every load that follows,
            a tuple; None for no pattern.
        solver: the solver that the pattern is made for; None to choose by size.
        symmetric: False if loads follow; with rotations it is unsymmetric in any case.
    """
    mask = fixed.array.copy()
    if rows is not None:
        repeated = np.arange(len(mask)) != rows.array
        mask[repeated, :3] = True  # numbered with their node
    free = np.flatnonzero(~mask.ravel()).astype(np.int32)
    n_free = len(free)
    number = np.full(mask.size, n_free, np.int32)
    number[free] = np.arange(n_free, dtype=np.int32)
    source = np.where(mask.ravel(), n_free + np.arange(mask.size), number).astype(np.int32)
    number = number.reshape(mask.shape)
    if rows is not None:
        number[:, :3] = number[rows.array, :3]
    turning = mask.shape[1] > N_FREEDOM
    pattern = None
    if links is not None and n_free > 0 and not (turning and linear.is_dense(solver, n_free)):
        numbers = [number[own.array][..., :width].reshape(len(own), -1) for own, width in links]
        if turning:  # moments have entries of their own, unsymmetric ones
            numbers.append(number[:, 3:])
        pattern = linear.make_pattern(numbers, n_free, symmetric and not turning, solver)
    return Freedoms(
        free,
        None if turning else source,
        number,
        fixed.array,
        None if rows is None else rows.array,
        pattern,
    )
