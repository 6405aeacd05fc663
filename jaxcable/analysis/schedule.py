"""The phases of an analysis as arrays, stacked on the host: one program serves for all phases.

What one phase has is also there in the arrays of the others, without effect: loads of zero,
inputs (such as a pretension) that concern no element, unknowns that are free in another phase
and held in this one. What no phase has is absent.
"""

from __future__ import annotations

import functools
import operator
from collections.abc import Callable, Sequence
from typing import Any

import jax
import numpy as np

from ..common.tree import copy_with, pytree
from ..common.types import ArrayLike, Bool, Float, Int, PyTree
from ..elements.phase_input import InputValues
from ..loads.load import Load
from ..loads.varying import Amplitude, stack_amplitudes
from ..mechanics.bundles import Bundles
from ..mechanics.load_ramp import NodalIncrement, PhaseData
from ..mechanics.load_stacks import LoadStack
from ..model.supports import FixedDofs
from ..programs.joining import concatenate, stack_trees
from ..spaces.dof_map import DofMap


@pytree(static=("increments", "n_node"))
class Schedule:
    """All phases of an analysis.

    Attributes:
        phases: `PhaseData` of all phases, stacked: arrays have a leading axis [n_phase]. Of its
            `dof_map` it has the fields that change from phase to phase, by name, or None; of its
            `dof_map_before` the fields with the supports before every phase, None if the supports
            never change.
        dof_map: numbering of all unknowns, without the axis of phases.
        loads: element loads of all phases, list of `LoadStack`.
        increments: number of increments of every phase, a tuple.
        n_node: number of nodes; further rows of motion belong to elements.
        present_at_start: elements that are there before the first phase, per group [n_elem] bool;
            None if no element ever comes or goes.
        is_consistent: `Activation.is_consistent`.
    """

    phases: PhaseData
    dof_map: DofMap
    loads: list[LoadStack]
    increments: tuple[int, ...] = ()
    n_node: int = 0
    present_at_start: list[Bool[ArrayLike, " n_elem"]] | None = None
    is_consistent: Bool[ArrayLike, " n_phase"] | None = None

    def __len__(self) -> int:
        return len(self.increments)

    @property
    def steps(self) -> tuple[Int[np.ndarray, " n_phase"], Float[np.ndarray, "n_phase 1+n_inc"]]:
        """Number of increments of every phase, and their load factors from 0 on.

        Load factors are above 1 in phases with fewer increments than others.
        """
        counts = np.array(self.increments, np.int32)
        return counts, np.arange(max(self.increments) + 1) / counts[:, None]

    def complete(self, phase: PhaseData) -> PhaseData:
        """Return one of `phases` with its whole `dof_map`, and that of the phase before."""
        changes: Any = phase.dof_map  # in `phases` it is a dict or None, as is the one before
        before: Any = phase.dof_map_before
        dof_map = self.dof_map if changes is None else copy_with(self.dof_map, **changes)
        was = None if before is None else copy_with(self.dof_map.without_unknowns, **before)
        return copy_with(phase, dof_map=dof_map, dof_map_before=was)

    def phase(self, k: int) -> PhaseData:
        """Return the `PhaseData` of the phase with index `k`."""
        return self.complete(jax.tree.map(lambda x: x[k], self.phases))


def stack_phase_inputs(
    inputs_of_phases: Sequence[Sequence[dict[str, InputValues]]], bundles: Bundles
) -> list[dict[str, InputValues]]:
    """Stack the inputs of all phases, and join those of the groups of a bundle.

    Returns for each bundle (groups evaluated as one) a dict from the name of the input to
    `InputValues`, whose arrays have a leading axis [n_phase]. They concern no element in phases
    without the input, and none of the groups of a bundle that do not have it.

    Args:
        inputs_of_phases: for every phase a list with a dict for every group.
        bundles: which groups are evaluated together.
    """
    found = []
    for groups in bundles.group_indices:
        names = dict.fromkeys(n for phase in inputs_of_phases for k in groups for n in phase[k])
        sizes = [bundles.sizes[k] for k in groups]
        of_bundle = {}
        for name in names:
            parts = [[phase[k].get(name) for k in groups] for phase in inputs_of_phases]
            of_bundle[name] = _stack_phase_input(parts, sizes)
        found.append(of_bundle)
    return found


def _stack_phase_input(parts, sizes):
    """Return `InputValues` [n_phase, n_elem, ...] of `parts`, for every phase a list by group.

    Each item is `InputValues` or None; `sizes` are the numbers of elements of the groups.
    """
    every = [part for phase in parts for part in phase]
    several = next(np.shape(part.values)[1:] for part in every if part is not None)

    def filled(stated, count):
        if stated is not None:
            return stated
        return InputValues(np.zeros((count, *several)), np.zeros(count, bool))

    rows = [list(map(filled, phase, sizes)) for phase in parts]
    joined = [[own.values for own in row] for row in rows]
    values = stack_trees([x[0] if len(x) == 1 else concatenate(x) for x in joined])
    if all(part is not None and part.chosen is None for part in every):
        return InputValues(values)
    masks = [np.concatenate([own.element_mask() for own in row]) for row in rows]
    return InputValues(values, np.stack(masks))


def stack_nodal_loads(
    loads: Sequence[Sequence[tuple[Load, Amplitude | None]]],
    method: str,
    shape: tuple[int, int],
    dtype: Any,
) -> NodalIncrement | None:
    """Stack nodal loads, or movements, of all phases, with an axis [n_phase]; None without any.

    Args:
        loads: for every phase a list of pairs: nodal load, or movement, and amplitude or None.
        method: the method that returns the array of one of them, "nodal_forces" or
            "nodal_movements".
        shape: shape of such an array, (n_row, 3 or 6).
        dtype: that of the nodes.
    """
    if not any(loads):
        return None
    zero = np.zeros(shape, dtype)

    def total(some):
        arrays = [_load_array(load, method, zero) for load, own in some if own is None]
        return functools.reduce(operator.add, arrays) if arrays else zero

    sums = [total(some) for some in loads]
    varying = [[load for load in some if load[1] is not None] for some in loads]
    most = max(map(len, varying))
    if not most:
        return NodalIncrement(stack_trees(sums))
    values, amplitudes = [], []
    for proportional, some in zip(sums, varying, strict=True):
        arrays = [_load_array(load, method, zero) for load, _ in some]
        padding = most - len(some)  # with loads of zero
        values.append(stack_trees([proportional, *arrays, *[zero] * padding]))
        amplitudes += [None, *(own for _, own in some), *[None] * padding]
    rows = len(loads), most + 1, -1
    return NodalIncrement(
        stack_trees(values), jax.tree.map(lambda x: x.reshape(rows), stack_amplitudes(amplitudes))
    )


def _load_array(load, method, zero):
    """Return the array that a `method` of a load, by its name, gives in shape and dtype of `zero`.

    ValueError, which names load and method, if an index of the load is out of range.
    """
    try:
        return getattr(load, method)(zero.shape, zero.dtype)
    except IndexError as error:  # of a load that somebody has written
        raise ValueError(
            f"loads: {type(load).__name__}.{method}: {error}; if this is a node number that the "
            "structure does not have, `check` of the load can refuse it"
        ) from error


def number_unknowns_by_phase(
    sets: Sequence[FixedDofs],
    numbered: Callable[[FixedDofs], DofMap],
    idle: Bool[ArrayLike, "1+n_phase n_row n_freedom"] | None = None,
) -> tuple[DofMap, dict[str, PyTree[ArrayLike]] | None, dict[str, ArrayLike] | None]:
    """Number the unknowns of all phases at once, and find what supports change from phase to phase.

    Args:
        sets: held degrees of freedom before the first phase and in every phase, `FixedDofs`.
        numbered: function from `FixedDofs` to the `DofMap` that numbers the rest.
        idle: degrees of freedom that no active element has, before the first phase and in every
            phase, which are held; None if elements neither come nor go.

    Returns:
        `dof_map` of `Schedule`, and `dof_map` and `dof_map_before` of its `phases`.
    """
    was, now = sets[:-1], sets[1:]
    if idle is None and all(fixed == now[0] for fixed in now):
        dof_map, changes = numbered(now[0]), None
    else:  # a freedom is unknown if any phase leaves it free
        always = np.logical_and.reduce([fixed.array for fixed in now])
        dof_map = numbered(FixedDofs(always, now[0].axes))
        changes = _stack_fixed(now)
        if idle is not None:
            changes |= {"fixed": changes["fixed"] | idle[1:], "supported": changes["fixed"]}
        changes["temporarily_fixed"] = changes["fixed"].reshape(len(now), -1)[
            :, np.asarray(dof_map.free)
        ]
        mechanisms = _stack_torsional_mechanisms([fixed.mechanisms for fixed in now])
        if mechanisms is not None:
            changes["torsional_mechanisms"] = mechanisms
    if idle is not None:
        before = _stack_fixed(was)
        held = {"fixed": before["fixed"] | idle[:-1], "supported": before["fixed"]}
        return dof_map, changes, before | held
    return dof_map, changes, None if was == now else _stack_fixed(was)


def _stack_fixed(sets):
    """Stack masks and directions of several `FixedDofs`: a dict by name of a `DofMap` field."""
    held = {"fixed": np.stack([fixed.array for fixed in sets])}
    if sets[0].axes is not None:
        held["axes"] = np.stack([fixed.axes.array for fixed in sets])
    return held


def _stack_torsional_mechanisms(by_phase):
    """Stack the `TorsionalMechanisms` of all phases, padded to equal size; None without any.

    Returns:
        Their `rows`, `piece` (-1 in padding) and `ends`, each with an axis [n_phase].
    """
    found = [some for some in by_phase if some is not None]
    if not found:
        return None
    m, pieces = max(len(some.rows) for some in found), max(len(some.ends) for some in found)
    rows, piece = np.zeros((len(by_phase), m), np.int32), np.full((len(by_phase), m), -1, np.int32)
    ends = np.tile(found[0].ends[:1], (len(by_phase), pieces, 1))  # padding: any line will do
    for k, some in enumerate(by_phase):
        if some is not None:
            rows[k, : len(some.rows)], piece[k, : len(some.rows)] = some.rows, some.piece
            ends[k, : len(some.ends)] = some.ends
    return rows, piece, ends
