"""What the law of the conductor needs in all spans of a section: first strains, mean tensions."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TypeVar

import jax
import jax.numpy as jnp
import numpy as np

from ..common import checks
from ..common.types import Array, Float
from .conductor_law import NO_SET
from .line_section import LineSection

Tree = TypeVar("Tree")


def stack(trees: Sequence[Tree]) -> Tree:
    """Return pytrees of one structure as one, with a leading axis; by NumPy where all is known."""

    def join(*values):
        known = [checks.array_if_known(x) for x in values]
        if any(x is None for x in known):
            return jnp.stack([jnp.asarray(x) for x in values])
        return jnp.asarray(np.stack(known))

    return jax.tree.map(join, *trees)


def never_loaded(section: LineSection) -> Float[Array, "n_span n_layer"]:
    """Return the permanent strains of a conductor that has never been loaded."""
    shape = len(section.layout.spans), len(section.conductor.layers)
    return jnp.asarray(np.full(shape, NO_SET))


def mean_tension(pulls: Float[Array, "n_span 2 3"]) -> Float[Array, " n_span"]:
    """Return the mean tensions along the unstressed lengths of catenaries, [n_span], N.

    Across the load the tension is constant, H, and along it u changes evenly from end to end, so
    that it is the mean of ``sqrt(H^2 + u^2)``. `pulls` are the forces on the nodes at both ends, N.
    """
    load = jnp.sum(pulls, axis=1, keepdims=True)
    whole = jnp.sqrt(jnp.sum(load**2, axis=-1))
    along = jnp.sum(pulls * load, axis=-1) / whole
    across2 = jnp.sum(pulls[:, 0] ** 2, axis=-1) - along[:, 0] ** 2
    level = jnp.sqrt(across2)[:, None]
    area = 0.5 * (along * jnp.hypot(level, along) + level**2 * jnp.arcsinh(along / level))
    return jnp.sum(area, axis=1) / whole[:, 0]
