"""Checks of cables: breaking force by EN 1993-1-11 or a factor of safety, service, fatigue."""

from __future__ import annotations

import dataclasses
from collections.abc import Sequence
from typing import Any, ClassVar

import jax.numpy as jnp

from ..analysis.solution import Solution
from ..common import checks
from ..common.types import Array, ArrayLike, Float, Int
from ..elements.element import Element
from ..model.result_parts import named_groups_of
from ..model.structure import Structure
from ..standards.cables import (
    FATIGUE_CATEGORIES,
    SERVICE_FRACTIONS,
    TERMINATIONS,
    cable_fatigue_strength,
    cable_resistance,
    termination_factor,
)
from .check import (
    SERVICE,
    ULTIMATE,
    UTILIZATION,
    OnElements,
    Terms,
    largest_forces,
    values_in_cases,
    warn_if_unusual,
)
from .result_envelopes import extreme_cases

_UNITS = {"F_Ed": "N", "F_uk": "N", "F_Rd": "N"}
_FATIGUE_UNITS = {"lowest F": "N", "highest F": "N", "A": "m2", "range": "Pa", "range_Rd": "Pa"}


@dataclasses.dataclass(frozen=True)
class _OnCables(OnElements):
    """Base of checks of tension-only elements with a `strength`, the minimum breaking force, N."""

    requirement: ClassVar[str] = (
        "have no strength, the minimum breaking force in N, or are no cables; give strength=..."
    )
    requirement_met: ClassVar[str] = (
        "has cables with a strength, the minimum breaking force in N; give strength=..."
    )
    units = _UNITS

    def applies_to(self, group: Element) -> bool:
        """Return whether the elements have tension only, and a strength."""
        return bool(group.tension_only) and group.strength is not None

    def skipped_text(self, structure: Structure) -> str:
        """Return a text that names unchecked groups of cables, without a strength; "" if none."""
        if self.elements is not None:
            return ""
        names = [
            repr(label)
            for label, one in named_groups_of(structure)
            if one.tension_only and not self.applies_to(one)
        ]
        return f"cables {', '.join(names)} {self.requirement}" if names else ""

    def _rating(self, structure, solution, resistance, factor):
        """Return the terms of a check, [n_item] each, by name; NaN where the case has failed.

        "F_Ed" is the largest axial force, N, "F_uk" the breaking force times the loss
        factor `factor`, N, "F_Rd" the given resistance, N, and the utilization is F_Ed /
        F_Rd.
        """
        force = largest_forces(self, structure, solution)
        return {
            "F_Ed": force,
            "F_uk": factor * self.strengths(structure) + 0.0 * force,
            "F_Rd": resistance + 0.0 * force,  # NaN, too, where the case has failed
            UTILIZATION: force / resistance,
        }


@dataclasses.dataclass(frozen=True)
class CableResistance(_OnCables):
    """Breaking force of cables by EN 1993-1-11: ``F_Ed / F_Rd`` in ultimate limit states.

    Args:
        elements: keys of groups, or selections by group; None: all cables with a strength, which is
            the minimum breaking force.
        name, of: as of `Check`.
        termination: name in `standards.TERMINATIONS`, or loss factor k_e, without unit.
        gamma_r: 1.0, or 0.9 where measures at the anchorage keep bending stresses small; without
            unit.
        proof_force: characteristic proof force F_k, N, one number; None: not checked, as it need
            not be where it is above the breaking force over 1.5.

    Example:
        >>> rope = jc.Cables([[0, 1]], axial_stiffness=1e7, strength=300e3)
        >>> structure = jc.Structure([[0, 0, 0], [0, 0, -2.0]], rope, supports=jc.pinned([0]))
        >>> solution = jc.solve(structure, jc.Phase(loads=jc.NodalLoads([1], (0, 0, -90e3))))
        >>> found = jc.design.checks(structure, solution, jc.design.CableResistance())
        >>> print(found)
        cable resistance: utilization 0.450, element 0, case 0, EN 1993-1-11:2006, 6.2
    """

    name: str = "cable resistance"
    of: Sequence[str] = ULTIMATE
    termination: str | Float[ArrayLike, ""] = 1.0
    gamma_r: Float[ArrayLike, ""] = 1.0
    proof_force: Float[ArrayLike, ""] | None = None

    clause = "EN 1993-1-11:2006, 6.2"
    formula = "F_Ed / F_Rd, F_Rd = min(F_uk / (1.5 gamma_R), F_k / gamma_R), F_uk = k_e F_min"
    not_covered = "saddles, clamps, terminations themselves, bending at anchorages"

    def __post_init__(self):
        super().__post_init__()
        cable_resistance(1.0, self.proof_force, termination=self.termination, gamma_r=self.gamma_r)

    def inputs(self) -> dict[str, Any]:
        """Return the factors and forces that the user gave, by the labels that a report shows."""
        proof = "not checked" if self.proof_force is None else self.proof_force
        return {"k_e": _format_factor(self.termination), "gamma_R": self.gamma_r, "F_k (N)": proof}

    def evaluate(self, structure: Structure, solution: Solution) -> Terms:
        """Return F_Ed, F_uk, F_Rd, N, and the utilization F_Ed / F_Rd in one case, [n_item]."""
        resistance = cable_resistance(
            self.strengths(structure),
            self.proof_force,
            termination=self.termination,
            gamma_r=self.gamma_r,
        )
        return self._rating(structure, solution, resistance, termination_factor(self.termination))


@dataclasses.dataclass(frozen=True)
class CableService(_OnCables):
    """Limit of stress in service, as a part of the breaking force: ``F_Ed / (fraction F_uk)``.

    Args:
        elements: as of `CableResistance`.
        name, of: as of `Check`.
        fraction: name in `standards.SERVICE_FRACTIONS`, or a number, without unit.
        termination: as of `CableResistance`.

    Example:
        >>> rope = jc.Cables([[0, 1]], axial_stiffness=1e7, strength=300e3)
        >>> structure = jc.Structure([[0, 0, 0], [0, 0, -2.0]], rope, supports=jc.pinned([0]))
        >>> solution = jc.solve(structure, jc.Phase(loads=jc.NodalLoads([1], (0, 0, -54e3))))
        >>> service = jc.design.CableService(fraction="service, with bending")
        >>> found = jc.design.checks(structure, solution, service)
        >>> print(found["cable service stress"].utilization)
        [0.36]
    """

    name: str = "cable service stress"
    of: Sequence[str] = SERVICE
    fraction: str | Float[ArrayLike, ""] = "service"
    termination: str | Float[ArrayLike, ""] = 1.0

    clause = "EN 1993-1-11:2006, 7.2"
    formula = "F_Ed / F_Rd, F_Rd = fraction F_uk, F_uk = k_e F_min"
    not_covered = "slip of clamps, deformations"

    def __post_init__(self):
        super().__post_init__()
        termination_factor(self.termination)
        if isinstance(self.fraction, str):
            checks.require_one_of(self.fraction, "fraction", list(SERVICE_FRACTIONS))

    def _service_limit_ratio(self):
        """Return the limit of the force in service over the breaking force, -."""
        given = self.fraction
        return SERVICE_FRACTIONS[given] if isinstance(given, str) else given

    def inputs(self) -> dict[str, Any]:
        """Return the factors and forces that the user gave, by the labels that a report shows."""
        return {"fraction": self._service_limit_ratio(), "k_e": _format_factor(self.termination)}

    def evaluate(self, structure: Structure, solution: Solution) -> Terms:
        """Return force, breaking force and service limit, N, and the utilization, [n_item] each."""
        factor = termination_factor(self.termination)
        limit = self._service_limit_ratio() * factor * self.strengths(structure)
        return self._rating(structure, solution, limit, factor)


@dataclasses.dataclass(frozen=True)
class CableSafety(_OnCables):
    """A factor of safety on the breaking force, under actions without factors.

    Args:
        elements: as of `CableResistance`.
        name, of: as of `Check`.
        factor: smallest breaking force over force, without unit; 2.2 is that of ASCE 19.
        termination: as of `CableResistance`.

    Example:
        >>> rope = jc.Cables([[0, 1]], axial_stiffness=1e7, strength=300e3)
        >>> structure = jc.Structure([[0, 0, 0], [0, 0, -2.0]], rope, supports=jc.pinned([0]))
        >>> solution = jc.solve(structure, jc.Phase(loads=jc.NodalLoads([1], (0, 0, -90e3))))
        >>> found = jc.design.checks(structure, solution, jc.design.CableSafety(factor=2.5))
        >>> print(found["cable safety"].utilization)
        [0.75]
    """

    name: str = "cable safety"
    of: Sequence[str] = SERVICE
    factor: Float[ArrayLike, ""] = 2.2
    termination: str | Float[ArrayLike, ""] = 1.0

    clause = "ASCE 19, factor of safety on the minimum breaking strength"
    formula = "F_Ed / F_Rd, F_Rd = F_uk / factor, F_uk = k_e F_min"
    not_covered = "fittings themselves, fatigue, bending over saddles"

    def __post_init__(self):
        super().__post_init__()
        termination_factor(self.termination)

    def inputs(self) -> dict[str, Any]:
        """Return the factors and forces that the user gave, by the labels that a report shows."""
        return {"factor": self.factor, "k_e": _format_factor(self.termination)}

    def evaluate(self, structure: Structure, solution: Solution) -> Terms:
        """Return force, breaking force, that over the factor of safety, N, and the utilization."""
        factor = termination_factor(self.termination)
        resistance = factor * self.strengths(structure) / jnp.asarray(self.factor)
        return self._rating(structure, solution, resistance, factor)


@dataclasses.dataclass(frozen=True)
class CableFatigue(_OnCables):
    """Fatigue of cables: the range of stress between any two of the cases that count.

    Args:
        elements: as of `CableResistance`.
        name: as of `Check`.
        of: limit states or rules whose combinations bound the cycle, such as "SLS frequent";
            empty: all cases.
        category: name in `standards.FATIGUE_CATEGORIES`, or the range at 2 million cycles, Pa.
        cycles: number of cycles of constant range, without unit.
        gamma_mf: partial factor of fatigue strength, without unit (EN 1993-1-9, table 3.1).
        gamma_ff: partial factor of the range, without unit.
        area: metallic area, m2, one number; None: that of the groups, where they have one.

    The range is one of axial stress. Bending at terminations is to be added by ``gamma_ff``.

    Example:
        >>> rope = jc.Cables([[0, 1]], axial_stiffness=1e7, strength=300e3)
        >>> structure = jc.Structure([[0, 0, 0], [0, 0, -2.0]], rope, supports=jc.pinned([0]))
        >>> hung = jc.Phase(loads=jc.NodalLoads([1], (0.0, 0.0, -1e3)))
        >>> cases = [jc.Phase(loads=jc.NodalLoads([1], (0, 0, -p))) for p in (10e3, 30e3)]
        >>> solutions = jc.design.solve_cases(structure, hung, cases)
        >>> fatigue = jc.design.CableFatigue(category="spiral strand", cycles=2e6, area=2e-4)
        >>> found = jc.design.checks(structure, solutions, fatigue)  # 100 of 150 / 1.35 MPa
        >>> print(found["cable fatigue"].utilization, found.governing("cable fatigue"))
        [0.9] ['case 0 to case 1']
    """

    name: str = "cable fatigue"
    of: Sequence[str] = ()
    category: str | Float[ArrayLike, ""] = 150e6
    cycles: Float[ArrayLike, ""] = 2e6
    gamma_mf: Float[ArrayLike, ""] = 1.35
    gamma_ff: Float[ArrayLike, ""] = 1.0
    area: Float[ArrayLike, ""] | None = None

    clause = "EN 1993-1-11:2006, 9.2, table 9.1; EN 1993-1-9, table 3.1 for gamma_Mf"
    formula = "gamma_Ff (max F_Ed - min F_Ed) / A / (range_R / gamma_Mf)"
    not_covered = "spectra of ranges, bending of the cable, vibration"
    units = _FATIGUE_UNITS
    requirement: ClassVar[str] = (
        "have no metallic area, or are no cables; give area=catalogue.cable(name).area"
    )
    requirement_met: ClassVar[str] = "has cables with a metallic area; give area=..."

    def __post_init__(self):
        super().__post_init__()
        cable_fatigue_strength(self.category, self.cycles)
        warn_if_unusual("category", self.category, 1e6, 2e9, "is the range in Pa?")
        warn_if_unusual("area", self.area, 0.0, 1.0, "is the area in m2?")

    def applies_to(self, group: Element) -> bool:
        """Return whether the elements have tension only, and an area."""
        return bool(group.tension_only) and not (self.area is None and group.area is None)

    def inputs(self) -> dict[str, Any]:
        """Return fatigue category, cycles and partial factors, by the labels of a report."""
        unit, number = "Pa", self.category
        if isinstance(number, str):
            unit, number = "MPa", f"{FATIGUE_CATEGORIES[number] / 1e6:g} ({number})"
        return {
            f"range at 2e6 cycles ({unit})": number,
            "cycles": self.cycles,
            "gamma_Mf": self.gamma_mf,
            "gamma_Ff": self.gamma_ff,
        }

    def evaluate(self, structure: Structure, solution: Solution) -> Terms:
        """Return the tension, N, under the name "utilization", and the area, m2, [n_item] each.

        A range needs all cases: `governing_terms` replaces the tension by the utilization.
        """
        given = [one.area if self.area is None else self.area for one in structure.groups]
        areas = [
            None if area is None else jnp.broadcast_to(jnp.asarray(area), len(one.links))
            for area, one in zip(given, structure.groups, strict=True)
        ]
        force = largest_forces(self, structure, solution)
        # the sum makes the area NaN where the case has failed, as the force is
        return {UTILIZATION: force, "area": self.checked_values(structure, areas) + 0.0 * force}

    def governing_terms(
        self, terms: dict[str, Float[Array, "n_case n_item"]]
    ) -> tuple[Terms, Int[Array, " n_item"], Int[Array, " n_item"] | None]:
        """Return the stress range between the cases of extreme forces, and its utilization.

        Args:
            terms: tension, N, as "utilization", and area, m2, in all cases, [n_case, n_item].

        Returns:
            Terms [n_item] by name: extreme forces, area, range and its resistance, Pa, utilization;
            indices of the cases with the highest forces, and of those with the lowest.
        """
        force = terms[UTILIZATION]
        low_case, high_case = (extreme_cases(force, sign) for sign in (-1, 1))
        low, high = values_in_cases(force, low_case), values_in_cases(force, high_case)
        resistance = cable_fatigue_strength(self.category, self.cycles) / self.gamma_mf
        area = values_in_cases(terms["area"], high_case)
        stress = self.gamma_ff * (high - low) / area
        found = {
            "lowest F": low,
            "highest F": high,
            "A": area,
            "range": stress,
            "range_Rd": jnp.broadcast_to(resistance, stress.shape),
            UTILIZATION: stress / resistance,
        }
        return found, high_case, low_case


def _format_factor(termination):
    """Return a loss factor k_e for reports: value and name as a text, or the number itself."""
    if isinstance(termination, str):
        return f"{TERMINATIONS[termination]:g} ({termination})"
    return termination
