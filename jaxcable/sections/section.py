"""A fibre section: forces from strains, energy, and what its fibres remember.

Plane sections: ``e = e0 + ky z - kz y`` with the section's axes y and z, hence
``N = sum s A``, ``My = sum s A z``, ``Mz = -sum s A y``. Fibre sums converge at second order in the
size of the fibres; where all laws are linear, sums are integrals and exact.
"""

import jax
import jax.numpy as jnp
import numpy as np

from ..common import checks
from ..common.rules import positive, refuse
from ..common.tree import Indices, copy, pytree
from ..materials import Elastic, Parallel
from ..materials.law import uniaxial
from . import capacity, composites, geometry, shapes, strains
from .linear import Linear


@pytree(static=("counts", "placed"), indices=("cells",))
class Section:
    """A cross-section made of fibres; the constructors below make its mesh.

    Fibres of one law follow each other. Coordinates are from the point through which the axis of an
    element goes. `disc`, `ring`, `rectangle` and `i_shape` put it at the centre of their shape;
    `polygon`, `mesh` and `composite` leave it at the origin of their points or parts, from where
    `centred` takes it to the centroid.

    The axis also counts as the shear centre: an element twists about it, and loads through it cause
    no torsion. In an L or a channel both points are apart, which is not modelled. Where the product
    ``Iyz`` of `inertia` is not zero (an L, a Z), a moment about y bends about z as well.

    Attributes:
        y, z: places of the fibres, [n_fibre], m.
        area: their areas, [n_fibre], m2.
        laws: tuple of uniaxial laws.
        counts: how many fibres each law has.
        torsion: Saint-Venant torsion constant that goes with each law, [n_law], m4, or None.
        points, cells: mesh for pictures, [n_point, 2] and [n_fibre, 4]; None if there is none.
        own: second moments of each fibre about its own centroid, of z^2, y^2 and yz, [n_fibre, 3],
            m4; None for points of area. They make `inertia` exact, and all of a section whose laws
            are linear. Laws of points are evaluated at the centres of the fibres.
        placed: False where the axis is where coordinates had their origin, and neither `centred`
            nor `shifted` has said that it is meant; a beam then warns unless it is the centroid.

    Raises:
        ValueError: wrong shapes, an area that is not positive, something that is no law, `counts`
            that do not add up.

    Example:
        A rod of 50 mm, as in the paper's saddle net:

        >>> section = jc.Section.disc(0.05, jc.Elastic(210e9), shape=(10, 10))
        >>> print(f"{section.n_fibre} fibres, {1e4 * section.total_area:.2f} cm2")
        100 fibres, 19.63 cm2
        >>> print(f"{section.stiffness()[0, 0] / 1e6:.1f} MN")  # EA
        412.3 MN
    """

    y: object
    z: object
    area: object
    laws: object
    counts: tuple = None
    torsion: object = None
    points: object = None
    cells: object = None
    own: object = None
    placed: bool = True

    def __post_init__(self):
        put = object.__setattr__
        for name in ("y", "z", "area"):
            value = checks.floats(getattr(self, name), name)
            if value.ndim != 1 or len(value) != len(self.y) or len(value) == 0:
                raise ValueError(f"{name}: expected shape [n_fibre] as y, got {value.shape}")
            put(self, name, value)
        refuse(self.rules())
        if self.own is not None:
            put(self, "own", checks.floats(self.own, "own"))
            if self.own.shape != (self.n_fibre, 3):
                raise ValueError(f"own: expected shape [n_fibre, 3], got {self.own.shape}")
        put(self, "laws", tuple(self.laws) if isinstance(self.laws, list | tuple) else (self.laws,))
        for k, law in enumerate(self.laws):
            uniaxial(law, f"laws[{k}]")
        put(self, "counts", (len(self.y),) if self.counts is None else tuple(self.counts))
        if len(self.counts) != len(self.laws) or sum(self.counts) != len(self.y):
            raise ValueError(f"counts = {self.counts}: must give every law its number of fibres")
        if self.cells is not None and not isinstance(self.cells, Indices):
            cells = checks.integers(self.cells, "cells", 4)
            count = 0 if self.points is None else len(self.points)
            if len(cells) != self.n_fibre or cells.max(initial=-1) >= count:
                raise ValueError(f"cells: expected four of {count} points for every fibre")
            put(self, "cells", Indices(cells))

    def rules(self):
        """What its numbers keep, see `_rules`; its laws have their own."""
        return [positive("area", self.area, "a fibre's area must be positive")]

    # --- shapes

    disc = classmethod(shapes.disc)
    ring = classmethod(shapes.ring)
    rectangle = classmethod(shapes.rectangle)
    i_shape = classmethod(shapes.i_shape)
    polygon = classmethod(shapes.polygon)
    mesh = classmethod(shapes.mesh)
    composite = classmethod(composites.composite)

    shifted = geometry.shifted
    centred = geometry.centred

    # --- numbers

    @property
    def n_fibre(self):
        """Number of fibres."""
        return len(self.y)

    @property
    def total_area(self):
        """Area, m2."""
        return jnp.sum(self.area)

    centroid = geometry.centroid
    inertia = geometry.inertia
    stiffness = geometry.stiffness
    torsional_stiffness = geometry.torsional_stiffness

    def axial(self):
        """Area, m2, and the one law that axial force sees (all fibres at the same strain).

        Example:
            >>> section = jc.Section.disc(0.05, jc.Elastic(210e9))
            >>> area, law = section.axial()
            >>> print(f"{1e6 * area:.1f} mm2, {law.modulus / 1e9:.0f} GPa")
            1963.5 mm2, 210 GPa
        """
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
        """Whether a fibre remembers anything."""
        return any(law.n_memory for law in self.laws)

    def virgin(self, shape=()):
        """What an unused section remembers, per law [*shape, n_fibre, n_memory] or None."""
        dtype = jnp.asarray(self.area).dtype
        return tuple(
            jnp.zeros((*shape, count, law.n_memory), dtype) if law.n_memory else None
            for law, count in zip(self.laws, self.counts, strict=True)
        )

    def fibre_strain(self, e0, ky, kz):
        """Strain of every fibre, [..., n_fibre]."""
        e0, ky, kz = (jnp.asarray(v)[..., None] for v in (e0, ky, kz))
        shape = (1,) * (jnp.broadcast_shapes(e0.shape, ky.shape, kz.shape).__len__() - 1) + (-1,)
        return e0 + ky * self.z.reshape(shape) - kz * self.y.reshape(shape)

    def fibre_stress(self, e0, ky, kz, memory=None):
        """Stress of every fibre, ``s(e0 + ky z - kz y)``.

        Args:
            e0, ky, kz: strain at the axis and curvatures, arrays of one shape, -, 1/m, 1/m.
            memory: plastic strains of the fibres, as from `virgin`; needed where laws remember
                some.

        Returns:
            [..., n_fibre], Pa; zero beyond the end of a curve.

        Example:
            >>> section = jc.Section.rectangle(0.1, 0.2, jc.Elastic(200e9), shape=(1, 4))
            >>> stress = section.fibre_stress(0.0, 0.01, 0.0)  # 0.01/m about y: E ky z
            >>> print(jnp.round(stress / 1e6, 1))  # MPa
            [-150.  -50.   50.  150.]
        """
        return self._stress(self.fibre_strain(e0, ky, kz), memory)

    def _stress(self, strain, memory):
        each = self._each(strain, memory)
        return jnp.concatenate([law.stress_at(e, p) for law, e, p in each], axis=-1)

    def forces(self, e0, ky, kz, memory=None):
        """Axial force and bending moments.

        Args:
            e0, ky, kz: strain at the axis and curvatures, arrays of one shape, -, 1/m, 1/m.
            memory: plastic strains of the fibres, as from `virgin`, or None.

        Returns:
            ``N, My, Mz``, N, N m, N m. Fibres beyond their curve count zero.

        Example:
            A strain of 1e-4 and a curvature of 0.01/m in a rectangle whose EI is 13.3 MN m2:

            >>> section = jc.Section.rectangle(0.1, 0.2, jc.Elastic(200e9), shape=(10, 10))
            >>> N, My, Mz = section.forces(1e-4, 0.01, 0.0)
            >>> print(f"{N / 1e3:.1f} kN, {My / 1e3:.1f} kN m, {abs(Mz):.1f} N m")
            400.0 kN, 133.3 kN m, 0.0 N m
        """
        if self.is_elastic:
            strain = jnp.stack(jnp.broadcast_arrays(e0, ky, kz), axis=-1)
            return tuple(jnp.moveaxis(strain @ self.stiffness(), -1, 0))
        if memory is None and self.remembers:
            memory = self.virgin(jnp.shape(jnp.asarray(e0) + ky + kz))
        force = self.fibre_stress(e0, ky, kz, memory)
        return tuple(jnp.moveaxis(force @ (self.area[:, None] * self._levers()), -1, 0))

    def linearized(self, e0, ky, kz, memory=None):
        """Forces ``N, My, Mz``, [..., 3], and their tangent, [..., 3, 3], as of `forces`."""
        shape = jnp.shape(jnp.asarray(e0) + ky + kz)
        if self.is_elastic:
            force = jnp.stack(self.forces(e0, ky, kz), axis=-1)
            return force, jnp.broadcast_to(self.stiffness(), (*shape, 3, 3))
        if memory is None and self.remembers:
            memory = self.virgin(shape)
        strain = self.fibre_strain(e0, ky, kz)
        # a fibre's stress depends on its own strain only: one derivative along all of them at once
        stress, modulus = jax.jvp(
            lambda e: self._stress(e, memory), (strain,), (jnp.ones_like(strain),)
        )
        lever = self._levers()
        weighted = self.area[:, None] * lever
        outer = (weighted[:, :, None] * lever[:, None, :]).reshape(-1, 9)
        return stress @ weighted, (modulus @ outer).reshape(*shape, 3, 3)

    def size(self, e0, ky, kz, memory):
        """Sum of the absolute forces of all fibres and their parts, N."""
        strain = self.fibre_strain(e0, ky, kz)
        areas = [self.area[part] for part in self._parts()]
        each = self._each(strain, memory)
        return sum(law.size_at(e, p) @ a for a, (law, e, p) in zip(areas, each, strict=True))

    def energy(self, e0, ky, kz, memory=None):
        """Stored energy per length, J/m, at a given memory."""
        if self.is_elastic:
            strain = jnp.stack(jnp.broadcast_arrays(e0, ky, kz), axis=-1)
            return 0.5 * jnp.sum(strain * (strain @ self.stiffness()), axis=-1)
        strain = self.fibre_strain(e0, ky, kz)
        areas = [self.area[part] for part in self._parts()]
        if memory is None and self.remembers:
            memory = self.virgin(strain.shape[:-1])
        each = self._each(strain, memory)
        return sum(law.energy_at(e, p) @ a for a, (law, e, p) in zip(areas, each, strict=True))

    def settle(self, e0, ky, kz, memory, duration=0.0):
        """What it remembers after an increment of a duration, s, that ended at these strains."""
        each = self._each(self.fibre_strain(e0, ky, kz), memory)
        return tuple(None if p is None else law.settle(e, p, duration) for law, e, p in each)

    def beyond(self, e0, ky, kz):
        """Whether any fibre is beyond its curve."""
        each = self._each(self.fibre_strain(e0, ky, kz), None)
        return jnp.any(jnp.concatenate([law.beyond(e) for law, e, _ in each], axis=-1), axis=-1)

    def reduced(self):
        """The section as an analysis has it: a linear one without fibres, else `continued`."""
        if not self.is_elastic:
            return self.continued()
        torsion = None if self.torsion is None else self.torsional_stiffness()
        return Linear(self.stiffness(), torsion)

    def continued(self):
        """The section for an iteration: its laws go on beyond their ends."""
        return copy(self, laws=tuple(law.continued() for law in self.laws))

    def corner_distance(self, e0, ky, kz, memory=None):
        """Smallest distance in strain of any fibre from a corner of its law."""
        strain = self.fibre_strain(e0, ky, kz)
        if memory is None and self.remembers:
            memory = self.virgin(strain.shape[:-1])
        each = [law.corner_distance(e, p) for law, e, p in self._each(strain, memory)]
        return jnp.min(jnp.concatenate(each, axis=-1), axis=-1)

    # --- equilibrium of the section

    def strains(self, N, My, Mz, memory=None, tol=None, max_steps=100):
        """Strains from forces, by iteration to the equilibrium of the section.

        Forces of any shape are taken in turn. Differentiable by the implicit function theorem.

        Args:
            N, My, Mz: arrays of one shape, N, N m, N m.
            memory: plastic strains of the fibres, as from `virgin`: one state for all forces, or
                with the axes of the forces in front; None for an unused section.
            tol: largest residual relative to the sum of absolute fibre forces and the load; default
                64 eps.
            max_steps: iterations allowed.

        Returns:
            `SectionState`; its status is BEYOND_CAPACITY where the section cannot carry the forces.

        Example:
            Half of the 2 MN that it can carry is half of its strain of failure; and more than that:

            >>> law = jc.Polygonal([-1e-3, 0.0, 1e-3], [-100e6, 0.0, 100e6])
            >>> section = jc.Section.rectangle(0.1, 0.2, law, shape=(10, 10))
            >>> state = section.strains(N=1e6, My=0.0, Mz=0.0)
            >>> print(f"{jc.describe(state.status)}: {state.strain[0]:.6f}")
            converged: 0.000500
            >>> print(jc.describe(section.strains(N=3e6, My=0.0, Mz=0.0).status)[:37])
            the section cannot carry these forces
        """
        return strains.equilibrium(self, N, My, Mz, memory, tol, max_steps)

    def interaction(self, n_angle=24, n_axial=21):
        """Interaction surface N-My-Mz: where the first fibre reaches the end of its curve.

        Args:
            n_angle: directions of bending, evenly round.
            n_axial: ratios of elongation to curvature, from pure compression to pure tension.

        Returns:
            ``N, My, Mz``, [n_axial, n_angle] each, N, N m, N m; infinite where no fibre ever fails.

        Raises:
            ValueError: no law of the section has an end.

        Example:
            The largest axial forces of 20 000 mm2 that carries 100 MPa:

            >>> law = jc.Polygonal([-1e-3, 0.0, 1e-3], [-100e6, 0.0, 100e6])
            >>> section = jc.Section.rectangle(0.1, 0.2, law, shape=(10, 10))
            >>> N, My, Mz = section.interaction(n_angle=4, n_axial=3)  # [3, 4] each
            >>> print(f"{N[0, 0] / 1e6:.2f} MN, {N[-1, 0] / 1e6:.2f} MN")
            -2.00 MN, 2.00 MN
        """
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

    def _each(self, strain, memory):
        """Law, strain of its fibres and what they remember."""
        memory = (None,) * len(self.laws) if memory is None else memory
        parts = self._parts()
        return [
            (law, strain[..., part], p)
            for law, part, p in zip(self.laws, parts, memory, strict=True)
        ]
