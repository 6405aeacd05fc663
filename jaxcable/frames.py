"""The whole structure where some nodes rotate: what `assembly.System` is to nets, for frames.

Every node has a motion of seven numbers, displacement and unit quaternion, and a step of up to six,
translation and spin. The point ``x`` of the iteration is the motion itself, [n_node, 7]; a step
[n_free] turns it on (`move`), so that rotations are updated and never added.

A spin enters the steps times a length, the mean length of the beams (`arm`): an arc. Then all
unknowns are lengths, all residuals forces, and one tolerance judges them.

The residual about ``x`` is the derivative of the energy with respect to a step from ``x``, at that
step. Its own derivative is a Hessian, symmetric also off equilibrium. A nodal moment that keeps its
direction in space has no potential; it enters by its work on the step and makes the tangent
unsymmetric (of the order of the moment). Plain Newton steps and derivatives of the result use all
of it, searched steps the symmetric part.
"""

from functools import partial

import jax
import jax.numpy as jnp
from jax import lax

from . import linear
from ._tree import pytree
from .assembly import System
from .elements.prestress import element
from .elementwise import each, motion_of
from .freedoms import along, combined
from .rotations import (
    IDENTITY,
    conjugate,
    cross,
    inverse,
    middle,
    product,
    rotate,
    turn_by,
    turned,
)

_NO_STIFFNESS = 1e-9  # of that of one node's spin, which a free spin may have from rounding


@pytree
class FrameSystem(System):
    """`System` with rotations; `load` and `held` have more columns.

    Attributes:
        load: force and moment on every node, [n_node, 6], N and N m.
        held: motion of every node, used where it is held, [n_node, 7].
        bearing: rotation in which the support of every row was set, [n_row, 4], where some hold
            rotations in directions of their own; None if that is as in `held`.
    """

    bearing: object = None

    turning = True

    @property
    def arm(self):
        """Length by which spins are multiplied, m; it scales unknowns, not results."""
        lengths = [
            jnp.linalg.norm(self.nodes[g.links[:, 1]] - self.nodes[g.links[:, 0]], axis=-1)
            for g in self.groups
            if g.n_freedom == 6
        ]
        return lax.stop_gradient(jnp.mean(jnp.concatenate(lengths)))

    # --- points and steps

    def motion(self, x):
        """The point of the iteration is the motion itself."""
        return x

    def unknowns(self, motion):
        """The point that belongs to a motion."""
        return motion

    def place(self, x):
        """`x` with held translations and clamped nodes put where their supports are."""
        fixed, axes = self.freedoms.fixed, self.freedoms.axes
        if axes is None:
            displacement = jnp.where(fixed[:, :3], self.held[:, :3], x[:, :3])
        else:
            own, held = along(axes, x[:, :3]), along(axes, self.held[:, :3])
            displacement = combined(axes, jnp.where(fixed[:, :3], held, own))
        clamped = jnp.all(fixed[:, 3:], axis=1, keepdims=True)
        rotation = jnp.where(clamped, self.held[:, 3:], x[:, 3:])
        return self._carried_along(jnp.concatenate([displacement, rotation], axis=1))

    def carried(self, x):
        """`x`, a constant, as a function of the rotation in which hinged supports were left."""
        hinged = jnp.any(self.freedoms.fixed[:, 3:], axis=1, keepdims=True)
        support = self._reference()
        relative = jax.vmap(product)(x[:, 3:], jax.vmap(inverse)(lax.stop_gradient(support)))
        rotation = jnp.where(hinged, jax.vmap(product)(relative, support), x[:, 3:])
        return jnp.concatenate([x[:, :3], rotation], axis=1)

    def _reference(self):
        """Rotation from which supports that hold some rotations reckon, [n_row, 4]."""
        return self.held[:, 3:] if self.bearing is None else self.bearing

    def move(self, x, step):
        """The motion after a step [n_free]."""
        return self._carried_along(jax.vmap(turned)(x, self._spread(x, step)))

    def reach(self, x):
        """Largest displacement of a point, m: what is said of rotations is no length."""
        return jnp.max(jnp.abs(x[:, :3]), initial=0.0)

    def _carried_along(self, x):
        """`x` with the nodes that others carry put where these take them."""
        if self.freedoms.carried is None:
            return x
        nodes, by = self.freedoms.carried
        arm, turn = self.nodes[nodes] - self.nodes[by], x[by, 3:]
        moved = x[by, :3] + jax.vmap(rotate)(turn, arm) - arm
        return x.at[nodes].set(jnp.concatenate([moved, turn], axis=1))

    def _arms(self, x):
        """From carriers to the nodes that they carry, as they are turned at `x`, [n, 3], m."""
        nodes, by = self.freedoms.carried
        return jax.vmap(rotate)(x[by, 3:], self.nodes[nodes] - self.nodes[by])

    def _spread(self, x, step):
        """Translation and spin of every row, [n_row, 6], from a step [n_free] from `x`.

        Carried nodes move with their carriers, by the turn of the arm itself.
        """
        full = jnp.append(step, jnp.zeros(1, step.dtype))[self.freedoms.number]
        full = full * self._scaling()
        if self.freedoms.axes is not None:
            shift = combined(self.freedoms.axes, full[:, :3])
            full = jnp.concatenate([shift, combined(self._spin_axes(x), full[:, 3:])], axis=1)
        if self.freedoms.carried is not None:
            nodes, by = self.freedoms.carried
            arm, spin = self._arms(x), full[by, 3:]
            swung = jax.vmap(lambda s, a: rotate(turn_by(s), a))(spin, arm) - arm
            full = full.at[nodes].set(jnp.concatenate([full[by, :3] + swung, spin], axis=1))
        return full

    def _spin_axes(self, x):
        """Directions of spins, rows of [n_row, 3, 3].

        Where one rotation is held the node swings, by the shortest way from `_reference`; the spins
        that keep it so are those across the held direction turned halfway along.
        """
        axes = jnp.asarray(self.freedoms.axes, x.dtype)
        alone = jnp.sum(self.freedoms.fixed[:, 3:], axis=1) == 1
        swing = jax.vmap(product)(x[:, 3:], jax.vmap(inverse)(self._reference()))
        still = jnp.asarray(IDENTITY, x.dtype)
        half = jax.vmap(lambda own, q: middle(still, jnp.where(own, q, still)))(alone, swing)
        return jax.vmap(lambda q, rows: jax.vmap(lambda v: rotate(q, v))(rows))(half, axes)

    def _scaling(self):
        arm = self.arm
        return jnp.concatenate([jnp.ones((1, 3), arm.dtype), jnp.full((1, 3), 1 / arm)], axis=1)

    def _slopes(self, motion):
        """Change of a row's motion by its numbers, [n_row, 6, 6]; None if only spins are scaled."""
        freedoms = self.freedoms
        if freedoms.axes is None and freedoms.carried is None:
            return None
        scale = self._scaling()
        slopes = jnp.zeros((len(motion), 6, 6), motion.dtype)
        if freedoms.axes is None:
            slopes = slopes + jnp.eye(6, dtype=motion.dtype)[None]
        else:
            slopes = slopes.at[:, :3, :3].set(jnp.swapaxes(jnp.asarray(freedoms.axes), 1, 2))
            slopes = slopes.at[:, 3:, 3:].set(jnp.swapaxes(self._spin_axes(motion), 1, 2))
        slopes = slopes * scale[None]
        if freedoms.carried is not None:
            nodes, by = freedoms.carried
            own = slopes[by]
            swung = jax.vmap(lambda a, spins: jax.vmap(lambda s: cross(s, a), 1, 1)(spins))(
                self._arms(motion), own[:, 3:]
            )
            slopes = slopes.at[nodes].set(own.at[:, :3].add(swung))
        return slopes

    def collected(self, force):
        """Sum at every unknown, [n_free], N, of forces and moments [n_row, 6]."""
        return self._collected(force, self.held, None)

    def _collected(self, force, x, spread):
        """The same at `x`, of forces conjugate to the steps `spread` of all rows from there."""
        n = self.freedoms.free.shape[0]
        force = self._handed_on(force, x, spread)
        if self.freedoms.axes is not None:
            force = jnp.concatenate(
                [along(self.freedoms.axes, force[:, :3]), along(self._spin_axes(x), force[:, 3:])],
                axis=1,
            )
        scaled = force * self._scaling()
        sums = jnp.zeros(n, force.dtype).at[self.freedoms.number].add(scaled, mode="drop")
        return self.freedoms.released(sums)

    def _handed_on(self, force, x, spread=None):
        """Forces and moments [n_row, 6] with those on carried nodes handed to their carriers."""
        if self.freedoms.carried is None:
            return force
        nodes, by = self.freedoms.carried
        arm, own = self._arms(x), force[nodes]
        if spread is None:
            turning = jax.vmap(cross)(arm, own[:, :3])
        else:
            spin = spread[by, 3:]
            arm = jax.vmap(lambda s, a: rotate(turn_by(s), a))(spin, arm)
            turning = jax.vmap(conjugate)(spin, jax.vmap(cross)(arm, own[:, :3]))
        force = force.at[nodes].set(0.0).at[by, :3].add(own[:, :3])
        return force.at[by, 3:].add(own[:, 3:] + turning)

    def chart(self, x):
        """Residual as a function of a step from `x`, the zero step, and the motion after a step."""
        x = self.place(x)
        # zero whatever x is, with the axes that x has in a batch: a root is sought from there
        zero = jnp.full(
            self.freedoms.free.shape[0], jnp.where(jnp.isnan(x[0, 0]), 0.0, 0.0), x.dtype
        )

        def residual(step):
            return self._held_still(self._residual_about(x, step), step)

        return residual, zero, lambda step: self.move(x, step)

    # --- forces

    def internal_force(self, motion, end_forces=None):
        """Sum of end forces and moments at every node, [n_node, 6], and their sizes, [n_node].

        `end_forces` are those of every group, if they are at hand.
        """
        force = jnp.zeros_like(motion[:, :6])
        size = jnp.zeros_like(motion[:, 0])
        if end_forces is None:
            end_forces = self.reading(motion, "end_forces")["end_forces"]
        for group, state, ends in zip(self.groups, self.states, end_forces, strict=True):
            if group.remembers:
                size = size.at[group.links].add(self.part_sizes(group, state, motion))
            force = force.at[group.links, : ends.shape[-1]].add(ends)
            own = _norm(ends[..., :3])
            if group.n_freedom == 6:
                own = own + _norm(ends[..., 3:]) / self.arm
            size = size.at[group.links].add(own)
        return force, size

    def _end_forces_about(self, motion, step):
        """End forces of every group conjugate to a step of all rows, [n_row, 6], from a motion."""
        found = []
        for group, state in zip(self.groups, self.states, strict=True):
            if group.n_freedom == 3:
                moved = motion[:, :3] + step[:, :3]
                found.append(each("end_forces", group, state, self.nodes, moved))
                continue
            ends, own = self.nodes[group.links], (motion_of(group, motion), step[group.links])
            about = jax.vmap(lambda p, *at, group=group: element(group, p).end_forces_about(*at))
            found.append(about(group.properties(), state, ends, *own))
        return found

    def _residual_about(self, x, step):
        """Unbalanced force conjugate to a step [n_free] from `x`, [n_free], N."""
        spread = self._spread(x, step)
        moment = jax.vmap(conjugate)(spread[:, 3:], self.load[:, 3:])
        force = self.load[:, :3]
        if self.followers is not None:
            force = force + self.following(self.nodes + x[:, :3] + spread[:, :3])
        load = jnp.concatenate([force, moment], axis=1)
        internal, _ = self.internal_force(x, self._end_forces_about(x, spread))
        return self._collected(internal - load, x, spread)

    def residual(self, x):
        """Unbalanced force at every free freedom, [n_free], N (moments over the arm)."""
        return self._collected(self.unbalanced(x), x, None)

    def residual_and_scale(self, x, end_forces=None):
        """Residual [n_free], and the force it is judged by, N."""
        (force, size), load = self.internal_force(x, end_forces), self.all_load(x)
        amount = _norm(load[:, :3]) + _norm(load[:, 3:]) / self.arm
        return self._collected(force - load, x, None), jnp.max(size + amount)

    def unsymmetric(self):
        """Whether nodal moments or following loads act, which make the tangent unsymmetric."""
        return jnp.any(self.load[:, 3:] != 0) | self.followed

    def load_norm(self, x):
        """Euclidean norm of the load on the free freedoms, N (moments over the arm)."""
        return jnp.linalg.norm(self._collected(self.all_load(x), x, None))

    def tangent(self, x, known=None):
        """Derivative of the residual by a step, a matrix of `linear`, N/m; see `System.tangent`."""
        tangents = self.tangents(x, known)
        if self._slopes(x) is None:
            pairs = zip(tangents, self.groups, strict=True)
            tangents = [self._scaled(b, g, g.links.shape[1]) for b, g in pairs]
        parts = self.parts(tangents, x) + self._following_blocks(x)
        return self._without_spins(self._assemble([*parts, self._turning_part(x)]), x)

    def _scaled(self, block, one, n_end):
        """Matrices of elements, [d, d] or [n_elem, d, d], with spins times a length."""
        scale = self._scaling()[0]
        count = n_end - one.n_inner_row
        own = [jnp.tile(scale[: one.n_freedom], count), jnp.ones(len(one.inner), scale.dtype)]
        own = jnp.concatenate(own)
        return jnp.einsum("...ij,i,j->...ij", block, own, own)

    def assembled(self, parts, motion):
        """See `System.assembled`."""
        if self._slopes(motion) is None:
            parts = [(self._scaled(b, group, group.links.shape[1]), group) for b, group in parts]
        return super().assembled(parts, motion)

    def _without_spins(self, matrix, x):
        """The tangent with free spins held at a node each, as far as they are without stiffness.

        A spring on one unknown that a spin z moves, where K z is zero: solutions for loads without
        work on z are those of K, with that unknown at rest.
        """
        if self.freedoms.spins is None:
            return matrix
        rows, piece, ends = self.freedoms.spins
        number = self.freedoms.number[rows, 3:]
        lines = self.nodes[ends[:, 1]] - self.nodes[ends[:, 0]]
        lines = lines / jnp.linalg.norm(lines, axis=1, keepdims=True)
        own = jax.vmap(rotate)(x[rows, 3:], lines[piece])
        if self.freedoms.axes is not None:
            own = along(self._spin_axes(x)[rows], own)
        diagonal = linear.diagonal(matrix)
        for k in range(len(ends)):
            mine = jnp.asarray(piece == k, own.dtype)[:, None]
            spin = jnp.zeros_like(diagonal).at[number].add(own * mine, mode="drop")
            held = jnp.argmax(jnp.abs(spin))
            stiffness = diagonal[held]
            # (a piece that another phase leaves free has no spin here)
            left = jnp.max(jnp.abs(matrix @ spin)) <= _NO_STIFFNESS * stiffness
            left = left & jnp.any(spin != 0)
            matrix = linear.plus_entry(matrix, held, jnp.where(left, stiffness, 0.0))
        return matrix

    def _turning_part(self, x):
        """What nodal moments, and forces on arms, take from the tangent as nodes turn.

        See `rotations.conjugate`. For one node after the other, by its spins.
        """
        zero = jnp.zeros_like(x[:, :3])
        load, first = self._handed_on(self.load, x), partial(conjugate, order=1)
        change = -jax.vmap(jax.jacfwd(first))(zero, load[:, 3:])
        if self.freedoms.carried is not None:
            nodes, by = self.freedoms.carried
            pull, arm = self.unbalanced(x)[nodes, :3], self._arms(x)
            # the moment of loads on arms is in `load` already
            own = jax.vmap(jax.jacfwd(first))(zero[by], jax.vmap(cross)(arm, self.load[nodes, :3]))
            change = change.at[by].add(own)

            def turning(spin, arm, pull):
                return first(spin, cross(rotate(turn_by(spin, order=1), arm), pull))

            change = change.at[by].add(jax.vmap(jax.jacfwd(turning))(zero[by], arm, pull))
        if self.freedoms.axes is not None:
            axes = self._spin_axes(x)
            change = jnp.einsum("nai,nij,nbj->nab", axes, change, axes)
        return change / self.arm**2, self.freedoms.number[:, 3:]

    def potential(self, x):
        """Stored energy minus the work of the nodal forces, J; moments have no potential."""
        return self.stored_energy(x) - jnp.sum(self.load[:, :3] * x[:, :3])

    # --- results

    def reactions(self, motion, end_forces=None):
        """Forces and moments of the supports on the structure, [n_row, 6]; zero where free."""
        force, freedoms = self.unbalanced(motion, end_forces), self.freedoms
        force = self._handed_on(force, motion)
        fixed = freedoms.fixed
        if freedoms.inner is not None:
            fixed = fixed & ~freedoms.inner[:, None]
        if freedoms.axes is None:
            return jnp.where(fixed, force, 0.0)
        spins = self._spin_axes(motion)
        shift = jnp.where(fixed[:, :3], along(freedoms.axes, force[:, :3]), 0.0)
        turn = jnp.where(fixed[:, 3:], along(spins, force[:, 3:]), 0.0)
        return jnp.concatenate([combined(freedoms.axes, shift), combined(spins, turn)], axis=1)


def _norm(vectors):
    return jnp.sqrt(jnp.sum(vectors**2, axis=-1))
