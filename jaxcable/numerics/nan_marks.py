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
    marked = _NAN_UNLESS.bind(jnp.asarray(ok), probe, *some) if some else []
    found = list(arrays)
    for k, x in zip(places, marked, strict=True):
        found[k] = x
    return found


def _broadcast_to(ok, x):
    """Repeat conditions, whose axes are the first ones of `x`, over its other axes; bool."""
    ok = jnp.asarray(ok)  # a literal of a program is a number of Python
    return lax.broadcast_in_dim(ok, x.shape, range(ok.ndim))


def _nan_unless(ok, probe, *arrays):
    """Return the arrays, NaN where `ok` is false: the value of `_NAN_UNLESS`.

    `probe` has no part in the value, only in derivatives.
    """
    return [lax.select(_broadcast_to(ok, x), x, lax.full_like(x, jnp.nan)) for x in arrays]


def _nan_cotangents(ok, *cotangents, probe):
    """Return cotangents of probe and arrays from those of the results of `_NAN_UNLESS`.

    Where `ok` is false and a cotangent is not zero, it becomes NaN, and that of the probe too; else
    that of the probe is zero. This is the value of `_NAN_COTANGENTS`. `probe` has shape (the axes
    of a batch) and dtype of the probe.
    """
    n_batch, kept, found = len(probe.shape), [], []
    for x in cotangents:
        own = _broadcast_to(ok, x) | (x == 0)
        kept.append(jnp.all(own, axis=tuple(range(n_batch, x.ndim))))
        found.append(lax.select(own, x, lax.full_like(x, jnp.nan)))
    every = functools.reduce(operator.and_, kept)
    return [jnp.where(every, 0.0, jnp.nan).astype(probe.dtype), *found]


def _shapes_of_nan_cotangents(ok, *cotangents, probe):
    """Return shapes and dtypes of the results of `_NAN_COTANGENTS`: its shape rule."""
    return [internals.abstract_array(probe), *cotangents]


def _jvp_linear_in_all_but_first(primitive, primals, tangents, **given):
    """JVP rule of `primitive`, linear in all arguments but the first: return values and tangents.

    The first argument is a bool without derivative.
    """
    changes = map(internals.instantiate_tangent, tangents[1:])
    found = primitive.bind(*primals, **given)
    return found, primitive.bind(primals[0], *changes, **given)


def _transpose_nan_unless(cotangents, ok, probe, *arrays):
    """Transpose rule of `_NAN_UNLESS`: return cotangents of its arguments by `_NAN_COTANGENTS`.

    An entry is None where no cotangent is asked for, or it is zero.
    """
    places = [k for k, x in enumerate(cotangents) if not internals.is_zero_tangent(x)]
    back: list[Any] = [None] * (2 + len(arrays))
    if places:
        like = jax.ShapeDtypeStruct(*_shape_and_dtype(probe))
        found = _NAN_COTANGENTS.bind(ok, *(cotangents[k] for k in places), probe=like)
        for k, x in zip((1, *(2 + k for k in places)), found, strict=True):
            back[k] = x
    asked = map(internals.is_undefined_primal, (ok, probe, *arrays))
    return [x if own else None for x, own in zip(back, asked, strict=True)]


def _transpose_nan_cotangents(cotangents, ok, *_, probe):
    """Transpose rule of `_NAN_COTANGENTS`: return cotangents of its arguments by `_NAN_UNLESS`."""
    if all(map(internals.is_zero_tangent, cotangents)):
        return [None] * len(cotangents)
    return [None, *_NAN_UNLESS.bind(ok, *map(internals.instantiate_tangent, cotangents))]


def _shape_and_dtype(x):
    """Return shape and dtype of an argument of a transpose rule, which may be undefined there."""
    aval = x.aval if internals.is_undefined_primal(x) else x
    return aval.shape, aval.dtype


def _batch_axis_first(arguments, axes):
    """Return arguments with the cases of a batch along the first axis, and the number of cases.

    `axes` has the axis of the cases in each argument; one with None is repeated for all cases.
    """
    size = next(x.shape[a] for x, a in zip(arguments, axes, strict=True) if a is not None)
    return [
        jnp.broadcast_to(x, (size, *jnp.shape(x))) if a is None else jnp.moveaxis(x, a, 0)
        for x, a in zip(arguments, axes, strict=True)
    ], size


def _batch_rule_of_nan_unless(arguments, axes):
    """Rule for `jax.vmap` of `_NAN_UNLESS`: the same with one more axis."""
    found = _NAN_UNLESS.bind(*_batch_axis_first(arguments, axes)[0])
    return found, [0] * len(found)


def _batch_rule_of_nan_cotangents(arguments, axes, *, probe):
    """Rule for `jax.vmap` of `_NAN_COTANGENTS`: the same with one more axis."""
    arguments, size = _batch_axis_first(arguments, axes)
    probe = jax.ShapeDtypeStruct((size, *probe.shape), probe.dtype)
    found = _NAN_COTANGENTS.bind(*arguments, probe=probe)
    return found, [0] * len(found)


_NAN_UNLESS: Any = internals.define_primitive(
    "nan_unless",
    _nan_unless,
    lambda ok, probe, *arrays: list(arrays),
    lambda *given, **options: _jvp_linear_in_all_but_first(_NAN_UNLESS, *given, **options),
    _batch_rule_of_nan_unless,
    _transpose_nan_unless,
    multiple_results=True,
    narrow=lambda used, count: (used, [True, True, *used], {}),
)
_NAN_COTANGENTS: Any = internals.define_primitive(
    "nan_cotangents",
    _nan_cotangents,
    _shapes_of_nan_cotangents,
    lambda *given, **options: _jvp_linear_in_all_but_first(_NAN_COTANGENTS, *given, **options),
    _batch_rule_of_nan_cotangents,
    _transpose_nan_cotangents,
    multiple_results=True,
)
