"""The whole structure: residual, tangent, energy and results of one loaded state.

A `System` has everything that is constant while equilibrium is sought at one load factor: elements,
loads, and the space in which nodes move (`spaces`). The point ``x`` of an iteration is the motion
of all rows, [n_row, n_motion], displacements first, m. A step [n_free] changes all unknowns.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Any, TypeAlias

import jax
import jax.numpy as jnp

from .. import linear
from ..common.tree import copy_with, pytree
from ..common.types import Array, ArrayLike, Bool, Float
from ..elements.abilities import RoundingEstimate, TensionElement
from ..elements.element import Element
from ..elements.element_state import ElementState
from ..spaces import Space
from ..spaces.dof_map import reference_rows
from ..spaces.space import Forces, Matrix, MatrixPart, Motion, Step
from ..spaces.translations import append_low_part, drop_low_part
from .elementwise import Elementwise, PerGroup, evaluate_elements
from .kinks import SlackenedElements, find_slackened, slacken
from .load_stacks import LoadStack

EndForces: TypeAlias = 'list[Float[Array, "n_elem n_end n_freedom"]]'
"""End forces of every group."""


@pytree
class System(Elementwise):
    """The equations of a structure at one load factor: forces, tangent, energy.

    Attributes:
        nodes: initial positions, [n_row, 3], m.
        groups: element groups; their links are arrays.
        states: element states, one per group.
        load: dead load on every row, [n_row, n_freedom], N and N m.
        space: `Space`: supports and degrees of freedom.
        followers: following loads, which depend on the positions of the nodes, a list of
            `load_stacks.LoadStack`, or None.
    """

    nodes: Float[Array, "n_row 3"]
    groups: list[Element]
    states: list[ElementState]
    load: Float[Array, "n_row n_freedom"]
    space: Space
    followers: list[LoadStack] | None = None

    def without_softening(self) -> System:
        """Return a copy with laws that do not soften (`Law.without_softening`)."""
        return copy_with(self, groups=[group.without_softening() for group in self.groups])

    # --- points and steps

    def impose_supports(self, x: Motion) -> Motion:
        """Return motion `x` with supported degrees of freedom at their prescribed values."""
        return self.space.impose_supports(x)

    def with_support_rotations(self, x: Motion) -> Motion:
        """Return `x` with its derivative by the rotations that nodes had when supports were set."""
        return self.space.with_support_rotations(x)

    def move(self, x: Motion, step: Step) -> Motion:
        """Return the motion after a step of the unknowns, [n_free], from motion `x`."""
        return self.space.move(x, step)

    def largest_displacement(self, x: Motion) -> Float[Array, ""]:
        """Return the largest displacement along an axis, m; rotations do not count."""
        return jnp.max(jnp.abs(x[:, :3]), initial=0.0)

    def local_residual(
        self, x: Motion
    ) -> tuple[Callable[[Step], Step], Step, Callable[[Step], Motion]]:
        """Return (residual as a function of a step from `x`, a zero step, motion by a step)."""
        x = self.impose_supports(x)
        # computed from x, so that the zero step has the batch axes of x
        zero = jnp.where(jnp.isnan(x[0, 0]), 0.0, 0.0)
        zero = jnp.full(self.dof_map.free.shape[0], zero, x.dtype)

        return lambda step: self.after_step(x, step)[0], zero, lambda step: self.move(x, step)

    def after_step(self, x: Motion, step: Step, *names: str) -> tuple[Step, dict[str, list[Any]]]:
        """Return the residual after a step of the unknowns, and named results of elements there.

        Args:
            x: motion, with the supports imposed.
            step: step of the unknowns, [n_free], from it.
            names: names of results of elements; "end_forces" come in any case.

        Returns:
            The residual conjugate to the step, [n_free], N; a dict as of `results_by_name`.
        """
        row_step = self.space.prolong(x, step)
        # with slackness, it shares the functions of `evaluate_output`
        wanted = sorted({*names, "end_forces", *(["is_slack"] if names else [])})
        found = self.results_by_name(self.move(x, step), *wanted)
        internal = self.space.conjugate_loads(self._assemble_forces(found["end_forces"]), row_step)
        residual = self.space.restrict(internal - self.external_force(x, row_step), x, row_step)
        return self.space.hold_temporarily_fixed(residual, step), found

    def with_zero_low_order_part(self, x: Motion) -> Motion:
        """Return `x`; for cable nets with three columns of zeros, in place of a low-order part."""
        return append_low_part(drop_low_part(x)) if self.is_net else x

    # --- forces

    def internal_force(
        self, x: Motion, end_forces: EndForces | None = None
    ) -> tuple[Forces, Float[Array, " n_row"]]:
        """Assemble end forces at nodes (rows), [n_row, n_freedom], and their norms, [n_row], N.

        `end_forces`, an array per group, are evaluated at `x` unless given.
        """
        if end_forces is None:
            end_forces = self.results_by_name(x, "end_forces")["end_forces"]
        ends = [self.space.pad_moments(forces) for forces in end_forces]
        return self.sum_at_rows(ends), self.sum_at_rows(self.end_force_norms(ends, x))

    def _assemble_forces(self, end_forces: EndForces) -> Forces:
        """Assemble end forces at nodes (rows), [n_row, n_freedom], N and N m."""
        return self.sum_at_rows([self.space.pad_moments(forces) for forces in end_forces])

    def end_force_norms(self, ends: EndForces, x: Motion) -> list[Float[Array, "n_elem n_end"]]:
        """Return norms of end forces plus `internal_absolute_forces`, [n_elem, n_end] each, N."""
        sizes = [self.space.force_norm(forces) for forces in ends]
        for k, (group, state) in enumerate(zip(self.groups, self.states, strict=True)):
            if group.has_memory:
                sizes[k] = sizes[k] + self.internal_absolute_forces(group, state, x)
        return sizes

    def internal_absolute_forces(
        self, group: Element, state: ElementState, motion: Motion
    ) -> Float[Array, "n_elem n_end"]:
        """Return sums of absolute forces of an element's parts, at each end, [n_elem, n_end], N.

        Forces of the parts of an elastic-plastic element can cancel each other. An unloaded element
        is in equilibrium up to the rounding of these forces.
        """
        sizes = evaluate_elements("absolute_force", group, state, self.nodes, motion)[:, None]
        return jnp.repeat(sizes, group.links.shape[1], axis=1)

    def external_force(self, x: Motion, row_step: Forces | None = None) -> Forces:
        """Return dead and following loads on all nodes (rows), [n_row, n_freedom], N and N m.

        A system with further forces, such as inertia, adds them here, and their tangent to
        `external_stiffness_parts`; every solver uses these two methods.

        Args:
            x: motion of all nodes (rows).
            row_step: step of all rows from `x`; the loads are those after it, work-conjugate to it.
        """
        load = self.load if row_step is None else self.space.conjugate_loads(self.load, row_step)
        if self.followers is None:
            return load
        moved = self.nodes + x[:, :3]
        moved = moved if row_step is None else moved + row_step[:, :3]
        return load + self.space.pad_moments(self.follower_forces(moved))

    def follower_forces(self, moved: Float[Array, "n_row 3"]) -> Float[Array, "n_row 3"]:
        """Return follower loads on nodes, [n_row, 3], N, with nodes at `moved`, [n_row, 3], m."""
        arguments = self.groups, self.states, self.nodes, moved
        forces: list[Any] = [follower.following_forces(*arguments) for follower in self.followers]
        return sum(forces)

    def unbalanced(self, x: Motion, end_forces: EndForces | None = None) -> Forces:
        """Return internal forces less loads at all nodes, [n_row, n_freedom], N and N m."""
        if end_forces is None:
            end_forces = self.results_by_name(x, "end_forces")["end_forces"]
        return self._assemble_forces(end_forces) - self.external_force(x)

    def residual(self, x: Motion) -> Step:
        """Return the residual at motion `x`: the unbalanced force of every unknown, [n_free], N."""
        return self.space.restrict(self.unbalanced(x), x)

    def residual_and_scale(
        self, x: Motion, end_forces: EndForces | None = None
    ) -> tuple[Step, Float[Array, ""]]:
        """Return the residual at `x`, [n_free], and the force that its tolerance refers to, N.

        This scale is the largest, over rows, of the sum of absolute end forces plus the load.
        """
        (force, size), load = self.internal_force(x, end_forces), self.external_force(x)
        scale = self.force_scale(size + self.space.force_norm(load))
        return self.space.restrict(force - load, x), scale

    def force_scale(self, sizes: Float[Array, " n_row"]) -> Float[Array, ""]:
        """Return the force of tolerances, N: the largest sum of absolute forces, of [n_row]."""
        return jnp.max(sizes)

    @property
    def estimates_rounding(self) -> bool:
        """Whether any elements estimate the rounding error of forces (`RoundingEstimate`)."""
        return any(isinstance(group, RoundingEstimate) for group in self.groups)

    def rounding_error(self, x: Motion) -> Step:
        """Estimate the absolute error of the residual from rounding of `x`, [n_free], N."""
        left = []
        for group, state in zip(self.groups, self.states, strict=True):
            if isinstance(group, RoundingEstimate):
                error = evaluate_elements("rounding_error", group, state, self.nodes, x)
                left.append(self.space.pad_moments(error))
            else:
                left.append(jnp.zeros((*group.links.shape, self.space.n_freedom), x.dtype))
        return jnp.abs(self.space.restrict(self.sum_at_rows(left), x))

    def load_norm(self, x: Motion) -> Float[Array, ""]:
        """Return the Euclidean norm of the load on the unknowns, N (moments over a length)."""
        return jnp.linalg.norm(self.space.restrict(self.external_force(x), x))

    @property
    def may_be_unsymmetric(self) -> bool:
        """Whether the tangent can be unsymmetric: by rotations, follower loads or elements."""
        return self.followers is not None or self.space.rotates or not self._has_symmetric_elements

    @property
    def _has_symmetric_elements(self) -> bool:
        """Whether the tangents of all elements are symmetric."""
        return all(group.symmetric for group in self.groups)

    def unsymmetric(self) -> Bool[Array, ""]:
        """Return whether the tangent is unsymmetric, scalar bool.

        It is so under nodal moments and following loads, and with unsymmetric elements.
        """
        if not self._has_symmetric_elements:
            return jnp.ones((), bool)
        moments = self.space.moments(self.load)
        following = self.has_following_loads
        return following if moments is None else jnp.any(moments != 0) | following

    @property
    def has_following_loads(self) -> Bool[Array, ""]:
        """Whether a following load acts in this phase, scalar bool."""
        if self.followers is None:
            return jnp.zeros((), bool)
        return jnp.any(jnp.stack([follower.is_acting for follower in self.followers]))

    # --- matrices

    def tangent(self, x: Motion, known: PerGroup | None = None) -> Matrix:
        """Assemble the tangent stiffness, N/m: the derivative of the residual by a step from `x`.

        A matrix of `linear`: dense [n_free, n_free], or sparse if the `DofMap` has a pattern.
        `known` has tangents that are evaluated already, one item per group: [n_elem, d, d] or None.
        """
        if self.dof_map.pattern is None and not self.dof_map.free.shape[0]:  # all is held
            return jnp.zeros((0, 0), x.dtype)
        parts = self.matrix_parts(self.tangents(x, known), x) + self.external_stiffness_parts(x)
        return self.space.stabilize_torsional_mechanisms(self._assemble_matrix(parts), x)

    def matrix_parts(
        self, matrices: Sequence[Float[Array, "n_elem ..."]], x: Motion
    ) -> list[MatrixPart]:
        """Transform element matrices, [n_elem, d, d] per group, to `MatrixPart`s by unknowns."""
        return [
            self.space.transform_to_unknowns(
                blocks, group.links, group.n_freedom, group.inner_unknowns, x
            )
            for blocks, group in zip(matrices, self.groups, strict=True)
        ]

    def mass_matrix(
        self, x: Motion, gravity: Float[ArrayLike, ""], distribution: str | None = None
    ) -> Matrix:
        """Assemble the mass matrix of the elements, on the pattern of `tangent`, kg.

        Weights are divided by `gravity`, m/s2; `distribution` is that of `Element.mass_matrix`. A
        pattern that stores stiffness blocks in pairs has no places for masses (ValueError).
        """
        pattern = self.dof_map.pattern
        if pattern is not None and any(pattern.paired):
            raise ValueError("pattern: is one of paired elements, whose masses are not paired")
        parts = self.matrix_parts(self.mass_matrices(x, gravity, distribution), x)
        return self._assemble_matrix(parts + self.external_mass_parts(x))

    def external_mass_parts(self, x: Motion) -> list[MatrixPart]:
        """Return masses that are none of elements: zeros where the pattern has places for loads."""
        others = jax.eval_shape(lambda: self.external_stiffness_parts(x))
        return jax.tree.map(lambda a: jnp.zeros(a.shape, a.dtype), others)

    def external_stiffness_parts(self, x: Motion) -> list[MatrixPart]:
        """Return minus the derivative of the loads by a step (load stiffness), in `MatrixPart`s.

        A sparse pattern needs places for them: give `make_dof_map` their `links` after the groups'.
        """
        turning = self.space.load_stiffness(self.load, lambda: self.unbalanced(x), x)
        return self.following_stiffness_parts(x) + turning

    def following_stiffness_parts(self, x: Motion) -> list[MatrixPart]:
        """Return minus the derivative of the following loads by a step, in `MatrixPart`s."""
        arguments = self.groups, self.states, self.nodes, self.nodes + x[:, :3]
        return [
            self.space.transform_to_unknowns(-blocks, links, 3, (), x)
            for follower in self.followers or ()
            for blocks, links in follower.following_blocks(*arguments)
        ]

    def largest_load(self) -> Float[Array, ""]:
        """Return the largest dead load on a row, N, a scale of forces."""
        return jnp.max(self.space.force_norm(self.load))

    def secant(self, before: Motion, x: Motion) -> Matrix:
        """Assemble the secant stiffness between two motions, a matrix like `tangent`, N/m."""
        return self._assemble_matrix(self.matrix_parts(self.secants(before, x), x))

    def displacement_jacobian(self, x: Motion) -> Float[Array, "n_row 3 n_free"]:
        """Return the derivative of all displacements by the unknowns, [n_row, 3, n_free]."""
        one = jnp.eye(self.dof_map.free.shape[0], dtype=x.dtype)
        return jnp.moveaxis(jax.vmap(lambda step: self.displacements_of_step(x, step))(one), 0, -1)

    def displacements_of_step(self, x: Motion, step: Step) -> Float[Array, "n_row 3"]:
        """Return the displacements by a small step of the unknowns, linear in it, m."""
        dof_map, n_row = self.dof_map, len(x)
        number, slopes = dof_map.unknown_of_dof, self.space.motion_jacobian(x)
        if dof_map.rigid_links is not None:
            number = number[reference_rows(n_row, dof_map.rigid_links)]
        own = linear.append_zero(step)[number]
        return own[:, :3] if slopes is None else jnp.einsum("rci,ri->rc", slopes[:, :3], own)

    def _assemble_matrix(self, parts: list[MatrixPart]) -> Matrix:
        """Assemble a matrix from `parts`; temporarily fixed unknowns keep a diagonal entry only."""
        matrix = linear.assemble_matrix(parts, self.dof_map.free.shape[0], self.dof_map.pattern)
        bound = self.dof_map.temporarily_fixed
        return matrix if bound is None or not bound.size else linear.hold_unknowns(matrix, bound)

    # --- results

    def potential(self, x: Motion) -> Float[Array, ""]:
        """Return stored energy less the work of dead nodal forces, J; the residual is its gradient.

        Following loads and nodal moments are left out, because they need not have a potential.
        """
        return self.stored_energy(x) - jnp.sum(self.load[:, :3] * x[:, :3])

    def reactions(self, x: Motion, end_forces: EndForces | None = None) -> Forces:
        """Return forces of supports on the structure, [n_row, n_freedom]; zero where free."""
        return self.space.reactions(self.unbalanced(x, end_forces), x)

    def nodes_without_stiffness(
        self, motion: Motion, slack: list[Bool[Array, " n_elem"]] | None = None
    ) -> Bool[Array, " n_row"]:
        """Return which free nodes have only elements that are `slack` (per group), [n_row] bool."""
        slack = self.slack(motion) if slack is None else slack
        taut = []
        for group, state, loose in zip(self.groups, self.states, slack, strict=True):
            bears = state.zero_where_absent(~loose)[:, None]
            taut.append(jnp.broadcast_to(bears, group.links.shape).astype(jnp.int32))
        stiffened = self.sum_at_rows(taut) > 0
        if self.dof_map.node_of_row is not None:
            stiffened = stiffened.at[self.dof_map.node_of_row].max(stiffened)
        return ~stiffened & ~jnp.all(self.dof_map.fixed, axis=-1)

    def find_slackened(self, motion: Motion) -> SlackenedElements:
        """Return which elements loose nodes can slacken, for derivatives: see `kinks`."""
        return find_slackened(self, motion)

    def slacken(self, released: list[Bool[Array, " n_elem"] | None]) -> System:
        """Return the system with `released` elements slack, [n_elem] bool per group or None."""
        return slacken(self, released)

    @property
    def may_be_convex(self) -> bool:
        """Whether all elements are tension-only and have monotone, symmetric laws."""
        return self._has_symmetric_elements and all(
            group.tension_only and group.monotone for group in self.groups
        )

    @property
    def always_convex(self) -> bool:
        """Whether energy is convex in all phases: `may_be_convex`, no load follows or slides."""
        return self.may_be_convex and self.followers is None and not self._sliding_loads

    @property
    def convex(self) -> Bool[Array, ""]:
        """Whether the energy is convex under the present loads, scalar bool."""
        if self.always_convex or not self.may_be_convex:
            return jnp.asarray(self.always_convex)
        still = [jnp.all(load == 0) for load in self._sliding_loads]
        return jnp.all(jnp.stack([~self.has_following_loads, *still]))

    @property
    def _sliding_loads(self) -> list[Float[Array, "n_elem 3"]]:
        """Loads that slide along elements (ropes on pulleys), a list of [n_elem, 3], N/m."""
        pairs = zip(self.groups, self.states, strict=True)
        loads = [state.line_load for group, state in pairs if group.slides]
        return [load for load in loads if load is not None]

    @property
    def is_net(self) -> bool:
        """Whether this is a net of cables under dead loads, each with one tension as an unknown."""
        pairs = zip(self.groups, self.states, strict=True)
        cables = [isinstance(g, TensionElement) and g.has_tension_unknown(s) for g, s in pairs]
        return all(cables) and self.always_convex and not self.space.rotates
