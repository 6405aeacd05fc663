"""Nodes, element groups and supports, checked on the host."""

from __future__ import annotations

import functools
from collections.abc import Sequence
from typing import Any

import jax
import numpy as np
from scipy import sparse

from ..common import checks
from ..common.rules import Rule, refuse_if_broken
from ..common.tree import Indices, computed_once, copy_with, index_array, pytree, set_fields
from ..common.types import ArrayLike, Bool, Float, Int, PyTree
from ..elements import contract
from ..elements.element import PEAK_TENSION, SECTION_FORCES, SECTION_STRAIN, TENSION, Element
from ..elements.rotating_saddles import with_rotating_saddles
from ..spaces import Space, space_class
from ..spaces.dof_map import MotionRows
from . import coordinate_precision, plausibility
from .supports import FixedDofs, Supports
from .topology import nodes_with_elements
from .torsional_mechanisms import find_torsional_mechanisms
from .torsional_mechanisms import warn_of_torsional_mechanisms as warn_of_spins

_RESERVED_RESULT_NAMES = (  # names of results of nodes and increments
    *("displacement", "displacement_in_phase", "positions", "reactions", "load", "rotation"),
    "reaction_moments",
    *("rest_length", "links", "status", "stable", "phase", "load_factor", "end_forces", "is_slack"),
    "present",
)


def is_group(x: object) -> bool:
    """Return whether `x` is an element group, a leaf of the `elements` pytree."""
    return isinstance(x, Element)


def position_rules(nodes, group, where=""):
    """Return the rules (`Rule`) of a group at node positions [n_node, 3], m, a list.

    Nodes of an element must not coincide, and elements may have rules of their own. `where` begins
    the messages: "elements['net'].".
    """
    links = index_array(group.links)

    def same(ends, _):
        return (ends == ends[:, :1]).all(axis=(1, 2))

    def text(index, _, links):
        k = index[0]
        return f"{where}links[{k}] = {links[k].tolist()}: zero length; its nodes are at one place"

    apart = [Rule("nodes", (nodes[links], links), same, text)] if links.shape[1] > 1 else []
    return [*apart, *group.rules_at(nodes)]


@pytree(indices=("rigid",))
class Structure:
    """A structure: initial geometry, element groups, supports.

    Its groups of elements may be in any pytree; results per element have the shape of this pytree.

    Args:
        nodes: initial positions, [n_node, 3], m.
        elements: one group (`Cables`, `Bars`, `Beams`, ...), or several, by name or in a list, at
            any depth.
        supports: `Supports`: which nodes are held, and how.
        rigid: pairs of nodes (carrier, carried), [n, 2]: the second moves with the first as if a
            rigid arm joined them (the bracket of a guy, an eccentric joint). A beam must be joined
            to the carrier. Elements at the carried node, and loads on it, act on the carrier.

    Raises:
        ValueError: wrong shapes, unknown nodes, zero-length elements, no supports, a part
            without supports, or a free node that no element touches; the message names the argument
            and the index.

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

    nodes: Float[ArrayLike, "n_node 3"]
    elements: PyTree[Element]
    supports: Supports = None  # type: ignore[assignment]  # the error says more than Python's
    rigid: Int[ArrayLike, "n 2"] | None = None

    def __post_init__(self):
        nodes = checks.as_floats(self.nodes, "nodes")
        if nodes.ndim != 2 or nodes.shape[1] != 3:
            hint = ""
            if nodes.ndim == 2 and nodes.shape[1] == 2:
                hint = "; a plane structure has z = 0, and supports that hold z"
            elif nodes.ndim == 2 and nodes.shape[0] == 3:
                hint = "; transpose it"
            raise ValueError(f"nodes: expected shape [n_node, 3], got {nodes.shape}{hint}")
        if nodes.dtype not in (np.float32, np.float64):  # the dtype of the whole analysis
            raise ValueError(f"nodes: expected float32 or float64, got {nodes.dtype}")
        set_fields(self, nodes=nodes)
        if not isinstance(self.supports, Supports):
            if self.supports is None:
                raise ValueError(
                    "supports: missing; a structure needs supports=pinned(nodes) or Supports(mask)"
                )
            got = checks.describe_type(self.supports, "pinned(nodes)")
            hint = "; write supports=pinned([0, 3])" if isinstance(self.supports, list) else ""
            raise ValueError(f"supports: expected pinned(nodes) or Supports(mask), got {got}{hint}")
        positions = checks.array_if_known(nodes)
        if positions is not None and all(is_group(group) for group in self.groups):
            coordinate_precision.warn_of_coarse_coordinates(positions, self.named_groups())
        for where, group in self.named_groups():
            if not is_group(group):
                raise ValueError(
                    f"elements{where}: {type(group).__name__} is not an element group such as "
                    "Cables(links, axial_stiffness=...)"
                )
            checks.require_known_nodes(group.links.array, len(nodes), f"elements{where}.links")
            if positions is not None:
                refuse_if_broken(position_rules(positions, group, f"elements{where}."))
                group.check(positions)
                plausibility.warn_of_dimensions(group, where, positions)
        if not self.groups:
            raise ValueError("elements: a structure needs at least one element group")
        self._check_result_names()
        for where, group in self.named_groups():
            contract.require_abilities(group, f"elements{where}")
        self._check_rigid_links()
        fixed = self.fixed(self.supports)
        if positions is not None:
            joined = self.nodes_with_elements()
            plausibility.warn_of_coincident_nodes(positions, joined, fixed.array)
            plausibility.warn_of_zero_bending(self.named_groups(), fixed.array[: self.n_node])
            warn_of_spins(self, fixed)

    def _check_result_names(self):
        """Raise ValueError for reserved names of results, or other units of one name in groups."""
        every = TENSION, PEAK_TENSION, SECTION_STRAIN, SECTION_FORCES
        known = {result.name: result for result in every}
        for where, group in self.named_groups():
            for result in group.results:
                if result.name in _RESERVED_RESULT_NAMES:
                    text = "is the name of a result of nodes or of the analysis; take another name"
                elif known.setdefault(result.name, result) != result:
                    text = "is a result of another group with another unit or shape; rename one"
                else:
                    continue
                raise ValueError(f"elements{where}.results: {result.name!r} {text}")

    def _check_rigid_links(self):
        """Make `rigid` `Indices`; ValueError for chains, repeated nodes, ends without rotation."""
        if self.rigid is None:
            return
        if not isinstance(self.rigid, Indices):
            pairs = checks.as_indices(self.rigid, "rigid", width=2)
            set_fields(self, rigid=Indices(pairs) if len(pairs) else None)
            if not len(pairs):
                return
        pairs = self.rigid.array
        checks.require_known_nodes(pairs, self.n_node, "rigid")
        turns = self.rigidly_joined_nodes()
        carried = pairs[:, 1].tolist()
        for k, (carrier, node) in enumerate(pairs.tolist()):
            text = None
            if carrier in carried or carrier == node:
                text = f"node {carrier} is carried itself; give the node at the end of the chain"
            elif carried.index(node) != k:
                text = f"node {node} is carried twice; give one carrier"
            elif not turns[carrier]:
                text = (
                    f"node {carrier} has no rotation: no beam is joined to it rigidly; join one "
                    "without a hinge, or give another node"
                )
            if text is not None:
                raise ValueError(f"rigid[{k}] = {[carrier, node]}: {text}")

    @computed_once
    def named_groups(self) -> list[tuple[str, Element]]:
        """Return pairs of (key in `elements` as text, element group), in pytree order."""
        leaves = jax.tree_util.tree_leaves_with_path(self.elements, is_leaf=is_group)
        return [(jax.tree_util.keystr(path), group) for path, group in leaves]

    @property
    @computed_once
    def groups(self) -> list[Element]:
        """Element groups, a list in pytree order."""
        return jax.tree.leaves(self.elements, is_leaf=is_group)

    @property
    def n_node(self) -> int:
        """Number of nodes."""
        return self.nodes.shape[0]

    def arrange(self, per_group: Sequence[Any]) -> PyTree[Any]:
        """Put a list with one item per group, in pytree order, into the shape of `elements`."""
        return self.group_tree.unflatten(per_group)

    @property
    @computed_once
    def group_tree(self) -> jax.tree_util.PyTreeDef:
        """Tree of `elements` without the groups, which are its leaves (a treedef of jax)."""
        return jax.tree.structure(self.elements, is_leaf=is_group)

    @property
    @computed_once
    def space(self) -> type[Space]:
        """Class of `spaces` that moves nodes: `RotatingNodes` with beams, else `Translations`."""
        return space_class(self.groups)

    def nodes_with_elements(self) -> Bool[np.ndarray, " n_node"]:
        """Return which nodes are ends of elements, [n_node] bool."""
        return nodes_with_elements(self.groups, self.n_node)

    def rigidly_joined_nodes(self) -> Bool[np.ndarray, " n_node"]:
        """Return which nodes a beam end is joined to rigidly (without a hinge), [n_node] bool."""
        joined = np.zeros(self.n_node, bool)
        for group in self.groups:
            if group.gives_rotations:
                loose = group.hinged_ends()
                rigid = np.ones(group.links.shape, bool) if loose is None else ~loose
                joined[group.links.array[rigid]] = True
        return joined

    def rotating_nodes(self) -> Bool[np.ndarray, " n_node"]:
        """Return which nodes have rotations, own ones or those of a rigid link, [n_node] bool."""
        turns = self.rigidly_joined_nodes()
        if self.rigid is not None:
            turns[self.rigid.array[:, 1]] = True
        return turns

    @computed_once
    def motion_rows(self) -> tuple[MotionRows | None, list[Element]]:
        """Number the rows of motion: nodes, hinged ends of beams, inner unknowns of elements.

        Returns:
            `dof_map.MotionRows`, or None if every row is a node; and the element groups with row
            numbers in place of node numbers in their links, cables with saddles on nodes that
            rotate as `CablesOnRotatingSaddles`.
        """
        count = self.n_node
        nodes, inner, idle, groups = [np.arange(count)], [np.zeros(count, bool)], [], []
        for group in with_rotating_saddles(self.groups, self.rotating_nodes(), self.nodes.dtype):
            links = group.links.array
            loose = group.hinged_ends()
            if loose is not None:
                links = links.copy()
                ends = np.argwhere(loose)
                nodes.append(links[ends[:, 0], ends[:, 1]])
                inner.append(np.zeros(len(ends), bool))
                links[ends[:, 0], ends[:, 1]] = count + np.arange(len(ends))
                count += len(ends)
            if group.n_inner_row:
                unused = group.unused_columns()  # [n_elem, n_inner_row, 3]
                extra = count + np.arange(len(links) * group.n_inner_row)
                nodes.append(np.repeat(group.links.array[:, 0], group.n_inner_row))
                inner.append(np.ones(len(extra), bool))
                idle.append((count, unused.reshape(-1, 3)))
                links = np.column_stack([links, extra.reshape(len(links), -1)])
                count += len(extra)
            if links is not group.links.array:
                group = copy_with(group, links=Indices(links.astype(np.int32)), hinges=None)
            groups.append(group)
        if count == self.n_node:
            return None, groups
        idles = np.zeros((count, 3), bool)
        for start, unused in idle:
            idles[start : start + len(unused)] = unused
        return MotionRows(np.concatenate(nodes), np.concatenate(inner), idles), groups

    def fixed(self, supports: Supports) -> FixedDofs:
        """Return which degrees of freedom `supports` fix, as `FixedDofs` [n_row, 3 or 6].

        Rotations exist where a beam is joined rigidly; elsewhere they count as fixed, as do inner
        unknowns that an element does not use.
        """
        return (
            self._fixed_by_own_supports()
            if supports is self.supports
            else self._find_fixed_dofs(supports)
        )

    @computed_once
    def _fixed_by_own_supports(self):
        """Return `fixed` of the structure's own supports, a `FixedDofs`, computed once."""
        return self._find_fixed_dofs(self.supports)

    def _find_fixed_dofs(self, supports):
        """Return `fixed` for `supports`, a `FixedDofs`; ValueError if they do not suffice.

        So it is for a part without support, and rotations or nodes that supports cannot hold.
        """
        fixed, axes = supports.fixed(self.n_node), supports.directions(self.n_node)
        if not fixed[:, :3].any():
            raise ValueError(
                "supports: no node is held, so that the structure would float away; hold some, "
                "such as pinned([0, 1])"
            )
        self._require_connected(fixed)
        rows, _ = self.motion_rows()
        if not self.space.rotates:
            if supports.holds_rotations:
                raise ValueError(
                    "supports: hold rotations, but no element of the structure has rotations (only "
                    "beams have); use pinned(nodes), or a mask [n_node, 3]"
                )
            fixed = fixed[:, :3]
            if rows is not None:
                fixed, axes = fixed[rows.node_of_row], axes[rows.node_of_row]
                fixed[rows.inner], axes[rows.inner] = rows.inactive[rows.inner], np.eye(3)
            return FixedDofs(fixed, None if (axes == np.eye(3)).all() else axes)
        if self.rigid is not None:
            carried = self.rigid.array[:, 1]
            wrong = fixed[carried].any(axis=1)
            if wrong.any():
                node = int(carried[wrong.argmax()])
                raise ValueError(
                    f"supports: node {node} is carried by another node (rigid); support that one"
                )
        fixed[:, 3:] |= ~self.rotating_nodes()[:, None]
        mechanisms = find_torsional_mechanisms(self, fixed, axes)
        if rows is not None:
            fixed, axes = fixed[rows.node_of_row], axes[rows.node_of_row]
            fixed[self.n_node :, 3:] = False  # a support acts on the node, not beyond the hinge
            fixed[rows.inner, 3:], fixed[rows.inner, :3] = True, rows.inactive[rows.inner]
            axes[rows.inner] = np.eye(3)
        plain = (axes == np.eye(3)).all() and (fixed[:, 3:].sum(axis=1) != 1).all()
        return FixedDofs(fixed, None if plain else axes, mechanisms)

    def held_displacements(self) -> Bool[np.ndarray, "n_node 3"]:
        """Return which displacements along x, y, z the supports hold, [n_node, 3] bool.

        Raises:
            ValueError: supports hold displacements along other directions.
        """
        fixed = self.fixed(self.supports)
        if fixed.axes is not None:
            raise ValueError(
                "supports: this function takes supports along x, y, z only, not along other axes; "
                "find_form and force_density take any"
            )
        return fixed.array

    def _require_connected(self, fixed):
        """Raise ValueError for a free node without elements, or a part without any support."""
        touched = self.nodes_with_elements()
        idle = ~touched & ~fixed[:, :3].all(axis=1)
        if self.rigid is not None:
            idle[self.rigid.array[:, 1]] = False
        if idle.any():
            raise ValueError(
                f"nodes[{int(idle.argmax())}]: no element touches this node and it is not "
                "supported; connect it, support it or remove it"
            )
        self._require_supported_parts(fixed[:, :3].any(axis=1), touched)

    def _require_supported_parts(self, held, touched):
        """Raise ValueError if a connected part has no support.

        `held` and `touched` say which nodes supports hold, and which have elements, [n_node] bool.
        """
        links = [group.links for group in self.groups]
        part = _connected_parts(
            (*links, *([] if self.rigid is None else [self.rigid])), self.n_node
        )
        if not part.any():  # one part only, and it has a support
            return
        anchored = np.zeros(self.n_node, bool)
        anchored[part[held]] = True
        adrift = touched & ~anchored[part]
        if adrift.any():
            node = int(adrift.argmax())
            count = int((part == part[node]).sum())
            raise ValueError(
                f"supports: node {node} is in a part of {count} nodes that no element joins to a "
                "support; the part would float away: support one of its nodes, or connect it"
            )


@functools.lru_cache(maxsize=16)
def _connected_parts(links, n_node):
    """Return the index of the connected part of each node, [n_node]; that of node 0 is 0.

    `links` are `Indices` [n, n_end] of all groups.
    """
    pairs = [
        np.stack([group_links.array[:, :-1].ravel(), group_links.array[:, 1:].ravel()])
        for group_links in links
    ]
    ends = np.concatenate(pairs, axis=1)
    graph = sparse.coo_array((np.ones(ends.shape[1], bool), ends), shape=(n_node, n_node))
    return sparse.csgraph.connected_components(graph, directed=False)[1]
