"""Annotations: on every field of the package, and on everything that a room offers.

`make lint` has mypy compare them with the code.
"""

import ast
import importlib
import inspect
import pathlib
import pkgutil
import types

import jaxcable as jc

PACKAGE = pathlib.Path(jc.__file__).parent
ROOMS = ["jaxcable"] + [
    module.name
    for module in pkgutil.walk_packages(jc.__path__, "jaxcable.")
    if module.ispkg and hasattr(importlib.import_module(module.name), "__all__")
]
SAYS_NOTHING = ("object", "Any")


def _functions(cls):
    """Functions behind the public members of a class that this package has written."""
    for ancestor in cls.__mro__:
        if not ancestor.__module__.startswith("jaxcable"):
            continue
        for name, member in vars(ancestor).items():
            if name.startswith("_") and name not in ("__init__", "__call__"):
                continue
            if isinstance(member, property):
                member = member.fget
            member = getattr(member, "__func__", member)  # of a class method
            member = getattr(member, "func", member)  # of a cached property
            if isinstance(member, types.FunctionType) and not member.__code__.co_filename[0] == "<":
                yield f"{ancestor.__module__}.{ancestor.__name__}.{name}", member


def _offered(room):
    module = importlib.import_module(room)
    for name in module.__all__:
        thing = getattr(module, name)
        if inspect.isclass(thing):
            yield from _functions(thing)
        elif inspect.isfunction(thing):
            yield f"{thing.__module__}.{name}", inspect.unwrap(thing)


def _missing(function):
    """Names of the parameters that have no annotation, and "return"."""
    signature = inspect.signature(function)
    first, *others = [*signature.parameters.values(), None]
    given = [p for p in (first, *others) if p is not None and p.name not in ("self", "cls")]
    missing = [p.name for p in given if p.annotation is p.empty]
    if signature.return_annotation is inspect.Signature.empty and function.__name__ != "__init__":
        missing.append("return")
    return missing


def test_what_rooms_offer_has_annotations():
    wanting = {name: _missing(own) for room in ROOMS for name, own in _offered(room)}
    assert {name: missing for name, missing in wanting.items() if missing} == {}
    assert len(wanting) > 500


def test_a_function_without_annotations_is_seen():
    def half(self, force: float, length) -> float:
        return force / length

    assert _missing(half) == ["length"]
    assert _missing(lambda: None) == ["return"]


def test_fields_say_what_they_hold():
    fields, empty = 0, []
    for path in sorted(PACKAGE.rglob("*.py")):
        for cls in ast.walk(ast.parse(path.read_text())):
            for line in cls.body if isinstance(cls, ast.ClassDef) else ():
                if isinstance(line, ast.AnnAssign):
                    fields += 1
                    if ast.unparse(line.annotation) in SAYS_NOTHING:
                        name = ast.unparse(line.target)
                        empty.append(f"{path.relative_to(PACKAGE)} {cls.name}.{name}")
    assert empty == []
    assert fields > 500
