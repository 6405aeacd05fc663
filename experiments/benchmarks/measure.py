"""Measure times: alternating calls, separate processes, medians with quartiles, tables."""

import json
import os
import subprocess
import sys
import time
from pathlib import Path

import numpy as np

HERE = Path(__file__).parent
PEERS = HERE.parent / "peers"
CALM = {"OPENBLAS_NUM_THREADS": "1", "JAX_COMPILATION_CACHE_DIR": None}
"""Environment of all processes that are measured: None is left out."""


def clock(function, *arguments):
    """Seconds of a call, blocked on completion, and its result."""
    import jax

    begin = time.perf_counter()
    result = jax.block_until_ready(function(*arguments))
    return time.perf_counter() - begin, result


def timed(function, *arguments, calls=5):
    """Result of a function, seconds of the first call, and of the others, sorted."""
    first, result = clock(function, *arguments)
    return result, first, sorted(clock(function, *arguments)[0] for _ in range(calls))


def by_turns(functions, count, new):
    """Measure functions in alternating order, forth and back; milliseconds, [count, n_function].

    Each call gets a new argument, `new(number of the call)`, from 1 on, because factors of matrices
    are cached by value.
    """
    import jax

    times, number = np.zeros((count, len(functions))), 0
    for turn in range(count):
        for k in range(len(functions))[:: 1 if turn % 2 else -1]:
            number += 1
            argument = jax.block_until_ready(new(number))
            times[turn, k] = 1e3 * clock(functions[k], argument)[0]
    return times


def apart(script, case, *words, interpreter=sys.executable, flags=None, limit=900):
    """Run a script for a case in a separate process; return its answer, also if it failed.

    Args:
        script: reads a line of JSON on stdin, and answers with another one.
        case: anything that JSON can hold.
        words: arguments of its command line.
        interpreter: Python interpreter.
        flags: changes of the environment; None removes a variable.
        limit: longest time, s.
    """
    environment = {**os.environ, **CALM, **(flags or {})}
    try:
        run = subprocess.run(
            [interpreter, str(script), *words],
            input=json.dumps(case) + "\n",
            capture_output=True,
            text=True,
            env={name: value for name, value in environment.items() if value is not None},
            timeout=limit,
        )
    except subprocess.TimeoutExpired:
        return {"error": f"no answer in {limit} s"}
    lines = run.stdout.strip().splitlines()
    if not lines:
        return {"error": f"died ({run.returncode}): {run.stderr.strip()[-300:]}"}
    return json.loads(lines[-1])


def analysis(case, **options):
    """The answer of `analysis.py`; SystemExit if it has none."""
    answer = apart(HERE / "analysis.py", case, **options)
    if "error" in answer:
        raise SystemExit(f"{case}: {answer['error']}")
    return answer


def opensees(script, case):
    """The answer of a script of `peers`, by the interpreter that OPENSEES_PYTHON names."""
    interpreter = os.environ.get("OPENSEES_PYTHON", sys.executable)
    return apart(PEERS / script, case, interpreter=interpreter)


class Peer:
    """A script of `peers` in a process of its own, that answers one line of JSON with another.

    Args:
        interpreter: environment variable that names the interpreter; else this one is taken.
        script, arguments: script that it runs, and its arguments.
        environment: changes of the environment.
    """

    def __init__(self, interpreter, script, *arguments, **environment):
        self.process = subprocess.Popen(
            [os.environ.get(interpreter, sys.executable), str(PEERS / script), *arguments],
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            stderr=subprocess.DEVNULL,
            text=True,
            env=os.environ | environment,
        )

    def ask(self, **case):
        print(json.dumps(case), file=self.process.stdin, flush=True)
        answer = self.process.stdout.readline()
        if not answer:
            raise RuntimeError(f"the process has ended at {case}")
        return json.loads(answer)

    def close(self):
        self.process.stdin.close()
        self.process.wait()


def bare(**options):
    """Seconds of the first call of the bare analysis, the unit Y."""
    return analysis({"scene": "bare"}, **options)["first_s"]


def quartiles(values, digits=2):
    """Median and quartiles as text."""
    low, middle, high = np.quantile(values, [0.25, 0.5, 0.75])
    return f"{middle:.{digits}f} ({low:.{digits}f}-{high:.{digits}f})"


def extent(values, digits=2):
    """Median, least and largest as text."""
    low, middle, high = np.quantile(values, [0, 0.5, 1])
    return f"{middle:.{digits}f} ({low:.{digits}f} to {high:.{digits}f})"


def table(head, rows):
    """Text with columns as wide as they need to be."""
    cells = [head, *rows]
    widths = [max(len(row[k]) for row in cells) for k in range(len(head))]
    lines = ["  ".join(c.rjust(w) for c, w in zip(row, widths, strict=True)) for row in cells]
    return "\n".join([lines[0], "-" * len(lines[0]), *lines[1:]])
