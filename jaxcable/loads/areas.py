"""Dead loads on the faces of a net: snow per plan area, cladding per surface."""

from __future__ import annotations

from typing import Literal

import jax.numpy as jnp
from jax.typing import DTypeLike

from ..common import checks
from ..common.tree import put, pytree
from ..common.types import Array, ArrayLike, Float, Int
from ..model.structure import Structure
from ..numerics import scaled
from . import faces as _faces
from .along import check_geometry, padded
from .load import Groups, Measured, OnEveryNode, Positions, States

PER = ("projected", "initial")


@pytree(static=("per", "geometry"), indices=("faces",))
class AreaLoads(Measured):
    """Dead loads per area; a third of the force on each triangle acts at each of its corners.

    The load is dead: the areas do not change while it acts. They are differentiable. `net_faces`
    finds the faces of a net.

    Args:
        faces: node numbers in order around each face, [n_face, 3] or [n_face, 4]. A quadrilateral
            is the mean of both ways to split it; a triangle among quadrilaterals repeats a node.
        forces: force per area, [3] or [n_face, 3], N/m2: snow is ``(0, 0, -s)``.
        per: the area that `forces` refer to: "projected", as seen along the force (plan area, for
            snow), or "initial", the surface itself. A zero force has no direction to project
            along: see `LineLoads`.
        factor: factor of the forces, without unit; default 1.
        geometry: the geometry of the areas: "input", that of the structure's nodes, or "begun",
            that at the beginning of the phase that adds the load, the form after prestress.

    Raises:
        ValueError: wrong shapes, a face of less than three nodes, an unknown `per` or `geometry`;
            where a phase is analysed, a node that the structure does not have.

    Example:
        Snow of 1 kN/m2 under wind that lifts with 0.4 kN/m2, on a net that spans 1.12 m2:

        >>> structure, _ = jc.scenes.flat_net()
        >>> faces = jc.net_faces(structure.nodes, structure.elements.links, border="ends")
        >>> snow, wind = jc.AreaLoads(faces, (0.0, 0.0, -1000.0)), jc.FacePressure(faces, 400.0)
        >>> solution = jc.solve(structure, jc.Phase(pretension=200.0, loads=[snow, wind]))
        >>> print(f"{jc.describe(solution.status)}: {solution.load[:, 2].sum():.3f} N")
        converged: -672.000 N
    """

    faces: Int[ArrayLike, "n_face 3or4"]
    forces: Float[ArrayLike, "... 3"]
    per: Literal["projected", "initial"] = "projected"
    factor: Float[ArrayLike, ""] = 1.0
    geometry: Literal["input", "begun"] = "input"
    begun: Float[Array, "n_row 3"] | None = (
        None  # nodes at the beginning of the phase, [n_row, 3], m; set by the analysis
    )

    scales = ("factor",)

    def __post_init__(self):
        put(self, faces=_faces.checked(self.faces))
        forces = checks.shaped(self.forces, "forces", (3,), (len(self.faces), 3))
        put(self, forces=forces, factor=checks.scalar(self.factor, "factor"))
        checks.one_of(self.per, "per", PER)
        check_geometry(self.geometry, self.per)

    def check(self, structure: Structure) -> None:
        """Raise ValueError if a node is unknown to the structure."""
        _faces.known(self.faces, structure)

    def element_forces(
        self,
        groups: Groups,
        states: States,
        nodes: Positions,
        shape: tuple[int, int],
        dtype: DTypeLike,
    ) -> OnEveryNode:
        """Force on every node, of `shape`, N."""
        corners = self.measured(nodes)[self.faces]
        per_area = jnp.broadcast_to(self.forces.astype(dtype), (len(corners), 3))
        total = jnp.zeros((shape[0], 3), dtype)
        for numbers, vector in _faces.area_vectors(corners):
            if self.per == "projected":
                along = jnp.abs(jnp.sum(vector * per_area, axis=-1))
                area = scaled.relative(along, scaled.length(per_area))
            else:
                area = scaled.length(vector)
            force = (area / 3)[:, None] * per_area
            for k in numbers:
                total = total.at[self.faces[:, k]].add(force)
        return padded(self.factor.astype(dtype) * total, shape)
