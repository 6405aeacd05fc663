"""A search in Python as one operation of jax, so that other programs can contain it.

A search is a loop of Python over programs (`as_program`) of known numbers. Where its arguments are
traced it becomes a call of the host. XLA waits for its end and may not be able to run another
program meanwhile: there NumPy evaluates the programs, and no array of jax is made.
"""

from __future__ import annotations

import uuid
from collections.abc import Callable, Sequence
from typing import Any, TypeVar

import jax
import numpy as np

from ..common import jax_internals as internals
from ..common.host_calls import call_on_host, register_host_function_family
from ..common.types import PyTree
from . import decision
from .control_flow import write_host_call
from .rules import rule

_T = TypeVar("_T")


def run_search(
    search: Callable[[Any], _T], problem: PyTree[Any], like: _T, *, reports: bool = False
) -> _T:
    """Return ``search(problem)``, also where numbers of the problem are traced.

    Under `jax.vmap` the cases are searched one after the other. A derivative raises ValueError.

    Args:
        search: function of a pytree of known arrays to a pytree of arrays. It must not call jax but
            by functions of `as_program`.
        problem: pytree of arrays. Random keys in it become their data where numbers are traced.
        like: pytree of arrays or of `jax.ShapeDtypeStruct` in the shapes and dtypes of the result.
        reports: whether the search reports progress.
    """
    tree: Any
    result_tree: Any
    leaves, tree = jax.tree.flatten(problem)
    shapes, result_tree = jax.tree.flatten(like)
    is_known = not any(isinstance(x, jax.core.Tracer) for x in leaves)
    if is_known and internals.is_untransformed():
        return search(problem)

    def flat(*leaves):
        return jax.tree.leaves(search(tree.unflatten(leaves)))

    own = _SearchCall(flat, list(map(internals.abstract_argument, shapes)), reports)
    operands = map(internals.as_operand, leaves)
    found = _SEARCH.bind(*map(_random_key_data, operands), call=own)
    return result_tree.unflatten(found)


def _random_key_data(x):
    """Return the data of random keys, which NumPy does not know; other arrays unchanged."""
    is_key = jax.dtypes.issubdtype(x.dtype, jax.dtypes.prng_key)
    return jax.random.key_data(x) if is_key else x


@internals.held_weakly
class _SearchCall:
    """A search as a function of arrays: the parameter of the primitive ``search``.

    Args:
        search: function of arrays to a list of arrays.
        shapes: `jax.ShapeDtypeStruct` of the results.
        reports: whether it reports progress, a side effect.
    """

    def __init__(
        self,
        search: Callable[..., Sequence[Any]],
        shapes: Sequence[jax.ShapeDtypeStruct],
        reports: bool,
    ):
        self.search, self.shapes, self.reports = search, shapes, reports

    def on_host(self, *leaves: np.ndarray) -> list[np.ndarray]:
        """Run the search with NumPy alone; return its results as arrays of NumPy."""
        with decision.within_host_call():
            found = self.search(*leaves)
        return [
            np.asarray(x, shape.dtype).reshape(shape.shape)
            for x, shape in zip(found, self.shapes, strict=True)
        ]

    def mapped(self, axes: Sequence[int | None], count: int) -> _SearchCall:
        """Return the `_SearchCall` that searches `count` cases one after the other.

        `axes` are the axes of the arguments along which the cases are, None for what they share.
        """

        def search(*leaves):
            rows = [
                [x] * count if axis is None else np.moveaxis(np.asarray(x), axis, 0)
                for x, axis in zip(leaves, axes, strict=True)
            ]
            cases = [self.search(*case) for case in zip(*rows, strict=True)]
            parts = zip(*cases, strict=True) if cases else [()] * len(shapes)
            pairs = zip(parts, shapes, strict=True)
            return [np.array(x, own.dtype).reshape(own.shape) for x, own in pairs]

        shapes = [jax.ShapeDtypeStruct((count, *x.shape), x.dtype) for x in self.shapes]
        return _SearchCall(search, shapes, self.reports)


def _evaluate(*leaves, call):
    """Return the results of a search for known arrays, as jax arrays: value of the primitive."""
    pairs = zip(call.search(*leaves), call.shapes, strict=True)
    return internals.arrays_on_default_device([np.asarray(x, own.dtype) for x, own in pairs])


def _result_shapes(*_, call):
    """Return the abstract arrays of the results of a search."""
    return [internals.abstract_array(x) for x in call.shapes]


def _jvp(primals, tangents, *, call):
    """Return results of a search and zero tangents; ValueError for tangents that are not zero."""
    if not all(map(internals.is_zero_tangent, tangents)):
        raise ValueError(
            "a result of a search such as minimize or fit has no derivative; pass "
            "lax.stop_gradient of what it depends on, or differentiate its optimality conditions"
        )
    found = _SEARCH.bind(*primals, call=call)
    return found, [internals.zero_tangent(x) for x in found]


def _batch(arguments, axes, *, call):
    """Return the results of a search of all cases of `jax.vmap`, and their batch axes, all 0."""
    count = next(x.shape[a] for x, a in zip(arguments, axes, strict=True) if a is not None)
    found = _SEARCH.bind(*arguments, call=call.mapped(tuple(axes), count))
    return found, [0] * len(found)


# by names that no other process has, so that none is found in programs on disk; never removed,
# because XLA may call a search as long as the process lives
_CALLS: dict[str, _SearchCall] = {}


@register_host_function_family
def _host_search(name):
    """Return the NumPy function of the search with this name, which a compiled program calls."""
    return _CALLS[name].on_host


def _call_from_xla(*leaves, call):
    """Return the results of a search within a program that XLA compiles, by a call of the host."""
    name = uuid.uuid4().hex
    _CALLS[name] = call
    return list(call_on_host((_host_search, name), call.shapes, *leaves))


_SEARCH = internals.define_primitive(
    "search", _evaluate, _result_shapes, _jvp, _batch, lowered=_call_from_xla, multiple_results=True
)


@rule("search")
def _write_search_call(block, equation, inputs):
    """Write the call of a search into a program of NumPy; return the values of its results."""
    call, avals = equation.params["call"], [x.aval for x in equation.outvars]
    return write_host_call(block, call.on_host, inputs, avals, not call.reports)
