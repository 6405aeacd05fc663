"""The result of `transient`: histories of a motion, its energy, and the status of every step."""

from __future__ import annotations

from typing import ClassVar

from ..common.tree import Indices, pytree
from ..common.types import Array, Float, Int, PyTree
from .energy_balance import EnergyBalance


@pytree(indices=("nodes",))
class Transient:
    """A motion in time: the result of `transient`. Histories have a leading axis [steps + 1].

    Everything but the status is NaN, with NaN derivatives, from the first step that fails.

    Attributes:
        status: code of the first failure, or 0; `describe` has the texts.
        step_status: status after every step, [steps + 1].
        parts: number of parts into which each step was divided (`halvings`), [steps + 1].
        time: times, [steps + 1], s.
        energy: `EnergyBalance` with arrays [steps + 1], J.
        histories: histories by name, [steps + 1, ...]: those of nodes, and those of elements in the
            shape of `elements`.
        nodes: numbers of the nodes that the histories of nodes have, `Indices` [n]; None: all.

    Example:
        A mass of 2 kg on a bar of 8 kN/m, under 16 N all of a sudden: it goes to twice 2 mm.

        >>> bar = jc.Bars([[0, 1]], axial_stiffness=8e3)
        >>> guide = jc.pinned([0]) + jc.restrained([1], "yz")
        >>> structure = jc.Structure([[0.0, 0, 0], [1.0, 0, 0]], bar, supports=guide)
        >>> pull, period = jc.NodalLoads([1], (16.0, 0, 0)), 2 * np.pi * np.sqrt(2.0 / 8e3)
        >>> times = {"dt": period / 100, "steps": 100}
        >>> moved = jc.dynamics.transient(structure, pull, **times, masses=2.0)
        >>> print(moved.status, f"{1e3 * moved.displacement[:, 1, 0].max():.3f} mm")
        0 4.000 mm
        >>> print(f"{moved.energy.kinetic.max():.6f} J")  # F^2 / 2 k, of a linear spring
        0.016000 J
    """

    _shown: ClassVar[str] = "status, time s, histories"

    status: Int[Array, ""]
    step_status: Int[Array, " m"]
    parts: Int[Array, " m"]
    time: Float[Array, " m"]
    energy: EnergyBalance
    histories: dict[str, PyTree[Float[Array, "m ..."]]]
    nodes: Indices | None = None

    @property
    def displacement(self) -> Float[Array, "m n 3"]:
        """Displacements of the nodes from the initial ones, [steps + 1, n, 3], m."""
        return self._history("displacement")

    @property
    def velocity(self) -> Float[Array, "m n n_freedom"]:
        """Velocities of the nodes, [steps + 1, n, 3 or 6], m/s and rad/s.

        With a `base_acceleration` they, displacements and accelerations are against the ground.
        """
        return self._history("velocity")

    @property
    def acceleration(self) -> Float[Array, "m n n_freedom"]:
        """Accelerations of the nodes, [steps + 1, n, 3 or 6], m/s2 and rad/s2.

        Those of degrees of freedom without mass have no meaning.
        """
        return self._history("acceleration")

    @property
    def rotation(self) -> Float[Array, "m n 4"]:
        """Rotations of the nodes as unit quaternions, [steps + 1, n, 4]."""
        return self._history("rotation")

    @property
    def reactions(self) -> Float[Array, "m n n_freedom"]:
        """Reactions of the supports, [steps + 1, n, 3 or 6], N and N m."""
        return self._history("reactions")

    @property
    def tension(self) -> PyTree[Float[Array, "m n_elem"]]:
        """Axial forces in the shape of `elements`, each [steps + 1, n_elem], N."""
        return self._history("tension")

    def _history(self, name):
        """Return a history by name; ValueError if `transient` was not asked to keep it."""
        if name not in self.histories:
            raise ValueError(f"histories: has no {name!r}; ask for it by histories=[...]")
        return self.histories[name]
