"""The frame that follows a straight element with two ends, and the statics of forces in it.

The frame follows the chord and the mean of the rotations of the ends (Crisfield 1990; Battini and
Pacoste 2002). Relative to it the rotations of the ends are small, and zero after a rigid motion of
any size. Forces in the frame come from a law of the element (`beam`, `bending`). The nodal forces
follow from virtual work, written out here instead of derived by autodiff, so that a tangent takes
one derivative and not two.

With the spins ``w_1, w_2`` of the ends, ``w_E`` of the frame and the relative translation ``v``,

    dW = N dl + M_1.(w_1 - w_E) + M_2.(w_2 - w_E) - T.w_E,   w_E = b x v / l + tau b,

with ``b`` along the chord and ``T`` the moment of loads that do not turn with the frame. The mean
rotation takes the initial axis to ``a``; the frame follows it, and then the smallest rotation from
``a`` to ``b``. This one has no spin along ``a + b``, hence with the spin ``w_m`` of the mean

    (w_E - w_m).(a + b) = 0.

The mean is halfway between the ends: with ``(c, h)`` the quaternion of half the rotation from the
first to the second,
``w_m = (w_1 + w_2)/2 + (w_2 - w_1) x h / 2c``.
"""

from __future__ import annotations

import jax
import jax.numpy as jnp

from ..common.tree import pytree
from ..common.types import Array, Float
from ..numerics.rotations import (
    compose,
    cross,
    halfway_rotation,
    invert,
    moment_conjugate_to_spin,
    shortest_rotation,
    small_stereographic_to_rotation_vector,
    to_matrix,
    to_stereographic,
)
from ..numerics.vectors import scalar_product
from .element import Scalar
from .element_state import Pressures
from .prestress import measure_chord


@pytree
class Pose:
    """Position of an element, and its deformation in the frame that follows it.

    Attributes:
        length: of the chord, m.
        change: change of the chord's length, computed without subtracting lengths, m.
        mean: direction a that the mean rotation gives the initial axis, [3].
        chord: direction b of the chord, [3].
        axes: axes of the element after its rotation, [3, 3], one in each row of the matrix.
        half_rotation: half of the rotation between the ends, quaternion [4].
        end_rotations: rotations of the ends relative to the frame, along its axes, as vectors
            ``tan(angle / 4) axis`` (`to_stereographic`), [2, 3].
        rotations: `end_rotations` as rotation vectors, minus those of the unstressed element,
            [2, 3], rad.
    """

    length: Scalar
    change: Scalar
    mean: Float[Array, " 3"]
    chord: Float[Array, " 3"]
    axes: Float[Array, "3 3"]
    half_rotation: Float[Array, " 4"]
    end_rotations: Float[Array, "2 3"]
    rotations: Float[Array, "2 3"]


def pose(
    axes: Float[Array, "3 3"],
    ends: Float[Array, "2 3"],
    displacements: Float[Array, "2 3"],
    quaternions: Float[Array, "2 4"],
    kinks: Float[Array, "2 3"] | None = None,
) -> Pose:
    """Return the `Pose` of an element from the motion of its ends.

    Args:
        axes: initial axes, one unit vector in each row: along the chord, the section's y and z.
        ends: initial positions of both ends, m.
        displacements: of both ends, m.
        quaternions: rotations of both ends from the initial state, unit quaternions, scalar first.
        kinks: rotation vectors of the ends at which the element is unstressed; None: zero.
    """
    vector, length, change, _ = measure_chord(ends, displacements)
    halfway = halfway_rotation(*quaternions)
    # a small rotation is a difference of directions: take both as changes of the initial axis
    turned = 2 * cross(halfway[1:], axes[0])
    turned = halfway[0] * turned + cross(halfway[1:], turned)
    swung = (displacements[1] - displacements[0] - change * axes[0]) / length
    mean, chord = axes[0] + turned, vector / length
    frame = compose(shortest_rotation(mean, chord, swung - turned), halfway)
    back = invert(frame)
    turns = jax.vmap(lambda q: axes @ to_stereographic(compose(back, q)))(quaternions)
    half = compose(quaternions[1], invert(halfway))
    half = jnp.where(half[0] < 0, -half, half)
    rotations = jax.vmap(small_stereographic_to_rotation_vector)(turns)
    if kinks is not None:
        rotations = rotations - kinks
    turned = axes @ to_matrix(frame).T
    return Pose(length, change, mean, chord, turned, half, turns, rotations)


def pressure_load(
    pose: Pose, pressures: Pressures, rest_length: Scalar
) -> tuple[Float[Array, " 3"], Float[Array, " 3"], Float[Array, "3 3"]]:
    """Return the load of pressures per unstressed length, on rotated axes, and two derivatives.

    Args:
        pose: of the element.
        pressures: `ElementLoad.pressures` of the element.
        rest_length: unstressed length, m.

    Returns:
        The load, [3], N/m. Its derivative by the length of the chord, [3], N/m2. A matrix [3, 3]
        that gives, times the derivative of the potential by the load, the moment on the frame
        beyond that of a dead load; zero where a pressure has no potential.
    """
    load, longer = jnp.zeros_like(pose.chord), jnp.zeros_like(pose.chord)
    torque = jnp.zeros_like(pose.axes)
    for pressure, axis in pressures.get("current", ()):
        x, y, z = pose.axes @ axis
        none = jnp.zeros_like(x)
        change = pressure / rest_length * jnp.stack([none, z, -y])  # axis x chord
        load, longer = load + change * pose.length, longer + change
        by_frame = jnp.stack([none, none, none, y, -x, none, z, none, -x]).reshape(3, 3)
        torque = torque + pressure * pose.length / rest_length * by_frame
    for pressure, axis in pressures.get("unstressed", ()):
        _, y, z = pose.axes @ axis
        seen = y**2 + z**2  # zero for a chord along the axis
        across = jnp.stack([jnp.zeros_like(y), z, -y]) / jnp.sqrt(jnp.where(seen > 0, seen, 1.0))
        load = load + pressure * across
    return load, longer, torque


def end_forces(
    pose: Pose, force: Scalar, moments: Float[Array, "2 3"], torque: Float[Array, " 3"]
) -> tuple[Float[Array, " 3"], Float[Array, "2 3"]]:
    """Return the force on the second end [3], N, and moments on both ends [2, 3], N m, in space.

    Args:
        pose: of the element.
        force: axial force, conjugate to the length of the chord, N.
        moments: conjugate to the rotation vectors ``pose.rotations``, [2, 3], N m.
        torque: moment of loads that do not rotate with the frame, [3], N m. Its components, and
            those of `moments`, are along the rotated axes.
    """
    by_spin = jax.vmap(moment_conjugate_to_spin)(pose.end_rotations, moments)
    first, second = by_spin @ pose.axes
    onto = first + second + torque @ pose.axes
    along = scalar_product(onto, pose.chord) / (1 + scalar_product(pose.mean, pose.chord))
    shared = along * (pose.mean + pose.chord)
    skew = cross(pose.half_rotation[1:], shared) / (2 * pose.half_rotation[0])
    pull = force * pose.chord - cross(onto - along * pose.mean, pose.chord) / pose.length
    return pull, jnp.stack([first - 0.5 * shared + skew, second - 0.5 * shared - skew])
