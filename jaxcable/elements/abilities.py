"""Abilities that only some elements have: one base class each, from which an element derives.

Other abilities are attributes of `Element`, because they depend on a law or a load:

| attribute | methods that an element must then have |
|---|---|
| `has_memory` | `absolute_force`, `initial_memory`; `committed_memory` (default: by strain) |
| `has_rupture` | `is_ruptured`, `section_strain`; `extrapolated` if forces end at rupture |
| `tension_only` | `is_slack`, `at_kink` |
| `compression_only` | `is_slack` (it is open), `at_kink` |
| `rotates` | `end_forces_after_step` |
| `slides` | `sliding_load_forces` |
| `face` | none: loads on areas then find it by its group |
| `inner_unknowns`, `n_inner_row` | `unused_columns`; its end forces and motion have rows for them |

`contract.require_abilities` refuses a group that lacks one of them; `contract.check` calls all of
them.
"""

from __future__ import annotations

import abc
from collections.abc import Mapping
from typing import ClassVar

import jax
import jax.numpy as jnp

from ..common.tree import pytree
from ..common.types import Array, ArrayLike, Bool, Float, PyTree
from .element import (
    PEAK_TENSION,
    SECTION_FORCES,
    SECTION_STRAIN,
    TENSION,
    Element,
    Ends,
    Forces,
    Motion,
    Result,
    Scalar,
)
from .element_state import ElementState, OwnState
from .phase_input import InputValues, PhaseInput

PHASE_INPUTS = {
    name: PhaseInput(name, unit)
    for name, unit in (
        *(("pretension", "N"), ("force_density", "N/m"), ("prestrain", "-"), ("rest_length", "m")),
        *(("shortening", "m"), ("temperature", "K"), ("sag", "m"), ("jacking", "N")),
        *(("end_tension", "N"), ("horizontal_tension", "N"), ("built_sag", "m")),
    )
}
"""The prestress inputs that `Phase` has as arguments, by name."""


class Prestressable(Element):
    """Elements that accept phase inputs: what a `Phase` prescribes, such as a pretension.

    Attributes:
        phase_inputs: names of `PHASE_INPUTS`, which are arguments of `Phase`, and a `PhaseInput`
            for each further one, which users give by ``Phase(own={name: values})``.
        components: where an input has several numbers for an element, their names by that of the
            input, such as ``{"pretension": ("warp", "weft")}``; values then are
            [n_elem, n_component], and one number is for all components.
    """

    phase_inputs: ClassVar[tuple[str | PhaseInput, ...]] = ()
    components: ClassVar[Mapping[str, tuple[str, ...]]] = {}

    @abc.abstractmethod
    def apply_phase_inputs(
        self,
        state: OwnState,
        ends: Float[Array, "n_elem n_end 3"],
        inputs: Mapping[str, InputValues],
    ) -> ElementState:
        """Return the state of the group after the inputs of a phase have changed it.

        Args:
            state: state of the group at the beginning of the phase.
            ends: initial positions of the ends of all elements, [n_elem, n_end, 3], m.
            inputs: values by the name of the phase input; only those that the phase gives.

        Where some of them hold from the beginning of a phase (not `PhaseInput.ramped`), there are
        two calls: the first with these, the second with all others.
        """

    def interpolate_states(self, start: OwnState, end: OwnState, factor: Scalar) -> OwnState:
        """Return the state of the group at a load factor, linear between two states of a phase.

        `start` and `end` are its states at the load factors 0 and 1. Numbers that do not change
        keep every digit, and factor 1 gives `end` exactly. Arrays that are not of floating-point
        numbers, such as masks, are those of `end` at any factor.
        """

        def one(a, b):
            return interpolate(a, b, factor) if jnp.issubdtype(b.dtype, jnp.floating) else b

        return jax.tree.map(one, start, end)


def accepted_inputs(group: Element) -> dict[str, PhaseInput]:
    """Return the inputs that a group accepts, by name; empty if it is not `Prestressable`."""
    accepted = group.phase_inputs if isinstance(group, Prestressable) else ()
    found = [PHASE_INPUTS[s] if isinstance(s, str) else s for s in accepted]
    return {phase_input.name: phase_input for phase_input in found}


def component_names(group: Element, name: str) -> tuple[str, ...]:
    """Return the names of the components of the input `name`; empty if it is one number."""
    return group.components.get(name, ()) if isinstance(group, Prestressable) else ()


@jax.jit  # traced once, although a program calls it for every number of a state
def interpolate(start: Array, end: Array, factor: Float[ArrayLike, ""]) -> Array:
    """Return an array linear between `start` and `end` at a load factor from 0 to 1.

    Equal numbers keep every digit, and factor 1 gives `end` exactly.
    """
    return end - (1 - factor) * (end - start)


def is_one_sided(group: Element) -> bool:
    """Return whether elements carry tension only, or compression only, and can be slack."""
    return group.tension_only or group.compression_only


class Uniaxial(Element):
    """Elements with one strain along their axis, from which their axial force follows.

    `forms.equivalent_prestress` and `design.slack_distance` need elements of this class. Along
    equilibrium paths such an element remains slack, or taut, as long as its strain is smaller than
    the rounding error of this strain.
    """

    @abc.abstractmethod
    def strain(self, state: OwnState, ends: Ends, motion: Motion) -> Scalar:
        """Return the axial strain of one element: its elongation over its unstressed length."""

    @abc.abstractmethod
    def force(self, strain: Scalar, memory: PyTree[Array] | None = None) -> Scalar:
        """Return the axial force at a strain, N; `memory` has the history variables, or is None."""

    @abc.abstractmethod
    def strain_at(self, force: Scalar, memory: PyTree[Array] | None = None) -> Scalar:
        """Return the strain at a force, N, with history variables or None; NaN if out of reach."""

    def section_strain(self, state: OwnState, ends: Ends, motion: Motion) -> Scalar:
        """Return the axial strain of the material: `strain`, unless a jack prescribes the force.

        The material then has the strain that belongs to this force.
        """
        return self.strain(state, ends, motion)


class Jackable(Prestressable):
    """Elements whose axial force a jack can prescribe in a phase, by the input "jacking".

    Their state has the fields `jack_force`, N, and `jacked`, bool, as in `prestress.AxialState`.
    """

    @abc.abstractmethod
    def tension(self, state: OwnState, ends: Ends, motion: Motion) -> Scalar:
        """Return the axial force of one element, N; the jack force if a jack prescribes it."""

    @abc.abstractmethod
    def lock_off(self, state: OwnState, ends: Ends, motion: Motion) -> ElementState:
        """Return the state of one element after lock-off: its jack is gone, and its force remains.

        The new unstressed length is the one that gives the jack force at this motion of the ends.
        """


END_PULL = Result("end_pull", "N", ("x", "y", "z"), increments=False, places=("first", "last"))
"""Forces of a hanging element on its end nodes, which are not along its chord, [2, 3]."""


class Hanging(Prestressable):
    """Elements that hang between their ends under their weight; a phase can state their sag.

    Their state has the field `rest_length`, m. With the result `END_PULL` (in `results`, under a
    load) their shapes are known at the end of every phase, as elastic catenaries.
    """

    axial_stiffness: Float[Array, " n_elem"] | None

    @property
    def stiffness_with_spring(self) -> Float[Array, " n_elem"] | None:
        """Axial stiffness, N, of EA and of springs in series with it, if there are any."""
        return self.axial_stiffness

    @abc.abstractmethod
    def tension(self, state: OwnState, ends: Ends, motion: Motion) -> Scalar:
        """Return the axial force of one element, its mean along the element, N."""

    @abc.abstractmethod
    def strain_at_sag(
        self,
        ends: Float[Array, "n_elem n_end 3"],
        sag: Float[Array, " n_elem"],
        thermal_stretch: float | Float[Array, " n_elem"] = 1.0,
    ) -> Float[Array, " n_elem"]:
        """Return the strains of the initial chords at which elements have given sags, [n_elem].

        A strain is chord over unstressed length, minus 1.

        Args:
            ends: initial positions of the ends, m.
            sag: vertical distances from the chords at midspan, under the weight, m.
            thermal_stretch: unstressed length over that at the reference temperature; the weight
                per length is divided by it.
        """

    @abc.abstractmethod
    def sag(self, state: OwnState, ends: Ends, motion: Motion) -> Scalar:
        """Return the distance of one element from its chord at midspan, along its load, m."""

    @abc.abstractmethod
    def end_tensions(self, state: OwnState, ends: Ends, motion: Motion) -> Float[Array, " 2"]:
        """Return the tensions of one element at its first and its second end, [2], N."""

    @abc.abstractmethod
    def curve(
        self, state: OwnState, ends: Ends, motion: Motion, parts: Float[Array, " n_place"]
    ) -> Float[Array, "n_place 3"]:
        """Return points of one element, m, at `parts` (0 to 1) of its unstressed length."""


class SecantStiffness(Element):
    """Elements with a secant stiffness between two motions, which the secant method needs."""

    @abc.abstractmethod
    def secant(
        self, state: OwnState, ends: Ends, before: Motion, motion: Motion
    ) -> Float[Array, "n_end 3 n_end 3"]:
        """Return the symmetric secant stiffness K of one element between two motions, N/m.

        ``K (u - u0) = f(u) - f(u0)`` with the displacements u0 of `before` and u of `motion`, and
        the end forces f; K has the shape of `tangent`.
        """


@pytree
class TensionResponse:
    """Tension, its stiffness and the end forces of one cable at given positions of its ends.

    Attributes:
        tension: the tension that is an unknown of the equations, not negative, N: the axial force,
            or of a hanging cable the mean of its end tensions minus half of the load on it.
        slope: derivative of the tension by the length of the cable, N/m.
        unit_forces: derivative of the end forces by the tension, [n_end, 3]; for a straight cable
            also the derivative of its length by the displacements of the ends.
        forces: end forces, [n_end, 3], N.
        shape: what `TensionElement.length_slack` needs of the positions, such as the strain.
    """

    tension: Scalar
    slope: Scalar
    unit_forces: Forces
    forces: Forces
    shape: PyTree[Array]


@pytree
class LengthSlack:
    """Length that one straight cable under a given tension would have beyond its present length.

    The tension is in equilibrium with the positions of the ends where this length equals the one
    that the sag of the cable takes.

    Attributes:
        spare_length: length of the straight cable under the tension minus the present length, m.
        compliance: derivative of `spare_length` by the tension, m/N.
        sag: length that the sag of the cable takes, m; None for a cable that cannot sag.
        sag_compliance: minus the derivative of `sag` by the tension, m/N, or None.
        unit_forces, forces: as of `TensionResponse`, but under the given tension; None where
            `unit_forces` does not depend on it, so that `forces` is ``tension * unit_forces``.
    """

    spare_length: Scalar
    compliance: Scalar
    sag: Scalar | None = None
    sag_compliance: Scalar | None = None
    unit_forces: Forces | None = None
    forces: Forces | None = None


class TensionElement(Element):
    """Cables whose end forces follow from the positions of the ends and one number, the tension.

    For a net of such cables these tensions can be unknowns of the equations beside the
    displacements (`equilibrium.tension_unknowns`). In a structure with other elements, too, they
    are unknowns where the steps of Newton's method fail (`equilibrium.partial_net`).
    """

    def has_tension_unknown(self, state: OwnState) -> bool:
        """Return whether the tensions of a group in this state can be unknowns of the equations."""
        return True

    def suits_cone_solver(self, state: OwnState) -> bool:
        """Return whether `conic_interior_point` applies: straight elements with a linear law."""
        return False

    @abc.abstractmethod
    def tension_response(self, state: OwnState, ends: Ends, motion: Motion) -> TensionResponse:
        """Return tension, its stiffness and the end forces of one cable at a motion of its ends."""

    @abc.abstractmethod
    def rebased_element(
        self, state: OwnState, ends: Ends, motion: Motion, precise: Bool[Array, ""]
    ) -> tuple[ElementState, Ends, Motion]:
        """Return one element as if it began at its present positions: its state, ends and motion.

        Args:
            motion: displacements, [n_end, 6], m, as the sum of columns 0 to 2 and of a much smaller
                part in columns 3 to 5, which together have nearly twice the working precision.
            precise: whether the elongation is needed with the precision of this sum.

        Returns:
            The state, with the elongation after the motion; the present positions of the ends
            relative to the first end, [n_end, 3], m; and a motion of zeros, [n_end, 3].
        """

    @abc.abstractmethod
    def length_slack(self, state: OwnState, tension: Scalar, shape: PyTree[Array]) -> LengthSlack:
        """Return by how much one cable under a tension, N, would exceed its present length.

        `shape` is that of the `TensionResponse` at the present positions of its ends.
        """

    @abc.abstractmethod
    def geometric_stiffness(
        self, state: OwnState, ends: Ends, motion: Motion, tension: Scalar
    ) -> Float[Array, "n_end 3 n_end 3"]:
        """Return the geometric stiffness of one element under a tension, N, in N/m.

        It is the derivative of the end forces by the positions of the ends at constant tension.
        """


class RoundingEstimate(Element):
    """Elements that estimate the rounding error of their end forces.

    At small strains this error may be larger than the force itself.
    """

    @abc.abstractmethod
    def rounding_error(self, state: OwnState, ends: Ends, motion: Motion) -> Forces:
        """Return an estimate of the absolute rounding error of `end_forces`, in their shape, N."""


POINT_LOADS = Result("point_loads", "-, N, N m", ("place", "Fx", "Fy", "Fz", "Mx", "My", "Mz"))
"""Concentrated loads within an element, [n, 7]: the place from 0 to 1, and force and moment along
the axes of the element where it is. By them reports and pictures show the jumps of section forces.
They are kept in every increment for the stresses, whose extremes may be at a load."""
BEAM_RESULTS = TENSION, PEAK_TENSION, SECTION_STRAIN, SECTION_FORCES, POINT_LOADS
"""Results of elements with section forces."""


class Bending(Element):
    """Elements that bend: their nodes have rotations, and they have section forces.

    Concentrated loads act within them (`ElementLoad.points`) if `POINT_LOADS` is one of their
    results.
    """

    rotates = True

    @abc.abstractmethod
    def section_forces(
        self,
        state: OwnState,
        ends: Ends,
        motion: Motion,
        places: Float[ArrayLike, " n_place"] | None = None,
    ) -> Float[Array, "n_place 6"]:
        """Return the section forces ``N, Vy, Vz, T, My, Mz`` of one element at n places, N and N m.

        `places` are positions on its axis, from 0 to 1; None for those at which results are given.
        """

    def end_slopes_and_axes(
        self, state: OwnState, ends: Ends, motion: Motion
    ) -> tuple[Float[Array, "2 3"], Float[Array, "3 3"]] | None:
        """Return, for pictures, the slopes of the deflected axis at both ends and the rotated axes.

        None, the default, lets pictures draw the chord.

        Returns:
            Slopes of the axis against its chord at both ends, in space, [2, 3]; and the axes of the
            element where it is, in rows: along the chord, then the section's y and z, [3, 3].
        """
        return None
