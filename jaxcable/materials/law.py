"""Contract of a uniaxial law: stress from strain and history variables (its memory)."""

from __future__ import annotations

import abc
from typing import TypeAlias

import jax.numpy as jnp
import numpy as np

from ..common.types import Array, ArrayLike, Bool, Float

Numbers: TypeAlias = 'Float[ArrayLike, "*shape"]'
"""Strains or stresses of fibres, as they are given."""
Values: TypeAlias = 'Float[Array, "*shape"]'
HistoryVariables: TypeAlias = 'Float[Array, "... n_memory"]'
"""History variables of each fibre."""
Memory: TypeAlias = "HistoryVariables | None"
Pair: TypeAlias = 'tuple[Float[ArrayLike, ""], Float[ArrayLike, ""]]'


class Law(abc.ABC):
    """A uniaxial law: a pytree that the elements or fibres of a group share.

    Its methods take arrays of any shape. ``memory`` holds the history variables of each fibre, such
    as plastic strains, [..., n_memory]; it is None for a law without history.

    Attributes:
        n_memory: number of history variables of a fibre; 0 for a reversible law.
        has_rupture: whether the curve can end (rupture).
        monotone: whether stress is known never to fall as strain grows (no softening): the energy
            is then convex. Such a law implements `in_series_with_spring`.
        worked_out: names of fields that the constructor computes and the user does not give.
    """

    worked_out: tuple[str, ...] = ()
    n_memory: int = 0
    has_rupture: bool = False
    monotone: bool = False

    @property
    @abc.abstractmethod
    def modulus(self) -> Float[Array, ""]:
        """Slope of the stress-strain curve at the origin, on the tension side, Pa."""

    @abc.abstractmethod
    def stress_at(self, strain: Numbers, memory: Memory = None) -> Values:
        """Return the stress at `strain`, Pa; its derivative at a corner is that of loading."""

    @abc.abstractmethod
    def energy_at(self, strain: Numbers, memory: Memory = None) -> Values:
        """Return the strain energy per unstressed volume, J/m3.

        Its derivative by the strain, at constant history variables `memory`, is the stress; without
        history variables it is zero at zero strain. A law states it as a formula of its own.
        """

    @abc.abstractmethod
    def strain_at(self, stress: Numbers, memory: Memory = None) -> Values:
        """Return the strain at a stress, Pa, on the rising branch from zero; NaN above its peak."""

    @property
    def capacity(self) -> Pair:
        """Smallest and largest stress that the law reaches, Pa; infinite by default."""
        return -jnp.inf, jnp.inf

    @property
    def strain_limits(self) -> Pair:
        """Smallest and largest strain of the curve, beyond which the material is ruptured."""
        return -jnp.inf, jnp.inf

    def is_ruptured(self, strain: Numbers) -> Bool[Array, "*shape"]:
        """Return whether `strain` is beyond an end of the curve, where the material is ruptured."""
        low, high = self.strain_limits
        return (strain > high) | (strain < low)

    def is_slack(self, strain: Numbers, memory: Memory = None) -> Bool[Array, "*shape"]:
        """Return whether the material would be compressed at `strain`, but carries tension only."""
        return jnp.zeros(jnp.shape(strain), bool)

    def corner_strains(self, memory: Memory = None) -> Float[ArrayLike, "... n_corner"]:
        """Return the strains at which the slope of the curve jumps, on the last axis."""
        return np.zeros(0)

    def corner_distance(self, strain: Numbers, memory: Memory = None) -> Values:
        """Return the distance from `strain` to the nearest corner strain; infinite without one."""
        strain, corners = jnp.asarray(strain), self.corner_strains(memory)
        if corners.shape[-1] == 0:
            return jnp.full_like(strain, jnp.inf)
        if memory is None:
            corners = broadcast_on_last_axis(corners, strain[..., None])
        return jnp.min(jnp.abs(strain[..., None] - corners), axis=-1)

    def stress_scale_at(self, strain: Numbers, memory: Memory) -> Values:
        """Return the scale of rounding errors of the stress, Pa: the default is its absolute value.

        A law whose stress is a sum of parallel parts, which can cancel each other, returns the sum
        of their absolute values.
        """
        return jnp.abs(self.stress_at(strain, memory))

    def commit_memory(
        self, strain: Numbers, memory: HistoryVariables, duration: Float[ArrayLike, ""] = 0.0
    ) -> HistoryVariables:
        """Return the history variables after an increment that ended at `strain` (commit).

        `memory` are those before the increment, `duration` is its duration, s.
        """
        return memory

    def extrapolated(self) -> Law:
        """Return the law continued elastically beyond rupture, with which iterations work.

        An iteration may pass through strains beyond rupture; an equilibrium there is refused
        (`status.MATERIAL_FAILURE`).
        """
        return self

    def without_softening(self) -> Law:
        """Return the law without softening: this one up to its first peak, then never falling.

        An iteration begins with it: equilibria below the peaks of all elements are those of both
        laws. The default, for laws that do not soften, is the law itself.
        """
        return self

    def tension_only(self) -> Law:
        """Return the law without its compression branch, for a cable.

        The law itself, unless a subclass says otherwise: the cable sets its stress to zero at
        negative strain.
        """
        return self

    def in_series_with_spring(self, compliance: Numbers) -> Law:
        """Return the law in series with a spring of `compliance`, strain per stress, 1/Pa."""
        raise NotImplementedError(f"{type(self).__name__} is not known in series with a spring")

    def softening_stresses(self) -> Float[ArrayLike, " n"] | None:
        """Return stresses along a curve that may fall (soften), [n]; None if it cannot fall."""
        return None


def broadcast_on_last_axis(values: Float[Array, " n"], like: Values) -> Float[Array, "... n"]:
    """Reshape `values`, [n], so that they broadcast along the last axis of `like`."""
    return values.reshape((1,) * (like.ndim - 1) + (-1,))


def require_law(law: object, name: str) -> None:
    """Raise ValueError, with the argument's `name`, unless `law` is a uniaxial law."""
    if isinstance(law, type):
        raise ValueError(f"{name}: the class {law.__name__} is not a law; call it with its numbers")
    if not isinstance(law, Law):
        raise ValueError(f"{name}: {type(law).__name__} is not a uniaxial law such as Elastic(E)")
