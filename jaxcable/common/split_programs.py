"""Functions run from Python as several programs: large ones that are kept by themselves stay apart.

A user's loss has an analysis in it, whose program is known or on disk if the analysis has been
called before, as has the program of its derivative. `jax.jit` would compile both once more, as
parts of a larger program. `SplitProgram` traces the function, such as that of a loss and its
gradient, and compiles what is before, between and after calls of such programs (`call_apart`).

Calls in functions that the user's function transforms or compiles itself (`jax.vmap`, `jax.jit`,
`lax.scan`) are not split: they are parts of the program that contains them.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Callable, Hashable, Iterator, Sequence
from contextlib import contextmanager
from contextvars import ContextVar
from typing import Any, NamedTuple

import jax
import numpy as np
from jax import lax

from . import jax_internals as internals
from .compilation import (
    argument_signature,
    is_debugging,
    program_settings,
    without_garbage_collection,
)
from .types import Array, PyTree


class _Splitting:
    """What is known of a function while it is traced to be split.

    Attributes:
        own_trace: the trace of jax in which the operations of the function itself are recorded.
        calls: number of calls that stay apart, so far.
    """

    own_trace: Hashable = None
    calls: int = 0


_SPLITTING: ContextVar[_Splitting | None] = ContextVar("_SPLITTING", default=None)


def is_splitting() -> bool:
    """Tell whether a function is traced now to be split."""
    return _SPLITTING.get() is not None


def is_split_here() -> bool:
    """Tell whether a call at this place of a function that is traced now can stay apart.

    It can where the function itself calls, not another one that it transforms or compiles.
    """
    splitting, trace = _SPLITTING.get(), internals.current_trace()
    return splitting is not None and trace is not None and trace is splitting.own_trace


def splittable(function: Callable[..., Any]) -> Callable[..., Any]:
    """Return a function, whose calls of `call_apart` may stay apart from its own operations.

    It may be called within `jax.vmap`, `jax.jvp` and the like of the function that is split.
    """

    def run(*arguments):
        splitting = _SPLITTING.get()
        if splitting is None:
            return function(*arguments)
        before, splitting.own_trace = splitting.own_trace, internals.current_trace()
        try:
            return function(*arguments)
        finally:
            splitting.own_trace = before

    return run


@contextmanager
def _tracing_to_split() -> Iterator[_Splitting]:
    """Record calls that stay apart, of what a ``with`` block traces."""
    splitting = _Splitting()
    token = _SPLITTING.set(splitting)
    try:
        with without_garbage_collection():
            yield splitting
    finally:
        _SPLITTING.reset(token)


# --- calls


class ProgramCall(NamedTuple):
    """A call of a program that stays apart.

    Attributes:
        run: function of the arguments, and of `axes` of a batch by keyword (as `jit_program` has
            it), to a pytree of arrays.
        result_shapes: function of the arguments to the shapes of these results, without a batch;
            arrays that are not known yet are `jax.ShapeDtypeStruct`.
        narrow: function of the positions of results (in the list of all) to the call that returns
            these only, as a list; None if there is none.
    """

    run: Callable[..., PyTree[Array]]
    result_shapes: Callable[..., PyTree[jax.ShapeDtypeStruct]]
    narrow: Callable[[tuple[int, ...]], ProgramCall] | None = None


@dataclasses.dataclass(frozen=True, eq=False)
class _BoundCall:
    """A `ProgramCall` with its arguments: the parameter of the primitive `_CALL`.

    Attributes:
        call: `ProgramCall`.
        leaves: leaves of the arguments, with None in place of those that are traced.
        tree: their pytree.
        axes: of every leaf, the axis of the batch or None; None for no batch.
    """

    call: ProgramCall
    leaves: list[Any]
    tree: Hashable
    axes: tuple[int | None, ...] | None = None

    def arguments(self, traced):
        """Return the arguments with the arrays `traced` in their places."""
        tree: Any = self.tree
        return tree.unflatten(_fill(self.leaves, traced))

    def run(self, traced):
        """Run the program; return the leaves of its results."""
        return jax.tree.leaves(self.call.run(*self.arguments(traced), axes=self.axes))

    def result_shapes(self, traced):
        """Return the pytree of shapes of the results."""
        axes = [None] * len(self.leaves) if self.axes is None else self.axes
        own = [axis for axis, x in zip(axes, self.leaves, strict=True) if x is None]
        sizes = [x.shape[axis] for axis, x in zip(own, traced, strict=True) if axis is not None]
        cases = [
            jax.ShapeDtypeStruct(x.shape if axis is None else np.delete(x.shape, axis), x.dtype)
            for axis, x in zip(own, traced, strict=True)
        ]
        token = _SPLITTING.set(None)
        try:
            with jax.ensure_compile_time_eval():  # the program may have to be compiled
                found = self.call.result_shapes(*self.arguments(cases))
        finally:
            _SPLITTING.reset(token)
        return jax.tree.map(lambda x: jax.ShapeDtypeStruct((*sizes[:1], *x.shape), x.dtype), found)

    def on_batch(self, axes):
        """Return the call for a batch along `axes` of the traced arrays, None for no batch."""
        if self.axes is not None:
            raise NotImplementedError("a batch of batches of calls that stay apart")
        axes = iter(axes)
        return dataclasses.replace(
            self, axes=tuple(next(axes) if x is None else None for x in self.leaves)
        )


def _fill(leaves, values):
    """Return a list in which the `values` take the places of None."""
    values = iter(values)
    return [next(values) if x is None else x for x in leaves]


def call_apart(call: ProgramCall, *arguments: PyTree[Any]) -> PyTree[Array]:
    """Call a program within a function that is traced to be split (`is_splitting`).

    Args:
        call: `ProgramCall`; derivatives of its results are none of its own.
        arguments: pytrees of arrays, some of them traced.
    """
    leaves, tree = jax.tree.flatten(arguments)
    traced: list[Any] = [x for x in leaves if isinstance(x, jax.core.Tracer)]
    known = [None if isinstance(x, jax.core.Tracer) else x for x in leaves]
    # a weak type would be another program
    traced = [lax.convert_element_type(x, x.dtype) for x in traced]
    bound, splitting = _BoundCall(call, known, tree), _SPLITTING.get()
    if splitting is not None:
        splitting.calls += 1
    shape: Any = jax.tree.structure(bound.result_shapes(traced))
    return shape.unflatten(_CALL.bind(*traced, call=bound))


def _shapes_of_call(*traced, call):
    """Return shapes and dtypes of the results of a call."""
    return [internals.abstract_array(x) for x in jax.tree.leaves(call.result_shapes(traced))]


def _refuse_derivative(primals, tangents, **_):
    """Raise NotImplementedError: what is differentiated has its own rule, and no call apart."""
    raise NotImplementedError("a call that stays apart has no derivative")


def _batch_call(traced, axes, *, call):
    """Map a call over a batch: the program for this batch."""
    found = _CALL.bind(*traced, call=call.on_batch(axes))
    return found, [0] * len(found)


_CALL = internals.define_primitive(
    "call_apart",
    lambda *traced, call: call.run(traced),
    _shapes_of_call,
    _refuse_derivative,
    _batch_call,
    multiple_results=True,
)


# --- programs


class SplitProgram:
    """A function that runs as several programs: between calls that stay apart, and these calls.

    As with `jax.jit`, arguments of other shapes compile again, and variables that the function
    captures become constants.

    Args:
        function: function of pytrees of arrays to a pytree of arrays, such as a loss and its
            gradient; what contains the calls is `splittable`.
        calling: function of the same arguments which contains the calls, such as the loss alone.
    """

    def __init__(self, function: Callable[..., PyTree[Any]], calling: Callable[..., Any]):
        self.function, self.calling, self.whole = function, calling, jax.jit(function)
        self.runs: dict[Any, Callable[..., Any]] = {}
        self.with_calls: dict[Any, bool] = {}

    def has_calls(self, *arguments: PyTree[Any]) -> bool:
        """Tell whether the function, with arguments like these, has calls that can stay apart."""
        key = _signature(arguments)
        if key not in self.with_calls:
            with _tracing_to_split() as splitting:
                jax.eval_shape(self.calling, *arguments)
            self.with_calls[key] = splitting.calls > 0
        return self.with_calls[key]

    def __call__(self, *arguments: PyTree[Any]) -> Any:
        """Run the function; trace and compile it at the first call with arguments like these.

        Where it cannot be split (`can_be_split`), it is one program.
        """
        if not can_be_split(arguments):
            return self.whole(*arguments)
        key = _signature(arguments)
        leaves, tree = jax.tree.flatten(arguments)
        if key not in self.runs:
            self.runs[key] = _trace_and_split(self.function, leaves, tree)
        return self.runs[key](leaves)


def can_be_split(arguments: PyTree[Any]) -> bool:
    """Tell whether a call with these arguments comes from Python, with known arrays only.

    Not while jax differentiates, batches or traces, nor with settings of jax that check operations.
    """
    leaves = jax.tree.leaves(arguments)
    known = not any(isinstance(x, jax.core.Tracer) for x in leaves)
    return _CALL is not None and known and internals.is_untransformed() and not is_debugging()


def _signature(arguments):
    """Return what a program depends on of its arguments and of the settings of jax."""
    leaves, tree = jax.tree.flatten(arguments)
    return tree, tuple(map(argument_signature, leaves)), program_settings()


def _trace_and_split(function, leaves, tree):
    """Return the function of a list of `leaves` that runs `function` in parts."""
    trees = []

    def flat(*leaves):
        values, found = jax.tree.flatten(function(*tree.unflatten(leaves)))
        trees.append(found)
        return values

    with _tracing_to_split():
        program = jax.make_jaxpr(flat)(*leaves)
    jaxpr, steps = program.jaxpr, _split_equations(program.jaxpr)
    constants = dict(zip(jaxpr.constvars, program.consts, strict=True))

    def run(leaves):
        values = constants | dict(zip(jaxpr.invars, leaves, strict=True))
        for step in steps:
            found = step.run([_read(values, x) for x in step.arguments])
            values.update(zip(step.results, found, strict=True))
        return trees[0].unflatten([_read(values, x) for x in jaxpr.outvars])

    return run


class _Step(NamedTuple):
    """A program of a function that has been split, as a step of its computation.

    Attributes:
        run: function of a list of arrays to a list of arrays.
        arguments, results: variables of the jaxpr.
    """

    run: Callable[[Sequence[Array]], Sequence[Array]]
    arguments: list[Any]
    results: list[Any]


def _split_equations(jaxpr):
    """Return the computation of a jaxpr as a list of `_Step`, without what no result needs."""
    needed, steps, later = set(_variables(jaxpr.outvars)), [], []
    after = set(needed)  # variables that are needed after the equations in `later`
    for equation in reversed(jaxpr.eqns):
        if not (needed.intersection(equation.outvars) or equation.effects):
            continue
        needed.update(_variables(equation.invars))
        if equation.primitive is not _CALL:
            later.append(equation)
            continue
        if later:
            steps.append(_step_of_equations(jaxpr, later[::-1], after))
        steps.append(_step_of_call(equation, needed))
        later, after = [], set(needed)
    if later:
        steps.append(_step_of_equations(jaxpr, later[::-1], after))
    return steps[::-1]


def _step_of_call(equation, needed):
    """Return the `_Step` of a call, of those of its results that are `needed` if it can do so."""
    bound, results = equation.params["call"], equation.outvars
    places = tuple(k for k, x in enumerate(results) if x in needed)
    if bound.call.narrow is not None and len(places) < len(results):
        bound = dataclasses.replace(bound, call=bound.call.narrow(places))
        results = [results[k] for k in places]
    return _Step(bound.run, equation.invars, results)


def _step_of_equations(jaxpr, equations, after):
    """Return the `_Step` of some equations of a jaxpr, whose variables `after` are needed later."""
    made = dict.fromkeys(x for equation in equations for x in equation.outvars)
    used = dict.fromkeys(x for equation in equations for x in _variables(equation.invars))
    arguments, results = [x for x in used if x not in made], [x for x in made if x in after]

    compute = jax.jit(internals.function_of_equations(jaxpr, equations, arguments, results))
    return _Step(lambda arrays: compute(*arrays), arguments, results)


def _variables(operands):
    """Return the operands of an equation of a jaxpr that are variables, not literal numbers."""
    return [x for x in operands if not internals.is_jaxpr_literal(x)]


def _read(values, operand):
    """Return the value of an operand of a jaxpr: a literal number, or a variable's value."""
    return operand.val if internals.is_jaxpr_literal(operand) else values[operand]
