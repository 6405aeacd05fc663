"""`Space`: what a `System` needs to know about the motion of its nodes.

The *motion* of a row (a node, or a row of an element, see `dof_map`) begins with its displacement.
Forces on a row, and steps of a row, begin with three components along x, y, z. The iterate ``x`` is
the motion of all rows, [n_row, n_motion] (of nets with a *low-order part*, see
`translations`). A *step* [n_free] from ``x`` has an entry for every unknown, all of them lengths.
The step of every row, [n_row, n_freedom], follows from it by *prolongation* (`Space.prolong`).
Forces on rows become forces at the unknowns by the transpose, *restriction* (`Space.restrict`):
both do the same work.
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
from ..linear.pattern import SparseMatrix
from .dof_map import DofMap, to_global, to_local

Motion: TypeAlias = 'Float[Array, "n_row n_motion"]'
"""Motion of all rows: the iterate."""
Forces: TypeAlias = 'Float[Array, "n_row n_freedom"]'
"""Forces on all rows, or a step of all rows."""
Step: TypeAlias = 'Float[Array, " n_free"]'
"""An entry for every unknown."""
MatrixPart: TypeAlias = 'tuple[Float[Array, "n_elem d d"], Int[ArrayLike, "n_elem d"]]'
"""Matrices of elements, and the indices of the unknowns of their rows and columns."""
Matrix: TypeAlias = 'Float[Array, "n_free n_free"] | SparseMatrix'


class ElementGroup(Protocol):
    """Protocol of a group of elements in a space: links, rotations of nodes, lengths."""

    links: Int[ArrayLike, "n_elem n_end"]

    @property
    def gives_rotations(self) -> bool:
        """Whether nodes have rotations because the elements are joined to them."""

    def chord(self, ends: Float[Array, "n_elem n_end 3"]) -> Float[Array, " n_elem"]:
        """Return the distance between the first two ends of every element, m."""


def mean_length(groups: Sequence[ElementGroup], nodes: Float[Array, "n_row 3"]) -> Float[Array, ""]:
    """Return the mean initial length of elements, m; 1 m if none has a length."""
    lengths = jnp.concatenate([group.chord(nodes[group.links]) for group in groups])
    return jnp.mean(lengths) if lengths.size else jnp.ones((), nodes.dtype)


@pytree
class Space(abc.ABC):
    """How unknowns move the rows of motion (nodes, for example), and what supports allow.

    Attributes:
        dof_map: the degree-of-freedom map.
        prescribed: prescribed motion of all rows, [n_row, n_motion], used where supports fix them;
            None where supports are not needed.
        n_motion: number of columns of a motion: displacement, and rotation if there is one.
        n_freedom: number of degrees of freedom of a row, 3 or 6.
        rotates: whether nodes have rotations.
        symmetric: whether the tangent is symmetric under all dead loads.
    """

    dof_map: DofMap
    prescribed: Motion | None

    n_motion: ClassVar[int] = 3
    n_freedom: ClassVar[int] = 3
    rotates: ClassVar[bool] = False
    symmetric: ClassVar[bool] = True

    # --- motions

    @classmethod
    @abc.abstractmethod
    def build(
        cls,
        nodes: Float[Array, "n_row 3"],
        groups: Sequence[ElementGroup],
        dof_map: DofMap,
        prescribed: Motion | None,
        support_rotation: Float[Array, "n_row 4"] | None,
    ) -> Self:
        """Make the space for the nodes, element groups and supports of a system.

        Args:
            nodes: initial positions of all rows of motion, m.
            groups: the element groups.
            dof_map: degree-of-freedom map of the phase.
            prescribed: prescribed motion of all rows, or None.
            support_rotation: rotation of every row when its support was set, unit quaternions, or
                None.
        """

    @classmethod
    @abc.abstractmethod
    def at_rest(cls, nodes: Float[Array, "n_row 3"]) -> Motion:
        """Return the motion, [n_row, n_motion], of nodes (rows of motion) that have not moved."""

    @classmethod
    @abc.abstractmethod
    def motion_after_row_step(cls, motion: Motion, step: Forces) -> Motion:
        """Return the motion after a step of all nodes (translations, and spins if they rotate)."""

    @classmethod
    @abc.abstractmethod
    def displacement_between(cls, before: Motion, after: Motion) -> Forces:
        """Return displacements, m (and rotation vectors), from motion `before` to `after`."""

    @classmethod
    @abc.abstractmethod
    def rigid_link_motion(cls, motion: Motion, arm: Float[Array, "n_row 3"]) -> Motion:
        """Return the motion of rows that rigid links join to other rows, their carriers.

        Args:
            motion: motion of the carrier of each row.
            arm: vectors from the carriers to the rows, in the initial geometry, m.
        """

    @classmethod
    def rotations(cls, motion: Motion) -> Float[Array, "n_row 4"] | None:
        """Return the rotations in a motion, unit quaternions; None if nodes do not rotate."""
        return None

    @classmethod
    def moments(cls, force: Float[Array, "... n_freedom"]) -> Float[Array, "... 3"] | None:
        """Return the moments in generalized forces, N m; None if nodes do not rotate."""
        return None

    @classmethod
    def stored_motion(
        cls, motion: Float[Array, "n_inc n_row n_motion"]
    ) -> Float[Array, "n_inc n_row n_motion"] | None:
        """Return the motions of a path that results store beside displacements.

        None if a motion is a displacement, so that there is nothing more to store.
        """
        return None

    @classmethod
    def pad_moments(cls, force: Float[Array, "... n"]) -> Float[Array, "... n_freedom"]:
        """Return forces, [..., n_freedom], with zeros for the moments that they lack."""
        missing = [(0, 0)] * (force.ndim - 1) + [(0, cls.n_freedom - force.shape[-1])]
        return jnp.pad(force, missing) if missing[-1][1] else force

    # --- points and steps

    @property
    def _prescribed_motion(self) -> Motion:
        """The field `prescribed`, for methods that need supports, where it is not None."""
        return self.prescribed  # type: ignore[return-value]  # not None where it is asked for

    def impose_supports(self, x: Motion) -> Motion:
        """Return motion `x` with prescribed values at degrees of freedom that supports fix."""
        return self._impose_displacements(x[:, :3])

    def _impose_displacements(
        self, displacement: Float[Array, "n_row 3"]
    ) -> Float[Array, "n_row 3"]:
        """Return displacements, m, with the prescribed values along directions that are fixed."""
        fixed, axes = self.dof_map.fixed[:, :3], self.dof_map.axes
        prescribed = self._prescribed_motion[:, :3]
        if axes is None:
            return jnp.where(fixed, prescribed, displacement)
        components = jnp.where(fixed, to_local(axes, prescribed), to_local(axes, displacement))
        return to_global(axes, components)

    def with_support_rotations(self, x: Motion) -> Motion:
        """Return the motion `x` with its derivative by the rotations of supports.

        Those are the rotations that nodes had when supports were set; without rotations there is
        none.
        """
        return x

    @abc.abstractmethod
    def prolong(self, x: Motion, step: Step) -> Forces:
        """Return the step of every node (row of motion) that a step of the unknowns makes.

        `x` is the motion before the step.
        """

    @abc.abstractmethod
    def move(self, x: Motion, step: Step) -> Motion:
        """Return the motion after a step of the unknowns, [n_free], from the motion `x`."""

    def hold_temporarily_fixed(self, residual: Step, step: Step) -> Step:
        """Add to the residual equations ``step = 0`` for unknowns that are fixed in this phase.

        They are unknowns only because another phase releases them. The equations have unit
        stiffness.

        Args:
            residual: residual at the step, with zeros at these unknowns, [n_free].
            step: the step of the unknowns, [n_free].
        """
        bound = self.dof_map.temporarily_fixed
        if bound is None:
            return residual
        return residual + jnp.where(bound, step - jax.lax.stop_gradient(step), 0.0)

    # --- forces

    @abc.abstractmethod
    def force_norm(self, force: Float[Array, "... n_freedom"]) -> Float[Array, " ..."]:
        """Return the norm of the force on each row, N, plus that of its moment over a length."""

    @abc.abstractmethod
    def restrict(self, force: Forces, x: Motion, row_step: Forces | None = None) -> Step:
        """Return the forces at the unknowns that do the same work as forces on all rows.

        Args:
            force: forces on all rows of motion, N, and moments, N m.
            x: the motion at which they act.
            row_step: step of all rows from `x` that the forces are work-conjugate to; None if it is
                zero.

        Returns:
            Forces at the unknowns, [n_free], N.
        """

    def conjugate_loads(self, load: Forces, row_step: Forces) -> Forces:
        """Return dead loads as forces work-conjugate to a change of `row_step`, a step of all rows.

        They differ from `load` where moments keep their direction while nodes rotate.
        """
        return load

    @abc.abstractmethod
    def reactions(self, unbalanced: Forces, motion: Motion) -> Forces:
        """Return the support reactions: unbalanced forces on all rows along fixed directions.

        They are zero along free directions. `motion` is the motion of all rows.
        """

    def dof_directions(self, motion: Motion) -> list[Float[ArrayLike, "n_row 3 3"] | None]:
        """Return the axes along which displacements, and spins if there are any, are fixed.

        Each entry of the list is [n_row, 3, 3], one direction in each row of a matrix, or None for
        x, y, z.
        """
        return [self.dof_map.axes]

    # --- matrices

    @classmethod
    def coupled_unknowns(
        cls, number: Int[np.ndarray, "n_row n_freedom"]
    ) -> list[Int[np.ndarray, "n_row d"]]:
        """Return lists of unknowns that each node couples without an element, [n_row, d] each.

        The sparsity pattern of the tangent needs places for them. `number` is the unknown of every
        dof.
        """
        return []

    @abc.abstractmethod
    def motion_jacobian(self, x: Motion) -> Float[Array, "n_row n_freedom d"] | None:
        """Return the Jacobian of every node's (row's) step by its unknowns; None: the identity."""

    @abc.abstractmethod
    def transform_to_unknowns(
        self,
        blocks: Float[Array, "n_elem ..."],
        links: Int[ArrayLike, "n_elem n_end"],
        width: int,
        inner: Sequence[tuple[int, int]],
        x: Motion,
    ) -> MatrixPart:
        """Transform element matrices from degrees of freedom of the ends to unknowns.

        Args:
            blocks: matrices by the degrees of freedom of the ends and the internal unknowns.
            links: rows of motion of the elements: ends, then rows of internal unknowns.
            width: degrees of freedom of an end, 3 or 6.
            inner: positions of the internal unknowns, (row after the ends, column).
            x: motion of all rows.

        Returns:
            Matrices by unknowns, [n_elem, d, d], and the indices of these, for
            `linear.assemble_matrix`.
        """

    def load_stiffness(
        self, load: Forces, unbalanced: Callable[[], Forces], x: Motion
    ) -> list[MatrixPart]:
        """Return the terms that dead loads on rotating nodes add to the tangent stiffness.

        Without rotations there are none, as here.

        Args:
            load: dead loads on all rows, [n_row, n_freedom], N and N m.
            unbalanced: function that returns internal forces less loads on all rows, in the same
                shape; called only with rigid links, whose arms turn these forces into moments.
            x: motion of all rows.

        Returns:
            Pairs of matrices [n_row, d, d] and the indices of their unknowns, [n_row, d].
        """
        return []

    def stabilize_torsional_mechanisms(self, matrix: Matrix, x: Motion) -> Matrix:
        """Return the tangent with springs at beams that can spin about their own line.

        Such spins have no stiffness, and results do not depend on them.
        """
        return matrix


def as_square_matrices(blocks: Float[Array, "n_elem ..."]) -> Float[Array, "n_elem d d"]:
    """Reshape the matrices of elements, [n_elem, ...] with d^2 entries each, to [n_elem, d, d]."""
    count = len(blocks)
    return blocks.reshape(count, -1, round((blocks.size // count) ** 0.5))


def transform_by_jacobian(
    blocks: Float[Array, "n_elem d d"],
    slopes: Float[Array, "n_elem n_end width n_number"],
    n_inner: int,
) -> Float[Array, "n_elem k k"]:
    """Transform element matrices K from degrees of freedom of the ends to unknowns, ``S^T K S``.

    Args:
        blocks: K, by the degrees of freedom of the ends and the internal unknowns.
        slopes: Jacobian of each end's step by the unknowns of the end, the blocks of S.
        n_inner: number of internal unknowns, which come last and stay as they are.
    """
    n_elem, n_end, width, n_number = slopes.shape
    whole = jnp.zeros((n_elem, n_end * width + n_inner, n_end * n_number + n_inner), blocks.dtype)
    for k in range(n_end):
        rows, columns = slice(k * width, (k + 1) * width), slice(k * n_number, (k + 1) * n_number)
        whole = whole.at[:, rows, columns].set(slopes[:, k].astype(blocks.dtype))
    if n_inner:
        whole = whole.at[:, n_end * width :, n_end * n_number :].set(jnp.eye(n_inner))
    return jnp.einsum("eai,eab,ebj->eij", whole, blocks, whole)
