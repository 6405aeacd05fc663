"""Derivatives of a solution outside of `jit`: programs of their own, without the iteration.

Where `jax.grad` and its like see the numbers of an analysis, it is solved first, by the program
that `solve` has without derivatives. The derivative of its converged points is another program,
much smaller than one that iterates once more, for the results that are asked for. Within `jax.jit`
there is one program.

As roots (`numerics.implicit_root`), solutions are results of a primitive of jax, and so are their
changes and the cotangents of their arguments: any order and mode of derivatives works.
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
from ..common.types import Array, PyTree
from ..mechanics.bundles import Bundles
from ..programs.program_calls import as_program
from .one_phase import ConvergedPoints
from .phase_loop import recall_solution
from .preparation import PreparedAnalysis
from .solution import Solution


@functools.partial(as_program, static=("bundles", "moving", "wanted"))
def change_of_solution(core, points, changes, bundles, moving, wanted):
    """Return the changes of results of an analysis for changes of its arguments.

    Args:
        core: arguments of `phase_loop.analyse`.
        points: its `ConvergedPoints`.
        changes: changes of the arguments `moving`, a list of arrays.
        bundles: as for `analyse`.
        moving, wanted: indices of arguments (among the leaves of `core`) and of results (among
            those of the solution), all floats.

    Returns:
        The changes of the results `wanted`, a list of arrays.
    """
    results, at = _results_of(core, points, bundles, moving, wanted)
    return jax.jvp(results, (at,), (list(changes),))[1]


@functools.partial(as_program, static=("bundles", "moving", "wanted"))
def adjoint_of_solution(core, points, cotangents, bundles, moving, wanted):
    """Return the cotangents of the arguments `moving` for those of the results `wanted`.

    Args:
        core, points, bundles, moving, wanted: as for `change_of_solution`.
        cotangents: cotangents of the results `wanted`, a list of arrays.
    """
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


def known_numbers(core: PyTree[Any]) -> PyTree[Any] | None:
    """Return the arguments of an analysis without derivatives; None if they are not known.

    They are known where a derivative is taken outside of `jit`.
    """
    if None in (_SOLUTION, _CHANGE, _ADJOINT) or not internals.is_differentiating():
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
    solution: Solution, core: PyTree[Any], points: ConvergedPoints, task: PreparedAnalysis
) -> Solution:
    """Return a known solution with its derivatives by the arguments of the analysis.

    Args:
        solution: `Solution` of the compiled core.
        core: arguments of the compiled core that are differentiated, of which it was computed.
        points: `ConvergedPoints` of the analysis.
        task: the analysis.
    """
    shape: Any
    values, shape = jax.tree.flatten(solution)
    leaves, tree = jax.tree.flatten(core)
    settings = _Settings(tree, task.bundles, len(values), len(leaves))
    # not `jnp.asarray`: each shape would be compiled while derivatives are taken
    arrays = [x if hasattr(x, "dtype") else np.asarray(x) for x in (*values, *leaves, *points)]
    return shape.unflatten(_SOLUTION.bind(*arrays, settings=settings))


class _Settings(NamedTuple):
    """What the primitives are told of an analysis.

    Attributes:
        tree: tree of the arguments of the compiled core (`jax.tree.structure`).
        bundles: as in `PreparedAnalysis`.
        n_value, n_leaf: numbers of leaves of the solution, and of these arguments.
    """

    tree: Hashable
    bundles: Bundles
    n_value: int
    n_leaf: int

    def core_and_points(self, arrays: Sequence[Array]) -> tuple[Any, ConvergedPoints]:
        """Return core and points of a list of the leaves of both."""
        tree: Any = self.tree
        core = tree.unflatten(arrays[: self.n_leaf])
        return core, ConvergedPoints(*arrays[self.n_leaf :])


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


def _evaluate(program, arrays, count, settings, moving, wanted, axes=None):
    """Run one of the programs above, for values that are the last `count` of the arrays.

    `axes` are those of a batch of all arrays, a list, or None.
    """
    first = len(arrays) - count
    core, points = settings.core_and_points(arrays[:first])
    given = {"bundles": settings.bundles, "moving": moving, "wanted": wanted}
    axes = None if axes is None else tuple(axes)
    return program(core, points, list(arrays[first:]), axes=axes, **given)


def _evaluate_change(*arrays, settings, moving, wanted, shapes, axes=None):
    """Return the changes of the results `wanted`; the last arrays are the changes of arguments."""
    return _evaluate(change_of_solution, arrays, len(moving), settings, moving, wanted, axes)


def _shapes_of_change(*_, shapes, **__):
    """Return shapes and dtypes of the changes."""
    return [internals.abstract_array(jax.ShapeDtypeStruct(*one)) for one in shapes]


def _change_jvp(primals, tangents, **given):
    """Forward derivative of `_CHANGE`: linear in the changes, traced in the other arguments."""
    return _linear_jvp(_CHANGE, _evaluate_change, primals, tangents, len(given["moving"]), given)


def _change_transpose(cotangents, *arrays, settings, moving, wanted, shapes):
    """Transpose `_CHANGE` in the changes, for reverse mode: the adjoint of the analysis."""
    count = len(arrays) - len(moving)
    places = [k for k, x in enumerate(cotangents) if not internals.is_zero_tangent(x)]
    if not places:
        return [None] * len(arrays)
    pulled = _ADJOINT.bind(
        *arrays[:count],
        *(cotangents[k] for k in places),
        settings=settings,
        moving=moving,
        wanted=tuple(wanted[k] for k in places),
        shapes=tuple(shapes[k] for k in places),
    )
    return [None] * count + list(pulled)


def _evaluate_adjoint(*arrays, settings, moving, wanted, shapes, axes=None):
    """Return the cotangents of the arguments `moving`; the last arrays are those of results."""
    return _evaluate(adjoint_of_solution, arrays, len(wanted), settings, moving, wanted, axes)


def _shapes_of_adjoint(*arrays, moving, **__):
    """Return shapes and dtypes of the cotangents."""
    return [internals.abstract_array(arrays[k]) for k in moving]


def _adjoint_jvp(primals, tangents, **given):
    """Forward derivative of `_ADJOINT`: linear in its cotangents, traced in the other arguments."""
    return _linear_jvp(_ADJOINT, _evaluate_adjoint, primals, tangents, len(given["wanted"]), given)


def _adjoint_transpose(cotangents, *arrays, settings, moving, wanted, shapes):
    """Transpose `_ADJOINT` in its cotangents: a change of the solution."""
    count = len(arrays) - len(wanted)
    if all(map(internals.is_zero_tangent, cotangents)):
        return [None] * len(arrays)
    changes = map(internals.instantiate_tangent, cotangents)
    given = {"settings": settings, "moving": moving, "wanted": wanted, "shapes": shapes}
    return [None] * count + list(_CHANGE.bind(*arrays[:count], *changes, **given))


def _linear_jvp(primitive, evaluate, primals, tangents, n_linear, given):
    """Forward derivative of a primitive that is linear in its last `n_linear` arguments."""
    count = len(primals) - n_linear
    if all(internals.is_zero_tangent(t) for t in tangents[:count]):
        further = [internals.instantiate_tangent(t) for t in tangents[count:]]
        out = primitive.bind(*primals, **given)
        return out, primitive.bind(*primals[:count], *further, **given)
    return _differentiate(evaluate, primals, tangents, **given)


def _differentiate(function, primals, tangents, **given):
    """Return ``function(*primals, **given)`` and its change, by tracing it; for rules."""
    places = [k for k, t in enumerate(tangents) if not internals.is_zero_tangent(t)]

    def some(*values):
        at = list(primals)
        for k, x in zip(places, values, strict=True):
            at[k] = x
        return function(*at, **given)

    return jax.jvp(some, [primals[k] for k in places], [tangents[k] for k in places])


def _batch_solution(arrays, axes, *, settings):
    """Map `_SOLUTION` over a batch: the same values."""
    return _return_values(*arrays, settings=settings), list(axes[: settings.n_value])


def _batch_change(arrays, axes, **given):
    """Map `_CHANGE` over a batch, such as one of directions."""
    found = _evaluate_change(*arrays, axes=axes, **given)
    return found, [0] * len(found)


def _batch_adjoint(arrays, axes, **given):
    """Map `_ADJOINT` over a batch of cotangents."""
    found = _evaluate_adjoint(*arrays, axes=axes, **given)
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
# cotangents of the arguments of an analysis, linear in those of its results
_ADJOINT = internals.define_primitive(
    "adjoint_of_solution",
    _evaluate_adjoint,
    _shapes_of_adjoint,
    _adjoint_jvp,
    _batch_adjoint,
    _adjoint_transpose,
    multiple_results=True,
)
