"""Diagrams of the tension along a cable with friction: `tension_along`."""

from __future__ import annotations

import os
from collections.abc import Sequence
from typing import Any

import numpy as np
from matplotlib.figure import Figure

from ..analysis.solution import Solution
from ..common import checks
from ..common.negligible import NEGLIGIBLE
from ..common.units import UnitsLike, as_units
from ..elements.friction_state import CLAMP_FORCE, FRICTION_USED, SEGMENT_TENSION
from ..elements.sliding_catenaries import END_TENSIONS
from ..model.result_parts import straight_pieces
from .element_forces import values_by_group
from .snapshots import Snapshots, evenly_spaced_indices
from .style import GRID, INK, display_unit, finish_figure, legend_below, new_figure, series_style

_MOST = 6
"""Curves of a diagram in a report, at most: more are hard to tell apart."""
_USED = 1 - 1e-6
"""Share of the largest ratio of tensions from which friction counts as fully used."""
_SEEN = 1e-4
"""Least difference of tensions with a mark, over the largest tension."""


def tension_along(
    solution: Solution,
    group: str | None = None,
    path: str | os.PathLike[str] | None = None,
    *,
    element: int = 0,
    phases: Sequence[int] | None = None,
    names: Sequence[str] | None = None,
    units: UnitsLike | None = None,
) -> Figure:
    """Draw the tension along a cable with friction at the ends of phases, over its present length.

    Lengths are those between nodes. Every straight segment has one tension, and one that hangs has
    two, at its ends; they jump at deviators. Dots mark those where friction is fully used, and
    squares those where a clamp holds a difference of tensions.

    Args:
        solution: `Solution` of a structure with `FrictionCables` or `SlidingCatenaries`.
        group: key of their group in the elements; None for the only one.
        path: where to save the picture, in the format of the suffix, or None.

    Options:
        element: index of the cable in its group.
        phases: indices of the phases to draw, from 0; default all that have converged.
        names: names of all phases of the solution, for the legend; default "phase 1" and so on.
        units: units of lengths and tensions, as of `net`.

    Returns:
        The matplotlib `Figure`, not registered with pyplot; see `jaxcable.plots`.

    Raises:
        ValueError: no such group, or one without friction; an unknown cable or phase; a phase that
            has not converged; a batch; another number of names than of phases; unknown units.

    A rope that turns by 90 degrees over a bar, and carries 1 kN:

    >>> import jax; jax.config.update("jax_enable_x64", True)
    >>> import jaxcable as jc
    >>> nodes = [[-3.0, 0.0, 0.0], [0.0, 0.0, 0.0], [0.0, 0.0, -1.0]]
    >>> rope = jc.FrictionCables(links=[[0, 1, 2]], axial_stiffness=1e6, friction=0.2)
    >>> held = jc.pinned([0, 1]) + jc.restrained([2], "xy")
    >>> weight = jc.NodalLoads([2], (0.0, 0.0, -1000.0))
    >>> solution = jc.solve(jc.Structure(nodes, rope, held), jc.Phase(loads=weight))
    >>> figure = jc.plots.tension_along(solution)
    >>> [axes.get_ylabel() for axes in figure.axes]
    ['tension (N)']
    """
    stated = None if units is None else as_units(units)
    snapshots = Snapshots(solution, names=names)
    number = _group_index(snapshots.parts, group)
    chains = snapshots.parts[number].links.array
    if not 0 <= element < len(chains):
        raise ValueError(f"element = {element!r}: there are elements 0 to {len(chains) - 1}")
    if phases is None:
        phases = [k for k, end in enumerate(solution.phases) if int(end.status) == 0]
    shots = [snapshots.at_state(snapshots.state_to_draw(None, k)) for k in phases]
    shots = [shot for shot in shots if shot.forces.present[shot.forces.group == number][element]]
    if not shots:
        raise ValueError("phases: the cable is in none of them, or none has converged")
    curves = [_along_cable(shot, chains[element], number, element) for shot in shots]
    factor, unit = display_unit(max(curve[1].max() for curve in curves), "N", stated)
    to_length, length = display_unit(0.0, "m", stated)
    figure = new_figure(4.8, 3.6)
    axes, seen = figure.add_subplot(), {}
    for row, (shot, (place, tension, marks)) in enumerate(zip(shots, curves, strict=True)):
        label = snapshots.titles[shot.phase]
        line = {key: series_style(row)[key] for key in ("color", "linestyle", "linewidth")}
        tension, place = factor * tension, to_length * place
        axes.plot(np.repeat(place, 2)[1:-1], tension.ravel(), label=label, **line)
        middle = 0.5 * (tension[1:, 0] + tension[:-1, 1])
        for (what, which), mark in zip(marks.items(), "os", strict=True):
            axes.plot(place[1:-1][which], middle[which], mark, color=line["color"], markersize=4)
            seen |= {what: mark} if which.any() else {}
    for what, mark in seen.items():
        axes.plot([], [], mark, color=INK, markersize=4, label=what)
    axes.set(xlabel=f"length from the first end ({length})", ylabel=f"tension ({unit})")
    axes.grid(color=GRID)
    legend_below(axes, columns=3)
    return finish_figure(figure, path)


def cables_with_largest_drop(solution: Solution) -> list[tuple[dict[str, Any], str, list[int]]]:
    """Choose the diagrams of a report: of each group with friction the cable to draw.

    It is the one with the largest difference between the tensions of its segments at the end of a
    phase. A group whose cables have none is left out.

    Args:
        solution: `Solution` that has converged.

    Returns:
        For each group the arguments `group` and `element` of `tension_along`, a caption, and the
        indices of the phases to draw: at most six of those in which the cable is there.
    """
    snapshots = Snapshots(solution)
    ends = [snapshots.after_phase(k).forces for k in range(len(solution.phases))]
    tensions = [forces.segment_tension for forces in ends if forces.segment_tension is not None]
    if not tensions:
        return []
    _, element, _ = straight_pieces(snapshots.parts)
    low, high = np.full((2, len(ends), len(ends[0].group)), np.nan)  # of elements
    for least, most, tension in zip(low, high, tensions, strict=True):
        np.fmin.at(least, element, tension)
        np.fmax.at(most, element, tension)
    drop = np.fmax.reduce(high - low, axis=0, initial=0.0)
    found = []
    for number, part in enumerate(snapshots.parts):
        own = np.flatnonzero(ends[0].group == number)
        if drop[own].max(initial=0.0) <= NEGLIGIBLE * np.fmax.reduce(high, axis=None):
            continue
        chosen = int(drop[own].argmax())
        phases = np.flatnonzero(~np.isnan(high[:, own[chosen]]))
        phases = phases[evenly_spaced_indices(len(phases), _MOST)]
        key = part.name.strip("[]'")
        caption = "Tension along " + f"{key}, element {chosen}".lstrip(", ")
        if len(own) > 1:
            caption += f": the largest drop of {len(own)} cables"
        found.append(({"group": key, "element": chosen}, caption, phases.tolist()))
    return found


def _group_index(parts, group):
    """Return the index of the group of cables with friction with a key, or of the only one.

    `parts` are `GroupTopology` of all groups. ValueError without one, or if None means several.
    """
    pairs = ((part.name.strip("[]'"), k) for k, part in enumerate(parts))
    known = {name: k for name, k in pairs if SEGMENT_TENSION in parts[k].results}
    if group is None and len(known) == 1:
        (group,) = known
    if group not in known:
        there = checks.suggest_names(group, known)
        raise ValueError(f"group = {group!r}: is no group of cables with friction{there}")
    return known[group]


def _along_cable(shot, chain, number, element):
    """Return places, tensions and marks along one cable in a `Snapshot`.

    `chain` are its nodes, [n_end], `number` is the index of its group, `element` its index there.

    Returns:
        place: distances of its nodes from the first one along the cable, [n + 1], m.
        tension: of its segments, at both ends, [n, 2], N.
        marks: by what they mean, at which deviators they are, [n - 1] bool.
    """
    count = int((chain[1:] != chain[:-1]).sum())  # shorter chains repeat their last node
    own = {name: values_by_group(tree, 0) for name, tree in shot.element_results.items()}
    hangs = END_TENSIONS.name in own and own[END_TENSIONS.name][number] is not None
    tension, used, clamp = (
        np.asarray(own[result.name][number][element])[:count]
        for result in (END_TENSIONS if hangs else SEGMENT_TENSION, FRICTION_USED, CLAMP_FORCE)
    )
    tension = tension if hangs else np.stack([tension, tension], axis=1)
    used, clamp = used[: count - 1], clamp[: count - 1]
    way = np.diff(shot.positions[chain[: count + 1]], axis=0)
    place = np.append(0.0, np.cumsum(np.linalg.norm(way, axis=1)))
    jump = np.abs(tension[1:, 0] - tension[:-1, 1])
    seen = jump > _SEEN * tension.max()  # not where the cable is straight
    full = seen & (np.abs(used) > _USED) & (clamp == 0)
    return place, tension, {"friction fully used": full, "clamp": clamp != 0}
