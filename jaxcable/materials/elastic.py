"""Linear law, without end."""

import jax.numpy as jnp

from .. import _check
from .._rules import positive, refuse
from .._tree import copy, pytree


@pytree
class Elastic:
    """Linear law, ``stress = E strain``.

    Attributes:
        E: Young's modulus, scalar, Pa, positive.

    Raises:
        ValueError: E is not a scalar, or not positive.

    Example:
        >>> law = jc.Elastic(210e9)
        >>> print(f"{law.stress_at(1e-3) / 1e6:.1f} MPa, {law.energy_at(1e-3) / 1e3:.1f} kJ/m3")
        210.0 MPa, 105.0 kJ/m3
        >>> print(f"{law.strain_at(-105e6):.4f}")
        -0.0005
    """

    E: object

    n_plastic = 0
    breaks = False
    rising = True

    def __post_init__(self):
        E = _check.floats(self.E, "E")
        if E.shape != ():
            raise ValueError(f"E: expected a scalar (a group shares its law), got shape {E.shape}")
        object.__setattr__(self, "E", E)
        refuse(self.rules())

    def rules(self):
        """What its number keeps, see `_rules`."""
        return [positive("E", self.E, "Young's modulus must be positive")]

    @property
    def modulus(self):
        """Slope at the origin, Pa."""
        return self.E

    @property
    def capacity(self):
        """No stress is too high."""
        return -jnp.inf, jnp.inf

    @property
    def limits(self):
        """The line has no ends."""
        return -jnp.inf, jnp.inf

    def stress_at(self, strain, plastic=None):
        """Stress, Pa, at `strain`."""
        return self.E * strain

    def size_at(self, strain, plastic):
        """Absolute stress, Pa."""
        return jnp.abs(self.E * strain)

    def energy_at(self, strain, plastic=None):
        """Strain energy per unstressed volume, J/m3."""
        return 0.5 * self.E * strain**2

    def strain_at(self, stress, plastic=None):
        """Strain at `stress`, Pa."""
        return stress / self.E

    def continued(self):
        """The law itself: it has no end to go beyond."""
        return self

    def tension_only(self):
        """The law itself; what is slack is decided by the cable, from its strain."""
        return self

    def beyond(self, strain):
        """Never."""
        return jnp.zeros(jnp.shape(strain), bool)

    def is_slack(self, strain, plastic=None):
        """Never: a line holds in compression too."""
        return jnp.zeros(jnp.shape(strain), bool)

    def corners(self, plastic=None):
        """None, [0]."""
        return jnp.zeros(0)

    def corner_distance(self, strain, plastic=None):
        """Infinite: a line has no corner."""
        return jnp.full_like(strain, jnp.inf)

    def softened(self, compliance):
        """The law in series with a spring of `compliance`, 1/Pa."""
        return copy(self, E=self.E / (1 + compliance * self.E))
