"""`Stated`: a statement of prestress, resolved for the elements of one group."""

from __future__ import annotations

import jax.numpy as jnp

from ..common.tree import pytree
from ..common.types import Array, ArrayLike, Bool, Float


@pytree
class Stated:
    """One statement of prestress for a group.

    Attributes:
        values: stated values, [n_elem], or [n_elem, n_component] (`Prestressable.components`); zero
            for elements that the statement does not concern.
        chosen: the elements that the statement concerns, [n_elem] bool; None for all.
    """

    values: Float[ArrayLike, "n_elem ..."]
    chosen: Bool[ArrayLike, " n_elem"] | None = None

    def over(
        self, new: Float[ArrayLike, "n_elem ..."], old: Float[ArrayLike, "n_elem ..."]
    ) -> Float[Array, "n_elem ..."]:
        """`new` for the elements that the statement concerns, `old` for all others."""
        if self.chosen is None:
            return new
        chosen = jnp.reshape(self.chosen, (-1, *(1,) * (jnp.ndim(new) - 1)))
        return jnp.where(chosen, new, old)
