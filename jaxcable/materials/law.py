"""What a uniaxial law is: stress from strain, and from what earlier increments left."""

from __future__ import annotations

import abc

import jax.numpy as jnp

from ..common.types import Array, ArrayLike, Bool, Float


class Law(abc.ABC):
    """A uniaxial law: a pytree shared by the elements or fibres of a group.

    Its members take arrays of any shape. ``memory`` is what it remembers of each, such as
    plastic strains, [..., n_memory], None of a law that remembers nothing.

    Attributes:
        n_memory: how many numbers a fibre remembers; 0 of a reversible law.
        breaks: whether the curve can end.
        rising: whether stress is known not to fall with strain: the energy is then convex. Such a
            law gives `softened`.
        worked_out: names of fields that nobody states: the constructor puts them in.
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
    def stress_at(
        self, strain: Float[ArrayLike, "*shape"], memory: Float[Array, "... n_memory"] | None = None
    ) -> Float[Array, "*shape"]:
        """Stress, Pa; derivatives at corners are those of loading."""

    @abc.abstractmethod
    def energy_at(
        self, strain: Float[ArrayLike, "*shape"], memory: Float[Array, "... n_memory"] | None = None
    ) -> Float[Array, "*shape"]:
        """Stress integrated over strain, written apart from it, J/m3."""

    @abc.abstractmethod
    def strain_at(
        self, stress: Float[ArrayLike, "*shape"], memory: Float[Array, "... n_memory"] | None = None
    ) -> Float[Array, "*shape"]:
        """The inverse on the rising branch from zero; NaN above it."""

    @property
    def capacity(self) -> tuple[Float[ArrayLike, ""], Float[ArrayLike, ""]]:
        """Smallest and largest stress, Pa."""
        return -jnp.inf, jnp.inf

    @property
    def limits(self) -> tuple[Float[ArrayLike, ""], Float[ArrayLike, ""]]:
        """Strains at which the curve ends."""
        return -jnp.inf, jnp.inf

    def beyond(self, strain: Float[ArrayLike, "*shape"]) -> Bool[Array, "*shape"]:
        """Whether the curve has ended there."""
        low, high = self.limits
        return (strain > high) | (strain < low)

    def is_slack(
        self, strain: Float[ArrayLike, "*shape"], memory: Float[Array, "... n_memory"] | None = None
    ) -> Bool[Array, "*shape"]:
        """Whether it carries nothing because it is shorter than it was."""
        return jnp.zeros(jnp.shape(strain), bool)

    def corners(
        self, memory: Float[Array, "... n_memory"] | None = None
    ) -> Float[Array, "... n_corner"]:
        """Strains at which the slope jumps, on the last axis."""
        return jnp.zeros(0)

    def corner_distance(
        self, strain: Float[ArrayLike, "*shape"], memory: Float[Array, "... n_memory"] | None = None
    ) -> Float[Array, "*shape"]:
        """Distance in strain to the nearest corner."""
        return jnp.full_like(strain, jnp.inf)

    def size_at(
        self, strain: Float[ArrayLike, "*shape"], memory: Float[Array, "... n_memory"] | None
    ) -> Float[Array, "*shape"]:
        """Sum of the absolute stresses of its parts, Pa, which rounding is relative to."""
        return jnp.abs(self.stress_at(strain, memory))

    def settle(
        self,
        strain: Float[ArrayLike, "*shape"],
        memory: Float[Array, "... n_memory"],
        duration: Float[ArrayLike, ""] = 0.0,
    ) -> Float[Array, "... n_memory"]:
        """What it remembers after an increment of a duration, s, that ended at `strain`."""
        return memory

    def extended(self) -> Law:
        """The law for an iteration, which goes on elastically beyond its ends.

        So the way to an answer may lead through there; the answer itself may not
        (`status.MATERIAL_FAILURE`).
        """
        return self

    def tension_only(self) -> Law:
        """The law without its compression branch.

        Itself, where the strain says what is slack: the cable sees to that.
        """
        return self

    def softened(self, compliance: Float[ArrayLike, "*shape"]) -> Law:
        """The law in series with a spring, strain per stress, 1/Pa."""
        raise NotImplementedError(f"{type(self).__name__} is not known in series with a spring")

    def falls(self) -> Float[ArrayLike, " n"] | None:
        """The stresses [n] of a curve that may fall, or None of one that cannot."""
        return None


def uniaxial(law: object, name: str) -> None:
    """Raise ValueError unless `law` is a uniaxial law."""
    if isinstance(law, type):
        raise ValueError(f"{name}: the class {law.__name__} is not a law; call it with its numbers")
    if not isinstance(law, Law):
        raise ValueError(f"{name}: {type(law).__name__} is not a uniaxial law such as Elastic(E)")
