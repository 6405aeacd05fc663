"""Parts of masts from members, profiles and cables: stiffness, weight, area in wind and ice."""

from __future__ import annotations

from typing import Literal

import numpy as np

from ..catalogue import cable as cable_of_catalogue
from ..catalogue import profile_data
from ..common import checks
from ..common.rules import Rule, nan_if_broken, positive
from ..common.types import Array, ArrayLike, Float
from ..loads.masses import STANDARD_GRAVITY
from ..sections import lattice
from .mast_components import GuyLevel, MastSection

STEEL_DENSITY = 7850.0
"""kg/m3 (EN 1991-1-1, Table A.4)."""
_MODULUS = 210e9
_DIAGONALS = {"X": 2, "N": 1, "W": 1, "K": 2}

DRAG_RULES = "EN 1993-3-1", "TIA-222"
"""Standards of `lattice_drag`."""


def lattice_drag(
    sides: Literal[3, 4],
    solidity: Float[ArrayLike, ""],
    members: Literal["flat", "round"] = "round",
    standard: Literal["EN 1993-3-1", "TIA-222"] = "EN 1993-3-1",
) -> Float[Array, ""]:
    """Return the drag coefficient of a lattice mast, on the area of the members of one face.

    With the solidity s, wind normal to a face, no ice:

    - EN 1993-3-1, B.2.2.2: flat ``1.76 C1 (1 - C2 s + s^2)``, round below the critical Reynolds
      number ``C1 (1 - C2 s) + (C1 + 0.875) s^2``; of four sides C1 = 2.25 and C2 = 1.5, of three
      1.9 and 1.4;
    - TIA-222-G, 2.6.9.1.1: flat ``4.0 s^2 - 5.9 s + 4.0`` of four sides, ``3.4 s^2 - 4.7 s + 3.4``
      of three; round this times ``0.57 - 0.14 s + 0.86 s^2 - 0.24 s^3``, at most 1.

    The texts of both clauses were not at hand when this was written: compare with yours. C1, C2 and
    the formula of round members are those of E.1 in the next EN 1991-1-4 (formulas E.22 and E.24),
    as public code has them (IP_dynamic_analysis, 2025).

    Args:
        sides: number of faces, 3 or 4.
        solidity: area of the members of a face over the area within its outline, without unit.
        members: "flat" (angles, plates) or "round", below the critical Reynolds number.
        standard: "EN 1993-3-1" or "TIA-222".

    Returns:
        Drag coefficient, without unit.

    Raises:
        ValueError: another number of sides, kind of members or standard; a solidity beyond 1.

    Example:
        >>> print(f"{jc.masts.lattice_drag(3, 0.2, 'flat'):.2f}")
        2.54
        >>> print(f"{jc.masts.lattice_drag(3, 0.2, 'flat', 'TIA-222'):.2f}")
        2.60
    """
    if sides not in (3, 4):
        raise ValueError(f"sides = {sides!r}: expected 3 or 4")
    checks.require_one_of(members, "members", ("flat", "round"))
    checks.require_one_of(standard, "standard", DRAG_RULES)
    outside = Rule("solidity", solidity, lambda s: (s < 0) | (s > 1), "expected 0 to 1")
    s, xp = nan_if_broken(outside), checks.numpy_or_jax(solidity)
    if standard == "EN 1993-3-1":
        first, second = (2.25, 1.5) if sides == 4 else (1.9, 1.4)
        if members == "flat":
            return 1.76 * first * (1 - second * s + s**2)
        return first * (1 - second * s) + (first + 0.875) * s**2
    flat = 4.0 * s**2 - 5.9 * s + 4.0 if sides == 4 else 3.4 * s**2 - 4.7 * s + 3.4
    return flat * (
        xp.minimum(0.57 - 0.14 * s + 0.86 * s**2 - 0.24 * s**3, 1) if members == "round" else 1
    )


def lattice_section(
    top: Float[ArrayLike, ""],
    sides: Literal[3, 4],
    width: Float[ArrayLike, ""],
    panel: Float[ArrayLike, ""],
    leg: Float[ArrayLike, ""],
    diagonal: Float[ArrayLike, ""],
    strut: Float[ArrayLike, ""] | None = None,
    *,
    leg_area: Float[ArrayLike, ""] | None = None,
    diagonal_area: Float[ArrayLike, ""] | None = None,
    strut_area: Float[ArrayLike, ""] | None = None,
    pattern: Literal["X", "N", "W", "K"] = "X",
    members: Literal["flat", "round"] = "round",
    standard: Literal["EN 1993-3-1", "TIA-222"] = "EN 1993-3-1",
    drag: Float[ArrayLike, ""] | None = None,
    modulus: Float[ArrayLike, ""] = _MODULUS,
    more_weight: Float[ArrayLike, ""] = 0.0,
    more_drag_area: Float[ArrayLike, ""] = 0.0,
) -> MastSection:
    """Return a section of a lattice mast of steel, from its width and its members.

    Stiffnesses are those of `sections.lattice`, the weight that of the members without joints. The
    drag coefficient is that of wind normal to a face, from all directions, and stays under ice.

    Args:
        top: height of its upper end above the base, m.
        sides: number of faces and legs, 3 or 4.
        width: of a face, between the axes of legs, m.
        panel: height of a panel, m.
        leg, diagonal, strut: diameters of members, or widths in the wind, m; no strut: None.

    Options:
        leg_area, diagonal_area, strut_area: of the cross-sections, m2; default those of solid round
            bars of these diameters.
        pattern: of the bracing, as of `sections.lattice`.
        members, standard: as of `lattice_drag`.
        drag: drag coefficient in place of that of `lattice_drag`.
        modulus: Young's modulus, N/m2.
        more_weight, more_drag_area: of ladders and feeders, N/m and m2/m, drag coefficient
            included.

    Returns:
        `MastSection`.

    Raises:
        ValueError: a size that is not positive; as of `sections.lattice` and `lattice_drag`.

    Example:
        >>> part = jc.masts.lattice_section(60.0, 3, 0.8, 0.8, leg=0.05, diagonal=0.02)
        >>> print(f"EI {part.EI / 1e6:.0f} MN m2, {part.weight:.0f} N/m, {part.drag_area:.3f} m2/m")
        EI 132 MN m2, 659 N/m, 0.236 m2/m
    """

    sizes = {"width": width, "panel": panel, "leg": leg, "diagonal": diagonal, "strut": strut}
    sizes |= {"leg_area": leg_area, "diagonal_area": diagonal_area, "strut_area": strut_area}
    for name in [name for name, size in sizes.items() if size is not None]:
        sizes[name] = nan_if_broken(positive(name, checks.as_scalar(sizes[name], name)))
    width, panel, leg, diagonal, strut, *areas = sizes.values()

    def area(given, diameter):
        return np.pi / 4 * diameter**2 if given is None else given

    of_leg, of_diagonal = area(areas[0], leg), area(areas[1], diagonal)
    of_strut = None if strut is None else area(areas[2], strut)
    stiffness = (modulus * of_leg, modulus * of_diagonal)
    strut_stiffness = None if of_strut is None else modulus * of_strut
    found = lattice(sides, width, panel, *stiffness, strut_stiffness, pattern)
    across = width / 2 if pattern == "K" else width
    # per height of one face: length of diagonals and of struts
    slanted = _DIAGONALS[pattern] * (panel**2 + across**2) ** 0.5 / panel
    level = 0.0 if strut is None else width / panel
    strut, of_strut = strut or 0.0, of_strut or 0.0
    face = 2 * leg + slanted * diagonal + level * strut
    if drag is None:
        drag = lattice_drag(sides, face / (width + leg), members, standard)
    volume = sides * (of_leg + slanted * of_diagonal + level * of_strut)
    length = sides * (1 + slanted + level)
    return MastSection(
        top,
        *(found.EA, found.EIy, found.GJ, found.GAy),
        weight=STEEL_DENSITY * STANDARD_GRAVITY * volume + more_weight,
        drag_area=drag * face + more_drag_area,
        ice_width=2 * drag * (2 + slanted + level),
        ice_length=length,
        ice_diameter=sides * (leg + slanted * diagonal + level * strut) / length,
    )


def tube_section(
    top: Float[ArrayLike, ""],
    profile: str,
    *,
    drag: Float[ArrayLike, ""] = 1.2,
    modulus: Float[ArrayLike, ""] = _MODULUS,
    more_weight: Float[ArrayLike, ""] = 0.0,
    more_drag_area: Float[ArrayLike, ""] = 0.0,
) -> MastSection:
    """Return a section of a mast that is a round steel tube of the catalogue.

    Args:
        top: height of its upper end above the base, m.
        profile: name of a circular hollow section, as of `catalogue.profile`.

    Options:
        drag: drag coefficient; 1.2 below the critical Reynolds number (EN 1991-1-4, 7.9).
        modulus: Young's modulus, N/m2; Poisson's ratio is 0.3. Rigid in shear.
        more_weight, more_drag_area: as of `lattice_section`.

    Returns:
        `MastSection`.

    Raises:
        ValueError: an unknown profile, or one that is not round.

    Example:
        >>> part = jc.masts.tube_section(30.0, "CHS 219.1x6.3")
        >>> print(f"{part.weight:.0f} N/m, {part.drag_area:.3f} m2/m")
        324 N/m, 0.263 m2/m
    """
    data = profile_data(profile)
    if data.shape != "circle":
        raise ValueError(f"profile = {profile!r}: is not round; give a CHS, or a MastSection")
    return MastSection(
        top,
        modulus * data.A,
        modulus * data.Iy,
        modulus / 2.6 * data.It,
        weight=data.weight + more_weight,
        drag_area=drag * data.h + more_drag_area,
        ice_width=2 * drag,
        ice_length=1.0,
        ice_diameter=data.h,
    )


def guy_level(
    height: Float[ArrayLike, ""],
    radius: Float[ArrayLike, ""] | Float[ArrayLike, " n_guy"],
    azimuths: Float[ArrayLike, " n_guy"],
    cable: str,
    share: Float[ArrayLike, ""] | None = None,
    **others: Float[ArrayLike, " n_guy"],
) -> GuyLevel:
    """Return a level of guys of a cable of the catalogue, at a share of its breaking strength.

    Args:
        height, radius, azimuths: as of `GuyLevel`.
        cable: name, as of `catalogue.cable`.
        share: initial tension at the anchors over breaking strength; default 0.1, if no `tension`
            is among the others.
        others: further arguments of `GuyLevel`.

    Returns:
        `GuyLevel`.

    Raises:
        ValueError: as of `GuyLevel` and `catalogue.cable`; a cable whose strength or diameter is
            not known; both a share and a tension.

    Example:
        >>> level = jc.masts.guy_level(30.0, 20.0, [0, 120, 240], "Galfan spiral strand 20")
        >>> print(level.tension[0], "N")
        40800.0 N
    """
    data = cable_of_catalogue(cable)
    if data.strength is None or data.diameter is None:
        raise ValueError(f"cable = {cable!r}: has no strength or diameter; give a GuyLevel")
    if share is not None and "tension" in others:
        raise ValueError("share, tension: give one of them")
    others = {"tension": (0.1 if share is None else share) * data.strength} | others
    own = data.axial_stiffness, data.weight, data.diameter, data.strength
    return GuyLevel(height, radius, azimuths, *own, **others)
