"""Finite rotations as unit quaternions, scalar first, [4].

A node's rotation is a state that is turned on, ``q <- exp(spin) q``, never a vector that is added
to. Every function is smooth where its formula has 0/0, in all derivatives that a Hessian of an
analysis needs: a series takes over there, and the formula is kept away from the point.
"""

import jax
import jax.numpy as jnp
import numpy as np

IDENTITY = (1.0, 0.0, 0.0, 0.0)
_SMALL = 1e-4  # of a squared angle: the series below are then exact to rounding


def _structure(rows):
    """Constants c_ijk of a bilinear map from its table: +-(k + 1) in row i, column j."""
    table = np.zeros((len(rows),) * 3)
    for i, row in enumerate(rows):
        for j, entry in enumerate(row):
            if entry:
                table[abs(entry) - 1, i, j] = np.sign(entry)
    return table


# two small contractions compile several times faster than the components written out
_CROSS = _structure([[0, 3, -2], [-3, 0, 1], [2, -1, 0]])
_PRODUCT = _structure([[1, 2, 3, 4], [2, -1, 4, -3], [3, -4, -1, 2], [4, 3, -2, -1]])


def cross(a, b):
    """Vector product of `a` and `b`, [3]."""
    return (jnp.asarray(_CROSS, b.dtype) @ b) @ a


def product(p, q):
    """Rotation by `q`, then by `p`."""
    return (jnp.asarray(_PRODUCT, q.dtype) @ q) @ p


def inverse(q):
    """The rotation back."""
    return q * jnp.array([1.0, -1.0, -1.0, -1.0], q.dtype)


def unit(q):
    """`q` at length 1."""
    return q / jnp.sqrt(q @ q)


def rotate(q, v):
    """The vector `v` [3] turned by `q`."""
    t = 2 * cross(q[1:], v)
    return v + q[0] * t + cross(q[1:], t)


def exp(spin):
    """Rotation by the angle |spin| about the axis `spin`, [3]."""
    square = spin @ spin
    small = square < _SMALL
    angle = jnp.sqrt(jnp.where(small, 1.0, square))
    t = jnp.where(small, square, 0.0)
    cosine = 1 - t / 8 * (1 - t / 48 * (1 - t / 120))
    sine = 0.5 * (1 - t / 24 * (1 - t / 80))
    w = jnp.where(small, cosine, jnp.cos(angle / 2))
    factor = jnp.where(small, sine, jnp.sin(angle / 2) / angle)
    return jnp.append(w[None], factor * spin)


def log(q):
    """Rotation vector of `q`, [3]: the axis times an angle up to pi."""
    q = jnp.where(q[0] < 0, -q, q)  # q and -q are one rotation
    w, v = q[0], q[1:]
    square = v @ v
    small = square < _SMALL * w**2
    t = jnp.where(small, square, 0.0) / jnp.where(small, w, 1.0) ** 2
    series = 1 - t * (1 / 3 - t * (1 / 5 - t / 7))  # atan(r)/r with r^2 = t
    sine = jnp.sqrt(jnp.where(small, 1.0, square))
    factor = jnp.where(
        small, 2 * series / jnp.where(small, w, 1.0), 2 * jnp.arctan2(sine, w) / sine
    )
    return factor * v


def middle(p, q):
    """The rotation halfway between `p` and `q`."""
    return unit(p + jnp.where(p @ q < 0, -q, q))


def shortest(a, b):
    """The smallest rotation that takes the unit vector `a` to `b`; not for opposite ones."""
    return unit(jnp.append((1 + a @ b)[None], cross(a, b)))


def turned(motion, step):
    """A node's displacement and rotation [7] after a step: translation and spin [6]."""
    return jnp.concatenate([motion[:3] + step[:3], unit(product(exp(step[3:]), motion[3:]))])


def conjugate(spin, moment):
    """Moment that does the work of the spatial `moment` on changes of the rotation vector `spin`.

    At ``exp(spin)`` a change d of the vector is a spin ``T d``; the result is ``T^T moment``. With it
    a moment that keeps its direction is linearised exactly (it has no potential).
    """
    back = inverse(exp(spin))

    def small_turn(vector):
        return 2 * product(exp(vector), back)[1:]  # rotation vector for a vanishing change

    return jax.vjp(small_turn, spin)[1](moment)[0]
