"""Members without a material: a given force, and a spring about a given length.

What form finding iterates with. ``N = T + k (l - L)``: with ``k = 0`` a member holds its force
whatever its length, as a string over a pulley does; with a large ``k`` it nearly holds its length.
"""

from __future__ import annotations

import jax.numpy as jnp

from ..common.tree import Indices, pytree
from ..common.types import Array, Float
from ..elements.bar import Axial
from ..elements.element import ElementState
from ..elements.prestress import stretch


@pytree
class StringState(ElementState):
    """Force and spring of the members of a group.

    Attributes:
        force: T, [n_elem], N.
        stiffness: k, [n_elem], N/m.
        excess: initial length less L, [n_elem], m.
    """

    force: Float[Array, " n_elem"]
    stiffness: Float[Array, " n_elem"]
    excess: Float[Array, " n_elem"] | None


@pytree(static=("tension_only",), indices=("links",))
class Strings(Axial):
    """A group of such members; see `elements` for what a group has to give.

    Attributes:
        links: node numbers, [n_elem, 2].
        tension_only: whether all forces are known to be tensions, and no member has a spring.
    """

    links: Indices
    tension_only: bool = False

    rising = True

    def start(self, ends):
        """A member that holds nothing; form finding makes its states itself."""
        nothing = jnp.zeros(len(ends), ends.dtype)
        return StringState(nothing, nothing, nothing)

    def tension(self, state, ends, motion):
        """Axial force, N."""
        return state.force + state.stiffness * (state.excess + stretch(ends, motion)[2])

    def energy(self, state, ends, motion):
        """Work of the force and of the spring, J."""
        change = stretch(ends, motion)[2]
        gap = state.excess + change
        return state.force * change + 0.5 * state.stiffness * gap**2

    def is_slack(self, state, ends, motion):
        """Whether it holds nothing at all."""
        return (state.force == 0) & (state.stiffness == 0)
