"""A guyed mast: sections by height, levels of guys, ancillaries; its structure of beams and guys."""

from __future__ import annotations

import functools
from collections.abc import Sequence
from typing import Literal, NamedTuple

import numpy as np

from ..common import checks
from ..common.rules import not_negative, positive, refuse_if_broken
from ..common.tree import pytree, set_fields
from ..common.types import Array, ArrayLike, Float
from ..elements import Beams, Catenaries
from ..model.structure import Structure
from ..model.supports import clamped, pinned, restrained
from ..sections import Section

EXPANSION = 12e-6
"""Thermal expansion of steel, 1/K (EN 1993-1-1, 3.2.6)."""
_SAME = 1e-6  # m: heights that differ by less are one


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
        refuse_if_broken([positive(name, getattr(self, name)) for name in self._all_fields[:4]])
        refuse_if_broken([not_negative(name, getattr(self, name)) for name in self._all_fields[5:]])


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
        ValueError: fewer than two guys, wrong shapes, numbers that are not positive.

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
        set_fields(self, azimuths=azimuths)
        if self.arm_azimuths is None:
            set_fields(self, arm_azimuths=azimuths)
        _convert_numbers(
            self, ("height", "EA", "weight", "diameter", "strength", "arm", "drag")
        )
        for name in ("radius", "tension", "anchor_height", "arm_azimuths"):
            value = checks.as_floats(getattr(self, name), name)
            if value.shape not in ((), azimuths.shape):
                raise ValueError(f"{name}: expected shape [] or {azimuths.shape}, got {value.shape}")
            xp = checks.numpy_or_jax(value)
            set_fields(self, **{name: xp.broadcast_to(value, azimuths.shape) + 0.0})
        names = ("height", "radius", "EA", "weight", "diameter", "strength", "tension", "arm")
        refuse_if_broken([positive(name, getattr(self, name)) for name in names])


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
        refuse_if_broken(
            [not_negative(name, getattr(self, name)) for name in self._data_fields[:5]]
        )


def _convert_numbers(record, names):
    """Convert fields to floats without axes, or raise; None stays."""
    for name in names:
        if getattr(record, name) is not None:
            set_fields(record, **{name: checks.as_scalar(getattr(record, name), name)})


class Patch(NamedTuple):
    """A part of the height of a mast: its name, its ends in `Layout.sources`, its elements."""

    name: str
    low: int
    high: int
    elements: tuple[int, int]


class Layout(NamedTuple):
    """Nodes and elements of a mast, from `layout_of`.

    Heights of breaks are in the order: base, guy levels, tops of sections, middles of the spans
    between guy levels, ancillaries.

    Attributes:
        nodes: of each node on the axis the breaks below and above, and the share of the latter.
        sections: index of the section of each element.
        guys, ancillaries: node of each guy level, and of each ancillary.
        patches: spans between guy levels, and parts from the middle of one to that of the next.
    """

    nodes: tuple[tuple[int, int, float], ...]
    sections: tuple[int, ...]
    guys: tuple[int, ...]
    ancillaries: tuple[int, ...]
    patches: tuple[Patch, ...]


@functools.lru_cache(maxsize=64)
def layout_of(
    tops: tuple[float, ...], guys: tuple[float, ...], others: tuple[float, ...], longest: float
) -> Layout:
    """Return the `Layout` of heights of sections, guy levels, ancillaries; `longest` element, m."""
    heights = list(break_heights(np.array(tops), np.array(guys), np.array(others)))
    order: list[int] = []
    for k in sorted(range(len(heights)), key=lambda k: (round(heights[k] / _SAME), k)):
        if not order or heights[k] - heights[order[-1]] > _SAME:
            order.append(k)
    nodes: list[tuple[int, int, float]] = [(0, 0, 0.0)]
    sections, node_of = [], {0: 0}
    for low, high in zip(order[:-1], order[1:], strict=True):
        count = max(1, int(np.ceil((heights[high] - heights[low]) / longest - 1e-9)))
        nodes += [(low, high, (k + 1) / count) for k in range(count)]
        middle = 0.5 * (heights[low] + heights[high])
        sections += [int(np.searchsorted(tops, middle))] * count
        node_of[high] = len(nodes) - 1

    def node(z):
        return node_of[min(order, key=lambda k: abs(heights[k] - z))]

    count = len(guys)
    top = 1 + count + len(tops) - 1  # index of the upper end of the mast
    spans = [0, *range(1, count + 1)]
    if tops[-1] - guys[-1] > _SAME:
        spans.append(top)
    middles = [1 + count + len(tops) + k for k in range(count)]
    parts = [(f"span {k + 1}", *pair) for k, pair in enumerate(zip(spans, spans[1:], strict=False))]
    middle = [0, *middles, spans[-1]]
    parts += [
        (f"about guys {k}" if k else "to mid-span 1", *pair)
        for k, pair in enumerate(zip(middle, middle[1:], strict=False))
    ]
    patches = [Patch(n, a, b, (node(heights[a]), node(heights[b]))) for n, a, b in parts]
    own = [node(z) for z in guys], [node(z) for z in others]
    return Layout(tuple(nodes), tuple(sections), tuple(own[0]), tuple(own[1]), tuple(patches))


def break_heights(tops, guys, others):
    """Return the heights of all breaks of a `Layout`, m, in its order; arrays [n] of heights."""
    xp = checks.numpy_or_jax(tops, guys, others)
    ground = xp.zeros(1)
    middles = 0.5 * (guys + xp.concatenate([ground, guys[:-1]]))
    return xp.concatenate([ground, guys, tops, middles, others])


@pytree(static=("base", "element_length", "layout"))
class GuyedMast:
    """A guyed mast: sections from the base upwards, levels of guys, ancillaries.

    The mast is a line of beams, with nodes at guys, ancillaries, ends of sections and in the middle
    of spans; each guy is an elastic catenary. All numbers may be traced, the order of heights not.

    Args:
        sections: `MastSection` from below, each up to its `top`.
        guys: `GuyLevel` from below.
        ancillaries: `Ancillary`, in any order.
        base: "hinged", with twist held, or "clamped".
        element_length: most length of a beam element, m.
        layout: set by the constructor.

    Raises:
        ValueError: no sections or guys, heights that do not increase, guys or ancillaries above the
            top; traced heights without `layout`.

    Example:
        >>> part = jc.masts.tube_section(30.0, "CHS 219.1x6.3")
        >>> cable = "Galfan spiral strand 12"
        >>> guys = [jc.masts.guy_level(h, 15.0, [0, 120, 240], cable) for h in (15.0, 28.0)]
        >>> mast = jc.masts.GuyedMast([part], guys, [jc.masts.Ancillary(29.0, 1.2, 600.0)])
        >>> print(len(mast.node_heights()), [p.name for p in mast.layout.patches])
        13 ['span 1', 'span 2', 'span 3', 'to mid-span 1', 'about guys 1', 'about guys 2']
    """

    sections: Sequence[MastSection]
    guys: Sequence[GuyLevel]
    ancillaries: Sequence[Ancillary] = ()
    base: Literal["hinged", "clamped"] = "hinged"
    element_length: float = 3.0
    layout: Layout = None  # type: ignore[assignment]  # the constructor puts it in

    def __post_init__(self):
        kinds = {"sections": MastSection, "guys": GuyLevel, "ancillaries": Ancillary}
        for name, kind in kinds.items():
            every = list(getattr(self, name))
            for k, one in enumerate(every):
                if not isinstance(one, kind):
                    raise ValueError(f"{name}[{k}]: expected a {kind.__name__}, got {one!r}")
            if not every and name != "ancillaries":
                raise ValueError(f"{name}: none; a guyed mast has at least one")
            set_fields(self, **{name: every})
        checks.require_one_of(self.base, "base", ("hinged", "clamped"))
        if not self.element_length > 0:
            raise ValueError(f"element_length = {self.element_length}: must be positive")
        heights = [checks.array_if_known(x) for x in self._heights()]
        if any(x is None for x in heights):
            if self.layout is None:
                raise ValueError("heights: are traced; give layout, that of the mast with numbers")
            return
        tops, guys, others = heights
        for name, values in (("sections", tops), ("guys", guys)):
            if (np.diff(values, prepend=0.0) <= _SAME).any():
                raise ValueError(f"{name}: heights {values.tolist()} m must increase from the base")
        for name, values in (("guys", guys), ("ancillaries", others)):
            if len(values) and (values.max() > tops[-1] + _SAME or values.min() < 0):
                raise ValueError(f"{name}: heights {values.tolist()} m, of 0 to {tops[-1]:g} m")
        own = (tuple(map(float, x)) for x in heights)
        set_fields(self, layout=layout_of(*own, float(self.element_length)))

    def _heights(self):
        """Return heights of tops of sections, of guys, and of ancillaries, arrays [n], m."""
        every = (
            [x.top for x in self.sections],
            [x.height for x in self.guys],
            [x.height for x in self.ancillaries],
        )
        xp = checks.numpy_or_jax(every)
        return [xp.stack([xp.asarray(z, float) for z in x]) if x else np.zeros(0) for x in every]

    def break_heights(self) -> Float[Array, " n_break"]:
        """Return the heights of the breaks of the `layout`, [n_break], m."""
        return break_heights(*self._heights())

    def node_heights(self) -> Float[Array, " n"]:
        """Return the heights of the nodes on the axis, from the base, [n], m."""
        low, high, share = (np.array(x) for x in zip(*self.layout.nodes, strict=True))
        every = self.break_heights()
        return every[low] + share * (every[high] - every[low])

    @property
    def guy_names(self) -> list[str]:
        """Names of all guys: level from 1, and azimuth of the anchor, such as "2 at 120"."""
        return [
            f"{k + 1} at {azimuth:g}"
            for k, level in enumerate(self.guys)
            for azimuth in np.asarray(level.azimuths)
        ]

    def of_guys(self, name: str) -> Float[Array, " n_guy"]:
        """Return a number of all guys, such as "strength", [n_guy], level after level."""
        every = [(getattr(level, name), len(level.azimuths)) for level in self.guys]
        xp = checks.numpy_or_jax([x for x, _ in every])
        return xp.concatenate([xp.broadcast_to(x, (n,)) for x, n in every])

    def structure(self) -> Structure:
        """Return the mast as a `Structure`: groups "section 01" and so on, from below, and "guys".

        Nodes: those on the axis, attachments on arms, ancillaries on arms, then anchors.
        """
        heights, own = self.node_heights(), self.layout
        count, xp = len(heights), checks.numpy_or_jax(self)
        every: list = [xp.stack([0 * heights, 0 * heights, heights], axis=1)]
        ends, rigid, at = [], [], count
        for level, node in zip(self.guys, own.guys, strict=True):
            number = len(level.azimuths)
            ends += [node] * number if level.arm is None else list(range(at, at + number))
            if level.arm is not None:
                rigid += [[node, at + k] for k in range(number)]
                every.append(_around(level.arm, level.arm_azimuths, level.height))
                at += number
        for one, node in zip(self.ancillaries, own.ancillaries, strict=True):
            if one.offset is not None:
                rigid.append([node, at])
                every.append(_around(one.offset, xp.reshape(one.azimuth, (1,)), one.height))
                at += 1
        every += [_around(x.radius, x.azimuths, x.anchor_height) for x in self.guys]
        anchors = np.arange(at, at + len(ends))
        elements: dict[str, Beams | Catenaries] = {}
        for k, part in enumerate(self.sections):
            members = np.flatnonzero(np.array(own.sections) == k)
            section = Section.linear(part.EA, part.EI, part.EI, part.GJ, part.GA, part.GA)
            elements[f"section {k + 1:02d}"] = Beams(
                np.stack([members, members + 1], axis=1),
                section,
                weight=part.weight,
                expansion=EXPANSION,
            )
        elements["guys"] = Catenaries(
            np.stack([anchors, ends], axis=1),
            axial_stiffness=self.of_guys("EA"),
            weight=self.of_guys("weight"),
            strength=self.of_guys("strength"),
            expansion=EXPANSION,
        )
        foot = clamped([0]) if self.base == "clamped" else restrained([0], "xyz", "z")
        nodes = xp.concatenate(every)
        return Structure(nodes, elements, foot + pinned(anchors), rigid=rigid or None)

    def ancillary_nodes(self) -> list[int]:
        """Return the node of each ancillary in `structure`, on the axis or on its arm."""
        at = len(self.layout.nodes)
        at += sum(len(level.azimuths) for level in self.guys if level.arm is not None)
        found = []
        for one, node in zip(self.ancillaries, self.layout.ancillaries, strict=True):
            found.append(node if one.offset is None else at)
            at += one.offset is not None
        return found

    def guy_share(self, patch: Patch) -> Float[Array, " n_guy"]:
        """Return the share of the height of each guy that lies within a patch, [n_guy]."""
        every, xp = self.break_heights(), checks.numpy_or_jax(self)
        low, high = self.of_guys("anchor_height"), self.of_guys("height")
        inside = xp.minimum(every[patch.high], high) - xp.maximum(every[patch.low], low)
        return xp.maximum(inside, 0.0) / (high - low)


def _around(radius, azimuths, height):
    """Return points at a radius from the axis, [n, 3], m; azimuths in degrees."""
    xp = checks.numpy_or_jax(radius, azimuths, height)
    angle = xp.radians(azimuths)
    height = xp.broadcast_to(height, angle.shape)
    return xp.stack([radius * xp.cos(angle), radius * xp.sin(angle), height], axis=1)
