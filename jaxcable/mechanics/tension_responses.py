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
class CableTensions:
    """Tensions and end forces of all cables at one motion, with their derivatives.

    Arrays of all groups are joined, [n], in the order of the groups.

    Attributes:
        tension: tensions, [n], N.
        slope: derivatives of the tensions by the lengths of the cables, [n], N/m.
        unit_forces: derivative of the length by the displacements of the ends, per group
            [n_elem, n_end, 3]; times the tension they are the end forces.
        forces: end forces, per group [n_elem, n_end, 3], N.
        shapes: `abilities.TensionResponse.shape` of every group.
    """

    tension: Float[Array, " n"]
    slope: Float[Array, " n"]
    unit_forces: list[Float[Array, "n_elem n_end 3"]]
    forces: list[Float[Array, "n_elem n_end 3"]]
    shapes: list[PyTree[Array]]

    @classmethod
    def at_motion(cls, system: System, x: Motion, exact: Bool[ArrayLike, ""]) -> CableTensions:
        """Evaluate all cables at motion `x`.

        With `exact`, elongations are as precise as a motion that is the sum of displacements and
        of their low-order part (double-double), see `map_elements_at_ends`.
        """
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
        """Return the residual, the force that its tolerance refers to, and its rounding error.

        Returns:
            Residual [n_free]; largest sum of absolute end forces and load at a row; error that the
            rounding of displacements leaves in the residual, [n_free]; all in N.
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
        scale = system.force_scale(rows[:, 3] + system.space.force_norm(load))
        residual = system.space.restrict(rows[:, :3] - load, x)
        return residual, scale, jnp.abs(system.space.restrict(system.sum_at_rows(unsure), x))

    def under_tensions(self, system: System, tensions: Float[Array, " n"]) -> SlackUnderTensions:
        """Return lengths and end forces of the cables under given tensions, [n], N.

        The positions of the nodes, and hence the directions of the cables, stay those of `self`.
        """
        split = _split_by_group(system, tensions)
        slacks: list[LengthSlack] = []
        for group, state, tension, shape in zip(
            system.groups, system.states, split, self.shapes, strict=True
        ):
            slack = call_each_element("length_slack", group, state, tension, shape)
            slacks.append(slack if state.present is None else _slacken_absent(slack, state))
        sags = _concatenate_or_none([slack.sag for slack in slacks], slacks)
        sag_compliance = _concatenate_or_none([slack.sag_compliance for slack in slacks], slacks)
        return SlackUnderTensions(
            tensions,
            jnp.concatenate([slack.spare_length for slack in slacks]),
            jnp.concatenate([slack.compliance for slack in slacks]),
            sags,
            sag_compliance,
            [
                g if r.unit_forces is None else r.unit_forces
                for r, g in zip(slacks, self.unit_forces, strict=True)
            ],
            [slack.forces for slack in slacks],
        )


@pytree
class SlackUnderTensions:
    """How much longer than now all cables would be under given tensions (length slack).

    Per group it is `abilities.LengthSlack`.

    Attributes:
        tension: given tensions, [n], N.
        spare_length: length of straight cables under the tensions less the present length, [n], m.
        compliance: derivative of `spare_length` by the tensions, [n], m/N.
        sag: length that sags take, [n], m; None if no cable can sag.
        sag_compliance: minus the derivative of `sag` by the tensions, [n], m/N; or None.
        unit_forces: derivatives of the end forces by the tensions, per group [n_elem, n_end, 3].
        forces: end forces, per group [n_elem, n_end, 3], N; None for a group where they are tension
            times `unit_forces`.
    """

    tension: Float[Array, " n"]
    spare_length: Float[Array, " n"]
    compliance: Float[Array, " n"]
    sag: Float[Array, " n"] | None
    sag_compliance: Float[Array, " n"] | None
    unit_forces: list[Float[Array, "n_elem n_end 3"]]
    forces: list[Float[Array, "n_elem n_end 3"] | None]

    def slack_beyond_sag(self, slack: Float[Array, " n"]) -> Float[Array, " n"]:
        """Return spare lengths `slack`, [n], m, less the lengths that sags take, at least 0."""
        return slack if self.sag is None else jnp.maximum(slack - self.sag, 0.0)

    def target_product_and_slope(
        self, product: Float[Array, ""]
    ) -> tuple[Float[Array, " n"], Float[ArrayLike, " n"]]:
        """Return the product of tension and whole length slack that an interior-point step aims at.

        The whole slack is that beyond the sag, and the sag.

        Args:
            product: aim for the product of tension and slack beyond the sag, scalar, N m.

        Returns:
            The product, ``product + tension sag``, [n], N m; minus the derivative of the logarithm
            of the whole slack by the logarithm of the tension, [n], 1 without sags.
        """
        if self.sag is None or self.sag_compliance is None:
            return jnp.broadcast_to(product, self.tension.shape), 1.0
        whole = product + self.tension * self.sag
        falls = product + self.tension * (self.tension * self.sag_compliance)
        falls = falls / jnp.where(whole > 0, whole, 1.0)
        return whole, jnp.where(whole > 0, falls, 1.0)

    def residual(self, system: System, x: Motion, tensions: Float[Array, " n"]) -> Step:
        """Return the residual [n_free], N, at `x` under other tensions [n], linearized in these."""
        ends = self.end_forces(system, tensions)
        return system.space.restrict(system.sum_at_rows(ends) - system.external_force(x), x)

    def end_forces(
        self, system: System, tensions: Float[Array, " n"]
    ) -> list[Float[Array, "n_elem n_end 3"]]:
        """Return the end forces under other tensions [n], N, linearized in these.

        They are [n_elem, n_end, 3] per group, N.
        """
        ends = []
        pairs = zip(self.unit_forces, self.forces, strict=True)
        split = _split_by_group(system, tensions), _split_by_group(system, tensions - self.tension)
        for (unit_forces, forces), whole, change in zip(pairs, *split, strict=True):
            if forces is None:
                ends.append(whole[:, None, None] * unit_forces)
            else:
                ends.append(forces + change[:, None, None] * unit_forces)
        return ends


def net_stiffness(
    system: System,
    x: Motion,
    unit_forces: Sequence[Float[Array, "n_elem n_end 3"]],
    slopes: Float[Array, " n"],
    tensions: Float[Array, " n"],
) -> list[Float[Array, "n_elem d d"]]:
    """Return element matrices of a net, ``slope g g'`` plus geometric stiffness, N/m.

    They are [n_elem, d, d] per group. `unit_forces` are the derivatives g of lengths by the ends,
    per group [n_elem, n_end, 3], `slopes` stiffnesses along g, [n], N/m, `tensions` those of the
    geometric stiffness, [n], N.
    """
    found = []
    split = _split_by_group(system, slopes), _split_by_group(system, tensions)
    for group, state, g, slope, tension in zip(
        system.groups, system.states, unit_forces, *split, strict=True
    ):
        at = system.nodes[group.links], motion_at_ends(group, drop_low_part(x))
        geometric = call_each_element("geometric_stiffness", group, state, *at, tension)
        g = g.reshape(len(g), -1)
        geometric = state.zero_where_absent(geometric.reshape(*g.shape, g.shape[1]))
        found.append(geometric + slope[:, None, None] * g[:, :, None] * g[:, None, :])
    return found


def linearized_elongation(
    system: System, unit_forces: Sequence[Float[Array, "n_elem n_end 3"]], row_step: Forces
) -> Float[Array, " n"]:
    """Return the linearized elongations of all cables by a step of all rows, [n], m.

    `unit_forces` are derivatives of lengths by the ends, per group [n_elem, n_end, 3].
    """
    pairs = zip(system.groups, unit_forces, strict=True)
    changes = [jnp.sum(g * row_step[group.links][..., :3], axis=(1, 2)) for group, g in pairs]
    return jnp.concatenate(changes)


def largest_relative_motion_per_cable(system: System, row_step: Forces) -> Float[Array, " n"]:
    """Return for each cable, [n], the largest relative motion of successive nodes over a length.

    That is the unstressed length of the cable over its number of pieces; `row_step` is the step of
    all nodes (rows), [n_row, n_freedom]. Inactive cables have zero.
    """
    found = []
    for group, state in zip(system.groups, system.states, strict=True):
        apart = jnp.sum(jnp.diff(row_step[group.links][..., :3], axis=1) ** 2, axis=-1)
        apart = state.zero_where_absent(apart)
        found.append(jnp.sqrt(jnp.max(apart, axis=1)) * (group.links.shape[1] - 1))
    return jnp.concatenate(found) / rest_lengths(system)


def _slacken_absent(slack, state):
    """Return the `LengthSlack` of a group with inactive cables slack and without end forces."""
    spare = jnp.where(state.present, slack.spare_length, state.rest_length)
    rest = copy_with(slack, spare_length=None, compliance=None)
    return copy_with(state.zero_where_absent(rest), spare_length=spare, compliance=slack.compliance)


def rest_lengths(system: System) -> Float[Array, " n"]:
    """Return the unstressed lengths of all cables, [n], m."""
    lengths: list[Array] = [state.rest_length for state in system.states]  # type: ignore[misc]  # all have one
    return jnp.concatenate(lengths)


def prescribed_tensions(system: System) -> Bool[Array, " n"] | None:
    """Return which cables have a prescribed tension: by a jack, or zero as inactive ones, [n] bool.

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
    """Return whether any load or jack force acts at motion `x`, scalar bool."""
    jacks = [
        jnp.any(state.jack_force != 0) for state in system.states if state.jack_force is not None
    ]
    return jnp.any(jnp.stack([jnp.any(system.external_force(x) != 0), *jacks]))


def _split_by_group(system, values):
    """Split an array over all cables, [n], into a list with an array [n_elem] per group."""
    ends = [0]
    for group in system.groups:
        ends.append(ends[-1] + len(group.links))
    return [values[i:j] for i, j in pairwise(ends)]


def _concatenate_or_none(values, slacks):
    """Concatenate `values`, [n_elem] or None per group, to [n]; return None if all are None.

    A group with None has zeros, in the shape of its `LengthSlack` in `slacks`.
    """
    if all(value is None for value in values):
        return None
    pairs = zip(values, slacks, strict=True)
    return jnp.concatenate([jnp.zeros_like(r.spare_length) if v is None else v for v, r in pairs])
