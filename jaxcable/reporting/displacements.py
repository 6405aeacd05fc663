"""The tables of a report on displacements and rotations of nodes, and tilts of elements."""

from __future__ import annotations

from collections.abc import Callable, Mapping

import numpy as np

from ..common import status
from ..common.negligible import NEGLIGIBLE
from ..common.types import Float
from ..common.units import Units
from ..elements import Bars
from ..model.result_parts import active_nodes
from ..results import element_tilts, rotation_vectors
from .columns import concatenate_groups, element_columns, envelope_columns, without_blank_rows
from .states import EnvelopeState, ReportedAnalysis
from .table import Column, Table, make_table

_AXES = "ux", "uy", "uz"
# Displacement over the extent of the structure up to which a node has not moved: analyses end
# within 1e-10 of the forces, which moves nodes by far less.
_NEGLIGIBLE = 1e-9
# Displacement over the extent from which units or stiffness are in doubt. Roofs and bridges move by
# 1/500 to 1/50 of their extent; a structure that moves by a tenth of it has found another form, or
# is given in mm.
_LARGE = 0.1


def displacement_tables(of: ReportedAnalysis) -> dict[str, Table]:
    """Return the displacements from the start, by node and state, and their envelope.

    Returns:
        A dict: ``displacements``, with a row for each node that moves and each state, and for
        several states ``displacement_envelope``; empty without states, or if nothing moves.
    """
    nodes = np.asarray(of.structure.nodes, float)
    note = "from the start: from the initial geometry, with all phases so far"
    return _displacement_tables(of, of.envelope, lambda _: nodes, "from the start", note)


def displacement_tables_since(
    of: ReportedAnalysis, begin: int, where: str, after: bool
) -> dict[str, Table]:
    """Return the displacements from the geometry in which a phase began, by node and state.

    Args:
        of: `ReportedAnalysis`; of cases each has its own geometry.
        begin: index of the phase, as of `reference_phase`.
        where: what the tables call its beginning, such as "the beginning of phase 2, wind".
        after: whether there are cases that begin at the end of the phases.

    Returns:
        A dict as of `displacement_tables`: ``displacements_since`` and, for several states,
        ``displacement_since_envelope``.
    """

    def geometry(name):
        # cases that begin at the end of the solution have no phases of their own from before
        before, own = of.solution.phases, () if of.cases is None else of.cases[name].phases
        phases = [*before, *own] if after else own if begin < len(own) else before
        phase = phases[begin]
        return np.asarray(phase.positions, float) - np.asarray(phase.displacement_in_phase, float)

    states = dict(list(of.envelope.items())[begin if of.cases is None else 0 :])
    note = f"from the geometry at {where}"
    found = _displacement_tables(of, states, geometry, f"since {where}", note)
    names = "displacements_since", "displacement_since_envelope"
    return dict(zip(names, found.values(), strict=False))


def largest_displacement_sentence(tables: Mapping[str, Table], where: str, units: Units) -> str:
    """Return the sentence on the largest displacement in tables of `displacement_tables_since`.

    `where` is from where they count, and `units` are those of the sentence.
    """
    table = tables.get("displacements_since")
    if table is None:
        return f"no displacements since {where}"
    column = table.columns.index("u")
    sizes = [float(row[column] or 0.0) for row in table.rows]
    largest = max(sizes)
    node, state = table.rows[sizes.index(largest)][:2]
    text = units.text(largest, "m", ".4g")
    return f"largest displacement since {where}: {text}, node {node}, {state}"


def _displacement_tables(
    of: ReportedAnalysis,
    states: Mapping[str, EnvelopeState],
    geometry: Callable[[str], Float[np.ndarray, "n_node 3"]],
    where: str,
    note: str,
) -> dict[str, Table]:
    """Return the tables of displacements from a reference geometry, as `displacement_tables`.

    Args:
        of: `ReportedAnalysis`.
        states: the states of the tables, by name.
        geometry: function from the name of a state to its reference geometry, [n_node, 3], m.
        where: names this geometry in titles.
        note: names it in a sentence.
    """
    if not states:
        return {}
    each = [np.asarray(x.result.positions, float) - geometry(k) for k, x in states.items()]
    moved, names = _nan_if_inactive(of.structure, states, each), list(states)
    sizes = np.linalg.norm(moved, axis=2)
    largest = np.nan_to_num(sizes).max(axis=0)  # NaN: no active element, the node is not there
    nodes = np.flatnonzero(largest > _NEGLIGIBLE * _largest_side(of.structure))
    if not len(nodes):
        return {}
    columns = _vector_columns(of, nodes, names, moved, (*_AXES, "u"), "m", "total u")
    if of.cases is None and where == "from the start":
        good = [phase for phase in of.solution.phases if int(phase.status) == status.OK]
        each = [np.asarray(phase.displacement_in_phase) for phase in good]
        within = np.linalg.norm(_nan_if_inactive(of.structure, states, each), axis=2)
        values = within[:, nodes].T.ravel()
        columns.append(Column("u in phase", "m", values, "u of this phase", millimeters=True))
    notes = [note, "nodes that do not move have no row"]
    if np.isnan(sizes[:, nodes]).any():
        notes[-1] += f", nor have those without active element in this {of.kind}"
    title, columns = f"Displacements {where}, by {of.kind}", without_blank_rows(columns)
    tables = {"displacements": make_table(title, columns, notes)}
    if len(names) > 1:
        columns = [Column("node", "", nodes)]
        parts = [
            (f"{word} {axis}", moved[..., k], sign, ("in",))
            for k, axis in enumerate(_AXES)
            for word, sign in (("min", -1), ("max", 1))
        ]
        for name, values, sign, hidden in (*parts, ("max u", sizes, 1, ())):
            columns += envelope_columns(
                *(name, "m", values[:, nodes], names, sign),
                hidden=hidden,
                heading=name.replace(" ", ". "),
                millimeters=True,
                governs=name == "max u",
            )
        title = f"Envelope of displacements {where}, over all {of.name_of_states}"
        tables["displacement_envelope"] = make_table(title, columns)
    return tables


def _nan_if_inactive(structure, states, vectors):
    """Return vectors of nodes by state, [n_state, n_node, 3], with NaN at inactive nodes.

    `states` are `EnvelopeState` by name; `vectors` has [n_node, 3] for each of them.
    """
    active = [active_nodes(structure, state.result.present) for state in states.values()]
    return np.where(np.array(active)[..., None], np.array(vectors), np.nan)


def _vector_columns(of, nodes, states, vectors, names, unit, total):
    """Return the columns of vectors of some nodes, with a row for each node and state.

    Args:
        of: `ReportedAnalysis`.
        nodes: indices of the nodes, [n].
        states: names of the states.
        vectors: [n_state, n_node, 3], in `unit`.
        names: names of the columns of three components and of the length.
        total: heading of the latter.
    """
    vectors = vectors[:, nodes]
    parts = [*np.moveaxis(vectors, -1, 0), np.linalg.norm(vectors, axis=2)]
    small = unit == "m"
    columns = [
        Column("node", "", np.repeat(nodes, len(states))),
        Column(of.kind, "", list(states) * len(nodes)),
        *(
            Column(name, unit, part.T.ravel(), millimeters=small)
            for name, part in zip(names, parts, strict=True)
        ),
    ]
    columns[-1] = columns[-1]._replace(heading=total, governs=True)
    return columns


def rotation_tables(of: ReportedAnalysis) -> dict[str, Table]:
    """Return the table of rotations of nodes by state, {"rotations": Table}; empty without any."""
    if not of.structure.space.rotates or not of.envelope:
        return {}
    each = [rotation_vectors(of.structure, state.result) for state in of.envelope.values()]
    turned = _nan_if_inactive(of.structure, of.envelope, each)
    angles = np.nan_to_num(np.linalg.norm(turned, axis=2))  # NaN: the node is not there
    nodes = np.flatnonzero(angles.max(axis=0) > NEGLIGIBLE)  # beside 1 rad
    if not len(nodes):
        return {}
    names = "rx", "ry", "rz", "angle"
    columns = _vector_columns(of, nodes, of.envelope, np.degrees(turned), names, "deg", "")
    notes = [
        "from the start: against the initial geometry, with all phases so far",
        "rotation vectors: the direction is the axis, the length the angle; small ones are angles "
        "about x, y, z",
    ]
    return {"rotations": make_table("Rotations from the start", without_blank_rows(columns), notes)}


def tilt_tables(of: ReportedAnalysis) -> dict[str, Table]:
    """Return the table of tilt and twist of beams and bars, degrees, {"tilts": Table}.

    Empty if there are no such elements, or all angles are negligible. Tilt is measured from the
    initial chord. Groups of bars without compression, which are cables, and springs to the ground
    have no rows.
    """
    structure = of.structure
    kept = [
        k
        for k, group in enumerate(structure.groups)
        if group.links.shape[1] > 1  # springs have no chord
        and (group.rotates or (isinstance(group, Bars) and not group.tension_only))
    ]

    def angles(state, end=None):
        """Return the tilt, or the twist at one end, of all elements, degrees."""
        every = structure.group_tree.flatten_up_to(element_tilts(structure, state))
        if end is None:
            parts = [one.tilt for one in every]
        else:
            parts = [None if one.twist is None else one.twist[:, end] for one in every]
        return np.degrees(concatenate_groups(structure, parts, kept))

    if not kept:
        return {}
    tilt, over = of.values(angles)
    twist = [angles(of.state, end) for end in (0, 1)]
    every = np.vstack([tilt, over, *twist])  # NaN: an element is not active, or has no twist
    if not np.nan_to_num(np.abs(every)).max() > np.degrees(NEGLIGIBLE):
        return {}
    columns = [
        *element_columns(structure, kept),
        Column("tilt", "deg", tilt, governs=True),
        Column("twist first", "deg", twist[0], "twist, start"),
        Column("twist last", "deg", twist[1], "twist, end"),
    ]
    if of.several:
        columns += envelope_columns("max. tilt", "deg", over, list(of.envelope), 1)
    notes = [
        "tilt: angle between the chord of the element and its initial direction",
        "twist: rotation of the nodes about the chord, right-handed from start to end node",
    ]
    return {"tilts": make_table("Tilt and twist of beams and bars", columns, notes)}


def _largest_side(structure):
    """Return the largest side of the bounding box of the initial nodes, m."""
    return float(np.ptp(np.asarray(structure.nodes, float), axis=0).max())


def large_displacement_sentence(of: ReportedAnalysis) -> str | None:
    """Return a sentence on final displacements above a tenth of the extent; None without any."""
    moved = np.linalg.norm(np.asarray(of.state.displacement, float), axis=1)
    moved = np.where(active_nodes(of.structure, of.state.present), moved, 0.0)
    extent, units = _largest_side(of.structure), of.units
    if not moved.max() > _LARGE * extent:
        return None
    return (
        f"CHECK: node {moved.argmax()} has moved by {units.text(moved.max(), 'm', '.4g')}, "
        f"{moved.max() / extent:.0%} of the extent of the structure "
        f"({units.text(extent, 'm', '.4g')}). Unless the form was to be found: are nodes in "
        f"{units.length}, forces in {units.force}, and all parts supported?"
    )
