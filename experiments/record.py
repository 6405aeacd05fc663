"""The record of a study: prints lines and writes them to `results`, after a line about the machine.

Importing this module sets double precision, and pictures without a window.
"""

import json
import os
import platform
import subprocess
import sys
import time
from pathlib import Path

import jax
import matplotlib
import numpy as np
import scipy

ROOT = Path(__file__).parent.parent
RESULTS = ROOT / "experiments" / "results"
jax.config.update("jax_enable_x64", True)
matplotlib.use("Agg")


def reference(name):
    """The numbers of the paper, or of an independent computation, in `tests/reference`."""
    return json.loads((ROOT / "tests" / "reference" / f"{name}.json").read_text())


def commit():
    """Short name of the commit, marked if anything but results differs from it."""

    def git(*arguments):
        run = subprocess.run(["git", *arguments], capture_output=True, text=True, cwd=ROOT)
        return run.stdout.strip()

    changed = git("status", "--porcelain", "--", ".", ":!experiments/results")
    return git("rev-parse", "--short", "HEAD") + ("-dirty" if changed else "")


def machine():
    """Describe the machine: processor, cores, versions, commit."""
    information = Path("/proc/cpuinfo")  # of Linux
    lines = information.read_text(encoding="utf-8").splitlines() if information.exists() else []
    names = [line.split(":")[1].strip() for line in lines if line.startswith("model name")]
    return (
        f"{names[0] if names else platform.machine()}, {os.cpu_count()} cores; "
        f"Python {platform.python_version()}, jax {jax.__version__}, numpy {np.__version__}, "
        f"scipy {scipy.__version__}; commit {commit()}"
    )


def write(path, content, dpi=130):
    """Write a text, or a picture of matplotlib, completely or not at all."""
    from jaxcable.common.writing import atomic_write

    path.parent.mkdir(exist_ok=True)
    text = isinstance(content, str)
    with atomic_write(path, "w" if text else "wb") as stream:
        if text:
            stream.write(content)
        else:
            content.savefig(stream, format=path.suffix[1:], dpi=dpi)


class Record:
    """Prints text, and keeps it for `results/NAME.txt`, which `close` writes.

    It begins with the machine, the versions and the commit.
    """

    def __init__(self, name):
        self.path = RESULTS / f"{name}.txt"
        self.picture = RESULTS / f"{name}.png"
        self.text, self.begin = "", time.perf_counter()
        self(machine())

    def __call__(self, text="", end="\n"):
        print(text, end=end)
        sys.stdout.flush()
        self.text += text + end

    def close(self, figure=None):
        """Write the table, and the picture if there is one."""
        self(f"\n{time.perf_counter() - self.begin:.0f} s in all, compilation included")
        write(self.path, self.text)
        if figure is not None:
            write(self.picture, figure)
