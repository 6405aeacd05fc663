"""The tables of a report on a motion in time: extremes of forces and displacements, and when."""

from __future__ import annotations

import numpy as np

from ..common import checks
from ..dynamics.response import Transient
from ..model.result_parts import items_per_group
from ..model.structure import Structure
from .columns import concatenate_groups, element_columns
from .table import Column, Table, make_table


def motion_tables(structure: Structure, motion: Transient) -> dict[str, Table]:
    """Return the tables ``motion_forces`` and ``motion_displacements`` of a motion.

    A history that the motion does not have makes no table.

    Raises:
        ValueError: no `Transient`, a batch, one that has failed, or of another structure.
    """
    if not isinstance(motion, Transient):
        kind = checks.describe_type(motion, "dynamics.transient(structure, ...)")
        raise ValueError(f"motion: expected a Transient, got {kind}")
    if np.ndim(motion.status) != 0 or int(motion.status) != 0:
        raise ValueError("motion: has failed, or is a batch; see describe(motion.status)")
    time = np.asarray(motion.time)
    notes = [
        f"extremes over {len(time) - 1} steps, {time[-1]:.4g} s, at the times beside them",
        _energy_sentence(motion),
    ]
    tables = {}
    if "tension" in motion.histories:
        tables["motion_forces"] = _force_table(structure, motion, notes)
    if "displacement" in motion.histories:
        tables["motion_displacements"] = _displacement_table(structure, motion, notes)
    return tables


def _energy_sentence(motion):
    """Return a sentence on the energy that the steps have gained or lost."""
    energy = motion.energy
    largest, error = float(energy.largest), float(np.abs(energy.error).max())
    share = 100 * error / largest if largest > 0 else 0.0
    return f"energy: the steps gain or lose at most {share:.2g} % of the largest energy"


def _force_table(structure, motion, notes):
    """Return the table of axial forces: at the start, smallest and largest, and when."""
    histories = items_per_group(structure, motion.tension)
    groups = [k for k, force in enumerate(histories) if force is not None]
    for k in groups:
        if np.shape(histories[k])[1:] != (len(structure.groups[k].links),):
            raise ValueError("motion: belongs to another structure")

    def joined(values_of):
        parts = [None if one is None else values_of(np.asarray(one)) for one in histories]
        return concatenate_groups(structure, parts, groups)

    columns = [
        *element_columns(structure, groups),
        Column("start", "N", joined(lambda force: force[0]), "at the start"),
        *_extreme_columns("min. N", "N", joined, np.min, np.argmin, motion.time),
        *_extreme_columns("max. N", "N", joined, np.max, np.argmax, motion.time, governs=True),
    ]
    return make_table("Axial forces in motion", columns, notes)


def _displacement_table(structure, motion, notes):
    """Return the table of displacements since the start of the motion, by node that moves."""
    history = np.asarray(motion.displacement)
    nodes = np.arange(structure.n_node) if motion.nodes is None else motion.nodes.array
    if history.shape[1] != len(nodes):
        raise ValueError("motion: belongs to another structure")
    moved = history - history[:1]
    kept = np.abs(moved).max(axis=(0, 2)) > 0
    nodes, moved = nodes[kept], moved[:, kept]
    distance = np.linalg.norm(moved, axis=-1)
    columns = [Column("node", "", nodes)]
    for k, name in enumerate(("ux", "uy", "uz")):
        for word, extreme in (("min.", np.min), ("max.", np.max)):
            values = extreme(moved[..., k], axis=0)
            columns.append(Column(f"{word} {name}", "m", values, millimeters=True))
    columns += _extreme_columns(
        *("largest", "m", lambda values_of: values_of(distance), np.max, np.argmax, motion.time),
        heading="largest movement",
        governs=True,
        millimeters=True,
    )
    title = "Displacements in motion, from its start"
    return make_table(title, columns, notes)


def _extreme_columns(name, unit, of_histories, extreme, place, time, **look):
    """Return the column of extreme values of histories, and that of their times.

    `of_histories` applies a function to histories [n_time, n], and returns values [n].
    """
    values = of_histories(lambda history: extreme(history, axis=0))
    when = of_histories(lambda history: np.asarray(time)[place(history, axis=0)])
    return [Column(name, unit, values, **look), Column("at", "s", when)]
