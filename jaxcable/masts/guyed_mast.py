"""A guyed mast of sections, guys and ancillaries, as a structure of beams and catenaries."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Literal

import numpy as np

from ..common import checks
from ..common.tree import pytree, set_fields
from ..common.types import Array, Float
from ..elements import Beams, Catenaries
from ..model.structure import Structure
from ..model.supports import clamped, pinned, restrained
from ..sections import Section
from .mast_components import Ancillary, GuyLevel, MastSection
from .mast_layout import SAME_HEIGHT, Layout, Patch, break_heights, layout_of

EXPANSION = 12e-6
"""Thermal expansion of steel, 1/K (EN 1993-1-1, 3.2.6)."""


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
        15 ['span 1', 'span 2', 'span 3', 'to mid-span 1', 'about guys 1', 'about guys 2']
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
            if (np.diff(values, prepend=0.0) <= SAME_HEIGHT).any():
                raise ValueError(f"{name}: heights {values.tolist()} m must increase from the base")
        for name, values in (("guys", guys), ("ancillaries", others)):
            if len(values) and (values.max() > tops[-1] + SAME_HEIGHT or values.min() < 0):
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

    def index_of_guy(self, guy: int) -> int:
        """Return the index of a guy; ValueError where there is none."""
        count = len(self.guy_names)
        if not isinstance(guy, int | np.integer) or not 0 <= guy < count:
            raise ValueError(f"guy = {guy!r}: there are guys 0 to {count - 1}")
        return int(guy)

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
        ends = self.of_guys("anchor_height"), self.of_guys("height")
        high = xp.maximum(*ends)
        low = xp.minimum(xp.minimum(*ends), high - SAME_HEIGHT)  # a horizontal guy has some, too
        inside = xp.minimum(every[patch.high], high) - xp.maximum(every[patch.low], low)
        return xp.maximum(inside, 0.0) / (high - low)


def _around(radius, azimuths, height):
    """Return points at a radius from the axis, [n, 3], m; azimuths in degrees."""
    xp = checks.numpy_or_jax(radius, azimuths, height)
    angle = xp.radians(azimuths)
    height = xp.broadcast_to(height, angle.shape)
    return xp.stack([radius * xp.cos(angle), radius * xp.sin(angle), height], axis=1)
