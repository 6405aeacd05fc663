"""Dead loads along elements: their base, and self-weight.

These loads are evaluated from the state of the elements and go on acting in later phases.
"""

from __future__ import annotations

import abc

import jax.numpy as jnp

from ..common import checks
from ..common.selection import Selection
from ..common.tree import pytree, set_fields
from ..common.types import Array, ArrayLike, Float
from ..elements.element import Element, OwnState
from ..model.structure import Structure
from .groups import Key, OnGroups
from .load import ForceOnlyLoad, Positions

GEOMETRIES = ("input", "begun")


class AlongElements(OnGroups, ForceOnlyLoad):
    """Base of dead loads along elements: one vector times an amount for each element.

    The amount is a weight (N) or a length (m), the vector a direction or a force per length.
    """

    @abc.abstractmethod
    def _vector_per_amount(self):
        """Return the vector that amounts are multiplied by, [3].

        It is a direction (of any length) for weights, N, and a force per length, N/m, for lengths.
        """

    @abc.abstractmethod
    def _distributed_amounts(self, number, group, state, nodes):
        """Return the amount (N, or m) that acts along each element of a group, [n_elem].

        None if the group has none. It bends beams and lets catenaries hang. `number` is the index
        of the group, `state` its state, and `nodes` are initial positions of all nodes, m.
        """

    def _lumped_amounts(self, number, group, state, nodes):
        """Return the amount (N, or m) that acts at each end of a group's elements, [n_elem, n_end].

        None if the group has none. It is the part of the end in that along the element, which is
        even per unstressed length.
        """
        amounts = self._distributed_amounts(number, group, state, nodes)
        if amounts is None:
            return None
        acting = self.apply_element_factors(number, amounts, state)
        return group.split_among_ends(acting, nodes[group.links])

    def _sum_forces(self, groups, states, nodes, dtype):
        """Return the forces on all nodes, [n_row, 3], N; `nodes` are their initial positions, m."""
        total, forces = jnp.zeros(len(nodes), dtype), None
        for number in self.on:
            amounts = self._lumped_amounts(number, groups[number], states[number], nodes)
            if amounts is None:
                continue
            vectors, links = self._vector_per_element(number), groups[number].links
            if vectors is None:
                total = total.at[links].add(amounts)
            else:
                each = amounts[..., None] * vectors[:, None].astype(dtype)
                forces = jnp.zeros((len(nodes), 3), dtype).at[links].add(each)
        if forces is None:
            return jnp.outer(total, self._vector_per_amount().astype(dtype))
        return forces

    def load_per_length(
        self, number: int, group: Element, state: OwnState, nodes: Positions
    ) -> Float[Array, "n_elem 3"] | None:
        """Return the load per unstressed length of a group, [n_elem, 3], N/m; None without any."""
        amounts = (
            self._distributed_amounts(number, group, state, nodes) if number in self.on else None
        )
        if amounts is None:
            return None
        per_length = self.apply_element_factors(number, amounts, state) / state.rest_length
        vectors = self._vector_per_element(number)
        if vectors is not None:
            return per_length[:, None] * vectors.astype(per_length.dtype)
        return jnp.outer(per_length, self._vector_per_amount())

    def _vector_per_element(self, number: int) -> Float[Array, "n_elem 3"] | None:
        """Return vectors by which amounts of each element of a group are multiplied, [n_elem, 3].

        None if all elements have the `_vector_per_amount`. A load with such vectors acts on one
        group.
        """
        return None


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
        direction: direction and factor, [3], without unit; default (0, 0, -1), once the weight
            downwards.
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
        None  # by index of group: 1 for loaded elements, else 0; set by the analysis
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

    def _distributed_amounts(self, number, group, state, nodes):
        """Return the weight of every element of a group, [n_elem], N; None without a weight."""
        return group.weights(state)


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
