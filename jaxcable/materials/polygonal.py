"""Numerically given law: a polygon of (strain, stress) points, reversible or elastic-plastic.

Written as slopes that change at corners, so that nothing cancels near the origin:

    s(e) = E e + sum_k (E_k - E_{k-1}) <e - e_k>,      <x> = x where x >= 0, else 0,

for the tension corners ``e_k > 0``, and mirrored for the compression corners. The elastic-plastic
form is the parallel model of Besseling (1958) with Masing's rule: corner k stands for an elastic-
perfectly plastic part of stiffness ``d_k = E_{k-1} - E_k`` that yields at ``e_k``,

    s(e) = E_end e + sum_k d_k [e - p_k],     [x] = x limited to the range of its two yield strains,

with plastic strains ``p_k``, which are the memory of the law. The model follows the polygon in
first loading, unloads with the initial slope, and yields in the opposite direction after twice the
strain. At given ``p_k`` its energy is convex.
"""

from __future__ import annotations

from typing import Literal

import jax.numpy as jnp
import numpy as np

from ..common import checks
from ..common.rules import Rule, refuse_if_broken
from ..common.tree import copy_with, pytree, set_fields
from ..common.types import Array, ArrayLike, Bool, Float
from . import point_rules
from .inversion import invert_curve
from .law import HistoryVariables, Law, Memory, Numbers, Pair, Values, broadcast_on_last_axis


@pytree(static=("unloading", "one_sided", "endless", "monotone", "n_memory"))
class Polygonal(Law):
    """Piecewise linear law through given points; beyond its ends it has failed, with zero stress.

    The curve passes through the origin, and the strain increases from point to point. Points of
    negative strain are the compression branch; without them (first point at the origin) the
    material carries tension only and is slack, not failed, in compression. Stress may rise
    (hardening) or fall (softening).

    Args:
        strain: strains of the points, [n], n >= 2, increasing, without unit; as many as `stress`.
            The origin is one of the points, or between two of them. Points of negative strain are
            compression; without them the law carries tension only, as cables do.
        stress: stresses of the points, [n], Pa; as many as `strain`.
        unloading: "reversible" (back along the curve), or "elastic": along the initial slope,
            with plastic strains that stay. Elastic unloading needs a concave curve (slopes fall
            away from the origin, not below zero); if it has two branches, their slopes must be the
            same, their corners may differ.
        one_sided: whether points of compression are left out: the law is slack in compression.
        endless: whether the law is continued elastically beyond its ends; set by an iteration.
        monotone, n_memory: as in `Law`; computed from the points where these are not traced.

    Raises:
        ValueError: wrong shapes, strain not increasing, a curve that misses the origin, a slope at
            the origin that is not positive, elastic unloading of a curve without a parallel model.
            Traced values are checked in the analysis instead (INVALID_INPUT).

    Source: of the elastic-plastic form Besseling (1958), with Masing's rule.

    Example:
        200 GPa up to a strain of 0.001, then 20 GPa, tension only:

        >>> law = jc.Polygonal([0.0, 0.001, 0.011], [0.0, 200e6, 400e6])
        >>> print(jnp.round(law.stress_at(jnp.array([0.0005, 0.006, 0.02])) / 1e6, 3))  # MPa
        [100. 300.   0.]
        >>> print(f"{law.corner_distance(0.006):.4f}")
        0.0050
        >>> bool(law.is_ruptured(0.02))  # failed, not slack
        True
    """

    strain: Float[ArrayLike, "2+"]
    stress: Float[ArrayLike, "2+"]
    unloading: Literal["reversible", "elastic"] = "reversible"
    one_sided: bool = False
    endless: bool = False
    monotone: bool = None  # type: ignore[assignment]  # set by the constructor
    n_memory: int = None  # type: ignore[assignment]  # set by the constructor

    has_rupture = True

    worked_out = ("monotone", "n_memory")

    def __post_init__(self):
        strain, stress = (
            checks.as_floats(self.strain, "strain"),
            checks.as_floats(self.stress, "stress"),
        )
        if strain.ndim != 1 or len(strain) < 2:
            raise ValueError(f"strain: expected shape [n] with n >= 2, got {strain.shape}")
        if stress.shape != strain.shape:
            raise ValueError(f"stress: expected shape {strain.shape} as strain, got {stress.shape}")
        if self.unloading not in ("reversible", "elastic"):
            raise ValueError(f'unloading = {self.unloading!r}: expected "reversible" or "elastic"')
        refuse_if_broken(point_rules.point_rules(strain, stress, self.unloading))
        e, s = checks.array_if_known(strain), checks.array_if_known(stress)
        if e is not None:
            point_rules.warn_if_percent(e)
            if s is not None:
                strain, stress = e, s = point_rules.insert_origin(e, s)
        set_fields(self, strain=strain, stress=stress)
        if self.monotone is None:
            set_fields(self, monotone=s is not None and bool((np.diff(s) >= 0).all()))
        if self.unloading == "elastic":
            set_fields(self, monotone=True)
        n_corner = len(strain) - 2
        if e is not None and not np.isnan(e).any():
            n_corner = max((e[1:-1] > 0).sum(), (e[1:-1] < 0).sum())
        if self.unloading == "reversible":
            n_corner = 0
        if self.n_memory is None:
            set_fields(self, n_memory=int(n_corner))

    def rules(self) -> list[Rule]:
        """Return the conditions on its points, `point_rules.point_rules`: a list of `Rule`."""
        return point_rules.point_rules(self.strain, self.stress, self.unloading)

    # --- the numbers of the curve

    @property
    def _array_module_stresses_strains(self):
        """NumPy if the points are known, else `jax.numpy`; their stresses, Pa; strains, [n]."""
        xp = checks.numpy_or_jax(self.stress, self.strain)
        return xp, xp.asarray(self.stress), xp.asarray(self.strain)

    @property
    def _segment_slopes(self):
        """Slopes of the segments between points, Pa, [n - 1]."""
        xp, stress, strain = self._array_module_stresses_strains
        return xp.diff(stress) / xp.diff(strain)

    @property
    def _has_compression(self):
        """Whether the curve has a compression branch, scalar bool."""
        return np.bool_(False) if self.one_sided else self._array_module_stresses_strains[2][0] < 0

    @property
    def modulus(self) -> Float[Array, ""]:
        """Slope of the curve at the origin, on the tension side, Pa."""
        xp, _, strain = self._array_module_stresses_strains
        return self._segment_slopes[xp.sum(strain[1:-1] <= 0)]

    @property
    def capacity(self) -> Pair:
        """Smallest and largest stress of the curve, Pa."""
        xp, stress, _ = self._array_module_stresses_strains
        return xp.where(self._has_compression, xp.min(stress), 0.0), xp.max(stress)

    @property
    def strain_limits(self) -> Pair:
        """Smallest and largest strain of the curve; -inf where compression makes it slack."""
        xp, _, strain = self._array_module_stresses_strains
        return xp.where(self._has_compression, strain[0], -xp.inf), strain[-1]

    # --- the law

    def stress_at(self, strain: Numbers, memory: Memory = None) -> Values:
        """Return the stress, Pa: zero beyond the ends of the curve, unless the law is `endless`."""
        strain = jnp.asarray(strain)
        inside, over = self._split_at_ends(strain)
        stress = self._stress_on_curve(inside, memory)
        if self.endless:
            stress = stress + self.modulus * over
        else:
            stress = jnp.where(self.is_ruptured(strain), 0.0, stress)
        if memory is None:
            return stress
        return jnp.where(~self._has_compression & (stress < 0), 0.0, stress)

    def stress_scale_at(self, strain: Numbers, memory: Memory) -> Values:
        """Return the sum of absolute stresses of the parallel parts, Pa: the scale of rounding."""
        if memory is None:
            return jnp.abs(self._stress_on_curve(strain, None))
        stiffness, end, _, kept = self._part_strains_after_yielding(strain, memory)
        return jnp.abs(end * strain) + jnp.sum(stiffness * jnp.abs(kept), axis=-1)

    def energy_at(self, strain: Numbers, memory: Memory = None) -> Values:
        """Return the strain energy per unstressed volume, J/m3.

        It is the area under the curve; with `memory`, the energy stored in the parallel parts.
        """
        strain = jnp.asarray(strain)
        inside, over = self._split_at_ends(strain)
        if memory is None:
            initial, changes, forward, backward = self._slope_changes_and_excess_strains(inside)
            energy = 0.5 * initial * inside**2
            energy = energy + 0.5 * jnp.sum(changes * (forward**2 - backward**2), axis=-1)
        else:
            stiffness, end, elastic, kept = self._part_strains_after_yielding(inside, memory)
            energy = 0.5 * end * inside**2
            energy = energy + jnp.sum(stiffness * kept * (elastic - 0.5 * kept), axis=-1)
            below = self._stress_on_curve(inside, memory)
            slack = ~self._has_compression & (below < 0)
            energy = energy - jnp.where(slack, 0.5 * below**2 / self.modulus, 0.0)
        if self.endless:
            energy = (
                energy + (self._stress_on_curve(inside, memory) + 0.5 * self.modulus * over) * over
            )
        return energy

    def strain_at(self, stress: Numbers, memory: Memory = None) -> Values:
        """Return the strain at `stress`, Pa, on the rising branch from zero; NaN above its peak.

        A law that is `endless` and does not soften has a strain at any stress.
        """
        strain = invert_curve(self, stress, memory)
        if not (self.endless and self.monotone):
            return strain
        low, high = (jnp.broadcast_to(end, jnp.shape(stress)) for end in self.strain_limits)
        more = stress - self._stress_on_curve(high, memory)
        strain = jnp.where(more > 0, high + more / self.modulus, strain)
        less = stress - self._stress_on_curve(low, memory)
        pushed = self._has_compression & (less < 0)
        return jnp.where(pushed, low + less / self.modulus, strain)

    def commit_memory(
        self, strain: Numbers, memory: HistoryVariables, duration: Float[ArrayLike, ""] = 0.0
    ) -> HistoryVariables:
        """Return the plastic strains after an increment that ended at `strain`, of any duration."""
        inside, _ = self._split_at_ends(jnp.asarray(strain))
        _, _, elastic, kept = self._part_strains_after_yielding(inside, memory)
        moved = jnp.isfinite(kept) & (kept != elastic)
        return jnp.where(moved, inside[..., None] - jnp.where(moved, kept, 0.0), memory)

    def is_slack(self, strain: Numbers, memory: Memory = None) -> Bool[Array, "*shape"]:
        """Return whether a material without compression branch would be compressed at `strain`."""
        if memory is None:
            return ~self._has_compression & (strain < 0)
        return ~self._has_compression & (self._stress_on_curve(strain, memory) < 0)

    def corner_strains(self, memory: Memory = None) -> Float[Array, "... n_corner"]:
        """Return the strains at which the slope jumps, and those of both ends, on the last axis."""
        if memory is None:
            return jnp.where(self._has_compression, self.strain, jnp.maximum(self.strain, 0.0))
        low, high = self.strain_limits
        stiffness, pull, push = (broadcast_on_last_axis(v, memory) for v in self._parallel_parts())
        yielding = jnp.concatenate([memory + pull, memory - push], -1)
        # a part that never yields in a direction has its corner at the end of the curve
        yielding = jnp.where(jnp.isfinite(yielding), yielding, high)
        # a material without compression goes slack elastically: no part yields on the way
        slack = jnp.sum(stiffness * memory, axis=-1, keepdims=True) / self.modulus
        ends = [jnp.where(self._has_compression, low, slack), jnp.full_like(slack, high)]
        return jnp.concatenate([yielding, *ends], -1)

    # --- the same material, changed

    def extrapolated(self) -> Polygonal:
        """Return the law continued with its initial slope beyond its ends, for an iteration."""
        return copy_with(self, endless=True)

    def without_softening(self) -> Polygonal:
        """Return the law with its initial slope from where its stress first falls."""
        if self.monotone:
            return self
        slopes, outward = self._segment_slopes, self.strain[1:] > 0
        falls = slopes < 0
        pulled = jnp.cumsum(falls & outward) > 0
        pushed = jnp.cumsum((falls & ~outward)[::-1])[::-1] > 0
        slopes = jnp.where(jnp.where(outward, pulled, pushed), self.modulus, slopes)
        rise = jnp.cumsum(slopes * jnp.diff(self.strain))
        stress = jnp.concatenate([jnp.zeros_like(rise[:1]), rise])
        stress = stress - stress[jnp.sum(self.strain < 0)]  # the origin is a point of every curve
        return copy_with(self, stress=stress, monotone=True)

    def tension_only(self) -> Polygonal:
        """Return the law without compression: slack where its stress would be negative."""
        return copy_with(self, one_sided=True)

    def softening_stresses(self) -> Float[ArrayLike, " n"] | None:
        """Return the stresses of the points, [n]; None if they are known not to fall."""
        return None if self.monotone else self.stress

    def in_series_with_spring(self, compliance: Numbers) -> Polygonal:
        """Return the law in series with a spring of `compliance`, 1/Pa; it must not soften."""
        return copy_with(self, strain=self.strain + compliance * self.stress)

    # --- its parts

    def _split_at_ends(self, strain):
        """Split strains into the part within the ends of the curve, and the excess beyond them.

        Both have the shape of `strain`, and add up to it; the excess is negative beyond the lower
        end.
        """
        low, high = self.strain_limits
        inside = jnp.where(strain > high, high, jnp.where(strain < low, low, strain))
        return inside, jnp.where(self.is_ruptured(strain), strain - inside, 0.0)

    def _stress_on_curve(self, strain, memory):
        """Return the stress, Pa, without a check for rupture, at strains within the curve.

        With `memory`, the plastic strains, it is the sum of the stresses of the parallel parts.
        """
        if memory is not None:
            stiffness, end, _, kept = self._part_strains_after_yielding(strain, memory)
            return end * strain + jnp.sum(stiffness * kept, axis=-1)
        initial, changes, forward, backward = self._slope_changes_and_excess_strains(strain)
        return initial * strain + jnp.sum(changes * (forward - backward), axis=-1)

    def _slope_changes_and_excess_strains(self, strain):
        """Return four arrays: initial slope, changes of slope, strains beyond the corners (two).

        The slope is that of the side on which `strain` is, Pa. The others have an entry for each
        corner on the last axis. Strains beyond corners in tension are positive, those beyond
        corners in compression, the last array, are negative; zero where a corner is not reached.
        """
        slopes, e = self._segment_slopes, strain[..., None]
        corners = broadcast_on_last_axis(self.strain[1:-1], e)
        forward = jnp.where((corners > 0) & (e >= corners), e - corners, 0.0)
        backward = jnp.where(
            (corners < 0) & (e <= corners) & self._has_compression, e - corners, 0.0
        )
        behind = jnp.where(
            self._has_compression, jnp.take(slopes, jnp.sum(self.strain[1:-1] < 0)), 0.0
        )
        initial = jnp.where(strain >= 0, self.modulus, behind)
        return initial, broadcast_on_last_axis(jnp.diff(slopes), e), forward, backward

    def _parallel_parts(self):
        """Return stiffness, Pa, yield strain in tension, and that in compression, of each part.

        Elastoplastic parts in parallel make the curve (Besseling). The arrays are [n_memory], not
        negative, in the order of corners from the origin outwards; on a side with fewer corners
        the last parts never yield (inf).
        """
        corners, changes = self.strain[1:-1], jnp.diff(self._segment_slopes)
        n, rank = len(corners), jnp.arange(self.n_memory)
        pulled = jnp.sum(corners <= 0) + rank
        pushed = jnp.sum(corners < 0) - 1 - rank
        pushed = jnp.where(pushed < 0, n, pushed)  # no such corner: `take` fills

        def take(values, index, fill):
            return jnp.take(values, index, mode="fill", fill_value=fill)

        # Away from the origin slopes fall: the changes are negative in tension, positive in
        # compression.
        stiffness = jnp.where(pulled < n, -take(changes, pulled, 0.0), take(changes, pushed, 0.0))
        push = jnp.where(self._has_compression, -take(corners, pushed, -jnp.inf), jnp.inf)
        return stiffness, take(corners, pulled, jnp.inf), push

    def _part_strains_after_yielding(self, strain, memory):
        """Return part stiffness and last slope, Pa, and strains of parts before and after yielding.

        All but the last slope have an entry for each elastoplastic part on the last axis; `memory`
        has the plastic strains of the parts.
        """
        stiffness, pull, push = (broadcast_on_last_axis(v, memory) for v in self._parallel_parts())
        elastic = strain[..., None] - memory
        # at a corner the plastic branch counts, that of loading
        kept = jnp.where(elastic >= pull, pull, jnp.where(elastic <= -push, -push, elastic))
        # the last slope of the side with more corners; on the other side the last parts never yield
        corners, slopes = self.strain[1:-1], self._segment_slopes
        last = jnp.where(jnp.sum(corners > 0) >= jnp.sum(corners < 0), slopes[-1], slopes[0])
        return stiffness, last, elastic, kept
