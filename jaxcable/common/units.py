"""Units of files and reports: names, exact factors, and units of quantities such as "N/m2".

Inside of the package every number is in SI units. A `Units` says in which units a file has its
numbers, or in which ones a report or a picture shows them. The factors are exact (international
yard and pound agreement of 1959: 1 lb = 0.45359237 kg, 1 in = 0.0254 m; standard gravity
9.80665 m/s2).
"""

from __future__ import annotations

import dataclasses
import difflib
import functools
import re
from collections.abc import Mapping
from fractions import Fraction
from typing import Any, TypeAlias, TypeVar

import numpy as np

from .types import ArrayLike, Float

_POUND, _GRAVITY = Fraction("0.45359237"), Fraction("9.80665")
_POUND_FORCE, _INCH = _POUND * _GRAVITY, Fraction("0.0254")

SYMBOLS: dict[str, dict[str, Fraction]] = {
    "force": {
        **{"N": Fraction(1), "daN": Fraction(10), "kN": Fraction(1000), "MN": Fraction(10**6)},
        **{"lbf": _POUND_FORCE, "kip": 1000 * _POUND_FORCE},
        **{"kgf": _GRAVITY, "tf": 1000 * _GRAVITY},
    },
    "length": {
        **{"m": Fraction(1), "cm": Fraction(1, 100), "mm": Fraction(1, 1000)},
        **{"in": _INCH, "ft": 12 * _INCH},
    },
    "temperature": {"K": Fraction(1), "C": Fraction(1), "F": Fraction(5, 9)},
    "mass": {"kg": Fraction(1), "t": Fraction(1000), "lb": _POUND},
}
"""Names of units by quantity, and each in N, m, K (differences of temperatures) or kg."""

_KINDS = {"N": "force", "m": "length", "K": "temperature", "kg": "mass"}
"""The quantity of each base unit that has several units; s and rad have no other."""

_BASES = {base: {base: 1} for base in ("N", "m", "kg", "K", "s", "rad")}
_BASES |= {"Pa": {"N": 1, "m": -2}, "J": {"N": 1, "m": 1}}
"""Units of which those of quantities are products, by their powers of base units."""

_WITHOUT_UNIT = ("", "-", "%")
_SMALL_LENGTHS = {"m": "mm", "cm": "mm", "mm": "mm", "ft": "in", "in": "in"}
"""Lengths in which texts give displacements."""
_STRESSES = {
    **{"kip": ("kip/in2", "kip", "in"), "lbf": ("lbf/in2", "lbf", "in")},
    **dict.fromkeys(("kgf", "tf"), ("kgf/cm2", "kgf", "cm")),
}
"""Stresses in texts by the unit of force: name, force and length; otherwise MPa."""

_Number = TypeVar("_Number", bound=Any)


@dataclasses.dataclass(frozen=True)
class Units:
    """Units of a file or of a report: one for forces, one for lengths, one for temperatures.

    Arguments ``units=`` of functions take such an object, a text such as ``"kN, m"`` or
    ``"kip, ft, F"`` in any order, or a dict ``{"force": "kN", "length": "m"}``. All other units are
    products of these: stresses of ``"kN, m"`` are in kN/m2, spring stiffnesses in kN m/rad. Times
    are in seconds and angles in radians.

    Attributes:
        force: "N", "daN", "kN", "MN", "lbf", "kip", "kgf" or "tf".
        length: "m", "cm", "mm", "in" or "ft".
        temperature: of differences: "K", "C" (the same), or "F", 5/9 K; None if not stated, which
            means K where lengths are metric, and is refused in files where they are not.
        mass: "kg", "t" or "lb"; None if not stated: reports then have kg, or lb where lengths are
            not metric, files that are written state this unit where they have masses, and files
            that are read are refused if they have some.

    Example:
        >>> units = jc.files.Units("kip", "ft")
        >>> print(units, units.name("N/m2"), float(units.factor("N")))
        kip, ft kip/ft2 4448.2216152605
        >>> print(units.text(1000.0, "N m", ".4g"))
        0.7376 kip ft
    """

    force: str = "N"
    length: str = "m"
    temperature: str | None = None
    mass: str | None = None

    def __post_init__(self):
        for kind in SYMBOLS:
            name = getattr(self, kind)
            if name is not None or kind in ("force", "length"):
                object.__setattr__(self, kind, _known_symbol(name, kind))

    def __str__(self) -> str:
        return ", ".join(filter(None, (self.force, self.length, self.temperature, self.mass)))

    @property
    def is_metric(self) -> bool:
        """Whether the lengths are metric."""
        return self.length not in ("in", "ft")

    @property
    def is_si(self) -> bool:
        """Whether forces, lengths and temperatures are in N, m and K."""
        return all(self.factor(base) == 1 for base in ("N", "m", "K"))

    def symbol(self, base: str) -> str:
        """Return the unit that replaces a base unit "N", "m", "K" or "kg"; other base units stay.

        If no unit of temperature or mass is stated it is K; kg, or lb with lengths in ft or in.
        """
        kind = _KINDS.get(base)
        stated = base if kind is None else getattr(self, kind)
        if stated is None:
            return base if base == "K" or self.is_metric else "lb"
        return stated

    def factor(self, unit: str) -> Fraction:
        """Return the factor from numbers in these units to the SI unit of a quantity.

        Args:
            unit: the SI unit, such as "N/m2"; "", "-" or "%" for numbers without one.

        Raises:
            ValueError: it is no product of N, Pa, J, m, kg, s, K and rad.
        """
        factor = Fraction(1)
        for base, power in dimensions(unit).items():
            if base in _KINDS:
                factor *= SYMBOLS[_KINDS[base]][self.symbol(base)] ** power
        return factor

    def name(self, unit: str) -> str:
        """Return the name of a quantity's unit in these units: "kip/ft2" for the SI unit "N/m2"."""
        powers = dimensions(unit)
        if all(self.symbol(base) == base for base in powers):
            return unit
        sizes = {base: "" if abs(p) == 1 else str(abs(p)) for base, p in powers.items()}
        above = [self.symbol(base) + size for base, size in sizes.items() if powers[base] > 0]
        below = [self.symbol(base) + size for base, size in sizes.items() if powers[base] < 0]
        return "/".join([" ".join(above) or "1", *below])

    def from_si(self, values: _Number, unit: str) -> _Number:
        """Return numbers of a quantity, given in the SI unit `unit`, in these units.

        Units that are no product of those of this module stay as they are.
        """
        return scale_exactly(values, 1 / self.factor(unit)) if is_unit(unit) else values

    def to_si(self, values: _Number, unit: str) -> _Number:
        """Return numbers of a quantity, given in these units, in the SI unit `unit`."""
        return scale_exactly(values, self.factor(unit))

    def shown(self, unit: str) -> str:
        """Return the name of an SI unit in these units, as `name`; a text that is no unit stays."""
        return self.name(unit) if is_unit(unit) else unit

    def text(self, value: float, unit: str, spec: str = ".6g") -> str:
        """Return a number, given in the SI unit `unit`, as text in these units, with their name.

        `spec` is the format of the number.
        """
        return f"{self.from_si(float(value), unit):{spec}} {self.shown(unit)}".rstrip(" -")

    @property
    def small_length(self) -> tuple[str, Fraction]:
        """Unit in which texts give displacements, mm or in, and the factor from `length` to it."""
        name = _SMALL_LENGTHS[self.length]
        return name, SYMBOLS["length"][self.length] / SYMBOLS["length"][name]

    @property
    def stress(self) -> tuple[str, Fraction]:
        """Unit of stresses in texts, and the factor from `force` over `length` squared to it."""
        name, force, length = _STRESSES.get(self.force, ("MPa", "N", "mm"))
        own = Units(force, length).factor("Pa")
        return name, self.factor("Pa") / own

    def as_dict(self) -> dict[str, str]:
        """Return the units as a scene file has them; the temperature is always stated."""
        stated = {"force": self.force, "length": self.length, "temperature": self.symbol("K")}
        return stated if self.mass is None else {**stated, "mass": self.mass}


UnitsLike: TypeAlias = "Units | str | Mapping[str, str]"
"""What arguments ``units=`` take."""


def as_units(given: UnitsLike, what: str = "units") -> Units:
    """Return the `Units` that a text such as "kN, m", a dict or a `Units` means.

    Raises:
        ValueError: unknown names, with the nearest ones; two units of one quantity; no force or no
            length. The message begins with `what`.
    """
    if isinstance(given, Units):
        return given
    if isinstance(given, str):
        stated = _parse_units(given, what)
    elif isinstance(given, Mapping):
        for kind, name in given.items():
            if kind not in SYMBOLS:
                near = difflib.get_close_matches(str(kind), SYMBOLS, n=1)
                hint = f"; did you mean {near[0]!r}?" if near else ""
                raise ValueError(
                    f"{what}: unknown key {kind!r}; known are {', '.join(SYMBOLS)}{hint}"
                )
            if not isinstance(name, str):
                raise ValueError(f"{what}.{kind}: expected a text, got {name!r:.40}")
        stated = dict(given)
    else:
        raise ValueError(f'{what}: expected a text such as "kN, m", got {given!r:.40}')
    for kind in ("force", "length"):
        if kind not in stated:
            hint = "; lb is a mass: did you mean lbf?" if stated.get("mass") == "lb" else ""
            raise ValueError(
                f"{what} = {given!r}: no unit of {kind}; give one of force and one of length, as "
                f'in "kN, m"{hint}'
            )
    try:
        return Units(**stated)
    except ValueError as error:
        raise ValueError(f"{what}.{error}") from None


def _parse_units(text, what):
    """Return {quantity: unit} for a text such as "kN, m"; raise ValueError for other texts.

    `what` begins the message.
    """
    stated: dict[str, str] = {}
    for word in filter(None, (part.strip() for part in re.split("[,;]", text))):
        word = word.removeprefix("°")
        kinds = [kind for kind, names in SYMBOLS.items() if word in names]
        if not kinds:
            raise ValueError(f"{what} = {text!r}: {_unknown_symbol_text(word)}")
        if kinds[0] in stated:
            raise ValueError(
                f"{what} = {text!r}: {stated[kinds[0]]} and {word} are both units of {kinds[0]}"
            )
        stated[kinds[0]] = word
    return stated


def _known_symbol(name, kind):
    """Return the name of a unit of the quantity `kind`, without a degree sign.

    Raise ValueError, with the nearest names, if it is no unit of this quantity.
    """
    name = name.removeprefix("°") if isinstance(name, str) else name
    if name in SYMBOLS[kind]:
        return name
    other = next((other for other, names in SYMBOLS.items() if name in names), None)
    if other is not None:
        known = ", ".join(SYMBOLS[kind])
        raise ValueError(f"{kind}: {name!r} is a unit of {other}; units of {kind} are {known}")
    raise ValueError(f"{kind}: {_unknown_symbol_text(str(name), SYMBOLS[kind])}")


def _unknown_symbol_text(word, names=None):
    """Return the message on an unknown unit `word`, with the nearest known `names`, or all."""
    known = list(names or (name for kind in SYMBOLS.values() for name in kind))
    if word in ("lb", "lbs", "pound", "pounds", "#"):
        return f"unknown unit {word!r}; did you mean 'lbf'?"
    if " " in word:
        return f"unknown unit {word!r}; separate units by commas, as in 'kN, m'"
    lower = {name.lower(): name for name in reversed(known)}
    near = difflib.get_close_matches(word.lower(), lower, n=3, cutoff=0.5)
    if near:
        return f"unknown unit {word!r}; did you mean {' or '.join(repr(lower[n]) for n in near)}?"
    return f"unknown unit {word!r}; known are {', '.join(known)}"


def is_unit(unit: str) -> bool:
    """Return whether a text is the SI unit of a quantity, such as "N/m2", or says that it has none.

    The text "" or "-" says this.
    """
    return _base_unit_powers(unit) is not None


@functools.cache
def _base_unit_powers(unit):
    """Return pairs (base unit, power) of the SI unit of a quantity; None for any other text."""
    if unit in _WITHOUT_UNIT:
        return ()
    above, *below = unit.split("/")
    terms = [] if above == "1" and below else [(term, 1) for term in above.split(" ")]
    powers: dict[str, int] = {}
    for term, sign in [*terms, *((term, -1) for term in below)]:
        base = term.rstrip("0123456789")
        digit = term[len(base) :] or "1"
        if base not in _BASES or len(digit) > 1:
            return None
        for own, power in _BASES[base].items():
            powers[own] = powers.get(own, 0) + sign * int(digit) * power
    return tuple((base, power) for base, power in powers.items() if power)


def dimensions(unit: str) -> dict[str, int]:
    """Return the powers of N, m, kg, s, K and rad in the unit of a quantity, a dict.

    Raises:
        ValueError: the text is no product of these, nor of Pa and J.

    Example:
        >>> from jaxcable.common.units import dimensions
        >>> dimensions("N m/rad"), dimensions("1/Pa"), dimensions("-")
        ({'N': 1, 'm': 1, 'rad': -1}, {'N': -1, 'm': 2}, {})
    """
    powers = _base_unit_powers(unit)
    if powers is None:
        raise ValueError(f"{unit!r}: no product of N, Pa, J, m, kg, s, K and rad")
    return dict(powers)


def scale_exactly(values: _Number, factor: Fraction) -> _Number:
    """Return numbers times an exact factor, with one rounding where that is possible.

    A factor such as 1/1000 becomes a division, so that 1500 mm are 1.5 m to the last digit.
    """
    if factor == 1:
        return values
    if factor.numerator == 1:
        return values / float(factor.denominator)
    return values * float(factor)


def convert_array(values: Float[ArrayLike, " ..."], factor: Fraction) -> Float[np.ndarray, " ..."]:
    """Return an array of numbers times an exact factor, in double precision."""
    return scale_exactly(np.asarray(values, float), factor)


SI = Units()
"""The units of all numbers inside of the package."""
