"""A law with memory written outside of the package, against its contract."""

import jax.numpy as jnp

import jaxcable as jc
from jaxcable._tree import pytree
from jaxcable.materials.law import Law


@jc.files.register
@pytree
class Prager(Law):
    """Linear kinematic hardening (Prager 1956): one plastic strain p, back stress H p.

    At given p the energy is that of the increment: least over the new p' of
    ``E (e - p')^2 / 2 + H p'^2 / 2 + y |p' - p|``.

    Attributes:
        E, H, y: Young's and hardening modulus, yield stress, Pa.
    """

    E: object
    H: object
    y: object

    n_plastic = 1

    @property
    def modulus(self):
        return self.E

    def _after(self, strain, plastic):
        p = jnp.zeros_like(strain) if plastic is None else plastic[..., 0]
        over = self.E * (strain - p) - self.H * p
        flow = jnp.maximum(jnp.abs(over) - self.y, 0.0) / (self.E + self.H)
        return p, p + jnp.sign(over) * flow

    def stress_at(self, strain, plastic=None):
        return self.E * (strain - self._after(strain, plastic)[1])

    def energy_at(self, strain, plastic=None):
        p, new = self._after(strain, plastic)
        stored = 0.5 * self.E * (strain - new) ** 2 + 0.5 * self.H * new**2
        return stored + self.y * jnp.abs(new - p)

    def strain_at(self, stress, plastic=None):
        p = jnp.zeros_like(stress) if plastic is None else plastic[..., 0]
        over = stress - self.H * p
        new = jnp.where(jnp.abs(over) > self.y, (stress - jnp.sign(over) * self.y) / self.H, p)
        return new + stress / self.E

    def settle(self, strain, plastic):
        return self._after(strain, plastic)[1][..., None]

    def corners(self, plastic=None):
        p = jnp.zeros(1) if plastic is None else plastic
        ends = jnp.stack([-self.y, self.y])
        return p + (self.H * p + ends.reshape((1,) * (p.ndim - 1) + (2,))) / self.E
