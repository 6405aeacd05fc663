"""Programs of derivatives of a known solution, without the iteration, for common sizes.

As analyses outside of `jit` (`outside_jit`), their derivatives run by programs of a few common
sizes, on the padded arguments and the points of the padded analysis. Changes of arguments are
padded and those of results are cut; for cotangents it is the other way round (`size_maps`).
"""

from __future__ import annotations

import functools
from collections.abc import Callable, Sequence
from typing import Any, NamedTuple

import jax
import numpy as np

from ..common import jax_internals as internals
from ..common import status
from ..evaluation.program_calls import as_program
from ..common.types import Array
from ..mechanics.bundles import Bundles
from .common_sizes import pad_analysis
from .cut_results import cut_points
from .one_phase import ConvergedPoints
from .outside_jit import analyse_by_known_programs, padded_result_shapes, without_numbers
from .padding import common_size, doubled_size
from .phase_loop import recall_solution
from .preparation import PreparedAnalysis
from .size_maps import ArgumentMap, ResultMap, is_of_section, size_maps

_FEW_DIRECTIONS = 8


@functools.partial(as_program, static=("bundles", "moving", "wanted"))
def change_of_solution(core, points, changes, bundles, moving, wanted):
    """Return the changes of the results `wanted` for changes of the arguments `moving`."""
    results, at = _results_of(core, points, bundles, moving, wanted)
    return jax.jvp(results, (at,), (list(changes),))[1]


@functools.partial(as_program, static=("bundles", "moving", "wanted"))
def adjoint_of_solution(core, points, cotangents, bundles, moving, wanted):
    """Return the cotangents of the arguments `moving` for those of the results `wanted`."""
    results, at = _results_of(core, points, bundles, moving, wanted)
    return jax.vjp(results, at)[1](list(cotangents))[0]


def _results_of(core, points, bundles, moving, wanted):
    """Return the results `wanted` as a function of the arguments `moving`, and these arguments."""
    leaves, tree = jax.tree.flatten(core)

    def results(values):
        at = list(leaves)
        for k, value in zip(moving, values, strict=True):
            at[k] = value
        found = jax.tree.leaves(recall_solution(*tree.unflatten(at), points, bundles))
        return [found[k] for k in wanted]

    return results, [leaves[k] for k in moving]


class Recalled(NamedTuple):
    """A solved analysis without its numbers; hashable.

    Attributes:
        task: `PreparedAnalysis` by `outside_jit.without_numbers`.
        listen: as for `analyse_by_known_programs`.
        exact_sizes: whether it was not padded, and its derivatives are not.
    """

    task: PreparedAnalysis
    listen: Callable[..., object] | None = None
    exact_sizes: bool = False

    def given(self, moving: tuple[int, ...], wanted: tuple[int, ...]) -> dict[str, Any]:
        """Return the keyword arguments of a program of exact sizes."""
        own = {"bundles": self.task.bundles, "size": self.task.n_unknown}
        return {**own, "moving": moving, "wanted": wanted}


def trace_change(recalled: Recalled, core, points, changes, moving, wanted) -> list[Array]:
    """Do as `run_change` where arrays are traced: a part of another program, of exact sizes."""
    given = recalled.given(moving, wanted)
    return change_of_solution(core, cut_points(points, core), list(changes), **given)


def trace_adjoint(recalled: Recalled, core, points, cotangents, moving, wanted) -> list[Array]:
    """Do as `run_adjoint` where arrays are traced: a part of another program, of exact sizes."""
    given = recalled.given(moving, wanted)
    return adjoint_of_solution(core, cut_points(points, core), list(cotangents), **given)


def run_change(
    recalled: Recalled,
    core: tuple[Any, ...],
    points: ConvergedPoints | None,
    changes: Sequence[Any],
    moving: tuple[int, ...],
    wanted: tuple[int, ...],
    count: int | None = None,
) -> list[Array]:
    """Compute changes of results for changes of arguments; all arrays are known.

    Args:
        recalled: `Recalled`.
        core: arguments of `analyse`.
        points: `ConvergedPoints`, of the padded analysis unless it has exact sizes.
        changes: changes of the arguments `moving`.
        moving, wanted: indices of arguments (among the leaves of `core`) and of results (among
            those of the solution), all floats.
        count: number of directions, which is a leading axis of all changes; None for no such axis.

    Returns:
        The changes of the results `wanted`, with the same leading axis.
    """
    padded = _padded(recalled, core, points)
    if padded is None:
        given = recalled.given(moving, wanted)
        found = _call(change_of_solution, core, cut_points(points, core), changes, count, given)
        return found if count is None else _on_device(_on_host(found, count), found)
    changes, lead = [np.asarray(x) for x in changes], () if count is None else (count,)
    own = padded.arguments.pad_changes(moving, changes, lead)
    sources = padded.results.sources(wanted)
    given = padded.given(tuple(own), sources)
    found = _call(change_of_solution, padded.core, points, [*own.values()], count, given)
    host = dict(zip(sources, _on_host(found, count), strict=True))
    direct = dict(zip(moving, changes, strict=True))
    return _on_device(padded.results.cut_changes(wanted, host, direct, lead), found)


def run_adjoint(
    recalled: Recalled,
    core: tuple[Any, ...],
    points: ConvergedPoints | None,
    cotangents: Sequence[Any],
    moving: tuple[int, ...],
    wanted: tuple[int, ...],
    count: int | None = None,
) -> list[Array]:
    """Compute cotangents of arguments from cotangents of results; all arrays are known.

    Args:
        recalled, core, points, moving, wanted, count: as for `run_change`.
        cotangents: cotangents of the results `wanted`.

    Returns:
        The cotangents of the arguments `moving`.
    """
    padded = _padded(recalled, core, points)
    if padded is None:
        given = recalled.given(moving, wanted)
        found = _call(adjoint_of_solution, core, cut_points(points, core), cotangents, count, given)
        return found if count is None else _on_device(_on_host(found, count), found)
    cotangents, lead = [np.asarray(x) for x in cotangents], () if count is None else (count,)
    own, direct = padded.results.pad_cotangents(wanted, cotangents, lead)
    needed = padded.arguments.needed(moving)
    given = padded.given(needed, tuple(own))
    found = _call(adjoint_of_solution, padded.core, points, [*own.values()], count, given)
    host = dict(zip(needed, _on_host(found, count), strict=True))
    pulled = padded.arguments.cut_cotangents(moving, host, lead)
    leaves, out = jax.tree.leaves(core), []
    for k, x in zip(moving, pulled, strict=True):
        own_shape = *lead, *np.shape(leaves[k])
        out.append((x.reshape(own_shape) + direct.get(k, 0.0)).astype(leaves[k].dtype))
    return _on_device(out, found)


def compile_adjoint(
    task: PreparedAnalysis, core: tuple[Any, ...], names: Sequence[str], by_sections: bool
) -> bool:
    """Analyse, and compile the program of gradients of the solution's results `names`; run it once.

    Args:
        task: `PreparedAnalysis` that can be padded.
        core: its arguments of `analyse`.
        names: names of results; all element groups that have them are taken.
        by_sections: whether gradients are also by numbers of sections, such as areas of fibres.

    Returns:
        Whether there is such a program; there is none where no element has a section.
    """
    moving = [
        k
        for k, (path, x) in enumerate(jax.tree_util.tree_leaves_with_path(core))
        if is_of_section(path) == by_sections and np.issubdtype(np.asarray(x).dtype, np.floating)
    ]
    if not moving:
        return False
    tree: Any
    solution, points = analyse_by_known_programs(task, core)
    leaves, tree = jax.tree.flatten(solution)
    places = tree.unflatten(range(len(leaves)))
    wanted = tuple(jax.tree.leaves([getattr(places, name) for name in names]))
    cotangents = [np.zeros(leaves[k].shape, leaves[k].dtype) for k in wanted]
    run_adjoint(Recalled(without_numbers(task)), core, points, cotangents, (moving[0],), wanted)
    return True


class _Padded(NamedTuple):
    """A padded analysis: its arguments, bundles and number of unknowns, and the maps to it."""

    core: tuple[Any, ...]
    bundles: Bundles
    n_unknown: int
    arguments: ArgumentMap
    results: ResultMap

    def given(self, moving, wanted):
        """Return the keyword arguments of a program."""
        own = {"bundles": self.bundles, "size": self.n_unknown}
        return {**own, "moving": moving, "wanted": wanted}


def _padded(recalled, core, points):
    """Return the `_Padded` analysis of arguments `core`; None if it is not padded."""
    if recalled.exact_sizes:
        return None
    task, listens = recalled.task, recalled.listen is not None
    core = jax.tree.map(np.asarray, core)
    padded = pad_analysis(task, core, listens)
    if padded is None:
        return None
    larger, bundles, sizes = padded

    def shapes():
        return padded_result_shapes(task, padded, recalled.listen)

    maps = size_maps(task, core, shapes, listens, _last_phase(points, len(core[0][-1])))
    return _Padded(jax.tree.map(np.asarray, larger), bundles, sizes.unknowns, *maps)


def _last_phase(points, n_phase):
    """Return the index of the last phase in which an increment has converged, -1 for none."""
    if points is None:
        return n_phase - 1
    return int(np.sum(np.asarray(points.codes)[:n_phase, 0] == status.OK)) - 1


def _call(program, core, points, values, count, given):
    """Run one of the programs above for a number of directions, or for one (`count` is None).

    There are a few numbers of directions, too: zeros are added.
    """
    if count is None:
        return program(core, points, values, **given)
    if count <= _FEW_DIRECTIONS:
        several = doubled_size(count, 1)
    else:
        several = common_size(count)
    values = [np.asarray(x) for x in values]
    rest = several - count
    values = [np.concatenate([x, np.zeros((rest, *x.shape[1:]), x.dtype)]) for x in values]
    axes = *(None,) * len(jax.tree.leaves((core, points))), *(0,) * len(values)
    return program(core, points, values, **given, axes=axes)


def _on_host(found, count):
    """Return results of `_call` as arrays of NumPy, without directions that were added."""
    return [np.asarray(x) if count is None else np.asarray(x)[:count] for x in found]


def _on_device(arrays, found):
    """Return jax arrays of `arrays`, on the device of the jax arrays `found`."""
    device = next(iter(found[0].devices())) if found else jax.devices()[0]
    arrays = [np.asarray(x, jax.dtypes.canonicalize_dtype(x.dtype), order="C") for x in arrays]
    return internals.arrays_on_device(arrays, device)
