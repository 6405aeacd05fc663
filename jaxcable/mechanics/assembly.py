"""The whole structure: residual, tangent, energy and results of one loaded state.

A `System` holds everything that is fixed while equilibrium is sought at one load factor: elements,
loads, and the space in which nodes move (`spaces`). The point ``x`` of an iteration is the motion
of all rows, [n_row, n_motion], which begins with displacements, m; a step [n_free] moves it on.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from typing import Any, TypeAlias

import jax
import jax.numpy as jnp

from .. import linear
from ..common.tree import copy, pytree
from ..common.types import Array, Bool, Float
from ..elements.abilities import Rounding
from ..elements.element import Element, ElementState
from ..elements.prestress import element
from ..spaces import Space
from ..spaces.freedoms import Freedoms, carriers
from ..spaces.space import Forces, Matrix, Motion, Part, Step
from .elementwise import Elementwise, PerGroup, each, motion_of
from .load_stacks import Following

EndForces: TypeAlias = 'list[Float[Array, "n_elem n_end n_freedom"]]'
"""End forces of every group."""


@pytree
class System(Elementwise):
    """One state of loading, ready to be brought to equilibrium.

    Attributes:
        nodes: initial positions, [n_row, 3], m.
        groups: element groups, their links arrays.
        states: element states, one per group (prestress).
        load: dead load on every row, [n_row, n_freedom], N and N m.
        space: `Space`: what supports do, and the numbering of the unknowns.
        followers: loads that depend on where the nodes are, a list of what has the
            members of `load_stacks.Following`, or None.
    """

    nodes: Float[Array, "n_row 3"]
    groups: list[Element]
    states: list[ElementState]
    load: Float[Array, "n_row n_freedom"]
    space: Space
    followers: list[Following] | None = None

    @property
    def freedoms(self) -> Freedoms:
        """The numbering of the unknowns, `Freedoms`."""
        return self.space.freedoms

    # --- points and steps

    def place(self, x: Motion) -> Motion:
        """`x` with what supports hold where they prescribe it."""
        return self.space.place(x)

    def carried(self, x: Motion) -> Motion:
        """`x`, a constant, as a function of what supports do to free nodes."""
        return self.space.carried(x)

    def move(self, x: Motion, step: Step) -> Motion:
        """The motion after a step [n_free]."""
        return self.space.move(x, step)

    def reach(self, x: Motion) -> Float[Array, ""]:
        """Largest displacement along an axis, m: what is said of rotations is no length."""
        return jnp.max(jnp.abs(x[:, :3]), initial=0.0)

    def chart(self, x: Motion) -> tuple[Callable[[Step], Step], Step, Callable[[Step], Motion]]:
        """Residual as a function of a step from `x`, the zero step, and the motion after a step."""
        x = self.place(x)
        # zero whatever x is, with the axes that x has in a batch: a root is sought from there
        zero = jnp.where(jnp.isnan(x[0, 0]), 0.0, 0.0)
        zero = jnp.full(self.freedoms.free.shape[0], zero, x.dtype)

        def residual(step: Step) -> Step:
            return self.space.held_still(self._residual_about(x, step), step)

        return residual, zero, lambda step: self.move(x, step)

    # --- forces

    def internal_force(
        self, x: Motion, end_forces: EndForces | None = None
    ) -> tuple[Forces, Float[Array, " n_row"]]:
        """Sum of the end forces at every row, [n_row, n_freedom], and of their sizes, [n_row], N.

        `end_forces` are those of every group, if they are at hand.
        """
        if end_forces is None:
            end_forces = self.reading(x, "end_forces")["end_forces"]
        rows, ends = self._at_ends([self.space.padded(own) for own in end_forces])
        force = jnp.zeros_like(self.load).at[rows].add(ends)
        size = jnp.zeros_like(x[:, 0]).at[rows].add(self.space.size(ends))
        for group, state in zip(self.groups, self.states, strict=True):
            if group.remembers:
                size = size.at[group.links].add(self.part_sizes(group, state, x))
        return force, size

    def _at_ends(self, values):
        """Rows of the ends of all groups one after the other, and values [n_elem, n_end, ...]."""
        rows = [group.links.reshape(-1) for group in self.groups]
        values = [own.reshape(-1, *own.shape[2:]) for own in values]
        return (own[0] if len(own) == 1 else jnp.concatenate(own) for own in (rows, values))

    def _end_forces_about(self, x, spread):
        """End forces of every group conjugate to a step of all rows from `x`."""
        found = []
        for group, state in zip(self.groups, self.states, strict=True):
            own = motion_of(group, x), spread[group.links, : group.n_freedom]
            about = jax.vmap(lambda p, *at, group=group: element(group, p).end_forces_about(*at))
            found.append(about(group.properties(), state, self.nodes[group.links], *own))
        return found

    def part_sizes(
        self, group: Element, state: ElementState, motion: Motion
    ) -> Float[Array, "n_elem n_end"]:
        """Forces inside elements that can balance each other there, at both ends, [n_elem, 2], N.

        An unloaded elastic-plastic element is in equilibrium to the rounding of these.
        """
        sizes = each("size", group, state, self.nodes, motion)[:, None]
        return jnp.repeat(sizes, group.links.shape[1], axis=1)

    def all_load(self, x: Motion) -> Forces:
        """Dead and following loads on every row, as `load`."""
        if self.followers is None:
            return self.load
        return self.load + self.space.padded(self.following(self.nodes + x[:, :3]))

    def following(self, moved: Float[Array, "n_row 3"]) -> Float[Array, "n_row 3"]:
        """Following loads on every row at the positions `moved`, both [n_row, 3], N."""
        arguments = self.groups, self.states, self.nodes, moved
        forces: list[Any] = [own.following_forces(*arguments) for own in self.followers]
        return sum(forces)

    def unbalanced(self, x: Motion, end_forces: EndForces | None = None) -> Forces:
        """Internal force minus load at every row, as `load`."""
        return self.internal_force(x, end_forces)[0] - self.all_load(x)

    def residual(self, x: Motion) -> Step:
        """Unbalanced force at every free freedom, [n_free], N (moments over a length)."""
        return self.space.collected(self.unbalanced(x), x)

    def _residual_about(self, x: Motion, step: Step) -> Step:
        """Unbalanced force conjugate to a step [n_free] from `x`, [n_free], N."""
        spread = self.space.spread(x, step)
        load = self.space.conjugate(self.load, spread)
        if self.followers is not None:
            moved = self.nodes + x[:, :3] + spread[:, :3]
            load = load + self.space.padded(self.following(moved))
        internal, _ = self.internal_force(x, self._end_forces_about(x, spread))
        return self.space.collected(internal - load, x, spread)

    def evaluated(self, x: Motion) -> tuple[Step, Float[Array, ""], PerGroup]:
        """`residual_and_scale`, and tangents of elements that are found with it, for `tangent`."""
        end_forces, tangents = self.linearized(x)
        return *self.residual_and_scale(x, end_forces), tangents

    def residual_and_scale(
        self, x: Motion, end_forces: EndForces | None = None
    ) -> tuple[Step, Float[Array, ""]]:
        """Residual [n_free], and the force it is judged by, N.

        The scale is the largest, over rows, of the sum of absolute end forces plus the load.
        """
        (force, size), load = self.internal_force(x, end_forces), self.all_load(x)
        scale = jnp.max(size + self.space.size(load))
        return self.space.collected(force - load, x), scale

    @property
    def rounds(self) -> bool:
        """Whether any element may be without force and yet have the rounding of its stiffness."""
        return any(isinstance(group, Rounding) for group in self.groups)

    def rounding(self, x: Motion) -> Step:
        """Residual that the rounding of displacements leaves at every freedom, [n_free], N."""
        left = jnp.zeros_like(self.load)
        for group, state in zip(self.groups, self.states, strict=True):
            if isinstance(group, Rounding):
                ends = each("rounding", group, state, self.nodes, x)
                left = left.at[group.links, : ends.shape[-1]].add(ends)
        return self.space.collected(left, x)

    def load_norm(self, x: Motion) -> Float[Array, ""]:
        """Euclidean norm of the load on the free freedoms, N (moments over a length)."""
        return jnp.linalg.norm(self.space.collected(self.all_load(x), x))

    def unsymmetric(self) -> Bool[Array, ""]:
        """Whether the tangent is not symmetric, scalar bool: nodal moments act, or loads follow."""
        moments = self.space.moments(self.load)
        return self.followed if moments is None else jnp.any(moments != 0) | self.followed

    @property
    def followed(self) -> Bool[Array, ""]:
        """Whether a load follows the nodes, scalar bool: of a later phase it does not act yet."""
        if self.followers is None:
            return jnp.zeros((), bool)
        return jnp.any(jnp.stack([own.acts for own in self.followers]))

    # --- matrices

    def tangent(self, x: Motion, known: PerGroup | None = None) -> Matrix:
        """Tangent stiffness, a matrix of `linear`, N/m: derivative of the residual by a step.

        By autodiff of the element forces. Dense [n_free, n_free], or sparse if the freedoms have a
        pattern. `known` are tangents of elements that are at hand, see `linearized`.
        """
        parts = self.parts(self.tangents(x, known), x) + self._following_blocks(x)
        own = self.space.own_parts(self.load, lambda: self.unbalanced(x), x)
        return self.space.regular(self._assemble(parts + own), x)

    def parts(self, matrices: Sequence[Float[Array, "n_elem ..."]], x: Motion) -> list[Part]:
        """Matrices [n_elem, d, d] of the elements of all groups as `linear.assemble` takes them."""
        return self._parts(zip(matrices, self.groups, strict=True), x)

    def _parts(
        self, pairs: Iterable[tuple[Float[Array, "n_elem ..."], Element]], x: Motion
    ) -> list[Part]:
        part = self.space.part
        return [part(own, group.links, group.n_freedom, group.inner, x) for own, group in pairs]

    def assembled(
        self, pairs: Iterable[tuple[Float[Array, "n_elem ..."], Element]], x: Motion
    ) -> Matrix:
        """A matrix as `tangent` from those of elements, list of ([n_elem, d, d], their group)."""
        return self._assemble(self._parts(pairs, x))

    def _following_blocks(self, x: Motion) -> list[Part]:
        """What following loads take from the tangent, as `parts`."""
        if self.followers is None:
            return []
        arguments = self.groups, self.states, self.nodes, self.nodes + x[:, :3]
        return [
            self.space.part(-blocks, links, 3, (), x)
            for own in self.followers
            for blocks, links in own.following_blocks(*arguments)
        ]

    def secant(self, before: Motion, x: Motion) -> Matrix:
        """Secant stiffness between two points, as `tangent`, N/m."""
        return self._assemble(self.parts(self.secants(before, x), x))

    def displaced_by(self, x: Motion) -> Float[Array, "n_row 3 n_free"]:
        """Displacements of all rows by the unknowns, [n_row, 3, n_free], about a point."""
        freedoms, n_row = self.freedoms, len(x)
        number, slopes = freedoms.number, self.space.slopes(x)
        if freedoms.carried is not None:
            number = number[carriers(n_row, freedoms.carried)]
        if slopes is None:
            number = number[:, :3]
            slopes = jnp.broadcast_to(jnp.eye(3, dtype=x.dtype), (n_row, 3, 3))
        moved = jnp.zeros((n_row, 3, freedoms.free.shape[0] + 1), x.dtype)
        at = jnp.arange(n_row)[:, None, None], jnp.arange(3)[None, :, None], number[:, None, :]
        return moved.at[at].add(slopes[:, :3])[..., :-1]

    def _assemble(self, parts: list[Part]) -> Matrix:
        matrix = linear.assemble(parts, self.freedoms.free.shape[0], self.freedoms.pattern)
        bound = self.freedoms.bound
        return matrix if bound is None else linear.held_at(matrix, bound)

    # --- results

    def potential(self, x: Motion) -> Float[Array, ""]:
        """Stored energy minus the work of the dead nodal forces, J; the residual is its gradient.

        Following loads and nodal moments are left out: they need not have a potential.
        """
        return self.stored_energy(x) - jnp.sum(self.load[:, :3] * x[:, :3])

    def reactions(self, x: Motion, end_forces: EndForces | None = None) -> Forces:
        """Forces of the supports on the structure, as `load`; zero where free."""
        return self.space.reactions(self.unbalanced(x, end_forces), x)

    def loose_nodes(
        self, motion: Motion, slack: list[Bool[Array, " n_elem"]] | None = None
    ) -> Bool[Array, " n_row"]:
        """Nodes that are not wholly supported and touch only slack elements, [n_node] bool."""
        slack = self.slack(motion) if slack is None else slack
        pairs = zip(self.groups, slack, strict=True)
        rows, taut = self._at_ends([jnp.repeat(~s[:, None], g.links.shape[1], 1) for g, s in pairs])
        held_up = jnp.zeros(self.nodes.shape[0], bool).at[rows].max(taut)
        if self.freedoms.rows is not None:
            held_up = held_up.at[self.freedoms.rows].max(held_up)
        return ~held_up & ~jnp.all(self.freedoms.fixed, axis=-1)

    def kinked(self, motion: Motion) -> Bool[Array, ""]:
        """Whether a cable that moves with free nodes is exactly unstressed.

        Equilibrium then has no derivative. (Laws with a memory slacken elsewhere.)
        """
        found, free = jnp.zeros((), bool), self.freedoms.moves()
        for group, state in zip(self.groups, self.states, strict=True):
            if group.tension_only and not group.remembers:
                moves = jnp.any(free[group.links], axis=(1, 2))
                kink = each("at_kink", group, state, self.nodes, motion)
                found = found | jnp.any(kink & moves)
        return found

    @property
    def may_be_convex(self) -> bool:
        """Whether the energy is convex while loads are dead: tension-only groups of rising laws."""
        return all(group.tension_only and group.rising for group in self.groups)

    @property
    def always_convex(self) -> bool:
        """Whether it is convex, and no load follows or slides, in this phase or a later one."""
        return self.may_be_convex and self.followers is None and not self._sliding

    @property
    def convex(self) -> Bool[Array, ""]:
        """Whether the energy is convex, scalar bool."""
        if self.always_convex or not self.may_be_convex:
            return jnp.asarray(self.always_convex)
        still = [jnp.all(load == 0) for load in self._sliding]
        return jnp.all(jnp.stack([~self.followed, *still]))

    @property
    def _sliding(self) -> list[Float[Array, "n_elem 3"]]:
        """Loads that slide along elements, a list of [n_elem, 3], N/m."""
        pairs = zip(self.groups, self.states, strict=True)
        loads = [state.line_load for group, state in pairs if group.slides]
        return [load for load in loads if load is not None]

    def softened(self, compliance: Float[Array, ""]) -> System:
        """The same system with a spring in series with every element, strain per force, 1/N."""
        return copy(self, groups=[group.softened(compliance) for group in self.groups])
