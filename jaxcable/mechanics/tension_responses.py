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
from ..elements.abilities import LengthSlack
from ..elements.prestress import call_each_element
from ..spaces.space import Forces, Motion, Step
from ..spaces.translations import drop_low_part
from .assembly import System
from .elementwise import evaluate_elements, motion_at_ends

_ROUNDINGS = 8  # bound on the errors of eps^2 displacement in an elongation (`elements.rebasing`)


@pytree
class TensionResponses:
    """Tensions and end forces of all cables at a point: `abilities.TensionResponse`, [n] in all.

    Attributes:
        tension, slope: tension, and its derivative by the length, [n], N and N/m.
        unit_forces: derivative of the length by the displacements of the ends, per group
            [n_elem, n_end, 3].
        forces: end forces, per group, likewise, N.
        shapes: `shape` of every group.
    """

    tension: Float[Array, " n"]
    slope: Float[Array, " n"]
    unit_forces: list[Float[Array, "n_elem n_end 3"]]
    forces: list[Float[Array, "n_elem n_end 3"]]
    shapes: list[PyTree[Array]]

    @classmethod
    def of(cls, system: System, x: Motion, exact: Bool[ArrayLike, ""]) -> TensionResponses:
        """Evaluate the cables at `x`; `exact` as of `elementwise.map_elements_at_ends`."""
        found = []
        for group, state in zip(system.groups, system.states, strict=True):
            pull = evaluate_elements(
                "tension_response", group, state, system.nodes, x, exact=exact, absent=True
            )
            found.append(copy_with(state.zero_where_absent(pull), shape=pull.shape))
        return cls(
            jnp.concatenate([pull.tension for pull in found]),
            jnp.concatenate([pull.slope for pull in found]),
            [pull.unit_forces for pull in found],
            [pull.forces for pull in found],
            [pull.shape for pull in found],
        )

    def residual_scale_and_rounding(
        self, system: System, x: Motion
    ) -> tuple[Step, Float[Array, ""], Step]:
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
            unsure.append(error[:, None, None] * jnp.abs(self.unit_forces[k]))
        sizes = [size[..., None] for size in system.end_force_norms(self.forces, x)]
        pairs = zip(self.forces, sizes, strict=True)
        rows = system.sum_at_rows([jnp.concatenate(pair, axis=-1) for pair in pairs])
        load = system.external_force(x)
        scale = jnp.max(rows[:, 3] + system.space.force_norm(load))
        residual = system.space.restrict(rows[:, :3] - load, x)
        return residual, scale, jnp.abs(system.space.restrict(system.sum_at_rows(unsure), x))

    def under_tensions(self, system: System, tensions: Float[Array, " n"]) -> SlackUnderTensions:
        """Return the length slack of the cables here under given `tensions` [n], N."""
        split = _split_by_group(system, tensions)
        rooms: list[LengthSlack] = []
        for group, state, tension, shape in zip(
            system.groups, system.states, split, self.shapes, strict=True
        ):
            room = call_each_element("length_slack", group, state, tension, shape)
            rooms.append(room if state.present is None else _slacken_absent(room, state))
        sags = _concatenate_or_none([room.sag for room in rooms], rooms)
        less = _concatenate_or_none([room.sag_compliance for room in rooms], rooms)
        return SlackUnderTensions(
            tensions,
            jnp.concatenate([room.spare_length for room in rooms]),
            jnp.concatenate([room.compliance for room in rooms]),
            sags,
            less,
            [
                g if r.unit_forces is None else r.unit_forces
                for r, g in zip(rooms, self.unit_forces, strict=True)
            ],
            [room.forces for room in rooms],
        )


@pytree
class SlackUnderTensions:
    """Length slack of all cables at a point under given tensions, see `abilities.LengthSlack`.

    Attributes:
        tension: given tensions, [n], N.
        spare_length, compliance: length of straight cables under the tensions less the present one,
            [n], m, and its derivative by the tensions, m/N.
        sag, sag_compliance: length that sags take, [n], m, and minus its derivative by the
            tensions, m/N; None if no cable can sag.
        unit_forces: derivatives of the end forces by the tensions, per group [n_elem, n_end, 3].
        forces: end forces, per group, likewise, N; None where they are tension times `unit_forces`.
    """

    tension: Float[Array, " n"]
    spare_length: Float[Array, " n"]
    compliance: Float[Array, " n"]
    sag: Float[Array, " n"] | None
    sag_compliance: Float[Array, " n"] | None
    unit_forces: list[Float[Array, "n_elem n_end 3"]]
    forces: list[Float[Array, "n_elem n_end 3"] | None]

    def beyond_sag(self, room: Float[Array, " n"]) -> Float[Array, " n"]:
        """Return what the sags leave of a length slack `length_slack` [n], m."""
        return room if self.sag is None else jnp.maximum(room - self.sag, 0.0)

    def target_product(
        self, product: Float[Array, ""]
    ) -> tuple[Float[Array, " n"], Float[ArrayLike, " n"]]:
        """Return the product of tension and length slack that an interior-point step aims at.

        Args:
            product: product of the tension and the slack beyond the sag, N m (complementarity).

        Returns:
            Product with the whole slack, [n], N m; minus the derivative of the logarithm of this
            slack by the logarithm of the tension, [n].
        """
        if self.sag is None or self.sag_compliance is None:
            return jnp.broadcast_to(product, self.tension.shape), 1.0
        whole = product + self.tension * self.sag
        falls = product + self.tension * (self.tension * self.sag_compliance)
        falls = falls / jnp.where(whole > 0, whole, 1.0)
        return whole, jnp.where(whole > 0, falls, 1.0)

    def residual(self, system: System, x: Motion, tensions: Float[Array, " n"]) -> Step:
        """Return the residual [n_free] at `x` under other tensions [n], to first order, N."""
        ends = self.end_forces(system, tensions)
        return system.space.restrict(system.sum_at_rows(ends) - system.external_force(x), x)

    def end_forces(
        self, system: System, tensions: Float[Array, " n"]
    ) -> list[Float[Array, "n_elem n_end 3"]]:
        """Return the end forces per group under other tensions [n], to first order, N."""
        ends = []
        pairs = zip(self.unit_forces, self.forces, strict=True)
        split = _split_by_group(system, tensions), _split_by_group(system, tensions - self.tension)
        for (along, forces), whole, change in zip(pairs, *split, strict=True):
            if forces is None:
                ends.append(whole[:, None, None] * along)
            else:
                ends.append(forces + change[:, None, None] * along)
        return ends


def net_stiffness(
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
        at = system.nodes[group.links], motion_at_ends(group, drop_low_part(x))
        bent = call_each_element("geometric_stiffness", group, state, *at, tension)
        g = g.reshape(len(g), -1)
        bent = state.zero_where_absent(bent.reshape(*g.shape, g.shape[1]))
        found.append(bent + slope[:, None, None] * g[:, :, None] * g[:, None, :])
    return found


def linearized_elongation(
    system: System, along: Sequence[Float[Array, "n_elem n_end 3"]], spread: Forces
) -> Float[Array, " n"]:
    """Return the linearized elongations by a step of all rows, m; derivatives `unit_forces`."""
    pairs = zip(system.groups, along, strict=True)
    changes = [jnp.sum(g * spread[group.links][..., :3], axis=(1, 2)) for group, g in pairs]
    return jnp.concatenate(changes)


def relative_node_motion(system: System, spread: Forces) -> Float[Array, " n"]:
    """Return the largest relative step of successive nodes of a cable, over their distance, [n]."""
    found = []
    for group, state in zip(system.groups, system.states, strict=True):
        apart = jnp.sum(jnp.diff(spread[group.links][..., :3], axis=1) ** 2, axis=-1)
        apart = state.zero_where_absent(apart)
        found.append(jnp.sqrt(jnp.max(apart, axis=1)) * (group.links.shape[1] - 1))
    return jnp.concatenate(found) / rest_lengths(system)


def _slacken_absent(room, state):
    """Return the `LengthSlack` of a group, where inactive cables are slack and without forces."""
    gap = jnp.where(state.present, room.spare_length, state.rest_length)
    rest = copy_with(room, spare_length=None, compliance=None)
    return copy_with(state.zero_where_absent(rest), spare_length=gap, compliance=room.compliance)


def rest_lengths(system: System) -> Float[Array, " n"]:
    """Return the unstressed lengths of all cables, [n], m."""
    lengths: list[Array] = [state.rest_length for state in system.states]  # type: ignore[misc]  # all have one
    return jnp.concatenate(lengths)


def prescribed_tensions(system: System) -> Bool[Array, " n"] | None:
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


def has_load(system: System, x: Motion) -> Bool[Array, ""]:
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
    return jnp.concatenate([jnp.zeros_like(r.spare_length) if v is None else v for v, r in pairs])
