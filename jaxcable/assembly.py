"""The whole structure: residual, tangent, energy and results of one loaded state.

A `System` holds everything that is fixed while equilibrium is sought at one load factor. Its
unknowns ``x`` are the free displacements, [n_free]; held ones are not among them.
"""

import jax
import jax.numpy as jnp

from ._tree import copy, pytree
from .elements.prestress import element


@pytree
class System:
    """One state of loading, ready to be brought to equilibrium.

    Attributes:
        nodes: initial positions, [n_node, 3], m.
        groups: element groups, their links arrays.
        states: element states, one per group (prestress).
        load: dead load on every node, [n_node, 3], N.
        held: displacement of every freedom, used where it is held, [3 n_node], m.
        freedoms: numbering of the unknowns.
    """

    nodes: object
    groups: object
    states: object
    load: object
    held: object
    freedoms: object

    def displacement(self, x):
        """Displacement of all nodes, [n_node, 3], from the unknowns [n_free]."""
        return jnp.concatenate([x, self.held])[self.freedoms.source].reshape(self.nodes.shape)

    def unknowns(self, displacement):
        """The unknowns [n_free] of a displacement [n_node, 3]."""
        return displacement.reshape(-1)[self.freedoms.free]

    def internal_force(self, displacement):
        """Sum of the end forces at every node, [n_node, 3], and of their norms, [n_node], N."""
        force = jnp.zeros_like(displacement)
        size = jnp.zeros_like(displacement[:, 0])
        for group, state in zip(self.groups, self.states, strict=True):
            ends = each("end_forces", group, state, self.nodes, displacement)
            force = force.at[group.links].add(ends)
            size = size.at[group.links].add(jnp.sqrt(jnp.sum(ends**2, axis=-1)))
        return force, size

    def unbalanced(self, displacement):
        """Internal force minus load at every node, [n_node, 3], N."""
        return self.internal_force(displacement)[0] - self.load

    def residual(self, x):
        """Unbalanced force at every free freedom, [n_free], N."""
        return self.unbalanced(self.displacement(x)).reshape(-1)[self.freedoms.free]

    def residual_and_scale(self, x):
        """Residual [n_free], and the force it is judged by, N.

        The scale is the largest, over nodes, of the sum of absolute end forces plus the load.
        """
        force, size = self.internal_force(self.displacement(x))
        scale = jnp.max(size + jnp.sqrt(jnp.sum(self.load**2, axis=-1)))
        return (force - self.load).reshape(-1)[self.freedoms.free], scale

    def tangent(self, x):
        """Tangent stiffness, dense [n_free, n_free], N/m: autodiff of the element forces."""
        return self._matrix(
            lambda one, state, ends, u: jax.jacfwd(one.end_forces, argnums=2)(state, ends, u),
            self.displacement(x),
        )

    def secant(self, before, x):
        """Secant stiffness between two states, each [n_free], dense [n_free, n_free], N/m."""
        return self._matrix(
            lambda one, *args: one.secant(*args), self.displacement(before), self.displacement(x)
        )

    def _matrix(self, block, *displacements):
        """Assemble element matrices block(element, state, ends, *motions), [n_end, 3, n_end, 3]."""
        n = self.freedoms.free.shape[0]
        matrix = jnp.zeros((n, n), self.nodes.dtype)
        for group, state in zip(self.groups, self.states, strict=True):
            blocks = jax.vmap(lambda p, *args, group=group: block(element(group, p), *args))(
                group.properties(),
                state,
                self.nodes[group.links],
                *(displacement[group.links] for displacement in displacements),
            )
            number = self.freedoms.number[group.links].reshape(len(blocks), -1)
            blocks = blocks.reshape(*number.shape, number.shape[1])
            # held freedoms have number n: out of range, dropped
            matrix = matrix.at[number[:, :, None], number[:, None, :]].add(blocks, mode="drop")
        return matrix

    def stored_energy(self, displacement):
        """Energy stored in the elements, J."""
        return sum(
            jnp.sum(each("energy", group, state, self.nodes, displacement))
            for group, state in zip(self.groups, self.states, strict=True)
        )

    def potential(self, x):
        """Stored energy minus the work of the loads, J; the residual is its gradient."""
        displacement = self.displacement(x)
        return self.stored_energy(displacement) - jnp.sum(self.load * displacement)

    def tensions(self, displacement):
        """Axial forces, one array [n_elem] per group, N."""
        return [
            each("tension", group, state, self.nodes, displacement)
            for group, state in zip(self.groups, self.states, strict=True)
        ]

    def reactions(self, displacement):
        """Forces of the supports on the structure, [n_node, 3], N; zero where free."""
        return jnp.where(self.freedoms.fixed, self.unbalanced(displacement), 0.0)

    def slack(self, displacement):
        """Slack elements, one boolean array [n_elem] per group."""
        return [
            each("is_slack", group, state, self.nodes, displacement)
            for group, state in zip(self.groups, self.states, strict=True)
        ]

    def loose_nodes(self, displacement):
        """Nodes that are not wholly supported and touch only slack elements, [n_node] bool."""
        held_up = jnp.zeros(self.nodes.shape[0], bool)
        for group, slack in zip(self.groups, self.slack(displacement), strict=True):
            held_up = held_up.at[group.links].max(~slack[:, None])
        return ~held_up & ~jnp.all(self.freedoms.fixed, axis=-1)

    @property
    def tension_only(self):
        """Whether all groups are: then the energy is convex under dead load."""
        return all(group.tension_only for group in self.groups)

    def softened(self, compliance):
        """The same system with a spring in series with every element, strain per force, 1/N."""
        return copy(self, groups=[group.softened(compliance) for group in self.groups])

    def length_scale(self):
        """A length to measure steps by: the mean initial element length, m."""
        lengths = [
            jnp.linalg.norm(self.nodes[g.links[:, -1]] - self.nodes[g.links[:, 0]], axis=-1)
            for g in self.groups
        ]
        return jnp.mean(jnp.concatenate(lengths))

    def extent(self):
        """Size of the whole structure: diagonal of its bounding box, m."""
        return jnp.linalg.norm(jnp.max(self.nodes, axis=0) - jnp.min(self.nodes, axis=0))


def each(method, group, state, nodes, displacement):
    """Evaluate an element method for all elements of a group by vmap."""

    def one(properties, state, ends, motion):
        return getattr(element(group, properties), method)(state, ends, motion)

    ends, motion = nodes[group.links], displacement[group.links]
    return jax.vmap(one)(group.properties(), state, ends, motion)
