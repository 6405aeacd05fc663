"""Axial forces of elements with two ends, along the chords between these.

They follow from end forces and tangents, so that they exist for bars, cables and elements of users
without a formula of their own.
"""

from __future__ import annotations

from collections.abc import Sequence

import jax.numpy as jnp
import numpy as np

from ..common.tree import pytree
from ..common.types import Array, Bool, Float
from ..elements.element import Element
from ..spaces.space import Motion
from .assembly import EndForces, System


@pytree
class Chords:
    """Chords (lines from end to end) of all elements with two ends, at one point of the iteration.

    Arrays of all groups are joined, [n].

    Attributes:
        force: axial force, the part of the force on the second end along the chord, [n], N;
            tension positive.
        along: unit vectors from the first end to the second, [n, 3].
        length: distance of the ends, [n], m.
    """

    force: Float[Array, " n"]
    along: Float[Array, "n 3"]
    length: Float[Array, " n"]

    @classmethod
    def of(cls, system: System, x: Motion, end_forces: EndForces) -> Chords:
        """Compute the chords of a system at motion `x` from its end forces, per group."""
        vector = second_minus_first_end(system, system.nodes + x[:, :3])
        length = jnp.sqrt(jnp.sum(vector**2, axis=1))
        along = vector / length[:, None]
        pairs = zip(system.groups, end_forces, strict=True)
        pull = jnp.concatenate([forces[:, 1, :3] for group, forces in pairs if has_chord(group)])
        return cls(jnp.sum(pull * along, axis=1), along, length)

    def linearized_elongation(self, relative_motion: Float[Array, "n 3"]) -> Float[Array, " n"]:
        """Return the linearized elongations, [n], m.

        `relative_motion` [n, 3], m, is the displacement of second ends less that of first ends.
        """
        return jnp.sum(self.along * relative_motion, axis=1)

    def max_relative_motion_squared(self, relative_motion: Float[Array, "n 3"]) -> Float[Array, ""]:
        """Return the largest square of relative motion over length, scalar.

        `relative_motion` [n, 3], m, is the displacement of second ends less that of first ends.
        """
        return jnp.max(jnp.sum(relative_motion**2, axis=1) / self.length**2)

    def axial_stiffness(
        self, system: System, tangents: Sequence[Float[Array, "n_elem d d"]]
    ) -> Float[Array, " n"]:
        """Return derivatives of axial forces by lengths from element tangents, [n], N/m."""
        blocks = []
        for group, matrix in zip(system.groups, tangents, strict=True):
            if has_chord(group):
                blocks.append(matrix[:, 3:, 3:])
        return jnp.einsum("ni,nij,nj->n", self.along, jnp.concatenate(blocks), self.along)

    def tangents_with_geometric_stiffness(
        self,
        system: System,
        tangents: Sequence[Float[Array, "n_elem d d"]],
        force: Float[Array, " n"],
    ) -> list[Float[Array, "n_elem d d"]]:
        """Return element tangents with the geometric stiffness of other axial forces.

        Args:
            system: the system of the chords.
            tangents: element tangents under the axial forces ``self.force``, per group
                [n_elem, d, d], N/m; the result has the same shapes.
            force: axial forces that replace them in the geometric stiffness, [n], N.
        """
        density = (force - self.force) / self.length
        square = self.along[:, :, None] * self.along[:, None, :]
        block = density[:, None, None] * (jnp.eye(3, dtype=density.dtype)[None] - square)
        row = jnp.concatenate([block, -block], axis=2)
        of_ends = jnp.concatenate([row, -row], axis=1)
        found, start = [], 0
        for group, matrix in zip(system.groups, tangents, strict=True):
            if has_chord(group):
                own = of_ends[start : start + len(matrix)]
                start += len(matrix)
                matrix = matrix + own
            found.append(matrix)
        return found


def has_chord(group: Element) -> bool:
    """Return whether the elements of a group have two ends and no rotations.

    The iteration predicts the axial forces of such elements only: with predicted forces of beams,
    columns beyond their buckling loads converge less often.
    """
    return group.links.shape[1] == 2 and not group.rotates


def any_chords(groups: Sequence[Element]) -> bool:
    """Return whether any group has elements with two ends and no rotations."""
    return any(map(has_chord, groups))


def tension_only_chords(groups: Sequence[Element]) -> Bool[np.ndarray, " n"]:
    """Return which elements with two ends and no rotations are tension-only, [n] bool, NumPy."""
    return np.concatenate(
        [np.full(len(group.links), group.tension_only) for group in groups if has_chord(group)]
    )


def compression_only_chords(groups: Sequence[Element]) -> Bool[np.ndarray, " n"]:
    """Return which elements with two ends and no rotations are compression-only, [n], NumPy."""
    return np.concatenate(
        [np.full(len(group.links), group.compression_only) for group in groups if has_chord(group)]
    )


def second_minus_first_end(system: System, values: Float[Array, "n_row n"]) -> Float[Array, "n 3"]:
    """Return `values` [n_row, 3] of second ends less those of first ends, [n, 3], m."""
    links = jnp.concatenate([group.links[:, :2] for group in system.groups if has_chord(group)])
    ends = values[:, :3][links]
    return ends[:, 1] - ends[:, 0]
