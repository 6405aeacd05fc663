"""Sizes in steps: analyses of similar size share one compiled program.

A program is compiled for arrays of certain sizes. Here nodes, elements, unknowns and increments are
padded to one of a few sizes, and results are cut. What is added has no effect: nodes that are held,
elements that are absent (as before the phase that adds them), unknowns that are held, increments
that are not taken. Arrays are those of NumPy: nothing is compiled for a new size.
"""

from __future__ import annotations

import functools
from typing import Any, NamedTuple

import jax
import numpy as np

from ..common.fusion import are_loops_fused
from ..common.python_objects import is_program_module
from ..common.tree import Indices, PerElement, copy_with
from ..elements.element import Element
from ..elements.statement import StatedValues
from ..linear.pattern import pad_pattern
from ..loads.groups import OnGroups
from ..mechanics.bundles import Bundles
from ..mechanics.load_ramp import NodalIncrement
from ..sections import Section
from ..sections.padding import split_last_fibres
from ..spaces import Space, space_of
from ..spaces.dof_map import DofMap, element_unknowns
from .padded_loads import pad_faces, pad_loads
from .padding import common_size, doubled_size, fill, repeat_last
from .preparation import PreparedAnalysis, join_states
from .schedule import stack_steps

_FEWEST_FIBRES = 8
_MOST_UNKNOWNS = 2000  # beyond them runs are longer than what a program takes to compile


class CommonSizes(NamedTuple):
    """Sizes that an analysis shares with others.

    Attributes:
        rows: number of rows of motion (nodes and others); at least one is padding.
        unknowns: number of unknowns.
        elements: number of elements of every bundle.
        phases: number of phases.
        increments: number of increments of the longest phase.
    """

    rows: int
    unknowns: int
    elements: tuple[int, ...]
    phases: int
    increments: int


def pad_analysis(
    task: PreparedAnalysis, arguments: tuple[Any, ...], listens: bool = False
) -> tuple[tuple[Any, ...], Bundles, CommonSizes] | None:
    """Pad the arguments of the compiled core to common sizes.

    Args:
        task: `PreparedAnalysis`.
        arguments: `without_indices`, `arrays`, `method` and `code` of `phase_loop.analyse`, known
            numbers.
        listens: whether the program reports progress, with the number of phases: it is exact then.

    Returns:
        The arguments, the bundles and the sizes of the padded analysis; None where an analysis has
        a part that cannot be padded, such as loads that follow the structure.
    """
    (nodes, groups, restart, schedule), arrays, method, code = arguments
    links = [arrays[group.links.number] for group in groups]
    if not _can_be_padded(links, groups, restart, schedule):
        return None
    sizes = CommonSizes(
        doubled_size(len(nodes) + 1, 12),
        common_size(task.n_unknown),
        tuple(common_size(len(own)) for own in links),
        len(schedule) if listens else doubled_size(len(schedule), 1),
        common_size(max(schedule.increments)),
    )
    padded = list(arrays)
    for group, own, size in zip(groups, links, sizes.elements, strict=True):
        padded[group.links.number] = repeat_last(own, size)
    loads = (*schedule.loads, *(() if restart is None else restart.loads))
    for number, faces in pad_faces(loads, arrays, sizes.rows - 1).items():
        padded[number] = faces
    pairs = list(zip(groups, sizes.elements, strict=True))
    inner = tuple((group.n_freedom, group.inner_unknowns) for group in groups)
    numbers, tree = jax.tree.flatten(schedule.dof_map)  # known by content
    by_content = tree, tuple(map(Indices, numbers)), tuple(map(Indices, links))
    dof_map = copy_with(
        _pad_dof_map(*by_content, inner, space_of(groups), sizes),
        mean_lengths=_mean_lengths(groups, links, np.asarray(nodes)),
    )
    parts = (
        repeat_last(nodes, sizes.rows),
        [_pad_group(group, size) for group, size in pairs],
        None if restart is None else _pad_restart(restart, groups, task.bundles, sizes),
        _pad_schedule(schedule, dof_map, sizes, links, task.bundles),
    )
    bundles = Bundles(tuple((k,) for k in range(len(groups))), sizes.elements)
    return (parts, padded, method, code), bundles, sizes


def _can_be_padded(links, groups, restart, schedule):
    """Return whether every part of an analysis has a padded form."""
    loads = [*schedule.loads, *(() if restart is None else restart.loads)]
    pattern = schedule.dof_map.pattern
    return (
        not are_loops_fused()
        and 0 < len(schedule.dof_map.free) <= _MOST_UNKNOWNS
        and all(type(group).chord is Element.chord for group in groups)
        and all(map(_has_links_only, groups))
        and all(map(_can_be_absent, groups, links))
        and all(isinstance(stack.load, OnGroups) and not stack.follows for stack in loads)
        and all(set(stack.load._index_fields) <= {"faces"} for stack in loads)
        and (pattern is None or not any(pattern.paired))
    )


def _has_links_only(group):
    """Return whether a group has no index arrays besides its links."""
    others = (name for name in group._index_fields if name != "links")
    return all(getattr(group, name) is None for name in others)


_with_mask: list[type] = []  # classes of the package whose states are known to have `present`


def _can_be_absent(group, links):
    """Return whether states of a class of elements have the mask `present`."""
    kind = type(group)
    if kind in _with_mask:
        return True
    ends = jax.ShapeDtypeStruct((*links.shape, 3), np.float64)
    state = jax.eval_shape(copy_with(group, links=links).start, ends)
    found = "present" in getattr(type(state), "_all_fields", ())
    if found and is_program_module(kind.__module__):
        _with_mask.append(kind)
    return found


def _pad_group(group, size):
    """Return a group with `size` elements; those that are added equal its last one."""
    changes: dict[str, Any] = {}
    own = not is_program_module(type(group).__module__)
    for name, value in vars(group).items():
        if name == "strength" and not own:
            changes[name] = None  # it is for reports
        elif name in group.per_element and value is not None:
            changes[name] = repeat_last(value, size)
        elif isinstance(value, PerElement):
            changes[name] = jax.tree.map(lambda x: repeat_last(x, size), value)
        elif isinstance(value, Section):
            changes[name] = _pad_section(value)
    return copy_with(group, **changes)


def _pad_section(section):
    """Return a section with one of a few numbers of fibres, unless they have history variables."""
    counts = section.counts
    if not section.has_memory:
        counts = tuple(doubled_size(n, _FEWEST_FIBRES) for n in counts)
    return split_last_fibres(section, counts)


def _pad_restart(restart, groups, bundles, sizes):
    """Return a `RestartState` on bundles, with padded rows and elements."""
    factors = [
        copy_with(
            own, begun=None if own.begun is None else repeat_last(own.begun, sizes.rows, axis=1)
        )
        for own in restart.load_factors
    ]
    return copy_with(
        restart,
        motion=repeat_last(restart.motion, sizes.rows),
        states=[
            jax.tree.map(lambda x, size=size: repeat_last(x, size), state)
            for state, size in zip(
                join_states(groups, bundles, restart.states), sizes.elements, strict=True
            )
        ],
        nodal_load=fill(restart.nodal_load, sizes.rows, 0, 0.0),
        loads=pad_loads(restart.loads, bundles, sizes.elements),
        load_factors=factors,
        support_rotation=None
        if restart.support_rotation is None
        else repeat_last(restart.support_rotation, sizes.rows),
    )


def _pad_schedule(schedule, dof_map, sizes, links, bundles):
    """Return a `Schedule` with padded rows, elements and increments."""
    statements = [
        {name: _pad_statement(own, size, sizes.phases) for name, own in stated.items()}
        for stated, size in zip(schedule.statements, sizes.elements, strict=True)
    ]
    counts = [len(own) for own in links]
    if schedule.present is None:
        present = None
        first = [np.arange(size) < n for n, size in zip(counts, sizes.elements, strict=True)]
    else:
        pairs = list(zip(schedule.present, schedule.present_at_start, sizes.elements, strict=True))
        present = [repeat_last(fill(own, size, 1, False), sizes.phases) for own, _, size in pairs]
        first = [fill(own, size, 0, False) for _, own, size in pairs]
    changes, before = schedule.changes, schedule.before
    if changes is not None:
        changes = _pad_held(changes, sizes)
        dof_map = copy_with(dof_map, temporarily_fixed=None)
    # analyses with and without nodal loads share their program
    fixed = np.asarray(schedule.dof_map.fixed)
    nothing = NodalIncrement(np.zeros((len(schedule), *fixed.shape), dof_map.mean_lengths.dtype))
    idle = (0,) * (sizes.phases - len(schedule))
    return copy_with(
        schedule,
        number=np.arange(sizes.phases, dtype=np.int32),
        statements=statements,
        added_load=_pad_nodal(schedule.added_load or nothing, sizes),
        moved=_pad_nodal(schedule.moved, sizes),
        dof_map=dof_map,
        changes=changes,
        before=None if before is None else _pad_held(before, sizes),
        loads=pad_loads(schedule.loads, bundles, sizes.elements),
        increments=(sizes.increments,) * sizes.phases,
        n_node=sizes.rows,
        present=present,
        present_at_start=first,
        given_steps=stack_steps((*schedule.increments, *idle), sizes.increments),
        attached=None
        if schedule.attached is None
        else repeat_last(schedule.attached, sizes.phases),
        is_consistent=None
        if schedule.is_consistent is None
        else fill(schedule.is_consistent, sizes.phases, 0, True),
    )


def _pad_statement(stated, size, phases):
    """Return `StatedValues`, [n_phase, n_elem, ...], that do not concern what is added."""
    values = repeat_last(repeat_last(stated.values, size, axis=1), phases)
    chosen = stated.chosen
    if chosen is None:
        chosen = np.ones(np.shape(stated.values)[:2], bool)
    return StatedValues(values, fill(fill(chosen, size, 1, False), phases, 0, False))


def _pad_nodal(added, sizes):
    """Return a `NodalIncrement` with zeros for rows and phases that are added, or None.

    The amplitudes of an added phase are those of the last one.
    """
    if added is None:
        return None
    values = np.asarray(added.values)
    values = fill(fill(values, sizes.rows, values.ndim - 2, 0.0), sizes.phases, 0, 0.0)
    amplitude = jax.tree.map(lambda x: repeat_last(x, sizes.phases), added.amplitude)
    return copy_with(added, values=values, amplitude=amplitude)


def _pad_held(fields, sizes):
    """Pad fields of a `DofMap` that change from phase to phase, by name: what is added is held."""
    padded = dict(fields)
    for name, value in fields.items():
        if name in ("fixed", "supported"):
            padded[name] = repeat_last(fill(value, sizes.rows, 1, True), sizes.phases)
        elif name == "axes":
            padded[name] = repeat_last(repeat_last(value, sizes.rows, axis=1), sizes.phases)
        elif name == "temporarily_fixed":
            padded[name] = repeat_last(fill(value, sizes.unknowns, 1, True), sizes.phases)
        else:
            padded[name] = jax.tree.map(lambda x: repeat_last(x, sizes.phases), value)
    return padded


@functools.lru_cache(maxsize=16)
def _pad_dof_map(
    tree: Any,
    arrays: tuple[Indices, ...],
    links: tuple[Indices, ...],
    inner: tuple[tuple[int, tuple[tuple[int, int], ...]], ...],
    space: type[Space],
    sizes: CommonSizes,
) -> DofMap:
    """Return a `DofMap` with padded rows and unknowns, which are held; cached.

    `tree` and `arrays` are those of the `DofMap`; `links` are those of all bundles; `inner` has
    (degrees of freedom of an end, inner unknowns) of each; `space` is the class of the space.
    """
    dof_map: DofMap = tree.unflatten([own.array for own in arrays])
    rows, unknowns = sizes.rows, sizes.unknowns
    number, count = np.asarray(dof_map.unknown_of_dof), len(dof_map.free)
    number = np.where(number == count, unknowns, number).astype(np.uint32)
    number = fill(number, rows, 0, unknowns)
    pattern = dof_map.pattern
    if pattern is not None:
        numbers = [
            fill(
                element_unknowns(number, own.array, width, within, dof_map.rigid_links),
                size,
                0,
                unknowns,
            )
            for own, (width, within), size in zip(links, inner, sizes.elements, strict=True)
        ]
        pattern = pad_pattern(pattern, [*numbers, *space.coupled_unknowns(number)], unknowns)
    optional = {
        "axes": lambda x: repeat_last(x, rows),
        "node_of_row": lambda x: fill(x, rows, 0, rows - 1),
        "inner": lambda x: fill(x, rows, 0, False),
        "supported": lambda x: fill(x, rows, 0, True),
    }
    fields = {name: getattr(dof_map, name) for name in optional}
    return copy_with(
        dof_map,
        free=fill(dof_map.free, unknowns, 0, number.size - 1),
        unknown_of_dof=number,
        fixed=fill(dof_map.fixed, rows, 0, True),
        pattern=pattern,
        temporarily_fixed=np.arange(unknowns) >= count,
        **{name: optional[name](x) for name, x in fields.items() if x is not None},
    )


def _mean_lengths(groups, links, nodes):
    """Return `DofMap.mean_lengths`: of all elements, and of those with rotations, [2]."""
    with np.errstate(over="ignore"):  # as in a program, where infinity leads to a status
        chords = [
            np.linalg.norm(nodes[own[:, 1]] - nodes[own[:, 0]], axis=-1)
            if own.shape[1] > 1
            else np.zeros(0)
            for own in links
        ]
    turning = [chord for chord, group in zip(chords, groups, strict=True) if group.rotates]
    together = [np.concatenate(some) if some else np.zeros(0) for some in (chords, turning)]
    return np.array([np.mean(all_) if len(all_) else 1.0 for all_ in together], nodes.dtype)
