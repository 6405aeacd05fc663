"""Evaluation of the elements of a structure, group by group."""

from __future__ import annotations

import dataclasses
from collections.abc import Callable, Sequence
from typing import Any, ClassVar, TypeAlias

import jax
import jax.numpy as jnp

from ..common import jax_internals as internals
from ..common.tree import is_hashable
from ..common.types import Array, ArrayLike, Bool, Float, PyTree
from ..elements.element import PEAK_TENSION, PRESENT, TENSION, Element, Result
from ..elements.element_state import ElementState
from ..elements.prestress import call_each_element, single_element
from ..numerics.rotations import IDENTITY
from ..spaces.dof_map import DofMap
from ..spaces.space import Motion, Space, mean_length
from ..spaces.translations import has_low_part

PerGroup: TypeAlias = 'list[Float[Array, "n_elem ..."] | None]'
"""An array for every group; None for a group that has none."""
Memory: TypeAlias = 'list[PyTree[Float[Array, "n_elem ..."]] | None]'
"""History variables of every group; None for a group that has none."""


class Elementwise:
    """Base of `System`: evaluates its elements, group by group.

    Attributes:
        predicts_axial_forces: whether an iteration may predict axial forces: not if end forces are
            others than those at one motion.
    """

    predicts_axial_forces: ClassVar[bool] = True

    nodes: Float[Array, "n_row 3"]
    groups: list[Element]
    states: list[ElementState]
    space: Space

    @property
    def dof_map(self) -> DofMap:
        """Map between the degrees of freedom of nodes (rows) and the unknowns, a `DofMap`."""
        return self.space.dof_map

    def gather_at_ends(
        self, values: Float[Array, "n_row ..."]
    ) -> list[Float[Array, "n_elem n_end ..."]]:
        """Gather values of rows, [n_row, ...], at ends of elements, [n_elem, n_end, ...] each.

        The transpose is `sum_at_rows`.
        """
        meeting = None if self.dof_map is None else self.dof_map.nodal_assembly
        if meeting is None:
            return [values[group.links] for group in self.groups]
        flat, found = meeting.apply_transpose(values), []
        for group in self.groups:
            count = group.links.size
            found.append(flat[:count].reshape(*group.links.shape, *values.shape[1:]))
            flat = flat[count:]
        return found

    def sum_at_rows(self, values: Sequence[Float[Array, "n_elem n_end ..."]]) -> Array:
        """Assemble values at element ends, [n_elem, n_end, ...] each, at nodes: [n_row, ...]."""
        parts = [value.reshape(-1, *value.shape[2:]) for value in values]
        flat = parts[0] if len(parts) == 1 else jnp.concatenate(parts)
        if self.dof_map.nodal_assembly is not None:
            return self.dof_map.nodal_assembly(flat)
        rows = jnp.concatenate([group.links.reshape(-1) for group in self.groups])
        return jnp.zeros((len(self.nodes), *flat.shape[1:]), flat.dtype).at[rows].add(flat)

    def stored_energy(self, motion: Motion) -> Float[Array, ""]:
        """Return the energy stored in the elements, J."""
        total: Float[ArrayLike, ""] = sum(
            jnp.sum(evaluate_elements("energy", group, state, self.nodes, motion))
            for group, state in zip(self.groups, self.states, strict=True)
        )
        return total

    def results_by_name(self, motion: Motion, *names: str) -> dict[str, list[Any]]:
        """Return named results of all elements; each element is evaluated once for all of them.

        Args:
            motion: motion of all nodes (rows).
            names: names of element methods.

        Returns:
            Dict by name of lists with an array per group; None for a group without this result.
        """
        found = []
        placed = zip(self.gather_at_ends(self.nodes), self.gather_at_ends(motion), strict=True)
        for group, state, at in zip(self.groups, self.states, placed, strict=True):
            # in one order, so that all who read the same results share a function
            present = tuple(sorted(name for name in names if group.has_result(name, state)))
            values = map_elements_at_ends(_Method("results_by_name", (present,)), group, state, at)
            if PRESENT.name in names and state.present is not None:
                values[PRESENT.name] = state.present.astype(motion.dtype)
            found.append(values)
        return {name: [values.get(name) for values in found] for name in names}

    def results(self) -> dict[str, Result]:
        """Return descriptions (`Result`: unit, components) of all groups' results, by name."""
        pairs = zip(self.groups, self.states, strict=True)
        found = [result for g, s in pairs for result in g.results if g.has_result(result.name, s)]
        if any(state.present is not None for state in self.states):
            found.append(PRESENT)
        return {result.name: result for result in (TENSION, PEAK_TENSION, *found)}

    def forces_and_tangents(self, motion: Motion) -> list[list[Any]]:
        """Return end forces of all groups, and tangents of groups that compute both together.

        Two lists with an array per group; the tangent is None for other groups, as it may never be
        needed.
        """
        pairs = []
        for group, state in zip(self.groups, self.states, strict=True):
            together = group.evaluates_forces_with_tangent(state)
            name = "forces_and_tangent" if together else "end_forces"
            found = evaluate_elements(name, group, state, self.nodes, motion)
            pairs.append(found if together else (found, None))
        return [list(arrays) for arrays in zip(*pairs, strict=True)]

    def tangents(
        self, motion: Motion, known: PerGroup | None = None
    ) -> list[Float[Array, "n_elem d d"]]:
        """Return the tangent stiffness of all elements, per group [n_elem, d, d], N/m.

        A group's tangent in `known` is taken instead, unless it is None.
        """
        known = [None] * len(self.groups) if known is None else known
        found = []
        for group, state, matrix in zip(self.groups, self.states, known, strict=True):
            if matrix is None and group.evaluates_forces_with_tangent(state):
                at = group, state, self.nodes, motion  # the function of `forces_and_tangents`
                matrix = evaluate_elements("forces_and_tangent", *at)[1]
            elif matrix is None:
                matrix = evaluate_elements("tangent", group, state, self.nodes, motion)
            count = len(matrix)
            found.append(matrix.reshape(count, -1, round((matrix.size // count) ** 0.5)))
        return found

    def mass_matrices(
        self, motion: Motion, gravity: Float[ArrayLike, ""], distribution: str | None = None
    ) -> list[Float[Array, "n_elem d d"]]:
        """Return mass matrices of all elements, per group [n_elem, d, d], kg; zero without weight.

        Args:
            motion: motion of all nodes (rows).
            gravity: acceleration by which weights are divided, m/s2.
            distribution: as in `Element.mass_matrix`.
        """
        mass_matrix, found = _Method("mass_matrix", (distribution,)), []
        shapes = jax.eval_shape(lambda: self.tangents(motion))
        for group, state, shape in zip(self.groups, self.states, shapes, strict=True):
            weights = group.weights(state)
            if weights is None:
                found.append(jnp.zeros(shape.shape, shape.dtype))
                continue
            at, beside = (self.nodes[group.links], motion[group.links]), (weights / gravity,)
            found.append(map_elements_at_ends(mass_matrix, group, state, at, beside))
        return found

    def secants(self, before: Motion, motion: Motion) -> list[Float[Array, "n_elem ..."]]:
        """Return secant stiffnesses between two motions, per group, N/m (`SecantStiffness`)."""
        return [
            evaluate_elements("secant", group, state, self.nodes, before, motion)
            for group, state in zip(self.groups, self.states, strict=True)
        ]

    def tensions(self, motion: Motion) -> list[Float[Array, " n_elem"]]:
        """Return the axial forces, one array [n_elem] per group, N."""
        return self.results_by_name(motion, "tension")["tension"]

    def slack(self, motion: Motion) -> list[Bool[Array, " n_elem"]]:
        """Return which elements are slack (cables without tension), per group [n_elem] bool."""
        return self.results_by_name(motion, "is_slack")["is_slack"]

    @property
    def has_memory(self) -> bool:
        """Whether any group has history variables."""
        return any(group.has_memory for group in self.groups)

    @property
    def has_rupture(self) -> bool:
        """Whether any group has a rupture strain."""
        return any(group.has_rupture for group in self.groups)

    def strains(self, motion: Motion) -> PerGroup:
        """Return the strains that laws and sections have in all elements, an array per group.

        [n_elem] for bars and cables; e0, ky, kz at the integration points of beams, [n_elem,
        n_point, 3]; None for a group without the result "section_strain".
        """
        return self.results_by_name(motion, "section_strain")["section_strain"]

    def ruptured_elements(self, strains: PerGroup) -> Bool[Array, " n"]:
        """Return which elements of all groups are ruptured, [n] bool, at section `strains`."""
        return jnp.concatenate(
            [
                call_each_element("is_ruptured", group, strain)
                if group.has_rupture
                else jnp.zeros(len(group.links), bool)
                for group, strain in zip(self.groups, strains, strict=True)
            ]
        )

    def is_ruptured(self, motion: Motion) -> Bool[Array, ""]:
        """Return whether any element exceeds its rupture strain at a motion of all nodes (rows)."""
        return jnp.any(self.ruptured_elements(self.strains(motion)))

    def commit_memory(
        self, motion: Motion, strains: PerGroup | None = None, duration: Any = 0.0
    ) -> Memory:
        """Return the history variables of every group at the end of an increment.

        Args:
            motion: motion of all nodes (rows) at the end.
            strains: section strains there, per group; None: they are evaluated.
            duration: duration of the increment, s; 0 in phases, which have none.
        """
        strains = self.strains(motion) if strains is None else strains
        found, options = [], {"duration": duration}
        for group, state, strain in zip(self.groups, self.states, strains, strict=True):
            if not group.has_memory:
                found.append(None)
            elif type(group).committed_memory is Element.committed_memory:
                found.append(
                    call_each_element("commit_memory", group, strain, state.memory, **options)
                )
            else:
                at = self.nodes[group.links], motion[group.links]
                commit, beside = _Method("committed_memory", (duration,)), []
                if not isinstance(duration, float):  # it is traced
                    commit = _Method("committed_memory")
                    beside = [jnp.full(len(group.links), duration)]
                given = group, state, at, tuple(beside)
                found.append(map_elements_at_ends(commit, *given, absent=True))
        return found

    def length_scale(self) -> Float[Array, ""]:
        """Return the mean initial length of elements, m, by which steps are measured."""
        return mean_length(self.groups, self.nodes)

    def extent(self) -> Float[Array, ""]:
        """Return the diagonal of the structure's bounding box, m; infinite if all is at a point."""
        size = jnp.linalg.norm(jnp.max(self.nodes, axis=0) - jnp.min(self.nodes, axis=0))
        return jnp.where(size > 0, size, jnp.inf)


@dataclasses.dataclass(frozen=True)
class _Method:
    """A method of one element as a function: equal ones are the same function to jax.

    Attributes:
        name: name of the method.
        further: its arguments after those with which it is called, hashable.
    """

    name: str
    further: tuple[Any, ...] = ()

    def __call__(self, one: Element, *arguments: Any) -> Any:
        return getattr(one, self.name)(*arguments, *self.further)


def evaluate_elements(
    method: str,
    group: Element,
    state: ElementState,
    nodes: Float[Array, "n_row 3"],
    *motions: Motion,
    exact: Bool[ArrayLike, ""] = True,
    absent: bool = False,
) -> Any:
    """Call a method of every element of a group, by vmap; return arrays [n_elem, ...].

    The method takes (state, ends, motion, ...) of one element. `nodes` and `motions` are those of
    all rows; `exact` and `absent` are those of `map_elements_at_ends`.
    """
    at = [values[group.links] for values in (nodes, *motions)]
    return map_elements_at_ends(_Method(method), group, state, at, exact=exact, absent=absent)


def map_elements_at_ends(
    function: Callable[..., Any],
    group: Element,
    state: ElementState,
    at: Sequence[Float[Array, "n_elem n_end ..."]],
    beside: tuple[Float[Array, "n_elem ..."], ...] = (),
    exact: Bool[ArrayLike, ""] = True,
    absent: bool = False,
) -> Any:
    """Call ``function(one, state, ends, motion, *beside)`` for all elements of a group, by vmap.

    Args:
        function: function of one element, `one`. It is traced once for all calls in the same shapes
            if it is the same object, or an equal one (of the module, not a lambda).
        group, state: elements and their state.
        at: initial positions, and motions, at the ends of the elements, [n_elem, n_end, ...].
        beside: further arrays [n_elem, ...].
        exact: whether elongations are as precise as motions with a low-order part (six columns,
            see `spaces.translations`); without such motions it has no effect. With them, functions
            get elements that begin where they are now (`rebased_element`): present positions,
            relative to the first end, as `ends`, and zeros [n_end, 3] as `motion`.
        absent: whether inactive elements get results, as of elements that have not moved; else
            their results are zero.

    Returns:
        Results of all elements, arrays [n_elem, ...].
    """
    properties = group.properties()
    law = single_element(group, dict.fromkeys(properties))
    nodes, *motions = at
    at = nodes, *(_motion_columns(group, motion) for motion in motions)
    arrays = law, properties, state, at, beside, jnp.asarray(exact)
    if internals.is_tracing() and is_hashable(jax.tree.structure(arrays)):
        return _trace_elements_once(function, absent, *arrays)
    return _map_elements(function, absent, *arrays)


def _map_elements(function, absent, law, properties, state, at, beside, exact):
    """Return the results of `map_elements_at_ends`, of a group taken apart.

    `law` is the group without links and `properties`, which have a value for every element; other
    arguments are those of `map_elements_at_ends`.
    """
    nodes, *motions = at
    if state.present is not None:
        motions = [_zero_motion_unless(state.present, motion) for motion in motions]

    def one(properties, beside, *at):
        single = single_element(law, properties)
        return function(
            single, *(single.rebased_element(*at, exact) if has_low_part(at[-1]) else at), *beside
        )

    found = jax.vmap(one)(properties, beside, state, nodes, *motions)
    return found if absent or isinstance(found, ElementState) else state.zero_where_absent(found)


_trace_elements_once = jax.jit(_map_elements, static_argnums=(0, 1))
"""One function for all calls in the same shapes, also of several programs, and its derivatives."""


def _zero_motion_unless(present, motion):
    """Return motions of ends, [n_elem, n_end, n], or no motion for elements not `present`.

    Without motion displacements are zero, quaternions those of no rotation.
    """
    still = jnp.zeros(motion.shape[-1], motion.dtype)
    if len(still) == 7:
        still = still.at[3:].set(jnp.asarray(IDENTITY, motion.dtype))
    return jnp.where(present[:, None, None], motion, still)


def motion_at_ends(group: Element, motion: Motion) -> Float[Array, "n_elem n_end n_motion"]:
    """Gather motions of all rows at the ends of a group, [n_elem, n_end, 3, 6 or 7]."""
    return _motion_columns(group, motion[group.links])


def _motion_columns(group, ends):
    """Return motions at the ends of a group without the rotations that it does not use.

    `ends` are [n_elem, n_end, 3 or 7]; with a low-order part (6 columns) they stay as they are.
    """
    return ends if has_low_part(ends) else ends[..., : group.n_motion]
