"""A matrix with one more row and column: regular where the matrix alone is singular.

    [ K  c ] [x]   [b]
    [ r  d ] [y] = [e]

With K the tangent stiffness and c the derivative of the residual by the load factor it stays
regular at limit points (Keller 1977). Sparse matrices are eliminated by blocks and the result is
improved once by its own residual, which makes up for a K that is nearly singular.
"""

import jax.numpy as jnp
import jax.scipy.linalg as jsl
from jax import lax

from . import sparse
from .pattern import Sparse


def solve_bordered(matrix, column, row, corner, rhs, last, loose):
    """Solve with a bordered matrix; not differentiable.

    Args:
        matrix: K, [n, n].
        column, row: c and r, [n].
        corner: d, scalar.
        rhs, last: b, [n], and e, scalar.
        loose: unknowns with empty rows and columns, which stay zero, [n] bool.

    Returns:
        x [n], y, and whether the bordered matrix is regular to working precision.
    """
    column, row, rhs = (jnp.where(loose, 0.0, v) for v in (column, row, rhs))
    if isinstance(matrix, Sparse) and matrix.pattern.solver != "dense":
        return _by_blocks(matrix, column, row, corner, rhs, last, loose)
    full = matrix.dense() if isinstance(matrix, Sparse) else matrix
    return _whole(lax.stop_gradient(full), column, row, corner, rhs, last, loose)


def _whole(matrix, column, row, corner, rhs, last, loose):
    n = len(rhs)
    matrix = jnp.where(loose[:, None] | loose[None, :], jnp.eye(n, dtype=matrix.dtype), matrix)
    size = jnp.sqrt(jnp.abs(jnp.diagonal(matrix)))
    size = jnp.where(size > 0, size, 1.0)
    # unknowns y and the last equation are scaled so that pivots can be compared
    width, height = _largest(column / size), jnp.maximum(_largest(row / size), 0.0)
    height = jnp.maximum(height, jnp.abs(corner) / width)
    bordered = jnp.block(
        [
            [matrix / size[:, None] / size[None, :], (column / size / width)[:, None]],
            [(row / size / height)[None, :], (corner / width / height).reshape(1, 1)],
        ]
    )
    lu, pivot = jsl.lu_factor(bordered)
    pivots = jnp.abs(jnp.diagonal(lu))
    limit = (n + 1) * jnp.finfo(matrix.dtype).eps * jnp.max(pivots, initial=0.0)
    regular = jnp.all(pivots > limit) & jnp.all(jnp.isfinite(pivots))
    solution = jsl.lu_solve((lu, pivot), jnp.append(rhs / size, last / height))
    return solution[:-1] / size, solution[-1] / width, regular


def _largest(v):
    """Largest size of an entry; 1 of nothing, so that it can divide."""
    largest = jnp.max(jnp.abs(v), initial=0.0)
    return jnp.where(largest > 0, largest, 1.0)


def _by_blocks(matrix, column, row, corner, rhs, last, loose):
    factor = sparse.factorize(matrix, loose)

    def solve(b):
        return jnp.where(loose, 0.0, factor.solve(b, lambda v: matrix @ v))

    along = solve(column)
    schur = corner - row @ along

    def eliminate(b, e):
        x = solve(b)
        y = (e - row @ x) / schur
        return x - y * along, y

    x, y = eliminate(rhs, last)
    left = jnp.where(loose, 0.0, rhs - matrix @ x - column * y)
    dx, dy = eliminate(left, last - row @ x - corner * y)
    x, y = x + dx, y + dy
    left = jnp.where(loose, 0.0, rhs - matrix @ x - column * y)
    terms = _size(rhs) + _size(column * y) + _size(matrix @ x)
    close = _size(left) <= jnp.cbrt(jnp.finfo(rhs.dtype).eps) * terms
    return x, y, close & jnp.all(jnp.isfinite(x)) & jnp.isfinite(y)


def _size(v):
    return jnp.max(jnp.abs(v), initial=0.0)
