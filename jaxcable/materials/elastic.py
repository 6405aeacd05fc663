"""Linear law, whose curve has no end."""

from __future__ import annotations

from ..common import checks
from ..common.rules import Rule, positive, refuse_if_broken
from ..common.tree import copy_with, pytree, set_fields
from ..common.types import Array, ArrayLike, Float
from .law import Law, Memory, Numbers, Values


@pytree
class Elastic(Law):
    """Linear law: stress is E times strain.

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

    E: Float[ArrayLike, ""]

    monotone = True

    def __post_init__(self):
        E = checks.as_floats(self.E, "E")
        if E.shape != ():
            raise ValueError(f"E: expected a scalar (a group shares its law), got shape {E.shape}")
        set_fields(self, E=E)
        refuse_if_broken(self.rules())

    def rules(self) -> list[Rule]:
        """Return the condition that E is positive, a list of one `Rule`."""
        return [positive("E", self.E, "Young's modulus must be positive")]

    @property
    def modulus(self) -> Float[Array, ""]:
        """Young's modulus, the slope at the origin, Pa."""
        return self.E

    def stress_at(self, strain: Numbers, memory: Memory = None) -> Values:
        """Return the stress at `strain`, Pa, in the same shape."""
        return self.E * strain

    def energy_at(self, strain: Numbers, memory: Memory = None) -> Values:
        """Return the strain energy per unstressed volume, J/m3."""
        return 0.5 * self.E * strain**2

    def strain_at(self, stress: Numbers, memory: Memory = None) -> Values:
        """Return the strain at `stress`, Pa, in the same shape."""
        return stress / self.E

    def in_series_with_spring(self, compliance: Numbers) -> Elastic:
        """Return the law in series with a spring of `compliance`, strain per stress, 1/Pa."""
        return copy_with(self, E=self.E / (1 + compliance * self.E))
