"""Elastic catenary: one element for a whole span, exact under its own weight (see `hanging`).

Its forces are the derivative of its potential energy: ``-+F`` at the ends, with the tension vector
``F`` in the middle, and half of the load at each end, which is exact. Its shape follows the dead
load along it at the present load factor (self-weight, line loads); without load it is a straight
cable.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import jax
import jax.numpy as jnp

from ..common.tree import pytree
from ..common.types import Array, Bool, Float, PyTree
from ..numerics.vectors import scalar_product
from . import hanging, hanging_sag, hanging_springs
from .abilities import END_PULL, Hanging, LengthSlack, RoundingEstimate, TensionResponse
from .cable import TensionOnly
from .element import PEAK_TENSION, Ends, Forces, Motion, Scalar
from .prestress import AxialState, measure_chord


@pytree(indices=("links",))
class Catenaries(TensionOnly, Hanging, RoundingEstimate):
    """A group of elastic catenaries, tension only: each hangs between its ends under its load.

    An element hangs under the weight of `SelfWeight` and the loads of `LineLoads` at the present
    load factor. Without load it is a straight cable, or slack and without force.

    The result `tension` is the mean of the tensions at both ends, which is at least half of the
    load on the element; `peak_tension` is the larger of the two, which strength is compared with;
    `forms.end_tensions` gives both. The result `end_pull` has the forces on both end nodes, [2, 3]
    for each element, N; shape, sag and clearance of any phase follow from it (`results.sags`).

    Prestress is stated as for `Cables`: a tension is that of the straight element without load. A
    `sag` is the vertical distance from the chord at midspan, under the whole weight along -z: for a
    span l, a chord d and the horizontal force H nearly ``w d l / (8 H)``, that of a parabola.

    A taut catenary without load takes its first load stiffly, not in proportion: `Incremental`
    needs small first increments or corrections there.

    Args:
        links: node numbers, [n_elem, 2].
        axial_stiffness: EA, scalar or [n_elem], N.
        rest_length: unstressed length, scalar or [n_elem], m; default the initial chord.
        weight: self-weight per unstressed length, scalar or [n_elem], N/m.
        expansion, strength, compliance: as of `Bars`.
        area, law, section: None, because a catenary is elastic.

    Raises:
        ValueError: as of `Bars`; also for a law or a section, because these have no closed form.

    Source: Irvine, Cable Structures (1981); Jayaraman and Knudson (1981).

    Example:
        Two cables of 60 m that meet in the middle form one catenary; its end slope is w s / H.

        >>> s, H, w, EA = 60.0, 6000.0, 30.0, 60e6  # m, N, N/m, N
        >>> x = H / w * np.arcsinh(w * s / H) + H * s / EA  # half of the span, m
        >>> nodes = [[-x, 0.0, 9.0], [0.0, 0.0, 0.0], [x, 0.0, 9.0]]
        >>> cables = jc.Catenaries([[0, 1], [1, 2]], axial_stiffness=EA, weight=w, rest_length=s)
        >>> structure = jc.Structure(nodes, cables, supports=jc.pinned([0, 2]))
        >>> solution = jc.solve(structure, jc.Phase(loads=jc.SelfWeight()))
        >>> print(solution.status, jnp.round(solution.reactions[2], 4))  # H, 0, w s
        0 [6000.    0. 1800.]
    """

    area: None = None
    law: None = None
    section: None = None

    shaped_by_load = True
    results = (*TensionOnly.results, PEAK_TENSION, END_PULL)

    def __post_init__(self):
        if self.law is not None or self.section is not None or self.area is not None:
            raise ValueError("law, area, section: a catenary is elastic; give axial_stiffness")
        super().__post_init__()

    def _solve_shape(self, state, ends, motion):
        """Return what solves the equations of one hanging cable at a motion of its ends.

        Returns:
            The tension vector at mid-length, [3], N; the mean of both end tensions, N; the shape
            parameter theta of `hanging`; and the chord vector, [3], m.
        """
        chord = (ends[1] - ends[0]) + (motion[1] - motion[0])
        force, tau, theta = hanging.solve_catenary(
            chord,
            squared_length_excess(state, ends, motion),
            state.line_load,
            state.rest_length,
            self.stiffness_with_spring,
        )
        return force, tau, theta, chord

    @property
    def stiffness_with_spring(self) -> Any:
        """Axial stiffness, N, of EA and the spring in series: ``EA / (1 + compliance EA)``."""
        return self._stiffness_law_and_area()[0]

    def has_result(self, name: str, state: AxialState) -> bool:
        """Return whether elements have the result `name`; those of both ends only under a load."""
        if name in ("peak_tension", "end_pull"):
            return state.line_load is not None
        return super().has_result(name, state)

    def tension(self, state: AxialState, ends: Ends, motion: Motion) -> Scalar:
        """Return the mean of the tensions at both ends of one cable, N."""
        if state.line_load is None:
            return super().tension(state, ends, motion)
        return self._solve_shape(state, ends, motion)[1]

    def _axial_force_vector(
        self, state: AxialState, ends: Ends, motion: Motion
    ) -> Float[Array, " 3"]:
        """Return the tension vector of one cable, [3], N; under a load the one at mid-length."""
        if state.line_load is None:
            return super()._axial_force_vector(state, ends, motion)
        return self._solve_shape(state, ends, motion)[0]

    def suits_cone_solver(self, state: AxialState) -> bool:
        """Return whether the law is linear and no phase has loads along the cables.

        Then they are straight, as `conic_interior_point` needs.
        """
        return state.line_load is None and super().suits_cone_solver(state)

    def tension_response(self, state: AxialState, ends: Ends, motion: Motion) -> TensionResponse:
        """Return tension, its stiffness and the end forces of one cable at a motion of its ends.

        Under a load the tension is the mean of both end tensions minus half of the load.
        """
        if state.line_load is None:
            return super().tension_response(state, ends, motion)
        shape = (
            (ends[1] - ends[0]) + (motion[1] - motion[0]),
            squared_length_excess(state, ends, motion),
        )
        span = (*shape, state.line_load, state.rest_length, self.stiffness_with_spring)
        tension = hanging.tension_unknown(*span)
        at = hanging_springs.hanging_under_tension(tension, *span)
        give = at.compliance + at.sag_compliance
        # a slack cable without load has no stiffness
        slope = jnp.where((tension > 0) | (shape[1] >= 0), 1 / give, 0.0)
        along, forces = (
            jnp.stack([-at.force_per_tension, at.force_per_tension]),
            jnp.stack([-at.force, at.force]),
        )
        return TensionResponse(tension, slope, along, forces, shape)

    def length_slack(self, state: AxialState, tension: Scalar, shape: PyTree[Array]) -> LengthSlack:
        """Return by how much one cable under a tension, N, would exceed its present length.

        `shape` is that of the `TensionResponse` at the present positions of its ends.
        """
        if state.line_load is None:
            return super().length_slack(state, tension, shape)
        chord, above = shape
        load, rest_length = state.line_load, state.rest_length
        at = hanging_springs.hanging_under_tension(
            tension, chord, above, load, rest_length, self.stiffness_with_spring
        )
        along, forces = (
            jnp.stack([-at.force_per_tension, at.force_per_tension]),
            jnp.stack([-at.force, at.force]),
        )
        return LengthSlack(at.spare_length, at.compliance, at.sag, at.sag_compliance, along, forces)

    def geometric_stiffness(
        self, state: AxialState, ends: Ends, motion: Motion, tension: Scalar
    ) -> Float[Array, "2 3 2 3"]:
        """Return the derivative of the end forces of one cable at constant tension, N/m."""
        if state.line_load is None:
            return super().geometric_stiffness(state, ends, motion, tension)
        block = hanging_springs.stiffness_under_tension(
            tension, state.line_load, state.rest_length, self.stiffness_with_spring
        )
        return jnp.stack([jnp.stack([block, -block], 1), jnp.stack([-block, block], 1)])

    def rounding_error(self, state: AxialState, ends: Ends, motion: Motion) -> Forces:
        """Return an estimate of the absolute error of the end forces, [2, 3], N, from rounding."""
        at = self.tension_response(state, ends, motion)
        moved = 8 * jnp.finfo(motion.dtype).eps * jnp.max(jnp.abs(motion))
        return moved * at.slope * jnp.abs(at.unit_forces)

    def energy(self, state: AxialState, ends: Ends, motion: Motion) -> Scalar:
        """Return the energy of one cable whose gradient its end forces are, J.

        It is the stored energy plus the potential of the load along the cable, minus the potential
        of the same load with a half at each end.
        """
        if state.line_load is None:
            return super().energy(state, ends, motion)
        force, tau, theta, chord = self._solve_shape(state, ends, motion)
        return hanging.stored_energy(
            force, tau, theta, chord, state.line_load, state.rest_length, self.stiffness_with_spring
        )

    def is_slack(self, state: AxialState, ends: Ends, motion: Motion) -> Bool[Array, ""]:
        """Return whether one cable is longer than its chord, unstressed, and without load."""
        slack = self.strain(state, ends, motion) < 0
        if state.line_load is None:
            return slack
        return slack & jnp.all(state.line_load == 0)

    def at_kink(self, state: AxialState, ends: Ends, motion: Motion) -> Bool[Array, ""]:
        """Return whether strain and load of one cable are zero; a load makes its force smooth."""
        kink = super().at_kink(state, ends, motion)
        return kink if state.line_load is None else kink & jnp.all(state.line_load == 0)

    def section_strain(self, state: AxialState, ends: Ends, motion: Motion) -> Scalar:
        """Return the axial strain of one cable: under a load along it that of its tension."""
        strain = super().section_strain(state, ends, motion)
        if state.line_load is None:
            return strain
        pulled = self.strain_at(self.tension(state, ends, motion))
        return jnp.where(jnp.any(state.line_load != 0), pulled, strain)

    def end_tensions(self, state: AxialState, ends: Ends, motion: Motion) -> Float[Array, " 2"]:
        """Return the tensions of one cable at its first and its second end, [2], N."""
        if state.line_load is None:
            return jnp.repeat(super().tension(state, ends, motion), 2)
        return _end_tensions(self._solve_shape(state, ends, motion)[0], state)

    def peak_tension(self, state: AxialState, ends: Ends, motion: Motion) -> Scalar:
        """Return the larger of the tensions at both ends of one cable, N, the largest along it."""
        return jnp.max(self.end_tensions(state, ends, motion))

    def end_pull(self, state: AxialState, ends: Ends, motion: Motion) -> Forces:
        """Return the forces of one cable on the nodes at its first and its last end, [2, 3], N.

        Their sum is the whole load along the cable.
        """
        return _end_pull(self._axial_force_vector(state, ends, motion), state)

    def results_by_name(
        self, state: AxialState, ends: Ends, motion: Motion, names: Sequence[str]
    ) -> dict[str, Array]:
        """Return results of one cable by name; its shape, found by iteration, is solved once."""
        if state.line_load is None:
            return super().results_by_name(state, ends, motion, names)
        force, tau, *_ = self._solve_shape(state, ends, motion)
        known = {
            "tension": tau,
            "peak_tension": jnp.max(_end_tensions(force, state)),
            "end_pull": _end_pull(force, state),
            "end_forces": jnp.stack([-force, force]),
        }
        others = super().results_by_name(
            state, ends, motion, [name for name in names if name not in known]
        )
        return others | {name: known[name] for name in names if name in known}

    def sag(self, state: AxialState, ends: Ends, motion: Motion) -> Scalar:
        """Return the distance of one cable from its chord at midspan, along its load, m."""
        force, _, theta, _ = self._solve_shape(state, ends, motion)
        load: Float[Array, " 3"] = state.line_load  # type: ignore[assignment]  # under a load
        return hanging_sag.midspan_sag(force, theta, load, self.stiffness_with_spring)

    def curve(
        self, state: AxialState, ends: Ends, motion: Motion, parts: Float[Array, " n_place"]
    ) -> Float[Array, "n_place 3"]:
        """Return points of one cable, m, at `parts` (0 to 1) of its unstressed length."""
        first = ends[0] + motion[0]
        if state.line_load is None:
            return first[None] + jnp.outer(parts, ends[1] + motion[1] - first)
        force, tau, _, _ = self._solve_shape(state, ends, motion)
        load, rest_length = state.line_load, state.rest_length
        return first[None] + hanging.positions_along(
            parts, force, tau, load, rest_length, self.stiffness_with_spring
        )

    def strain_at_sag(
        self,
        ends: Float[Array, "n_elem 2 3"],
        sag: Float[Array, " n_elem"],
        thermal_stretch: float | Float[Array, " n_elem"] = 1.0,
    ) -> Float[Array, " n_elem"]:
        """Return the strains of the initial chords at which elements have given sags, [n_elem].

        Sags are vertical distances from the chords at midspan, [n_elem], m, under the whole weight
        along -z; `ends` are initial positions. `thermal_stretch` is as in `AxialState`: an element
        that heat has lengthened weighs less per length.
        """

        def one(ends, weight, stiffness, sag):
            load = weight * jnp.array([0.0, 0.0, -1.0], ends.dtype)
            return hanging_sag.chord_strain_at_sag(ends[1] - ends[0], load, stiffness, sag)

        weight = jnp.asarray(self.weight, ends.dtype) / thermal_stretch
        stiffness = jnp.asarray(self.stiffness_with_spring, ends.dtype)
        return jax.vmap(one)(ends, weight, stiffness, sag)


def _end_tensions(force, state):
    """Return the tensions at the first and the second end of one cable under a load, [2], N.

    `force` is the tension vector at mid-length, [3], N.
    """
    half = 0.5 * state.rest_length * state.line_load
    return jnp.sqrt(jnp.stack([jnp.sum((force + half) ** 2), jnp.sum((force - half) ** 2)]))


def _end_pull(force, state):
    """Return the forces on the nodes at both ends, [2, 3], N.

    `force` is the tension vector at mid-length, [3], N, towards the second end.
    """
    if state.line_load is None:
        return jnp.stack([force, -force])
    half = 0.5 * state.rest_length * state.line_load
    return jnp.stack([half + force, half - force])


def squared_length_excess(state: AxialState, ends: Ends, motion: Motion) -> Scalar:
    """Return ``|chord|^2 - L0^2`` of one element, m2, computed without this subtraction."""
    start, w = ends[1] - ends[0], motion[1] - motion[0]
    length = measure_chord(ends, jnp.zeros_like(ends))[3]
    return state.elongation * (length + state.rest_length) + scalar_product(2 * start + w, w)
