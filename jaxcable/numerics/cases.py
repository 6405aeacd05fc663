"""Cases of a batch one after the other, each computed as it is alone."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import jax
from jax import lax
from jax.custom_batching import custom_vmap

from ..common.types import PyTree


def one_by_one(function: Callable[..., PyTree[Any]]) -> Callable[..., PyTree[Any]]:
    """The function of pytrees of arrays; under `jax.vmap`, a loop over the cases.

    `jax.vmap` computes both branches of every `lax.cond` for all cases, and as many iterations as
    the slowest of them needs. A loop computes what each case needs, and takes the same path as the
    case alone. That is faster where the loop becomes one function (`common.fusion`).

    The function is not differentiated; its arguments must have no derivatives.
    """
    mapped = custom_vmap(function)

    def over_cases(_, in_batch, *arguments):
        leaves, tree = jax.tree.flatten(arguments)
        which = jax.tree.leaves(in_batch)
        of_cases = [leaf for leaf, own in zip(leaves, which, strict=True) if own]

        def one(own):
            own = iter(own)
            pairs = zip(leaves, which, strict=True)
            return mapped(*tree.unflatten([next(own) if each else leaf for leaf, each in pairs]))

        results = lax.map(one, of_cases)
        return results, jax.tree.map(lambda _: True, results)

    mapped.def_vmap(over_cases)
    return mapped
