"""Checks of steel members by EN 1993-1-1: what they share, and cross-sections."""

from __future__ import annotations

import dataclasses
from collections.abc import Mapping, Sequence
from typing import Any, ClassVar

import jax.numpy as jnp
import numpy as np

from ..analysis.solution import Solution
from ..common import checks
from ..common.types import ArrayLike, Float
from ..elements.abilities import Bending, is_one_sided
from ..elements.element import TENSION, Element
from ..model.result_parts import items_per_group, named_groups_of
from ..model.structure import Structure
from ..results import section_forces
from ..standards.steel_members import (
    Profile,
    SteelSection,
    section_utilization,
    steel_section,
)
from .check import ULTIMATE, UTILIZATION, OnElements, Terms, warn_if_unusual

_COMPONENTS = "N", "Vy", "Vz", "T", "My", "Mz"
_UNITS = {"N": "N", "Vy": "N", "Vz": "N", "T": "N m", "My": "N m", "Mz": "N m"}


@dataclasses.dataclass(frozen=True)
class OnMembers(OnElements):
    """Base of checks of beams and bars with one steel profile; bars have axial forces only."""

    profile: Profile | SteelSection | None = None
    yield_strength: Float[ArrayLike, ""] | None = None
    section_class: int = 3
    places: int = 21

    requirement: ClassVar[str] = "are neither beams nor bars"
    requirement_met: ClassVar[str] = "has beams or bars"

    def __post_init__(self):
        super().__post_init__()
        if self.profile is None or self.yield_strength is None:
            raise ValueError(
                f"{self.name}: profile, yield_strength: missing; give "
                'profile=catalogue.profile_data("IPE 300"), yield_strength=355e6'
            )
        checks.as_scalar(self.yield_strength, "yield_strength")
        warn_if_unusual("yield_strength", self.yield_strength, 1e7, 3e9, "is it in Pa?")
        section = steel_section(self.profile, self.section_class)
        if isinstance(self.profile, Mapping):
            object.__setattr__(self, "profile", section)

    @property
    def section(self) -> SteelSection:
        """Area, section moduli and radii of gyration of the profile, a `SteelSection`."""
        assert self.profile is not None
        return steel_section(self.profile, self.section_class)

    def applies_to(self, group: Element) -> bool:
        """Return whether the elements bear compression, and have an axial force."""
        has_axial_force = any(one.name == TENSION.name for one in group.results)
        return has_axial_force and not is_one_sided(group)

    def checked_elements(self, structure: Structure) -> list[tuple[int, np.ndarray]]:
        """Return pairs: index of a group, and indices of its checked elements.

        Raises ValueError if no groups are named and several could have the profile.
        """
        found = super().checked_elements(structure)
        if self.elements is None and len(found) > 1:
            labels = [named_groups_of(structure)[k][0] for k, _ in found]
            raise ValueError(
                f"{self.name}: elements: missing; say which of {', '.join(map(repr, labels))} have "
                "this profile"
            )
        return found

    def inputs(self) -> dict[str, Any]:
        """Return name, yield strength, area and moduli of the section, by labels of a report."""
        s = self.section
        kind = "" if isinstance(self.profile, SteelSection) else "el,"
        kind = "pl," if kind and self.section_class < 3 else kind
        return {
            "section": s.label,
            "f_y (Pa)": self.yield_strength,
            "A (m2)": s.A,
            f"W{kind}y (m3)": s.Wy,
            f"W{kind}z (m3)": s.Wz,
        }

    def _section_forces_of_checked(self, structure, solution):
        """Return section forces along the checked elements, [n_item, n_place, 6], N and N m.

        The last axis has N, Vy, Vz, T, My, Mz; bars have N only.
        """
        axial = items_per_group(structure, solution.peak_tension)
        along = [None] * len(structure.groups)
        if any(isinstance(one, Bending) for one in structure.groups):
            along = items_per_group(structure, section_forces(structure, solution, self.places))
        for k, force in enumerate(axial):
            if along[k] is None and force is not None:  # bars
                along[k] = (
                    jnp.zeros((*force.shape, self.places, 6)).at[..., 0].set(force[..., None])
                )
        return self.checked_values(structure, along)


OF_TUBES = "of circular sections both moments, and both shear forces, add as vectors"


@dataclasses.dataclass(frozen=True)
class MemberSection(OnMembers):
    """Cross-sections of members by EN 1993-1-1: N with My and Mz, and shear, along each element.

    Forces are those of the deformed structure. With imperfections in the geometry this check alone
    is what 5.2.2 (7) a) asks for; otherwise check `MemberBuckling`, too.

    Args:
        elements: keys of groups, or selections by group; None: all beams and bars.
        name, of: as of `Check`.
        profile: record from `catalogue.profile_data`, or the numbers of a `SteelSection`; in
            files the name of the record, such as "CHS 168.3x8".
        section_class: of a profile: 1 or 2 for plastic moduli, 3 for elastic ones.
        yield_strength: yield strength f_y, Pa.
        places: number of places along beams.
        gamma_m0: partial factor, without unit.

    Example:
        >>> tube = jc.catalogue.profile_data("CHS 168.3x8")
        >>> strut = jc.Bars([[0, 1]], axial_stiffness=210e9 * tube.A)
        >>> supports = jc.pinned([0]) + jc.restrained([1], "xy")
        >>> structure = jc.Structure([[0, 0, 0], [0, 0, 4.0]], strut, supports)
        >>> solution = jc.solve(structure, jc.Phase(loads=jc.NodalLoads([1], (0, 0, -400e3))))
        >>> section = jc.design.MemberSection(profile=tube, yield_strength=355e6)
        >>> found = jc.design.checks(structure, solution, section)
        >>> print(found["cross-section"].utilization.round(3))
        [0.28]
    """

    name: str = "cross-section"
    of: Sequence[str] = ULTIMATE
    gamma_m0: Float[ArrayLike, ""] = 1.0

    clause = "EN 1993-1-1:2005, 6.2.1 (7), 6.2.6, 6.2.8, 6.2.10"
    formula = (
        "N/N_Rd + My/My_Rd + Mz/Mz_Rd, with resistances reduced where V > V_Rd/2; or V/V_Rd; "
        f"{OF_TUBES}"
    )
    units = _UNITS
    not_covered = "torsion, holes, class 4, local buckling in shear, concentrated forces"

    def inputs(self) -> dict[str, Any]:
        """Return the inputs and the resistances that follow from them, by labels of a report."""
        s, strength = self.section, self.yield_strength / self.gamma_m0
        areas = {"y": s.Avy, "z": s.Avz}
        shear = {f"Av{k} (m2)": "not checked" if v is None else v for k, v in areas.items()}
        resistances = {
            "N_Rd (N)": s.A * strength,
            "My_Rd (N m)": s.Wy * strength,
            "Mz_Rd (N m)": s.Wz * strength,
            **{f"V{k}_Rd (N)": v * strength / 3**0.5 for k, v in areas.items() if v is not None},
        }
        return {**super().inputs(), **shear, "gamma_M0": self.gamma_m0, **resistances}

    def evaluate(self, structure: Structure, solution: Solution) -> Terms:
        """Return section forces, N and N m, where they govern an element, x/L, and utilization."""
        forces = self._section_forces_of_checked(structure, solution)
        used = section_utilization(forces, self.section, self.yield_strength, self.gamma_m0)
        place = jnp.argmax(jnp.where(jnp.isnan(used), -jnp.inf, used), axis=1)
        at = jnp.take_along_axis(forces, place[:, None, None], axis=1)[:, 0]
        found = {name: at[:, k] for k, name in enumerate(_COMPONENTS)}
        most = jnp.take_along_axis(used, place[:, None], axis=1)[:, 0]
        return {**found, "x/L": place / (self.places - 1) + 0.0 * most, UTILIZATION: most}
