"""Moving pictures of all phases, increment by increment: `animation`."""

from __future__ import annotations

import base64
import io
import os
from collections.abc import Sequence
from pathlib import Path

import numpy as np
from matplotlib.colors import to_rgb
from PIL import Image

from ..analysis.solution import Solution
from ..common.units import SI, UnitsLike, as_units
from ..common.writing import atomic_write
from ..model.structure import Structure
from .element_lines import ColorScale, ElementLines, draw_earlier_geometry, line_legend
from .layout import arrange_pictures, finish_layout
from .page import fill_template
from .snapshots import Snapshots
from .style import OVER, SLACK, color_map
from .symbols import draw_supports, support_legend
from .views import choose_view

_LAST_FRAME_FACTOR = 10  # times longer is the last frame shown: a second, before it repeats


def animation(
    solution: Solution,
    path: str | os.PathLike[str],
    *,
    magnify: float = 1.0,
    color: str = "tension",
    structure: Structure | None = None,
    view: str | None = None,
    names: Sequence[str] | None = None,
    frames: int = 60,
    rate: float = 10.0,
    dpi: float = 110,
    units: UnitsLike | None = None,
) -> Path:
    """Save the increments of all phases as an animation, in space or in the plane of the structure.

    Limits of the axes and the color scale are the same in all frames. With a `structure`, beams
    are bent and catenaries hang, as in `net`; catenaries are exact at the ends of phases, between
    them their distances from their chords are interpolated (in the first phase they are those of
    its end).

    Args:
        solution: `Solution`; of a failed analysis the converged increments are shown.
        path: where to save the pictures, with the suffix ".gif", or ".html" for a page with a
            slider that needs no other file.

    Options:
        magnify: factor on the displacement after the first phase (of a single phase, on its
            displacement).
        color, structure: as for `net`.
        view: "plan", "elevation" or "space"; default: elevation for a structure in a vertical
            plane, else space.
        names: names of the phases for the titles, one for each.
        frames: largest number of frames, taken evenly from all increments, with the last one.
        rate: frames per second.
        dpi: pixels per inch, of a picture about 5 inches wide.
        units: units of coordinates and values, as of `net`.

    Returns:
        The `pathlib.Path` of the file.

    Raises:
        ValueError: another suffix, no converged increment, a batch, another number of names than of
            phases, or an unknown option.

    >>> import pathlib, tempfile
    >>> import jax; jax.config.update("jax_enable_x64", True)
    >>> import jaxcable as jc
    >>> solution = jc.solve(*jc.scenes.flat_net())
    >>> with tempfile.TemporaryDirectory() as folder:
    ...     made = jc.plots.animation(solution, pathlib.Path(folder) / "net.gif", frames=3)
    >>> made.name
    'net.gif'
    """
    path = Path(path)
    if path.suffix.lower() not in (".gif", ".html"):
        raise ValueError(f'path = {str(path)!r}: expected the suffix ".gif" or ".html"')
    if not rate > 0:
        raise ValueError(f"rate = {rate}: must be positive")
    stated = None if units is None else as_units(units)
    snapshots = Snapshots(solution, structure, color, names)
    shots = snapshots.increments(frames)
    start, single = shots[0].in_initial_geometry(), len(solution.phases) == 1
    origin = start if single else snapshots.after_phase(0)
    shots = [s.magnified(origin, magnify) if single or s.phase > 0 else s for s in shots]
    everything = np.concatenate([start.positions, *(shot.points() for shot in shots)])
    seen = choose_view(everything, view, space=True, units=stated or SI)
    scale = ColorScale([shot.forces for shot in shots], stated)
    images = _draw_frames(snapshots, start, shots, seen, scale, everything, dpi)
    (_save_gif if path.suffix.lower() == ".gif" else _save_html)(images, path, rate)
    return path


def _draw_frames(snapshots, start, shots, seen, scale, everything, dpi):
    """Draw a frame for each `Snapshot` in `shots`, and return the images (Pillow), a list.

    All frames have one palette, so that colors do not flicker.

    Args:
        snapshots: `Snapshots` of the solution.
        start: `Snapshot` that is drawn dashed behind.
        shots: the snapshots, in order.
        seen: `View` of the frames.
        scale: `ColorScale` of the elements.
        everything: points [n, 3], m, that the axes have to show.
        dpi: pixels per inch.
    """
    palette = Image.new("P", (1, 1))
    palette.putpalette(_shared_palette())
    forces = [shot.forces for shot in shots]
    names = snapshots.names or [f"Phase {k + 1}" for k in range(len(snapshots.solution.phases))]
    titles = [f"{names[shot.phase]}, load factor {shot.load_factor:.2f}" for shot in shots]
    figure, slots = arrange_pictures([seen], [everything], titles[:1])
    figure.set_dpi(dpi)
    (axes,) = figure.axes
    draw_earlier_geometry(axes, seen, snapshots.links, start)
    lines = ElementLines(axes, seen, snapshots, scale)
    lines.show(shots[0])
    held = [shot.support_kinds(seen.normal) for shot in shots]
    handles = scale.legend_entries() + line_legend(
        forces, bool(start.has_known_shape().any()), counted=False
    )
    handles += support_legend(np.any(held, axis=0))
    finish_layout(figure, slots, handles, (lines.taut, scale.label))
    images = []
    for shot, title, kinds in zip(shots, titles, held, strict=True):
        lines.show(shot)
        axes.title.set_text(title)
        marks = draw_supports(axes, seen, shot.positions, kinds)
        figure.canvas.draw()
        image = Image.fromarray(np.array(figure.canvas.buffer_rgba())[..., :3])
        images.append(image.quantize(palette=palette, dither=Image.Dither.NONE))
        for mark in marks:
            mark.remove()
    return images


def _save_gif(images, path, rate):
    """Save images as a GIF that repeats, `rate` images per second, the last one for longer."""
    times = [round(1000 / rate)] * len(images)
    times[-1] *= _LAST_FRAME_FACTOR
    with atomic_write(path, "wb") as stream:
        options = {"save_all": True, "append_images": images[1:], "duration": times, "loop": 0}
        images[0].save(stream, "GIF", **options)


def _shared_palette():
    """Return 256 colors as a flat list r, g, b, r, ...: greys, and line colors in four shades."""
    lines = np.concatenate(
        [color_map()(np.linspace(0, 1, 53))[:, :3], *([to_rgb(c)] for c in (SLACK, OVER))]
    )
    grey = np.linspace(0.0, 1.0, 36)[:, None] * np.ones(3)
    faded = [1.0 - part * (1.0 - lines) for part in (1.0, 0.75, 0.5, 0.25)]
    return np.round(255 * np.concatenate([grey, *faded])).astype(int).ravel().tolist()


def _save_html(images, path, rate):
    """Save the images in an HTML page with a slider, which plays them at `rate` per second."""
    frames = []
    for image in images:
        buffer = io.BytesIO()
        image.save(buffer, format="PNG", optimize=True)
        frames.append(f'"data:image/png;base64,{base64.b64encode(buffer.getvalue()).decode()}"')
    parts = {
        "@WIDTH@": str(images[0].width),
        "@LAST@": str(len(images) - 1),
        "@WAIT@": str(round(1000 / rate)),
        "@FRAMES@": ",\n".join(frames),
    }
    with atomic_write(path) as stream:
        stream.write(fill_template("frames.html", parts))
