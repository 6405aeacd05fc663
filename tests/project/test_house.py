"""The rules of the house: imports go downward, modules are short, public names are documented."""

import ast
import functools
import graphlib
import inspect
import re
from pathlib import Path

import pytest
import rooms

import jaxcable as jc

ROOT = Path(__file__).parents[2]
PACKAGE = ROOT / "jaxcable"

LEVEL = {name: k for k, name in enumerate([*rooms.ORDER, "extend", "__init__", "__main__"])}
TEXTS = {path: path.read_text() for path in sorted(PACKAGE.rglob("*.py"))}


def nodes(kind):
    """Pairs (path, node) of all nodes of a kind in the modules of the package."""
    for path, tree in rooms.trees().items():
        yield from ((path, node) for node in ast.walk(tree) if isinstance(node, kind))


def named(node):
    """The last name of ``a.b.c``, or None."""
    return getattr(node, "attr", getattr(node, "id", None))


def room(path):
    """The top-level module or folder that a file belongs to."""
    return path.relative_to(PACKAGE).parts[0].removesuffix(".py")


def imported(path, tree):
    """What a file imports of this package, anywhere in it: modules, or rooms, as tuples."""
    here = path.relative_to(PACKAGE).parts[:-1]
    for node in ast.walk(tree):
        if isinstance(node, ast.ImportFrom) and node.level:
            base = here[: len(here) + 1 - node.level]
            base += tuple(node.module.split(".")) if node.module else ()
            for alias in node.names:
                whole = (*base, alias.name)
                yield whole if whole in KNOWN else base
        elif isinstance(node, ast.ImportFrom) and node.module.split(".")[0] == "jaxcable":
            yield tuple(node.module.split(".")[1:]) or ("__init__",)
        elif isinstance(node, ast.Import):
            yield from (("__init__",) for a in node.names if a.name.split(".")[0] == "jaxcable")


def dotted(path):
    """Name of a module within the package, a tuple."""
    parts = path.relative_to(PACKAGE).with_suffix("").parts
    return parts[:-1] if parts[-1] == "__init__" else parts


KNOWN = {dotted(path) for path in TEXTS}


@functools.cache
def graph():
    """What each file imports of other modules, by path."""
    trees = rooms.trees()
    return {path: set(imported(path, tree)) - {dotted(path)} for path, tree in trees.items()}


def test_imports_go_downward():
    upward = [
        (str(path.relative_to(PACKAGE)), other)
        for path, others in graph().items()
        for other in ((other or ("__init__",))[0] for other in others)
        if other != room(path) != "__main__" and LEVEL[other] >= LEVEL[room(path)]
    ]
    assert upward == [] and sum(map(len, graph().values())) > 1000


def test_no_text_has_marks_of_a_merge():
    """What is left of a conflict is no line of a file."""
    marks = re.compile(r"^(<{7} |>{7} )", re.M)
    texts = [path for kind in ("md", "py", "toml", "yml") for path in ROOT.glob(f"*/**/*.{kind}")]
    texts = [path for path in [*ROOT.glob("*.*"), *texts] if path.suffix in (".md", ".py", ".toml")]
    texts = [path for path in texts if not {"build", ".venv"} & set(path.parts)]
    assert [str(p) for p in texts if marks.search(p.read_text("utf-8"))] == [] and len(texts) > 400
    assert marks.search("one\n<<<<<<< HEAD\n")


def test_no_module_imports_itself_by_way_of_others():
    """One way inside of rooms, too: the modules can be put in an order."""
    modules = {dotted(path): others for path, others in graph().items()}
    order = list(graphlib.TopologicalSorter(modules).static_order())  # raises CycleError
    assert len(order) == len(TEXTS) and max(map(len, modules.values())) > 10


def test_map_of_the_rooms_is_that_of_the_imports():
    """`python tests/rooms.py` writes it."""
    assert rooms.parts()[1] == rooms.drawn()
    assert set(rooms.rooms()) == LEVEL.keys() - {"__init__", "__main__", "extend"}


def test_modules_and_functions_are_short_and_documented():
    """Functions under 80 lines without their docstring: longer ones do several things."""
    wrong = [str(path) for path, text in TEXTS.items() if len(text.splitlines()) > 400]
    for path, node in nodes(ast.FunctionDef):
        told = node.body[0].end_lineno if ast.get_docstring(node) else node.body[0].lineno - 1
        if node.end_lineno - told >= 80:
            wrong.append(f"{path}: {node.name} is long")
    for path, tree in rooms.trees().items():
        defined = [n for n in tree.body if isinstance(n, ast.FunctionDef | ast.ClassDef)]
        public = [node for node in defined if not node.name.startswith("_")]
        wrong += [f"{path}: docstring" for node in (tree, *public) if not ast.get_docstring(node)]
    assert wrong == []


@pytest.mark.parametrize("name", sorted({path.parent.name for path in TEXTS}))
def test_what_a_room_shows_is_in_its_list(name):
    """`__all__` has all that a room's `__init__` defines or, if it defines nothing, imports."""
    (tree,) = (
        tree
        for path, tree in rooms.trees().items()
        if path.name == "__init__.py" and path.parent.name == name
    )
    later = [inner for node in tree.body if isinstance(node, ast.If) for inner in node.body]
    shown = [
        alias.asname or alias.name
        for node in (*tree.body, *later)  # what is slow to import is shown to type checkers
        if isinstance(node, ast.ImportFrom)
        for alias in node.names
    ]
    lists = [
        n.value for n in tree.body if isinstance(n, ast.Assign) and named(n.targets[0]) == "__all__"
    ]
    if not shown and not lists:
        return
    (names,) = (ast.literal_eval(own) for own in lists)
    own = {node.name for node in tree.body if isinstance(node, ast.FunctionDef | ast.ClassDef)}
    assert names and set(names) <= own | set(shown)
    assert {name for name in own if not name.startswith("_")} <= set(names)
    if not own:  # nothing is done here, only shown
        assert {name for name in shown if not name.startswith("_")} == set(names)


def public():
    """Pairs of (name, function) that rooms show."""

    def walk(module, name):
        for key in module.__all__:
            own = getattr(module, key)
            if inspect.ismodule(own) and hasattr(own, "__all__"):
                yield from walk(own, f"{name}.{key}")
            elif inspect.isfunction(own):
                yield f"{name}.{key}", own

    return dict(walk(jc, "jc"))


def test_options_are_named():
    """Main arguments first, then options by name: at most two with a default may go without.

    Three numbers of a material, and what a node is held along, about and in, are main arguments.
    """
    found, lax = public(), {"jc.force_density", "jc.find_form"}  # a second one may be missing
    assert len(found) > 100
    for name, function in found.items():
        given = inspect.signature(function).parameters.values()
        by_place = [p for p in given if p.kind is p.POSITIONAL_OR_KEYWORD]
        count = sum(p.default is not p.empty for p in by_place)
        most = 3 if name.startswith(("jc.materials", "jc.restrained")) else 2
        assert count <= most + (name in lax), name


# --- contracts are code

_OBJECTS = {"group", "g", "one", "load", "law", "own_law", "section"}


def test_nobody_asks_groups_loads_and_laws_for_names():
    found = [
        f"{path}: {ast.unparse(node)}"
        for path, node in nodes(ast.Call)
        if named(node.func) in ("hasattr", "getattr")
        and isinstance(node.args[1], ast.Constant)
        and named(node.args[0]) in _OBJECTS
    ]
    assert found == []


def test_only_spaces_know_how_many_numbers_a_motion_has():
    """Nobody compares `n_freedom`, or columns of a motion, a load, a step: spaces and elements
    say what they do with them."""
    widths = ("motion.shape", "begin.shape", "before.shape", "load.shape")
    for path, node in nodes(ast.Compare):
        asked = ast.unparse(node.left)
        assert not asked.endswith(("n_freedom", "n_motion")), f"{path}: {asked}"
        assert not any(width in asked for width in widths), f"{path}: {asked}"


def kinds():
    """All classes of elements, loads, laws and solvers, bases and those beside them."""
    from jaxcable.elements.element import Element
    from jaxcable.linear.solver import Solver
    from jaxcable.loads.load import Load
    from jaxcable.materials.law import Law

    found, ahead = set(), [Element, Load, Law, Solver]
    while ahead:
        cls = ahead.pop()
        found.add(cls)
        ahead += cls.__subclasses__()
    return {cls for cls in found if cls.__module__.startswith("jaxcable.")}  # not those of tests


def test_no_method_is_deleted_by_a_subclass():
    checked = 0
    for cls in kinds():
        for base in cls.__mro__[1:]:
            for name, value in vars(base).items():
                if callable(value) and name in vars(cls):
                    checked += 1
                    assert vars(cls)[name] is not None, f"{cls.__name__}.{name}"
    assert checked > 50


def test_what_is_asked_of_a_group_is_in_the_contract():
    """Attributes of what is called ``group``, outside of elements and what makes scenes of them."""
    from jaxcable.elements import abilities, element

    known = set()
    for cls in (*vars(element).values(), *vars(abilities).values()):
        if isinstance(cls, type) and cls.__module__ in (element.__name__, abilities.__name__):
            known |= set(dir(cls)) | set(cls.__annotations__)
    known |= {"links", "_index_fields", "_static_fields"}  # of every pytree of the package
    asked = {
        node.attr
        for path, node in nodes(ast.Attribute)
        if named(node.value) == "group"
        and path.name != "opensees.py"  # takes straight elements only, and all of them apart
        and room(path) not in ("elements", "scenes", "forms", "design", "cli")
    }
    assert len(asked) > 20
    assert asked <= known, asked - known


FOREIGN = {"CACHEDIR", "TAG", "OtherClass", "custom_derivatives", "linear_call", "ffi", "tree_util"}
FOREIGN |= {"include_dir", "register_dataclass", "mnum", "pythonpath", "pyproject", "txt", "toml"}
FOREIGN |= {"CHANGELOG", "opensees_script", "dist", "pypi", "py", "distributed", "Client"}
FOREIGN |= {"xarray", "Dataset", "schema_parts"}
"""Names in backticks that are of other programs, or of files."""


TOKENS = re.compile(r'"""[\s\S]*?"""|"(?:\\.|[^"\\\n])*"|\'(?:\\.|[^\'\\\n])*\'|#.*|\b[^\W\d]\w*')
"""Strings, comments and names of Python; `tokenize` finds the same, and takes ten times as long."""


def words_of(text):
    """Names and words in the code of a module, and in those of its strings that are one word."""
    for token in TOKENS.findall(text):
        word = token.strip("\"'")
        if word.isidentifier():
            yield word


def unknown_names(text, known):
    """Names in single backticks that do not exist, ``a.b`` name by name."""
    for name in re.findall(r"(?<!`)`([A-Za-z_][\w.]*)(?:\(\))?`(?!`)", text):
        if not set(name.removesuffix(".py").removesuffix(".md").split(".")) <= known:
            yield name


def test_names_in_backticks_exist():
    """A docstring, comment or page names nothing that has another name by now."""
    python = [*TEXTS, *sorted((ROOT / "tests").rglob("*.py"))]
    pages = [ROOT / name for name in ("README.md", "CONTRIBUTING.md", "experiments/README.md")]
    known = FOREIGN | {word for path in python for word in words_of(path.read_text())}
    known |= {part.removesuffix(".py") for path in python + pages for part in path.parts}
    known |= {
        path.stem
        for folder in ("experiments", "notebooks")
        for path in (ROOT / folder).rglob("*.*")
    }
    texts = TEXTS | {path: path.read_text() for path in pages}
    assert {
        p.name: found for p, text in texts.items() if (found := [*unknown_names(text, known)])
    } == {}
    assert [*unknown_names("see `System.no_such_name`, `System`", known)] == ["System.no_such_name"]


def members_by_class():
    """Names of methods, fields and attributes of every class, with those of its bases."""
    own, bases = {}, {}
    for _, node in nodes(ast.ClassDef):
        names = own.setdefault(node.name, set())
        bases.setdefault(node.name, []).extend(map(named, node.bases))
        for part in ast.walk(node):
            if isinstance(part, ast.FunctionDef):
                names.add(part.name)
            elif isinstance(part, ast.AnnAssign):
                names.add(named(part.target))
            elif isinstance(part, ast.Assign):
                names.update(map(named, part.targets))

    def collect(name, seen=()):
        further = [base for base in bases.get(name, ()) if base in own and base not in seen]
        return own[name].union(*(collect(base, (*seen, name)) for base in further))

    return {name: collect(name) for name in own}


def test_members_in_backticks_exist():
    """`Class.member` in a docstring, comment or page is a member of the class."""
    members = members_by_class()
    pages = {p: p.read_text() for p in (ROOT / "README.md", ROOT / "CONTRIBUTING.md")}
    missing = {
        f"{path.name}: {owner}.{name}"
        for path, text in (TEXTS | pages).items()
        for owner, name in re.findall(r"`(\w+)\.(\w+)`", text)
        if owner in members and name not in members[owner]
    }
    assert missing == set()
    assert "tangent" in members["System"] and "never" not in members["System"]
