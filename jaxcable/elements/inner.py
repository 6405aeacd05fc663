"""Inner numbers of a beam: unknowns of an element beside the motion of its two ends.

An element whose section is not linear has inner numbers for the field of its section (`bending`);
one whose ends turn against their nodes has inner numbers for its joints. They are stored in rows of
motion after those of the ends (`Structure.rows`), each at an index (row, column).
"""

from __future__ import annotations

import jax.numpy as jnp
import numpy as np

from ..common.tree import template_of
from ..common.types import Array, ArrayLike, Float, Int
from ..sections import Section
from .abilities import Bending
from .element import Forces, Motion
from .prestress import AxialState

# indices of a_1, a_2 and of b about y, z among the inner rows, by the number of these rows
_FIELD = (), ((0, 0),), ((0, 0), (0, 1), (1, 0), (1, 1))


class Inner(Bending):
    """Inner numbers of beams (`beam.Beams`): their indices, and the forces at them."""

    section: Section
    points: int
    springs: Float[ArrayLike, "n_elem 2 3"] | None = None

    @property
    def inner(self) -> tuple[tuple[int, int], ...]:  # type: ignore[override]  # read only
        """Indices of the inner numbers as (row after the ends, column), a tuple.

        A section that is not linear has ``a_1 L, a_2 L`` and ``b L^2 / 32``, the deflection of the
        middle beyond the cubic. Joints have the rotation of each end, times a length.
        """
        rows = self._n_field_row
        joints = () if self.springs is None else np.ndindex(2, 3)
        return (*self.field_places, *((rows + end, axis) for end, axis in joints))

    @property
    def field_places(self) -> tuple[tuple[int, int], ...]:
        """Indices of the inner numbers for the field of the section."""
        return _FIELD[self._n_field_row]

    @property
    def n_inner_row(self) -> int:  # type: ignore[override]  # read only
        """Rows of motion that an element uses for its inner numbers."""
        return self._n_field_row + (0 if self.springs is None else 2)

    @property
    def _n_field_row(self) -> int:
        """Rows for the field of the section; three integration points cannot resolve P2."""
        if template_of(self.section).is_elastic:
            return 0
        return 1 if self.points < 4 else 2

    def _joints(self, state: AxialState, motion: Motion) -> Float[Array, "2 3"]:
        """Rotations of the ends against their nodes, ``tan(angle / 4) axis``, [2, 3]."""
        return motion[-2:, :3] / (4 * state.rest_length)

    @property
    def _places(self) -> tuple[Int[np.ndarray, " k"], ...]:
        """Rows and columns of the inner numbers, counted from the row after the two ends."""
        return tuple(np.array(self.inner).T)

    def _spread(self, force: Float[Array, " 9+k"]) -> Forces:
        """Forces [9 + k], as of `Member._step`, at the ends and inner rows, [n_end, 6]."""
        pull, first, second, inner = jnp.split(force, [3, 6, 9])
        at = jnp.stack([jnp.concatenate([-pull, first]), jnp.concatenate([pull, second])])
        if not self.inner:
            return at
        rows = jnp.zeros((self.n_inner_row, 6), force.dtype).at[self._places].set(inner)
        return jnp.concatenate([at, rows])

    def _joined(
        self, pull: Float[Array, " 3"], moments: Float[Array, "2 3"], inner: Float[Array, " k"]
    ) -> Forces:
        return self._spread(jnp.concatenate([pull, moments.ravel(), inner]))
