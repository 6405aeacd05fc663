"""LAPACK on one matrix at a time: values and derivatives beside jax's own, and no batched call."""

import ast
import re
from pathlib import Path

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from banks import waiting_programs

import jaxcable as jc
from jaxcable.linear import unbatched
from jaxcable.scenes import von_mises_truss

RNG = np.random.default_rng(0)
N = 5
GENERAL = jnp.asarray(RNG.normal(size=(3, N, N)))
DEFINITE = GENERAL @ jnp.swapaxes(GENERAL, 1, 2) + np.eye(N)[None]
RHS = jnp.asarray(RNG.normal(size=(3, N)))
TALL = jnp.asarray(RNG.normal(size=(3, 7, N)))


def triangular(factor, rhs):
    return jax.scipy.linalg.solve_triangular(factor, rhs, lower=True)


def over_both(function):
    """Sum of a function whose sign does not depend on that of eigenvectors."""
    return lambda matrix: sum(jnp.sum(jnp.sin(x**2)) for x in function(matrix))


SAME = {  # ours, jax's, arguments of three cases
    "cholesky": (unbatched.cholesky, jnp.linalg.cholesky, (DEFINITE,)),
    "eigh": (over_both(unbatched.eigh), over_both(jnp.linalg.eigh), (DEFINITE,)),
    "triangular": (unbatched.solve_triangular, triangular, (GENERAL + 3 * np.eye(N)[None], RHS)),
    "lstsq": (unbatched.lstsq, lambda a, b: jnp.linalg.lstsq(a, b)[0], (TALL, TALL[..., 0] ** 2)),
    "short": (
        unbatched.lstsq,
        lambda a, b: a.T @ jnp.linalg.solve(a @ a.T, b),  # A^+ of full row rank
        (jnp.swapaxes(TALL, 1, 2), RHS),
    ),
}


def transformed(function, count):
    """Values and derivatives of a batch, one program."""
    every = tuple(range(count))

    def total(*arguments):
        return jnp.sum(jnp.sin(function(*arguments)))

    return jax.jit(
        jax.vmap(
            lambda *a: (
                function(*a),
                jax.jacfwd(function, every)(*a),
                jax.grad(total, every)(*a),
                jax.hessian(total, every)(*a),
            )
        )
    )


@pytest.mark.slow_cases("lstsq", "short", "triangular")
@pytest.mark.parametrize("name", SAME)
def test_values_and_derivatives_are_those_of_jax(name):
    """In batches, too. Rounding: the matrices' condition is below 1e3, eps times that 2e-13."""
    *functions, arguments = SAME[name]
    found = [jax.tree.leaves(transformed(f, len(arguments))(*arguments)) for f in functions]
    for a, b in zip(*found, strict=True):
        assert jnp.isfinite(b).all() and jnp.abs(b).max() > 0
        assert jnp.abs(a - b).max() < 1e-9 * jnp.abs(b).max()


@pytest.mark.parametrize("transposed", [False, True])
def test_lu_of_a_batch(transposed):
    def solve(matrix, rhs):
        return unbatched.lu_solve(*unbatched.lu_factor(matrix), rhs, transposed)

    found = jax.jit(jax.vmap(solve))(GENERAL, RHS)
    for x, matrix, rhs in zip(found, GENERAL, RHS, strict=True):
        assert np.abs((matrix.T if transposed else matrix) @ x - rhs).max() < 1e-12
    assert np.array_equal(found[1], solve(GENERAL[1], RHS[1]))  # alone it is the same call


def test_batches_of_batches_and_arguments_that_all_cases_share():
    nested = jax.vmap(jax.vmap(unbatched.cho_solve, (None, 0)), (0, None))
    factors = jnp.linalg.cholesky(DEFINITE)
    found = jax.jit(nested)(factors, RHS)
    for x, factor in zip(found, factors, strict=True):
        assert jnp.abs(factor @ factor.T @ x.T - RHS.T).max() < 1e-12


def batched_calls(function, *arguments):
    """Calls of LAPACK in a program: all, and those of a batch of matrices."""
    text = jax.jit(function).lower(*arguments).as_text()
    batches = re.findall(r'custom_call @lapack_.*?num_batch_dims = "(\d)"', text)
    return len(batches), sum(map(int, batches))


def saddle_form(q):
    structure, _ = jc.scenes.saddle(3, 3)
    return jc.force_density(structure, q)[:, 2].sum()


def moment(curvature):
    section = jc.Section.rectangle(0.1, 0.2, jc.Elastic(1e9), shape=(2, 2))
    return section.strains(1e3, 1e3 * curvature, 0.0).strain


def followed(load):
    return jc.trace_path(
        *von_mises_truss(load=load), method=jc.Newton(linear_solver="dense")
    ).load_factor[-1]


def hung(sag):
    chain = jc.forms.hanging_chain
    return chain((0.0, 0, 0), (10.0, 0, 1.0), sag=sag, weight=1.0, axial_stiffness=1e4, n=4)


PROGRAMS = {
    "frame": (waiting_programs.bent, jnp.ones((2, 3))),
    "frame, gradient": (jax.grad(waiting_programs.bent), jnp.ones((2, 3))),
    "form": (jax.grad(saddle_form), jnp.ones(2)),
    "path": (followed, jnp.array([500.0, 510.0])),
    "section": (moment, jnp.ones(2)),
    "hanging chain": (hung, jnp.ones(2)),
    "adjustment": (lambda a: jc.design.adjustment(a, jnp.ones(3)), TALL[:, :3, :3]),
}


@pytest.mark.slow_cases("frame", "frame, gradient", "path", "hanging chain")
@pytest.mark.parametrize("name", PROGRAMS)
def test_programs_call_lapack_for_no_batch(name):
    function, cases = PROGRAMS[name]
    calls, batched = batched_calls(jax.vmap(function), cases)
    assert calls > 0 and batched == 0


def test_what_is_counted():
    assert batched_calls(jax.vmap(jnp.linalg.cholesky), DEFINITE) == (1, 1)


def test_only_one_module_calls_lapack():
    """Everything else of `jnp.linalg`, `jax.scipy.linalg` and `lax.linalg` has to go through it."""
    harmless = "norm", "cross", "multi_dot", "matmul", "outer", "lu_pivots_to_permutation"
    allowed = "unbatched.py", "jax_internals.py"  # the latter lowers a program and runs none
    package = Path(jc.__file__).parent
    found = []
    texts = {path: path.read_text() for path in package.rglob("*.py")}
    for path, text in texts.items():
        for node in ast.walk(ast.parse(text if "linalg" in text or "jsl" in text else "")):
            if isinstance(node, ast.Attribute) and isinstance(node.value, ast.Attribute | ast.Name):
                owner = ast.unparse(node.value)
                lapack = owner in ("jnp.linalg", "jsl", "lax.linalg", "jax.scipy.linalg")
                if lapack and node.attr not in harmless and path.name not in allowed:
                    found.append(f"{path.name}:{node.lineno} {owner}.{node.attr}")
    assert found == []
