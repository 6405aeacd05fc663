"""The phases of an analysis as data, stacked on the host: one program serves for all of them.

What a phase lacks and another has is there and does nothing: loads are zero, statements concern no
element, and unknowns that are free in another phase only are held. What no phase has is absent.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Any

import jax
import numpy as np

from ..common.tree import copy, pytree, stacked
from ..common.types import ArrayLike, Float, Int, PyTree
from ..elements.element import Element
from ..elements.prestress import Stated
from ..loads.load import Load
from ..mechanics.load_stacks import LoadStack
from ..mechanics.ramp import PhaseData
from ..model.supports import Fixed
from ..spaces.freedoms import Freedoms


@pytree(static=("increments", "n_node"))
class Schedule:
    """All phases of an analysis; arrays have a leading axis [n_phase].

    Attributes:
        number: of every phase.
        inputs, added_load, moved: as of `PhaseData`.
        freedoms: numbering of all unknowns, without that axis.
        changes: what of it changes from phase to phase, by name, or None.
        before: what of it was held before every phase, by name; None if supports never change.
        loads: element loads of all phases, list of `LoadStack`.
        increments: numbers of increments, a tuple.
        n_node: number of nodes; further rows of motion belong to elements.
    """

    number: Int[ArrayLike, " n_phase"]
    inputs: list[dict[str, Stated]]
    added_load: Float[ArrayLike, "n_phase n_row n_freedom"] | None
    moved: Float[ArrayLike, "n_phase n_row n_freedom"] | None
    freedoms: Freedoms
    changes: dict[str, PyTree[ArrayLike]] | None
    before: dict[str, ArrayLike] | None
    loads: list[LoadStack]
    increments: tuple[int, ...] = ()
    n_node: int = 0

    def __len__(self) -> int:
        return len(self.increments)

    @property
    def factors(self) -> Float[np.ndarray, "n_phase 1+n_inc"]:
        """Load factors from 0 on, [n_phase, 1 + n_inc]; above 1 where a phase has fewer."""
        numbers = np.arange(max(self.increments) + 1)
        return numbers / np.array(self.increments)[:, None]

    @property
    def rows(self) -> tuple[Any, ...]:
        """What `of` makes a phase of, for all phases, to be scanned."""
        data = self.inputs, self.added_load, self.moved, self.changes, self.before
        return self.number, *data

    def of(self, row: tuple[Any, ...]) -> PhaseData:
        """The `PhaseData` of one of the `rows`."""
        number, inputs, added, moved, changes, before = row
        freedoms = self.freedoms if changes is None else copy(self.freedoms, **changes)
        was = None if before is None else copy(self.freedoms.of_supports, **before)
        return PhaseData(number, inputs, added, moved, freedoms, was)

    def phase(self, k: int) -> PhaseData:
        """The `PhaseData` of a phase."""
        return self.of(jax.tree.map(lambda x: x[k], self.rows))


def stated(
    inputs: Sequence[Sequence[dict[str, Stated]]], groups: Sequence[Element]
) -> list[dict[str, Stated]]:
    """Prestress statements of all phases stacked, per group a dict from name to `Stated`.

    Args:
        inputs: for every phase, a list with a dict for every group.
        groups: element groups.
    """
    found = []
    for k, group in enumerate(groups):
        names = list(dict.fromkeys(name for phase in inputs for name in phase[k]))
        nothing = Stated(np.zeros(len(group.links)), np.zeros(len(group.links), bool))
        own = {}
        for name in names:
            parts = [phase[k].get(name, nothing) for phase in inputs]
            if any(part.chosen is not None for part in parts):
                parts = [
                    copy(part, chosen=np.ones(len(group.links), bool))
                    if part.chosen is None
                    else part
                    for part in parts
                ]
            own[name] = stacked(parts)
        found.append(own)
    return found


def on_rows(
    loads: Sequence[Sequence[Load]], method: str, shape: tuple[int, int], dtype: Any
) -> Float[ArrayLike, "n_phase n_row n_freedom"] | None:
    """Sums of the nodal loads, or movements, of every phase, [n_phase, n_row, 3 or 6], or None.

    Args:
        loads: for every phase a list of them.
        method: what gives the array of one, "nodal_forces" or "steps".
        shape: of all rows, [n_row, 3 or 6].
        dtype: of the nodes.
    """
    if not any(loads):
        return None
    zero = np.zeros(shape, dtype)
    return stacked([sum((getattr(x, method)(shape, dtype) for x in own), zero) for own in loads])


def numbering(
    sets: Sequence[Fixed], numbered: Callable[[Fixed], Freedoms]
) -> tuple[Freedoms, dict[str, PyTree[ArrayLike]] | None, dict[str, ArrayLike] | None]:
    """Numbering of the unknowns of all phases, and what supports change of it.

    Args:
        sets: held freedoms before the first phase and in every phase, `Fixed`.
        numbered: function of a `Fixed` that numbers.

    Returns:
        Freedoms, changes, before: see `Schedule`.
    """
    was, own = sets[:-1], sets[1:]
    if all(fixed == own[0] for fixed in own):
        freedoms, changes = numbered(own[0]), None
    else:  # unknown is what any phase leaves free
        both = np.logical_and.reduce([fixed.array for fixed in own])
        freedoms = numbered(Fixed(both, own[0].axes))
        changes = _held(own)
        changes["bound"] = changes["fixed"].reshape(len(own), -1)[:, np.asarray(freedoms.free)]
        spins = _spins([fixed.spins for fixed in own])
        if spins is not None:
            changes["spins"] = spins
    return freedoms, changes, None if was == own else _held(was)


def _held(sets):
    """What is held, and along which directions, of several `Fixed`, by name."""
    held = {"fixed": np.stack([fixed.array for fixed in sets])}
    if sets[0].axes is not None:
        held["axes"] = np.stack([fixed.axes.array for fixed in sets])
    return held


def _spins(spins):
    """Free spins of every phase as those of one are in `Freedoms`, padded and stacked, or None."""
    found = [own for own in spins if own is not None]
    if not found:
        return None
    m, pieces = max(len(own.rows) for own in found), max(len(own.ends) for own in found)
    rows, piece = np.zeros((len(spins), m), np.int32), np.full((len(spins), m), -1, np.int32)
    ends = np.tile(found[0].ends[:1], (len(spins), pieces, 1))  # of pieces that are not there
    for k, own in enumerate(spins):
        if own is not None:
            rows[k, : len(own.rows)], piece[k, : len(own.rows)] = own.rows, own.piece
            ends[k, : len(own.ends)] = own.ends
    return rows, piece, ends
