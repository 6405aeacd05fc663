"""Nodes with six degrees of freedom, a displacement and a rotation: structures with beams.

The motion of a row has seven numbers, a displacement and a unit quaternion; a step of a row has six
numbers, a translation and a spin. Rotations are multiplied and never added. The unknown of a spin
is the spin times a length, the mean length of the beams (`rotation_length`): an arc. Hence all
unknowns are lengths, all residuals are forces, and one tolerance serves for all.

The residual about ``x`` is the derivative of the energy with respect to a step from ``x``, at this
step. The derivative of the residual is a Hessian, symmetric also off equilibrium. A nodal moment
that keeps its direction in space has no potential; it enters by its work on the step and makes the
tangent unsymmetric (of the order of the moment). Newton steps and derivatives of the result use the
whole tangent.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from functools import partial
from typing import Self

import jax
import jax.numpy as jnp
import numpy as np
from jax import lax

from .. import linear
from ..common.tree import pytree
from ..common.types import Array, ArrayLike, Float, Int
from ..numerics.rotations import (
    IDENTITY,
    compose,
    conjugate_moment,
    cross,
    exp_map_by_series,
    halfway_rotation,
    invert,
    move_node,
    rotate,
    stereographic_to_rotation_vector,
    to_stereographic,
)
from .dof_map import DofMap, element_unknowns, to_global, to_local
from .space import (
    ElementGroup,
    Forces,
    Matrix,
    MatrixPart,
    Motion,
    Space,
    Step,
    as_square_matrices,
    mean_length,
    transform_by_jacobian,
)

# stiffness of a free spin that is only rounding, over the stiffness of one node's spin: rounding
# leaves some eps times the number of nodes of a piece, real stiffness is many orders larger
_SPIN_STIFFNESS_OF_ROUNDING = 1e-9


@pytree
class RotatingNodes(Space):
    """Space of nodes with rotations: a motion is a displacement and a unit quaternion.

    Attributes:
        nodes: initial positions, [n_row, 3], m.
        rotation_length: length by which spins are multiplied, m; it scales unknowns, not results.
        support_rotation: rotation of every row when its support was set, [n_row, 4], if supports
            fix rotations along directions other than x, y, z; None if `prescribed` contains it.
    """

    nodes: Float[Array, "n_row 3"]
    rotation_length: Float[Array, ""]
    support_rotation: Float[Array, "n_row 4"] | None

    n_motion, n_freedom = 7, 6
    rotates = True
    symmetric = False  # nodal moments have no potential

    @classmethod
    def build(
        cls,
        nodes: Float[Array, "n_row 3"],
        groups: Sequence[ElementGroup],
        dof_map: DofMap,
        prescribed: Motion | None,
        support_rotation: Float[Array, "n_row 4"] | None,
    ) -> Self:
        """Make the space of a system; `rotation_length` is the mean length of rotating elements."""
        turning = [group for group in groups if group.gives_rotations]
        arm = lax.stop_gradient(mean_length(turning, nodes))
        return cls(dof_map, prescribed, nodes, arm, support_rotation)

    # --- motions

    @classmethod
    def at_rest(cls, nodes: Float[Array, "n_row 3"]) -> Motion:
        """Return the motion of nodes that have not moved: zero displacements and rotations."""
        rotation = jnp.broadcast_to(jnp.asarray(IDENTITY, nodes.dtype), (len(nodes), 4))
        return jnp.concatenate([jnp.zeros_like(nodes), rotation], axis=1)

    @classmethod
    def motion_after_row_step(cls, motion: Motion, step: Forces) -> Motion:
        """Return the motion after a step: displaced by its translations, rotated by its spins."""
        return jax.vmap(move_node)(motion, step)

    @classmethod
    def displacement_between(cls, before: Motion, after: Motion) -> Forces:
        """Return displacements, m, and rotation vectors from motion `before` to `after`."""

        def rotation(old, new):
            return stereographic_to_rotation_vector(to_stereographic(compose(new, invert(old))))

        shift = (after - before)[:, :3]
        return jnp.concatenate([shift, jax.vmap(rotation)(before[:, 3:], after[:, 3:])], axis=1)

    @classmethod
    def rigid_link_motion(cls, motion: Motion, arm: Float[Array, "n_row 3"]) -> Motion:
        """Return the motion of rigid-link ends, from the motion of the rows that carry the arms."""
        swung = jax.vmap(rotate)(motion[:, 3:], arm) - arm
        return jnp.concatenate([motion[:, :3] + swung, motion[:, 3:]], axis=1)

    @classmethod
    def rotations(cls, motion: Motion) -> Float[Array, "n_row 4"]:
        """Return the rotations of all rows in a motion, unit quaternions."""
        return motion[:, 3:]

    @classmethod
    def moments(cls, force: Float[Array, "... n_freedom"]) -> Float[Array, "... 3"]:
        """Return the moments of generalized forces, which are forces then moments, N m."""
        return force[..., 3:]

    @classmethod
    def stored_motion(
        cls, motion: Float[Array, "n_inc n_row n_motion"]
    ) -> Float[Array, "n_inc n_row n_motion"]:
        """Return `motion`: results store it, because displacements do not give rotations."""
        return motion

    # --- points and steps

    def impose_supports(self, x: Motion) -> Motion:
        """Return `x` with prescribed values at supports, and nodes on rigid links moved too."""
        clamped = jnp.all(self.dof_map.fixed[:, 3:], axis=1, keepdims=True)
        rotation = jnp.where(clamped, self._prescribed_motion[:, 3:], x[:, 3:])
        moved = self._impose_displacements(x[:, :3])
        return self._move_carried_nodes(jnp.concatenate([moved, rotation], axis=1))

    def with_support_rotations(self, x: Motion) -> Motion:
        """Return `x`, unchanged in value, with its derivative by the rotations of supports.

        A support that fixes some rotations only counts from the rotation that the node had when the
        support was set: if that rotation changes, so does `x`.
        """
        hinged = jnp.any(self.dof_map.fixed[:, 3:], axis=1, keepdims=True)
        support = self._support_reference_rotations()
        relative = jax.vmap(compose)(x[:, 3:], jax.vmap(invert)(lax.stop_gradient(support)))
        rotation = jnp.where(hinged, jax.vmap(compose)(relative, support), x[:, 3:])
        return jnp.concatenate([x[:, :3], rotation], axis=1)

    def _support_reference_rotations(self) -> Float[Array, "n_row 4"]:
        """Return each row's rotation when its support was set, [n_row, 4], the zero of supports."""
        return (
            self._prescribed_motion[:, 3:]
            if self.support_rotation is None
            else self.support_rotation
        )

    def move(self, x: Motion, step: Step) -> Motion:
        """Return the motion after a step of the unknowns, [n_free], from the motion `x`."""
        return self._move_carried_nodes(self.motion_after_row_step(x, self.prolong(x, step)))

    def _move_carried_nodes(self, x: Motion) -> Motion:
        """Return `x` with the nodes on rigid links moved as the nodes that carry them."""
        if self.dof_map.rigid_links is None:
            return x
        nodes, by = self.dof_map.rigid_links
        arm, rotation = self.nodes[nodes] - self.nodes[by], x[by, 3:]
        moved = x[by, :3] + jax.vmap(rotate)(rotation, arm) - arm
        return x.at[nodes].set(jnp.concatenate([moved, rotation], axis=1))

    def _rotated_arms(self, x: Motion) -> Float[Array, "n 3"]:
        """Return the vectors of rigid links, from carrier to carried node, rotated as at `x`, m."""
        nodes, by = self.dof_map.rigid_links  # type: ignore[misc]  # not None
        return jax.vmap(rotate)(x[by, 3:], self.nodes[nodes] - self.nodes[by])

    def prolong(self, x: Motion, step: Step) -> Forces:
        """Return translation and spin of every node after a step of the unknowns from `x`."""
        full = jnp.append(step, jnp.zeros(1, step.dtype))[self.dof_map.unknown_of_dof]
        full = full * self._row_step_per_unknown()
        if self.dof_map.axes is not None:
            shift = to_global(self.dof_map.axes, full[:, :3])
            full = jnp.concatenate([shift, to_global(self._spin_axes(x), full[:, 3:])], axis=1)
        if self.dof_map.rigid_links is not None:
            nodes, by = self.dof_map.rigid_links
            arm, spin = self._rotated_arms(x), full[by, 3:]
            swung = jax.vmap(lambda s, a: rotate(exp_map_by_series(s), a))(spin, arm) - arm
            full = full.at[nodes].set(jnp.concatenate([full[by, :3] + swung, spin], axis=1))
        return full

    def _spin_axes(self, x: Motion) -> Float[Array, "n_row 3 3"]:
        """Return the axes of the spin unknowns, one in each row of a matrix.

        Where a support holds exactly one rotation, a node swings from its rotation at the time when
        the support was set, by the smallest rotation. Its spins about the two other axes, turned by
        half of the swing, keep the support.
        """
        axes = jnp.asarray(self.dof_map.axes, x.dtype)
        alone = jnp.sum(self.dof_map.fixed[:, 3:], axis=1) == 1
        swing = jax.vmap(compose)(x[:, 3:], jax.vmap(invert)(self._support_reference_rotations()))
        still = jnp.asarray(IDENTITY, x.dtype)
        half = jax.vmap(lambda swings, q: halfway_rotation(still, jnp.where(swings, q, still)))(
            alone, swing
        )
        return jax.vmap(lambda q, rows: jax.vmap(lambda v: rotate(q, v))(rows))(half, axes)

    def _row_step_per_unknown(self):
        """Return 1 for translations and 1 / `rotation_length` for spins, [1, 6]."""
        arm = self.rotation_length
        return jnp.concatenate([jnp.ones((1, 3), arm.dtype), jnp.full((1, 3), 1 / arm)], axis=1)

    # --- forces

    def force_norm(self, force: Float[Array, "... n_freedom"]) -> Float[Array, " ..."]:
        """Return the norms of forces plus those of moments over `rotation_length`, N."""
        size = _vector_norms(force[..., :3])
        return size + _vector_norms(force[..., 3:]) / self.rotation_length

    def restrict(self, force: Forces, x: Motion, row_step: Forces | None = None) -> Step:
        """Return forces at the unknowns, [n_free], N; those on carried nodes act on carriers."""
        n = self.dof_map.free.shape[0]
        force = self._shift_to_carriers(force, x, row_step)
        if self.dof_map.axes is not None:
            force = jnp.concatenate(
                [
                    to_local(self.dof_map.axes, force[:, :3]),
                    to_local(self._spin_axes(x), force[:, 3:]),
                ],
                axis=1,
            )
        scaled = force * self._row_step_per_unknown()
        sums = jnp.zeros(n, force.dtype).at[self.dof_map.unknown_of_dof].add(scaled, mode="drop")
        return self.dof_map.zero_temporarily_fixed(sums)

    def _shift_to_carriers(
        self, force: Forces, x: Motion, row_step: Forces | None = None
    ) -> Forces:
        """Return forces and moments with those on rigid-link nodes moved to their carriers."""
        if self.dof_map.rigid_links is None:
            return force
        nodes, by = self.dof_map.rigid_links
        arm, carried = self._rotated_arms(x), force[nodes]
        if row_step is None:
            turning = jax.vmap(cross)(arm, carried[:, :3])
        else:
            spin = row_step[by, 3:]
            arm = jax.vmap(lambda s, a: rotate(exp_map_by_series(s), a))(spin, arm)
            turning = jax.vmap(conjugate_moment)(spin, jax.vmap(cross)(arm, carried[:, :3]))
        force = force.at[nodes].set(0.0).at[by, :3].add(carried[:, :3])
        return force.at[by, 3:].add(carried[:, 3:] + turning)

    def conjugate_loads(self, load: Forces, row_step: Forces) -> Forces:
        """Return loads whose moments, fixed in space, are made conjugate to spins of a step."""
        spin = row_step[:, 3:]
        if self.dof_map.inner is not None:  # inner unknowns do not rotate
            spin = jnp.where(self.dof_map.inner[:, None], 0.0, spin)
        return jnp.concatenate([load[:, :3], jax.vmap(conjugate_moment)(spin, load[:, 3:])], axis=1)

    def reactions(self, unbalanced: Forces, motion: Motion) -> Forces:
        """Return support reactions, N and N m, from unbalanced forces; zero at free dofs."""
        force, dof_map = self._shift_to_carriers(unbalanced, motion), self.dof_map
        fixed = dof_map.fixed
        if dof_map.inner is not None:
            fixed = fixed & ~dof_map.inner[:, None]
        if dof_map.axes is None:
            return jnp.where(fixed, force, 0.0)
        spins = self._spin_axes(motion)
        shift = jnp.where(fixed[:, :3], to_local(dof_map.axes, force[:, :3]), 0.0)
        moment = jnp.where(fixed[:, 3:], to_local(spins, force[:, 3:]), 0.0)
        return jnp.concatenate([to_global(dof_map.axes, shift), to_global(spins, moment)], axis=1)

    def dof_directions(self, motion: Motion) -> list[Float[ArrayLike, "n_row 3 3"] | None]:
        """Return the axes of displacements (None: x, y, z) and those of spins, [n_row, 3, 3]."""
        return [self.dof_map.axes, self._spin_axes(motion)]

    # --- matrices

    @classmethod
    def coupled_unknowns(
        cls, number: Int[np.ndarray, "n_row 6"]
    ) -> list[Int[np.ndarray, "n_row 3"]]:
        """Return the indices of every node's spin unknowns, which its moment couples, in a list."""
        return [number[:, 3:]]

    def motion_jacobian(self, motion: Motion) -> Float[Array, "n_row 6 6"] | None:
        """Return the Jacobian of row steps by unknowns; None: diagonal, `_row_step_per_unknown`."""
        dof_map = self.dof_map
        if dof_map.axes is None and dof_map.rigid_links is None:
            return None
        scale = self._row_step_per_unknown()
        slopes = jnp.zeros((len(motion), 6, 6), motion.dtype)
        if dof_map.axes is None:
            slopes = slopes + jnp.eye(6, dtype=motion.dtype)[None]
        else:
            slopes = slopes.at[:, :3, :3].set(jnp.swapaxes(jnp.asarray(dof_map.axes), 1, 2))
            slopes = slopes.at[:, 3:, 3:].set(jnp.swapaxes(self._spin_axes(motion), 1, 2))
        slopes = slopes * scale[None]
        if dof_map.rigid_links is not None:
            nodes, by = dof_map.rigid_links
            at_carrier = slopes[by]
            swung = jax.vmap(lambda a, spins: jax.vmap(lambda s: cross(s, a), 1, 1)(spins))(
                self._rotated_arms(motion), at_carrier[:, 3:]
            )
            slopes = slopes.at[nodes].set(at_carrier.at[:, :3].add(swung))
        return slopes

    def transform_to_unknowns(
        self,
        blocks: Float[Array, "n_elem ..."],
        links: Int[ArrayLike, "n_elem n_end"],
        width: int,
        inner: Sequence[tuple[int, int]],
        x: Motion,
    ) -> MatrixPart:
        """Transform element matrices to unknowns: return [n_elem, d, d], and unknowns' indices."""
        dof_map, blocks, slopes = self.dof_map, as_square_matrices(blocks), self.motion_jacobian(x)
        number = element_unknowns(dof_map.unknown_of_dof, links, width, inner, dof_map.rigid_links)
        n_end = links.shape[1] - (1 + max((row for row, _ in inner), default=-1))
        if slopes is None:
            if width > 3:
                scale = self._row_step_per_unknown()[0]
                factors = jnp.concatenate(
                    [jnp.tile(scale, n_end), jnp.ones(len(inner), scale.dtype)]
                )
                blocks = jnp.einsum("eij,i,j->eij", blocks, factors, factors)
            return blocks, number
        factors = slopes[links[:, :n_end], :width]
        if dof_map.rigid_links is None:
            factors = factors[..., :width]
        return transform_by_jacobian(blocks, factors, len(inner)), number

    def load_stiffness(
        self, load: Forces, unbalanced: Callable[[], Forces], x: Motion
    ) -> list[MatrixPart]:
        """Return the terms that nodal moments and forces on rigid links add to the tangent.

        The list has one pair: matrices by the spins of each row, [n_row, 3, 3], and the indices of
        these unknowns, [n_row, 3].
        """
        zero = jnp.zeros_like(x[:, :3])
        moment, first = self._shift_to_carriers(load, x)[:, 3:], partial(conjugate_moment, order=1)
        change = -jax.vmap(jax.jacfwd(first))(zero, moment)
        if self.dof_map.rigid_links is not None:
            nodes, by = self.dof_map.rigid_links
            pull, arm = unbalanced()[nodes, :3], self._rotated_arms(x)
            # `moment` and `pull` both contain the moment of loads on arms: count it once
            by_load = jax.vmap(jax.jacfwd(first))(zero[by], jax.vmap(cross)(arm, load[nodes, :3]))
            change = change.at[by].add(by_load)

            def turning(spin, arm, pull):
                return first(spin, cross(rotate(exp_map_by_series(spin, order=1), arm), pull))

            change = change.at[by].add(jax.vmap(jax.jacfwd(turning))(zero[by], arm, pull))
        if self.dof_map.axes is not None:
            axes = self._spin_axes(x)
            change = jnp.einsum("nai,nij,nbj->nab", axes, change, axes)
        return [(change / self.rotation_length**2, self.dof_map.unknown_of_dof[:, 3:])]

    def stabilize_torsional_mechanisms(self, matrix: Matrix, x: Motion) -> Matrix:
        """Return the tangent with a spring at each beam that can spin without stiffness.

        The spring acts on one unknown that a spin z with ``K z = 0`` moves. For loads that do no
        work on z the solutions are those of K in which this unknown is zero.
        """
        if self.dof_map.torsional_mechanisms is None:
            return matrix
        rows, piece, ends = self.dof_map.torsional_mechanisms
        number = self.dof_map.unknown_of_dof[rows, 3:]
        lines = self.nodes[ends[:, 1]] - self.nodes[ends[:, 0]]
        lines = lines / jnp.linalg.norm(lines, axis=1, keepdims=True)
        about = jax.vmap(rotate)(x[rows, 3:], lines[piece])
        if self.dof_map.axes is not None:
            about = to_local(self._spin_axes(x)[rows], about)
        diagonal = linear.diagonal(matrix)
        for k in range(len(ends)):
            mine = jnp.asarray(piece == k, about.dtype)[:, None]
            spin = jnp.zeros_like(diagonal).at[number].add(about * mine, mode="drop")
            largest = jnp.argmax(jnp.abs(spin))
            stiffness = diagonal[largest]
            # (a piece that another phase leaves free has no spin here)
            soft = jnp.max(jnp.abs(matrix @ spin)) <= _SPIN_STIFFNESS_OF_ROUNDING * stiffness
            soft = soft & jnp.any(spin != 0)
            matrix = linear.add_to_diagonal_entry(matrix, largest, jnp.where(soft, stiffness, 0.0))
        return matrix


def _vector_norms(vectors: Float[Array, "... 3"]) -> Float[Array, " ..."]:
    """Return the Euclidean norm of every vector."""
    return jnp.sqrt(jnp.sum(vectors**2, axis=-1))
