"""A state of a line: temperature, ice, wind, a broken conductor, before or after stretch."""

from __future__ import annotations

from typing import Literal

import jax.numpy as jnp
import numpy as np

from ..common import checks
from ..common.rules import Rule, nan_if_broken, not_negative, refuse_if_broken
from ..common.tree import pytree, set_fields
from ..common.types import Array, ArrayLike, Float
from ..loads import IceLoads, LineLoads, SelfWeight, WindLoads, WindTable
from ..loads.ice import warn_of_thick_ice
from ..loads.load import Load
from ..loads.masses import STANDARD_GRAVITY
from .line_section import LineSection, unit

CONDITIONS = "initial", "final", "creep"
"""Which curves a conductor follows in a state: of first loading, after stretch, of creep."""

STRING_DRAG = 1.2
"""Drag coefficient of insulator strings, without unit (EN 50341-1, 4.4.2)."""

NUMBERS = ("temperature", "wind", "wind_direction", "drag", "extra", "ice_density")
"""Fields of a state that have one number."""


def _span_index(value):
    """Return the index of a broken span as an int; ValueError if it is no whole number, or < 0."""
    whole = isinstance(value, int | float | np.number) and not isinstance(value, bool)
    if not whole or value % 1 != 0 or value < 0:
        raise ValueError(f"broken = {value!r}: expected a whole number, the index of a span from 0")
    return int(value)


@pytree(static=("condition", "broken"))
class LineState:
    """What acts on a line at one time.

    Args:
        temperature: of the conductor, degrees C.
        ice: thickness of the ice around the conductor, scalar or, where it is uneven, [n_span], m.
        wind: velocity pressure, N/m2, the same at all heights.
        wind_direction: towards which it blows, degrees from the first span to the left: 90 blows
            across the line.
        drag: drag coefficient of the (iced) conductor and factor of spans, without unit.
        extra: load added to the resultant of weight, ice and wind, in its direction, N/m (the
            constant K of the NESC).
        ice_density: kg/m3; default 900. The NESC has 57 lb/ft3, 913.
        condition: "initial": the conductor follows its curves of first loading; "final": it has
            the permanent stretch that is stated for the analysis; "creep": it follows its curves of
            ten years, to find that stretch.
        broken: index of the span whose conductor is broken, from 0; None: none is.

    Raises:
        ValueError: wrong shapes, negative numbers, an unknown condition, a broken span that is no
            whole number or negative.

    Example:
        >>> heavy = jc.lines.LineState(-17.8, ice=0.0127, wind=191.5, extra=4.38, ice_density=913.0)
        >>> print(heavy.condition)
        initial
    """

    temperature: Float[ArrayLike, ""] = 15.0
    ice: Float[ArrayLike, ""] | Float[ArrayLike, " n_span"] = 0.0
    wind: Float[ArrayLike, ""] = 0.0
    wind_direction: Float[ArrayLike, ""] = 90.0
    drag: Float[ArrayLike, ""] = 1.0
    extra: Float[ArrayLike, ""] = 0.0
    ice_density: Float[ArrayLike, ""] = 900.0
    condition: Literal["initial", "final", "creep"] = "initial"
    broken: int | None = None

    def __post_init__(self):
        numbers = {name: checks.as_scalar(getattr(self, name), name) for name in NUMBERS}
        ice = checks.as_floats(self.ice, "ice")
        if ice.ndim > 1:
            raise ValueError(f"ice: expected shape [] or [n_span], got {ice.shape}")
        set_fields(self, ice=ice, **numbers)
        checks.require_one_of(self.condition, "condition", CONDITIONS)
        if self.broken is not None:
            set_fields(self, broken=_span_index(self.broken))
        refuse_if_broken(self.rules())
        warn_of_thick_ice(ice)
        # the other numbers are those of loads, which look at traced ones
        set_fields(self, extra=nan_if_broken(not_negative("extra", self.extra)))

    def rules(self) -> list[Rule]:
        """Return the rules that ice, wind, drag and extra load are not negative, a list."""
        names = ("ice", "wind", "drag", "extra", "ice_density")
        return [not_negative(name, getattr(self, name)) for name in names]

    @property
    def blows(self) -> Float[Array, " 3"]:
        """Unit vector towards which the wind blows, [3]."""
        angle = jnp.radians(jnp.asarray(self.wind_direction))
        return jnp.stack([jnp.cos(angle), jnp.sin(angle), jnp.zeros_like(angle)])

    def loads(
        self,
        section: LineSection,
        scale: Float[ArrayLike, " n_span"] = 1.0,
        wind_scale: Float[ArrayLike, " n_span"] = 1.0,
    ) -> list[Load]:
        """Return what acts on a section in this state, a list of loads.

        `scale` multiplies ice and `extra` on the spans, `wind_scale` the wind, [n_span].
        """
        blows, wind = self.blows, WindTable(pressures=self.wind)
        diameter = section.conductor.diameter
        found: list[Load] = [
            SelfWeight(),
            IceLoads(self.ice, diameter, self.ice_density, on="conductor"),
            WindLoads(
                *(blows, wind, self.drag, diameter), on="conductor", ice=self.ice, factor=wind_scale
            ),
            LineLoads(self._more_load(section, scale), on="conductor"),
        ]
        own = section.layout
        if own.strings:
            at = np.array(own.towers)[np.array(own.strings)[:, 0]]
            width = jnp.asarray(section.string_area)[at] / jnp.asarray(section.string_length)[at]
            found.append(WindLoads(blows, wind, STRING_DRAG, width, on="strings"))
        return found

    def load_per_length(self, section: LineSection) -> Float[Array, "n_span 2"]:
        """Return the loads on level spans, [n_span, 2], N/m: across the span, and downwards."""
        own = section.directions()
        across = own[:, 0] * self.blows[1] - own[:, 1] * self.blows[0]
        wide = section.conductor.diameter + 2 * jnp.asarray(self.ice)
        blown = self.wind * self.drag * wide * across * jnp.abs(across)
        weight = section.conductor.weight + self.ice_weight(section)
        both = jnp.stack(jnp.broadcast_arrays(blown, weight), axis=1)
        size = jnp.sqrt(jnp.sum(both**2, axis=1, keepdims=True))
        return both * (1 + self.extra / size)

    def ice_weight(self, section: LineSection) -> Float[Array, " n_span"]:
        """Return the weight of the ice per length of conductor, a scalar or [n_span], N/m."""
        volume = np.pi * jnp.asarray(self.ice) * (section.conductor.diameter + self.ice)
        return STANDARD_GRAVITY * self.ice_density * volume

    def _more_load(self, section, scale):
        """Return `extra` in its direction, and what `scale` adds to the ice, [n_span, 3], N/m."""
        along = unit(self.load_per_length(section))
        own = section.directions()
        scale = jnp.broadcast_to(scale, (len(own),))[:, None]
        left = jnp.stack([-own[:, 1], own[:, 0]], axis=1)
        more = self.extra * jnp.concatenate([along[:, :1] * left, -along[:, 1:]], axis=1) * scale
        ice = jnp.broadcast_to(self.ice_weight(section), (len(own),))[:, None]
        return more - ice * (scale - 1) * jnp.asarray([[0.0, 0.0, 1.0]])
