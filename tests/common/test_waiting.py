"""Nothing waits for ever: batches, threads and gradients, each in a process with a time limit."""

import os
import subprocess
import sys
from pathlib import Path

import jax
import pytest
from banks.waiting_programs import PROGRAMS

SCRIPT = Path(__file__).parents[1] / "banks" / "waiting_programs.py"
LIMIT = 240  # seconds: what takes 10 on a quiet machine, 25 times as long
FUSED = "forms", "nets"
# one program by `jax.vmap` in threads, one by `jc.batched`, and two that call searches in Python
USUAL = "frames_in_threads", "forms", "searches", "fits"
CALLS = {"nets_on_the_host": 10, "searches_by_analyses": 10}
"""Calls of programs that call the host hundreds of times in each; of the others there are 30."""
OTHERS = sorted(PROGRAMS.keys() - {"control", *USUAL})


def ended(name):
    """What a program prints in a process of its own, with jax's own settings, and its calls."""
    calls = CALLS.get(name, 30)
    environment = {k: v for k, v in os.environ.items() if k != "XLA_FLAGS"}
    # what they have compiled is kept: that they run to the end is what is tested
    environment["JAX_COMPILATION_CACHE_DIR"] = jax.config.jax_compilation_cache_dir or ""
    environment["JAX_PERSISTENT_CACHE_MIN_COMPILE_TIME_SECS"] = "0.1"
    words = [name, "--calls", str(calls), *(["--fused"] if name in FUSED else [])]
    done = subprocess.run(
        [sys.executable, SCRIPT, *words],
        env=environment,
        capture_output=True,
        text=True,
        timeout=LIMIT,
    )
    assert done.returncode == 0, done.stderr[-2000:]
    return done.stdout.strip(), calls


@pytest.mark.slow_cases("frames_in_threads", "searches", "fits")
@pytest.mark.parametrize("name", USUAL)
def test_calls_end(name):
    said, calls = ended(name)
    assert said == f"{calls} calls ended"


@pytest.mark.slow
@pytest.mark.parametrize("name", OTHERS)
def test_all_programs_end(name):
    """`experiments/benchmark.py waiting` runs all of them with fused loops, and without."""
    said, calls = ended(name)
    assert said == f"{calls} calls ended"
