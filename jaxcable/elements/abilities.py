"""What some elements can do beside what all can: a class each, which an element derives from.

Some of it is asked for by an attribute of `Element` instead, where a law or a load decides:

| attribute | what it obliges an element to write |
|---|---|
| `remembers` | `settle`, `size`, `fibre_stress` of a strain and a memory; `initial_memory` |
| `breaks` | `beyond` of a strain, `extended` |
| `tension_only` | `is_slack`, `at_kink`; where `Prestressable`, `strain_at` of a force |
| `slides` | `slid`, how much of the load along it goes from node to node |
| `inner`, `n_inner_row` | `unused_columns`; its end forces and motion have rows for them |
"""

from __future__ import annotations

import abc
from collections.abc import Mapping
from typing import ClassVar

import jax
import jax.numpy as jnp

from ..common.types import Array, ArrayLike, Float
from .element import Element, ElementState, Ends, Forces, Motion, OwnState, Scalar
from .stated import Stated


class Prestressable(Element):
    """Its state can be changed by what a phase states (`Phase`).

    Attributes:
        statements: names of what can be stated for it.
    """

    statements: ClassVar[tuple[str, ...]] = ()

    @abc.abstractmethod
    def restate(
        self,
        state: OwnState,
        ends: Float[Array, "n_elem n_end 3"],
        inputs: Mapping[str, Stated],
    ) -> ElementState:
        """State of the group after statements, names to `Stated`; ends [n_elem, ...]."""

    def between(self, start: OwnState, end: OwnState, factor: Scalar) -> OwnState:
        """State of the group in a phase that takes it from one to another.

        What does not change keeps every digit, and the end is met. Numbers that are no floats are
        those of the end from the beginning.
        """

        def one(a, b):
            return b - (1 - factor) * (b - a) if jnp.issubdtype(b.dtype, jnp.floating) else b

        return jax.tree.map(one, start, end)


class Jacked(Prestressable):
    """Its force can be held by a jack, by the statement "jacking".

    The state then has `jack_force` and `jacked`.
    """

    @abc.abstractmethod
    def lock(self, state: OwnState, ends: Ends, motion: Motion) -> ElementState:
        """State of one anchored jack: what gives the held force here."""


class Sagging(Prestressable):
    """It hangs under its weight, by the statement "sag"."""

    @abc.abstractmethod
    def strain_at_sag(
        self,
        ends: Float[Array, "n_elem n_end 3"],
        sag: Float[Array, " n_elem"],
        warmth: float | Float[Array, " n_elem"] = 1.0,
    ) -> Float[Array, " n_elem"]:
        """Strains of the initial chords with which a group hangs by `sag`, [n_elem], m."""

    @abc.abstractmethod
    def depth(self, state: OwnState, ends: Ends, motion: Motion) -> Scalar:
        """How far its middle hangs below that of its chord, m."""

    @abc.abstractmethod
    def end_tensions(self, state: OwnState, ends: Ends, motion: Motion) -> Float[Array, " 2"]:
        """Tensions at the first and the second end, [2], N."""

    @abc.abstractmethod
    def curve(
        self, state: OwnState, ends: Ends, motion: Motion, parts: Float[Array, " n"]
    ) -> Float[Array, "n 3"]:
        """Places along it, [n, 3], m, at parts [n] of its unstressed length."""


class Secant(Element):
    """It has a stiffness between two states, which the secant scheme takes."""

    @abc.abstractmethod
    def secant(
        self, state: OwnState, ends: Ends, before: Motion, motion: Motion
    ) -> Float[Array, "n_end 3 n_end 3"]:
        """Symmetric matrix, as `tangent`, with ``K (u - u0) = f(u) - f(u0)``."""


class Rounding(Element):
    """It may be without force and yet have the rounding of its stiffness."""

    @abc.abstractmethod
    def rounding(self, state: OwnState, ends: Ends, motion: Motion) -> Forces:
        """What the rounding of displacements leaves of the end forces, as these."""


class Bending(Element):
    """It gives its nodes rotations and has section forces."""

    rotates = True

    @abc.abstractmethod
    def section_forces(
        self,
        state: OwnState,
        ends: Ends,
        motion: Motion,
        places: Float[ArrayLike, " n"] | None = None,
    ) -> Float[Array, "n 6"]:
        """``N, Vy, Vz, T, My, Mz`` at places from 0 to 1, [n, 6], N and N m."""
