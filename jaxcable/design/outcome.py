"""What a loss or residuals may return beside their value: solutions, or status codes."""

from __future__ import annotations

from typing import Any

import jax
import jax.numpy as jnp

from ..common import status
from ..common.types import Array, ArrayLike, Float, Int, PyTree


def split_loss(result: Any) -> tuple[Float[Array, ""], Int[Array, ""]]:
    """Scalar and status of what a loss returns: a scalar, or (scalar, what carries the status)."""
    value, told = result if isinstance(result, tuple) and len(result) == 2 else (result, ())
    if value is None or hasattr(value, "status"):
        got = "None; it needs a return" if value is None else f"a {type(value).__name__} first"
        raise ValueError(f"loss: expected a scalar float, or (scalar, solution), got {got}")
    value = jnp.asarray(value)
    if value.shape != () or not jnp.issubdtype(value.dtype, jnp.floating):
        raise ValueError(
            f"loss: expected a scalar float, or (scalar, solution), got {value.dtype}"
            f"{list(value.shape)}"
        )
    return value, worst_code(told, "loss")


def split_residuals(result: Any) -> tuple[PyTree[Float[ArrayLike, " ..."]], Int[Array, ""]]:
    """Residuals and status of what a function returns: a pytree, or (pytree, solutions or codes).

    A pair counts as the latter if there is nothing else than solutions and integers in its second.
    """
    if isinstance(result, tuple) and len(result) == 2:
        leaves = jax.tree.leaves(result[1], is_leaf=_has_status)
        if all(_has_status(x) or jnp.issubdtype(jnp.asarray(x).dtype, jnp.integer) for x in leaves):
            return result[0], worst_code(result[1], "residuals")
    return result, worst_code((), "residuals")


def worst_code(told: PyTree[Any], name: str) -> Int[Array, ""]:
    """The largest status code in a pytree of solutions and arrays of codes; OK if it is empty."""
    code = jnp.int32(status.OK)
    for item in jax.tree.leaves(told, is_leaf=_has_status):
        codes = jnp.asarray(getattr(item, "status", item))
        if not jnp.issubdtype(codes.dtype, jnp.integer):
            raise ValueError(f"{name}: beside the value expected solutions or status codes")
        code = jnp.maximum(code, jnp.max(codes, initial=status.OK))
    return code.astype(jnp.int32)


def _has_status(item):
    return hasattr(item, "status")
