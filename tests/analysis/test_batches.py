"""Chunks, devices and processes change nothing in the answers of a batch."""

import functools
import json
import os
import socket
import subprocess
import sys
from pathlib import Path

import jax
import jax.numpy as jnp
import numpy as np
import pytest

import jaxcable as jc
from jaxcable.analysis import batches

SCRIPT = Path(__file__).parents[2] / "experiments" / "several_devices.py"
STRUCTURE, _ = jc.scenes.flat_net()
FREE = np.array([3, 4, 7, 8])
FORCES = np.random.default_rng(0).normal(size=(7, 4, 3)) * 20


def tension(force, pretension=200.0):
    loading = jc.Phase(loads=jc.NodalLoads(FREE, force))
    solution = jc.solve(STRUCTURE, [jc.Phase(pretension=pretension), loading])
    return solution.tension, solution.status


@pytest.mark.parametrize("devices", [None, 1])
@pytest.mark.parametrize("chunk", [1, 3, 7, 100, None])
def test_chunks(chunk, devices):
    """One device here; `make test-all` has four, and two processes."""

    def function(force):
        return jnp.sin(force).sum(), force[0]

    found = jc.batched(function, chunk, devices=devices and jax.devices())(FORCES)
    np.testing.assert_allclose(found[0], np.sin(FORCES).sum(axis=(1, 2)), rtol=1e-14)
    np.testing.assert_array_equal(found[1], FORCES[:, 0])


@pytest.mark.slow
def test_analyses_and_gradients_of_shared_and_own_parameters():
    """Beside single analyses, and differences."""

    @jax.jit
    @functools.partial(jax.value_and_grad, argnums=(0, 1), has_aux=True)
    def loss(pretension, forces):
        found, status = jc.batched(lambda F: tension(F, pretension), 3)(forces)
        return jnp.sum(found**2), (found, status)

    at = 200.0 * jnp.ones(12), jnp.asarray(FORCES)
    (_, (found, status)), slopes = loss(*at)
    assert found.shape == (7, 12) and not status.any()
    for force, row in zip(FORCES, found, strict=True):
        assert jnp.abs(row - tension(force, at[0])[0]).max() < 1e-9 * row.max()
    rng = np.random.default_rng(1)
    way = [jnp.asarray(rng.normal(size=x.shape)) for x in at]
    for k in (0, 1):  # 1e-3 N of 200 N: truncation and rounding are near 1e-9
        ends = []
        for step in (1e-3, -1e-3):
            moved = list(at)
            moved[k] = at[k] + step * way[k]
            ends.append(float(loss(*moved)[0][0]))
        difference = (ends[0] - ends[1]) / 2e-3
        assert float(jnp.sum(slopes[k] * way[k])) == pytest.approx(difference, rel=1e-6)


def test_several_arguments_as_pytrees():
    def function(case):
        return {"sum": case["a"] + case["b"][0].sum()}

    cases = {"a": jnp.arange(5.0), "b": (jnp.ones((5, 2)),)}
    assert np.array_equal(jc.batched(function, 2)(cases)["sum"], np.arange(5.0) + 2)


def test_random_keys_are_cases():
    keys = jax.random.split(jax.random.key(0), 5)
    found = jc.batched(jax.random.normal, 2)(keys)
    np.testing.assert_allclose(found, jax.vmap(jax.random.normal)(keys), rtol=1e-14)


def test_the_same_program_serves_all_calls(collect_young):
    """Another number of cases at once, or another number in it, is another program."""

    def power(x):
        return x**exponent

    known, exponent = batches._map_cases.known, 2
    known.clear()
    for count in (1, 1, 2):
        cases = jnp.arange(30.0 * count)  # at most 64 at once, fused loops a share for each core
        np.testing.assert_array_equal(jc.batched(power)(cases), cases**2)
        assert len(known) == count
    for many in (jnp.arange(4.0), jnp.arange(7.0)):  # chunks of two cases
        np.testing.assert_array_equal(jc.batched(power, chunk=2)(many), many**2)
    assert len(known) == 3
    exponent = 3
    np.testing.assert_array_equal(jc.batched(power)(cases), cases**3)
    assert len(known) == 4
    kept = jc.batched(lambda x: 2 * x)  # nobody else has this function
    collect_young()
    np.testing.assert_array_equal(kept(cases), 2 * cases)


def run(*options):
    """Start the script; it shares settings and compiled programs with this process."""
    environment = os.environ | {
        "JAX_DISABLE_MOST_OPTIMIZATIONS": "1",  # compiles faster
        "JAX_COMPILATION_CACHE_DIR": jax.config.jax_compilation_cache_dir or "",
        "JAX_PERSISTENT_CACHE_MIN_COMPILE_TIME_SECS": "0.1",
    }
    return subprocess.Popen(
        [sys.executable, SCRIPT, *map(str, options)],
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
        env=environment,
    )


def figures(process):
    out, err = process.communicate(timeout=240)
    assert process.returncode == 0, err[-2000:]
    found = json.loads(out.strip().splitlines()[-1])
    assert found["displacement_difference_m"] < 1e-12 * found["largest_displacement_m"]
    assert found["gradient_difference"] < 1e-12 * found["largest_gradient"]
    return found


@pytest.mark.slow
def test_two_processes_give_the_answers_of_one():
    with socket.socket() as probe:
        probe.bind(("127.0.0.1", 0))
        address = f"127.0.0.1:{probe.getsockname()[1]}"
    options = ("--processes", 2, "--cases", 6, "--chunk", 2, "--address", address)
    processes = [run(*options, "--rank", rank) for rank in (0, 1)]
    try:
        for rank, process in enumerate(processes):
            found = figures(process)
            assert found["devices"] == 2 and found["process"] == rank
    finally:
        for process in processes:
            process.kill()


@pytest.mark.slow
def test_four_devices_with_factorisations_on_the_host():
    # one case at a time goes by conjugate gradients, six at once do not: alike within `Newton.tol`
    options = ("--devices", 4, "--cases", 6, "--chunk", 1, "--side", 14, "--tol", 1e-13)
    found = figures(run(*options))
    assert found["devices"] == 4 and found["unknowns"] == 588
