"""Flexibility: displacements of a loaded state by small forces."""

from __future__ import annotations

import jax
import jax.numpy as jnp
import numpy as np

from .. import linear
from ..analysis.solution import Solution, State
from ..common import checks
from ..common.types import Array, ArrayLike, Bool, Float, Int
from ..model.structure import Structure
from .tangent import displaced_by, prepared, tangent_of

AXES = {"x": 0, "y": 1, "z": 2}


def flexibility(
    structure: Structure,
    state: Solution | State,
    nodes: Int[ArrayLike, " n"],
    axes: str = "xyz",
    fixed: Bool[ArrayLike, "n_row n_freedom"] | None = None,
) -> Float[Array, "m m"]:
    """Displacements by unit forces at chosen freedoms of a loaded state, a part of ``K^-1``.

    Symmetric unless following loads act. Differentiable like the solution. NaN where the tangent
    stiffness is singular (a mechanism without prestress, a loose node, a limit point).

    Args:
        structure: the `Structure` that was analysed.
        state: `Solution` (its last converged state is used) or `State`.
        nodes: node numbers, [n].
        axes: directions at each of the nodes, a string of "x", "y", "z".
        fixed: freedoms to leave out, as in `stiffness.tangent_of`.

    Returns:
        [m, m], m/N, with m = n times the number of axes, node by node: entry (i, j) is the
        displacement of freedom i by a unit force at freedom j; zero where i or j is held.

    Raises:
        ValueError: unknown nodes or axes.

    Example:
        The vertical stiffness at a node between two cables (14600 N/m, see `tangent_of`):

        >>> nodes = [[-4.0, 0.0, 3.0], [0.0, 0.0, 0.0], [4.0, 0.0, 3.0]]
        >>> cables = jc.Cables([[0, 1], [1, 2]], axial_stiffness=1e5)
        >>> structure = jc.Structure(nodes, cables, supports=jc.pinned([0, 2]))
        >>> weight = jc.NodalLoads([1], (0.0, 0.0, -600.0))
        >>> solution = jc.solve(structure, jc.Phase(pretension=500.0, loads=weight))
        >>> given = jc.stiffness.flexibility(structure, solution, [1], axes="z")
        >>> print(solution.status, f"{1 / given[0, 0]:.3f} N/m")
        0 14600.000 N/m
    """
    nodes = checks.integers(nodes, "nodes")
    checks.known(nodes, structure.n_node, "nodes")
    if not isinstance(axes, str) or not axes or set(axes) - set(AXES):
        raise ValueError(f'axes = {axes!r}: expected some of "x", "y", "z"')
    moved = displaced_by(*prepared(structure, state, fixed))
    unit = moved[nodes][:, np.array([AXES[a] for a in axes])].reshape(-1, moved.shape[2])
    stiffness = tangent_of(structure, state, fixed)
    factor = linear.factorize(stiffness)
    given = jax.vmap(lambda b: factor.solve(b, lambda v: stiffness @ v), out_axes=1)(unit)
    free = jnp.any(unit != 0, axis=1)
    return jnp.where(free[:, None] & free[None, :], unit @ given, 0.0)
