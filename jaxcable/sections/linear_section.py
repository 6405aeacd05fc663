"""A section whose laws are all linear, reduced to its 3 x 3 stiffness: no fibres are needed."""

from __future__ import annotations

import jax.numpy as jnp

from ..common.tree import pytree
from ..common.types import Array, Float
from ..materials import Elastic
from ..materials.law import Law, Numbers, Values


@pytree
class LinearSection:
    """Stiffness that replaces a `section.Section` in an element if all its laws are linear.

    Attributes:
        matrix: derivative of (N, My, Mz) by (e0, ky, kz), [3, 3], N, N m and N m2.
        torsion: torsional stiffness, N m2, or None if it is not known.
    """

    matrix: Float[Array, "3 3"]
    torsion: Float[Array, ""] | None

    is_elastic = True
    has_rupture = False
    has_memory = False

    @property
    def laws(self) -> tuple[Law]:
        """The linear law that over an area of 1 m2 has the axial stiffness, a tuple of one."""
        return (Elastic(self.matrix[0, 0]),)

    def axial(self) -> tuple[Float[Array, ""], Law]:
        """Return an area of 1 m2, and the linear law that over it has the axial stiffness."""
        return jnp.ones_like(self.matrix[0, 0]), *self.laws

    def stiffness(self) -> Float[Array, "3 3"]:
        """Return the derivative of (N, My, Mz) by (e0, ky, kz), [3, 3], N, N m and N m2."""
        return self.matrix

    def torsional_stiffness(self) -> Float[Array, ""] | None:
        """Return the torsional stiffness, N m2, or None if it is not known."""
        return self.torsion

    def energy(self, e0: Numbers, ky: Numbers, kz: Numbers, memory: None = None) -> Values:
        """Return the stored energy per length, J/m; there are no history variables."""
        strain = jnp.stack(jnp.broadcast_arrays(e0, ky, kz), axis=-1)
        return 0.5 * jnp.sum(strain * (strain @ self.matrix), axis=-1)
