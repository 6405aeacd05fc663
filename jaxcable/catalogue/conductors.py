"""Conductors of overhead lines by name: layers with curves of first loading and of creep."""

from __future__ import annotations

import functools

import numpy as np

from ..common import checks
from ..common.rules import Rule, not_negative, positive, refuse_if_broken
from ..common.tree import pytree, set_fields
from ..common.types import Array, ArrayLike, Float
from ..files.reading import FileError
from ..loads.masses import STANDARD_GRAVITY
from .cables import cable
from .names import plain_name
from .tables import needed_value, package_rows, si_value, source_text

CONDUCTOR_COLUMNS = (
    *("name", "other_names", "construction", "area_mm2", "diameter_mm", "mass_kg_per_m"),
    *("breaking_force_kn", "temperature_c"),
    *(f"outer_{x}" for x in ("initial_psi", "creep_psi", "modulus_psi", "expansion_1e-6_per_k")),
    *(f"core_{x}" for x in ("initial_psi", "creep_psi", "modulus_psi", "expansion_1e-6_per_k")),
    "source",
)
_PSI = 6894.757293168  # Pa
_CURVES_END = 0.005  # strain up to which tests of conductors have measured the curves


@pytree
class Layer:
    """Strands of one material in a conductor: their stress-strain curves.

    Stresses are forces of the layer over the area of the *whole* conductor, so that those of all
    layers add. At first loading the stress is the polynomial ``sum_k initial[k] e**k`` of the
    strain e, beyond `limit` its tangent; unloading has the slope `modulus`.

    Args:
        initial: coefficients of the curve of first loading, [n], Pa, the constant first.
        modulus: slope of unloading, the final modulus, Pa.
        expansion: thermal expansion coefficient, 1/K.
        creep: coefficients of the stress that keeps a strain after ten years, [n], Pa, without
            unit; None for a layer that does not creep.
        limit: strain up to which the polynomials hold, without unit.

    Raises:
        ValueError: wrong shapes, or a modulus or limit that is not positive.

    Source: Aluminum Association, Stress-Strain-Creep Curves for Aluminum Overhead Electrical
        Conductors (1974).

    Example:
        >>> steel = jc.catalogue.conductor("Drake").layers[1]
        >>> print(f"final modulus over the whole area {steel.modulus / 1e9:.2f} GPa")
        final modulus over the whole area 25.51 GPa
    """

    initial: Float[ArrayLike, " n"]
    modulus: Float[ArrayLike, ""]
    expansion: Float[ArrayLike, ""]
    creep: Float[ArrayLike, " n"] | None = None
    limit: Float[ArrayLike, ""] = _CURVES_END

    def __post_init__(self):
        for name in ("initial", "creep"):
            if getattr(self, name) is not None:
                values = checks.as_floats(getattr(self, name), name)
                if values.ndim != 1 or len(values) < 2:
                    raise ValueError(f"{name}: expected shape [n] with n >= 2, got {values.shape}")
                set_fields(self, **{name: values})
        for name in ("modulus", "expansion", "limit"):
            set_fields(self, **{name: checks.as_scalar(getattr(self, name), name)})
        refuse_if_broken(self.rules())

    def rules(self) -> list[Rule]:
        """Return the rules that modulus and limit are positive, a list of `Rule`."""
        return [positive("modulus", self.modulus), positive("limit", self.limit)]


@pytree(static=("name", "source"))
class Conductor:
    """A conductor of an overhead line: size, weight, strength and the curves of its layers.

    Args:
        layers: `Layer` of each material, the core last.
        area: metallic area, m2.
        diameter: m.
        weight: weight per length, N/m.
        strength: rated strength, N.
        temperature: at which the curves were measured, degrees C.
        name: of the conductor.
        source: where the numbers are from.

    Raises:
        ValueError: no layers, wrong shapes, an area that is not positive, negative numbers.

    Example:
        >>> drake = jc.catalogue.conductor("Drake")
        >>> print(f"{1e6 * drake.area:.1f} mm2, {drake.weight:.2f} N/m, {len(drake.layers)} layers")
        468.6 mm2, 15.97 N/m, 2 layers
    """

    layers: tuple[Layer, ...]
    area: Float[ArrayLike, ""]
    diameter: Float[ArrayLike, ""]
    weight: Float[ArrayLike, ""]
    strength: Float[ArrayLike, ""]
    temperature: Float[ArrayLike, ""] = 20.0
    name: str = ""
    source: str = ""

    def __post_init__(self):
        if not self.layers or not all(isinstance(one, Layer) for one in self.layers):
            raise ValueError("layers: expected a list of Layer, the core last")
        set_fields(self, layers=tuple(self.layers))
        for name in ("area", "diameter", "weight", "strength", "temperature"):
            set_fields(self, **{name: checks.as_scalar(getattr(self, name), name)})
        refuse_if_broken(self.rules())

    def rules(self) -> list[Rule]:
        """Return the rules of the layers, and: area positive, others not negative; a list."""
        names = ("diameter", "weight", "strength")
        own = [not_negative(name, getattr(self, name)) for name in names]
        return [positive("area", self.area), *own, *(r for x in self.layers for r in x.rules())]

    @property
    def final_modulus(self) -> Float[Array, ""]:
        """Slope of stress over strain when all layers unload, Pa."""
        return sum(layer.modulus for layer in self.layers)


def conductor(name: str) -> Conductor:
    """Return a conductor of overhead lines by name, for `jc.lines`.

    "Drake" (ACSR) has curves of first loading and of ten years of creep. All other conductors of
    the tables (`cable_names`) have one layer, which is elastic: their final modulus and thermal
    expansion, without permanent stretch.

    Args:
        name: as in the tables; capitals, spaces and hyphens do not count.

    Returns:
        `Conductor`.

    Raises:
        ValueError: an unknown name, or a cable that is no conductor.

    Example:
        >>> one = jc.catalogue.conductor("Al/St 240/40")
        >>> print(one.name, f"{one.final_modulus / 1e9:.0f} GPa, {one.strength / 1e3:.1f} kN")
        243-AL1/39-ST1A 77 GPa, 85.1 kN
    """
    found = _conductors_by_name().get(plain_name(name))
    if found is not None:
        return found
    data = cable(name)
    if data.kind != "conductor":
        raise ValueError(f"name = {name!r}: is a {data.kind}, not a conductor")
    layer = Layer([0.0, data.modulus], data.modulus, data.expansion)
    numbers = data.area, data.diameter, data.weight, data.strength
    return Conductor((layer,), *numbers, name=data.name, source=data.source)


@functools.cache
def _conductors_by_name():
    """Read the conductors with curves: `Conductor` by `plain_name`, also of their other names."""
    found: dict[str, Conductor] = {}
    for row in package_rows("conductors.csv", CONDUCTOR_COLUMNS):
        names = [row.text("name"), *row.text("other_names").split(";")]
        one = _conductor_of_row(row)
        found |= {plain_name(name.strip()): one for name in names}
    return found


def _conductor_of_row(row) -> Conductor:
    """Return the `Conductor` of a `TableRow`, in SI units."""
    layers = [_layer_of_row(row, part) for part in ("outer", "core")]
    names = ("area_mm2", "diameter_mm", "mass_kg_per_m", "breaking_force_kn")
    area, diameter, mass, strength = (needed_value(row, name) for name in names)
    return Conductor(
        tuple(layer for layer in layers if layer is not None),
        *(area, diameter, mass * STANDARD_GRAVITY, strength, row.number("temperature_c")),
        name=row.text("name"),
        source=source_text(row.text("source")),
    )


def _layer_of_row(row, part: str) -> Layer | None:
    """Return the `Layer` of a part, "outer" or "core", of a `TableRow`; None if there is none."""
    if not row.text(f"{part}_initial_psi"):
        return None
    expansion = si_value(row, f"{part}_expansion_1e-6_per_k")
    if expansion is None:
        raise FileError(f"{row.place}: {part}_expansion: is empty")
    creep = row.text(f"{part}_creep_psi")
    return Layer(
        _coefficients(row.text(f"{part}_initial_psi")),
        100 * _PSI * row.number(f"{part}_modulus_psi"),
        expansion,
        _coefficients(creep) if creep else None,
    )


def _coefficients(words: str) -> np.ndarray:
    """Return coefficients in Pa, [n], from those in psi over powers of a strain in percent."""
    values = np.array([float(word) for word in words.split()])
    return _PSI * values * 100.0 ** np.arange(len(values))
