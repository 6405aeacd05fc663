"""What a load is: a base class, and a class for each of the ways in which loads act."""

from __future__ import annotations

import abc
from collections.abc import Mapping, Sequence
from typing import Protocol, Self, TypeAlias

import numpy as np
from jax.typing import DTypeLike

from ..common.rules import Rule
from ..common.tree import Indices, copy_with
from ..common.types import Array, ArrayLike, Float, Int
from ..elements.element import Element, OwnState
from ..model.structure import Structure
from ..model.supports import Fixed

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
    def plain(self) -> bool:
        """Whether every bundle is a single group, in the order of the groups."""

    def numbers(self, on: tuple[int, ...]) -> tuple[int, ...]:
        """Numbers of the bundles that contain any of the groups `on`, in ascending order."""

    def spread(
        self, on: tuple[int, ...], values: dict[int, Float[ArrayLike, " ..."]]
    ) -> Mapping[int, Float[ArrayLike, " ..."]]:
        """Convert arrays [n_elem] or scalars by number of group to the same by number of bundle."""


class Load(abc.ABC):  # noqa: B024  # the classes that derive from it have abstract methods
    """Something that acts on a structure in a phase; a pytree whose leaves are its numbers.

    A load derives from one of the classes below: `OnNodes`, `Moving`, `Dead` or `Measured`,
    `Following`.

    Attributes:
        worked_out: names of fields that the analysis sets and the user does not give.
        scales: names of fields that a factor of the load multiplies.
    """

    worked_out: tuple[str, ...] = ("begun", "part")
    scales: tuple[str, ...] = ()

    def check(self, structure: Structure) -> None:
        """Raise ValueError if the load does not fit a structure."""
        return None

    def scaled(self, factor: Float[ArrayLike, ""]) -> Self:
        """The load times `factor`, by its fields `scales`."""
        if not self.scales:
            kind = type(self).__name__
            raise ValueError(f"{kind}: cannot be scaled; its class names no field in `scales`")
        given = {name: getattr(self, name) for name in self.scales}
        return copy_with(self, **{name: factor * x for name, x in given.items() if x is not None})

    def rules(self) -> list[Rule]:
        """The rules of its numbers, see `common.rules`."""
        return []

    def __str__(self) -> str:
        return type(self).__name__


class OnNodes(Load):
    """A dead load on nodes; where a freedom becomes fixed, its force no longer counts as load."""

    def at_nodes(self) -> tuple[Indices, Float[ArrayLike, "... 3"]] | None:
        """Nodes [n] and the forces on them, [3] or [n, 3], N, to warn of loads without effect.

        None (the default) of a load that has them in another form, which is not warned of.
        """
        return None

    @property
    def has_moments(self) -> bool:
        """Whether it may have moments, which have no potential."""
        return True

    @abc.abstractmethod
    def nodal_forces(self, shape: tuple[int, int], dtype: DTypeLike) -> OnEveryNode:
        """Force, and moment if `shape` is [n_node, 6], on every node, N and N m."""


class Moving(Load):
    """A movement of supports."""

    @abc.abstractmethod
    def check_supported(self, fixed: Fixed) -> None:
        """Raise ValueError if a moved freedom is not held; `fixed` is a `supports.Fixed`."""

    @abc.abstractmethod
    def steps(self, shape: tuple[int, int], dtype: DTypeLike) -> OnEveryNode:
        """Steps of all nodes, of `shape`: translations, and rotation vectors with six columns."""


class Acting(Load):
    """A load on elements or areas, which goes on acting in later phases."""

    @property
    def asks_begun(self) -> bool:
        """Whether it depends on where the nodes are when its phase begins (`Measured`)."""
        return False

    def among(self, structure: Structure) -> Acting:
        """The load as an analysis of a structure needs it, with groups by their numbers."""
        return self

    def bundled(self, bundles: Bundles) -> Acting:
        """The load, after `among`, with bundles instead of groups (`mechanics.bundles`)."""
        return self

    def touched(self, bundles: Bundles) -> Acting:
        """As `bundled`, with only the numbers of the bundles that the load acts on."""
        return self


class Dead(Acting):
    """Forces that do not depend on where the nodes are, but may on the state of the elements."""

    @abc.abstractmethod
    def element_forces(
        self,
        groups: Groups,
        states: States,
        nodes: Positions,
        shape: tuple[int, int],
        dtype: DTypeLike,
    ) -> OnEveryNode:
        """Force on every node, as `shape`, N, for the given element states."""

    def per_length(
        self, number: int, group: Element, state: OwnState, nodes: Positions
    ) -> Float[Array, "n_elem 3"] | None:
        """The load along the elements of a group, which bends them or makes them hang.

        Returns:
            Force per unstressed length, [n_elem, 3], N/m; None if the load has no such part.
        """
        return None


class Measured(Dead):
    """A dead load per length or area of a geometry.

    Attributes:
        geometry: "input", that of the structure's nodes, or "begun", that at the beginning of the
            phase.
        begun: nodes at the beginning of the phase, [n_row, 3], m, set by the analysis; else None.
    """

    geometry: str = "input"
    begun: Positions | None = None

    @property
    def asks_begun(self) -> bool:
        """Whether it is measured in the geometry at the beginning of its phase."""
        return self.geometry == "begun"

    def measured(self, nodes: Positions) -> Positions:
        """Positions to measure lengths or areas in, [n_row, 3], m; `nodes` are the initial ones."""
        return nodes if self.begun is None else self.begun


class Following(Acting):
    """Forces that depend on where the nodes are."""

    @abc.abstractmethod
    def touches(self, groups: Groups) -> list[Indices]:
        """Nodes whose forces depend on each other's positions, a list of `Indices` [n, k]."""

    @abc.abstractmethod
    def following_forces(
        self, groups: Groups, states: States, nodes: Positions, moved: Positions
    ) -> Positions:
        """Force on every node, [n_node, 3], N, at the positions `moved` [n_node, 3]."""

    @abc.abstractmethod
    def following_blocks(
        self, groups: Groups, states: States, nodes: Positions, moved: Positions
    ) -> Blocks:
        """Derivative of the forces: list of (blocks [n, k, 3, k, 3], nodes [n, k])."""

    def pressing(
        self, number: int, group: Element
    ) -> tuple[str, Float[Array, " n_elem"], Float[Array, "n_elem 3"]] | None:
        """The pressure that bends the elements of a group.

        Returns:
            The length that it is per, pressure [n_elem], axes [n_elem, 3]; None if it bends none.
        """
        return None
