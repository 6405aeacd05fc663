"""Cables by name: strands, ropes, bars and conductors, with what `Cables` and `Catenaries` take."""

from __future__ import annotations

import dataclasses
import functools
from collections.abc import Iterator
from os import PathLike

from ..common import checks
from ..files.csv_tables import TableRow
from ..files.reading import FileError
from ..loads.masses import STANDARD_GRAVITY
from .names import plain_name, unknown_name_error
from .tables import CABLE_COLUMNS, needed_value, package_rows, read_rows, si_value, source_text

UNIT_WEIGHT = 83e3
"""Weight of spiral strands and locked coil ropes over their metallic area, with corrosion
protection, N/m3 (EN 1993-1-11, 2.3.1)."""

_NEEDED = ("name", "area_mm2", "breaking_force_kn")


@dataclasses.dataclass(frozen=True)
class CableData:
    """Numbers of a cable in SI units, with the arguments of elements.

    ``jc.Cables(links, **data)`` hands on `axial_stiffness`, `weight`, `strength` and `expansion`,
    those that are known; so do `Catenaries`, `Bars` and `SlidingCables`.

    Attributes:
        name: as in the table.
        kind: "spiral strand", "full locked coil rope", "prestressing strand", "bar", ...
        construction: in words.
        diameter: m; None for several strands together.
        area: metallic area, m2.
        axial_stiffness: EA, N.
        weight: self-weight, N/m, at the standard gravity 9.80665 m/s2.
        strength: minimum breaking force, N; of terminations nothing is subtracted. None if unknown.
        expansion: thermal expansion coefficient, 1/K.
        modulus_state: what the modulus holds for: "after bedding-in", "final" or "".
        source: where the numbers are from.

    Example:
        >>> data = jc.catalogue.cable("Galfan spiral strand 20")
        >>> print(f"EA {data.axial_stiffness / 1e6:.1f} MN, E {data.modulus / 1e9:.0f} GPa")
        EA 39.0 MN, E 160 GPa
        >>> cables = jc.Cables([[0, 1], [1, 2]], **data)
        >>> print(f"breaks at {cables.strength[0] / 1e3:.0f} kN, {cables.weight[0]:.1f} N/m")
        breaks at 408 kN, 20.3 N/m
    """

    name: str
    kind: str
    construction: str
    diameter: float | None
    area: float
    axial_stiffness: float
    weight: float
    strength: float | None
    expansion: float | None
    modulus_state: str
    source: str

    @property
    def modulus(self) -> float:
        """Young's modulus of the metallic area, Pa."""
        return self.axial_stiffness / self.area

    @property
    def mass(self) -> float:
        """Mass per length, kg/m."""
        return self.weight / STANDARD_GRAVITY

    def keys(self) -> Iterator[str]:
        """Yield the names of the arguments of elements that are known, for ``**data``."""
        for name in ("axial_stiffness", "weight", "strength", "expansion"):
            if getattr(self, name) is not None:
                yield name

    def __getitem__(self, name: str) -> float:
        if name not in self.keys():
            raise KeyError(name)
        return getattr(self, name)


def cable(name: str, *, count: int = 1) -> CableData:
    """Return the numbers of a cable of the tables, ready for elements.

    Among them are open spiral strands and full locked coil ropes (Galfan and stainless), 7-wire
    prestressing strands, threaded bars, and conductors of overhead lines (EN 50182, Drake).
    `cable_names` lists them; `rope` computes ropes of any diameter by the formulas of standards.

    The tables are for preliminary design: the certificate of the manufacturer replaces them (see
    `load`). Moduli are those after bedding-in, or final ones, where the source says so; new ropes
    that have not been prestretched are softer.

    Args:
        name: as in the table; capitals, spaces and hyphens do not count.

    Options:
        count: number of equal cables side by side, as of the strands of a tendon.

    Returns:
        `CableData`.

    Raises:
        ValueError: an unknown name, with the nearest ones; a count that is no whole number.

    Example:
        A stay of 15 strands, and a conductor by its former and by its present name:

        >>> stay = jc.catalogue.cable("Y1860S7 15.7", count=15)
        >>> print(f"{stay.name}: {1e6 * stay.area:.0f} mm2, {stay.strength / 1e6:.3f} MN")
        15 x Y1860S7 15.7: 2250 mm2, 4.185 MN
        >>> one, same = (jc.catalogue.cable(name) for name in ("Al/St 240/40", "243-AL1/39-ST1A"))
        >>> print(one == same, f"{one.weight:.2f} N/m")
        True 9.61 N/m
    """
    checks.require_whole_number(count, "count")
    table = _cables_by_name()
    plain = plain_name(name)
    if plain not in table:
        names = [other for row in _rows() for other in _all_names(row)]
        raise unknown_name_error(name, names, "catalogue.cable_names() lists all names")
    found = table[plain]
    if count == 1:
        return found
    return dataclasses.replace(
        found,
        name=f"{count} x {found.name}",
        diameter=None,
        area=count * found.area,
        axial_stiffness=count * found.axial_stiffness,
        weight=count * found.weight,
        strength=None if found.strength is None else count * found.strength,
    )


def cable_names(kind: str | None = None) -> list[str]:
    """List the names of cables in the tables, without their other names.

    Args:
        kind: "spiral strand", "stainless spiral strand", "full locked coil rope", "stainless full
            locked coil rope", "prestressing strand", "bar", "conductor"; None for all.

    Returns:
        List of names.

    Raises:
        ValueError: there is no such kind.

    Example:
        >>> jc.catalogue.cable_names("prestressing strand")[-2:]
        ['Y1860S7 15.3', 'Y1860S7 15.7']
    """
    if kind is not None:
        kinds = list(dict.fromkeys(row.text("kind") for row in _rows()))
        checks.require_one_of(kind, "kind", kinds)
    return [row.text("name") for row in _rows() if kind in (None, row.text("kind"))]


def load(path: str | PathLike[str]) -> dict[str, CableData]:
    """Load cables from a table of your own, as from the certificates of a manufacturer.

    The columns are those of the package's tables, with their units: ``name``, ``area_mm2`` and
    ``breaking_force_kN``; ``axial_stiffness_MN`` or ``modulus_GPa``; and, if you like,
    ``mass_kg_per_m``, ``expansion_1e-6_per_K``, ``diameter_mm``, ``kind``, ``construction``,
    ``modulus_state``, ``source``. Without a mass the weight is 83 kN/m3 times the area (EN
    1993-1-11). Other columns are left out, with a warning.

    Args:
        path: a ``.csv`` table, with commas or semicolons between fields; or a ``.json`` file with
            an object that has a list of rows: ``{"cables": [{"name": ..., "area_mm2": ...}]}``.

    Returns:
        Dict from name to `CableData`.

    Raises:
        OSError: there is no such file, or it cannot be read.
        FileError: wrong contents; names file and line.

    Example:
        >>> import pathlib, tempfile
        >>> path = pathlib.Path(tempfile.mkdtemp()) / "certificates.csv"
        >>> columns = "name,area_mm2,axial_stiffness_MN,mass_kg_per_m,breaking_force_kN"
        >>> _ = path.write_text(f"{columns}\\nridge cable,548,88.9,4.53,912\\n")
        >>> ridge = jc.catalogue.load(path)["ridge cable"]
        >>> print(jc.Cables([[0, 1]], **ridge).axial_stiffness)  # N
        [88900000.]
    """
    found = {}
    for row in read_rows(path, CABLE_COLUMNS, _NEEDED):
        data = _cable_from_row(row)
        if data.name in found:
            raise FileError(f"{row.place}: name {data.name!r} occurs twice")
        found[data.name] = data
    return found


@functools.cache
def _cables_by_name():
    """Read the package's cables: `CableData` by `plain_name`, also of their other names."""
    return {plain_name(name): _cable_from_row(row) for row in _rows() for name in _all_names(row)}


def _rows() -> tuple[TableRow, ...]:
    """Return the rows of the package's table of cables."""
    return package_rows("cables.csv", CABLE_COLUMNS)


def _all_names(row):
    """Return the name and the other names of the cable in a `TableRow`, a list."""
    others = row.text("other_names")
    return [row.text("name"), *(word.strip() for word in others.split(";") if word.strip())]


def _cable_from_row(row):
    """Return the `CableData` of a `TableRow`, whose columns are those of `load`, in SI units.

    Raise FileError, which names the row, for an empty or wrong field, and unless exactly one of
    stiffness and modulus is given.
    """
    if not row.text("name"):
        raise FileError(f"{row.place}: name: is empty")
    area, mass = needed_value(row, "area_mm2"), si_value(row, "mass_kg_per_m")
    stiffness, modulus = si_value(row, "axial_stiffness_mn"), si_value(row, "modulus_gpa")
    if (stiffness is None) == (modulus is None):
        raise FileError(f"{row.place}: give one of axial_stiffness_MN and modulus_GPa")
    return CableData(
        name=row.text("name"),
        kind=row.text("kind"),
        construction=row.text("construction"),
        diameter=si_value(row, "diameter_mm"),
        area=area,
        axial_stiffness=modulus * area if stiffness is None else stiffness,
        weight=UNIT_WEIGHT * area if mass is None else mass * STANDARD_GRAVITY,
        strength=si_value(row, "breaking_force_kn"),
        expansion=si_value(row, "expansion_1e-6_per_k"),
        modulus_state=row.text("modulus_state"),
        source=source_text(row.text("source")),
    )
