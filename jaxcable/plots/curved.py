"""Curves and diagrams of elements at all moments that `view` shows."""

from __future__ import annotations

import numpy as np

from ..common.types import Float, Int
from ..elements.abilities import Bending, Sagging
from ..model.parts import listed
from ..results.between import stored_forces
from .moments import Moments
from .shapes import bends, numbered, sags, state_at

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
    found = bends(structure, last, motion)
    if found is None:
        return None
    number, bend, axes = found
    return Beams(number, bend, axes[:, :, 1:], _diagrams(moments, structure, number))


def _diagrams(moments, structure, number):
    """Section forces along beams at the ends of phases, see `Beams`."""
    found, places = [], np.linspace(0.0, 1.0, PLACES)
    for shot in moments.shots:
        if shot.end is not None:
            forces, at = listed(structure, shot.end.section_forces), shot.end.positions
            along = stored_forces(structure.groups, forces, at, places)
            kept = [x for x in along if x is not None]
            known = sum(map(len, kept)) == len(number)
            found.append(np.concatenate(kept) if known else np.zeros((len(number), 0, 6)))
    return np.stack(found)


def sagging_of(
    moments: Moments,
) -> tuple[Int[np.ndarray, " n_sag"], Float[np.ndarray, "n_end n_sag n_place 3"]] | None:
    """How catenaries hang below their chords at the ends of phases.

    Returns:
        Numbers of the elements, counted through all groups, [n_sag], and their distances from the
        chord at places between its ends, evenly along the unstressed length, m. None without a
        structure, or if nothing in it sags.
    """
    structure, last = moments.structure, moments.solution.last
    if structure is None or not any(isinstance(group, Sagging) for group in structure.groups):
        return None
    pairs = zip(numbered(structure), structure.groups, strict=True)
    number = np.concatenate([own for own, group in pairs if isinstance(group, Sagging)])
    n = 17 if len(number) <= 2000 else 9  # pieces are shorter than a pixel where there are many
    found = []
    for shot in moments.shots:
        if shot.end is None:
            continue
        motion, state = moments.paths[shot.phase].motion, last
        if shot.end is not last:
            motion = None if motion is None else motion[shot.number]
            state = state_at(last, structure, shot.phase, shot.end, motion)
        apart = sags(structure, state, moments.start + shot.moved, n)[1]
        found.append(np.nan_to_num(apart))  # chords of what is not there
    return number, np.stack(found)
