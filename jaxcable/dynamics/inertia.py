"""Stiffness and mass of a loaded state on one pattern, with the masses at nodes."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, TypeAlias

import jax
import jax.numpy as jnp
import numpy as np
from jax.scipy.sparse.linalg import cg

from ..analysis.solution import Solution, State
from ..common import checks
from ..common.rules import nan_if_broken, not_negative
from ..common.tree import Indices, pytree
from ..common.types import Array, ArrayLike, Bool, Float
from ..linear import Matrix, diagonal
from ..loads.masses import PointMasses
from ..mechanics.assembly import System
from ..mechanics.bundles import Bundles
from ..mechanics.restart_state import make_system
from ..model.structure import Structure
from ..spaces.dof_map import make_dof_map
from ..spaces.space import MatrixPart, Motion
from ..stiffness.tangent import merge_solution_state, split_solution_state

# Unknowns up to which matrices are dense: a pattern and its analysis would take longer.
_DENSE_UNKNOWNS = 300
_MAX_CG_STEPS = 300  # of conjugate gradients with a mass matrix; 10 to 60 are needed

Masses: TypeAlias = (
    "Float[ArrayLike, ' n_node'] | Float[ArrayLike, ''] | PointMasses | Sequence[PointMasses]"
)


@pytree(kw_only=True)
class SystemWithNodalMasses(System):
    """A system with masses at nodes, beside those of elements, for its matrices at rest.

    Attributes:
        nodal_mass: at every node, [n_node], kg.
    """

    nodal_mass: Float[Array, " n_node"]

    def external_stiffness_parts(self, x: Motion) -> list[MatrixPart]:
        """Return the parts of the load stiffness, and a zero part in place of nodal masses."""
        return self._insert_nodal_masses(super().external_stiffness_parts(x), 0.0, x)

    def external_mass_parts(self, x: Motion) -> list[MatrixPart]:
        """Return the part of the nodal masses, kg, beside zero parts like the load stiffness."""
        parts = super().external_mass_parts(x)
        del parts[self._index_of_nodal_masses(parts)]
        return self._insert_nodal_masses(parts, 1.0, x)

    def _insert_nodal_masses(self, parts, factor, x):
        """Return matrix parts with the one of nodal masses, times `factor`, inserted among them."""
        blocks = factor * self.nodal_mass[:, None, None] * jnp.eye(3, dtype=x.dtype)[None]
        nodes = jnp.arange(len(self.nodal_mass))[:, None]
        own = self.space.transform_to_unknowns(blocks, nodes, 3, (), x)
        at = len(parts) - int(self.space.rotates)
        return [*parts[:at], own, *parts[at:]]

    def _index_of_nodal_masses(self, parts):
        """Return the index of nodal masses in parts: before those of moments on rotating nodes."""
        return len(parts) - 1 - int(self.space.rotates)


def split_state_for_modes(
    structure: Structure,
    state: Solution | State,
    fixed: Bool[ArrayLike, "n_row n_freedom"] | None,
    linear_solver: str | None,
) -> tuple[Any, list[np.ndarray], Any]:
    """Split a state into arrays, indices and dof map, with places for masses in its pattern.

    The result is that of `split_solution_state`; a small structure has dense matrices, no pattern.

    Args:
        structure, state, fixed: as for `modes`.
        linear_solver: name of the solver that the pattern is made for; None to choose by size, and
            dense matrices if it is small.
    """
    groups = structure.motion_rows()[1]
    last = state.last if isinstance(state, Solution) else state

    def number(fixed, rows):
        plain = make_dof_map(fixed, rows, rigid=structure.rigid)
        small = linear_solver is None and len(plain.free) <= _DENSE_UNKNOWNS
        if small or linear_solver == "dense":
            return plain
        followers = [stack for stack in last.restart.loads if stack.follows]
        sizes = tuple(len(group.links) for group in groups)
        alone = Bundles(tuple((k,) for k in range(len(groups))), sizes)
        links = [(group.links, group.n_freedom, group.inner_unknowns) for group in groups]
        links += [(at, 3, ()) for stack in followers for at in stack.coupled_nodes(groups, alone)]
        links.append((Indices(np.arange(structure.n_node)[:, None]), 3, ()))
        space = structure.space
        symmetric = space.symmetric and not followers and all(g.symmetric for g in groups)
        settings = linear_solver, symmetric, structure.rigid, space
        return make_dof_map(fixed, rows, tuple(links), *settings)

    return split_solution_state(structure, state, fixed, number=number)


def make_system_with_nodal_masses(
    split: Any, masses: Float[Array, " n_node"]
) -> tuple[SystemWithNodalMasses, Motion]:
    """Return the `SystemWithNodalMasses` of a split state, and the motion of all its rows.

    `split` is from `split_state_for_modes`; `masses` are those at nodes, [n_node], kg.
    """
    without_indices, index_arrays, dof_map = split
    nodes, groups, restart = merge_solution_state(without_indices, index_arrays)
    system = make_system(nodes, groups, restart, restart.motion, dof_map)
    masses = jnp.asarray(masses, nodes.dtype)
    return SystemWithNodalMasses(**vars(system), nodal_mass=masses), restart.motion


def mass_times_ground_motion(
    system: SystemWithNodalMasses, x: Motion, gravity: Float[Array, ""], distribution: str | None
) -> Float[Array, "n_free 3"]:
    """Return the mass matrix times a unit motion of the ground along x, y and z, [n_free, 3], kg.

    All nodes move with the ground, supports included, so that the mass that couples unknowns to
    supports counts. The products are the loads on unknowns for a ground that accelerates by
    -1 m/s2.
    """
    ends: list[list[Array]] = [[], [], []]
    for group, blocks in zip(
        system.groups, system.mass_matrices(x, gravity, distribution), strict=True
    ):
        n_end, width = group.links.shape[1] - group.n_inner_row, group.n_freedom
        size = round(blocks[0].size ** 0.5)
        by_end = blocks.reshape(len(group.links), size, size)
        for axis, found in enumerate(ends):
            own = jnp.sum(by_end[:, :, axis : n_end * width : width], axis=2)
            rows = own[:, : n_end * width].reshape(len(own), n_end, width)
            rows = jnp.pad(rows, [(0, 0), (0, group.n_inner_row), (0, 0)])
            if group.inner_unknowns:
                at, columns = np.array(group.inner_unknowns).T
                rows = rows.at[:, n_end + at, columns].set(own[:, n_end * width :])
            found.append(system.space.pad_moments(rows))
    columns = []
    for axis, found in enumerate(ends):
        force = system.sum_at_rows(found).at[: len(system.nodal_mass), axis].add(system.nodal_mass)
        columns.append(system.space.restrict(force, x))
    return jnp.stack(columns, axis=1)


def total_effective_mass(
    mass: Matrix, inertia: Float[Array, "n_free 3"], loose: Bool[Array, " n_free"]
) -> Float[Array, " 3"]:
    """Return the sum of the effective masses of all modes along x, y and z, [3], kg.

    It is ``p M^-1 p`` by conjugate gradients, with `inertia`, p, from `mass_times_ground_motion`.
    Unknowns that are `loose` (without stiffness) are left out. Scaled by its diagonal, a mass
    matrix of finite elements has a small condition number, whatever its size.
    """
    size = diagonal(mass)
    idle = (size <= 0) | loose
    scale = jnp.where(idle, 1.0, size)

    def product(v):
        return jnp.where(idle, v, mass @ jnp.where(idle, 0.0, v))

    tol = 100 * jnp.finfo(inertia.dtype).eps

    def one(force):
        solved, _ = cg(product, force, tol=tol, maxiter=_MAX_CG_STEPS, M=lambda v: v / scale)
        return force @ solved

    return jax.vmap(one)(jnp.where(idle[:, None], 0.0, inertia).T)


def nodal_masses(structure: Structure, masses: Any) -> Float[ArrayLike, " n_node"]:
    """Return the argument `masses` of `modes` as an array [n_node], kg; zeros for None.

    Raises:
        ValueError: wrong shapes, negative masses, something else in a list of `PointMasses`.
    """
    if masses is None:
        return np.zeros(structure.n_node)
    several = masses if isinstance(masses, list | tuple) else [masses]
    if any(isinstance(one, PointMasses) for one in several):
        for k, one in enumerate(several):
            if not isinstance(one, PointMasses):
                raise ValueError(f"masses[{k}]: expected PointMasses, got {type(one).__name__}")
            one.check(structure)
        return sum(one.nodal_masses(structure.n_node) for one in several)
    hint = "; one mass for each node, one for all, or PointMasses"
    masses = checks.floats_of_shape(masses, "masses", (), (structure.n_node,), hint=hint)
    known = checks.array_if_known(masses)
    if known is not None and not np.isfinite(known).all():
        raise ValueError(f"masses = {known[~np.isfinite(known)][0]}: must be finite")
    masses = checks.numpy_or_jax(masses).broadcast_to(masses, structure.n_node)
    return nan_if_broken(not_negative("masses", masses))
