"""Nets in which every element is a string: one tension, along one length.

The forces of a string at its nodes are its tension times the derivative of its length. Hence one
evaluation of lengths serves for forces, for forces under other tensions, and for the stiffness.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import TypeAlias

import jax.numpy as jnp

from ..common.tree import copy, pytree
from ..common.types import Array, Float
from ..spaces.space import Motion, Step
from .assembly import System
from .elementwise import each

PerGroup: TypeAlias = 'list[Float[Array, " n_elem"]]'
"""A number for every element, an array per group."""

_ROUNDINGS = 8  # of a displacement, in a length: of chord, products, sum, root, quotient


@pytree
class Strings:
    """The strings of a net at a point, an array per group.

    Attributes:
        force, slope: tension, and its derivative by the length, [n_elem], N and N/m.
        strain: on the unstressed length, [n_elem].
        along: derivative of the length by the displacements of the ends, [n_elem, n_end, 3].
    """

    force: PerGroup
    slope: PerGroup
    strain: PerGroup
    along: list[Float[Array, "n_elem n_end 3"]]

    @classmethod
    def of(cls, system: System, x: Motion) -> Strings:
        """The strings of a system at `x`."""
        found = [
            each("string", group, state, system.nodes, x)
            for group, state in zip(system.groups, system.states, strict=True)
        ]
        return cls(*(list(values) for values in zip(*found, strict=True)))

    def residual(self, system: System, x: Motion, tensions: PerGroup) -> Step:
        """Unbalanced force [n_free] at `x` under stated tensions, N."""
        forces = [n[:, None, None] * g for n, g in zip(tensions, self.along, strict=True)]
        return system.space.collected(_at_rows(system, forces) - system.load, x)

    def judged(self, system: System, x: Motion) -> tuple[Step, Float[Array, ""], Step]:
        """Unbalanced force, the force it is judged by, and the part of it that is rounding.

        Returns:
            Residual [n_free]; largest sum of absolute end forces and load at a row; error that the
            rounding of displacements leaves in the residual, [n_free]; N.
        """
        eps, columns = jnp.finfo(x.dtype).eps, []
        for group, state, n, k, g in zip(
            *(system.groups, system.states, self.force, self.slope, self.along), strict=True
        ):
            sizes = n[:, None] * system.space.size(g)
            if group.remembers:
                sizes = sizes + system.part_sizes(group, state, x)
            moved = jnp.max(jnp.abs(x[group.links]), axis=(1, 2))
            left = (_ROUNDINGS * eps * moved * k)[:, None, None] * jnp.abs(g)
            columns.append(jnp.concatenate([n[:, None, None] * g, left, sizes[..., None]], axis=-1))
        rows = _at_rows(system, columns)
        scale = jnp.max(rows[:, 6] + system.space.size(system.load))
        collected = system.space.collected
        residual = collected(rows[:, :3] - system.load, x)
        return residual, scale, jnp.abs(collected(rows[:, 3:6], x))

    def stiffness(
        self, system: System, x: Motion, slopes: PerGroup, tensions: PerGroup
    ) -> list[Float[Array, "n_elem d d"]]:
        """Matrices of the elements: slope times g g^T plus tension times the Hessian of length."""
        found = []
        for group, state, g, k, n in zip(
            *(system.groups, system.states, self.along, slopes, tensions), strict=True
        ):
            unit = copy(state, jack_force=jnp.ones_like(n), jacked=None)
            bend = each("tangent", group, unit, system.nodes, x)
            flat = g.reshape(len(g), -1)
            bend = bend.reshape(len(g), flat.shape[1], flat.shape[1])
            k, n = k[:, None, None], n[:, None, None]
            found.append(k * flat[:, :, None] * flat[:, None, :] + n * bend)
        return found


def _at_rows(system: System, values: Sequence[Float[Array, "n_elem n_end d"]]):
    """Sums at every row of `values` at the ends of all elements, [n_row, d]."""
    rows = jnp.concatenate([group.links.reshape(-1) for group in system.groups])
    flat = jnp.concatenate([value.reshape(-1, value.shape[-1]) for value in values])
    return jnp.zeros((len(system.nodes), flat.shape[1]), flat.dtype).at[rows].add(flat)
