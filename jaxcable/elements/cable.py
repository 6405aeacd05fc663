"""Cable: a bar that carries tension only.

At exactly zero strain the taut-side tangent holds: a flat net without prestress starts there and
needs its axial stiffness. Hence ``where(e < 0, 0, ...)``, which also lets a NaN through instead of
calling it slack.
"""

import jax.numpy as jnp

from .._tree import pytree
from .bar import Bars


@pytree(indices=("links",))
class Cables(Bars):
    """A group of straight two-node cables: tension only; arguments as `Bars`."""

    tension_only = True

    def force(self, strain):
        """Axial force, N: zero in a slack cable."""
        return jnp.where(strain < 0, 0.0, super().force(strain))

    def energy_per_length(self, strain):
        """Stored energy per unstressed length, J/m: zero in a slack cable."""
        return jnp.where(strain < 0, 0.0, super().energy_per_length(strain))

    def is_slack(self, state, ends, motion):
        """Shorter than its unstressed length, hence without force."""
        if state.held is not None:
            return jnp.zeros((), bool)
        return self.strain(state, ends, motion) < 0
