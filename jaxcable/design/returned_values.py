"""Split what a user's loss or residual function returns into values and a status."""

from __future__ import annotations

from typing import Any

import jax
import jax.numpy as jnp

from ..common import status
from ..common.types import Array, ArrayLike, Float, Int, PyTree


def loss_and_status(result: Any) -> tuple[Float[Array, ""], Int[Array, ""]]:
    """Return the scalar loss and the worst status, from what a user's loss has returned.

    That is a scalar, or a pair of it and a pytree of solutions or status codes; else ValueError.
    """
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
    return value, worst_status(outcomes, "loss")


def residuals_and_status(result: Any) -> tuple[PyTree[Float[ArrayLike, " ..."]], Int[Array, ""]]:
    """Return the residuals and the worst status, from what a user's function has returned.

    That is a pytree of floats, or a pair of it and a pytree of solutions or status codes. A pair
    counts as residuals alone unless its second part has nothing but solutions and integers.
    Solutions or texts among the residuals raise ValueError.
    """
    if isinstance(result, tuple) and len(result) == 2:
        leaves = jax.tree.leaves(result[1], is_leaf=_has_status)
        if all(_has_status(x) or _holds_status_codes(x) for x in leaves):
            return _require_residuals(result[0]), worst_status(result[1], "residuals")
    return _require_residuals(result), worst_status((), "residuals")


def _require_residuals(residuals):
    """Return the residuals; raise ValueError if any leaf is a solution or a text."""
    for leaf in jax.tree.leaves(residuals, is_leaf=_has_status):
        if _has_status(leaf) or isinstance(leaf, str):
            text = "expected floats, or (floats, solution), got a"
            raise ValueError(f"residuals: {text} {type(leaf).__name__}")
    return residuals


def worst_status(outcomes: PyTree[Any], name: str) -> Int[Array, ""]:
    """Return the largest status code in a pytree of solutions and status codes; OK if it is empty.

    Raises ValueError with the `name` of the user's function if a leaf is neither.
    """
    code = jnp.int32(status.OK)
    for item in jax.tree.leaves(outcomes, is_leaf=_has_status):
        codes = jnp.asarray(getattr(item, "status", item))
        if not jnp.issubdtype(codes.dtype, jnp.integer):
            raise ValueError(
                f"{name}: expected solutions or status codes in the second part of the pair"
            )
        code = jnp.maximum(code, jnp.max(codes, initial=status.OK))
    return code.astype(jnp.int32)


def _holds_status_codes(item):
    """Return whether an object is an integer or an array of integers, as status codes are."""
    return not isinstance(item, str) and jnp.issubdtype(jnp.asarray(item).dtype, jnp.integer)


def _has_status(item):
    """Return whether an object has a status, as a `Solution` has."""
    return hasattr(item, "status")
