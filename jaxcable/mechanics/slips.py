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
    """Return where elements slip at a motion: places of all elements that can, in a row, bool.

    None: no group can slip.
    """
    found = _slipping_by_group(system, x)
    return jnp.concatenate([own.ravel() for own in found]) if found else None


def elements_at_places(
    system: System, x: Motion, places: Bool[Array, " n_place"]
) -> Bool[Array, " n_elem"]:
    """Return which elements have any of the `places` of `slipping_places`, all groups in a row."""
    widths = iter(jax.eval_shape(lambda: _slipping_by_group(system, x)))
    masks, first = [], 0
    for group in system.groups:
        own = jnp.zeros((len(group.links), 0), bool)
        if isinstance(group, Slipping):
            shape = next(widths).shape
            own = places[first : (first := first + shape[0] * shape[1])].reshape(shape)
        masks.append(jnp.any(own, axis=1))
    return jnp.concatenate(masks)


def _slipping_by_group(system, x):
    """Return where elements slip, a list of arrays [n_elem, n_place] of the groups that can."""
    pairs: Any = zip(system.groups, system.states, strict=True)
    return [
        evaluate_elements("is_slipping", group, state, system.nodes, x)
        for group, state in pairs
        if isinstance(group, Slipping)
    ]
