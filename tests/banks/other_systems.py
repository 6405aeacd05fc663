"""The package where names of Linux are missing: what Windows and macOS lack is hidden first.

    python -X warn_default_encoding tests/banks/other_systems.py FOLDER

runs commands and calls in an empty folder, and prints what it has run. A file that is opened as
text without its encoding is an error, since the default differs from system to system.
"""

import builtins
import ctypes
import io
import multiprocessing.pool  # what the standard library asks of a system, it asks now
import os
import runpy
import signal
import sys
import tempfile
import warnings
from pathlib import Path

import jax
import matplotlib.pyplot
import numpy as np
import optax  # noqa: F401 - as the next two: before names are hidden, which they may need
import scipy.optimize  # noqa: F401
import scipy.sparse.linalg  # noqa: F401

# not on Windows (https://docs.python.org/3/library/os.html, "Availability"); the first not on macOS
FUNCTIONS = """sched_getaffinity chown fchmod fchown fork geteuid getegid getgid getgroups
    getloadavg getpgid getuid killpg lchown mkfifo nice openpty posix_fallocate posix_spawn setsid
    statvfs sysconf uname wait3 wait4 O_NOFOLLOW O_NONBLOCK O_CLOEXEC O_DIRECTORY"""
MODULES = "fcntl grp pwd resource termios tty pty readline syslog posix"
SIGNALS = "SIGALRM SIGHUP SIGKILL SIGPIPE SIGUSR1 SIGUSR2 setitimer alarm"


def without_proc(opens):
    def refuse(path, *arguments, **options):
        if isinstance(path, str | os.PathLike) and str(path).startswith("/proc"):
            raise FileNotFoundError(path)
        return opens(path, *arguments, **options)

    return refuse


def hide():
    """Take away what other systems do not have."""
    for name in FUNCTIONS.split():
        if hasattr(os, name):
            delattr(os, name)
    for name in SIGNALS.split():
        delattr(signal, name)
    for name in MODULES.split():
        sys.modules[name] = None
    builtins.open = io.open = without_proc(io.open)
    os.open = without_proc(os.open)
    library = ctypes.CDLL

    class WithoutItself(library):
        def __init__(self, name, *arguments, **options):
            if name is None:  # as on Windows
                raise TypeError("argument of type 'NoneType' is not iterable")
            super().__init__(name, *arguments, **options)

    ctypes.CDLL = WithoutItself


def commands():
    """Commands of the command line, each with status 0."""
    from jaxcable.cli import main

    for words in (
        ["demo"],
        *(["new", kind] for kind in ("net", "mast", "dome", "bridge")),
        ["info", "net.json"],
        ["solve", "net.json", "--report", "net.txt", "--save", "net.vtk"],
        ["solve", "net.json", "--report", "net.csv", "--save", "net.csv"],
        ["plot", "net.json", "--save", "net.png"],
        ["view", "net.json", "--no-open"],
        ["convert", "net.json", "--save", "net.dxf"],
        ["schema", "--save", "scene.schema.json"],
    ):
        assert main(words) == 0, words
        print("ran", *words, flush=True)
    runpy.run_path("net.py")
    print("ran net.py")


def calls(folder):
    """What asks the system most: devices, studies in files, memory."""
    import jaxcable as jc

    structure, phases = jc.scenes.flat_net()

    one = jc.solve(structure, phases).displacement[3, 2]
    forces = np.linspace(900.0, 1100.0, 4)

    def lowest(force):
        stated = [jc.replace(phases[0], pretension=force), *phases[1:]]
        return {"z": jc.solve(structure, stated).displacement[3, 2]}

    found = jc.batched(lowest)(forces)["z"]
    assert found.shape == (4,) and np.isfinite(one)
    study = jc.study(lowest, forces, folder / "study", chunk=2)
    np.testing.assert_allclose(study.load()["z"], found, rtol=1e-9)
    jc.forget_programs()
    print("ran calls")


def main(folder):
    folder = Path(folder).resolve()
    os.chdir(folder)
    matplotlib.use("Agg")
    jax.config.update("jax_enable_x64", True)
    multiprocessing.pool.ThreadPool(1).close()
    tempfile.gettempdir()
    warnings.filterwarnings("error", category=EncodingWarning, module=r"jaxcable(\.|$)")
    hide()
    commands()
    calls(folder)


if __name__ == "__main__":
    main(sys.argv[1])
