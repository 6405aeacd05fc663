"""Rules of linear algebra: products by NumPy, factors and triangular solves by LAPACK of SciPy."""

from __future__ import annotations

import math

import numpy as np
from scipy.linalg import blas, lapack

from .rules import rule


def _aval(equation, k=0):
    aval = equation.outvars[k].aval
    return tuple(aval.shape), np.dtype(aval.dtype)


@rule("dot_general")
def _dot_general(block, equation, inputs):
    a, b = inputs
    shape, dtype = _aval(equation)
    numbers = equation.params["dimension_numbers"]
    (of_a, of_b), (batch_a, _) = numbers
    a, b = (_converted(block, block.full(x), dtype) for x in (a, b))
    plain = not batch_a and len(of_a) == 1 and max(len(a.shape), len(b.shape)) <= 2
    if plain and len(a.shape) and len(b.shape):
        left = "{0}" if of_a[0] == len(a.shape) - 1 else "{0}.T"
        right = "{1}" if of_b[0] == 0 else "{1}.T"
        text = f"{left}.dot({right})"
    else:
        text = _stacked_product(a.shape, b.shape, shape, numbers)
    return [block.write(text, [a, b], shape, dtype)]


def _converted(block, x, dtype):
    """Return a factor in the dtype of the product, so that sums have its range and its digits."""
    return x if x.dtype == dtype else block.write(f"{{0}}.astype('{dtype}')", [x], x.shape, dtype)


def _stacked_product(shape_a, shape_b, shape, numbers):
    """Return the expression of a product of arrays as one of two stacks of matrices."""
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


def _for_each(function, n_core):
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


def _letter(dtype):
    """Return the letter of a dtype in names of LAPACK; NotImplementedError for complex numbers."""
    if dtype not in (np.float32, np.float64):
        raise NotImplementedError(f"linear algebra of {dtype}")
    return "s" if dtype == np.float32 else "d"


def _write(block, equation, inputs, text):
    """Write a call with the results of an equation; none where there is nothing to compute."""
    avals = [x.aval for x in equation.outvars]
    inputs = [block.full(x) for x in inputs]
    if not any(math.prod(a.shape) for a in avals):
        return [block.names.constant(np.zeros(a.shape, a.dtype)) for a in avals]
    if any(not math.prod(x.shape) for x in inputs):
        raise NotImplementedError("linear algebra of nothing")
    if len(avals) == 1:
        return [block.write(text, inputs, *_aval(equation), work=4)]
    return block.write_call(text, inputs, avals)


@rule("cholesky")
def _cholesky(block, equation, inputs):
    function = block.names.helper(_make_cholesky, _letter(inputs[0].dtype))
    return _write(block, equation, inputs, f"{function}({{0}})")


def _make_cholesky(letter):
    factorize = getattr(lapack, f"{letter}potrf")

    def cholesky(a):
        factor, failed = factorize(a, lower=1, clean=1)
        return np.full_like(a, np.nan) if failed else factor

    return _for_each(cholesky, 2)


@rule("triangular_solve")
def _triangular_solve(block, equation, inputs):
    given = equation.params
    solve = block.names.helper(
        _make_triangular_solve,
        *(_letter(inputs[0].dtype), bool(given["left_side"]), bool(given["lower"])),
        *(bool(given["transpose_a"]), bool(given["unit_diagonal"])),
    )
    return _write(block, equation, inputs, f"{solve}({{0}},{{1}})")


def _make_triangular_solve(letter, left_side, lower, transposed, unit):
    solve = getattr(blas, f"{letter}trsm")

    def triangular_solve(a, b):
        # the transpose of an array in C order is in the order of LAPACK: no copy
        if a.flags.c_contiguous:
            a, low, turned = a.T, not lower, not transposed
        else:
            low, turned = lower, transposed
        return solve(1.0, a, b, side=not left_side, lower=low, trans_a=turned, diag=unit)

    return _for_each(triangular_solve, 2)


@rule("lu")
def _lu(block, equation, inputs):
    function = block.names.helper(_make_lu, _letter(inputs[0].dtype))
    return _write(block, equation, inputs, f"{function}({{0}})")


def _make_lu(letter):
    factorize = getattr(lapack, f"{letter}getrf")

    def lu(a):
        factor, pivots, _ = factorize(a)
        return factor, pivots.astype(np.int32), permutation(pivots, len(a))

    return _for_each(lu, 2)


def permutation(pivots: np.ndarray, size: int) -> np.ndarray:
    """Return the permutation of rows that pivots of LU factors stand for, [size] int32."""
    order = np.arange(size, dtype=np.int32)
    for i, k in enumerate(pivots):
        order[i], order[k] = order[k], order[i]
    return order


@rule("lu_pivots_to_permutation")
def _permutation(block, equation, inputs):
    function = block.names.helper(_make_permutation, equation.params["permutation_size"])
    return _write(block, equation, inputs, f"{function}({{0}})")


def _make_permutation(size):
    return _for_each(lambda pivots: permutation(pivots, size), 1)


@rule("eigh")
def _eigh(block, equation, inputs):
    given = equation.params
    if given.get("subset_by_index") not in (None, (0, inputs[0].shape[-1])):
        raise NotImplementedError("some of the eigenvalues")
    function = block.names.helper(_make_eigh, _letter(inputs[0].dtype), bool(given["lower"]))
    return _write(block, equation, inputs, f"{function}({{0}})")


def _make_eigh(letter, lower):
    solve = getattr(lapack, f"{letter}syevd")

    def eigh(a):
        values, vectors, failed = solve(a, compute_v=1, lower=int(lower))
        if failed:
            return np.full_like(vectors, np.nan), np.full_like(values, np.nan)
        return vectors, values

    return _for_each(eigh, 2)


@rule("qr")
def _qr(block, equation, inputs):
    if equation.params.get("pivoting"):
        raise NotImplementedError("qr with pivoting")
    mode = "complete" if equation.params["full_matrices"] else "reduced"
    return _write(block, equation, inputs, f"tuple(np.linalg.qr({{0}},'{mode}'))")
