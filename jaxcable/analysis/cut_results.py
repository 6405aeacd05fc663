"""Results of a padded analysis (`common_sizes`), cut to the sizes of the structure."""

from __future__ import annotations

from typing import Any

import jax
import jax.numpy as jnp
import numpy as np

from ..common import jax_internals as internals
from ..common import status
from ..common.tree import copy_with
from ..mechanics.bundles import Bundles
from .one_phase import ConvergedPoints
from .results import map_element_fields, result_fields
from .schedule import Schedule
from .solution import Solution

_FIELDS_OF_NODES = (
    *("displacement", "positions", "reactions", "load"),
    *("rotation", "reaction_moments"),
)


def cut_results(solution: Solution, arguments: tuple[Any, ...], bundles: Bundles) -> Solution:
    """Cut the results of a padded analysis to the sizes of the one that was padded.

    Args:
        solution: `Solution` of `phase_loop.analyse` for the padded analysis.
        arguments: the arguments of `phase_loop.analyse` before they were padded.
        bundles: bundles of the analysis that was padded.
    """
    tree: Any
    leaves, tree = jax.tree.flatten(solution)
    on_host = [np.asarray(own) for own in leaves]
    cut, tree = jax.tree.flatten(cut_on_host(tree.unflatten(on_host), arguments, bundles))
    whole = {id(host): own for host, own in zip(on_host, leaves, strict=True)}
    changed = list({id(x): x for x in cut if id(x) not in whole}.values())
    device = next(iter(leaves[0].devices()))
    placed = zip(changed, internals.arrays_on_device(changed, device), strict=True)
    whole |= {id(host): own for host, own in placed}
    return tree.unflatten([whole[id(x)] for x in cut])


def cut_on_host(solution: Solution, arguments: tuple[Any, ...], bundles: Bundles) -> Solution:
    """Do as `cut_results` does with arrays of NumPy."""
    nodes, _, restart, schedule = arguments[0]
    most, n_row, n_phase = max(schedule.increments), len(nodes), len(schedule)
    ends, paths, log = jax.tree.map(
        lambda x: _first(x, n_phase),
        (solution.phases.ends, solution.phases.paths, solution.phases.log),
    )
    ends = _cut(ends, schedule, bundles, 1)
    paths = jax.tree.map(lambda x: _first(x, most, 1), paths)
    paths = _cut(paths, schedule, bundles, 2)
    if paths.motion is not None:
        paths = copy_with(paths, motion=_first(paths.motion, n_row, 2))
    phases = copy_with(
        solution.phases,
        ends=ends,
        paths=paths,
        log=_first(log, most, 1),
        increments=schedule.increments,
    )
    last = copy_with(
        _cut(solution.last, schedule, bundles, 0),
        restart=_cut_restart(solution.last, restart, schedule, bundles, nodes),
    )
    if solution.status == status.OK:  # the results of the solution are those of its last state
        solution = copy_with(solution, **result_fields(last))
    else:
        solution = _cut(solution, schedule, bundles, 0)
    return copy_with(solution, phases=phases, last=last)


def cut_points(
    points: ConvergedPoints | None, arguments: tuple[Any, ...]
) -> ConvergedPoints | None:
    """Return the `ConvergedPoints` of a padded analysis in its exact sizes; others as they are.

    Args:
        points: `ConvergedPoints`, traced or not; None for none.
        arguments: as for `cut_results`.
    """
    if points is None:
        return None
    nodes, *_, schedule = arguments[0]
    most, n_row, n_phase = max(schedule.increments), len(nodes), len(schedule)
    motions, codes = (
        _first(x if isinstance(x, jax.core.Tracer) else np.asarray(x), n_phase) for x in points
    )
    motions = _first(_first(motions, n_row, 2), min(motions.shape[1], most), 1)
    return ConvergedPoints(motions, _first(codes, most, 1))


def _cut(part, schedule: Schedule, bundles, axis):
    """Cut the results of nodes and elements in `part`, which are on this axis of its arrays."""
    fields = vars(part)
    there = [name for name in _FIELDS_OF_NODES if fields.get(name) is not None]
    results = dict(part.results or {})
    if schedule.present is None:
        results.pop("present", None)  # padding alone is absent
    part = copy_with(
        part,
        **{name: _first(fields[name], schedule.n_node, axis) for name in there},
        results=results,
    )
    return map_element_fields(part, lambda values: bundles.take_groups(values, axis))


def _first(x, count, axis=0):
    """Return the first `count` entries along an axis; the array itself if it has no more."""
    return x if x.shape[axis] == count else x[(*(slice(None),) * axis, slice(count))]


def _cut_restart(last, before, schedule, bundles, nodes):
    """Cut the `RestartState` of a padded analysis; `before` is the one it started from, or None."""
    restart, n_row = last.restart, len(nodes)
    states = bundles.take_groups(restart.states)
    if schedule.present is None:
        states = [copy_with(state, present=None) for state in states]
    factors = [
        copy_with(own, begun=None if own.begun is None else _first(own.begun, n_row, 1))
        for own in restart.load_factors
    ]
    turned = restart.support_rotation
    stacks = [*(() if before is None else before.loads), *schedule.loads]
    dtype = jnp.result_type(nodes)
    return copy_with(
        restart,
        motion=_first(restart.motion, n_row),
        states=states,
        nodal_load=_first(restart.nodal_load, n_row),
        loads=[_known_loads(stack, int(last.phase), dtype) for stack in stacks],
        load_factors=factors,
        support_rotation=None if turned is None else _first(turned, n_row),
    )


def _known_loads(stack, phase, dtype):
    """Return the numbers of a stack of loads, zero (also for NaN) in phases after `phase`."""
    known = np.asarray(stack.phase) <= phase
    found = []
    for leaf in jax.tree.leaves(stack.load):
        x = np.asarray(leaf)
        real = np.issubdtype(x.dtype, np.floating)
        x = x.astype(dtype if real else jax.dtypes.canonicalize_dtype(x.dtype))
        if stack.late:
            x = np.where(known.reshape(-1, *(1,) * (x.ndim - 1)), x, np.zeros((), x.dtype))
        found.append(x)
    return found
