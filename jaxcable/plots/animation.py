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
from ..common.writing import atomic_write
from ..model.structure import Structure
from .glyphs import draw_supports, support_keys
from .layout import arrange, settle
from .members import Members, Scale, ghost, keys
from .page import filled
from .snapshots import Snapshots
from .style import OVER, SLACK, colour_map
from .views import choose

_HOLD = 10  # how many times longer the last frame is shown


def animation(
    solution: Solution,
    path: str | os.PathLike[str],
    *,
    magnify: float = 1.0,
    colour: str = "tension",
    structure: Structure | None = None,
    view: str | None = None,
    names: Sequence[str] | None = None,
    frames: int = 60,
    rate: float = 10.0,
    dpi: float = 110,
) -> Path:
    """Save the increments of all phases as moving pictures, in space or in their plane.

    Limits of the axes and the colour scale are the same in all frames. With a `structure`, beams
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
        colour, structure: as for `net`.
        view: "plan", "elevation" or "space"; default: elevation for a structure in a vertical
            plane, else space.
        names: names of the phases for the titles, one for each.
        frames: largest number of frames, taken evenly from all increments, with the last one.
        rate: frames per second.
        dpi: pixels per inch, of a picture about 5 inches wide.

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
    found = Snapshots(solution, structure, colour, names)
    shots = found.increments(frames)
    start, single = shots[0].before(), len(solution.phases) == 1
    origin = start if single else found.after(0)
    shots = [s.magnified(origin, magnify) if single or s.phase > 0 else s for s in shots]
    everything = np.concatenate([start.positions, *(shot.points() for shot in shots)])
    seen = choose(everything, view, space=True)
    images = _draw(found, start, shots, seen, everything, dpi)
    (_gif if path.suffix.lower() == ".gif" else _html)(images, path, rate)
    return path


def _draw(found, start, shots, seen, everything, dpi):
    """The frames as images with one palette, so that colours do not flicker."""
    palette = Image.new("P", (1, 1))
    palette.putpalette(_palette())
    forces = [shot.forces for shot in shots]
    scale = Scale(forces)
    names = found.names or [f"Phase {k + 1}" for k in range(len(found.solution.phases))]
    titles = [f"{names[shot.phase]}, load factor {shot.factor:.2f}" for shot in shots]
    figure, slots = arrange([seen], [everything], titles[:1])
    figure.set_dpi(dpi)
    (axes,) = figure.axes
    ghost(axes, seen, found.links, start)
    lines = Members(axes, seen, found, scale)
    lines.show(shots[0])
    held = [shot.held(seen.normal) for shot in shots]
    handles = keys(forces, bool(start.known().any()), counted=False)
    handles += support_keys(np.any(held, axis=0))
    settle(figure, slots, lines.taut, scale.label, handles)
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


def _gif(images, path, rate):
    """Save all frames as a GIF that repeats, the last frame for longer."""
    times = [round(1000 / rate)] * len(images)
    times[-1] *= _HOLD
    with atomic_write(path, "wb") as stream:
        options = {"save_all": True, "append_images": images[1:], "duration": times, "loop": 0}
        images[0].save(stream, "GIF", **options)


def _palette():
    """A palette of 256 colours, flat: greys, and colours of lines in four shades up to white."""
    lines = np.concatenate(
        [colour_map()(np.linspace(0, 1, 53))[:, :3], *([to_rgb(c)] for c in (SLACK, OVER))]
    )
    grey = np.linspace(0.0, 1.0, 36)[:, None] * np.ones(3)
    faded = [1.0 - part * (1.0 - lines) for part in (1.0, 0.75, 0.5, 0.25)]
    return np.round(255 * np.concatenate([grey, *faded])).astype(int).ravel().tolist()


def _html(images, path, rate):
    """Save a page that contains all frames and a slider."""
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
        stream.write(filled("frames.html", parts))
