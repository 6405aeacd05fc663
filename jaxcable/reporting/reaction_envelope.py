"""The table of the smallest and the largest reactions over load cases, component by component.

Foundations are designed for all components at once: beside each extreme are the others of the same
case.
"""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from ..common.negligible import NEGLIGIBLE
from ..model.structure import Structure
from .columns import envelope_columns
from .reactions import ground_rows, supported_components
from .states import EnvelopeState
from .table import Column, Table, make_table

_COMPONENTS = {"Rx": "N", "Ry": "N", "Rz": "N", "Mx": "N m", "My": "N m", "Mz": "N m"}


def reaction_envelope_table(
    structure: Structure, states: Mapping[str, EnvelopeState]
) -> dict[str, Table]:
    """Return the table ``reaction_envelope`` by name, or an empty dict without several cases.

    It has two rows for each component of each support, spring or bearing on the ground that is ever
    larger than rounding: the case
    in which it is smallest, and that in which it is largest, with all components of this case.

    Args:
        structure: `Structure`.
        states: the ends of the cases, by name.
    """
    if len(states) < 2:
        return {}
    held = [supported_components(structure, state.fixed) for state in states.values()]
    nodes = np.flatnonzero(np.any(held, axis=(0, 2)))
    ground = [ground_rows(structure, state.result) for state in states.values()]
    values = np.array(
        [
            np.vstack([_reactions(state.result, mask)[nodes], rows.values])
            for state, mask, rows in zip(states.values(), held, ground, strict=True)
        ]
    )  # [n_state, n, 6]
    sizes = np.nan_to_num(np.abs(values)).max(
        axis=0, initial=0.0
    )  # NaN: not supported in that direction
    limits = NEGLIGIBLE * np.repeat([sizes[:, :3].max(initial=0.0), sizes.max(initial=0.0)], 3)
    acts = sizes > limits
    names = np.concatenate([nodes, ground[0].nodes])
    by = ["support"] * len(nodes) + ground[0].names
    parts = [
        (place, component, sign)
        for place in range(len(names))
        for component in range(6)
        for sign in (-1, 1)
        if acts[place, component]
    ]
    if not parts:
        return {}
    place, component, sign = (np.array(part) for part in zip(*parts, strict=True))
    chosen = values[:, place]  # [n_state, n_part, 6]
    extreme = np.take_along_axis(chosen, component[None, :, None], axis=2)[..., 0]
    beside = [(name, unit, chosen[..., k]) for k, (name, unit) in enumerate(_COMPONENTS.items())]
    used = np.isfinite(values).any(axis=(0, 1))
    beside = [one for one, is_used in zip(beside, used, strict=True) if is_used]
    _, *others, when = envelope_columns("", "", sign * extreme, list(states), 1, beside)
    words = {-1: "min", 1: "max"}
    columns = [
        Column("node", "", names[place]),
        *([Column("by", "", [by[k] for k in place])] if len(ground[0].nodes) else []),
        Column(
            "extreme",
            "",
            [f"{words[s]} {list(_COMPONENTS)[k]}" for s, k in zip(sign, component, strict=True)],
        ),
        *others,
        when,
    ]
    title = "Smallest and largest reactions over all cases, with the other components"
    return {"reaction_envelope": make_table(title, columns)}


def _reactions(result, mask):
    """Return reactions of a state on all nodes, [n_node, 6], N and N m; NaN where not supported."""
    forces = np.asarray(result.reactions, float)
    moments = np.full_like(forces, np.nan)
    if result.reaction_moments is not None:
        moments = np.asarray(result.reaction_moments, float)
    return np.where(mask, np.hstack([forces, moments]), np.nan)
