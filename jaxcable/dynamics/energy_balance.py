"""Energy of a motion: kinetic and stored, work of loads, what dampers dissipate, and the rest."""

from __future__ import annotations

import jax
import jax.numpy as jnp
import numpy as np

from ..common.tree import apply_numpy_or_jax, pytree
from ..common.types import Array, Float
from ..spaces.space import Forces
from .generalized_alpha import MotionState, displacement_in_body_axes, to_space_axes
from .inertial_system import InertialSystem


@pytree
class EnergyBalance:
    """Energies in a motion, and works since its start, of one time or of all, [...], J.

    Attributes:
        kinetic: kinetic energy.
        stored: energy stored in elements; with history variables the part that can be regained.
            That of elements that are removed is gone from then on.
        work: work of the loads since the start, by the mean of both ends of each step.
        dissipated: energy that dampers have dissipated since the start, likewise.
        total: kinetic and stored energy at the start; from a removal on such that `error` does not
            change by it.

    Example:
        A mass of 2 kg with 3 m/s on a bar of 8 kN/m, after a quarter of a period:

        >>> bar = jc.Bars([[0, 1]], axial_stiffness=8e3)
        >>> guide = jc.pinned([0]) + jc.restrained([1], "yz")
        >>> structure = jc.Structure([[0.0, 0, 0], [1.0, 0, 0]], bar, supports=guide)
        >>> times = {"dt": 2 * np.pi * np.sqrt(2.0 / 8e3) / 400, "steps": 100}
        >>> thrown = {"masses": 2.0, "velocity": [[0, 0, 0], [3.0, 0, 0]]}
        >>> moved = jc.dynamics.transient(structure, **times, **thrown)
        >>> energy = moved.energy
        >>> print(moved.status, *(f"{x:.3f}" for x in (energy.kinetic[0], energy.stored[-1])))
        0 9.000 9.000
    """

    kinetic: Float[Array, " ..."]
    stored: Float[Array, " ..."]
    work: Float[Array, " ..."]
    dissipated: Float[Array, " ..."]
    total: Float[Array, " ..."]

    @property
    def error(self) -> Float[Array, " ..."]:
        """Kinetic, stored and dissipated energy less work and the energy at the start, J.

        It is what the steps in time gain or lose, and minus what friction and plastic strains
        dissipate.
        """
        return self.kinetic + self.stored + self.dissipated - self.work - self.total

    @property
    def largest(self) -> Float[Array, " ..."]:
        """Largest energy of a motion, which `error` is compared with, J: of all times, not of one.

        It is the largest size of kinetic energy, change of stored energy since the start, and work
        of loads. What is stored in elements that are removed does not count. NaN if a step failed.
        """
        return apply_numpy_or_jax(
            lambda xp, *energies: _energy_sizes(xp, *energies).max(axis=-1),
            *(self.kinetic, self.stored, self.work, self.total),
        )

    def largest_so_far(self) -> Float[np.ndarray, " ..."]:
        """Return `largest` of the times up to each one, as NumPy array, [..., m], J.

        It stays as it is from the first step on that has failed, whose energies are NaN.
        """
        energies = map(np.asarray, (self.kinetic, self.stored, self.work, self.total))
        return np.fmax.accumulate(_energy_sizes(np, *energies), axis=-1)

    @classmethod
    def initial(cls, system: InertialSystem, state: MotionState) -> EnergyBalance:
        """Return the balance at the start of a motion."""
        kinetic, stored = kinetic_energy(system, state), system.stored_energy(state.motion)
        zero = jnp.zeros_like(kinetic)
        return cls(kinetic, stored, zero, zero, kinetic + stored)

    def go_on_from(self, begun: EnergyBalance) -> EnergyBalance:
        """Return this balance with the energies of `begun`, after a removal, and the same error."""
        total = begun.kinetic + begun.stored + self.dissipated - self.work - self.error
        return EnergyBalance(begun.kinetic, begun.stored, self.work, self.dissipated, total)

    def after_step(
        self,
        system: InertialSystem,
        ends: tuple[MotionState, MotionState],
        before: tuple[Forces, Forces],
        after: tuple[Forces, Forces],
        stored: Float[Array, ""],
    ) -> EnergyBalance:
        """Return the balance at the end of a step, with the works in it added.

        Args:
            system: the `InertialSystem` of the step.
            ends: `MotionState` at both ends.
            before, after: pairs of loads and damping forces on rows at both ends, N and N m.
            stored: energy stored at the end, J.
        """
        begin, end = ends
        space, at = system.space, (begin.motion, end.motion)
        moved = to_space_axes(space, end.motion, displacement_in_body_axes(space, *at))
        works = [0.5 * jnp.sum((a + b) * moved) for a, b in zip(before, after, strict=True)]
        kinetic = kinetic_energy(system, end)
        work, dissipated = self.work + works[0], self.dissipated + works[1]
        return EnergyBalance(kinetic, stored, work, dissipated, self.total)


def _energy_sizes(xp, kinetic, stored, work, total):
    """Return the largest size of the energies of `EnergyBalance.largest` at each time, [..., m], J.

    `xp` is NumPy or jax.numpy. It is NaN for steps that have failed.
    """
    # a removal changes the total by what it takes away
    change = stored - stored[..., :1] - (total - total[..., :1])
    return xp.abs(xp.stack([kinetic, change, work])).max(axis=0)


def kinetic_energy(system: InertialSystem, state: MotionState) -> Float[Array, ""]:
    """Return the kinetic energy of the whole structure, rotary inertia included, J."""
    own, velocity = system.inertia, state.velocity
    total = 0.5 * jnp.sum(own.nodal_mass * jnp.sum(velocity[:, :3] ** 2, axis=1))
    for group, blocks in zip(system.groups, own.masses, strict=True):
        n_end = blocks.shape[1] // 3
        at = velocity[group.links[:, :n_end], :3].reshape(len(blocks), -1)
        total = total + 0.5 * jnp.einsum("ei,eij,ej->", at, blocks, at)
    if own.rotary is None:
        return total
    spins = jax.vmap(lambda j, w: jnp.sum(w * (j @ w)))(own.rotary, velocity[:, 3:])
    return total + 0.5 * jnp.sum(spins)
