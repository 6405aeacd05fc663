"""The map of the rooms in CONTRIBUTING.md, drawn from the imports: `python tests/rooms.py`.

`python tests/rooms.py --lines` writes their code lines as budgets to `budgets.toml`.

Rooms in the order in which data flows: a room imports only from those above it. Of the rooms that
it imports the map names those that it does not also get by way of others.
"""

import ast
import functools
import sys
from pathlib import Path

ROOT = Path(__file__).parent.parent
PACKAGE = ROOT / "jaxcable"
BEGIN, END = "<!-- rooms: python tests/rooms.py -->\n", "<!-- end of rooms -->\n"


@functools.cache
def trees():
    """Syntax trees of the modules of the package, by path."""
    return {path: ast.parse(path.read_text()) for path in sorted(PACKAGE.rglob("*.py"))}


def rooms():
    """Names of the rooms."""
    return sorted(path.parent.name for path in PACKAGE.glob("*/__init__.py"))


def uses(room):
    """Rooms that the modules of a room import."""
    found = set()
    for tree in (tree for path, tree in trees().items() if path.parent.name == room):
        for node in ast.walk(tree):
            if isinstance(node, ast.ImportFrom) and node.level == 2:
                names = [alias.name for alias in node.names]
                found |= {node.module.split(".")[0]} if node.module else set(names)
    return found & set(rooms())


def ordered():
    """Pairs (room, rooms that it uses and no other of them uses), those that use least first."""
    graph = {room: uses(room) for room in rooms()}
    below = {}

    def all_below(room):
        if room not in below:
            below[room] = set().union(graph[room], *(all_below(own) for own in graph[room]))
        return below[room]

    level = {}

    def height(room):
        if room not in level:
            level[room] = 1 + max((height(own) for own in graph[room]), default=0)
        return level[room]

    for room in sorted(graph, key=lambda own: (height(own), own)):
        hidden = set().union(*(all_below(own) for own in graph[room]))
        yield room, sorted(graph[room] - hidden, key=lambda own: (-height(own), own))


def drawn():
    """The table, as it stands in CONTRIBUTING.md."""
    lines = ["| room | what is in it | modules | stands on |", "|---|---|---|---|"]
    for room, below in ordered():
        what = ast.get_docstring(trees()[PACKAGE / room / "__init__.py"]).split("\n")[0].rstrip(".")
        modules = [path.stem for path in sorted((PACKAGE / room).glob("*.py"))]
        modules = ", ".join(f"`{name}`" for name in modules if name != "__init__")
        lines.append(f"| `{room}` | {what} | {modules} | {', '.join(below)} |")
    return "\n".join(lines) + "\n"


def code_lines():
    """Count the lines of code of the rooms: all but docstrings, imports, comments, empty lines."""
    found = dict.fromkeys(["package", *rooms()], 0)
    for path, tree in trees().items():
        left_out = set()
        for node in ast.walk(tree):
            is_text = isinstance(node, ast.Expr) and isinstance(node.value, ast.Constant)
            if is_text or isinstance(node, ast.Import | ast.ImportFrom):
                left_out.update(range(node.lineno, node.end_lineno + 1))
        lines = enumerate(path.read_text().splitlines(), start=1)
        count = sum(k not in left_out and text.strip()[:1] not in ("", "#") for k, text in lines)
        found["package" if path.parent == PACKAGE else path.parent.name] += count
    return found


def parts():
    """Text of CONTRIBUTING.md before the map, the map, and what follows."""
    text = (ROOT / "CONTRIBUTING.md").read_text()
    before, rest = text.split(BEGIN)
    return before, *rest.split(END)


def write_budget():
    """Write the lines of all rooms as their budgets."""
    path = ROOT / "tests" / "budgets.toml"
    before = path.read_text().split('["code lines"]\n')[0]
    rows = "".join(f"{room} = {count}\n" for room, count in code_lines().items())
    path.write_text(f'{before}["code lines"]\n{rows}')


if __name__ == "__main__" and "--lines" in sys.argv:
    write_budget()
elif __name__ == "__main__":
    before, _, after = parts()
    (ROOT / "CONTRIBUTING.md").write_text(before + BEGIN + drawn() + END + after)
    sys.stdout.write(drawn())
