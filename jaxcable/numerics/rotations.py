"""Finite rotations as unit quaternions, scalar first, [4].

Besides quaternions there are rotation vectors, ``angle axis``, and *stereographic* parameters,
``tan(angle / 4) axis``, also called modified Rodrigues parameters. A *spin* is a small rotation
vector in space, applied after the rotation: ``q <- exp_map(spin) q``; rotation vectors are never
added.

Where a formula has 0/0 a series replaces it, and the formula is evaluated at another point, so that
all derivatives exist. Functions that elements call have no such cases at all, because they are
compiled many times.
"""

from __future__ import annotations

import jax
import jax.numpy as jnp
import numpy as np

from ..common.types import Array, Float

IDENTITY = (1.0, 0.0, 0.0, 0.0)
# squared angle (or squared |r|) below which series replace formulas: the terms that they leave out
# are below 2e-18 there, less than the rounding of float64; above it the formulas lose no digits
_SERIES_BELOW = 1e-4


def _bilinear_constants(rows):
    """Return the constants c [k, i, j] of a product ``z_k = sum c_kij x_i y_j``, such as x cross y.

    They are +-1 where the table `rows` has the entry +-(k + 1) in row i, column j, else 0.
    """
    table = np.zeros((len(rows),) * 3)
    for i, row in enumerate(rows):
        for j, entry in enumerate(row):
            if entry:
                table[abs(entry) - 1, i, j] = np.sign(entry)
    return table


# two contractions with small constants compile several times faster than explicit components
_CROSS = _bilinear_constants([[0, 3, -2], [-3, 0, 1], [2, -1, 0]])
_QUATERNION_PRODUCT = _bilinear_constants(
    [[1, 2, 3, 4], [2, -1, 4, -3], [3, -4, -1, 2], [4, 3, -2, -1]]
)


def cross(a: Float[Array, " 3"], b: Float[Array, " 3"]) -> Float[Array, " 3"]:
    """Return the vector product of `a` and `b`, [3]."""
    return (jnp.asarray(_CROSS, b.dtype) @ b) @ a


def compose(p: Float[Array, " 4"], q: Float[Array, " 4"]) -> Float[Array, " 4"]:
    """Return the product p q of two quaternions: the rotation first by `q` and then by `p`, [4]."""
    return (jnp.asarray(_QUATERNION_PRODUCT, q.dtype) @ q) @ p


# the matrix of a rotation, as a quadratic form of its quaternion
_MATRIX = np.zeros((3, 3, 4, 4))
for _k in range(3):
    _i, _j = (_k + 1) % 3, (_k + 2) % 3
    _MATRIX[_k, _k] = np.diag([1.0, -1.0, -1.0, -1.0])
    _MATRIX[_k, _k, _k + 1, _k + 1] = 1.0
    _MATRIX[_i, _j, _i + 1, _j + 1] = _MATRIX[_j, _i, _i + 1, _j + 1] = 2.0
    _MATRIX[_j, _i, 0, _k + 1], _MATRIX[_i, _j, 0, _k + 1] = 2.0, -2.0


def to_matrix(q: Float[Array, " 4"]) -> Float[Array, "3 3"]:
    """Convert a unit quaternion to a rotation matrix: ``to_matrix(q) @ v`` is ``rotate(q, v)``."""
    table = jnp.asarray(_MATRIX.reshape(9, 16), q.dtype)
    return (table @ jnp.outer(q, q).ravel()).reshape(3, 3)


def invert(q: Float[Array, " 4"]) -> Float[Array, " 4"]:
    """Return the quaternion of the inverse rotation: the conjugate of `q`."""
    return q * jnp.array([1.0, -1.0, -1.0, -1.0], q.dtype)


def normalize(q: Float[Array, " 4"]) -> Float[Array, " 4"]:
    """Return the quaternion `q` scaled to length 1."""
    return q / jnp.sqrt(q @ q)


def rotate(q: Float[Array, " 4"], v: Float[Array, " 3"]) -> Float[Array, " 3"]:
    """Return the vector `v` rotated by the unit quaternion `q` (scalar first), [3]."""
    t = 2 * cross(q[1:], v)
    return v + q[0] * t + cross(q[1:], t)


def exp_map(spin: Float[Array, " 3"]) -> Float[Array, " 4"]:
    """Convert a rotation vector ``angle axis`` to a unit quaternion, [4]."""
    square = spin @ spin
    small = square < _SERIES_BELOW
    angle = jnp.sqrt(jnp.where(small, 1.0, square))
    t = jnp.where(small, square, 0.0)
    cosine = 1 - t / 8 * (1 - t / 48 * (1 - t / 120))
    sine = 0.5 * (1 - t / 24 * (1 - t / 80))
    w = jnp.where(small, cosine, jnp.cos(angle / 2))
    factor = jnp.where(small, sine, jnp.sin(angle / 2) / angle)
    return jnp.append(w[None], factor * spin)


def to_stereographic(q: Float[Array, " 4"]) -> Float[Array, " 3"]:
    """Convert a unit quaternion to ``r = tan(angle / 4) axis``, [3]; smooth below half a turn."""
    q = jnp.where(q[0] < 0, -q, q)  # q and -q are one rotation
    return q[1:] / (1 + q[0])


def _angle_factor_and_slope(t):
    """Return the factor ``f = 4 atan(s) / s``, and its slope ``df / dt``, by series in t.

    With the parameters ``r = tan(angle / 4) axis``, s = |r| and ``t = s^2 = tan(angle / 4)^2``, the
    rotation vector is ``f r``. For small angles only.
    """
    value = 4 * (1 - t * (1 / 3 - t * (1 / 5 - t * (1 / 7 - t / 9))))
    slope = 4 * (-1 / 3 + t * (2 / 5 - t * (3 / 7 - t * 4 / 9)))
    return value, slope


def small_stereographic_to_rotation_vector(r: Float[Array, " 3"]) -> Float[Array, " 3"]:
    """Convert ``r = tan(angle / 4) axis`` to the rotation vector ``angle axis``, for small angles.

    By a series without branches. The relative error of the angle is 1e-15 at 10, 1e-11 at 23, 1e-7
    at 45 degrees.
    """
    return _angle_factor_and_slope(r @ r)[0] * r


def moment_conjugate_to_spin(
    r: Float[Array, " 3"], moment: Float[Array, " 3"]
) -> Float[Array, " 3"]:
    """Transform a moment conjugate to a rotation vector to the moment conjugate to spins, N m.

    The work of both is equal: a spin w changes r by ``[(1 - r^2) w - 2 r x w + 2 r (r.w)] / 4``
    (Schaub and Junkins 1996).

    Args:
        r: the rotation, ``tan(angle / 4) axis``, small.
        moment: conjugate to ``small_stereographic_to_rotation_vector(r)``, N m.
    """
    t = r @ r
    value, slope = _angle_factor_and_slope(t)
    of_r = value * moment + 2 * slope * (r @ moment) * r  # conjugate to r
    return 0.25 * ((1 - t) * of_r + 2 * cross(r, of_r) + 2 * (r @ of_r) * r)


def from_stereographic(r: Float[Array, " 3"]) -> Float[Array, " 4"]:
    """Convert ``r = tan(angle / 4) axis`` to a unit quaternion; for any angle below a full turn."""
    t = r @ r
    return jnp.append((1 - t)[None], 2 * r) / (1 + t)


def moment_conjugate_to_stereographic(
    r: Float[Array, " 3"], moment: Float[Array, " 3"]
) -> Float[Array, " 3"]:
    """Transform a moment conjugate to spins to one conjugate to ``r = tan(angle / 4) axis``."""
    t = r @ r
    return 4 / (1 + t) ** 2 * ((1 - t) * moment - 2 * cross(r, moment) + 2 * (r @ moment) * r)


def stereographic_to_rotation_vector(r: Float[Array, " 3"]) -> Float[Array, " 3"]:
    """Convert ``r = tan(angle / 4) axis`` to ``angle axis``, [3]; for angles below a full turn."""
    t = r @ r
    small = t < _SERIES_BELOW
    size = jnp.sqrt(jnp.where(small, 1.0, t))
    series = _angle_factor_and_slope(jnp.where(small, t, 0.0))[0]
    return jnp.where(small, series, 4 * jnp.arctan(size) / size) * r


@jax.jit
def rotation_vectors(quaternions: Float[Array, "*n 4"]) -> Float[Array, "*n 3"]:
    """Convert unit quaternions to rotation vectors ``angle axis``, angles from 0 to pi."""

    def one(q):
        return stereographic_to_rotation_vector(to_stereographic(q))

    for _ in range(quaternions.ndim - 1):
        one = jax.vmap(one)
    return one(quaternions)


def halfway_rotation(p: Float[Array, " 4"], q: Float[Array, " 4"]) -> Float[Array, " 4"]:
    """Return the unit quaternion of the rotation halfway between the rotations `p` and `q`."""
    return normalize(p + jnp.where(p @ q < 0, -q, q))


def shortest_rotation(
    a: Float[Array, " 3"], b: Float[Array, " 3"], change: Float[Array, " 3"]
) -> Float[Array, " 4"]:
    """Return the quaternion of the smallest rotation that takes unit vector `a` to unit vector `b`.

    `change` is ``b - a``, which the caller may know to more digits than a subtraction gives. The
    vectors must not be opposite.
    """
    return normalize(jnp.append((1 + a @ b)[None], cross(a, change)))


def move_node(motion: Float[Array, " 7"], step: Float[Array, " 6"]) -> Float[Array, " 7"]:
    """Return the motion of a node after a step: the translation is added, the spin applied.

    Args:
        motion: displacement, m, and unit quaternion of the node.
        step: translation, m, and spin (rotation vector in space).
    """
    return jnp.concatenate(
        [motion[:3] + step[:3], normalize(compose(exp_map(step[3:]), motion[3:]))]
    )


def move_node_by_series(
    motion: Float[Array, " 7"], step: Float[Array, " 6"], order: int = 5
) -> Float[Array, " 7"]:
    """Return the motion of a node after a step, by a series in the spin of order 1 or 5.

    It replaces `move_node` for derivatives at a zero step, which are exact up to this order: a
    polynomial compiles faster, and has no case for small angles.
    """
    return jnp.concatenate(
        [motion[:3] + step[:3], compose(exp_map_by_series(step[3:], order), motion[3:])]
    )


def exp_map_by_series(spin: Float[Array, " 3"], order: int = 5) -> Float[Array, " 4"]:
    """Convert a rotation vector `spin` to a quaternion by a series of order 1 or 5.

    It is for derivatives at a zero spin, which are exact up to this order: a polynomial compiles
    faster, and has no case for small angles.
    """
    if order == 1:
        return jnp.append(jnp.ones_like(spin[:1]), 0.5 * spin)
    t = spin @ spin
    return jnp.append((1 - t / 8 * (1 - t / 48))[None], 0.5 * (1 - t / 24 * (1 - t / 80)) * spin)


def conjugate_moment(
    spin: Float[Array, " 3"], moment: Float[Array, " 3"], order: int = 5
) -> Float[Array, " 3"]:
    """Transform a moment fixed in space to the one conjugate to a rotation vector `spin`, [3].

    At ``exp_map(spin)`` a change d of the vector is a further spin ``T d`` with the tangent
    operator ``T = sum_k [spin x]^k / (k + 1)!``; the result is ``T^T moment``, for derivatives at a
    zero spin up to `order`. It linearizes a moment that keeps its direction, which has no
    potential.
    """
    term = total = moment
    for k in range(2, order + 2):
        term = -cross(spin, term) / k
        total = total + term
    return total
