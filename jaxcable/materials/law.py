"""What a uniaxial law is: stress from strain, and from the memory of earlier increments."""

from __future__ import annotations

import abc
from typing import TypeAlias

import jax.numpy as jnp
import numpy as np

from ..common.types import Array, ArrayLike, Bool, Float

Numbers: TypeAlias = 'Float[ArrayLike, "*shape"]'
"""Strains or stresses of fibres, as they are given."""
Values: TypeAlias = 'Float[Array, "*shape"]'
Remembered: TypeAlias = 'Float[Array, "... n_memory"]'
"""What a law remembers of each fibre."""
Memory: TypeAlias = "Remembered | None"
Pair: TypeAlias = 'tuple[Float[ArrayLike, ""], Float[ArrayLike, ""]]'


class Law(abc.ABC):
    """A uniaxial law: a pytree shared by the elements or fibres of a group.

    Its methods take arrays of any shape. ``memory`` has the numbers that the law remembers of each
    fibre, such as plastic strains, [..., n_memory]; it is None for a law without memory.

    Attributes:
        n_memory: how many numbers the law remembers of a fibre; 0 for a reversible law.
        breaks: whether the curve can end.
        rising: whether stress is known never to fall as strain grows: the energy is then convex.
            Such a law implements `softened`.
        worked_out: names of fields that the constructor computes and the user does not give.
    """

    worked_out: tuple[str, ...] = ()
    n_memory: int = 0
    breaks: bool = False
    rising: bool = False

    @property
    @abc.abstractmethod
    def modulus(self) -> Float[Array, ""]:
        """Slope at the origin, on the tension side, Pa."""

    @abc.abstractmethod
    def stress_at(self, strain: Numbers, memory: Memory = None) -> Values:
        """Stress, Pa; derivatives at corners are those of loading."""

    @abc.abstractmethod
    def energy_at(self, strain: Numbers, memory: Memory = None) -> Values:
        """Integral of the stress over strain, J/m3, by a formula that does not use `stress_at`."""

    @abc.abstractmethod
    def strain_at(self, stress: Numbers, memory: Memory = None) -> Values:
        """Strain at a stress, Pa, on the branch that rises from zero; NaN above its peak."""

    @property
    def capacity(self) -> Pair:
        """Smallest and largest stress, Pa."""
        return -jnp.inf, jnp.inf

    @property
    def limits(self) -> Pair:
        """Strains at which the curve ends."""
        return -jnp.inf, jnp.inf

    def beyond(self, strain: Numbers) -> Bool[Array, "*shape"]:
        """Whether `strain` is beyond an end of the curve."""
        low, high = self.limits
        return (strain > high) | (strain < low)

    def is_slack(self, strain: Numbers, memory: Memory = None) -> Bool[Array, "*shape"]:
        """Whether the law carries no stress because it has become too short."""
        return jnp.zeros(jnp.shape(strain), bool)

    def corners(self, memory: Memory = None) -> Float[ArrayLike, "... n_corner"]:
        """Strains at which the slope jumps, on the last axis."""
        return np.zeros(0)

    def corner_distance(self, strain: Numbers, memory: Memory = None) -> Values:
        """Distance in strain to the nearest corner."""
        strain, corners = jnp.asarray(strain), self.corners(memory)
        if corners.shape[-1] == 0:
            return jnp.full_like(strain, jnp.inf)
        if memory is None:
            corners = on_last_axis(corners, strain[..., None])
        return jnp.min(jnp.abs(strain[..., None] - corners), axis=-1)

    def size_at(self, strain: Numbers, memory: Memory) -> Values:
        """Sum of the absolute stresses of its parts, Pa: rounding errors are relative to it."""
        return jnp.abs(self.stress_at(strain, memory))

    def settle(
        self, strain: Numbers, memory: Remembered, duration: Float[ArrayLike, ""] = 0.0
    ) -> Remembered:
        """The memory after an increment of a duration, s, that ended at `strain`."""
        return memory

    def extended(self) -> Law:
        """The law for an iteration, which goes on elastically beyond its ends.

        An iteration may pass through strains beyond the ends; an equilibrium there is refused
        (`status.MATERIAL_FAILURE`).
        """
        return self

    def risen(self) -> Law:
        """A law that never falls, and is this one up to the first peak of its stress.

        An iteration begins with it: equilibria below the peaks of all elements are those of both.
        The law itself, where it is not known to fall.
        """
        return self

    def tension_only(self) -> Law:
        """The law without its compression branch.

        The law itself, unless a subclass says otherwise: the cable sets its stress to zero at
        negative strain.
        """
        return self

    def softened(self, compliance: Numbers) -> Law:
        """The law in series with a spring of `compliance`, strain per stress, 1/Pa."""
        raise NotImplementedError(f"{type(self).__name__} is not known in series with a spring")

    def falls(self) -> Float[ArrayLike, " n"] | None:
        """The stresses [n] of a curve that may fall, or None if the curve cannot fall."""
        return None


def on_last_axis(values: Float[Array, " n"], like: Values) -> Float[Array, "... n"]:
    """`values` [n], reshaped so that they broadcast along the last axis of `like`."""
    return values.reshape((1,) * (like.ndim - 1) + (-1,))


def uniaxial(law: object, name: str) -> None:
    """Raise ValueError unless `law` is a uniaxial law."""
    if isinstance(law, type):
        raise ValueError(f"{name}: the class {law.__name__} is not a law; call it with its numbers")
    if not isinstance(law, Law):
        raise ValueError(f"{name}: {type(law).__name__} is not a uniaxial law such as Elastic(E)")
