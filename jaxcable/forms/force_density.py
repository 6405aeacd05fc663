"""The force density method: the form of a net whose ratios of force to length are given.

With ``q = N / l`` equilibrium is linear in the positions, and the same in each direction:

    sum_j q_ij (x_i - x_j) = p_i,      D_ff x_f = p_f - D_fs x_s,      D = C^T Q C

(Schek 1974, The force density method for form finding and computation of general networks; after
Linkwitz). The matrix has one unknown per node instead of three. Where supports hold whole nodes it
is factorised once for the right sides of x, y and z.
"""

from __future__ import annotations

import functools
from collections.abc import Callable, Sequence

import jax
import jax.numpy as jnp
import numpy as np
from jax import lax

from .. import linear
from ..common import status
from ..common.selection import Only
from ..common.tree import Indices, cast, copy, fill, pytree, thaw
from ..common.types import Array, ArrayLike, Float, Int, PyTree
from ..equilibrium.newton import Newton
from ..loads import Load
from ..mechanics.assembly import System
from ..model import plausibility
from ..model.structure import Structure
from ..model.supports import Fixed
from ..numerics import implicit
from ..spaces.freedoms import number_freedoms
from .along import OnForm, split, touched
from .members import check_members, require_one, stated, total, verdict
from .strings import StringNet

_FIRST = 5  # forms of given force densities ahead of Newton's method


def force_density(
    structure: Structure,
    q: PyTree[Float[ArrayLike, " ..."] | Only],
    loads: Load | Sequence[Load] | None = None,
    linear_solver: str | None = None,
) -> Float[Array, "n_node 3"]:
    """Positions in which a net with given force densities is in equilibrium.

    The positions solve ``D_ff x_f = p_f - D_fs x_s`` with ``D = C^T diag(q) C``. This is a pure
    function of pytrees: jit, vmap, grad, jvp, jacfwd and hessian work on it, with respect to q,
    supports and loads.

    Args:
        structure: `Structure` of cables and bars. Of its nodes only the held coordinates count.
        q: force over length, N/m: a scalar, [n_elem], or a prefix pytree of the elements. Negative
            in struts, which must be `Bars`.
        loads: `NodalLoads`, `SelfWeight`, `LineLoads` and `AreaLoads`, one or a list of them. Loads
            along elements and on areas are per lengths and areas of the form found, and per
            unstressed lengths that go with its forces, as in an analysis that begins with the form.
            With them the problem is not linear, and Newton's method solves it.
        linear_solver: "dense", "superlu" or "pardiso"; None chooses by size, as `Newton` does.

    Returns:
        Positions of all nodes, [n_node, 3], m. If the matrix of a direction is singular (supports
        do not hold the net, a node has no force density at all, or struts and cables cancel), its
        free coordinates are NaN, with NaN derivatives. With loads along elements or on areas all
        free coordinates are NaN if there is no form, or one that an element's law cannot bear.

    Raises:
        ValueError: elements that are not straight members, other loads, a negative force density
            in a cable, an element without a force density.

    Source: Schek (1974), after Linkwitz.

    Example:
        Equal loads on equal force densities hang in a parabola, ``z = -F / 2 q k (4 - k)``:

        >>> nodes = [[k, 0.0, 0.0] for k in range(5)]
        >>> cables = jc.Cables([[0, 1], [1, 2], [2, 3], [3, 4]], axial_stiffness=1e5)
        >>> structure = jc.Structure(nodes, cables, supports=jc.pinned([0, 4]))
        >>> loads = jc.NodalLoads([1, 2, 3], (0.0, 0.0, -100.0))
        >>> positions = jc.force_density(structure, 100.0, loads)
        >>> print(jnp.round(positions[:, 2], 9))
        [ 0.  -1.5 -2.  -1.5  0. ]

        A net with edge cables between two masts with guys and two blocks. Forces in masts and guys
        follow from the net: first its force densities (edges about ten times the net) with the
        heads of the masts held, then `find_form` with the lengths of masts and guys as drawn:

        >>> nodes = [[0.0, 0, 0], [8, 0, 4], [8, 8, 0], [0, 8, 4], [4, 4, 2]]  # corners, middle
        >>> nodes += [[4, 0, 2], [8, 4, 2], [4, 8, 2], [0, 4, 2]]  # middles of the edges
        >>> nodes += [[9, -1, 0], [15, -3, 0], [11, -7, 0]]  # foot of a mast, feet of its guys
        >>> nodes += [[-1, 9, 0], [-3, 15, 0], [-7, 11, 0]]
        >>> elements = {
        ...     "NET": jc.Cables([[5, 4], [4, 7], [6, 4], [4, 8]], 1e6),
        ...     "EDGE": jc.Cables(
        ...         [[0, 5], [5, 1], [1, 6], [6, 2], [2, 7], [7, 3], [3, 8], [8, 0]], 1e7
        ...     ),
        ...     "MAST": jc.Bars([[9, 1], [12, 3]], 1e9),
        ...     "GUY": jc.Cables([[1, 10], [1, 11], [3, 13], [3, 14]], 1e7),
        ... }
        >>> ground = jc.pinned([0, 2, 9, 10, 11, 12, 13, 14])
        >>> roof = jc.Structure(nodes, elements, ground)
        >>> held = jc.replace(roof, supports=ground + jc.pinned([1, 3]))
        >>> q = {"NET": 1e3, "EDGE": 10e3, "MAST": 0.0, "GUY": 0.0}
        >>> shape = jc.replace(roof, nodes=jc.force_density(held, q))
        >>> def lengths(name):
        ...     ends = shape.nodes[np.asarray(elements[name].links)]
        ...     return jnp.linalg.norm(ends[:, 1] - ends[:, 0], axis=1)
        >>> form = jc.find_form(
        ...     shape,
        ...     tension={k: q[k] * lengths(k) if q[k] else None for k in q},
        ...     length={k: None if q[k] else lengths(k) for k in q},
        ... )
        >>> print(jc.describe(form.status))
        converged
        >>> print({k: round(float(form.tension[k][0]) / 1e3, 1) for k in q}, "kN")
        {'NET': 3.8, 'EDGE': 44.8, 'MAST': -97.5, 'GUY': 55.8} kN
    """
    check_members(structure)
    plausibility.precision(structure.nodes)
    linear.check(linear_solver)
    loads, others = split(structure, loads)
    densities, chosen = stated(q, structure, "q")
    missing = "has no force density; every element needs one"
    require_one(structure, ["q"], [chosen], missing)
    fixed = Fixed(structure.held())
    links = tuple(group.links for group in structure.groups)
    net = number_axes(fixed, links, linear_solver)
    if others:
        coupled = (*((ends, 3, ()) for ends in links), *touched(structure, others))
        freedoms = number_freedoms(fixed, None, coupled, linear_solver, False)
        task = thaw((structure.nodes, densities, loads, structure.groups, others))
        return _loaded(*task, net, freedoms, Newton(linear_solver=linear_solver))
    return _positions(*thaw((structure.nodes, densities, loads)), net)


@pytree(static=("axes",))
class _Block:
    """Directions in which supports leave the same nodes free; they share one matrix.

    Attributes:
        axes: these directions, of 0, 1, 2.
        free: numbers of the free nodes, [n_free].
        number: unknown of both ends of every element, n_free if the end is held, [n_elem, 2].
        pattern: `linear.Pattern` of the matrix.
    """

    axes: tuple[int, ...]
    free: Int[Array, " n_free"]
    number: Int[Array, "n_elem 2"]
    pattern: linear.Pattern

    def place(
        self, positions: Float[Array, "n_node 3"], found: Float[Array, "n_free n_axis"]
    ) -> Float[Array, "n_node 3"]:
        """Positions [n_node, 3] with the free coordinates `found`, [n_free, n_axis]."""
        at = positions.at[self.free[:, None], np.array(self.axes)]
        return at.set(found, unique_indices=True)


@functools.lru_cache(maxsize=16)
def number_axes(
    fixed: Indices, links: tuple[Indices, ...], solver: str | None
) -> tuple[Int[Array, "n_elem 2"], list[_Block]]:
    """Links of all elements, [n_elem, 2], and the blocks of directions; cached.

    Args:
        fixed: True where a coordinate is held, `Indices` [n_node, 3].
        links: links of every group, a tuple of `Indices`.
        solver: name of a linear solver, or None.
    """
    mask, ends = fixed.array, np.concatenate([group_links.array for group_links in links])
    alike = {}
    for axis in range(3):
        alike.setdefault(mask[:, axis].tobytes(), []).append(axis)
    blocks = []
    for axes in alike.values():
        free = np.flatnonzero(~mask[:, axes[0]]).astype(np.int32)
        if len(free) == 0:
            continue
        number = np.full(len(mask), len(free), np.int32)
        number[free] = np.arange(len(free), dtype=np.int32)
        number = number[ends]
        pattern = linear.make_pattern([number], len(free), True, solver)
        with jax.ensure_compile_time_eval():  # known arrays, even if a caller is being traced
            blocks.append(_Block(tuple(axes), jnp.asarray(free), jnp.asarray(number), pattern))
    with jax.ensure_compile_time_eval():
        return jnp.asarray(ends), blocks


@jax.jit
def _positions(thawed, arrays, net):
    """The compiled core with nodal loads: one linear solve per block of directions."""
    parameters = fill(thawed, arrays)
    nodes, densities, loads = parameters
    nodes = jnp.asarray(nodes)
    q = jnp.concatenate([jnp.asarray(density, nodes.dtype) for density in densities])
    load = total(loads, nodes.shape, nodes.dtype)
    positions = nodes
    for block in net[1]:
        found = _differentiable(Balance.build(nodes, q, load, net[0], block))
        found = implicit.nan_unless(jnp.all(jnp.isfinite(found)), found, parameters)
        positions = block.place(positions, found)
    return positions


@jax.jit
def _loaded(thawed, arrays, net, freedoms, method):
    """The compiled core with loads that depend on the form: Newton's method for all coordinates.

    Members are springs that pull with ``q l``; see `strings`.
    """
    parameters = fill(thawed, arrays)
    dtype = parameters[0].dtype
    nodes, densities, loads, groups, others = cast(parameters, dtype)
    strings = StringNet(
        nodes,
        [group.links for group in groups],
        [jnp.zeros_like(q) for q in densities],
        [(q, jnp.zeros_like(q)) for q in densities],
        total(loads, nodes.shape, dtype),
        OnForm(groups, others),
    )
    q = lax.stop_gradient(jnp.concatenate(densities))
    allowed = verdict(nodes, groups, others)
    laws = lax.stop_gradient(groups)

    def begin(system):
        return draped(system, lambda _: q, net)

    _, code, _, moved = strings.equilibrated(begin, method, freedoms, allowed, laws)
    moved = implicit.nan_unless(code == status.OK, moved, parameters)
    free = jnp.zeros(nodes.size, bool).at[freedoms.free].set(True).reshape(nodes.shape)
    return jnp.where(free, nodes + moved, nodes)


def draped(
    system: System,
    densities: Callable[[Float[Array, "n_node 3"]], Float[Array, " n_elem"]],
    net: tuple[Int[Array, "n_elem 2"], list[_Block]],
) -> Float[Array, "n_node 3"]:
    """Displacements [n_node, 3] for the start, by some forms of given force densities.

    Args:
        system: that of a `StringNet`; each form has its loads in the form before.
        densities: force densities as a function of the positions in the form before, [n_elem].
        net: the numbering of `number_axes`.
    """

    def step(_, x):
        follows = system.followers is not None
        load = system.load + system.following(x) if follows else system.load
        new = shape(system.nodes, densities(x), load, net)
        return jnp.where(jnp.all(jnp.isfinite(new)), new, x)

    return lax.fori_loop(0, _FIRST, step, system.nodes) - system.nodes


def shape(
    nodes: Float[Array, "n_node 3"],
    q: Float[Array, " n_elem"],
    load: Float[Array, "n_node 3"],
    net: tuple[Int[Array, "n_elem 2"], list[_Block]],
) -> Float[Array, "n_node 3"]:
    """Positions [n_node, 3] for force densities [n_elem], with the numbering of `number_axes`.

    Not differentiable; NaN in directions whose matrix is singular.
    """
    positions = nodes
    for block in net[1]:
        balance = Balance.build(nodes, q, load, net[0], block)
        positions = block.place(positions, balance.solve(balance.rhs()))
    return positions


@pytree
class Balance:
    """Equilibrium along the axes of a block, linear in the free coordinates.

    Attributes:
        q: force densities, [n_elem], N/m.
        held: difference of the coordinates of the ends of every element, those of free ends being
            zero, [n_elem, n_axis], m.
        load: loads on the free nodes, [n_free, n_axis], N.
        block: `_Block`.
        factor: factor of its matrix, a constant.
    """

    q: Float[Array, " n_elem"]
    held: Float[Array, "n_elem n_axis"]
    load: Float[Array, "n_free n_axis"]
    block: _Block
    factor: linear.Direct | linear.SparseFactor

    @classmethod
    def build(
        cls,
        nodes: Float[Array, "n_node 3"],
        q: Float[Array, " n_elem"],
        load: Float[Array, "n_node 3"],
        links: Int[Array, "n_elem 2"],
        block: _Block,
    ) -> Balance:
        """Assemble and, with dense matrices, factorise."""
        axes = np.array(block.axes)
        held = nodes[:, axes].at[block.free].set(0.0, unique_indices=True)
        blocks = jnp.stack([q, -q, -q, q], axis=1).reshape(-1, 2, 2)
        parts = [(lax.stop_gradient(blocks), block.number)]
        matrix = linear.assemble(parts, len(block.free), block.pattern)
        held = held[links[:, 0]] - held[links[:, 1]]
        return cls(q, held, load[block.free][:, axes], block, linear.factorize(matrix))

    def gather(self, difference: Float[Array, "n_elem n_axis"]) -> Float[Array, "n_free n_axis"]:
        """Sum of ``q (x_i - x_j)`` at the free nodes, from ``x_i - x_j``, [n_elem, n_axis]."""
        force = self.q[:, None] * difference
        ends = jnp.stack([force, -force], axis=1)
        zero = jnp.zeros((len(self.block.free), force.shape[1]), force.dtype)
        return zero.at[self.block.number].add(ends, mode="drop")

    def pull(self, x: Float[Array, "n_free n_axis"]) -> Float[Array, "n_free n_axis"]:
        """``D_ff x``, [n_free, n_axis]: `gather` of free coordinates x, held ones being zero."""
        ends = x.at[self.block.number].get(mode="fill", fill_value=0.0)
        return self.gather(ends[:, 0] - ends[:, 1])

    def rhs(self) -> Float[Array, "n_free n_axis"]:
        """``p_f - D_fs x_s``, [n_free, n_axis]."""
        return self.load - self.gather(self.held)

    def solve(self, rhs: Float[Array, "n_free n_axis"]) -> Float[Array, "n_free n_axis"]:
        """Solve for all columns with one factor; NaN if the matrix is singular."""

        def solve_column(b):
            return self.factor.solve(b, lambda v: self.pull(v[:, None])[:, 0])

        return jax.vmap(solve_column, 1, 1)(rhs)


def _differentiable(balance):
    """Free coordinates [n_free, n_axis], with their derivative; NaN if the matrix is singular.

    The value is computed first, and the derivative attached to it afterwards, so that a singular
    case does not pollute the other cases of a batch.
    """
    start = lax.stop_gradient(balance.solve(balance.rhs()))
    ok = jnp.all(jnp.isfinite(start))
    q, held, load = implicit.gate(ok, (balance.q, balance.held, balance.load))
    balance = copy(balance, q=q, held=held, load=load)

    def residual(x):
        return balance.pull(x) - balance.rhs()

    def tangent_solve(_, rhs):
        return balance.solve(rhs)

    safe = jnp.where(ok, start, 0.0)
    x = lax.custom_root(residual, safe, lambda _, x: x, tangent_solve)
    return jnp.where(ok, x, jnp.nan)
