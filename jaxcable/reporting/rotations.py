"""The tables of a report on rotations: of nodes, and tilt and twist of beams and bars."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from ..analysis.results import Results
from ..common.negligible import NEGLIGIBLE
from ..elements import Bars
from ..model.structure import Structure
from ..results import element_tilts, rotation_vectors
from .columns import concatenate_groups, element_columns, envelope_columns
from .states import EnvelopeState
from .table import Column, Table, make_table

_UNIT = "deg"


def rotation_tables(
    structure: Structure,
    state: Results,
    states: Mapping[str, EnvelopeState],
    several: bool,
    cases: bool,
) -> dict[str, Table]:
    """Return the tables ``rotations`` of nodes and ``tilts`` of beams and bars, a dict.

    Args:
        structure: `Structure`.
        state: the final state.
        states: ends of phases, or load cases, by name.
        several: whether there are columns for the envelope.
        cases: whether the states are load cases.
    """
    return {
        **_node_table(structure, states, cases),
        **_tilt_table(structure, state, states, several),
    }


def _node_table(structure, states, cases):
    """Return the table of rotations of nodes by state, {"rotations": Table}; empty without any."""
    if not structure.space.rotates or not states:
        return {}
    turned = np.array(
        [np.asarray(rotation_vectors(structure, other.result)) for other in states.values()]
    )
    sizes = np.linalg.norm(turned, axis=2)
    nodes = np.flatnonzero(sizes.max(axis=0) > NEGLIGIBLE)  # beside 1 rad
    if not len(nodes):
        return {}
    turned, sizes = np.degrees(turned[:, nodes]), np.degrees(sizes[:, nodes])
    names = list(states)
    columns = [
        Column("node", "", np.repeat(nodes, len(names))),
        Column("case" if cases else "phase", "", names * len(nodes)),
        *(Column(f"r{axis}", _UNIT, turned[..., k].T.ravel()) for k, axis in enumerate("xyz")),
        Column("angle", _UNIT, sizes.T.ravel(), governs=True),
    ]
    notes = [
        "from the start: against the nodes of the input, with all phases so far",
        "rotation vectors: the direction is the axis, the length the angle; small ones are angles "
        "about x, y, z",
    ]
    return {"rotations": make_table("Rotations from the start", columns, notes)}


def _tilt_table(structure, state, states, several):
    """Return the table of tilt and twist, {"tilts": Table}; empty without beams and bars.

    Groups of bars without compression, which are cables, and springs to the ground have no rows.
    """
    kept = [
        k
        for k, group in enumerate(structure.groups)
        if group.links.shape[1] > 1  # springs have no chord
        and (group.rotates or (isinstance(group, Bars) and not group.tension_only))
    ]
    if not kept:
        return {}
    tilt, *twist = _tilts(structure, state, kept)
    over = np.array([_tilts(structure, other.result, kept)[0] for other in states.values()])
    angles = (tilt, over, *twist)  # NaN: an element is not active, or has no twist
    if not any(np.nan_to_num(np.abs(x)).max(initial=0) > np.degrees(NEGLIGIBLE) for x in angles):
        return {}
    columns = [
        *element_columns(structure, kept),
        Column("tilt", _UNIT, tilt, governs=True),
        Column("twist first", _UNIT, twist[0], heading="twist, start"),
        Column("twist last", _UNIT, twist[1], heading="twist, end"),
    ]
    if several:
        columns += envelope_columns("max. tilt", _UNIT, over, list(states), 1)
    notes = [
        "tilt: angle between the chord of the element and its initial direction",
        "twist: rotation of the nodes about the chord, right-handed from start to end node",
    ]
    return {"tilts": make_table("Tilt and twist of beams and bars", columns, notes)}


def _tilts(structure, state, kept):
    """Return tilt and twist at both ends of the elements of some groups, three arrays, degrees."""
    every = structure.group_tree.flatten_up_to(element_tilts(structure, state))
    parts = [
        [None if x is None else np.degrees(np.asarray(x, float)) for x in columns]
        for columns in (
            [one.tilt for one in every],
            [None if one.twist is None else one.twist[:, 0] for one in every],
            [None if one.twist is None else one.twist[:, 1] for one in every],
        )
    ]
    return [concatenate_groups(structure, part, kept) for part in parts]
