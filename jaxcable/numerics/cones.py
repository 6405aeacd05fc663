"""Second-order cones for interior-point methods: scaling, steps to the boundary, corrector.

A point (a, A) with a number a and a vector A is in the second-order cone if ``a >= |A|``. The
functions take pairs of points (u, X) and (N, -V) in its interior, such as an upper bound of a
length beside the vector, and a tension beside the force. The points are complementary, both on the
boundary, where ``u N - X.V = 0``. Where a and |A| are nearly equal, their difference, the *slack*
``a - |A|``, loses its digits if it is computed from them; hence it is stored beside them.

The Hessian of the cone's barrier at the scaling point of Nesterov and Todd maps the first point to
the second one,

    [[ a, -a h' ], [ -a h, D ]] (u, X) = (N, -V),         D = q (I - c c') + a h h',

with ``h = r c`` and, in terms of ``n = X + V/q``, ``d = u^2 - |X|^2``, ``p = u N - X.V``,

    q^2 = (N^2 - |V|^2) / d,    B = d + p/q,    E = B + |n|^2,
    c = n / E^(1/2),    r^2 = 1 + B/E,    1/a = B / (q E).

Sources: Nesterov, Todd, "Primal-dual interior-point methods for self-scaled cones" (1998); Lobo,
Vandenberghe, Boyd, Lebret, "Applications of second-order cone programming" (1998); Andersen, Roos,
Terlaky, "On implementing a primal-dual interior-point method for conic quadratic optimization"
(2003). (The form above was derived for this package: nothing in it cancels.)
"""

from __future__ import annotations

from typing import NamedTuple, TypeAlias

import jax
import jax.numpy as jnp
from jax import lax

from ..common.types import Array, Float

Scalars: TypeAlias = 'Float[Array, " n"]'
Vectors: TypeAlias = 'Float[Array, "n 3"]'


class ConeScaling(NamedTuple):
    """Nesterov-Todd scaling of n pairs of points in the cone: a matrix that maps (u, X) to (N, -V).

    The matrix is ``[[a, -a h'], [-a h, D]]`` with ``D = q (I - c c') + a h h'`` and ``h = r c``.

    Attributes:
        stiff: q, [n].
        axis: c, [n, 3].
        ratio: r, [n].
        spring: 1/a, [n].
    """

    stiff: Scalars
    axis: Vectors
    ratio: Scalars
    spring: Scalars


@jax.jit  # one function in a program, however often it is called
def norm(v: Vectors) -> Scalars:
    """Return the Euclidean norm of every vector, [n]."""
    return jnp.sqrt(jnp.sum(v * v, axis=-1))


@jax.jit
def lorentz_products(u: Scalars, x: Vectors, n: Scalars, v: Vectors) -> Scalars:
    """Return the Lorentz product ``u N - X.V`` of every pair, [n]; zero if it is complementary."""
    return u * n - jnp.sum(x * v, axis=-1)


def repeat_for_vectors(numbers: Scalars, v: Vectors) -> Vectors:
    """Return the number of every vector three times, once for each component, [n, 3]."""
    return lax.broadcast_in_dim(numbers, v.shape, (0,))  # `[:, None]` makes two operations of it


@jax.jit
def nesterov_todd_scaling(
    u: Scalars, x: Vectors, n: Scalars, v: Vectors, slack: Scalars, other_slack: Scalars
) -> ConeScaling:
    """Return the Nesterov-Todd `ConeScaling` of points (u, X) and (N, -V) in the cone.

    Args:
        u, x: the first points, [n] and [n, 3].
        n, v: N and V of the second points, [n] and [n, 3].
        slack, other_slack: ``u - |X|`` and ``N - |V|``, [n], without cancellation.
    """
    size, product = slack * (u + u - slack), lorentz_products(u, x, n, v)
    stiff = jnp.sqrt(other_slack * (n + n - other_slack) / size)
    normal = x + v / repeat_for_vectors(stiff, v)
    # the second term is the larger one, but for rounding
    small = size + jnp.maximum(product / stiff, size)
    large = small + jnp.sum(normal * normal, axis=-1)
    part, axis = small / large, normal * repeat_for_vectors(lax.rsqrt(large), normal)
    return ConeScaling(stiff, axis, jnp.sqrt(1 + part), part / stiff)


@jax.jit
def inverse_step_to_boundary(
    u: Scalars, x: Vectors, slack: Scalars, du: Scalars, dx: Vectors
) -> Float[Array, ""]:
    """Return 1/t for the smallest step length t > 0 at which any of the points leaves the cone.

    One number for all points (u, X) with steps (du, dX) and slacks ``u - |X|``; it is not positive
    if no point ever leaves the cone along its step.
    """
    rise = norm(dx)
    square, half = (du - rise) * (du + rise), lorentz_products(u, x, du, dx)
    size = slack * (u + u - slack)
    # the larger root of size r^2 + 2 half r + square, by the formula without cancellation
    root = jnp.sqrt(half * half - square * size)
    falls = half < 0
    rate = jnp.where(falls, root - half, -square) / jnp.where(falls, size, root + half)
    least = -du / u  # where the axis is left; the root is NaN where the boundary is not met
    return jnp.max(jnp.where(rate > least, rate, least))


@jax.jit
def slack_after_step(
    x: Vectors, slack: Scalars, du: Scalars, dx: Vectors, part: Float[Array, ""]
) -> Scalars:
    """Return the slacks ``u - |X|``, [n], after steps (du, dX) of the length `part`, a scalar.

    Args:
        x, slack: X and ``u - |X|`` before the step, [n, 3] and [n].
        du, dx: the whole steps of u and X.
        part: the part of them that is made, 0 to 1. Nothing cancels.
    """
    change = part * dx
    after = x + change
    both = jnp.maximum(norm(x) + norm(after), jnp.finfo(slack.dtype).tiny)
    return slack + (part * du - jnp.sum((x + after) * change, axis=-1) / both)


@jax.jit
def apply_lorentz_boost(
    w0: Scalars, w: Vectors, first: Scalars, rest: Vectors
) -> tuple[Scalars, Vectors]:
    """Return W (first, rest), point by point, for the Lorentz boost W with ``W (1, 0) = (w0, w)``.

    Numbers are [n], vectors [n, 3]; ``w0^2 - |w|^2 = 1``.
    """
    along = jnp.sum(w * rest, axis=-1)
    return w0 * first + along, rest + repeat_for_vectors(first + along / (1 + w0), w) * w


def jordan_quotient(
    u: Scalars, x: Vectors, size: Scalars, first: Scalars, rest: Vectors
) -> tuple[Scalars, Vectors]:
    """Divide by points: return the points whose Jordan product with (u, X) is (first, rest).

    The Jordan product of (a, A) and (b, B) is ``(a b + A.B, a B + b A)``.

    Args:
        u, x: the divisors.
        size: their determinants, ``u^2 - |X|^2``.
        first, rest: the dividends.
    """
    own = lorentz_products(u, x, first, rest) / size
    return own, (rest - repeat_for_vectors(own, x) * x) / repeat_for_vectors(u, x)


def second_order_corrector(
    scaled: ConeScaling,
    second: tuple[Scalars, Vectors, Scalars],
    steps: tuple[Scalars, Vectors, Scalars, Vectors],
    aim: Scalars,
) -> tuple[Scalars, Vectors]:
    """Return the second-order (Mehrotra) corrector, the right side of the equations of products.

    With the matrix H of `ConeScaling` these are ``H (du, dX) + (N + dN, -V - dV) = corrector``. The
    Jordan products o of the scaled points are then ``m (1, 0)`` to second order. The corrector is

        F^-1 (lam \\ (m (1, 0) - F^-1 (du, dX) o F (dN, -dV)))

    with the changes of the predictor, the square root F of the inverse of H, ``lam = F (N, -V)``
    and the division \\, the inverse of the Jordan product (`jordan_quotient`).

    Args:
        scaled: the scaling of the points.
        second: N and V, [n] and [n, 3], and their slack ``N - |V|``, [n].
        steps: predicted changes of u, X, N and V.
        aim: m less ``du dN - dX.dV``, [n]: the first number of the Jordan product of the changes,
            which does not depend on the scaling, is subtracted here already.

    Returns:
        The number of the corrector of every point, [n], and its vector, [n, 3].
    """
    (n, v, slack), (du, dx, dn, dv) = second, steps
    stiff, axis, ratio, spring = scaled
    factor = lax.rsqrt(stiff * (spring + spring))
    w0, w = ratio * factor, axis * repeat_for_vectors(factor, axis)
    shift, turn = apply_lorentz_boost(w0, w, dn, -dv)
    longer, change = apply_lorentz_boost(w0, -w, du, dx)
    rest = repeat_for_vectors(shift, v) * change + repeat_for_vectors(longer, v) * turn
    first, along = apply_lorentz_boost(w0, w, n, -v)
    lacks = jordan_quotient(first, along, slack * (n + n - slack), aim, -rest)
    force, back = apply_lorentz_boost(w0, -w, *lacks)
    return stiff * force, repeat_for_vectors(stiff, v) * back
