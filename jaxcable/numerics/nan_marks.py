"""Arrays that become NaN where they are not valid, with NaN derivatives, as a primitive of jax.

The map from arrays and a *probe*, a zero that depends on all parameters, to these arrays is linear.
Its transpose gives NaN, to the arrays and through the probe to every parameter, only where a
cotangent is not zero. A product with NaN would give 0 NaN for cases of a batch whose cotangent is
zero, and pollute the parameters that the cases share. Tracing cannot yield such a pair of maps:
both are primitives, each with the other one as its transpose, for as many arrays as there are.
"""

from __future__ import annotations

import functools
import operator
from collections.abc import Sequence
from typing import Any

import jax
import jax.numpy as jnp
from jax import lax

from ..common import jax_internals as internals
from ..common.types import Array, ArrayLike, Bool, Float


def nan_unless_valid(
    ok: Bool[ArrayLike, ""], arrays: Sequence[Float[Array, " ..."]], probe: Float[Array, ""]
) -> list[Float[Array, " ..."]]:
    """Return arrays if `ok`, else NaN with NaN derivatives by them and by what a probe depends on.

    Args:
        ok: bool, a scalar or one for each entry of the arrays along their first axis.
        arrays: arrays of floats.
        probe: ``implicit.gradient_probe(parameters)``.
    """
    places = [k for k, x in enumerate(arrays) if x.size]
    some = [arrays[k] for k in places]
    marked = _MARKED.bind(jnp.asarray(ok), probe, *some) if some else []
    found = list(arrays)
    for k, x in zip(places, marked, strict=True):
        found[k] = x
    return found


def _along(ok, x):
    """Return conditions with the axes of `x`, of which they have the first ones."""
    ok = jnp.asarray(ok)  # a literal of a program is a number of Python
    return lax.broadcast_in_dim(ok, x.shape, range(ok.ndim))


def _mark(ok, probe, *arrays):
    """Return the arrays, NaN where they are not ok: the value of `_MARKED`."""
    return [lax.select(_along(ok, x), x, lax.full_like(x, jnp.nan)) for x in arrays]


def _unmark(ok, *cotangents, probe):
    """Return the cotangents of probe and arrays for those of the results: the value of `_UNMARKED`.

    `probe` has shape and dtype of the probe, whose axes are those of a batch.
    """
    n_batch, kept, found = len(probe.shape), [], []
    for x in cotangents:
        own = _along(ok, x) | (x == 0)
        kept.append(jnp.all(own, axis=tuple(range(n_batch, x.ndim))))
        found.append(lax.select(own, x, lax.full_like(x, jnp.nan)))
    every = functools.reduce(operator.and_, kept)
    return [jnp.where(every, 0.0, jnp.nan).astype(probe.dtype), *found]


def _shapes_of_unmarked(ok, *cotangents, probe):
    """Shape rule of `_UNMARKED`."""
    return [internals.abstract_array(probe), *cotangents]


def _linear_jvp(primitive, primals, tangents, **given):
    """Forward derivative of both: linear in all arguments but the first, which is bool."""
    changes = map(internals.instantiate_tangent, tangents[1:])
    found = primitive.bind(*primals, **given)
    return found, primitive.bind(primals[0], *changes, **given)


def _transpose_mark(cotangents, ok, probe, *arrays):
    """Transpose rule of `_MARKED`: `_UNMARKED`."""
    places = [k for k, x in enumerate(cotangents) if not internals.is_zero_tangent(x)]
    back: list[Any] = [None] * (2 + len(arrays))
    if places:
        like = jax.ShapeDtypeStruct(*_shape_and_dtype(probe))
        found = _UNMARKED.bind(ok, *(cotangents[k] for k in places), probe=like)
        for k, x in zip((1, *(2 + k for k in places)), found, strict=True):
            back[k] = x
    asked = map(internals.is_undefined_primal, (ok, probe, *arrays))
    return [x if own else None for x, own in zip(back, asked, strict=True)]


def _transpose_unmark(cotangents, ok, *_, probe):
    """Transpose rule of `_UNMARKED`: `_MARKED`."""
    if all(map(internals.is_zero_tangent, cotangents)):
        return [None] * len(cotangents)
    return [None, *_MARKED.bind(ok, *map(internals.instantiate_tangent, cotangents))]


def _shape_and_dtype(x):
    """Return shape and dtype of an argument of a transpose rule."""
    aval = x.aval if internals.is_undefined_primal(x) else x
    return aval.shape, aval.dtype


def _in_batch(arguments, axes):
    """Return arguments with the cases along their first axis, and the number of cases."""
    size = next(x.shape[a] for x, a in zip(arguments, axes, strict=True) if a is not None)
    return [
        jnp.broadcast_to(x, (size, *jnp.shape(x))) if a is None else jnp.moveaxis(x, a, 0)
        for x, a in zip(arguments, axes, strict=True)
    ], size


def _batch_mark(arguments, axes):
    """Rule for `jax.vmap` of `_MARKED`: the same with one more axis."""
    found = _MARKED.bind(*_in_batch(arguments, axes)[0])
    return found, [0] * len(found)


def _batch_unmark(arguments, axes, *, probe):
    """Rule for `jax.vmap` of `_UNMARKED`: the same with one more axis."""
    arguments, size = _in_batch(arguments, axes)
    probe = jax.ShapeDtypeStruct((size, *probe.shape), probe.dtype)
    found = _UNMARKED.bind(*arguments, probe=probe)
    return found, [0] * len(found)


_MARKED: Any = internals.define_primitive(
    "nan_unless",
    _mark,
    lambda ok, probe, *arrays: list(arrays),
    lambda *given, **options: _linear_jvp(_MARKED, *given, **options),
    _batch_mark,
    _transpose_mark,
    multiple_results=True,
    narrow=lambda used, count: (used, [True, True, *used], {}),
)
_UNMARKED: Any = internals.define_primitive(
    "nan_cotangents",
    _unmark,
    _shapes_of_unmarked,
    lambda *given, **options: _linear_jvp(_UNMARKED, *given, **options),
    _batch_unmark,
    _transpose_unmark,
    multiple_results=True,
)
