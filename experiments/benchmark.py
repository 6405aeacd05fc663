"""The benchmarks: times of jaxcable, alone and beside other programs.

    python experiments/benchmark.py [--quick] NAME [PART ...]

Without a name it lists them. Each writes its files to experiments/results. With --quick it measures
a case or two of each kind and writes to a temporary folder, to see that it runs. The table
`benchmarks/cases.py` says what is measured, `benchmarks/measure.py` how. OpenSees and jax_fdm are
measured, too, if OPENSEES_PYTHON and JAX_FDM_PYTHON name interpreters that have them; first calls
with another version of jax, if OTHER_JAX_PYTHON names an interpreter that has it.
"""

import importlib
import os
import sys
import tempfile
from pathlib import Path

os.environ["OPENBLAS_NUM_THREADS"] = "1"  # before NumPy is loaded

import record
from benchmarks.cases import FULL, QUICK

NAMES = {  # name: module of `benchmarks`, function, parts, and what it measures
    "scaling": (
        "scaling",
        "run",
        "nets and batches beside OpenSees [nets hard batches draw]",
    ),
    "evaluation": ("evaluations", "run", "first calls by NumPy, and compiled"),
    "kept_programs": ("kept_programs", "run", "memory of programs of many shapes"),
    "gradient_cost": ("gradient_cost", "run", "value and gradient over the value alone"),
    "work_precision": ("work_precision", "run", "time against error, setting by setting"),
    "force_density": ("force_density", "run", "force densities beside jax_fdm"),
    "frames_batch": ("frames_batch", "run", "frames in batches, and their gradients"),
    "many_cases": ("many_cases", "run", "a study of many cases in files, by several processes"),
    "first_screen": ("commands", "first_screen", "commands of the README's first screen"),
    "waiting": ("commands", "waiting", "programs that might wait for ever [PYTHON ...]"),
    "installs": ("installs", "run", "the wheel in empty environments"),
    "gpu": ("gpu", "run", "a GPU beside the CPU of its machine"),
}


def main(words):
    quick = "--quick" in words
    name, *parts = [word for word in words if word != "--quick"] or [""]
    if name not in NAMES:
        print(__doc__)
        for known, (module, _, text) in NAMES.items():
            print(f"  {known:16}{text}; see benchmarks/{module}.py")
        return 2
    module, function, _ = NAMES[name]
    with tempfile.TemporaryDirectory() as folder:
        if quick:
            record.RESULTS = Path(folder)
        run = getattr(importlib.import_module(f"benchmarks.{module}"), function)
        run(QUICK if quick else FULL, parts)
    return 0


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
