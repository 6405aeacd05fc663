"""Where elements of a system slip with friction."""

from __future__ import annotations

from typing import Any

import jax
import jax.numpy as jnp

from ..common.types import Array, Bool
from ..elements.deviator_results import Slipping
from ..spaces.space import Motion
from .assembly import System
from .elementwise import evaluate_elements


def slipping_places(system: System, x: Motion) -> Bool[Array, " n_place"] | None:
    """Return which places slip with friction in a motion, such as deviators, [n_place] bool.

    Places are those of all elements of all groups that can slip, one after the other; None if no
    group can.
    """
    found = _is_slipping_by_group(system, x)
    return jnp.concatenate([own.ravel() for own in found]) if found else None


def elements_at_places(
    system: System, x: Motion, places: Bool[Array, " n_place"]
) -> Bool[Array, " n_elem"]:
    """Return which elements have one of the `places` chosen, those of all groups in a row.

    `places` are chosen among those of `slipping_places`.
    """
    widths = iter(jax.eval_shape(lambda: _is_slipping_by_group(system, x)))
    masks, first = [], 0
    for group in system.groups:
        own = jnp.zeros((len(group.links), 0), bool)
        if isinstance(group, Slipping):
            shape = next(widths).shape
            own = places[first : (first := first + shape[0] * shape[1])].reshape(shape)
        masks.append(jnp.any(own, axis=1))
    return jnp.concatenate(masks)


def _is_slipping_by_group(system, x):
    """Return which places of elements slip, [n_elem, n_place] bool for each group that can."""
    pairs: Any = zip(system.groups, system.states, strict=True)
    return [
        evaluate_elements("is_slipping", group, state, system.nodes, x)
        for group, state in pairs
        if isinstance(group, Slipping)
    ]
