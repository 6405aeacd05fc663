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

from ..common import jax_internals as internals
from ..common.compilation import traces_known_by, without_garbage_collection
from ..common.tree import pytree
from ..common.types import Array, PyTree
from .program_calls import as_program
from .writing import inner_jaxpr, inner_programs

_JAX = os.path.join(os.path.dirname(jax.__file__), "")
_PACKAGE = os.path.join(os.path.dirname(os.path.dirname(__file__)), "")


class Equations:
    """Equations of a traced function, static metadata of a `TracedFunction`.

    Two are equal if they compute the same: equations, literals, shapes and structures of arguments
    and result. Names of the functions in them that jax calls later (rules of `jax.custom_jvp`) are
    not compared, but their identity.

    Args:
        jaxpr: equations, without constants.
        arguments, result: pytrees of shapes of arguments and result.
    """

    def __init__(self, jaxpr: Any, arguments: PyTree[Any], result: PyTree[Any]):
        self.jaxpr, self.result = jaxpr, result
        self.trees = jax.tree.structure(arguments), jax.tree.structure(result)
        self._hash = hash((self.trees, *map(_words, _visible_equations(jaxpr))))

    def __hash__(self) -> int:
        return self._hash

    def __eq__(self, other: object) -> bool:
        if self is other:
            return True
        if not isinstance(other, Equations) or hash(self) != hash(other):
            return False  # jax does not compare the hash
        return self.trees == other.trees and are_same_jaxprs(self.jaxpr, other.jaxpr)


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
        if tree != self.equations.trees[0]:
            raise ValueError(f"arguments: {tree}: traced with {self.equations.trees[0]}")
        found = internals.bind_constants(self.equations.jaxpr, self.captured)(*leaves)
        return self.equations.trees[1].unflatten(found)


def trace_function(function: Callable[..., PyTree[Any]], *arguments: PyTree[Any]) -> TracedFunction:
    """Trace a function for arguments of these shapes, whatever has been traced of it before.

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
            with traces_known_by(object()):
                traced, result = jax.make_jaxpr(own, return_shape=True)(*shapes)
    _own_constants(traced)
    captured = [x if isinstance(x, jax.Array) else np.asarray(x) for x in traced.consts]
    return TracedFunction(captured, Equations(traced.jaxpr, shapes, result))


def _functions_within(jaxpr):
    """Yield the functions in a jaxpr that are not of this package: jaxpr, constants and file.

    So do those in functions of jax and of users.
    """
    for program in (inner for equation in jaxpr.eqns for inner in inner_programs(equation)):
        own, constants = inner_jaxpr(program)
        path = (own.debug_info.func_src_info or "").partition(" at ")[2]
        if not path.startswith(_PACKAGE):
            yield own, constants, path
            yield from _functions_within(own)


def _visible_equations(jaxpr):
    """Yield the equations of a jaxpr and of `_functions_within` it."""
    yield from jaxpr.eqns
    for own, *_ in _functions_within(jaxpr):
        yield from own.eqns


def _literals(equation):
    """Return the literal operands of an equation."""
    return [x for x in equation.invars if internals.is_jaxpr_literal(x)]


def _words(equation):
    """Return the primitive of an equation and its literals, hashable."""
    return equation.primitive.name, *(np.asarray(x.val).tobytes() for x in _literals(equation))


def _own_constants(program):
    """Copy the arrays of NumPy in a traced program, which a user may change in place later."""
    for _, constants, _ in _functions_within(program.jaxpr):
        for k, x in enumerate(constants):
            if isinstance(x, np.ndarray):
                constants[k] = x.copy()
    for x in (x for equation in _visible_equations(program.jaxpr) for x in _literals(equation)):
        if isinstance(x.val, np.ndarray):
            x.val = x.val.copy()


@as_program
def evaluate_traced(function: TracedFunction, *arguments: PyTree[Any]) -> PyTree[Array]:
    """Return ``function(*arguments)``, by a program."""
    return function(*arguments)


# --- comparison


def are_same_jaxprs(a: Any, b: Any) -> bool:
    """Tell whether two jaxprs compute the same, equation by equation."""
    if a is b:
        return True
    pairs: dict[Any, Any] = {}

    def match(new, old):
        """Pair variables that are defined."""
        pairs.update(zip(new, old, strict=False))
        return len(new) == len(old) and all(x.aval == y.aval for x, y in zip(new, old, strict=True))

    def is_paired(x, y):
        if internals.is_jaxpr_literal(x):
            literal = internals.is_jaxpr_literal(y)
            return literal and x.aval == y.aval and _are_same(np.asarray(x.val), np.asarray(y.val))
        return pairs.get(x) is y

    def operands_agree(new, old):
        return len(new) == len(old) and all(map(is_paired, new, old))

    return (
        len(a.eqns) == len(b.eqns)
        and match(a.constvars, b.constvars)
        and match(a.invars, b.invars)
        and all(
            x.primitive is y.primitive
            and operands_agree(x.invars, y.invars)
            and _are_same(x.params, y.params)
            and match(x.outvars, y.outvars)
            for x, y in zip(a.eqns, b.eqns, strict=True)
        )
        and operands_agree(a.outvars, b.outvars)
    )


def _are_same(a, b):
    """Tell whether two parameters of equations are the same; False where that cannot be told."""
    if a is b:
        return True
    if internals.is_jaxpr(a) and internals.is_jaxpr(b):
        constants = (list(getattr(x, "consts", ())) for x in (a, b))
        return _are_same(*constants) and are_same_jaxprs(*(getattr(x, "jaxpr", x) for x in (a, b)))
    if type(a) is not type(b):
        return False
    if isinstance(a, tuple | list):
        return len(a) == len(b) and all(map(_are_same, a, b))
    if isinstance(a, dict):
        return a.keys() == b.keys() and all(_are_same(x, b[name]) for name, x in a.items())
    if isinstance(a, float):
        return repr(a) == repr(b)  # tells 0.0 and -0.0 apart
    if hasattr(a, "tobytes"):  # an array on the host
        return a.dtype == b.dtype and a.shape == b.shape and a.tobytes() == b.tobytes()
    try:
        return bool(a == b)
    except Exception:  # whatever the comparison of foreign objects raises
        return False
