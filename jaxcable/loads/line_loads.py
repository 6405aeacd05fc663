"""Dead loads along elements: a force per length, of all elements or of each."""

from __future__ import annotations

from typing import Literal

import jax.numpy as jnp
import numpy as np

from ..common import checks
from ..common.selection import Selection
from ..common.tree import copy_with, pytree, set_fields
from ..common.types import Array, ArrayLike, Float
from ..model.result_parts import group_path
from ..model.structure import Structure
from ..numerics import scaled
from .along import AlongElements, require_known_geometry
from .groups import Key, concatenate_last_axis, scatter_to_elements
from .load import LoadPerGeometry
from .member_values import require_members

LENGTH_REFERENCES = ("unstressed", "initial", "projected")


@pytree(static=("on", "per", "geometry"))
class LineLoads(AlongElements, LoadPerGeometry):
    """Dead loads along the elements; beams bend under them and catenaries hang.

    They act on elements whenever these are there (`Phase`): also on those that later phases add, or
    remove and add again. Half of each element's load goes to each end. On beams the load also works
    on the deflection between the ends (consistent end moments that turn with the element).

    Args:
        forces: force per length, [3], or one for each loaded element, [n_elem, 3], N/m.
        on: key of the loaded group in the structure's elements, such as "guys", or its place from 0
            where these are a list; None loads all groups. Values for each element belong to one
            group: name it, where a structure has several with lengths.
        per: the length that `forces` refer to: "unstressed" (the length that `SelfWeight` weighs,
            without heat and including the length that a jack has taken in), "initial" (the chord),
            or "projected" (the chord as seen along the force: snow on a sloping cable, wind on a
            mast). A zero force has no direction to project along, and no sensible derivative:
            scale the load with `factor` instead.
        factor: factor of the forces, without unit, or one for each loaded element, [n_elem];
            default 1. Load patterns (checkerboard, half span) are numbers of a batch this way:
            ``jax.vmap`` over factors, or `combine`, compiles one program for all of them.
        geometry: the geometry of the chords: "input", that of the structure's nodes, or "begun",
            that at the beginning of the phase that adds the load, the form after prestress. The
            load is dead in both cases.
        elements: `Selection` of the elements of that group that are loaded; None loads all. Values
            for each element are then in the order of this selection.

    Raises:
        ValueError: `forces` or `factor` of the wrong shape, an unknown `per` or `geometry`, or
            "begun" for unstressed lengths; where a phase is analysed, a group or element that the
            structure does not have, another number of elements than values, or values for each
            element of several groups.

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

        Drifted snow, twice as much on the first leg; and none on the others, by factors:

        >>> for factor in ([2.0, 1.0, 1.0], [2.0, 0.0, 0.0]):
        ...     snow = jc.LineLoads((0.0, 0.0, -100.0), per="projected", factor=factor)
        ...     solution = jc.solve(structure, jc.Phase(loads=snow))
        ...     print(solution.status, jnp.round(solution.load[:, 2], 6))
        0 [-300. -150. -150. -600.]
        0 [-300.    0.    0. -300.]
    """

    forces: Float[ArrayLike, "... 3"]
    on: Key = None
    per: Literal["unstressed", "initial", "projected"] = "unstressed"
    factor: Float[ArrayLike, ""] | Float[ArrayLike, " n_elem"] = 1.0
    geometry: Literal["input", "begun"] = "input"
    elements: Selection | None = None
    begin_nodes: Float[Array, "n_row 3"] | None = (
        None  # nodes at the beginning of the phase, [n_row, 3], m; set by the analysis
    )
    element_factors: dict[int, Float[Array, "n_elem ..."]] | None = (
        None  # by index of group: factor of each element, 0 for those that are not loaded,
        # [n_elem]; with its force beside it, N/m, [n_elem, 4]; set by the analysis
    )

    scales = ("factor",)

    def __post_init__(self):
        self._check_selection()
        forces, factor = (
            checks.as_floats(getattr(self, name), name) for name in ("forces", "factor")
        )
        # values for each element
        each = [len(x) for x, ndim in ((forces, 2), (factor, 1)) if x.ndim == ndim][:1]
        checks.floats_of_shape(forces, "forces", (3,), *((n, 3) for n in each))
        checks.floats_of_shape(factor, "factor", (), *((n,) for n in each))
        set_fields(self, forces=forces, factor=factor)
        checks.require_one_of(self.per, "per", LENGTH_REFERENCES)
        require_known_geometry(self.geometry, self.per)

    def check(self, structure: Structure) -> None:
        """Raise ValueError if the structure lacks the loaded group, or it has no lengths.

        Whether values for each element fit the group `with_group_indices` checks.
        """
        require_members(self, structure)

    @property
    def _n_value(self):
        """Number of elements for each of which a value is given; None if no value is."""
        if jnp.ndim(self.forces) > 1:
            return len(self.forces)
        return len(self.factor) if jnp.ndim(self.factor) else None

    def _elements_with_values(self, structure):
        """Return the index of the group whose elements have values, and indices of these elements.

        Raises:
            ValueError: several groups, or another number of elements than values.
        """
        name = "forces" if jnp.ndim(self.forces) > 1 else "factor"
        numbers, mask = self.loaded_groups(structure)
        lengthy = [number for number in numbers if structure.groups[number].has_length]
        if len(lengthy) != 1:
            raise ValueError(
                f"{name}: has a value for each element, but on = {self.on!r} means "
                f"{len(lengthy)} groups; give a load for each group, named by on=..."
            )
        count = len(structure.groups[lengthy[0]].links)
        index = np.arange(count) if mask is None else self.elements.elements.array
        if len(index) != self._n_value:
            path = group_path(structure, lengthy[0])
            chosen = "" if mask is None else f" {len(index)} chosen of"
            raise ValueError(
                f"{name}: has values for {self._n_value} elements; {path} has{chosen} {count}"
            )
        return lengthy[0], index

    def with_group_indices(self, structure: Structure) -> LineLoads:
        """Return the load in the form of an analysis: indices of groups, values in their order."""
        if self._n_value is None:
            return super().with_group_indices(structure)
        number, index = self._elements_with_values(structure)
        count = len(structure.groups[number].links)
        factor, load = self.factor, copy_with(self, on=(number,), elements=None)
        own = jnp.ndim(factor) > 0
        values = scatter_to_elements(count, index, factor if own else np.ones(len(index)))
        if own:
            load = copy_with(load, factor=np.ones(()))
        if jnp.ndim(self.forces) > 1:
            forces = scatter_to_elements(count, index, self.forces)
            values = concatenate_last_axis([values[:, None], forces])
            load = copy_with(load, forces=np.zeros(3))
        return copy_with(load, element_factors={number: values})

    def _factors_in_group(self, number):
        """Return the factors of a group's elements, [n_elem], which forces may stand beside."""
        factors = super()._factors_in_group(number)
        return factors[:, 0] if self._has_own_forces(number) else factors

    def _has_own_forces(self, number):
        """Return whether each element of the group with index `number` has a force of its own."""
        return self.element_factors is not None and jnp.ndim(self.element_factors[number]) == 2

    def _vector_per_element(self, number):
        """Return the force per length of each element of a group, [n_elem, 3], N/m.

        None if all elements have the same force. `number` is the index of the group.
        """
        if not self._has_own_forces(number):
            return None
        return self.factor * self.element_factors[number][:, 1:]

    def _vector_per_amount(self):
        """Return the force per length, [3], N/m."""
        return self.factor * self.forces

    def _lumped_amounts(self, number, group, state, nodes):
        """Return the length whose load each end of a group takes, [n_elem, n_end], m; or None."""
        if self.per == "unstressed" or not group.has_length:
            return super()._lumped_amounts(number, group, state, nodes)
        ends, n_inner = self._end_positions(group, nodes), group.n_inner_row
        # half of each chord to each of its ends
        half = 0.5 * self._chord_lengths(number, ends[:, : ends.shape[1] - n_inner])
        share = jnp.pad(half, ((0, 0), (0, 1))) + jnp.pad(half, ((0, 0), (1, 0)))
        return self.apply_element_factors(number, jnp.pad(share, ((0, 0), (0, n_inner))), state)

    def _distributed_amounts(self, number, group, state, nodes):
        """Return the loaded length of each element of a group, [n_elem], m; None if it has none."""
        slides = group.slides and self.per != "unstressed"
        if slides or not group.has_length:
            return None
        if self.per == "unstressed":
            return state.load_bearing_length
        ends = self._end_positions(group, nodes)
        pieces = ends[:, : ends.shape[1] - group.n_inner_row]
        return jnp.sum(self._chord_lengths(number, pieces), axis=-1)

    def _end_positions(self, group, nodes):
        """Return ends of elements in the geometry that lengths refer to, [n_elem, n_end, 3], m.

        `nodes` are initial positions; those at the beginning of the phase count if
        `geometry` says so.
        """
        return self.measuring_positions(nodes)[group.links]

    def _chord_lengths(self, number, ends):
        """Return the lengths of chords between successive ends, [n_elem, n_end - 1], m.

        `ends` are positions, [n_elem, n_end, 3], m, `number` is the index of the group.
        With ``per="projected"`` only the parts at right angles to the force count.
        """
        pieces = ends[:, 1:] - ends[:, :-1]
        if self.per == "projected" and self._has_own_forces(number):
            force = self.element_factors[number][:, None, 1:].astype(pieces.dtype)
            square = jnp.sum(force**2, axis=-1)
            along = jnp.sum(pieces * force, axis=-1) / jnp.where(square > 0, square, 1.0)
            pieces = pieces - along[..., None] * force
        elif self.per == "projected":
            square = self.forces @ self.forces
            along = pieces @ self.forces / jnp.where(square > 0, square, 1.0)
            pieces = pieces - jnp.tensordot(along, self.forces, axes=0)
        return scaled.safe_norm(pieces)  # a chord along the force has no projected length
