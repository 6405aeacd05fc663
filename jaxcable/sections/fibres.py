"""The fibres of a section at given strains: stresses, forces, energy and memory.

Plane sections: ``e = e0 + ky z - kz y`` with the section's axes y and z, hence
``N = sum s A``, ``My = sum s A z``, ``Mz = -sum s A y``. Fibre sums converge at second order in the
size of the fibres; where all laws are linear, the sums are exact integrals.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Sequence
from typing import Self, TypeAlias

import jax
import jax.numpy as jnp
import numpy as np

from ..common.tree import copy
from ..common.types import Array, ArrayLike, Bool, Float, Int
from ..materials import Elastic
from ..materials.law import Law, Numbers, Values

Memory: TypeAlias = "tuple[Float[Array, '... n_fibre n_memory'] | None, ...]"
"""Memory of the fibres, an array for each law of a section; None for a law without memory."""
Forces: TypeAlias = "tuple[Values, Values, Values]"
"""Axial force and moments about y and z, ``N, My, Mz``."""


@dataclasses.dataclass(frozen=True, eq=False, repr=False)
class Fibres:
    """The law of a section from its fibres; `section.Section` says what its fields are."""

    y: Float[ArrayLike, " n_fibre"]
    z: Float[ArrayLike, " n_fibre"]
    area: Float[ArrayLike, " n_fibre"]
    laws: Sequence[Law]
    counts: tuple[int, ...] = None  # type: ignore[assignment]  # set by the constructor
    torsion: Float[ArrayLike, " n_law"] | None = None
    points: Float[ArrayLike, "n_point 2"] | None = None
    cells: Int[ArrayLike, "n_fibre 4"] | None = None
    own: Float[ArrayLike, "n_fibre 3"] | None = None
    placed: bool = True

    @property
    def n_fibre(self) -> int:
        """Number of fibres."""
        return len(self.y)

    @property
    def is_elastic(self) -> bool:
        """Whether all its laws are linear; a 3 x 3 stiffness then describes the section."""
        return all(isinstance(law, Elastic) for law in self.laws)

    @property
    def breaks(self) -> bool:
        """Whether a fibre can fail."""
        return any(law.breaks for law in self.laws)

    @property
    def remembers(self) -> bool:
        """Whether a law of the section has a memory."""
        return any(law.n_memory for law in self.laws)

    def stiffness(self) -> Float[Array, "3 3"]:
        """Initial stiffness, N, N m and N m2: forces per (e0, ky, kz), [3, 3].

        Exact if all laws are linear. Otherwise the sum over the fibres as points, as in `forces`,
        with an error of second order in their size (1 % below a rectangle for ten layers).

        Example:
            >>> section = jc.Section.rectangle(0.1, 0.2, jc.Elastic(200e9), shape=(10, 10))
            >>> EA, EIy, EIz = jnp.diagonal(section.stiffness()) / 1e6
            >>> print(f"{EA:.0f} MN, {EIy:.2f} MN m2, {EIz:.2f} MN m2")
            4000 MN, 13.33 MN m2, 3.33 MN m2
        """
        return _stiffness(self)

    def initial_memory(self, shape: tuple[int, ...] = ()) -> Memory:
        """Memory of an unused section, per law [*shape, n_fibre, n_memory] or None."""
        dtype = jnp.asarray(self.area).dtype
        return tuple(
            jnp.zeros((*shape, count, law.n_memory), dtype) if law.n_memory else None
            for law, count in zip(self.laws, self.counts, strict=True)
        )

    def fibre_strain(self, e0: Numbers, ky: Numbers, kz: Numbers) -> Float[Array, "*shape n_fibre"]:
        """Strain of every fibre, [..., n_fibre]."""
        e0, ky, kz = (jnp.asarray(v)[..., None] for v in (e0, ky, kz))
        shape = (1,) * (jnp.broadcast_shapes(e0.shape, ky.shape, kz.shape).__len__() - 1) + (-1,)
        return e0 + ky * self.z.reshape(shape) - kz * self.y.reshape(shape)

    def fibre_stress(
        self, e0: Numbers, ky: Numbers, kz: Numbers, memory: Memory | None = None
    ) -> Float[Array, "*shape n_fibre"]:
        """Stress of every fibre, ``s(e0 + ky z - kz y)``.

        Args:
            e0, ky, kz: strain at the axis and curvatures, arrays of one shape, -, 1/m, 1/m.
            memory: of the fibres, as from `initial_memory`; None for an unused section.

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
        return jnp.concatenate(
            [law.stress_at(e, remembered) for law, e, remembered in each], axis=-1
        )

    def forces(self, e0: Numbers, ky: Numbers, kz: Numbers, memory: Memory | None = None) -> Forces:
        """Axial force and bending moments.

        Args:
            e0, ky, kz: strain at the axis and curvatures, arrays of one shape, -, 1/m, 1/m.
            memory: of the fibres, as from `initial_memory`; None for an unused section.

        Returns:
            ``N, My, Mz``, N, N m, N m. Fibres beyond the end of their curve carry nothing.

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
        force = self.fibre_stress(e0, ky, kz, memory)
        return tuple(jnp.moveaxis(force @ (self.area[:, None] * self._levers()), -1, 0))

    def linearized(
        self, e0: Numbers, ky: Numbers, kz: Numbers, memory: Memory | None = None
    ) -> tuple[Float[Array, "*shape 3"], Float[Array, "*shape 3 3"]]:
        """Forces ``N, My, Mz``, [..., 3], and their tangent, [..., 3, 3]; arguments as `forces`."""
        shape = jnp.shape(jnp.asarray(e0) + ky + kz)
        if self.is_elastic:
            force = jnp.stack(self.forces(e0, ky, kz), axis=-1)
            return force, jnp.broadcast_to(self.stiffness(), (*shape, 3, 3))
        strain = self.fibre_strain(e0, ky, kz)
        # The stress of a fibre depends on no other fibre's strain: a single directional derivative
        # along ones gives the moduli of all fibres.
        stress, modulus = jax.jvp(
            lambda e: self._stress(e, memory), (strain,), (jnp.ones_like(strain),)
        )
        lever = self._levers()
        weighted = self.area[:, None] * lever
        outer = (weighted[:, :, None] * lever[:, None, :]).reshape(-1, 9)
        return stress @ weighted, (modulus @ outer).reshape(*shape, 3, 3)

    def size(self, e0: Numbers, ky: Numbers, kz: Numbers, memory: Memory | None) -> Values:
        """Sum of the absolute forces of all fibres, and of parallel parts in them, N."""
        return self._times_area("size_at", self.fibre_strain(e0, ky, kz), memory)

    def energy(self, e0: Numbers, ky: Numbers, kz: Numbers, memory: Memory | None = None) -> Values:
        """Stored energy per length, J/m, at a given memory."""
        if self.is_elastic:
            strain = jnp.stack(jnp.broadcast_arrays(e0, ky, kz), axis=-1)
            return 0.5 * jnp.sum(strain * (strain @ self.stiffness()), axis=-1)
        return self._times_area("energy_at", self.fibre_strain(e0, ky, kz), memory)

    def settle(
        self,
        e0: Numbers,
        ky: Numbers,
        kz: Numbers,
        memory: Memory,
        duration: Float[ArrayLike, ""] = 0.0,
    ) -> Memory:
        """The memory after an increment of a duration, s, that ended at these strains."""
        each = self._each(self.fibre_strain(e0, ky, kz), memory)
        return tuple(
            None if remembered is None else law.settle(e, remembered, duration)
            for law, e, remembered in each
        )

    def beyond(self, e0: Numbers, ky: Numbers, kz: Numbers) -> Bool[Array, "*shape"]:
        """Whether any fibre is beyond the end of its curve."""
        strain, pairs = self.fibre_strain(e0, ky, kz), zip(self.laws, self._parts(), strict=True)
        return jnp.any(jnp.concatenate([law.beyond(strain[..., p]) for law, p in pairs], -1), -1)

    def extended(self) -> Self:
        """The section for an iteration: its laws go on elastically beyond their ends."""
        return copy(self, laws=tuple(law.extended() for law in self.laws))

    def corner_distance(
        self, e0: Numbers, ky: Numbers, kz: Numbers, memory: Memory | None = None
    ) -> Values:
        """Smallest distance in strain of any fibre from a corner of its law."""
        each = self._each(self.fibre_strain(e0, ky, kz), memory)
        distances = [law.corner_distance(e, remembered) for law, e, remembered in each]
        return jnp.min(jnp.concatenate(distances, axis=-1), axis=-1)

    # --- helpers

    def _levers(self):
        """Contribution of a unit force in each fibre to N, My, Mz, [n_fibre, 3]."""
        return jnp.stack([jnp.ones_like(self.y), self.z, -self.y], axis=-1)

    def _parts(self):
        """Slices of the fibres of each law."""
        ends = np.cumsum(self.counts)
        return [slice(int(e) - n, int(e)) for e, n in zip(ends, self.counts, strict=True)]

    def _per_fibre(self, values):
        """Values of the laws, given to their fibres, [n_fibre]."""
        return jnp.concatenate(
            [jnp.full(n, v) for n, v in zip(self.counts, values, strict=True)]
        ).astype(jnp.asarray(self.y).dtype)

    def _each(self, strain, memory):
        """For each law: the law, the strain of its fibres, and their memory or None.

        Without `memory` it is that of an unused section.
        """
        memory = self.initial_memory(strain.shape[:-1]) if memory is None else memory
        return [
            (law, strain[..., part], remembered)
            for law, part, remembered in zip(self.laws, self._parts(), memory, strict=True)
        ]

    def _times_area(self, name, strain, memory):
        """Sum over the fibres of their areas times a method of their law, by its name."""
        return sum(
            getattr(law, name)(e, remembered) @ self.area[part]
            for part, (law, e, remembered) in zip(
                self._parts(), self._each(strain, memory), strict=True
            )
        )


@jax.jit
def _stiffness(section):
    """Initial stiffness, see `Fibres.stiffness`."""
    lever = section._levers()
    modulus = section._per_fibre([law.modulus for law in section.laws])
    total = lever.T @ ((section.area * modulus)[:, None] * lever)
    if section.own is None or not section.is_elastic:
        return total
    z2, y2, yz = modulus @ section.own
    zero = jnp.zeros_like(z2)
    bending = [[zero, zero, zero], [zero, z2, -yz], [zero, -yz, y2]]
    return total + jnp.stack([jnp.stack(line) for line in bending])
