"""Ropes of any diameter, by the formulas of EN 1993-1-11 and EN 12385-4."""

from __future__ import annotations

import functools

import numpy as np

from ..common import checks
from ..loads.masses import STANDARD_GRAVITY
from .cables import UNIT_WEIGHT, CableData
from .names import plain_name
from .tables import ROPE_COLUMNS, needed_value, package_rows, source_text

_FILL_FACTORS = {
    "spiral strand": {1: 0.77, 2: 0.76, 3: 0.75, 4: 0.75, 5: 0.75, 6: 0.75, 7: 0.73},
    "full locked coil rope": {1: 0.81, 2: 0.84, 3: 0.88},
}
"""Metallic area over that of the circle, by number of layers; the last one also holds for more
(EN 1993-1-11, table 2.2)."""

_SPIRAL = {
    "spiral strand": ("spiral strand", 150e9, 12e-6),
    "stainless spiral strand": ("spiral strand", 130e9, 16e-6),
    "full locked coil rope": ("full locked coil rope", 160e9, 12e-6),
}
"""Fill factors, modulus for variable loads and thermal expansion (EN 1993-1-11, 3.2.2 and 3.3)."""


def rope(
    construction: str, diameter: float, *, layers: int | None = None, grade: float | None = None
) -> CableData:
    """Return the numbers of a rope of any diameter, by the formulas of standards.

    Use it where no table has the rope, as a first estimate: its `source` and `name` say so.

    - Spiral strands and full locked coil ropes follow EN 1993-1-11: the metallic area is the fill
      factor times that of the circle, and the weight 83 kN/m3 times this area. The modulus is the
      middle of a range of +-10 GPa. The breaking force depends on the strength of the wires and on
      the loss by spinning, which manufacturers state: it is unknown.
    - Stranded ropes follow EN 12385-4: area, mass and breaking force are factors times the square
      of the diameter.

    Args:
        construction: "spiral strand", "stainless spiral strand" or "full locked coil rope"; or
            classes with fibre or steel core: "6x7 FC", "6x7 IWRC", and 8x7, 6x19, 8x19, 6x36, 8x36.
        diameter: nominal, m.

    Options:
        layers: number of layers of wires about the core wire of a spiral strand, or of Z-shaped
            wires of a locked coil rope.
        grade: rope grade of a stranded rope, Pa; 1770e6, for example. Without it the breaking
            force is unknown.

    Returns:
        `CableData`.

    Raises:
        ValueError: an unknown construction, a diameter or grade that is not positive, `layers` or
            `grade` where it does not belong, or no `layers` where it does.

    Source: EN 1993-1-11:2006, tables 2.2 and 3.1; EN 12385-4, as in Feyrer, Wire Ropes (2015),
    table 1.9.

    Example:
        >>> strand = jc.catalogue.rope("spiral strand", 0.040, layers=4)
        >>> print(f"{strand.name}: {1e6 * strand.area:.0f} mm2")  # 0.75 pi d^2 / 4
        spiral strand of 40 mm by EN 1993-1-11: 942 mm2
        >>> rope = jc.catalogue.rope("6x36 IWRC", 0.020, grade=1770e6)
        >>> print(f"{rope.strength / 1e3:.0f} kN, {rope.mass:.2f} kg/m")  # 0.356 d^2 R_r
        252 kN, 1.64 kg/m
    """
    diameter = _positive_number(diameter, "diameter")
    if diameter > 1.0:
        raise ValueError(f"diameter = {diameter:g}: is in m; no rope is as thick")
    stranded = _stranded_ropes()
    named = {plain_name(one): one for one in (*_SPIRAL, *stranded)}
    known = named.get(plain_name(construction), construction)
    checks.require_one_of(known, "construction", list(named.values()))
    if known in _SPIRAL:
        if grade is not None:
            raise ValueError("grade: the formulas of a spiral strand give no breaking force")
        return _spiral_rope(known, diameter, layers)
    if layers is not None:
        raise ValueError("layers: are those of spiral strands and locked coil ropes")
    area_factor, mass_factor, force_factor, modulus = stranded[known]
    grade = None if grade is None else _positive_number(grade, "grade")
    if grade is not None and grade < 1e8:
        raise ValueError(f"grade = {grade:g}: is in Pa, such as 1770e6")
    area = area_factor * diameter**2
    return CableData(
        name=f"{known} rope of {1e3 * diameter:g} mm by EN 12385-4",
        kind="stranded rope",
        construction=known,
        diameter=diameter,
        area=area,
        axial_stiffness=modulus * area,
        weight=mass_factor * 1e4 * diameter**2 * STANDARD_GRAVITY,  # kg per 100 m and mm2
        strength=None if grade is None else force_factor * diameter**2 * grade,
        expansion=12e-6,
        modulus_state="after bedding-in",
        source=source_text("en-12385-4"),
    )


def _positive_number(value, name):
    """Return a number as float; ValueError, which names the argument, if it is not positive."""
    number = float(checks.as_scalar(value, name))
    if not number > 0:
        raise ValueError(f"{name} = {number:g}: must be positive")
    return number


def _spiral_rope(construction, diameter, layers):
    """Return the `CableData` of a spiral strand or a locked coil rope by EN 1993-1-11.

    `construction` is a key of `_SPIRAL`, `diameter` is in m. Raise ValueError unless `layers` is a
    whole number of at least 1.
    """
    kind, modulus, expansion = _SPIRAL[construction]
    checks.require_whole_number(layers, "layers")
    factors = _FILL_FACTORS[kind]
    area = factors[min(layers, max(factors))] * np.pi / 4 * diameter**2
    return CableData(
        name=f"{construction} of {1e3 * diameter:g} mm by EN 1993-1-11",
        kind=construction,
        construction=f"{layers} layers",
        diameter=diameter,
        area=area,
        axial_stiffness=modulus * area,
        weight=UNIT_WEIGHT * area,
        strength=None,
        expansion=expansion,
        modulus_state="after bedding-in",
        source=source_text("en-1993-1-11"),
    )


@functools.cache
def _stranded_ropes():
    """Read the factors of stranded ropes by construction: area, mass, force, and modulus (Pa)."""
    return {
        row.text("name"): (
            *(row.number(name) for name in ROPE_COLUMNS[1:4]),
            needed_value(row, "modulus_gpa"),
        )
        for row in package_rows("ropes.csv", ROPE_COLUMNS)
    }
