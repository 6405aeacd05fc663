"""Nodes with three degrees of freedom, displacements only: cable nets, trusses.

A motion [n_row, 3] has as many digits as a float. Nets are iterated with a *low-order part*
beside it, in three more columns: the displacement is the sum of both, to nearly twice as many
digits (double-double, see `numerics.compensated`).
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Self

import jax.numpy as jnp
from jax import lax

from ..common.tree import pytree
from ..common.types import Array, ArrayLike, Float, Int
from ..linear import append_zero
from ..numerics import compensated
from .dof_map import DofMap, element_unknowns, to_global, to_local
from .space import (
    ElementGroup,
    Forces,
    MatrixPart,
    Motion,
    Space,
    Step,
    as_square_matrices,
    transform_by_jacobian,
)

# columns of a motion with a low-order part; motions of other spaces have seven
_COLUMNS_WITH_LOW_PART = 6


def has_low_part(x: Float[Array, "... n_motion"]) -> bool:
    """Tell whether motions have three more columns for the low-order part of displacements.

    The displacement is the sum of both parts, to twice the digits of a float.
    """
    return x.shape[-1] == _COLUMNS_WITH_LOW_PART


def drop_low_part(motion: Float[Array, "... n_motion"]) -> Float[Array, "... n_motion"]:
    """Return motions without the columns of their low-order part, if they have them."""
    return motion[..., :3] if has_low_part(motion) else motion


def append_low_part(motion: Float[Array, "n_row 3"]) -> Float[Array, "n_row 6"]:
    """Append three columns of zeros, a low-order part, to displacements, m."""
    return jnp.concatenate([motion, jnp.zeros_like(motion)], axis=1)


@pytree
class Translations(Space):
    """Space of nodes without rotations: the motion of a node is its displacement, m."""

    @classmethod
    def build(
        cls,
        nodes: Float[Array, "n_row 3"],
        groups: Sequence[ElementGroup],
        dof_map: DofMap,
        prescribed: Motion | None,
        support_rotation: Float[Array, "n_row 4"] | None,
    ) -> Self:
        """Make the space of a system from its degree-of-freedom map and prescribed motion."""
        return cls(dof_map, prescribed)

    @classmethod
    def at_rest(cls, nodes: Float[Array, "n_row 3"]) -> Motion:
        """Return zero displacements, [n_row, 3]."""
        return jnp.zeros_like(nodes)

    @classmethod
    def motion_after_row_step(cls, motion: Motion, step: Forces) -> Motion:
        """Return the motion after a step of all rows: their sum.

        If the motion has a low-order part, that takes up the rounding error of the sum.
        """
        return _add_compensated(motion, step) if has_low_part(motion) else motion + step

    @classmethod
    def displacement_between(cls, before: Motion, after: Motion) -> Forces:
        """Return the displacement, m, from motion `before`, without low-order part, to `after`."""
        shift = drop_low_part(after) - before
        return shift + after[:, 3:] if has_low_part(after) else shift

    @classmethod
    def rigid_link_motion(cls, motion: Motion, arm: Float[Array, "n_row 3"]) -> Motion:
        """Return the motion of the carriers, which rows on rigid links share: nothing rotates."""
        return motion

    def impose_supports(self, x: Motion) -> Motion:
        """Return the motion `x` with prescribed displacements along directions that are fixed."""
        if not has_low_part(x):
            return super().impose_supports(x)
        fixed, axes, prescribed = self.dof_map.fixed, self.dof_map.axes, self._prescribed_motion
        high, low = x[:, :3], x[:, 3:]
        if axes is None:
            placed = [jnp.where(fixed, prescribed, high), jnp.where(fixed, 0.0, low)]
            return jnp.concatenate(placed, axis=1)
        # the difference, because components of the displacement itself would be rounded
        away = to_local(axes, (prescribed - high) - low)
        return _add_compensated(x, to_global(axes, jnp.where(fixed, away, 0.0)))

    def prolong(self, x: Motion, step: Step) -> Forces:
        """Return the displacement of every node, m, that follows from a step of the unknowns."""
        numbering = self.dof_map.unknown_assembly
        if numbering is None:
            components = append_zero(step)[self.dof_map.unknown_of_dof]
        else:
            components = numbering.apply_transpose(step).reshape(self.dof_map.unknown_of_dof.shape)
        return components if self.dof_map.axes is None else to_global(self.dof_map.axes, components)

    def move(self, x: Motion, step: Step) -> Motion:
        """Return the motion after a step of the unknowns, [n_free], from the motion `x`."""
        return self.motion_after_row_step(x, self.prolong(x, step))

    def force_norm(self, force: Float[Array, "... n_freedom"]) -> Float[Array, " ..."]:
        """Return the Euclidean norms of forces, N."""
        return jnp.sqrt(jnp.sum(force**2, axis=-1))

    def restrict(self, force: Forces, x: Motion, row_step: Forces | None = None) -> Step:
        """Return the components of forces along the free degrees of freedom, [n_free], N."""
        components = force if self.dof_map.axes is None else to_local(self.dof_map.axes, force)
        flat, numbering = components.reshape(-1), self.dof_map.unknown_assembly
        chosen = flat[self.dof_map.free] if numbering is None else numbering(flat)
        return self.dof_map.zero_temporarily_fixed(chosen)

    def reactions(self, unbalanced: Forces, motion: Motion) -> Forces:
        """Return the support reactions, N: unbalanced forces along fixed directions, else zero."""
        fixed, axes = self.dof_map.fixed, self.dof_map.axes
        if axes is None:
            return jnp.where(fixed, unbalanced, 0.0)
        return to_global(axes, jnp.where(fixed, to_local(axes, unbalanced), 0.0))

    def motion_jacobian(self, x: Motion) -> Float[Array, "n_row 3 3"] | None:
        """Return the directions of every node's unknowns, in columns; None if they are x, y, z."""
        axes = self.dof_map.axes
        return None if axes is None else jnp.swapaxes(jnp.asarray(axes), 1, 2)

    def transform_to_unknowns(
        self,
        blocks: Float[Array, "n_elem ..."],
        links: Int[ArrayLike, "n_elem n_end"],
        width: int,
        inner: Sequence[tuple[int, int]],
        x: Motion,
    ) -> MatrixPart:
        """Transform element matrices to unknowns: return [n_elem, d, d], and unknowns' indices."""
        number = element_unknowns(self.dof_map.unknown_of_dof, links, width, inner)
        blocks, slopes = as_square_matrices(blocks), self.motion_jacobian(x)
        if slopes is not None:
            n_end = (blocks.shape[1] - len(inner)) // width
            blocks = transform_by_jacobian(blocks, slopes[links[:, :n_end]], len(inner))
        return blocks, number


def _add_compensated(x, step):
    """Return a motion after a step of all rows, [n_row, 3], m: a sum to twice the precision.

    `x` is the motion with its low-order part, [n_row, 6], which takes up the rounding error.
    """
    high, lost = compensated.two_sum(x[:, :3], step)
    high, low = compensated.two_sum(high, x[:, 3:] + lax.stop_gradient(lost))
    return jnp.concatenate([high, lax.stop_gradient(low)], axis=1)
