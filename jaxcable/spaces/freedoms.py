"""Degree-of-freedom map: which degrees of freedom are free, and the index of each unknown.

A *row of motion* is whatever has a displacement. Every node is a row. Elements can have further
rows: a hinged end of a beam has the displacement of its node and a rotation of its own; internal
unknowns of beams (`elements.inner`) are the displacements of rows that belong to one element only.
A node that a rigid link joins to another node, its *carrier* (reference node), is *carried*: it has
no unknowns and moves with its carrier.
"""

from __future__ import annotations

import functools
from collections.abc import Sequence
from typing import TypeAlias

import jax
import jax.numpy as jnp
import numpy as np

from .. import linear
from ..common import memory
from ..common.tree import Indices, copy, places, pytree
from ..common.types import Array, ArrayLike, Bool, Float, Int

Carried: TypeAlias = 'tuple[Int[ArrayLike, " n"], Int[ArrayLike, " n"]]'
"""Rigid links: carried (dependent) nodes, and their carriers (reference nodes)."""
FreeSpins: TypeAlias = (
    'tuple[Int[ArrayLike, " m"], Int[ArrayLike, " m"], Int[ArrayLike, "n_piece 2"]]'
)
"""Straight pieces of beams that can spin about their own line without stiffness: the rows that
spin, the piece of each row, and two nodes on the line of each piece."""

# dense matrices in memory at once: indices and values of a tangent, its scaled form, its factor
_DENSE_MATRICES = 4


class Rows:
    """Rows of motion of a structure that has more rows than nodes; hashable, for caches.

    Attributes:
        node: node that every row belongs to, [n_row], NumPy.
        inner: True for rows of internal unknowns of elements, [n_row] bool, NumPy.
        idle: True for columns of such rows that no element uses, [n_row, 3] bool, NumPy.
    """

    def __init__(
        self,
        node: Int[ArrayLike, " n_row"],
        inner: Bool[ArrayLike, " n_row"],
        idle: Bool[ArrayLike, "n_row 3"],
    ):
        self.node = np.array(node, np.int32)
        self.inner, self.idle = np.array(inner, bool), np.array(idle, bool).reshape(-1, 3)
        self._key = tuple(Indices(a) for a in (self.node, self.inner, self.idle))

    def __hash__(self) -> int:
        return hash(self._key)

    def __eq__(self, other: object) -> bool:
        return isinstance(other, Rows) and self._key == other._key

    def __len__(self) -> int:
        return len(self.node)


@pytree
class Freedoms:
    """Map between degrees of freedom (dofs) and unknowns in a phase; only free dofs are solved for.

    A row of motion (see the module) has three dofs, or six in a structure with beams, along the
    directions in `axes`.

    Attributes:
        free: free dofs as flat indices ``n_freedom row + direction``, [n_free].
        number: index of the unknown of every dof, or n_free if it is fixed, [n_row, n_freedom].
        fixed: True where a dof is fixed, [n_row, n_freedom].
        axes: directions of the dofs, [n_row, 3, 3], one in each row of a matrix; None if they are
            x, y, z.
        rows: node that every row of motion belongs to, or None if every row is a node.
        inner: True for rows of internal unknowns of elements, [n_row] bool, or None.
        carried: rigid links, (carried nodes, their carriers), [n] each, or None.
        bound: True for unknowns that are fixed in this phase and free in another one, [n_free]
            bool, or None; they do not move.
        spins: `FreeSpins`, or None.
        pattern: `linear.Pattern` of sparse matrices; None if they are dense.
        meeting: assembly map that sums the end forces of all elements at every row; None to
            scatter, which is as fast where loops are not fused (`common.fusion`), in a smaller
            program.
        numbering: assembly map that sums forces at every unknown; given with `meeting` where every
            dof has an unknown of its own. Its transpose needs no scatter.
        supported: True where a support fixes a dof, [n_row, n_freedom]; others are `fixed` because
            they are inactive: no present element touches them. None if supports fix all of them.
    """

    free: Int[ArrayLike, " n_free"]
    number: Int[ArrayLike, "n_row n_freedom"]
    fixed: Bool[ArrayLike, "n_row n_freedom"]
    axes: Float[ArrayLike, "n_row 3 3"] | None = None
    rows: Int[ArrayLike, " n_row"] | None = None
    inner: Bool[ArrayLike, " n_row"] | None = None
    carried: Carried | None = None
    pattern: linear.Pattern | None = None
    spins: FreeSpins | None = None
    bound: Bool[ArrayLike, " n_free"] | None = None
    meeting: linear.Gathering | None = None
    numbering: linear.Gathering | None = None
    supported: Bool[ArrayLike, "n_row n_freedom"] | None = None

    @property
    def by_supports(self) -> Bool[ArrayLike, "n_row n_freedom"]:
        """Degrees of freedom that supports fix, [n_row, n_freedom] bool."""
        return self.fixed if self.supported is None else self.supported

    def released(self, vector: Float[Array, " n_free"]) -> Float[Array, " n_free"]:
        """Return a vector with zeros at the unknowns that are `bound`."""
        return vector if self.bound is None else jnp.where(self.bound, 0.0, vector)

    def moves(self) -> Bool[Array, "n_row n_freedom"]:
        """Return which degrees of freedom can move in this phase, [n_row, n_freedom] bool.

        They have an unknown that is not `bound`. A carried node has those of its carrier.
        """
        number = self.number
        if self.carried is not None:
            number = number[carriers(len(number), self.carried)]
        if self.bound is None:
            return number < self.free.shape[0]
        return ~jnp.append(self.bound, True)[number]

    @property
    def row_of_unknown(self) -> Int[Array, " n_free"]:
        """Row of motion of every unknown, [n_free]."""
        return self.free // self.number.shape[1]

    @property
    def of_supports(self) -> Freedoms:
        """The part that results need: supports, rows and rigid links, without unknowns."""
        nothing = {
            name: None for name in ("free", "number", "pattern", "spins", "bound", "numbering")
        }
        return copy(self, **nothing)


def element_unknowns(
    number: Int[ArrayLike, "n_row n_freedom"],
    links: Int[ArrayLike, "n_elem n_end"],
    width: int,
    inner: Sequence[tuple[int, int]] = (),
    carried: Carried | None = None,
) -> Int[ArrayLike, "n_elem d"]:
    """Return the indices of each element's unknowns, in the order of its matrix, [n_elem, d].

    Args:
        number: unknown of every degree of freedom, as in `Freedoms`, [n_row, 3 or 6].
        links: rows of the elements, [n_elem, n_end]: ends, then rows of internal unknowns.
        width: degrees of freedom that an element has at each end, 3 or 6.
        inner: positions of the internal unknowns, (row after the ends, column), a tuple.
        carried: as in `Freedoms`; ends at carried nodes have the six unknowns of their carriers.
    """
    n_inner_row = 1 + max((row for row, _ in inner), default=-1)
    n_end = links.shape[1] - n_inner_row
    ends = links[:, :n_end]
    if carried is not None:
        ends, width = carriers(len(number), carried)[ends], 6
    numbers = number[ends][..., :width].reshape(len(links), -1)
    if not inner:
        return numbers
    rows, columns = np.array(inner).T
    of_inner = number[links[:, n_end + rows], columns]
    on_host = isinstance(number, np.ndarray) and isinstance(links, np.ndarray)
    return (np if on_host else jnp).concatenate([numbers, of_inner], axis=1)


def carriers(n_row: int, carried: Carried) -> Int[ArrayLike, " n_row"]:
    """Return the row whose unknowns move each row: its carrier or, without one, itself, [n_row]."""
    if isinstance(carried[0], np.ndarray):
        found = np.arange(n_row)
        found[carried[0]] = carried[1]
        return found
    return jnp.arange(n_row).at[carried[0]].set(carried[1])


@functools.lru_cache(maxsize=16)
def number_freedoms(
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
    """Number the unknowns and find the pattern of the tangent; cached for later analyses.

    Args:
        fixed: `Fixed`, True where a degree of freedom is fixed, [n_row, 3 or 6].
        rows: `Rows`, or None.
        links: triples (`Indices` of links, degrees of freedom of an end, internal unknowns) for
            every group and every follower load, a tuple; None for no pattern.
        solver: the solver that the pattern is made for; None to choose by size.
        symmetric: whether the tangent is symmetric.
        rigid: rigid links, pairs (carrier, carried node), `Indices` [n, 2], or None.
        space: the `Space`, for the unknowns that a row couples by itself; None for no such
            coupling.
        definite: whether the tangent is known to be positive semidefinite.
        paired: see `linear.make_pattern`.

    Returns:
        `Freedoms`.

    Raises:
        ValueError: a dense matrix, asked for by `solver`, does not fit into memory.
    """
    mask, spins = fixed.array.copy(), fixed.spins
    carried = None
    if rows is not None:
        shared = (np.arange(len(mask)) != rows.node) & ~rows.inner
        mask[shared, :3] = True  # these displacements get the unknowns of their node
    if rigid is not None:
        carried = rigid.array[:, 1], rigid.array[:, 0]
        mask[carried[0]] = True  # carried nodes move by the unknowns of their carriers
    free = np.flatnonzero(~mask.ravel()).astype(np.int32)
    n_free = len(free)
    number = np.full(mask.size, n_free, np.int32)
    number[free] = np.arange(n_free, dtype=np.int32)
    if solver == "dense":
        need = _DENSE_MATRICES * n_free**2 * jnp.zeros(0).dtype.itemsize
        way_out = "linear_solver=None chooses a sparse solver"
        memory.require(need, f'linear_solver = "dense" for {n_free} unknowns', way_out)
    number = number.reshape(mask.shape)
    if rows is not None:
        number[shared, :3] = number[rows.node[shared], :3]
    pattern, coupled = None, [] if space is None else space.coupled(number)
    dense = coupled and linear.choose(n_free, False, solver).on_device
    if links is not None and n_free > 0 and not dense:
        numbers = [
            element_unknowns(number, ends.array, width, inner, carried)
            for ends, width, inner in links
        ]
        pattern = linear.make_pattern(
            [*numbers, *coupled], n_free, symmetric, solver, definite=definite, paired=paired
        )
    return Freedoms(
        places(free),
        places(number),
        fixed.array,
        None if fixed.axes is None else fixed.axes.array,
        None if rows is None else places(rows.node),
        rows.inner if rows is not None and rows.inner.any() else None,
        None if carried is None else tuple(map(places, carried)),
        pattern,
        None if spins is None else (spins.rows, spins.piece, spins.ends),
    )


@functools.lru_cache(maxsize=16)
def gathering(freedoms: Freedoms, links: tuple[Indices, ...], own: bool) -> Freedoms:
    """Add the assembly maps `meeting` and `numbering`; cached for later analyses.

    Args:
        freedoms: from `number_freedoms`.
        links: rows of the elements of every group.
        own: whether every free degree of freedom has an unknown of its own; only then
            `numbering` is added.
    """
    ends = np.concatenate([indices.array.ravel() for indices in links])
    found = {"meeting": linear.gathering(ends, len(freedoms.number))}
    if own:
        numbers = np.asarray(freedoms.number).ravel()
        found["numbering"] = linear.gathering(numbers, len(freedoms.free))
    with jax.ensure_compile_time_eval():  # concrete arrays, also when a caller is being traced
        return copy(freedoms, **jax.tree.map(jax.device_put, found))


def along(axes: Float[ArrayLike, "n 3 3"], vectors: Float[Array, "n 3"]) -> Float[Array, "n 3"]:
    """Return the components of vectors along local axes, the rows of matrices [n, 3, 3]."""
    return jnp.einsum("nij,nj->ni", jnp.asarray(axes, vectors.dtype), vectors)


def combined(
    axes: Float[ArrayLike, "n 3 3"], components: Float[Array, "n 3"]
) -> Float[Array, "n 3"]:
    """Return vectors from their components along local axes, the rows of matrices [n, 3, 3]."""
    return jnp.einsum("nij,ni->nj", jnp.asarray(axes, components.dtype), components)
