"""A law with memory written outside of the package, against its contract."""

import jax.numpy as jnp

from jaxcable.extend import Law, pytree, register


@register
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

    n_memory = 1

    @property
    def modulus(self):
        return self.E

    def _after(self, strain, memory):
        p = jnp.zeros_like(strain) if memory is None else memory[..., 0]
        over = self.E * (strain - p) - self.H * p
        flow = jnp.maximum(jnp.abs(over) - self.y, 0.0) / (self.E + self.H)
        return p, p + jnp.sign(over) * flow

    def stress_at(self, strain, memory=None):
        return self.E * (strain - self._after(strain, memory)[1])

    def energy_at(self, strain, memory=None):
        p, new = self._after(strain, memory)
        stored = 0.5 * self.E * (strain - new) ** 2 + 0.5 * self.H * new**2
        return stored + self.y * jnp.abs(new - p)

    def strain_at(self, stress, memory=None):
        p = jnp.zeros_like(stress) if memory is None else memory[..., 0]
        over = stress - self.H * p
        new = jnp.where(jnp.abs(over) > self.y, (stress - jnp.sign(over) * self.y) / self.H, p)
        return new + stress / self.E

    def commit_memory(self, strain, memory, duration=0.0):
        return self._after(strain, memory)[1][..., None]

    def corner_strains(self, memory=None):
        p = jnp.zeros(1) if memory is None else memory
        ends = jnp.stack([-self.y, self.y])
        return p + (self.H * p + ends.reshape((1,) * (p.ndim - 1) + (2,))) / self.E


@register
@pytree
class Maxwell(Law):
    """Elastic, with a strain that creeps at the stress over a viscosity: it needs time.

    Attributes:
        E, viscosity: Pa, Pa s.
    """

    E: object
    viscosity: object

    n_memory = 1

    @property
    def modulus(self):
        return self.E

    def _crept(self, like, memory):
        return jnp.zeros_like(like) if memory is None else memory[..., 0]

    def stress_at(self, strain, memory=None):
        return self.E * (strain - self._crept(strain, memory))

    def energy_at(self, strain, memory=None):
        return 0.5 * self.E * (strain - self._crept(strain, memory)) ** 2

    def strain_at(self, stress, memory=None):
        return stress / self.E + self._crept(stress, memory)

    def commit_memory(self, strain, memory, duration=0.0):
        rate = self.stress_at(strain, memory) / self.viscosity
        return memory + (duration * rate)[..., None]
