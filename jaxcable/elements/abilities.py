"""Abilities that only some elements have: one base class each, from which an element derives.

Other abilities are stated by an attribute of `Element`, because a law or a load decides on them:

| attribute | methods that an element must then have |
|---|---|
| `remembers` | `size`, `initial_memory`; `commit_memory` and `section_strain`, a result, or `settled` |
| `has_rupture` | `is_ruptured`; `section_strain`, a result; `extrapolated` if its iteration may not pass an end |
| `tension_only` | `is_slack`, `at_kink` |
| `rotates` | `end_forces_about` |
| `slides` | `slid` |
| `face` | none: loads on areas then find it by its group |
| `inner`, `n_inner_row` | `unused_columns`; its end forces and motion have rows for them |

`contract.require` refuses a group that lacks one of them; `contract.check` tries all methods.
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
from .stated import Stated, Statement

STATEMENTS = {
    name: Statement(name, unit)
    for name, unit in (
        *(("pretension", "N"), ("force_density", "N/m"), ("prestrain", "-"), ("rest_length", "m")),
        *(("shortening", "m"), ("temperature", "K"), ("sag", "m"), ("jacking", "N")),
    )
}
"""The statements of prestress that `Phase` has as arguments, by name."""


class Prestressable(Element):
    """Elements whose state is changed by statements of a phase (`Phase`).

    Attributes:
        statements: those that the group accepts: names of `STATEMENTS`, and a `Statement` for each
            of its own, which users state by ``Phase(own={name: values})``.
        components: names of the components of statements that have several numbers for an element,
            by statement, such as ``{"pretension": ("warp", "weft")}``; values then are
            [n_elem, n_component], and one number is for all components.
    """

    statements: ClassVar[tuple[str | Statement, ...]] = ()
    components: ClassVar[Mapping[str, tuple[str, ...]]] = {}

    @abc.abstractmethod
    def restate(
        self,
        state: OwnState,
        ends: Float[Array, "n_elem n_end 3"],
        statements: Mapping[str, Stated],
    ) -> ElementState:
        """State of the group after statements, by name; ends [n_elem, n_end, 3].

        Those that hold from the beginning of a phase (`Statement.ramped`) are given first, in a
        call of their own. What a phase does not state is not among the `statements`.
        """

    def between(self, start: OwnState, end: OwnState, factor: Scalar) -> OwnState:
        """State of the group at a load `factor` of a phase that leads from `start` to `end`.

        Numbers that do not change keep every digit, and factor 1 gives `end` exactly. Arrays that
        are not floating point are those of `end` from the beginning.
        """

        def one(a, b):
            return mixed(a, b, factor) if jnp.issubdtype(b.dtype, jnp.floating) else b

        return jax.tree.map(one, start, end)


def statements_of(group: Element) -> dict[str, Statement]:
    """The statements that a group accepts, by name; none if it is not `Prestressable`."""
    accepted = group.statements if isinstance(group, Prestressable) else ()
    found = [STATEMENTS[s] if isinstance(s, str) else s for s in accepted]
    return {statement.name: statement for statement in found}


def components_of(group: Element, name: str) -> tuple[str, ...]:
    """Names of the components of a statement of a group; none if it is one number."""
    return group.components.get(name, ()) if isinstance(group, Prestressable) else ()


@jax.jit  # traced once, although a program calls it for every number of a state
def mixed(start: Array, end: Array, factor: Float[ArrayLike, ""]) -> Array:
    """Value at a load factor; what does not change keeps every digit, and factor 1 gives `end`."""
    return end - (1 - factor) * (end - start)


class Uniaxial(Element):
    """Elements with one strain along their axis, from which their force follows.

    `forms.equivalent_prestress` and `design.slack_distance` ask for them, and form finding for
    those that are `straight.Straight`. On paths they stay slack, or taut, where rounding hides
    their strain.
    """

    @abc.abstractmethod
    def strain(self, state: OwnState, ends: Ends, motion: Motion) -> Scalar:
        """Strain on the unstressed length."""

    @abc.abstractmethod
    def force(self, strain: Scalar, memory: PyTree[Array] | None = None) -> Scalar:
        """Axial force at a strain, N."""

    @abc.abstractmethod
    def strain_at(self, force: Scalar, memory: PyTree[Array] | None = None) -> Scalar:
        """Strain at an axial force, N; NaN if the law does not reach this force."""

    def section_strain(self, state: OwnState, ends: Ends, motion: Motion) -> Scalar:
        """Strain of the material; another one than `strain` where a jack prescribes the force."""
        return self.strain(state, ends, motion)


class Jacked(Prestressable):
    """Elements whose force a jack can prescribe, by the statement "jacking".

    Their state has `jack_force` and `jacked`.
    """

    @abc.abstractmethod
    def tension(self, state: OwnState, ends: Ends, motion: Motion) -> Scalar:
        """Axial force, N; that of the jack where the state has one."""

    @abc.abstractmethod
    def lock(self, state: OwnState, ends: Ends, motion: Motion) -> ElementState:
        """State of one element whose jack is anchored here: it keeps the jack force."""


class Sagging(Prestressable):
    """Elements that hang under their weight, with the statement "sag".

    Their state has `rest_length`.
    """

    @abc.abstractmethod
    def tension(self, state: OwnState, ends: Ends, motion: Motion) -> Scalar:
        """Axial force, N; its mean along the element."""

    @abc.abstractmethod
    def strain_at_sag(
        self,
        ends: Float[Array, "n_elem n_end 3"],
        sag: Float[Array, " n_elem"],
        warmth: float | Float[Array, " n_elem"] = 1.0,
    ) -> Float[Array, " n_elem"]:
        """Strains of the initial chords at which elements have the sags `sag` [n_elem], m.

        A sag is the vertical distance of an element from its chord at midspan, under its weight.
        """

    @abc.abstractmethod
    def sag(self, state: OwnState, ends: Ends, motion: Motion) -> Scalar:
        """Distance of the element from its chord at midspan, along the load, m."""

    @abc.abstractmethod
    def end_tensions(self, state: OwnState, ends: Ends, motion: Motion) -> Float[Array, " 2"]:
        """Tensions at the first and the second end, [2], N."""

    @abc.abstractmethod
    def curve(
        self, state: OwnState, ends: Ends, motion: Motion, parts: Float[Array, " n"]
    ) -> Float[Array, "n 3"]:
        """Positions along the element, [n, 3], m, at parts [n] of its unstressed length."""


class Secant(Element):
    """Elements with a secant stiffness between two motions, which the secant scheme needs."""

    @abc.abstractmethod
    def secant(
        self, state: OwnState, ends: Ends, before: Motion, motion: Motion
    ) -> Float[Array, "n_end 3 n_end 3"]:
        """Symmetric matrix, in the shape of `tangent`, with ``K (u - u0) = f(u) - f(u0)``."""


@pytree
class Pull:
    """What a cable does at a point.

    Attributes:
        tension: the unknown of the cable, not negative, N: its axial force; of one that hangs the
            mean of the tensions at its ends less half of the load on it.
        slope: its derivative by the length, N/m.
        along: derivative of the end forces by the tension, [n_end, 3]; of a straight cable that of
            its length by the displacements of the ends, too.
        forces: end forces, [n_end, 3], N.
        shape: what `Pulling.room` needs to know of the point.
    """

    tension: Scalar
    slope: Scalar
    along: Forces
    forces: Forces
    shape: PyTree[Array]


@pytree
class Room:
    """What a tension would do to a cable at a point; the cable is in balance where gap = sag.

    Attributes:
        gap: length that the tension allows a straight cable less the present one, m.
        compliance: its derivative by the tension, m/N.
        sag: length that the sag takes, m; None for a cable that cannot sag.
        less: minus the derivative of `sag` by the tension, m/N, or None.
        along, forces: as of `Pull`, but under the tension; None where `along` does not depend on
            it, so that `forces` is ``tension * along``.
    """

    gap: Scalar
    compliance: Scalar
    sag: Scalar | None = None
    less: Scalar | None = None
    along: Forces | None = None
    forces: Forces | None = None


class Pulling(Element):
    """Cables whose state at a point follows from one number, their tension.

    A net of them is solved with these tensions as unknowns, see `equilibrium.tension_unknowns`.
    """

    def pulls(self, state: OwnState) -> bool:
        """Whether the elements have such a number in this state."""
        return True

    def fits_cones(self, state: OwnState) -> bool:
        """Whether `conic_interior_point` applies: straight between nodes, and of a linear law."""
        return False

    @abc.abstractmethod
    def pulled(self, state: OwnState, ends: Ends, motion: Motion) -> Pull:
        """The `Pull` at a point."""

    @abc.abstractmethod
    def brought(
        self, state: OwnState, ends: Ends, motion: Motion, wanted: Bool[Array, ""]
    ) -> tuple[ElementState, Ends, Motion]:
        """The element where a motion with a fine part, [n_end, 6], has brought it (`fine`).

        State, ends [n_end, 3] and motion [n_end, 3] of an element that begins there and has not
        moved. Its elongation is exact, if this is `wanted`; its ends are relative to the first.
        """

    @abc.abstractmethod
    def room(self, state: OwnState, tension: Scalar, shape: PyTree[Array]) -> Room:
        """The `Room` under a tension, N, at the point of a `Pull` that has this shape."""

    @abc.abstractmethod
    def bent(
        self, state: OwnState, ends: Ends, motion: Motion, tension: Scalar
    ) -> Float[Array, "n_end 3 n_end 3"]:
        """Stiffness that a tension gives by itself, as the ends move, N/m."""


class Rounding(Element):
    """Elements whose force may vanish while its rounding error does not."""

    @abc.abstractmethod
    def rounding(self, state: OwnState, ends: Ends, motion: Motion) -> Forces:
        """Error that the rounding of displacements leaves in the end forces, in their shape."""


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
        """``N, Vy, Vz, T, My, Mz`` at `places` along the axis, from 0 to 1, [n, 6], N and N m."""

    def deflected(
        self, state: OwnState, ends: Ends, motion: Motion
    ) -> tuple[Float[Array, "2 3"], Float[Array, "3 3"]] | None:
        """How the axis leaves its chord, for pictures; None (the default) draws the chord.

        Returns:
            Slopes of the axis against its chord at both ends, in space, [2, 3]; and the axes of the
            element where it is, in rows: along the chord, then the section's y and z, [3, 3].
        """
        return None
