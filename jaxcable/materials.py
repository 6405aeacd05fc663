"""Uniaxial laws: stress from strain.

A law is a pytree with `stress(strain)`, `energy(strain)` (stress integrated over strain),
`strain(stress)` (its inverse on the rising branch from zero), all on arrays of any shape, and
`softened(compliance)`: the law of the same material in series with a spring (strain per stress).
"""

from . import _check
from ._tree import copy, pytree


@pytree
class Elastic:
    """Linear law, ``stress = E strain``.

    Attributes:
        E: Young's modulus, scalar, Pa, positive.
    """

    E: object

    def __post_init__(self):
        E = _check.floats(self.E, "E")
        if E.shape != ():
            raise ValueError(f"E: expected a scalar (a group shares its law), got shape {E.shape}")
        _check.require(E, lambda v: v > 0, "E", "Young's modulus must be positive")
        object.__setattr__(self, "E", E)

    def stress(self, strain):
        """Stress, Pa, at `strain`."""
        return self.E * strain

    def energy(self, strain):
        """Strain energy per unstressed volume, J/m3."""
        return 0.5 * self.E * strain**2

    def strain(self, stress):
        """Strain at `stress`, Pa."""
        return stress / self.E

    def softened(self, compliance):
        """The law in series with a spring of `compliance`, 1/Pa."""
        return copy(self, E=self.E / (1 + compliance * self.E))
