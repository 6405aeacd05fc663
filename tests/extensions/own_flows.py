"""Unsymmetric elements written outside of the package: drag in a current, a floor with friction."""

import jax.numpy as jnp
import numpy as np
from extensions.own_elements import Nothing
from extensions.own_links import Joined

from jaxcable.common import checks
from jaxcable.common.tree import Indices, pytree
from jaxcable.elements.element import Element, Result

_SOFT = 1e-3  # m, slip at which friction has 0.7 of its largest value


@pytree(indices=("links",))
class Drags(Joined):
    """Drag across links in a current along x, which turns with them, half of it at each end.

    ``drag |v| v`` per unit length, N/m, with the part v of the unit vector along x that is normal
    to the link; no energy.
    """

    links: object
    drag: object
    weight: object = None

    per_element = ("drag", "weight")
    symmetric = False
    results = (Result("across", "N", ("x", "y", "z")),)

    def across(self, state, ends, motion):
        """Drag on an element, [3], N."""
        _, length, along = self._way(ends, motion)
        v = jnp.eye(3)[0] - along[0] * along
        return self.drag * length * jnp.sqrt(v @ v + 1e-12) * v

    def end_forces(self, state, ends, motion):
        return jnp.broadcast_to(-0.5 * self.across(state, ends, motion), (2, 3))

    def energy(self, state, ends, motion):
        return jnp.zeros(())


@pytree(indices=("links",))
class Floors(Element):
    """An elastic floor at z = 0 with friction against all that slips from its initial place.

    The floor pushes with ``N = stiffness d`` where it is d deep, smoothed at its surface by
    ``d = (sqrt(z^2 + 1e-4) - z) / 2``; friction is ``mu N s / sqrt(s^2 + 1e-6)`` for a slip s.
    """

    links: object
    stiffness: object
    mu: object

    per_element = ("stiffness", "mu")
    symmetric = False
    results = (Result("pressing", "N"),)

    def __post_init__(self):
        if not isinstance(self.links, Indices):
            object.__setattr__(self, "links", Indices(np.asarray(self.links, np.int32)))
        for name in self.per_element:
            own = checks.floats_per_element(getattr(self, name), len(self.links), name)
            object.__setattr__(self, name, own)

    def start(self, ends):
        return Nothing()

    def pressing(self, state, ends, motion):
        """Force with which the floor pushes an element up, N."""
        z = ends[0, 2] + motion[0, 2]
        return self.stiffness * 0.5 * (jnp.sqrt(z**2 + 1e-4) - z)

    def end_forces(self, state, ends, motion):
        normal, slip = self.pressing(state, ends, motion), motion[0, :2]
        rub = self.mu * normal * slip / jnp.sqrt(slip @ slip + _SOFT**2)
        return jnp.append(rub, -normal)[None]

    def energy(self, state, ends, motion):
        return jnp.zeros(())
