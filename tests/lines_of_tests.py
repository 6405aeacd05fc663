"""Which lines of the package does every test run?

Record     LINES_OF_TESTS=FILE PYTHONPATH=tests python -m pytest -p lines_of_tests [-m ...] [-n 2]
           Every process appends to FILE.PID, one JSON object a test: its id, its seconds by the
           clock and of the processor, and by module below `jaxcable/` the lines that it has run.
           Python 3.12 or later (`sys.monitoring`): a line costs something once in a test only.
Read       python tests/lines_of_tests.py FILE ...
           Prints, room by room, the part of the lines that the tests run: those without the mark
           `slow`, and all that are recorded. It counts lines of functions. Lines that importing
           runs (modules and bodies of classes) are left out: no test is needed for them.
Limits     A test that finds a function of JAX traced by an earlier one does not run its lines: a
           line belongs to the tests that trace it, once in a process.
"""

import dis
import importlib.util
import json
import os
import subprocess
import sys
import time
from pathlib import Path

import pytest

ROOT = Path(__file__).parent.parent
PACKAGE = ROOT / "jaxcable"
TOOL = 3  # of `sys.monitoring`: neither debugger, coverage nor profiler
NO_LINE = {"RESUME", "RETURN_GENERATOR", "MAKE_CELL", "COPY_FREE_VARS"}
"""Instructions at the beginning of a function, whose line is that of its `def`."""
OPTIMIZED = 1  # flag of code of functions, which modules and bodies of classes do not have


# --- record


class Recorder:
    """Lines of the package that have run since `restart`, and where they are written.

    Attributes:
        package: folder of the package that is tested, with a separator at its end.
        path: beginning of the name of the file.
        ran: pairs (module, line).
    """

    def __init__(self, path):
        if not hasattr(sys, "monitoring"):
            raise pytest.UsageError("lines_of_tests: needs Python 3.12 or later")
        found = importlib.util.find_spec("jaxcable")
        self.package, self.path = str(Path(found.origin).parent) + os.sep, path
        self.ran, monitoring = set(), sys.monitoring
        monitoring.use_tool_id(TOOL, "lines_of_tests")
        monitoring.register_callback(TOOL, monitoring.events.LINE, self._note)
        monitoring.set_events(TOOL, monitoring.events.LINE)

    def _note(self, code, line):
        """Note a line that runs; it is not reported again before the next `restart`."""
        if code.co_filename.startswith(self.package):
            self.ran.add((code.co_filename, line))
        return sys.monitoring.DISABLE

    def restart(self):
        """Forget the lines, and have all of them reported anew."""
        self.ran = set()
        sys.monitoring.restart_events()

    def write(self, test, wall, cpu):
        """Append the lines of a test to the file of this process."""
        ran, lines = self.ran, {}
        for name, line in sorted(ran.copy()):
            module = Path(name).relative_to(self.package).as_posix()
            lines.setdefault(module, []).append(line)
        record = {"id": test, "wall": wall, "cpu": cpu, "lines": lines}
        with open(f"{self.path}.{os.getpid()}", "a", encoding="utf-8") as stream:
            stream.write(json.dumps(record) + "\n")


def pytest_configure(config):
    if "LINES_OF_TESTS" not in os.environ:
        raise pytest.UsageError("lines_of_tests: LINES_OF_TESTS names no file")
    config.lines_of_tests = Recorder(os.environ["LINES_OF_TESTS"])


@pytest.hookimpl(wrapper=True)
def pytest_runtest_protocol(item, nextitem):
    recorder = item.config.lines_of_tests
    recorder.restart()
    wall, cpu = time.perf_counter(), time.process_time()
    result = yield
    recorder.write(item.nodeid, time.perf_counter() - wall, time.process_time() - cpu)
    return result


# --- read


def records(files):
    """The objects in files of JSON lines, a list; a last line that is cut off is left out."""
    found = []
    for file in files:
        for line in Path(file).read_text(encoding="utf-8").splitlines():
            try:
                found.append(json.loads(line))
            except json.JSONDecodeError:
                sys.stderr.write(f"{file}: a line that is cut off\n")
    return found


def collected(marks, root=ROOT):
    """Ids of the tests with `marks`, an expression of pytest, in their order."""
    command = [sys.executable, "-m", "pytest", "--collect-only", "-o", "addopts=", "-q", "-n", "0"]
    command += ["-p", "no:cacheprovider", "-m", marks]
    run = subprocess.run(command, cwd=root, capture_output=True, text=True)
    if run.returncode not in (0, 5):
        raise SystemExit(f"tests cannot be collected:\n{run.stdout[-2000:]}{run.stderr[-2000:]}")
    found = [line for line in run.stdout.splitlines() if line.startswith("tests/") and "::" in line]
    if not found:
        raise SystemExit(f"no tests are collected for {marks!r}:\n{run.stdout[-2000:]}")
    return found


def executable(text, name="<module>"):
    """Lines of the functions in the text of a module that something is done in, a set."""

    def lines(code):
        found = set()
        if code.co_flags & OPTIMIZED:
            for step in dis.get_instructions(code):
                if step.opname not in NO_LINE and step.positions.lineno is not None:
                    found.add(step.positions.lineno)
            if not code.co_name.startswith("<"):  # decorators and `def` belong to the import
                found.discard(code.co_firstlineno)
        return found.union(*(lines(c) for c in code.co_consts if hasattr(c, "co_code")))

    return lines(compile(text, name, "exec"))


def run_by(tests):
    """Lines that records of tests have run, by module, {module: set}."""
    ran = {}
    for test in tests:
        for module, lines in test["lines"].items():
            ran.setdefault(module, set()).update(lines)
    return ran


def table(tests, fast):
    """Lines of the table of coverage: one a room, for tests among the ids `fast`, and for all."""
    sets = run_by(t for t in tests if t["id"] in fast), run_by(tests)
    counts = {}
    for path in sorted(PACKAGE.rglob("*.py")):
        module = path.relative_to(PACKAGE).as_posix()
        known = executable(path.read_text())
        room = module.split("/")[0] if "/" in module else "(top)"
        row = counts.setdefault(room, [0, 0, 0])
        for k, size in enumerate(
            [len(known), *(len(known & ran.get(module, set())) for ran in sets)]
        ):
            row[k] += size
    counts["all"] = [sum(row[k] for row in counts.values()) for k in range(3)]
    yield f"{'room':<14}{'lines':>8}{'not slow':>12}{'all tests':>12}"
    for room, (lines, *ran) in counts.items():
        if lines:
            yield f"{room:<14}{lines:>8}" + "".join(f"{100 * n / lines:>10.1f} %" for n in ran)


def main(files):
    tests = records(files)
    fast = set(collected("not slow"))
    count = sum(test["id"] in fast for test in tests)
    sys.stdout.write(f"{len(tests)} tests are recorded, {count} of them not slow\n\n")
    for line in table(tests, fast):
        sys.stdout.write(line + "\n")


if __name__ == "__main__":
    if len(sys.argv) < 2:
        raise SystemExit(__doc__)
    main(sys.argv[1:])
