"""The rules of the house: imports go downward, modules are short, public names are documented."""

import ast
from pathlib import Path

import pytest

import jaxcable as jc

ROOT = Path(__file__).parent.parent
PACKAGE = ROOT / "jaxcable"

FLOORS = [
    ["_tree", "_check", "_interrupt"],
    ["_rules"],
    ["selection", "status"],
    ["plausibility"],
    ["linear", "search", "rotations", "progress", "compilation", "rooted"],
    ["roots"],
    ["implicit"],
    ["materials"],
    ["sections"],
    ["elements"],
    ["supports", "spins"],
    ["freedoms"],
    ["spaces"],
    ["structure"],
    ["parts", "topology"],
    ["loads"],
    ["load_stacks", "elementwise", "bundles"],
    ["assembly"],
    ["newton_step", "globalisation", "reading"],
    ["iteration"],
    ["equilibrium"],
    ["incremental"],
    ["phases"],
    ["ramp"],
    ["solution"],
    ["schedule"],
    ["preparation", "results"],
    ["one_phase"],
    ["solver", "batches", "tangent", "works"],
    ["paths", "stresses", "internal_forces", "energy"],
    ["design", "forms"],
    ["scenes"],
    ["plots", "files"],
    ["reports"],
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


@pytest.mark.parametrize("path", MODULES, ids=lambda p: str(p.relative_to(PACKAGE)))
def test_modules_are_short_and_documented(path):
    text = path.read_text()
    assert len(text.splitlines()) <= 400
    tree = ast.parse(text)
    assert ast.get_docstring(tree)
    for node in tree.body:
        if isinstance(node, ast.FunctionDef | ast.ClassDef) and not node.name.startswith("_"):
            assert ast.get_docstring(node), node.name


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
    from jaxcable.elements import element

    known = set()
    for cls in vars(element).values():
        if isinstance(cls, type) and cls.__module__ == element.__name__:
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
