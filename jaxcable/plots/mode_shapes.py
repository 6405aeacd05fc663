"""Natural modes drawn on the structure, as pictures and as moving shapes of the page."""

from __future__ import annotations

import dataclasses
import os
from typing import Any

import numpy as np
from matplotlib.figure import Figure

from ..analysis.solution import Solution
from ..common import checks
from ..common.units import UnitsLike, as_units
from ..dynamics.modes import NaturalModes
from ..model.structure import Structure
from .nets import StagePicture
from .sequences import draw_stages
from .snapshots import Snapshot, Snapshots
from .style import finish_figure
from .views import choose_view

_AMPLITUDE = 0.08  # of the node that moves most, over the extent of the structure
_FRAMES = 24  # of a period, on the page


def mode_shapes(
    modes: NaturalModes,
    solution: Solution,
    path: str | os.PathLike[str] | None = None,
    *,
    n: int = 6,
    structure: Structure | None = None,
    phase: int | None = None,
    color: str | None = None,
    view: str | None = None,
    columns: int | None = None,
    supports: bool = True,
    units: UnitsLike | None = None,
) -> Figure:
    """Draw natural modes: one small picture each, with the frequency, over the structure at rest.

    Shapes are scaled to a visible size. Elements are straight between their nodes; moving shapes
    are on the page of `view`.

    Args:
        modes: result of `dynamics.modes`.
        solution: the `Solution` whose state vibrates.
        path: where to save the picture, in the format of the suffix, or None.

    Options:
        n: number of modes, at most as many as there are.
        structure: the `Structure` that was analysed, as of `net`.
        phase: number of the phase, from 0, at whose end the state is; default the last state.
        color: values that color the elements, of the state about which they vibrate, as of
            `sequence`; default: one color for all.
        columns, supports, units: as of `sequence`.
        view: "plan", "elevation" or "space"; default elevation of what moves in a vertical plane
            alone, else space.

    Returns:
        The matplotlib `Figure`, not registered with pyplot; see `jaxcable.plots`.

    Raises:
        ValueError: modes of another structure, a batch, an unknown phase, or `n` below 1.

    >>> import jax; jax.config.update("jax_enable_x64", True)
    >>> import jaxcable as jc
    >>> structure, phases = jc.scenes.flat_net()
    >>> solution = jc.solve(structure, phases)
    >>> found = jc.dynamics.modes(structure, solution, n=2, masses=3.0)
    >>> figure = jc.plots.mode_shapes(found, solution, structure=structure)
    >>> [axes.get_title() for axes in figure.axes[:2]]
    ['mode 1: 8.02 Hz', 'mode 2: 8.49 Hz']
    """
    checks.require_whole_number(n, "n")
    snapshots = Snapshots(solution, structure, color or "tension")
    rest, amplitude = state_at_rest(modes, snapshots, phase)
    titles = mode_titles(modes)[:n]
    stages = [
        StagePicture(title, moved_by_mode(rest, amplitude * shape), rest)
        for title, shape in zip(titles, np.asarray(modes.shape), strict=False)
    ]
    if view is None:  # plan would not show what moves up and down
        points = np.concatenate([stage.points() for stage in stages])
        view = choose_view(points, None, space=True).kind
    stated = None if units is None else as_units(units)
    options = None, False, view, columns, supports, [], stated, "at rest"
    figure = draw_stages(stages, snapshots, *options, colored=color is not None)
    return finish_figure(figure, path)


def mode_titles(modes: NaturalModes) -> list[str]:
    """Return the title of each mode: its number and frequency, or that it is unstable."""
    pairs = zip(np.asarray(modes.frequency), np.asarray(modes.squared), strict=True)
    return [
        f"mode {k}: {frequency:.3g} Hz" if squared > 0 else f"mode {k}: no frequency"
        for k, (frequency, squared) in enumerate(pairs, start=1)
    ]


def state_at_rest(
    modes: NaturalModes, snapshots: Snapshots, phase: int | None = None
) -> tuple[Snapshot, float]:
    """Return the state about which modes vibrate, and the amplitude of their pictures, m.

    Its positions are the initial ones of the `Snapshot`. Arguments are those of `mode_shapes`.

    Raises:
        ValueError: modes of another structure, a batch, or a state that is not found.
    """
    shape = np.shape(modes.shape)
    state: Any = snapshots.state_to_draw(None, phase)
    count = len(np.asarray(state.positions))
    if shape[1:] != (count, 3):
        raise ValueError(
            f"modes: has shapes {shape}; expected [n, {count}, 3], the modes of this structure"
        )
    if not len(shape) or int(modes.status) != 0:
        raise ValueError("modes: were not found; see describe(modes.status)")
    found = snapshots.at_state(state)
    nothing = np.zeros_like(found.displacement)
    rest = dataclasses.replace(
        found, initial_positions=found.positions, displacement=nothing, curves=None
    )
    return rest, _AMPLITUDE * float(np.ptp(rest.positions, axis=0).max())


def moved_by_mode(rest: Snapshot, displacement: Any, **place: Any) -> Snapshot:
    """Return a state at rest, moved by a mode, [n_node, 3], m; `place` are fields of `Snapshot`."""
    return dataclasses.replace(rest, displacement=displacement, **place)


def moving_modes(
    modes: NaturalModes, snapshots: Snapshots, phase: int | None = None
) -> list[Snapshot]:
    """Return the `Snapshot`s of the page: a period of each mode, which ends where it moves most.

    Modes stand for phases, and instants of a period for increments. Arguments and errors are those
    of `state_at_rest`.
    """
    rest, amplitude = state_at_rest(modes, snapshots, phase)
    found = []
    for number, shape in enumerate(np.asarray(modes.shape)):
        for k in range(1, _FRAMES + 1):
            part = float(np.cos(2 * np.pi * k / _FRAMES))
            place: dict[str, Any] = {"phase": number, "increment": k - 1, "load_factor": part}
            place["end"] = rest.end if k == _FRAMES else None
            found.append(moved_by_mode(rest, amplitude * part * shape, **place))
    return found
