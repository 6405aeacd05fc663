"""Shapes of elements that are no straight lines, for `view`: bent beams and hanging cables."""

from __future__ import annotations

import itertools
from typing import Any

import jax
import numpy as np
from scipy.interpolate import BarycentricInterpolator, CubicHermiteSpline

from ..analysis.solution import State
from ..common.tree import copy
from ..common.types import Float, Int
from ..elements.abilities import Bending, Sagging
from ..elements.bending import lobatto
from ..elements.prestress import element
from ..forms import catenary_curves
from ..model.parts import first_and_last, per_group
from ..model.structure import Structure
from ..stiffness.tangent import filled, prepared
from .moments import Moment, Moments

PLACES = 13
"""Places along a beam at which its diagrams are known, ends included."""


class Beams:
    """Beams of a solution, as far as they are no straight lines.

    Attributes:
        number: of the elements, counted through all groups, [n_beam].
        bend: the chord's length times the slopes against it at both ends, which make a cubic of
            the axis, [n_shot, n_beam, 2, 3], m.
        axes: the section's axes y and z, [n_shot, n_beam, 2, 3].
        diagrams: ``N, Vy, Vz, T, My, Mz`` at `PLACES` places at the ends of phases,
            [n_end, n_beam, PLACES, 6], N and N m; no places if a group of beams tells none.
    """

    def __init__(
        self,
        number: Int[np.ndarray, " n_beam"],
        bend: Float[np.ndarray, "n_shot n_beam 2 3"],
        axes: Float[np.ndarray, "n_shot n_beam 2 3"],
        diagrams: Float[np.ndarray, "n_end n_beam n_place 6"],
    ):
        self.number, self.bend, self.axes, self.diagrams = number, bend, axes, diagrams


def beams_of(moments: Moments) -> Beams | None:
    """`Beams` at all moments; None without a structure, or if none of its elements bends."""
    structure, last = moments.structure, moments.solution.last
    if structure is None or not any(isinstance(group, Bending) for group in structure.groups):
        return None
    motion = np.stack([moments.paths[s.phase].motion[s.number] for s in moments.shots])
    thawed, arrays, _ = prepared(structure, last)
    numbers, bend, axes = [], [], []
    for number, found in zip(_numbers(structure), _bent(thawed, arrays, motion), strict=True):
        if found is not None:
            slopes, turned, length = (np.asarray(x) for x in found)
            numbers.append(number)
            bend.append(slopes * length[..., None, None])
            axes.append(turned[..., 1:, :])
    if not numbers:
        return None
    joined = np.concatenate(bend, axis=1), np.concatenate(axes, axis=1)
    number = np.concatenate(numbers)
    return Beams(number, *joined, _diagrams(moments, structure, number))


def _diagrams(moments, structure, number):
    """Section forces along beams at the ends of phases, see `Beams`."""
    found = []
    for shot in moments.shots:
        if shot.end is None:
            continue
        place, parts = moments.start + shot.moved, []
        forces = per_group(structure, shot.end.section_forces)
        for values, group in zip(forces, structure.groups, strict=True):
            if values is not None:
                chord = np.diff(place[first_and_last(group)], axis=1)[:, 0]
                parts.append(_along(values, np.linalg.norm(chord, axis=1)))
        known = sum(map(len, parts)) == len(number)
        found.append(np.concatenate(parts) if known else np.zeros((len(number), 0, 6)))
    return np.stack(found)


def _along(
    values: Float[np.ndarray, "n_beam n_point 6"], length: Float[np.ndarray, " n_beam"]
) -> Float[np.ndarray, "n_beam n_place 6"]:
    """Section forces at `PLACES` places from those at the points at which beams tell them.

    Forces and the torque are polynomials through the points. Moments are cubics between
    neighbouring points, with the shear forces as slopes: exact up to loads that are uniform along a
    beam, and near it where its axial force bends it further (1e-3 of the largest in frames that
    turn by a right angle).
    """
    points, places = lobatto(values.shape[1])[0], np.linspace(0.0, 1.0, PLACES)
    found = BarycentricInterpolator(points, values, axis=1)(places)
    for moment, shear, sign in ((4, 2, 1.0), (5, 1, -1.0)):  # My' = Vz, Mz' = -Vy
        slopes = sign * values[:, :, shear] * length[:, None]
        found[:, :, moment] = CubicHermiteSpline(points, values[:, :, moment], slopes, axis=1)(
            places
        )
    return found


@jax.jit
def _bent(thawed, arrays, motion):
    """Slopes, axes and chords of the beams of every group at some motions of all rows, or None."""
    nodes, groups, carry = filled(thawed, arrays)

    def one(group, properties, state, ends, motion):
        found = element(group, properties).deflected(state, ends, motion)
        if found is None:
            return None
        chord = ends[1] + motion[1, :3] - ends[0] - motion[0, :3]
        return *found, (chord * chord).sum() ** 0.5

    def along(group, state):
        def of(motion):
            at = group.properties(), state, nodes[group.links], motion[group.links]
            return jax.vmap(lambda *x: one(group, *x))(*at)

        return jax.vmap(of)(motion.astype(nodes.dtype))

    pairs = zip(groups, carry.states, strict=True)
    return [along(*pair) if isinstance(pair[0], Bending) else None for pair in pairs]


def sagging_of(
    moments: Moments,
) -> tuple[Int[np.ndarray, " n_sag"], Float[np.ndarray, "n_end n_sag n_place 3"]] | None:
    """How catenaries hang below their chords at the ends of phases.

    Returns:
        Numbers of the elements, counted through all groups, [n_sag], and their distances from the
        chord at places between its ends, evenly along the unstressed length, m. None without a
        structure, or if nothing in it sags.
    """
    structure = moments.structure
    if structure is None or not any(isinstance(group, Sagging) for group in structure.groups):
        return None
    pairs = zip(_numbers(structure), structure.groups, strict=True)
    kept = [(number, group) for number, group in pairs if isinstance(group, Sagging)]
    count = sum(len(number) for number, _ in kept)
    n = 17 if count <= 2000 else 9  # pieces are shorter than a pixel where there are many
    parts = np.linspace(0.0, 1.0, n)[1:-1, None]
    found = []
    for shot in moments.shots:
        if shot.end is None:
            continue
        place = moments.start + shot.moved
        curves = per_group(structure, catenary_curves(structure, _state(moments, shot), n))
        apart = []
        for curve, (_, group) in zip([c for c in curves if c is not None], kept, strict=True):
            a, b = (place[nodes][:, None] for nodes in first_and_last(group).T)
            apart.append(curve[:, 1:-1] - (1 - parts) * a - parts * b)
        found.append(np.concatenate(apart))
    return np.concatenate([number for number, _ in kept]), np.stack(found)


def _state(moments: Moments, shot: Moment) -> State:
    """The `State` of the end of a phase, as far as shapes depend on it.

    Loads of later phases do not act yet, lengths and motions are those of the phase.
    """
    last, end = moments.solution.last, shot.end
    if end is last or end is None:
        return last
    carry: Any = last.carry
    structure: Any = moments.structure
    amounts = [
        copy(amount, factors=amount.factors * (np.asarray(stack.phase) <= shot.phase))
        for stack, amount in zip(carry.loads, carry.amounts, strict=True)
    ]
    then, now = (per_group(structure, x.rest_length) for x in (end, last))
    states = []
    for state, a, b in zip(carry.states, then, now, strict=True):
        if state.rest_length is not None:  # the sum of length and elongation stays
            length = np.asarray(state.rest_length) * (np.asarray(a) / np.asarray(b))
            longer = np.asarray(state.elongation) + (np.asarray(state.rest_length) - length)
            state = copy(state, rest_length=length, elongation=longer)
        states.append(state)
    path = moments.paths[shot.phase]
    motion = carry.motion
    if path.motion is not None:
        motion = path.motion[shot.number]
    else:  # from the initial nodes, which an earlier analysis may have left
        moved = np.asarray(end.positions) - np.asarray(structure.nodes)
        motion = np.concatenate([moved, np.asarray(motion)[len(moved) :]])
    return copy(last, carry=copy(carry, motion=motion, states=states, amounts=amounts))


def _numbers(structure: Structure) -> list[Int[np.ndarray, " n_elem"]]:
    """Numbers of the elements of every group, counted through all groups."""
    ends = np.cumsum([0, *(len(group.links) for group in structure.groups)])
    return [np.arange(a, b) for a, b in itertools.pairwise(ends)]
