"""The map of the rooms in CONTRIBUTING.md, drawn from the imports: `python tests/rooms.py`.

`python tests/rooms.py --lines` writes their code lines as budgets to `budgets.toml`.

Rooms in the order in which data flows: a room imports only from those above it. Of the rooms that
it imports the map names those that it does not also get by way of others. The wings are no folders,
because rooms are public modules (`jaxcable.design`).
"""

import ast
import functools
import sys
from pathlib import Path

ROOT = Path(__file__).parent.parent
PACKAGE = ROOT / "jaxcable"
WINGS = {
    "without structures": ["common", "programs", "linear", "numerics"],
    "physics": ["materials", "sections", "spaces", "elements", "model", "loads", "mechanics"],
    "solving": ["equilibrium", "analysis", "paths"],
    "states": ["stiffness", "results", "dynamics"],
    "forms": ["forms"],
    "scenes": ["scenes"],
    "design": ["standards", "design", "studies", "reliability"],
    "files": ["files", "catalogue"],
    "output": ["plots", "reporting"],
    "applications": ["lines", "masts", "cli"],
}
ORDER = [room for wing in WINGS.values() for room in wing]
BEGIN, END = "<!-- rooms: python tests/rooms.py -->\n", "<!-- end of rooms -->\n"


@functools.cache
def trees():
    """Syntax trees of the modules of the package, by path."""
    return {path: ast.parse(path.read_text()) for path in sorted(PACKAGE.rglob("*.py"))}


def rooms():
    """Names of the rooms."""
    return sorted(path.parent.name for path in PACKAGE.glob("*/__init__.py"))


@functools.cache
def uses(room):
    """Rooms that the modules of a room import."""
    found = set()
    for tree in (tree for path, tree in trees().items() if path.parent.name == room):
        for node in ast.walk(tree):
            if isinstance(node, ast.ImportFrom) and node.level == 2:
                names = [alias.name for alias in node.names]
                found |= {node.module.split(".")[0]} if node.module else set(names)
    return found & set(rooms())


def stands_on(room):
    """Rooms that a room uses and that no other of these uses."""

    @functools.cache
    def all_below(room):
        return uses(room).union(*map(all_below, uses(room)))

    return sorted(uses(room).difference(*map(all_below, uses(room))), key=ORDER.index)


def drawn():
    """The table, as it stands in CONTRIBUTING.md."""
    lines = ["| wing | room | what is in it | modules | stands on |", "|---|---|---|---|---|"]
    for wing, room in ((wing, room) for wing, those in WINGS.items() for room in those):
        what = ast.get_docstring(trees()[PACKAGE / room / "__init__.py"]).split("\n")[0].rstrip(".")
        modules = [path.stem for path in sorted((PACKAGE / room).glob("*.py"))]
        modules = ", ".join(f"`{name}`" for name in modules if name != "__init__")
        label = f"**{wing}**" if room == WINGS[wing][0] else ""
        below = ", ".join(stands_on(room))
        lines.append(f"| {label} | `{room}` | {what} | {modules} | {below} |")
    return "\n".join(lines) + "\n"


def statements(tree):
    """Yield all statements of a module, and those within them."""
    for name in ("body", "orelse", "finalbody", "handlers", "cases"):
        for node in getattr(tree, name, ()):
            yield node
            yield from statements(node)


@functools.cache
def code_lines():
    """Count the lines of code of the rooms: all but docstrings, imports, comments, empty lines."""
    found = dict.fromkeys(["package", *rooms()], 0)
    for path, tree in trees().items():
        left_out = set()
        for node in statements(tree):
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
