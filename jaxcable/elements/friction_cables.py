"""Cables that slide over their nodes with friction, or are clamped there.

Every straight segment has a tension of its own, which `friction` finds for given positions of the
nodes. An increment remembers what has slipped over each node, so that loads can be reversed. The
element has no potential: its tangent is unsymmetric.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Mapping
from typing import Any

import jax
import jax.numpy as jnp

from ..common.rules import Rule
from ..common.tree import copy_with, index_array, pytree, set_fields
from ..common.types import Array, ArrayLike, Bool, Float
from .abilities import PHASE_INPUTS
from .cable_path import CablePath, path_over_points, path_over_saddles, saddle_rules
from .deviator_results import DeviatorResults
from .element import PEAK_TENSION, SECTION_STRAIN, TENSION, Ends, Forces, Motion, Scalar
from .element_state import OwnState
from .friction import (
    FrictionCoefficients,
    StraightSegments,
    at_slip_limit,
    clamp_rule,
    elongations_and_flexibilities,
    floats_per_deviator,
    is_last_segment,
    length_fed_at_ends,
    no_softening_rules,
    segment_tensions,
    slip_lengths,
    stressed_ends_rule,
)
from .friction_state import CONTACT_RESULTS, DEVIATOR_RESULTS, SEGMENT_TENSION, FrictionState
from .phase_input import InputValues, PhaseInput
from .prestress import AxialState
from .sliding import SlidingCables, forces_of_segments


@pytree(indices=("links",), kw_only=True)
class FrictionCables(DeviatorResults, SlidingCables):
    """A group of cables that slide with Coulomb friction over their nodes; tension only.

    At every node between its ends, a *deviator* (saddle, pulley, duct), the tensions of a cable on
    both sides differ at most by a factor ``exp(b)``, and by this factor where it slips, against the
    slip: ``b = friction theta + wobble l`` with theta the angle between the segments and l the mean
    of their lengths. Where the cable sticks, no unstressed length passes. Slips are found exactly
    for all deviators together (`elements.friction`), and remembered at the end of every increment:
    loads can be reversed, and results depend on the path, so that more increments are more exact.

    A phase clamps a cable to deviators by ``Phase(clamped={"rope": values})`` with 1 (clamped) or
    0, one number or [n_elem, n_deviator], until it is stated anew. A jack pulls, and a shortening
    is taken out, at the first end, or at those that ``Phase(stressed_ends={"rope": [[0, 1]]})``
    names from then on (both share a shortening); a negative shortening after lock-off is the
    draw-in of an anchor. Other changes of length are those of all segments alike.

    `tension` is the mean over the length of a cable, `segment_tension` has all, `slip` what has
    passed each deviator, `friction_used` the part of friction in use, `clamp_force` of a clamp.

    With a `radius` a node is the center of a circle, and tangent points move with the segments
    (`elements.cable_path`). `contact_arc` is the length on a saddle, `contact_pressure` its force
    per length, both negative where the cable would lift off. Each half of an arc has the tension of
    the segment beside it. Where beams or springs give the node rotations, the saddle rotates with
    it, and the node gets the moment of the tensions (`saddle_moment`, about x, y, z); where not,
    the saddle does not rotate, and no reaction contains this moment.

    Args:
        axial_stiffness, area, law, section, rest_length, weight, expansion, strength, compliance:
            as of `SlidingCables`, and so are `links`; the law has no history variables.
        friction: coefficient of friction mu, without unit, scalar, [n_elem], or [n_elem,
            n_deviator] with ``n_deviator = n_end - 2`` of the longest chain (shorter ones leave the
            last numbers unused; one cable may have a flat list); default 0.
        axle_friction: of pulleys that turn with the cable, k, the friction coefficient of the axle
            times its radius over that of the pulley, without unit, likewise, below 1; default 0. It
            alone lets the tensions differ by k times the force on the axle; both add up in b.
        wobble: friction of unintended angles, times mu, scalar or [n_elem], 1/m; default 0.
        radius: of saddles and pulleys, given as `friction`, m; default 0, a point.
        axis: vector without unit about which the cable turns there by the right-hand rule, normal
            to its segments within 20 degrees, [3] or [n_elem, n_deviator, 3]. Default: that about
            which the polygon of initial nodes turns.

    Raises:
        ValueError: as of `SlidingCables`; negative coefficients; a law that softens or has history;
            a radius larger than half a segment, or where the polygon of a cable is straight; an
            axis that does not fit, or without a radius.

    Source: Euler (1769) for the ratio of tensions.

    Example:
        A weight of 1 kN hangs on a rope that turns by 90 degrees over a fixed bar, mu = 0.2. The
        anchor holds ``1000 exp(-0.2 pi / 2)`` N:

        >>> nodes = [[-3.0, 0.0, 0.0], [0.0, 0.0, 0.0], [0.0, 0.0, -1.0]]
        >>> rope = jc.FrictionCables(links=[[0, 1, 2]], axial_stiffness=1e6, friction=0.2)
        >>> held = jc.pinned([0, 1]) + jc.restrained([2], "xy")
        >>> structure = jc.Structure(nodes, {"rope": rope}, held)
        >>> weight = jc.NodalLoads([2], (0.0, 0.0, -1000.0))
        >>> solution = jc.solve(structure, jc.Phase(loads=weight))
        >>> tensions = solution.element_results["segment_tension"]["rope"]
        >>> print(solution.status, jnp.round(tensions, 6))
        0 [[ 730.402691 1000.      ]]
    """

    friction: Float[ArrayLike, "n_elem n_deviator"] | None = None
    axle_friction: Float[ArrayLike, "n_elem n_deviator"] | None = None
    wobble: Float[ArrayLike, " n_elem"] | None = None
    radius: Float[ArrayLike, "n_elem n_deviator"] | None = None
    axis: Float[ArrayLike, "n_elem n_deviator 3"] | None = None

    symmetric = False
    has_memory = is_chain = True
    results = (TENSION, PEAK_TENSION, SECTION_STRAIN, SEGMENT_TENSION, *DEVIATOR_RESULTS)
    phase_inputs = (
        *(name for name in PHASE_INPUTS if name not in ("sag", "built_sag", "horizontal_tension")),
        PhaseInput("clamped", "-", ramped=False, rules=(clamp_rule,)),
        PhaseInput("stressed_ends", "-", ramped=False, rules=(stressed_ends_rule,)),
    )
    per_element = (  # type: ignore[assignment]  # five more
        *SlidingCables.per_element,
        *("friction", "axle_friction", "wobble", "radius", "axis"),
    )

    def __post_init__(self):
        super().__post_init__()
        if index_array(self.links).shape[1] < 3:
            raise ValueError("links: no cable has a node between its ends; take Cables")
        if self.axis is not None and self.radius is None:
            raise ValueError("axis: of saddles and pulleys with a `radius`, which is not given")
        if any(law.n_memory for law in self._laws):
            raise ValueError("law: has history variables; a cable with friction needs one without")

    def _floats_per_element(self, name):
        """Return a field as floats, [n_elem], or [n_elem, n_deviator] for those of deviators."""
        own = ("friction", "axle_friction", "radius", "axis")
        if name not in own or getattr(self, name) is None:
            return super()._floats_per_element(name)
        shape = len(self.links), index_array(self.links).shape[1] - 2
        return floats_per_deviator(getattr(self, name), name, shape)

    def rules(self) -> list[Rule]:
        """Return the rules of chains and friction; no law softens, and no radius is negative."""
        radius = Rule("radius", self.radius, lambda v: ~(v >= 0), "must not be negative")
        return [
            *super().rules(),
            *no_softening_rules(self._laws),
            *self.coefficients().rules(),
            radius,
        ]

    def rules_at(self, nodes: Float[ArrayLike, "n_node 3"]) -> list[Rule]:
        """Return the rules of chains and `saddle_rules` at initial positions `nodes`, m."""
        found = super().rules_at(nodes)
        if self.radius is None:
            return found
        return found + saddle_rules(self.radius, self.axis, nodes, index_array(self.links))

    def chord(self, ends: Float[Array, "n_elem n_end 3"]) -> Float[Array, " n_elem"]:
        """Return the initial length of every cable over all of its nodes, [n_elem], m."""
        if self.radius is None:
            return super().chord(ends)
        still = jnp.zeros_like(ends)
        paths = jax.vmap(path_over_saddles)(self.radius, self.axis, ends, still)
        return jnp.sum(paths.initial_length, axis=1)

    @property
    def components(self) -> Mapping[str, tuple[str, ...]]:  # type: ignore[override]  # read only
        """Names of the components of the phase inputs "clamped" and "stressed_ends", by input."""
        count = index_array(self.links).shape[1] - 2
        clamped = tuple(f"deviator {k}" for k in range(count))
        return {"clamped": clamped, "stressed_ends": ("first end", "last end")}

    def has_tension_unknown(self, state: OwnState) -> bool:
        """Return False: a cable has several tensions, and none can be an unknown."""
        return False

    def without_friction(self, state: OwnState) -> tuple[SlidingCables, AxialState]:
        """Return frictionless cables, and their state: `SlidingCables`, no clamps, no slips."""
        group, plain = object.__new__(SlidingCables), object.__new__(AxialState)
        for new, old in ((group, self), (plain, state)):
            set_fields(new, **{f.name: getattr(old, f.name) for f in dataclasses.fields(new)})
        return group, copy_with(plain, memory=None)

    # --- state

    def start(self, ends: Float[Array, "n_elem n_end 3"]) -> FrictionState:
        """Return the state before the first phase: all segments have one tension, without slip."""
        state: Any = super().start(ends)
        fields = {name: getattr(state, name) for name in state._all_fields}
        zero = jnp.zeros((len(self.links), ends.shape[1] - 2), state.rest_length.dtype)
        fed = jnp.zeros((len(self.links), 2), zero.dtype)
        fields |= {"fed_length": fed, "stressed_ends": fed.at[:, 0].set(1.0)}
        return FrictionState(**fields, clamped=zero, initial_slip=zero)

    def state_at_activation(self, state: OwnState, ends: Ends, motion: Motion) -> FrictionState:
        """Return the state of one cable activated here, all of whose segments have one strain."""
        path = self.path(ends, motion)
        before, length = path.initial_length, path.length
        sums = (jnp.sum(values) for values in (length, path.change, before))
        state = self._state_activated_at_length(state, *sums)
        # of a cable as long as its initial chain: inputs of the phase may change its length
        slip = jnp.cumsum(before - jnp.sum(before) * (length / jnp.sum(length)))[:-1]
        return copy_with(state, initial_slip=slip, fed_length=jnp.zeros_like(state.fed_length))

    def initial_memory(self) -> Float[Array, "n_elem n_deviator"]:
        """Return the slips before the first phase, zeros, [n_elem, n_deviator], m."""
        count, width = index_array(self.links).shape
        dtype = jnp.asarray(next(iter(self.properties().values()))).dtype
        return jnp.zeros((count, width - 2), dtype)

    def apply_phase_inputs(
        self,
        state: OwnState,
        ends: Float[Array, "n_elem n_end 3"],
        inputs: Mapping[str, InputValues],
    ) -> FrictionState:
        """Return the state after the inputs of a phase; a shortening acts at stressed ends."""
        own = [name for name in ("clamped", "stressed_ends") if name in inputs]
        known = {name: stated for name, stated in inputs.items() if name not in own}
        stretch = state.thermal_stretch_or_one  # a temperature is applied after a shortening
        state = super().apply_phase_inputs(state, ends, known)  # an `AxialState` of the same class
        for name in own:
            values = inputs[name].select(inputs[name].values, getattr(state, name))
            state = copy_with(state, **{name: values})
        if "shortening" in inputs:
            share = state.stressed_ends / jnp.sum(state.stressed_ends, axis=1, keepdims=True)
            fed = share * (inputs["shortening"].values / stretch)[:, None]
            state = copy_with(state, fed_length=state.fed_length - fed)
        return state

    def committed_memory(
        self, state: OwnState, ends: Ends, motion: Motion, duration: float = 0.0
    ) -> Float[Array, " n_deviator"]:
        """Return the slips over the deviators of one cable so far, its memory, [n_deviator], m."""
        return self.slip(state, ends, motion)

    # the history of a cable is that of its slips: its law has none, and is asked without

    def force(self, strain: Scalar, memory: Array | None = None) -> Scalar:
        """Return the axial force of a segment at a strain, N, not negative."""
        return super().force(strain)

    def strain_at(self, force: Scalar, memory: Array | None = None) -> Scalar:
        """Return the strain of a segment at an axial force, N."""
        return super().strain_at(force)

    def energy_per_length(self, strain: Scalar, memory: Array | None = None) -> Scalar:
        """Return the stored energy per unstressed length at a strain, J/m."""
        return super().energy_per_length(strain)

    def fibre_stress(
        self, strain: Scalar, memory: Array | None = None
    ) -> Float[Array, " n_fibre"] | Scalar:
        """Return the stresses of the fibres of a segment at a strain, Pa."""
        return super().fibre_stress(strain)

    def commit_memory(self, strain: Scalar, memory: Array, duration: float = 0.0) -> Array:
        """Return `memory`, the slips, unchanged: `committed_memory` commits them."""
        return memory

    def section_strain(self, state: OwnState, ends: Ends, motion: Motion) -> Scalar:
        """Return the largest strain of the segments of one cable."""
        return self.strain_at(self.peak_tension(state, ends, motion))

    def has_result(self, name: str, state: OwnState) -> bool:
        """Return whether elements have a result by name; contact results need a radius."""
        if name == SECTION_STRAIN.name:
            return self.section is not None or self.has_rupture
        if name in [result.name for result in CONTACT_RESULTS]:
            return self.radius is not None
        return super().has_result(name, state)

    def lock_off(self, state: OwnState, ends: Ends, motion: Motion) -> FrictionState:
        """Return the state after lock-off: lengths fed in by jacks belong to the cable now."""
        segments, found = self._segments_with_tensions(state, ends, motion)
        gained = jnp.where(found.tension > 0, found.gained, segments.stuck_elongation)
        fed = length_fed_at_ends(found, gained, state.jack.at_first)
        return copy_with(
            state,
            rest_length=state.rest_length + jnp.sum(fed),
            elongation=state.elongation - jnp.sum(fed),
            fed_length=state.fed_length + fed / state.thermal_stretch_or_one,
            jack_force=None,
            jacked=None,
        )

    # --- one cable

    def path(self, ends: Ends, motion: Motion) -> CablePath:
        """Return the `CablePath` of one cable: its segments and angles in a motion."""
        if self.radius is None:
            return path_over_points(ends, motion)
        return path_over_saddles(self.radius, self.axis, ends, motion)

    def length_change(self, ends: Ends, motion: Motion) -> Scalar:
        """Return the present length of one cable over all nodes less the initial one, m."""
        return jnp.sum(self.path(ends, motion).change)

    def coefficients(self) -> FrictionCoefficients:
        """Return the coefficients of friction of one cable."""
        return FrictionCoefficients(self.friction, self.axle_friction, self.wobble)

    def _segments_with_tensions(self, state, ends, motion):
        """Return the `StraightSegments` of one cable, and their `SegmentTensions`."""
        path = self.path(ends, motion)
        elongation = self.stuck_elongations(state, path)
        bound = self.coefficients().largest_log_ratio(path.angle, path.length)
        clamped = self.closed_clamps(state, path.length)
        jack = state.jack
        segments = StraightSegments(self, path.length, elongation, bound, clamped, jack)
        return segments, segment_tensions(segments)

    def stuck_elongations(self, state: OwnState, path: CablePath) -> Float[Array, " n_segment"]:
        """Return present less unstressed lengths of segments if nothing slips now, [n], m."""
        change, before = path.change, path.initial_length
        slip = jnp.pad(state.memory * state.thermal_stretch_or_one, 1)
        moved = jnp.diff(jnp.pad(state.initial_slip, 1))
        fed = state.fed_length * state.thermal_stretch_or_one
        elongation = (before - moved) / jnp.sum(before) * (state.elongation + jnp.sum(fed))
        elongation = elongation + change + moved + slip[1:] - slip[:-1]
        return elongation.at[0].add(-fed[0]) - jnp.where(is_last_segment(before), fed[1], 0.0)

    def closed_clamps(
        self, state: OwnState, length: Float[Array, " n_segment"]
    ) -> Bool[Array, " n_deviator"]:
        """Return at which deviators one cable is clamped; `length` is that of its segments, m."""
        return (state.clamped > 0) & (length[1:] > 0) & (length[:-1] > 0)  # no filler is

    def segment_tension(
        self, state: OwnState, ends: Ends, motion: Motion
    ) -> Float[Array, " n_segment"]:
        """Return the tension of every segment of one cable, [n_segment], N; 0 for fillers."""
        segments, found = self._segments_with_tensions(state, ends, motion)
        return jnp.where(segments.length > 0, found.tension, 0.0)

    def tension(self, state: OwnState, ends: Ends, motion: Motion) -> Scalar:
        """Return the mean tension of one cable over its present length, N."""
        segments, found = self._segments_with_tensions(state, ends, motion)
        return segments.length @ found.tension / jnp.sum(segments.length)

    def peak_tension(self, state: OwnState, ends: Ends, motion: Motion) -> Scalar:
        """Return the largest tension of the segments of one cable, N."""
        return jnp.max(self.segment_tension(state, ends, motion))

    def is_slack(self, state: OwnState, ends: Ends, motion: Motion) -> Bool[Array, ""]:
        """Return whether no segment of one cable has a tension."""
        return self.peak_tension(state, ends, motion) <= 0

    def at_kink(self, state: OwnState, ends: Ends, motion: Motion) -> Bool[Array, ""]:
        """Return whether one cable is just between taut and slack, or at its first slip.

        Where it has slipped before and loads pause, derivatives are those of slipping on.
        """
        segments, found = self._segments_with_tensions(state, ends, motion)
        change = at_slip_limit(found, segments.length) & (state.clamped == 0)
        change = change & (state.memory == 0)
        unstressed = self.is_unstressed(copy_with(state, jack_force=None), ends, motion)
        return jnp.any(change) | unstressed

    def absolute_force(self, state: OwnState, ends: Ends, motion: Motion) -> Scalar:
        """Return the largest tension of one cable, N: the scale of rounding."""
        return self.peak_tension(state, ends, motion)

    def end_forces(self, state: OwnState, ends: Ends, motion: Motion) -> Forces:
        """Return the internal force of one cable at every node, sliding load included, N."""
        along = self.path(ends, motion).along
        force = forces_of_segments(self.segment_tension(state, ends, motion)[:, None] * along)
        if state.line_load is None:
            return force
        return force - self.sliding_load_forces(state, ends, motion)

    def energy(self, state: OwnState, ends: Ends, motion: Motion) -> Scalar:
        """Return the stored energy of one cable and what friction dissipates in the increment, J.

        The work of friction is that of the differences of tension at its end. Friction has no
        potential: end forces are not the gradient of this sum.
        """
        segments, found = self._segments_with_tensions(state, ends, motion)
        strain = self.strain_at(found.tension)
        stored = jnp.sum(segments.length / (1 + strain) * self.energy_per_length(strain))
        before, after = found.deviator_tensions()
        lost = jnp.sum(jnp.abs(slip_lengths(found) * (after - before)))
        return stored + lost

    def rounding_error(self, state: OwnState, ends: Ends, motion: Motion) -> Forces:
        """Return the error of the end forces from the rounding of displacements, [n_end, 3], N."""
        along = self.path(ends, motion).along
        segments, found = self._segments_with_tensions(state, ends, motion)
        real = segments.length > 0
        rate = elongations_and_flexibilities(segments, found.tension)[1]
        moved = jnp.max(jnp.abs(motion[:, :3]))
        if self.radius is not None:  # tangent points are rounded, too
            moved = moved + jnp.max(self.radius)
        moved = 8 * jnp.finfo(moved.dtype).eps * moved
        force = jnp.where(real, moved / jnp.where(real, rate, 1.0), 0.0)
        return jnp.abs(forces_of_segments(force[:, None] * jnp.abs(along), 1.0))
