"""Programs compiled in advance: those that analyses of the same kind and size will look for."""

from __future__ import annotations

import itertools
import time
from collections.abc import Iterable, Iterator
from typing import Any, NamedTuple

import jax

from ..analysis.as_built import with_guessed_lengths
from ..analysis.common_sizes import CommonSizes, pad_analysis
from ..analysis.derivative_programs import compile_adjoint
from ..analysis.outside_jit import compile_analysis
from ..analysis.phases import Phase
from ..analysis.preparation import prepare
from ..common.program_store import argument_signature
from ..model.structure import Structure

_OBJECTIVES = ("displacement",), ("tension",), ("displacement", "tension")
"""Results of which gradients are usual, by any arguments."""


class WarmedProgram(NamedTuple):
    """A program for analyses of one kind and size.

    Attributes:
        sizes: `CommonSizes` of these analyses; None if it is for the sizes of one structure only.
        has_fallbacks: whether it has the steps that few analyses need.
        seconds: time that it took to compile the program, or to find it on disk.
        gradient_of: names of the results of which it computes the gradient; () for an analysis.
        by_sections: whether this gradient is also by numbers of sections, such as areas.
    """

    sizes: CommonSizes | None
    has_fallbacks: bool
    seconds: float
    gradient_of: tuple[str, ...] = ()
    by_sections: bool = False


def warm_programs(
    scenes: Iterable[tuple[Structure, list[Phase]]], gradients: bool = False
) -> Iterator[WarmedProgram]:
    """Compile the programs that scenes need outside of `jax.jit`, one for each kind and size.

    First those without fallbacks, which most analyses end with, then those with them, then those of
    gradients. With `keep_programs` they lie on disk, for other processes.

    Args:
        scenes: pairs of structure and phases.
        gradients: whether to compile the programs of gradients of displacements, of tensions, and
            of both, by any arguments. Scenes that have programs of their own sizes have none: these
            depend on the arguments.

    Yields:
        `WarmedProgram`, each when it has been compiled.
    """
    tasks = []
    known: set[Any] = set()
    for structure, phases in scenes:
        phases = with_guessed_lengths(structure, phases)
        task = prepare(structure, phases, None, None, to_end=True)
        core = task.without_indices, task.arrays, task.method, task.code
        padded = pad_analysis(task, core)
        arguments, bundles, sizes = (core, task.bundles, None) if padded is None else padded
        leaves, tree = jax.tree.flatten(arguments)
        key: Any = (tree, bundles, tuple(map(argument_signature, leaves)))
        if key not in known:
            known.add(key)
            tasks.append((task, arguments, bundles, sizes))
    for with_fallbacks in (False, True):
        for task, arguments, bundles, sizes in tasks:
            if with_fallbacks or task.may_go_without_fallbacks:
                begin = time.perf_counter()
                size = task.n_unknown if sizes is None else sizes.unknowns
                compile_analysis(arguments, bundles, size, with_fallbacks)
                yield WarmedProgram(sizes, with_fallbacks, time.perf_counter() - begin)
    for task, _, _, sizes in tasks:
        if not gradients or sizes is None:
            continue
        for names, by_sections in itertools.product(_OBJECTIVES, (False, True)):
            begin = time.perf_counter()
            core = task.without_indices, task.arrays, task.method, task.code
            if compile_adjoint(task, core, names, by_sections):
                seconds = time.perf_counter() - begin
                yield WarmedProgram(sizes, False, seconds, names, by_sections)
