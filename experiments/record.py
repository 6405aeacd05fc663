"""Where the studies write: the machine and the versions first, then every line twice."""

import os
import platform
import subprocess
import sys
import time
from pathlib import Path

RESULTS = Path(__file__).parent / "results"


def commit():
    """Short name of the commit, marked if anything but results differs from it."""

    def git(*arguments):
        run = subprocess.run(
            ["git", *arguments], capture_output=True, text=True, cwd=RESULTS.parent.parent
        )
        return run.stdout.strip()

    changed = git("status", "--porcelain", "--", ".", ":!experiments/results")
    return git("rev-parse", "--short", "HEAD") + ("-dirty" if changed else "")


class Record:
    """Prints lines, and keeps them for `results/NAME.txt`, which `close` writes.

    It begins with the machine, the versions and the commit.
    """

    def __init__(self, name):
        import jax
        import numpy as np

        self.path = RESULTS / f"{name}.txt"
        self.picture = RESULTS / f"{name}.png"
        self.lines, self.begin = [], time.perf_counter()
        self(
            f"{platform.machine()}, {os.cpu_count()} cores; Python {platform.python_version()}, "
            f"jax {jax.__version__}, numpy {np.__version__}; commit {commit()}"
        )

    def __call__(self, line=""):
        print(line)
        sys.stdout.flush()
        self.lines.append(line)

    def close(self, figure=None):
        """Write the table, and the picture if there is one."""
        self(f"\n{time.perf_counter() - self.begin:.0f} s in all, compilation included")
        RESULTS.mkdir(exist_ok=True)
        self.path.write_text("\n".join(self.lines) + "\n")
        if figure is not None:
            figure.savefig(self.picture, dpi=130)
