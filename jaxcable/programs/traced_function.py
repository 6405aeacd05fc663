"""A user's function as a pytree: traced in every call, and known by what it computes.

A function reads more than its arguments: globals, attributes, what it closes over. All of this may
have changed since the last call, although the function object is the same. So it is traced anew,
which takes milliseconds once jax has traced the analyses in it. The values that it captures are
leaves. Its equations are static: programs of another trace with equal equations are used again.
"""

from __future__ import annotations

import os
from collections.abc import Callable
from typing import Any

import jax
import numpy as np

from ..common import digest, jaxprs
from ..common import jax_internals as internals
from ..common.compilation import trace_cache_context, without_garbage_collection
from ..common.tree import pytree
from ..common.types import Array, PyTree
from .program_calls import as_program
from .writing import inner_jaxpr, inner_programs

_JAX = os.path.join(os.path.dirname(jax.__file__), "")
_PACKAGE = os.path.join(os.path.dirname(os.path.dirname(__file__)), "")


class Equations:
    """Equations of a traced function, static metadata of a `TracedFunction`.

    Two are equal if they compute the same: equations, literals, shapes and structures of arguments
    and result.

    Args:
        jaxpr: equations, without constants.
        arguments, result: pytrees of shapes of arguments and result.
    """

    def __init__(self, jaxpr: Any, arguments: PyTree[Any], result: PyTree[Any]):
        self.jaxpr, self.result = jaxpr, result
        self.arguments_tree: Any = jax.tree.structure(arguments)
        self.result_tree: Any = jax.tree.structure(result)
        # jaxprs are alive as long as these: so are the functions in them, and their addresses
        self._key = digest.equations_digest(jaxpr), self.arguments_tree, self.result_tree

    def __hash__(self) -> int:
        return hash(self._key)

    def __eq__(self, other: object) -> bool:
        return isinstance(other, Equations) and self._key == other._key


@pytree(static=("equations",))
class TracedFunction:
    """A function of pytrees of arrays that was traced by `trace_function`.

    Attributes:
        captured: values of the arrays that the function captures, leaves.
        equations: its `Equations`.
    """

    captured: list[Array]
    equations: Equations

    @property
    def result(self) -> PyTree[jax.ShapeDtypeStruct]:
        """Shapes and dtypes of the result."""
        return self.equations.result

    def __call__(self, *arguments: PyTree[Any]) -> PyTree[Array]:
        """Return the result for arguments in the shapes with which the function was traced."""
        leaves, tree = jax.tree.flatten(arguments)
        if tree != self.equations.arguments_tree:
            raise ValueError(f"arguments: expected {self.equations.arguments_tree}, got {tree}")
        jaxpr = self.equations.jaxpr
        captured = map(_as_key, self.captured, jaxpr.constvars)
        found = internals.bind_constants(jaxpr, list(captured))(*map(_as_key, leaves, jaxpr.invars))
        return self.equations.result_tree.unflatten(found)


def _as_key(x, variable):
    """Return `x` with the type of a variable of a jaxpr: raw data of a random key become a key."""
    dtype = variable.aval.dtype
    if not jax.dtypes.issubdtype(dtype, jax.dtypes.prng_key) or x.dtype == dtype:
        return x
    return jax.random.wrap_key_data(x, impl=internals.implementation_of_keys(dtype))


def trace_function(function: Callable[..., PyTree[Any]], *arguments: PyTree[Any]) -> TracedFunction:
    """Trace a function anew for arguments of these shapes, whatever jax has traced of it before.

    Args:
        function: of pytrees of arrays, to a pytree of arrays.
        arguments: pytrees of arrays, of numbers or of `jax.ShapeDtypeStruct`.
    """
    shapes = jax.tree.map(internals.abstract_argument, arguments)

    def own(*arguments):  # a new object: jax does not know it
        return function(*arguments)

    with without_garbage_collection(), internals.same_context_as_outside():
        traced, result = jax.make_jaxpr(own, return_shape=True)(*shapes)
        # what a user decorates with `jax.jit`, or gives to `jax.lax.scan`, jax traces once
        if not all(path.startswith(_JAX) for *_, path in _functions_within(traced.jaxpr)):
            with trace_cache_context(object()):
                traced, result = jax.make_jaxpr(own, return_shape=True)(*shapes)
    _copy_numpy_constants(traced)
    captured: Any = [x if isinstance(x, jax.Array) else np.asarray(x) for x in traced.consts]
    return TracedFunction(captured, Equations(traced.jaxpr, shapes, result))


def _functions_within(jaxpr):
    """Yield (jaxpr, constants, file) of each function in a jaxpr that is not of this package.

    These are functions of jax and of users, and those within them.
    """
    for program in (inner for equation in jaxpr.eqns for inner in inner_programs(equation)):
        own, constants = inner_jaxpr(program)
        path = (own.debug_info.func_src_info or "").partition(" at ")[2]
        if not path.startswith(_PACKAGE):
            yield own, constants, path
            yield from _functions_within(own)


def _copy_numpy_constants(program):
    """Replace NumPy arrays in a traced program by copies: a user may change his in place later."""
    for jaxpr, constants, _ in ((program.jaxpr, (), ""), *_functions_within(program.jaxpr)):
        for k, x in enumerate(constants):
            if isinstance(x, np.ndarray):
                constants[k] = x.copy()
        for x in (x for equation in jaxpr.eqns for x in equation.invars):
            if jaxprs.is_jaxpr_literal(x) and isinstance(x.val, np.ndarray):
                x.val = x.val.copy()


def evaluate_at_once(
    function: Callable[..., PyTree[Any]], *arguments: PyTree[Any]
) -> PyTree[Array]:
    """Return ``function(*arguments)`` by one program, not by one for each operation in it.

    The function is traced in every call.
    """
    return evaluate_traced(trace_function(function, *arguments), *arguments)


@as_program
def evaluate_traced(function: TracedFunction, *arguments: PyTree[Any]) -> PyTree[Array]:
    """Return ``function(*arguments)`` by one program, which equal equations share."""
    return function(*arguments)
