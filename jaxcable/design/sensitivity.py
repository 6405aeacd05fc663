"""Results of all phases with their derivatives by numbers of the phases, by one kept program.

The program takes all numbers as arguments: those of the structure and the phases, and the
directions in which numbers of the phases change. Other numbers do not compile it again, nor does
what is then computed of the results. It is traced by the phase, as that of `solve`: derivatives of
all phases are one loop.
"""

from __future__ import annotations

import functools
from collections.abc import Callable, Sequence
from typing import Any

import jax
import jax.numpy as jnp
from jax import lax

from ..analysis.phases import Phase
from ..analysis.preparation import prepare
from ..analysis.solution import Solution, State
from ..analysis.solver import analysed
from ..analysis.states import arranged
from ..common.compilation import program
from ..common.tree import copy
from ..common.types import Array, Float, Int
from ..equilibrium.incremental import Incremental
from ..equilibrium.newton import Newton
from ..model.structure import Structure
from ..numerics import implicit

_TOGETHER = 32
"""Directions of one run of the program, at most: their results are in memory together."""


def sensitivity(
    structure: Structure,
    put: Callable[[Float[Array, " n"]], Sequence[Phase]],
    measure: Callable[[Solution], Float[Array, " m"]],
    names: tuple[str, ...],
    x: Float[Array, " n"],
    method: Newton | Incremental | None,
    start: Solution | State | None,
) -> tuple[Float[Array, " m"], Float[Array, "m n"], Int[Array, ""]]:
    """What is measured of the results of phases, its derivative, and the status of the analysis.

    Args:
        structure, method, start: as for `solve`.
        put: function of numbers [n] that returns the phases with them.
        measure: function of the `Solution` to an array [m].
        names: results of phases by which it measures: fewer compile faster.
        x: the numbers, [n].
    """
    task: Any = None
    tree: Any
    moving: tuple[int, ...] = ()

    def moved(x):
        """What is traced of the arguments of the analysis: that is what depends on the numbers."""
        nonlocal task, moving
        task = prepare(structure, put(x), method, start, to_end=True)
        leaves = jax.tree.leaves(_core(task))
        moving = tuple(k for k, leaf in enumerate(leaves) if isinstance(leaf, jax.core.Tracer))
        return [leaves[k] for k in moving]

    values, push = jax.linearize(moved, x)
    leaves, tree = jax.tree.flatten(_core(task))
    for k, value in zip(moving, values, strict=True):
        leaves[k] = value
    together = min(x.size, _TOGETHER)
    every = jnp.eye(x.size + -x.size % together, x.size, dtype=x.dtype)
    columns = []
    for k in range(0, x.size, together):
        changes = jax.vmap(push)(every[k : k + together])
        core = tree.unflatten(leaves)
        given = {"bundles": task.bundles, "moving": moving, "names": names}
        solution, ends = _pushed(core, changes, **given, size=task.n_free)

        def measured(phases, solution=solution):
            return measure(arranged(structure, copy(solution, phases=phases), task))

        found, column = _measured(measured, names, solution.phases, ends)
        columns.append(column)
    return found, jnp.concatenate(columns)[: x.size].T, solution.status


def _core(task):
    """The arrays that the compiled core of an analysis takes, as arguments of `analysed`."""
    return task.thawed, task.arrays, task.method, task.code


@functools.partial(program, static=("bundles", "moving", "names"))
def _pushed(core, changes, bundles, moving, names):
    """The solution, and the changes of its `phases.ends` for some changes of the leaves `moving`.

    Args:
        core: see `_core`.
        changes: list of arrays, an axis of directions before those of the leaf.
        bundles, moving, names: static.

    Returns:
        `Solution` of the compiled core; list of arrays for `_floats` of its `phases.ends`.
    """
    leaves, tree = jax.tree.flatten(core)

    def analyse(values):
        at = list(leaves)
        for k, value in zip(moving, values, strict=True):
            at[k] = value
        solution = analysed(*tree.unflatten(at), bundles)
        return _floats(solution.phases.ends, names)[0], solution

    # forward and linear part apart: a fifth more to compile than one direction, but the iteration
    # is done once for all
    _, push, solution = jax.linearize(analyse, [leaves[k] for k in moving], has_aux=True)
    return solution, lax.map(push, changes)


def _floats(ends, names):
    """The floats of some results of phases, and a function that puts others in their place."""
    leaves, shape = jax.tree.flatten({name: getattr(ends, name) for name in names})
    real = [jnp.issubdtype(jnp.result_type(x), jnp.floating) for x in leaves]

    def back(floats):
        floats = iter(floats)
        put = [next(floats) if own else x for own, x in zip(real, leaves, strict=True)]
        return copy(ends, **shape.unflatten(put))

    return [x for own, x in zip(real, leaves, strict=True) if own], back


def _measured(measure, names, phases, changes):
    """What is measured of phases, [m], and its derivatives in all directions, [n_direction, m]."""
    floats, back = _floats(phases.ends, names)

    def value(floats):
        # paths have no derivatives (`solve`): those by the ends are NaN, too
        paths = implicit.undifferentiated(phases.paths, floats)
        return measure(copy(phases, ends=back(floats), paths=paths))

    found, push = jax.linearize(value, floats)
    return found, jax.vmap(push)(changes)
