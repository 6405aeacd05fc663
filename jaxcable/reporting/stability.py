"""What a report says on buckling."""

from __future__ import annotations

import numpy as np

from ..analysis.solution import Solution, State
from ..model.result_parts import straight_pieces
from ..model.structure import Structure
from ..stiffness import buckling_factor


def buckling_sentence(
    structure: Structure, state: State, reference: Solution | State | None = None
) -> str:
    """Return a sentence on the lowest buckling factor of a state, by linear theory.

    The factor multiplies the loads since the `reference`, a state of prestress, or all loads and
    forces if there is none.
    """
    factor = float(buckling_factor(structure, state, reference).factor[0])
    before = np.asarray(structure.nodes)
    if reference is not None:
        before = np.asarray(getattr(reference, "last", reference).positions)
    ends = straight_pieces(structure.groups)[0]
    rotation = np.degrees(_largest_rotation(before[ends], np.asarray(state.positions)[ends]))
    loads = "the loads and all forces of this state"
    if reference is not None:
        loads = "the loads since the reference state"
    if np.isnan(factor):
        return (
            "buckling: no estimate: the state is a mechanism or has buckled, or cables went slack "
            "since the reference state; jaxcable.trace_path (Python) follows the path"
        )
    if np.isinf(factor):
        return f"buckling: at no multiple of {loads} (linear theory)"
    return (
        f"buckling: at {factor:.4g} times {loads} (linear theory, for small rotations; elements "
        f"have rotated by up to {rotation:.2g} degrees)"
    )


def _largest_rotation(before, after):
    """Return the largest rotation of a chord, rad; arguments are end positions, [n, 2, 3]."""
    first, second = before[:, 1] - before[:, 0], after[:, 1] - after[:, 0]
    sine = np.linalg.norm(np.cross(first, second), axis=1)
    return float(np.arctan2(sine, (first * second).sum(axis=1)).max())
