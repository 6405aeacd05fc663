"""The tables of a report on what was analysed: nodes, properties of elements, phases."""

from __future__ import annotations

import itertools
from collections.abc import Sequence
from typing import Any

import numpy as np

from ..analysis.activation import make_activation
from ..analysis.load_resultants import load_resultants
from ..analysis.phases import Phase
from ..analysis.solution import State
from ..common.negligible import vector_text
from ..common.types import Bool, Float
from ..common.units import Units
from ..elements import FrictionCables, GroundContacts, Springs
from ..elements.beam_element import BeamElement
from ..elements.element import Element
from ..elements.straight import Straight
from ..loads import as_list
from ..model.result_parts import active_nodes, named_groups_of
from ..model.structure import Structure
from ..model.supports import Supports
from .load_descriptions import SUM_OF_LOADS, range_with_unit
from .phase_descriptions import describe_activation, describe_loads, describe_phase_inputs
from .table import Column, Table, columns_of_rows, make_table

_FREEDOMS = "x", "y", "z", "rx", "ry", "rz"
_MOST = 8  # nodes that are listed
_MOVED = 1e-3  # m, displacement from which on there are final positions, too
_DIGITS = 3  # decimals of directions
_SKEW = 1e-9  # size of an entry of a rotation matrix up to which it is rounding
# Properties that groups have for each element: names in the table, and units.
_PROPERTIES = {
    "area": ("A", "m2"),
    "weight": ("weight", "N/m"),
    "strength": ("strength", "N"),
    "expansion": ("expansion", "1/K"),
    "gap": ("gap", "m"),
}
_STIFFNESSES = {"EA": "N", "EIy": "N m2", "EIz": "N m2", "GJ": "N m2", "GAy": "N", "GAz": "N"}


def model_tables(
    structure: Structure,
    phases: Sequence[Phase] | None,
    names: Sequence[str],
    units: Units | None,
    end: State,
) -> dict[str, Table]:
    """Return the tables ``geometry``, ``properties`` and, if `phases` are given, ``phases``.

    `names` are those of the phases, and `end` is the state at their end; numbers in texts are in
    `units`, None for SI with kN.
    """
    change = any(phase.supports is not None for phase in phases or ())
    found = {
        "geometry": _node_table(structure, change, end),
        "properties": property_table(structure, units),
    }
    if phases is not None:
        found["phases"] = _phase_table(structure, phases, names, units)
    return found


def _node_table(structure: Structure, change: bool, end: State) -> Table:
    """Return the table of all nodes: initial and final positions, and what the supports hold.

    There are final positions if a node has moved visibly. `change` says whether phases replace the
    supports, and `end` is the state at their end.
    """
    nodes = np.asarray(structure.nodes, float)
    columns = [
        Column("node", "", list(range(len(nodes)))),
        *(Column(axis, "m", values) for axis, values in zip("xyz", nodes.T, strict=True)),
    ]
    notes = ["x, y, z: initial geometry, before all phases"]
    moved = np.asarray(end.displacement, float)
    moved = np.where(active_nodes(structure, end.present)[:, None], moved, np.nan)
    if (np.abs(moved) > _MOVED).any():  # not of nodes without elements, which are NaN
        columns += [
            Column(f"{axis} end", "m", values, f"{axis}, end")
            for axis, values in zip("xyz", (nodes + moved).T, strict=True)
        ]
        notes.append("x, y, z, end: at the end of the phases, under their loads")
    columns.append(Column("held", "", _support_texts(structure.supports, len(nodes))))
    notes.append("held: displacements x, y, z, rotations rx, ry, rz, or directions")
    if change:
        notes.append("supports before all phases: phases replace them, see their table")
    if structure.rigid is not None:
        pairs = ", ".join(f"{a} to {b}" for a, b in structure.rigid.array.tolist())
        notes.append(f"rigid arms, from carrier to carried node: {pairs}")
    return make_table("Nodes and supports", columns, notes)


def _support_texts(supports: Supports, count: int) -> list[str | None]:
    """Return the text of the support at each of `count` nodes, such as "x y z", or None."""
    held, axes = supports.fixed(count), supports.directions(count)
    return [_support_text(*of_node) for of_node in zip(held, axes, strict=True)]


def _support_text(held: Bool[np.ndarray, " 6"], axes: Float[np.ndarray, "3 3"]) -> str | None:
    """Return what is held at one node, as text; None if nothing is.

    It names degrees of freedom, "x y z rx", or directions if the node is held along others. `held`
    is [6], and `axes` are the directions, [3, 3], in rows.
    """
    in_part = any(held[k : k + 3].any() and not held[k : k + 3].all() for k in (0, 3))
    names = list(_FREEDOMS)
    if in_part:  # of what is held in full, directions do not count
        for k, axis in enumerate(np.tile(axes, (2, 1))):
            along = int(np.abs(axis).argmax())
            if np.abs(np.abs(axis) - np.eye(3)[along]).max() <= _SKEW:
                names[k] = _FREEDOMS[along + k // 3 * 3]
            else:
                names[k] = f"{('along', 'about')[k // 3]} {vector_text(axis.round(_DIGITS))}"
    words = [names[k] for k in np.flatnonzero(held)]
    plain = sorted((word for word in words if word in _FREEDOMS), key=_FREEDOMS.index)
    skew = [word for word in words if word not in _FREEDOMS]
    return ", ".join([" ".join(plain), *skew] if plain else skew) or None


def property_table(structure: Structure, units: Units | None) -> Table:
    """Return the table of the properties of elements: a row for all with the same in a group.

    It is in SI; numbers in its texts are in `units`, None for SI with kN.
    """
    rows: list[list[Any]] = []
    for label, group in named_groups_of(structure):
        values = _group_properties(group)
        also = _further_properties(group, units)
        changes = (values[1:] != values[:-1]) & ~(np.isnan(values[1:]) & np.isnan(values[:-1]))
        starts = [0, *(np.flatnonzero(changes.any(axis=1)) + 1).tolist(), len(values)]
        for start, stop in itertools.pairwise(starts):
            which = str(start) if stop - start == 1 else f"{start} to {stop - 1}"
            rows.append([label, type(group).__name__, which, *values[start].tolist(), also])
    heads = *_STIFFNESSES.items(), *_PROPERTIES.values()
    columns = columns_of_rows(rows, "group", "kind", "elements", *heads, "also")
    notes = ["EA, EIy, EIz, GJ: at zero strain, of beams about the axis through their nodes"]
    return make_table("Properties of elements", columns, notes)


def _group_properties(group: Element) -> Float[np.ndarray, "n_elem n_property"]:
    """Return the properties of each element, [n_elem, n_property], SI; NaN where a group has none.

    They are those of `_STIFFNESSES`, at zero strain, then of `_PROPERTIES`. Weights of faces, per
    area, are left out.
    """
    section = group.section
    found: dict[str, Any] = {name: _number_or_nan(section, name) for name in _STIFFNESSES}
    found |= {name: _number_or_nan(group, name) for name in _PROPERTIES}
    if group.face is not None:
        found["weight"] = np.nan
    if section is not None:
        matrix = np.asarray(section.stiffness(), float)
        found["EA"] = matrix[..., 0, 0]
        if isinstance(beam := group, BeamElement):
            found["EIy"], found["EIz"] = matrix[..., 1, 1], matrix[..., 2, 2]
            given = beam.torsional_stiffness
            found["GJ"] = section.torsional_stiffness() if given is None else given
    stated = _number_or_nan(group, "axial_stiffness")
    found["EA"] = np.where(np.isnan(stated), found["EA"], stated)
    if isinstance(bar := group, Straight) and bar.law is not None:
        found["EA"] = np.asarray(bar.law.modulus, float) * np.asarray(bar.area, float)
    count = len(group.links)
    return np.stack([np.broadcast_to(np.asarray(x, float), count) for x in found.values()], axis=1)


def _number_or_nan(thing, name):
    """Return an attribute of an object as an array of floats; NaN if it is missing or None."""
    value = getattr(thing, name, None)
    return np.asarray(np.nan if value is None else value, float)


def _further_properties(group, units):
    """Return further properties of a group in words: fibres, laws, springs; None without any.

    Numbers are in `units`, None for SI.
    """
    parts, section = [], group.section
    if isinstance(bar := group, Straight) and bar.law is not None:
        parts.append(f"law {type(bar.law).__name__}")
    if section is not None and section.n_fibre:
        laws = dict.fromkeys(type(one).__name__ for one in section.laws)
        parts.append(f"section of {section.n_fibre} fibres, {', '.join(laws)}")
    if group.face is not None and group.weight is not None:
        parts.append(f"weight {range_with_unit(group.weight, 'N/m2', units)}")
    if np.isfinite(lengths := _number_or_nan(group, "rest_length")).all():
        parts.append(f"unstressed length {range_with_unit(lengths, 'm', units)}")
    if group.hinges is not None:
        parts.append("hinges")
    if isinstance(rope := group, FrictionCables):
        parts += _friction_texts(rope, units)
    if isinstance(spring := group, Springs | GroundContacts):
        parts.append(f"stiffness {range_with_unit(spring.stiffness, 'N/m', units)}")
    return "; ".join(parts) or None


def _friction_texts(rope, units):
    """Return what cables with friction state on it and on their saddles, a list of texts."""
    stated = {"friction": "-", "axle_friction": "-", "wobble": "1/m", "radius": "m"}
    found = [
        f"{name.replace('_', ' ')} {range_with_unit(value, unit, units).removesuffix(' -')}"
        for name, unit in stated.items()
        if (value := getattr(rope, name)) is not None
    ]
    axes = [] if rope.axis is None else np.unique(np.reshape(rope.axis, (-1, 3)), axis=0)
    return found + ([f"axis {', '.join(map(vector_text, axes[:_MOST]))}"] if len(axes) else [])


def _phase_table(structure, phases, names, units):
    """Return the table of phases: a row for each input, load, new supports, and activation.

    `names` are those of the phases; numbers in texts are in `units`, None for SI with kN.
    """
    presence = make_activation(structure, phases, None)
    supports, rows = structure.supports, []
    for k, (phase, name) in enumerate(zip(phases, names, strict=True)):
        lines: list[tuple[Any, ...]] = [("increments", str(phase.increments))]
        lines += [("sets", text) for text in describe_phase_inputs(phase, structure, units)]
        present = [np.ones(len(one.links), bool) for one in structure.groups]
        if presence is not None:
            present = [np.asarray(own[k]) for own in presence.present]
        sums = load_resultants(structure, as_list(phase.loads), present).tolist()
        told = describe_loads(phase, structure, units)
        lines += [("applies", text, *own) for text, own in zip(told, sums, strict=True)]
        if phase.supports is not None:
            lines.append(("supports", _support_changes(supports, phase.supports, structure.n_node)))
            supports = phase.supports
        if presence is not None:
            lines += [("elements", text) for text in describe_activation(k, structure, presence)]
        rows += [(k + 1, name, *line, *(None,) * (5 - len(line))) for line in lines]
    sums = ((f"sum F{axis}", "N") for axis in "xyz")
    columns = columns_of_rows(rows, "phase", "name", "what", "text", *sums)
    notes = [
        SUM_OF_LOADS,
        "all that a phase sets, applies, adds and removes acts together, ramped over its "
        "increments; loads go on acting in the phases after it",
        "elements are numbered from 0 in their group",
    ]
    return make_table("Phases of the analysis", columns, notes)


def _support_changes(before, after, count):
    """Return in words the supports of nodes whose support is replaced by another one.

    `before` and `after` are `Supports`, and `count` is the number of nodes.
    """
    every = (_support_texts(supports, count) for supports in (before, after))
    pairs = enumerate(zip(*every, strict=True))
    changed = [f"node {k}: {new or 'free'}" for k, (old, new) in pairs if old != new]
    if len(changed) > _MOST:
        return f"new ones at {len(changed)} nodes"
    return "; ".join(changed) or "as before"
