"""Several laws side by side at one strain: the axial law of a composite section.

All laws together may be in series with one spring. They may also be the law of a cable, which goes
slack as a whole: where the sum of their stresses would be a compression, the cable carries nothing.
The laws of a slack cable stay at the strain at which their sum became zero, some in tension and
some in compression, in balance.

At a given memory every law is linear between known corners, and so is their sum. With the
stress ``s(m)`` of the laws at their own strain m, a spring of compliance c makes the strain of the
whole ``e = m + c s(m)``. It rises with m where s rises and is inverted exactly, corner by corner.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence

import jax.numpy as jnp

from ..common.tree import copy_with, pytree
from ..common.types import Array, ArrayLike, Bool, Float
from .elastic import Elastic
from .inversion import SAMPLED_BEYOND, invert_curve, value_at_index
from .law import HistoryVariables, Law, Memory, Numbers, Pair, Values


@pytree(static=("one_sided",))
class Parallel(Law):
    """Several laws that share one strain: stresses add by their shares of the area.

    ``s(e) = sum_i share_i s_i(e)``.

    Attributes:
        laws: the laws, in a list.
        shares: share of each law in the area, [n_law], without unit, summing to 1.
        spring: compliance of a spring in series with all laws together, 1/Pa, or None; for laws
            that all rise.
        one_sided: whether the laws together are slack in compression, as a cable is.

    Example:
        Concrete in a steel tube, a quarter of the area, at one strain:

        >>> laws = jc.Elastic(30e9), jc.Elastic(210e9)
        >>> law = jc.materials.Parallel(laws, np.array([0.75, 0.25]))
        >>> print(f"{law.modulus / 1e9:.1f} GPa, {law.stress_at(1e-4) / 1e6:.1f} MPa")
        75.0 GPa, 7.5 MPa
    """

    laws: Sequence[Law]
    shares: Float[ArrayLike, " n_law"]
    spring: Float[ArrayLike, "*shape"] | None = None
    one_sided: bool = False

    @property
    def n_memory(self) -> int:  # type: ignore[override]  # from its laws
        """Number of history variables of all laws; those of one law follow those of another."""
        return sum(law.n_memory for law in self.laws)

    @property
    def has_rupture(self) -> bool:  # type: ignore[override]  # from its laws
        """Whether any of the laws has a rupture strain."""
        return any(law.has_rupture for law in self.laws)

    @property
    def monotone(self) -> bool:  # type: ignore[override]  # from its laws
        """Whether none of the laws softens."""
        return all(law.monotone for law in self.laws)

    @property
    def modulus(self) -> Float[Array, ""]:
        """Slope of stress over total strain (with that of the spring) at the origin, Pa."""
        modulus = sum(a * law.modulus for a, law in zip(self.shares, self.laws, strict=True))
        return modulus if self.spring is None else modulus / (1 + self.spring * modulus)

    @property
    def strain_limits(self) -> Pair:
        """Smallest and largest total strain, spring included, before the first law ruptures.

        The smallest one of a cable is -inf.

        Computed for first loading. They hold after any other loading too: at these strains every
        part that can yield has yielded.
        """
        low, high = (self._add_spring_strain(jnp.asarray(v)) for v in self._strain_limits_of_laws())
        return jnp.full_like(low, -jnp.inf) if self.one_sided else low, high

    def _strain_limits_of_laws(self):
        """Return the smallest and largest strain of the laws (no spring) before one ruptures."""
        low, high = zip(*(law.strain_limits for law in self.laws), strict=True)
        return (
            jnp.max(jnp.stack([jnp.asarray(v) for v in low])),
            jnp.min(jnp.stack([jnp.asarray(v) for v in high])),
        )

    @property
    def capacity(self) -> Pair:
        """Smallest and largest stress before the first law ruptures, Pa."""
        low, high = self._strain_limits_of_laws()
        corners = self._corner_strains_of_laws(
            None if self.n_memory == 0 else jnp.zeros(self.n_memory)
        )
        strains = jnp.clip(jnp.append(corners, jnp.stack([low, high])), low, high)
        strains = jnp.where(jnp.isfinite(strains), strains, 0.0)
        memory = jnp.zeros((len(strains), self.n_memory)) if self.n_memory else None
        stress = self._extrapolated_without_spring().stress_at(strains, memory)
        least, most = jnp.min(stress), jnp.max(stress)
        least = jnp.where(jnp.isfinite(low), least, -jnp.inf)
        most = jnp.where(jnp.isfinite(high), most, jnp.inf)
        return jnp.zeros_like(least) if self.one_sided else least, most

    def laws_with_memory(
        self, memory: Float[Array, "... n_memory"] | None
    ) -> Iterator[tuple[Float[ArrayLike, ""], Law, Float[Array, "... n_memory_of_law"] | None]]:
        """Yield for each law: its share of the area, the law, its history variables or None."""
        start = 0
        for share, law in zip(self.shares, self.laws, strict=True):
            remembered = None
            if law.n_memory and memory is not None:
                remembered = memory[..., start : start + law.n_memory]
                start += law.n_memory
            yield share, law, remembered

    # --- the laws at their own strain: that of the whole less that of the spring

    def _sum_over_laws(self, name, strain, memory):
        """Return the sum, over all laws, of share of the area times the result of a method.

        `name` is that of the method, such as "stress_at"; `strain` the common strain of the laws,
        without that of the spring; `memory` has the history variables of all laws, or is None.
        """
        return sum(
            share * getattr(law, name)(strain, remembered)
            for share, law, remembered in self.laws_with_memory(memory)
        )

    def _are_all_laws_slack(self, law_strain, memory):
        """Return whether every law is slack at their common strain, without that of the spring."""
        slack = [
            law.is_slack(law_strain, remembered)
            for _, law, remembered in self.laws_with_memory(memory)
        ]
        return jnp.all(jnp.stack(jnp.broadcast_arrays(*slack)), axis=0)

    def _extrapolated_without_spring(self):
        """Return a `Parallel` of these laws at their own strain: without the spring in series.

        They are extrapolated beyond rupture, and their sum may be a compression.
        """
        return copy_with(self.extrapolated(), spring=None, one_sided=False)

    def _add_spring_strain(self, strain, memory=None):
        """Return the total strain: that of the laws plus that of the spring at the same stress."""
        if self.spring is None:
            return strain
        finite = jnp.where(jnp.isfinite(strain), strain, 0.0)
        extra = self.spring * self._extrapolated_without_spring().stress_at(finite, memory)
        return jnp.where(jnp.isfinite(strain), finite + extra, strain)

    def _strain_of_laws(self, strain, memory):
        """Return the strain of the laws at a total strain: it is less by that of the spring."""
        if self.spring is None:
            return strain
        if all(isinstance(law, Elastic) for law in self.laws):
            return strain / (1 + self.spring * copy_with(self, spring=None).modulus)
        strain = jnp.asarray(strain)
        corners = self._corner_strains_of_laws(memory)
        corners = jnp.broadcast_to(corners, (*strain.shape, corners.shape[-1]))
        first, last = jnp.min(corners, -1, initial=0.0), jnp.max(corners, -1, initial=0.0)
        more = jnp.stack(
            [first - SAMPLED_BEYOND, jnp.zeros_like(strain), last + SAMPLED_BEYOND], axis=-1
        )
        strains = jnp.sort(jnp.concatenate([corners, more], axis=-1))
        lifted = copy_with(self, spring=jnp.asarray(self.spring)[..., None])
        whole = lifted._add_spring_strain(strains, None if memory is None else memory[..., None, :])
        # The last segment goes on beyond its end. At a corner the segment of loading counts, at the
        # origin that of tension.
        target = strain[..., None]
        below = jnp.where(target >= 0, whole <= target, whole < target)
        start = jnp.clip(jnp.sum(below, -1, keepdims=True) - 1, 0, strains.shape[-1] - 2)

        e0, e1, v0, v1 = (
            value_at_index(v, k) for v in (strains, whole) for k in (start, start + 1)
        )
        return e0 + (strain - v0) * (e1 - e0) / (v1 - v0)

    def _is_cable_slack(self, law_strain, memory):
        """Return whether a cable is slack: the laws add to a compression, or all of them are slack.

        `law_strain` is the common strain of the laws, without that of the spring in series;
        `memory` has the history variables of all laws, or is None.
        """
        if memory is None:
            return law_strain < 0
        slack = self._are_all_laws_slack(law_strain, memory)
        return (self._extrapolated_without_spring().stress_at(law_strain, memory) < 0) | slack

    def _slackening_strain(self, like, memory):
        """Return the strain of the laws at which a cable goes slack, in the shape of `like`.

        `memory` has the history variables of all laws; with None it is zero.
        """
        if memory is None:
            return jnp.zeros_like(like)
        return invert_curve(self._extrapolated_without_spring(), jnp.zeros_like(like), memory)

    def _law_strain_until_slack(self, strain, memory):
        """Return the strain of the laws; in a slack cable the one at which it went slack."""
        law_strain = jnp.asarray(self._strain_of_laws(strain, memory))
        if not self.one_sided:
            return law_strain
        return jnp.where(
            self._is_cable_slack(law_strain, memory),
            self._slackening_strain(law_strain, memory),
            law_strain,
        )

    # --- the law

    def stress_at(self, strain: Numbers, memory: Memory = None) -> Values:
        """Return the stress over the whole area at a total strain, Pa."""
        law_strain = self._strain_of_laws(strain, memory)
        stress = self._sum_over_laws("stress_at", law_strain, memory)
        if not self.one_sided:
            return stress
        return jnp.where(law_strain < 0 if memory is None else stress < 0, 0.0, stress)

    def stress_of_each_law(self, strain: Numbers, memory: Memory = None) -> list[Values]:
        """Return the stress of every law at a total strain, Pa, a list in the order of `laws`."""
        law_strain = self._law_strain_until_slack(strain, memory)
        return [
            law.stress_at(law_strain, remembered)
            for _, law, remembered in self.laws_with_memory(memory)
        ]

    def stress_scale_at(self, strain: Numbers, memory: Memory) -> Values:
        """Return the sum of absolute stresses of all laws, Pa; exactly zero in a slack cable."""
        law_strain = self._strain_of_laws(strain, memory)
        size = self._sum_over_laws("stress_scale_at", law_strain, memory)
        if not self.one_sided:
            return size
        pushed = (
            law_strain if memory is None else self._sum_over_laws("stress_at", law_strain, memory)
        )
        return jnp.where(pushed < 0, 0.0, size)

    def energy_at(self, strain: Numbers, memory: Memory = None) -> Values:
        """Return the energy per volume, J/m3, including that of the spring.

        In a taut cable it is the integral of its stress, if none of the curves falls. In a slack
        cable it is the energy that yielded laws store against each other.
        """
        law_strain = self._law_strain_until_slack(strain, memory)
        energy = self._sum_over_laws("energy_at", law_strain, memory)
        if self.spring is not None:
            energy = energy + 0.5 * self.spring * self.stress_at(strain, memory) ** 2
        return energy

    def strain_at(self, stress: Numbers, memory: Memory = None) -> Values:
        """Return the total strain at a stress, Pa; NaN above its peak or for a compressed cable."""
        stress = jnp.asarray(stress)
        strain = invert_curve(self._extrapolated_without_spring(), stress, memory)
        if self.spring is not None:
            strain = strain + self.spring * stress
        return jnp.where(stress < 0, jnp.nan, strain) if self.one_sided else strain

    def commit_memory(
        self, strain: Numbers, memory: HistoryVariables, duration: Float[ArrayLike, ""] = 0.0
    ) -> HistoryVariables:
        """Return the history variables of all laws after an increment that ended at `strain`.

        In a slack cable the laws stay at the strain at which it went slack.
        """
        law_strain = self._law_strain_until_slack(strain, memory)
        return jnp.concatenate(
            [
                law.commit_memory(law_strain, remembered, duration)
                for _, law, remembered in self.laws_with_memory(memory)
                if remembered is not None
            ],
            axis=-1,
        )

    def _corner_strains_of_laws(self, memory):
        """Return the strains of the laws, without spring, at which the slope of one jumps."""
        parts = [
            law.corner_strains(remembered) for _, law, remembered in self.laws_with_memory(memory)
        ]
        shape = max((part.shape[:-1] for part in parts), key=len)
        return jnp.concatenate(
            [jnp.broadcast_to(part, (*shape, part.shape[-1])) for part in parts], axis=-1
        )

    def corner_strains(self, memory: Memory = None) -> Float[Array, "... n_corner"]:
        """Return the total strains at which the slope jumps, on the last axis.

        Those at which a cable is slack are replaced by that at which it goes slack.
        """
        corners = self._corner_strains_of_laws(memory)
        if self.one_sided:
            slack = self._slackening_strain(corners[..., :1].sum(-1), memory)[..., None]
            slack = jnp.broadcast_to(slack, (*corners.shape[:-1], 1))
            candidates = jnp.concatenate([corners, slack], -1)
            corners = jnp.maximum(candidates, jnp.broadcast_to(slack, candidates.shape))
        return self._add_spring_strain(corners, None if memory is None else memory[..., None, :])

    def is_slack(self, strain: Numbers, memory: Memory = None) -> Bool[Array, "*shape"]:
        """Return whether the laws carry no stress: as a cable together, or else each of them."""
        law_strain = self._strain_of_laws(strain, memory)
        if self.one_sided:
            return self._is_cable_slack(law_strain, memory)
        return self._are_all_laws_slack(law_strain, memory)

    # --- the same, changed

    def extrapolated(self) -> Parallel:
        """Return the laws continued elastically beyond rupture, with which iterations work."""
        return copy_with(self, laws=tuple(law.extrapolated() for law in self.laws))

    def tension_only(self) -> Parallel:
        """Return the law of a cable: slack where the sum of stresses would be a compression."""
        return copy_with(self, one_sided=True)

    def in_series_with_spring(self, compliance: Numbers) -> Parallel:
        """Return all laws in series with one spring of `compliance`, 1/Pa; none may soften."""
        return copy_with(
            self, spring=compliance if self.spring is None else self.spring + compliance
        )
