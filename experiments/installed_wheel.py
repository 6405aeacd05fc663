"""Install a wheel into empty environments; run its demo, its commands and some tests there.

    python experiments/installed_wheel.py WHEEL [--python ...] [--jax ...] [--extras ...]

For each Python, version of jax ("newest" is that of the index) and set of extras ("none" is none)
it makes a virtual environment in a temporary folder, and works there, outside of the checkout: the
tests are copied, without the package beside them. It prints one line for each environment, and
exits with 1 if anything fails. `make test-dist` runs it; `benchmark.py installs` writes the table.
"""

import argparse
import itertools
import os
import re
import shutil
import subprocess
import sys
import tempfile
import time
from pathlib import Path
from typing import NamedTuple

ROOT = Path(__file__).resolve().parent.parent
COMMANDS = "demo", "new net", "solve net.json --report report.txt", "view net.json --no-open"
TESTS = (
    "tests/equilibrium/test_reference.py",
    "tests/elements/test_sliding.py",
    "tests/project/test_notebooks.py",
)
SITE_PACKAGES = "import sysconfig; print(sysconfig.get_path('purelib'))"
VERSIONS = "import jax, platform; print(platform.python_version(), jax.__version__)"
HEADER = "Python   jax      extras   install, s     MB   demo, s  new, solve, view, s   tests, s"


class StepError(Exception):
    """A step of an environment that has failed, with the end of its output."""


class Installed(NamedTuple):
    """What an environment took: versions, seconds and MB."""

    python: str
    jax: str
    extras: str
    install: float
    megabytes: float
    demo: float
    commands: float
    tests: float
    count: str

    def line(self):
        return (
            f"{self.python:<8} {self.jax:<8} {self.extras:<8} {self.install:>10.0f}"
            f" {self.megabytes:>6.0f} {self.demo:>9.1f} {self.commands:>20.1f}"
            f" {self.tests:>10.0f} ({self.count})"
        )


def run(words, folder):
    """Run a command in a folder without this checkout's settings; return output and seconds."""
    dropped = "PYTHONPATH", "JAX_COMPILATION_CACHE_DIR", "VIRTUAL_ENV"
    environment = {name: value for name, value in os.environ.items() if name not in dropped}
    begin = time.perf_counter()
    done = subprocess.run(
        [str(word) for word in words],
        cwd=folder,
        env=environment,
        capture_output=True,
        text=True,
        encoding="utf-8",
        timeout=1800,
    )
    if done.returncode:
        end = (done.stdout + done.stderr)[-3000:]
        raise StepError(f"{' '.join(map(str, words))} ended with {done.returncode}:\n{end}")
    return done.stdout, time.perf_counter() - begin


def try_wheel(wheel, python, jax, extras, folder):
    """Make an environment in `folder`, install the wheel and use it; return an `Installed`."""
    run([python, "-m", "venv", folder / "env"], folder)
    scripts = folder / "env" / ("Scripts" if os.name == "nt" else "bin")
    own = scripts / "python"
    wanted = [f"jaxcable{'' if extras == 'none' else f'[{extras}]'} @ {Path(wheel).as_uri()}"]
    wanted += [] if jax == "newest" else [f"jax=={jax}", f"jaxlib=={jax}"]
    install = run([own, "-m", "pip", "install", "--quiet", *wanted], folder)[1]
    place = Path(run([own, "-c", SITE_PACKAGES], folder)[0].strip())
    size = sum(path.stat().st_size for path in place.rglob("*") if path.is_file()) / 1e6
    versions = run([own, "-c", VERSIONS], folder)[0].split()
    seconds = [run([scripts / "jaxcable", *words.split()], folder)[1] for words in COMMANDS]
    for made in ("net.json", "report.txt", "net.html"):
        if not (folder / made).stat().st_size:
            raise StepError(f"{made} is empty")
    for name in ("tests", "experiments", "notebooks"):
        shutil.copytree(ROOT / name, folder / name, ignore=shutil.ignore_patterns("results"))
    shutil.copy(ROOT / "pyproject.toml", folder)
    run([own, "-m", "pip", "install", "--quiet", "pytest"], folder)
    said, tests = run([own, "-m", "pytest", "-p", "no:cacheprovider", *TESTS], folder)
    count = re.search(r"\d+ passed", said)[0]
    return Installed(*versions, extras, install, size, seconds[0], sum(seconds[1:]), tests, count)


def main(words):
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("wheel")
    parser.add_argument("--python", nargs="+", default=[sys.executable])
    parser.add_argument("--jax", nargs="+", default=["newest"])
    parser.add_argument("--extras", nargs="+", default=["none"])
    chosen = parser.parse_args(words)
    wheel, failures = Path(chosen.wheel).resolve(), 0
    print(HEADER)
    for python, jax, extras in itertools.product(chosen.python, chosen.jax, chosen.extras):
        with tempfile.TemporaryDirectory() as folder:
            try:
                print(try_wheel(wheel, python, jax, extras, Path(folder)).line(), flush=True)
            except (StepError, OSError, subprocess.TimeoutExpired) as error:
                failures += 1
                print(f"{python} jax {jax} extras {extras}: {error}", flush=True)
    return min(failures, 1)


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
