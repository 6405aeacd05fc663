"""The rules of the house: imports go downward, modules are short, public names are documented."""

import ast
import graphlib
import inspect
from pathlib import Path

import pytest
import rooms

import jaxcable as jc

ROOT = Path(__file__).parents[2]
PACKAGE = ROOT / "jaxcable"

FLOORS = [
    ["common"],
    ["linear"],
    ["numerics"],
    ["materials"],
    ["sections"],
    ["elements"],
    ["spaces"],
    ["model"],
    ["loads"],
    ["mechanics"],
    ["equilibrium"],
    ["analysis"],
    ["stiffness"],
    ["results"],
    ["paths"],
    ["forms"],
    ["design"],
    ["scenes"],
    ["plots", "files"],
    ["reporting"],
    ["cli"],
    ["__init__", "__main__"],
]
LEVEL = {name: k for k, floor in enumerate(FLOORS) for name in floor}
MODULES = sorted(PACKAGE.rglob("*.py"))


def room(path):
    """The top-level module or folder that a file belongs to."""
    return path.relative_to(PACKAGE).parts[0].removesuffix(".py")


def imports(path):
    """Rooms of this package that a file imports, anywhere in it."""
    depth = len(path.relative_to(PACKAGE).parts)
    for node in ast.walk(ast.parse(path.read_text())):
        if isinstance(node, ast.ImportFrom):
            module = node.module or ""
            if node.level:
                if node.level < depth:  # within its own folder
                    continue
                yield from [module.split(".")[0]] if module else [a.name for a in node.names]
            elif module.split(".")[0] == "jaxcable":
                yield module.split(".")[1] if "." in module else "__init__"
        elif isinstance(node, ast.Import):
            yield from ["__init__" for a in node.names if a.name.split(".")[0] == "jaxcable"]


@pytest.mark.parametrize("path", MODULES, ids=lambda p: str(p.relative_to(PACKAGE)))
def test_imports_go_downward(path):
    for other in imports(path):
        if room(path) == "__main__":
            continue
        assert LEVEL[other] < LEVEL[room(path)], f"{room(path)} imports {other}"


def dotted(path):
    """Name of a module within the package, a tuple."""
    parts = path.relative_to(PACKAGE).with_suffix("").parts
    return parts[:-1] if parts[-1] == "__init__" else parts


def imported(path):
    """Modules of this package that a file imports, anywhere in it, as tuples."""
    known = {dotted(own) for own in MODULES}
    here = path.relative_to(PACKAGE).parts[:-1]
    for node in ast.walk(ast.parse(path.read_text())):
        if isinstance(node, ast.ImportFrom) and node.level:
            base = here[: len(here) + 1 - node.level]
            base += tuple(node.module.split(".")) if node.module else ()
            for alias in node.names:
                whole = (*base, alias.name)
                yield whole if whole in known else base


def test_no_module_imports_itself_by_way_of_others():
    """One way inside of rooms, too: the modules can be put in an order."""
    graph = {dotted(path): set(imported(path)) - {dotted(path)} for path in MODULES}
    order = list(graphlib.TopologicalSorter(graph).static_order())  # raises CycleError
    assert len(order) == len(MODULES) and max(map(len, graph.values())) > 10


def test_map_of_the_rooms_is_that_of_the_imports():
    """`python tests/rooms.py` writes it."""
    assert rooms.parts()[1] == rooms.drawn()
    floors = [room for floor in FLOORS for room in floor]
    assert set(rooms.rooms()) == set(floors) - {"__init__", "__main__"}


@pytest.mark.parametrize("path", MODULES, ids=lambda p: str(p.relative_to(PACKAGE)))
def test_functions_are_short(path):
    """Under 80 lines without their docstring: longer ones do several things."""
    for node in ast.walk(ast.parse(path.read_text())):
        if isinstance(node, ast.FunctionDef):
            told = node.body[0].end_lineno if ast.get_docstring(node) else node.body[0].lineno - 1
            assert node.end_lineno - told < 80, node.name


@pytest.mark.parametrize("path", MODULES, ids=lambda p: str(p.relative_to(PACKAGE)))
def test_what_a_room_shows_is_in_its_list(path):
    """`__all__` has all that a room's `__init__` defines or, if it defines nothing, imports."""
    if path.name != "__init__.py":
        return
    tree = ast.parse(path.read_text())
    shown = [
        alias.asname or alias.name
        for node in tree.body
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


@pytest.mark.parametrize("path", MODULES, ids=lambda p: str(p.relative_to(PACKAGE)))
def test_modules_are_short_and_documented(path):
    text = path.read_text()
    assert len(text.splitlines()) <= 400
    tree = ast.parse(text)
    assert ast.get_docstring(tree)
    for node in tree.body:
        if isinstance(node, ast.FunctionDef | ast.ClassDef) and not node.name.startswith("_"):
            assert ast.get_docstring(node), node.name


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


@pytest.mark.parametrize("name", sorted(public()))
def test_options_are_named(name):
    """Main arguments first, then options by name: at most two with a default may go without.

    Three numbers of a material, and what a node is held along, about and in, are main arguments.
    """
    most = 3 if name.startswith(("jc.materials", "jc.restrained")) else 2
    given = inspect.signature(public()[name]).parameters.values()
    by_place = [p for p in given if p.kind is p.POSITIONAL_OR_KEYWORD and p.default is not p.empty]
    allowed = {"jc.force_density", "jc.find_form"}  # whose second argument may be missing
    assert len(by_place) <= most + (name in allowed), [p.name for p in by_place]


def test_picture_of_a_failed_solution_is_refused():
    structure, phases = jc.scenes.flat_net()
    failed = jc.solve(structure, phases, jc.Newton(max_steps=1))
    with pytest.raises(ValueError, match="solution: has failed"):
        jc.plots.net(failed)


# --- contracts are code

_OBJECTS = {"group", "g", "one", "load", "law", "own_law", "section"}


def named(node):
    """The last name of ``a.b.c``, or None."""
    return getattr(node, "attr", getattr(node, "id", None))


@pytest.mark.parametrize("path", MODULES, ids=lambda p: str(p.relative_to(PACKAGE)))
def test_nobody_asks_groups_loads_and_laws_for_names(path):
    found = []
    for node in ast.walk(ast.parse(path.read_text())):
        if isinstance(node, ast.Call) and named(node.func) in ("hasattr", "getattr"):
            literal = isinstance(node.args[1], ast.Constant)
            if literal and named(node.args[0]) in _OBJECTS:
                found.append(ast.unparse(node))
    assert not found


@pytest.mark.parametrize("path", MODULES, ids=lambda p: str(p.relative_to(PACKAGE)))
def test_only_spaces_know_how_many_numbers_a_motion_has(path):
    """Nobody compares `n_freedom`, or columns of a motion, a load, a step: spaces and elements
    say what they do with them."""
    found = []
    for node in ast.walk(ast.parse(path.read_text())):
        if isinstance(node, ast.Compare):
            asked = ast.unparse(node.left)
            widths = ("motion.shape", "begin.shape", "before.shape", "load.shape")
            if asked.endswith(("n_freedom", "n_motion")) or any(w in asked for w in widths):
                found.append(ast.unparse(node))
    assert not found


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
    return found


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
    asked = set()
    for path in MODULES:
        aside = path.name == "opensees.py"  # takes straight elements only, and all of them apart
        if aside or room(path) in ("elements", "scenes", "forms", "design", "cli"):
            continue
        for node in ast.walk(ast.parse(path.read_text())):
            if isinstance(node, ast.Attribute) and named(node.value) == "group":
                asked.add(node.attr)
    assert len(asked) > 20
    assert asked <= known, asked - known
