"""What a `System` asks of the space that its nodes move in.

The *motion* of a row (a node, or a row of an element, see `freedoms`) begins with its displacement;
so do forces on it and steps of it. The point ``x`` of an iteration is the motion of all rows,
[n_row, n_motion]. A *step* [n_free] from ``x`` has a number for every unknown, all of them lengths;
it *spreads* to a step of every row, [n_row, n_freedom], and moves ``x`` on. Forces on rows are
*collected* to the unknowns, by the work that they do on such a step.
"""

import abc

import jax
import jax.numpy as jnp

from ..common.tree import pytree
from .freedoms import along, combined


@pytree
class Space(abc.ABC):
    """The motions that supports allow.

    Attributes:
        freedoms: `Freedoms`, the numbering of the unknowns.
        prescribed: motion of all rows as supports have it, used where they hold,
            [n_row, n_motion]; None if it is not asked for.
        n_motion, n_freedom: numbers of a row's motion, and of a force on it or a step of it.
        rotates: whether nodes turn.
        symmetric: whether the tangent is symmetric whatever the dead loads are.
    """

    freedoms: object
    prescribed: object

    n_motion = n_freedom = 3
    rotates = False
    symmetric = True

    # --- motions

    @classmethod
    @abc.abstractmethod
    def of(cls, nodes, groups, freedoms, prescribed, bearing):
        """The space of a system; `bearing` as of `ramp.Carry`."""

    @classmethod
    @abc.abstractmethod
    def still(cls, nodes):
        """Motion of rows [n_row, 3] that have not moved."""

    @classmethod
    @abc.abstractmethod
    def advanced(cls, motion, step):
        """Motion after a step of any size, [n_row, n_freedom]."""

    @classmethod
    @abc.abstractmethod
    def between(cls, before, after):
        """Displacement, and rotation vector, from one motion to another, [n_row, n_freedom]."""

    @classmethod
    def rotations(cls, motion):
        """Rotations of all rows, unit quaternions [n_row, 4]; None if there are none."""
        return None

    @classmethod
    def moments(cls, force):
        """Moments in forces [..., n_freedom], [..., 3], N m; None if there are none."""
        return None

    @classmethod
    def kept(cls, motion):
        """What a path has to keep of motions [n_inc, n_row, n_motion] beside displacements."""
        return None

    @classmethod
    def padded(cls, force):
        """Forces [..., 3] or [..., n_freedom] with no moments where they have none."""
        missing = [(0, 0)] * (force.ndim - 1) + [(0, cls.n_freedom - force.shape[-1])]
        return jnp.pad(force, missing) if missing[-1][1] else force

    # --- points and steps

    def place(self, x):
        """`x` with what supports hold where they prescribe it."""
        return self._supported(x[:, :3])

    def _supported(self, displacement):
        fixed, axes = self.freedoms.fixed[:, :3], self.freedoms.axes
        held = self.prescribed[:, :3]
        if axes is None:
            return jnp.where(fixed, held, displacement)
        own = jnp.where(fixed, along(axes, held), along(axes, displacement))
        return combined(axes, own)

    def carried(self, x):
        """`x`, a constant, as a function of what supports do to free nodes: nothing."""
        return x

    @abc.abstractmethod
    def spread(self, x, step):
        """Step of every row, [n_row, n_freedom], from a step [n_free] from `x`."""

    @abc.abstractmethod
    def move(self, x, step):
        """The motion after a step [n_free]."""

    def held_still(self, residual, step):
        """Residual [n_free] at a step, with that of what is held in this phase only.

        What only other phases leave free stays where it is: it has some stiffness, and no force.
        """
        bound = self.freedoms.bound
        if bound is None:
            return residual
        return residual + jnp.where(bound, step - jax.lax.stop_gradient(step), 0.0)

    # --- forces

    @abc.abstractmethod
    def size(self, force):
        """Sizes of forces [..., n_freedom], [...], N; moments over a length."""

    @abc.abstractmethod
    def collected(self, force, x, spread=None):
        """Forces on all rows at the unknowns, [n_free], N.

        At `x`, or of forces conjugate to the steps `spread` of all rows from there.
        """

    def conjugate(self, load, spread):
        """Dead loads, [n_row, n_freedom], as forces conjugate to steps from where they were."""
        return load

    @abc.abstractmethod
    def reactions(self, unbalanced, motion):
        """Forces of the supports, [n_row, n_freedom], of unbalanced ones; zero where free."""

    def directions(self, motion):
        """Directions of displacements, and of spins, a list of [n_row, 3, 3]."""
        return [self.freedoms.axes]

    # --- matrices

    @classmethod
    def coupled(cls, number):
        """Numbers of unknowns that a row couples by itself, list of [n_row, d]."""
        return []

    @abc.abstractmethod
    def slopes(self, x):
        """Change of a row's motion by its numbers, [n_row, n_freedom, d]; None if the same."""

    @abc.abstractmethod
    def part(self, blocks, links, width, inner, x):
        """Matrices [n_elem, d, d] of elements as `linear.assemble` takes them.

        By the unknowns of their ends, which have `width` freedoms each, and their inner numbers.
        """

    def own_parts(self, load, unbalanced, x):
        """What loads take from the tangent as nodes turn, a list as of `part`.

        `unbalanced` is a function without arguments that gives the forces [n_row, n_freedom].
        """
        return []

    def regular(self, matrix, x):
        """The tangent with what has no stiffness, and needs none, held."""
        return matrix


def square(blocks):
    """Matrices of elements in any shape as [n_elem, d, d]."""
    count = len(blocks)
    return blocks.reshape(count, -1, round((blocks.size // count) ** 0.5))


def by_numbers(blocks, slopes, n_inner):
    """Matrices [n_elem, d, d] of ends by those of the numbers behind them; inner numbers stay.

    `slopes`: change of each end by its numbers, [n_elem, n_end, width, n_number].
    """
    n_elem, n_end, width, n_number = slopes.shape
    whole = jnp.zeros((n_elem, n_end * width + n_inner, n_end * n_number + n_inner), blocks.dtype)
    for k in range(n_end):
        rows, columns = slice(k * width, (k + 1) * width), slice(k * n_number, (k + 1) * n_number)
        whole = whole.at[:, rows, columns].set(slopes[:, k].astype(blocks.dtype))
    if n_inner:
        whole = whole.at[:, n_end * width :, n_end * n_number :].set(jnp.eye(n_inner))
    return jnp.einsum("eai,eab,ebj->eij", whole, blocks, whole)
