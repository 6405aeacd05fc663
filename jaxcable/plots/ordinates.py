"""Ordinates of diagrams on beams: to which side they are drawn, and which values are written."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
from matplotlib.lines import Line2D
from matplotlib.patheffects import Normal, Stroke

from ..common.types import Float, Int
from .style import INK, format_value
from .views import View

_SIDES = {
    "My": "drawn on the side in tension; negative: at -z (level beams: sagging)",
    "Mz": "drawn on the side in tension; negative: at y",
}
_INSIDE = 4.0  # least distance of a text from the frame of a picture, in pixels
_UPRIGHT = 2.0  # height over width of all beams from which on they are seen in an elevation
_REPEATED = 2  # times that one text is written
_FARTHER = 4.0  # distance of equal texts over that of others
_EQUAL = 6  # decimals up to which values are compared
_LEAST = 0.05  # of the largest value: less is not written


def side_legend(of: str) -> list[Line2D]:
    """Return the legend entry on the side to which bending moments are drawn; [] for others.

    `of` is the name of the section force.
    """
    return [Line2D([], [], linestyle="", label=_SIDES[of])] if of in _SIDES else []


def write_largest_values(
    axes: Any,
    view: View,
    ordinates: Sequence[Float[np.ndarray, "n_beam n_place 3"]],
    values: Float[np.ndarray, "n_beam n_place"],
    factor: float,
    limits: tuple[float, int, float],
) -> None:
    """Write the values at ends and extremes beside the tips of their ordinates, the largest first.

    Values too close to a written one are left out, and so are those of which two are written:
    repeated bays have the same values.

    Args:
        axes, view: of the picture.
        ordinates: bases and tips of the ordinates, m.
        values: of all ordinates, N or N m; texts have these times `factor`.
        factor: factor from N or N m to the unit of the texts.
        limits: least distance of written values, m, their largest number, and their least
            magnitude.
    """
    apart, most, least = limits
    halo = [Stroke(linewidth=2.5, foreground="white"), Normal()]
    look: Any = {"color": INK, "zorder": 9, "path_effects": halo}
    beam: Int[np.ndarray, " n_beam"] = np.arange(len(values))
    at = np.stack(
        [0 * beam, 0 * beam + values.shape[1] - 1, values.argmax(axis=1), values.argmin(axis=1)]
    )
    bases, tips = (own[beam, at].reshape(-1, 3) for own in ordinates)
    found = values[beam, at].ravel()
    kept: list[int] = []
    written: list[str] = []
    # equal values count in their order, whatever their rounding errors
    sizes = [float(f"{abs(value):.{_EQUAL}e}") for value in found]
    for k in np.argsort(-np.array(sizes), kind="stable"):
        if len(kept) == most or np.abs(found[k]) <= max(least, _LEAST * np.abs(found).max()):
            break
        text = format_value(factor * float(found[k]))
        if written.count(text) == _REPEATED:
            continue
        away = [apart * (_FARTHER if text == other else 1.0) for other in written]
        if all(np.linalg.norm(tips[k] - tips[j]) > d for j, d in zip(kept, away, strict=True)):
            kept.append(int(k))
            written.append(text)
            place = view.project(tips[k])
            across, up = (place - view.project(bases[k]))[:2] if view.flat else (0.0, 0.0)
            beside = abs(across) > abs(up)
            look["ha"] = ("left" if across > 0 else "right") if beside else "center"
            look["va"] = "center" if beside or not up else "bottom" if up > 0 else "top"
            axes.text(*place, text, **look)


def keep_texts_inside(axes: Any) -> None:
    """Move texts of flat axes that have their final place, so that none crosses the frame.

    Of texts that cover each other the first one stays, also in space.
    """
    axes.figure.draw_without_rendering()
    if axes.name == "3d":
        _remove_covered_texts(axes)
        return
    low, high = axes.bbox.min + _INSIDE, axes.bbox.max - _INSIDE
    for text in axes.texts:
        box = text.get_window_extent()
        shift = np.maximum(low - box.min, 0.0) - np.maximum(box.max - high, 0.0)
        place = axes.transData.transform(text.get_position()) + shift
        text.set_position(axes.transData.inverted().transform(place))
    axes.figure.draw_without_rendering()
    _remove_covered_texts(axes)


def _remove_covered_texts(axes):
    """Remove texts of axes that cover an earlier one; they have been drawn."""
    kept: list[Any] = []
    for text in list(axes.texts):
        box = text.get_window_extent()
        if any(box.overlaps(other) for other in kept):
            text.remove()
        else:
            kept.append(box)


def positive_side_directions(
    axes: Float[np.ndarray, "n_beam 3 3"], ends: Float[np.ndarray, "n_beam 2 3"], of: str
) -> Float[np.ndarray, "n_beam 3"]:
    """Return unit vectors across the beams, to which positive values are drawn, [n_beam, 3].

    `axes` are the section axes of the beams, in rows, [n_beam, 3, 3], `ends` the positions of their
    ends, [n_beam, 2, 3], m, and `of` is the name of the section force.
    """
    chord = ends[:, 1] - ends[:, 0]
    chord = chord / np.linalg.norm(chord, axis=1, keepdims=True)
    side = {"Vy": axes[:, 1], "Mz": -axes[:, 1]}.get(of, axes[:, 2])
    side = side - (side * chord).sum(axis=1, keepdims=True) * chord
    return side / np.maximum(np.linalg.norm(side, axis=1, keepdims=True), 1e-12)


def default_section_axes(ends: Float[np.ndarray, "n_beam 2 3"]) -> Float[np.ndarray, "n_beam 3 3"]:
    """Return the axes of beams without a stated `up` vector, in rows, [n_beam, 3, 3].

    `ends` are the positions of their ends, [n_beam, 2, 3], m.
    """
    chord = ends[:, 1] - ends[:, 0]
    chord = chord / np.linalg.norm(chord, axis=1, keepdims=True)
    steep = np.abs(chord[:, 2:]) > 0.999
    axes_z = np.where(steep, [[1.0, 0.0, 0.0]], [[0.0, 0.0, 1.0]])
    return np.stack([chord, np.cross(axes_z, chord), axes_z], axis=1)


def side_directions_in_picture(
    sides: Float[np.ndarray, "n_beam 3"], chord: Float[np.ndarray, "n_beam 3"], view: View
) -> Float[np.ndarray, "n_beam 3"]:
    """Turn directions across beams into the plane of a flat picture, at right angles to the beams.

    `sides`, [n_beam, 3], are directions as of `positive_side_directions`, which stay unchanged in
    space; `chord` are the vectors from start to end of the beams, [n_beam, 3], m.
    """
    if not view.flat:
        return sides
    basis = view.project(np.eye(3)).T / view.scale  # directions of the picture, [2, 3]
    across = view.project(chord) @ np.array([[0.0, 1.0], [-1.0, 0.0]])
    across = across / np.maximum(np.linalg.norm(across, axis=1, keepdims=True), 1e-12)
    along = (across * view.project(sides)).sum(axis=1, keepdims=True)
    return np.where(along < -1e-9, -across, across) @ basis


def view_of_ordinates(
    view: View, ends: Float[np.ndarray, "n_beam 2 3"], sides: Float[np.ndarray, "n_beam 3"]
) -> View:
    """Return the elevation that shows the ordinates of upright beams in their true length.

    It is for masts and towers, whose ordinates hide each other in space: beams that are at least
    twice as high as wide. Of others, and for a plane `view`, it is that view.

    Args:
        view: `View` that was chosen.
        ends: positions of the ends of the beams, [n_beam, 2, 3], m.
        sides: directions of the ordinates, as of `positive_side_directions`, [n_beam, 3].
    """
    size = np.ptp(ends.reshape(-1, 3), axis=0) if len(ends) else np.zeros(3)
    if view.flat or size[2] <= _UPRIGHT * size[:2].max():
        return view
    along = np.linalg.eigh(sides[:, :2].T @ sides[:, :2])[1][:, -1]  # that of most of them
    along = along * (-1.0 if along @ [1.0, 1e-3] < 0 else 1.0)
    along = np.where(np.abs(along) < 1e-9, 0.0, along)
    return View("elevation", np.append(along, 0.0), False, view.units)
