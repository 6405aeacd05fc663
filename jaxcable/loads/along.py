"""Dead loads along elements: self-weight and line loads.

These loads are evaluated from the state of the elements and go on acting in later phases.
"""

from __future__ import annotations

import abc
from typing import Literal

import jax.numpy as jnp
from jax.typing import DTypeLike

from ..common import checks
from ..common.selection import Selection
from ..common.tree import pytree, set_fields
from ..common.types import Array, ArrayLike, Float
from ..elements.element import Element, OwnState
from ..model.result_parts import path_of_group
from ..model.structure import Structure
from ..numerics import scaled
from .groups import Key, OnGroups
from .load import Dead, Groups, Measured, OnEveryNode, Positions, States

LENGTH_REFERENCES = ("unstressed", "initial", "projected")
GEOMETRIES = ("input", "begun")


class AlongElements(OnGroups, Dead):
    """Base of dead loads along elements: one vector times an amount for each element.

    The amount is a weight (N) or a length (m), the vector a direction or a force per length.
    """

    @abc.abstractmethod
    def _vector_per_amount(self):
        """Return the vector that amounts are multiplied by, [3].

        It is a direction (of any length) for weights, N, and a force per length, N/m, for lengths.
        """

    @abc.abstractmethod
    def _amounts_at_ends(self, number, group, state, nodes):
        """Return the amount (N, or m) that acts at each end of a group's elements, [n_elem, n_end].

        None if the group has none. `number` is the index of the group, `nodes` are its initial
        positions.
        """

    @abc.abstractmethod
    def _amounts_between_ends(self, number, group, state, nodes):
        """Return the amount (N, or m) that acts along each element of a group, [n_elem].

        None if the group has none. It bends beams and lets catenaries hang.
        """

    def element_forces(
        self,
        groups: Groups,
        states: States,
        nodes: Positions,
        shape: tuple[int, int],
        dtype: DTypeLike,
    ) -> OnEveryNode:
        """Return forces, N, and zero moments on all nodes, in an array of `shape`.

        `nodes` are initial positions, `shape` is (n_row, 3 or 6), `dtype` that of the result.
        """
        total = jnp.zeros(shape[0], dtype)
        for number in self.on:
            amounts = self._amounts_at_ends(number, groups[number], states[number], nodes)
            if amounts is not None:
                total = total.at[groups[number].links].add(amounts)
        return pad_moments(jnp.outer(total, self._vector_per_amount().astype(dtype)), shape)

    def load_per_length(
        self, number: int, group: Element, state: OwnState, nodes: Positions
    ) -> Float[Array, "n_elem 3"] | None:
        """Return the load per unstressed length of a group, [n_elem, 3], N/m; None without any."""
        amounts = (
            self._amounts_between_ends(number, group, state, nodes) if number in self.on else None
        )
        if amounts is None:
            return None
        per_length = self.apply_factors(number, amounts, state) / state.rest_length
        return jnp.outer(per_length, self._vector_per_amount())


@pytree(static=("on",))
class SelfWeight(AlongElements):
    """Self-weight of the elements that have a `weight`; half of it acts at each end of an element.

    Of elements with more ends, such as membranes of your own, each end has an equal part of it.

    The weight is that of the current unstressed length at the temperature before the first phase:
    heat adds no mass. It acts on elements whenever they are there (`Phase`), those that later
    phases add among them. While a jack pulls, the weight stays as it was when the jack began, so
    that the structure does not move when the jack is anchored. Beams bend and catenaries hang under
    it.

    Args:
        direction: direction and factor, [3]; default (0, 0, -1), once the weight downwards.
        on: key of the loaded group in the structure's elements, such as "guys", or its place from 0
            where these are a list; None loads all groups that have a `weight`.
        elements: `Selection` of the elements of that group that weigh; None means all.

    Raises:
        ValueError: `direction` of the wrong shape; where a phase is analysed, no group with a
            weight, or a group or element that the structure does not have.

    Example:
        Two hanging cables of 60 m and 30 N/m; half of the weight of each acts at each of its ends:

        >>> x = 200.0 * np.arcsinh(0.3) + 0.006  # half of the span (see `Catenaries`), m
        >>> nodes = [[-x, 0.0, 9.0], [0.0, 0.0, 0.0], [x, 0.0, 9.0]]
        >>> cables = jc.Catenaries(
        ...     [[0, 1], [1, 2]], axial_stiffness=60e6, weight=30.0, rest_length=60.0
        ... )
        >>> structure = jc.Structure(nodes, cables, supports=jc.pinned([0, 2]))
        >>> solution = jc.solve(structure, jc.Phase(loads=jc.SelfWeight()))
        >>> print(solution.status, jnp.round(solution.load[:, 2], 6))
        0 [ -900. -1800.  -900.]
    """

    direction: Float[ArrayLike, " 3"] = (0.0, 0.0, -1.0)
    on: Key = None
    elements: Selection | None = None
    element_factors: dict[int, Float[Array, " n_elem"]] | None = (
        None  # by number of group: 1 for loaded elements, else 0; set by the analysis
    )

    scales = ("direction",)

    def __post_init__(self):
        self._check_selection()
        direction = checks.as_floats(self.direction, "direction")
        if direction.shape != (3,):
            raise ValueError(
                f"direction: expected shape (3,) such as (0, 0, -1), got {direction.shape}"
            )
        set_fields(self, direction=direction)

    def check(self, structure: Structure) -> None:
        """Raise ValueError if the structure lacks the loaded group, or it has no weight."""
        groups = [structure.groups[number] for number in self.loaded_groups(structure)[0]]
        if all(group.weight is None for group in groups):
            kind = "no element group" if self.on is None else f"on = {self.on!r}: no such group"
            raise ValueError(
                f"SelfWeight: {kind} has a weight; give the group weight=... in N/m (surfaces: "
                "N/m2)"
            )

    def _vector_per_amount(self):
        """Return the direction of the weight times its factor, [3]."""
        return self.direction

    def _amounts_between_ends(self, number, group, state, nodes):
        """Return the weight of every element of a group, [n_elem], N; None without a weight."""
        return group.weights(state)

    def _amounts_at_ends(self, number, group, state, nodes):
        """Return the weight at every end of a group, [n_elem, n_end], N; None without a weight."""
        weights = group.weights(state)
        if weights is None:
            return None
        return group.split_among_ends(
            self.apply_factors(number, weights, state), nodes[group.links]
        )


@pytree(static=("on", "per", "geometry"))
class LineLoads(AlongElements, Measured):
    """Dead loads along the elements; beams bend under them and catenaries hang.

    They act on elements whenever these are there (`Phase`): also on those that later phases add, or
    remove and add again. Half of each element's load goes to each end. On beams the load also works
    on the deflection between the ends (consistent end moments that turn with the element).

    Args:
        forces: force per length, [3], N/m.
        on: key of the loaded group in the structure's elements, such as "guys", or its place from 0
            where these are a list; None loads all groups.
        per: the length that `forces` refer to: "unstressed" (the length that `SelfWeight` weighs,
            without heat and including the length that a jack has taken in), "initial" (the chord),
            or "projected" (the chord as seen along the force: snow on a sloping cable, wind on a
            mast). A zero force has no direction to project along, and no sensible derivative:
            scale the load with `factor` instead.
        factor: factor of the forces, without unit; default 1.
        geometry: the geometry of the chords: "input", that of the structure's nodes, or "begun",
            that at the beginning of the phase that adds the load, the form after prestress. The
            load is dead in both cases.
        elements: `Selection` of the elements of that group that are loaded; None loads all.

    Raises:
        ValueError: `forces` of the wrong shape, an unknown `per` or `geometry`, or "begun" for
            unstressed lengths; where a phase is analysed, a group or element that the structure
            does not have.

    Example:
        Snow of 100 N per metre in plan on the legs of a tripod, each 3 m long in plan:

        >>> around = 2 * np.pi * np.arange(3) / 3
        >>> feet = np.column_stack([3 * np.cos(around), 3 * np.sin(around), 0 * around])
        >>> legs = jc.Bars([[0, 3], [1, 3], [2, 3]], axial_stiffness=1e6)
        >>> structure = jc.Structure([*feet, [0.0, 0.0, 4.0]], legs, supports=jc.pinned([0, 1, 2]))
        >>> snow = jc.LineLoads((0.0, 0.0, -100.0), per="projected")
        >>> solution = jc.solve(structure, jc.Phase(loads=snow))
        >>> print(solution.status, jnp.round(solution.load[:, 2], 6))
        0 [-150. -150. -150. -450.]
    """

    forces: Float[ArrayLike, " 3"]
    on: Key = None
    per: Literal["unstressed", "initial", "projected"] = "unstressed"
    factor: Float[ArrayLike, ""] = 1.0
    geometry: Literal["input", "begun"] = "input"
    elements: Selection | None = None
    begin_nodes: Float[Array, "n_row 3"] | None = (
        None  # nodes at the beginning of the phase, [n_row, 3], m; set by the analysis
    )
    element_factors: dict[int, Float[Array, " n_elem"]] | None = (
        None  # by number of group: 1 for loaded elements, else 0; set by the analysis
    )

    scales = ("factor",)

    def __post_init__(self):
        self._check_selection()
        forces = checks.floats_of_shape(self.forces, "forces", (3,))
        set_fields(self, forces=forces, factor=checks.as_scalar(self.factor, "factor"))
        checks.require_one_of(self.per, "per", LENGTH_REFERENCES)
        require_known_geometry(self.geometry, self.per)

    def check(self, structure: Structure) -> None:
        """Raise ValueError if the structure lacks the loaded group, or it has no lengths."""
        numbers, _ = self.loaded_groups(structure)
        without = [number for number in numbers if not structure.groups[number].has_length]
        if without and (self.on is not None or len(without) == len(numbers)):
            path, kind = path_of_group(structure, without[0]), type(structure.groups[without[0]])
            raise ValueError(
                f"on = {self.on!r}: {path} ({kind.__name__}) has no length to load; if its "
                "elements have one, give the class has_length = True"
            )

    def _vector_per_amount(self):
        """Return the force per length, [3], N/m."""
        return self.factor * self.forces

    def _amounts_at_ends(self, number, group, state, nodes):
        """Return the length whose load each end of a group takes, [n_elem, n_end], m; or None."""
        if not group.has_length:
            return None
        ends = self._end_positions(group, nodes)
        if self.per == "unstressed":
            share = group.split_among_ends(state.load_bearing_length, ends)
        else:  # half of each piece to each of its ends
            n_inner = group.n_inner_row
            half = 0.5 * self._piece_lengths(ends[:, : ends.shape[1] - n_inner])
            share = jnp.pad(half, ((0, 0), (0, 1))) + jnp.pad(half, ((0, 0), (1, 0)))
            share = jnp.pad(share, ((0, 0), (0, n_inner)))
        return self.apply_factors(number, share, state)

    def _amounts_between_ends(self, number, group, state, nodes):
        """Return the loaded length of each element of a group, [n_elem], m; None if it has none."""
        slides = group.slides and self.per != "unstressed"
        if slides or not group.has_length:
            return None
        if self.per == "unstressed":
            return state.load_bearing_length
        ends = self._end_positions(group, nodes)
        return jnp.sum(self._piece_lengths(ends[:, : ends.shape[1] - group.n_inner_row]), axis=-1)

    def _end_positions(self, group, nodes):
        """Return ends of elements in the geometry that lengths refer to, [n_elem, n_end, 3], m."""
        return self.measuring_positions(nodes)[group.links]

    def _piece_lengths(self, ends):
        """Return distances of successive ends [n_elem, n_end, 3], as [n_elem, n_end - 1], m.

        With ``per="projected"`` only their parts at right angles to the force count.
        """
        pieces = ends[:, 1:] - ends[:, :-1]
        if self.per == "projected":
            square = self.forces @ self.forces
            along = pieces @ self.forces / jnp.where(square > 0, square, 1.0)
            pieces = pieces - jnp.tensordot(along, self.forces, axes=0)
        return scaled.safe_norm(pieces)  # a piece along the force has no projected length


def require_known_geometry(geometry: str, per: str) -> None:
    """Raise ValueError for an unknown `geometry`, or one that does not go with `per`.

    Unstressed lengths do not change, so that they have no shape at the start of a phase ("begun").
    """
    checks.require_one_of(geometry, "geometry", GEOMETRIES)
    if geometry == "begun" and per == "unstressed":
        raise ValueError(
            'geometry = "begun": cannot be used with per="unstressed", because unstressed lengths '
            'have no geometry; give per="initial" or per="projected"'
        )


def pad_moments(
    forces: Float[Array, "n_row 3"], shape: tuple[int, int]
) -> Float[Array, "n_row n_freedom"]:
    """Append zero moments to forces [n_row, 3] if `shape` is (n_row, 6)."""
    return jnp.pad(forces, ((0, 0), (0, shape[1] - 3)))
