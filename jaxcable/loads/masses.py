"""Weight of masses at nodes, which natural frequencies take into account as well."""

from __future__ import annotations

import jax.numpy as jnp
import numpy as np
from jax.typing import DTypeLike

from ..common import checks
from ..common.rules import Rule, nan_if_broken, not_negative, refuse_if_broken
from ..common.tree import Indices, apply_numpy_or_jax, pytree, set_fields
from ..common.types import Array, ArrayLike, Float, Int
from ..common.units import SI, Units
from ..model.structure import Structure
from .groups import scatter_to_nodes
from .load import OnEveryNode, OnNodes
from .nodal import NodalLoads, set_node_numbers

STANDARD_GRAVITY = 9.80665
"""Standard acceleration of gravity, m/s2."""


@pytree(indices=("nodes",))
class PointMasses(OnNodes):
    """Masses at nodes, such as antennas, platforms and cable clamps, with their weight as the load.

    The force on a node is ``mass gravity direction``. A `direction` such as (0.2, 0, 0) states an
    equivalent static acceleration of 0.2 g along x. The masses are points: they have no moments and
    no rotational inertia. `dynamics.modes` takes the object as its `masses`.

    Args:
        nodes: node numbers, [n]; masses add if a node is named more than once.
        masses: one mass for each of the nodes, scalar or [n], kg.
        direction: direction and factor of the weight, [3], without unit; default (0, 0, -1), once
            downwards.
        gravity: acceleration of gravity, m/s2; default 9.80665.

    Raises:
        ValueError: wrong shapes, negative masses (traced ones fail the analysis); where a phase is
            analysed, a node that the structure does not have.

    Example:
        A seconds pendulum of 2 kg, ``sqrt(g / l) / 2 pi`` = 1/2 Hz, stiff by its weight:

        >>> length = 9.80665 / np.pi**2  # m
        >>> rope = jc.Cables([[0, 1]], axial_stiffness=1e6)
        >>> structure = jc.Structure([[0.0, 0, 0], [0, 0, -length]], rope, supports=jc.pinned([0]))
        >>> bob = jc.PointMasses([1], 2.0)
        >>> solution = jc.solve(structure, jc.Phase(pretension=2 * 9.80665, loads=bob))
        >>> found = jc.dynamics.modes(structure, solution, n=2, masses=bob)
        >>> print(solution.status, jnp.round(found.frequency, 6))  # Hz, in x and in y
        0 [0.5 0.5]
    """

    nodes: Int[ArrayLike, " n"]
    masses: Float[ArrayLike, ""] | Float[ArrayLike, " n"]
    direction: Float[ArrayLike, " 3"] = (0.0, 0.0, -1.0)
    gravity: Float[ArrayLike, ""] = STANDARD_GRAVITY

    scales = ("direction",)

    def __post_init__(self):
        set_node_numbers(self, "load nodes")
        set_fields(
            self,
            masses=checks.floats_of_shape(self.masses, "masses", (), (len(self.nodes),)),
            direction=checks.floats_of_shape(self.direction, "direction", (3,)),
            gravity=checks.as_scalar(self.gravity, "gravity"),
        )
        refuse_if_broken(self.rules())

    def rules(self) -> list[Rule]:
        """Return the rule that masses are not negative, a list of one `Rule`."""
        return [not_negative("masses", self.masses)]

    def check(self, structure: Structure) -> None:
        """Raise ValueError if a node is unknown to the structure."""
        checks.require_known_nodes(self.nodes.array, structure.n_node, "load nodes")

    @property
    def has_moments(self) -> bool:
        """Whether the load has moments: never."""
        return False

    def nodal_masses(self, n_node: int) -> Float[Array, " n_node"]:
        """Return the masses of all nodes of a structure, [n_node], kg; NaN if one is negative."""
        masses = jnp.asarray(nan_if_broken(self.rules()[0]))
        return jnp.zeros(n_node, masses.dtype).at[self.nodes.array].add(masses)

    def as_nodal_loads(self) -> NodalLoads:
        """Return the weights as `NodalLoads`; NaN where a traced mass is negative."""
        return NodalLoads(self.nodes, self._weights())

    def forces_at_nodes(self) -> tuple[Indices, Float[ArrayLike, "n 3"]]:
        """Return nodes [n] and the forces on them, [n, 3], N."""
        return self.nodes, self._weights()

    def nodal_forces(self, shape: tuple[int, int], dtype: DTypeLike) -> OnEveryNode:
        """Return the weights ``mass gravity direction``, N, of all nodes, and no moments.

        `shape` is that of the result, (n_node, 3 or 6).
        """
        return scatter_to_nodes(self.nodes, (self._weights(), None), shape, dtype)

    def _weights(self):
        """Return the forces on the nodes of the load, [n, 3], N; NumPy unless one is traced."""
        masses = nan_if_broken(self.rules()[0])
        masses = apply_numpy_or_jax(lambda xp, x: xp.broadcast_to(x, (len(self.nodes),)), masses)
        return masses[:, None] * (self.gravity * self.direction)[None, :]

    def describe(self, units: Units = SI) -> str:
        """Return the number of nodes and the sum of the masses, in `units`, as text."""
        masses = checks.array_if_known(self.masses)
        if masses is None:
            return "PointMasses"
        total = np.broadcast_to(masses, (len(self.nodes),)).sum()
        count = f"{len(self.nodes)} node" + "s" * (len(self.nodes) != 1)
        return f"PointMasses on {count}, sum {units.text(total, 'kg')}"
