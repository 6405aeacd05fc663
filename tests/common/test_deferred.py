"""Functions that are traced only where they are needed (`common.deferred`)."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from jax import lax

from jaxcable.common.deferred import deferred
from jaxcable.programs.evaluator import write_program

X = np.array([0.5, 1.5, -2.0])


def branching(seen, wrap):
    """A function with a rarely taken branch, which `wrap` may defer, and notes its tracing."""

    def rare(x):
        seen.append("rare")
        return {"cube": x**3, "sum": jnp.sum(jnp.sin(x))}

    def usual(x):
        return {"cube": x, "sum": jnp.sum(x)}

    return lambda x: lax.cond(jnp.sum(x) > 10, wrap(rare, usual(x)), usual, x)


def test_a_branch_is_traced_when_it_is_first_taken():
    seen = []
    program = jax.make_jaxpr(branching(seen, deferred))(X)
    assert seen == []
    run = write_program(program)
    np.testing.assert_allclose(run([X], [0.0, np.inf])[0], X)
    assert seen == []
    for _ in range(2):
        cube, total = run([X + 5], [0.0, np.inf])
        np.testing.assert_allclose(cube, (X + 5) ** 3, rtol=1e-15)
        np.testing.assert_allclose(total, np.sin(X + 5).sum(), rtol=1e-14)
    assert seen == ["rare"]


@pytest.mark.parametrize("shift", [0.0, 5.0])
@pytest.mark.parametrize(
    "transform",
    [
        jax.jit,
        lambda f: jax.jit(jax.grad(lambda x: f(x)["sum"] + f(x)["cube"].sum())),
        lambda f: jax.jit(jax.jacfwd(lambda x: f(x)["cube"])),
        lambda f: lambda x: jax.jit(jax.vmap(f))(jnp.stack([x, x - 9, x + 9])),
        lambda f: jax.jit(lambda x: f(x)["sum"]),
    ],
)
def test_it_is_the_function_within_programs(transform, shift):
    both = [branching([], wrap) for wrap in (deferred, lambda rare, _: rare)]
    ours, theirs = (transform(function)(X + shift) for function in both)
    for own, other in zip(jax.tree.leaves(ours), jax.tree.leaves(theirs), strict=True):
        np.testing.assert_allclose(own, other, rtol=1e-14)
