"""Dead forces and moments on nodes."""

from __future__ import annotations

import dataclasses
from collections.abc import Sequence
from typing import Any

import numpy as np
from jax.typing import DTypeLike

from ..common import checks
from ..common.negligible import NEGLIGIBLE, vector_text, zero_negligible
from ..common.tree import Indices, pytree, set_fields
from ..common.types import ArrayLike, Float, Int
from ..common.units import SI, Units
from ..model.structure import Structure
from .groups import scatter_to_nodes
from .load import VECTOR_HINT, OnEveryNode, OnNodes


def set_node_numbers(load: Any, name: str) -> None:
    """Convert the field `nodes` of a load to `Indices`; `name` is what messages call it."""
    if not isinstance(load.nodes, Indices):
        set_fields(load, nodes=Indices(checks.as_indices(load.nodes, name)))


def set_vectors(load: Any, names: Sequence[str], count: int, hint: str) -> None:
    """Convert fields `names` of a load to floats, [3] or [count, 3]; a None by default may stay.

    Raises ValueError for other shapes, with `hint` at the end of its message.
    """
    defaults = {field.name: field.default for field in dataclasses.fields(load)}
    for name in names:
        value = getattr(load, name)
        if value is not None or defaults[name] is not None:
            vectors = checks.floats_of_shape(value, name, (3,), (count, 3), hint=hint)
            set_fields(load, **{name: vectors})


def require_rotations(structure: Structure, nodes: Int[np.ndarray, " n"], name: str) -> None:
    """Raise ValueError for a node without rotation; `name` is the argument that turns nodes."""
    rotating = structure.rotating_nodes()[nodes]
    if not rotating.all():
        node = nodes[int((~rotating).argmax())]
        raise ValueError(f"{name}: node {node} has no rotation: no beam is joined to it rigidly")


@pytree(indices=("nodes",))
class NodalLoads(OnNodes):
    """Dead forces on nodes.

    Args:
        nodes: node numbers, [n]; forces add if a node is named more than once.
        forces: one force for each of the nodes, [3], or [n, 3], N.
        moments: moments [3] or [n, 3], N m, on nodes that a beam is joined to rigidly. They keep
            their direction in space; such moments have no potential (unless the nodes can only turn
            about one axis) and make the tangent unsymmetric.

    Raises:
        ValueError: wrong shapes; where a phase is analysed, a node that the structure does not
            have, or a moment on a node without rotation.

    Example:
        >>> nodes = [[-4.0, 0.0, 3.0], [0.0, 0.0, 0.0], [4.0, 0.0, 3.0]]
        >>> cables = jc.Cables([[0, 1], [1, 2]], axial_stiffness=1e5)
        >>> structure = jc.Structure(nodes, cables, supports=jc.pinned([0, 2]))
        >>> weight = jc.NodalLoads([1], (0.0, 0.0, -600.0))
        >>> solution = jc.solve(structure, jc.Phase(pretension=500.0, loads=weight))
        >>> print(solution.status, solution.load[1], jnp.round(solution.reactions[2], 6))
        0 [   0.    0. -600.] [400.   0. 300.]
    """

    nodes: Int[ArrayLike, " n"]
    forces: Float[ArrayLike, "... 3"]
    moments: Float[ArrayLike, "... 3"] | None = None

    scales = ("forces", "moments")

    def __post_init__(self):
        set_node_numbers(self, "load nodes")
        set_vectors(self, ("forces", "moments"), len(self.nodes), VECTOR_HINT)

    def forces_at_nodes(self) -> tuple[Indices, Float[ArrayLike, "... 3"]]:
        """Return nodes [n] and the forces on them, [3] or [n, 3], N."""
        return self.nodes, self.forces

    @property
    def has_moments(self) -> bool:
        """Whether the load has moments."""
        return self.moments is not None

    def check(self, structure: Structure) -> None:
        """Raise ValueError if a node is unknown to the structure."""
        checks.require_known_nodes(self.nodes.array, structure.n_node, "load nodes")
        if self.moments is not None:
            require_rotations(structure, self.nodes.array, "moments")

    def describe(self, units: Units = SI) -> str:
        """Return the number of loads and their sum, in `units`, as text.

        Where they balance each other in part, so that a load is larger than the sum, it is given.
        """
        forces = checks.array_if_known(self.forces)
        if forces is None:
            return "NodalLoads"
        forces = np.broadcast_to(forces, (len(self.nodes), 3))
        largest = np.linalg.norm(forces, axis=1).max(initial=0.0)
        total, unit, single = zero_negligible(forces.sum(axis=0), largest), units.name("N"), ""
        if largest > np.linalg.norm(total) * (1.0 + NEGLIGIBLE):
            single = f"up to {units.from_si(largest, 'N'):.6g} {unit}, "
        count = f"{len(self.nodes)} node" + "s" * (len(self.nodes) != 1)
        return f"NodalLoads on {count}, {single}sum {vector_text(units.from_si(total, 'N'))} {unit}"

    def nodal_forces(self, shape: tuple[int, int], dtype: DTypeLike) -> OnEveryNode:
        """Return forces, N, and moments, N m, on all nodes, in an array of `shape` (n, 3 or 6)."""
        return scatter_to_nodes(self.nodes, (self.forces, self.moments), shape, dtype)
