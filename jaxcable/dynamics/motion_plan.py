"""Arguments and results of the program that computes a motion in time."""

from __future__ import annotations

from typing import Any, NamedTuple

from ..common.tree import Indices, pytree
from ..common.types import Array, ArrayLike, Bool, Float
from ..mechanics.bundles import Bundles
from .energy_balance import EnergyBalance

NODAL_HISTORIES = ("displacement", "velocity", "acceleration", "rotation", "reactions")
"""Histories of nodes by name; others are results of elements."""


class MotionPlan(NamedTuple):
    """What is static in a motion.

    Attributes:
        bundles: which groups are evaluated together.
        steps: number of steps.
        first: number of steps before elements are removed; all of them without removal.
        histories: names of the histories that are kept.
        nodes: nodes whose histories are kept, `Indices`; None: all.
        n_node: number of nodes.
        distribution: as for `transient`.
        halvings: how often a step may be halved.
        conserves: whether energy and momentum are conserved.
        moving: places of loads that move, of `time_loads.moving_numbers`.
    """

    bundles: Bundles
    steps: int
    first: int
    histories: tuple[str, ...]
    nodes: Indices | None
    n_node: int
    distribution: str | None
    halvings: int
    conserves: bool
    moving: tuple[tuple[int, int], ...]


@pytree
class MotionData:
    """Numbers of a motion.

    Attributes:
        duration: duration of a step, s.
        radius: spectral radius at high frequencies.
        gravity: acceleration that weights are divided by, m/s2.
        masses: masses added to nodes, [n_node], kg, or None.
        velocity: velocity at the start, [n_node, 3 or 6], or None.
        forces: forces on nodes in time, [steps + 1, n_node, 3 or 6], N and N m, or None.
        base: acceleration of the base in time, [steps + 1, 3], m/s2, or None.
        moving: numbers of loads that move, of `time_loads.moving_numbers`.
        dampings: list of dampings.
        stays: which elements are not removed, per bundle [n_elem] bool; None if none is.
        release: duration over which the forces of removed elements end, s.
    """

    duration: Float[ArrayLike, ""]
    radius: Float[ArrayLike, ""]
    gravity: Float[ArrayLike, ""]
    masses: Float[ArrayLike, " n_node"] | None
    velocity: Float[ArrayLike, "n_node n"] | None
    forces: Float[ArrayLike, "m n_node n"] | None
    base: Float[ArrayLike, "m 3"] | None
    moving: list[list[Float[Array, "m ..."]]]
    dampings: list[Any]
    stays: list[Bool[ArrayLike, " n_elem"]] | None
    release: Float[ArrayLike, ""]


class MotionHistories(NamedTuple):
    """What the program of a motion returns; arrays have a leading axis [steps + 1].

    Attributes:
        codes: status after every step.
        parts: number of parts into which each step was divided.
        histories: histories by name; of elements a list with an item per group.
        energy: `EnergyBalance`.
    """

    codes: Array
    parts: Array
    histories: dict[str, Any]
    energy: EnergyBalance
