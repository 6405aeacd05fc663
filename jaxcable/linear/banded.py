"""Symmetric positive definite banded solves for batches of small systems on CPU.

XLA runs a loop over columns of one small matrix as a string of tiny kernels. Here the cases of a
batch are the last axis, so that each kernel works on many cases in vector registers, and the batch
is solved in chunks whose window of the factor stays in cache. `solve_banded` takes one case; under
`jax.vmap`, however deep, it becomes one such program.

Storage of a matrix A with half-bandwidth b: ``band[k, i] = A[k + i, k]``, [n, b + 1], which is the
transpose of the lower form of `scipy.linalg.solveh_banded`. Entries past the last row (k + i >= n)
have no influence, but must be finite.

The solve is not differentiable by itself: put it into `lax.custom_linear_solve`.

Three modules have Cholesky's method for bands, because none does what the two others do. Below are
microseconds per solve in a loop of ten, of one matrix and of 64 at once (jaxlib 0.10.2, two cores,
float64; float32 takes up to half as long in jax), and lines of StableHLO for every solve in the
program:

| unknowns, half-bandwidth | here | `rolling` | `lapack`, by a call of the host |
|---|---|---|---|
| 300, 20: one, fused loops | 41 | 33 | 41, and ends the fused function |
| 300, 20: one | 66 | 168 | 42 |
| 300, 20: 64 | 1 370 | 6 270 | 4 470 |
| 900, 30: one, fused loops | 234 | 184 | 173 |
| 900, 30: one | 234 | 920 | 198 |
| 900, 30: 64 | 23 000 | 96 000 | 27 000 |
| lines of the program | 1 110, 1 580 | 280 | 25 |

So `rolling` is for programs of fused loops, this module for batches, and LAPACK for all else; only
LAPACK solves with matrices that are not definite. Solutions differ by some roundings (1e-15).
"""

from __future__ import annotations

import jax.numpy as jnp
from jax import lax
from jax.custom_batching import custom_vmap

from ..common.types import Array, Bool, Float

# Bytes of one entry for all cases of a chunk at most: with 32 cases of float64 the window of the
# factor stays in cache.
_CHUNK_ROW_BYTES = 256
_VECTOR_CASES = 4  # divides the cases of a chunk: float64 in a vector register (AVX2)
# Segments of a column at most, rows of a segment at least: more segments skip more products that
# are zero, but make a longer program.
_SEGMENTS, _SEGMENT = 6, 4


def solve_banded(
    band: Float[Array, "n b+1"], rhs: Float[Array, " n"]
) -> tuple[Float[Array, " n"], Bool[Array, ""]]:
    """Solve one banded, symmetric positive definite system; map with `jax.vmap` for many.

    Args:
        band: lower band of the matrix A, ``band[k, i] = A[k + i, k]``, [n, b + 1].
        rhs: right side, [n].

    Returns:
        Solution [n], and whether the matrix is (numerically) positive definite; if not, the
        solution is meaningless.
    """
    x, definite = _solve_banded_batch(band[None], rhs[None, :, None])
    return x[0, :, 0], definite[0]


@custom_vmap
def _solve_banded_batch(band, rhs):
    """Solve B banded systems with q right sides each, in chunks of cases that stay in cache.

    Takes lower bands [B, n, b + 1] and right sides [B, n, q]; returns solutions [B, n, q], and
    whether each matrix is positive definite, [B].
    """
    cases, n, width = band.shape
    sides = rhs.shape[2]
    most = _CHUNK_ROW_BYTES // band.dtype.itemsize
    chunks = -(-cases // most)
    size = min(cases, -(-cases // (chunks * _VECTOR_CASES)) * _VECTOR_CASES)
    segment = min(width, max(_SEGMENT, -(-width // _SEGMENTS)))

    def step(chunk, carry):
        factor, x, definite = carry
        at = chunk * size  # slices past the end are moved back: the last chunk overlaps
        band_part = _read_slice(band, (at, 0, 0), (size, n, width))
        rhs_part = _read_slice(rhs, (at, 0, 0), (size, n, sides))
        factor, x_part, definite_part = _cholesky_solve_chunk(
            factor, jnp.transpose(band_part, (1, 2, 0)), jnp.transpose(rhs_part, (1, 2, 0))
        )
        x = _write_slice(x, jnp.transpose(x_part, (2, 0, 1)), (at, 0, 0))
        return factor, x, _write_slice(definite, definite_part, (at,))

    # zero before the first column and below the band; no chunk writes there
    factor = jnp.zeros((width - 1 + n, width - 1 + segment, size), band.dtype)
    carry = (factor, jnp.zeros_like(rhs), jnp.zeros(cases, bool))
    return lax.fori_loop(jnp.uint32(0), jnp.uint32(chunks), step, carry)[1:]


@_solve_banded_batch.def_vmap
def _solve_banded_batch_rule(axis_size, mapped, band, rhs):
    """Rule for `jax.vmap`: a larger batch, or more right sides if all cases share the matrices.

    `axis_size` is the number of mapped cases, `mapped` says which of `band` and `rhs` have
    their axis. Returns solutions, whether matrices are definite, and whether these results are
    mapped.
    """
    if not mapped[0]:
        cases, n, sides = rhs.shape[1:]
        rhs = jnp.moveaxis(rhs, 0, 2).reshape(cases, n, axis_size * sides)
        x, definite = _solve_banded_batch(band, rhs)
        return (jnp.moveaxis(x.reshape(cases, n, axis_size, sides), 2, 0), definite), (True, False)
    if not mapped[1]:
        rhs = jnp.broadcast_to(rhs[None], (axis_size, *rhs.shape))
    x, definite = _solve_banded_batch(
        band.reshape(-1, *band.shape[2:]), rhs.reshape(-1, *rhs.shape[2:])
    )
    return (x.reshape(rhs.shape), definite.reshape(rhs.shape[:2])), (True, True)


def _read_slice(array, start, shape):
    """Return the slice of an array that has the shape `shape` and begins at `start`."""
    return lax.dynamic_slice(array, [jnp.uint32(i) for i in start], shape)


def _write_slice(array, part, start):
    """Return an array with the slice that begins at `start` replaced by `part`."""
    return lax.dynamic_update_slice(array, part, [jnp.uint32(i) for i in start])


def _cholesky_solve_chunk(factor, band, rhs):
    """Solve C banded systems by Cholesky factors, column by column; the cases are the last axis.

    A column is reduced in segments, each of which skips products that are known to be zero.

    The state of the loops is arranged for XLA, which would copy an array in every iteration if a
    kernel read one position of it and wrote another: right sides are in rolling windows. Counters
    are unsigned, so that no test for negative positions is compiled.

    Args:
        factor: work array for the factors, [b + n, b + segment, C], column k at b + k; zero in its
            first b columns and below the band.
        band: lower bands, [n, b + 1, C].
        rhs: right sides, [n, q, C].

    Returns:
        Work array with the factors, solutions [n, q, C], and whether the matrices are positive
        definite, [C].
    """
    n, width, size = band.shape
    b = width - 1
    segment = factor.shape[1] - b
    sides = rhs.shape[1]
    start, end = jnp.uint32(0), jnp.uint32(n)
    rhs = jnp.pad(rhs, ((0, width), (0, 0), (0, 0)))

    def reduce(factor, k, low):
        """A segment of column k, from row `low` on, minus products with the columns before it."""
        rows = min(segment, width - low)
        column = _read_slice(band, (k, low, 0), (1, rows, size))
        for m in range(1, b + 1 - low):
            before = _read_slice(factor, (k + (b - m), m + low, 0), (1, rows, size))
            column = column - before * _read_slice(factor, (k + (b - m), m, 0), (1, 1, size))
        return column

    def forward(k, carry):
        factor, y, window = carry  # window: right sides k ... k + b, reduced so far
        column = lax.concatenate([reduce(factor, k, low) for low in range(0, width, segment)], 1)
        scale = lax.rsqrt(column[:, :1])
        factor = _write_slice(factor, column * scale, (k + b, 0, 0))
        first = window[:1] * scale
        y = _write_slice(y, first, (k, 0, 0))
        rest = window[1:] - (column * scale)[0, 1:, None, :] * first
        window = lax.concatenate([rest, _read_slice(rhs, (k + width, 0, 0), (1, sides, size))], 0)
        return factor, y, window

    y = jnp.zeros((n, sides, size), rhs.dtype)
    factor, y, _ = lax.fori_loop(start, end, forward, (factor, y, rhs[:width]))
    pivots = factor[b:, 0]
    definite = jnp.all((pivots > 0) & jnp.isfinite(pivots), axis=0)

    def backward(count, carry):
        x, window = carry  # window: solution k + 1 ... k + b
        k = jnp.uint32(n - 1) - count
        value = _read_slice(y, (k, 0, 0), (1, sides, size))
        for i in range(1, width):
            value = value - _read_slice(factor, (k + b, i, 0), (1, 1, size)) * window[i - 1 : i]
        value = value / _read_slice(factor, (k + b, 0, 0), (1, 1, size))
        return _write_slice(x, value, (k, 0, 0)), lax.concatenate([value, window[:-1]], 0)[:b]

    x = jnp.zeros((n, sides, size), rhs.dtype)
    window = jnp.zeros((b, sides, size), rhs.dtype)
    x, _ = lax.fori_loop(start, end, backward, (x, window))
    return factor, x, definite
