"""What an installation takes, and whether what is installed works.

Question   Seconds and MB of `pip install` into an empty environment, and seconds of the first
           commands there, by version of Python and of jax, with and without all extras. Do demo,
           commands and some tests run from there, outside of the checkout?
Reference  None: they run, or not.
Error      None. Seconds include the network, and the compilation of a first run.
Results    installs.txt

The wheel is built from this checkout. INSTALL_PYTHONS names further interpreters, separated by
colons.
"""

import os
import subprocess
import sys
import tempfile
from pathlib import Path

import installed_wheel
import record


def run(cases, _):
    say = record.Record("installs")
    pythons = [sys.executable, *filter(None, os.environ.get("INSTALL_PYTHONS", "").split(":"))]
    with tempfile.TemporaryDirectory() as folder:
        build = [sys.executable, "-m", "pip", "wheel", "--no-deps", "-w", folder, record.ROOT]
        subprocess.run(build, check=True, capture_output=True)
        wheel = next(Path(folder).glob("*.whl"))
        say(f"\nwheel {wheel.name}, {wheel.stat().st_size / 1e6:.1f} MB\n")
        say(installed_wheel.HEADER)
        for python in pythons[: cases.installs]:
            for jax, extras in (("0.10.2", "none"), ("newest", "none"), ("newest", "all")):
                with tempfile.TemporaryDirectory() as place:
                    given = wheel, python, jax, extras, Path(place)
                    say(installed_wheel.try_wheel(*given).line())
    say.close()
