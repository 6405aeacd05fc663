"""A section of an overhead line: towers, attachments, insulator strings, ground and crossings."""

from __future__ import annotations

import functools
from collections.abc import Mapping, Sequence
from typing import NamedTuple

import jax.numpy as jnp
import numpy as np

from ..catalogue.conductors import Conductor
from ..common import checks
from ..common.rules import Rule, nan_if_broken, not_negative, positive, refuse_if_broken
from ..common.tree import pytree, set_fields
from ..common.types import Array, ArrayLike, Float
from ..elements import Bars, Catenaries
from ..model.structure import Structure
from ..model.supports import pinned
from .conductor_law import NO_SET

KINDS = "suspension", "strain", "post"
"""How a tower holds the conductor: by a hanging string, by strings in line, on a rigid post."""

_STRING_STIFFNESS = 1e9  # EA of insulator strings, N: one of 3 m gives 0.1 mm at 30 kN
_STRINGS = "string_length", "string_weight", "string_area"
NUMBERS = "station", "ground", "height", "offset", "angle", *_STRINGS
"""Fields of a section that have a number for each tower."""


def unit(vectors: Float[Array, "n dim"]) -> Float[Array, "n dim"]:
    """Return vectors, [n, dim], divided by their lengths."""
    return vectors / jnp.sqrt(jnp.sum(vectors**2, axis=1, keepdims=True))


def _increase_text(index, profile):
    """Return the message on the first point of a profile that is not beyond the one before."""
    k = index[0] + 1
    return (
        f"profile[{k}]: its station, {profile[k, 0]:g} m, must be more than that of the point "
        f"before, {profile[k - 1, 0]:g} m (a step in the ground: two stations 0.01 m apart)"
    )


def _as_points(value, name, width):
    """Return points as floats, [n, width]; ValueError for another shape, or fewer than two."""
    points = checks.as_floats(value, name)
    if points.ndim != 2 or points.shape[1] != width or len(points) < 2:
        raise ValueError(f"{name}: expected shape [n, {width}], n >= 2, got {points.shape}")
    return points


class Attachment(NamedTuple):
    """A place where a tower holds the conductor.

    Attributes:
        tower: index of the tower.
        side: "" for one attachment, else "back" or "ahead" of a strain tower.
        clamp: node at which the conductor is clamped.
        string: index of the string from which it hangs, or None.
    """

    tower: int
    side: str
    clamp: int
    string: int | None


class Layout(NamedTuple):
    """Nodes and elements of a section, from `layout_of`.

    Attributes:
        held: nodes that towers hold, indices; towers of all nodes in `towers`.
        towers: tower of each node, [n_node].
        spans: nodes of each span, [n_span, 2].
        strings: nodes of each string: at the tower and at the conductor, [n_string, 2].
        reach: tower towards which each string of a strain tower pulls; itself if it hangs.
        attachments: list of `Attachment`.
        tension_sections: indices of the spans between strain towers, lists.
    """

    held: list[int]
    towers: list[int]
    spans: list[list[int]]
    strings: list[list[int]]
    reach: list[int]
    attachments: list[Attachment]
    tension_sections: list[list[int]]


@functools.lru_cache(maxsize=64)
def layout_of(kinds: tuple[str, ...], with_string: tuple[bool, ...]) -> Layout:
    """Return the `Layout` of towers of these kinds, with and without strings."""
    found = Layout([], [], [], [], [], [], [[]])
    last, count = None, len(kinds)
    for tower, kind in enumerate(kinds):
        at_tower = len(found.towers)
        found.towers.append(tower)
        found.held.append(at_tower)
        both = ("back", "ahead")[tower == 0 : 1 if tower == count - 1 else 2]
        for side in both if kind == "strain" else ("",):
            clamp, string = at_tower, None
            if with_string[tower]:
                clamp, string = len(found.towers), len(found.strings)
                found.towers.append(tower)
                found.strings.append([at_tower, clamp])
                found.reach.append(tower + {"": 0, "back": -1, "ahead": 1}[side])
            found.attachments.append(Attachment(tower, side, clamp, string))
            if side != "ahead" and last is not None:
                found.tension_sections[-1].append(len(found.spans))
                found.spans.append([last, clamp])
            last = clamp
        if kind == "strain" and 0 < tower < count - 1:
            found.tension_sections.append([])
    return found


@pytree(static=("kinds", "names", "with_string"))
class LineSection:
    """Towers of an overhead line with their attachments, a conductor, the ground and crossings.

    The line runs in plan along its stations; at a tower with an angle it turns. Attachments of a
    tower lie on its arm, across the bisector of this angle. From a "suspension" tower the conductor
    hangs by a string, which swings freely; a "strain" tower holds it on both sides by strings in
    line with it (or, with a length of zero, directly), and ends a tension section; a "post" holds
    it as a rigid insulator does. Strings are straight, and rigid but for their elongation.

    Args:
        conductor: `Conductor`, of `catalogue.conductor`.
        station: of each tower along the line, [n_tower], m, increasing.
        ground: elevation of the ground at each tower, [n_tower], m.
        height: of the attachment above the ground, where the string begins, [n_tower], m.
        kinds: "suspension", "strain" or "post" of each tower, or one for all.
        offset: of the attachment from the line, to the left, scalar or [n_tower], m.
        angle: by which the line turns at each tower, to the left, scalar or [n_tower], degrees.
        string_length: of insulator strings, scalar or [n_tower], m.
        string_weight: of one string, scalar or [n_tower], N.
        string_area: of one string exposed to the wind, scalar or [n_tower], m2.
        profile: points of the ground, [n, 2], station and elevation, m, at increasing stations;
            None for lines between the towers.
        crossings: lines that are crossed, by name: points [n, 3], station, offset to the left and
            elevation, m.
        names: of the towers; default "1", "2" and so on.
        with_string: which towers have strings; set by the constructor.

    Raises:
        ValueError: wrong shapes or kinds, stations of towers or profile that do not increase,
            negative lengths or weights, suspension towers without string; fewer than two towers.

    Example:
        >>> section = jc.lines.LineSection(
        ...     jc.catalogue.conductor("Drake"),
        ...     station=[0.0, 300.0, 640.0],
        ...     ground=[100.0, 104.0, 96.0],
        ...     height=[24.0, 27.0, 24.0],
        ...     kinds=["strain", "suspension", "strain"],
        ...     string_length=2.5,
        ...     string_weight=900.0,
        ... )
        >>> print(f"{section.ruling_spans()[0]:.2f} m")
        321.87 m
    """

    conductor: Conductor
    station: Float[ArrayLike, " n_tower"]
    ground: Float[ArrayLike, " n_tower"]
    height: Float[ArrayLike, " n_tower"]
    kinds: Sequence[str] | str = "suspension"
    offset: Float[ArrayLike, ""] | Float[ArrayLike, " n_tower"] = 0.0
    angle: Float[ArrayLike, ""] | Float[ArrayLike, " n_tower"] = 0.0
    string_length: Float[ArrayLike, ""] | Float[ArrayLike, " n_tower"] = 0.0
    string_weight: Float[ArrayLike, ""] | Float[ArrayLike, " n_tower"] = 0.0
    string_area: Float[ArrayLike, ""] | Float[ArrayLike, " n_tower"] = 0.0
    profile: Float[ArrayLike, "n 2"] | None = None
    crossings: Mapping[str, Float[ArrayLike, "n 3"]] | None = None
    names: Sequence[str] = ()
    with_string: tuple[bool, ...] | None = None

    def __post_init__(self):
        if not isinstance(self.conductor, Conductor):
            kind = checks.describe_type(self.conductor, 'catalogue.conductor("Drake")')
            raise ValueError(f"conductor: expected a Conductor, got {kind}")
        station = checks.as_floats(self.station, "station")
        if station.ndim != 1 or len(station) < 2:
            raise ValueError(f"station: expected shape [n_tower], at least 2, got {station.shape}")
        count = len(station)
        kinds = (self.kinds,) * count if isinstance(self.kinds, str) else tuple(self.kinds)
        if len(kinds) != count:
            raise ValueError(f"kinds: expected {count}, one for each tower, got {len(kinds)}")
        for k, kind in enumerate(kinds):
            checks.require_one_of(kind, f"kinds[{k}]", KINDS)
        names = tuple(map(str, self.names or range(1, count + 1)))
        if len(names) != count or len(set(names)) != count:
            raise ValueError(f"names: expected {count} different names, one for each tower")
        set_fields(self, station=station, kinds=kinds, names=names)
        for name in NUMBERS[1:]:
            value = checks.as_floats(getattr(self, name), name)
            if value.shape not in ((), (count,)):
                raise ValueError(f"{name}: expected shape [] or [{count}], got {value.shape}")
            xp = checks.numpy_or_jax(value)
            set_fields(self, **{name: xp.broadcast_to(value, (count,)) + 0.0})
        self._check_strings()
        if self.profile is not None:
            set_fields(self, profile=_as_points(self.profile, "profile", 2))
        crossings = dict(self.crossings or {})
        points = {k: _as_points(v, f"crossings[{k!r}]", 3) for k, v in crossings.items()}
        set_fields(self, crossings=points)
        refuse_if_broken(self.rules())
        step = nan_if_broken(positive("differences of station", station[1:] - station[:-1]))
        set_fields(self, station=station + 0 * step.sum())

    def _check_strings(self):
        """Set `with_string` from known lengths; ValueError for suspension towers without string."""
        length = checks.array_if_known(self.string_length)
        if length is not None:
            has_one = (length > 0) & (np.array(self.kinds) != "post")
            set_fields(self, with_string=tuple(has_one.tolist()))
        if self.with_string is None:
            raise ValueError("string_length: is traced; give with_string, booleans of all towers")
        for k, (kind, has_one) in enumerate(zip(self.kinds, self.with_string, strict=True)):
            if kind == "suspension" and not has_one:
                text = "a suspension tower needs a string; or a post"
                raise ValueError(f"string_length[{k}]: {text}")

    def rules(self) -> list[Rule]:
        """Return the rules of the numbers, those of the conductor included, a list of `Rule`.

        Stations of towers and of the profile increase; lengths and weights of strings are not
        negative.
        """
        step = self.station[1:] - self.station[:-1]
        return [
            *self.conductor.rules(),
            Rule("profile", self.profile, lambda x: x[1:, 0] <= x[:-1, 0], _increase_text),
            positive("differences of station", step),
            *(not_negative(name, getattr(self, name)) for name in _STRINGS),
        ]

    @property
    def layout(self) -> Layout:
        """Nodes and elements of the section."""
        return layout_of(self.kinds, self.with_string)

    @property
    def span_lengths(self) -> Float[Array, " n_span"]:
        """Differences of stations, [n_span], m."""
        return jnp.diff(jnp.asarray(self.station))

    @property
    def never_loaded(self) -> Float[Array, "n_span n_layer"]:
        """Permanent strains of a conductor that has never been loaded, [n_span, n_layer]."""
        shape = len(self.layout.spans), len(self.conductor.layers)
        return jnp.asarray(np.full(shape, NO_SET))

    def chord_lengths(self) -> Float[Array, " n_span"]:
        """Return the distances of the ends of spans while strings hang as drawn, [n_span], m."""
        ends = self.nodes()[np.array(self.layout.spans)]
        return jnp.sqrt(jnp.sum((ends[:, 1] - ends[:, 0]) ** 2, axis=1))

    def ruling_spans(self) -> list[float]:
        """Return the ruling span of every tension section, ``sqrt(sum S^3 / sum S)``, a list, m."""
        spans = np.diff(np.asarray(self.station))
        return [
            float(np.sqrt((spans[own] ** 3).sum() / spans[own].sum()))
            for own in self.layout.tension_sections
        ]

    def directions(self) -> Float[Array, "n_span 2"]:
        """Return the unit vectors along the spans in plan, [n_span, 2]; the first one is x."""
        turned = jnp.radians(jnp.asarray(self.angle)).at[0].set(0.0)
        heading = jnp.cumsum(turned)[:-1]
        return jnp.stack([jnp.cos(heading), jnp.sin(heading)], axis=1)

    def bisectors(self) -> Float[Array, "n_tower 2"]:
        """Return the unit vectors along the line at the towers, [n_tower, 2], across their arms."""
        own = self.directions()
        return unit(jnp.concatenate([own[:1], own]) + jnp.concatenate([own, own[-1:]]))

    def in_plan(
        self, station: Float[ArrayLike, " n"], offset: Float[ArrayLike, " n"] = 0.0
    ) -> Float[Array, "n 2"]:
        """Return the places of points beside the line in plan, [n, 2], m.

        `station` and `offset` (to the left), m; the first and last span go on beyond the towers.
        """
        own, begin = self.directions(), jnp.asarray(self.station)
        before = jnp.asarray(station)[:, None]
        low = begin[None, :-1].at[0, 0].set(-jnp.inf)
        high = begin[None, 1:].at[0, -1].set(jnp.inf)
        length = jnp.clip(before, low, high) - jnp.clip(begin[0], low, high)
        inside = ((before > low) & (before <= high)).astype(length.dtype)
        left = jnp.stack([-own[:, 1], own[:, 0]], axis=1)
        beside = jnp.broadcast_to(offset, before.shape[:1])[:, None] * (inside @ left)
        return length @ own + beside

    def attachment_points(self) -> Float[Array, "n_tower 3"]:
        """Return the points where strings or conductors are attached to towers, [n_tower, 3], m."""
        along = self.bisectors()
        left = jnp.stack([-along[:, 1], along[:, 0]], axis=1)
        plan = self.in_plan(self.station) + jnp.asarray(self.offset)[:, None] * left
        top = jnp.asarray(self.ground) + jnp.asarray(self.height)
        return jnp.concatenate([plan, top[:, None]], axis=1)

    def ground_points(self) -> Float[Array, "n 3"]:
        """Return the ground along the line, points [n, 3], m."""
        profile = self.profile
        if profile is None:
            profile = jnp.stack([jnp.asarray(self.station), jnp.asarray(self.ground)], axis=1)
        profile = jnp.asarray(profile)
        return jnp.concatenate([self.in_plan(profile[:, 0]), profile[:, 1:]], axis=1)

    def crossing_points(self) -> dict[str, Float[Array, "n 3"]]:
        """Return the points of the lines that are crossed, by name, each [n, 3], m."""
        every = {name: jnp.asarray(points) for name, points in (self.crossings or {}).items()}
        return {
            name: jnp.concatenate([self.in_plan(x[:, 0], x[:, 1]), x[:, 2:]], axis=1)
            for name, x in every.items()
        }

    def nodes(self) -> Float[Array, "n_node 3"]:
        """Return the nodes, [n_node, 3], m: strings hang plumb, or point along their span."""
        own, points = self.layout, self.attachment_points()
        towers = np.array(own.towers)
        nodes = points[towers]
        if not own.strings:
            return nodes
        held, hung = np.array(own.strings).T
        at, reach = towers[held], np.array(own.reach)
        plumb = jnp.asarray([[0.0, 0.0, -1.0]])
        towards = jnp.where((reach == at)[:, None], plumb, points[reach] - points[at])
        falling = unit(0.1 * plumb + unit(towards))
        return nodes.at[hung].add(jnp.asarray(self.string_length)[at][:, None] * falling)

    def structure(
        self, stiffness: Float[Array, " n_span"], weight: Float[Array, " n_span"]
    ) -> Structure:
        """Return the section as a `Structure` with the groups "conductor" and "strings".

        Args:
            stiffness: EA of the conductor in each span, [n_span], N.
            weight: its weight per unstressed length in each span, [n_span], N/m.
        """
        own = self.layout
        conductor = Catenaries(own.spans, axial_stiffness=stiffness, weight=weight)
        elements: dict[str, Bars | Catenaries] = {"conductor": conductor}
        if own.strings:
            at = np.array(own.towers)[np.array(own.strings)[:, 0]]
            length = jnp.asarray(self.string_length)[at]
            heavy = jnp.asarray(self.string_weight)[at] / length
            elements["strings"] = Bars(
                own.strings, axial_stiffness=_STRING_STIFFNESS, rest_length=length, weight=heavy
            )
        return Structure(self.nodes(), elements, pinned(own.held))
