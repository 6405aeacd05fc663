"""Abilities that only some elements have: one base class each, from which an element derives.

Other abilities are attributes of `Element`, because they depend on a law or a load:

| attribute | methods that an element must then have |
|---|---|
| `has_memory` | `absolute_force`, `initial_memory`; `committed_memory` (default: by strain) |
| `has_rupture` | `is_ruptured`, `section_strain`; `extrapolated` if forces end at rupture |
| `tension_only` | `is_slack`, `at_kink` |
| `rotates` | `end_forces_after_step` |
| `slides` | `sliding_load_forces` |
| `face` | none: loads on areas then find it by its group |
| `inner_unknowns`, `n_inner_row` | `unused_columns`; its end forces and motion have rows for them |

`contract.require` refuses a group that lacks one of them; `contract.check` calls all methods.
"""

from __future__ import annotations

import abc
from collections.abc import Mapping
from typing import ClassVar

import jax
import jax.numpy as jnp

from ..common.tree import pytree
from ..common.types import Array, ArrayLike, Bool, Float, PyTree
from .element import Element, Ends, Forces, Motion, Scalar
from .element_state import ElementState, OwnState
from .statement import StatedValues, Statement

STATEMENTS = {
    name: Statement(name, unit)
    for name, unit in (
        *(("pretension", "N"), ("force_density", "N/m"), ("prestrain", "-"), ("rest_length", "m")),
        *(("shortening", "m"), ("temperature", "K"), ("sag", "m"), ("jacking", "N")),
    )
}
"""The statements of prestress that `Phase` has as arguments, by name."""


class Prestressable(Element):
    """Elements whose state is changed by statements of a `Phase`, such as a pretension.

    Attributes:
        statements: the statements that the group accepts: names of `STATEMENTS`, and a `Statement`
            for each of its own, which users give by ``Phase(own={name: values})``.
        components: names of the components of statements that have several numbers for an element,
            by statement, such as ``{"pretension": ("warp", "weft")}``; values then are
            [n_elem, n_component], and one number is for all components.
    """

    statements: ClassVar[tuple[str | Statement, ...]] = ()
    components: ClassVar[Mapping[str, tuple[str, ...]]] = {}

    @abc.abstractmethod
    def apply_statements(
        self,
        state: OwnState,
        ends: Float[Array, "n_elem n_end 3"],
        statements: Mapping[str, StatedValues],
    ) -> ElementState:
        """Return the state of the group after statements, by name; ends [n_elem, n_end, 3].

        Statements that hold from the beginning of a phase (not `Statement.ramped`) come first, in a
        call of their own. `statements` has only those that the phase states.
        """

    def interpolate_states(self, start: OwnState, end: OwnState, factor: Scalar) -> OwnState:
        """Interpolate the state of the group at a load `factor` of a phase from `start` to `end`.

        Numbers that do not change keep every digit, and factor 1 gives `end` exactly. Arrays of
        other than floating-point numbers are those of `end` at any factor.
        """

        def one(a, b):
            return interpolate(a, b, factor) if jnp.issubdtype(b.dtype, jnp.floating) else b

        return jax.tree.map(one, start, end)


def statements_of(group: Element) -> dict[str, Statement]:
    """Return the statements that a group accepts, by name; none if it is not `Prestressable`."""
    accepted = group.statements if isinstance(group, Prestressable) else ()
    found = [STATEMENTS[s] if isinstance(s, str) else s for s in accepted]
    return {statement.name: statement for statement in found}


def components_of(group: Element, name: str) -> tuple[str, ...]:
    """Return the names of the components of a statement of a group; none if it is one number."""
    return group.components.get(name, ()) if isinstance(group, Prestressable) else ()


@jax.jit  # traced once, although a program calls it for every number of a state
def interpolate(start: Array, end: Array, factor: Float[ArrayLike, ""]) -> Array:
    """Interpolate at a load factor; equal numbers keep every digit, and factor 1 gives `end`."""
    return end - (1 - factor) * (end - start)


class Uniaxial(Element):
    """Elements with one strain along their axis, from which their force follows.

    `forms.equivalent_prestress` and `design.slack_distance` ask for them, and form finding for
    those that are `straight.Straight`. On paths they stay slack, or taut, where rounding hides
    their strain.
    """

    @abc.abstractmethod
    def strain(self, state: OwnState, ends: Ends, motion: Motion) -> Scalar:
        """Return the strain on the unstressed length."""

    @abc.abstractmethod
    def force(self, strain: Scalar, memory: PyTree[Array] | None = None) -> Scalar:
        """Return the axial force at a strain, N."""

    @abc.abstractmethod
    def strain_at(self, force: Scalar, memory: PyTree[Array] | None = None) -> Scalar:
        """Return the strain at an axial force, N; NaN if the law does not reach this force."""

    def section_strain(self, state: OwnState, ends: Ends, motion: Motion) -> Scalar:
        """Return the strain of the material; not `strain` where a jack prescribes the force."""
        return self.strain(state, ends, motion)


class Jacked(Prestressable):
    """Elements whose force a jack can prescribe, by the statement "jacking".

    Their state has `jack_force` and `jacked`.
    """

    @abc.abstractmethod
    def tension(self, state: OwnState, ends: Ends, motion: Motion) -> Scalar:
        """Return the axial force, N; the jack force where the state has one."""

    @abc.abstractmethod
    def lock_off(self, state: OwnState, ends: Ends, motion: Motion) -> ElementState:
        """Return the state of one element after lock-off of its jack: it keeps the jack force."""


class Sagging(Prestressable):
    """Elements that hang under their weight, with the statement "sag".

    Their state has `rest_length`.
    """

    @abc.abstractmethod
    def tension(self, state: OwnState, ends: Ends, motion: Motion) -> Scalar:
        """Return the axial force, N: its mean along the element."""

    @abc.abstractmethod
    def strain_at_sag(
        self,
        ends: Float[Array, "n_elem n_end 3"],
        sag: Float[Array, " n_elem"],
        thermal_stretch: float | Float[Array, " n_elem"] = 1.0,
    ) -> Float[Array, " n_elem"]:
        """Return the strains of the initial chords at which elements have given sags [n_elem], m.

        A sag is the vertical distance of an element from its chord at midspan, under its weight.
        """

    @abc.abstractmethod
    def sag(self, state: OwnState, ends: Ends, motion: Motion) -> Scalar:
        """Return the distance of the element from its chord at midspan, along the load, m."""

    @abc.abstractmethod
    def end_tensions(self, state: OwnState, ends: Ends, motion: Motion) -> Float[Array, " 2"]:
        """Return the tensions at the first and the second end, [2], N."""

    @abc.abstractmethod
    def curve(
        self, state: OwnState, ends: Ends, motion: Motion, parts: Float[Array, " n"]
    ) -> Float[Array, "n 3"]:
        """Return positions along the element, [n, 3], m, at parts [n] of its unstressed length."""


class Secant(Element):
    """Elements with a secant stiffness between two motions, for the secant method."""

    @abc.abstractmethod
    def secant(
        self, state: OwnState, ends: Ends, before: Motion, motion: Motion
    ) -> Float[Array, "n_end 3 n_end 3"]:
        """Return the symmetric K, in the shape of `tangent`, with ``K (u - u0) = f(u) - f(u0)``."""


@pytree
class TensionResponse:
    """Tension and end forces of a cable at a point of the iteration.

    Attributes:
        tension: unknown of the cable, not negative, N: its axial force, or of a hanging cable the
            mean of the tensions at its ends less half of the load on it.
        slope: derivative of the tension by the length, N/m.
        unit_forces: derivative of the end forces by the tension, [n_end, 3]; for a straight cable
            also the derivative of its length by the displacements of the ends.
        forces: end forces, [n_end, 3], N.
        shape: data of the point for `TensionElement.length_slack`.
    """

    tension: Scalar
    slope: Scalar
    unit_forces: Forces
    forces: Forces
    shape: PyTree[Array]


@pytree
class LengthSlack:
    """Length that a given tension leaves a cable at a point; in equilibrium it equals the sag.

    Attributes:
        spare_length: length of a straight cable under the tension less the present length, m.
        compliance: derivative of `spare_length` by the tension, m/N.
        sag: length that the sag takes, m; None for a cable that cannot sag.
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
    """Cables whose end forces at a point follow from one number, their tension.

    A net of them is solved with these tensions as unknowns, see `equilibrium.tension_unknowns`;
    beside other elements they are unknowns of some steps, see `equilibrium.partial_net`.
    """

    def has_tension_unknown(self, state: OwnState) -> bool:
        """Return whether the tension is such an unknown in this state."""
        return True

    def suits_cone_solver(self, state: OwnState) -> bool:
        """Return whether `conic_interior_point` applies: straight pieces, with a linear law."""
        return False

    @abc.abstractmethod
    def tension_response(self, state: OwnState, ends: Ends, motion: Motion) -> TensionResponse:
        """Return the `TensionResponse` at a point."""

    @abc.abstractmethod
    def rebased_element(
        self, state: OwnState, ends: Ends, motion: Motion, wanted: Bool[Array, ""]
    ) -> tuple[ElementState, Ends, Motion]:
        """Rebase the element after a motion with a low-order part, [n_end, 6] (`rebasing`).

        Return state, ends [n_end, 3] and motion [n_end, 3] of an element that begins at the present
        positions and has not moved. Its elongation has full precision if this is `wanted`; its ends
        are relative to the first.
        """

    @abc.abstractmethod
    def length_slack(self, state: OwnState, tension: Scalar, shape: PyTree[Array]) -> LengthSlack:
        """Return the `LengthSlack` under a tension, N, for the `shape` of a `TensionResponse`."""

    @abc.abstractmethod
    def geometric_stiffness(
        self, state: OwnState, ends: Ends, motion: Motion, tension: Scalar
    ) -> Float[Array, "n_end 3 n_end 3"]:
        """Return the geometric stiffness of a tension, N/m."""


class Rounding(Element):
    """Elements that estimate the rounding error of a force, which may be all that is left of it."""

    @abc.abstractmethod
    def rounding_error(self, state: OwnState, ends: Ends, motion: Motion) -> Forces:
        """Return the error of the end forces by rounding of displacements, in their shape."""


class Bending(Element):
    """Elements that give their nodes rotations and have section forces."""

    rotates = True

    @abc.abstractmethod
    def section_forces(
        self,
        state: OwnState,
        ends: Ends,
        motion: Motion,
        places: Float[ArrayLike, " n"] | None = None,
    ) -> Float[Array, "n 6"]:
        """Return ``N, Vy, Vz, T, My, Mz`` at `places` on the axis, from 0 to 1, [n, 6], N, N m."""

    def end_slopes_and_axes(
        self, state: OwnState, ends: Ends, motion: Motion
    ) -> tuple[Float[Array, "2 3"], Float[Array, "3 3"]] | None:
        """Return the slopes of the deflected axis at its ends, for pictures; None draws the chord.

        Returns:
            Slopes of the axis against its chord at both ends, in space, [2, 3]; and the axes of the
            element where it is, in rows: along the chord, then the section's y and z, [3, 3].
        """
        return None
