"""What a load is: a base class, and a class for each of the ways in which loads act."""

from __future__ import annotations

import abc
from collections.abc import Mapping, Sequence
from typing import Protocol, Self, TypeAlias

import numpy as np
from jax.typing import DTypeLike

from ..common.old_names import LOAD, refuse_old_names
from ..common.rules import Rule
from ..common.tree import Indices, copy_with
from ..common.types import Array, ArrayLike, Float, Int
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
    """What loads need to know of groups that are evaluated together, see `mechanics.bundles`."""

    @property
    def are_groups(self) -> bool:
        """Whether every bundle is a single group, in the order of the groups."""

    def containing(self, on: tuple[int, ...]) -> tuple[int, ...]:
        """Numbers of the bundles that contain any of the groups `on`, in ascending order."""

    def join_values(
        self, on: tuple[int, ...], values: dict[int, Float[ArrayLike, " ..."]]
    ) -> Mapping[int, Float[ArrayLike, " ..."]]:
        """Convert arrays [n_elem] or scalars by number of group to the same by number of bundle."""


class Load(abc.ABC):  # noqa: B024  # the classes that derive from it have abstract methods
    """Base of all loads: pytrees whose leaves are their numbers, and which act in a phase.

    A load derives from one of the classes below: `OnNodes`, `Moving`, `Dead` or `Measured`,
    `Following`.

    Attributes:
        worked_out: names of fields that the analysis sets and the user does not give.
        scales: names of fields that a factor of the load multiplies.
    """

    worked_out: tuple[str, ...] = ("begin_nodes", "element_factors")
    scales: tuple[str, ...] = ()

    def __init_subclass__(cls, **options: object):
        super().__init_subclass__(**options)
        refuse_old_names(cls, LOAD)

    def check(self, structure: Structure) -> None:
        """Raise ValueError if the load does not fit a structure."""
        return None

    def scaled(self, factor: Float[ArrayLike, ""]) -> Self:
        """Return the load times `factor`, which multiplies the fields `scales`."""
        if not self.scales:
            kind = type(self).__name__
            raise ValueError(
                f"{kind}: cannot be multiplied by a factor; its class must name the fields that a "
                "factor multiplies, such as scales = ('forces',)"
            )
        given = {name: getattr(self, name) for name in self.scales}
        return copy_with(self, **{name: factor * x for name, x in given.items() if x is not None})

    def rules(self) -> list[Rule]:
        """Return the rules of its numbers, see `common.rules`."""
        return []

    def __str__(self) -> str:
        return type(self).__name__


class OnNodes(Load):
    """Base of dead loads on nodes; at a degree of freedom that becomes fixed they end."""

    def forces_at_nodes(self) -> tuple[Indices, Float[ArrayLike, "... 3"]] | None:
        """Return nodes [n] and the forces on them, [3] or [n, 3], N, for warnings.

        None (the default) of a load that has them in another form, which is not warned of.
        """
        return None

    @property
    def has_moments(self) -> bool:
        """Whether it may have moments, which have no potential."""
        return True

    @abc.abstractmethod
    def nodal_forces(self, shape: tuple[int, int], dtype: DTypeLike) -> OnEveryNode:
        """Return force, and moment if `shape` is [n_node, 6], on every node, N and N m."""


class Moving(Load):
    """Base of movements of supports."""

    @abc.abstractmethod
    def check_supported(self, fixed: FixedDofs) -> None:
        """Raise ValueError if a moved degree of freedom is not held."""

    @abc.abstractmethod
    def nodal_movements(self, shape: tuple[int, int], dtype: DTypeLike) -> OnEveryNode:
        """Return the movement of every node, of `shape`: translation, and rotation vector."""


class Acting(Load):
    """Base of loads on elements or areas, which go on acting in later phases."""

    @property
    def needs_begin_nodes(self) -> bool:
        """Whether it depends on where the nodes are when its phase begins (`Measured`)."""
        return False

    def with_group_numbers(self, structure: Structure) -> Acting:
        """Return the load as an analysis of a structure needs it, with groups by their numbers."""
        return self

    def on_bundles(self, bundles: Bundles) -> Acting:
        """Return the load, after `with_group_numbers`, on bundles of groups."""
        return self

    def with_bundle_numbers(self, bundles: Bundles) -> Acting:
        """Return the load as `on_bundles` does, with only the numbers of its bundles."""
        return self


class Dead(Acting):
    """Base of forces that depend on no current positions, but may on states of elements."""

    @abc.abstractmethod
    def element_forces(
        self,
        groups: Groups,
        states: States,
        nodes: Positions,
        shape: tuple[int, int],
        dtype: DTypeLike,
    ) -> OnEveryNode:
        """Return the force on every node, as `shape`, N, for the given element states."""

    def load_per_length(
        self, number: int, group: Element, state: OwnState, nodes: Positions
    ) -> Float[Array, "n_elem 3"] | None:
        """Return the load along the elements of a group, which bends them or makes them hang.

        Returns:
            Force per unstressed length, [n_elem, 3], N/m; None if the load has no such part.
        """
        return None


class Measured(Dead):
    """Base of dead loads per length or area of a geometry.

    Attributes:
        geometry: "input", that of the structure's nodes, or "begun", that at the beginning of the
            phase.
        begin_nodes: nodes at the beginning of the phase, [n_row, 3], m, set by the analysis; else
            None.
    """

    geometry: str = "input"
    begin_nodes: Positions | None = None

    @property
    def needs_begin_nodes(self) -> bool:
        """Whether it is measured in the geometry at the beginning of its phase."""
        return self.geometry == "begun"

    def measuring_positions(self, nodes: Positions) -> Positions:
        """Return the positions in which lengths or areas are measured, [n_row, 3], m.

        `nodes` are the initial positions.
        """
        return nodes if self.begin_nodes is None else self.begin_nodes


class Following(Acting):
    """Base of follower loads: forces that depend on the current positions of the nodes."""

    @abc.abstractmethod
    def coupled_nodes(self, groups: Groups) -> list[Indices]:
        """Return nodes whose forces depend on each other's positions, list of `Indices` [n, k]."""

    @abc.abstractmethod
    def following_forces(
        self, groups: Groups, states: States, nodes: Positions, moved: Positions
    ) -> Positions:
        """Return the force on every node, [n_node, 3], N, at the positions `moved` [n_node, 3]."""

    @abc.abstractmethod
    def following_blocks(
        self, groups: Groups, states: States, nodes: Positions, moved: Positions
    ) -> Blocks:
        """Return the derivative of the forces: list of (blocks [n, k, 3, k, 3], nodes [n, k])."""

    def bending_pressure(
        self, number: int, group: Element
    ) -> tuple[str, Float[Array, " n_elem"], Float[Array, "n_elem 3"]] | None:
        """Return the pressure that bends the elements of a group (beams, between their ends).

        Returns:
            The length that it is per, pressure [n_elem], axes [n_elem, 3]; None if it bends none.
        """
        return None
