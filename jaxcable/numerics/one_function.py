"""A function computed as a whole: one function of the machine, and a batch case by case.

XLA's backend for CPUs compiles a loop to one function where it is asked to (`common.fusion`); what
stands before and after the loop remains a chain of small functions, and a chain of more than eight
is handed over to another thread, which takes longer than they do. `as_one` puts the whole of a
function into a loop with one iteration.

Under `jax.vmap` it becomes a loop over the cases. `jax.vmap` would compute both branches of every
`lax.cond` for all cases, and as many iterations as the slowest of them needs; a loop computes what
each case needs, by the same path as the case alone.

For this a function is a primitive of jax, with its program as parameter. The derivative is linear
in the changes of the arguments: a second primitive, which takes from the first what it needs.
"""

from __future__ import annotations

import itertools
from collections.abc import Callable
from typing import TypeVar

import jax
import jax.numpy as jnp
from jax import lax

from ..common import jax_internals as internals
from ..common.compilation import without_collection
from ..common.jax_internals import function_of

Tree = TypeVar("Tree")


def as_one(function: Callable[..., Tree]) -> Callable[..., Tree]:
    """The function of pytrees of arrays, compiled as a whole, and mapped case by case.

    All transformations work on it. It must not close over traced values, nor call the host. Where
    jax has no primitives to define, it is the function itself: slower, with the same results.
    """
    if _WHOLE is None or _LINEAR is None:
        return function

    def run(*arguments):
        leaves, tree = jax.tree.flatten(arguments)
        trees = []

        def flat(*leaves):
            values, found = jax.tree.flatten(function(*tree.unflatten(leaves)))
            trees.append(found)
            return [lax.convert_element_type(x, jnp.result_type(x)) for x in values]

        program = jax.make_jaxpr(flat)(*leaves)
        return trees[0].unflatten(_WHOLE.bind(*leaves, program=program))

    return run


def _in_a_loop(*leaves, program, **_):
    """The results of a program, computed in a loop of one iteration."""
    compute = function_of(program)
    floats = [x for x in leaves if jnp.issubdtype(x.dtype, jnp.floating) and x.size]
    if not floats:
        return compute(*leaves)
    # XLA must not see that there is one iteration: it would take the loop away
    begun = -1 - jnp.isnan(floats[0].ravel()[0]).astype(jnp.int32)
    blank = [jnp.zeros(x.shape, x.dtype) for x in program.out_avals]

    def once(_):
        return jnp.ones((), jnp.int32), compute(*leaves)

    return lax.while_loop(lambda state: state[0] < 0, once, (begun, blank))[1]


def _shapes(*_, program, **__):
    return program.out_avals


def _placed(values, places, some):
    """A list of `values` with `some` at their `places`."""
    values = list(values)
    for k, x in zip(places, some, strict=True):
        values[k] = x
    return values


def _packed(arrays):
    """Arrays as one vector for each dtype, in the order of its first array.

    Every result of a loop is an array to begin with, filled with zeros by a function of its own.
    """
    kinds = {}
    for x in arrays:
        kinds.setdefault(jnp.result_type(x), []).append(jnp.ravel(x))
    return [jnp.concatenate(parts) for parts in kinds.values()]


def _unpacked(vectors, like):
    """The arrays of `_packed`, from their shapes and dtypes."""
    kinds = dict.fromkeys(x.dtype for x in like)
    left, found = dict(zip(kinds, vectors, strict=True)), []
    for x in like:
        found.append(left[x.dtype][: x.size].reshape(x.shape))
        left[x.dtype] = left[x.dtype][x.size :]
    return found


def _derivative(primals, tangents, *, program, **_):
    """Forward derivative: the results with what the linear part needs, and the linear part."""
    moving = [k for k, t in enumerate(tangents) if not internals.is_zero(t)]
    floating = [jnp.issubdtype(x.dtype, jnp.inexact) for x in program.out_avals]
    compute, traced = function_of(program), {}

    def forward(*leaves):
        def of_moving(*some):
            values = compute(*_placed(leaves, moving, some))
            return [x for x, own in zip(values, floating, strict=True) if own], values

        at = [leaves[k] for k in moving]
        _, linear, values = jax.linearize(of_moving, *at, has_aux=True)
        part = jax.make_jaxpr(linear)(*at)
        places = {id(x): k for k, x in enumerate(leaves)}
        traced["part"], traced["place"] = part.jaxpr, [places.get(id(x)) for x in part.consts]
        pairs = zip(part.consts, traced["place"], strict=True)
        return [*values, *_packed([x for x, place in pairs if place is None])]

    found = _WHOLE.bind(*primals, program=jax.make_jaxpr(forward)(*primals))
    values, packed = found[: len(floating)], found[len(floating) :]
    part, place = traced["part"], traced["place"]
    given = [primals[k] for k in place if k is not None]  # arguments, which need not be stored

    def linear(*arguments):
        kept, known, changes = _split(arguments, len(packed), len(given))
        pairs = list(zip(part.constvars, place, strict=True))
        kept = iter(_unpacked(kept, [x.aval for x, k in pairs if k is None]))
        known = iter(known)
        needed = [next(kept if k is None else known) for k in place]
        return internals.closed(part, needed)(*changes)

    arguments = *packed, *given, *(tangents[k] for k in moving)
    known = len(packed) + len(given)
    changes = _LINEAR.bind(*arguments, program=jax.make_jaxpr(linear)(*arguments), known=known)
    changes = iter(changes)
    return values, [
        next(changes) if own else internals.zero_tangent(x)
        for x, own in zip(values, floating, strict=True)
    ]


def _split(values, *counts):
    """`values` in parts of these counts, and the rest."""
    ends = list(itertools.accumulate(counts, initial=0))
    return [values[i:k] for i, k in itertools.pairwise([*ends, len(values)])]


def _derivative_of_linear(primals, tangents, *, program, known):
    """Forward derivative of the linear part; linear again if what it needs does not change."""
    if any(not internals.is_zero(t) for t in tangents[:known]):
        return _derivative(primals, tangents, program=program)
    further = *primals[:known], *map(internals.as_array, tangents[known:])
    return [_LINEAR.bind(*each, program=program, known=known) for each in (primals, further)]


@without_collection()
def _transposed(back, *arguments, program, **_):
    """Transpose of the linear part in those of its arguments that are not known."""
    sought = [k for k, x in enumerate(arguments) if internals.is_sought(x)]
    asked = [k for k, x in enumerate(back) if not internals.is_zero(x)]
    if not asked:
        return [None] * len(arguments)
    given = [k for k in range(len(arguments)) if k not in set(sought)]
    like = [arguments[k].aval for k in sought]
    compute = function_of(program)

    def pulled(*values):
        known, back = _split(values, len(given))
        at = _placed(arguments, given, known)

        def asked_for(*some):
            results = compute(*_placed(at, sought, some))
            return [results[k] for k in asked]

        return jax.linear_transpose(asked_for, *like)(list(back))

    values = *(arguments[k] for k in given), *(back[k] for k in asked)
    program = jax.make_jaxpr(pulled)(*values)
    found = _LINEAR.bind(*values, program=program, known=len(given))
    return _placed([None] * len(arguments), sought, found)


def _mapped(primitive, arguments, axes, *, program, **given):
    """The rule of a primitive for `jax.vmap`: a loop over the cases."""
    compute = function_of(program)
    of_case = [k for k, axis in enumerate(axes) if axis is not None]
    moved = [jnp.moveaxis(arguments[k], axes[k], 0) for k in of_case]

    def all_cases(*leaves):
        def one(own):
            return compute(*_placed(leaves, of_case, own))

        return lax.map(one, [leaves[k] for k in of_case])

    leaves = _placed(arguments, of_case, moved)
    found = primitive.bind(*leaves, program=jax.make_jaxpr(all_cases)(*leaves), **given)
    return found, [0] * len(found)


def _computed(*leaves, program, **_):
    return function_of(program)(*leaves)


def _primitive(name, derivative, transposed=None):
    """A primitive whose parameter is a program."""

    def mapped(*given, **options):
        return _mapped(made, *given, **options)

    rules = derivative, mapped, transposed, _in_a_loop
    made = internals.primitive(name, _computed, _shapes, *rules, several=True)
    return made


_WHOLE = _primitive("whole", _derivative)
# linear in all arguments but the first `known`
_LINEAR = _primitive("whole_linear", _derivative_of_linear, _transposed)
