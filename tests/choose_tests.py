"""Which tests does `make test` run, and which only `make test-all`?

Record     as `lines_of_tests.py` says, with `-m "slow or not slow"`; once more by `make test` with
           the list that came of it, because other tests compile then what they share.
Choose     python tests/choose_tests.py FILE ... [--seconds 600]
           Writes `tests/only_in_test_all.txt`: what `make test` leaves out. A test that is not in
           that list and has no mark `slow` is in `make test`: so is a new one. What the list has
           and nothing has recorded stays in it: a record of `make test` alone makes that shorter.
Rule       Tests of at most 0.3 s stay. Of the others those stay that add most per second, until
           the seconds are used up: lines of the package that no chosen test runs; in every module
           that a test runs, a subject that its text names (a gradient, a batch, float32, a
           refusal, ...); a function and a file of tests that has none yet. What texts cite as
           proof of a claim stays in any case.
"""

import ast
import collections
import heapq
import json
import re
import sys
from pathlib import Path

import numpy as np
import pytest

ROOT = Path(__file__).parent.parent
LIST = ROOT / "tests" / "only_in_test_all.txt"
CITED = [ROOT / "README.md", ROOT / "experiments" / "README.md"]
SUBJECTS = (
    *("grad", "hessian", "vmap", "jacfwd", "jacrev", "jacobian", "scan", "float32", "Incremental"),
    *("raises", "warns", "status", "save", "subprocess"),
)
FREE = 0.3  # seconds up to which a test stays
SECOND = 0.15  # worth of running a line once more, over that of the first time
UNKNOWN = pytest.StashKey()
"""Of pytest's configuration: names of the list that no test has; None where a part is collected."""
WORTH = {"file": 3.0, "function": 1.0, "subject": 0.7, "line": 1.0}


def left_out():
    """Return names of tests, and of test functions as a whole, that only `make test-all` runs."""
    if not LIST.exists():
        return set()
    lines = LIST.read_text().splitlines()
    return {line for line in lines if line and not line.startswith("#")}


def is_left_out(name, names):
    """Return whether a test `test_x.py::test_y[z]` is among `names`."""
    return name in names or name.partition("[")[0] in names


def cited():
    """Return names `test_x.py::test_y` of tests that texts cite."""
    texts = "".join(path.read_text() for path in CITED)
    return set(re.findall(r"`tests/([\w/]+\.py::\w+)`", texts))


def texts_of(file):
    """Return the text of every function of a test file."""
    text = (ROOT / "tests" / file).read_text()
    functions = (n for n in ast.walk(ast.parse(text)) if isinstance(n, ast.FunctionDef))
    return {node.name: ast.get_source_segment(text, node) for node in functions}


def shown(record, text):
    """Return what a test shows by its record and its text, as (kind, what) pairs."""
    file, _, function = record["id"].partition("[")[0].partition("::")
    subjects = [word for word in SUBJECTS if re.search(rf"\b\w*{word}", text)]
    yield "file", file
    yield "function", (file, function)
    for module, lines in record.get("lines", {}).items():
        yield from (("line", (module, number)) for number in lines)
        yield from (("subject", (module, word)) for word in subjects)


def recorded(paths):
    """Read files of records.

    The seconds of a test that is there more than once are the largest: it is dearer where no other
    one has compiled its programs.

    Returns:
        By the name of every test its seconds, and the numbers of what it shows; the worth of that.
    """
    numbers, worth, texts, tests = {}, [], {}, {}
    for line in (
        line for path in paths for line in Path(path).read_text(encoding="utf-8").splitlines()
    ):
        record = json.loads(line)
        name = record["id"].removeprefix("tests/")
        file, _, function = name.partition("[")[0].partition("::")
        if file not in texts:
            texts[file] = texts_of(file)
        found = set()
        for one in shown(record, texts[file].get(function, "")):
            if one not in numbers:
                numbers[one] = len(numbers)
                worth.append(WORTH[one[0]])
            found.add(numbers[one])
        waits = record["wall"] > 3 * record["cpu"] + 1  # for a process that it has started
        cost, before = tests.get(name, (0.0, ()))
        cost = max(cost, 0.6 * record["wall"] if waits else record["cpu"])
        tests[name] = cost, np.union1d(np.fromiter(found, int), np.asarray(before, int))
    return tests, np.array(worth)


def chosen(tests, worth, seconds, always):
    """Return the names that stay, see the rule above, and their seconds.

    Args:
        tests, worth: as `recorded` gives them.
        seconds: how many there are.
        always: functions that stay.
    """
    stay, count, again = set(), np.zeros(len(worth), int), np.array([1.0, SECOND, 0.0])

    def keep(name):
        stay.add(name)
        count[tests[name][1]] += 1

    def rate(name):
        cost, shows = tests[name]
        return worth[shows] @ again[np.minimum(count[shows], 2)] / max(cost, 1e-3)

    for name, (cost, _) in tests.items():
        if cost <= FREE:
            keep(name)
    for function in sorted(always):  # the cheapest case of every cited function
        cases = [name for name in tests if name.partition("[")[0] == function]
        if cases and not stay & set(cases):
            keep(min(cases, key=lambda name: tests[name][0]))
    queue = [(-rate(name), name) for name in tests if name not in stay]
    heapq.heapify(queue)
    spent = sum(tests[name][0] for name in stay)
    while queue:
        _, name = heapq.heappop(queue)
        now = rate(name)
        if queue and now < -queue[0][0]:  # has lost worth since: later
            heapq.heappush(queue, (-now, name))
        elif now > 0 and spent + tests[name][0] <= seconds:
            keep(name)
            spent += tests[name][0]
    return stay, spent


def write(tests, stay):
    """Write the list: functions by name where none of their cases stays, else the cases."""
    before = left_out()
    functions = collections.defaultdict(list)
    for name in tests:
        functions[name.partition("[")[0]].append(name)
    lines = before - set(tests) - set(functions)
    for function, names in functions.items():
        out = set(names) - stay
        if len(out) == len(names):
            lines = {line for line in lines if line.partition("[")[0] != function} | {function}
        else:
            lines |= out
    LIST.write_text("# written by tests/choose_tests.py\n" + "\n".join(sorted(lines)) + "\n")
    return len(lines)


def main(arguments):
    seconds = 600.0
    if "--seconds" in arguments:
        at = arguments.index("--seconds")
        seconds = float(arguments[at + 1])
        arguments = arguments[:at] + arguments[at + 2 :]
    tests, worth = recorded(arguments)
    stay, spent = chosen(tests, worth, seconds, cited())
    lines = write(tests, stay)
    everything = sum(cost for cost, _ in tests.values())
    print(f"{len(tests)} tests, {everything:.0f} s; {len(stay)} in `make test`, {spent:.0f} s")
    print(f"{lines} lines in {LIST.relative_to(ROOT)}")


if __name__ == "__main__":
    main(sys.argv[1:])
