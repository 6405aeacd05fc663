"""The tables of a report on displacements of nodes: of every phase or case, and their envelope."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np

from ..analysis.solution import Solution
from ..common import status
from ..common.units import SI, Units
from ..model.structure import Structure
from .columns import envelope_columns
from .states import EnvelopeState
from .table import Column, Table, make_table

_AXES = "ux", "uy", "uz"
_NEGLIGIBLE = 1e-9
"""Displacement over the extent of the structure up to which a node has not moved.

Analyses end within 1e-10 of the forces: that moves nodes by far less.
"""
_LARGE = 0.1
"""Displacement over the extent from which units or stiffness are in doubt.

Roofs and bridges move by 1/500 to 1/50 of their extent; a structure that moves by a tenth of it has
found another form, or is given in mm.
"""


def displacement_tables(
    structure: Structure, solution: Solution, states: Mapping[str, EnvelopeState], cases: bool
) -> dict[str, Table]:
    """Return the displacements from the start, by node and state, and their envelope.

    Args:
        structure: `Structure`.
        solution: `Solution`.
        states: ends of phases, or load cases, by name.
        cases: whether the states are load cases.

    Returns:
        A dict: ``displacements``, with a row for each node that moves and each state, and for
        several states ``displacement_envelope``; empty without states, or if nothing moves.
    """
    if not states:
        return {}
    moved = np.array([np.asarray(other.result.positions, float) for other in states.values()])
    return _tables_of(
        structure, solution, moved - np.asarray(structure.nodes, float), states, cases
    )


def phase_index(since: int | str, labels: Sequence[str]) -> int:
    """Return the index of the phase `since`: its number from 0, or its name among `labels`.

    Raises:
        ValueError: there is no such phase.
    """
    if isinstance(since, str) and since in labels:
        return list(labels).index(since)
    if (
        isinstance(since, int)
        and not isinstance(since, bool)
        and -len(labels) <= since < len(labels)
    ):
        return since % len(labels)
    names = ", ".join(map(repr, labels))
    raise ValueError(
        f"since = {since!r}: no such phase; give 0 to {len(labels) - 1}, or one of {names}"
    )


def tables_since(
    structure: Structure,
    solution: Solution,
    states: Mapping[str, EnvelopeState],
    cases: Mapping[str, Solution] | None,
    begin: int,
    head: str,
) -> dict[str, Table]:
    """Return the displacements from the geometry in which a phase began, by node and state.

    Args:
        structure, solution, states: as for `displacement_tables`.
        cases: `Solution` of every load case by name, each with its own geometry; None for phases.
        begin: index of the phase.
        head: what the tables call it, such as "phase 2, wind".

    Returns:
        A dict as of `displacement_tables`: ``displacements_since`` and, for several states,
        ``displacement_since_envelope``.
    """

    def geometry(analysis):
        # cases that begin at the end of the solution have no phases of their own from before
        phase = (analysis if begin < len(analysis.phases) else solution).phases[begin]
        return np.asarray(phase.positions, float) - np.asarray(phase.displacement_in_phase, float)

    if cases is None:
        kept = dict(list(states.items())[begin:])
        start = dict.fromkeys(kept, geometry(solution))
    else:
        kept, start = dict(states), {name: geometry(case) for name, case in cases.items()}
    if not kept:
        return {}
    moved = np.array(
        [np.asarray(other.result.positions, float) - start[k] for k, other in kept.items()]
    )
    where = f"since the beginning of {head}"
    found = _tables_of(
        structure,
        None,
        moved,
        kept,
        cases is not None,
        where,
        f"from the geometry in which {head} began",
    )
    names = {
        "displacements": "displacements_since",
        "displacement_envelope": "displacement_since_envelope",
    }
    return {names[name]: table for name, table in found.items()}


def _tables_of(structure, solution, moved, states, cases, where="from the start", note=""):
    """Return the tables of displacements `moved`, [n_state, n_node, 3], as `displacement_tables`.

    `where` names their geometry in titles, `note` in a sentence. With a `solution` there is a
    column of displacements within each phase.
    """
    sizes = np.linalg.norm(moved, axis=2)
    nodes = np.flatnonzero(sizes.max(axis=0) > _NEGLIGIBLE * _largest_side(structure))
    if not len(nodes):
        return {}
    names, moved, sizes = list(states), moved[:, nodes], sizes[:, nodes]
    count = len(names)
    columns = [
        Column("node", "", np.repeat(nodes, count)),
        Column("case" if cases else "phase", "", names * len(nodes)),
        *(_displacement_column(axis, moved[..., k].T.ravel()) for k, axis in enumerate(_AXES)),
        _displacement_column("u", sizes.T.ravel())._replace(heading="total u", governs=True),
    ]
    if not cases and solution is not None:
        within = _displacement_sizes_within_phases(solution, names)[:, nodes]
        columns.append(
            _displacement_column("u in phase", within.T.ravel())._replace(heading="u of this phase")
        )
    notes = [note or "from the start: from the nodes of the input, with all phases so far"]
    notes.append("nodes that do not move have no row")
    tables = {"displacements": make_table(f"Displacements {where}", columns, notes)}
    if count > 1:
        kind = "cases" if cases else "ends of phases"
        title = f"Envelope of displacements {where}, over all {kind}"
        envelope = _displacement_envelope_columns(nodes, names, moved, sizes)
        tables["displacement_envelope"] = make_table(title, envelope)
    return tables


def _displacement_column(name, values):
    """Return a `Column` of displacements, given in m, which the text shows in mm."""
    return Column(name, "m", values, millimeters=True)


def _displacement_sizes_within_phases(solution, names):
    """Return the sizes of displacements since the phase began, [n_phase, n_node], m.

    Phases are those that have converged, as many as `names`.
    """
    good = [phase for phase in solution.phases if int(phase.status) == status.OK]
    assert len(good) == len(names)
    return np.array([np.linalg.norm(np.asarray(p.displacement_in_phase), axis=1) for p in good])


def _displacement_envelope_columns(nodes, names, moved, sizes):
    """Return the columns of the displacement envelope, a list of `Column`.

    `nodes` are those that move, [n], `moved` their displacements from the start in each of the
    states `names`, [n_state, n, 3], m, and `sizes` the sizes of these, [n_state, n], m.
    """
    columns = [Column("node", "", nodes)]
    for k, axis in enumerate(_AXES):
        for word, sign in (("min", -1), ("max", 1)):
            name = f"{word} {axis}"
            extreme, when = envelope_columns(
                name, "m", moved[..., k], names, sign, heading=f"{word}. {axis}"
            )
            columns += [extreme._replace(millimeters=True), when._replace(detail=True)]
    largest, when = envelope_columns("max u", "m", sizes, names, 1, heading="max. u")
    return [*columns, largest._replace(millimeters=True, governs=True), when]


def _largest_side(structure):
    """Return the largest side of the bounding box of the nodes, m."""
    return float(np.ptp(np.asarray(structure.nodes, float), axis=0).max())


def large_displacement_sentence(
    structure: Structure, solution: Solution, units: Units = SI
) -> str | None:
    """Return a sentence on a displacement above a tenth of the extent, or None; in `units`."""
    moved = np.linalg.norm(np.asarray(solution.last.displacement, float), axis=1)
    extent = _largest_side(structure)
    if not moved.max() > _LARGE * extent:
        return None
    return (
        f"CHECK: node {moved.argmax()} has moved by {units.text(moved.max(), 'm', '.4g')}, "
        f"{moved.max() / extent:.0%} of the extent of the structure "
        f"({units.text(extent, 'm', '.4g')}). Unless the form was to be found: are nodes in "
        f"{units.length}, forces in {units.force}, and all parts supported?"
    )
