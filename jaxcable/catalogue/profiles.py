"""Profiles by name: their record in SI units, and their fibre section with rounded corners."""

from __future__ import annotations

import dataclasses
import functools
import re
from collections.abc import Iterator

import numpy as np

from ..common import checks
from ..files.codec import NAMED_RECORDS
from ..loads.masses import STANDARD_GRAVITY
from ..materials.law import Law
from ..sections import Section
from . import rolled, torsion_constants
from .names import plain_name, unknown_name_error
from .quads import Quad, quad_moments
from .tables import (
    HOLLOW_COLUMNS,
    PROFILE_COLUMNS,
    needed_value,
    package_rows,
    si_value,
    source_text,
)

STEEL_DENSITY = 7850.0
"""Of the tables, kg/m3 (EN 10365, EN 10210-2, EN 10219-2)."""

_HOLLOW = re.compile(r"(chs|shs|rhs)([\d.]+(?:x[\d.]+)*?)x([\d.]+)")
_MANUFACTURES = ("hot-finished", "cold-formed")


@dataclasses.dataclass(frozen=True)
class ProfileData:
    """Numbers of a profile in SI units, from its table; of a hollow section, from its dimensions.

    y is the axis along the flanges and z that along the web; legs of an angle are along both. What
    a table rounds is rounded here, too; `section` has the exact values of the nominal dimensions.

    Attributes:
        name: as in the table.
        family: "IPE", "HEA", "L", "CHS", ...
        shape: "I", "U", "tapered U", "L", "rectangle" or "circle".
        h, b: height along z and width along y, m.
        tw, tf: thicknesses of web and flange, or of a wall or leg (twice the same), m.
        r: radius of the fillets; the outer one of hollow sections, m.
        r2: radius of rounded toes; the inner one of hollow sections; 0 if there are none, m.
        mass: kg/m.
        A: area, m2.
        Iy, Iz: second moments of area about axes through the centroid, m4.
        It: torsion constant, m4.
        Wel_y, Wel_z: elastic moduli ``I`` over the largest distance from the centroid, m3.
        Wpl_y, Wpl_z: plastic moduli, m3; None for angles.
        source: where the numbers are from.

    Example:
        >>> data = jc.catalogue.profile_data("IPE 300")
        >>> print(f"{1e3 * data.h:.0f} x {1e3 * data.b:.0f} mm, {1e4 * data.A:.1f} cm2")
        300 x 150 mm, 53.8 cm2
        >>> print(f"Iy {1e8 * data.Iy:.0f} cm4, Wpl,y {1e6 * data.Wpl_y:.0f} cm3")
        Iy 8360 cm4, Wpl,y 628 cm3
        >>> print(f"{data.mass} kg/m, {data.weight:.0f} N/m")
        42.2 kg/m, 414 N/m
    """

    name: str
    family: str
    shape: str
    h: float
    b: float
    tw: float
    tf: float
    r: float
    r2: float
    mass: float
    A: float
    Iy: float
    Iz: float
    It: float
    Wel_y: float
    Wel_z: float
    Wpl_y: float | None
    Wpl_z: float | None
    source: str

    @property
    def weight(self) -> float:
        """Self-weight, N/m, at the standard gravity 9.80665 m/s2."""
        return self.mass * STANDARD_GRAVITY

    def section(self, law: Law, size: float | None = None) -> Section:
        """Make the fibre section; arguments and result are those of `profile`."""
        return _make_section(self, law, size)


def profile(
    name: str, law: Law, *, manufacture: str = "hot-finished", size: float | None = None
) -> Section:
    """Make the fibre section of a rolled profile or a hollow section from its name.

    Area and second moments are those of the nominal dimensions, with root fillets, rounded toes and
    rounded corners, exact whatever the mesh. The torsion constant is that of the tables: by El
    Darwish and Johnston (1965) for I, U and L, by EN 10210-2 for rectangles, exact for circles. The
    centroid is at the axis of the element.

    Names are tolerant: ``"HEA 200"``, ``"HE 200 A"`` and ``"hea200"`` are the same. Hollow sections
    are ``"CHS 168.3x8"``, ``"SHS 100x5"``, ``"RHS 200x100x8"``, of any size, in mm.
    `profile_names` lists names of tables and standard sizes.

    In a U or an L the centroid and the shear centre are apart, which is not modelled (see
    `Section`).

    Args:
        name: of the profile.
        law: uniaxial law.

    Options:
        manufacture: of hollow sections, for the radii of their corners: "hot-finished" (EN 10210-2:
            1.5 t and 1.0 t) or "cold-formed" (EN 10219-2: 2 t and 1 t up to 6 mm, 2.5 t and 1.5 t
            up to 10 mm, then 3 t and 2 t).
        size: largest side of the fibres, m; default an eighth of height or width. Smaller fibres
            are of use for laws that are not linear.

    Returns:
        `Section`.

    Raises:
        ValueError: an unknown name, with the nearest ones; dimensions that make no section.

    Source: `ProfileData` names it.

    Example:
        >>> section = jc.catalogue.profile("HEA 200", jc.Elastic(210e9))
        >>> print(f"{1e4 * section.total_area:.2f} cm2, {section.n_fibre} fibres")
        53.83 cm2, 27 fibres
        >>> Iy, Iz, Iyz = section.inertia()
        >>> print(f"{1e8 * Iy:.0f} cm4, {1e8 * Iz:.0f} cm4, It {1e8 * section.torsion[0]:.1f} cm4")
        3692 cm4, 1336 cm4, It 21.0 cm4
        >>> tube = jc.catalogue.profile("RHS 200x100x8", jc.Elastic(210e9))
        >>> print(f"{1e4 * tube.total_area:.1f} cm2")
        44.8 cm2
    """
    return _make_section(profile_data(name, manufacture=manufacture), law, size)


def profile_data(name: str, *, manufacture: str = "hot-finished") -> ProfileData:
    """Return the record of a profile: dimensions, mass, second moments, moduli, source.

    Args:
        name: as in `profile`.

    Options:
        manufacture: as in `profile`.

    Returns:
        `ProfileData`.

    Raises:
        ValueError: as `profile`.

    Example:
        >>> print(jc.catalogue.profile_data("HE 200 A").name)
        HEA 200
        >>> try:
        ...     jc.catalogue.profile_data("HEA 210")
        ... except ValueError as error:
        ...     print(str(error).split(";")[1].strip())
        near it are HEA 220, HEA 200, HEA 240
    """
    checks.require_one_of(manufacture, "manufacture", _MANUFACTURES)
    plain = plain_name(name)
    if found := _HOLLOW.fullmatch(plain):
        return _hollow_profile(found, manufacture)
    table = _rolled_table()
    if plain not in table:
        raise unknown_name_error(name, profile_names(), "catalogue.profile_names() lists all names")
    return table[plain]


NAMED_RECORDS["Profile"] = profile_data  # in scene files


def profile_names(family: str | None = None) -> list[str]:
    """List the names of profiles: rolled ones, and standard sizes of hollow sections.

    Args:
        family: "IPE", "IPE A", "IPE O", "HEAA", "HEA", "HEB", "HEM", "UPE", "UPN", "L", "CHS",
            "SHS", "RHS"; None for all.

    Returns:
        List of names.

    Raises:
        ValueError: there is no such family.

    Example:
        >>> print(jc.catalogue.profile_names("UPN")[:3], len(jc.catalogue.profile_names()))
        ['UPN 50', 'UPN 65', 'UPN 80'] 896
    """
    names = [data.name for data in _rolled_table().values()] + list(dict.fromkeys(_hollow_names()))
    if family is None:
        return names
    families = list(dict.fromkeys(_family_name(one) for one in names))
    checks.require_one_of(family, "family", families)
    return [one for one in names if _family_name(one) == family]


def _family_name(name):
    """Return the family of a profile from its name, "IPE" of "IPE 300"."""
    return name.rpartition(" ")[0]


def _hollow_names() -> Iterator[str]:
    """Yield the names of hollow sections of standard size, some of them twice."""
    for row in package_rows("hollow.csv", HOLLOW_COLUMNS):
        for thickness in row.text("thicknesses_mm").split():
            yield f"{row.text('kind')} {row.text('size_mm')}x{thickness}"


@functools.cache
def _rolled_table():
    """Read the rolled profiles of the package: `ProfileData` by `plain_name`."""
    rows = package_rows("profiles.csv", PROFILE_COLUMNS)
    return {plain_name(row.text("name")): _rolled_profile(row) for row in rows}


def _rolled_profile(row):
    """Return the `ProfileData` of a `TableRow` of rolled profiles, in SI units.

    Elastic moduli are computed from the second moments in the table and the nominal dimensions.
    """
    name, shape = row.text("name"), row.text("shape")
    h, b, tw, tf, r = (needed_value(row, f"{key}_mm") for key in ("h", "b", "tw", "tf", "r"))
    r2 = si_value(row, "r2_mm") or 0.0
    moments = needed_value(row, "iy_cm4"), needed_value(row, "iz_cm4")
    extent = _edge_distances(_section_cells(shape, h, b, tw, tf, r, r2, max(h, b)))
    plastic = si_value(row, "wpl_y_cm3"), si_value(row, "wpl_z_cm3")
    return ProfileData(
        *(name, _family_name(name), shape, h, b, tw, tf, r, r2, needed_value(row, "mass_kg_per_m")),
        *(needed_value(row, "a_cm2"), *moments, needed_value(row, "it_cm4")),
        *(moments[0] / extent[1], moments[1] / extent[0], *plastic),
        source_text(row.text("source")),
    )


def _hollow_profile(found, manufacture):
    """Return the `ProfileData` of a hollow section, computed from its dimensions in mm.

    Corner radii are those of EN 10210-2 (hot-finished) or EN 10219-2 (cold-formed). Raise
    ValueError for a wrong number of dimensions, or a wall too thick for them.

    Args:
        found: match of a plain name with `_HOLLOW`: kind, sides and wall thickness.
        manufacture: "hot-finished" or "cold-formed".
    """
    kind, t = found[1].upper(), float(found[3]) * 1e-3
    sides = [float(word) * 1e-3 for word in found[2].split("x")]
    name = f"{kind} {found[2]}x{found[3]}"
    if len(sides) != (2 if kind == "RHS" else 1):
        wanted = {"CHS": "CHS 168.3x8", "SHS": "SHS 100x5", "RHS": "RHS 200x100x8"}[kind]
        raise ValueError(f"name = {name!r}: {len(sides) + 1} numbers; expected as in {wanted!r}")
    h, b = sides[0], sides[-1]
    if kind == "CHS":
        shape, r, r2 = "circle", h / 2, h / 2 - t
        source, too_thick = "EN 10210-2 and EN 10219-2, annex A", not 0 < 2 * t < h
    else:
        shape, source = "rectangle", "EN 10219-2, annex A"
        r, r2 = (2.0 * t, t) if t <= 6e-3 else (2.5 * t, 1.5 * t) if t <= 10e-3 else (3 * t, 2 * t)
        if manufacture == "hot-finished":
            r, r2, source = 1.5 * t, t, "EN 10210-2, annex A"
        too_thick = not (t > 0 and 2 * max(r, t + r2) < min(h, b))
    if too_thick:
        raise ValueError(f"name = {name!r}: the wall is too thick for the size")
    cells = _section_cells(shape, h, b, t, t, r, r2, max(h, b))
    area, _, (Iy, Iz, _) = _area_and_inertia(cells)
    torsion = _torsion_constant(shape, h, b, t, t, r, r2)
    plastic = (
        ((h**3 - (h - 2 * t) ** 3) / 6,) * 2
        if shape == "circle"
        else (_plastic_modulus(h, b, t, r, r2), _plastic_modulus(b, h, t, r, r2))
    )
    return ProfileData(
        *(name, kind, shape, h, b, t, t, r, r2, STEEL_DENSITY * area, area, Iy, Iz, torsion),
        *(2 * Iy / h, 2 * Iz / b, *plastic, source),
    )


def _plastic_modulus(h, b, t, outer, inner):
    """Return the plastic modulus of a rectangular hollow section, m3 (EN 10210-2, annex A).

    It is about the axis across the height `h`; `outer` and `inner` are the radii of the corners, m.
    """
    share, arm = 1 - np.pi / 4, (10 - 3 * np.pi) / (12 - 3 * np.pi)
    solid = b * h**2 / 4 - 4 * share * outer**2 * (h / 2 - arm * outer)
    hole = (b - 2 * t) * (h - 2 * t) ** 2 / 4
    return solid - hole + 4 * share * inner**2 * (h / 2 - t - arm * inner)


def _section_cells(shape, h, b, tw, tf, r, r2, size) -> list[Quad]:
    """Return the quadrilateral cells of a section of a `ProfileData.shape`, in axes of its own.

    Dimensions are those of `ProfileData`, m; `size` is the largest side of a cell, m. The axes
    are those of `rolled`.
    """
    if shape == "I":
        return rolled.i_cells(h, b, tw, tf, r, size)
    if shape == "L":
        return rolled.l_cells(h, tw, r, r2, size)
    if shape == "rectangle":
        return rolled.rectangular_cells(h, b, tw, r, r2, size)
    if shape == "circle":
        return rolled.circular_cells(h, tw, size)
    slope = 0.0 if shape == "U" else 0.08 if h <= 0.3 else 0.05
    return rolled.u_cells(h, b, tw, tf, r, r2, slope, size)


def _torsion_constant(shape, h, b, tw, tf, r, r2) -> float:
    """Return the torsion constant of a section of `ProfileData.shape`, m4; dimensions in m."""
    if shape == "I":
        return torsion_constants.i_torsion(h, b, tw, tf, r)
    if shape == "L":
        return torsion_constants.l_torsion(h, tw, r)
    if shape == "rectangle":
        return torsion_constants.rectangular_torsion(h, b, tw, r, r2)
    if shape == "circle":
        return np.pi / 32 * (h**4 - (h - 2 * tw) ** 4)
    return torsion_constants.u_torsion(h, b, tw, tf, r)


def _area_and_inertia(cells):
    """Return area, centroid (y, z), and second moments (z^2, y^2, y z) about it, of all cells.

    They are in m2, m and m4.
    """
    area, centroid, own = quad_moments(cells)
    middle = area @ centroid / area.sum()
    y, z = (centroid - middle).T
    return area.sum(), middle, own.sum(0) + area @ np.stack([z * z, y * y, y * z], -1)


def _edge_distances(cells):
    """Return the largest distances along y and z of any corner from the centroid, [2], m."""
    corners = np.concatenate([cell.corners for cell in cells])
    return np.abs(corners - _area_and_inertia(cells)[1]).max(axis=0)


def _make_section(data, law, size):
    """Return the fibre `Section` of a `ProfileData`, its centroid at the origin.

    `size` is the largest side of a fibre, m; None for an eighth of height or width. Raise
    ValueError unless it is positive and finite.
    """
    if size is None:
        size = max(data.h, data.b) / 8
    elif not 0 < size < np.inf:
        raise ValueError(f"size = {size}: must be positive and finite")
    numbers = data.h, data.b, data.tw, data.tf, data.r, data.r2
    cells = _section_cells(data.shape, *numbers, float(size))
    area, centroid, own = quad_moments(cells)
    middle = area @ centroid / area.sum()
    y, z = (centroid - middle).T
    points = np.concatenate([cell.corners for cell in cells]) - middle
    corners = np.arange(4 * len(cells)).reshape(-1, 4)
    torsion = np.array([_torsion_constant(data.shape, *numbers)])
    return Section(y, z, area, law, None, torsion, points, corners, own)
