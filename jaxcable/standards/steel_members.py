"""Steel members by EN 1993-1-1:2005: flexural buckling, and cross-sections under N, M and V."""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import Protocol, TypeAlias

import jax.numpy as jnp

from ..common import checks
from ..common.tree import pytree
from ..common.types import Array, ArrayLike, Float

IMPERFECTION_FACTORS = {"a0": 0.13, "a": 0.21, "b": 0.34, "c": 0.49, "d": 0.76}
"""Factors alpha of the buckling curves (EN 1993-1-1:2005, table 6.1)."""


@pytree(static=("circular", "label"))
class SteelSection:
    """Numbers of a cross-section that its resistance depends on; `steel_section` makes it.

    Attributes:
        A: area, m2.
        Iy, Iz: second moments of area, m4.
        Wy, Wz: section moduli that bending may use, m3: plastic ones in classes 1 and 2, elastic
            ones in class 3.
        Avy, Avz: shear areas along y and z, m2; None: shear is not checked.
        circular: whether it is a tube or a round bar, whose moments about y and z add as a vector.
        label: of what they are, such as "IPE 300, class 1"; for reports.

    Example:
        >>> rod = jc.standards.SteelSection(A=1e-3, Iy=1e-7, Iz=1e-7, Wy=1e-5, Wz=1e-5)
        >>> print(rod.label, rod.Avz)
        given numbers None
    """

    A: Float[ArrayLike, ""]
    Iy: Float[ArrayLike, ""]
    Iz: Float[ArrayLike, ""]
    Wy: Float[ArrayLike, ""]
    Wz: Float[ArrayLike, ""]
    Avy: Float[ArrayLike, ""] | None = None
    Avz: Float[ArrayLike, ""] | None = None
    circular: bool = False
    label: str = "given numbers"


class ProfileNumbers(Protocol):
    """Protocol of a steel profile as `steel_section` takes it, such as `catalogue.ProfileData`.

    Sizes h, b, tw, tf, r in m, area A in m2, second moments in m4, section moduli in m3.
    """

    name: str
    shape: str
    h: float
    b: float
    tw: float
    tf: float
    r: float
    A: float
    Iy: float
    Iz: float
    Wel_y: float
    Wel_z: float
    Wpl_y: float | None
    Wpl_z: float | None


Profile: TypeAlias = "ProfileNumbers | Mapping[str, Float[ArrayLike, '']]"
"""What `steel_section` makes a section of: a record of the catalogue, or a dict of numbers."""


def steel_section(
    profile: Profile | SteelSection,
    section_class: int = 3,
) -> SteelSection:
    """Return the numbers of a section that its resistance depends on.

    Args:
        profile: record from `catalogue.profile_data`; or a dict of numbers with the names of the
            attributes of `SteelSection`; or such a section.
        section_class: of a profile, which you have determined (EN 1993-1-1, table 5.2): 1 or 2 for
            plastic moduli, 3 for elastic ones.

    Shear areas of profiles are those of 6.2.6 (3): I-sections by a), along y the flanges; U by b);
    hollow sections by f) and g).

    Raises:
        ValueError: class 4, which has effective areas; angles, which do not bend about the axes of
            their tables; missing or unknown names.

    Example:
        >>> tube = jc.standards.steel_section(jc.catalogue.profile_data("CHS 168.3x8"), 1)
        >>> print(f"{1e6 * tube.Wy:.0f} cm3, {tube.label}")
        206 cm3, CHS 168.3x8, class 1
    """
    if isinstance(profile, SteelSection):
        return profile
    if isinstance(profile, Mapping):
        unknown = set(profile) - set(SteelSection.__dataclass_fields__)
        missing = {"A", "Iy", "Iz", "Wy", "Wz"} - set(profile)
        if unknown or missing:
            raise ValueError(
                "profile: expected a dict with A, Iy, Iz, Wy, Wz, and Avy, Avz if shear is to be "
                f"checked; missing: {sorted(missing) or 'none'}, unknown: "
                f"{sorted(unknown) or 'none'}"
            )
        return SteelSection(**profile)
    if not hasattr(profile, "Wel_y"):
        if isinstance(profile, str):
            raise ValueError(f"profile = {profile!r}: expected catalogue.profile_data({profile!r})")
        kind = checks.describe_type(profile, 'catalogue.profile_data("IPE 300")')
        raise ValueError(f"profile: expected catalogue.profile_data(name) or a dict, got {kind}")
    if section_class not in (1, 2, 3):
        raise ValueError(
            f"section_class = {section_class}: expected 1, 2 or 3; a section of class 4 has "
            "effective areas, which are not computed here: give a dict of its numbers"
        )
    if profile.shape == "L":
        raise ValueError(
            f"profile: {profile.name} is an angle, whose principal axes are not y and z; give a "
            "dict of its numbers about the axes of the elements"
        )
    Wy, Wz = profile.Wel_y, profile.Wel_z
    if section_class < 3:
        if profile.Wpl_y is None or profile.Wpl_z is None:
            raise ValueError(f"profile: {profile.name} has no plastic moduli; give class 3")
        Wy, Wz = profile.Wpl_y, profile.Wpl_z
    label = f"{profile.name}, class {section_class}"
    Avy, Avz = _shear_areas(profile)
    return SteelSection(
        profile.A, profile.Iy, profile.Iz, Wy, Wz, Avy, Avz, profile.shape == "circle", label
    )


def _shear_areas(profile):
    """Return the shear areas of a profile along y and z, m2 (6.2.6 (3), with eta = 1)."""
    p = profile
    if p.shape == "circle":
        return (2 * p.A / math.pi,) * 2
    if p.shape == "rectangle":
        return p.A * p.b / (p.b + p.h), p.A * p.h / (p.b + p.h)
    if p.shape == "I":
        along_web = p.A - 2 * p.b * p.tf + (p.tw + 2 * p.r) * p.tf
        return 2 * p.b * p.tf, max(along_web, (p.h - 2 * p.tf) * p.tw)
    return 2 * p.b * p.tf, p.A - 2 * p.b * p.tf + (p.tw + p.r) * p.tf


def critical_force(
    inertia: Float[ArrayLike, " ..."],
    length: Float[ArrayLike, " ..."],
    youngs_modulus: Float[ArrayLike, " ..."] = 210e9,
) -> Float[Array, " ..."]:
    """Compute Euler's force ``pi^2 E I / L^2``, N.

    Args:
        inertia: second moment of area, m4.
        length: buckling length, m.
        youngs_modulus: Pa.

    Example:
        >>> print(f"{jc.standards.critical_force(3692e-8, 4.0) / 1e3:.0f} kN")
        4783 kN
    """
    stiffness = jnp.asarray(youngs_modulus) * jnp.asarray(inertia)
    return math.pi**2 * stiffness / jnp.asarray(length) ** 2


def buckling_reduction(slenderness: Float[ArrayLike, " ..."], curve: str) -> Float[Array, " ..."]:
    """Compute the reduction factor chi of flexural buckling (EN 1993-1-1:2005, 6.3.1.2).

    ``chi = 1 / (phi + sqrt(phi^2 - s^2))`` with ``phi = (1 + alpha (s - 0.2) + s^2) / 2``, at most
    1, where s is the slenderness.

    Args:
        slenderness: ``sqrt(A f_y / N_cr)``, -.
        curve: "a0", "a", "b", "c" or "d" (table 6.2).

    Raises:
        ValueError: an unknown curve.

    Example:
        >>> print(f"{jc.standards.buckling_reduction(1.0, 'b'):.4f}")
        0.5970
    """
    checks.require_one_of(curve, "curve", list(IMPERFECTION_FACTORS))
    s = jnp.asarray(slenderness)
    phi = (1 + IMPERFECTION_FACTORS[curve] * (s - 0.2) + s**2) / 2
    return jnp.minimum(1.0, 1 / (phi + jnp.sqrt(phi**2 - s**2)))


def section_utilization(
    forces: Float[ArrayLike, "... 6"],
    section: SteelSection,
    yield_strength: Float[ArrayLike, ""],
    gamma_m0: Float[ArrayLike, ""] = 1.0,
) -> Float[Array, " ..."]:
    """Compute the utilization of cross-sections: ``N/N_Rd + My/My_Rd + Mz/Mz_Rd``, or shear.

    The sum of utilizations is the conservative rule of 6.2.1 (7). The result is the larger one of
    it and of the utilization by shear, which is the larger one of ``Vy/Vy_Rd`` and ``Vz/Vz_Rd``.
    Shear forces on circular sections add as a vector, and moments, too, as in 6.2.9.1 (6): the
    result does not depend on the directions of y and z.

    Where a shear force is above half of its resistance, its shear area has the yield strength
    ``(1 - rho) f_y`` left, with ``rho = (2 V/V_Rd - 1)^2`` (6.2.8, 6.2.10). The resistance to N is
    that of the area with this loss; moments lose the larger rho of both directions wholly, because
    a flange or web resists moments about both axes (for the moment about the other axis this is on
    the safe side). At and beyond V_Rd one thousandth is left, so that utilizations stay finite:
    they grow with every force and have no jump.

    Args:
        forces: section forces N, Vy, Vz, T, My, Mz, [..., 6], N and N m. Torsion is not checked.
        section: `SteelSection`.
        yield_strength: f_y, Pa.
        gamma_m0: partial factor of cross-sections.

    Source: EN 1993-1-1:2005, 6.2.

    Example:
        >>> rod = jc.standards.SteelSection(A=1e-3, Iy=1e-7, Iz=1e-7, Wy=1e-5, Wz=1e-5)
        >>> used = jc.standards.section_utilization([1e5, 0, 0, 0, 1e3, 0], rod, 250e6)
        >>> print(f"{used:.2f}")
        0.80
    """
    force = jnp.moveaxis(jnp.abs(jnp.asarray(forces)), -1, 0)
    strength = jnp.asarray(yield_strength) / gamma_m0
    areas = section.Avy, section.Avz
    shear = [
        jnp.zeros_like(one) if area is None else one / (area * strength / math.sqrt(3.0))
        for one, area in zip(force[1:3], areas, strict=True)
    ]
    if section.circular:
        areas, shear = _resultant_shear(areas, shear)
    lost = [jnp.where(used > 0.5, jnp.minimum((2 * used - 1) ** 2, 1.0), 0.0) for used in shear]
    lost_area = sum(rho * area for rho, area in zip(lost, areas, strict=True) if area is not None)
    axial_part = jnp.maximum(1 - lost_area / section.A, _LEAST_PART)
    bending_part = jnp.maximum(1 - jnp.maximum(*lost), _LEAST_PART)
    bending_y, bending_z = (
        force[k] / (modulus * strength * bending_part)
        for k, modulus in ((4, section.Wy), (5, section.Wz))
    )
    bending = combined_bending(bending_y, bending_z, section)
    together = force[0] / (section.A * strength * axial_part) + bending
    return jnp.maximum(together, jnp.maximum(*shear))


_LEAST_PART = 1e-3
"""Part of a resistance that is left beside a shear force of V_Rd and more."""


def _resultant_shear(areas, shear):
    """Return areas and utilizations by shear of a circular section, in the direction of the force.

    `areas` and `shear` are pairs along y and z, [...]; the results are pairs, whose second
    items are None and zero.
    """
    area = next((one for one in areas if one is not None), None)
    return (area, None), (vector_sum(*shear), jnp.zeros_like(shear[0]))


def combined_bending(
    about_y: Float[Array, " ..."], about_z: Float[Array, " ..."], section: SteelSection
) -> Float[Array, " ..."]:
    """Return the utilization by both moments, -, from those by each of them.

    They add as vectors for a circular `section`, else as numbers.
    """
    return vector_sum(about_y, about_z) if section.circular else about_y + about_z


def vector_sum(
    along_y: Float[Array, " ..."], along_z: Float[Array, " ..."]
) -> Float[Array, " ..."]:
    """Return the length of vectors from their components; that of zero has the derivative zero."""
    square = along_y**2 + along_z**2
    acts = square > 0
    return jnp.where(acts, jnp.sqrt(jnp.where(acts, square, 1.0)), 0.0)
