"""The fibres of a section at given strains: stresses, forces, energy and history variables.

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

from ..common.tree import copy_with
from ..common.types import Array, ArrayLike, Bool, Float, Int
from ..materials import Elastic
from ..materials.law import Law, Numbers, Values
from ..programs.program_calls import as_program

FibreMemory: TypeAlias = "tuple[Float[Array, '... n_fibre n_memory'] | None, ...]"
"""History variables of the fibres, an array for each law of a section; None for a law without."""
SectionForces: TypeAlias = "tuple[Values, Values, Values]"
"""Axial force and moments about y and z, ``N, My, Mz``."""


@dataclasses.dataclass(frozen=True, eq=False, repr=False)
class Fibres:
    """Forces, stiffness and history of a section from its fibres; base class of `Section`.

    The fields are described at `section.Section`.
    """

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
    GAy: Float[ArrayLike, ""] | None = None
    GAz: Float[ArrayLike, ""] | None = None

    @property
    def n_fibre(self) -> int:
        """Number of fibres."""
        return len(self.y)

    @property
    def is_elastic(self) -> bool:
        """Whether all laws of the section are linear, so that a 3 x 3 stiffness describes it."""
        return all(isinstance(law, Elastic) for law in self.laws)

    @property
    def has_rupture(self) -> bool:
        """Whether a law of the section has a rupture strain."""
        return any(law.has_rupture for law in self.laws)

    @property
    def has_memory(self) -> bool:
        """Whether a law of the section has history variables."""
        return any(law.n_memory for law in self.laws)

    def stiffness(self) -> Float[Array, "3 3"]:
        """Return the initial stiffness: derivative of (N, My, Mz) by (e0, ky, kz), [3, 3].

        In N, N m and N m2. Exact if all laws are linear. Otherwise the sum over the fibres as
        points, as in `forces`, with an error of second order in their size (1 % below that of a
        rectangle for ten layers).

        Example:
            >>> section = jc.Section.rectangle(0.1, 0.2, jc.Elastic(200e9), shape=(10, 10))
            >>> EA, EIy, EIz = jnp.diagonal(section.stiffness()) / 1e6
            >>> print(f"{EA:.0f} MN, {EIy:.2f} MN m2, {EIz:.2f} MN m2")
            4000 MN, 13.33 MN m2, 3.33 MN m2
        """
        return _initial_stiffness(self)

    def initial_memory(self, shape: tuple[int, ...] = ()) -> FibreMemory:
        """Return the history variables of a section that has not been strained yet.

        Args:
            shape: axes in front of those of the fibres, such as those of elements.

        Returns:
            For each law [*shape, n_fibre, n_memory], or None for a law without history variables.
        """
        dtype = jnp.asarray(self.area).dtype
        return tuple(
            jnp.zeros((*shape, count, law.n_memory), dtype) if law.n_memory else None
            for law, count in zip(self.laws, self.counts, strict=True)
        )

    def fibre_strain(self, e0: Numbers, ky: Numbers, kz: Numbers) -> Float[Array, "*shape n_fibre"]:
        """Return the strain of every fibre, ``e0 + ky z - kz y``, [..., n_fibre].

        `e0` is the strain at the axis, `ky` and `kz` are curvatures, 1/m, arrays of one shape.
        """
        e0, ky, kz = (jnp.asarray(v)[..., None] for v in (e0, ky, kz))
        shape = (1,) * (jnp.broadcast_shapes(e0.shape, ky.shape, kz.shape).__len__() - 1) + (-1,)
        return e0 + ky * self.z.reshape(shape) - kz * self.y.reshape(shape)

    def fibre_stress(
        self, e0: Numbers, ky: Numbers, kz: Numbers, memory: FibreMemory | None = None
    ) -> Float[Array, "*shape n_fibre"]:
        """Return the stress of every fibre at the strain ``e0 + ky z - kz y``.

        Args:
            e0, ky, kz: strain at the axis and curvatures, arrays of one shape, -, 1/m, 1/m.
            memory: history variables, as from `initial_memory`; None if not strained yet.

        Returns:
            [..., n_fibre], Pa; zero beyond the rupture strain of a fibre.

        Example:
            >>> section = jc.Section.rectangle(0.1, 0.2, jc.Elastic(200e9), shape=(1, 4))
            >>> stress = section.fibre_stress(0.0, 0.01, 0.0)  # 0.01/m about y: E ky z
            >>> print(jnp.round(stress / 1e6, 1))  # MPa
            [-150.  -50.   50.  150.]
        """
        return self._stress_of_fibres(self.fibre_strain(e0, ky, kz), memory)

    def _stress_of_fibres(self, strain, memory):
        """Return the stress of every fibre from its strain, both [..., n_fibre], Pa."""
        each = self._fibres_by_law(strain, memory)
        return jnp.concatenate(
            [law.stress_at(e, remembered) for law, e, remembered in each], axis=-1
        )

    def forces(
        self, e0: Numbers, ky: Numbers, kz: Numbers, memory: FibreMemory | None = None
    ) -> SectionForces:
        """Return axial force and bending moments at given strains.

        Args:
            e0, ky, kz: strain at the axis and curvatures, arrays of one shape, -, 1/m, 1/m.
            memory: history variables, as from `initial_memory`; None if not strained yet.

        Returns:
            ``N, My, Mz``, N, N m, N m. Fibres beyond their rupture strain carry nothing.

        Example:
            A strain of 1e-4 and a curvature of 0.01/m in a rectangle whose EI is 13.3 MN m2:

            >>> section = jc.Section.rectangle(0.1, 0.2, jc.Elastic(200e9), shape=(10, 10))
            >>> N, My, Mz = section.forces(1e-4, 0.01, 0.0)
            >>> print(f"{N / 1e3:.1f} kN, {My / 1e3:.1f} kN m, {abs(Mz):.1f} N m")
            400.0 kN, 133.3 kN m, 0.0 N m
        """
        return _section_forces(self, e0, ky, kz, memory)

    def forces_and_tangent(
        self, e0: Numbers, ky: Numbers, kz: Numbers, memory: FibreMemory | None = None
    ) -> tuple[Float[Array, "*shape 3"], Float[Array, "*shape 3 3"]]:
        """Return forces and their tangent by (e0, ky, kz); arguments as for `forces`.

        Returns:
            ``(N, My, Mz)``, [..., 3], and its derivative, [..., 3, 3].
        """
        shape = jnp.shape(jnp.asarray(e0) + ky + kz)
        if self.is_elastic:
            force = jnp.stack(self.forces(e0, ky, kz), axis=-1)
            return force, jnp.broadcast_to(self.stiffness(), (*shape, 3, 3))
        strain = self.fibre_strain(e0, ky, kz)
        # The stress of a fibre depends on no other fibre's strain: a single directional derivative
        # along ones gives the moduli of all fibres.
        stress, modulus = jax.jvp(
            lambda e: self._stress_of_fibres(e, memory), (strain,), (jnp.ones_like(strain),)
        )
        lever = self._lever_arms()
        weighted = self.area[:, None] * lever
        outer = (weighted[:, :, None] * lever[:, None, :]).reshape(-1, 9)
        return stress @ weighted, (modulus @ outer).reshape(*shape, 3, 3)

    def absolute_force(
        self, e0: Numbers, ky: Numbers, kz: Numbers, memory: FibreMemory | None
    ) -> Values:
        """Return the sum of the absolute forces of all fibres, N: the scale of rounding errors.

        Laws in parallel within a fibre count one by one.
        """
        return self._integrate_over_area(
            _absolute_stress_of_law, self.fibre_strain(e0, ky, kz), memory
        )

    def energy(
        self, e0: Numbers, ky: Numbers, kz: Numbers, memory: FibreMemory | None = None
    ) -> Values:
        """Return the stored energy per length, J/m; arguments as for `forces`."""
        if self.is_elastic:
            strain = jnp.stack(jnp.broadcast_arrays(e0, ky, kz), axis=-1)
            return 0.5 * jnp.sum(strain * (strain @ self.stiffness()), axis=-1)
        return self._integrate_over_area(_energy_of_law, self.fibre_strain(e0, ky, kz), memory)

    def commit_memory(
        self,
        e0: Numbers,
        ky: Numbers,
        kz: Numbers,
        memory: FibreMemory,
        duration: Float[ArrayLike, ""] = 0.0,
    ) -> FibreMemory:
        """Return the history variables after an increment that ended at these strains (commit).

        Args:
            e0, ky, kz: strain at the axis and curvatures at the end of the increment.
            memory: history variables before it.
            duration: of the increment, s.
        """
        each = self._fibres_by_law(self.fibre_strain(e0, ky, kz), memory)
        return tuple(
            None if remembered is None else law.commit_memory(e, remembered, duration)
            for law, e, remembered in each
        )

    def is_ruptured(self, e0: Numbers, ky: Numbers, kz: Numbers) -> Bool[Array, "*shape"]:
        """Return whether any fibre is beyond its rupture strain, [...] bool, at given strains."""
        strain, pairs = (
            self.fibre_strain(e0, ky, kz),
            zip(self.laws, self._law_slices(), strict=True),
        )
        return jnp.any(
            jnp.concatenate([law.is_ruptured(strain[..., p]) for law, p in pairs], -1), -1
        )

    def extrapolated(self) -> Self:
        """Return the section with laws continued elastically beyond rupture, for an iteration."""
        return copy_with(self, laws=tuple(law.extrapolated() for law in self.laws))

    def corner_distance(
        self, e0: Numbers, ky: Numbers, kz: Numbers, memory: FibreMemory | None = None
    ) -> Values:
        """Return the smallest distance of a fibre's strain from a corner of its law, [...].

        At a corner the tangent jumps.
        """
        each = self._fibres_by_law(self.fibre_strain(e0, ky, kz), memory)
        distances = [law.corner_distance(e, remembered) for law, e, remembered in each]
        return jnp.min(jnp.concatenate(distances, axis=-1), axis=-1)

    # --- helpers

    def _lever_arms(self):
        """Return lever arms ``1, z, -y`` of the fibres for N, My, Mz, [n_fibre, 3]."""
        return jnp.stack([jnp.ones_like(self.y), self.z, -self.y], axis=-1)

    def _law_slices(self):
        """Return a list with the slice of each law's fibres in arrays of all fibres."""
        ends = np.cumsum(self.counts)
        return [slice(int(e) - n, int(e)) for e, n in zip(ends, self.counts, strict=True)]

    def _repeat_per_fibre(self, values):
        """Return an array [n_fibre] from one value for each law, repeated for its fibres."""
        return jnp.concatenate(
            [jnp.full(n, v) for n, v in zip(self.counts, values, strict=True)]
        ).astype(jnp.asarray(self.y).dtype)

    def _fibres_by_law(self, strain, memory):
        """Return for each law: the law, the strains of its fibres, and their history variables.

        The latter are None for a law without any, and zero if `memory` is None.
        """
        memory = self.initial_memory(strain.shape[:-1]) if memory is None else memory
        return [
            (law, strain[..., part], remembered)
            for law, part, remembered in zip(self.laws, self._law_slices(), memory, strict=True)
        ]

    def _integrate_over_area(self, of_law, strain, memory):
        """Return the sum over fibres of their area times ``of_law(law, strain, memory)``, [...].

        `strain` is that of every fibre, [..., n_fibre]; `memory` as for `forces`.
        """
        return sum(
            of_law(law, e, remembered) @ self.area[part]
            for part, (law, e, remembered) in zip(
                self._law_slices(), self._fibres_by_law(strain, memory), strict=True
            )
        )


def _absolute_stress_of_law(law, strain, memory):
    """Return the sum of absolute stresses in parts of a law, Pa (`Law.stress_scale_at`)."""
    return law.stress_scale_at(strain, memory)


def _energy_of_law(law, strain, memory):
    """Return the stored energy of a law per volume, J/m3 (`Law.energy_at`)."""
    return law.energy_at(strain, memory)


@as_program
def _section_forces(section, e0, ky, kz, memory):
    """Return ``N, My, Mz`` of a section at given strains; a program.

    Arguments and results are those of `Fibres.forces`.
    """
    if section.is_elastic:
        strain = jnp.stack(jnp.broadcast_arrays(e0, ky, kz), axis=-1)
        return tuple(jnp.moveaxis(strain @ section.stiffness(), -1, 0))
    force = section.fibre_stress(e0, ky, kz, memory)
    return tuple(jnp.moveaxis(force @ (section.area[:, None] * section._lever_arms()), -1, 0))


@as_program
def _initial_stiffness(section):
    """Return the initial stiffness of a section, [3, 3]: `Fibres.stiffness`, a program."""
    lever = section._lever_arms()
    modulus = section._repeat_per_fibre([law.modulus for law in section.laws])
    total = lever.T @ ((section.area * modulus)[:, None] * lever)
    if section.own is None or not section.is_elastic:
        return total
    z2, y2, yz = modulus @ section.own
    zero = jnp.zeros_like(z2)
    bending = [[zero, zero, zero], [zero, z2, -yz], [zero, -yz, y2]]
    return total + jnp.stack([jnp.stack(line) for line in bending])
