"""A fibre section: forces from strains, energy, and what its fibres remember.

Plane sections: ``e = e0 + ky z - kz y`` with the section's axes y and z, hence
``N = sum s A``, ``My = sum s A z``, ``Mz = -sum s A y``. Fibre sums converge at second order in the
size of the fibres.
"""

import jax
import jax.numpy as jnp
import numpy as np

from .. import _check
from .._tree import Indices, copy, pytree
from ..materials import Elastic, Parallel
from . import capacity, shapes, strains


@pytree(static=("counts",), indices=("cells",))
class Section:
    """A cross-section made of fibres; the constructors below make its mesh.

    Fibres of one law follow each other. Coordinates are from the point through which the axis of an
    element goes; constructors put it at the centre of their shape.

    Attributes:
        y, z: places of the fibres, [n_fibre], m.
        area: their areas, [n_fibre], m2.
        laws: tuple of uniaxial laws.
        counts: how many fibres each law has.
        torsion: Saint-Venant torsion constant that goes with each law, [n_law], m4, or None.
        points, cells: mesh for pictures, [n_point, 2] and [n_fibre, 4]; None if there is none.
    """

    y: object
    z: object
    area: object
    laws: object
    counts: tuple = None
    torsion: object = None
    points: object = None
    cells: object = None

    def __post_init__(self):
        put = object.__setattr__
        for name in ("y", "z", "area"):
            value = _check.floats(getattr(self, name), name)
            if value.ndim != 1 or len(value) != len(self.y) or len(value) == 0:
                raise ValueError(f"{name}: expected shape [n_fibre] as y, got {value.shape}")
            put(self, name, value)
        _check.require(self.area, lambda v: v > 0, "area", "a fibre's area must be positive")
        put(self, "laws", tuple(self.laws) if isinstance(self.laws, list | tuple) else (self.laws,))
        for k, law in enumerate(self.laws):
            if not hasattr(law, "stress_at"):
                raise ValueError(f"laws[{k}]: {type(law).__name__} is not a uniaxial law")
        put(self, "counts", (len(self.y),) if self.counts is None else tuple(self.counts))
        if len(self.counts) != len(self.laws) or sum(self.counts) != len(self.y):
            raise ValueError(f"counts = {self.counts}: must give every law its number of fibres")
        if self.cells is not None and not isinstance(self.cells, Indices):
            put(self, "cells", Indices(self.cells))

    # --- shapes

    disc = staticmethod(shapes.disc)
    ring = staticmethod(shapes.ring)
    rectangle = staticmethod(shapes.rectangle)
    i_shape = staticmethod(shapes.i_shape)
    polygon = staticmethod(shapes.polygon)
    mesh = staticmethod(shapes.mesh)
    composite = staticmethod(shapes.composite)

    def shifted(self, y=0.0, z=0.0):
        """The section moved by `y`, `z`, m, against the axis of the element."""
        points = None if self.points is None else self.points + np.array([y, z])
        return copy(self, y=self.y + y, z=self.z + z, points=points)

    # --- numbers

    @property
    def n_fibre(self):
        """Number of fibres."""
        return len(self.y)

    @property
    def total_area(self):
        """Area, m2."""
        return jnp.sum(self.area)

    def inertia(self):
        """Second moments of area about the axes: ``sum A z^2, sum A y^2, sum A y z``, m4."""
        return (
            jnp.sum(self.area * self.z**2),
            jnp.sum(self.area * self.y**2),
            jnp.sum(self.area * self.y * self.z),
        )

    def stiffness(self):
        """Initial stiffness, N, N m and N m2: forces per (e0, ky, kz), [3, 3]."""
        lever = self._levers()
        modulus = self._per_fibre([law.modulus for law in self.laws])
        return lever.T @ ((self.area * modulus)[:, None] * lever)

    def torsional_stiffness(self, poisson=0.3):
        """Initial torsional stiffness ``sum G J``, N m2, with ``G = E / 2 (1 + poisson)``."""
        if self.torsion is None:
            raise ValueError(
                "torsional_stiffness: missing; this section has no known torsion constant"
            )
        shear = jnp.stack([law.modulus / (2 * (1 + poisson)) for law in self.laws])
        return jnp.sum(shear * self.torsion)

    def axial(self):
        """Area, m2, and the one law that axial force sees (all fibres at the same strain)."""
        areas = [jnp.sum(self.area[part]) for part in self._parts()]
        area = sum(areas)
        if len(self.laws) == 1:
            return area, self.laws[0]
        return area, Parallel(self.laws, jnp.stack(areas) / area)

    # --- the law of the section

    @property
    def is_elastic(self):
        """Whether all its laws are linear; then three numbers a strain are all there is."""
        return all(isinstance(law, Elastic) for law in self.laws)

    @property
    def breaks(self):
        """Whether a fibre can fail."""
        return any(law.breaks for law in self.laws)

    @property
    def remembers(self):
        """Whether a fibre has plastic strains."""
        return any(law.n_plastic for law in self.laws)

    def virgin(self, shape=()):
        """Plastic strains of an unused section, per law [*shape, n_fibre, n_plastic] or None."""
        dtype = jnp.asarray(self.area).dtype
        return tuple(
            jnp.zeros((*shape, count, law.n_plastic), dtype) if law.n_plastic else None
            for law, count in zip(self.laws, self.counts, strict=True)
        )

    def fibre_strain(self, e0, ky, kz):
        """Strain of every fibre, [..., n_fibre]."""
        e0, ky, kz = (jnp.asarray(v)[..., None] for v in (e0, ky, kz))
        shape = (1,) * (jnp.broadcast_shapes(e0.shape, ky.shape, kz.shape).__len__() - 1) + (-1,)
        return e0 + ky * self.z.reshape(shape) - kz * self.y.reshape(shape)

    def fibre_stress(self, e0, ky, kz, plastic=None):
        """Stress of every fibre, [..., n_fibre], Pa."""
        return self._stress(self.fibre_strain(e0, ky, kz), plastic)

    def _stress(self, strain, plastic):
        each = self._each(strain, plastic)
        return jnp.concatenate([law.stress_at(e, p) for law, e, p in each], axis=-1)

    def forces(self, e0, ky, kz, plastic=None):
        """Axial force and bending moments.

        Args:
            e0, ky, kz: strain at the axis and curvatures, arrays of one shape, -, 1/m, 1/m.
            plastic: plastic strains of the fibres, as from `virgin`, or None.

        Returns:
            ``N, My, Mz``, N, N m, N m. Fibres beyond their curve count zero.
        """
        if self.is_elastic:
            strain = jnp.stack(jnp.broadcast_arrays(e0, ky, kz), axis=-1)
            return tuple(jnp.moveaxis(strain @ self.stiffness(), -1, 0))
        if plastic is None and self.remembers:
            plastic = self.virgin(jnp.shape(jnp.asarray(e0) + ky + kz))
        force = self.fibre_stress(e0, ky, kz, plastic)
        return tuple(jnp.moveaxis(force @ (self.area[:, None] * self._levers()), -1, 0))

    def linearized(self, e0, ky, kz, plastic=None):
        """Forces ``N, My, Mz``, [..., 3], and their tangent, [..., 3, 3], as of `forces`."""
        shape = jnp.shape(jnp.asarray(e0) + ky + kz)
        if self.is_elastic:
            force = jnp.stack(self.forces(e0, ky, kz), axis=-1)
            return force, jnp.broadcast_to(self.stiffness(), (*shape, 3, 3))
        if plastic is None and self.remembers:
            plastic = self.virgin(shape)
        strain = self.fibre_strain(e0, ky, kz)
        # a fibre's stress depends on its own strain only: one derivative along all of them at once
        stress, modulus = jax.jvp(
            lambda e: self._stress(e, plastic), (strain,), (jnp.ones_like(strain),)
        )
        lever = self._levers()
        weighted = self.area[:, None] * lever
        outer = (weighted[:, :, None] * lever[:, None, :]).reshape(-1, 9)
        return stress @ weighted, (modulus @ outer).reshape(*shape, 3, 3)

    def size(self, e0, ky, kz, plastic):
        """Sum of the absolute forces of all fibres and their parts, N."""
        strain = self.fibre_strain(e0, ky, kz)
        areas = [self.area[part] for part in self._parts()]
        each = self._each(strain, plastic)
        return sum(law.size_at(e, p) @ a for a, (law, e, p) in zip(areas, each, strict=True))

    def energy(self, e0, ky, kz, plastic=None):
        """Stored energy per length, J/m, at given plastic strains."""
        strain = self.fibre_strain(e0, ky, kz)
        areas = [self.area[part] for part in self._parts()]
        if plastic is None and self.remembers:
            plastic = self.virgin(strain.shape[:-1])
        each = self._each(strain, plastic)
        return sum(law.energy_at(e, p) @ a for a, (law, e, p) in zip(areas, each, strict=True))

    def settle(self, e0, ky, kz, plastic):
        """Plastic strains after an increment that ended at these strains, as `plastic`."""
        each = self._each(self.fibre_strain(e0, ky, kz), plastic)
        return tuple(None if p is None else law.settle(e, p) for law, e, p in each)

    def beyond(self, e0, ky, kz):
        """Whether any fibre is beyond its curve."""
        each = self._each(self.fibre_strain(e0, ky, kz), None)
        return jnp.any(jnp.concatenate([law.beyond(e) for law, e, _ in each], axis=-1), axis=-1)

    def continued(self):
        """The section for an iteration: its laws go on beyond their ends."""
        return copy(self, laws=tuple(law.continued() for law in self.laws))

    def corner_distance(self, e0, ky, kz, plastic=None):
        """Smallest distance in strain of any fibre from a corner of its law."""
        strain = self.fibre_strain(e0, ky, kz)
        if plastic is None and self.remembers:
            plastic = self.virgin(strain.shape[:-1])
        each = [law.corner_distance(e, p) for law, e, p in self._each(strain, plastic)]
        return jnp.min(jnp.concatenate(each, axis=-1), axis=-1)

    # --- equilibrium of the section

    def strains(self, N, My, Mz, plastic=None, tol=None, max_steps=100):
        """Strains from forces, by iteration to equilibrium; see `strains.equilibrium`."""
        return strains.equilibrium(self, N, My, Mz, plastic, tol, max_steps)

    def interaction(self, n_angle=24, n_axial=21):
        """Interaction surface N-My-Mz of first fibre failure; see `capacity.interaction`."""
        return capacity.interaction(self, n_angle, n_axial)

    # --- helpers

    def _levers(self):
        """What a fibre's force adds to N, My, Mz, [n_fibre, 3]."""
        return jnp.stack([jnp.ones_like(self.y), self.z, -self.y], axis=-1)

    def _parts(self):
        ends = np.cumsum(self.counts)
        return [slice(int(e) - n, int(e)) for e, n in zip(ends, self.counts, strict=True)]

    def _per_fibre(self, values):
        return jnp.concatenate(
            [jnp.full(n, v) for n, v in zip(self.counts, values, strict=True)]
        ).astype(jnp.asarray(self.y).dtype)

    def _each(self, strain, plastic):
        """Law, strain of its fibres and their plastic strains."""
        plastic = (None,) * len(self.laws) if plastic is None else plastic
        parts = self._parts()
        return [
            (law, strain[..., part], p)
            for law, part, p in zip(self.laws, parts, plastic, strict=True)
        ]
