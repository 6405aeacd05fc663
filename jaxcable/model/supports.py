"""Supports: which freedoms of which nodes are held, and in which directions."""

from __future__ import annotations

import numpy as np

from ..common import checks
from ..common.tree import Indices, pytree, set_fields
from ..common.types import ArrayLike, Bool, Float, Int
from .torsional_mechanisms import TorsionalMechanisms

N_DISPLACEMENT = 3
"""Freedoms of a node in a structure of bars and cables: three displacements."""


class FixedDofs(Indices):
    """Fixed degrees of freedom of all rows of motion, with their directions: static metadata.

    Attributes:
        array: True where a freedom is held, [n_row, 3 or 6].
        axes: directions of displacements and of rotations, `Indices` [n_row, 3, 3], one in each row
            of a matrix; None if they are x, y, z everywhere and no row has exactly one held
            rotation.
        mechanisms: `TorsionalMechanisms` that these supports permit, or None.
    """

    __slots__ = ("axes", "mechanisms")

    def __init__(
        self,
        array: Bool[ArrayLike, "n_row n_freedom"],
        axes: Float[ArrayLike, "n_row 3 3"] | Indices | None = None,
        mechanisms: TorsionalMechanisms | None = None,
    ):
        super().__init__(array)
        self.axes = axes if axes is None or isinstance(axes, Indices) else Indices(axes)
        self.mechanisms = mechanisms

    def _identity(self):
        """Return what equality and hash compare, a tuple: digest of the array, axes, mechanisms."""
        return self._digest, self.axes, self.mechanisms

    def __hash__(self):
        return hash(self._identity())

    def __eq__(self, other):
        return isinstance(other, FixedDofs) and self._identity() == other._identity()

    def with_directions(self) -> FixedDofs:
        """Return a copy that always has `axes`: x, y, z in every row if it had none."""
        if self.axes is not None:
            return self
        return FixedDofs(self.array, np.tile(np.eye(3), (len(self.array), 1, 1)), self.mechanisms)


@pytree(indices=("mask", "nodes", "clamps", "chosen", "held", "axes"))
class Supports:
    """Which displacements and rotations of which nodes are held.

    `pinned`, `clamped` and `restrained` make them, and ``+`` joins them. Each of the three
    displacements and three rotations of a node can be held. If exactly one rotation is held (a
    fork, which keeps the end of a beam from twisting), the node swings from where it was supported:
    its rotation since then is about an axis across the held direction. So defined, it does not
    depend on the history of the motion.

    Args:
        mask: True where a displacement is held, [n_node, 3] along x, y, z, or [n_node, 6] with
            the rotations about x, y, z.
        nodes: numbers of the nodes whose position is held (pinned), [n].
        clamps: numbers of the nodes whose position and rotation are held, [n].
        chosen: numbers of nodes of which single displacements or rotations are held, [n]. What
            `mask`, `nodes` and `clamps` hold of the same nodes is held as well.
        held: True where a freedom of the `chosen` nodes is held, [n, 6]: their displacements along
            x, y, z, then their rotations about x, y, z.
        axes: directions of the `chosen` nodes that replace x, y, z there, [n, 3, 3], one in each
            row of a matrix, of length 1 without unit, at right angles; default x, y, z.

    Raises:
        ValueError: nothing given, a mask of the wrong shape or type; in a structure, unknown nodes,
            or a node that is held in part along two sets of directions.

    Example:
        >>> mask = np.zeros((3, 3), bool)
        >>> mask[:, 1] = True  # all nodes held in the plane y = 0
        >>> (jc.pinned([0, 2]) + jc.Supports(mask)).fixed(3)[1, :3]
        array([False,  True, False])
    """

    mask: Bool[ArrayLike, "n_node 3"] | Bool[ArrayLike, "n_node 6"] | None = None
    nodes: Int[ArrayLike, " n"] | None = None
    clamps: Int[ArrayLike, " n"] | None = None
    chosen: Int[ArrayLike, " n"] | None = None
    held: Bool[ArrayLike, "n 6"] | None = None
    axes: Float[ArrayLike, "n 3 3"] | None = None

    def __post_init__(self):
        given = (self.mask, self.nodes, self.clamps, self.chosen)
        if all(value is None for value in given):
            raise ValueError(
                "Supports: nothing is held; give nodes or clamps (node numbers), chosen with held, "
                "or a mask [n_node, 3]"
            )
        numbers = {"nodes": "pinned", "clamps": "clamped", "chosen": "restrained"}
        for name in (*numbers, "held", "axes"):
            value = getattr(self, name)
            if value is not None and not isinstance(value, Indices):
                if name in numbers:
                    value = checks.as_indices(value, f"{numbers[name]} nodes")
                set_fields(self, **{name: Indices(value)})
        self._check_restrained_nodes()
        if self.mask is not None and not isinstance(self.mask, Indices):
            mask = np.asarray(self.mask)
            if mask.dtype != bool or mask.ndim != 2 or mask.shape[1] not in (N_DISPLACEMENT, 6):
                raise ValueError(
                    f"supports mask: expected booleans [n_node, {N_DISPLACEMENT}] or [n_node, 6] "
                    f"(true, false), got {mask.dtype} {mask.shape}; for node numbers use "
                    "pinned(nodes)"
                )
            set_fields(self, mask=Indices(mask))

    def _check_restrained_nodes(self):
        """Check that `chosen`, `held` and `axes` have matching shapes; set default axes x, y, z.

        Raises ValueError otherwise, or if `chosen` or `held` is missing.
        """
        if self.chosen is None and self.held is None and self.axes is None:
            return
        for name in ("chosen", "held"):
            if getattr(self, name) is None:
                raise ValueError(
                    f"supports {name}: missing; chosen (nodes) and held (which of their degrees of "
                    "freedom, [n, 6]) are given together, as restrained(...) does"
                )
        if self.axes is None:
            axes = np.tile(np.eye(3), (len(self.chosen), 1, 1))
            set_fields(self, axes=Indices(axes))
        count = len(self.chosen)
        if self.held.shape != (count, 6) or self.held.array.dtype != bool:
            raise ValueError(f"supports held: expected booleans [{count}, 6]")
        if self.axes.shape != (count, 3, 3) or self.axes.array.dtype.kind not in "if":
            raise ValueError(f"supports axes: expected numbers [{count}, 3, 3]")

    def __add__(self, other):
        if not isinstance(other, Supports):
            return NotImplemented
        joined = {}
        for name in ("nodes", "clamps", "chosen", "held", "axes"):
            parts = [getattr(s, name) for s in (self, other) if getattr(s, name) is not None]
            joined[name] = np.concatenate([p.array for p in parts]) if parts else None
        masks = [s.mask.array for s in (self, other) if s.mask is not None]
        if len(masks) == 2:
            if len(masks[0]) != len(masks[1]):
                raise ValueError(
                    f"supports: masks of {len(masks[0])} and {len(masks[1])} nodes cannot be "
                    "added; both must have a row for every node of the structure"
                )
            masks = [np.pad(m, ((0, 0), (0, 6 - m.shape[1]))) for m in masks]
            masks = [masks[0] | masks[1]]
        return Supports(mask=masks[0] if masks else None, **joined)

    @property
    def holds_rotations(self) -> bool:
        """Whether any rotation can be held: by columns of `mask`, or by `held`."""
        by_mask = self.mask is not None and self.mask.shape[1] != N_DISPLACEMENT
        return by_mask or (self.held is not None and bool(self.held.array[:, 3:].any()))

    def fixed(self, n_node: int) -> Bool[np.ndarray, "n_node 6"]:
        """Return which displacements and rotations of each node are held, [n_node, 6] bool, NumPy.

        They are those along and about the node's `directions`.
        """
        fixed = self._is_fixed_along_axes(n_node)
        if self.chosen is not None:
            np.logical_or.at(fixed, self.chosen.array, self.held.array)
        return fixed

    def _is_fixed_along_axes(self, n_node):
        """Return degrees of freedom along and about x, y, z that are held, [n_node, 6] bool.

        They are those of `mask`, `nodes` and `clamps`; `chosen` nodes are left out.
        """
        fixed = np.zeros((n_node, 6), bool)
        if self.mask is not None:
            if self.mask.shape[0] != n_node:
                raise ValueError(
                    f"supports mask: has {self.mask.shape[0]} rows, but the structure has {n_node} "
                    "nodes"
                )
            fixed[:, : self.mask.shape[1]] = self.mask.array
        for name, nodes, width in (("pinned", self.nodes, 3), ("clamped", self.clamps, 6)):
            if nodes is None:
                continue
            checks.require_known_nodes(nodes.array, n_node, f"{name} nodes")
            fixed[nodes.array, :width] = True
        if self.chosen is not None:
            checks.require_known_nodes(self.chosen.array, n_node, "restrained nodes")
        return fixed

    def directions(self, n_node: int) -> Float[np.ndarray, "n_node 3 3"]:
        """Return the directions of each node's displacements and rotations, [n_node, 3, 3], NumPy.

        Every row of a matrix is one direction, a unit vector. Raises ValueError for a node that is
        held along two sets of directions.
        """
        axes = np.tile(np.eye(3), (n_node, 1, 1))
        if self.chosen is None:
            return axes
        plain, taken = self._is_fixed_along_axes(n_node), {}
        for node, held, given in zip(
            self.chosen.array.tolist(), self.held.array, self.axes.array, strict=True
        ):
            turned = np.abs(given - np.eye(3)).max() > 0
            for kind, part in (("displacements", slice(3)), ("rotations", slice(3, 6))):
                in_part = plain[node, part].any() and not plain[node, part].all()
                if turned and held[part].any() and in_part:
                    raise ValueError(
                        f"supports: {kind} of node {node} are held in part along x, y, z and in "
                        "part along other directions; give all along one set of directions"
                    )
            if node in taken and np.abs(taken[node] - given).max() > 1e-9:
                raise ValueError(
                    f"supports: node {node} is held along two sets of directions; give all along "
                    "one set"
                )
            axes[node] = taken[node] = given
        return axes


def pinned(nodes: Int[ArrayLike, " n"]) -> Supports:
    """Make supports that hold the position of the given nodes, node numbers [n].

    Example:
        >>> jc.pinned([0, 2]).fixed(3)[:, :3].all(axis=1)
        array([ True, False,  True])
    """
    return Supports(nodes=nodes)


def clamped(nodes: Int[ArrayLike, " n"]) -> Supports:
    """Make supports that hold position and rotation of the given nodes, node numbers [n].

    Example:
        >>> jc.clamped([0]).fixed(2).all(axis=1)
        array([ True, False])
        >>> (jc.clamped([0]) + jc.pinned([1])).fixed(2).sum(axis=1)
        array([6, 3])
    """
    return Supports(clamps=nodes)


def restrained(
    nodes: Int[ArrayLike, " n"],
    along: str = "",
    about: str = "",
    axes: Float[ArrayLike, "... 3"] | None = None,
) -> Supports:
    """Make supports that hold some displacements and rotations of nodes, along any directions.

    Args:
        nodes: node numbers, [n].
        along: displacements that are held, some of "xyz".
        about: rotations that are held, some of "xyz"; only nodes joined to a beam have rotations.
        axes: directions that replace x, y, z at these nodes, [3, 3] or [n, 3, 3], one in each row
            of a matrix, at right angles (`Beams.element_axes` gives those of beams); or only the
            direction that replaces x, [3], if any two across it serve for y and z. They do not
            change while the structure moves. Default x, y, z.

    Returns:
        `Supports`.

    Raises:
        ValueError: wrong letters or shapes, directions that are not at right angles, nothing held,
            traced directions.

    Example:
        Forks at both ends of a beam along x, which keep it from twisting, one of them sliding:

        >>> forks = jc.restrained([0], "xyz", "x") + jc.restrained([8], "yz", "x")
        >>> forks.fixed(9)[[0, 8]].astype(int)
        array([[1, 1, 1, 1, 0, 0],
               [0, 1, 1, 1, 0, 0]])

        A roller on a plane that rises by 45 degrees holds displacements across the plane:

        >>> roller = jc.restrained([3], along="x", axes=(-1.0, 0.0, 1.0))
        >>> print(roller.directions(4)[3, 0].round(4))
        [-0.7071  0.      0.7071]
    """
    nodes = np.atleast_1d(checks.as_indices(nodes, "restrained nodes"))
    held = np.zeros((len(nodes), 6), bool)
    for start, name, letters in ((0, "along", along), (3, "about", about)):
        if not isinstance(letters, str) or set(letters) - set("xyz"):
            raise ValueError(f'{name} = {letters!r}: expected some of "x", "y", "z"')
        held[:, [start + "xyz".index(letter) for letter in letters]] = True
    if not held.any():
        raise ValueError('along, about: nothing is held; give some of "xyz" in one of them')
    return Supports(chosen=nodes, held=held, axes=_orthonormal_axes(axes, len(nodes)))


def _orthonormal_axes(axes, count):
    """Return directions of supports as unit vectors at right angles, in rows, [count, 3, 3].

    `axes` are as of `restrained`: None for x, y, z; the first direction, [3]; or all, [3, 3] or
    [count, 3, 3]. Raise ValueError for other shapes, traced numbers, and directions that are not at
    right angles.
    """
    if axes is None:
        return np.tile(np.eye(3), (count, 1, 1))
    axes = checks.array_if_known(checks.as_floats(axes, "axes"))
    if axes is None:
        raise ValueError("axes: directions of supports cannot be traced")
    if axes.shape == (3,):
        length = np.linalg.norm(axes)
        if not (np.isfinite(length) and length > 0):
            raise ValueError(f"axes = {axes.tolist()}: has no direction; must not be zero")
        along = axes / length
        across = np.eye(3)[np.abs(along).argmin()]
        across = across - (across @ along) * along
        across /= np.linalg.norm(across)
        axes = np.stack([along, across, np.cross(along, across)])
    if axes.shape not in ((3, 3), (count, 3, 3)):
        raise ValueError(f"axes: expected shape (3,), (3, 3) or ({count}, 3, 3), got {axes.shape}")
    axes = np.broadcast_to(axes, (count, 3, 3)).astype(float)
    square = axes @ np.swapaxes(axes, 1, 2)
    skew = ~(np.abs(square - np.eye(3)).max(axis=(1, 2)) < 1e-6)
    if skew.any():
        raise ValueError(
            f"axes[{int(skew.argmax())}]: expected three directions of length 1 at right angles"
        )
    right, _, left = np.linalg.svd(axes)  # nearest exactly orthogonal directions
    return right @ left
