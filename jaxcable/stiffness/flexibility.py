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
from .tangent import displaced_by, prepared, require_memory, tangent_at

AXES = {"x": 0, "y": 1, "z": 2}
DENSE = 6  # matrices at once, measured: displacements by unknowns, tangent, scaled form, factor


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
        ValueError: unknown nodes or axes; more unknowns than dense matrices have memory for.

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
    nodes = checks.integers(nodes, "nodes")
    checks.known(nodes, structure.n_node, "nodes")
    if not isinstance(axes, str) or not axes or set(axes) - set(AXES):
        raise ValueError(f'axes = {axes!r}: expected some of "x", "y", "z"')
    at = prepared(structure, state, fixed)
    require_memory(at[2], DENSE, "flexibility")
    moved = displaced_by(*at)
    unit = moved[nodes][:, np.array([AXES[a] for a in axes])].reshape(-1, moved.shape[2])
    return _flexibility(tangent_at(*at), unit)


@jax.jit
def _flexibility(stiffness, unit):
    """The compiled core; `unit` has the displacements asked about per unknown, [m, n_free]."""
    factor = linear.factorize(stiffness)
    given = jax.vmap(lambda b: factor.solve(b, lambda v: stiffness @ v), out_axes=1)(unit)
    free = jnp.any(unit != 0, axis=1)
    return jnp.where(free[:, None] & free[None, :], unit @ given, 0.0)
