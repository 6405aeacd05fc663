"""`as_program`: a function that runs as a program of its own wherever numbers are known.

Where jax differentiates or maps a call outside of `jax.jit`, the derivative and the batch are
programs, too: the call is a primitive of jax, whose rules derive them from the program. They are
kept with it.
"""

from __future__ import annotations

import functools
from collections.abc import Callable
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np

from ..common import jax_internals as internals
from ..common.compilation import (
    is_debugging,
    program_settings,
    trace_cache_context,
    without_garbage_collection,
)
from ..common.fusion import are_loops_fused
from .known import KnownPrograms
from .own_code import user_code_digest
from .program import MappedProgram, Program


def as_program(function: Callable[..., Any], static: tuple[str, ...] = ()) -> Callable[..., Any]:
    """Return a function that runs as one program where it is called outside of `jax.jit`.

    Where it is called inside of another jax program, it becomes part of that program as with
    `jax.jit`.

    Args:
        function: its arguments are pytrees of arrays.
        static: names of static arguments, which are hashable and given by keyword. One with the
            name ``alone`` is set here: True if the function is a program of its own.

    Returns:
        Function of the same arguments. By keyword it also takes ``value``, its result if that is
        known, a pytree of floats: it is returned, and a program has its derivative only.
    """
    plain = jax.jit(function, static_argnames=static)
    known = KnownPrograms()

    @functools.wraps(function)
    def run(*arguments, value=None, **options):
        leaves, tree = jax.tree.flatten(arguments)
        alone = not internals.is_tracing() and not is_debugging()
        traced = any(isinstance(x, jax.core.Tracer) for x in leaves)
        if "alone" in static:  # a batch of a function with fused loops is mapped in its kernel
            options["alone"] = alone and not (traced and are_loops_fused())

        def own(*leaves):
            return function(*tree.unflatten(leaves), **options)

        code = user_code_digest(tree)
        with trace_cache_context(code):
            if not alone and value is None:
                with without_garbage_collection():
                    return plain(*arguments, **options)
            signature = tuple(map(_argument_signature, leaves))
            key = tree, signature, tuple(options.items()), program_settings(), code
            program = known.find(key, lambda: Program(own, leaves))
            operands = map(internals.as_operand, leaves)
            if value is not None:
                values, result = jax.tree.flatten(value)
                return result.unflatten(_KNOWN.bind(*operands, *values, program=program))
            found = _CALL.bind(*operands, program=program) if traced else program.run(leaves)
        return program.tree.unflatten(found)

    made: Any = run
    made.known = known.programs  # for tests
    return made


def _argument_signature(x):
    """Return shape, dtype and device of an argument, as far as a program depends on them; hashable.

    Arrays of NumPy, and those of jax that are bound to no device, are the same to a program. So are
    numbers of Python and what is traced in their place, whose dtype yields to that of others.
    """
    if isinstance(x, np.ndarray | np.generic):
        return x.shape, x.dtype
    if isinstance(x, jax.Array) and not isinstance(x, jax.core.Tracer):
        place = (x.sharding,) if getattr(x, "committed", True) else ()
        weak = getattr(x, "weak_type", False)  # keys of random numbers have none
        return (x.shape, x.dtype, weak, *place) if weak or place else (x.shape, x.dtype)
    aval = jax.typeof(x)
    return (aval.shape, aval.dtype, True) if aval.weak_type else (aval.shape, aval.dtype)


# --- the call as a primitive


class _Linearization:
    """The programs of the forward derivative of a program.

    The first computes the results, and residuals: intermediate values that the derivative needs.
    The second is linear: from residuals and tangents of arguments to tangents of results.

    Args:
        program: `Program`.
        moving: indices of its arguments by which it is differentiated.
    """

    def __init__(self, program, moving):
        self.program, self.moving = program, moving
        self.forward = Program(self._values_and_residuals, program.arguments)
        self.linear = None

    def _values_and_residuals(self, *leaves):
        """Return all results, then values that the linear part needs beside the arguments."""
        function = self.program.function
        found = internals.linearize_entries(function, leaves, self.moving)
        values, self.moved, self.part, self.places, further = found
        return [*values, *further]

    def tangents(self, primals, found, tangents):
        """Return the tangents of the results that depend on these arguments, a list.

        Args:
            primals: arguments of the program.
            found: results of the program `forward`.
            tangents: tangents of the arguments by which it is differentiated.
        """
        residuals = iter(found[len(self.moved) :])
        known = [next(residuals) if k is None else primals[k] for k in self.places]
        count = len(known)
        if self.linear is None:

            def linear(*arguments):
                return internals.bind_constants(self.part, arguments[:count])(*arguments[count:])

            self.linear = Program(linear, [*known, *tangents])
        return _LINEAR_CALL.bind(*known, *tangents, program=self.linear, count=count)


def _call_jvp(primals, tangents, *, program, **_):
    """JVP rule of a call of a program: results and their tangents, by a program each."""
    moving = internals.differentiated_arguments(primals, tangents)
    if not moving:
        found = _CALL.bind(*primals, program=program)
        return found, [internals.zero_tangent(x) for x in found]
    own = program.derived(("jvp", moving), lambda: _Linearization(program, moving))
    found = _CALL.bind(*primals, program=own.forward)
    changes = iter(own.tangents(primals, found, [tangents[k] for k in moving]))
    values = found[: len(own.moved)]
    return values, [
        next(changes) if moved else internals.zero_tangent(x)
        for x, moved in zip(values, own.moved, strict=True)
    ]


def _known_jvp(primals, tangents, *, program):
    """JVP rule of `_KNOWN`: known results, and their tangents by one program from all arguments.

    Their shapes are those of the values, so that it is not traced for them: reverse mode traces its
    transpose only.
    """
    found = _KNOWN.bind(*primals, program=program)
    count = len(program.arguments)
    return found, _tangents_by_one_program(program, found, primals[:count], tangents[:count])


def _known_batch_rule(arrays, axes, *, program):
    """Rule for `jax.vmap` of `_KNOWN`: the program, mapped, computes the results once more.

    The known ones have no derivative by the arguments.
    """
    count = len(program.arguments)
    return _batch_rule(_CALL, arrays[:count], axes[:count], program=program)


def _tangents_by_one_program(program, found, primals, tangents):
    """Return the tangents of the results `found` of a program, by a program that has no others."""
    count = len(primals)
    moving = internals.differentiated_arguments(primals, tangents)
    if not moving:
        return [internals.zero_tangent(x) for x in found]

    def changes(*values):
        def of_moving(*some):
            return program.function(*internals.replace_entries(values[:count], moving, some))

        return jax.jvp(of_moving, [values[k] for k in moving], list(values[count:]))[1]

    given = [*primals, *(tangents[k] for k in moving)]
    avals = list(map(internals.abstract_array, found))
    own = program.derived(("changes", moving), lambda: Program(changes, given, avals))
    return _LINEAR_CALL.bind(*given, program=own, count=count)


def _known_values(*arrays, program):
    """Return the known results of a program, which follow its arguments (value of `_KNOWN`)."""
    return list(arrays[len(program.arguments) :])


def _linear_call_jvp(primals, tangents, *, program, count):
    """JVP rule of a call that is linear in all but its first `count` arguments.

    Tangents of the linear arguments go through the same program.
    """
    if any(not internals.is_zero_tangent(t) for t in tangents[:count]):
        if not isinstance(program, _TransposedProgram):
            return _call_jvp(primals, tangents, program=program)
        # jax cannot linearize the transpose of a checkpointed loop
        found = _CALL.bind(*primals, program=program)
        return found, _tangents_by_one_program(program, found, primals, tangents)
    further = [*primals[:count], *map(internals.instantiate_tangent, tangents[count:])]
    given = {"program": program, "count": count}
    return _LINEAR_CALL.bind(*primals, **given), _LINEAR_CALL.bind(*further, **given)


class _TransposedProgram(Program):
    """The transpose of a linear program: from cotangents of its results to those of its arguments.

    It takes the arguments in which the program is not linear, then the cotangents. It differs from
    `Program` by its class only: its own transpose is taken by `jax.vjp`.
    """


def _linear_call_transpose(cotangents, *arguments, program, count):
    """Transpose rule of a call that is linear in all but its first `count` arguments.

    Returns the cotangents of the linear arguments, by a `_TransposedProgram`; None for the others.
    """
    asked = tuple(k for k, x in enumerate(cotangents) if not internals.is_zero_tangent(x))
    if not asked:
        return [None] * len(arguments)
    known, sought = arguments[:count], arguments[count:]
    like = [internals.abstract_argument(x.aval) for x in sought]

    def transposed(*values):
        def asked_for(*some):
            found = program.function(*values[:count], *some)
            return [found[k] for k in asked]

        back = list(values[count:])
        # these may have solved for roots, whose derivatives jax can transpose
        if isinstance(program, MappedProgram | _TransposedProgram):
            return jax.vjp(asked_for, *(jnp.zeros(x.shape, x.dtype) for x in like))[1](back)
        return jax.linear_transpose(asked_for, *like)(back)

    values = [*known, *(cotangents[k] for k in asked)]
    own = program.derived(("transpose", asked), lambda: _TransposedProgram(transposed, values))
    return [None] * count + list(_LINEAR_CALL.bind(*values, program=own, count=count))


def _batch_rule(primitive, arguments, axes, *, program, **given):
    """Rule for `jax.vmap` of a call: bind `primitive` to the program mapped over the batch.

    Returns its results and their batch axes, 0, or None of those that do not depend on the batch.
    `axes` are those of the arguments, None where one is not mapped.
    """
    sizes = {x.shape[axis] for x, axis in zip(arguments, axes, strict=True) if axis is not None}
    key = "vmap", tuple(axes), *sizes
    own = program.derived(key, lambda: MappedProgram(program, axes, arguments))
    found = primitive.bind(*arguments, program=own, **given)
    return found, [0 if mapped else None for mapped in own.is_mapped]


def _define_call_primitive(name, jvp, transpose=None):
    """Return a new primitive of jax that calls a program, with its rules.

    `jvp` and `transpose` are functions as of `define_primitive`; without a transpose it is not
    linear.
    """

    def batch(arguments, axes, **given):
        return _batch_rule(made, arguments, axes, **given)

    def run(*leaves, program, **_):
        return program.run(leaves)

    def avals(*_, program, **__):
        return program.avals

    def function(*leaves, program, **_):
        return program.function(*leaves)

    made = internals.define_primitive(
        name, run, avals, jvp, batch, transpose, function, multiple_results=True
    )
    return made


_CALL = _define_call_primitive("program", _call_jvp)
_LINEAR_CALL = _define_call_primitive("linear_program", _linear_call_jvp, _linear_call_transpose)
_KNOWN = internals.define_primitive(
    "known_value",
    _known_values,
    _known_values,
    _known_jvp,
    _known_batch_rule,
    multiple_results=True,
)
