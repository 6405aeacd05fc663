"""Dead wind loads on members, by the cross-flow principle and a profile over the height."""

from __future__ import annotations

from typing import Any, Literal, Self

import jax.numpy as jnp
import numpy as np

from ..common import checks
from ..common.negligible import vector_text
from ..common.rules import Rule, not_negative, refuse_if_broken
from ..common.selection import Selection
from ..common.tree import copy_with, pytree, set_fields
from ..common.types import Array, ArrayLike, Float
from ..common.units import SI, Units
from ..elements.element import Element, OwnState
from ..model.structure import Structure
from ..numerics import scaled
from .along import GEOMETRIES
from .groups import Key, OnGroups
from .load import ForceOnlyLoad, LoadPerGeometry, Positions
from .member_values import check_member_values, require_members, with_member_factors
from .wind_profiles import WindProfile

# Gauss points from 0 to 1 along a member: three integrate a pressure and its moment exactly that is
# a polynomial of degree 4 of the height
_PLACES, _WEIGHTS = np.polynomial.legendre.leggauss(3)
_PLACES, _WEIGHTS = 0.5 * (1 + _PLACES), 0.5 * _WEIGHTS
_END_SHARES = np.stack([_WEIGHTS * (1 - _PLACES), _WEIGHTS * _PLACES], axis=1)

_PER_MEMBER = ("drag", "diameter", "ice", "factor")


@pytree(static=("on", "geometry"))
class WindLoads(OnGroups, ForceOnlyLoad, LoadPerGeometry):
    """Wind on cables, bars, catenaries, sliding cables and beams, across each of them.

    By the cross-flow principle only the part of the wind that is normal to a member presses on it,
    in the direction of this part. With the velocity pressure q of the undisturbed wind, and the
    angle a between wind and member, the force per length is ``q drag diameter sin(a)**2``. There
    is no force along members and no lift, and the drag coefficient does not depend on the angle,
    nor on the velocity.

    The load is dead: direction and length of the chord between two nodes are those of `geometry`,
    and do not change while it acts. A cable that sags between its ends is pressed as its chord is:
    with a sag of 3 % of the chord the error is below 0.5 % of the force across the wind, with 10 %
    below 5 % (divide such a cable into several elements). The pressure is integrated along every
    chord by three Gauss points, and each end has its share: resultant and moment of an element are
    right to 0.1 % where the profile is smooth. Of an element from the ground over the corner of
    `EurocodeWind` at its lowest height, such as a guy as high as the mast, the resultant is right
    to 1.5 % and its moment to 3 %. Beams bend, and catenaries hang, under the mean of the pressure
    on the element, so that shear forces of beams have steps at nodes. The load acts on elements
    whenever they are there (`Phase`).

    Args:
        direction: the direction towards which the wind blows, [3], without unit, of any length;
            not necessarily horizontal.
        profile: velocity pressure over the height: `EurocodeWind`, `WindPowerLaw`, `WindTable`, or
            one of your own (`extend.WindProfile`).
        drag: drag (force) coefficient, without unit, scalar or [n_elem], of the iced member if it
            is iced; about 1.2 for round cables and tubes below the critical Reynolds number.
        diameter: diameter, or width across the wind, scalar or [n_elem], m; without ice.
        on: key of the loaded group in the structure's elements, such as "guys", or its place from 0
            where these are a list; None loads all groups whose elements have a length.
        ice: thickness of the ice around members, scalar or [n_elem], m, which makes them wider by
            twice this; its weight is that of `IceLoads`. None: no ice.
        factor: factor of the forces, without unit, scalar or [n_elem]: gust factor, factors of
            patches, partial factor. Default 1.
        ground: height of the ground, m, along `vertical`; default 0.
        vertical: direction upwards, [3], without unit, of any length; default (0, 0, 1).
        geometry: "input", that of the structure's nodes, or "begun", that at the beginning of the
            phase that adds the load, the form after prestress.
        elements: `Selection` of the elements of that group that are loaded; None loads all.

    Raises:
        ValueError: wrong shapes, a direction that is zero, negative coefficients or widths (traced
            ones end in INVALID_INPUT), no profile, an unknown `geometry`; where a phase is
            analysed, a group or element that the structure does not have, or a group without
            length.

    Source: Hoerner, Fluid-Dynamic Drag (1965), 3-11 (cross-flow principle).

    Example:
        A wind of 500 N/m2 on a stay that rises by 3 m over 4 m, with the wind and across it: 2 m
        times ``sin(a)**2``, which is ``(3 / 5)**2`` and 1, and half of the force at each end.

        >>> nodes = [[0.0, 0.0, 0.0], [4.0, 0.0, 3.0]]
        >>> stay = jc.Bars([[0, 1]], axial_stiffness=1e6)
        >>> structure = jc.Structure(nodes, stay, supports=jc.pinned([0, 1]))
        >>> for direction in ((1.0, 0.0, 0.0), (0.0, 1.0, 0.0)):
        ...     steady = jc.WindTable(pressures=500.0)
        ...     wind = jc.WindLoads(direction, steady, drag=1.2, diameter=0.05)
        ...     solution = jc.solve(structure, jc.Phase(loads=wind))
        ...     print(solution.status, jnp.round(solution.load[0], 6))
        0 [ 16.2   0.  -21.6]
        0 [ 0. 75.  0.]
    """

    direction: Float[ArrayLike, " 3"]
    profile: WindProfile
    drag: Float[ArrayLike, ""] | Float[ArrayLike, " n_elem"]
    diameter: Float[ArrayLike, ""] | Float[ArrayLike, " n_elem"]
    on: Key = None
    ice: Float[ArrayLike, ""] | Float[ArrayLike, " n_elem"] | None = None
    factor: Float[ArrayLike, ""] | Float[ArrayLike, " n_elem"] = 1.0
    ground: Float[ArrayLike, ""] = 0.0
    vertical: Float[ArrayLike, " 3"] = (0.0, 0.0, 1.0)
    geometry: Literal["input", "begun"] = "input"
    elements: Selection | None = None
    begin_nodes: Float[Array, "n_row 3"] | None = (
        None  # nodes at the beginning of the phase, [n_row, 3], m; set by the analysis
    )
    element_factors: dict[int, Float[Array, " n_elem"]] | None = (
        None  # by index of group: drag times width times factor, m; set by the analysis
    )

    scales = ("factor",)

    def __post_init__(self):
        self._check_selection()
        for name in ("direction", "vertical"):
            vector = checks.floats_of_shape(getattr(self, name), name, (3,))
            set_fields(self, **{name: vector})
        if not isinstance(self.profile, WindProfile):
            kind = checks.describe_type(self.profile, "WindTable(pressures=500.0)")
            raise ValueError(
                "profile: expected a wind profile such as EurocodeWind(25.0, 'II') or "
                f"WindTable(pressures=500.0), got {kind}"
            )
        check_member_values(self, _PER_MEMBER)
        set_fields(self, ground=checks.as_scalar(self.ground, "ground"))
        checks.require_one_of(self.geometry, "geometry", GEOMETRIES)
        refuse_if_broken(self.rules())

    def rules(self) -> list[Rule]:
        """Return the rules: directions are not zero; drag, diameter, ice not negative; a list."""
        text = "is zero; give the direction towards which the wind blows, such as (1, 0, 0)"
        return [
            Rule("direction", self.direction, lambda v: (v == 0).all(), text),
            Rule("vertical", self.vertical, lambda v: (v == 0).all(), "is zero; it points upwards"),
            *[not_negative(name, getattr(self, name)) for name in ("drag", "diameter", "ice")],
        ]

    def check(self, structure: Structure) -> None:
        """Raise ValueError if the structure lacks the loaded group, or it has no lengths."""
        require_members(self, structure, _PER_MEMBER)

    def with_group_indices(self, structure: Structure) -> Self:
        """Return the load in the form of an analysis: `on` becomes indices of groups.

        Drag coefficient times width, times the factor where elements have their own, becomes
        `element_factors`, zero where the load does not act.
        """
        load = super().with_group_indices(structure)
        load = with_member_factors(load, structure, _PER_MEMBER, _drag_times_width)
        return copy_with(load, factor=np.ones(())) if jnp.ndim(self.factor) else load

    def _sum_forces(self, groups, states, nodes, dtype):
        """Return the forces on all nodes, [n_row, 3], N; `nodes` are their initial positions, m."""
        total = jnp.zeros((len(nodes), 3), dtype)
        for number in self.on:
            group = groups[number]
            if group.has_length:
                forces = self._forces_on_chords(number, group, states[number], nodes)
                count = forces.shape[1] + 1
                total = total.at[group.links[:, : count - 1]].add(forces[:, :, 0].astype(dtype))
                total = total.at[group.links[:, 1:count]].add(forces[:, :, 1].astype(dtype))
        return total

    def load_per_length(
        self, number: int, group: Element, state: OwnState, nodes: Positions
    ) -> Float[Array, "n_elem 3"] | None:
        """Return the mean load per unstressed length of a group, [n_elem, 3], N/m, or None."""
        if number not in self.on or group.slides or not group.has_length:
            return None
        forces = self._forces_on_chords(number, group, state, nodes)
        return jnp.sum(forces, axis=(1, 2)) / state.rest_length[:, None]

    def _forces_on_chords(self, number, group, state, nodes):
        """Return the forces at both ends of every chord of a group, [n_elem, n_chord, 2, 3], N.

        A chord joins two successive nodes of an element. `number` is the index of the group, and
        `nodes` are its initial positions.
        """
        ends = self.measuring_positions(nodes)[group.links]
        ends = ends[:, : ends.shape[1] - group.n_inner_row]
        chords = ends[:, 1:] - ends[:, :-1]
        length = scaled.safe_norm(chords)[..., None]
        along = chords / jnp.where(length > 0, length, 1.0)
        wind, upwards = _unit_vector_or_zero(self.direction), _unit_vector_or_zero(self.vertical)
        across = wind[None, None] - (along @ wind)[..., None] * along
        sine = scaled.safe_norm(across)[..., None]  # zero, with derivative zero, along a member
        first, rise = ends[:, :-1] @ upwards - self.ground, chords @ upwards
        pressure = self.profile.pressure_at(
            first[..., None] + rise[..., None] * jnp.asarray(_PLACES, ends.dtype)[None, None]
        )
        area_pressure = length * (pressure @ jnp.asarray(_END_SHARES, ends.dtype))
        forces = area_pressure[..., None] * (sine * across)[..., None, :]
        return self.factor * self.apply_element_factors(number, forces, state)

    def describe(self, units: Units = SI) -> str:
        """Return direction and profile of the wind, in `units`, as text."""
        direction = checks.array_if_known(self.direction)
        towards = ""
        if direction is not None:
            towards = f" towards {vector_text(direction)}"
        iced = "" if self.ice is None else ", iced"
        return f"WindLoads{self._location_text()}{towards}: {self.profile.describe(units)}{iced}"


def _drag_times_width(load: Any) -> Any:
    """Return drag coefficient times iced width, m, times the factor if it differs by element."""
    width = load.diameter if load.ice is None else load.diameter + 2.0 * load.ice
    found = load.drag * width
    return found * load.factor if np.ndim(load.factor) else found


def _unit_vector_or_zero(vector):
    """Return a vector over its length, [3]; zero for a zero vector (phases before the load)."""
    size = scaled.safe_norm(vector)
    return vector / jnp.where(size > 0, size, 1.0)
