"""``info``: what is in a scene or a net, and whether it is sound."""

from __future__ import annotations

from argparse import Namespace

import numpy as np

from ..analysis.phases import all_stated
from ..analysis.preparation import prepare
from ..analysis.presence import presence_of
from ..elements.abilities import STATEMENTS, statements_of
from ..files.doubts import counted, doubts, place
from ..loads import as_list
from ..loads.faces import areas
from ..model.parts import groups_by_name
from ..spaces.dof_map import make_dof_map
from ..stiffness.vibration import STANDARD_GRAVITY
from . import inputs

_MOST = 12  # nodes that are listed of a kind
_SIDE = 135.0  # degrees within which all links of a group lie at a corner of it


def run(options: Namespace) -> None:
    """Print the contents of the files that `options` name."""
    if inputs.is_scene(options):
        options.scene = options.files[0]
        inputs.refuse_unread(options)
        return _scene(*inputs.scene(options))
    return _net(inputs.net(options))


def _scene(structure, phases):
    """Print the contents of a scene."""
    prepare(structure, phases, None, None)  # checks the scene and issues its warnings
    nodes = np.asarray(structure.nodes)
    print(
        f"scene of {counted(structure.n_node, 'node')}, "
        f"{counted(len(phases), 'phase')}, {nodes.dtype}"
    )
    print(f"extent: {_extent(nodes)}")
    fixed = structure.supports.fixed(structure.n_node)
    pinned, clamped = fixed[:, :3].all(axis=1), fixed[:, 3:].any(axis=1)
    partly = fixed[:, :3].any(axis=1) & ~pinned
    print(
        f"supports: {int(pinned.sum())} nodes held, {int(partly.sum())} partly, "
        f"{int(clamped.sum())} against rotation"
    )
    rows, _ = structure.rows()
    dof_map = make_dof_map(structure.fixed(structure.supports), rows, rigid=structure.rigid)
    print(f"unknowns: {len(dof_map.free)}")
    named = groups_by_name(structure)
    for (label, group), lengths in zip(named, inputs.lengths(structure), strict=True):
        sizes, kind, unit = lengths, "lengths", "m"
        if group.face is not None:
            sizes, kind, unit = areas(nodes[group.links.array[:, group.face]]), "areas", "m2"
        print(
            f"{type(group).__name__} {label}".strip() + f": {counted(len(lengths), 'element')}, "
            f"{kind} {inputs.spread(sizes)} {unit}, {inputs.short(sizes.sum())} {unit} in total"
        )
        for field in ("axial_stiffness", "area", "rest_length", "weight", "strength", "expansion"):
            value = getattr(group, field, None)
            if value is not None:
                print(f"  {field} {inputs.spread(value)}")
        if group.face is not None and group.weight is not None:
            weight = float(group.weights(group.start(nodes[group.links.array])).sum())
            mass = inputs.short(weight / STANDARD_GRAVITY / float(sizes.sum()))
            print(f"  weighs {inputs.short(weight)} N in total, {mass} kg/m2")
        for field in ("law", "section"):
            if getattr(group, field, None) is not None:
                print(f"  {field} {type(getattr(group, field)).__name__}")
    presence = presence_of(structure, phases, None)
    for number, phase in enumerate(phases, 1):
        _phase(number, phase, structure)
        if presence is not None:
            _changes(number - 1, structure, presence)


def _changes(k, structure, presence):
    """Print which elements phase `k` adds and removes, and how many are there then."""
    for word, change in (("adds", 1), ("removes", -1)):
        parts = []
        names = [label for label, _ in groups_by_name(structure)]
        for label, first, present in zip(names, presence.first, presence.present, strict=True):
            before = present[k - 1] if k else first
            count = int((present[k].astype(int) - before.astype(int) == change).sum())
            if count:
                parts.append(f"{count} of {label}".removesuffix(" of "))
        if parts:
            print(f"  {word} {', '.join(parts)}")
    total = sum(present.shape[1] for present in presence.present)
    print(f"  {sum(int(p[k].sum()) for p in presence.present)} of {total} elements there")


def _phase(number, phase, structure):
    """Print the contents of a phase."""
    print(f"phase {number}: {counted(phase.increments, 'increment')}")
    stated = phase.statements(structure)
    for name in all_stated(phase):
        print(f"  {name} {_stated(name, [of.get(name) for of in stated], structure)}")
    for load in as_list(phase.loads):
        print(f"  {load}")
    if phase.supports is not None:
        print("  other supports")


def _stated(field, statements, structure):
    """What a phase states, with the names of the groups, and of those that it passes by."""
    parts: dict[str, list[str]] = {}
    without, cold = [], []
    for (label, group), stated in zip(groups_by_name(structure), statements, strict=True):
        if stated is None and field not in STATEMENTS and field not in statements_of(group):
            continue  # only groups of one class may know it
        if stated is None:
            lacks = field == "temperature" and group.expansion is None
            (cold if lacks else without).append(label)
            continue
        values = np.asarray(stated.values)
        meant = np.ones(len(values), bool) if stated.chosen is None else stated.chosen
        unit = statements_of(group)[field].unit
        text = f"{inputs.spread(values[meant])} {unit}".removesuffix(" -")
        some = "" if meant.all() else f" ({int(meant.sum())} of {len(meant)} elements)"
        parts.setdefault(text, []).append(f"{label}{some}".strip())
    told = [f"{text} on {', '.join(names)}" for text, names in parts.items()]
    if len(statements) == 1:
        told = [part.removesuffix(" on ").replace(" on (", " (") for part in told]
    if without:
        told.append(f"none on {', '.join(without)}")
    told += [f"{', '.join(cold)} has no expansion"] if cold else []
    return "; ".join(told)


def _net(net):
    """Print the contents of a net."""
    kinds = {kind: net.kinds.count(kind) for kind in dict.fromkeys(net.kinds)}
    counts = ", ".join(f"{count} {kind}s" for kind, count in kinds.items())
    print(f"net of {len(net.nodes)} nodes, {len(net.links)} links: {counts}")
    print(f"extent: {_extent(net.nodes)}")
    ends = net.nodes[net.links]
    print(f"lengths {inputs.spread(np.linalg.norm(ends[:, 1] - ends[:, 0], axis=1))} m")
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
        print(f"{name} {inputs.spread(known)} ({len(known)} links)")
    if net.loads is not None:
        total = ", ".join(inputs.short(f) for f in net.loads.sum(axis=0))
        print(f"loads: sum ({total}) N")
    single = np.bincount(net.links.ravel(), minlength=len(net.nodes)) == 1
    _places("nodes with one link", net, np.flatnonzero(single))
    _places("corners of groups in plan", net, np.setdiff1d(_corners(net), np.flatnonzero(single)))
    for text in doubts(net.nodes, net.links, held):
        print(f"doubtful: {text}")


def _places(what, net, nodes):
    """Print numbers and places of some nodes, those of supports marked."""
    print(f"{what}: {len(nodes)}")
    for k in nodes[:_MOST].tolist():
        print(f"  node {k} at {place(net.nodes[k])}{', support' * bool(net.fixed[k].any())}")
    if len(nodes) > _MOST:
        print(f"  and {len(nodes) - _MOST} more")


def _corners(net):
    """Nodes at which two or more links of a group lie on one side in plan, within `_SIDE`, [n]."""
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


def _extent(nodes):
    """The size of the bounding box of nodes, as text."""
    return " x ".join(inputs.short(float(v)) for v in np.ptp(nodes, axis=0)) + " m"
