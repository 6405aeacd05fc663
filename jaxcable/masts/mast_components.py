"""What a mast is made of: sections by height, levels of guys, ancillaries."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Any

from ..common import checks
from ..common.rules import Rule, nan_if_broken, not_negative, positive, refuse_if_broken
from ..common.tree import pytree, set_fields
from ..common.types import ArrayLike, Float


@pytree
class MastSection:
    """A part of a mast up to a height, by its stiffnesses and what wind and ice act on.

    `lattice_section` and `tube_section` make one of members or of a profile.

    Args:
        top: height of its upper end above the base, m.
        EA, EI, GJ: axial, bending (the same in all directions) and torsional stiffness, N and N m2.
        GA: shear stiffness, N; None: rigid in shear.
        weight: N/m, with ladders and feeders.
        drag_area: drag coefficient times area of the members in the wind, per height, m2/m; the
            same from all directions.
        ice_width: by how much ice of 1 m would widen this product, per height, m2/m: twice the
            length of the members in the wind per height, times the drag coefficient.
        ice_length: length of all members per height, m/m, of the weight of ice.
        ice_diameter: their mean diameter, m.

    Raises:
        ValueError: numbers that are not positive, or negative.

    Example:
        >>> part = jc.masts.MastSection(20.0, EA=1e9, EI=5e7, GJ=2e7, weight=800.0, drag_area=0.4)
        >>> print(part.top)
        20.0
    """

    top: Float[ArrayLike, ""]
    EA: Float[ArrayLike, ""]
    EI: Float[ArrayLike, ""]
    GJ: Float[ArrayLike, ""]
    GA: Float[ArrayLike, ""] | None = None
    weight: Float[ArrayLike, ""] = 0.0
    drag_area: Float[ArrayLike, ""] = 0.0
    ice_width: Float[ArrayLike, ""] = 0.0
    ice_length: Float[ArrayLike, ""] = 0.0
    ice_diameter: Float[ArrayLike, ""] = 0.0

    def __post_init__(self):
        _convert_numbers(self, self._all_fields)
        keep_rule(self, positive, self._all_fields[:5])
        keep_rule(self, not_negative, self._all_fields[5:])


@pytree
class GuyLevel:
    """The guys of one level of a mast, all of one cable.

    `guy_level` makes one with a cable of the catalogue, at a share of its strength.

    Args:
        height: of the attachment above the base, m.
        radius: distance of the anchors from the axis of the mast, scalar or [n_guy], m.
        azimuths: of the anchors, degrees from x to y, [n_guy].
        EA: axial stiffness of a guy, N.
        weight: N/m.
        diameter: m, in the wind and under ice.
        strength: breaking strength, N.
        tension: of the guys as built, at the anchors in calm air, scalar or [n_guy], N.
        anchor_height: of the anchors above the base, scalar or [n_guy], m.
        arm: distance of the attachments from the axis, m; None: on the axis.
        arm_azimuths: of the attachments, [n_guy], degrees; default those of the anchors. Others
            make the guys hold the mast against twist.
        drag: drag coefficient of a guy; 1.2 below the critical Reynolds number.

    Raises:
        ValueError: fewer than two guys, wrong shapes, numbers that are not positive; azimuths of
            arms without an arm.

    Example:
        >>> level = jc.masts.GuyLevel(30.0, 20.0, [0, 120, 240], 30e6, 16.0, 0.018, 3e5, 30e3)
        >>> print(level.azimuths)
        [  0. 120. 240.]
    """

    height: Float[ArrayLike, ""]
    radius: Float[ArrayLike, ""] | Float[ArrayLike, " n_guy"]
    azimuths: Float[ArrayLike, " n_guy"]
    EA: Float[ArrayLike, ""]
    weight: Float[ArrayLike, ""]
    diameter: Float[ArrayLike, ""]
    strength: Float[ArrayLike, ""]
    tension: Float[ArrayLike, ""] | Float[ArrayLike, " n_guy"]
    anchor_height: Float[ArrayLike, ""] | Float[ArrayLike, " n_guy"] = 0.0
    arm: Float[ArrayLike, ""] | None = None
    arm_azimuths: Float[ArrayLike, " n_guy"] | None = None
    drag: Float[ArrayLike, ""] = 1.2

    def __post_init__(self):
        azimuths = checks.as_floats(self.azimuths, "azimuths")
        if azimuths.ndim != 1 or len(azimuths) < 2:
            raise ValueError(f"azimuths: expected shape [n_guy], at least 2, got {azimuths.shape}")
        if self.arm is None and self.arm_azimuths is not None:
            raise ValueError("arm_azimuths: there is no arm; give its length")
        set_fields(self, azimuths=azimuths)
        _convert_numbers(self, ("height", "EA", "weight", "diameter", "strength", "arm", "drag"))
        if self.arm is not None and self.arm_azimuths is None:
            set_fields(self, arm_azimuths=azimuths)
        names = "radius", "tension", "anchor_height", *["arm_azimuths"] * (self.arm is not None)
        for name in names:
            value = checks.floats_of_shape(getattr(self, name), name, (), azimuths.shape)
            xp = checks.numpy_or_jax(value)
            set_fields(self, **{name: xp.broadcast_to(value, azimuths.shape) + 0.0})
        refuse_if_broken([positive("tension", self.tension)])  # traced: the phase that has it
        names = ("height", "radius", "EA", "weight", "diameter", "strength", "arm")
        keep_rule(self, positive, names)
        keep_rule(self, not_negative, ["drag"])


@pytree(static=("name",))
class Ancillary:
    """An antenna, platform or light on a mast: its weight, and its area in the wind.

    Args:
        height: above the base, m.
        drag_area: drag coefficient times area, m2, the same from all directions.
        weight: N.
        iced_drag_area, iced_weight: under ice, m2 and N; default those without.
        offset: distance from the axis of the mast, on a rigid arm, m; None: on the axis.
        azimuth: of this offset, degrees from x to y.
        name: for reports.

    Raises:
        ValueError: negative areas or weights.

    Example:
        >>> dish = jc.masts.Ancillary(28.0, drag_area=1.6, weight=900.0, offset=0.8)
        >>> print(dish.iced_weight)
        900.0
    """

    height: Float[ArrayLike, ""]
    drag_area: Float[ArrayLike, ""] = 0.0
    weight: Float[ArrayLike, ""] = 0.0
    iced_drag_area: Float[ArrayLike, ""] | None = None
    iced_weight: Float[ArrayLike, ""] | None = None
    offset: Float[ArrayLike, ""] | None = None
    azimuth: Float[ArrayLike, ""] = 0.0
    name: str = "ancillary"

    def __post_init__(self):
        for iced, bare in (("iced_drag_area", self.drag_area), ("iced_weight", self.weight)):
            if getattr(self, iced) is None:
                set_fields(self, **{iced: bare})
        _convert_numbers(self, self._data_fields)
        keep_rule(self, not_negative, self._data_fields[:5])


def _convert_numbers(record, names):
    """Convert fields to floats without axes, or raise; None stays."""
    for name in names:
        if getattr(record, name) is not None:
            set_fields(record, **{name: checks.as_scalar(getattr(record, name), name)})


def keep_rule(record: Any, make_rule: Callable[[str, Any], Rule], names: Sequence[str]) -> None:
    """Have numbers of a record keep a rule: ValueError for known ones, NaN for traced ones.

    `make_rule` is a function of name and value, such as `positive`; None keeps every rule.
    """
    for name in names:
        if getattr(record, name) is not None:
            value = nan_if_broken(make_rule(name, getattr(record, name)))
            set_fields(record, **{name: value})
