"""Elements with a single force, along the line through their two nodes."""

from __future__ import annotations

import abc
from typing import ClassVar

import jax
import jax.numpy as jnp

from ..common.types import Array, Float
from .element import TENSION, Element, Ends, Forces, Motion, Result, Scalar
from .prestress import AxialState, measure_chord


class Axial(Element):
    """Elements of two nodes whose only force acts along the line through these nodes."""

    results: ClassVar[tuple[Result, ...]] = (TENSION,)
    paired = True

    @abc.abstractmethod
    def tension(self, state: AxialState, ends: Ends, motion: Motion) -> Scalar:
        """Return the axial force of one element, N."""

    def end_forces(self, state: AxialState, ends: Ends, motion: Motion) -> Forces:
        """Return the forces at both ends of one element, [2, 3], N, outwards in tension."""
        pull = self._axial_force_vector(state, ends, motion)
        return jnp.stack([-pull, pull])

    def _axial_force_vector(
        self, state: AxialState, ends: Ends, motion: Motion
    ) -> Float[Array, " 3"]:
        """Return the axial force as a vector from the first end to the second, [3], N."""
        vector, length, _, _ = measure_chord(ends, motion)
        return self.tension(state, ends, motion) * vector / length

    def tangent(self, state: AxialState, ends: Ends, motion: Motion) -> Float[Array, "2 3 2 3"]:
        """Return the tangent stiffness of one element, [2, 3, 2, 3], N/m, by autodiff of forces.

        The end forces depend only on the relative displacement of the ends. Hence the derivatives
        by the displacement of the second end give all of them.
        """

        def pull(second):
            return self._axial_force_vector(state, ends, jnp.stack([motion[0], second]))

        # the barrier keeps XLA from computing the block again for each of its four uses
        block = jax.lax.optimization_barrier(jax.jacfwd(pull)(motion[1]))
        return jnp.stack([jnp.stack([block, -block], 1), jnp.stack([-block, block], 1)])
