"""Run the tests that a change is likely to affect: `make check`.

Every test imports the whole package, so that imports do not say which tests a module concerns.
Words do: of the names that a changed module defines, or that its texts have, each test file gets
one share for each that it has, the smaller the more files have it. Run are
- test files that have changed, and those that import a bank, an oracle or an extension that has;
- for each module the files with the largest shares, of its own room first, up to `FILES`, and
  the messages of all rooms;
- the rules of the house, and tests that have the name of a page that has changed.
It is no substitute for `make test`: `tests/mutants.py --check` says how many of its faults the
files of a module notice.

Usage: python tests/affected.py [SINCE] [options of pytest]; SINCE is a commit, default HEAD.
"""

import ast
import functools
import re
import subprocess
import sys
from collections import Counter
from pathlib import Path

ROOT = Path(__file__).parent.parent
TESTS = ROOT / "tests"
FILES = 4  # for a module: as many take less than a minute
HOUSE = TESTS / "project" / "test_house.py"
MESSAGES = TESTS / "model" / "test_messages.py"


@functools.cache
def words():
    """The words of each test file, {path: set}."""
    found = sorted(TESTS.rglob("test_*.py"))
    return {path: set(re.findall(r"[^\W\d]\w+", path.read_text("utf-8"))) for path in found}


@functools.cache
def frequency():
    """How many test files have a word."""
    return Counter(word for own in words().values() for word in own)


def names_of(path):
    """Names that a module defines, of its classes and functions with their parts; and its own."""
    found = {path.stem, *path.stem.split("_")}
    for node in ast.walk(ast.parse(path.read_text("utf-8"))):
        if isinstance(node, ast.FunctionDef | ast.ClassDef):
            found.add(node.name)
        elif isinstance(node, ast.AnnAssign | ast.Assign):
            places = node.targets if isinstance(node, ast.Assign) else [node.target]
            found |= {place.id for place in places if isinstance(place, ast.Name)}
    return found


def files_for(module):
    """Return the test files for a module of the package, the most telling first."""
    names = names_of(module)
    room = module.relative_to(ROOT / "jaxcable").parts[0]
    share = {}
    for path, own in words().items():
        share[path] = sum(1 / frequency()[word] for word in names & own)
        if path.parent.name == room:
            share[path] *= 4
        if path.stem == f"test_{module.stem}":
            share[path] += 10
    best = sorted(share, key=lambda path: -share[path])[:FILES]
    return [path for path in best if share[path] > 0]


def affected(changed):
    """Return the test files for changed files, in the order of their names."""
    found = {HOUSE}
    for path in changed:
        inside = path.relative_to(ROOT).parts
        if path in words():
            found.add(path)
        elif path.suffix == ".py" and inside[0] == "jaxcable":
            found.update(files_for(path) if path.exists() else [])
            found.add(MESSAGES)
        elif inside[0] == "tests" and path.suffix == ".py":  # banks, oracles, extensions
            found |= {own for own, known in words().items() if path.stem in known}
        else:
            found |= {own for own in words() if path.name in own.read_text("utf-8")}
    return sorted(found)


def changes(since):
    """Return the files that differ from a commit, and those that git does not know."""
    commands = (
        ["diff", "--name-only", since],
        ["ls-files", "--others", "--exclude-standard"],
    )
    found = []
    for command in commands:
        told = subprocess.check_output(["git", *command], cwd=ROOT, text=True)
        found += [ROOT / line for line in told.splitlines()]
    return found


def main(arguments):
    since, options = "HEAD", arguments
    if arguments and not arguments[0].startswith("-"):
        since, options = arguments[0], arguments[1:]
    files = affected(changes(since))
    print(*(path.relative_to(ROOT) for path in files), sep="\n", flush=True)
    command = [sys.executable, "-m", "pytest", "-n", "2", "--dist", "loadfile", *options]
    return subprocess.run([*command, *files], cwd=ROOT).returncode


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
