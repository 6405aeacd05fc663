"""Elastic catenary: one element for a whole span, exact under its own weight (see `hanging`).

Its forces are the derivative of its potential energy: ``-+F`` at the ends, with the tension vector
``F`` in the middle, and half of the load at each end, which is exact. Its shape follows the dead
load along it at the present load factor (self-weight, line loads); without load it is a straight
cable.
"""

from __future__ import annotations

from collections.abc import Sequence

import jax
import jax.numpy as jnp

from ..common.tree import pytree
from ..common.types import Array, Bool, Float, PyTree
from ..numerics.vectors import scalar_product
from . import hanging, hanging_sag, hanging_springs
from .abilities import LengthSlack, Rounding, Sagging, TensionResponse
from .cable import TensionOnly
from .element import PEAK_TENSION, Ends, Forces, Motion, Scalar
from .prestress import AxialState, measure_chord


@pytree(indices=("links",))
class Catenaries(TensionOnly, Sagging, Rounding):
    """A group of elastic catenaries, tension only; results per element are means over its ends.

    It carries the weight of `SelfWeight` and the loads of `LineLoads`, at the present load factor;
    a slack catenary without load has no force. The result `tension` is the mean of the tensions at
    the two ends, which is at least half of the load on the element; `peak_tension` is the larger of
    the two, which strength is compared with; `forms.end_tensions` gives both. Prestress is stated
    as for cables: a tension is that of the straight element without load; a `sag` is the vertical
    distance from the chord at midspan under the whole weight along -z: a conductor over the span l
    with the chord d, strung with the horizontal force H, has the sag ``w d l / (8 H)``, but for the
    flatness of a parabola. A taut catenary without load takes its
    first load stiffly, not in proportion: `Incremental` needs small first increments or corrections
    there.

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
    results = (*TensionOnly.results, PEAK_TENSION)

    def __post_init__(self):
        if self.law is not None or self.section is not None or self.area is not None:
            raise ValueError("law, area, section: a catenary is elastic; give axial_stiffness")
        super().__post_init__()

    def _solve_shape(self, state, ends, motion):
        """Return the tension vector F in the middle, tau, theta (see `hanging`), and the chord."""
        chord = (ends[1] - ends[0]) + (motion[1] - motion[0])
        force, tau, theta = hanging.solve_catenary(
            chord,
            squared_length_excess(state, ends, motion),
            state.line_load,
            state.rest_length,
            self._stiffness,
        )
        return force, tau, theta, chord

    @property
    def _stiffness(self):
        return self._axial_section()[0]

    def has_result(self, name: str, state: AxialState) -> bool:
        """Return whether it has a result; a peak tension only under a load."""
        if name == "peak_tension":
            return state.line_load is not None
        return super().has_result(name, state)

    def tension(self, state: AxialState, ends: Ends, motion: Motion) -> Scalar:
        """Return the mean of the tensions at both ends, N."""
        if state.line_load is None:
            return super().tension(state, ends, motion)
        return self._solve_shape(state, ends, motion)[1]

    def _pull(self, state: AxialState, ends: Ends, motion: Motion) -> Float[Array, " 3"]:
        if state.line_load is None:
            return super()._pull(state, ends, motion)
        return self._solve_shape(state, ends, motion)[0]

    def suits_cone_solver(self, state: AxialState) -> bool:
        """Return whether `conic_interior_point` applies: without loads along them in any phase."""
        return state.line_load is None and super().suits_cone_solver(state)

    def tension_response(self, state: AxialState, ends: Ends, motion: Motion) -> TensionResponse:
        """Return the `TensionResponse`; under a load its tension is ``tau - |q| L0/2``."""
        if state.line_load is None:
            return super().tension_response(state, ends, motion)
        shape = (
            (ends[1] - ends[0]) + (motion[1] - motion[0]),
            squared_length_excess(state, ends, motion),
        )
        span = (*shape, state.line_load, state.rest_length, self._stiffness)
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
        """Return the `LengthSlack` under a tension; of a hanging cable by `hanging_springs`."""
        if state.line_load is None:
            return super().length_slack(state, tension, shape)
        chord, above = shape
        load, rest_length = state.line_load, state.rest_length
        at = hanging_springs.hanging_under_tension(
            tension, chord, above, load, rest_length, self._stiffness
        )
        along, forces = (
            jnp.stack([-at.force_per_tension, at.force_per_tension]),
            jnp.stack([-at.force, at.force]),
        )
        return LengthSlack(at.spare_length, at.compliance, at.sag, at.sag_compliance, along, forces)

    def geometric_stiffness(
        self, state: AxialState, ends: Ends, motion: Motion, tension: Scalar
    ) -> Float[Array, "2 3 2 3"]:
        """Return the geometric stiffness; under a load by the two springs of `hanging_springs`."""
        if state.line_load is None:
            return super().geometric_stiffness(state, ends, motion, tension)
        block = hanging_springs.tension_stiffness(
            tension, state.line_load, state.rest_length, self._stiffness
        )
        return jnp.stack([jnp.stack([block, -block], 1), jnp.stack([-block, block], 1)])

    def rounding_error(self, state: AxialState, ends: Ends, motion: Motion) -> Forces:
        """Return the error of the end forces by rounding of displacements, [2, 3], N."""
        at = self.tension_response(state, ends, motion)
        moved = 8 * jnp.finfo(motion.dtype).eps * jnp.max(jnp.abs(motion))
        return moved * at.slope * jnp.abs(at.unit_forces)

    def energy(self, state: AxialState, ends: Ends, motion: Motion) -> Scalar:
        """Return stored energy plus potential of the load along it, less its end shares, J."""
        if state.line_load is None:
            return super().energy(state, ends, motion)
        force, tau, theta, chord = self._solve_shape(state, ends, motion)
        return hanging.stored_energy(
            force, tau, theta, chord, state.line_load, state.rest_length, self._stiffness
        )

    def is_slack(self, state: AxialState, ends: Ends, motion: Motion) -> Bool[Array, ""]:
        """Return whether its unstressed length exceeds its chord and no load acts on it."""
        slack = self.strain(state, ends, motion) < 0
        if state.line_load is None:
            return slack
        return slack & jnp.all(state.line_load == 0)

    def at_kink(self, state: AxialState, ends: Ends, motion: Motion) -> Bool[Array, ""]:
        """Return whether it is unstressed and without load; a load makes its force smooth."""
        kink = super().at_kink(state, ends, motion)
        return kink if state.line_load is None else kink & jnp.all(state.line_load == 0)

    def end_tensions(self, state: AxialState, ends: Ends, motion: Motion) -> Float[Array, " 2"]:
        """Tensions at the first and the second end, [2], N."""
        if state.line_load is None:
            return jnp.repeat(super().tension(state, ends, motion), 2)
        return _end_tensions(self._solve_shape(state, ends, motion)[0], state)

    def peak_tension(self, state: AxialState, ends: Ends, motion: Motion) -> Scalar:
        """Return the larger of the tensions at both ends, N; it is smaller between them."""
        return jnp.max(self.end_tensions(state, ends, motion))

    def results_by_name(
        self, state: AxialState, ends: Ends, motion: Motion, names: Sequence[str]
    ) -> dict[str, Array]:
        """Return results by name; the shape, which takes an iteration, is computed once."""
        if state.line_load is None:
            return super().results_by_name(state, ends, motion, names)
        force, tau, *_ = self._solve_shape(state, ends, motion)
        known = {
            "tension": tau,
            "peak_tension": jnp.max(_end_tensions(force, state)),
            "end_forces": jnp.stack([-force, force]),
        }
        others = super().results_by_name(
            state, ends, motion, [name for name in names if name not in known]
        )
        return others | {name: known[name] for name in names if name in known}

    def sag(self, state: AxialState, ends: Ends, motion: Motion) -> Scalar:
        """Return the distance of the cable from its chord at midspan, along the load, m."""
        force, _, theta, _ = self._solve_shape(state, ends, motion)
        load: Float[Array, " 3"] = state.line_load  # type: ignore[assignment]  # under a load
        return hanging_sag.midspan_sag(force, theta, load, self._stiffness)

    def curve(
        self, state: AxialState, ends: Ends, motion: Motion, parts: Float[Array, " n"]
    ) -> Float[Array, "n 3"]:
        """Return positions along the element, [n, 3], m, at parts [n] of its unstressed length."""
        first = ends[0] + motion[0]
        if state.line_load is None:
            return first[None] + jnp.outer(parts, ends[1] + motion[1] - first)
        force, tau, _, _ = self._solve_shape(state, ends, motion)
        load, rest_length = state.line_load, state.rest_length
        return first[None] + hanging.positions_along(
            parts, force, tau, load, rest_length, self._stiffness
        )

    def strain_at_sag(
        self,
        ends: Float[Array, "n_elem 2 3"],
        sag: Float[Array, " n_elem"],
        thermal_stretch: float | Float[Array, " n_elem"] = 1.0,
    ) -> Float[Array, " n_elem"]:
        """Return the strains of the chords at which elements have given sags [n_elem], m.

        Sags are vertical distances from the chords between the initial ends [n_elem, 2, 3] at
        midspan, under the whole weight of the group along -z. `thermal_stretch` as in `AxialState`:
        an element that heat has lengthened weighs less per length.
        """

        def one(ends, weight, stiffness, sag):
            load = weight * jnp.array([0.0, 0.0, -1.0], ends.dtype)
            return hanging_sag.strain_at_sag(ends[1] - ends[0], load, stiffness, sag)

        weight = jnp.asarray(self.weight, ends.dtype) / thermal_stretch
        stiffness = jnp.asarray(self._stiffness, ends.dtype)
        return jax.vmap(one)(ends, weight, stiffness, sag)


def _end_tensions(force, state):
    """Return the tensions at both ends, [2], N, from the tension vector in the middle, [3]."""
    half = 0.5 * state.rest_length * state.line_load
    return jnp.sqrt(jnp.stack([jnp.sum((force + half) ** 2), jnp.sum((force - half) ** 2)]))


def squared_length_excess(state: AxialState, ends: Ends, motion: Motion) -> Scalar:
    """Return ``|chord|^2 - L0^2``, computed without this subtraction, m2."""
    start, w = ends[1] - ends[0], motion[1] - motion[0]
    length = measure_chord(ends, jnp.zeros_like(ends))[3]
    return state.elongation * (length + state.rest_length) + scalar_product(2 * start + w, w)
