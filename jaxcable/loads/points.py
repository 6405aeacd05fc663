"""Concentrated loads within beams, in the form in which an analysis takes them: a table of places.

`PointLoads` names elements and places along them; `path_loads` has loads that move along a path.
"""

from __future__ import annotations

import jax.numpy as jnp
import numpy as np
from jax.typing import DTypeLike

from ..common import checks
from ..common.negligible import vector_text
from ..common.rules import Rule, refuse_if_broken
from ..common.tree import Indices, pytree, set_fields
from ..common.types import Array, ArrayLike, Float, Int
from ..common.units import SI, Units
from ..elements.abilities import POINT_LOADS
from ..elements.element import Element, OwnState
from ..elements.element_state import ElementState
from ..model.result_parts import group_path
from ..model.structure import Structure
from .groups import Key, OnGroups, concatenate_last_axis, indices_of_groups
from .load import DeadLoad, Groups, OnEveryNode, PersistentLoad, Positions, States
from .nodal import set_vectors

_HINT = "; give one vector for all loads, or one for each of them"


class WithinElements(PersistentLoad):
    """Base of concentrated loads within the beams of one group, as a user gives them."""

    on: Key

    def group_index(self, structure: Structure) -> int:
        """Return the index of the group of beams that `on` names, or of the only one.

        ValueError if there is no such group, or several, or its elements take no such loads.
        """
        numbers = indices_of_groups(self.on, structure)
        beams = [n for n in numbers if POINT_LOADS in structure.groups[n].results]
        if self.on is not None and len(numbers) == 1 and not beams:
            where, kind = group_path(structure, numbers[0]), type(structure.groups[numbers[0]])
            hint = "; give it a node where the load acts, and `NodalLoads`"
            raise ValueError(
                f"on = {self.on!r}: {where} ({kind.__name__}) takes no loads within its elements"
                f"{hint}"
            )
        if len(beams) != 1:
            raise ValueError(
                f"on = {self.on!r} means {len(beams)} groups of beams; name one group: only beams "
                "take loads within their elements, cables, bars and catenaries need a node there"
            )
        return beams[0]


@pytree(static=("on", "has_moments", "has_line", "name"))
class ActingPoints(OnGroups, DeadLoad):
    """Concentrated loads within the beams of one group, in the form of an analysis.

    Args:
        on: indices of groups; of one group, or of its bundle.
        element_factors: by index of the group, the loads of its elements, [n_elem, k, 4 or 7], as
            of `ElementLoad.points`.
        has_moments: whether there are moments, so that a load has seven numbers.
        has_line: whether the last load of each element is one along the whole element, N, at the
            place 0.5.
        name: of the class of loads that a user has given.
    """

    on: tuple[int, ...]
    element_factors: dict[int, Float[Array, "n_elem k 4or7"]]
    has_moments: bool = False
    has_line: bool = False
    name: str = "PointLoads"

    def rules(self) -> list[Rule]:
        """Return the rule that places are from 0 to 1, a list of `Rule`."""
        return [_place_rule(table[..., 0]) for table in self.element_factors.values()]

    def __str__(self) -> str:
        return self.name

    def element_forces(
        self,
        groups: Groups,
        states: States,
        nodes: Positions,
        shape: tuple[int, int],
        dtype: DTypeLike,
    ) -> OnEveryNode:
        """Return the shares of forces and moments at the ends, N and N m, in an array of `shape`.

        `nodes` are initial positions, `shape` is (n_row, 3 or 6), `dtype` that of the result.
        """
        total = jnp.zeros(shape, dtype)
        for number in self.on:
            table = states[number].zero_where_absent(self.element_factors[number])
            place, loads = table[..., :1], table[..., 1:]
            shares = [jnp.sum(part * loads, axis=1) for part in (1 - place, place)]
            columns = shares[0].shape[-1]
            links = groups[number].links[:, :2]
            total = total.at[links, :columns].add(jnp.stack(shares, axis=1).astype(dtype))
        return total

    def point_loads(self, number: int, state: ElementState) -> Float[Array, "n_elem k 4or7"] | None:
        """Return the loads within the elements of a group with index `number`, or None.

        Columns are place, from 0 to 1, forces, N, and moments, N m (if `has_moments`). Loads along
        whole elements are left out (`has_line`). None if no load is on the group.
        """
        if number not in self.on:
            return None
        table = self.element_factors[number]
        return state.zero_where_absent(table[:, :-1] if self.has_line else table)

    def load_per_length(
        self, number: int, group: Element, state: OwnState, nodes: Positions
    ) -> Float[Array, "n_elem 3"] | None:
        """Return the load along whole elements of a group per unstressed length, N/m, or None."""
        if number not in self.on or not self.has_line:
            return None
        total = state.zero_where_absent(self.element_factors[number][:, -1, 1:])
        return total / state.rest_length[:, None]


@pytree(static=("on",), indices=("elements",))
class PointLoads(WithinElements):
    """Concentrated dead loads within beams, at places between their nodes.

    They are exact in linear theory, for displacements of nodes and for section forces, with hinges
    and joints, wherever the neutral axis is: one element does, no node is needed at the load. The
    loads keep their direction and act, also at large rotations, where the deflected beam is. Like
    all loads of elements they go on acting in later phases, on elements whenever they are there.

    Where an axial force is large against ``EI / L^2``, or rotations within an element are, its
    nodes are found with the error of an element, as under line loads: of fourth order in its
    length. Sections that are not linear take the work of the load on the strains that they have,
    without the kink of the curvature: divide the beam at the load where that matters. With shear
    flexibility the second-order effect of the bending between load and nodes is left out.

    Solutions and `fibre_stress` have section forces and stresses at the ends and the middle of
    elements, or at the `points` of `Beams`; `jaxcable.section_forces` has forces at the load, and
    reports have the extremes of both.

    Straight cables, bars and catenaries carry forces at their nodes only: give them a node.

    Args:
        elements: indices of the loaded elements in their group, [n]; an element may occur more than
            once.
        places: along each element over its unstressed length, without unit, from 0 to 1: [n], or
            one for all.
            Derivatives by places exist; at both ends of an element, where the load passes to the
            next one, they are those of this element (results have a kink there).
        forces: [3] or [n, 3], N.
        moments: [3] or [n, 3], N m, or None. They keep their direction in space, have no potential
            (see `NodalLoads`), and need ends without `springs`.
        on: key of the group in the structure's elements, such as "deck", or its place from 0 where
            these are a list; None means the only group of beams.

    Raises:
        ValueError: wrong shapes, places outside of 0 to 1 (traced ones end in INVALID_INPUT); where
            a phase is analysed, a group or element that the structure does not have, elements that
            take no such load, or several groups of beams.

    Source: fixed-end moments of the Euler-Bernoulli beam, as in any table.

    Example:
        1 N at the third point of a clamped beam of 6 m: ``P a b^2 / L^2`` and ``P a^2 b / L^2``:

        >>> section = jc.Section.rectangle(0.1, 0.2, jc.Elastic(10e9))
        >>> beam = jc.Beams([[0, 1]], section=section)
        >>> nodes = [[0.0, 0.0, 0.0], [6.0, 0.0, 0.0]]
        >>> structure = jc.Structure(nodes, beam, supports=jc.clamped([0, 1]))
        >>> load = jc.PointLoads([0], 1 / 3, (0.0, 0.0, -1.0))
        >>> solution = jc.solve(structure, jc.Phase(loads=load))
        >>> print(solution.status, jnp.round(solution.reaction_moments[:, 1], 3))
        0 [-0.889  0.444]
        >>> forces = jc.section_forces(structure, solution, [0.0, 1 / 3 - 1e-9, 1 / 3 + 1e-9, 1.0])
        >>> print(jnp.round(forces[0, :, [2, 4]], 3))  # Vz has a jump, My a kink
        [[-0.741 -0.741  0.259  0.259]
         [ 0.889 -0.593 -0.593  0.444]]
    """

    elements: Int[ArrayLike, " n"]
    places: Float[ArrayLike, ""] | Float[ArrayLike, " n"]
    forces: Float[ArrayLike, "... 3"]
    moments: Float[ArrayLike, "... 3"] | None = None
    on: Key = None

    scales = ("forces", "moments")

    def __post_init__(self):
        if not isinstance(self.elements, Indices):
            numbers = checks.as_indices(self.elements, "elements", things="element")
            set_fields(self, elements=Indices(numbers))
        count = len(self.elements)
        set_fields(self, places=checks.floats_of_shape(self.places, "places", (), (count,)))
        set_vectors(self, self.scales, count, _HINT)
        refuse_if_broken(self.rules())

    def rules(self) -> list[Rule]:
        """Return the rule that places are from 0 to 1, a list of `Rule`."""
        return [_place_rule(self.places)]

    @property
    def has_moments(self) -> bool:
        """Whether the load has moments."""
        return self.moments is not None

    def check(self, structure: Structure) -> None:
        """Raise ValueError if the structure lacks the group or an element, or they take no load."""
        number = self.group_index(structure)
        group, path = structure.groups[number], group_path(structure, number)
        count = len(group.links)
        unknown = self.elements.array >= count
        if unknown.any():
            k = int(unknown.argmax())
            raise ValueError(
                f"elements[{k}] = {self.elements[k]}: {path} has elements 0 to {count - 1}"
            )
        if self.moments is not None and group.springs is not None:
            raise ValueError(
                f"moments: {path} has joints (springs, or hinges about some axes); give moments on "
                "nodes of it, by `NodalLoads`"
            )

    def with_group_indices(self, structure: Structure) -> ActingPoints:
        """Return the loads in the form of an analysis: `ActingPoints`, a table by element."""
        number = self.group_index(structure)
        n_elem = len(structure.groups[number].links)
        count = len(self.elements)
        given = zip((self.places, self.forces, self.moments), (1, 3, 3), strict=True)
        values = concatenate_last_axis([_load_rows(x, count, n) for x, n in given if x is not None])
        rows = _loads_of_elements(self.elements.array, n_elem)
        zero = np.zeros((1, values.shape[1]), values.dtype)
        table = checks.numpy_or_jax(values).concatenate([values, zero])[rows]
        return ActingPoints((number,), {number: table}, self.has_moments)

    def describe(self, units: Units = SI) -> str:
        """Return the number of forces and their sum, in `units`, as text."""
        forces = checks.array_if_known(self.forces)
        if forces is None:
            return "PointLoads"
        total = np.broadcast_to(forces, (len(self.elements), 3)).sum(axis=0)
        total = vector_text(units.from_si(total, "N"))
        return f"PointLoads at {len(self.elements)} places, sum {total} {units.name('N')}"


def _place_rule(places):
    """Return the `Rule` that all `places` along elements are from 0 to 1."""
    text = "must be from 0 to 1, along the element"
    return Rule("places", places, lambda v: (v < 0) | (v > 1), text)


def _load_rows(values, count, width):
    """Return numbers of loads, [count, width], from one row for all, [width], or one for each."""
    pack = checks.numpy_or_jax(values)
    each = pack.reshape(values, (-1, width))
    return pack.broadcast_to(each, (count, width))


def _loads_of_elements(elements, n_elem):
    """Return the indices of the loads on each of `n_elem` elements, [n_elem, k].

    Rows are filled up by n, for no load; `elements` has the index of the element of each of the
    n loads, and k is the largest number of loads on one element.
    """
    count = np.bincount(elements, minlength=n_elem)
    rows = np.full((n_elem, max(int(count.max(initial=0)), 1)), len(elements))
    order = np.argsort(elements, kind="stable")
    first = np.cumsum(count) - count
    column = np.arange(len(elements)) - first[elements[order]]
    rows[elements[order], column] = order
    return rows
