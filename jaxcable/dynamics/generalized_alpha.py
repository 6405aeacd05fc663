"""A step in time by the generalized-alpha method: its numbers, and rates from a motion.

Forces and inertia are in balance at the end of every step, ``M v' + C v + f = F``. The acceleration
a of the formulas of Newmark lags behind the true one, v':

    u1 = u0 + h v0 + h^2 ((1/2 - beta) a0 + beta a1),    v1 = v0 + h ((1 - gamma) a0 + gamma a1),
    (1 - alpha_m) a1 + alpha_m a0 = (1 - alpha_f) v'1 + alpha_f v'0.

With a constant mass matrix this is the method of Chung and Hulbert, of second order. Rotations are
those of Bruels and Cardona: the same formulas for the rotation vector of a step and the angular
velocity, both in the axes of the node, which the rotation carries along. Nodes without mass have no
part in any of it: they are in static balance at the end of every step.

Source: Chung, Hulbert, J. Appl. Mech. 60 (1993) 371; Bruels, Cardona, J. Comput. Nonlinear Dyn. 5
(2010) 031002; Arnold, Bruels, Multibody Syst. Dyn. 18 (2007) 185.
"""

from __future__ import annotations

from typing import TypeAlias

import jax
import jax.numpy as jnp

from ..common.tree import pytree
from ..common.types import Array, Float
from ..numerics.rotations import invert, rotate
from ..spaces.space import Forces, Motion, Space

Rates: TypeAlias = 'Float[Array, "n_row n_freedom"]'
"""Velocities or accelerations of rows, m/s and m/s2; of rotations in the axes of the node, rad/s
and rad/s2."""


@pytree
class AlphaParameters:
    """The four parameters of the generalized-alpha method.

    Attributes:
        alpha_m, alpha_f: weights of the start of a step, for accelerations and for forces.
        beta, gamma: parameters of Newmark's formulas.
    """

    alpha_m: Float[Array, ""]
    alpha_f: Float[Array, ""]
    beta: Float[Array, ""]
    gamma: Float[Array, ""]

    @classmethod
    def from_spectral_radius(cls, radius: Float[Array, ""]) -> AlphaParameters:
        """Return the parameters for a spectral radius at high frequencies, from 0 to 1."""
        alpha_m, alpha_f = (2 * radius - 1) / (radius + 1), radius / (radius + 1)
        gamma = 0.5 - alpha_m + alpha_f
        return cls(alpha_m, alpha_f, 0.25 * (1 - alpha_m + alpha_f) ** 2, gamma)


@pytree
class MotionState:
    """Motion, velocities and accelerations of all rows at one time.

    Attributes:
        motion: motion of all rows.
        velocity: velocities of all rows.
        acceleration: accelerations v', in balance with the forces; no meaning without mass.
        auxiliary_acceleration: accelerations a of Newmark's formulas.
    """

    motion: Motion
    velocity: Rates
    acceleration: Rates
    auxiliary_acceleration: Rates


@pytree
class TimeStep:
    """A step in time by the generalized-alpha method: its start, duration and parameters.

    Attributes:
        begin: `MotionState` at its start.
        duration: duration h, s.
        parameters: `AlphaParameters`.
    """

    begin: MotionState
    duration: Float[Array, ""]
    parameters: AlphaParameters

    @property
    def velocity_per_displacement(self) -> Float[Array, ""]:
        """Derivative of the velocity at the end of the step by its displacement, 1/s."""
        return self.parameters.gamma / (self.parameters.beta * self.duration)

    @property
    def acceleration_per_displacement(self) -> Float[Array, ""]:
        """Derivative of the acceleration v' at the end of the step by its displacement, 1/s2."""
        own = self.parameters
        whole = (1 - own.alpha_m) / (1 - own.alpha_f)
        return whole / (own.beta * self.duration**2)

    def end_state(self, space: Space, x: Motion) -> MotionState:
        """Return the `MotionState` at the end of the step, where the motion of all rows is `x`."""
        begin, own, h = self.begin, self.parameters, self.duration
        moved = displacement_in_body_axes(space, begin.motion, x)
        new = (moved / h - begin.velocity) / (own.beta * h)
        new = new - (0.5 / own.beta - 1) * begin.auxiliary_acceleration
        change = (1 - own.gamma) * begin.auxiliary_acceleration + own.gamma * new
        mixed = (1 - own.alpha_m) * new + own.alpha_m * begin.auxiliary_acceleration
        acceleration = (mixed - own.alpha_f * begin.acceleration) / (1 - own.alpha_f)
        return MotionState(x, begin.velocity + h * change, acceleration, new)

    def balanced_state(self, space: Space, x: Motion) -> MotionState:
        """Return the `MotionState` in which the scheme balances forces: at the end of the step."""
        return self.end_state(space, x)

    def predicted_motion(self, space: Space, max_displacement: Float[Array, ""]) -> Motion:
        """Return the predicted motion of all rows at the end of the step: constant acceleration.

        If a row would move more than `max_displacement`, m, all steps are shortened in proportion:
        from far, an iteration may end in another equilibrium, such as a bar turned inside out.
        """
        begin, h = self.begin, self.duration
        step = h * begin.velocity + 0.5 * h**2 * begin.auxiliary_acceleration
        moved = jnp.max(jnp.abs(step[:, :3]), initial=0.0)
        step = step / jnp.maximum(moved / max_displacement, 1.0)
        return space.motion_after_row_step(begin.motion, to_space_axes(space, begin.motion, step))


def displacement_in_body_axes(space: Space, before: Motion, after: Motion) -> Forces:
    """Return displacements of rows between two motions, m, and rotation vectors in body axes.

    The rotation vector is the same in the axes before and after, because it is their axis of
    rotation.
    """
    return to_body_axes(space, before, space.displacement_between(before, after))


def to_space_axes(space: Space, motion: Motion, rates: Rates) -> Forces:
    """Return rates of rows with angular ones transformed from the axes of nodes to x, y, z."""
    rotations = space.rotations(motion)
    return rates if rotations is None else _rotate_angular_rates(rotations, rates)


def to_body_axes(space: Space, motion: Motion, rates: Forces) -> Rates:
    """Return rates of rows with angular ones transformed from x, y, z to the axes of nodes."""
    rotations = space.rotations(motion)
    return rates if rotations is None else _rotate_angular_rates(jax.vmap(invert)(rotations), rates)


def _rotate_angular_rates(rotations, rates):
    """Return rates of rows, [n_row, 6], with angular ones, the last three columns, rotated."""
    turned = jax.vmap(rotate)(rotations, rates[:, 3:])
    return jnp.concatenate([rates[:, :3], turned], axis=1)
