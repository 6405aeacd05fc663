"""The tables of a report on a state, one function per table."""

from __future__ import annotations

from collections.abc import Mapping
from typing import NamedTuple

import numpy as np

from ..analysis import solution as results
from ..common.types import ArrayLike, Bool, Float, PyTree
from ..design import utilisation
from ..elements.abilities import Sagging
from ..elements.element import PRESENT
from ..model.parts import (
    columns,
    first_and_last,
    groups_by_name,
    per_group,
    pieces,
    slack_cables,
    there,
)
from ..model.structure import Structure
from ..results.energy import energy_balance
from ..stiffness import buckling_factor
from .table import Table

BUCKLING = (
    "utilisation in compression is force over strength, buckling is not in it: see "
    "stiffness.buckling_factor"
)
_ROUNDING = 1e-9  # compression over the largest force up to which it is rounding
_IMBALANCE = 0.05  # imbalance over the largest term of a phase from which there is a note


class State(NamedTuple):
    """A state that counts in envelopes: the end of a phase, or a case.

    Attributes:
        tension: axial forces in the shape of the elements, N.
        peak_tension: largest force along each element, likewise, N.
        reactions: reactions at all nodes, [n_node, 3], N.
        present: 1 for elements that are there, in the shape of the elements; None if all are.
        fixed: freedoms that supports hold in this state, [n_row, 3 or 6] bool.
    """

    tension: PyTree[Float[ArrayLike, " n_elem"]]
    peak_tension: PyTree[Float[ArrayLike, " n_elem"]]
    reactions: Float[ArrayLike, "n_node 3"]
    present: PyTree[Float[ArrayLike, " n_elem"]] | None
    fixed: Bool[np.ndarray, "n_row n_freedom"]


def reactions(
    structure: Structure,
    state: results.State,
    fixed: Bool[np.ndarray, "n_row n_freedom"],
    states: Mapping[str, State],
) -> Table:
    """Reactions at the end, and the largest resultant over cases or phases with its case.

    The table has all nodes that are held at the end or in one of these states.
    """
    forces = np.asarray(state.reactions)
    turning = state.reaction_moments is not None
    columns, units = ["node", "Rx", "Ry", "Rz", "R"], ["", "N", "N", "N", "N"]
    if turning:
        moments = np.asarray(state.reaction_moments)
        columns, units = [*columns, "Mx", "My", "Mz"], [*units, "N m", "N m", "N m"]
    columns, units = [*columns, "largest R", "in"], [*units, "N", ""]
    names = list(states)
    sizes = np.array([np.linalg.norm(np.asarray(s.reactions), axis=1) for s in states.values()])
    held = _held(structure, fixed)
    for other in states.values():
        held = held | _held(structure, other.fixed)
    rows = []
    for k in np.flatnonzero(held):
        row = [int(k), *forces[k].tolist(), float(np.linalg.norm(forces[k]))]
        row += moments[k].tolist() if turning else []
        worst = int(sizes[:, k].argmax()) if names else None
        row += [None, None] if worst is None else [float(sizes[worst, k]), names[worst]]
        rows.append(row)
    return Table("Reactions", tuple(columns), tuple(units), rows, governing=4)


def _held(structure, fixed):
    """Nodes with a support of their position, or of their rotation if they have one, [n_node]."""
    fixed = fixed[: structure.n_node]
    held = fixed[:, :3].any(axis=1)
    return held | (fixed[:, 3:].any(axis=1) & structure.rotating())


def equilibrium(structure: Structure, state: results.State) -> Table:
    """Sums of loads and reactions; also of moments about the origin if all forces are at nodes."""
    load, reactions = np.asarray(state.load, float), np.asarray(state.reactions, float)
    rows = [
        ["loads", *load.sum(0).tolist()],
        ["reactions", *reactions.sum(0).tolist()],
        ["sum of forces", *(load + reactions).sum(0).tolist()],
    ]
    units = ["", "N", "N", "N"]
    notes = []
    size = np.abs(load).sum() + np.abs(reactions).sum()
    apart = np.abs((load + reactions).sum(0)).max()
    notes.append(
        f"forces out of balance: {apart:.1e} N, {apart / size if size else 0.0:.1e} of all forces"
    )
    if not any(group.shaped_by_load and not group.slides for group in structure.groups):
        moment = np.cross(np.asarray(state.positions, float), load + reactions).sum(0)
        span = np.ptp(np.asarray(structure.nodes, float), axis=0).max()
        apart = np.abs(moment).max()
        share = apart / (size * span) if size else 0.0
        notes.append(
            f"moments about the origin out of balance: {apart:.1e} N m, {share:.1e} of all forces "
            "times the extent"
        )
    else:
        notes.append("moments not summed: beams and catenaries carry loads between their nodes")
    columns = ("of", "x", "y", "z")
    return Table("Global equilibrium", columns, tuple(units), rows, tuple(notes))


def members(structure, state, states):
    """Force, utilisation and envelope of every element, by the largest force along it."""
    try:
        used = per_group(structure, utilisation(structure, state))
        most = {name: per_group(structure, utilisation(structure, s)) for name, s in states.items()}
    except ValueError:  # no group has a strength
        used, most = [None] * len(structure.groups), {}
    now = _forces(structure, state)
    each = {name: _forces(structure, s) for name, s in states.items()}
    names, rows = list(each), []
    for number, (label, group) in enumerate(groups_by_name(structure)):
        if now[number] is None:  # a group without axial forces
            continue
        force = np.array([each[name][number] for name in names])
        share = [most[n][number] for n in names if n in most and most[n][number] is not None]
        for k, ends in enumerate(first_and_last(group).tolist()):
            here = np.isfinite(now[number][k])
            row = [label, k, *ends, float(now[number][k]) if here else None]
            if names and np.isfinite(force[:, k]).any():
                low, high = int(np.nanargmin(force[:, k])), int(np.nanargmax(force[:, k]))
                row += [float(force[low, k]), names[low], float(force[high, k]), names[high]]
            else:
                row += [None] * 4
            row.append(float(used[number][k]) if here and used[number] is not None else None)
            row.append(max(float(s[k]) for s in share) if share else None)
            rows.append(row)
    heads = ("group", "element", "first", "last", "force", "lowest", "in", "highest", "in ")
    columns = (*heads, "used", "most used")
    units = ("", "", "", "", "N", "N", "", "N", "", "-", "-")
    known = any(value is not None for row in rows for value in row[-2:])
    notes = [] if known else ["no group has a strength: no utilisation"]
    if any(row[4] is None for row in rows):
        notes.append("no force: the element is not there")
    if any(isinstance(group, Sagging) for group in structure.groups):
        notes.append("force of a catenary: the larger of the tensions at its two ends")
    if _compressed(structure, used, now, *each.values()):
        notes.append(BUCKLING)
    if known and structure.space.rotates:
        notes.append("utilisation of beams is that of their axial force alone: see fibre_stress")
    title = "Forces, tension positive, and their envelope"
    return Table(title, columns, units, rows, tuple(notes), governing=10 if known else 4)


def _forces(structure, state):
    """Largest forces along elements, NaN for those that are not there, a list of [n_elem]."""
    parts = per_group(structure, state.peak_tension), there(structure, state.present)
    return [
        None if force is None else np.where(present, force, np.nan)
        for force, present in zip(*parts, strict=True)
    ]


def others(structure, state):
    """Tables of other results than forces along elements, a dict by name of the result.

    A result is included if elements tell one number, or one for each component.
    """
    found = {}
    for name, value in (state.results or {}).items():
        if name == PRESENT.name:  # the tables of forces leave out what is not there
            continue
        told = columns(structure.groups, {name: value})
        rows = []
        for number, (label, group) in enumerate(groups_by_name(structure)):
            parts = [column.values[number] for column in told]
            if not parts or parts[0] is None:
                continue
            for k, ends in enumerate(first_and_last(group).tolist()):
                rows.append([label, k, *ends, *(float(part[k]) for part in parts)])
        if rows:
            heads = [column.label.removeprefix(name).strip() or name for column in told]
            units = ("", "", "", "", *(column.unit for column in told))
            title = name.replace("_", " ").capitalize()
            names = ("group", "element", "first", "last", *heads)
            found[name] = Table(title, names, units, rows, governing=4)
    return found


def _compressed(structure, used, *forces):
    """Whether compression is compared with strength in any state.

    Args:
        structure: `Structure`.
        used: utilisation, a list with an item per group.
        forces: forces of every state, lists with an item per group.
    """
    sizes = [np.nanmax(np.abs(f), initial=0.0) for state in forces for f in state if f is not None]
    largest = max(sizes, default=0.0)
    return any(
        share is not None
        and force is not None
        and not group.tension_only
        and (force < -_ROUNDING * largest).any()
        for state in forces
        for group, share, force in zip(structure.groups, used, state, strict=True)
    )


def buckling(
    structure: Structure,
    state: results.State,
    reference: results.Solution | results.State | None = None,
) -> str:
    """A sentence on the lowest buckling factor of a state, by linear theory.

    Args:
        structure, state, reference: as for `stiffness.buckling_factor`.
    """
    factor = float(buckling_factor(structure, state, reference).factor[0])
    before = np.asarray(structure.nodes)
    if reference is not None:
        before = np.asarray(getattr(reference, "last", reference).positions)
    ends = pieces(structure.groups)[0]
    turn = np.degrees(_turn(before[ends], np.asarray(state.positions)[ends]))
    loads = "the loads and all forces of this state"
    if reference is not None:
        loads = "what has come since the reference"
    if np.isnan(factor):
        return (
            "buckling: no estimate; the state is a mechanism or has buckled, or cables went slack "
            "since the reference (trace_path follows the path)"
        )
    if np.isinf(factor):
        return f"buckling: at no multiple of {loads}, by linear theory"
    return (
        f"buckling: at {factor:.4g} times {loads}, by linear theory, which takes turns for small: "
        f"elements have turned by {turn:.2g} degrees at most"
    )


def energy(structure, solution, phases, start=None):
    """Work of all that acts, and stored and dissipated energy, with a line per phase.

    Args:
        structure, phases, solution, start: as for `energy_balance`.
    """
    balance = energy_balance(structure, phases, solution, start)
    names = ("dead", "following", "supports", "prestress", "stored", "dissipated", "imbalance")
    values = [getattr(balance, name) for name in names]
    values = np.column_stack([*values, 100 * balance.relative]).tolist()
    rows = [[k, *terms] for k, terms in enumerate(values, 1)]
    notes = [
        f"stored at the end: {float(balance.level[-1]):.6g} J",
        "work by the trapezoidal rule, whose error falls with the square of the increments; "
        "part: imbalance over the largest term",
    ]
    for k, gaps in enumerate(balance.increments):
        if balance.relative[k] > _IMBALANCE and len(gaps):
            worst = int(np.abs(gaps).argmax())
            notes.append(
                f"phase {k + 1} is not balanced: {gaps[worst]:.3g} J in increment {worst + 1} of "
                f"{len(gaps)}; it jumped there, began out of balance, or needs more increments"
            )
    columns, units = ("phase", *names, "part"), ("", *["J"] * len(names), "%")
    return Table(
        "Energy: work = stored + dissipated + imbalance", columns, units, rows, tuple(notes)
    )


def _turn(before, after):
    """Largest rotation of elements, rad, from their ends before and after, [n, 2, 3]."""
    first, second = before[:, 1] - before[:, 0], after[:, 1] - after[:, 0]
    sine = np.linalg.norm(np.cross(first, second), axis=1)
    return float(np.arctan2(sine, (first * second).sum(axis=1)).max())


def cutting_list(structure: Structure, solution: results.Solution) -> Table:
    """Unstressed lengths of all elements, at the temperature before the first phase."""
    lengths = per_group(structure, solution.last.rest_length)
    warmth = [state.warmth for state in solution.last.carry.states]
    lengths = [
        length if length is None or warm is None else length / np.asarray(warm)
        for length, warm in zip(lengths, warmth, strict=True)
    ]
    notes = ["at the temperature before the first phase"]
    rows = []
    for (label, group), length in zip(groups_by_name(structure), lengths, strict=True):
        if length is None:  # a group without unstressed lengths
            continue
        ends = first_and_last(group).tolist()
        rows += [[label, k, *ends[k], float(length[k])] for k in range(len(ends))]
        notes.append(
            f"{label or 'all'}: {len(ends)} pieces, {float(np.sum(length)):.3f} m in total"
        )
    columns = ("group", "element", "first", "last", "unstressed length")
    return Table("Cutting list", columns, ("", "", "", "", "m"), rows, tuple(notes))


def slack(structure: Structure, states: Mapping[str, State]) -> Table:
    """Cables without tension, and the states in which they are slack."""
    found = {}
    for name, state in states.items():
        parts = per_group(structure, state.tension), there(structure, state.present)
        for (label, group), force, present in zip(groups_by_name(structure), *parts, strict=True):
            for k in np.flatnonzero(slack_cables(group, force, present)):
                found.setdefault((label, int(k)), []).append(name)
    rows = [[label, k, ", ".join(names)] for (label, k), names in found.items()]
    notes = () if rows else ("none",)
    return Table("Slack cables", ("group", "element", "in"), ("", "", ""), rows, notes)


def loose(structure, states):
    """Nodes that only slack cables touch, but for pinned ones, and the states in which they are."""
    found = {}
    for name, state in states.items():
        taut = state.fixed[: structure.n_node, :3].all(axis=1)
        touched = np.zeros(structure.n_node, bool)  # a node that waits is not loose
        parts = (
            structure.groups,
            per_group(structure, state.tension),
            there(structure, state.present),
        )
        for group, force, present in zip(*parts, strict=True):
            slack = slack_cables(group, force, present)
            touched[group.links.array[present]] = True
            taut[group.links.array[present & ~slack]] = True
        for k in np.flatnonzero(~taut & touched):
            found.setdefault(int(k), []).append(name)
    rows = [[k, ", ".join(names)] for k, names in found.items()]
    return Table("Loose nodes", ("node", "in"), ("", ""), rows, () if rows else ("none",))
