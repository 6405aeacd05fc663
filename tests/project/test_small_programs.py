"""What NumPy evaluates in place of XLA has the same values, dtypes and weak types."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest
import small_programs

X = np.array([0.5, -2.0, 3.0])
CALLS = {
    "operators": lambda: 2.0 * jnp.asarray(X)[1:] - 1,
    "weak": lambda: jnp.sin(2.0) * np.float32(3.0),
    "integers": lambda: jnp.argsort(jnp.asarray(X)) // 2,
    "norm": lambda: jnp.linalg.norm(jnp.asarray(X)),
    "gradient": lambda: jax.grad(lambda x: jnp.where(x > 0, x, 0.1 * x).sum())(X),
    "batch": lambda: jax.vmap(lambda x: jnp.cross(x, X))(np.outer(X, X)),
    "loop": lambda: jax.lax.fori_loop(0, 3, lambda _, x: jnp.cos(x), jnp.asarray(X)),
}


@pytest.mark.skipif(not small_programs.is_possible(), reason="this jax has no place for it")
@pytest.mark.parametrize("name", CALLS)
def test_small_programs_have_the_results_of_xla(name):
    found = []
    for switch in (True, False):
        jax.clear_caches()
        small_programs.by_numpy(switch)  # until the next test
        found.append(CALLS[name]())
    ours, theirs = found
    assert (ours.dtype, ours.weak_type) == (theirs.dtype, theirs.weak_type)
    np.testing.assert_allclose(ours, theirs, rtol=1e-15)
