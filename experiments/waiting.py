"""Does any program wait for ever: batches, threads, gradients, on two cores?

Question   How many of 50 calls of each of eleven programs do not end, fused loops or not.
Reference  The control: 500 batched calls of LAPACK as jax makes them, which on jaxlib 0.10 wait
           for each other; the same programs of any other version of the package by PYTHONPATH.
Error      Calls that have not ended within the limit, by default 240 s for 50 of them.
Command    python experiments/waiting.py [--python ANOTHER ...] [--limit 240]
           (writes experiments/results/waiting.txt; 10 minutes for each interpreter, most of it
           compilation)

Each program (`tests/banks/waiting_programs.py`) is a process of its own; every call has other
numbers.
"""

import argparse
import os
import subprocess
import sys
import time
from pathlib import Path

from record import Record

TESTS = Path(__file__).parent.parent / "tests"
sys.path.insert(0, str(TESTS))
CALLS, CONTROL_CALLS = 50, 500
VERSION = (
    "import jax, platform; print(f'jax {jax.__version__}, Python {platform.python_version()}')"
)


def ended(python, name, fused, limit):
    """Whether all calls of a program end, and seconds; what it says if it fails."""
    environment = {k: v for k, v in os.environ.items() if k != "XLA_FLAGS"}
    calls = CONTROL_CALLS if name == "control" else CALLS
    options = ["--calls", str(calls), *(["--fused"] if fused else [])]
    begin = time.perf_counter()
    command = [python, str(TESTS / "banks" / "waiting_programs.py"), name, *options]
    try:
        done = subprocess.run(
            command, env=environment, capture_output=True, text=True, timeout=limit
        )
    except subprocess.TimeoutExpired:
        return f"has not ended after {limit} s"
    if done.returncode:
        return f"failed: {done.stderr.strip().splitlines()[-1][:80]}"
    return f"ended, {time.perf_counter() - begin:4.0f} s"


def main():
    parser = argparse.ArgumentParser()
    parser.add_argument("--python", nargs="*", default=[sys.executable])
    parser.add_argument("--limit", type=float, default=240.0)
    given = parser.parse_args()
    from banks.waiting_programs import PROGRAMS

    record = Record("waiting")
    for python in given.python:
        run = subprocess.run([python, "-c", VERSION], capture_output=True, text=True)
        record(f"\n{run.stdout.strip()}; {CALLS} calls each, two cores; seconds with compilation")
        record(f"{'':22}{'usual':>28}{'fused loops':>28}")
        for name in PROGRAMS:
            limit = min(given.limit, 60) if name == "control" else given.limit
            found = [ended(python, name, fused, limit) for fused in (False, True)]
            record(f"{name:22}{found[0]:>28}{found[1]:>28}")
    record.close()


if __name__ == "__main__":
    main()
