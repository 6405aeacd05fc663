"""Whole-program fusion: a function compiled to a single kernel, and batches mapped case by case.

XLA's backend for CPUs compiles a loop to one kernel where it is asked to (`common.fusion`). The
operations before and after the loop remain many small kernels, and a chain of more than eight is
handed over to another thread, which takes longer than they do. `as_single_kernel` puts a whole
function into a loop with one iteration.

Under `jax.vmap` it becomes a loop over the cases. `jax.vmap` would compute both branches of every
`lax.cond` for all cases, and as many iterations as the slowest of them needs; a loop computes what
each case needs, by the same path as the case alone.

To this end the function is a primitive of jax, `_KERNEL`, whose parameter is the function's
program. Its derivative is linear in the changes of the arguments: a second primitive,
`_LINEAR_KERNEL`, which takes intermediate results from the first one.
"""

from __future__ import annotations

import itertools
from collections.abc import Callable
from typing import TypeVar

import jax
import jax.numpy as jnp
from jax import lax

from ..common import jax_internals as internals
from ..common.compilation import without_garbage_collection
from ..common.jax_internals import function_of_jaxpr

Tree = TypeVar("Tree")


def as_single_kernel(function: Callable[..., Tree]) -> Callable[..., Tree]:
    """Return a function that computes `function` as a single XLA kernel, and batches case by case.

    All transformations of jax work on it.

    Args:
        function: function of pytrees of arrays; it must not close over traced values, nor call the
            host.
    """

    def run(*arguments):
        leaves, tree = jax.tree.flatten(arguments)
        trees = []

        def flat(*leaves):
            values, found = jax.tree.flatten(function(*tree.unflatten(leaves)))
            trees.append(found)
            return [lax.convert_element_type(x, jnp.result_type(x)) for x in values]

        program = jax.make_jaxpr(flat)(*leaves)
        return trees[0].unflatten(_KERNEL.bind(*leaves, program=program))

    return run


def _run_in_loop(*leaves, program, **_):
    """Return the results of a program (a jaxpr), computed in a loop with one iteration.

    XLA compiles a loop to one kernel. `leaves` are the arguments, here and below.
    """
    compute = function_of_jaxpr(program)
    floats = [x for x in leaves if jnp.issubdtype(x.dtype, jnp.floating) and x.size]
    if not floats:
        return compute(*leaves)
    # XLA would remove a loop that it knows to have one iteration: the count depends on a value
    begun = -1 - jnp.isnan(floats[0].ravel()[0]).astype(jnp.int32)
    blank = [jnp.zeros(x.shape, x.dtype) for x in program.out_avals]

    def once(_):
        return jnp.ones((), jnp.int32), compute(*leaves)

    return lax.while_loop(lambda state: state[0] < 0, once, (begun, blank))[1]


def _result_shapes(*_, program, **__):
    """Return shapes and dtypes of the results of `program`, a jaxpr: the primitives' shape rule."""
    return program.out_avals


def _pack_by_dtype(arrays):
    """Concatenate arrays to one vector for each dtype, in the order in which dtypes first appear.

    A loop first fills every result with zeros, by a kernel each: few results are faster.
    """
    kinds = {}
    for x in arrays:
        kinds.setdefault(jnp.result_type(x), []).append(jnp.ravel(x))
    return [jnp.concatenate(parts) for parts in kinds.values()]


def _unpack_by_dtype(vectors, like):
    """Split vectors, one for each dtype, into arrays with the shapes and dtypes of `like`."""
    kinds = dict.fromkeys(x.dtype for x in like)
    left, found = dict(zip(kinds, vectors, strict=True)), []
    for x in like:
        found.append(left[x.dtype][: x.size].reshape(x.shape))
        left[x.dtype] = left[x.dtype][x.size :]
    return found


def _kernel_jvp(primals, tangents, *, program, **_):
    """Forward derivative of `_KERNEL`: return values and tangents of the results.

    One kernel computes the values and what the linearization needs, another the tangents.
    """
    moving = internals.differentiated_arguments(primals, tangents)
    compute, traced = function_of_jaxpr(program), {}

    def forward(*leaves):
        values, *traced["linear"], kept = internals.linearize_entries(compute, leaves, moving)
        return [*values, *_pack_by_dtype(kept)]

    found = _KERNEL.bind(*primals, program=jax.make_jaxpr(forward)(*primals))
    moved, part, place = traced["linear"]
    values, packed = found[: len(moved)], found[len(moved) :]
    given = [primals[k] for k in place if k is not None]  # arguments need not be stored twice

    def linear(*arguments):
        kept, known, changes = _split_by_counts(arguments, len(packed), len(given))
        pairs = list(zip(part.constvars, place, strict=True))
        kept = iter(_unpack_by_dtype(kept, [x.aval for x, k in pairs if k is None]))
        known = iter(known)
        needed = [next(kept if k is None else known) for k in place]
        return internals.bind_constants(part, needed)(*changes)

    arguments = *packed, *given, *(tangents[k] for k in moving)
    known = len(packed) + len(given)
    changes = _LINEAR_KERNEL.bind(
        *arguments, program=jax.make_jaxpr(linear)(*arguments), known=known
    )
    changes = iter(changes)
    return values, [
        next(changes) if own else internals.zero_tangent(x)
        for x, own in zip(values, moved, strict=True)
    ]


def _split_by_counts(values, *counts):
    """Split a list into parts of the lengths `counts`, and a last part with the rest."""
    ends = list(itertools.accumulate(counts, initial=0))
    return [values[i:k] for i, k in itertools.pairwise([*ends, len(values)])]


def _linear_kernel_jvp(primals, tangents, *, program, known):
    """JVP rule of `_LINEAR_KERNEL`, which is linear in all but the first `known` arguments.

    Return its values and their tangents. If those first arguments have tangents, too, the rule of
    `_KERNEL` is applied.
    """
    if any(not internals.is_zero_tangent(t) for t in tangents[:known]):
        return _kernel_jvp(primals, tangents, program=program)
    further = *primals[:known], *map(internals.instantiate_tangent, tangents[known:])
    return [_LINEAR_KERNEL.bind(*each, program=program, known=known) for each in (primals, further)]


@without_garbage_collection()
def _linear_kernel_transpose(back, *arguments, program, **_):
    """Transpose rule of `_LINEAR_KERNEL`: return the cotangents of its linear arguments.

    `back` has the cotangents of the results. The list has None for arguments that are known.
    """
    sought = [k for k, x in enumerate(arguments) if internals.is_undefined_primal(x)]
    asked = [k for k, x in enumerate(back) if not internals.is_zero_tangent(x)]
    if not asked:
        return [None] * len(arguments)
    given = [k for k in range(len(arguments)) if k not in set(sought)]
    like = [arguments[k].aval for k in sought]
    compute = function_of_jaxpr(program)

    def pulled(*values):
        known, back = _split_by_counts(values, len(given))
        at = internals.replace_entries(arguments, given, known)

        def asked_for(*some):
            results = compute(*internals.replace_entries(at, sought, some))
            return [results[k] for k in asked]

        return jax.linear_transpose(asked_for, *like)(list(back))

    values = *(arguments[k] for k in given), *(back[k] for k in asked)
    program = jax.make_jaxpr(pulled)(*values)
    found = _LINEAR_KERNEL.bind(*values, program=program, known=len(given))
    return internals.replace_entries([None] * len(arguments), sought, found)


def _kernel_batch_rule(primitive, arguments, axes, *, program, **given):
    """Rule for `jax.vmap` of both primitives: a loop over the cases inside one kernel."""
    compute = function_of_jaxpr(program)
    of_case = [k for k, axis in enumerate(axes) if axis is not None]
    moved = [jnp.moveaxis(arguments[k], axes[k], 0) for k in of_case]

    def all_cases(*leaves):
        def one(own):
            return compute(*internals.replace_entries(leaves, of_case, own))

        return lax.map(one, [leaves[k] for k in of_case])

    leaves = internals.replace_entries(arguments, of_case, moved)
    found = primitive.bind(*leaves, program=jax.make_jaxpr(all_cases)(*leaves), **given)
    return found, [0] * len(found)


def _run_program(*leaves, program, **_):
    """Return the results of `program` at `leaves` without the loop, for calls outside `jax.jit`."""
    return function_of_jaxpr(program)(*leaves)


def _make_kernel_primitive(name, derivative, transposed=None):
    """Return a new primitive of jax that runs a program, its parameter, in one kernel.

    `derivative` is its JVP rule, `transposed` its transpose rule if it is linear.
    """

    def mapped(*given, **options):
        return _kernel_batch_rule(made, *given, **options)

    rules = derivative, mapped, transposed, _run_in_loop
    made = internals.define_primitive(
        name, _run_program, _result_shapes, *rules, multiple_results=True
    )
    return made


_KERNEL = _make_kernel_primitive("whole", _kernel_jvp)
# linear in all arguments but the first `known`
_LINEAR_KERNEL = _make_kernel_primitive(
    "whole_linear", _linear_kernel_jvp, _linear_kernel_transpose
)
