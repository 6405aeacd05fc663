"""Steps that conserve energy and momentum, of structures of straight cables and bars.

Velocities are those of the midpoint rule, ``u1 - u0 = h (v0 + v1) / 2``, and forces act along the
mean of the directions of an element at both ends of a step, with the size that does the work of the
stored energy U:

    N = (U1 - U0) / (l1 - l0),    force on the second end N (r0 + r1) / (l0 + l1).

So energy, momentum and angular momentum stay as they are without loads, whatever the duration of a
step, also where cables go slack and taut.

Source: Simo, Tarnow, ZAMP 43 (1992) 757; Gonzalez, J. Nonlinear Sci. 6 (1996) 449.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import jax
import jax.numpy as jnp

from ..analysis.solution import Solution, State
from ..common.tree import copy_with, pytree
from ..common.types import Array, Bool, Float
from ..elements.abilities import Hanging
from ..elements.prestress import measure_chord
from ..elements.straight import Straight
from ..loads.load import FollowerLoad, Load
from ..loads.varying import Varying
from ..mechanics.assembly import System
from ..mechanics.elementwise import PerGroup, map_elements_at_ends
from ..model.structure import Structure
from ..numerics.vectors import scalar_product
from ..spaces.space import Motion, Space
from ..spaces.translations import drop_low_part
from .generalized_alpha import MotionState, TimeStep
from .inertial_system import Inertia, InertialSystem

# Change of length over the sum of both lengths below which the force is that at the mean length:
# the difference of energies has few digits there, and the error is of third order in it.
_SMALL_ELONGATION = 1e-7


@pytree
class MidpointStep(TimeStep):
    """A step in time by the midpoint rule: forces and inertia balance in its middle."""

    @property
    def velocity_per_displacement(self) -> Float[Array, ""]:
        """Derivative of the velocity in the middle of the step by its displacement, 1/s."""
        return 1 / self.duration

    @property
    def acceleration_per_displacement(self) -> Float[Array, ""]:
        """Derivative of the acceleration in the middle of the step by its displacement, 1/s2."""
        return 2 / self.duration**2

    def balanced_state(self, space: Space, x: Motion) -> MotionState:
        """Return the rates in the middle of the step, with the motion `x` at its end."""
        mean = space.displacement_between(self.begin.motion, x) / self.duration
        acceleration = 2 / self.duration * (mean - self.begin.velocity)
        return MotionState(x, mean, acceleration, acceleration)

    def end_state(self, space: Space, x: Motion) -> MotionState:
        """Return the `MotionState` at the end of the step, with the acceleration in its middle."""
        middle = self.balanced_state(space, x)
        velocity = 2 * middle.velocity - self.begin.velocity
        return MotionState(x, velocity, middle.acceleration, middle.acceleration)


@pytree(kw_only=True)
class ConservingSystem(InertialSystem):
    """The equations of a time step that conserves energy, momentum and angular momentum.

    Its `step` is a `MidpointStep`, its `load` the mean of the loads at both ends of the step.
    """

    predicts_axial_forces = False

    @classmethod
    def from_system(
        cls, system: System, inertia: Inertia, step: TimeStep, load_before: Any = None
    ) -> InertialSystem:
        """Return the equations of a step whose loads change from `load_before` to `system.load`."""
        step = MidpointStep(step.begin, step.duration, step.parameters)
        found = super().from_system(system, inertia, step)
        return copy_with(found, load=0.5 * (load_before + system.load))

    def forces_and_tangents(self, motion: Motion) -> list[list[Any]]:
        """Return end forces of the step, per group [n_elem, 2, 3], N, and None for each tangent."""
        forces = self._end_forces(motion)
        return [forces, [None] * len(forces)]

    def tangents(self, motion: Motion, known: PerGroup | None = None) -> list[Array]:
        """Return derivatives of end forces by the motion at the end, per group [n_elem, 6, 6]."""
        return [
            blocks.reshape(len(blocks), 6, 6)
            for blocks in self._map_elements_over_step(_conserving_tangent, motion)
        ]

    def results_by_name(self, motion: Motion, *names: str) -> dict[str, list[Any]]:
        """Return results of elements at the end by name; "end_forces" are those of the step."""
        found = super().results_by_name(motion, *names)
        return found | ({"end_forces": self._end_forces(motion)} if "end_forces" in names else {})

    def _end_forces(self, motion):
        """Return end forces of a step that ends at `motion`, per group [n_elem, 2, 3], N."""
        return self._map_elements_over_step(_conserving_end_forces, motion)

    def _map_elements_over_step(self, function, motion):
        """Return `function` of each element and its motion at both ends of the step, per group."""
        found, motion = [], drop_low_part(motion)
        for group, state in zip(self.groups, self.states, strict=True):
            at = [a[group.links] for a in (self.nodes, self.step.begin.motion, motion)]
            found.append(map_elements_at_ends(function, group, state, at))
        return found

    @property
    def may_be_convex(self) -> bool:
        """False: the forces of the step have no potential."""
        return False

    @property
    def may_be_unsymmetric(self) -> bool:
        """True: the tangent of the step is unsymmetric."""
        return True

    def unsymmetric(self) -> Bool[Array, ""]:
        """Return True, a scalar array: the tangent of the step is unsymmetric."""
        return jnp.ones((), bool)


def _conserving_end_forces(one, state, ends, before, after):
    """Return end forces of a straight element in a step, whose work is its change of energy, N.

    They are [2, 3]; `before` and `after` are the motions of its ends at both ends of the step.
    """
    first, *_ = measure_chord(ends, before)
    second, *_ = measure_chord(ends, after)
    moved = (after[1] - after[0]) - (before[1] - before[0])
    length, new = (jnp.sqrt(scalar_product(v, v)) for v in (first, second))
    total = first + second
    longer = scalar_product(moved, total) / (length + new)
    short = jnp.abs(longer) <= _SMALL_ELONGATION * (length + new)
    work = one.energy(state, ends, after) - one.energy(state, ends, before)
    # at the mean length, along the line at the end
    mean = 0.5 * (length + new) / new
    place = before[0] + mean * second - (ends[1] - ends[0])
    at_mean = one.tension(state, ends, jnp.stack([before[0], place]))
    tension = jnp.where(short, at_mean, work / jnp.where(short, 1.0, longer))
    force = tension / (length + new) * total
    return jnp.stack([-force, force])


def _conserving_tangent(one, state, ends, before, after):
    """Return the derivative of `_conserving_end_forces` by `after`, [2, 3, 2, 3], N/m."""
    return jax.jacfwd(lambda moved: _conserving_end_forces(one, state, ends, before, moved))(after)


def require_energy_momentum_input(
    structure: Structure, loads: Sequence[Load], start: Solution | State | None
) -> None:
    """Raise ValueError for elements or loads that the scheme "energy-momentum" does not support.

    It supports straight cables and bars of two nodes without history variables, under dead loads.
    """
    for where, group in structure.named_groups():
        straight = isinstance(group, Straight) and not isinstance(group, Hanging)
        if not straight or group.has_memory or group.links.shape[1] != 2:
            raise ValueError(
                f'scheme = "energy-momentum": elements{where} ({type(group).__name__}) are not '
                "supported; it is for straight cables and bars without history variables"
            )
    bare = [load.load if isinstance(load, Varying) else load for load in loads]
    last = start.last if isinstance(start, Solution) else start
    bare += [] if last is None else [stack.load for stack in last.restart.loads]
    for load in bare:
        if isinstance(load, FollowerLoad):
            raise ValueError(
                f'scheme = "energy-momentum": {type(load).__name__} follows the structure; only '
                "dead loads are supported"
            )
