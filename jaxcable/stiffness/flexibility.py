"""Flexibility matrix: displacements of a loaded state by unit forces."""

from __future__ import annotations

import jax
import jax.numpy as jnp
import numpy as np

from .. import linear
from ..analysis.solution import Solution, State
from ..common import checks
from ..common.types import Array, ArrayLike, Bool, Float, Int
from ..model.structure import Structure
from ..programs.program_calls import as_program
from .tangent import require_dense_memory, split_solution_state, tangent_and_displacements

_AXIS_INDEX = {"x": 0, "y": 1, "z": 2}
# dense matrices in memory at once, measured: displacements by unknowns, tangent, scaled, factor
_DENSE_MATRICES = 6


def flexibility(
    structure: Structure,
    state: Solution | State,
    nodes: Int[ArrayLike, " n"],
    axes: str = "xyz",
    fixed: Bool[ArrayLike, "n_row n_freedom"] | None = None,
) -> Float[Array, "m m"]:
    """Compute the flexibility matrix of some nodes: their displacements by small unit forces.

    These are added to a loaded state; the matrix is a part of ``K^-1`` with the tangent stiffness
    K. It is symmetric unless follower loads act, and differentiable like the solution. It is NaN
    where K is singular (a mechanism without prestress, a node with slack cables only, a limit
    point).

    Args:
        structure: the `Structure` that was analysed.
        state: `Solution` (NaN if it has failed) or `State`.
        nodes: node numbers, [n].
        axes: directions at each of the nodes, a string of "x", "y", "z".
        fixed: degrees of freedom to leave out, as in `stiffness.tangent_stiffness`.

    Returns:
        [m, m], m/N, with m = n times the number of axes, node by node: entry (i, j) is the
        displacement of degree of freedom i by a unit force at j; zero where i or j is held.

    Raises:
        ValueError: unknown nodes or axes; too many unknowns for dense matrices in the memory
            there is.

    Example:
        A tripod with legs of 5 m has ``3/2 EA/l 0.6^2`` = 108 kN/m sideways and ``3 EA/l 0.8^2`` =
        384 kN/m downward:

        >>> around = 2 * np.pi * np.arange(3) / 3
        >>> feet = np.column_stack([3 * np.cos(around), 3 * np.sin(around), 0 * around])
        >>> legs = jc.Bars([[0, 3], [1, 3], [2, 3]], axial_stiffness=1e6)
        >>> structure = jc.Structure([*feet, [0.0, 0.0, 4.0]], legs, supports=jc.pinned([0, 1, 2]))
        >>> solution = jc.solve(structure, jc.Phase())
        >>> given = jc.stiffness.flexibility(structure, solution, [3])
        >>> print(solution.status, jnp.round(1 / jnp.diagonal(given), 3))  # N/m
        0 [108000. 108000. 384000.]
    """
    nodes = checks.as_indices(nodes, "nodes")
    checks.require_known_nodes(nodes, structure.n_node, "nodes")
    if not isinstance(axes, str) or not axes or set(axes) - set(_AXIS_INDEX):
        raise ValueError(f'axes = {axes!r}: expected some of "x", "y", "z"')
    at = split_solution_state(structure, state, fixed)
    require_dense_memory(at[2], _DENSE_MATRICES, "flexibility")
    return _displacements_by_unit_forces(*at, nodes, np.array([_AXIS_INDEX[a] for a in axes]))


@as_program
def _displacements_by_unit_forces(without_indices, index_arrays, dof_map, nodes, axes):
    """Return the displacements of nodes along axes by unit forces, [m, m], m/N.

    They are ``unit K^-1 unit^T``, where `unit` [m, n_free] maps the unknowns to the displacements.
    `nodes` are indices, `axes` are 0, 1, 2 for x, y, z; other arguments are as of
    `tangent_and_displacements`.
    """
    stiffness, _, moved = tangent_and_displacements(without_indices, index_arrays, dof_map)
    unit = moved[nodes][:, axes].reshape(-1, moved.shape[2])
    factor = linear.factorize(stiffness)
    given = jax.vmap(lambda b: factor.solve(b, lambda v: stiffness @ v), out_axes=1)(unit)
    free = jnp.any(unit != 0, axis=1)
    return jnp.where(free[:, None] & free[None, :], unit @ given, 0.0)
