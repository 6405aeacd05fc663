"""Does any of ten thousand random scenes end wrongly?

Question   Random nets, bars, curved laws, plastic bars, catenaries and ropes, with numbers over
           many orders of magnitude and in both precisions, and random mistakes in the input: what
           is the outcome?
Reference  `tests/oracles/independent.py`: residual, tensions, reactions and lengths in NumPy, in
           extended precision, independently of the package.
Error      There are three correct outcomes: a ValueError that names the argument; a failure status
           with NaN results and a last converged state; status OK with a residual within the
           tolerance of the method. Everything else is a defect.
Command    python experiments/fuzz.py [count] [seed]   (default 10000 1; writes
           experiments/results/fuzz.txt; five minutes)
"""

import collections
import os
import re
import sys
import time
from pathlib import Path

os.environ["OPENBLAS_NUM_THREADS"] = "1"
sys.path.insert(0, str(Path(__file__).parent.parent / "tests"))

import jax
import numpy as np
from banks.fuzz_scenes import FAMILIES, outcome, random_recipe
from banks.mistakes import MISTAKES
from record import Record

from jaxcable.common import status

# 20 programs, each compiled once and run some hundred times: compilation is most of the time
jax.config.update("jax_disable_most_optimizations", True)

MISTAKEN = 0.2  # part of the cases


def mistake(name, rng):
    """Return how the analysis of a wrong input ended, and what is wrong with that."""
    make, pattern = MISTAKES[name]
    try:
        result = make(rng)
    except ValueError as error:
        fits = pattern is not None and re.search(pattern, str(error))
        return "ValueError", None if fits else f"names something else: {error}"
    except Exception as error:  # any other kind is a defect, and counted as one
        return type(error).__name__, f"raises {type(error).__name__}: {error}"
    if pattern is not None:
        return "taken", "wrong input was taken"
    code = int(result.status)
    return "status", "wrong numbers are OK" if code == status.OK else None


def scene(recipe):
    try:
        return outcome(recipe)
    except Exception as error:  # a scene must not raise: a defect, and counted as one
        return type(error).__name__, f"raises {type(error).__name__}: {error}"


def main(count=10_000, seed=1):
    record, rng = Record("fuzz"), np.random.default_rng(seed)
    record(f"{count} cases, seed {seed}\n")
    defects, table = [], {}
    scenes = count - int(MISTAKEN * count)
    shapes = [(family, dtype) for family in FAMILIES for dtype in ("float64", "float32")]
    for number, (family, dtype) in enumerate(shapes):
        here, begin = collections.Counter(), time.perf_counter()
        for _ in range(scenes * (number + 1) // len(shapes) - scenes * number // len(shapes)):
            recipe = random_recipe(rng, [family], [dtype])
            name, defect = scene(recipe)
            here[name] += 1
            if defect is not None:
                defects.append(f"{defect}; {recipe}")
        table[family, dtype] = here, time.perf_counter() - begin
        jax.clear_caches()
    here, begin = collections.Counter(), time.perf_counter()
    for k in range(count - scenes):
        name = list(MISTAKES)[k % len(MISTAKES)]
        ended, defect = mistake(name, np.random.default_rng([seed, k]))
        here[ended] += 1
        if defect is not None:
            defects.append(f"{name} {[seed, k]}: {defect}")
    table["mistakes", ""] = here, time.perf_counter() - begin
    total = collections.Counter()
    for (family, dtype), (here, seconds) in table.items():
        ends = ", ".join(f"{n} {name}" for name, n in here.most_common())
        record(f"{family:10s} {dtype:8s} {seconds:5.0f} s  {ends}")
        total.update(here)
    record("\n" + "\n".join(f"{n:6d} {name}" for name, n in total.most_common()))
    share = 100 * total["NOT_CONVERGED"] / scenes  # no mistake ends so: its status is another
    record(f"valid scenes: {scenes}, of which {share:.0f} % end NOT_CONVERGED")
    record(f"\ndefects: {len(defects)}")
    for defect in defects:
        record(f"  {defect}")
    record.close()
    return len(defects)


if __name__ == "__main__":
    sys.exit(main(*map(int, sys.argv[1:])) > 0)
