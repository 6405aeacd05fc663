"""Values and status codes of what a loss or a function of residuals returns."""

from __future__ import annotations

from typing import Any

import jax
import jax.numpy as jnp

from ..common import status
from ..common.types import Array, ArrayLike, Float, Int, PyTree


def split_loss(result: Any) -> tuple[Float[Array, ""], Int[Array, ""]]:
    """Scalar and status from the result of a loss: a scalar, or (scalar, solutions or codes)."""
    value, outcomes = result if isinstance(result, tuple) and len(result) == 2 else (result, ())
    if value is None or hasattr(value, "status"):
        got = "None; it needs a return" if value is None else f"a {type(value).__name__} first"
        raise ValueError(f"loss: expected a scalar float, or (scalar, solution), got {got}")
    value = jnp.asarray(value)
    if value.shape != () or not jnp.issubdtype(value.dtype, jnp.floating):
        raise ValueError(
            f"loss: expected a scalar float, or (scalar, solution), got {value.dtype}"
            f"{list(value.shape)}"
        )
    return value, worst_code(outcomes, "loss")


def split_residuals(result: Any) -> tuple[PyTree[Float[ArrayLike, " ..."]], Int[Array, ""]]:
    """Residuals and status from a result: a pytree of residuals, or (pytree, solutions or codes).

    A pair is taken for the latter if its second part holds solutions and integers only.
    """
    if isinstance(result, tuple) and len(result) == 2:
        leaves = jax.tree.leaves(result[1], is_leaf=_has_status)
        if all(_has_status(x) or _is_code(x) for x in leaves):
            return _no_results(result[0]), worst_code(result[1], "residuals")
    return _no_results(result), worst_code((), "residuals")


def _no_results(residuals):
    """The residuals; ValueError for results, whose arrays are no residuals, and for text."""
    for leaf in jax.tree.leaves(residuals, is_leaf=_has_status):
        if _has_status(leaf) or isinstance(leaf, str):
            text = "expected floats, or (floats, solution), got a"
            raise ValueError(f"residuals: {text} {type(leaf).__name__}")
    return residuals


def worst_code(outcomes: PyTree[Any], name: str) -> Int[Array, ""]:
    """The largest status code in a pytree of solutions and arrays of codes; OK for no leaves."""
    code = jnp.int32(status.OK)
    for item in jax.tree.leaves(outcomes, is_leaf=_has_status):
        codes = jnp.asarray(getattr(item, "status", item))
        if not jnp.issubdtype(codes.dtype, jnp.integer):
            raise ValueError(f"{name}: beside the value expected solutions or status codes")
        code = jnp.maximum(code, jnp.max(codes, initial=status.OK))
    return code.astype(jnp.int32)


def _is_code(item):
    return not isinstance(item, str) and jnp.issubdtype(jnp.asarray(item).dtype, jnp.integer)


def _has_status(item):
    return hasattr(item, "status")
