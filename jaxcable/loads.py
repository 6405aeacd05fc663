"""What acts on a structure in a phase.

Nodal loads are dead: they keep direction and follow their node. Element loads (self-weight) are
evaluated from the state of the elements and go on acting in later phases.
"""

import jax.numpy as jnp

from . import _check
from ._tree import Indices, pytree


@pytree(indices=("nodes",))
class NodalLoads:
    """Dead forces on nodes.

    Args:
        nodes: node numbers, [n]; a node may be named more than once, its forces add.
        forces: one force [3] for each of them, or [n, 3], N.
        moments: for nodes with rotations; no element has them yet, so it must be None.
    """

    nodes: object
    forces: object
    moments: object = None

    def __post_init__(self):
        if not isinstance(self.nodes, Indices):
            object.__setattr__(self, "nodes", Indices(_check.integers(self.nodes, "load nodes")))
        forces = _check.floats(self.forces, "forces")
        if forces.shape not in ((3,), (len(self.nodes), 3)):
            raise ValueError(
                f"forces: expected shape (3,) or ({len(self.nodes)}, 3), got {forces.shape}"
            )
        object.__setattr__(self, "forces", forces)
        if self.moments is not None:
            raise ValueError("moments: must be None; no element of the structure has rotations")

    def check(self, structure):
        """Raise ValueError if a node is unknown to the structure."""
        unknown = self.nodes.array >= structure.n_node
        if unknown.any():
            k = int(unknown.argmax())
            raise ValueError(
                f"load nodes[{k}] = {self.nodes[k]}: "
                f"the structure has nodes 0 to {structure.n_node - 1}"
            )

    def nodal_forces(self, n_node, dtype):
        """Force on every node, [n_node, 3], N."""
        each = jnp.broadcast_to(self.forces.astype(dtype), (len(self.nodes), 3))
        return jnp.zeros((n_node, 3), dtype).at[self.nodes].add(each)


@pytree
class SelfWeight:
    """Self-weight of every group that has `weight`, half of each element to each end.

    The weight is that of the current unstressed length; a jack leaves it as it was when it began to
    pull, so that anchoring it moves nothing.

    Args:
        direction: direction and factor, [3]; (0, 0, -1) is once the weight downwards.
    """

    direction: object = (0.0, 0.0, -1.0)

    def __post_init__(self):
        direction = _check.floats(self.direction, "direction")
        if direction.shape != (3,):
            raise ValueError(f"direction: expected shape (3,), got {direction.shape}")
        object.__setattr__(self, "direction", direction)

    def check(self, structure):
        """Raise ValueError if no group has a weight."""
        if all(getattr(group, "weight", None) is None for group in structure.groups):
            raise ValueError("SelfWeight: no element group has a weight; give weight=... in N/m")

    def nodal_forces(self, groups, states, n_node, dtype):
        """Force on every node, [n_node, 3], N, for the given element states."""
        total = jnp.zeros(n_node, dtype)
        for group, state in zip(groups, states, strict=True):
            if group.weight is not None:
                total = total.at[group.links].add(group.weight_at_ends(state))
        return jnp.outer(total, self.direction.astype(dtype))


def as_list(loads):
    """Loads of a phase as a list: None, one load, or a list or tuple of loads."""
    if loads is None:
        return []
    items = list(loads) if isinstance(loads, list | tuple) else [loads]
    for k, load in enumerate(items):
        if not hasattr(load, "nodal_forces"):
            raise ValueError(f"loads[{k}]: {type(load).__name__} is not a load")
    return items
