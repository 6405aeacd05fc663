"""How long do the commands of the README's first screen take?

Question   Seconds from a fresh checkout to the picture of the demo, with and without what is
           installed first; from a command to a page that turns.
Reference  None: times of whole commands, as a newcomer has them.
Error      None.
Command    python experiments/first_screen.py   (writes experiments/results/first_screen.txt)

The time to install is taken apart: `make demo` does it itself. The last commit is cloned into an
empty folder. Nothing that was downloaded or compiled before is used: pip's cache is off, and the
folder of kept programs is empty. Downloads are part of the time.
"""

import os
import subprocess
import tempfile
import time
from pathlib import Path

from record import Record

ROOT = Path(__file__).parent.parent
MODEL = "bridge"


class Screen:
    """Runs commands in a clone, and notes how long each takes.

    Args:
        folder: an empty folder.
        record: function that takes lines.
    """

    def __init__(self, folder, record):
        self.at, self.record = Path(folder) / "jaxcable", record
        subprocess.run(["git", "clone", "--quiet", str(ROOT), str(self.at)], check=True)
        kept = {
            name: value
            for name, value in os.environ.items()
            if name not in ("PYTHONPATH", "VIRTUAL_ENV", "MAKEFLAGS")
        }
        cache = str(Path(folder) / "cache")
        self.environment = kept | {"PIP_NO_CACHE_DIR": "1", "XDG_CACHE_HOME": cache}
        record(f"{'seconds':>8}  command")

    def __call__(self, command, note=""):
        """Run a command line, which must succeed."""
        begin = time.perf_counter()
        run = subprocess.run(
            command, shell=True, cwd=self.at, env=self.environment, capture_output=True, text=True
        )
        seconds = time.perf_counter() - begin
        if run.returncode:
            raise RuntimeError(f"{command}: {run.stdout[-3000:]}{run.stderr[-3000:]}")
        self.record(f"{seconds:8.1f}  {command}{'  # ' + note if note else ''}")


def main():
    record = Record("first_screen")
    with tempfile.TemporaryDirectory() as folder:
        screen = Screen(folder, record)
        screen("make .venv/installed")
        screen("make demo", "first")
        screen("make demo", "again")
        screen(f".venv/bin/jaxcable new {MODEL}")
        for note in ("first", "again"):
            screen(f".venv/bin/jaxcable view {MODEL}.json --no-open", note)
    record.close()


if __name__ == "__main__":
    main()
