"""Inner unknowns of a beam: degrees of freedom of an element beside the motion of its two ends.

An element whose section is not linear has inner unknowns for the strains along its axis
(`bending`); one whose ends rotate against their nodes has inner unknowns for its joints. They are
stored in rows of motion after those of the ends (`Structure.motion_rows`), at indices (row,
column).
"""

from __future__ import annotations

import jax.numpy as jnp
import numpy as np

from ..common.tree import shared_or_stacked
from ..common.types import Array, ArrayLike, Float, Int
from ..sections import Section
from .abilities import Bending
from .element import Forces, Motion
from .prestress import AxialState

# indices of a_1, a_2 and of b about y, z in the inner rows, by the number of these rows
_STRAIN_FIELD_INDICES = (), ((0, 0),), ((0, 0), (0, 1), (1, 0), (1, 1))


class InnerUnknowns(Bending):
    """Degrees of freedom of beams beside those of their two ends: indices and forces."""

    section: Section
    points: int
    springs: Float[ArrayLike, "n_elem 2 3"] | None = None

    @property
    def inner_unknowns(self) -> tuple[tuple[int, int], ...]:  # type: ignore[override]  # read only
        """Indices of the inner unknowns of an element: pairs (row after the ends, column).

        Where the section is not linear they are the coefficients ``a_1 L, a_2 L`` of the axial
        strain and ``b L^2 / 32``, the deflection of the middle beyond the cubic (see `bending`).
        Joints have the rotation of each end, times a length.
        """
        rows = self._n_strain_rows
        joints = () if self.springs is None else np.ndindex(2, 3)
        return (*self.strain_field_indices, *((rows + end, axis) for end, axis in joints))

    @property
    def strain_field_indices(self) -> tuple[tuple[int, int], ...]:
        """Indices (row, column) of those inner unknowns that describe strains along the axis."""
        return _STRAIN_FIELD_INDICES[self._n_strain_rows]

    @property
    def n_inner_row(self) -> int:  # type: ignore[override]  # read only
        """Number of rows that the inner unknowns of an element take in its motion."""
        return self._n_strain_rows + (0 if self.springs is None else 2)

    @property
    def _n_strain_rows(self) -> int:
        """Number of rows for strains along the axis: 0 if linear, 1 with three points, else 2."""
        if shared_or_stacked(self.section).is_elastic:
            return 0
        return 1 if self.points < 4 else 2

    def _joint_rotations(self, state: AxialState, motion: Motion) -> Float[Array, "2 3"]:
        """Return rotations of the ends against their nodes, as ``tan(angle / 4) axis``, [2, 3]."""
        return motion[-2:, :3] / (4 * state.rest_length)

    @property
    def _inner_indices(self) -> tuple[Int[np.ndarray, " k"], ...]:
        """Rows (counted after the two ends) and columns of the inner unknowns, two arrays [k]."""
        return tuple(np.array(self.inner_unknowns).T)

    def _expand_reduced_forces(self, force: Float[Array, " 9+k"]) -> Forces:
        """Return end forces, [n_end, 6], from force on the second end, moments, inner: [9 + k]."""
        pull, first, second, inner = jnp.split(force, [3, 6, 9])
        at = jnp.stack([jnp.concatenate([-pull, first]), jnp.concatenate([pull, second])])
        if not self.inner_unknowns:
            return at
        rows = jnp.zeros((self.n_inner_row, 6), force.dtype).at[self._inner_indices].set(inner)
        return jnp.concatenate([at, rows])

    def _join_end_forces(
        self, pull: Float[Array, " 3"], moments: Float[Array, "2 3"], inner: Float[Array, " k"]
    ) -> Forces:
        """Return end forces, [n_end, 6], from force on the second end, moments, inner forces."""
        return self._expand_reduced_forces(jnp.concatenate([pull, moments.ravel(), inner]))
