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
    """Static arguments of the programs of a motion: a change of one compiles them anew.

    Attributes:
        bundles: which groups are evaluated together.
        histories: names of the histories that are kept.
        nodes: nodes whose histories are kept, `Indices`; None: all.
        n_node: number of nodes.
        distribution: as for `transient`.
        halvings: how often a step may be halved.
        conserves: whether energy and momentum are conserved.
        moving_loads: where moving loads are stored, as `time_loads.moving_load_values` returns.
    """

    bundles: Bundles
    histories: tuple[str, ...]
    nodes: Indices | None
    n_node: int
    distribution: str | None
    halvings: int
    conserves: bool
    moving_loads: tuple[tuple[int, int], ...]


@pytree
class MotionData:
    """Traced arguments of the programs of a motion, but for the loads in time.

    Attributes:
        duration: duration of a step, s.
        spectral_radius: spectral radius of the scheme at high frequencies, 0 to 1.
        gravity: acceleration that weights are divided by, m/s2.
        masses: masses added to nodes, [n_node], kg, or None.
        velocity: velocity at the start, [n_node, 3 or 6], or None.
        dampings: list of dampings.
        remaining: which elements are not removed, per bundle [n_elem] bool; None if none is.
        release_duration: duration over which the forces of removed elements end, s.
    """

    duration: Float[ArrayLike, ""]
    spectral_radius: Float[ArrayLike, ""]
    gravity: Float[ArrayLike, ""]
    masses: Float[ArrayLike, " n_node"] | None
    velocity: Float[ArrayLike, "n_node n"] | None
    dampings: list[Any]
    remaining: list[Bool[ArrayLike, " n_elem"]] | None
    release_duration: Float[ArrayLike, ""]


@pytree
class LoadsInTime:
    """What acts on a structure in motion, at the times of the steps.

    Attributes:
        forces: forces on nodes, [steps + 1, n_node, 3 or 6], N and N m, or None.
        base_acceleration: acceleration of the base, [steps + 1, 3], m/s2, or None.
        moving_loads: leaves of moving loads, as `time_loads.moving_load_values` returns.
    """

    forces: Float[ArrayLike, "m n_node n"] | None
    base_acceleration: Float[ArrayLike, "m 3"] | None
    moving_loads: list[list[Float[Array, "m ..."]]]


class MotionHistories(NamedTuple):
    """Results of a motion by time step; arrays have a leading axis of time, [steps + 1].

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
