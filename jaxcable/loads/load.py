"""What a load is: a base class, and a class for each of the ways in which loads act."""

from __future__ import annotations

import abc
from collections.abc import Mapping, Sequence
from typing import Protocol, Self, TypeAlias

import jax.numpy as jnp
import numpy as np
from jax.typing import DTypeLike

from ..common.rules import Rule
from ..common.tree import Indices, copy_with
from ..common.types import Array, ArrayLike, Float, Int
from ..common.units import SI, Units
from ..elements.element import Element, OwnState
from ..model.structure import Structure
from ..model.supports import FixedDofs

VECTOR_HINT = "; give (x, y, z) for all nodes, or for each of them"
"""End of messages on vectors of nodes that have another shape."""

Groups: TypeAlias = Sequence[Element]
States: TypeAlias = Sequence[OwnState]
"""State of every group, an `ElementState` of the group's own class."""
Positions: TypeAlias = 'Float[Array, "n_row 3"]'
OnEveryNode: TypeAlias = 'Float[Array | np.ndarray, "n_row n_freedom"]'
"""Forces of all nodes, N, and moments, N m, or steps, with three columns or six."""
Blocks: TypeAlias = 'list[tuple[Float[Array, "n k 3 k 3"], Int[Array, "n k"]]]'
"""Derivatives of forces by positions: blocks, and the nodes that they couple."""


class Bundles(Protocol):
    """Protocol of `mechanics.bundles`: groups that are evaluated as one, as loads need them."""

    @property
    def are_groups(self) -> bool:
        """Whether no groups are joined: every bundle is one group, in the order of the groups."""

    def containing(self, on: tuple[int, ...]) -> tuple[int, ...]:
        """Return indices of the bundles that contain any group with an index in `on`, ascending."""

    def join_values(
        self, on: tuple[int, ...], values: dict[int, Float[ArrayLike, " ..."]]
    ) -> Mapping[int, Float[ArrayLike, " ..."]]:
        """Convert a dict {index of group: [n_elem] or scalar} to one by index of bundle."""


class Load(abc.ABC):  # noqa: B024  # the classes that derive from it have abstract methods
    """Base of all loads: pytrees whose leaves are their numbers, and which act in a phase.

    A load derives from one of the classes below: `OnNodes`, `PrescribedMovement`, `DeadLoad` or
    `LoadPerGeometry`, `FollowerLoad`.

    Attributes:
        worked_out: names of fields that the analysis sets and the user does not give.
        scales: names of fields that `scaled` multiplies by a factor.
    """

    worked_out: tuple[str, ...] = ("begin_nodes", "element_factors")
    scales: tuple[str, ...] = ()

    def check(self, structure: Structure) -> None:
        """Raise ValueError if the load does not fit the structure.

        The analysis itself refuses node numbers that the structure does not have: those of a field
        `nodes` of `Indices`, and of `forces_at_nodes`.
        """
        return None

    def scaled(self, factor: Float[ArrayLike, ""]) -> Self:
        """Return a copy with the fields named in `scales` multiplied by `factor`.

        Raises ValueError if the class names none.
        """
        if not self.scales:
            kind = type(self).__name__
            raise ValueError(
                f"{kind}: cannot be multiplied by a factor; its class must name the fields that a "
                "factor multiplies, such as scales = ('forces',)"
            )
        given = {name: getattr(self, name) for name in self.scales}
        return copy_with(self, **{name: factor * x for name, x in given.items() if x is not None})

    def rules(self) -> list[Rule]:
        """Return the rules that the numbers of the load must satisfy, a list; by default none."""
        return []

    def __str__(self) -> str:
        described = type(self).describe is not Load.describe
        return self.describe() if described else type(self).__name__

    def describe(self, units: Units = SI) -> str:
        """Return the load in a few words, for people, with its numbers in `units`."""
        return str(self)


class OnNodes(Load):
    """Base of dead loads on nodes; they end where a later phase fixes a degree of freedom."""

    def forces_at_nodes(self) -> tuple[Indices, Float[ArrayLike, "... 3"]] | None:
        """Return node numbers [n] and the forces on them, [3] or [n, 3], N, for warnings.

        None (the default): the load has no such list, and there are no warnings about its size.
        """
        return None

    @property
    def has_moments(self) -> bool:
        """Whether the load may have moments, which have no potential."""
        return True

    @abc.abstractmethod
    def nodal_forces(self, shape: tuple[int, int], dtype: DTypeLike) -> OnEveryNode:
        """Return forces, N, and moments, N m, on all nodes, in an array of `shape` (n, 3 or 6)."""


class PrescribedMovement(Load):
    """Base of prescribed movements of supports: displacements, m, and rotations, rad."""

    @abc.abstractmethod
    def check_supported(self, fixed: FixedDofs) -> None:
        """Raise ValueError if a moved degree of freedom is not held by `fixed`, the supports."""

    @abc.abstractmethod
    def nodal_movements(self, shape: tuple[int, int], dtype: DTypeLike) -> OnEveryNode:
        """Return displacements and rotation vectors of all nodes in an array of `shape`, m, rad."""


class PersistentLoad(Load):
    """Base of loads on elements or faces, which go on acting in all later phases."""

    @property
    def needs_begin_nodes(self) -> bool:
        """Whether the load depends on where nodes are when the phase that adds it begins."""
        return False

    def with_group_indices(self, structure: Structure) -> PersistentLoad:
        """Return the load with indices of groups in place of keys; the load itself by default."""
        return self

    def on_bundles(self, bundles: Bundles) -> PersistentLoad:
        """Return the load on bundles (groups evaluated as one); the load itself by default."""
        return self

    def with_bundle_indices(self, bundles: Bundles) -> PersistentLoad:
        """Return the load with indices of bundles in place of groups, otherwise unchanged."""
        return self


class DeadLoad(PersistentLoad):
    """Base of loads that do not depend on current positions, but may on states of elements."""

    @property
    def has_moments(self) -> bool:
        """Whether the load has moments that keep their direction, which have no potential."""
        return False

    @abc.abstractmethod
    def element_forces(
        self,
        groups: Groups,
        states: States,
        nodes: Positions,
        shape: tuple[int, int],
        dtype: DTypeLike,
    ) -> OnEveryNode:
        """Return forces, N, and moments, N m, on all nodes, in an array of `shape`.

        `nodes` are initial positions, `shape` is (n_row, 3 or 6), `dtype` that of the result.
        """

    def load_per_length(
        self, number: int, group: Element, state: OwnState, nodes: Positions
    ) -> Float[Array, "n_elem 3"] | None:
        """Return the load along a group with index `number`, by which its elements bend or hang.

        It is a force per unstressed length, [n_elem, 3], N/m; None if the load has no such part.
        """
        return None

    def point_loads(self, number: int, state: OwnState) -> Float[Array, "n_elem k 4or7"] | None:
        """Return concentrated loads within elements of a group with index `number`, or None.

        They are [n_elem, k, 4 or 7] as of `ElementLoad.points`, zero for absent elements. Their
        shares at the ends of the elements are part of `element_forces`.
        """
        return None


class ForceOnlyLoad(DeadLoad):
    """Base of dead loads on elements or faces that put forces, and no moments, on nodes.

    A subclass writes `_sum_forces`, the forces on all nodes.
    """

    @abc.abstractmethod
    def _sum_forces(self, groups, states, nodes, dtype):
        """Return the forces of the load on all nodes, [n_row, 3], N, as an array of `dtype`.

        Args:
            groups, states: all groups of elements, and the state of each.
            nodes: initial positions of the nodes, [n_row, 3], m.
        """

    def element_forces(
        self,
        groups: Groups,
        states: States,
        nodes: Positions,
        shape: tuple[int, int],
        dtype: DTypeLike,
    ) -> OnEveryNode:
        """Return forces, N, and zero moments on all nodes, in an array of `shape`.

        `nodes` are initial positions, `shape` is (n_row, 3 or 6), `dtype` that of the result.
        """
        forces = self._sum_forces(groups, states, nodes, dtype)
        return jnp.pad(forces, ((0, 0), (0, shape[1] - 3)))


class LoadPerGeometry(DeadLoad):
    """Base of dead loads per length or area, which are measured in a certain geometry.

    Attributes:
        geometry: "input", that of the structure's nodes, or "begun", that at the beginning of the
            phase.
        begin_nodes: positions at the beginning of the phase, [n_row, 3], m, set by the analysis;
            None for "input".
    """

    geometry: str = "input"
    begin_nodes: Positions | None = None

    @property
    def needs_begin_nodes(self) -> bool:
        """Whether lengths or areas are those at the beginning of the phase that adds the load."""
        return self.geometry == "begun"

    def measuring_positions(self, nodes: Positions) -> Positions:
        """Return the positions [n_row, 3], m, by which lengths or areas are computed.

        `nodes` are the initial positions.
        """
        return nodes if self.begin_nodes is None else self.begin_nodes


class FollowerLoad(PersistentLoad):
    """Base of follower loads: forces that depend on the current positions of the nodes."""

    @abc.abstractmethod
    def coupled_nodes(self, groups: Groups) -> list[Indices]:
        """Return sets of k nodes whose forces depend on each other's positions, list of [n, k]."""

    @abc.abstractmethod
    def following_forces(
        self, groups: Groups, states: States, nodes: Positions, moved: Positions
    ) -> Positions:
        """Return the force on every node, [n_row, 3], N, with nodes at `moved` [n_row, 3], m."""

    @abc.abstractmethod
    def following_blocks(
        self, groups: Groups, states: States, nodes: Positions, moved: Positions
    ) -> Blocks:
        """Return derivatives of the forces by current positions `moved`, [n_row, 3].

        The list has pairs (blocks [n, k, 3, k, 3], N/m, nodes [n, k]) for n sets of k coupled
        nodes.
        """

    def bending_pressure(
        self, number: int, group: Element
    ) -> tuple[str, Float[Array, " n_elem"], Float[Array, "n_elem 3"]] | None:
        """Return (per, pressure [n_elem], N/m, axes [n_elem, 3]) that bend a group, or None.

        `per` is the length that the pressure refers to, "current" or "unstressed"; `number` is the
        index of the group.
        """
        return None
