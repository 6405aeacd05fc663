"""Pairs of points in second-order cones: their scaling, and the way to the boundary.

A point (a, A) with a number a and a vector A is in the second-order cone if ``a >= |A|``. Here are
pairs of points (u, X) and (N, -V) inside of it, such as a bound of a length beside a vector, and a
tension beside a force. They are complementary, on the boundary both, where ``u N - X.V = 0``.
Where a and |A| are nearly equal, their difference, the *slack*, cannot be computed from them: it is
known beside them.

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

Numbers: TypeAlias = 'Float[Array, " n"]'
Vectors: TypeAlias = 'Float[Array, "n 3"]'


class Scaling(NamedTuple):
    """The Hessian that maps points (u, X) to points (N, -V).

    Attributes:
        stiff: q, [n].
        across: c, [n, 3].
        ratio: r, [n].
        spring: 1/a, [n].
    """

    stiff: Numbers
    across: Vectors
    ratio: Numbers
    spring: Numbers


@jax.jit  # one function in a program, however often it is called
def norm(v: Vectors) -> Numbers:
    """Return the lengths of vectors."""
    return jnp.sqrt(jnp.sum(v * v, axis=-1))


@jax.jit
def products(u: Numbers, x: Vectors, n: Numbers, v: Vectors) -> Numbers:
    """Return ``u N - X.V`` of pairs."""
    return u * n - jnp.sum(x * v, axis=-1)


def wide(numbers: Numbers, v: Vectors) -> Vectors:
    """Return numbers repeated to the shape of vectors."""
    return lax.broadcast_in_dim(numbers, v.shape, (0,))  # `[:, None]` makes two of it


@jax.jit
def scaling(
    u: Numbers, x: Vectors, n: Numbers, v: Vectors, slack: Numbers, other_slack: Numbers
) -> Scaling:
    """Return the `Scaling` of pairs of points (u, X) and (N, -V) with their slacks."""
    size, product = slack * (u + u - slack), products(u, x, n, v)
    stiff = jnp.sqrt(other_slack * (n + n - other_slack) / size)
    normal = x + v / wide(stiff, v)
    # the second term is the larger one, but for rounding
    small = size + jnp.maximum(product / stiff, size)
    large = small + jnp.sum(normal * normal, axis=-1)
    part, across = small / large, normal * wide(lax.rsqrt(large), normal)
    return Scaling(stiff, across, jnp.sqrt(1 + part), part / stiff)


@jax.jit
def rate_to_boundary(
    u: Numbers, x: Vectors, slack: Numbers, du: Numbers, dx: Vectors
) -> Float[Array, ""]:
    """Return the largest rate 1/t at which steps lead points (u, X) to the boundary.

    The step times t leads there. The rate is not positive if steps never do.
    """
    rise = norm(dx)
    square, half = (du - rise) * (du + rise), products(u, x, du, dx)
    size = slack * (u + u - slack)
    # the larger root of size r^2 + 2 half r + square, by the formula without cancellation
    root = jnp.sqrt(half * half - square * size)
    falls = half < 0
    rate = jnp.where(falls, root - half, -square) / jnp.where(falls, size, root + half)
    least = -du / u  # where the axis is left; the root is NaN where the boundary is not met
    return jnp.max(jnp.where(rate > least, rate, least))


@jax.jit
def slack_after(
    x: Vectors, slack: Numbers, du: Numbers, dx: Vectors, part: Float[Array, ""]
) -> Numbers:
    """Return the slacks of points (u, X) after a part of a step, without cancellation."""
    change = part * dx
    after = x + change
    both = jnp.maximum(norm(x) + norm(after), jnp.finfo(slack.dtype).tiny)
    return slack + (part * du - jnp.sum((x + after) * change, axis=-1) / both)


@jax.jit
def boosted(w0: Numbers, w: Vectors, first: Numbers, rest: Vectors) -> tuple[Numbers, Vectors]:
    """Return the Lorentz transforms W of points, for which ``W (1, 0) = (w0, w)``."""
    along = jnp.sum(w * rest, axis=-1)
    return w0 * first + along, rest + wide(first + along / (1 + w0), w) * w


def divided(
    u: Numbers, x: Vectors, size: Numbers, first: Numbers, rest: Vectors
) -> tuple[Numbers, Vectors]:
    """Return the points whose Jordan product with (u, X), of determinant `size`, is (first, rest).

    The product of (a, A) and (b, B) is ``(a b + A.B, a B + b A)``.
    """
    own = products(u, x, first, rest) / size
    return own, (rest - wide(own, x) * x) / wide(u, x)


def correction(
    scaled: Scaling,
    second: tuple[Numbers, Vectors, Numbers],
    steps: tuple[Numbers, Vectors, Numbers, Vectors],
    aim: Numbers,
) -> tuple[Numbers, Vectors]:
    """Return what second points lack so that products are ``aim (1, 0)`` to second order.

    That is ``F (lam \\ (aim (1, 0) - F^-1 (du, dX) o F (dN, -dV)))`` with the root F of the inverse
    of the Hessian of `Scaling`, ``lam = F (N, -V)``, the Jordan product o and the division by it.

    Args:
        scaled: the `Scaling`.
        second: N and V, and the slack of these.
        steps: changes of u, X, N and V.
        aim: less the first numbers of the products of changes, which a scaling leaves as they are.
    """
    (n, v, slack), (du, dx, dn, dv) = second, steps
    stiff, across, ratio, spring = scaled
    factor = lax.rsqrt(stiff * (spring + spring))
    w0, w = ratio * factor, across * wide(factor, across)
    shift, turn = boosted(w0, w, dn, -dv)
    longer, change = boosted(w0, -w, du, dx)
    rest = wide(shift, v) * change + wide(longer, v) * turn
    first, along = boosted(w0, w, n, -v)
    lacks = divided(first, along, slack * (n + n - slack), aim, -rest)
    force, back = boosted(w0, -w, *lacks)
    return stiff * force, wide(stiff, v) * back
