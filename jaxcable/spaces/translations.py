"""Nodes with three degrees of freedom, displacements only: cable nets, trusses.

A motion [n_row, 3] has as many digits as a float. Nets are iterated with a *low-order part*
beside it, in three more columns: the displacement is the sum of both, to nearly twice as many
digits (double-double, see `numerics.exact`).
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
from .freedoms import Freedoms, along, combined, element_unknowns
from .space import (
    ElementGroup,
    Forces,
    Motion,
    Part,
    Space,
    Step,
    as_square_matrices,
    transform_by_jacobian,
)

# columns of a motion with a low-order part; motions of other spaces have seven
_COLUMNS_WITH_LOW_PART = 6


def is_fine(x: Float[Array, "... n_motion"]) -> bool:
    """Return whether motions have a low-order part, see the module."""
    return x.shape[-1] == _COLUMNS_WITH_LOW_PART


def coarse(motion: Float[Array, "... n_motion"]) -> Float[Array, "... n_motion"]:
    """Return motions without their low-order part, if they have one."""
    return motion[..., :3] if is_fine(motion) else motion


def refined(motion: Float[Array, "n_row 3"]) -> Float[Array, "n_row 6"]:
    """Append a low-order part of zero to displacements, m."""
    return jnp.concatenate([motion, jnp.zeros_like(motion)], axis=1)


@pytree
class Translations(Space):
    """Space of nodes without rotations: the motion of a row is its displacement, m; see `Space`."""

    @classmethod
    def of(
        cls,
        nodes: Float[Array, "n_row 3"],
        groups: Sequence[ElementGroup],
        freedoms: Freedoms,
        prescribed: Motion | None,
        bearing: Float[Array, "n_row 4"] | None,
    ) -> Self:
        """Make the space of a system, see `Space.of`."""
        return cls(freedoms, prescribed)

    @classmethod
    def still(cls, nodes: Float[Array, "n_row 3"]) -> Motion:
        """Return zero displacements."""
        return jnp.zeros_like(nodes)

    @classmethod
    def advanced(cls, motion: Motion, step: Forces) -> Motion:
        """Return the motion after a step of all rows: their sum."""
        return _add_compensated(motion, step) if is_fine(motion) else motion + step

    @classmethod
    def between(cls, before: Motion, after: Motion) -> Forces:
        """Return the displacement from one motion, without a low-order part, to another."""
        shift = coarse(after) - before
        return shift + after[:, 3:] if is_fine(after) else shift

    @classmethod
    def borne(cls, motion: Motion, arm: Float[Array, "n_row 3"]) -> Motion:
        """Return the same displacements, because nothing rotates; see `Space.borne`."""
        return motion

    def place(self, x: Motion) -> Motion:
        """Return `x` with the displacements that supports fix at their prescribed values."""
        if not is_fine(x):
            return super().place(x)
        fixed, axes, prescribed = self.freedoms.fixed, self.freedoms.axes, self._known_prescribed
        high, low = x[:, :3], x[:, 3:]
        if axes is None:
            placed = [jnp.where(fixed, prescribed, high), jnp.where(fixed, 0.0, low)]
            return jnp.concatenate(placed, axis=1)
        # the difference, because components of the displacement itself would be rounded
        away = along(axes, (prescribed - high) - low)
        return _add_compensated(x, combined(axes, jnp.where(fixed, away, 0.0)))

    def spread(self, x: Motion, step: Step) -> Forces:
        """Return the displacement of every row that belongs to a step of the unknowns."""
        numbering = self.freedoms.numbering
        if numbering is None:
            components = with_zero(step)[self.freedoms.number]
        else:
            components = numbering.spread(step).reshape(self.freedoms.number.shape)
        return (
            components if self.freedoms.axes is None else combined(self.freedoms.axes, components)
        )

    def move(self, x: Motion, step: Step) -> Motion:
        """Return the motion after a step of the unknowns from `x`."""
        return self.advanced(x, self.spread(x, step))

    def size(self, force: Float[Array, "... n_freedom"]) -> Float[Array, " ..."]:
        """Return the norms of forces, N."""
        return jnp.sqrt(jnp.sum(force**2, axis=-1))

    def collected(self, force: Forces, x: Motion, row_step: Forces | None = None) -> Step:
        """Return the components of forces along the free degrees of freedom, [n_free], N."""
        components = force if self.freedoms.axes is None else along(self.freedoms.axes, force)
        flat, numbering = components.reshape(-1), self.freedoms.numbering
        chosen = flat[self.freedoms.free] if numbering is None else numbering(flat)
        return self.freedoms.released(chosen)

    def reactions(self, unbalanced: Forces, motion: Motion) -> Forces:
        """Return the support reactions: unbalanced forces along fixed degrees of freedom."""
        fixed, axes = self.freedoms.fixed, self.freedoms.axes
        if axes is None:
            return jnp.where(fixed, unbalanced, 0.0)
        return combined(axes, jnp.where(fixed, along(axes, unbalanced), 0.0))

    def slopes(self, x: Motion) -> Float[Array, "n_row 3 3"] | None:
        """Return the directions of the unknowns, one in each column; None if they are x, y, z."""
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
        """Transform element matrices to unknowns, see `Space.part`."""
        number = element_unknowns(self.freedoms.number, links, width, inner)
        blocks, slopes = as_square_matrices(blocks), self.slopes(x)
        if slopes is not None:
            n_end = (blocks.shape[1] - len(inner)) // width
            blocks = transform_by_jacobian(blocks, slopes[links[:, :n_end]], len(inner))
        return blocks, number


def _add_compensated(x, step):
    """Add a step of all rows to a motion with a low-order part, without rounding errors."""
    high, lost = exact.two_sum(x[:, :3], step)
    high, low = exact.two_sum(high, x[:, 3:] + lax.stop_gradient(lost))
    return jnp.concatenate([high, lax.stop_gradient(low)], axis=1)
