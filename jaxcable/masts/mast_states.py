"""States of a mast: wind over the height, its gusts, ice; after EN 1993-3-1 and TIA-222."""

from __future__ import annotations

from typing import Literal

import jax.numpy as jnp
import numpy as np

from ..common import checks
from ..common.rules import not_negative
from ..common.tree import pytree, set_fields
from ..common.types import Array, ArrayLike, Float
from ..loads import EurocodeWind, LineLoads, NodalLoads, WindLoads, WindPowerLaw
from ..loads.ice import warn_of_thick_ice
from ..loads.load import Load
from ..loads.masses import STANDARD_GRAVITY
from ..loads.wind_profiles import WindProfile
from .guyed_mast import GuyedMast
from .mast_components import keep_rule

PEAK_FACTOR = 3.5
"""Factor k_s of EN 1993-3-1, B.4.3.2.3; ``1 + 2 k_s I_v`` is then that of EN 1991-1-4."""

EXPOSURES = {"B": (7.0, 365.76, 0.70), "C": (9.5, 274.32, 0.85), "D": (11.5, 213.36, 1.03)}
"""Of TIA-222-G, Table 2-4: exponent alpha, gradient height z_g, m, and least K_z."""

_GREATEST_COEFFICIENT = 2.01  # K_z at the gradient height, TIA-222-G, 2.6.5.2
_PLACES, _WEIGHTS = np.polynomial.legendre.leggauss(3)  # along an element
_PLACES, _WEIGHTS = 0.5 * (1 + _PLACES), 0.5 * _WEIGHTS


@pytree
class MastState:
    """What acts on a mast at one time, from any direction: wind over the height, ice, factors.

    `eurocode_state` and `tia_state` make one after a standard.

    Args:
        wind: profile of the velocity pressure over the height above the base; with `gust` that of
            the mean wind.
        gust: profile of the peak pressure, which acts on patches of the mast, one after another,
            while the mean pressure acts on the rest; None: there are no patches.
        patch_factor: of the difference of both on patches: k_s / 3.5 of EN 1993-3-1.
        wind_factor: partial and combination factor of the wind.
        ice: thickness of ice around all members 10 m above the base, m.
        ice_exponent: it grows with this power of the height, up to `most_ice` times.
        most_ice: largest thickness over that at 10 m.
        ice_density: kg/m3.
        weight_factor: partial factor of the weights of mast, guys and ancillaries; the guys were
            tensioned under weights without it.
        temperature: above that of calm air, when guys were tensioned, K; None: the same.

    Raises:
        ValueError: negative numbers, or no profile.

    Example:
        >>> state = jc.masts.MastState(jc.WindTable(pressures=500.0), ice=0.01)
        >>> print(state.ice_at(40.0))
        0.01
    """

    wind: WindProfile
    gust: WindProfile | None = None
    patch_factor: Float[ArrayLike, ""] = 1.0
    wind_factor: Float[ArrayLike, ""] = 1.0
    ice: Float[ArrayLike, ""] = 0.0
    ice_exponent: Float[ArrayLike, ""] = 0.0
    most_ice: Float[ArrayLike, ""] = 1.4
    ice_density: Float[ArrayLike, ""] = 900.0
    weight_factor: Float[ArrayLike, ""] = 1.0
    temperature: Float[ArrayLike, ""] | None = None

    def __post_init__(self):
        for name in ("wind", "gust"):
            own = getattr(self, name)
            if not isinstance(own, WindProfile) and (own is not None or name == "wind"):
                got = checks.describe_type(own, 'EurocodeWind(25.0, "II")')
                raise ValueError(f"{name}: expected a wind profile, got {got}")
        for name in self._data_fields[2:]:
            if getattr(self, name) is not None:
                set_fields(self, **{name: checks.as_scalar(getattr(self, name), name)})
        keep_rule(self, not_negative, self._data_fields[2:-1])
        warn_of_thick_ice(self.ice)

    def ice_at(self, height: Float[ArrayLike, "*n"]) -> Float[Array, "*n"]:
        """Return the thickness of the ice at heights above the base, m, in their shape."""
        xp = checks.numpy_or_jax(self, height)
        return self.ice * xp.minimum((height / 10.0) ** self.ice_exponent, self.most_ice)

    def loads(
        self,
        mast: GuyedMast,
        direction: Float[ArrayLike, ""],
        pattern: Float[ArrayLike, " n_element"],
        shares: Float[ArrayLike, " n_guy"],
    ) -> list[Load]:
        """Return what acts on a mast beside its weight, a list of loads.

        Args:
            mast: `GuyedMast`.
            direction: towards which the wind blows, degrees from x to y.
            pattern: 1 on elements in the patch, else 0, [n_element].
            shares: of each guy in the patch, [n_guy].
        """
        angle = jnp.radians(jnp.asarray(direction))
        towards = jnp.stack([jnp.cos(angle), jnp.sin(angle), jnp.zeros_like(angle)])
        down = jnp.asarray([0.0, 0.0, -1.0])
        heights, own = mast.node_heights(), mast.layout
        low, high = heights[:-1], heights[1:]
        middle, number = 0.5 * (low + high), np.array(own.sections)
        pressure = self._pressure(
            low[:, None] + (high - low)[:, None] * _PLACES[None], pattern[:, None]
        )
        pressure, thickness = pressure @ jnp.asarray(_WEIGHTS), self.ice_at(middle)
        more = self.weight_factor - 1
        found: list[Load] = []
        for k, part in enumerate(mast.sections):
            here = np.flatnonzero(number == k)
            t = thickness[here]
            blown = self.wind_factor * pressure[here] * (part.drag_area + t * part.ice_width)
            weight = self._ice_weight(t, part.ice_diameter) * part.ice_length + more * part.weight
            forces = blown[:, None] * towards[None] + weight[:, None] * down[None]
            found.append(LineLoads(forces, on=f"section {k + 1:02d}"))
        found += self._loads_on_guys(mast, towards, shares, more)
        if mast.ancillaries:
            at = mast.ancillary_nodes()
            below = pattern[np.maximum(np.array(own.ancillaries) - 1, 0)]
            q = self.wind_factor * self._pressure(heights[np.array(own.ancillaries)], below)
            for k, one in enumerate(mast.ancillaries):
                iced = jnp.where(self.ice > 0, 1.0, 0.0)
                area = one.drag_area + iced * (one.iced_drag_area - one.drag_area)
                weight = more * one.weight + iced * (one.iced_weight - one.weight)
                found.append(NodalLoads([at[k]], (q[k] * area * towards + weight * down)[None]))
        return found

    def _loads_on_guys(self, mast, towards, shares, more):
        """Return wind, ice and `more` times the weight on the guys, a list of loads."""
        thickness = self.ice_at(0.5 * (mast.of_guys("anchor_height") + mast.of_guys("height")))
        diameter, weight = mast.of_guys("diameter"), mast.of_guys("weight")
        gusts = 0.0 if self.gust is None else self.patch_factor * shares
        profiles = [(self.wind, 1 - gusts)] + [(self.gust, gusts)] * (self.gust is not None)
        down = jnp.asarray([[0.0, 0.0, -1.0]])
        dead = self._ice_weight(thickness, diameter) + more * weight
        found: list[Load] = [LineLoads(dead[:, None] * down, on="guys")]
        for profile, factor in profiles:
            factor = jnp.broadcast_to(self.wind_factor * factor, shares.shape)
            own = mast.of_guys("drag"), diameter
            found.append(WindLoads(towards, profile, *own, on="guys", ice=thickness, factor=factor))
        return found

    def _pressure(self, heights, pattern):
        """Return the pressure at heights, N/m2, in their shape: with gusts where `pattern` is 1.

        There it is the mean pressure, plus `patch_factor` times the excess of the peak pressure.
        """
        mean = self.wind.pressure_at(heights)
        if self.gust is None:
            return mean
        return mean + self.patch_factor * pattern * (self.gust.pressure_at(heights) - mean)

    def _ice_weight(self, thickness, diameter):
        """Return the weight of ice around members, N/m."""
        return STANDARD_GRAVITY * self.ice_density * np.pi * thickness * (diameter + thickness)


def eurocode_state(
    velocity: Float[ArrayLike, ""],
    terrain: Literal["0", "I", "II", "III", "IV"] = "II",
    *,
    scaling: Float[ArrayLike, ""] = PEAK_FACTOR,
    **others: Float[ArrayLike, ""],
) -> MastState:
    """Return a state after EN 1993-3-1, Annex B, with the wind of EN 1991-1-4.

    - B.4.3.2.2: the mean wind acts everywhere, ``q_p / (1 + 7 I_v)``, that of the mean velocity.
    - B.4.3.2.3: patch loads in addition, ``2 k_s I_v`` times the mean, on each span between guy
      levels and from the base, on the cantilever, and from the middle of a span to that of the next
      one; on guys by the share of their height within the patch.
    - B.4.3.2.5: effects are ``S_M +- sqrt(sum (S_i - S_M)^2)``, which `extremes` returns.

    The text of the annex was not at hand when this was written, but for B.4.3.2.5 (in Dlubal's
    FAQ 3104): compare clauses and k_s with your copy and National Annex. Ice is even over the
    height; ISO 12494 has its thickness and the wind that goes with it.

    Args:
        velocity: basic wind velocity, m/s.
        terrain: terrain category of EN 1991-1-4.

    Options:
        scaling: k_s.
        others: further arguments of `MastState`: `wind_factor`, `ice`, `weight_factor`.

    Returns:
        `MastState`.

    Example:
        >>> state = jc.masts.eurocode_state(25.0, "II", ice=0.02, wind_factor=0.5)
        >>> print([f"{p.pressure_at(40.0):.0f} N/m2" for p in (state.wind, state.gust)])
        ['630 N/m2', '1290 N/m2']
    """
    mean, peak = (EurocodeWind(velocity, terrain, kind) for kind in ("mean", "peak"))
    return MastState(mean, peak, scaling / PEAK_FACTOR, **others)


def tia_state(
    velocity: Float[ArrayLike, ""],
    exposure: Literal["B", "C", "D"] = "C",
    *,
    gust_factor: Float[ArrayLike, ""] = 0.85,
    directionality: Float[ArrayLike, ""] = 0.85,
    importance: Float[ArrayLike, ""] = 1.0,
    topography: Float[ArrayLike, ""] = 1.0,
    ice: Float[ArrayLike, ""] = 0.0,
    ice_factor: Float[ArrayLike, ""] = 2.0,
    **others: Float[ArrayLike, ""],
) -> MastState:
    """Return a state after TIA-222-G: a wind of 3 s over the height, ice that grows with it.

    - 2.6.5.2: ``K_z = 2.01 (z / z_g)^(2 / alpha)``, from the least K_z of the exposure to 2.01;
    - 2.6.9.6: ``q_z = 0.613 K_z K_zt K_d V^2 I``, N/m2; 2.6.7: times the gust effect factor;
    - 2.6.8: ice of the thickness ``2.0 t_i I K_iz K_zt^0.35``, ``K_iz = (z / 10 m)^0.10 <= 1.4``.

    The text was not at hand when this was written; K_z is that of ASCE 7-05, with alpha and z_g of
    its table 6-2; the least K_z of exposure B and the factor 2.0 were compared with excerpts.
    Revision H has winds and ice of other return periods (`ice_factor`), load factors to match, and
    the density of air by altitude. Pattern loading is not in it: give a `gust`, or factors of your
    own. The power law has the velocity at z_g of the pressure with all these factors.

    Args:
        velocity: basic wind speed, 3 s gust at 10 m in open country, m/s.
        exposure: exposure category.

    Options:
        gust_factor: G_h, 0.85 for guyed masts.
        directionality: K_d, 0.85 for lattice masts, 0.95 for tubes.
        importance: I.
        topography: K_zt.
        ice: design thickness t_i, m.
        ice_factor: of the thickness, 2.0 in revision G.
        others: further arguments of `MastState`: `wind_factor` (1.6 without ice), `weight_factor`.

    Returns:
        `MastState`.

    Raises:
        ValueError: an unknown exposure.

    Example:
        K_z is 1.0 at 33 ft in exposure C:

        >>> state = jc.masts.tia_state(40.0, "C", gust_factor=1.0, directionality=1.0)
        >>> print(f"{state.wind.pressure_at(10.06) / (0.613 * 40**2):.3f}")
        1.002
    """
    checks.require_one_of(exposure, "exposure", tuple(EXPOSURES))
    alpha, gradient, least = EXPOSURES[exposure]
    factor = _GREATEST_COEFFICIENT * gust_factor * directionality * importance * topography
    wind = WindPowerLaw(
        velocity * factor**0.5,
        exponent=1 / alpha,
        reference_height=gradient,
        lowest_height=gradient * (least / _GREATEST_COEFFICIENT) ** (alpha / 2),
        highest_height=gradient,
        density=2 * 0.613,
    )
    thick = ice * ice_factor * importance * topography**0.35
    return MastState(wind, ice=thick, ice_exponent=0.10, **others)
