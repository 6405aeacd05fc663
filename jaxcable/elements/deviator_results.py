"""Results of cables at the nodes that deviate them: slip, friction, forces of clamps, contact."""

from __future__ import annotations

import abc
from collections.abc import Callable
from typing import Any

import jax.numpy as jnp

from ..common.types import Array, ArrayLike, Bool, Float
from .cable_path import CablePath, saddle_moments
from .element import Element, Ends, Motion
from .element_state import OwnState
from .friction import SegmentTensions, slip_lengths

_STRAIGHT = 1e-6  # log of the largest ratio of tensions below which a cable counts as straight


class Slipping(Element):
    """Elements that stick and slip with friction; `trace_path` locates where they begin to slip."""

    @abc.abstractmethod
    def is_slipping(self, state: OwnState, ends: Ends, motion: Motion) -> Bool[Array, " n_place"]:
        """Return at which of its places one element slips or is about to slip, [n_place] bool."""


class DeviatorResults(Slipping):
    """Cables with friction that have results at their deviators, [n_deviator] or [n_deviator, 3].

    Subclasses have `path` and `_segments_with_tensions`, as `FrictionCables`.
    """

    path: Callable[[Ends, Motion], CablePath]
    _segments_with_tensions: Callable[[Any, Ends, Motion], tuple[Any, SegmentTensions]]
    radius: Float[ArrayLike, "n_elem n_deviator"] | None

    def slip(self, state: OwnState, ends: Ends, motion: Motion) -> Float[Array, " n_deviator"]:
        """Return the length that has slipped over each deviator so far, [n_deviator], m.

        It is positive towards the next segment, and unstressed length at the reference temperature.
        """
        found = self._segments_with_tensions(state, ends, motion)[1]
        return state.memory + slip_lengths(found) / state.thermal_stretch_or_one

    def is_slipping(
        self, state: OwnState, ends: Ends, motion: Motion
    ) -> Bool[Array, " n_deviator"]:
        """Return at which deviators one cable slips with friction, or is about to, [n_deviator]."""
        found = self._segments_with_tensions(state, ends, motion)[1]
        before, after = found.deviator_tensions()
        taut = (before > 0) & (after > 0) & (found.bound > _STRAIGHT)
        return taut & (found.sign != 0) & (state.clamped == 0)

    def friction_used(
        self, state: OwnState, ends: Ends, motion: Motion
    ) -> Float[Array, " n_deviator"]:
        """Return the utilization of friction at each deviator, -1 to 1, more at a clamp.

        It is the logarithm of the ratio of the tensions after and before the deviator over the
        largest one. 1 or -1: the cable slips towards the next segment, or back. Zero without
        tension or friction, and where the cable is straight.
        """
        found = self._segments_with_tensions(state, ends, motion)[1]
        before, after = found.deviator_tensions()
        counts = (before > 0) & (after > 0) & (found.bound > _STRAIGHT)
        ratio = jnp.where(counts, after, 1.0) / jnp.where(counts, before, 1.0)
        return jnp.log(ratio) / jnp.where(counts, found.bound, 1.0)

    def clamp_force(
        self, state: OwnState, ends: Ends, motion: Motion
    ) -> Float[Array, " n_deviator"]:
        """Return the tension after each clamp less that before it, N; 0 where there is no clamp.

        Friction carries a part of this difference.
        """
        before, after = self._segments_with_tensions(state, ends, motion)[1].deviator_tensions()
        return jnp.where(state.clamped > 0, after - before, 0.0)

    def contact_arc(
        self, state: OwnState, ends: Ends, motion: Motion
    ) -> Float[Array, " n_deviator"]:
        """Return the contact length on each saddle, m; negative where the cable would lift off."""
        return jnp.asarray(self.radius) * jnp.asarray(self.path(ends, motion).contact_angle)

    def contact_pressure(
        self, state: OwnState, ends: Ends, motion: Motion
    ) -> Float[Array, " n_deviator"]:
        """Return the contact force per length on each saddle, larger T / r, N/m; 0 without radius.

        It is negative where a saddle would have to pull, because the cable would lift off.
        """
        before, after = self._segments_with_tensions(state, ends, motion)[1].deviator_tensions()
        side = jnp.sign(jnp.asarray(self.path(ends, motion).contact_angle))
        radius = jnp.asarray(self.radius)
        return side * jnp.maximum(before, after) / jnp.where(radius > 0, radius, 1.0)

    def saddle_moment(
        self, state: OwnState, ends: Ends, motion: Motion
    ) -> Float[Array, "n_deviator 3"]:
        """Return the moment of one cable on the node of each saddle about x, y, z, N m.

        It is that of both tensions at their tangent points; 0 without a radius.
        """
        before, after = self._segments_with_tensions(state, ends, motion)[1].deviator_tensions()
        return saddle_moments(self.path(ends, motion), jnp.asarray(self.radius), before, after)
