"""Analyses outside of `jit`, where numbers are known: which programs run, and for which sizes.

Arrays are padded to common sizes (`common_sizes`). Where few analyses need fallbacks, a smaller
program without them runs first.
"""

from __future__ import annotations

from typing import Any

import jax
import numpy as np

from ..common import status
from ..common.compilation import is_top_level_call, on_forget_programs, program_settings
from ..common.program_store import argument_signature
from ..common.tree import set_fields
from ..equilibrium.newton import Newton, NewtonWithoutFallbacks
from .common_sizes import pad_analysis
from .cut_results import cut_results
from .phase_loop import analyse

_fell_back: set[Any] = set()  # analyses that have needed fallbacks, by tree and shapes
on_forget_programs(_fell_back.clear)

_MOST_SHAPES = 256
_result_shapes_by_key: dict[Any, Any] = {}  # shapes of results of padded analyses
on_forget_programs(_result_shapes_by_key.clear)


def analyse_by_known_programs(
    task, arguments, differentiate_path=False, listen=None, exact_sizes=False
):
    """Run a `PreparedAnalysis`, padded to common sizes, without fallbacks if it needs none.

    Only outside of `jit`, where the status of the smaller program is known. Within it, and where
    such an analysis has needed fallbacks before, the program is that of `analyse`.

    Args:
        task: `PreparedAnalysis`.
        arguments: `without_indices`, `arrays`, `method` and `code` of `analyse`.
        differentiate_path, listen: as for `analyse`.
        exact_sizes: whether not to pad the arrays to `common_sizes`.

    Returns:
        `Solution` and `ConvergedPoints`, as `analyse`; points are those of the padded analysis.
    """
    given = {"differentiate_path": differentiate_path, "listen": listen}
    if not is_top_level_call(jax.tree.leaves(arguments)):
        return analyse(*arguments, **given, bundles=task.bundles, size=task.n_unknown)
    exact = exact_sizes or differentiate_path
    padded = None if exact else pad_analysis(task, arguments, listen is not None)
    larger, bundles, size = _sized(task, arguments, padded)
    found = _analyse(task, larger, {**given, "bundles": bundles, "size": size})
    if padded is None:
        return found
    _note_result_shapes(larger, bundles, found)
    solution, points = found
    return cut_results(solution, arguments, task.bundles), points


def _sized(task, arguments, padded):
    """Return arguments, bundles and number of unknowns of a program; `padded` may be None."""
    if padded is None:
        return arguments, task.bundles, task.n_unknown
    larger, bundles, sizes = padded
    return larger, bundles, sizes.unknowns


def _analyse(task, arguments, given):
    """Run an analysis, by the smaller program if it does without fallbacks."""
    if task.may_go_without_fallbacks and given["listen"] is None:
        leaves, tree = jax.tree.flatten(arguments)
        key = tree, given["bundles"], tuple(map(argument_signature, leaves))
        if key not in _fell_back:
            found = analyse(*_without_fallbacks(*arguments), **given)
            if int(found[0].status) != status.NEEDS_FALLBACKS:
                return found
            _fell_back.add(key)
    return analyse(*arguments, **given)


def _without_fallbacks(*arguments):
    """Return the arguments of `analyse` with the method in its form without fallbacks."""
    *parts, method, code = arguments
    smaller = object.__new__(NewtonWithoutFallbacks)  # numbers were checked before
    set_fields(smaller, **{name: getattr(method, name) for name in Newton._all_fields})
    return *parts, smaller, code


def compile_analysis(arguments, bundles, size, with_fallbacks):
    """Compile a program of an analysis, with fallbacks or without, and run it once.

    Args:
        arguments, bundles: as for `analyse`.
        size: number of unknowns.
        with_fallbacks: whether the method has fallbacks.
    """
    given = {"differentiate_path": False, "listen": None, "bundles": bundles, "size": size}
    arguments = arguments if with_fallbacks else _without_fallbacks(*arguments)
    jax.block_until_ready(analyse(*arguments, **given))


def padded_result_shapes(task, padded, listen=None):
    """Return the shapes of what `analyse` returns for a padded analysis, `padded`.

    They are known if such an analysis has run; else its program is compiled.
    """
    larger, bundles, sizes = padded
    known = _result_shapes_by_key.get(_shape_key(larger, bundles))
    if known is not None:
        return known
    if task.may_go_without_fallbacks and listen is None:
        larger = _without_fallbacks(*larger)
    given = {"differentiate_path": False, "listen": listen, "bundles": bundles}
    return analyse.result_shapes(*larger, **given, size=sizes.unknowns)


def _note_result_shapes(arguments, bundles, found):
    """Note the shapes of what an analysis returns, for its derivatives."""
    key = _shape_key(arguments, bundles)
    if key not in _result_shapes_by_key:
        shapes = jax.tree.map(lambda x: jax.ShapeDtypeStruct(x.shape, x.dtype), found)
        _result_shapes_by_key[key] = shapes
        while len(_result_shapes_by_key) > _MOST_SHAPES:
            _result_shapes_by_key.pop(next(iter(_result_shapes_by_key)), None)  # or another thread


def _shape_key(arguments, bundles):
    """Return what the shapes of results depend on."""
    leaves, tree = jax.tree.flatten(arguments)
    return tree, bundles, tuple(map(np.shape, leaves)), program_settings()


def without_numbers(task):
    """Return a `PreparedAnalysis` without arrays: hashable, with what programs depend on."""
    nothing = dict.fromkeys(("without_indices", "arrays", "method", "code", "loads"))
    return task._replace(**nothing, fixed=())
