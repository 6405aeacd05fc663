"""Dead loads on faces, of a net or of surfaces: snow per plan area, cladding per surface."""

from __future__ import annotations

from typing import Literal

import jax.numpy as jnp

from ..common import checks
from ..common.selection import Selection
from ..common.tree import pytree, set_fields
from ..common.types import Array, ArrayLike, Float, Int
from ..numerics import scaled
from .along import require_known_geometry
from .faces import OnFaces, area_vectors
from .groups import Key
from .load import ForceOnlyLoad, LoadPerGeometry

AREA_REFERENCES = ("projected", "initial")


@pytree(static=("per", "geometry", "on"), indices=("faces",))
class AreaLoads(OnFaces, ForceOnlyLoad, LoadPerGeometry):
    """Dead loads per area; a third of the force on each triangle acts at each of its corners.

    The load is dead: the areas do not change while it acts. They are differentiable. `net_faces`
    finds the faces of a net. The load on a group acts on elements whenever they are there
    (`Phase`), as with `LineLoads`; that on `faces` always.

    Args:
        faces: node numbers in order around each face, [n_face, 3] or [n_face, 4]. A quadrilateral
            is the mean of both ways to split it; a triangle among quadrilaterals repeats a node.
            None for the faces of groups whose elements have some, such as membranes of your own.
        forces: force per area, [3] or [n_face, 3], N/m2: snow is ``(0, 0, -s)``. Of a group
            [n_elem, 3], one for each of its elements.
        per: the area that `forces` refer to: "projected", as seen along the force (plan area, for
            snow), or "initial", the surface itself. A zero force has no direction to project
            along: see `LineLoads`.
        factor: factor of the forces, without unit; default 1.
        geometry: the geometry of the areas: "input", that of the structure's nodes, or "begun",
            that at the beginning of the phase that adds the load, the form after prestress.
        on: key of the group whose faces are loaded, such as "membrane", or its place from 0 where
            these are a list; None loads `faces`, or without them all groups that have faces.
        elements: `Selection` of the elements of that group that are loaded; None loads all.

    Raises:
        ValueError: wrong shapes, a face of less than three nodes, both `faces` and a group, an
            unknown `per` or `geometry`; where a phase is analysed, a node, group or element that
            the structure does not have, or a group without faces.

    Example:
        Snow of 1 kN/m2 under wind that lifts with 0.4 kN/m2, on a net that spans 1.12 m2:

        >>> structure, _ = jc.scenes.flat_net()
        >>> faces = jc.net_faces(structure.nodes, structure.elements.links, border="ends")
        >>> snow, wind = jc.AreaLoads(faces, (0.0, 0.0, -1000.0)), jc.FacePressure(faces, 400.0)
        >>> solution = jc.solve(structure, jc.Phase(pretension=200.0, loads=[snow, wind]))
        >>> print(f"{jc.describe(solution.status)}: {solution.load[:, 2].sum():.3f} N")
        converged: -672.000 N
    """

    faces: Int[ArrayLike, "n_face 3or4"] | None = None
    forces: Float[ArrayLike, "... 3"] = None
    per: Literal["projected", "initial"] = "projected"
    factor: Float[ArrayLike, ""] = 1.0
    geometry: Literal["input", "begun"] = "input"
    on: Key = None
    elements: Selection | None = None
    begin_nodes: Float[Array, "n_row 3"] | None = (
        None  # nodes at the beginning of the phase, [n_row, 3], m; set by the analysis
    )
    element_factors: dict[int, Float[Array, "n_elem ..."]] | None = (
        None  # by index of group: factors of the forces on each element; set by the analysis
    )

    scales = ("factor",)
    varies = ("forces", (3,))

    def __post_init__(self):
        self._check_faces()
        set_fields(self, factor=checks.as_scalar(self.factor, "factor"))
        checks.require_one_of(self.per, "per", AREA_REFERENCES)
        require_known_geometry(self.geometry, self.per)

    def _sum_forces(self, groups, states, nodes, dtype):
        """Return the forces on all nodes, [n_row, 3], N; `nodes` are their initial positions, m."""
        total = jnp.zeros((len(nodes), 3), dtype)
        for faces, per_area in self._faces_and_values(groups, states, dtype):
            for numbers, vector in area_vectors(self.measuring_positions(nodes)[faces]):
                if self.per == "projected":
                    along = jnp.abs(jnp.sum(vector * per_area, axis=-1))
                    area = scaled.relative_residual(along, scaled.safe_norm(per_area))
                else:
                    area = scaled.safe_norm(vector)
                force = (area / 3)[:, None] * per_area
                for k in numbers:
                    total = total.at[faces[:, k]].add(force)
        return self.factor.astype(dtype) * total
