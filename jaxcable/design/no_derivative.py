"""Refuse derivatives of the results of searches."""

from __future__ import annotations

from typing import Any

import jax

from ..common.types import PyTree


@jax.custom_jvp
def refuse_derivative(tree: PyTree[Any]) -> PyTree[Any]:
    """Return the pytree unchanged, such that differentiating through it raises ValueError.

    Without this, a derivative of a search would be a silent NaN or zero.
    """
    return tree


@refuse_derivative.defjvp
def _raise_on_derivative(primals, tangents):
    """Raise ValueError: this is the derivative rule of `refuse_derivative`."""
    raise ValueError(
        "a result of minimize or fit has no derivative; pass lax.stop_gradient of what it depends "
        "on, or differentiate its optimality conditions"
    )
