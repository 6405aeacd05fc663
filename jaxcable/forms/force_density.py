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
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
from jax import lax

from .. import linear
from ..common import status
from ..common.selection import Only
from ..common.tree import Indices, cast_floats, copy_with, merge_indices, pytree, split_indices
from ..common.types import Array, ArrayLike, Float, Int, PyTree
from ..equilibrium.newton import Newton
from ..loads import Load
from ..mechanics.assembly import System
from ..model import plausibility
from ..model.structure import Structure
from ..model.supports import FixedDofs
from ..numerics import implicit
from ..programs.program_calls import as_program
from ..spaces.dof_map import make_dof_map
from .force_elements import ForceElementNet
from .form_dependent_loads import FormDependentLoads, nodes_coupled_by_loads, split_loads
from .forms_by_analysis import force_density_by_analysis, needs_analysis
from .input_checks import (
    input_status,
    require_single_input,
    require_straight_elements,
    sum_nodal_loads,
    values_by_group,
)

# Forms of given force densities ahead of Newton's method. A saddle net of 64 free nodes, disturbed
# by 0.4 m, takes 80 Newton steps without them (with loads it fails), 5 steps with 5 and 4 with 10.
_N_START_FORMS = 5


def force_density(
    structure: Structure,
    q: PyTree[Float[ArrayLike, " ..."] | Only],
    loads: Load | Sequence[Load] | None = None,
    linear_solver: str | None = None,
) -> Float[Array, "n_node 3"]:
    """Find the positions in which a net with given force densities is in equilibrium.

    The positions solve ``D_ff x_f = p_f - D_fs x_s`` with ``D = C^T diag(q) C``. This is a pure
    function of pytrees: jit, vmap, grad, jvp, jacfwd and hessian work on it, with respect to q,
    supports and loads.

    Args:
        structure: `Structure` of cables and bars. Of its nodes only the held coordinates count.
            Supports may hold any directions (`restrained`), such as radial bearings of a ring.
        q: force over length, N/m: a scalar, [n_elem], or a prefix pytree of the elements. Negative
            in struts, which must be `Bars`.
        loads: any loads that `solve` takes except `Varying`, one or a list of them. Dead loads
            along elements and on areas refer to the lengths and areas of the form found, and to the
            unstressed lengths that follow from its forces, as in an analysis that begins with the
            form. With loads that depend on the form the problem is not linear, and Newton's method
            solves it.
        linear_solver: "dense", "superlu" or "pardiso"; None chooses by size, as `Newton` does.

    Returns:
        Positions of all nodes, [n_node, 3], m. If the matrix of a direction is singular, its free
        coordinates are NaN, with NaN derivatives: supports do not hold the net, all elements at a
        node have the force density zero, or struts and cables cancel each other. With loads other
        than those on nodes, all free coordinates are NaN if there is no form, or if the law of an
        element cannot carry its force. With them, or supports along other directions than x, y, z,
        all coordinates may be.

    Raises:
        ValueError: elements that are not straight, a load that varies, a negative force density in
            a cable, an element without a force density.

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
    require_straight_elements(structure)
    plausibility.warn_of_lost_precision(structure.nodes)
    linear.check_solver_name(linear_solver)
    densities, chosen = values_by_group(q, structure, "q")
    missing = "has no force density; every element needs one"
    require_single_input(structure, ["q"], [chosen], missing)
    if needs_analysis(structure, loads):
        return force_density_by_analysis(structure, densities, loads, linear_solver)
    loads, others = split_loads(structure, loads)
    fixed = FixedDofs(structure.held_displacements())
    links = tuple(group.links for group in structure.groups)
    numbering = number_unknowns_by_axis(fixed, links, linear_solver)
    if others:
        loaded = nodes_coupled_by_loads(structure.groups, others)
        coupled = (*((ends, 3, ()) for ends in links), *loaded)
        dof_map = make_dof_map(fixed, None, coupled, linear_solver, False)
        problem = split_indices((structure.nodes, densities, loads, structure.groups, others))
        method = Newton(linear_solver=linear_solver)
        return _solve_with_form_loads(*problem, numbering, dof_map, method)
    return _solve_with_nodal_loads(*split_indices((structure.nodes, densities, loads)), numbering)


@pytree(static=("axes",))
class _AxesSharingMatrix:
    """Coordinate axes along which supports leave the same nodes free, so that they share a matrix.

    Attributes:
        axes: these axes, of 0, 1, 2.
        free: indices of the free nodes, [n_free].
        unknown_of_end: index of the unknown of both ends of every element, [n_elem, 2]; n_free if
            the end is held.
        pattern: `linear.Pattern` of the matrix.
    """

    axes: tuple[int, ...]
    free: Int[np.ndarray, " n_free"]
    unknown_of_end: Int[np.ndarray, "n_elem 2"]
    pattern: linear.Pattern

    def with_free_coordinates(
        self, positions: Float[Array, "n_node 3"], found: Float[Array, "n_free n_axis"]
    ) -> Float[Array, "n_node 3"]:
        """Return `positions` with the coordinates `found` of free nodes along these axes."""
        at = positions.at[self.free[:, None], np.array(self.axes)]
        return at.set(found, unique_indices=True)


@functools.lru_cache(maxsize=16)
def number_unknowns_by_axis(
    fixed: Indices, links: tuple[Indices, ...], solver: str | None
) -> tuple[Int[np.ndarray, "n_elem 2"], list[_AxesSharingMatrix]]:
    """Number the unknown coordinates, for each set of axes with the same free nodes; cached.

    Args:
        fixed: True where a coordinate is held, `Indices` [n_node, 3].
        links: links of every group, a tuple of `Indices`.
        solver: name of a linear solver, or None.

    Returns:
        Links of all elements, [n_elem, 2], and a list with an item for each set of axes.
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
        blocks.append(_AxesSharingMatrix(tuple(axes), free, number, pattern))
    return ends, blocks


@as_program
def _solve_with_nodal_loads(without_indices, index_arrays, numbering):
    """Return the positions [n_node, 3], m, under nodal loads, by linear solves for sets of axes."""
    parameters = merge_indices(without_indices, index_arrays)
    nodes, densities, loads = parameters
    nodes = jnp.asarray(nodes)
    q = jnp.concatenate([jnp.asarray(density, nodes.dtype) for density in densities])
    load = sum_nodal_loads(loads, nodes.shape, nodes.dtype)
    positions = nodes
    for block in numbering[1]:
        found = _solve_differentiably(AxisEquilibrium.build(nodes, q, load, numbering[0], block))
        found = implicit.nan_unless(jnp.all(jnp.isfinite(found)), found, parameters)
        positions = block.with_free_coordinates(positions, found)
    return positions


@as_program
def _solve_with_form_loads(without_indices, index_arrays, numbering, dof_map, method):
    """Find the positions, [n_node, 3], under loads that depend on the form, by Newton's method.

    Elements are springs of unstressed length zero that pull with ``q l``. Compiled.
    """
    parameters = merge_indices(without_indices, index_arrays)
    dtype = parameters[0].dtype
    nodes, densities, loads, groups, others = cast_floats(parameters, dtype)
    force_net = ForceElementNet(
        nodes,
        [group.links for group in groups],
        [jnp.zeros_like(q) for q in densities],
        [(q, jnp.zeros_like(q)) for q in densities],
        sum_nodal_loads(loads, nodes.shape, dtype),
        FormDependentLoads(groups, others),
    )
    q = lax.stop_gradient(jnp.concatenate(densities))
    allowed = input_status(nodes, groups, others)
    laws = lax.stop_gradient(groups)

    def begin(system):
        return start_displacements_by_force_density(system, lambda _: q, numbering)

    _, code, _, moved = force_net.find_equilibrium(begin, method, dof_map, allowed, laws)
    moved = implicit.nan_unless(code == status.OK, moved, parameters)
    free = jnp.zeros(nodes.size, bool).at[dof_map.free].set(True).reshape(nodes.shape)
    return jnp.where(free, nodes + moved, nodes)


def start_displacements_by_force_density(
    system: System,
    densities: Callable[[Float[Array, "n_node 3"]], Float[Array, " n_elem"]],
    numbering: tuple[Int[np.ndarray, "n_elem 2"], list[_AxesSharingMatrix]],
) -> Float[Array, "n_node 3"]:
    """Find start displacements for Newton's method, [n_node, 3], m, by the force density method.

    It is applied a few times, each with force densities and loads at the previous positions.

    Args:
        system: `System` of a `ForceElementNet`.
        densities: function of positions [n_node, 3] that returns force densities, [n_elem].
        numbering: from `number_unknowns_by_axis`.
    """

    def step(_, x):
        follows = system.followers is not None
        load = system.load + system.follower_forces(x) if follows else system.load
        new = solve_positions(system.nodes, densities(x), load, numbering)
        return jnp.where(jnp.all(jnp.isfinite(new)), new, x)

    return lax.fori_loop(0, _N_START_FORMS, step, system.nodes) - system.nodes


def solve_positions(
    nodes: Float[Array, "n_node 3"],
    q: Float[Array, " n_elem"],
    load: Float[Array, "n_node 3"],
    numbering: tuple[Int[np.ndarray, "n_elem 2"], list[_AxesSharingMatrix]],
) -> Float[Array, "n_node 3"]:
    """Solve for the positions [n_node, 3], m, in which given force densities are in equilibrium.

    Not differentiable; NaN along axes whose matrix is singular.

    Args:
        nodes: positions of the supports; other rows do not count, [n_node, 3], m.
        q: force densities, [n_elem], N/m.
        load: nodal loads, [n_node, 3], N.
        numbering: from `number_unknowns_by_axis`.
    """
    positions = nodes
    for block in numbering[1]:
        balance = AxisEquilibrium.build(nodes, q, load, numbering[0], block)
        positions = block.with_free_coordinates(positions, balance.solve(balance.rhs()))
    return positions


@pytree
class AxisEquilibrium:
    """Equilibrium ``D_ff x_f = p_f - D_fs x_s`` of free nodes (f) along axes that share a matrix.

    Attributes:
        q: force densities, [n_elem], N/m.
        held: difference of the coordinates of both ends of every element, [n_elem, n_axis], m, with
            zero in place of those of free ends.
        load: loads on the free nodes, [n_free, n_axis], N.
        block: the axes and the numbering of their unknowns.
        factor: factor of the matrix ``D_ff``, not differentiated.
    """

    q: Float[Array, " n_elem"]
    held: Float[Array, "n_elem n_axis"]
    load: Float[Array, "n_free n_axis"]
    block: _AxesSharingMatrix
    factor: linear.OnDeviceFactor | linear.SparseFactor

    @classmethod
    def build(
        cls,
        nodes: Float[Array, "n_node 3"],
        q: Float[Array, " n_elem"],
        load: Float[Array, "n_node 3"],
        links: Int[np.ndarray, "n_elem 2"],
        block: _AxesSharingMatrix,
    ) -> AxisEquilibrium:
        """Assemble and factorise the matrix of the axes in `block`, and return the equations.

        `nodes`, `q` and `load` are as in `solve_positions`; `links` has all elements, [n_elem, 2].
        Sparse matrices are factorised when they are first solved with.
        """
        axes = np.array(block.axes)
        held = nodes[:, axes].at[block.free].set(0.0, unique_indices=True)
        blocks = jnp.stack([q, -q, -q, q], axis=1).reshape(-1, 2, 2)
        parts: Any = [(lax.stop_gradient(blocks), block.unknown_of_end)]
        matrix = linear.assemble_matrix(parts, len(block.free), block.pattern)
        held = held[links[:, 0]] - held[links[:, 1]]
        return cls(q, held, load[block.free][:, axes], block, linear.factorize(matrix))

    def sum_at_free_nodes(
        self, difference: Float[Array, "n_elem n_axis"]
    ) -> Float[Array, "n_free n_axis"]:
        """Sum the forces ``q (x_i - x_j)`` of the elements at the free nodes, [n_free, n_axis], N.

        `difference` has the coordinate differences ``x_i - x_j``, [n_elem, n_axis], m.
        """
        force = self.q[:, None] * difference
        ends = jnp.stack([force, -force], axis=1)
        zero = jnp.zeros((len(self.block.free), force.shape[1]), force.dtype)
        return zero.at[self.block.unknown_of_end].add(ends, mode="drop")

    def apply_matrix(self, x: Float[Array, "n_free n_axis"]) -> Float[Array, "n_free n_axis"]:
        """Return ``D_ff x``, [n_free, n_axis], for coordinates x of the free nodes."""
        ends = x.at[self.block.unknown_of_end].get(mode="fill", fill_value=0.0)
        return self.sum_at_free_nodes(ends[:, 0] - ends[:, 1])

    def rhs(self) -> Float[Array, "n_free n_axis"]:
        """Return ``p_f - D_fs x_s``, [n_free, n_axis], N: loads and the pull of supports."""
        return self.load - self.sum_at_free_nodes(self.held)

    def solve(self, rhs: Float[Array, "n_free n_axis"]) -> Float[Array, "n_free n_axis"]:
        """Solve ``D_ff x = rhs`` for all axes with one factor; NaN if the matrix is singular."""

        def solve_column(b):
            return self.factor.solve(b, lambda v: self.apply_matrix(v[:, None])[:, 0])

        return jax.vmap(solve_column, 1, 1)(rhs)


def _solve_differentiably(balance):
    """Solve an `AxisEquilibrium` for the free coordinates [n_free, n_axis], differentiably.

    They are NaN if the matrix is singular. The implicit derivative is attached to a value computed
    before, so that a singular case does not make other cases of a batch NaN.
    """
    start = lax.stop_gradient(balance.solve(balance.rhs()))
    ok = jnp.all(jnp.isfinite(start))
    q, held, load = implicit.stop_gradient_unless(ok, (balance.q, balance.held, balance.load))
    balance = copy_with(balance, q=q, held=held, load=load)

    def residual(x):
        return balance.apply_matrix(x) - balance.rhs()

    def tangent_solve(_, rhs):
        return balance.solve(rhs)

    safe = jnp.where(ok, start, 0.0)
    x = lax.custom_root(residual, safe, lambda _, x: x, tangent_solve)
    return jnp.where(ok, x, jnp.nan)
