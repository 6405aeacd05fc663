"""Conditions that stay conditions in a batch.

Under `jax.vmap` a `lax.cond` with a predicate of its own for every case becomes a select: both
branches are computed for all cases, whether or not any needs them. With `cond_in_batch` a branch
that no case needs is not computed.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import TypeVar

import jax
import jax.numpy as jnp
from jax import lax
from jax.custom_batching import custom_vmap

from .tree import select_tree
from .types import Array, Bool

Tree = TypeVar("Tree")


def cond_in_batch(wanted: Bool[Array, ""], function: Callable[[Tree], Tree], operand: Tree) -> Tree:
    """Return ``function(operand)`` if `wanted`, else `operand`; not differentiable in reverse mode.

    In a batch, however deep, the function is computed for all cases if any of them wants it, and
    for none otherwise.
    """

    def compute(operand):
        return _select_in_batch(wanted, function(operand), operand)

    return lax.cond(_is_wanted_by_any(wanted), compute, lambda operand: operand, operand)


@custom_vmap
def _is_wanted_by_any(wanted):
    """Return `wanted`, a scalar bool; in a batch one bool for all cases: True if any of them is."""
    return wanted


@_is_wanted_by_any.def_vmap
def _is_wanted_by_any_batch_rule(axis_size, mapped, wanted):
    """Return `any` over the cases, for `jax.vmap`: the result is not mapped.

    It calls the function again, so that a batch around this one reduces over its own cases.
    """
    return _is_wanted_by_any(jnp.any(wanted)), False


@custom_vmap
def _select_in_batch(wanted, new, old):
    """Return the pytree `new`; in a batch only for cases where `wanted` is True, else `old`.

    Outside of a batch `wanted` is ignored, because `cond_in_batch` has decided already.
    """
    return new


@_select_in_batch.def_vmap
def _select_in_batch_rule(axis_size, mapped, *arguments):
    """Return, as a rule for `jax.vmap`, `new` or `old` of each case, and that all are mapped."""
    axes = jax.tree.map(lambda is_mapped: 0 if is_mapped else None, mapped)
    found = jax.vmap(select_tree, in_axes=tuple(axes), axis_size=axis_size)(*arguments)
    return found, jax.tree.map(lambda _: True, found)
