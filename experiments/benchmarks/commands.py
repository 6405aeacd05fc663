"""How long do whole commands take, and does any program hang?

Question   first_screen: seconds from a fresh checkout to the picture of the demo, with and without
           the installation; from a command to an interactive 3-D page. waiting: how many of 50
           calls of each of eleven programs (batches, threads, gradients, on two cores) hang, with
           and without fused loops.
Reference  first_screen: none, times of whole commands, as a newcomer has them. waiting: the
           control, 500 batched calls of LAPACK as jax makes them, which on jaxlib 0.10 wait for
           each other; the same programs of any other version of the package by PYTHONPATH.
Error      waiting: calls that have not ended within 240 s, for 50 of them.
Results    first_screen.txt; waiting.txt (10 minutes for each interpreter that is named, this one by
           default; most of it compilation)

first_screen: `make demo` installs the package; the time for that is measured separately. The last
commit is cloned into an empty folder. Nothing that was downloaded or compiled before is used: pip's
cache is off. Downloads are part of the time.

waiting: each program (`tests/banks/waiting_programs.py`) runs in a separate process; every call has
different numbers.
"""

import os
import subprocess
import sys
import tempfile
import time
from pathlib import Path

from record import Record

ROOT = Path(__file__).parents[2]
TESTS = ROOT / "tests"
SCREEN = [  # the notes are a part of the table
    "make .venv/installed",
    "make demo  # first",
    "make demo  # again",
    ".venv/bin/jaxcable new bridge",
    ".venv/bin/jaxcable view bridge.json --no-open  # first",
    ".venv/bin/jaxcable view bridge.json --no-open  # again",
]
LIMIT = 240  # s
VERSION = (
    "import jax, platform; print(f'jax {jax.__version__}, Python {platform.python_version()}')"
)


def first_screen(cases, _):
    say, inherited = Record("first_screen"), ("PYTHONPATH", "VIRTUAL_ENV", "MAKEFLAGS")
    with tempfile.TemporaryDirectory() as folder:
        at = Path(folder) / "jaxcable"
        subprocess.run(["git", "clone", "--quiet", str(ROOT), str(at)], check=True)
        environment = {k: v for k, v in os.environ.items() if k not in inherited}
        environment |= {"PIP_NO_CACHE_DIR": "1", "XDG_CACHE_HOME": str(Path(folder) / "cache")}
        say(f"{'seconds':>8}  command")
        for line in SCREEN if cases.whole else ["git log -1"]:
            command = line.partition("  #")[0]
            begin = time.perf_counter()
            run = subprocess.run(
                command, shell=True, cwd=at, env=environment, capture_output=True, text=True
            )
            seconds = time.perf_counter() - begin
            if run.returncode:
                raise RuntimeError(f"{command}: {run.stdout[-3000:]}{run.stderr[-3000:]}")
            say(f"{seconds:8.1f}  {line}")
    say.close()


def ended(python, name, fused, calls, limit):
    """Return whether all calls of a program end, the seconds, and the message of a failure."""
    environment = {k: v for k, v in os.environ.items() if k != "XLA_FLAGS"}
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


def waiting(cases, pythons):
    sys.path.insert(0, str(TESTS))
    from banks.waiting_programs import PROGRAMS

    say, (calls, of_control) = Record("waiting"), cases.waiting
    for python in pythons or [sys.executable]:
        run = subprocess.run([python, "-c", VERSION], capture_output=True, text=True)
        say(f"\n{run.stdout.strip()}; {calls} calls each, two cores; seconds with compilation")
        say(f"{'':22}{'usual':>28}{'fused loops':>28}")
        for name in PROGRAMS if cases.whole else ["control"]:
            control = name == "control"
            limits = (of_control, 60) if control else (calls, LIMIT)
            found = [ended(python, name, fused, *limits) for fused in (False, True)]
            say(f"{name:22}{found[0]:>28}{found[1]:>28}")
    say.close()
