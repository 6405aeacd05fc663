"""Rules of NumPy against XLA: every primitive, on random shapes and special numbers."""

import itertools

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from jax import lax

from jaxcable.common import jaxprs
from jaxcable.programs.evaluator import write_program
from jaxcable.programs.rules import RULES

SPECIAL = [0.0, -0.0, 1.0, -1.0, np.inf, -np.inf, np.nan, 1e300, -1e-300, 0.5, 2.5, -2.5]
SEEN: set[str] = set()


def primitives(jaxpr):
    """Names of all primitives in a jaxpr, and in those within it."""
    for equation in jaxpr.eqns:
        yield equation.primitive.name
        for value in equation.params.values():
            for inner in value if isinstance(value, tuple | list) else (value,):
                if jaxprs.is_jaxpr(inner):
                    yield from primitives(getattr(inner, "jaxpr", inner))


def by_numpy(function, *arguments):
    """Results of a function by NumPy, in the shapes and dtypes of its jaxpr."""
    program, shapes = jax.make_jaxpr(function, return_shape=True)(*arguments)
    SEEN.update(primitives(program.jaxpr))
    found = write_program(program)(jax.tree.leaves(arguments), [0.0, np.inf])
    for x, aval in zip(found, program.out_avals, strict=True):
        assert (x.shape, x.dtype) == (aval.shape, aval.dtype), program
    return jax.tree.unflatten(jax.tree.structure(shapes), found)


def agree(function, *arguments, ulps=4, atol=0.0):
    """Assert that NumPy and XLA agree, NaN where NaN is, within some units in the last place."""
    agree_each({"": function}, *arguments, ulps={"": ulps}, atol=atol)


def agree_each(table, *arguments, ulps, atol=0.0):
    """As `agree`, of all functions of a table, which XLA compiles as one program.

    Args:
        ulps: units in the last place by name; 4 where there are none.
        atol: part of the largest number that is granted beside.
    """

    def each(*arguments):
        return {name: function(*arguments) for name, function in table.items()}

    ours = jax.tree_util.tree_leaves_with_path(by_numpy(each, *arguments))
    theirs = jax.tree.leaves(jax.jit(each)(*arguments))
    for (path, own), other in zip(ours, theirs, strict=True):
        other, name = np.asarray(other), path[0].key
        if own.dtype.kind == "f":
            eps = ulps.get(name, 4) * np.finfo(own.dtype).eps
            size = atol * np.max(np.abs(other), initial=0.0) if atol else 0.0
            np.testing.assert_allclose(own, other, rtol=eps, atol=size, err_msg=name)
        else:
            np.testing.assert_array_equal(own, other, err_msg=name)


def floats(draw, shape, dtype):
    """Random floats, some of them special."""
    rng = np.random.default_rng(draw(st.integers(0, 2**32 - 1)))
    x = rng.normal(size=shape) * 10.0 ** rng.integers(-3, 3, shape)
    x = np.where(rng.random(shape) < 0.25, rng.choice(SPECIAL, shape), x)
    with np.errstate(over="ignore"):
        return x.astype(dtype)


def integers(draw, shape, low=-9, high=9):
    """Random integers, int32."""
    rng = np.random.default_rng(draw(st.integers(0, 2**32 - 1)))
    return rng.integers(low, high, shape, dtype=np.int32)


SHAPES = st.lists(st.integers(1, 4), min_size=0, max_size=3).map(tuple)
DTYPES = st.sampled_from([np.float64, np.float32])
RUNS = settings(max_examples=4, deadline=None, derandomize=True)

UNARY = {
    **{f: getattr(lax, f) for f in ("neg", "abs", "sign", "floor", "ceil", "is_finite", "square")},
    **{f: getattr(lax, f) for f in ("sqrt", "rsqrt", "cbrt", "sin", "cos", "tan", "sinh", "cosh")},
    **{f: getattr(lax, f) for f in ("tanh", "asin", "acos", "atan", "asinh", "acosh", "atanh")},
    **{f: getattr(lax, f) for f in ("exp", "exp2", "expm1", "log", "log1p", "logistic")},
    **{f: getattr(lax, f) for f in ("erf", "erfc", "erf_inv")},
    # away from the zeros of the logarithm
    "lgamma": lambda x: lax.lgamma(3.0 + jnp.abs(x)),
    "round": lambda x: (lax.round(x), lax.round(x, lax.RoundingMethod.TO_NEAREST_EVEN)),
    "integer_pow": lambda x: [lax.integer_pow(x, y) for y in (-2, -1, 2, 3)],
    "to_int": lambda x: (x.astype(jnp.int32), x.astype(bool)),
    "reduce_precision": lambda x: lax.reduce_precision(x, *REDUCED[x.dtype.name]),
}
REDUCED = {"float64": (11, 25), "float32": (8, 12)}
# SciPy and XLA have other approximations of these functions; XLA flushes exp2 of large numbers
LOOSE = {"lgamma": 64, "erf_inv": 500, "erfc": 200, "exp2": 300, "logistic": 16}
LOOSE |= {"tan": 16, **dict.fromkeys(("cbrt", "acosh", "asinh", "atanh", "sinh", "cosh"), 100)}


@RUNS
@given(st.data())
def test_unary(data):
    dtype = data.draw(DTYPES)
    agree_each(UNARY, floats(data.draw, data.draw(SHAPES), dtype), ulps=LOOSE)


BINARY = {
    **{f: getattr(lax, f) for f in ("add", "sub", "mul", "div", "rem", "max", "min", "atan2")},
    **{f: getattr(lax, f) for f in ("eq", "ne", "lt", "le", "gt", "ge", "nextafter", "pow")},
    "select": lambda a, b: lax.select(a > b, a, b),
    "clamp": lambda a, b: lax.clamp(-jnp.ones((), a.dtype), a, jnp.abs(b)),
}


@RUNS
@given(st.data())
def test_binary(data):
    dtype, shape = data.draw(DTYPES), data.draw(SHAPES)
    a, b = (floats(data.draw, shape, dtype) for _ in range(2))
    agree_each(BINARY, a, b, ulps={"pow": 16})


INTEGER = {
    **{f: getattr(lax, f) for f in ("add", "sub", "mul", "div", "rem", "max", "min")},
    **{f: getattr(lax, f"bitwise_{f}") for f in ("and", "or", "xor")},
    "not": lambda a, b: (lax.bitwise_not(a), lax.bitwise_not(b > 0), (a > 0) & (b > 0)),
    "abs": lambda a, b: (lax.abs(a), lax.sign(b), a.astype(jnp.float64), a**3),
    "choose": lambda a, b: lax.select_n(jnp.abs(a) % 3, a, b, a + b),
    "choose the only one": lambda a, b: (lax.select_n(a, b), lax.select_n(a.ravel()[0], b)),
}


@RUNS
@given(st.data())
def test_integers(data):
    shape = data.draw(SHAPES)
    agree_each(INTEGER, integers(data.draw, shape), integers(data.draw, shape), ulps={})


@RUNS
@given(st.data())
def test_power_with_integer_exponents(data):
    shape, dtype = data.draw(SHAPES), data.draw(DTYPES)
    x, n = floats(data.draw, shape, dtype), integers(data.draw, shape, 0, 4)
    agree(lax.pow, x, n, ulps=16)


SHAPED = {
    "broadcast": lambda x: (x[None] + jnp.zeros((3, *x.shape), x.dtype), jnp.zeros((2, 3)) + 1.0),
    "reshape": lambda x: (x.reshape(-1), x[..., None], jnp.squeeze(x[None], 0)),
    "transpose": lambda x: (x.T, jnp.flip(x), jnp.flip(jnp.broadcast_to(1.5, (2, 3)))),
    "slice": lambda x: (x[::2], x[1:], lax.slice(jnp.ones((4, 4)), (1, 0), (3, 4), (1, 2))),
    "concatenate": lambda x: (jnp.concatenate([x, x * 2]), jnp.stack([x, x], -1), jnp.tile(x, 2)),
    "split": lambda x: jnp.split(x, [1]),
    "iota": lambda x: lax.broadcasted_iota(jnp.int32, (2, 3), 1) + x.size,
    "pad": lambda x: (
        lax.pad(x, jnp.ones((), x.dtype), [(1, 2, 0)] * x.ndim),
        lax.pad(x, jnp.ones((), x.dtype), [(-1, 2, 1)] * x.ndim),
    ),
    "reduce": lambda x: [f(x, a) for f in (jnp.max, jnp.min) for a in (0, -1)],
    "any": lambda x: ((x > 0).any(0), (x > 0).all(), jnp.max(x > 0), jnp.min(x > 0, 0)),
    "of nothing": lambda x: (
        *(lax.reduce_max(y[:0], (0,)) for y in (x, x > 0, x.astype(int))),
        *(lax.reduce_min(y[:0], (0,)) for y in (x, x > 0, x.astype(int))),
        jnp.linalg.cholesky(jnp.zeros((0, 0))),
    ),
    "argmax": lambda x: (jnp.argmax(x, 0), jnp.argmin(x, -1)),
    "cumulate": lambda x: [f(x, axis=0) for f in (lax.cummax, lax.cummin)],
    "sort": lambda x: (jnp.sort(x, 0), jnp.argsort(x, 0), jnp.lexsort([jnp.round(x[0]), x[0]])),
    "loose": lambda x: (
        jnp.where(jnp.zeros(x.shape, bool), x, 2.0),
        jnp.where(x.ravel()[0] > 0, x, jnp.zeros_like(x)),
        jnp.zeros(x.shape).sum(0),
        jnp.ones(x.shape).max(0),
    ),
}


@RUNS
@given(st.data())
def test_shapes(data):
    shape = data.draw(st.lists(st.integers(2, 4), min_size=1, max_size=3).map(tuple))
    agree_each(SHAPED, floats(data.draw, shape, data.draw(DTYPES)), ulps={})


SUMS = {
    "sum": lambda x: (x.sum(), x.sum(0), x.sum((0, -1))),
    "prod": lambda x: x.prod(-1),
    "cumsum": lambda x: (lax.cumsum(x, 0), lax.cumsum(x, x.ndim - 1, reverse=True)),
    "cumprod": lambda x: lax.cumprod(x, 0),
    "integers": lambda x: (x.astype(jnp.int32).sum(0), lax.cumsum(x.astype(jnp.int32))),
}


@RUNS
@given(st.data())
def test_sums(data):
    """The order of summation differs: an absolute bound by the terms."""
    shape = data.draw(st.lists(st.integers(1, 5), min_size=2, max_size=3).map(tuple))
    x = np.random.default_rng(data.draw(st.integers(0, 99))).uniform(0.5, 2.0, shape)
    agree_each(SUMS, x, ulps=dict.fromkeys(SUMS, 64))


AT = {
    "rows": lambda x, i: x[i],
    "rows from the end": lambda x, i: x[i - 4],
    "columns": lambda x, i: x[:, i],
    "entries": lambda x, i: x[i, i % 3],
    "filled": lambda x, i: x.at[i * 3].get(mode="fill"),
    "filled with": lambda x, i: x.at[:, i * 2].get(mode="fill", fill_value=-1.0),
    "clipped": lambda x, i: x.at[i * 3].get(mode="clip"),
    "along": lambda x, i: jnp.take_along_axis(x, i[:, None] % 3, 1),
    "mapped": lambda x, i: jax.vmap(lambda row, k: row[k % 3])(x, i),
    "windows": lambda x, i: jax.vmap(lambda k: lax.dynamic_slice(x, (k, 0), (2, 2)))(i),
    "one": lambda x, i: (x[i[0]], x[i[0], i[1] % 3], lax.dynamic_slice(x, (i[0], i[1]), (2, 1))),
    "integers": lambda x, i: (i[i % 4], i.at[9].get(mode="fill"), (x > 0).at[9].get(mode="fill")),
    "of one number": lambda x, i: jnp.full((4, 3), 2.0)[i],
    "add": lambda x, i: x.at[i].add(x[::-1]),
    "add from nothing": lambda x, i: jnp.zeros((5, 3)).at[i].add(x),
    "add entries": lambda x, i: jnp.zeros(7).at[i].add(x[:, 0]),
    "add to columns": lambda x, i: x.at[:, i % 3].add(1.5),
    "add outside": lambda x, i: x.at[i * 2].add(1.0, mode="drop"),
    "add clipped": lambda x, i: x.at[i * 2].add(1.0, mode="clip"),
    "add integers": lambda x, i: jnp.zeros(5, int).at[i].add(i),
    "set": lambda x, i: x.at[jnp.sort(i) + jnp.arange(4)].set(7.0, mode="drop"),
    "set one": lambda x, i: x.at[i[0], 1].set(3.0),
    "multiply": lambda x, i: (x.at[i].multiply(2.0), x.at[i].subtract(x[::-1])),
    "min": lambda x, i: (x.at[i].min(0.25), x.at[i].max(0.25)),
    "mapped add": lambda x, i: jax.vmap(lambda row, k: row.at[k % 3].add(1.0))(x, i),
    "update": lambda x, i: lax.dynamic_update_slice(x, x[:2, :2] * 2, (i[0], i[1])),
}


@pytest.mark.parametrize("dtype", [np.float64, np.float32])
@RUNS
@given(st.data())
def test_indexing(dtype, data):
    rng = np.random.default_rng(data.draw(st.integers(0, 999)))
    x = rng.uniform(0.5, 2, (4, 3)).astype(dtype)
    agree_each(AT, x, rng.integers(0, 4, 4), ulps=dict.fromkeys(AT, 16))


def spd(rng, *shape):
    """Random matrices that are symmetric and positive definite."""
    a = rng.normal(size=shape)
    return a @ np.swapaxes(a, -1, -2) + 4 * np.eye(shape[-1])


MATRICES = {
    "dot": lambda a, b: (a @ b, a.T @ b, a @ b[0], b[0] @ b[1], jnp.einsum("ij,kj->ki", a, b)),
    "tensor": lambda a, b: (jnp.einsum("ijk,jl->lik", jnp.stack([a, b]), b), jnp.tensordot(a, b)),
    "batch": lambda a, b: jnp.einsum("bij,bjk->bik", jnp.stack([a, b]), jnp.stack([b, b])),
    "cholesky": lambda a, b: jnp.linalg.cholesky(jnp.stack([a, b])),
    "solve": lambda a, b: (jnp.linalg.solve(a, b), jnp.linalg.solve(a, b[0])),
    "lu": lambda a, b: lax.linalg.lu(jnp.stack([a - 3.0, b - 2.0])),
    "inverse": lambda a, b: (jnp.linalg.inv(a), jnp.linalg.det(b)),
    "qr": lambda a, b: (jnp.linalg.qr(a), jnp.linalg.qr(jnp.stack([a, b])[:, :, :1], "complete")),
    "eigenvalues": lambda a, b: jnp.abs(jnp.linalg.eigh(a)[0]),
}


def triangular(left, lower, turned):
    """Solutions of one triangular matrix, and of two with ones on their diagonals."""
    how = {"left_side": left, "lower": lower, "transpose_a": turned}

    def solve(a, b):
        two = lax.linalg.triangular_solve(
            jnp.stack([a, b]), jnp.stack([b, b]), **how, unit_diagonal=True
        )
        return lax.linalg.triangular_solve(a, b, **how), two

    return solve


BOTH = (True, False)
MATRICES |= {f"triangular {how}": triangular(*how) for how in itertools.product(BOTH, BOTH, BOTH)}


@RUNS
@given(st.data())
def test_matrices(data):
    """Errors grow with the condition of the matrices, some 10."""
    rng, n = np.random.default_rng(data.draw(st.integers(0, 99))), data.draw(st.integers(2, 6))
    agree_each(MATRICES, spd(rng, n, n), spd(rng, n, n), ulps={}, atol=1e-11)


def test_factors_of_matrices_without_one_are_nan():
    indefinite = np.diag([1.0, -1.0])
    agree(jnp.linalg.cholesky, indefinite)
    agree(jnp.linalg.cholesky, np.full((2, 2), np.nan))
    agree(lambda a: jnp.linalg.cholesky(jnp.stack([a, -a])), np.eye(2))
    agree(lambda a: jnp.linalg.solve(a, jnp.ones(2)), np.zeros((2, 2)))


LOOPS = {
    "scan": lambda x: lax.scan(lambda c, row: (c + row, c * row), jnp.zeros(3), x),
    "reverse": lambda x: lax.scan(lambda c, row: (c - row, c), x[0], x, reverse=True),
    "one turn": lambda x: lax.scan(lambda c, row: (c + row.sum(), c), 1.0, x[:1]),
    "no turn": lambda x: lax.scan(lambda c, row: (c + row.sum(), c), 1.0, x[:0]),
    "unchanged": lambda x: lax.scan(lambda c, r: ((c[0], c[1] + c[0] * r), None), (x[0], x[1]), x),
    "swap": lambda x: lax.fori_loop(0, 5, lambda k, c: (c[1], c[0] + k), (x[0], x[1])),
    "while": lambda x: lax.while_loop(
        lambda c: jnp.sum(c[0]) < 100, lambda c: (c[0] * 2 + x[0] ** 2, c[1] + 1), (x[1] ** 2, 0)
    ),
    "no turns": lambda x: lax.while_loop(lambda c: c[0, 0] > 99, lambda c: c * 2, x),
    "mapped while": lambda x: jax.vmap(
        lambda row: lax.while_loop(lambda c: c[0] < 20, lambda c: (c[0] * 1.5, c[1] + 1), (row, 0))
    )(x[:, 0]),
    "cond": lambda x: lax.cond(x[0, 0] > 1, lambda a: (a * 2, 1), lambda a: (a, 2), x),
    "switch": lambda x: [
        lax.switch(k, [jnp.sin, jnp.cos, lambda a: a + 1], x[0]) for k in (-1, 0, 1, 2, 9)
    ],
    "chosen": lambda x: lax.switch(
        jnp.sum(x > 1).astype(int) - 4, [jnp.sin, jnp.cos, lambda a: a + 1], x
    ),
    "nested": lambda x: lax.scan(
        lambda c, row: (
            lax.while_loop(lambda a: jnp.sum(a) < 50, lambda a: a * 1.7 + x[0].sum(), c + row),
            lax.cond(row[0] > 1, jnp.sin, jnp.cos, row),
        ),
        jnp.zeros(3),
        x,
    ),
    "calls": lambda x: (_long(x), _long(x * 2), jax.checkpoint(_long)(x), _custom(x)),
    "gradient": lambda x: jax.grad(lambda x: (_long(x) * _custom(x)).sum())(x),
    "barrier": lambda x: lax.optimization_barrier((x, x + 1)),
    "linear solve": lambda x: lax.custom_linear_solve(
        lambda v: 2 * v, x, lambda _, b: b / 2, lambda _, b: b / 2
    ),
    "callback": lambda x: jax.pure_callback(
        lambda a: np.asarray(a) + 1, jax.ShapeDtypeStruct(x.shape, x.dtype), x
    ),
    "platform": lambda x: lax.platform_dependent(x, cpu=jnp.sin, default=jnp.cos),
    "arguments": lambda x: (x, jnp.ones(3), np.arange(3.0), x.T),
}


@jax.jit
def _long(x):
    """A function of many equations, which is called several times."""
    for k in range(20):
        x = jnp.sin(x) + k * x[:1]
    return x


@jax.custom_jvp
def _custom(x):
    return x**2


_custom.defjvp(lambda p, t: (p[0] ** 2, 3.0 * t[0]))


@RUNS
@given(st.data())
def test_loops_and_calls(data):
    x = np.random.default_rng(data.draw(st.integers(0, 99))).uniform(0.5, 2.0, (4, 3))
    agree_each(LOOPS, x, ulps=dict.fromkeys(LOOPS, 256))


LARGE = np.linspace(0.0, 1.0, 5000)  # given back after its last use


@pytest.mark.parametrize("taken", [0, 1, 2])
def test_memory_that_one_of_three_branches_reads_is_given_back_after_all(taken):
    branches = [lambda x: jnp.max(x) + x[1], lambda _: 1.0, lambda _: 0.0]
    agree(lambda x, k: lax.switch(k, branches, jnp.sin(x)), LARGE, np.int32(taken), ulps=64)


def test_products_are_summed_in_the_dtype_of_the_result():
    small = np.arange(80, 96, dtype=np.int8).reshape(4, 4)
    agree(lambda a: jnp.matmul(a, a, preferred_element_type=jnp.int32), small)
    agree(lambda a: jnp.matmul(a, a[0], preferred_element_type=jnp.float64), np.sin(small * 1.0))


def test_functions_of_users_get_arrays_of_their_own():
    """In the shapes of the program; what they do to them, and to what they return, changes none."""
    seen, kept = [], np.zeros(3)

    def function(a, b):
        seen.append((np.shape(a), np.shape(b)))
        kept[:] = np.asarray(a) + b
        if isinstance(a, np.ndarray):
            a *= 2.0
        return kept

    def program(x):
        shape = jax.ShapeDtypeStruct((3,), x.dtype)
        first = jax.pure_callback(function, shape, x, 1.0)
        return first, jax.pure_callback(function, shape, first, 2.0), x + 0.0

    x = np.arange(3.0)
    found = by_numpy(program, x)
    np.testing.assert_array_equal(np.stack(found), [[1.0, 2, 3], [3, 4, 5], [0, 1, 2]])
    np.testing.assert_array_equal(x, [0.0, 1, 2])
    assert seen == [((3,), ())] * 2


def _nested(depth):
    """A function with that many loops in one another."""

    def function(x):
        if depth == 0:
            return jnp.sin(x)
        inner = _nested(depth - 1)
        return lax.while_loop(lambda c: c[1] < 1, lambda c: (inner(c[0]), c[1] + 1), (x, 0))[0]

    return function


@pytest.mark.parametrize(
    ("function", "x"),
    [
        (_nested(21), np.ones(2)),
        (lambda x: x + jax.random.normal(jax.random.key(0), x.shape), np.ones(2)),
        (lambda key: jax.random.key_data(key), jax.random.key(0)),
        (lambda x: (x * 1j).real, np.ones(2)),
        (jnp.conj, np.ones(2, complex)),
        (lambda x: lax.erf(x) * 2, np.ones(2, np.float16)),
        (lambda x: x.sum(), jnp.ones(2, jnp.bfloat16)),
        (lambda x: jnp.dot(x, x, preferred_element_type=jnp.bfloat16), np.ones(2, np.float32)),
        (lambda x: x.at[np.array([0, 1])].apply(jnp.sin), np.ones(3)),
        (
            jax.vmap(lambda k: lax.switch(k, [lambda j=j: 1.0 * j for j in range(65)])),
            np.arange(3),
        ),
    ],
)
def test_what_python_or_numpy_cannot_is_left_to_xla(function, x):
    with pytest.raises(NotImplementedError):
        write_program(jax.make_jaxpr(function)(x))


def test_as_many_loops_as_python_allows():
    agree(_nested(20), np.ones(2))


def test_arrays_are_nobody_elses():
    """jax may keep the memory of results: they are no views of arguments or constants."""
    x, own = np.arange(6.0).reshape(2, 3), np.arange(3.0)

    def function(x):
        known = lax.cond(x[0, 0] < 1, lambda: jnp.sqrt(jnp.arange(3.0)), lambda: x[0])
        return x, x.T, own + 0 * x[0], jnp.asarray(own), own, known, jnp.zeros(3)

    run = write_program(jax.make_jaxpr(function)(x))
    results = [run([x], [0.0, np.inf]) for _ in range(2)]
    for found, again in zip(*results, strict=True):
        assert found.base is None and not np.shares_memory(found, x)
        assert not np.shares_memory(found, own) and not np.shares_memory(found, again)


def test_every_rule_has_been_compared():
    """The tests above go through every primitive that has a rule."""
    one, whole = np.ones((3, 2)), np.ones(3, np.int32)
    for table, *arguments in (
        *((table, one) for table in (UNARY, SHAPED, SUMS)),
        *((table, np.eye(3), np.eye(3)) for table in (BINARY, MATRICES)),
        (INTEGER, whole, whole),
        (AT, np.ones((4, 3)), np.arange(4)),
        (LOOPS, np.ones((4, 3))),
    ):
        for function in table.values():
            by_numpy(function, *arguments)
    # names of other versions of jax; primitives of this package; what only whole analyses have
    elsewhere = {"traced", "deferred", "search", "ffi_call", "debug_callback", "io_callback"}
    elsewhere |= {"add_any", "empty", "empty2"}
    missing = set(RULES) - SEEN - elsewhere
    assert missing <= OTHER_VERSIONS


OTHER_VERSIONS = {
    *("log2", "one_minus_square", "closed_call", "remat2", "checkpoint", "custom_vmap_call"),
    *("eval_jaxpr", "call_hi_primitive"),
    *("scatter_add", "scatter_sub", "scatter_mul", "scatter_min", "scatter_max", "tile"),
    *("custom_vjp_call", "copy", "stop_gradient", "unstack", "lu_pivots_to_permutation", "stack"),
}
