"""Form finding with given lengths: the forces of these elements are unknown multipliers.

The form is a stationary point of the Lagrangian ``sum T l + sum N (l - L) - p.x``, whose unknowns
are the free displacements x and the forces N of the elements of given length L. It is a saddle
point: the Hessian, by autodiff, is symmetric and indefinite. Newton's method halves its step until
the residual falls. It starts from a form in which stiff springs nearly keep the lengths
(`prescribed_forces`).
"""

from __future__ import annotations

import functools
from collections.abc import Sequence
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
from jax import lax

from .. import linear
from ..common import status
from ..common.tree import Indices, copy_with, pytree
from ..common.types import Array, Bool, Float, Int
from ..elements.prestress import measure_chord
from ..mechanics.assembly import System
from ..numerics import scaled
from ..spaces.dof_map import make_dof_map

# Part of Newton's step that is tried last, after halving: with a tangent so poor, further halving
# would only delay the failure status.
_LEAST_PART = 1 / 2048


@pytree
class SaddlePointNumbering:
    """Indices of the unknowns of a form with given lengths.

    The free displacements come first, then the forces of the elements whose length is given: these
    are Lagrange multipliers.

    Attributes:
        unknown_of_dof: index of the unknown of every degree of freedom, [n_node, 3]; n_all if a
            support holds it.
        given_elements: for each group the indices of its elements of given length, or None.
        unknowns: for each group the indices of the six end displacements and the force of these
            elements, [n_given, 7], or None.
        pattern: `linear.Pattern` of the Hessian.
        zeros: n_all zeros; their shape tells the number of unknowns where the rest is traced.
    """

    unknown_of_dof: Int[Array | np.ndarray, "n_node 3"]
    given_elements: Sequence[Int[Array | np.ndarray, " n_given"] | None]
    unknowns: Sequence[Int[Array | np.ndarray, "n_given 7"] | None]
    pattern: linear.Pattern
    zeros: Float[Array | np.ndarray, " n_all"]


@functools.lru_cache(maxsize=16)
def number_saddle_point_unknowns(
    fixed: Indices, links: tuple[Indices, ...], sought: tuple[Indices, ...], solver: str | None
) -> SaddlePointNumbering:
    """Number the unknowns of a form with given lengths; cached.

    Args:
        fixed: True where a coordinate is held, `Indices` [n_node, 3].
        links: links of every group, a tuple of `Indices`.
        sought: True where the length is given and the force sought, a tuple of `Indices` [n_elem].
        solver: name of a linear solver, or None.

    Raises:
        ValueError: the named solver does not exchange distant rows (pivoting), which zeros on the
            diagonal need.
    """
    linear.check_solver_name(solver, exchanges_rows=True)
    dof_map = make_dof_map(fixed)
    n_free = len(dof_map.free)
    n_all = n_free + sum(int(mask.array.sum()) for mask in sought)
    of_freedom = np.where(dof_map.unknown_of_dof == n_free, n_all, dof_map.unknown_of_dof).astype(
        np.int32
    )
    elements, ends, count = [], [], n_free
    for group_links, mask in zip(links, sought, strict=True):
        chosen = np.flatnonzero(mask.array).astype(np.int32)
        moving = of_freedom[group_links.array[chosen]].reshape(-1, 6)
        force = np.arange(count, count + len(chosen), dtype=np.int32)
        count += len(chosen)
        elements.append(chosen if len(chosen) else None)
        ends.append(np.column_stack([moving, force]) if len(chosen) else None)
    numbers = [of_freedom[group_links.array].reshape(-1, 6) for group_links in links]
    numbers += [unknowns for unknowns in ends if unknowns is not None]
    pattern = linear.make_pattern(numbers, n_all, True, solver, exchanges_rows=True)
    return SaddlePointNumbering(of_freedom, elements, ends, pattern, np.zeros(n_all))


@pytree
class SaddlePointSystem:
    """Equations of equilibrium and of given lengths: the gradient of a Lagrangian is zero.

    The unknowns z [n_all] are the free displacements, m, then the forces of the elements of given
    length, divided by `unit`.

    Attributes:
        system: `System` of elements that keep their forces; these are zero where the length is
            given.
        given: for each group the given lengths L of its elements, [n_elem], m, with any value where
            none is given.
        unit: force in N by which forces are divided; it makes the matrix entries of displacements
            and of forces about equally large.
        numbering: `SaddlePointNumbering`.
    """

    system: System
    given: list[Float[Array, " n_elem"]]
    unit: Float[Array, ""]
    numbering: SaddlePointNumbering

    def split_unknowns(
        self, z: Float[Array, " n_all"]
    ) -> tuple[Float[Array, " n_free"], list[Float[Array, " n_given"]]]:
        """Split z into free displacements, [n_free], m, and forces of given-length elements, N.

        The forces are a list of [n_given], one array for each group.
        """
        n_free = self.system.dof_map.free.shape[0]
        parts, at = [], n_free
        for chosen in self.numbering.given_elements:
            size = 0 if chosen is None else chosen.shape[0]
            parts.append(self.unit * z[at : at + size])
            at += size
        return z[:n_free], parts

    def nodal_motion(self, z: Float[Array, " n_all"]) -> Float[Array, "n_node 3"]:
        """Return the displacements of all nodes, [n_node, 3], m, from the unknowns z."""
        prescribed: Any = self.system.space.prescribed  # never None here
        return self.system.move(prescribed, self.split_unknowns(z)[0])

    def join_unknowns(
        self, motion: Float[Array, "n_node 3"], forces: Sequence[Float[Array, " n_elem"]]
    ) -> Float[Array, " n_all"]:
        """Return the unknowns z from displacements [n_node, 3], m, and all forces per group, N.

        The forces of elements without given length do not enter.
        """
        x = motion.reshape(-1)[self.system.dof_map.free]
        pairs = zip(forces, self.numbering.given_elements, strict=True)
        given = [force[chosen] / self.unit for force, chosen in pairs if chosen is not None]
        return jnp.concatenate([x, *given])

    def axial_forces(self, z: Float[Array, " n_all"]) -> list[Float[Array, " n_elem"]]:
        """Return the axial forces of all elements from z, a list of [n_elem], N, per group."""
        states: Sequence[Any] = self.system.states  # of `force_elements.ForceElementState`
        pairs = zip(states, self.numbering.given_elements, self.split_unknowns(z)[1], strict=True)
        return [
            state.force if chosen is None else state.force.at[chosen].set(given)
            for state, chosen, given in pairs
        ]

    def system_with_forces(
        self, z: Float[Array, " n_all"]
    ) -> tuple[System, Float[Array, "n_node 3"]]:
        """Return the `System` whose elements have the forces of z, and the displacements of z."""
        pairs = zip(self.system.states, self.axial_forces(z), strict=True)
        system = copy_with(
            self.system, states=[copy_with(state, force=force) for state, force in pairs]
        )
        return system, self.nodal_motion(z)

    def _given_length_groups(self, motion):
        """Generate, for each group with given lengths, the data of these elements.

        `motion` has the displacements [n_node, 3]. Yields initial positions of the ends [n_given,
        2, 3], their displacements, lengths L [n_given], and indices of the unknowns [n_given, 7].
        """
        n = self.numbering
        for group, chosen, unknowns, lengths in zip(
            self.system.groups, n.given_elements, n.unknowns, self.given, strict=True
        ):
            if chosen is not None:
                links = group.links[chosen]
                yield self.system.nodes[links], motion[links], lengths[chosen], unknowns

    def residual(self, z: Float[Array, " n_all"]) -> Float[Array, " n_all"]:
        """Return the gradient of the Lagrangian, [n_all]: unbalanced forces, N, then length errors.

        The errors l - L are multiplied by `unit`.
        """
        system, motion = self.system_with_forces(z)
        errors = [
            self.unit * jax.vmap(length_error)(*data)
            for *data, _ in self._given_length_groups(motion)
        ]
        return jnp.concatenate([system.residual(motion), *errors])

    def convergence_measures(
        self, z: Float[Array, " n_all"]
    ) -> tuple[Float[Array, " n_free"], Float[Array, ""], Float[Array, " n_given"]]:
        """Return the quantities by which convergence is judged, for unknowns z.

        These are the unbalanced forces [n_free], N, the force that they are compared with, N, and
        the relative errors of the given lengths, (l - L) / L, [n_given].
        """
        system, motion = self.system_with_forces(z)
        errors = [
            jax.vmap(length_error)(*data) / data[2]
            for *data, _ in self._given_length_groups(motion)
        ]
        return *system.residual_and_scale(motion), jnp.concatenate(errors)

    def tangent(
        self, z: Float[Array, " n_all"]
    ) -> Float[Array, "n_all n_all"] | linear.SparseMatrix:
        """Return the Hessian of the Lagrangian, [n_all, n_all], dense or sparse."""
        system, motion = self.system_with_forces(z)
        dof_map = copy_with(system.dof_map, unknown_of_dof=self.numbering.unknown_of_dof)
        system = copy_with(system, space=copy_with(system.space, dof_map=dof_map))
        parts = system.matrix_parts(system.tangents(motion), motion)
        return self._assemble_hessian(parts, motion)

    def _assemble_hessian(self, parts, motion):
        """Return the Hessian of the Lagrangian, [n_all, n_all], dense or sparse.

        Args:
            parts: blocks by displacements alone, as pairs (blocks, indices of their unknowns).
            motion: displacements, [n_node, 3], m, at which the blocks of the length constraints
                are evaluated and added.
        """
        couple = jax.vmap(functools.partial(_constraint_hessian, self.unit))
        parts = parts + [
            (couple(*data), unknowns) for *data, unknowns in self._given_length_groups(motion)
        ]
        return linear.assemble_matrix(parts, len(self.numbering.zeros), self.numbering.pattern)

    def unknowns_of_least_residual(
        self, motion: Float[Array, "n_node 3"]
    ) -> Float[Array, " n_all"]:
        """Return the unknowns z with given displacements, and with those forces that balance best.

        `motion` has the displacements, [n_node, 3], m. The forces of elements of given length
        follow from weighted least squares, solved with the Hessian with identity blocks as element
        stiffnesses.
        """
        states: Sequence[Any] = self.system.states
        none = [jnp.zeros_like(state.force) for state in states]
        z, n_free = self.join_unknowns(motion, none), self.system.dof_map.free.shape[0]
        blocks = []
        for group in self.system.groups:
            unknowns = self.numbering.unknown_of_dof[group.links].reshape(-1, 6)
            ones = jnp.broadcast_to(jnp.eye(6, dtype=z.dtype), (len(unknowns), 6, 6))
            blocks.append((ones, unknowns))
        matrix = self._assemble_hessian(blocks, motion)
        rhs = -self.residual(z).at[n_free:].set(0.0)
        found, regular = linear.solve_general(matrix, rhs)
        return z.at[n_free:].set(jnp.where(regular, found[n_free:], 0.0))


def length_error(ends, moved, length):
    """Return an element's length minus its given `length`, m, without cancellation at the start.

    `ends` are initial positions of its two ends, [2, 3], m, `moved` their displacements, [2,
    3], m.
    """
    _, _, change, start = measure_chord(ends, moved)
    return (start - length) + change


def _constraint_hessian(unit, ends, moved, length):
    """Return the Hessian of ``N (l - L)`` at N = 0, [7, 7], by six end displacements and N / unit.

    The part that grows with N is in the tangent of the elements, which keep this force.
    """

    def lagrangian(u):
        return unit * u[6] * length_error(ends, u[:6].reshape(2, 3), length)

    return jax.hessian(lagrangian)(jnp.append(moved.reshape(-1), 0.0))


def solve_saddle_point(
    saddle: SaddlePointSystem,
    z: Float[Array, " n_all"],
    tol: Float[Array, ""],
    max_steps: Int[Array, ""] | int,
) -> tuple[Float[Array, " n_all"], Int[Array, ""], Int[Array, ""]]:
    """Solve for a form with given lengths by Newton's method; not differentiable.

    A line search halves steps until the largest relative residual falls.

    Args:
        saddle: the equations.
        z: unknowns at the start, [n_all].
        tol: relative residual of forces and relative error of lengths at convergence.
        max_steps: largest number of steps.

    Returns:
        The unknowns z, the status, and the number of steps.
    """

    def largest_error(z):
        residual, scale, errors = saddle.convergence_measures(z)
        forces = scaled.relative_residual(jnp.max(jnp.abs(residual), initial=0.0), scale)
        return jnp.maximum(forces, jnp.max(jnp.abs(errors), initial=0.0))

    def iterate(state):
        z, error, steps, _ = state
        step, _ = linear.solve_general(saddle.tangent(z), -saddle.residual(z))

        def try_next(trial):
            part = 0.5 * trial[0]
            return part, largest_error(z + part * step)

        def goes_on(trial):
            part, new_error = trial
            return ~(new_error < error) & (part > _LEAST_PART)

        part, new_error = lax.while_loop(goes_on, try_next, (jnp.full_like(error, 2.0), error))
        better = new_error < error
        return (
            jnp.where(better, z + part * step, z),
            jnp.where(better, new_error, error),
            steps + 1,
            better,
        )

    def unfinished(state):
        _, error, steps, better = state
        return better & (steps < max_steps) & ~(error <= tol)

    begin = (z, largest_error(z), jnp.int32(0), jnp.ones((), bool))
    z, error, steps, _ = lax.while_loop(unfinished, iterate, begin)
    code = jnp.where(jnp.isfinite(error), status.NOT_CONVERGED, status.NONFINITE)
    return z, jnp.where(error <= tol, status.OK, code).astype(jnp.int32), steps


def attach_saddle_point_derivative(
    saddle: SaddlePointSystem, z: Float[Array, " n_all"], valid: Bool[Array, ""]
) -> Float[Array, " n_all"]:
    """Return the solution `z` with its implicit derivative by the numbers in `saddle`.

    `valid` says whether the solution has converged. If not, the caller must have stopped the
    derivatives of `saddle` (`implicit.stop_gradient_unless`).
    """
    z = lax.stop_gradient(z)
    frozen = lax.stop_gradient(saddle)
    factor = linear.factorize(linear.identity_unless(frozen.tangent(z), valid))
    saddle = copy_with(saddle, unit=frozen.unit)

    def tangent_solve(linearized, rhs):
        return factor.solve(rhs, linearized)

    return lax.custom_root(saddle.residual, z, lambda _, z: z, tangent_solve)
