"""Dead loads along elements: self-weight and line loads.

These loads are evaluated from the state of the elements and go on acting in later phases.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Literal

import jax.numpy as jnp
from jax.typing import DTypeLike

from ..common import checks
from ..common.selection import Selection
from ..common.tree import copy, pytree
from ..common.types import Array, ArrayLike, Float
from ..elements.element import Element
from ..model.parts import group_path
from ..model.structure import Structure
from ..numerics import scaled
from .groups import Key, bundled, check_elements, partly, selected, settled
from .load import Bundles, Dead, Measured, OwnState

PER = ("unstressed", "initial", "projected")
GEOMETRIES = ("input", "begun")


@pytree(static=("on",))
class SelfWeight(Dead):
    """Self-weight of the elements that have a `weight`; half of it acts at each end of an element.

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
    part: dict[int, Float[Array, " n_elem"]] | None = (
        None  # by number of group: 1 for loaded elements, else 0; set by the analysis
    )

    def __post_init__(self):
        check_elements(self.elements)
        direction = checks.floats(self.direction, "direction")
        if direction.shape != (3,):
            raise ValueError(
                f"direction: expected shape (3,) such as (0, 0, -1), got {direction.shape}"
            )
        object.__setattr__(self, "direction", direction)

    def check(self, structure: Structure) -> None:
        """Raise ValueError if the structure has no such elements, or they have no weight."""
        groups = [structure.groups[number] for number in selected(self, structure)[0]]
        if all(group.weight is None for group in groups):
            kind = "no element group" if self.on is None else f"on = {self.on!r}: no such group"
            raise ValueError(f"SelfWeight: {kind} has a weight; give weight=... in N/m")

    def among(self, structure: Structure) -> SelfWeight:
        """The load with `on` and `elements` as numbers of groups and factors of elements."""
        return settled(self, structure)

    def bundled(self, bundles: Bundles) -> SelfWeight:
        """The load on bundles of the groups that it acts on."""
        return bundled(self, bundles)

    def scaled(self, factor: Float[ArrayLike, ""]) -> SelfWeight:
        """The load times `factor`."""
        return copy(self, direction=factor * self.direction)

    def element_forces(
        self,
        groups: Sequence[Element],
        states: Sequence[OwnState],
        nodes: Float[Array, "n_row 3"],
        shape: tuple[int, int],
        dtype: DTypeLike,
    ) -> Float[Array, "n_row n_freedom"]:
        """Force on every node, of `shape`, N, for the given element states."""
        total = jnp.zeros(shape[0], dtype)
        for number, (group, state) in enumerate(zip(groups, states, strict=True)):
            weights = group.weights(state) if number in self.on else None
            if weights is not None:
                weights = partly(self, number, weights, state)
                total = total.at[group.links].add(group.at_ends(weights, nodes[group.links]))
        return padded(jnp.outer(total, self.direction.astype(dtype)), shape)

    def per_length(
        self, number: int, group: Element, state: OwnState, nodes: Float[Array, "n_row 3"]
    ) -> Float[Array, "n_elem 3"] | None:
        """Load along the elements of a group per unstressed length, [n_elem, 3], N/m, or None."""
        if number not in self.on or group.weight is None:
            return None
        share = partly(self, number, group.weights(state), state) / state.rest_length
        return jnp.outer(share, self.direction)


@pytree(static=("on", "per", "geometry"))
class LineLoads(Measured):
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
    begun: Float[Array, "n_row 3"] | None = (
        None  # nodes at the beginning of the phase, [n_row, 3], m; set by the analysis
    )
    part: dict[int, Float[Array, " n_elem"]] | None = (
        None  # by number of group: 1 for loaded elements, else 0; set by the analysis
    )

    def __post_init__(self):
        check_elements(self.elements)
        forces = checks.floats(self.forces, "forces")
        if forces.shape != (3,):
            raise ValueError(f"forces: expected shape (3,), got {forces.shape}")
        object.__setattr__(self, "forces", forces)
        object.__setattr__(self, "factor", checks.scalar(self.factor, "factor"))
        if self.per not in PER:
            raise ValueError(f"per = {self.per!r}: expected one of {', '.join(PER)}")
        check_geometry(self.geometry, self.per)

    def check(self, structure: Structure) -> None:
        """Raise ValueError if the structure has no such elements, or they have no length."""
        numbers = selected(self, structure)[0]
        without = [number for number in numbers if not structure.groups[number].has_length]
        if without and (self.on is not None or len(without) == len(numbers)):
            path, kind = group_path(structure, without[0]), type(structure.groups[without[0]])
            raise ValueError(
                f"on = {self.on!r}: {path} ({kind.__name__}) has no length to load; its class must "
                "state has_length = True"
            )

    def among(self, structure: Structure) -> LineLoads:
        """The load with `on` and `elements` as numbers of groups and factors of elements."""
        return settled(self, structure, begun=room(self.geometry, structure))

    def bundled(self, bundles: Bundles) -> LineLoads:
        """The load on bundles of the groups that it acts on."""
        return bundled(self, bundles)

    def scaled(self, factor: Float[ArrayLike, ""]) -> LineLoads:
        """The load times `factor`."""
        return copy(self, factor=factor * self.factor)

    def element_forces(
        self,
        groups: Sequence[Element],
        states: Sequence[OwnState],
        nodes: Float[Array, "n_row 3"],
        shape: tuple[int, int],
        dtype: DTypeLike,
    ) -> Float[Array, "n_row n_freedom"]:
        """Force on every node, of `shape`, N, for the given element states."""
        total = jnp.zeros(shape[0], dtype)
        for number, (group, state) in enumerate(zip(groups, states, strict=True)):
            if number in self.on and group.has_length:
                ends = self._ends(group, nodes)
                if self.per == "unstressed":
                    share = group.at_ends(state.loaded, ends)
                else:  # half of each piece to each of its ends
                    n_inner = group.n_inner_row
                    half = 0.5 * self._pieces(ends[:, : ends.shape[1] - n_inner])
                    share = jnp.pad(half, ((0, 0), (0, 1))) + jnp.pad(half, ((0, 0), (1, 0)))
                    share = jnp.pad(share, ((0, 0), (0, n_inner)))
                total = total.at[group.links].add(partly(self, number, share, state))
        return padded(jnp.outer(total, (self.factor * self.forces).astype(dtype)), shape)

    def per_length(
        self, number: int, group: Element, state: OwnState, nodes: Float[Array, "n_row 3"]
    ) -> Float[Array, "n_elem 3"] | None:
        """Load along the elements of a group per unstressed length, [n_elem, 3], N/m, or None."""
        slides = group.slides and self.per != "unstressed"
        if number not in self.on or slides or not group.has_length:
            return None
        length = state.loaded
        if self.per != "unstressed":
            ends = self._ends(group, nodes)
            outer_ends = ends[:, : ends.shape[1] - group.n_inner_row]
            length = jnp.sum(self._pieces(outer_ends), axis=-1)
        return jnp.outer(
            partly(self, number, length, state) / state.rest_length, self.factor * self.forces
        )

    def _ends(self, group, nodes):
        """Ends of a group's elements in the geometry that lengths are measured in."""
        return self.measured(nodes)[group.links]

    def _pieces(self, ends):
        """Initial or projected lengths between successive ends, [n_elem, n_end - 1], m."""
        pieces = ends[:, 1:] - ends[:, :-1]
        if self.per == "projected":
            square = self.forces @ self.forces
            along = pieces @ self.forces / jnp.where(square > 0, square, 1.0)
            pieces = pieces - jnp.tensordot(along, self.forces, axes=0)
        return scaled.length(pieces)  # a piece along the force has no projected length


def check_geometry(geometry: str, per: str) -> None:
    """Raise ValueError for an unknown geometry, or "begun" with unstressed lengths."""
    if geometry not in GEOMETRIES:
        raise ValueError(f"geometry = {geometry!r}: expected one of {', '.join(GEOMETRIES)}")
    if geometry == "begun" and per == "unstressed":
        raise ValueError(
            'geometry = "begun": unstressed lengths have no geometry; give per="initial" or '
            '"projected"'
        )


def room(geometry: str, structure: Structure) -> Float[Array, "n_row 3"] | None:
    """Zeros [n_row, 3] to be replaced by the nodes when the phase begins; None for "input"."""
    if geometry == "input":
        return None
    rows = structure.rows()[0]
    return jnp.zeros((structure.n_node if rows is None else len(rows), 3))


def padded(
    forces: Float[Array, "n_row 3"], shape: tuple[int, int]
) -> Float[Array, "n_row n_freedom"]:
    """Forces [n_node, 3] in the columns of `shape`, with zero moments if it has six."""
    return jnp.pad(forces, ((0, 0), (0, shape[1] - 3)))
