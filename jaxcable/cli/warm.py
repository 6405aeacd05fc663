"""``warm``: compile the programs of usual structures in advance, which takes some minutes.

First analyses by commands, and by scripts that call `jaxcable.keep_programs()`, then begin at once.
"""

from __future__ import annotations

import subprocess
import sys
import time
from argparse import Namespace
from pathlib import Path

from ..common import program_store
from ..scenes import usual
from . import inputs
from .guard import BadInput, refuse_value_errors
from .warming import warm_programs

_started: list[subprocess.Popen[bytes]] = []  # kept, because they go on after this process


def run(options: Namespace) -> None:
    """Compile the programs of the kinds and scenes that options name; print each, and the sum."""
    if program_store.bytes_of_kept_programs() is None:
        raise BadInput(
            "warm: no programs are kept; let JAXCABLE_PROGRAMS name a folder to which only you can "
            "write"
        )
    kinds = [word for word in options.what if word in usual.KINDS]
    files = [word for word in options.what if word not in usual.KINDS]
    for word in files:
        if not Path(word).is_file():
            known = ", ".join(usual.KINDS)
            raise BadInput(f"warm: {word}: expected a scene, or one of {known}")
    if options.background:
        _start_in_background(options)
        return
    begin, count = time.perf_counter(), 0
    for kind in kinds if options.what else usual.KINDS:
        count += _warm(kind, usual.KINDS[kind](usual.SIZES[options.size]), options.gradients)
    for path in files:
        with refuse_value_errors(path):
            scene = inputs.read_scene(Namespace(**vars(options), scene=path))
            count += _warm(path, [scene], options.gradients)
    size = (program_store.bytes_of_kept_programs() or 0) / 1e6
    seconds = time.perf_counter() - begin
    print(f"{count} programs in {seconds:.0f} s; all programs that are kept take {size:.0f} MB")


def _warm(name, scenes, gradients):
    """Compile the programs of scenes, print their sizes and times, and return their number."""
    count = 0
    for program in warm_programs(scenes, gradients):
        sizes, count = program.sizes, count + 1
        text = (
            "its own sizes"
            if sizes is None
            else f"{sum(sizes.elements)} elements, {sizes.unknowns} unknowns, "
            f"{sizes.phases} phases, {sizes.increments} increments"
        )
        kind = ", with fallbacks" if program.has_fallbacks else ""
        if program.gradient_of:
            by = " by sections, too" if program.by_sections else ""
            kind = f", gradient of {' and '.join(program.gradient_of)}{by}"
        print(f"{name}: up to {text}{kind}: {program.seconds:.1f} s", flush=True)
    return count


def _start_in_background(options):
    """Start the command once more, as a process of its own that goes on after this one."""
    words = [sys.executable, "-m", "jaxcable", "warm", *options.what, "--size", options.size]
    words += ["--largest", str(options.largest)]
    words += ["--gradients"] * options.gradients
    for module in options.modules:
        words += ["--import", module]
    nowhere = dict.fromkeys(("stdin", "stdout", "stderr"), subprocess.DEVNULL)
    process = subprocess.Popen([*words, "--quiet"], **nowhere, start_new_session=True)
    _started.append(process)
    print(f"compiling in the background (process {process.pid})")
