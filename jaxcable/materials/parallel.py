"""Several laws side by side at one strain: what axial force sees of a composite section."""

import jax.numpy as jnp

from .._tree import copy, pytree
from .inverse import inverse


@pytree
class Parallel:
    """Laws that share one strain, ``s(e) = sum_i share_i s_i(e)``.

    Attributes:
        laws: tuple of laws.
        shares: part of the area that each has, [n_law], summing to 1.

    Example:
        Concrete in a steel tube, a quarter of the area, at one strain:

        >>> laws = jc.Elastic(30e9), jc.Elastic(210e9)
        >>> law = jc.materials.Parallel(laws, np.array([0.75, 0.25]))
        >>> print(f"{law.modulus / 1e9:.1f} GPa, {law.stress_at(1e-4) / 1e6:.1f} MPa")
        75.0 GPa, 7.5 MPa
    """

    laws: object
    shares: object

    @property
    def n_plastic(self):
        """Plastic strains of all laws, one after the other."""
        return sum(law.n_plastic for law in self.laws)

    @property
    def breaks(self):
        """Whether any of the curves can end."""
        return any(law.breaks for law in self.laws)

    @property
    def rising(self):
        """Whether none of the curves falls."""
        return all(law.rising for law in self.laws)

    @property
    def modulus(self):
        """Slope at the origin, Pa."""
        return sum(a * law.modulus for a, law in zip(self.shares, self.laws, strict=True))

    @property
    def limits(self):
        """Strains at which the first of the curves ends."""
        low, high = zip(*(law.limits for law in self.laws), strict=True)
        return (
            jnp.max(jnp.stack([jnp.asarray(v) for v in low])),
            jnp.min(jnp.stack([jnp.asarray(v) for v in high])),
        )

    @property
    def capacity(self):
        """Smallest and largest stress within the limits, Pa."""
        low, high = self.limits
        corners = self.corners(None if self.n_plastic == 0 else jnp.zeros(self.n_plastic))
        at = jnp.clip(jnp.append(corners, jnp.stack([low, high])), low, high)
        at = jnp.where(jnp.isfinite(at), at, 0.0)
        virgin = jnp.zeros((len(at), self.n_plastic)) if self.n_plastic else None
        stress = self.continued().stress_at(at, virgin)
        least, most = jnp.min(stress), jnp.max(stress)
        return jnp.where(jnp.isfinite(low), least, -jnp.inf), jnp.where(
            jnp.isfinite(high), most, jnp.inf
        )

    def each(self, plastic):
        """Share, law and its own plastic strains, of every law."""
        start = 0
        for share, law in zip(self.shares, self.laws, strict=True):
            own = None
            if law.n_plastic and plastic is not None:
                own = plastic[..., start : start + law.n_plastic]
                start += law.n_plastic
            yield share, law, own

    def stress_at(self, strain, plastic=None):
        """Stress over the whole area, Pa."""
        return sum(share * law.stress_at(strain, p) for share, law, p in self.each(plastic))

    def size_at(self, strain, plastic):
        """Sum of the absolute stresses of all parts, Pa."""
        return sum(share * law.size_at(strain, p) for share, law, p in self.each(plastic))

    def energy_at(self, strain, plastic=None):
        """Energy per volume, J/m3."""
        return sum(share * law.energy_at(strain, p) for share, law, p in self.each(plastic))

    def strain_at(self, stress, plastic=None):
        """Strain at a stress over the whole area, Pa."""
        return inverse(self, stress, plastic)

    def beyond(self, strain):
        """Whether any of the curves has ended."""
        low, high = self.limits
        return (strain > high) | (strain < low)

    def settle(self, strain, plastic):
        """Plastic strains after an increment."""
        return jnp.concatenate(
            [law.settle(strain, p) for _, law, p in self.each(plastic) if p is not None], axis=-1
        )

    def corners(self, plastic=None):
        """Corners of all laws, on the last axis."""
        parts = [law.corners(own) for _, law, own in self.each(plastic)]
        shape = max((part.shape[:-1] for part in parts), key=len)
        return jnp.concatenate(
            [jnp.broadcast_to(part, (*shape, part.shape[-1])) for part in parts], axis=-1
        )

    def corner_distance(self, strain, plastic=None):
        """Distance in strain to the nearest corner of any law."""
        each = [law.corner_distance(strain, own) for _, law, own in self.each(plastic)]
        return jnp.min(jnp.stack(each), axis=0)

    def is_slack(self, strain, plastic=None):
        """Whether it carries nothing because all its laws are slack."""
        each = [law.is_slack(strain, own) for _, law, own in self.each(plastic)]
        return jnp.all(jnp.stack(jnp.broadcast_arrays(*each)), axis=0)

    def continued(self):
        """The law for an iteration."""
        return copy(self, laws=tuple(law.continued() for law in self.laws))

    def tension_only(self):
        """The laws without compression."""
        return copy(self, laws=tuple(law.tension_only() for law in self.laws))

    def softened(self, compliance):
        """Every law in series with a spring of its own of `compliance`, 1/Pa."""
        return copy(self, laws=tuple(law.softened(compliance) for law in self.laws))
