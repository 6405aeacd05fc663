"""Straight two-node elements: strain, force by a law, prestress, mass.

Strain ``e = (l - L0) / L0``, force ``N = A s(e)``, end forces ``-+N (xj - xi) / l``.
Lengths are never subtracted: with the initial chord ``d`` of length ``l_s``, its elongation
``delta = l_s - L0`` and the relative end displacement ``w``,

    l - l_s = (2 d.w + w.w) / (l + l_s),      e = (delta + (l - l_s)) / L0,

so a prestress of 1e-8 of the axial stiffness keeps its digits (``l - L0`` would lose eight).
"""

from __future__ import annotations

from typing import ClassVar, Self

import jax
import jax.numpy as jnp

from ..common import checks
from ..common.rules import Rule, not_negative, positive, refuse_if_broken
from ..common.tree import copy_with, map_over_elements, pytree, shared_or_stacked
from ..common.types import Array, ArrayLike, Bool, Float, Int
from ..materials import Elastic, Parallel
from ..materials.law import Law, require_law
from ..sections import LinearSection, Section
from ..sections.section import section_hint
from .abilities import Uniaxial
from .axial import Axial
from .element import SECTION_STRAIN, TENSION, Ends, Motion, Result, Scalar
from .prestress import AxialState, Prestressed, checked_links, jack_value_or, measure_chord

# entries of the mass matrix over the mass, on and off the diagonal; "mean" is of order 4 in length
_SHARES = {"lumped": (1 / 2, 0.0), "consistent": (1 / 3, 1 / 6), "mean": (5 / 12, 1 / 12)}


@pytree(indices=("links",))
class Straight(Axial, Prestressed, Uniaxial):
    """Straight two-node elements whose force follows from strain and history; fields as `Bars`."""

    links: Int[ArrayLike, "n_elem 2"]
    axial_stiffness: Float[ArrayLike, " n_elem"] | None = None
    area: Float[ArrayLike, " n_elem"] | None = None
    law: Law | None = None
    rest_length: Float[ArrayLike, " n_elem"] | None = None
    weight: Float[ArrayLike, " n_elem"] | None = None
    expansion: Float[ArrayLike, " n_elem"] | None = None
    strength: Float[ArrayLike, " n_elem"] | None = None
    compliance: Float[ArrayLike, " n_elem"] | None = None
    section: Section | None = None

    results: ClassVar[tuple[Result, ...]] = (TENSION, SECTION_STRAIN)
    per_element = (
        "axial_stiffness",
        "area",
        "rest_length",
        "weight",
        "expansion",
        "strength",
        "compliance",
    )

    def __post_init__(self):
        links = checked_links(self.links)
        object.__setattr__(self, "links", links)
        for name in self.per_element:
            object.__setattr__(self, name, self._floats_per_element(name))
        given = [self.axial_stiffness, self.area if self.law is None else self.law, self.section]
        if sum(value is not None for value in given) > 1:
            raise ValueError(
                "axial_stiffness, area: give either axial_stiffness, or area with law, or section; "
                "not two of them"
            )
        if (self.area is None) != (self.law is None) or not any(v is not None for v in given):
            raise ValueError(
                "axial_stiffness: missing; give axial_stiffness, or area with law, or section"
            )
        if self.law is not None:
            require_law(self.law, "law")
        if self.section is not None and not isinstance(self.section, Section):
            kind = f": {type(self.section).__name__} is not a Section"
            text = f"section{section_hint(self.section) or kind}"
            if isinstance(self.section, LinearSection):
                text = "section: its stiffnesses are for Beams; give axial_stiffness instead"
            raise ValueError(text)
        if self.compliance is not None:
            self._check_compliance()
        refuse_if_broken(self.rules())

    def _floats_per_element(self, name):
        """Return the field `name` with a value for every element; ValueError for a wrong shape."""
        return checks.floats_per_element(getattr(self, name), len(self.links), name)

    def rules(self) -> list[Rule]:
        """Return the conditions on numbers of the group, a list of `Rule`.

        Stiffness, area, length and strength are positive; weight and compliance are not negative.
        With a compliance no law softens.
        """
        above = ("axial_stiffness", "area", "rest_length", "strength")
        rules = [positive(name, getattr(self, name)) for name in above]
        rules += [not_negative(name, getattr(self, name)) for name in ("weight", "compliance")]
        laws = () if self.compliance is None or self.section is None else self._laws
        for k, law in enumerate(laws if len(laws) > 1 else ()):
            stress = law.softening_stresses()
            if stress is not None:
                text = (
                    f"section.laws[{k}] softens; with a spring in series (compliance) it would "
                    "snap back: a strain would have more than one force"
                )
                rules.append(Rule("compliance", stress, _decreases_anywhere, text))
        return rules

    def _check_compliance(self):
        """Raise ValueError for `compliance` and a law with rupture in a group of many elements."""
        if len(self._laws) == 1 and len(self.links) > 1 and self.has_rupture:
            raise ValueError(
                "compliance: beside a law of points only in groups of one element; change the law "
                "instead: strain + compliance area stress at each point"
            )

    # --- the cross-section: force from strain, energy from strain, strain from force

    def force(self, strain: Scalar, memory: Float[Array, " n_memory"] | None = None) -> Scalar:
        """Return the axial force, N, at a strain, given history variables or None."""
        stiffness, law, area = self._stiffness_law_and_area()
        return stiffness * strain if law is None else area * law.stress_at(strain, memory)

    def energy_per_length(
        self, strain: Scalar, memory: Float[Array, " n_memory"] | None = None
    ) -> Scalar:
        """Return the stored energy per unstressed length, J/m, at a strain."""
        stiffness, law, area = self._stiffness_law_and_area()
        return 0.5 * stiffness * strain**2 if law is None else area * law.energy_at(strain, memory)

    def strain_at(self, force: Scalar, memory: Float[Array, " n_memory"] | None = None) -> Scalar:
        """Return the strain at an axial force, N, on the rising branch; NaN above its peak."""
        stiffness, law, area = self._stiffness_law_and_area()
        return force / stiffness if law is None else law.strain_at(force / area, memory)

    def _stiffness_law_and_area(self):
        """Return axial stiffness, N, law, and area, m2, with the spring of `compliance` in series.

        The stiffness is None where there is a law, else law and area are None.
        """
        area, law = self.area, self.law
        if self.section is not None:
            area, law = self.section.uniaxial()
        if law is None:
            if self.compliance is None:
                return self.axial_stiffness, None, None
            stiffness = self.axial_stiffness / (1 + self.compliance * self.axial_stiffness)
            return stiffness, None, None
        return (
            None,
            law if self.compliance is None else law.in_series_with_spring(self.compliance * area),
            area,
        )

    @property
    def _laws(self):
        """Laws of the section, or the law of the group, a tuple; empty with a stiffness only.

        If elements have a law each, only its static fields can be used.
        """
        if self.section is not None:
            return shared_or_stacked(self.section).laws
        return () if self.law is None else (shared_or_stacked(self.law),)

    @property
    def has_memory(self) -> bool:  # type: ignore[override]  # read only
        """Whether a law of the group has history variables, such as plastic strains."""
        return any(law.n_memory for law in self._laws)

    @property
    def has_rupture(self) -> bool:  # type: ignore[override]  # read only
        """Whether a law of the group has a rupture strain."""
        return any(law.has_rupture for law in self._laws)

    @property
    def monotone(self) -> bool:  # type: ignore[override]  # read only
        """Whether the force is known never to fall as strain grows (no softening)."""
        return all(law.monotone for law in self._laws)

    # --- the group

    def initial_memory(self) -> Float[Array, "n_elem n_memory"] | None:
        """Return the history variables of unstrained elements, zeros; None without."""
        if not self.has_memory:
            return None
        area = self.area if self.section is None else shared_or_stacked(self.section).area
        count = sum(law.n_memory for law in self._laws)
        return jnp.zeros((len(self.links), count), jnp.asarray(area).dtype)

    def extrapolated(self) -> Self:
        """Return the group with stress-strain curves extended beyond rupture, for an iteration."""
        if self.section is not None:
            return copy_with(
                self, section=map_over_elements(lambda part: part.for_analysis(), self.section)
            )
        if self.law is None:
            return self
        return copy_with(self, law=map_over_elements(lambda part: part.extrapolated(), self.law))

    def without_softening(self) -> Self:
        """Return the group with a law that does not soften, with which an iteration begins."""
        if self.monotone or self.law is None:
            return self
        return copy_with(
            self, law=map_over_elements(lambda part: part.without_softening(), self.law)
        )

    def linear_axial_stiffness(self) -> Float[ArrayLike, " n_elem"] | None:
        """Return the axial stiffness EA, [n_elem], N; None if the law is not linear."""
        stiffness = self.axial_stiffness
        if stiffness is None:
            if self.law is None or not isinstance(self.law, Elastic):
                return None
            stiffness = self.area * self.law.E
        return (
            stiffness if self.compliance is None else stiffness / (1 + self.compliance * stiffness)
        )

    def capacity(self) -> tuple[float | Float[Array, " n_elem"], float | Float[Array, " n_elem"]]:
        """Return the smallest and the largest axial force, N; infinite without a rupture strain."""
        if not self.has_rupture:
            return -jnp.inf, jnp.inf
        area, law = (self.area, self.law) if self.section is None else self.section.uniaxial()
        low, high = law.capacity
        return low * area, high * area

    # --- one element

    def is_unstressed(self, state: AxialState, ends: Ends, motion: Motion) -> Bool[Array, ""]:
        """Return whether the strain is zero up to rounding; not where a jack sets the force."""

        def unstressed():
            strain = self.strain(state, ends, motion)
            # elongation and displacements cancel there, and each is rounded
            size = jnp.abs(state.elongation) + jnp.sum(jnp.abs(motion))
            return jnp.abs(strain) <= 4 * jnp.finfo(strain.dtype).eps * size / state.rest_length

        return jack_value_or(state, jnp.zeros((), bool), unstressed)

    def mass_matrix(
        self,
        state: AxialState,
        ends: Ends,
        motion: Motion,
        mass: Scalar,
        distribution: str | None = None,
    ) -> Float[Array, "6 6"]:
        """Return the mass matrix of one element of a `mass`, kg, the same in all directions, kg.

        `distribution` is "lumped" at the ends, "consistent", or "mean" of both, as is None.
        """
        if len(ends) != 2:
            return super().mass_matrix(state, ends, motion, mass, distribution)
        same, other = mass_shares(distribution)
        shares = mass * jnp.array([[same, other], [other, same]], mass.dtype)
        return jnp.kron(shares, jnp.eye(3, dtype=mass.dtype))

    def has_result(self, name: str, state: AxialState) -> bool:
        """Return whether elements have a result; section strain: with fibres, rupture or memory."""
        if name == "section_strain":
            return self.section is not None or self.has_rupture or self.has_memory
        return super().has_result(name, state)

    def strain(self, state: AxialState, ends: Ends, motion: Motion) -> Scalar:
        """Return the axial strain of one element: its elongation over its unstressed length."""
        _, _, change, _ = measure_chord(ends, motion)
        return (state.elongation + change) / state.rest_length

    def tension(self, state: AxialState, ends: Ends, motion: Motion) -> Scalar:
        """Return the axial force of one element, N; the jack force if a jack prescribes it."""
        return jack_value_or(
            state,
            state.jack_force,
            lambda: self.force(self.strain(state, ends, motion), state.memory),
        )

    def tension_and_stiffness(
        self, state: AxialState, ends: Ends, motion: Motion
    ) -> tuple[Scalar, Scalar]:
        """Return the axial force, N, and its derivative by length, N/m; this is 0 with a jack."""

        def following():
            strain = self.strain(state, ends, motion)
            one = jnp.ones_like(strain)
            force, slope = jax.jvp(lambda e: self.force(e, state.memory), (strain,), (one,))
            return jnp.stack([force, slope / state.rest_length])

        prescribed = None
        if state.jack_force is not None:
            prescribed = jnp.stack([state.jack_force, jnp.zeros_like(state.jack_force)])
        force, stiffness = jack_value_or(state, prescribed, following)
        return force, stiffness

    def energy(self, state: AxialState, ends: Ends, motion: Motion) -> Scalar:
        """Return the stored energy of one element, J; with a jack its force times length change."""

        def stored():
            strain = self.strain(state, ends, motion)
            return state.rest_length * self.energy_per_length(strain, state.memory)

        work = (
            None if state.jack_force is None else state.jack_force * measure_chord(ends, motion)[2]
        )
        return jack_value_or(state, work, stored)

    def section_strain(self, state: AxialState, ends: Ends, motion: Motion) -> Scalar:
        """Return the strain of the material of one element; with a jack that at the jack force."""
        jacked = (
            None if state.jack_force is None else self.strain_at(state.jack_force, state.memory)
        )
        return jack_value_or(state, jacked, lambda: self.strain(state, ends, motion))

    def absolute_force(self, state: AxialState, ends: Ends, motion: Motion) -> Scalar:
        """Return the sum of absolute forces of the law's parts, N: the scale of rounding."""
        _, law, area = self._stiffness_law_and_area()
        return area * law.stress_scale_at(self.section_strain(state, ends, motion), state.memory)

    def commit_memory(
        self, strain: Scalar, memory: Float[Array, " n_memory"], duration: float = 0.0
    ) -> Float[Array, " n_memory"]:
        """Return the history variables after an increment of a `duration`, s, ended at a strain."""
        return self._stiffness_law_and_area()[1].commit_memory(strain, memory, duration)

    def fibre_stress(
        self, strain: Scalar, memory: Float[Array, " n_memory"] | None = None
    ) -> Float[Array, " n_fibre"] | Scalar:
        """Return the stress of every fibre, Pa, at a strain; a scalar with a law and no section.

        `memory` are the history variables, None for a law that has none.
        """
        law = self._stiffness_law_and_area()[1]
        if self.section is None:
            return law.stress_at(strain, memory)
        several = isinstance(law, Parallel)
        stress = (
            law.stress_of_each_law(strain, memory) if several else [law.stress_at(strain, memory)]
        )
        counts = self.section.counts
        return jnp.concatenate([jnp.full(n, s) for n, s in zip(counts, stress, strict=True)])

    def is_ruptured(self, strain: Scalar) -> Bool[Array, ""]:
        """Return whether a strain is beyond the rupture strain of the law."""
        return self._stiffness_law_and_area()[1].is_ruptured(strain)

    # --- prestress

    def locked_off_state(self, state: AxialState, length: Scalar, change: Scalar) -> AxialState:
        """Return the state after lock-off at a `length`, m: its law gives the jack force there.

        `change` is by how much this exceeds the initial length, m.
        """
        strain = self.strain_at(state.jack_force, state.memory)  # type: ignore[arg-type]  # not None
        rest_length = length / (1 + strain)
        pair = jnp.stack([rest_length, rest_length * strain - change])
        pair = jack_value_or(state, pair, lambda: jnp.stack([state.rest_length, state.elongation]))
        return copy_with(
            state, rest_length=pair[0], elongation=pair[1], jack_force=None, jacked=None
        )


def _decreases_anywhere(stress):
    """Return whether stresses along a curve, [..., n], fall between any two successive points."""
    return (stress[..., 1:] < stress[..., :-1]).any()


def mass_shares(distribution: str | None) -> tuple[float, float]:
    """Return entries of a mass matrix over the mass, on and off the diagonal.

    `distribution` is "lumped", "consistent", or "mean" of both, as is None.
    """
    return _SHARES[distribution or "mean"]
