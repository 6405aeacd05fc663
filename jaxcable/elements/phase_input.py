"""`PhaseInput`: a quantity that a phase can give elements; `InputValues`: values for one group."""

from __future__ import annotations

import dataclasses
from collections.abc import Callable

import jax.numpy as jnp
import numpy as np

from ..common.rules import Rule
from ..common.tree import pytree
from ..common.types import Array, ArrayLike, Bool, Float


@dataclasses.dataclass(frozen=True)
class PhaseInput:
    """Declaration of a quantity that a phase can give for elements, such as a pretension.

    Attributes:
        name: name in phases, files and messages.
        unit: unit of its numbers.
        ramped: whether its effect grows with the load factor. Otherwise it holds from the beginning
            of the phase, such as a clamp that is closed.
        rules: rules of its numbers: functions of the name and the numbers that return a `Rule`,
            such as `common.rules.not_negative`.
    """

    name: str
    unit: str
    ramped: bool = True
    rules: tuple[Callable[[str, Float[ArrayLike, "n_elem ..."]], Rule], ...] = ()


@pytree
class InputValues:
    """Values of one phase input, such as a pretension, for the elements of a group.

    Attributes:
        values: given values, [n_elem], or [n_elem, n_component] (`Prestressable.components`); zero
            for elements that the input does not concern.
        chosen: the elements that the input concerns, [n_elem] bool; None for all.
    """

    values: Float[ArrayLike, "n_elem ..."]
    chosen: Bool[ArrayLike, " n_elem"] | None = None

    def element_mask(self) -> Bool[np.ndarray, " n_elem"]:
        """Return which elements a known input concerns, [n_elem], a new NumPy array."""
        return np.ones(len(self.values), bool) if self.chosen is None else np.array(self.chosen)

    def select(
        self, new: Float[ArrayLike, "n_elem ..."], old: Float[ArrayLike, "n_elem ..."]
    ) -> Float[Array, "n_elem ..."]:
        """Return `new` for the elements that the input concerns, and `old` for all others."""
        if self.chosen is None:
            return new
        chosen = jnp.reshape(self.chosen, (-1, *(1,) * (jnp.ndim(new) - 1)))
        return jnp.where(chosen, new, old)
