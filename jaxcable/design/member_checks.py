"""Checks of steel members by EN 1993-1-1: cross-sections, and flexural buckling."""

from __future__ import annotations

import dataclasses
from collections.abc import Mapping, Sequence
from typing import Any, ClassVar, Literal

import jax
import jax.numpy as jnp
import numpy as np

from ..analysis.solution import Solution, State
from ..common import checks, status
from ..common.types import ArrayLike, Float
from ..elements.abilities import Bending, is_one_sided
from ..elements.element import TENSION, Element
from ..model.result_parts import items_per_group, named_groups_of
from ..model.structure import Structure
from ..results import section_forces
from ..standards.steel_members import (
    IMPERFECTION_FACTORS,
    Profile,
    SteelSection,
    buckling_reduction,
    combined_bending,
    critical_force,
    section_utilization,
    steel_section,
)
from ..stiffness.buckling import buckling_factor
from .check import ULTIMATE, UTILIZATION, OnElements, Terms, warn_if_unusual

_COMPONENTS = "N", "Vy", "Vz", "T", "My", "Mz"
_UNITS = {"N": "N", "Vy": "N", "Vz": "N", "T": "N m", "My": "N m", "Mz": "N m"}
_BUCKLING_UNITS = {"N": "N", "N_b,Rd": "N", "My": "N m", "Mz": "N m"}


@dataclasses.dataclass(frozen=True)
class _OnMembers(OnElements):
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


_OF_TUBES = "of circular sections both moments, and both shear forces, add as vectors"


@dataclasses.dataclass(frozen=True)
class MemberSection(_OnMembers):
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
        f"{_OF_TUBES}"
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


@dataclasses.dataclass(frozen=True)
class MemberBuckling(_OnMembers):
    """Flexural buckling of members: ``N/N_b,Rd + My/My_Rd + Mz/Mz_Rd`` with largest moments.

    Moments are those of the deformed structure, so they contain the effect of the axial force on
    deflections, and interaction factors are 1 (conservative beside 6.3.3). Elements in tension have
    the moments alone.

    Args:
        elements, name, of, profile, section_class, yield_strength, places: as of `MemberSection`.
        lengths: buckling lengths about y and z, or one number for both, m. An element is seldom a
            member: give the length of the member.
        factors: instead of lengths, the lowest buckling factor of the loads, without unit, from
            `stiffness.buckling_factor`; the same for all cases: the smallest of `buckling_factors`.
            The critical force is then ``N_ref + factor (N - N_ref)``, the same for elements that do
            not take part in buckling, which is conservative; N_ref where the loads relieve them,
            which they are known to bear.
        reference: `Solution` or `State` that the factors refer to, whose forces are N_ref; "last
            phase" for the state in which the last phase begins, which a scene file can state, too;
            None: 0.
        curves: buckling curves about y and z, table 6.2; or one for both.
        chi_lt: reduction of My for lateral torsional buckling, without unit; 1.0 for hollow
            sections, or where the flange in compression is held.
        gamma_m1: partial factor, without unit.
        youngs_modulus: modulus of elasticity, Pa.

    Example:
        >>> tube = jc.catalogue.profile_data("CHS 168.3x8")
        >>> strut = jc.Bars([[0, 1]], axial_stiffness=210e9 * tube.A)
        >>> supports = jc.pinned([0]) + jc.restrained([1], "xy")
        >>> structure = jc.Structure([[0, 0, 0], [0, 0, 4.0]], strut, supports)
        >>> solution = jc.solve(structure, jc.Phase(loads=jc.NodalLoads([1], (0, 0, -400e3))))
        >>> buckling = jc.design.MemberBuckling(
        ...     profile=tube, yield_strength=355e6, lengths=4.0, curves="a"
        ... )
        >>> found = jc.design.checks(structure, solution, buckling)
        >>> print(found["member buckling"].utilization.round(3))
        [0.389]
    """

    name: str = "member buckling"
    of: Sequence[str] = ULTIMATE
    lengths: Float[ArrayLike, ""] | Float[ArrayLike, " 2"] | None = None
    factors: Float[ArrayLike, ""] | None = None
    reference: Literal["last phase"] | Solution | State | None = None
    curves: str | Sequence[str] = ("c", "c")
    chi_lt: Float[ArrayLike, ""] = 1.0
    gamma_m1: Float[ArrayLike, ""] = 1.0
    youngs_modulus: Float[ArrayLike, ""] = 210e9

    clause = "EN 1993-1-1:2005, 6.3.1, 6.3.3 with k = 1 on moments of second order"
    formula = "-N/N_b,Rd + My/(chi_LT Wy f_y/gamma_M1) + Mz/(Wz f_y/gamma_M1), " + (
        f"N_b,Rd = min(chi_y, chi_z) A f_y/gamma_M1; {_OF_TUBES}"
    )
    units = _BUCKLING_UNITS
    not_covered = "shear, torsional buckling, lateral torsional buckling beyond chi_LT, class 4"

    def __post_init__(self):
        super().__post_init__()
        pair = (self.curves,) * 2 if isinstance(self.curves, str) else tuple(self.curves)
        if len(pair) != 2:
            raise ValueError(f"curves = {self.curves!r}: expected two, about y and z")
        for curve in pair:
            checks.require_one_of(curve, "curves", list(IMPERFECTION_FACTORS))
        object.__setattr__(self, "curves", pair)
        if (self.lengths is None) == (self.factors is None):
            raise ValueError("lengths, factors: give one of them, buckling lengths or factors")
        if self.lengths is not None:
            lengths = np.asarray(checks.as_floats(self.lengths, "lengths"))
            if lengths.shape not in ((), (2,)):
                raise ValueError(
                    f"lengths = {self.lengths}: expected one number, or two, about y and z; other "
                    "members get a check of their own, by elements"
                )
            lengths = np.broadcast_to(lengths, (2,))
            warn_if_unusual("lengths", lengths, 0.0, 1e3, "are they in m?")
            if not (lengths > 0).all():
                raise ValueError(f"lengths = {self.lengths}: expected positive lengths, m")
            object.__setattr__(self, "lengths", tuple(lengths.tolist()))
        warn_if_unusual("youngs_modulus", self.youngs_modulus, 1e9, 1e12, "is it in Pa?")
        if isinstance(self.reference, str):
            checks.require_one_of(self.reference, "reference", ["last phase"])
        if self.reference is not None and self.factors is None:
            raise ValueError("reference: belongs to factors, which are missing")

    def inputs(self) -> dict[str, Any]:
        """Return section, buckling lengths or factor, curves and so on, by labels of a report."""
        if self.lengths is None:
            how: dict[str, Any] = {"buckling factor": self.factors}
        else:
            lengths = np.broadcast_to(np.asarray(self.lengths), (2,)).tolist()
            how = {f"L_cr,{k} (m)": v for k, v in zip("yz", lengths, strict=True)}
        how |= {"curves": " and ".join(self.curves), "chi_LT": self.chi_lt}
        return {**super().inputs(), **how, "gamma_M1": self.gamma_m1}

    def _buckling_reduction_factors(self, structure, solution, compression):
        """Return the reduction factors chi about y and about z, [n_item] each, -.

        `compression` is the compressive force of each element, positive, [n_item], N.
        """
        s, strength = self.section, jnp.asarray(self.yield_strength)
        if self.lengths is None:
            reference, begin = jnp.zeros_like(compression), self.reference
            if isinstance(begin, str):
                if len(solution.phases) < 2:
                    raise ValueError(
                        f"{self.name}: reference = {begin!r}: the solution has one phase alone; "
                        "give the Solution that it was started from"
                    )
                begin = solution.phases[-2]
            if begin is not None:
                reference = -self.checked_values(structure, begin.peak_tension)
            critical = reference + self.factors * jnp.maximum(compression - reference, 0.0)
            # tension at the critical load: no buckling; an unknown factor leaves NaN
            critical = [jnp.where(critical <= 0, jnp.inf, critical)] * 2
        else:
            modulus = jnp.asarray(self.youngs_modulus)
            pairs = zip((s.Iy, s.Iz), self.lengths, strict=True)
            critical = [critical_force(inertia, length, modulus) for inertia, length in pairs]
        about = [
            buckling_reduction(jnp.sqrt(s.A * strength / force), curve)
            for force, curve in zip(critical, self.curves, strict=True)
        ]
        return [jnp.broadcast_to(chi, compression.shape) for chi in about]

    def evaluate(self, structure: Structure, solution: Solution) -> Terms:
        """Return axial force, resistance, N, largest moments, N m, and utilization, [n_item]."""
        forces = self._section_forces_of_checked(structure, solution)
        smallest = forces[..., 0].min(axis=1)
        compression = jnp.maximum(-smallest, 0.0)
        chi_y, chi_z = self._buckling_reduction_factors(structure, solution, compression)
        s = self.section
        strength = jnp.asarray(self.yield_strength) / self.gamma_m1
        My, Mz = (jnp.abs(forces[..., k]) for k in (4, 5))
        about_y, about_z = My / (self.chi_lt * s.Wy * strength), Mz / (s.Wz * strength)
        if s.circular:
            bending = combined_bending(about_y, about_z, s).max(axis=1)
        else:  # the largest of each, wherever they are (6.3.3)
            bending = about_y.max(axis=1) + about_z.max(axis=1)
        resistance = jnp.minimum(chi_y, chi_z) * s.A * strength
        return {
            "N": smallest,
            "chi_y": chi_y,
            "chi_z": chi_z,
            "N_b,Rd": resistance,
            "My": My.max(axis=1),
            "Mz": Mz.max(axis=1),
            UTILIZATION: compression / resistance + bending,
        }


def buckling_factors(
    structure: Structure, solutions: Solution, reference: Solution | State | None = None
) -> Float[np.ndarray, " n_case"]:
    """Find the lowest buckling factor of every case, one eigenproblem each.

    Args:
        structure: `Structure`.
        solutions: `Solution` with a leading axis [n_case].
        reference: as of `stiffness.buckling_factor`: the prestressed state.

    Returns:
        Factors, [n_case], -; NaN for cases that have failed.

    Raises:
        ValueError: as `stiffness.buckling_factor`.

    Example:
        >>> structure, phases = jc.scenes.von_mises_truss(load=100.0)
        >>> pushes = [jc.Phase(loads=jc.NodalLoads([1], (0, 0, -p))) for p in (50.0, 100.0)]
        >>> solutions = jc.design.solve_cases(structure, jc.Phase(), pushes)
        >>> factors = jc.design.buckling_factors(structure, solutions)
        >>> print(factors.shape, bool(factors[0] > factors[1] > 1))
        (2,) True
    """
    found = np.full(len(solutions.status), np.nan)
    for k in np.flatnonzero(np.asarray(solutions.status) == status.OK):
        one = jax.tree.map(lambda values, k=k: values[k], solutions)
        found[k] = float(buckling_factor(structure, one, reference).factor[0])
    return found
