"""Elongations by error-free arithmetic, against 400 bits."""

import functools

import jax
import jax.numpy as jnp
import mpmath
import numpy as np
import pytest
from oracles.traced import traced

from jaxcable.elements.rebasing import elongation_and_moved_ends


def scenes(dtype, n_end, count=200):
    """Elongations, ends and fine motions of chains, of which many cancel."""
    rng = np.random.default_rng(n_end)
    ends = rng.normal(size=(count, n_end, 3)) + 10 ** rng.uniform(-1, 2, size=(count, 1, 1))
    size = 10 ** rng.uniform(-6, 1, size=(count, 1, 1))
    motion = size * rng.normal(size=(count, n_end, 3))
    if n_end > 2:  # padding
        for values in (ends, motion):
            values[: count // 4, -1] = values[: count // 4, -2]
    ends, motion = ends.astype(dtype), motion.astype(dtype)
    low = (0.5 * np.finfo(dtype).eps * np.sin(motion) * motion).astype(dtype)
    motion = np.concatenate([motion, low], axis=-1)
    change = [longer(0, *at) for at in zip(ends, motion, strict=True)]
    nearly = np.where(np.arange(count) % 2, 1.0, 1.0001)
    elongation = [-float(c) * f for c, f in zip(change, nearly, strict=True)]
    return np.array(elongation, dtype), ends, motion


def longer(elongation, ends, motion):
    """The elongation after a motion, to 400 bits."""
    mpmath.mp.prec = 400
    ends, motion = (np.vectorize(lambda x: mpmath.mpf(float(x)))(v) for v in (ends, motion))
    chord, moved = np.diff(ends, axis=0), np.diff(motion[:, :3] + motion[:, 3:], axis=0)
    pairs = zip(chord + moved, chord, strict=True)
    norm = [mpmath.sqrt((v**2).sum()) - mpmath.sqrt((d**2).sum()) for v, d in pairs]
    return mpmath.mpf(float(elongation)) + sum(norm)


@pytest.mark.slow_cases("float32-5")
@pytest.mark.parametrize(("dtype", "n_end"), [(np.float64, 2), (np.float64, 5), (np.float32, 5)])
def test_elongations_are_exact_up_to_their_own_rounding(dtype, n_end):
    given = scenes(dtype, n_end)
    eps = float(np.finfo(dtype).eps)
    true = [longer(*at) for at in zip(*given, strict=True)]
    exactly = functools.partial(elongation_and_moved_ends, precise=jnp.ones((), bool))
    for run in (jax.vmap(exactly), traced(jax.vmap(exactly))):
        found, places = run(*given)
        assert found.dtype == dtype and places.dtype == dtype
        worst = 0.0
        for k, at in enumerate(true):
            error = abs(float(mpmath.mpf(float(found[k])) - at))
            moved = np.abs(given[2][k]).max()
            assert error <= eps * abs(float(at)) + 8 * eps**2 * moved
            worst = max(worst, eps * moved / max(error, 1e-300))
        assert worst > 1 / eps**0.5  # in working precision the rounding of displacements remains
    plain = np.asarray(given[0]) + np.sum(
        np.linalg.norm(np.diff(given[1] + given[2][..., :3], axis=1), axis=-1)
        - np.linalg.norm(np.diff(given[1], axis=1), axis=-1),
        axis=1,
    )
    short = [abs(float(mpmath.mpf(float(p)) - at)) for p, at in zip(plain, true, strict=True)]
    assert max(short) > 1e3 * eps**2  # the comparison can fail
