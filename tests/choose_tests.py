"""Which tests does `make test` run, and which only `make test-all`?

Record     as `lines_of_tests.py` says, with `-m "slow or not slow"`; once more by `make test` with
           the list that came of it, because other tests compile then what they share.
Choose     python tests/choose_tests.py FILE ... [--seconds 600]
           Writes `tests/only_in_test_all.txt`: what `make test` leaves out. A test that is not in
           that list and has no mark `slow` is in `make test`: so is a new one.
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

ROOT = Path(__file__).parent.parent
LIST = ROOT / "tests" / "only_in_test_all.txt"
CITED = [ROOT / "README.md", ROOT / "experiments" / "README.md"]
SUBJECTS = (
    *("grad", "hessian", "vmap", "jacfwd", "jacrev", "jacobian", "scan", "float32", "Incremental"),
    *("raises", "warns", "status", "save", "subprocess"),
)
FREE = 0.3  # seconds up to which a test stays
SECOND = 0.15  # worth of running a line once more, over that of the first time
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
    return set(re.findall(r"`tests/(\w+\.py::\w+)`", texts))


def texts_of(file):
    """Return the text of every function of a test file."""
    text = (ROOT / "tests" / file).read_text()
    functions = (n for n in ast.walk(ast.parse(text)) if isinstance(n, ast.FunctionDef))
    return {node.name: ast.get_source_segment(text, node) for node in functions}


def recorded(paths):
    """Return seconds and what it shows, a set of pairs, of every test in files of records.

    The seconds of a test that is there more than once are the largest: it is dearer where no other
    one has compiled its programs.
    """
    tests, known = {}, {}
    for line in (line for path in paths for line in Path(path).read_text().splitlines()):
        record = json.loads(line)
        name = record["id"].removeprefix("tests/")
        file, _, function = name.partition("[")[0].partition("::")
        known.setdefault(file, texts_of(file))
        text = known[file].get(function, "")
        subjects = [word for word in SUBJECTS if re.search(rf"\b\w*{word}", text)]
        shows = {("file", file), ("function", (file, function))}
        for module, lines in record.get("lines", {}).items():
            shows |= {("line", (module, number)) for number in lines}
            shows |= {("subject", (module, word)) for word in subjects}
        waits = record["wall"] > 3 * record["cpu"] + 1  # for a process that it has started
        cost, before = tests.get(name, (0.0, set()))
        tests[name] = max(cost, 0.6 * record["wall"] if waits else record["cpu"]), shows | before
    return tests


def chosen(tests, seconds, always):
    """Return the names that stay, see the rule above; `always` are functions that stay."""
    stay, count = set(), collections.Counter()

    def keep(name):
        stay.add(name)
        count.update(tests[name][1])

    def worth(name):
        cost, shows = tests[name]
        new = (WORTH[one[0]] * (1, SECOND, 0)[min(count[one], 2)] for one in shows)
        return sum(new) / max(cost, 1e-3)

    for name, (cost, _) in tests.items():
        if cost <= FREE:
            keep(name)
    for function in always:  # the cheapest of every cited function
        cases = [name for name in tests if name.partition("[")[0] == function]
        if cases and not stay & set(cases):
            keep(min(cases, key=lambda name: tests[name][0]))
    queue = [(-worth(name), name) for name in tests if name not in stay]
    heapq.heapify(queue)
    spent = sum(tests[name][0] for name in stay)
    while queue:
        _, name = heapq.heappop(queue)
        now = worth(name)
        if queue and now < -queue[0][0]:  # has lost worth since: later
            heapq.heappush(queue, (-now, name))
        elif now > 0 and spent + tests[name][0] <= seconds:
            keep(name)
            spent += tests[name][0]
    return stay, spent


def write(tests, stay):
    """Write the list: functions by name where none of their cases stays, else the cases."""
    functions = collections.defaultdict(list)
    for name in tests:
        functions[name.partition("[")[0]].append(name)
    lines = []
    for function, names in sorted(functions.items()):
        out = sorted(set(names) - stay)
        lines += [function] if len(out) == len(names) else out
    LIST.write_text("# written by tests/choose_tests.py\n" + "\n".join(lines) + "\n")
    return len(lines)


def main(arguments):
    seconds = 600.0
    if "--seconds" in arguments:
        at = arguments.index("--seconds")
        seconds = float(arguments[at + 1])
        arguments = arguments[:at] + arguments[at + 2 :]
    tests = recorded(arguments)
    stay, spent = chosen(tests, seconds, cited())
    lines = write(tests, stay)
    everything = sum(cost for cost, _ in tests.values())
    print(f"{len(tests)} tests, {everything:.0f} s; {len(stay)} in `make test`, {spent:.0f} s")
    print(f"{lines} lines in {LIST.relative_to(ROOT)}")


if __name__ == "__main__":
    main(sys.argv[1:])
