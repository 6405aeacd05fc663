"""Inner unknowns of a beam: degrees of freedom of an element beside the motion of its two ends.

An element whose section is not linear has inner unknowns for the strains along its axis
(`bending`), and for the mean shear angles if it is flexible in shear (`shear`); one whose ends
rotate against their nodes has inner unknowns for these rotations. They are stored in rows of motion
after those of the ends (`Structure.motion_rows`), at indices (row, column).
"""

from __future__ import annotations

import jax.numpy as jnp
import numpy as np

from ..common import checks
from ..common.tree import Indices, shared_or_stacked
from ..common.types import Array, ArrayLike, Bool, Float, Int
from ..sections import Section
from . import shear
from .abilities import Bending
from .element import Forces, Motion, Scalar
from .prestress import AxialState

# indices of a_1, a_2 and of b about y, z in the inner rows, by the number of these rows
_STRAIN_FIELD_INDICES = (), ((0, 0),), ((0, 0), (0, 1), (1, 0), (1, 1))


class InnerUnknowns(Bending):
    """Degrees of freedom of beams beside those of their two ends: indices and forces."""

    section: Section
    points: int
    hinges: Indices | None = None
    springs: Float[ArrayLike, "n_elem 2 3"] | None = None

    @property
    def inner_unknowns(self) -> tuple[tuple[int, int], ...]:  # type: ignore[override]  # read only
        """Indices of the inner unknowns of an element: pairs (row counted after the ends, column).

        Where the section is not linear they are the coefficients ``a_1 L, a_2 L`` of the axial
        strain and ``b L^2 / 32``, the deflection of the middle beyond the cubic (see `bending`);
        then the mean shear angles times the length (see `shear`). Semi-rigid connections have the
        rotation of each end against its node, times a length.
        """
        rows = self._n_strain_rows
        joints = () if self.springs is None else np.ndindex(2, 3)
        angles = (place for place, _ in self._shear_angle_indices)
        return (*self.strain_field_indices, *angles, *((rows + end, axis) for end, axis in joints))

    @property
    def strain_field_indices(self) -> tuple[tuple[int, int], ...]:
        """Indices (row, column) of those inner unknowns that describe strains along the axis."""
        return _STRAIN_FIELD_INDICES[self._n_strain_rows]

    @property
    def _shear_angle_indices(self) -> tuple[tuple[tuple[int, int], int], ...]:
        """Indices of the mean shear angles: pairs of (row, column) and 0 or 1 (about y or z).

        Empty if the section is linear, where they follow from the rotations of the ends, and if it
        is rigid in shear. They are in columns that strains along the axis leave free.
        """
        section, rows = shared_or_stacked(self.section), self._n_strain_rows
        flexible = [k for k, v in enumerate((section.GAz, section.GAy)) if v is not None]
        return tuple((((0, 1 + k) if rows == 1 else (k, 2)), k) for k in flexible if rows)

    @property
    def n_inner_row(self) -> int:  # type: ignore[override]  # read only
        """Number of rows of motion that an element has for its inner unknowns, after its ends."""
        return self._n_strain_rows + (0 if self.springs is None else 2)

    @property
    def _n_strain_rows(self) -> int:
        """Number of rows of motion for inner unknowns of strains along the axis.

        It is 0 if the section is linear, 1 with three integration points, else 2.
        """
        if shared_or_stacked(self.section).is_elastic:
            return 0
        return 1 if self.points < 4 else 2

    def unused_columns(self) -> Bool[np.ndarray, "n_elem n_inner_row 3"]:
        """Return which entries of the inner rows of motion of elements hold no unknown, bool."""
        count = len(self.links)
        idle = np.ones((count, self.n_inner_row, 3), bool)
        for (row, column), _ in self._shear_angle_indices:
            idle[:, row, column] = False
        for row, column in self.strain_field_indices:
            idle[:, row, column] = False
            if row == 1:  # fibres on one line do not resist bending along this line
                places = checks.array_if_known((self.section.z, self.section.y)[column])
                idle[:, row, column] = places is not None and np.ptp(places) == 0
        if self.springs is not None:
            idle[:, -2:] = ~self.hinges.array
        return idle

    def _strain_coefficients(self, motion: Motion, length: Scalar) -> Float[Array, "2 2"]:
        """Return the coefficients of the strain field from inner unknowns, [2, 2].

        They are the argument `inner` of `bending.strain_field` for a section that is not linear.
        `motion` has the inner unknowns in rows after those of both ends, in m; `length` is the
        unstressed length, m.
        """
        inner = jnp.zeros((2, 2), length.dtype)
        if self._n_strain_rows == 1:
            return inner.at[0, 0].set(motion[2, 0] / length)
        size = jnp.stack([length, length**2 / 32])
        return motion[2:4, :2] / size[:, None]

    def _shear_angles(
        self,
        motion: Motion,
        rotations: Float[Array, "2 3"],
        length: Scalar,
        load: Float[Array, " 3"] | None,
        stiffness: Float[Array, "3 3"] | None,
    ) -> shear.ShearAngles | None:
        """Return the `ShearAngles` of a beam, about y and z; None if it is rigid in shear.

        `motion` is that of the ends, with rows of inner unknowns; other arguments are as of
        `bending.strain_field`.
        """
        resists = shear.shear_stiffness(self.section, length.dtype)
        if resists is None:
            return None
        if stiffness is not None:
            return shear.shear_angles_of_linear_section(resists, stiffness, rotations, length, load)
        mean = jnp.zeros(2, length.dtype)
        for (row, column), about in self._shear_angle_indices:
            mean = mean.at[about].set(motion[2 + row, column] / length)
        return shear.shear_angles(resists, length, load, mean)

    def _hinge_rotations(self, state: AxialState, motion: Motion) -> Float[Array, "2 3"]:
        """Return the rotations of both ends against their nodes in semi-rigid connections, [2, 3].

        They are ``tan(angle / 4) axis``, along the initial axes of the element, which the nodes
        carry along.
        """
        return motion[-2:, :3] / (4 * state.rest_length)

    @property
    def _inner_indices(self) -> tuple[Int[np.ndarray, " k"], ...]:
        """Rows (counted after the two ends) and columns of the inner unknowns, two arrays [k]."""
        return tuple(np.array(self.inner_unknowns).T)

    def _expand_reduced_forces(self, force: Float[Array, " 9+k"]) -> Forces:
        """Return forces on rows of an element, [n_row, 6], from its 9 independent and k inner ones.

        `force` has the force on the second end, 3, the moments on both ends, 6, and the k forces
        conjugate to inner unknowns.
        """
        end_force, first, second, inner = jnp.split(force, [3, 6, 9])
        at = jnp.stack([jnp.concatenate([-end_force, first]), jnp.concatenate([end_force, second])])
        if not self.inner_unknowns:
            return at
        rows = jnp.zeros((self.n_inner_row, 6), force.dtype).at[self._inner_indices].set(inner)
        return jnp.concatenate([at, rows])

    def _join_end_forces(
        self, force: Float[Array, " 3"], moments: Float[Array, "2 3"], inner: Float[Array, " k"]
    ) -> Forces:
        """Join the force on the second end, N, the moments on both ends, N m, and inner forces.

        Return end forces, [n_end, 6], as `_expand_reduced_forces` does.
        """
        return self._expand_reduced_forces(jnp.concatenate([force, moments.ravel(), inner]))
