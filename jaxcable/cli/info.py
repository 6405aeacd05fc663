"""``info``: show what is in a scene or a net, and what looks like a mistake."""

from __future__ import annotations

from argparse import Namespace

import numpy as np

from ..analysis.activation import make_activation
from ..analysis.preparation import prepare
from ..common.negligible import vector_text
from ..common.units import SI
from ..files.net_doubts import describe_likely_mistakes, format_position, pluralize
from ..files.net_units import unit_of_net_value
from ..loads.faces import face_areas
from ..loads.masses import STANDARD_GRAVITY
from ..model.result_parts import named_groups_of
from ..reporting.load_descriptions import (
    describe_actions,
    format_number,
    format_range,
    range_text,
)
from ..reporting.model_tables import property_table
from ..reporting.phase_descriptions import (
    describe_activation,
    describe_loads,
    describe_phase_inputs,
)
from ..reporting.plain_text import table_text
from ..reporting.table import common_scales, table_in_units
from ..spaces.dof_map import make_dof_map
from . import inputs
from .combining import combine_actions

_MOST = 12  # nodes that are listed; two per corner of a six-sided net
_SIDE = 135.0
"""Degrees within which all links of a group lie at a corner of its net.

At a corner of a rectangle that is 90, along a straight edge 180: the mean of both.
"""


def run(options: Namespace) -> None:
    """Print the contents of the scene or net in `options.files`."""
    if inputs.is_scene_file(options):
        options.scene = options.files[0]
        inputs.refuse_options_without_effect(options, ("units",), inputs.STATED)
        inputs.refuse_options_of_other_formats(options)
        scene = inputs.read_scene(options)
        combine_actions(options, scene)  # refuses what `solve` cannot combine
        return _print_scene(scene, inputs.shown_units(options, scene))
    units = inputs.parse_units(options.show_units, "--show-units")
    return _print_net(inputs.read_net(options), units or inputs.parse_units(options.units) or SI)


def _print_scene(scene, stated):
    """Print the size, supports, groups and phases of a scene.

    Numbers are in the units `stated`; None for SI.
    """
    structure, phases = scene
    units = stated or SI
    prepare(structure, phases, None, None)  # checks the scene and issues its warnings
    nodes = np.asarray(structure.nodes)
    print(
        f"scene of {pluralize(structure.n_node, 'node')}, "
        f"{pluralize(len(phases), 'phase')}, {nodes.dtype}"
    )
    if scene.units is not None:
        print(f"units of the file: {scene.units}")
    print(f"extent: {_bounding_box_text(nodes, units)}")
    fixed = structure.supports.fixed(structure.n_node)
    pinned, clamped = fixed[:, :3].all(axis=1), fixed[:, 3:].any(axis=1)
    partly = fixed[:, :3].any(axis=1) & ~pinned
    print(
        f"supports: {pluralize(int(pinned.sum()), 'node')} fixed in all translations, "
        f"{int(partly.sum())} partially supported, {int(clamped.sum())} with rotations fixed"
    )
    rows, _ = structure.motion_rows()
    dof_map = make_dof_map(structure.fixed(structure.supports), rows, rigid=structure.rigid)
    print(f"unknowns: {len(dof_map.free)} degrees of freedom")
    named = named_groups_of(structure)
    for (label, group), lengths in zip(named, inputs.element_lengths(structure), strict=True):
        sizes, kind, unit = lengths, "lengths", "m"
        if group.face is not None:
            sizes, kind, unit = face_areas(nodes[group.links.array[:, group.face]]), "areas", "m2"
        count, total = pluralize(len(lengths), "element"), units.text(sizes.sum(), unit)
        head = f"{type(group).__name__} {label}".strip() + f": {count}"
        if group.links.shape[1] > 1:
            head += f", {kind} {range_text(sizes, unit, units)}, {total} in total"
        print(head)
        if group.face is not None and group.weight is not None:
            weight = float(group.weights(group.start(nodes[group.links.array])).sum())
            mass = units.text(weight / STANDARD_GRAVITY / float(sizes.sum()), "kg/m2")
            print(f"  weighs {units.text(weight, 'N')} in total, {mass}")
    table = property_table(structure, stated)
    table = table if stated is None else table_in_units(table, stated)
    print(table_text(table, None, common_scales([table], stated), units))
    presence = make_activation(structure, phases, None)
    for number, phase in enumerate(phases, 1):
        _print_phase(number, phase, structure, presence, stated)
    texts = describe_actions(scene.actions, structure, stated)
    for action, text in zip(scene.actions, texts, strict=True):
        held = " (in the phases)" * action.in_phases
        print(f"action {action.name}, {action.kind}{held}")
        print(f"  {text}")
    if scene.combination_rules is not None:
        rules = scene.combination_rules
        source = rules if isinstance(rules, str) else rules.get("source", "rules of the file")
        print(f"combinations by {source}")
    for check in scene.checks:
        print(f"check {check if isinstance(check, str) else f'{check.name}, {check.clause}'}")


def _print_phase(number, phase, structure, presence, units):
    """Print the increments, prestress, loads, new supports and elements of phase `number`, from 1.

    `presence` is the result of `make_activation`. Numbers are in `units`, None for SI.
    """
    print(f"phase {number}: {pluralize(phase.increments, 'increment')}")
    lines = describe_phase_inputs(phase, structure, units, name_others=True)
    lines += describe_loads(phase, structure, units)
    if phase.supports is not None:
        lines.append("new supports, which replace those before")
    if presence is not None:
        lines += describe_activation(number - 1, structure, presence)
    for line in lines:
        print(f"  {line}")


def _print_net(net, units):
    """Print the size, supports, groups, loads and likely mistakes of a `Net` in `units`."""
    kinds = {kind: net.kinds.count(kind) for kind in dict.fromkeys(net.kinds)}
    counts = ", ".join(f"{count} {kind}s" for kind, count in kinds.items())
    print(f"net of {len(net.nodes)} nodes, {len(net.links)} links: {counts}")
    print(f"extent: {_bounding_box_text(net.nodes, units)}")
    ends = net.nodes[net.links]
    lengths = np.linalg.norm(ends[:, 1] - ends[:, 0], axis=1)
    print(f"lengths {range_text(lengths, 'm', units)}")
    held = net.fixed.any(axis=1)
    print(f"supports: {int(held.sum())} nodes")
    if net.groups is not None:
        counts = [f"{name} {net.groups.count(name)}" for name in dict.fromkeys(net.groups)]
        print(f"groups: {', '.join(counts)}")
    if net.marks:
        counts = [f"{layer} {len(nodes)}" for layer, nodes in net.marks.items()]
        print(f"nodes with points, by layer: {', '.join(counts)}")
    for name, value in net.values.items():
        known = value[~np.isnan(value)]
        text = format_range(known)
        if units != SI:
            text = range_text(known, unit_of_net_value(name), units).removesuffix(" -")
        print(f"{name} {text} ({len(known)} links)")
    if net.loads is not None:
        print(f"loads: sum {vector_text(units.from_si(net.loads.sum(axis=0), 'N'))} {units.force}")
    single = np.bincount(net.links.ravel(), minlength=len(net.nodes)) == 1
    _print_nodes("end nodes", net, np.flatnonzero(single), units)
    corners = np.setdiff1d(_group_corners(net), np.flatnonzero(single))
    _print_nodes("corners of groups in plan", net, corners, units)
    for text in describe_likely_mistakes(net.nodes, net.links, held):
        print(f"doubtful: {text}")


def _print_nodes(what, net, nodes, units):
    """Print the number of some nodes, and the first ones with index and position in `units`.

    `what` says what these nodes are; supports are marked.
    """
    print(f"{what}: {len(nodes)}")
    for k in nodes[:_MOST].tolist():
        support = ", support" * bool(net.fixed[k].any())
        print(f"  node {k} at {format_position(net.nodes[k], units)}{support}")
    if len(nodes) > _MOST:
        print(f"  and {len(nodes) - _MOST} more")


def _group_corners(net):
    """Return the nodes at the corners of groups in plan, [n].

    At a corner all links of a group lie within an angle of 135 degrees.
    """
    labels = np.array(net.groups or [""] * len(net.links))
    found = []
    for label in dict.fromkeys(labels.tolist()):
        links = net.links[labels == label]
        out = np.concatenate([links, links[:, ::-1]])  # every link from both of its ends
        way = (net.nodes[out[:, 1]] - net.nodes[out[:, 0]])[:, :2]
        seen = np.linalg.norm(way, axis=1) > 0
        start, angle = out[seen, 0], np.degrees(np.arctan2(way[seen, 1], way[seen, 0]))
        order = np.lexsort((angle, start))
        start, angle = start[order], angle[order]
        for node, first, count in zip(*np.unique(start, True, False, True), strict=True):
            turns = angle[first : first + count]
            widest = np.diff(np.append(turns, turns[0] + 360.0)).max()
            if count > 1 and widest > 360.0 - _SIDE:
                found.append(int(node))
    return np.unique(np.array(found, int))


def _bounding_box_text(nodes, units):
    """Return the sides of the bounding box of nodes as text: "8 x 6 x 2 m".

    `nodes` are positions, [n_node, 3], m; the text is in `units`.
    """
    sides = units.from_si(np.ptp(nodes, axis=0).astype(float), "m")
    return " x ".join(format_number(float(v)) for v in sides) + f" {units.length}"
