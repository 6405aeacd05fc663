"""Contract of a uniaxial law: stress from strain and history variables (its memory)."""

from __future__ import annotations

import abc
from typing import TypeAlias

import jax.numpy as jnp
import numpy as np

from ..common.old_names import LAW, refuse_old_names
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

    def __init_subclass__(cls, **options: object):
        super().__init_subclass__(**options)
        refuse_old_names(cls, LAW)

    @property
    @abc.abstractmethod
    def modulus(self) -> Float[Array, ""]:
        """Slope at the origin, on the tension side, Pa."""

    @abc.abstractmethod
    def stress_at(self, strain: Numbers, memory: Memory = None) -> Values:
        """Return the stress, Pa; derivatives at corners are those of loading."""

    @abc.abstractmethod
    def energy_at(self, strain: Numbers, memory: Memory = None) -> Values:
        """Return the integral of the stress, J/m3, by a formula that does not use `stress_at`."""

    @abc.abstractmethod
    def strain_at(self, stress: Numbers, memory: Memory = None) -> Values:
        """Return the strain at a stress, Pa, on the rising branch from zero; NaN above its peak."""

    @property
    def capacity(self) -> Pair:
        """Smallest and largest stress, Pa."""
        return -jnp.inf, jnp.inf

    @property
    def strain_limits(self) -> Pair:
        """Strains at which the curve ends (rupture), smallest and largest."""
        return -jnp.inf, jnp.inf

    def is_ruptured(self, strain: Numbers) -> Bool[Array, "*shape"]:
        """Return whether `strain` is beyond an end of the curve, where the material is ruptured."""
        low, high = self.strain_limits
        return (strain > high) | (strain < low)

    def is_slack(self, strain: Numbers, memory: Memory = None) -> Bool[Array, "*shape"]:
        """Return whether the law carries no stress because it has become too short."""
        return jnp.zeros(jnp.shape(strain), bool)

    def corner_strains(self, memory: Memory = None) -> Float[ArrayLike, "... n_corner"]:
        """Return the strains at which the slope jumps, on the last axis."""
        return np.zeros(0)

    def corner_distance(self, strain: Numbers, memory: Memory = None) -> Values:
        """Return the distance in strain to the nearest corner."""
        strain, corners = jnp.asarray(strain), self.corner_strains(memory)
        if corners.shape[-1] == 0:
            return jnp.full_like(strain, jnp.inf)
        if memory is None:
            corners = broadcast_on_last_axis(corners, strain[..., None])
        return jnp.min(jnp.abs(strain[..., None] - corners), axis=-1)

    def stress_scale_at(self, strain: Numbers, memory: Memory) -> Values:
        """Return the sum of absolute stresses of its parts, Pa: rounding is relative to it."""
        return jnp.abs(self.stress_at(strain, memory))

    def commit_memory(
        self, strain: Numbers, memory: HistoryVariables, duration: Float[ArrayLike, ""] = 0.0
    ) -> HistoryVariables:
        """Commit the history variables: return them after an increment that ended at `strain`.

        `duration` is that of the increment, s.
        """
        return memory

    def extrapolated(self) -> Law:
        """Return the law for an iteration, which goes on elastically beyond its ends.

        An iteration may pass through strains beyond the ends; an equilibrium there is refused
        (`status.MATERIAL_FAILURE`).
        """
        return self

    def without_softening(self) -> Law:
        """Return the law without softening: this one up to its first peak, then never falling.

        An iteration begins with it: equilibria below the peaks of all elements are those of both
        laws. It is the law itself where that is not known to soften.
        """
        return self

    def tension_only(self) -> Law:
        """Return the law without its compression branch.

        The law itself, unless a subclass says otherwise: the cable sets its stress to zero at
        negative strain.
        """
        return self

    def in_series_with_spring(self, compliance: Numbers) -> Law:
        """Return the law in series with a spring of `compliance`, strain per stress, 1/Pa."""
        raise NotImplementedError(f"{type(self).__name__} is not known in series with a spring")

    def softening_stresses(self) -> Float[ArrayLike, " n"] | None:
        """Return the stresses [n] of a curve that may fall (soften); None if it cannot fall."""
        return None


def broadcast_on_last_axis(values: Float[Array, " n"], like: Values) -> Float[Array, "... n"]:
    """Reshape `values`, [n], so that they broadcast along the last axis of `like`."""
    return values.reshape((1,) * (like.ndim - 1) + (-1,))


def require_law(law: object, name: str) -> None:
    """Raise ValueError unless `law` is a uniaxial law."""
    if isinstance(law, type):
        raise ValueError(f"{name}: the class {law.__name__} is not a law; call it with its numbers")
    if not isinstance(law, Law):
        raise ValueError(f"{name}: {type(law).__name__} is not a uniaxial law such as Elastic(E)")
