"""Views of a structure: plan, elevation or space, with equal scales of the axes if not stated."""

from __future__ import annotations

from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.collections import LineCollection, PolyCollection
from matplotlib.ticker import MaxNLocator
from mpl_toolkits.mplot3d import Axes3D  # makes the projection known
from mpl_toolkits.mplot3d.art3d import Line3DCollection, Poly3DCollection

from ..common.types import Float
from ..common.units import SI, Units
from .style import SIZE

__all__ = ["VIEWS", "Axes3D", "View", "choose_view"]

VIEWS = ("plan", "elevation", "space")
_PLANE = 1e-6  # largest distance of a plane structure from its plane, over its extent
_HIGH = 0.5  # height over the smaller extent in plan from which on a structure is seen from a side
_LOW = 0.3  # height over width to which heights are magnified at most
_MOST = 100.0  # largest factor on heights that is chosen: a level structure stays a line
_RISE, _AZIMUTH = 30.0, -52.5  # degrees; between the multiples of 15 at which guys often stand,
# which an azimuth of -60 would hide behind their mast
_ROUND = (5.0, 2.0, 1.0)  # round factors are powers of ten times these
_LEAST = 0.15  # least extent of axes over the largest one, so that a flat net has some height
_EDGE = "0.4"  # color of the edges of the box in space, drawn half transparent
_MARGIN = 0.05  # margin on each side over the extent


class View:
    """A projection of space into the axes of a picture: plan, elevation or space.

    Args:
        kind: "plan", "elevation" or "space".
        along: horizontal unit vector of an elevation, [3]; of a plane structure its direction.
        plane: whether the whole structure lies in one vertical plane.
        units: `Units` of the coordinates in the picture.
        heights: factor on heights in an elevation.

    Attributes:
        kind, along, plane, units, heights: as above.
        scale: factor from m to the unit of length of the picture.
        normal: unit normal vector of the plane of the structure, [3], or None.
        flat: whether the axes of the picture have two directions, rather than three.
    """

    def __init__(self, kind, along=None, plane=False, units=SI, heights=1.0):
        self.kind, self.along, self.plane, self.heights = kind, along, plane, heights
        self.units, self.scale = units, units.from_si(1.0, "m")
        self.flat = kind != "space"
        self.normal = np.array([-along[1], along[0], 0.0]) if plane else None

    def project(self, vectors: Float[np.ndarray, "... 3"]) -> Float[np.ndarray, "... 2or3"]:
        """Return the coordinates of vectors [..., 3], m, in the picture, [..., 2] or [..., 3].

        They are in the units of the picture, with heights in an elevation times `heights`.
        """
        vectors = vectors if self.scale == 1.0 else self.scale * vectors
        if self.kind == "plan":
            return vectors[..., :2]
        if self.kind == "elevation":
            return np.stack([vectors @ self.along, self.heights * vectors[..., 2]], axis=-1)
        return vectors

    def add_lines(self, axes: Axes, segments: Any, **look: Any) -> LineCollection:
        """Draw lines in axes without changing their limits; return matplotlib's `LineCollection`.

        `segments` are in coordinates of the picture (see `project`), and `look` has arguments of
        the collection.
        """
        make: Any = LineCollection if self.flat else Line3DCollection
        lines = make(segments, **look)
        axes.add_collection(lines, autolim=False)
        return lines

    def add_ground(self, axes: Any, profile: Float[np.ndarray, "n 3"]) -> None:
        """Draw a profile of the ground, points [n, 3], m, in axes of an elevation or of space."""
        line = self.project(profile)
        if self.flat:
            axes.fill_between(*line.T, axes.get_ylim()[0], color="0.93", linewidth=0, zorder=0)
        axes.plot(*line.T, color="0.45", linewidth=1.0, zorder=0.5)

    def add_faces(self, axes: Axes, corners: Any, **look: Any) -> Any:
        """Draw faces in axes without changing their limits; return matplotlib's `PolyCollection`.

        `corners` are in coordinates of the picture (see `project`), and `look` has arguments of the
        collection.
        """
        faces = (PolyCollection if self.flat else Poly3DCollection)(corners, **look)
        axes.add_collection(faces, autolim=False)
        return faces

    def axis_labels(self) -> tuple[str, ...]:
        """Return the labels of the two or three axes, such as "x (m)"."""
        x, y, z = (f"{name} ({self.units.length})" for name in "xyz")
        z += "" if self.heights == 1.0 else f" x {self.heights:g}"
        if self.kind != "elevation":
            return (x, y, z)[: 2 if self.flat else 3]
        along = np.abs(self.along[:2])
        if along[1] < 1e-9:
            return x, z
        if along[0] < 1e-9:
            return y, z
        angle = np.degrees(np.arctan2(self.along[1], self.along[0]))
        return f"along {angle:.0f}° to {x}", z

    def axis_limits(
        self, points: Float[np.ndarray, "n 3"]
    ) -> tuple[Float[np.ndarray, " 2or3"], Float[np.ndarray, " 2or3"]]:
        """Return the lower and the upper limits of axes that show all points [n, 3], m."""
        seen = self.project(points)
        low, high = seen.min(axis=0), seen.max(axis=0)
        size = np.maximum(high - low, _LEAST * max((high - low).max(), 1e-9))
        # flat axes cut off what is outside: marks take as much room on all sides
        size = size + 2 * _MARGIN * (size.max() if self.flat else size)
        middle = 0.5 * (low + high)
        return middle - 0.5 * size, middle + 0.5 * size

    def height_over_width(self, points: Float[np.ndarray, "n 3"]) -> float:
        """Return height over width of the picture that shows all points [n, 3], m."""
        low, high = self.axis_limits(points)
        size = high - low
        if self.flat:
            return float(size[1] / size[0])
        rise, azimuth = np.radians([_RISE, _AZIMUTH])
        across, away = np.abs([np.sin(azimuth), np.cos(azimuth)]) @ [size[:2], size[1::-1]]
        return float((np.sin(rise) * away + np.cos(rise) * size[2]) / across)

    def add_axes(self, figure, points, title):
        """Add axes that show all points to a figure, and return them; `layout` moves them later.

        Args:
            figure: figure to draw in.
            points: positions that the limits have to include, [n, 3], m.
            title: title of the axes.
        """
        low, high = self.axis_limits(points)
        names = self.axis_labels()
        if self.flat:
            axes = figure.add_axes([0.1, 0.1, 0.8, 0.8])
            axes.set(xlim=(low[0], high[0]), ylim=(low[1], high[1]))
            axes.set_aspect("equal", adjustable="box")
            least = 3 if (high - low)[1] < 0.4 * (high - low)[0] else 6
            axes.yaxis.set_major_locator(MaxNLocator(nbins=least))
            axes.xaxis.set_major_locator(MaxNLocator(nbins=6))
            if self.heights != 1.0:  # round numbers are true heights
                low, high = np.array(axes.get_ylim()) / self.heights
                marks = MaxNLocator(nbins=least).tick_values(low, high)
                marks = marks[(marks >= low) & (marks <= high)]
                axes.set_yticks(self.heights * marks, [f"{mark:g}" for mark in marks])
            axes.set(xlabel=names[0], ylabel=names[1])
        else:
            axes = figure.add_axes([0.1, 0.1, 0.8, 0.8], projection="3d")
            axes.view_init(_RISE, _AZIMUTH)
            axes.computed_zorder = False  # keep the stated order of lines, marks and arrows
            axes.patch.set_visible(False)  # the background would cover the axes beside
            axes.set(xlim=(low[0], high[0]), ylim=(low[1], high[1]), zlim=(low[2], high[2]))
            size = high - low
            axes.set_box_aspect(size, zoom=0.95)
            for name, share, label in zip("xyz", size / size.max(), names, strict=True):
                axis = getattr(axes, f"{name}axis")
                axis.set_major_locator(
                    MaxNLocator(nbins=4 if share > 0.5 else 2 if share > 0.2 else 1)
                )
                axis.set_label_text(label)
                axis.pane.set(edgecolor=_EDGE, linewidth=0.8, closed=True)  # the box ends there
                axis.labelpad = 0 if name == "z" and share < 0.5 else 6 if name == "z" else 9
                axes.tick_params(axis=name, pad=0)
            axes.set_title("", y=1.0)  # y stops matplotlib from moving the title
        axes.set_title(title, fontsize=SIZE)
        return axes


def choose_view(
    points: Float[np.ndarray, "n 3"],
    kind: str | None = None,
    space: bool = False,
    units: Units = SI,
    heights: float | None = 1.0,
) -> View:
    """Return the view of a structure: of the given kind, or else elevation or plan.

    Args:
        points: all positions that are drawn, [n, 3].
        kind: "plan", "elevation", "space", or None to choose one of the first two: elevation for a
            structure that lies in a vertical plane or is higher than half its width, the smaller
            of its extents in plan.
        space: whether to choose "space" instead, unless the structure lies in a vertical plane.
        units: `Units` of the coordinates in the picture.
        heights: factor on heights in an elevation; None for a round one, at most 100, at which the
            picture is not very low.
    """
    if heights is not None and not heights > 0:
        raise ValueError(f"heights = {heights!r}: must be positive, or None")
    if kind is not None and kind not in VIEWS:
        raise ValueError(f'view = {kind!r}: expected "plan", "elevation" or "space"')
    along, plane = _elevation_direction(points)
    size = np.ptp(points, axis=0)
    if kind is None:
        high = plane or size[2] > _HIGH * min(size[:2])
        kind = "space" if space and not plane else "elevation" if high else "plan"
    if kind != "elevation":
        heights = 1.0
    elif heights is None:
        wide, high = np.ptp(View(kind, along).project(points), axis=0)
        level = high <= _PLANE * wide  # what is left of heights is rounding
        heights = 1.0 if level else round_factor(min(_LOW * wide / high, _MOST))
    return View(kind, along, plane, units, heights)


def round_factor(wanted: float) -> float:
    """Return 1, 2 or 5 times a power of ten, the largest that is not above `wanted`; at least 1."""
    if wanted < 2.0 or not np.isfinite(wanted):
        return 1.0
    power = 10.0 ** np.floor(np.log10(wanted))
    return float(power * next(r for r in _ROUND if r * power <= wanted * (1 + 1e-9)))


def _elevation_direction(points):
    """Return the horizontal unit vector of an elevation, [3], and whether all points lie in it.

    Then they are in one vertical plane, which has this direction. `points` are [n, 3], m.
    """
    level = points[:, :2] - points[:, :2].mean(axis=0)
    size = np.ptp(level, axis=0)
    spread, directions = np.linalg.svd(level, full_matrices=False)[1:]
    largest = max(np.ptp(points, axis=0).max(), 1e-300)
    plane = bool(np.abs(level @ directions[1]).max() <= _PLANE * largest)
    if plane and spread[0] > _PLANE * largest:
        along = directions[0] * np.where(directions[0] @ [1.0, 1e-3] < 0, -1.0, 1.0)
        along = np.where(np.abs(along) < _PLANE, 0.0, along)
    else:
        along = np.array([0.0, 1.0]) if size[1] > 1.5 * size[0] else np.array([1.0, 0.0])
    return np.append(along / np.linalg.norm(along), 0.0), plane
