"""Tensions and end forces of all cables of a net, whose tensions are unknowns.

The end forces of a cable are its tension times the derivative of its length. Hence one evaluation
of lengths gives forces, forces under other tensions, and stiffness.
"""

from __future__ import annotations

from collections.abc import Sequence
from itertools import pairwise

import jax.numpy as jnp

from ..common.tree import copy_with, pytree
from ..common.types import Array, ArrayLike, Bool, Float, PyTree
from ..elements.abilities import Room
from ..elements.prestress import of_each
from ..spaces.space import Forces, Motion, Step
from ..spaces.translations import drop_low_part
from .assembly import System
from .elementwise import each, motion_of

_ROUNDINGS = 8  # bound on the errors of eps^2 displacement in an elongation (`elements.fine`)


@pytree
class Pulls:
    """Tensions and end forces of all cables at a point, see `abilities.Pull`; [n] over all groups.

    Attributes:
        tension, slope: tension, and its derivative by the length, [n], N and N/m.
        along: derivative of the length by the displacements of the ends, per group
            [n_elem, n_end, 3].
        forces: end forces, per group, likewise, N.
        shapes: `shape` of every group.
    """

    tension: Float[Array, " n"]
    slope: Float[Array, " n"]
    along: list[Float[Array, "n_elem n_end 3"]]
    forces: list[Float[Array, "n_elem n_end 3"]]
    shapes: list[PyTree[Array]]

    @classmethod
    def of(cls, system: System, x: Motion, exact: Bool[ArrayLike, ""]) -> Pulls:
        """Evaluate the cables of a system at `x`; `exact` as of `elementwise.over_ends`."""
        found = []
        for group, state in zip(system.groups, system.states, strict=True):
            pull = each("pulled", group, state, system.nodes, x, exact=exact, absent=True)
            found.append(copy_with(state.only_present(pull), shape=pull.shape))
        return cls(
            jnp.concatenate([pull.tension for pull in found]),
            jnp.concatenate([pull.slope for pull in found]),
            [pull.along for pull in found],
            [pull.forces for pull in found],
            [pull.shape for pull in found],
        )

    def judged(self, system: System, x: Motion) -> tuple[Step, Float[Array, ""], Step]:
        """Return the residual, the force that its tolerance is relative to, and its rounding error.

        Returns:
            Residual [n_free]; largest sum of absolute end forces and load at a row; error that the
            rounding of displacements leaves in the residual, [n_free]; N.
        """
        slopes = _split_by_group(system, self.slope)
        fine, unsure = _ROUNDINGS * jnp.finfo(x.dtype).eps ** 2, []
        for k, group in enumerate(system.groups):
            moved = jnp.max(jnp.abs(x[group.links]), axis=(1, 2))
            error = fine * moved * slopes[k]
            unsure.append(error[:, None, None] * jnp.abs(self.along[k]))
        sizes = [size[..., None] for size in system.end_sizes(self.forces, x)]
        pairs = zip(self.forces, sizes, strict=True)
        rows = system.at_rows([jnp.concatenate(pair, axis=-1) for pair in pairs])
        load = system.external_force(x)
        scale = jnp.max(rows[:, 3] + system.space.force_norm(load))
        residual = system.space.restrict(rows[:, :3] - load, x)
        return residual, scale, jnp.abs(system.space.restrict(system.at_rows(unsure), x))

    def under(self, system: System, tensions: Float[Array, " n"]) -> Under:
        """Return the length slack of the cables here under given `tensions` [n], N."""
        split = _split_by_group(system, tensions)
        rooms: list[Room] = []
        for group, state, tension, shape in zip(
            system.groups, system.states, split, self.shapes, strict=True
        ):
            room = of_each("room", group, state, tension, shape)
            rooms.append(room if state.present is None else _slacken_absent(room, state))
        sags = _concatenate_or_none([room.sag for room in rooms], rooms)
        less = _concatenate_or_none([room.less for room in rooms], rooms)
        return Under(
            tensions,
            jnp.concatenate([room.gap for room in rooms]),
            jnp.concatenate([room.compliance for room in rooms]),
            sags,
            less,
            [g if r.along is None else r.along for r, g in zip(rooms, self.along, strict=True)],
            [room.forces for room in rooms],
        )


@pytree
class Under:
    """Length slack of all cables of a net at a point under given tensions, see `abilities.Room`.

    Attributes:
        tension: given tensions, [n], N.
        gap, compliance: length of straight cables under the tensions less the present one, [n], m,
            and its derivative by the tensions, m/N.
        sag, less: length that sags take, [n], m, and minus its derivative by the tensions, m/N;
            None if no cable can sag.
        along: derivatives of the end forces by the tensions, per group [n_elem, n_end, 3].
        forces: end forces, per group, likewise, N; None where they are tension times `along`.
    """

    tension: Float[Array, " n"]
    gap: Float[Array, " n"]
    compliance: Float[Array, " n"]
    sag: Float[Array, " n"] | None
    less: Float[Array, " n"] | None
    along: list[Float[Array, "n_elem n_end 3"]]
    forces: list[Float[Array, "n_elem n_end 3"] | None]

    def spare(self, room: Float[Array, " n"]) -> Float[Array, " n"]:
        """Return what the sags leave of a length slack `room` [n], m."""
        return room if self.sag is None else jnp.maximum(room - self.sag, 0.0)

    def aim(self, product: Float[Array, ""]) -> tuple[Float[Array, " n"], Float[ArrayLike, " n"]]:
        """Return the product of tension and length slack that an interior-point step aims at.

        Args:
            product: product of the tension and the slack beyond the sag, N m (complementarity).

        Returns:
            Product with the whole slack, [n], N m; minus the derivative of the logarithm of this
            slack by the logarithm of the tension, [n].
        """
        if self.sag is None or self.less is None:
            return jnp.broadcast_to(product, self.tension.shape), 1.0
        whole = product + self.tension * self.sag
        falls = product + self.tension * (self.tension * self.less)
        falls = falls / jnp.where(whole > 0, whole, 1.0)
        return whole, jnp.where(whole > 0, falls, 1.0)

    def residual(self, system: System, x: Motion, tensions: Float[Array, " n"]) -> Step:
        """Return the residual [n_free] at `x` under other tensions [n], to first order, N."""
        ends = []
        pairs = zip(self.along, self.forces, strict=True)
        split = _split_by_group(system, tensions), _split_by_group(system, tensions - self.tension)
        for (along, forces), whole, change in zip(pairs, *split, strict=True):
            if forces is None:
                ends.append(whole[:, None, None] * along)
            else:
                ends.append(forces + change[:, None, None] * along)
        return system.space.restrict(system.at_rows(ends) - system.external_force(x), x)


def stiffness(
    system: System,
    x: Motion,
    along: Sequence[Float[Array, "n_elem n_end 3"]],
    slopes: Float[Array, " n"],
    tensions: Float[Array, " n"],
) -> list[Float[Array, "n_elem d d"]]:
    """Return the element matrices of a net, per group [n_elem, d, d], N/m.

    Slopes [n], N/m, times ``g g^T`` with g = `along`, plus the geometric stiffness of tensions [n].
    """
    found = []
    split = _split_by_group(system, slopes), _split_by_group(system, tensions)
    for group, state, g, slope, tension in zip(
        system.groups, system.states, along, *split, strict=True
    ):
        at = system.nodes[group.links], motion_of(group, drop_low_part(x))
        bent = of_each("bent", group, state, *at, tension)
        g = g.reshape(len(g), -1)
        bent = state.only_present(bent.reshape(*g.shape, g.shape[1]))
        found.append(bent + slope[:, None, None] * g[:, :, None] * g[:, None, :])
    return found


def lengthened(
    system: System, along: Sequence[Float[Array, "n_elem n_end 3"]], spread: Forces
) -> Float[Array, " n"]:
    """Return the linearized elongations by a step of all rows, from derivatives `along`, m."""
    pairs = zip(system.groups, along, strict=True)
    changes = [jnp.sum(g * spread[group.links][..., :3], axis=(1, 2)) for group, g in pairs]
    return jnp.concatenate(changes)


def turned(system: System, spread: Forces) -> Float[Array, " n"]:
    """Return the largest relative step of successive nodes of a cable, over their distance, [n]."""
    found = []
    for group, state in zip(system.groups, system.states, strict=True):
        apart = jnp.sum(jnp.diff(spread[group.links][..., :3], axis=1) ** 2, axis=-1)
        apart = state.only_present(apart)
        found.append(jnp.sqrt(jnp.max(apart, axis=1)) * (group.links.shape[1] - 1))
    return jnp.concatenate(found) / rest_lengths(system)


def _slacken_absent(room, state):
    """Return the `Room` of a group, where inactive cables are slack and without forces."""
    gap = jnp.where(state.present, room.gap, state.rest_length)
    rest = copy_with(room, gap=None, compliance=None)
    return copy_with(state.only_present(rest), gap=gap, compliance=room.compliance)


def rest_lengths(system: System) -> Float[Array, " n"]:
    """Return the unstressed lengths of all cables, [n], m."""
    lengths: list[Array] = [state.rest_length for state in system.states]  # type: ignore[misc]  # all have one
    return jnp.concatenate(lengths)


def held(system: System) -> Bool[Array, " n"] | None:
    """Return which cables have a prescribed tension: by a jack, or zero as inactive ones, [n].

    None if there are no such cables in any phase.
    """
    if all(state.jack_force is None and state.present is None for state in system.states):
        return None
    found = []
    for group, state in zip(system.groups, system.states, strict=True):
        jacked = jnp.full(len(group.links), state.jack_force is not None)
        if state.jack_force is not None and state.jacked is not None:
            jacked = state.jacked
        found.append(jacked if state.present is None else jacked | ~state.present)
    return jnp.concatenate(found)


def loaded(system: System, x: Motion) -> Bool[Array, ""]:
    """Return whether any load or jack acts at `x`."""
    jacks = [
        jnp.any(state.jack_force != 0) for state in system.states if state.jack_force is not None
    ]
    return jnp.any(jnp.stack([jnp.any(system.external_force(x) != 0), *jacks]))


def _split_by_group(system, values):
    """Split an array for all cables [n] into a list with an array per group."""
    ends = [0]
    for group in system.groups:
        ends.append(ends[-1] + len(group.links))
    return [values[i:j] for i, j in pairwise(ends)]


def _concatenate_or_none(values, rooms):
    """Concatenate arrays of all groups, with zeros for None; None if all are None."""
    if all(value is None for value in values):
        return None
    pairs = zip(values, rooms, strict=True)
    return jnp.concatenate([jnp.zeros_like(r.gap) if v is None else v for v, r in pairs])
