"""Rules of linear algebra: products by NumPy, factors and triangular solves by LAPACK of SciPy."""

from __future__ import annotations

import math

import numpy as np
from scipy.linalg import blas, lapack

from .rules import NoRuleError, places, result_of, rule, write_full


@rule("dot_general")
def _dot_general(block, equation, inputs):
    """Write a product of arrays, with sums over given axes and axes of a batch."""
    (shape, dtype), numbers = result_of(equation), equation.params["dimension_numbers"]
    (of_a, of_b), (batch_a, _) = numbers
    a, b = (_write_cast(block, block.full(x), dtype) for x in inputs)
    plain = not batch_a and len(of_a) == 1 and max(len(a.shape), len(b.shape)) <= 2
    if plain and len(a.shape) and len(b.shape):
        left = "{0}" if of_a[0] == len(a.shape) - 1 else "{0}.T"
        right = "{1}" if of_b[0] == 0 else "{1}.T"
        text = f"{left}.dot({right})"
    else:
        text = _matmul_expression(a.shape, b.shape, shape, numbers)
    return [block.write(text, [a, b], shape, dtype)]


def _write_cast(block, x, dtype):
    """Write a factor of a product in the dtype of the product, and return its value.

    So sums have the range and the digits of the product.
    """
    return x if x.dtype == dtype else block.write(f"{{0}}.astype('{dtype}')", [x], x.shape, dtype)


def _matmul_expression(shape_a, shape_b, shape, numbers):
    """Return the text of ``dot_general`` as NumPy's product of two stacks of matrices.

    `shape_a`, `shape_b` and `shape` are those of the factors and the product, and `numbers` its
    dimension numbers (jax).
    """
    (of_a, of_b), (batch_a, batch_b) = numbers
    free_a = [k for k in range(len(shape_a)) if k not in (*of_a, *batch_a)]
    free_b = [k for k in range(len(shape_b)) if k not in (*of_b, *batch_b)]
    batch = [shape_a[k] for k in batch_a]
    inner = math.prod(shape_a[k] for k in of_a)
    rows, columns = (
        math.prod(own[k] for k in free) for own, free in ((shape_a, free_a), (shape_b, free_b))
    )

    def matrices(text, own, order, sizes):
        ordered = tuple(own[k] for k in order)
        if list(order) != sorted(order):
            text += f".transpose({tuple(order)})"
        return text if ordered == sizes else f"{text}.reshape({sizes})"

    left = matrices("{0}", shape_a, (*batch_a, *free_a, *of_a), (*batch, rows, inner))
    right = matrices("{1}", shape_b, (*batch_b, *of_b, *free_b), (*batch, inner, columns))
    text = f"np.matmul({left},{right})"
    if shape == ():
        return text + "[...,0,0]"
    return text if shape == (*batch, rows, columns) else f"{text}.reshape({shape})"


# --- factors


def _lapack_rule(name, n_core=2):
    """Register the rule of a primitive by a function for one matrix (a decorator).

    The decorated function gets the letter of the dtype in names of LAPACK and the parameters of the
    equation, and returns the function of one matrix. That is mapped over leading axes; the last
    `n_core` axes of each argument are those of one case.
    """

    def register(make):
        @rule(name)
        def write(block, equation, inputs):
            avals = [x.aval for x in equation.outvars]
            if not any(math.prod(a.shape) for a in avals):
                return [block.names.constant(np.zeros(a.shape, a.dtype)) for a in avals]
            letter = {"float32": "s", "float64": "d", "int32": ""}.get(inputs[0].dtype.name)
            if letter is None or any(not math.prod(x.shape) for x in inputs):
                raise NoRuleError(f"{name} of {inputs[0].dtype} in shape {inputs[0].shape}")
            function = block.names.helper(_map_over_batch, make(letter, equation.params), n_core)
            text = f"{function}({places(inputs)})"
            if len(avals) == 1:
                return write_full(block, equation, text, inputs, work=4)
            return block.write_call(text, [block.full(x) for x in inputs], avals)

    return register


def _map_over_batch(function, n_core):
    """Return `function` mapped over leading axes; the last `n_core` axes are those of a case."""

    def mapped(*arrays):
        lead = arrays[0].shape[: arrays[0].ndim - n_core]
        if not lead:
            return function(*arrays)
        cases = [x.reshape(-1, *x.shape[len(lead) :]) for x in arrays]
        found = [function(*own) for own in zip(*cases, strict=True)]
        if isinstance(found[0], tuple):
            return tuple(np.stack(x).reshape(*lead, *x[0].shape) for x in zip(*found, strict=True))
        return np.stack(found).reshape(*lead, *found[0].shape)

    return mapped


@_lapack_rule("cholesky")
def _make_cholesky(letter, _):
    """Return the function from a matrix to its lower Cholesky factor; NaN if indefinite."""
    factorize = getattr(lapack, f"{letter}potrf")

    def cholesky(a):
        factor, failed = factorize(a, lower=1, clean=1)
        return np.full_like(a, np.nan) if failed else factor

    return cholesky


@_lapack_rule("triangular_solve")
def _make_triangular_solve(letter, given):
    """Return the function (a, b) that solves with a triangular matrix, from left or right."""
    solve, right = getattr(blas, f"{letter}trsm"), not given["left_side"]
    lower, transposed, unit = given["lower"], given["transpose_a"], given["unit_diagonal"]

    def triangular_solve(a, b):
        low, turned = lower, transposed
        if a.flags.c_contiguous:  # its transpose is in the order of LAPACK: no copy
            a, low, turned = a.T, not lower, not transposed
        return solve(1.0, a, b, side=right, lower=low, trans_a=turned, diag=unit)

    return triangular_solve


@_lapack_rule("lu")
def _make_lu(letter, _):
    """Return the function from a matrix to its LU factors, pivots and order of rows."""
    factorize = getattr(lapack, f"{letter}getrf")

    def lu(a):
        factor, pivots, _ = factorize(a)
        return factor, pivots.astype(np.int32), _row_permutation(pivots, len(a))

    return lu


@_lapack_rule("lu_pivots_to_permutation", n_core=1)
def _make_permutation(_, given):
    """Return the function from the pivots of LU factors to the order of rows."""
    return lambda pivots: _row_permutation(pivots, given["permutation_size"])


def _row_permutation(pivots, size):
    """Return the order of rows that LAPACK's pivots of LU factors stand for, [size] int32."""
    order = np.arange(size, dtype=np.int32)
    for i, k in enumerate(pivots):
        order[i], order[k] = order[k], order[i]
    return order


@_lapack_rule("eigh")
def _make_eigh(letter, given):
    """Return the function from a symmetric matrix to eigenvectors and values; NaN if it fails."""
    solve, lower = getattr(lapack, f"{letter}syevd"), int(given["lower"])
    if given.get("subset_by_index") is not None:
        raise NoRuleError("some of the eigenvalues")

    def eigh(a):
        values, vectors, failed = solve(a, compute_v=1, lower=lower)
        if failed:
            return np.full_like(vectors, np.nan), np.full_like(values, np.nan)
        return vectors, values

    return eigh


@_lapack_rule("qr")
def _make_qr(_, given):
    """Return the function from a matrix to its QR factors."""
    if given.get("pivoting"):
        raise NoRuleError("qr with pivoting")
    mode = "complete" if given["full_matrices"] else "reduced"
    return lambda a: tuple(np.linalg.qr(a, mode))
