"""Nodes that have displacements only: cable nets, trusses."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Self

import jax.numpy as jnp

from ..common.tree import pytree
from ..common.types import Array, ArrayLike, Float, Int
from .freedoms import Freedoms, along, combined, numbers_of
from .space import Forces, Group, Motion, Part, Space, Step, by_numbers, square


@pytree
class Translations(Space):
    """The motion of a row is its displacement, [3], m; see `Space`."""

    @classmethod
    def of(
        cls,
        nodes: Float[Array, "n_row 3"],
        groups: Sequence[Group],
        freedoms: Freedoms,
        prescribed: Motion | None,
        bearing: Float[Array, "n_row 4"] | None,
    ) -> Self:
        """The space of a system."""
        return cls(freedoms, prescribed)

    @classmethod
    def still(cls, nodes: Float[Array, "n_row 3"]) -> Motion:
        """Zero displacements."""
        return jnp.zeros_like(nodes)

    @classmethod
    def advanced(cls, motion: Motion, step: Forces) -> Motion:
        """Motion plus step."""
        return motion + step

    @classmethod
    def between(cls, before: Motion, after: Motion) -> Forces:
        """Displacement from one motion to another."""
        return after - before

    def spread(self, x: Motion, step: Step) -> Forces:
        """Displacement of every row."""
        components = jnp.append(step, jnp.zeros(1, step.dtype))[self.freedoms.number]
        return (
            components if self.freedoms.axes is None else combined(self.freedoms.axes, components)
        )

    def move(self, x: Motion, step: Step) -> Motion:
        """The motion after a step [n_free]."""
        return x + self.spread(x, step)

    def size(self, force: Float[Array, "... n_freedom"]) -> Float[Array, " ..."]:
        """Norms of forces."""
        return jnp.sqrt(jnp.sum(force**2, axis=-1))

    def collected(self, force: Forces, x: Motion, spread: Forces | None = None) -> Step:
        """Components of forces along the free freedoms."""
        components = force if self.freedoms.axes is None else along(self.freedoms.axes, force)
        return self.freedoms.released(components.reshape(-1)[self.freedoms.free])

    def reactions(self, unbalanced: Forces, motion: Motion) -> Forces:
        """Unbalanced forces along held freedoms."""
        fixed, axes = self.freedoms.fixed, self.freedoms.axes
        if axes is None:
            return jnp.where(fixed, unbalanced, 0.0)
        return combined(axes, jnp.where(fixed, along(axes, unbalanced), 0.0))

    def slopes(self, x: Motion) -> Float[Array, "n_row 3 3"] | None:
        """Directions of the freedoms, one in each column; None if they are x, y, z."""
        axes = self.freedoms.axes
        return None if axes is None else jnp.swapaxes(jnp.asarray(axes), 1, 2)

    def part(
        self,
        blocks: Float[Array, "n_elem ..."],
        links: Int[ArrayLike, "n_elem n_end"],
        width: int,
        inner: Sequence[tuple[int, int]],
        x: Motion,
    ) -> Part:
        """Matrices by the unknowns of their ends, and the numbers of these unknowns."""
        number = numbers_of(self.freedoms.number, links, width, inner)
        blocks, slopes = square(blocks), self.slopes(x)
        if slopes is not None:
            blocks = by_numbers(blocks, slopes[links], len(inner))
        return blocks, number
