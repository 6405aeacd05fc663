"""`Space`: what a `System` needs to know about the motion of its nodes.

The *motion* of a row (a node, or a row of an element, see `freedoms`) begins with its displacement.
Forces on a row, and steps of a row, begin with three numbers along x, y, z. The point ``x`` of an
iteration is the motion of all rows, [n_row, n_motion] (of nets with a fine part, see
`translations`). A *step* [n_free] from ``x`` has a number for every unknown, all of them lengths.
It is *spread* to a step of every row, [n_row, n_freedom], which moves ``x``. Forces on rows are
*collected* at the unknowns, by the work that they do on such a step.
"""

from __future__ import annotations

import abc
from collections.abc import Callable, Sequence
from typing import ClassVar, Protocol, Self, TypeAlias

import jax
import jax.numpy as jnp
import numpy as np

from ..common.tree import pytree
from ..common.types import Array, ArrayLike, Float, Int
from ..linear.pattern import Sparse
from .freedoms import Freedoms, along, combined

Motion: TypeAlias = 'Float[Array, "n_row n_motion"]'
"""Motion of all rows: the point of an iteration."""
Forces: TypeAlias = 'Float[Array, "n_row n_freedom"]'
"""Forces on all rows, or a step of all rows."""
Step: TypeAlias = 'Float[Array, " n_free"]'
"""A number for every unknown."""
Part: TypeAlias = 'tuple[Float[Array, "n_elem d d"], Int[ArrayLike, "n_elem d"]]'
"""Matrices of elements, and the numbers of the unknowns of their lines and columns."""
Matrix: TypeAlias = 'Float[Array, "n_free n_free"] | Sparse'


class Group(Protocol):
    """What a space needs of an element group, see `elements.element.Element`."""

    links: Int[ArrayLike, "n_elem n_end"]
    rotates: bool

    def chord(self, ends: Float[Array, "n_elem n_end 3"]) -> Float[Array, " n_elem"]:
        """Distance of the first two ends, m."""


@pytree
class Space(abc.ABC):
    """The motions that supports allow.

    Attributes:
        freedoms: `Freedoms`, the numbering of the unknowns.
        prescribed: prescribed motion of all rows, [n_row, n_motion], used where supports hold them;
            None where supports are not needed.
        n_motion, n_freedom: how many numbers the motion of a row has, and a force on a row.
        rotates: whether nodes have rotations.
        symmetric: whether the tangent is symmetric under all dead loads.
    """

    freedoms: Freedoms
    prescribed: Motion | None

    n_motion: ClassVar[int] = 3
    n_freedom: ClassVar[int] = 3
    rotates: ClassVar[bool] = False
    symmetric: ClassVar[bool] = True

    # --- motions

    @classmethod
    @abc.abstractmethod
    def of(
        cls,
        nodes: Float[Array, "n_row 3"],
        groups: Sequence[Group],
        freedoms: Freedoms,
        prescribed: Motion | None,
        bearing: Float[Array, "n_row 4"] | None,
    ) -> Self:
        """The space of a system; `bearing` as of `ramp.Carry`."""

    @classmethod
    @abc.abstractmethod
    def still(cls, nodes: Float[Array, "n_row 3"]) -> Motion:
        """Motion of rows [n_row, 3] that have not moved."""

    @classmethod
    @abc.abstractmethod
    def advanced(cls, motion: Motion, step: Forces) -> Motion:
        """Motion after a step of any size, [n_row, n_freedom]."""

    @classmethod
    @abc.abstractmethod
    def between(cls, before: Motion, after: Motion) -> Forces:
        """Displacement, and rotation vector, from one motion to another, [n_row, n_freedom]."""

    @classmethod
    @abc.abstractmethod
    def borne(cls, motion: Motion, arm: Float[Array, "n_row 3"]) -> Motion:
        """Motion of rows that are joined rigidly to others, by arms from these [n_row, 3], m.

        `motion` is that of the others.
        """

    @classmethod
    def rotations(cls, motion: Motion) -> Float[Array, "n_row 4"] | None:
        """Rotations of all rows, unit quaternions [n_row, 4]; None if there are none."""
        return None

    @classmethod
    def moments(cls, force: Float[Array, "... n_freedom"]) -> Float[Array, "... 3"] | None:
        """Moments in forces [..., n_freedom], [..., 3], N m; None if there are none."""
        return None

    @classmethod
    def kept(
        cls, motion: Float[Array, "n_inc n_row n_motion"]
    ) -> Float[Array, "n_inc n_row n_motion"] | None:
        """Motions [n_inc, n_row, n_motion] that a path stores beside displacements, or None."""
        return None

    @classmethod
    def padded(cls, force: Float[Array, "... n"]) -> Float[Array, "... n_freedom"]:
        """Forces [..., 3] or [..., n_freedom], with zeros for missing moments."""
        missing = [(0, 0)] * (force.ndim - 1) + [(0, cls.n_freedom - force.shape[-1])]
        return jnp.pad(force, missing) if missing[-1][1] else force

    # --- points and steps

    @property
    def _prescribed(self) -> Motion:
        """`prescribed`, where it is not None."""
        return self.prescribed  # type: ignore[return-value]  # asked where it is

    def place(self, x: Motion) -> Motion:
        """`x` with the freedoms that supports hold put to their prescribed values."""
        return self._supported(x[:, :3])

    def _supported(self, displacement: Float[Array, "n_row 3"]) -> Float[Array, "n_row 3"]:
        fixed, axes = self.freedoms.fixed[:, :3], self.freedoms.axes
        prescribed = self._prescribed[:, :3]
        if axes is None:
            return jnp.where(fixed, prescribed, displacement)
        components = jnp.where(fixed, along(axes, prescribed), along(axes, displacement))
        return combined(axes, components)

    def carried(self, x: Motion) -> Motion:
        """`x`, a constant, as a function of supports; here they have no influence on it."""
        return x

    @abc.abstractmethod
    def spread(self, x: Motion, step: Step) -> Forces:
        """Step of every row, [n_row, n_freedom], from a step [n_free] from `x`."""

    @abc.abstractmethod
    def move(self, x: Motion, step: Step) -> Motion:
        """The motion after a step [n_free]."""

    def held_still(self, residual: Step, step: Step) -> Step:
        """Residual [n_free] at a step, with a unit stiffness and no force at bound unknowns.

        They are unknowns only for other phases; in this phase they stay where they are.
        """
        bound = self.freedoms.bound
        if bound is None:
            return residual
        return residual + jnp.where(bound, step - jax.lax.stop_gradient(step), 0.0)

    # --- forces

    @abc.abstractmethod
    def size(self, force: Float[Array, "... n_freedom"]) -> Float[Array, " ..."]:
        """Sizes of forces [..., n_freedom], [...], N; moments are divided by a length."""

    @abc.abstractmethod
    def collected(self, force: Forces, x: Motion, spread: Forces | None = None) -> Step:
        """Forces on all rows, collected at the unknowns, [n_free], N.

        The forces act at `x`; with `spread` they are conjugate to this step of all rows from `x`.
        """

    def conjugate(self, load: Forces, spread: Forces) -> Forces:
        """Dead loads [n_row, n_freedom] as forces conjugate to the step `spread` of all rows."""
        return load

    @abc.abstractmethod
    def reactions(self, unbalanced: Forces, motion: Motion) -> Forces:
        """Forces of the supports, [n_row, n_freedom], from unbalanced forces; zero where free."""

    def directions(self, motion: Motion) -> list[Float[ArrayLike, "n_row 3 3"] | None]:
        """Directions of displacements, and of spins if there are any, a list of [n_row, 3, 3]."""
        return [self.freedoms.axes]

    # --- matrices

    @classmethod
    def coupled(
        cls, number: Int[np.ndarray, "n_row n_freedom"]
    ) -> list[Int[np.ndarray, "n_row d"]]:
        """Numbers of the unknowns that a row couples by itself, a list of [n_row, d]."""
        return []

    @abc.abstractmethod
    def slopes(self, x: Motion) -> Float[Array, "n_row n_freedom d"] | None:
        """Change of each row by its unknowns, [n_row, n_freedom, d]; None if along x, y, z."""

    @abc.abstractmethod
    def part(
        self,
        blocks: Float[Array, "n_elem ..."],
        links: Int[ArrayLike, "n_elem n_end"],
        width: int,
        inner: Sequence[tuple[int, int]],
        x: Motion,
    ) -> Part:
        """Matrices [n_elem, d, d] of elements by unknowns, as `linear.assemble` takes them.

        `blocks` are by the freedoms of the ends, `width` each, and by the inner numbers.
        """

    def own_parts(self, load: Forces, unbalanced: Callable[[], Forces], x: Motion) -> list[Part]:
        """Terms of the tangent from dead loads as nodes turn, a list as of `part`.

        `unbalanced` is a function without arguments that gives the forces [n_row, n_freedom].
        """
        return []

    def regular(self, matrix: Matrix, x: Motion) -> Matrix:
        """The tangent with springs at free spins, which have no stiffness and need none."""
        return matrix


def square(blocks: Float[Array, "n_elem ..."]) -> Float[Array, "n_elem d d"]:
    """Matrices of elements, in any shape, as [n_elem, d, d]."""
    count = len(blocks)
    return blocks.reshape(count, -1, round((blocks.size // count) ** 0.5))


def by_numbers(
    blocks: Float[Array, "n_elem d d"],
    slopes: Float[Array, "n_elem n_end width n_number"],
    n_inner: int,
) -> Float[Array, "n_elem k k"]:
    """Matrices [n_elem, d, d] of the freedoms of ends as matrices of their unknowns.

    `slopes`: change of each end by its unknowns, [n_elem, n_end, width, n_number]. The `n_inner`
    inner numbers, which come last, are unknowns already.
    """
    n_elem, n_end, width, n_number = slopes.shape
    whole = jnp.zeros((n_elem, n_end * width + n_inner, n_end * n_number + n_inner), blocks.dtype)
    for k in range(n_end):
        rows, columns = slice(k * width, (k + 1) * width), slice(k * n_number, (k + 1) * n_number)
        whole = whole.at[:, rows, columns].set(slopes[:, k].astype(blocks.dtype))
    if n_inner:
        whole = whole.at[:, n_end * width :, n_end * n_number :].set(jnp.eye(n_inner))
    return jnp.einsum("eai,eab,ebj->eij", whole, blocks, whole)
