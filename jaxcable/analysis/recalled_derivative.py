"""Derivatives of a solution outside of `jit`: programs of their own, without the iteration.

Where `jax.grad` and its like see the numbers of an analysis, it is solved first, by the program
that `solve` has without derivatives. The derivative of its converged points is another program,
much smaller than one that iterates once more, and only for the results and inputs that are asked
for. Within `jax.jit` there is one program, as before.

As roots (`numerics.implicit_root`), solutions are results of a primitive of jax, and so are their
changes: any order and mode of derivatives works.
"""

from __future__ import annotations

import functools
from collections.abc import Hashable, Sequence
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jax import lax

from ..common import jax_internals as internals
from ..common.compilation import jit_program
from ..common.split_programs import ProgramCall, call_apart, is_split_here, is_splitting
from ..common.types import Array, PyTree
from ..mechanics.bundles import Bundles
from .one_phase import ConvergedPoints
from .phase_loop import recall_solution
from .solution import Solution


def can_stay_apart() -> bool:
    """Tell whether an analysis at this place of a function that is split stays apart."""
    return None not in (_SOLUTION, _CHANGE) and is_split_here()


def known_numbers(core: PyTree[Any]) -> PyTree[Any] | None:
    """Return the arguments of an analysis without derivatives, if they are known; else None.

    They are known where a derivative is taken outside of `jit`; else None is returned.
    """
    if None in (_SOLUTION, _CHANGE) or not internals.is_differentiating():
        return None
    known = without_derivatives(core)
    traced = any(isinstance(x, jax.core.Tracer) for x in jax.tree.leaves(known))
    return None if traced else known


def without_derivatives(core: PyTree[Any]) -> PyTree[Any]:
    """Return the arguments of an analysis with no derivatives of their own."""

    def without(x):
        return lax.stop_gradient(x) if isinstance(x, jax.core.Tracer) else x

    return jax.tree.map(without, core)


def attach_recalled_derivative(
    solution: Solution, core: PyTree[Any], points: ConvergedPoints, bundles: Bundles, size: int
) -> Solution:
    """Return a known solution with its derivatives by the arguments of the analysis.

    Args:
        solution: `Solution` of the compiled core.
        core: arguments of the compiled core that are differentiated, of which it was computed.
        points: `ConvergedPoints` of the solution.
        bundles, size: as for the compiled core.
    """
    shape: Any
    values, shape = jax.tree.flatten(solution)
    leaves, tree = jax.tree.flatten(core)
    settings = _Settings(tree, bundles, size, len(values), len(leaves))
    # not `jnp.asarray`: each shape would be compiled while derivatives are taken
    arrays = [x if hasattr(x, "dtype") else np.asarray(x) for x in (*values, *leaves, *points)]
    return shape.unflatten(_SOLUTION.bind(*arrays, settings=settings))


class _Settings(NamedTuple):
    """What the primitives are told of an analysis.

    Attributes:
        tree: tree of the arguments of the compiled core (`jax.tree.structure`).
        bundles: `Bundles`.
        size: number of unknowns.
        n_value, n_leaf: numbers of leaves of the solution, and of these arguments.
    """

    tree: Hashable
    bundles: Bundles
    size: int
    n_value: int
    n_leaf: int

    def core_and_points(self, arrays: Sequence[Array]) -> tuple[Any, ConvergedPoints]:
        """Return core and points of a list of the leaves of both."""
        tree: Any = self.tree
        core = tree.unflatten(arrays[: self.n_leaf])
        return core, ConvergedPoints(*arrays[self.n_leaf :])


@functools.partial(jit_program, static=("bundles", "moving", "wanted"))
def change_of_solution(core, points, changes, bundles, moving, wanted):
    """Return the changes of the results `wanted` for changes of the arguments `moving`."""
    results, at = _results_of(core, points, bundles, moving, wanted)
    return jax.jvp(results, (at,), (list(changes),))[1]


@functools.partial(jit_program, static=("bundles", "moving", "wanted"))
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


def _return_values(*arrays, settings):
    """Return the leaves of the solution: the value of the primitive `_SOLUTION`."""
    return list(arrays[: settings.n_value])


def _solution_jvp(primals, tangents, *, settings):
    """Forward derivative of `_SOLUTION`: its floats change as the primitive `_CHANGE` says."""
    found = _SOLUTION.bind(*primals, settings=settings)
    known, changes = primals[settings.n_value :], tangents[settings.n_value :]
    moving = tuple(
        k
        for k, change in enumerate(changes[: settings.n_leaf])
        if jnp.issubdtype(known[k].dtype, jnp.inexact) and not internals.is_zero_tangent(change)
    )
    wanted = tuple(k for k, x in enumerate(found) if jnp.issubdtype(x.dtype, jnp.inexact))
    out = [internals.zero_tangent(x) for x in found]
    if moving:
        shapes = tuple((found[k].shape, found[k].dtype) for k in wanted)
        given = {"settings": settings, "moving": moving, "wanted": wanted, "shapes": shapes}
        moved = _CHANGE.bind(*known, *(changes[k] for k in moving), **given)
        for k, change in zip(wanted, moved, strict=True):
            out[k] = change
    return found, out


def _evaluate_change(*arrays, settings, moving, wanted, shapes):
    """Return the changes of the results `wanted`; the last arrays are the changes of arguments."""
    count = len(arrays) - len(moving)
    core, points = settings.core_and_points(arrays[:count])
    given = {"bundles": settings.bundles, "moving": moving, "size": settings.size}
    if not is_splitting():
        return change_of_solution(core, points, list(arrays[count:]), wanted=wanted, **given)

    def call(places):  # few results compile faster
        some = tuple(wanted[k] for k in places)
        return ProgramCall(
            functools.partial(change_of_solution, wanted=some, **given),
            lambda *_: [jax.ShapeDtypeStruct(*shapes[k]) for k in places],
            call,
        )

    return call_apart(call(tuple(range(len(wanted)))), core, points, list(arrays[count:]))


def _shapes_of_change(*_, shapes, **__):
    """Return shapes and dtypes of the changes."""
    return [internals.abstract_array(jax.ShapeDtypeStruct(*one)) for one in shapes]


def _change_jvp(primals, tangents, *, moving, **given):
    """Forward derivative of `_CHANGE`: linear in the changes, traced in the other arguments."""
    count = len(primals) - len(moving)
    out = _CHANGE.bind(*primals, moving=moving, **given)
    if all(internals.is_zero_tangent(t) for t in tangents[:count]):
        further = [internals.instantiate_tangent(t) for t in tangents[count:]]
        return out, _CHANGE.bind(*primals[:count], *further, moving=moving, **given)
    places = [k for k, t in enumerate(tangents) if not internals.is_zero_tangent(t)]

    def some(*values):
        at = list(primals)
        for k, x in zip(places, values, strict=True):
            at[k] = x
        return _evaluate_change(*at, moving=moving, **given)

    start, direction = [primals[k] for k in places], [tangents[k] for k in places]
    return out, jax.jvp(some, start, direction)[1]


def _change_transpose(cotangents, *arrays, settings, moving, wanted, shapes):
    """Transpose `_CHANGE` in the changes, for reverse mode: the adjoint of the analysis."""
    count = len(arrays) - len(moving)
    pairs = zip(wanted, cotangents, strict=True)
    some = {k: x for k, x in pairs if not internals.is_zero_tangent(x)}
    if not some:
        return [None] * len(arrays)
    core, points = settings.core_and_points(arrays[:count])
    given = {"bundles": settings.bundles, "moving": moving, "wanted": tuple(some)}
    run = functools.partial(adjoint_of_solution, **given, size=settings.size)
    given = core, points, list(some.values())
    if is_splitting():
        shapes = [jax.ShapeDtypeStruct(arrays[k].shape, arrays[k].dtype) for k in moving]
        pulled = call_apart(ProgramCall(run, lambda *_: shapes), *given)
    else:
        pulled = run(*given)
    return [None] * count + list(pulled)


def _batch_solution(arrays, axes, *, settings):
    """Map `_SOLUTION` over a batch: the same values."""
    return _return_values(*arrays, settings=settings), list(axes[: settings.n_value])


def _batch_change(arrays, axes, **given):
    """Map `_CHANGE` over a batch, such as one of directions: its program under `jax.vmap`."""
    found = jax.vmap(functools.partial(_evaluate_change, **given), axes)(*arrays)
    return found, [0] * len(found)


_SOLUTION = internals.define_primitive(
    "recalled_solution",
    _return_values,
    lambda *arrays, settings: list(arrays[: settings.n_value]),
    _solution_jvp,
    _batch_solution,
    multiple_results=True,
)
# change of a solution, linear in the changes of the arguments of the analysis
_CHANGE = internals.define_primitive(
    "change_of_solution",
    _evaluate_change,
    _shapes_of_change,
    _change_jvp,
    _batch_change,
    _change_transpose,
    multiple_results=True,
)
