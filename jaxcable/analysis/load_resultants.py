"""The resultant of a load: the sum of the forces that it puts on the nodes, for reports."""

from __future__ import annotations

from collections.abc import Sequence

import jax.numpy as jnp
import numpy as np

from ..common.tree import merge_indices, split_indices
from ..common.types import Bool, Float
from ..loads import Varying
from ..loads.load import DeadLoad, FollowerLoad, Load, OnNodes, PersistentLoad
from ..mechanics.restart_state import initial_restart_state
from ..model.structure import Structure
from ..programs.traced_function import evaluate_at_once


def load_resultants(
    structure: Structure,
    loads: Sequence[Load],
    present: Sequence[Bool[np.ndarray, " n_elem"]],
) -> Float[np.ndarray, "n_load 3"]:
    """Return the sum of the forces of each load in the geometry of the input, [n_load, 3], N.

    Of a `Varying` load it is that of the load by factor 1; movements of supports have none, NaN.

    Args:
        structure: `Structure`.
        loads: loads that fit it.
        present: which elements are active, per group [n_elem] bool.
    """
    rows, row_groups = structure.motion_rows()
    nodes = jnp.asarray(structure.nodes)
    nodes = nodes if rows is None else nodes[rows.node_of_row]
    bare = [load.load if isinstance(load, Varying) else load for load in loads]
    acting = [x.with_group_indices(structure) if isinstance(x, PersistentLoad) else x for x in bare]

    def sums(groups, acting, nodes, present):
        groups, acting = merge_indices(*split_indices((groups, acting)))
        states = [
            group.with_activation(state, there)
            for group, state, there in zip(
                groups, initial_restart_state(nodes, groups).states, present, strict=True
            )
        ]
        found = []
        for load in acting:
            forces = jnp.full((1, 3), jnp.nan)
            if isinstance(load, OnNodes):
                forces = load.nodal_forces((len(nodes), structure.space.n_freedom), nodes.dtype)
            elif isinstance(load, DeadLoad):
                shape = len(nodes), structure.space.n_freedom
                forces = load.element_forces(groups, states, nodes, shape, nodes.dtype)
            elif isinstance(load, FollowerLoad):
                forces = load.following_forces(groups, states, nodes, nodes)
            found.append(forces[:, :3].sum(axis=0))
        return jnp.stack(found)

    if not loads:
        return np.zeros((0, 3))
    return np.asarray(evaluate_at_once(sums, row_groups, acting, nodes, list(present)))
