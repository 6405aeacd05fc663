"""Cable: a bar that carries tension only.

At exactly zero strain the tangent is that of a taut cable: a flat net without prestress starts
there and needs its axial stiffness. Hence ``where(e < 0, 0, ...)``, which also passes a NaN on
instead of calling the cable slack.
"""

from __future__ import annotations

import jax
import jax.numpy as jnp

from ..common.tree import copy_with, pytree
from ..common.types import Array, Bool, Float
from ..materials import Parallel
from . import rebasing
from .abilities import LengthSlack, TensionElement, TensionResponse
from .bar import TwoNodeStraight
from .element import Ends, Motion, Scalar
from .prestress import AxialState, jack_value_or
from .straight import Straight


class TensionOnly(Straight, TensionElement):
    """Straight elements that go slack: the force is zero where it would be a compression."""

    tension_only = True

    def force(self, strain: Scalar, memory: Float[Array, " n_memory"] | None = None) -> Scalar:
        """Return the axial force at a strain, N; zero in a slack cable."""
        return self._zero_if_slack(super().force(strain, memory), strain, memory)

    def energy_per_length(
        self, strain: Scalar, memory: Float[Array, " n_memory"] | None = None
    ) -> Scalar:
        """Return the stored energy per unstressed length, J/m; zero if slack and without `memory`.

        With history variables, parts of a law that have yielded still pull and push each other in a
        slack cable, and this energy remains.
        """
        energy = super().energy_per_length(strain, memory)
        return energy if memory is not None else self._zero_if_slack(energy, strain, memory)

    def fibre_stress(
        self, strain: Scalar, memory: Float[Array, " n_memory"] | None = None
    ) -> Float[Array, " n_fibre"] | Scalar:
        """Return the stress of every fibre, Pa; stress times area sums up to zero in a slack cable.

        Each stress is zero, too, unless the cable has several laws and some have yielded: then the
        stresses at which it went slack remain, in equilibrium. A cable with one law in place of a
        section has one stress, a scalar. Without history variables `memory` is None.
        """
        return self._zero_if_slack(super().fibre_stress(strain, memory), strain, memory)

    def is_slack(self, state: AxialState, ends: Ends, motion: Motion) -> Bool[Array, ""]:
        """Return whether one cable carries no force because it is too short; False with a jack."""
        return jack_value_or(
            state,
            jnp.zeros((), bool),
            lambda: self._is_slack_at(self.strain(state, ends, motion), state.memory),
        )

    def suits_cone_solver(self, state: AxialState) -> bool:
        """Return whether the law is linear, as `equilibrium.conic_interior_point` needs it."""
        return self.linear_axial_stiffness() is not None

    def tension_response(self, state: AxialState, ends: Ends, motion: Motion) -> TensionResponse:
        """Return tension, its stiffness and the end forces of one cable at a motion of its ends."""
        tension, slope = self.tension_and_stiffness(state, ends, motion)
        along = self.end_forces(_with_unit_jack_force(state), ends, motion)
        shape = self.strain(state, ends, motion)
        return TensionResponse(tension, slope, along, tension * along, shape)

    def rebased_element(
        self, state: AxialState, ends: Ends, motion: Motion, precise: Bool[Array, ""]
    ) -> tuple[AxialState, Ends, Motion]:
        """Return one cable as if it began at its present positions: its state, ends and motion.

        Its `motion` is the sum of columns 0 to 2 and of small numbers in columns 3 to 5, [n_end,
        6], m; the elongation has the precision of this sum if that is to be `precise`.
        """
        elongation, places = rebasing.elongation_and_moved_ends(
            state.elongation, ends, motion, precise
        )
        return copy_with(state, elongation=elongation), places, jnp.zeros_like(places)

    def length_slack(self, state: AxialState, tension: Scalar, shape: Scalar) -> LengthSlack:
        """Return by how much one cable under a tension, N, would exceed its present length.

        `shape` is its present strain.
        """
        one = jnp.ones_like(tension)
        under, slope = jax.jvp(lambda n: self.strain_at(n, state.memory), (tension,), (one,))
        return LengthSlack(state.rest_length * (under - shape), state.rest_length * slope)

    def geometric_stiffness(
        self, state: AxialState, ends: Ends, motion: Motion, tension: Scalar
    ) -> Float[Array, "n_end 3 n_end 3"]:
        """Return the tension, N, times the second derivative of the length of one cable, N/m."""
        return tension * self.tangent(_with_unit_jack_force(state), ends, motion)

    def at_kink(self, state: AxialState, ends: Ends, motion: Motion) -> Bool[Array, ""]:
        """Return whether the strain of one cable is zero up to rounding: between taut and slack."""
        return self.is_unstressed(state, ends, motion)

    def _zero_if_slack(self, value, strain, memory):
        """Return `value`, a force, stress or energy at a strain, or zero if the cable is slack.

        A `Parallel` law has zeros there already. `memory` has history variables, or is None.
        """
        if isinstance(self._stiffness_law_and_area()[1], Parallel):
            return value
        return jnp.where(self._is_slack_at(strain, memory), 0.0, value)

    def _is_slack_at(self, strain, memory):
        """Return whether a cable with history variables `memory` (or None) is slack at a strain."""
        if memory is None:
            return strain < 0
        # plastic strain has lengthened the cable: the law (or several of them, by the sum of their
        # stresses) says where the force ends
        return self._stiffness_law_and_area()[1].is_slack(strain, memory)

    def _stiffness_law_and_area(self):
        """Return axial stiffness, N, law (without compression), and area, m2, as for `Straight`."""
        stiffness, law, area = super()._stiffness_law_and_area()
        return stiffness, None if law is None else law.tension_only(), area


def _with_unit_jack_force(state):
    """Return the state of an element in which a jack prescribes a force of 1 N."""
    return copy_with(state, jack_force=jnp.ones_like(state.rest_length), jacked=None)


@pytree(indices=("links",))
class Cables(TensionOnly, TwoNodeStraight):
    """A group of straight two-node cables: as `Bars`, but in tension only.

    ``N = max(EA e, 0)`` or ``N = A s(e)`` with ``e = (l - L0) / L0``; at ``e = 0`` the tangent is
    that of the taut cable. With a section of several laws ``N`` is the sum over all laws, or zero
    if this sum is a compression: a cable goes slack as a whole. Arguments and errors are those of
    `Bars`.

    Example:
        Two cables, prestressed so that 600 N hang in a 3-4-5 triangle:

        >>> nodes = [[-4.0, 0.0, 3.0], [0.0, 0.0, 0.0], [4.0, 0.0, 3.0]]
        >>> cables = jc.Cables([[0, 1], [1, 2]], axial_stiffness=1e5)
        >>> structure = jc.Structure(nodes, cables, supports=jc.pinned([0, 2]))
        >>> weight = jc.NodalLoads([1], (0.0, 0.0, -600.0))
        >>> solution = jc.solve(structure, jc.Phase(pretension=500.0, loads=weight))
        >>> jc.describe(solution.status)
        'converged'
        >>> print(jnp.round(solution.tension, 6), jnp.round(solution.displacement[1], 6))  # N, m
        [500. 500.] [0. 0. 0.]
        >>> print(jnp.round(solution.rest_length, 6))  # 5 m / (1 + 500 / 1e5)
        [4.975124 4.975124]
    """
