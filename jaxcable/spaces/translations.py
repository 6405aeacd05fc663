"""Nodes that have displacements only: cable nets, trusses.

A motion [n_row, 3] has as many digits as a float. Nets are iterated with a *fine part* beside it,
in three more columns: the displacement is the sum of both, to nearly twice as many digits.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Self

import jax.numpy as jnp
from jax import lax

from ..common.tree import pytree
from ..common.types import Array, ArrayLike, Float, Int
from ..linear import with_zero
from ..numerics import exact
from .freedoms import Freedoms, along, combined, numbers_of
from .space import Forces, Group, Motion, Part, Space, Step, by_numbers, square

_FINE = 6  # columns of a motion with a fine part; no other space has motions of so many


def is_fine(x: Float[Array, "... n_motion"]) -> bool:
    """Whether motions have a fine part."""
    return x.shape[-1] == _FINE


def coarse(motion: Float[Array, "... n_motion"]) -> Float[Array, "... n_motion"]:
    """Motions without a fine part."""
    return motion[..., :3] if is_fine(motion) else motion


def refined(motion: Float[Array, "n_row 3"]) -> Float[Array, "n_row 6"]:
    """Displacements [n_row, 3], m, with a fine part, which is zero."""
    return jnp.concatenate([motion, jnp.zeros_like(motion)], axis=1)


@pytree
class Translations(Space):
    """The motion of a row is its displacement, [3], m, or [6] with a fine part; see `Space`."""

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
        return _after(motion, step) if is_fine(motion) else motion + step

    @classmethod
    def between(cls, before: Motion, after: Motion) -> Forces:
        """Displacement from one motion, without a fine part, to another."""
        shift = coarse(after) - before
        return shift + after[:, 3:] if is_fine(after) else shift

    @classmethod
    def borne(cls, motion: Motion, arm: Float[Array, "n_row 3"]) -> Motion:
        """The same displacements, because nothing turns."""
        return motion

    def place(self, x: Motion) -> Motion:
        """`x` with the freedoms that supports hold put to their prescribed values."""
        if not is_fine(x):
            return super().place(x)
        fixed, axes, prescribed = self.freedoms.fixed, self.freedoms.axes, self._prescribed
        high, low = x[:, :3], x[:, 3:]
        if axes is None:
            placed = [jnp.where(fixed, prescribed, high), jnp.where(fixed, 0.0, low)]
            return jnp.concatenate(placed, axis=1)
        # the difference, because components of the displacement itself would be rounded
        away = along(axes, (prescribed - high) - low)
        return _after(x, combined(axes, jnp.where(fixed, away, 0.0)))

    def spread(self, x: Motion, step: Step) -> Forces:
        """Displacement of every row."""
        numbering = self.freedoms.numbering
        if numbering is None:
            components = with_zero(step)[self.freedoms.number]
        else:
            components = numbering.spread(step).reshape(self.freedoms.number.shape)
        return (
            components if self.freedoms.axes is None else combined(self.freedoms.axes, components)
        )

    def move(self, x: Motion, step: Step) -> Motion:
        """The motion after a step [n_free]."""
        return self.advanced(x, self.spread(x, step))

    def size(self, force: Float[Array, "... n_freedom"]) -> Float[Array, " ..."]:
        """Norms of forces."""
        return jnp.sqrt(jnp.sum(force**2, axis=-1))

    def collected(self, force: Forces, x: Motion, spread: Forces | None = None) -> Step:
        """Components of forces along the free freedoms."""
        components = force if self.freedoms.axes is None else along(self.freedoms.axes, force)
        flat, numbering = components.reshape(-1), self.freedoms.numbering
        chosen = flat[self.freedoms.free] if numbering is None else numbering(flat)
        return self.freedoms.released(chosen)

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
            n_end = (blocks.shape[1] - len(inner)) // width
            blocks = by_numbers(blocks, slopes[links[:, :n_end]], len(inner))
        return blocks, number


def _after(x, step):
    """A motion with a fine part after a step of all rows, [n_row, 6]."""
    high, lost = exact.two_sum(x[:, :3], step)
    high, low = exact.two_sum(high, x[:, 3:] + lax.stop_gradient(lost))
    return jnp.concatenate([high, lax.stop_gradient(low)], axis=1)
