"""Members without a material: a prescribed force, and a spring about a given length.

Form finding iterates with these members. Their force is ``N = T + k (l - L)``: with ``k = 0`` a
member keeps its force whatever its length, as a string over a pulley with a weight does; with a
large ``k`` it nearly keeps its length.
"""

from __future__ import annotations

import jax.numpy as jnp

from ..common.tree import Indices, pytree
from ..common.types import Array, Float
from ..elements.axial import Axial
from ..elements.element_state import ElementState
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
    """A group of members with prescribed forces and springs; see `elements` for the methods.

    Attributes:
        links: node numbers, [n_elem, 2].
        tension_only: whether all forces are known to be tensions, and no member has a spring.
    """

    links: Indices
    tension_only: bool = False

    rising = True

    def start(self, ends):
        """A state without force and spring; form finding makes the states that it uses."""
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
        """Whether a member has neither force nor spring."""
        return (state.force == 0) & (state.stiffness == 0)
