"""`InertialSystem`: the equations of a structure at the end of a step in time.

Inertia and damping are further forces of a `System`; they depend on the motion at the end of the
step (`generalized_alpha`). All solvers of equilibrium and all derivatives take them into account.
"""

from __future__ import annotations

import dataclasses

import jax
import jax.numpy as jnp

from .. import linear
from ..common.tree import copy_with, pytree
from ..common.types import Array, Bool, Float, Int
from ..equilibrium.convergence import default_tolerance
from ..linear import Matrix
from ..mechanics.assembly import System
from ..mechanics.elementwise import PerGroup
from ..numerics.rotations import cross, invert, move_node_by_series, rotate
from ..spaces.space import Forces, MatrixPart, Motion
from ..spaces.translations import drop_low_part
from .generalized_alpha import MotionState, TimeStep, to_space_axes

# change of the velocity in a step, over the velocity, whose inertia counts as a force: tolerances
# then leave 1e-13 of the velocity, which rounding leaves, too
_VELOCITY_CHANGE = 1e-3


@pytree
class DamperMatrices:
    """Damping matrices of dampers, each for the rates of several rows, such as of a dashpot.

    Attributes:
        links: the rows of each matrix, [n, n_end].
        blocks: the matrices, by translations (or by all rates) of its rows, [n, d, d].
    """

    links: Int[Array, "n n_end"]
    blocks: Float[Array, "n d d"]

    @property
    def width(self) -> int:
        """Number of rates of each row that the matrices multiply, 3 or 6."""
        return self.blocks.shape[1] // self.links.shape[1]

    def forces(self, rates: Forces) -> Forces:
        """Return the damping forces on rows for their `rates`, [n_row, n_freedom], N and N m."""
        at = rates[self.links][..., : self.width]
        found = jnp.einsum("eij,ej->ei", self.blocks, at.reshape(len(at), -1)).reshape(at.shape)
        padding = [(0, 0), (0, 0), (0, rates.shape[1] - self.width)]
        return jnp.zeros_like(rates).at[self.links].add(jnp.pad(found, padding))


@pytree
class Inertia:
    """Mass and damping matrices of a structure: of elements, of rows, and of dampers.

    Attributes:
        masses: mass matrices of elements by the translations of their ends, per group
            [n_elem, 3 n_end, 3 n_end], kg.
        nodal_mass: masses at rows, [n_row], kg.
        rotary: rotary inertia of rows in the axes of their nodes, [n_row, 3, 3], kg m2; None
            without rotations.
        damping: damping matrices of elements by all rates of their ends, per group
            [n_elem, d, d], N s/m; None without.
        nodal_damping: damping of the rates of rows, [n_row, n_freedom, n_freedom], N s/m.
        dampers: list of `DamperMatrices`.
    """

    masses: list[Float[Array, "n_elem d d"]]
    nodal_mass: Float[Array, " n_row"]
    rotary: Float[Array, "n_row 3 3"] | None
    damping: list[Float[Array, "n_elem d d"]] | None
    nodal_damping: Float[Array, "n_row n_freedom n_freedom"] | None
    dampers: list[DamperMatrices]

    def dofs_with_mass(self, system: System) -> Bool[Array, "n_row n_freedom"]:
        """Return which degrees of freedom of rows have mass, [n_row, n_freedom] bool."""
        return self.diagonal_mass(system) > 0

    def diagonal_mass(self, system: System) -> Float[Array, "n_row n_freedom"]:
        """Return the diagonal of the mass matrix of all rows, [n_row, n_freedom], kg and kg m2."""
        parts = []
        for group, blocks in zip(system.groups, self.masses, strict=True):
            own = jnp.diagonal(blocks, axis1=1, axis2=2).reshape(len(blocks), -1, 3)
            parts.append(system.space.pad_moments(_pad_inner_rows(own, group.links.shape[1])))
        found = system.sum_at_rows(parts)
        found = found.at[:, :3].add(self.nodal_mass[:, None])
        if self.rotary is not None:
            found = found.at[:, 3:].add(jnp.diagonal(self.rotary, axis1=1, axis2=2))
        return found


def _pad_inner_rows(values, count):
    """Return values at ends, [n_elem, n_end, ...], padded by zeros to `count` rows an element."""
    padding = [(0, 0), (0, count - values.shape[1]), *[(0, 0)] * (values.ndim - 2)]
    return jnp.pad(values, padding)


@pytree(kw_only=True)
class InertialSystem(System):
    """The equations of motion of a structure at the end of a step in time.

    Attributes:
        inertia: `Inertia`.
        step: `TimeStep`.
        min_force_scale: lower limit of the force that tolerances refer to, N: loads and inertia
            cancel where parts fly freely, and displacements (of nets: in the step) are rounded.
    """

    inertia: Inertia
    step: TimeStep
    min_force_scale: Float[Array, ""]

    @classmethod
    def from_system(
        cls, system: System, inertia: Inertia, step: TimeStep, load_before: Forces | None = None
    ) -> InertialSystem:
        """Return the equations of motion for a system without inertia, under the same loads.

        `load_before` are the loads at the start of the step, for schemes that need them.
        """
        given = {field.name: getattr(system, field.name) for field in dataclasses.fields(System)}
        begin, mass = step.begin, inertia.diagonal_mass(system)[:, :3]
        found = cls(**given, inertia=inertia, step=step, min_force_scale=jnp.zeros(()))
        speed = jnp.abs(begin.velocity[:, :3])
        rounded = step.duration * speed + (0.0 if found.is_net else jnp.abs(begin.motion[:, :3]))
        rounding = jnp.finfo(mass.dtype).eps / default_tolerance(mass.dtype)
        rates = jnp.abs(begin.acceleration[:, :3]) + _VELOCITY_CHANGE * speed / step.duration
        rates = rates + rounding * step.acceleration_per_displacement * rounded
        force = jnp.abs(system.load[:, :3]) + mass * rates
        return copy_with(found, min_force_scale=jnp.max(force, initial=0.0))

    # --- forces

    def inertia_and_damping_force(self, x: Motion) -> Forces:
        """Return ``M v' + C v`` of all rows, N and N m, for a step that ends at motion `x`."""
        state = self.step.balanced_state(self.space, x)
        return self.inertia_force(state) + self.damping_force(state)

    def inertia_force(self, state: MotionState) -> Forces:
        """Return mass times acceleration, ``M v'``, of all rows, [n_row, n_freedom], N and N m."""
        own, acceleration = self.inertia, state.acceleration
        force = self._multiply_element_matrices(own.masses, acceleration[:, :3])
        force = force.at[:, :3].add(own.nodal_mass[:, None] * acceleration[:, :3])
        if own.rotary is None:
            return force
        turning = jax.vmap(_rotary_inertia_moment)(
            own.rotary, state.motion[:, 3:], state.velocity[:, 3:], acceleration[:, 3:]
        )
        return force.at[:, 3:].add(turning)

    def damping_force(self, state: MotionState) -> Forces:
        """Return damping times velocity, ``C v``, of all rows, [n_row, n_freedom], N and N m."""
        own, force = self.inertia, jnp.zeros_like(state.velocity)
        if not self.is_damped:
            return force
        rates = to_space_axes(self.space, state.motion, state.velocity)
        if own.damping is not None:
            force = force + self._multiply_element_matrices(own.damping, rates)
        if own.nodal_damping is not None:
            force = force + jnp.einsum("nij,nj->ni", own.nodal_damping, rates)
        return sum((damper.forces(rates) for damper in own.dampers), force)

    @property
    def is_damped(self) -> bool:
        """Whether elements, rows or dampers have damping."""
        own = self.inertia
        return own.damping is not None or own.nodal_damping is not None or bool(own.dampers)

    def _multiply_element_matrices(self, matrices, rates):
        """Return products of element matrices and rates of their ends, summed at rows."""
        ends, wide = [], rates.shape[1] > 3
        for group, blocks in zip(self.groups, matrices, strict=True):
            width = group.n_freedom if wide else 3
            n_end = blocks.shape[1] // width
            at = rates[group.links[:, :n_end]][..., :width]
            own = jnp.einsum("eij,ej->ei", blocks, at.reshape(len(at), -1)).reshape(at.shape)
            ends.append(self.space.pad_moments(_pad_inner_rows(own, group.links.shape[1])))
        return self.sum_at_rows(ends)

    def external_force(self, x: Motion, row_step: Forces | None = None) -> Forces:
        """Return loads less inertia and damping on all rows, [n_row, n_freedom], N and N m."""
        at = x if row_step is None else self.space.motion_after_row_step(x, row_step)
        against = self.inertia_and_damping_force(at)
        if row_step is not None:
            against = self.space.conjugate_loads(against, row_step)
        return super().external_force(x, row_step) - against

    def force_scale(self, sizes: Float[Array, " n_row"]) -> Float[Array, ""]:
        """Return the force that tolerances refer to, N: at least `min_force_scale`."""
        return jnp.maximum(jnp.max(sizes), self.min_force_scale)

    def largest_load(self) -> Float[Array, ""]:
        """Return the largest norm on a row of load less inertia and damping at the start, N."""
        begun = self.inertia_and_damping_force(self.step.begin.motion)
        return jnp.max(self.space.force_norm(self.load - begun))

    # --- matrices

    def tangent(self, x: Motion, known: PerGroup | None = None) -> Matrix:
        """Assemble the derivative of the residual by a step from `x`, as `System.tangent`, N/m."""
        slopes = self._velocity_derivatives(x)
        matrices = [
            matrix + self._inertia_and_damping_tangents(k, matrix, slopes)
            for k, matrix in enumerate(self.tangents(x, known))
        ]
        parts = self.matrix_parts(matrices, x) + self.external_stiffness_parts(x)
        return self.space.stabilize_torsional_mechanisms(self._assemble_matrix(parts), x)

    def assemble_mass_matrix(self, x: Motion) -> Matrix:
        """Assemble the mass matrix of the unknowns, on the pattern of the tangent, kg."""
        own, masses = self.inertia, []
        for group, blocks, like in zip(
            self.groups, self.inertia.masses, jax.eval_shape(self.tangents, x), strict=True
        ):
            wide = _pad_per_end(blocks, 3, group.n_freedom)
            masses.append(_pad_matrices_to(wide, like.shape[1]))
        nodal = self._nodal_mass_blocks(own.nodal_mass)
        if own.rotary is not None:
            turned = jax.vmap(_inertia_along_xyz)(own.rotary, x[:, 3:])
            nodal = nodal.at[:, 3:, 3:].add(turned)
        others = jax.eval_shape(self.external_stiffness_parts, x)
        zeros = jax.tree.map(lambda a: jnp.zeros(a.shape, a.dtype), others)
        zeros[len(self.following_stiffness_parts(x))] = self._transform_row_blocks(nodal, x)
        return self._assemble_matrix(self.matrix_parts(masses, x) + zeros)

    def external_stiffness_parts(self, x: Motion) -> list[MatrixPart]:
        """Return minus the derivative of loads, inertia and damping by a step, in `MatrixPart`s.

        Those of elements are added to their stiffness. The pattern has places for the rows, then
        for `Inertia.dampers`, after those of following loads.
        """
        own, slopes = self.inertia, self._velocity_derivatives(x)
        nodal = self._nodal_mass_blocks(self.step.acceleration_per_displacement * own.nodal_mass)
        if own.nodal_damping is not None:
            nodal = nodal + own.nodal_damping @ slopes
        if own.rotary is not None:
            nodal = nodal.at[:, 3:, 3:].add(self._rotary_moment_derivatives(x))
        parts = [self._transform_row_blocks(nodal, x)]
        for damper in own.dampers:
            blocks = _blocks_times_derivatives(damper.blocks, slopes[damper.links], damper.width)
            parts.append(
                self.space.transform_to_unknowns(blocks, damper.links, damper.width, (), x)
            )
        load = self.load - self.inertia_and_damping_force(x) if self.space.rotates else self.load
        turning = self.space.load_stiffness(load, lambda: self.unbalanced(x), x)
        return self.following_stiffness_parts(x) + parts + turning

    def _transform_row_blocks(self, blocks, x):
        """Transform matrices of rows, [n_row, n_freedom, n_freedom], to a part for the unknowns."""
        rows = jnp.arange(len(blocks))[:, None]
        return self.space.transform_to_unknowns(blocks, rows, blocks.shape[1], (), x)

    def _nodal_mass_blocks(self, mass):
        """Return masses of rows, [n_row], as matrices [n_row, n_freedom, n_freedom]."""
        which = jnp.diag(jnp.asarray([1.0] * 3 + [0.0] * (self.space.n_freedom - 3), mass.dtype))
        return mass[:, None, None] * which[None]

    def _velocity_derivatives(self, x):
        """Return derivatives of velocities along x, y, z by motion, of each row, [n_row, f, f]."""
        width, factor = self.space.n_freedom, self.step.velocity_per_displacement
        if not self.space.rotates:
            return jnp.broadcast_to(factor * jnp.eye(3, dtype=x.dtype), (len(x), 3, 3))

        def velocity(spin, begin, motion):
            moved = _rotate_row(motion, spin)
            end = self.time_step_of_row(begin).end_state(self.space, moved[None])
            return to_space_axes(self.space, end.motion, end.velocity)[0, 3:]

        slopes = jnp.zeros((len(x), width, width), x.dtype)
        slopes = slopes.at[:, :3, :3].set(factor * jnp.eye(3, dtype=x.dtype))
        turning = jax.vmap(jax.jacfwd(velocity))(jnp.zeros_like(x[:, :3]), self.step.begin, x)
        return slopes.at[:, 3:, 3:].set(turning)

    def time_step_of_row(self, begin: MotionState) -> TimeStep:
        """Return the `TimeStep` of a single row, whose start `begin` has no axis of rows."""
        rows = jax.tree.map(lambda a: a[None], begin)
        return TimeStep(rows, self.step.duration, self.step.parameters)

    def _rotary_moment_derivatives(self, x):
        """Return derivatives of rotary inertia moments, N m, by rotations of rows, [n_row, 3, 3].

        Both are along x, y, z. Velocity and acceleration follow a rotation by the time integration.
        """

        def moment(spin, begin, motion, rotary):
            moved = _rotate_row(motion, spin)
            end = self.time_step_of_row(begin).end_state(self.space, moved[None])
            rates = end.velocity[0, 3:], end.acceleration[0, 3:]
            return _rotary_inertia_moment(rotary, moved[3:], *rates)

        given = jnp.zeros_like(x[:, :3]), self.step.begin, x, self.inertia.rotary
        return jax.vmap(jax.jacfwd(moment))(*given)

    def _inertia_and_damping_tangents(self, k, like, slopes):
        """Return the tangents of inertia and damping of elements of group `k`, [n_elem, d, d].

        `like` has an array of this shape, `slopes` the derivatives of `_velocity_derivatives`.
        """
        group, own, factor = self.groups[k], self.inertia, self.step.acceleration_per_displacement
        found = factor * _pad_per_end(own.masses[k], 3, group.n_freedom)
        if own.damping is not None:
            width, blocks = group.n_freedom, own.damping[k]
            links = group.links[:, : blocks.shape[1] // width]
            found = found + _blocks_times_derivatives(blocks, slopes[links], width)
        return _pad_matrices_to(found, like.shape[1])

    # --- what is different with inertia

    def nodes_without_stiffness(
        self, motion: Motion, slack: list[Bool[Array, " n_elem"]] | None = None
    ) -> Bool[Array, " n_row"]:
        """Return which rows have neither stiffness nor mass, [n_row] bool."""
        return super().nodes_without_stiffness(motion, slack) & ~jnp.any(
            self.inertia.dofs_with_mass(self), axis=1
        )

    def largest_displacement(self, x: Motion) -> Float[Array, ""]:
        """Return the largest displacement along an axis in this step, m: parts may fly far."""
        moved = drop_low_part(x)[:, :3] - self.step.begin.motion[:, :3]
        return jnp.max(jnp.abs(moved), initial=0.0)

    def unsymmetric(self) -> Bool[Array, ""]:
        """Return whether the tangent is unsymmetric: always with rotary inertia (gyroscopic)."""
        return super().unsymmetric() | (self.inertia.rotary is not None)


def _rotate_row(motion, spin):
    """Return the motion of one row after a small rotation `spin`, for derivatives at zero."""
    return move_node_by_series(motion, jnp.concatenate([jnp.zeros_like(spin), spin]), order=1)


def _rotary_inertia_moment(rotary, rotation, velocity, acceleration):
    """Return the moment ``R (J w' + w x J w)`` along x, y, z, [3], N m, of one row."""
    return rotate(rotation, rotary @ acceleration + cross(velocity, rotary @ velocity))


def _inertia_along_xyz(rotary, rotation):
    """Return rotary inertia ``R J R^T`` along x, y, z, [3, 3], kg m2, of one row."""

    def times(v):
        return rotate(rotation, rotary @ rotate(invert(rotation), v))

    return jax.vmap(times, 0, 1)(jnp.eye(3, dtype=rotary.dtype))


def _pad_per_end(blocks, width, wanted):
    """Return matrices for `width` rates an end, padded by zeros for `wanted` rates an end."""
    if width == wanted:
        return blocks
    n_elem, n_end = len(blocks), blocks.shape[1] // width
    own = blocks.reshape(n_elem, n_end, width, n_end, width)
    more = (0, wanted - width)
    own = jnp.pad(own, [(0, 0), (0, 0), more, (0, 0), more])
    return own.reshape(n_elem, n_end * wanted, n_end * wanted)


def _pad_matrices_to(blocks, size):
    """Return matrices [n_elem, d, d] padded by zero rows and columns: [n_elem, size, size]."""
    more = (0, size - blocks.shape[1])
    return jnp.pad(blocks, [(0, 0), more, more])


def _blocks_times_derivatives(blocks, slopes, width):
    """Return matrices times derivatives of the rates of their ends, [n_elem, d, d].

    `blocks` are [n_elem, d, d] by `width` rates of each end, `slopes` [n_elem, n_end, f, f].
    """
    n_elem, n_end = slopes.shape[:2]
    by_ends = blocks.reshape(n_elem, -1, n_end, width)
    found = jnp.einsum("eikj,ekjm->eikm", by_ends, slopes[..., :width, :width])
    return found.reshape(blocks.shape)


def initial_acceleration_and_load(
    bare: System, system: InertialSystem, state: MotionState
) -> tuple[Forces, Forces]:
    """Return accelerations by the equations of motion at one time, and the loads of `bare` then.

    Both are along x, y, z, [n_row, n_freedom]. Massless unknowns get zero, without equilibrium.

    Args:
        bare: the `System` without inertia, under the loads of this time.
        system: the `InertialSystem` with masses and damping; its step is of no meaning.
        state: `MotionState` with zero accelerations.
    """
    x = state.motion
    force = -bare.unbalanced(x) - system.inertia_force(state) - system.damping_force(state)
    matrix = system.assemble_mass_matrix(x)
    massless = linear.diagonal(matrix) <= 0
    matrix = linear.hold_unknowns(matrix, massless)
    rhs = jnp.where(massless, 0.0, system.space.restrict(force, x))
    found = linear.factorize(matrix).solve(rhs, lambda v: matrix @ v)
    zero = jnp.zeros_like(found)
    # the derivative: accelerations are no finite rotations of rigid links
    rows = jax.jvp(lambda step: system.space.prolong(x, step), (zero,), (found,))[1]
    return rows, bare.external_force(x)
