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

import jax
import jax.numpy as jnp
from jax import lax

from ._tree import pytree
from .assembly import System, each, motion_of
from .elements.prestress import element
from .rotations import conjugate, inverse, product, turned


@pytree
class FrameSystem(System):
    """`System` with rotations; `load` and `held` have more columns.

    Attributes:
        load: force and moment on every node, [n_node, 6], N and N m.
        held: motion of every node, used where it is held, [n_node, 7].
    """

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
        fixed = self.freedoms.fixed
        displacement = jnp.where(fixed[:, :3], self.held[:, :3], x[:, :3])
        clamped = jnp.all(fixed[:, 3:], axis=1, keepdims=True)
        rotation = jnp.where(clamped, self.held[:, 3:], x[:, 3:])
        return jnp.concatenate([displacement, rotation], axis=1)

    def carried(self, x):
        """`x`, a constant, as a function of the rotation in which hinged supports were left."""
        hinged = jnp.any(self.freedoms.fixed[:, 3:], axis=1, keepdims=True)
        support = self.held[:, 3:]
        relative = jax.vmap(product)(x[:, 3:], jax.vmap(inverse)(lax.stop_gradient(support)))
        rotation = jnp.where(hinged, jax.vmap(product)(relative, support), x[:, 3:])
        return jnp.concatenate([x[:, :3], rotation], axis=1)

    def move(self, x, step):
        """The motion after a step [n_free]."""
        return jax.vmap(turned)(x, self._spread(step))

    def _spread(self, step):
        """Translation and spin of every node, [n_node, 6], from a step [n_free]."""
        full = jnp.append(step, jnp.zeros(1, step.dtype))[self.freedoms.number]
        return full * self._scaling()

    def _scaling(self):
        arm = self.arm
        return jnp.concatenate([jnp.ones((1, 3), arm.dtype), jnp.full((1, 3), 1 / arm)], axis=1)

    def collected(self, force):
        """Sum at every unknown, [n_free], N, of forces and moments [n_node, 6]."""
        n = self.freedoms.free.shape[0]
        scaled = force * self._scaling()
        return jnp.zeros(n, force.dtype).at[self.freedoms.number].add(scaled, mode="drop")

    def chart(self, x):
        """Residual as a function of a step from `x`, the zero step, and the motion after a step."""
        x = self.place(x)
        # zero whatever x is, with the axes that x has in a batch: a root is sought from there
        zero = jnp.full(
            self.freedoms.free.shape[0], jnp.where(jnp.isnan(x[0, 0]), 0.0, 0.0), x.dtype
        )
        return (lambda step: self._residual_about(x, step)), zero, lambda step: self.move(x, step)

    # --- forces

    def internal_force(self, motion):
        """Sum of end forces and moments at every node, [n_node, 6], and their sizes, [n_node]."""
        return self._internal_about(motion, None)

    def _internal_about(self, motion, step):
        force = jnp.zeros_like(motion[:, :6])
        size = jnp.zeros_like(motion[:, 0])
        arm = self.arm
        for group, state in zip(self.groups, self.states, strict=True):
            if group.remembers:
                size = size.at[group.links].add(self.part_sizes(group, state, motion))
            if group.n_freedom == 3:
                moved = motion if step is None else motion[:, :3] + step[:, :3]
                ends = each("end_forces", group, state, self.nodes, moved)
                force = force.at[group.links, :3].add(ends)
                size = size.at[group.links].add(_norm(ends))
                continue
            if step is None:
                ends = each("end_forces", group, state, self.nodes, motion)
            else:
                ends = jax.vmap(
                    lambda p, *args, group=group: element(group, p).end_forces_about(*args)
                )(
                    group.properties(),
                    state,
                    self.nodes[group.links],
                    motion_of(group, motion),
                    step[group.links],
                )
            force = force.at[group.links].add(ends)
            size = size.at[group.links].add(_norm(ends[..., :3]) + _norm(ends[..., 3:]) / arm)
        return force, size

    def _residual_about(self, x, step):
        """Unbalanced force conjugate to a step [n_free] from `x`, [n_free], N."""
        spread = self._spread(step)
        moment = jax.vmap(conjugate)(spread[:, 3:], self.load[:, 3:])
        force = self.load[:, :3]
        if self.followers is not None:
            force = force + self.following(self.nodes + x[:, :3] + spread[:, :3])
        load = jnp.concatenate([force, moment], axis=1)
        return self.collected(self._internal_about(x, spread)[0] - load)

    def residual(self, x):
        """Unbalanced force at every free freedom, [n_free], N (moments over the arm)."""
        return self.collected(self.unbalanced(x))

    def residual_and_scale(self, x):
        """Residual [n_free], and the force it is judged by, N."""
        (force, size), load = self.internal_force(x), self.all_load(x)
        amount = _norm(load[:, :3]) + _norm(load[:, 3:]) / self.arm
        return self.collected(force - load), jnp.max(size + amount)

    def unsymmetric(self):
        """Whether nodal moments or following loads act, which make the tangent unsymmetric."""
        return jnp.any(self.load[:, 3:] != 0) | (self.followers is not None)

    def load_norm(self, x):
        """Euclidean norm of the load on the free freedoms, N (moments over the arm)."""
        return jnp.linalg.norm(self.collected(self.all_load(x)))

    def tangent(self, x):
        """Derivative of the residual by a step, a matrix of `linear`, N/m."""
        scale = self._scaling()[0]

        def block(one, state, ends, motion):
            own = scale[: one.n_freedom]
            tangent = one.tangent(state, ends, motion)
            return tangent * own[None, :, None, None] * own[None, None, None, :]

        parts = self._blocks(block, x)
        # the change of a moment's work on the step, see `rotations.conjugate`
        change = jax.vmap(jax.jacfwd(conjugate))(jnp.zeros_like(x[:, :3]), self.load[:, 3:])
        parts += self._following_blocks(x)
        return self._assemble([*parts, (-change / self.arm**2, self.freedoms.number[:, 3:])])

    def potential(self, x):
        """Stored energy minus the work of the nodal forces, J; moments have no potential."""
        return self.stored_energy(x) - jnp.sum(self.load[:, :3] * x[:, :3])

    # --- results

    def reactions(self, motion):
        """Forces and moments of the supports on the structure, [n_node, 6]; zero where free."""
        return jnp.where(self.freedoms.fixed, self.unbalanced(motion), 0.0)

    def section_forces(self, motion):
        """Section forces at the integration points of beams, per group; None for others."""
        return [
            each("section_forces", group, state, self.nodes, motion)
            if group.n_freedom == 6
            else None
            for group, state in zip(self.groups, self.states, strict=True)
        ]


def _norm(vectors):
    return jnp.sqrt(jnp.sum(vectors**2, axis=-1))
