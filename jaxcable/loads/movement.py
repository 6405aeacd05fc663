"""Prescribed movement of supports."""

from __future__ import annotations

import numpy as np
from jax.typing import DTypeLike

from ..common import checks
from ..common.tree import pytree, set_fields
from ..common.types import ArrayLike, Float, Int
from ..model import plausibility
from ..model.structure import Structure
from ..model.supports import FixedDofs
from .groups import scatter_to_nodes
from .load import VECTOR_HINT, OnEveryNode, PrescribedMovement
from .nodal import require_rotations, set_node_numbers, set_vectors


@pytree(indices=("nodes",))
class SupportMovement(PrescribedMovement):
    """Displacement of supports, by increments, from their positions at the beginning of the phase.

    A turn of more than pi, which is most likely in degrees, is an `InputWarning`.

    Args:
        nodes: node numbers, [n].
        displacements: [3] or [n, 3], m, along freedoms held in the phase; None if nodes only turn.
        rotations: rotation vectors [3] or [n, 3], rad (not degrees), of clamped nodes; default
            none.

    Raises:
        ValueError: wrong shapes; where a phase is analysed, an unknown node, a displacement along a
            freedom that is not held, or a rotation of a node that is not clamped.

    Example:
        Two ropes of 1 m in a line, one end of which is pulled by 10 mm, 5 mm for each of them:

        >>> nodes = [[0.0, 0.0, 0.0], [1.0, 0.0, 0.0], [2.0, 0.0, 0.0]]
        >>> ropes = jc.Cables([[0, 1], [1, 2]], axial_stiffness=1e5)
        >>> structure = jc.Structure(nodes, ropes, supports=jc.pinned([0, 2]))
        >>> pull = jc.SupportMovement([2], (0.01, 0.0, 0.0))
        >>> solution = jc.solve(structure, jc.Phase(loads=pull))
        >>> print(solution.status, solution.tension.round(6), solution.displacement[:, 0].round(6))
        0 [500. 500.] [0.    0.005 0.01 ]
    """

    nodes: Int[ArrayLike, " n"]
    displacements: Float[ArrayLike, "... 3"] | None
    rotations: Float[ArrayLike, "... 3"] | None = None

    scales = ("displacements", "rotations")

    def __post_init__(self):
        set_node_numbers(self, "moved nodes")
        if self.displacements is None:
            set_fields(self, displacements=(0.0, 0.0, 0.0))
        set_vectors(self, ("displacements", "rotations"), len(self.nodes), VECTOR_HINT)
        turn = checks.array_if_known(self.rotations)
        if turn is not None:
            plausibility.warn_of_degrees("rotations", turn)

    def check(self, structure: Structure) -> None:
        """Raise ValueError for an unknown node, or rotations of a node that has none."""
        checks.require_known_nodes(self.nodes.array, structure.n_node, "moved nodes")
        if self.rotations is not None:
            require_rotations(structure, self.nodes.array, "rotations")

    def check_supported(self, fixed: FixedDofs) -> None:
        """Raise ValueError if a moved degree of freedom is not held by `fixed`, the supports.

        It is not known which components of a traced movement are zero: here only nodes without any
        support are refused; a free component that moves ends in NONFINITE (see
        `mechanics.load_ramp`).
        """
        held = fixed.array[self.nodes.array]
        moves = checks.array_if_known(self.displacements)
        for k, node in enumerate(self.nodes.array):
            if moves is None:
                free = ~held[k, :3] & ~held[k, :3].any()
            else:
                move = np.broadcast_to(moves, (len(held), 3))[k]
                if fixed.axes is not None:
                    size = np.abs(move).max()
                    move = fixed.axes.array[node] @ move
                    move = np.where(np.abs(move) <= 1e-15 * size, 0.0, move)
                free = (move != 0) & ~held[k, :3]
            if free.any():
                where = "xyz"[int(free.argmax())]
                skew = fixed.axes is not None and (fixed.axes.array[node] != np.eye(3)).any()
                raise ValueError(
                    f"displacements[{k}]: node {node} is free along "
                    f"{'its own ' if skew else ''}{where}; only what is held can be moved"
                )
            if self.rotations is not None and not held[k, 3:].all():
                raise ValueError(
                    f"rotations[{k}]: node {node} is not clamped; only a node whose three "
                    "rotations are held can be rotated"
                )

    def nodal_movements(self, shape: tuple[int, int], dtype: DTypeLike) -> OnEveryNode:
        """Return displacements and rotation vectors of all nodes in an array of `shape`, m, rad."""
        return scatter_to_nodes(self.nodes, (self.displacements, self.rotations), shape, dtype)
