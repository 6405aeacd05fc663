"""An element written outside of the package, against its contract: a spring to the ground."""

import jax
import jax.numpy as jnp
import numpy as np

import jaxcable as jc
from jaxcable._tree import Indices, pytree
from jaxcable.elements.element import Element, ElementState


@pytree
class Nothing(ElementState):
    """Phases change nothing in it."""


@jc.files.register
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
            object.__setattr__(self, "links", Indices(self.links))
        if not isinstance(self.stiffness, jax.Array):
            object.__setattr__(self, "stiffness", np.asarray(self.stiffness))

    def start(self, ends):
        return Nothing()

    def end_forces(self, state, ends, motion):
        return self.stiffness[None] * motion

    def energy(self, state, ends, motion):
        return 0.5 * jnp.sum(self.stiffness[None] * motion**2)
