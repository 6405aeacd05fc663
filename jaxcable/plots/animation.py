"""Moving pictures of all phases, increment by increment: `animation`."""

from __future__ import annotations

import base64
import io
import itertools
import os
from collections.abc import Sequence
from pathlib import Path

import jax
import numpy as np
from matplotlib.colors import to_rgb
from PIL import Image

from ..analysis.solution import Solution
from ..common.types import Int
from ..common.writing import written
from ..model.parts import pieces
from ..model.structure import Structure
from .glyphs import draw_supports, support_keys, supports
from .layout import arrange, settle
from .members import Members, Scale, ghost, keys
from .shapes import Shapes, known
from .stages import drawn, forces_of, named, shown, start_of
from .style import OVER, SLACK, colour_map
from .views import View, choose

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
    if not (isinstance(frames, int) and frames > 0):
        raise ValueError(f"frames = {frames}: must be a positive integer")
    if not rate > 0:
        raise ValueError(f"rate = {rate}: must be positive")
    colour = shown(solution, structure, colour)
    begin = start_of(solution, solution.last)
    shots = _shots(solution, begin, structure, magnify, colour, frames, names)
    shown_points = (drawn(shot.positions, shot.curves, shot.forces.present) for shot in shots)
    everything = np.concatenate([begin, *itertools.chain.from_iterable(shown_points)])
    seen = choose(everything, view)
    if view is None and not seen.plane:
        seen = View("space")
    images = _draw(shots, begin, seen, everything, solution, structure, dpi)
    (_gif if path.suffix.lower() == ".gif" else _html)(images, path, rate)
    return path


class _Shot:
    """The contents of a frame: number of the phase, title, positions, `Forces`, `Curves`."""

    def __init__(self, phase, title, positions, forces, curves):
        self.phase, self.title, self.positions, self.forces = phase, title, positions, forces
        self.curves = curves


def _shots(solution, begin, structure, magnify, colour, frames, names=None):
    """The frames, a list of `_Shot`."""
    named(solution, names)
    converged = [
        (k, number)
        for k, phase in enumerate(solution.phases)
        for number in np.flatnonzero(np.asarray(phase.path.status) == 0)
    ]
    if not converged:
        raise ValueError("solution: has no converged increment to draw; see raise_if_failed")
    origin = begin if len(solution.phases) == 1 else np.asarray(solution.phases[0].positions)
    paths = [jax.tree.map(np.asarray, phase.path) for phase in solution.phases]
    chosen = [converged[j] for j in evenly(len(converged), frames)]
    shapes = Shapes(solution, structure)
    every = shapes.along(chosen)
    first = shapes.start(every[0]) if len(solution.phases) == 1 else shapes.after(0)
    shots = []
    for (k, number), curves in zip(chosen, every, strict=True):
        path = paths[k]
        base = begin if k == 0 else np.asarray(solution.phases[k - 1].positions)
        place = base + path.displacement[number]
        if k > 0 or len(solution.phases) == 1:
            place = origin + magnify * (place - origin)
            curves = curves if curves is None else curves.magnified(first, magnify)
        name = f"Phase {k + 1}" if names is None else names[k]
        title = f"{name}, load factor {path.load_factor[number]:.2f}"
        part = jax.tree.map(lambda t, number=number: t[number], path)
        forces = forces_of(part, solution, structure, colour)
        shots.append(_Shot(k, title, place, forces, curves))
    return shots


def evenly(n: int, most: int) -> Int[np.ndarray, " n_frame"]:
    """At most `most` of the numbers from 0 to n - 1, evenly spaced, with the last one."""
    return np.round(np.linspace(n - 1, 0, min(most, n))).astype(int)[::-1]


def _draw(shots, begin, seen, everything, solution, structure, dpi):
    """The frames as images with one palette, so that colours do not flicker."""
    palette = Image.new("P", (1, 1))
    palette.putpalette(_palette())
    links = pieces(solution.last.topology.parts)[:2]
    scale = Scale([shot.forces for shot in shots])
    figure, slots = arrange([seen.ratio(everything)], [seen.flat])
    figure.set_dpi(dpi)
    axes = seen.add_axes(figure, everything, shots[0].title)
    begun = Shapes(solution, structure).start(shots[0].curves)
    ghost(axes, seen, begin, links, shots[0].forces.present, begun)
    lines = Members(axes, seen, links, scale)
    lines.show(shots[0].positions, shots[0].forces, shots[0].curves)
    rotates = None if structure is None else structure.rotating()
    kinds = [
        supports(fixed.array[: len(shots[0].positions)], rotates, seen.normal)
        for fixed in solution.last.fixed[1:]
    ]
    before = bool(known(begun, shots[0].forces.present).any())
    handles = keys([shot.forces for shot in shots], before, counted=False)
    handles += support_keys(np.any([kinds[shot.phase] for shot in shots], axis=0))
    settle(figure, slots, lines.taut, scale.label, handles)
    images = []
    for shot in shots:
        lines.show(shot.positions, shot.forces, shot.curves)
        axes.title.set_text(shot.title)
        marks = draw_supports(axes, seen, shot.positions, kinds[shot.phase])
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
    with written(path, "wb") as stream:
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
    page = _PAGE.replace("WIDTH", str(images[0].width)).replace("LAST", str(len(images) - 1))
    page = page.replace("WAIT", str(round(1000 / rate))).replace("FRAMES", ",\n".join(frames))
    with written(path) as stream:
        stream.write(page)


_PAGE = """<!DOCTYPE html>
<html lang="en">
<head><meta charset="utf-8"><title>jaxcable</title></head>
<body style="font-family: sans-serif; max-width: WIDTHpx; margin: auto">
<img id="frame" alt="a frame" style="width: 100%">
<div style="display: flex; gap: 1em">
<button id="play" type="button">Pause</button>
<input id="place" type="range" min="0" max="LAST" value="0" aria-label="frame" style="flex: 1">
</div>
<script>
const frames = [FRAMES];
const image = document.getElementById("frame"), place = document.getElementById("place");
const button = document.getElementById("play");
let playing = true;
function show() { image.src = frames[place.value]; }
function play(on) { playing = on; button.textContent = on ? "Pause" : "Play"; }
button.onclick = () => play(!playing);
place.oninput = () => { play(false); show(); };
setInterval(() => {
  if (!playing) return;
  place.value = (Number(place.value) + 1) % frames.length;
  show();
}, WAIT);
show();
</script>
</body>
</html>
"""
