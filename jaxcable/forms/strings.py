"""Members without a material: a given force, and a spring about a given length.

What form finding iterates with. ``N = T + k (l - L)``: with ``k = 0`` a member holds its force
whatever its length, as a string over a pulley does; with a large ``k`` it nearly holds its length.
"""

import jax.numpy as jnp

from .._tree import Indices, pytree
from ..elements import Bars
from ..elements.prestress import Readable, stretch


@pytree
class StringState:
    """Force and spring of the members of a group.

    Attributes:
        force: T, [n_elem], N.
        stiffness: k, [n_elem], N/m.
        excess: initial length less L, [n_elem], m.
    """

    force: object
    stiffness: object
    excess: object


@pytree(static=("tension_only",), indices=("links",))
class Strings(Readable):
    """A group of such members; see `elements` for what a group has to give.

    Attributes:
        links: node numbers, [n_elem, 2].
        tension_only: whether all forces are known to be tensions, and no member has a spring.
    """

    links: Indices
    tension_only: bool = False

    n_freedom = 3
    inner = ()
    n_inner_row = 0
    rising = True
    breaks = remembers = shaped_by_load = slides = False
    rounding = None

    def properties(self):
        """Nothing: all of it is state."""
        return {}

    def chord(self, ends):
        """Length between the ends, [n_elem], m."""
        return jnp.linalg.norm(ends[:, 1] - ends[:, 0], axis=-1)

    def softened(self, compliance):
        """Itself: a held force has no stiffness to soften."""
        return self

    def tension(self, state, ends, motion):
        """Axial force, N."""
        return state.force + state.stiffness * (state.excess + stretch(ends, motion)[2])

    def energy(self, state, ends, motion):
        """Work of the force and of the spring, J."""
        change = stretch(ends, motion)[2]
        gap = state.excess + change
        return state.force * change + 0.5 * state.stiffness * gap**2

    def at_kink(self, state, ends, motion):
        """Its force has no kink."""
        return jnp.zeros((), bool)

    def is_slack(self, state, ends, motion):
        """Whether it holds nothing at all."""
        return (state.force == 0) & (state.stiffness == 0)

    _pull = Bars._pull
    end_forces = Bars.end_forces
    tangent = Bars.tangent
