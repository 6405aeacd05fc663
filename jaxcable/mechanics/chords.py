"""Axial forces of elements with two ends, or a chain of them, along the chords between these.

They follow from end forces and tangents, so that they exist for bars, cables and elements of users
without a formula of their own. A chain of straight segments (`Element.is_chain`) has one for each
segment: its force is the sum of the forces at all later ends.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import jax.numpy as jnp
import numpy as np

from ..common.tree import copy_with, pytree
from ..common.types import Array, Bool, Float
from ..elements.element import Element
from ..spaces.space import Forces, Motion, Step
from .assembly import EndForces, System


@pytree
class Chords:
    """Chords (lines from end to end) of elements at one point of the iteration.

    They are those of all elements for which `has_chord` is true, of chains one for each segment.

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
    def at_motion(cls, system: System, x: Motion, end_forces: EndForces) -> Chords:
        """Compute the chords of a system at motion `x` from its end forces, per group."""
        vector = second_minus_first_end(system, system.nodes + x[:, :3])
        length = jnp.sqrt(jnp.sum(vector**2, axis=1))
        if any(group.is_chain for group in system.groups):  # whose fillers have no length
            length = jnp.where(length > 0, length, jnp.inf)
        along = vector / length[:, None]
        pairs = zip(system.groups, end_forces, strict=True)
        pulls = [_pulls_of_segments(forces[..., :3]) for group, forces in pairs if has_chord(group)]
        pull = jnp.concatenate(pulls)
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

    def forces_after_step(
        self,
        system: System,
        tangents: Sequence[Float[Array, "n_elem d d"]],
        row_step: Forces,
        longer: Float[Array, " n"],
    ) -> tuple[Float[Array, " n"], Float[Array, " n"]]:
        """Return the axial forces after a step of all nodes (rows), linearized, and their slopes.

        Args:
            system: the system of the chords.
            tangents: element tangents, per group [n_elem, d, d], N/m.
            row_step: the step.
            longer: `linearized_elongation` by it, [n], m.

        Returns:
            Forces, [n], N; their derivatives by the lengths, [n], N/m, zero in chains.
        """
        pairs = [pair for pair in zip(system.groups, tangents, strict=True) if has_chord(pair[0])]
        blocks = [
            jnp.zeros((n_chord(group), 3, 3), longer.dtype) if group.is_chain else matrix[:, 3:, 3:]
            for group, matrix in pairs
        ]
        slopes = jnp.einsum("ni,nij,nj->n", self.along, jnp.concatenate(blocks), self.along)
        force, start = self.force + slopes * longer, 0
        for group, matrix in pairs:
            own = slice(start, start := start + n_chord(group))
            if group.is_chain:  # where every force depends on all lengths
                step = row_step[group.links][..., :3]
                change = jnp.einsum("eij,ej->ei", matrix, step.reshape(len(step), -1))
                pulls = _pulls_of_segments(change.reshape(step.shape))
                force = force.at[own].add(jnp.sum(self.along[own] * pulls, axis=1))
        return force, slopes

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
        return self._add_to_tangents(system, tangents, density)

    def with_springs(
        self,
        system: System,
        x: Motion,
        tangents: Sequence[Float[Array, "n_elem d d"]],
        force: Float[Array, " n"],
        slope: Float[Array, " n"],
    ) -> tuple[Chords, list[Float[Array, "n_elem d d"]], Step]:
        """Return chords and tangents with a spring along every chord, and the springs' residual.

        Args:
            system: the system of the chords.
            x: motion of the chords.
            tangents: element tangents, per group [n_elem, d, d], N/m; the result has their shapes.
            force: axial forces of the springs, [n], N.
            slope: derivatives of these forces by the lengths, [n], N/m.

        Returns:
            Chords; tangents; internal force of the springs alone at every unknown, [n_free], N.
        """
        pull = force[:, None] * self.along
        ends = jnp.zeros_like(system.nodes).at[_chord_links(system)]
        at_rows = system.space.pad_moments(ends.add(jnp.stack([-pull, pull], axis=1)))
        new = self._add_to_tangents(system, tangents, force / self.length, slope)
        return copy_with(self, force=self.force + force), new, system.space.restrict(at_rows, x)

    def _add_to_tangents(self, system, tangents, density, slope=None):
        """Return element tangents with those of springs of a force density and a slope, N/m."""
        square = self.along[:, :, None] * self.along[:, None, :]
        block = density[:, None, None] * (jnp.eye(3, dtype=density.dtype)[None] - square)
        if slope is not None:
            block = block + slope[:, None, None] * square
        row = jnp.concatenate([block, -block], axis=2)
        of_ends = jnp.concatenate([row, -row], axis=1)
        found, start = [], 0
        for group, matrix in zip(system.groups, tangents, strict=True):
            if has_chord(group):
                own = slice(start, start := start + n_chord(group))
                matrix = matrix + (
                    _matrices_of_chains(block[own].reshape(len(matrix), -1, 3, 3))
                    if group.is_chain
                    else of_ends[own]
                )
            found.append(matrix)
        return found


def _pulls_of_segments(forces):
    """Return the forces of segments on their second ends from those at all ends, joined, [n, 3], N.

    `forces` at the ends of elements are [n_elem, n_end, 3].
    """
    later = forces[:, 1:]
    if later.shape[1] > 1:
        later = jnp.flip(jnp.cumsum(jnp.flip(later, axis=1), axis=1), axis=1)
    return later.reshape(-1, 3)


def _matrices_of_chains(blocks):
    """Return matrices of elements, [n_elem, d, d], from those of segments, [n_elem, n, 3, 3].

    A block is that between the second end of a segment and itself; others differ in sign.
    """
    n = blocks.shape[1]
    ends = np.eye(n, n + 1, 1) - np.eye(n, n + 1)  # of each segment
    matrix = jnp.einsum("pa,epij,pb->eaibj", ends, blocks, ends.astype(blocks.dtype))
    return matrix.reshape(len(blocks), 3 * (n + 1), 3 * (n + 1))


def has_chord(group: Element) -> bool:
    """Return whether the elements of a group have two ends, or are chains, without rotations.

    The iteration predicts the axial forces of such elements only: with predicted forces of beams,
    columns beyond their buckling loads converge less often.
    """
    return (group.links.shape[1] == 2 or group.is_chain) and not group.rotates


def any_chords(groups: Sequence[Element]) -> bool:
    """Return whether any group has elements with chords."""
    return any(map(has_chord, groups))


def tension_only_chords(groups: Sequence[Element]) -> Bool[np.ndarray, " n"]:
    """Return which chords are those of tension-only elements, [n] bool, NumPy."""
    return np.concatenate(
        [np.full(n_chord(group), group.tension_only) for group in groups if has_chord(group)]
    )


def compression_only_chords(groups: Sequence[Element]) -> Bool[np.ndarray, " n"]:
    """Return which chords are those of elements that press only, [n] bool, NumPy."""
    return np.concatenate(
        [np.full(n_chord(group), group.compression_only) for group in groups if has_chord(group)]
    )


def without_friction(system: System) -> System:
    """Return a copy of a system in which the cables that are chains slide without friction."""
    given: Any = zip(system.groups, system.states, strict=True)
    pairs = [g.without_friction(s) if g.is_chain else (g, s) for g, s in given]
    groups, states = map(list, zip(*pairs, strict=True))
    return copy_with(system, groups=groups, states=states)


def n_chord(group: Element) -> int:
    """Return the number of chords of a group that has them."""
    return len(group.links) * (group.links.shape[1] - 1)


def second_minus_first_end(system: System, values: Float[Array, "n_row n"]) -> Float[Array, "n 3"]:
    """Return `values` [n_row, 3] of the second ends of chords less those of first ends, [n, 3]."""
    ends = values[:, :3][_chord_links(system)]
    return ends[:, 1] - ends[:, 0]


def _chord_links(system):
    """Return the rows of both ends of all chords, [n, 2]."""
    links = [
        jnp.stack([group.links[:, :-1], group.links[:, 1:]], axis=-1).reshape(-1, 2)
        if group.is_chain
        else group.links[:, :2]
        for group in system.groups
        if has_chord(group)
    ]
    return jnp.concatenate(links)
