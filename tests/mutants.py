"""Do the tests notice a fault in the package?

Question   62 slips (`tests/mutants_table.py`), two in every room and more where the physics is, are
           put into a copy of the package one at a time: which test fails, and which slips does none
           notice?
Reference  The unchanged package: a test that fails on that, too, catches nothing.
Reading    caught: the first test that fails, and the seconds until then. SURVIVED: no test that was
           run fails, so that one is missing. undecided: the limit of time was reached first; a slip
           that makes a program hang is undecided, too.
           With --lines a fault meets only tests that run its line, the cheapest first, as
           `tests/lines_of_tests.py` has recorded them. A function that JAX has traced for an
           earlier test is not run again for a later one, so that some tests are missed: look at a
           survivor again with --only and without --lines. For lines that only importing runs (a
           table, a default) those of their function stand, then the module, with at most 150
           tests.
           With --check it meets the test files that `make check` runs for its module.
Command    python tests/mutants.py [--lines FILE ... | --check] [--only N ...]
           [--marks EXPRESSION] [--limit SECONDS] [--save]
           --marks "not slow" is the default; "" runs the slow tests, too, where no other one fails.
           --save writes experiments/results/mutants.txt, if all faults are run. Compiled programs
           are kept between faults where JAX_COMPILATION_CACHE_DIR names a folder.
"""

import argparse
import ast
import os
import shutil
import signal
import subprocess
import sys
import tempfile
import time
from collections import Counter
from pathlib import Path
from typing import NamedTuple

import affected
from lines_of_tests import ROOT, collected, executable, records
from mutants_table import FAULTS

FIRST = 40  # tests of a first call of pytest, which often suffices
MOST = 150  # tests where it is only known that they run the function, or the module
FAILED = "MUTANTS_FAILED"  # variable of the environment: file for the ids of tests that fail
OWN = "tests/project/test_mutants.py"  # tests of the table, which every fault would break


# --- a plugin of pytest, for runs of this script


def pytest_runtest_logreport(report):
    _note_failed(report)


def pytest_collectreport(report):
    _note_failed(report)


def _note_failed(report):
    if report.failed and FAILED in os.environ:
        with open(os.environ[FAILED], "a", encoding="utf-8") as stream:
            stream.write(report.nodeid + "\n")


# --- copies of the repository


def copied(folder):
    """Copy the files of the repository, without what git ignores."""
    command = ["git", "ls-files", "-z", "--cached", "--others", "--exclude-standard"]
    names = subprocess.run(command, cwd=ROOT, capture_output=True, text=True, check=True).stdout
    for name in filter(None, names.split("\0")):
        if (ROOT / name).is_file():
            (folder / name).parent.mkdir(parents=True, exist_ok=True)
            shutil.copyfile(ROOT / name, folder / name)


class Run(NamedTuple):
    """How a run of pytest has ended.

    Attributes:
        failed: id of the first test that failed, or None.
        late: whether the time was over first.
    """

    failed: str | None
    late: bool


def tested(folder, limit, tests, marks):
    """Run tests of a copy, given as ids and options of pytest, up to the first that fails."""
    noted = folder.parent / "failed.txt"
    noted.unlink(missing_ok=True)
    paths = [str(folder), str(folder / "tests")]
    changes = {"PYTHONPATH": os.pathsep.join(paths), "PYTHONDONTWRITEBYTECODE": "1"}
    command = [sys.executable, "-m", "pytest", "-x", "-q", "-n", "0", "-p", "no:cacheprovider"]
    command += ["-p", "mutants", "-m", marks, f"--ignore={OWN}", *tests]
    with open(folder.parent / "pytest.txt", "w", encoding="utf-8") as stream:
        run = subprocess.Popen(
            command,
            cwd=folder,
            env=os.environ | changes | {FAILED: str(noted)},
            stdout=stream,
            stderr=subprocess.STDOUT,
            start_new_session=True,
        )
        try:
            code = run.wait(max(limit, 1.0))
        except subprocess.TimeoutExpired:
            os.killpg(run.pid, signal.SIGKILL)
            run.wait()
            return Run(None, True)
        except BaseException:
            os.killpg(run.pid, signal.SIGKILL)
            raise
    if noted.exists():
        return Run(noted.read_text().splitlines()[0], False)
    if code in (0, 5):  # 5: none of the tests has the marks
        return Run(None, False)
    told = Path(stream.name).read_text(encoding="utf-8")[-2000:]
    return Run(f"pytest ended with {code}: {told.splitlines()[-1] if told else ''}", False)


class Unchanged:
    """The copy without a fault: says of a test whether it passes there."""

    def __init__(self, folder, limit):
        self.folder, self.limit, self.known = folder / "unchanged" / "copy", limit, {}
        copied(self.folder)

    def fails(self, test):
        """Whether a test fails without a fault, too; what is no id of a test does not."""
        if "::" not in test:
            return False
        if test not in self.known:
            run = tested(self.folder, self.limit, [test], "slow or not slow")
            self.known[test] = run.failed is not None
            if self.known[test]:
                sys.stdout.write(f"   (fails without a fault: {test})\n")
        return self.known[test]


# --- which tests


def place(fault):
    """Lines of a fault: (those of its text, of its statement, of its function), three sets."""
    text = (ROOT / "jaxcable" / fault.file).read_text()
    start = text.index(fault.old)
    lead = len(fault.old) - len(fault.old.lstrip())
    first = text.count("\n", 0, start + lead) + 1
    last = first + fault.old.strip().count("\n")
    known = executable(text)
    statement, function = (first, last), None
    for node in ast.walk(ast.parse(text)):  # outer nodes come before those in them
        if not isinstance(node, ast.stmt) or not node.lineno <= first <= last <= node.end_lineno:
            continue
        body = getattr(node, "body", None)
        end = body[0].lineno - 1 if body else node.end_lineno
        if last <= end:
            statement = node.lineno, end
        if isinstance(node, ast.FunctionDef):
            function = node.lineno, node.end_lineno
    of = [range(a, b + 1) for a, b in ((first, last), statement, function or (1, 0))]
    return [known.intersection(lines) for lines in of]


def chosen(fault, tests, among):
    """Ids of tests for a fault, the cheapest first, and in words how they are known.

    Args:
        fault: `Fault`.
        tests: records of `lines_of_tests`.
        among: ids that may be run.
    """
    among, cost, ran = set(among), Counter(), {}
    for test in tests:
        if test["id"] in among and fault.file in test["lines"]:
            cost[test["id"]] += test["cpu"]
            ran.setdefault(test["id"], set()).update(test["lines"][fault.file])
    order = sorted(cost, key=lambda test: cost[test])
    exact, statement, function = place(fault)
    kinds = [(exact, None, "run its line"), (statement, None, "run its statement")]
    if not exact:  # only importing runs it
        module = set().union(*ran.values())
        kinds += [(function, MOST, "run its function"), (module, MOST, "run its module")]
    for lines, most, told in kinds:
        found = [test for test in order if not lines.isdisjoint(ran[test])][:most]
        if found:
            return found, told
    return [], kinds[0][2]


def calls(fault, tests, among, check=False):
    """Lists of arguments of pytest for a fault, one a call, and what they are, in words."""
    if check:
        files = affected.affected([ROOT / "jaxcable" / fault.file])
        return [[str(path.relative_to(ROOT)) for path in files]], "files of `make check`"
    if tests is None:
        return [[]], "all tests"
    found, told = chosen(fault, tests, among)
    return [part for part in (found[:FIRST], found[FIRST:]) if part], f"{len(found)} {told}"


# --- one fault after the other


def judged(fault, folder, stages, limit, unchanged):
    """Whether a fault is caught: (verdict, by which test or how it was looked for)."""
    text = (folder / "jaxcable" / fault.file).read_text()
    assert text.count(fault.old) == 1, fault
    (folder / "jaxcable" / fault.file).write_text(text.replace(fault.old, fault.new))
    told, end = [], time.perf_counter() + limit
    for marks, parts, words in stages:
        told.append(f"{marks}: {words}")
        for arguments in parts:
            left_out = []
            while True:
                rest = end - time.perf_counter()
                run = tested(folder, rest, [*arguments, *left_out], marks)
                if run.late:
                    return "undecided", f"{limit:.0f} s were too short"
                if run.failed is None:
                    break
                if not unchanged.fails(run.failed):
                    return "caught", run.failed
                left_out.append(f"--deselect={run.failed}")
    return "SURVIVED", "; ".join(told)


def main(options):
    sys.path.insert(0, str(ROOT / "experiments"))
    from record import Record, commit

    lines = []

    def tell(line=""):
        print(line, flush=True)
        lines.append(line)

    numbers = list(range(1, len(FAULTS) + 1)) if options.only is None else options.only
    marks = ["not slow", "slow"] if options.marks == "" else [options.marks]
    tests = None if options.lines is None else records(options.lines)
    among = {own: [] if tests is None else collected(own) for own in marks}
    counts, by_room, begun = Counter(), {}, time.perf_counter()
    tell(f"commit {commit()}; tests: {', '.join(marks)}; by lines: {tests is not None}\n")
    with tempfile.TemporaryDirectory(prefix="mutants-") as scratch:
        unchanged = Unchanged(Path(scratch), options.limit)
        for number in numbers:
            fault, start = FAULTS[number - 1], time.perf_counter()
            stages = [(own, *calls(fault, tests, among[own], options.check)) for own in marks]
            with tempfile.TemporaryDirectory(dir=scratch) as own:
                folder = Path(own) / "copy"
                copied(folder)
                verdict, told = judged(fault, folder, stages, options.limit, unchanged)
            seconds = time.perf_counter() - start
            tell(f"{number:>3} {fault.file}: {fault.what}")
            tell(f"    {verdict:<10}{seconds:>6.0f} s   {told}")
            counts[verdict] += 1
            by_room.setdefault(fault.room, Counter())[verdict] += 1
    tell(f"\n{'room':<14}{'caught':>8}{'of':>5}")
    for room, own in by_room.items():
        tell(f"{room:<14}{own['caught']:>8}{own.total():>5}")
    tell(f"{'all':<14}{counts['caught']:>8}{counts.total():>5}")
    if counts["undecided"]:
        tell(f"undecided: {counts['undecided']}")
    tell(f"{time.perf_counter() - begun:.0f} s")
    if options.save and numbers == list(range(1, len(FAULTS) + 1)):
        record = Record("mutants")
        record.lines += lines
        record.close()


def arguments():
    """Options of the command line."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--lines", nargs="+", metavar="FILE")
    parser.add_argument("--check", action="store_true")
    parser.add_argument("--only", nargs="+", type=int, metavar="N", help="numbers from 1")
    parser.add_argument("--marks", default="not slow", metavar="EXPRESSION")
    parser.add_argument("--limit", type=float, default=1800.0, metavar="SECONDS", help="of a fault")
    parser.add_argument("--save", action="store_true")
    options = parser.parse_args()
    if options.only and not set(options.only) <= set(range(1, len(FAULTS) + 1)):
        parser.error(f"--only: expected numbers from 1 to {len(FAULTS)}")
    if options.save and options.only:
        parser.error("--save: only with all faults")
    return options


if __name__ == "__main__":
    main(arguments())
