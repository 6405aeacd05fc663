"""Nets in which every element pulls with one tension along one length.

The forces of a cable at its nodes are its tension times the derivative of its length. Hence one
evaluation of lengths serves for forces, for forces under other tensions, and for the stiffness.
"""

from __future__ import annotations

from collections.abc import Sequence
from itertools import pairwise

import jax.numpy as jnp

from ..common.tree import copy, pytree
from ..common.types import Array, Bool, Float
from ..elements.prestress import of_each
from ..spaces.space import Forces, Motion, Step
from ..spaces.translations import coarse
from .assembly import System
from .elementwise import each

_ROUNDINGS = 8  # eps^2 of a displacement, in an elongation (`elements.fine`)


@pytree
class Pulls:
    """What the cables of a net do at a point, those of all groups in one array, [n].

    Attributes:
        force, slope: tension, and its derivative by the length, N and N/m.
        strain: on the unstressed length.
        along: derivative of the length by the displacements of the ends, per group
            [n_elem, n_end, 3].
    """

    force: Float[Array, " n"]
    slope: Float[Array, " n"]
    strain: Float[Array, " n"]
    along: list[Float[Array, "n_elem n_end 3"]]

    @classmethod
    def of(cls, system: System, x: Motion) -> Pulls:
        """The pulls of a system at `x`."""
        found = [
            each("pulled", group, state, system.nodes, x)
            for group, state in zip(system.groups, system.states, strict=True)
        ]
        force, slope, strain, along = zip(*found, strict=True)
        join = jnp.concatenate
        return cls(join(force), join(slope), join(strain), list(along))

    def residual(self, system: System, x: Motion, tensions: Float[Array, " n"]) -> Step:
        """Unbalanced force [n_free] at `x` under stated tensions, N."""
        pulls = zip(_split(system, tensions), self.along, strict=True)
        rows = _at_rows(system, [n[:, None, None] * g for n, g in pulls])
        return system.space.collected(rows - system.load, x)

    def judged(self, system: System, x: Motion) -> tuple[Step, Float[Array, ""], Step]:
        """Unbalanced force, the force it is judged by, and the part of it that is rounding.

        Returns:
            Residual [n_free]; largest sum of absolute end forces and load at a row; error that the
            rounding of displacements leaves in the residual, [n_free]; N.
        """
        forces, slopes = _split(system, self.force), _split(system, self.slope)
        fine, pulls, unsure = _ROUNDINGS * jnp.finfo(x.dtype).eps ** 2, [], []
        for k, (group, state) in enumerate(zip(system.groups, system.states, strict=True)):
            n, g = forces[k][:, None], self.along[k]
            sizes = n * system.space.size(g)
            if group.remembers:
                sizes = sizes + system.part_sizes(group, state, x)
            moved = jnp.max(jnp.abs(x[group.links]), axis=(1, 2))
            unsure.append((fine * moved * slopes[k])[:, None, None] * jnp.abs(g))
            pulls.append(jnp.concatenate([n[..., None] * g, sizes[..., None]], axis=-1))
        rows, collected = _at_rows(system, pulls), system.space.collected
        scale = jnp.max(rows[:, 3] + system.space.size(system.load))
        residual = collected(rows[:, :3] - system.load, x)
        return residual, scale, jnp.abs(collected(_at_rows(system, unsure), x))

    def stiffness(
        self, system: System, x: Motion, slopes: Float[Array, " n"], tensions: Float[Array, " n"]
    ) -> list[Float[Array, "n_elem d d"]]:
        """Matrices of the elements: slope times g g^T plus tension times the Hessian of length."""
        found = []
        slopes, tensions = _split(system, slopes), _split(system, tensions)
        for k, (group, state) in enumerate(zip(system.groups, system.states, strict=True)):
            unit = copy(state, jack_force=jnp.ones_like(tensions[k]), jacked=None)
            bend = each("tangent", group, unit, system.nodes, coarse(x))
            g = self.along[k].reshape(len(bend), -1)
            bend = bend.reshape(*g.shape, g.shape[1])
            along = slopes[k][:, None, None] * g[:, :, None] * g[:, None, :]
            found.append(along + tensions[k][:, None, None] * bend)
        return found

    def room(
        self, system: System, tensions: Float[Array, " n"]
    ) -> tuple[Float[Array, " n"], Float[Array, " n"]]:
        """Lengths under `tensions` less present lengths, m, and their derivative, m/N."""
        pairs = [
            of_each("room", group, state, tension, strain)
            for group, state, tension, strain in zip(
                system.groups,
                system.states,
                _split(system, tensions),
                _split(system, self.strain),
                strict=True,
            )
        ]
        rooms, compliances = zip(*pairs, strict=True)
        return jnp.concatenate(rooms), jnp.concatenate(compliances)

    def moved(
        self, system: System, spread: Forces
    ) -> tuple[Float[Array, " n"], Float[Array, " n"]]:
        """How a step of all rows changes the lengths, to first order, m, and how far it leads.

        The second result is the largest relative motion of two nodes in succession, over the
        unstressed length between them.
        """
        longer, turned = [], []
        for group, g in zip(system.groups, self.along, strict=True):
            ends = spread[group.links][..., :3]
            longer.append(jnp.sum(g * ends, axis=(1, 2)))
            apart = jnp.max(jnp.sum(jnp.diff(ends, axis=1) ** 2, axis=-1), axis=1)
            turned.append(jnp.sqrt(apart) * (g.shape[1] - 1))
        return jnp.concatenate(longer), jnp.concatenate(turned) / rest_lengths(system)


def rest_lengths(system: System) -> Float[Array, " n"]:
    """Unstressed lengths of all cables, m."""
    lengths: list[Array] = [state.rest_length for state in system.states]  # type: ignore[misc]  # all have one
    return jnp.concatenate(lengths)


def held(system: System) -> Bool[Array, " n"]:
    """Which cables a jack holds."""
    found = []
    for group, state in zip(system.groups, system.states, strict=True):
        jacked = state.jack_force is not None
        if jacked and state.jacked is not None:
            found.append(state.jacked)
        else:
            found.append(jnp.full(len(group.links), jacked))
    return jnp.concatenate(found)


def loaded(system: System) -> Bool[Array, ""]:
    """Whether any load or jack acts."""
    jacks = [
        jnp.any(state.jack_force != 0) for state in system.states if state.jack_force is not None
    ]
    return jnp.any(jnp.stack([jnp.any(system.load != 0), *jacks]))


def _split(system, values):
    """An array for all cables [n] as a list with an array per group."""
    ends = [0]
    for group in system.groups:
        ends.append(ends[-1] + len(group.links))
    return [values[i:j] for i, j in pairwise(ends)]


def _at_rows(system: System, values: Sequence[Float[Array, "n_elem n_end d"]]) -> Array:
    """Sums at every row of `values` at the ends of all elements, [n_row, d]."""
    rows = jnp.concatenate([group.links.reshape(-1) for group in system.groups])
    flat = jnp.concatenate([value.reshape(-1, value.shape[-1]) for value in values])
    return jnp.zeros((len(system.nodes), flat.shape[1]), flat.dtype).at[rows].add(flat)
