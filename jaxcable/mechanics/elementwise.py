"""What is read off the elements of a structure, group by group."""

from __future__ import annotations

from typing import Any, TypeAlias

import jax
import jax.numpy as jnp

from ..common.types import Array, ArrayLike, Bool, Float, PyTree
from ..elements.element import PEAK_TENSION, TENSION, Element, ElementState, Result
from ..elements.prestress import element, of_each
from ..spaces.space import Motion

PerGroup: TypeAlias = 'list[Float[Array, "n_elem ..."] | None]'
"""An array for every group, or None where it has none."""
Memory: TypeAlias = 'list[PyTree[Float[Array, "n_elem ..."]] | None]'
"""What the law of every group remembers, or None."""


class Elementwise:
    """What a `System` says of its elements; it has `nodes`, `groups` and their `states`."""

    nodes: Float[Array, "n_row 3"]
    groups: list[Element]
    states: list[ElementState]

    def stored_energy(self, motion: Motion) -> Float[Array, ""]:
        """Energy stored in the elements, J."""
        total: Float[ArrayLike, ""] = sum(
            jnp.sum(each("energy", group, state, self.nodes, motion))
            for group, state in zip(self.groups, self.states, strict=True)
        )
        return total

    def reading(self, motion: Motion, *names: str) -> dict[str, list[Any]]:
        """What is read off the elements, each of them evaluated once for all of it.

        Args:
            motion: of all rows.
            names: of element methods.

        Returns:
            By name a list with an array for every group, or None where it has no such result: the
            strains of a mere stiffness, section forces of a cable; a peak tension without load
            along the element, where its axial force is the same everywhere.
        """
        found = []
        for group, state in zip(self.groups, self.states, strict=True):
            own = [name for name in names if group.has_result(name, state)]

            def read(one, *at, own=own):
                return one.reading(*at, own)

            found.append(_over(read, group, state, self.nodes, motion))
        return {name: [own.get(name) for own in found] for name in names}

    def results(self) -> dict[str, Result]:
        """What any group tells in its state, `Result` by name; tensions in any case."""
        pairs = zip(self.groups, self.states, strict=True)
        found = [own for g, s in pairs for own in g.results if g.has_result(own.name, s)]
        return {own.name: own for own in (TENSION, PEAK_TENSION, *found)}

    def linearized(self, motion: Motion) -> list[list[Any]]:
        """End forces of every group, and tangents of those whose elements find both together.

        Two lists; None for the tangents of others, which may not be asked for.
        """
        pairs = []
        for group, state in zip(self.groups, self.states, strict=True):
            together = group.finds_both(state)
            name = "linearized" if together else "end_forces"
            found = each(name, group, state, self.nodes, motion)
            pairs.append(found if together else (found, None))
        return [list(own) for own in zip(*pairs, strict=True)]

    def tangents(
        self, motion: Motion, known: PerGroup | None = None
    ) -> list[Float[Array, "n_elem d d"]]:
        """Tangent stiffness of all elements, list of [n_elem, d, d], if not `known` already."""
        known = [None] * len(self.groups) if known is None else known
        found = []
        for group, state, own in zip(self.groups, self.states, known, strict=True):
            own = each("tangent", group, state, self.nodes, motion) if own is None else own
            count = len(own)
            found.append(own.reshape(count, -1, round((own.size // count) ** 0.5)))
        return found

    def secants(self, before: Motion, motion: Motion) -> list[Float[Array, "n_elem ..."]]:
        """Secant stiffness of all elements between two motions, list of [n_elem, ...]."""
        return [
            each("secant", group, state, self.nodes, before, motion)
            for group, state in zip(self.groups, self.states, strict=True)
        ]

    def tensions(self, motion: Motion) -> list[Float[Array, " n_elem"]]:
        """Axial forces, one array [n_elem] per group, N."""
        return self.reading(motion, "tension")["tension"]

    def slack(self, motion: Motion) -> list[Bool[Array, " n_elem"]]:
        """Slack elements, one boolean array [n_elem] per group."""
        return self.reading(motion, "is_slack")["is_slack"]

    @property
    def remembers(self) -> bool:
        """Whether any group remembers what has happened to it."""
        return any(group.remembers for group in self.groups)

    @property
    def breaks(self) -> bool:
        """Whether any element can be strained beyond its curve."""
        return any(group.breaks for group in self.groups)

    def strains(self, motion: Motion) -> PerGroup:
        """Strains of what has fibres or a law, a list with an array for every group, or None."""
        return self.reading(motion, "section_strain")["section_strain"]

    def broken(self, strains: PerGroup) -> Bool[Array, " n"]:
        """Elements strained beyond their curve, all groups one after the other, bool."""
        return jnp.concatenate(
            [
                of_each("beyond", group, strain)
                if group.breaks
                else jnp.zeros(len(group.links), bool)
                for group, strain in zip(self.groups, strains, strict=True)
            ]
        )

    def beyond(self, motion: Motion) -> Bool[Array, ""]:
        """Whether any element is strained beyond its curve."""
        return jnp.any(self.broken(self.strains(motion)))

    def settle(self, strains: PerGroup, duration: float = 0.0) -> Memory:
        """Memory after an increment of a duration, s, that ended so, a list, None without any.

        Phases say nothing of time yet: theirs have none.
        """
        own = {"duration": duration}
        return [
            of_each("settle", group, strain, state.memory, **own) if group.remembers else None
            for group, state, strain in zip(self.groups, self.states, strains, strict=True)
        ]

    def length_scale(self) -> Float[Array, ""]:
        """A length to measure steps by: the mean initial element length, m."""
        return jnp.mean(jnp.concatenate([g.chord(self.nodes[g.links]) for g in self.groups]))

    def extent(self) -> Float[Array, ""]:
        """Size of the whole structure: diagonal of its bounding box, m."""
        return jnp.linalg.norm(jnp.max(self.nodes, axis=0) - jnp.min(self.nodes, axis=0))


def each(
    method: str,
    group: Element,
    state: ElementState,
    nodes: Float[Array, "n_row 3"],
    *motions: Motion,
) -> Any:
    """Evaluate an element method for all elements of a group by vmap."""
    return _over(lambda one, *at: getattr(one, method)(*at), group, state, nodes, *motions)


def _over(function, group, state, nodes, *motions):
    """``function(element, state, ends, motion)`` for all elements of a group."""

    def one(properties, *at):
        return function(element(group, properties), *at)

    ends, motions = nodes[group.links], (motion_of(group, motion) for motion in motions)
    return jax.vmap(one)(group.properties(), state, ends, *motions)


def motion_of(group: Element, motion: Motion) -> Float[Array, "n_elem n_end n_motion"]:
    """What the ends of a group's elements see of the motion, [n_elem, n_end, 3 or 7]."""
    return motion[group.links][..., : group.n_motion]
