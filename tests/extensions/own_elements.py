"""An element written outside of the package, against its contract: a spring to the ground."""

import jax
import jax.numpy as jnp
import numpy as np

from jaxcable.extend import (
    Element,
    ElementState,
    Indices,
    pytree,
    register,
    rotations,
    set_fields,
)


@pytree
class Nothing(ElementState):
    """Phases change nothing in it."""


@register
@pytree(indices=("links",))
class GroundSprings(Element):
    """Linear springs from nodes to the ground, along x, y and z.

    Args:
        links: node numbers, [n_elem, 1].
        stiffness: [n_elem, 3], N/m.
    """

    links: object
    stiffness: object

    per_element = ("stiffness",)

    def __post_init__(self):
        if not isinstance(self.links, Indices):
            set_fields(self, links=Indices(self.links))
        if not isinstance(self.stiffness, jax.Array):
            set_fields(self, stiffness=np.asarray(self.stiffness))

    def start(self, ends):
        return Nothing()

    def end_forces(self, state, ends, motion):
        return self.stiffness[None] * motion

    def energy(self, state, ends, motion):
        return 0.5 * jnp.sum(self.stiffness[None] * motion**2)


@pytree(indices=("links",))
class TurningSprings(Element):
    """Springs against the rotation of nodes, alike about all axes: they make nodes rotate.

    Args:
        links: node numbers, [n_elem, 1].
        stiffness: [n_elem], N m.
    """

    links: object
    stiffness: object

    per_element = ("stiffness",)
    rotates = True

    def __post_init__(self):
        if not isinstance(self.links, Indices):
            set_fields(self, links=Indices(self.links))

    def start(self, ends):
        return Nothing()

    def _moment(self, motion):
        return self.stiffness * _angles(motion)

    def end_forces(self, state, ends, motion):
        return jnp.concatenate([jnp.zeros(3), self._moment(motion)])[None]

    def end_forces_after_step(self, state, ends, motion, step):
        moment = self._moment(jax.vmap(rotations.move_node_by_series)(motion, step))
        return jnp.concatenate([jnp.zeros(3), rotations.conjugate_moment(step[0, 3:], moment)])[
            None
        ]

    def tangent(self, state, ends, motion):
        still = jnp.zeros((1, 6))
        return jax.jacfwd(lambda step: self.end_forces_after_step(state, ends, motion, step))(still)

    def energy(self, state, ends, motion):
        return 0.5 * self.stiffness * jnp.sum(_angles(motion) ** 2)


def _angles(motion):
    """Rotation of a node as a vector, rad."""
    return rotations.stereographic_to_rotation_vector(rotations.to_stereographic(motion[0, 3:]))
