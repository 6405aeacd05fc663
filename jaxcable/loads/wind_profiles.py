"""Wind profiles: the velocity pressure of the wind as a function of the height above ground."""

from __future__ import annotations

import abc
from typing import Any, Literal

import jax.numpy as jnp

from ..common import checks
from ..common.rules import Rule, not_negative, positive, refuse_if_broken
from ..common.tree import pytree, set_fields
from ..common.types import Array, ArrayLike, Float
from ..common.units import SI, Units

AIR_DENSITY = 1.25
"""Density of air, kg/m3, that EN 1991-1-4, 4.5(1), note 2, recommends."""

TERRAINS = {
    "0": (0.003, 1.0),
    "I": (0.01, 1.0),
    "II": (0.05, 2.0),
    "III": (0.3, 5.0),
    "IV": (1.0, 10.0),
}
"""Roughness length and lowest height, m, of the terrain categories of EN 1991-1-4, Table 4.1."""

_PRESSURES = ("peak", "mean")
_REFERENCE_ROUGHNESS = 0.05  # of terrain category II, m


class WindProfile(abc.ABC):
    """Base of wind profiles: pytrees whose leaves are their numbers.

    A profile of your own derives from it, is decorated by `extend.pytree`, and writes
    `pressure_at`; `extend.register` lets files hold it. Numbers of loads of later phases are zero
    until then: it divides by none of them.
    """

    @abc.abstractmethod
    def pressure_at(self, height: Float[ArrayLike, "*n"]) -> Float[Array, "*n"]:
        """Return the velocity pressure, N/m2, at heights above ground, m, in their shape."""

    def rules(self) -> list[Rule]:
        """Return the rules that numbers of the profile must satisfy, a list; by default none."""
        return []

    def describe(self, units: Units = SI) -> str:
        """Return the profile in a few words, for people, with its numbers in `units`."""
        return type(self).__name__

    def __str__(self) -> str:
        return self.describe()


@pytree
class WindTable(WindProfile):
    """Wind profile by a table of heights, or a wind that is the same at all heights.

    The given values, velocities or velocity pressures, are interpolated linearly; above the last
    height and below the first one they are constant.

    Args:
        heights: heights above ground, [n], m, increasing; None for a constant wind.
        velocities: wind velocities, [n], m/s, with a pressure of ``density / 2 velocity**2``;
            without `heights` a scalar.
        pressures: velocity pressures, [n], N/m2, in place of velocities; without `heights` a
            scalar.
        density: density of air, kg/m3, which turns velocities into pressures; default 1.25.

    Raises:
        ValueError: both velocities and pressures, or neither; wrong shapes, negative values,
            heights that do not increase (traced ones end in INVALID_INPUT).

    Example:
        >>> wind = jc.WindTable([10.0, 50.0], velocities=[20.0, 28.0])
        >>> print(wind.pressure_at(jnp.array([5.0, 30.0, 80.0])))  # N/m2; 24 m/s at 30 m
        [250. 360. 490.]
        >>> print(jc.WindTable(pressures=500.0).pressure_at(30.0))
        500.0
    """

    heights: Float[ArrayLike, " n_height"] | None = None
    velocities: Float[ArrayLike, ""] | Float[ArrayLike, " n_height"] | None = None
    pressures: Float[ArrayLike, ""] | Float[ArrayLike, " n_height"] | None = None
    density: Float[ArrayLike, ""] = AIR_DENSITY

    def __post_init__(self):
        if (self.velocities is None) == (self.pressures is None):
            raise ValueError(
                "velocities, pressures: give one of them, such as WindTable([10.0, 50.0], "
                "velocities=[20.0, 28.0])"
            )
        shape: tuple[int, ...] = ()
        if self.heights is not None:
            heights = checks.as_floats(self.heights, "heights")
            if heights.ndim != 1 or not len(heights):
                raise ValueError(f"heights: expected shape [n], got {heights.shape}")
            shape = heights.shape
            set_fields(self, heights=heights)
        for name in ("velocities", "pressures"):
            if getattr(self, name) is not None:
                value = getattr(self, name)
                value = (
                    checks.floats_of_shape(value, name, shape)
                    if shape
                    else checks.as_scalar(value, name)
                )
                set_fields(self, **{name: value})
        set_fields(self, density=checks.as_scalar(self.density, "density"))
        refuse_if_broken(self.rules())

    def rules(self) -> list[Rule]:
        """Return the rules of the table: heights increase, values are not negative."""
        return [
            Rule("heights", self.heights, _does_not_increase, _describe_not_increasing),
            not_negative("velocities", self.velocities),
            not_negative("pressures", self.pressures),
            positive("density", self.density),
        ]

    def pressure_at(self, height: Float[ArrayLike, "*n"]) -> Float[Array, "*n"]:
        """Return the velocity pressure, N/m2, at heights above ground, m, in their shape."""
        if self.velocities is None:
            return self._interpolate(self.pressures, jnp.asarray(height))
        return 0.5 * self.density * self._interpolate(self.velocities, jnp.asarray(height)) ** 2

    def _interpolate(self, values, height):
        """Interpolate `values` of the table, [n_height] or a scalar, linearly at heights, m.

        Above the last and below the first height they are constant; the result has the
        shape of `height`.
        """
        if self.heights is None:
            return jnp.broadcast_to(values, height.shape)
        rise = self.heights[1:] - self.heights[:-1]
        rise = jnp.where(rise > 0, rise, 1.0)  # heights of later phases are all zero
        # no index is looked up: its derivative would scatter, which ends a fused program
        first, rise, step = (
            x.reshape((1,) * height.ndim + (-1,))
            for x in (self.heights[:-1], rise, values[1:] - values[:-1])
        )
        passed = jnp.clip((height[..., None] - first) / rise, 0.0, 1.0)
        return values[0] + jnp.sum(step * passed, axis=-1)

    def describe(self, units: Units = SI) -> str:
        """Return a text for reports: the number of heights of the table."""
        return f"wind table of {1 if self.heights is None else len(self.heights)} heights"


@pytree
class WindPowerLaw(WindProfile):
    """Wind profile by a power law: the velocity ``velocity (height / reference_height)**exponent``.

    Args:
        velocity: wind velocity at the reference height, m/s.
        exponent: exponent of the velocity, without unit; that of the pressure is twice as large.
        reference_height: height above ground, m; default 10.
        lowest_height: height, m, below which the velocity is constant; default 0. At height zero
            the velocity is zero, and has no derivative by the height.
        density: density of air, kg/m3; default 1.25.
        highest_height: height, m, above which the velocity is constant (gradient height of ASCE 7
            and TIA-222); default None, there is none.

    Raises:
        ValueError: wrong shapes, negative velocity, exponent or lowest height, a reference height,
            highest height or density that is not positive (traced ones end in INVALID_INPUT).

    Source: Davenport, Proc. ICE 19 (1961).

    Example:
        >>> wind = jc.WindPowerLaw(velocity=20.0, exponent=0.25)
        >>> print(wind.pressure_at(jnp.array([10.0, 40.0])))  # N/m2
        [250. 500.]
    """

    velocity: Float[ArrayLike, ""]
    exponent: Float[ArrayLike, ""]
    reference_height: Float[ArrayLike, ""] = 10.0
    lowest_height: Float[ArrayLike, ""] = 0.0
    density: Float[ArrayLike, ""] = AIR_DENSITY
    highest_height: Float[ArrayLike, ""] | None = None

    def __post_init__(self):
        _convert_to_scalars(self)
        refuse_if_broken(self.rules())

    def rules(self) -> list[Rule]:
        """Return the rules of the law: lengths and density are positive, others not negative."""
        return [
            not_negative("velocity", self.velocity),
            not_negative("exponent", self.exponent),
            positive("reference_height", self.reference_height),
            not_negative("lowest_height", self.lowest_height),
            positive("density", self.density),
            positive("highest_height", self.highest_height),
        ]

    def pressure_at(self, height: Float[ArrayLike, "*n"]) -> Float[Array, "*n"]:
        """Return the velocity pressure, N/m2, at heights above ground, m, in their shape."""
        height = jnp.maximum(height, self.lowest_height)
        if self.highest_height is not None:
            # where all numbers are still zero there is no highest height
            most = jnp.where(self.highest_height > 0, self.highest_height, jnp.inf)
            height = jnp.minimum(height, most)
        blown = (height > 0) & (self.reference_height > 0)
        ratio = jnp.where(blown, height, 1.0) / jnp.where(blown, self.reference_height, 1.0)
        pressure = 0.5 * self.density * self.velocity**2
        return jnp.where(blown, pressure * ratio ** (2 * self.exponent), 0.0)

    def describe(self, units: Units = SI) -> str:
        """Return the law and its velocity at the reference height, in `units`, as text."""
        velocity = _describe_number("of", self.velocity, "m/s", units)
        return f"power law{velocity}{_describe_number('at', self.reference_height, 'm', units)}"


@pytree(static=("terrain", "pressure"))
class EurocodeWind(WindProfile):
    """Wind profile of EN 1991-1-4: logarithmic mean velocity, and peak pressure by turbulence.

    With the height z, not less than the lowest height of the terrain:

    - roughness factor ``c_r = k_r ln(z / z_0)`` (4.4), with ``k_r = 0.19 (z_0 / 0.05 m)**0.07``
      (4.5);
    - mean velocity ``v_m = c_r c_o v_b`` (4.3);
    - turbulence intensity ``I_v = k_I / (c_o ln(z / z_0))`` (4.7);
    - peak velocity pressure ``q_p = (1 + 7 I_v) density / 2 v_m**2`` (4.8).

    The standard has these up to 200 m; national annexes may have others. It has the factor of the
    structure ``c_s c_d`` beside them, which is none of the profile: see `factor` of `WindLoads`.

    Args:
        velocity: basic wind velocity v_b, with the factors of direction and season, m/s.
        terrain: terrain category, "0", "I", "II", "III" or "IV" (Table 4.1); None where
            `roughness_length` and `lowest_height` are given.
        pressure: "peak", the peak velocity pressure (default), or "mean", that of the mean
            velocity, ``density / 2 v_m**2``, for methods that have gust factors of their own.
        orography: orography factor c_o, without unit, the same at all heights; default 1.
        turbulence: turbulence factor k_I, without unit; default 1.
        roughness_length: roughness length z_0, m, in place of a category.
        lowest_height: height z_min, m, below which the pressure is constant, in place of a
            category; it must be above the roughness length.
        density: density of air, kg/m3; default 1.25.

    Raises:
        ValueError: an unknown `terrain` or `pressure`; both a category and a roughness length or
            lowest height, or neither; wrong shapes or numbers that the standard does not allow
            (traced ones end in INVALID_INPUT).

    Source: EN 1991-1-4:2005, 4.2 to 4.5.

    Example:
        26 m/s over suburban terrain, at a height of 8 m (Steel Buildings in Europe, Single-Storey
        Steel Buildings, Part 3: Actions, Appendix B, has 659 N/m2 with rounded factors):

        >>> wind = jc.EurocodeWind(26.0, "III")
        >>> print(f"{wind.pressure_at(8.0):.0f} N/m2")
        662 N/m2
    """

    velocity: Float[ArrayLike, ""]
    terrain: Literal["0", "I", "II", "III", "IV"] | None = None
    pressure: Literal["peak", "mean"] = "peak"
    orography: Float[ArrayLike, ""] = 1.0
    turbulence: Float[ArrayLike, ""] = 1.0
    roughness_length: Float[ArrayLike, ""] | None = None
    lowest_height: Float[ArrayLike, ""] | None = None
    density: Float[ArrayLike, ""] = AIR_DENSITY

    def __post_init__(self):
        checks.require_one_of(self.pressure, "pressure", _PRESSURES)
        own = [x for x in (self.roughness_length, self.lowest_height) if x is not None]
        if self.terrain is not None:
            checks.require_one_of(self.terrain, "terrain", tuple(TERRAINS))
        if len(own) != (2 if self.terrain is None else 0):
            raise ValueError(
                'terrain: give a category such as "II", or both roughness_length and '
                "lowest_height in its place"
            )
        _convert_to_scalars(self)
        refuse_if_broken(self.rules())

    def rules(self) -> list[Rule]:
        """Return the rules of the law, a list of `Rule`.

        The lowest height is above the roughness length. Velocity and turbulence are not negative;
        orography, roughness length and density are positive.
        """
        return [
            not_negative("velocity", self.velocity),
            positive("orography", self.orography),
            not_negative("turbulence", self.turbulence),
            positive("roughness_length", self.roughness_length),
            *self._rule_of_lowest_height(),
            positive("density", self.density),
        ]

    def _rule_of_lowest_height(self):
        """Return the rule that ``ln(z / z_0)`` is positive at all heights, a list."""
        if self.lowest_height is None or self.roughness_length is None:
            return []
        values = self.lowest_height, self.roughness_length
        return [Rule("lowest_height", values, lambda v, z: v <= z, "must exceed roughness_length")]

    def pressure_at(self, height: Float[ArrayLike, "*n"]) -> Float[Array, "*n"]:
        """Return the velocity pressure, N/m2, at heights above ground, m, in their shape."""
        roughness: Any = self.roughness_length
        lowest: Any = self.lowest_height
        if self.terrain is not None:
            roughness, lowest = TERRAINS[self.terrain]
        roughness = jnp.where(jnp.asarray(roughness) > 0, roughness, 1.0)
        height = jnp.maximum(height, lowest)
        height = jnp.where(height > 0, height, roughness)  # where all numbers are still zero
        factor = 0.19 * (roughness / _REFERENCE_ROUGHNESS) ** 0.07
        sheltered = self.orography * jnp.log(height / roughness)  # c_r c_o over k_r
        square = sheltered**2
        if self.pressure == "peak":
            # (1 + 7 I_v) v_m^2 without a division: I_v = k_I / (c_o ln(z / z_0))
            square = square + 7.0 * self.turbulence * sheltered
        return 0.5 * self.density * (factor * self.velocity) ** 2 * square

    def describe(self, units: Units = SI) -> str:
        """Return the standard, its basic velocity, in `units`, and the terrain as text."""
        told = _describe_number("of", self.velocity, "m/s", units)
        where = "" if self.terrain is None else f", terrain {self.terrain}"
        return f"EN 1991-1-4{told}{where}, {self.pressure} pressure"


def _describe_number(word, number, unit, units):
    """Return a number in `units` after a word and a space; nothing if it is not known."""
    number = checks.array_if_known(number)
    known = number is not None and not number.ndim
    return f" {word} {units.text(number, unit)}" if known else ""


def _convert_to_scalars(profile):
    """Convert all fields of a profile that are numbers to floats without axes, or raise."""
    for name in profile._data_fields:
        if getattr(profile, name) is not None:
            set_fields(profile, **{name: checks.as_scalar(getattr(profile, name), name)})


def _does_not_increase(heights):
    """Return where a height is not above the one before, [n - 1] bool, for heights [n]."""
    return heights[1:] <= heights[:-1]


def _describe_not_increasing(index, heights):
    """Return the error message for heights that do not increase at `index`, a tuple."""
    k = index[0] + 1
    return f"heights[{k}] = {heights[k]}: must be above heights[{k - 1}] = {heights[k - 1]}"
