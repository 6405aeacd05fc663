"""Turbulent wind: spectra of its velocity, and its coherence between points."""

from __future__ import annotations

from typing import Any, Literal, get_args

import jax.numpy as jnp

from ..common import checks
from ..common.rules import Rule, not_negative, positive, refuse_if_broken
from ..common.tree import pytree, set_fields
from ..common.types import Array, ArrayLike, Float
from ..loads.wind_profiles import WindProfile
from ..numerics.rotations import cross
from ..numerics.scaled import safe_norm

Spectrum = Literal["Davenport", "Kaimal", "von Karman"]

_DAVENPORT_LENGTH = 1200.0  # m
_REFERENCE_HEIGHT = 10.0  # m, of the velocity in Davenport's spectrum


@pytree(static=("spectrum",))
class Turbulence:
    """Turbulence along the mean wind: a spectrum of its velocity, and coherence between points.

    With f the frequency, V the mean velocity, s the standard deviation and L the length scale:

    - "Davenport": ``f S / s^2 = 2/3 x^2 / (1 + x^2)^(4/3)``, ``x = f 1200 m / V(10 m)``;
    - "Kaimal": ``f S / s^2 = 6.8 x / (1 + 10.2 x)^(5/3)``, ``x = f L / V`` (EN 1991-1-4, B.1);
    - "von Karman": ``f S / s^2 = 4 x / (1 + 70.8 x^2)^(5/6)``, ``x = f L / V``.

    The coherence of two points is ``exp(-f r / V)``, with V the mean at both, and r the distance
    whose components along the wind, across and upwards are multiplied by `decay` (Davenport). There
    are no components across the wind.

    Args:
        profile: mean velocity over the height, as ``density / 2 V^2``: `WindPowerLaw`, `WindTable`,
            or ``EurocodeWind(..., pressure="mean")``.
        deviation: standard deviation of the velocity, m/s, the same everywhere; in EN 1991-1-4
            turbulence intensity times mean velocity.
        length_scale: L, m, for "Kaimal" and "von Karman".
        spectrum: "Davenport", "Kaimal" or "von Karman".
        direction: direction towards which the wind blows, [3], of any length; default along x.
        decay: decay of the coherence along, across, upwards, [3], without unit.
        ground: height of the ground, m, along `vertical`.
        vertical: direction upwards, [3], of any length, across the wind.

    Raises:
        ValueError: an unknown spectrum, a peak pressure as a profile, no length scale where one is
            needed, wrong shapes, numbers that are not positive (if traced, histories are NaN).

    Sources: Davenport, Quart. J. Roy. Met. Soc. 87 (1961); Kaimal et al., 98 (1972); Solari and
    Piccardo, Prob. Eng. Mech. 16 (2001), for the decay.

    Example:
        45 % of the energy of the wind at 20 m/s is in waves slower than 0.02 Hz:

        >>> steady = jc.WindTable(velocities=20.0)
        >>> wind = jc.dynamics.Turbulence(steady, 3.0, 150.0, spectrum="von Karman")
        >>> f = np.geomspace(1e-5, 0.02, 400)
        >>> part = np.trapezoid(wind.density(f, 20.0), f)
        >>> print(f"{part / 3.0**2:.2f}")
        0.45
    """

    profile: WindProfile
    deviation: Float[ArrayLike, ""]
    length_scale: Float[ArrayLike, ""] | None = None
    spectrum: Spectrum = "Kaimal"
    direction: Float[ArrayLike, " 3"] = (1.0, 0.0, 0.0)
    decay: Float[ArrayLike, " 3"] = (3.0, 10.0, 10.0)
    ground: Float[ArrayLike, ""] = 0.0
    vertical: Float[ArrayLike, " 3"] = (0.0, 0.0, 1.0)

    def __post_init__(self):
        checks.require_one_of(self.spectrum, "spectrum", get_args(Spectrum))
        if not isinstance(self.profile, WindProfile):
            kind = checks.describe_type(self.profile, "WindPowerLaw(20.0, 0.2)")
            raise ValueError(f"profile: expected a wind profile, got {kind}")
        if getattr(self.profile, "pressure", None) == "peak":
            raise ValueError(
                'profile: has peak pressures; give those of the mean velocity, pressure="mean"'
            )
        if self.length_scale is None and self.spectrum != "Davenport":
            raise ValueError(f'length_scale: missing, m; the spectrum "{self.spectrum}" needs it')
        for name in ("direction", "decay", "vertical"):
            set_fields(self, **{name: checks.floats_of_shape(getattr(self, name), name, (3,))})
        for name in ("deviation", "length_scale", "ground"):
            if getattr(self, name) is not None:
                set_fields(self, **{name: checks.as_scalar(getattr(self, name), name)})
        refuse_if_broken(self.rules())

    def rules(self) -> list[Rule]:
        """Return the rules of the numbers, a list of `Rule`.

        The length scale is positive; deviation and decay are not negative; directions are not zero.
        """
        text = "is zero; give the direction towards which the wind blows, such as (1, 0, 0)"
        return [
            not_negative("deviation", self.deviation),
            positive("length_scale", self.length_scale),
            not_negative("decay", self.decay),
            Rule("direction", self.direction, lambda v: (v == 0).all(), text),
            Rule("vertical", self.vertical, lambda v: (v == 0).all(), "is zero; it points upwards"),
        ]

    def velocity_at(self, points: Float[ArrayLike, "n 3"]) -> Float[Array, " n"]:
        """Return the mean velocity at points [n, 3], m: [n], m/s."""
        points = jnp.asarray(points)
        upwards = self._wind_axes()[2].astype(points.dtype)
        return self._mean_velocity(points @ upwards - self.ground)

    def density(
        self, frequency: Float[ArrayLike, ...], velocity: Float[ArrayLike, ...]
    ) -> Float[Array, ...]:
        """Return the one-sided spectral density of the velocity, m2/s, at frequencies, Hz.

        Its integral over all positive frequencies is the square of the deviation. `velocity` is the
        mean at the points, m/s, in a shape that goes with that of `frequency`. Where it is zero,
        such as on the ground, the density is zero.
        """
        frequency, velocity = jnp.broadcast_arrays(frequency, velocity)
        if self.spectrum == "Davenport":
            x = frequency * _DAVENPORT_LENGTH / self._mean_velocity(jnp.asarray(_REFERENCE_HEIGHT))
            share = 2 / 3 * x**2 / (1 + x**2) ** (4 / 3)
        else:
            x = frequency * self.length_scale * inverse_velocity(velocity)
            kaimal = self.spectrum == "Kaimal"
            share = (
                6.8 * x / (1 + 10.2 * x) ** (5 / 3)
                if kaimal
                else 4 * x / (1 + 70.8 * x**2) ** (5 / 6)
            )
        density = jnp.asarray(self.deviation) ** 2 * share / frequency
        return jnp.where(velocity > 0, density, 0.0)

    def decay_distances(self, points: Float[ArrayLike, "n 3"]) -> Float[Array, "n n"]:
        """Return the distances of all pairs of points, scaled by `decay`: r in ``exp(-f r / V)``.

        They are [n, n], m.
        """
        points = jnp.asarray(points)
        along = jnp.stack([points @ a.astype(points.dtype) for a in self._wind_axes()], axis=1)
        apart = (along[:, None] - along[None]) * jnp.asarray(self.decay)[None, None]
        return safe_norm(apart)

    def cross_spectrum(
        self,
        frequency: Float[Array, ""],
        velocity: Float[Array, " n"],
        distances: Float[Array, "n n"],
    ) -> Float[Array, "n n"]:
        """Return the cross-spectral density of the velocity at points, [n, n], m2/s.

        Args:
            frequency: scalar, Hz.
            velocity: mean velocity at the points, m/s.
            distances: as from `decay_distances`.
        """
        slowness = inverse_velocity(0.5 * (velocity[:, None] + velocity[None]))
        density = self.density(frequency, velocity)
        root = jnp.where(density > 0, jnp.sqrt(jnp.where(density > 0, density, 1.0)), 0.0)
        return root[:, None] * root[None] * jnp.exp(-frequency * distances * slowness)

    def _mean_velocity(self, height):
        """Return the mean velocity at heights above ground, m/s, in their shape."""
        profile: Any = self.profile
        pressure = profile.pressure_at(height)
        blown = pressure > 0
        velocity = jnp.sqrt(2 * jnp.where(blown, pressure, 1.0) / profile.density)
        return jnp.where(blown, velocity, 0.0)

    def _wind_axes(self):
        """Return unit vectors along the wind, across it and upwards, three arrays [3]."""
        wind, up = jnp.asarray(self.direction), jnp.asarray(self.vertical)
        wind, up = wind / jnp.sqrt(jnp.sum(wind**2)), up / jnp.sqrt(jnp.sum(up**2))
        return wind, cross(up, wind), up


def inverse_velocity(velocity: Float[Array, ...]) -> Float[Array, ...]:
    """Return the reciprocals of velocities, s/m; 0 where the velocity is zero."""
    blown = velocity > 0
    return jnp.where(blown, 1.0 / jnp.where(blown, velocity, 1.0), 0.0)
