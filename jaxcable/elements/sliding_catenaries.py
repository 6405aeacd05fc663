"""Hanging cables that slide over their nodes: an elastic catenary between any two of them."""

from __future__ import annotations

from typing import Any

import jax
import jax.numpy as jnp

from ..common.tree import copy_with, pytree
from ..common.types import Array, Bool, Float
from . import hanging, hanging_sag
from .element import PEAK_TENSION, TENSION, Ends, Forces, Motion, Result, Scalar
from .element_state import OwnState
from .friction import slip_lengths
from .friction_cables import FrictionCables
from .friction_state import CLAMP_FORCE, FRICTION_USED, SEGMENT_TENSION, SLIP
from .hanging_friction import HangingSegments, hanging_tensions, shallow_elongations
from .sliding import forces_of_segments, moved_segments_with_lengths

END_TENSIONS = Result("end_tensions", "N", ("first", "last"))
"""Tensions at the first and the last end of every segment, [n_segment, 2]; 0 for fillers."""
SEGMENT_PULL = Result("segment_pull", "N", ("x1", "y1", "z1", "x2", "y2", "z2"), increments=False)
"""Forces of every segment on the nodes at its first and its last end, [n_segment, 6]."""
SEGMENT_LENGTH = Result("segment_length", "m")
"""Unstressed length of every segment, at its present temperature; 0 for fillers."""
SEGMENT_SAG = Result("segment_sag", "m")
"""Distance of every segment from its chord at midspan, along its load; 0 for fillers."""


@pytree(indices=("links",), kw_only=True)
class SlidingCatenaries(FrictionCables):
    """A group of hanging cables that slide over their nodes: ropeways, stays over a saddle, lines.

    Between two nodes a cable hangs as an elastic catenary under its weight and the loads of
    `LineLoads` per unstressed length, exact in one segment. At the nodes between its ends it slides
    with friction as `FrictionCables`, or without any (conductors on stringing pulleys): the
    tensions beside the node differ at most by ``exp(b)``, with the angle between the *tangents*
    there. What slips takes its weight along.

    A deep segment, whose tension rises with its length, pulls ever more cable towards itself if it
    slips: there is no equilibrium then, and the analysis ends with a status (NONFINITE, or
    NOT_CONVERGED). It is deep from a sag of about a third of a level span on.

    `tension` of a cable is the mean over its chords, `segment_tension` the mean of both ends of
    each segment, `end_tensions` has both; `segment_sag`, `segment_length` (unstressed) and
    `segment_pull` (forces on the nodes) describe the catenaries. A jack pulls with its force at the
    first end.

    Args:
        links, friction, axle_friction, wobble: as of `FrictionCables`.
        axial_stiffness, rest_length, weight, expansion, strength: as of `SlidingCables`.
        compliance: as of `SlidingCables`.
        area, law, section: None, because a catenary is elastic.
        radius, axis: None; the cable bends at its nodes.

    Raises:
        ValueError: as of `FrictionCables`; also for a law, a section or a radius.

    Source: as of `Catenaries` and `FrictionCables`.

    Example:
        A conductor on a pulley between spans of 200 and 300 m, on one level: without friction the
        tensions beside the pulley are equal.

        >>> nodes = [[0.0, 0.0, 0.0], [200.0, 0.0, 0.0], [500.0, 0.0, 0.0]]
        >>> line = jc.SlidingCatenaries(
        ...     links=[[0, 1, 2]], axial_stiffness=3e7, weight=15.0, rest_length=502.0
        ... )
        >>> structure = jc.Structure(nodes, {"line": line}, jc.pinned([0, 1, 2]))
        >>> solution = jc.solve(structure, jc.Phase(loads=jc.SelfWeight()))
        >>> tensions = solution.element_results["end_tensions"]["line"][0]
        >>> print(solution.status, bool(jnp.allclose(tensions[0, 1], tensions[1, 0])))
        0 True
    """

    area: None = None
    law: None = None
    section: None = None
    radius: None = None
    axis: None = None

    is_chain = False
    results = (  # others than those of straight segments
        *(TENSION, PEAK_TENSION, SEGMENT_TENSION, SLIP, FRICTION_USED, CLAMP_FORCE),
        *(END_TENSIONS, SEGMENT_PULL, SEGMENT_LENGTH, SEGMENT_SAG),
    )

    def __post_init__(self):
        if self.law is not None or self.section is not None or self.area is not None:
            raise ValueError("law, area, section: a catenary is elastic; give axial_stiffness")
        if self.radius is not None or self.axis is not None:
            raise ValueError("radius: hanging cables bend at their nodes; take FrictionCables")
        super().__post_init__()

    @property
    def stiffness_with_spring(self) -> Any:
        """Axial stiffness, N, of EA and of springs in series with it, if there are any."""
        return self._stiffness_law_and_area()[0]

    @property
    def has_friction(self) -> bool:
        """Whether any coefficient of friction is given."""
        return any(x is not None for x in self.coefficients())

    def without_friction(self, state: OwnState) -> tuple[Any, OwnState]:
        """Return the cables as they slide without friction and clamps, and their state."""
        open_clamps = jnp.zeros_like(state.clamped)
        group = copy_with(self, friction=None, axle_friction=None, wobble=None)
        return group, copy_with(state, clamped=open_clamps)

    # --- one cable

    def _segments_with_tensions(self, state, ends, motion):
        """Return the `HangingSegments` of one cable, and their `SegmentTensions`."""
        return self._solve_shape(state, ends, motion)[:2]

    def _solve_shape(self, state, ends, motion):
        """Return `HangingSegments`, `SegmentTensions` and `HangingShape` of one cable."""
        chord, length = moved_segments_with_lengths(ends, motion)
        load = jnp.zeros_like(chord[0]) if state.line_load is None else state.line_load
        segments = HangingSegments(
            self.coefficients(),
            chord,
            length,
            self.stuck_elongations(state, self.path(ends, motion)),
            load,
            jnp.asarray(self.stiffness_with_spring, length.dtype),
            self.closed_clamps(state, length),
            state.jack,
        )
        return segments, *hanging_tensions(segments)

    def end_tensions(
        self, state: OwnState, ends: Ends, motion: Motion
    ) -> Float[Array, "n_segment 2"]:
        """Return the tensions at both ends of every segment of one cable, [n_segment, 2], N.

        They are zero in segments of length zero, with which shorter cables are filled up.
        """
        segments, found = self._segments_with_tensions(state, ends, motion)
        both = jnp.stack([found.tension + found.drop, found.tension - found.drop], axis=1)
        return jnp.where(segments.length[:, None] > 0, both, 0.0)

    def segment_pull(
        self, state: OwnState, ends: Ends, motion: Motion
    ) -> Float[Array, "n_segment 6"]:
        """Return the forces of every segment on the nodes at its first and last end, N.

        The sum of a pair is the load on the segment.
        """
        segments, _, shape = self._solve_shape(state, ends, motion)
        half = 0.5 * shape.unstressed[:, None] * segments.load[None]
        return jnp.concatenate([half + shape.force, half - shape.force], axis=1)

    def segment_length(
        self, state: OwnState, ends: Ends, motion: Motion
    ) -> Float[Array, " n_segment"]:
        """Return the unstressed lengths of the segments of one cable, [n_segment], m."""
        return self._solve_shape(state, ends, motion)[2].unstressed

    def peak_tension(self, state: OwnState, ends: Ends, motion: Motion) -> Scalar:
        """Return the largest tension along one cable, N."""
        return jnp.max(self.end_tensions(state, ends, motion))

    def segment_sag(
        self, state: OwnState, ends: Ends, motion: Motion
    ) -> Float[Array, " n_segment"]:
        """Return the distances of the segments of one cable from their chords, [n_segment], m.

        They are taken at midspan, along the load; NaN without load.
        """
        segments, _, shape = self._solve_shape(state, ends, motion)
        real = segments.length > 0
        force = jnp.where(real[:, None], shape.force, jnp.asarray([1.0, 0.0, 0.0]))

        def one(force, theta):
            return hanging_sag.midspan_sag(force, theta, segments.load, segments.stiffness)

        return jnp.where(real, jax.vmap(one)(force, jnp.where(real, shape.theta, 1.0)), 0.0)

    def is_unstressed(self, state: OwnState, ends: Ends, motion: Motion) -> Bool[Array, ""]:
        """Return whether one cable has no strain; a load makes its forces smooth there: False."""
        unstressed = super().is_unstressed(state, ends, motion)
        if state.line_load is None:
            return unstressed
        return unstressed & jnp.all(state.line_load == 0)

    def end_forces(self, state: OwnState, ends: Ends, motion: Motion) -> Forces:
        """Return the internal force of one cable at every node, beside its shares of the load, N.

        The loads of an analysis have the shares of the nodes in the initial position; the cable
        hangs under the load of its present segments.
        """
        segments, _, shape = self._solve_shape(state, ends, motion)
        return forces_of_segments(shape.force) - self._moved_load(state, ends, segments, shape)

    def sliding_load_forces(self, state: OwnState, ends: Ends, motion: Motion) -> Forces:
        """Return nodal forces of the load of one cable minus its initial shares, N."""
        segments, _, shape = self._solve_shape(state, ends, motion)
        return self._moved_load(state, ends, segments, shape)

    def _moved_load(self, state, ends, segments, shape):
        """Return half the loads of present segments at their ends, minus initial shares, N."""
        now = forces_of_segments(0.5 * shape.unstressed[:, None], 1.0)
        share = self.split_among_ends(jnp.ones((1,), now.dtype), ends[None])[0]
        return (now - state.rest_length * share[:, None]) * segments.load[None]

    def energy(self, state: OwnState, ends: Ends, motion: Motion) -> Scalar:
        """Return the energy of one cable, J: of strain, of its load, and lost by friction.

        Added to the strain energy is the potential of the load along the cable; subtracted is that
        of the shares of the load that act at its nodes, which the structure has as nodal forces.
        What friction dissipates in the increment is added, as in `FrictionCables.energy`.
        """
        segments, found, shape = self._solve_shape(state, ends, motion)
        real = segments.length > 0
        stored = jax.vmap(hanging.stored_energy, (0, 0, 0, 0, None, 0, None))(
            *(shape.force, shape.tension, shape.theta, segments.chord, segments.load),
            jnp.where(real, shape.unstressed, 1.0),
            segments.stiffness,
        )
        place = ends - ends[:1] + motion
        middle = 0.5 * (place[1:] + place[:-1])
        share = self.split_among_ends(jnp.ones((1,), middle.dtype), ends[None])[0]
        moved = state.rest_length * (share @ place) - shape.unstressed @ middle
        before, after = found.deviator_tensions()
        lost = jnp.sum(jnp.abs(slip_lengths(found) * (after - before)))
        return jnp.sum(jnp.where(real, stored, 0.0)) + segments.load @ moved + lost

    def rounding_error(self, state: OwnState, ends: Ends, motion: Motion) -> Forces:
        """Return the error of the end forces from the rounding of displacements, [n_end, 3], N."""
        segments, found = self._segments_with_tensions(state, ends, motion)
        real = segments.length > 0
        rate = shallow_elongations(segments, found.tension)[1]
        moved = 8 * jnp.finfo(rate.dtype).eps * jnp.max(jnp.abs(motion))
        force = jnp.where(real, moved / jnp.where(real, rate * segments.length, 1.0), 0.0)
        return forces_of_segments(force[:, None] * jnp.abs(segments.chord), 1.0)
