"""Degree-of-freedom map: which degrees of freedom are free, and the index of each unknown.

A *row of motion* is whatever has a displacement. Every node is a row. Elements can have further
rows: a hinged end of a beam has the displacement of its node and a rotation of its own; internal
unknowns of beams (`elements.inner_unknowns`) are the displacements of rows that belong to one
element only. A node that a rigid link joins to another node, its *carrier* (reference node), is
*carried*: it has no unknowns and moves with its carrier.
"""

from __future__ import annotations

import functools
from collections.abc import Sequence
from typing import TypeAlias

import jax
import jax.numpy as jnp
import numpy as np

from .. import linear
from ..common import memory_limit
from ..common.tree import Indices, copy_with, pytree, unsigned_indices
from ..common.types import Array, ArrayLike, Bool, Float, Int

RigidLinks: TypeAlias = 'tuple[Int[ArrayLike, " n"], Int[ArrayLike, " n"]]'
"""Rigid links: carried (dependent) nodes, and their carriers (reference nodes)."""
TorsionalMechanisms: TypeAlias = (
    'tuple[Int[ArrayLike, " m"], Int[ArrayLike, " m"], Int[ArrayLike, "n_piece 2"]]'
)
"""Straight pieces of beams that can spin about their own line without stiffness: the rows that
spin, the piece of each row, and two nodes on the line of each piece."""

# dense matrices in memory at once: indices and values of a tangent, its scaled form, its factor
_DENSE_MATRICES = 4


class MotionRows:
    """Rows of motion: nodes, then what moves on its own, such as hinged ends of beams.

    For each row it has the node, whether the row is of an inner unknown, and which of its three
    displacements no element uses. Hashable, for caches.

    Attributes:
        node_of_row: node that every row belongs to, [n_row], NumPy.
        inner: True for rows of internal unknowns of elements, [n_row] bool, NumPy.
        inactive: True for displacements of such rows that no element uses, [n_row, 3] bool, NumPy.

    The constructor takes them in this order.
    """

    def __init__(
        self,
        node: Int[ArrayLike, " n_row"],
        inner: Bool[ArrayLike, " n_row"],
        idle: Bool[ArrayLike, "n_row 3"],
    ):
        self.node_of_row = np.array(node, np.int32)
        self.inner, self.inactive = np.array(inner, bool), np.array(idle, bool).reshape(-1, 3)
        self._key = tuple(Indices(a) for a in (self.node_of_row, self.inner, self.inactive))

    def __hash__(self) -> int:
        return hash(self._key)

    def __eq__(self, other: object) -> bool:
        return isinstance(other, MotionRows) and self._key == other._key

    def __len__(self) -> int:
        return len(self.node_of_row)


@pytree
class DofMap:
    """Map between degrees of freedom (dofs) and unknowns in a phase; only free dofs are solved for.

    A row of motion (a node, a hinged end, internal unknowns of an element) has three dofs, or six
    in a structure with beams, along the directions in `axes`.

    Attributes:
        free: free dofs as flat indices ``n_freedom row + direction``, [n_free].
        unknown_of_dof: index of the unknown of every dof, or n_free if it is fixed, [n_row,
            n_freedom].
        fixed: True where a dof is fixed, [n_row, n_freedom].
        axes: directions of the dofs, [n_row, 3, 3], one in each row of a matrix; None if they are
            x, y, z.
        node_of_row: node that every row of motion belongs to, or None if every row is a node.
        inner: True for rows of internal unknowns of elements, [n_row] bool, or None.
        rigid_links: (carried nodes, their carriers), [n] each, or None.
        temporarily_fixed: True for unknowns that are fixed in this phase and free in another one,
            [n_free] bool, or None; they do not move.
        torsional_mechanisms: beams that can rotate about their own line without stiffness, or
            None.
        pattern: sparsity pattern of matrices; None if they are dense.
        nodal_assembly: assembly map that sums the end forces of all elements at every row; None to
            scatter, which is as fast where loops are not fused (`common.fusion`), in a smaller
            program.
        unknown_assembly: assembly map that sums forces at every unknown; given with
            `nodal_assembly` where every dof has an unknown of its own. Its transpose needs no
            scatter.
        supported: True where a support fixes a dof, [n_row, n_freedom]; others are `fixed` because
            they are inactive: no element of the phase is joined to them. None if supports fix all
            of them.
    """

    free: Int[ArrayLike, " n_free"]
    unknown_of_dof: Int[ArrayLike, "n_row n_freedom"]
    fixed: Bool[ArrayLike, "n_row n_freedom"]
    axes: Float[ArrayLike, "n_row 3 3"] | None = None
    node_of_row: Int[ArrayLike, " n_row"] | None = None
    inner: Bool[ArrayLike, " n_row"] | None = None
    rigid_links: RigidLinks | None = None
    pattern: linear.Pattern | None = None
    torsional_mechanisms: TorsionalMechanisms | None = None
    temporarily_fixed: Bool[ArrayLike, " n_free"] | None = None
    nodal_assembly: linear.AssemblyMap | None = None
    unknown_assembly: linear.AssemblyMap | None = None
    supported: Bool[ArrayLike, "n_row n_freedom"] | None = None

    @property
    def fixed_by_supports(self) -> Bool[ArrayLike, "n_row n_freedom"]:
        """Mask of the degrees of freedom that supports fix, [n_row, n_freedom] bool."""
        return self.fixed if self.supported is None else self.supported

    def zero_temporarily_fixed(self, vector: Float[Array, " n_free"]) -> Float[Array, " n_free"]:
        """Return `vector`, [n_free], with zeros at unknowns that are fixed in this phase only."""
        return (
            vector
            if self.temporarily_fixed is None
            else jnp.where(self.temporarily_fixed, 0.0, vector)
        )

    def movable_dofs(self) -> Bool[Array, "n_row n_freedom"]:
        """Return a mask of the degrees of freedom that can move in this phase, [n_row, n_freedom].

        A node on a rigid link can move where the node that carries it can.
        """
        number = self.unknown_of_dof
        if self.rigid_links is not None:
            number = number[reference_rows(len(number), self.rigid_links)]
        if self.temporarily_fixed is None:
            return number < self.free.shape[0]
        return ~jnp.append(self.temporarily_fixed, True)[number]

    @property
    def row_of_unknown(self) -> Int[Array, " n_free"]:
        """Index of the row of motion (a node, for example) of every unknown, [n_free]."""
        return self.free // self.unknown_of_dof.shape[1]

    @property
    def without_unknowns(self) -> DofMap:
        """Copy of this map without unknowns: supports, rows and rigid links, for results."""
        nothing = {
            name: None
            for name in (
                "free",
                "unknown_of_dof",
                "pattern",
                "torsional_mechanisms",
                "temporarily_fixed",
                "unknown_assembly",
            )
        }
        return copy_with(self, **nothing)


def element_unknowns(
    number: Int[ArrayLike, "n_row n_freedom"],
    links: Int[ArrayLike, "n_elem n_end"],
    width: int,
    inner: Sequence[tuple[int, int]] = (),
    carried: RigidLinks | None = None,
) -> Int[ArrayLike, "n_elem d"]:
    """Return the indices of each element's unknowns, in the order of its matrix, [n_elem, d].

    Args:
        number: index of the unknown of every degree of freedom, [n_row, 3 or 6].
        links: rows of motion of the elements, [n_elem, n_end]: ends, then rows of internal
            unknowns.
        width: degrees of freedom that an element has at each end, 3 or 6.
        inner: positions of the internal unknowns, (row after the ends, column), a tuple.
        carried: (carried nodes, their carriers) of rigid links; ends at carried nodes have the six
            unknowns of their carriers.
    """
    n_inner_row = 1 + max((row for row, _ in inner), default=-1)
    n_end = links.shape[1] - n_inner_row
    ends = links[:, :n_end]
    if carried is not None:
        ends, width = reference_rows(len(number), carried)[ends], 6
    numbers = number[ends][..., :width].reshape(len(links), -1)
    if not inner:
        return numbers
    rows, columns = np.array(inner).T
    of_inner = number[links[:, n_end + rows], columns]
    on_host = isinstance(number, np.ndarray) and isinstance(links, np.ndarray)
    return (np if on_host else jnp).concatenate([numbers, of_inner], axis=1)


def reference_rows(n_row: int, carried: RigidLinks) -> Int[ArrayLike, " n_row"]:
    """Return the node whose unknowns move each node (row): its rigid-link carrier, or itself."""
    if isinstance(carried[0], np.ndarray):
        found = np.arange(n_row)
        found[carried[0]] = carried[1]
        return found
    return jnp.arange(n_row).at[carried[0]].set(carried[1])


@functools.lru_cache(maxsize=16)
def make_dof_map(
    fixed,
    rows=None,
    links=None,
    solver=None,
    symmetric=True,
    rigid=None,
    space=None,
    definite=False,
    paired=(),
):
    """Number the unknowns, find the sparsity pattern of the tangent, and return the `DofMap`.

    The last results are cached for later analyses.

    Args:
        fixed: True where a degree of freedom is fixed, [n_row, 3 or 6], a `Fixed`.
        rows: `MotionRows`, or None if every row is a node.
        links: triples (`Indices` of links, degrees of freedom of an end, internal unknowns) for
            every group and every follower load, a tuple; None for no pattern.
        solver: name of the linear solver that the pattern is made for; None to choose by size.
        symmetric: whether the tangent is symmetric.
        rigid: rigid links, pairs (carrier, carried node), `Indices` [n, 2], or None.
        space: class of the `Space`, for unknowns of a row that are coupled without elements; None
            for none.
        definite: whether the tangent is known to be positive semidefinite.
        paired: for every group whether its matrices are ``[[B, -B], [-B, B]]``.

    Raises:
        ValueError: a dense matrix, asked for by `solver`, does not fit into memory.
    """
    mask, mechanisms = fixed.array.copy(), fixed.mechanisms
    carried = None
    if rows is not None:
        shared = (np.arange(len(mask)) != rows.node_of_row) & ~rows.inner
        mask[shared, :3] = True  # these displacements get the unknowns of their node
    if rigid is not None:
        carried = rigid.array[:, 1], rigid.array[:, 0]
        mask[carried[0]] = True  # carried nodes move by the unknowns of their carriers
    free = np.flatnonzero(~mask.ravel()).astype(np.int32)
    n_free = len(free)
    number = np.full(mask.size, n_free, np.int32)
    number[free] = np.arange(n_free, dtype=np.int32)
    if solver == "dense":
        need = _DENSE_MATRICES * n_free**2 * jax.dtypes.canonicalize_dtype(float).itemsize
        way_out = "linear_solver=None chooses a sparse solver"
        memory_limit.require_memory(need, f'linear_solver = "dense" for {n_free} unknowns', way_out)
    number = number.reshape(mask.shape)
    if rows is not None:
        number[shared, :3] = number[rows.node_of_row[shared], :3]
    pattern, coupled = None, [] if space is None else space.coupled_unknowns(number)
    if links is not None and n_free > 0:
        numbers = [
            element_unknowns(number, ends.array, width, inner, carried)
            for ends, width, inner in links
        ]
        pattern = linear.make_pattern(
            [*numbers, *coupled], n_free, symmetric, solver, definite=definite, paired=paired
        )
    return DofMap(
        unsigned_indices(free),
        unsigned_indices(number),
        fixed.array,
        None if fixed.axes is None else fixed.axes.array,
        None if rows is None else unsigned_indices(rows.node_of_row),
        rows.inner if rows is not None and rows.inner.any() else None,
        None if carried is None else tuple(map(unsigned_indices, carried)),
        pattern,
        None if mechanisms is None else (mechanisms.rows, mechanisms.piece, mechanisms.ends),
    )


@functools.lru_cache(maxsize=16)
def with_assembly_maps(dof_map: DofMap, links: tuple[Indices, ...], own: bool) -> DofMap:
    """Return a `DofMap` with assembly maps for end forces of elements; cached for later analyses.

    These are its fields `nodal_assembly` and `unknown_assembly`.

    Args:
        dof_map: from `make_dof_map`.
        links: rows of motion of the elements of every group.
        own: whether every free degree of freedom has an unknown of its own; only then
            `unknown_assembly` is added.
    """
    ends = np.concatenate([indices.array.ravel() for indices in links])
    found = {"nodal_assembly": linear.make_assembly_map(ends, len(dof_map.unknown_of_dof))}
    if own:
        numbers = np.asarray(dof_map.unknown_of_dof).ravel()
        found["unknown_assembly"] = linear.make_assembly_map(numbers, len(dof_map.free))
    with jax.ensure_compile_time_eval():  # concrete arrays, also when a caller is being traced
        return copy_with(dof_map, **jax.tree.map(jax.device_put, found))


def to_local(axes: Float[ArrayLike, "n 3 3"], vectors: Float[Array, "n 3"]) -> Float[Array, "n 3"]:
    """Return the components of vectors [n, 3] along local axes, the rows of matrices [n, 3, 3]."""
    return jnp.einsum("nij,nj->ni", jnp.asarray(axes, vectors.dtype), vectors)


def to_global(
    axes: Float[ArrayLike, "n 3 3"], components: Float[Array, "n 3"]
) -> Float[Array, "n 3"]:
    """Return vectors [n, 3] from components along local axes, the rows of matrices [n, 3, 3]."""
    return jnp.einsum("nij,ni->nj", jnp.asarray(axes, components.dtype), components)
