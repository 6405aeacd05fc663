"""Objects of the package as plain data for JSON, and back: fixed tables of types and fields.

- A number, a text, true or false stand for themselves; null or an absent field stands for None.
- A list of numbers, also a nested one, is an array; an array of float32 is
  ``{"type": "float32", "values": [...]}``.
- An object with a text under "type" is of the class of that name in `TYPES`; its other fields are
  those of the class.
- A list of texts is one of keys.
- An object without "type" is a dict. A list that holds objects is a list. A tuple is
  ``{"type": "tuple", "items": []}``, and a list of numbers that is no array is
  ``{"type": "list", "items": []}``.
"""

from __future__ import annotations

import dataclasses
import difflib
import json
from typing import Any, TypeVar

import jax
import numpy as np

from ..analysis.phases import Phase
from ..common.checks import holds_boolean
from ..common.selection import Only, Selection, WholeGroups
from ..common.tree import Indices
from ..elements import Bars, Beams, Cables, Catenaries, SlidingCables
from ..elements.element import Element
from ..loads import (
    AreaLoads,
    CablePressure,
    FacePressure,
    LineLoads,
    NodalLoads,
    SelfWeight,
    SupportMovement,
    Varying,
)
from ..loads.load import Load
from ..materials import Elastic, Parallel, Polygonal
from ..materials.law import Law
from ..model.structure import Structure, is_group
from ..model.supports import Supports
from ..sections import Section
from .reading import FileError

Kind = TypeVar("Kind", bound=type)

TYPES: dict[str, type] = {
    cls.__name__: cls
    for cls in (
        *(Structure, Supports, Phase, Only, Selection),
        *(Bars, Beams, Cables, Catenaries, SlidingCables),
        *(AreaLoads, CablePressure, FacePressure, LineLoads, NodalLoads, SelfWeight),
        *(SupportMovement, Varying, Elastic, Parallel, Polygonal, Section),
    )
}
"""Classes whose objects a file can hold, by name."""


def register(cls: Kind) -> Kind:
    """Let files hold objects of a user's class: a group, a load, a law.

    Args:
        cls: the class, a dataclass whose fields are the arguments of its constructor.

    Returns:
        The class, so that `register` can be a decorator.

    Raises:
        ValueError: another class has that name, or it is no dataclass.

    Example:
        >>> from jaxcable.elements import Cables
        >>> jc.files.register(Cables) is Cables  # files know it already
        True
    """
    if not dataclasses.is_dataclass(cls):
        raise ValueError(f"{cls.__name__}: expected a dataclass, such as a pytree of jaxcable")
    known = TYPES.get(cls.__name__, cls)
    # a cell of a notebook that runs again defines the same class once more
    if (known.__module__, known.__qualname__) != (cls.__module__, cls.__qualname__):
        raise ValueError(f"{cls.__name__}: files know another class of that name")
    TYPES[cls.__name__] = cls
    return cls


IMPLIED = {"structure": Structure, "supports": Supports, "section": Section}
"""Classes of objects that need not name theirs, by the field that they stand in."""

COMMENT = "comment"
"""Field of every object of a class that is not read: for people."""

DEEPEST = 32
"""Levels of nested objects that are read: more than any structure needs."""


def encode(value: Any, where: str, implied: type | None = None) -> Any:
    """Plain data of an object, a container, an array or a number.

    Args:
        value: object, container, array or number.
        where: its place in the scene, in words, for messages.
        implied: the class that a reader expects here; its name is left out of the data.

    Raises:
        ValueError: a file cannot hold the value: other types, tracers, NaN.
    """
    if value is None or isinstance(value, bool | str):
        return value
    if isinstance(value, jax.core.Tracer):
        raise ValueError(f"{where}: is being traced; write files outside of jit")
    if isinstance(value, Indices):
        return value.array.tolist()
    if isinstance(value, WholeGroups):  # keys of groups: a text, or several
        return value.names[0] if len(value.names) == 1 else list(value.names)
    if TYPES.get(type(value).__name__) is type(value):
        return _encode_object(value, where, implied)
    if isinstance(value, dict):
        for key in value:
            if not isinstance(key, str):
                raise ValueError(f"{where}: the key {key!r} is no text; JSON has no other keys")
        return {key: encode(v, f"{where}[{key!r}]") for key, v in value.items()}
    if isinstance(value, tuple | list):
        items = [encode(v, f"{where}[{k}]") for k, v in enumerate(value)]
        if type(value) is list and any(isinstance(item, dict) for item in items):
            return items
        if type(value) in (list, tuple):
            return {"type": type(value).__name__, "items": items}
    if isinstance(value, np.ndarray | np.generic | jax.Array | int | float):
        return _encode_numbers(value, where)
    raise ValueError(f"{where}: a {type(value).__name__} cannot be written to a file")


def _encode_object(value, where, implied):
    """Plain data of an object of a class in `TYPES`, a dict; fields with defaults are left out."""
    cls = type(value)
    fields = {} if cls is implied else {"type": cls.__name__}
    for field in stated(cls):
        content = getattr(value, field.name)
        if content is None:
            continue
        if field.default is not dataclasses.MISSING and content is field.default:
            continue
        own = cls.__module__.partition(".")[0] == __package__.partition(".")[0]
        if own and is_group(value) and isinstance(content, np.ndarray | jax.Array):
            content = _once(np.asarray(content))
        if cls is Section and field.name == "laws":
            content = list(content)  # its constructor makes a tuple of it again
        place = f"{where}.{field.name}"
        fields[field.name] = encode(content, place, IMPLIED.get(field.name))
    return fields


def stated(cls: type) -> list[dataclasses.Field]:
    """Fields of a class that users state, a list; the constructor or the analysis fills others."""
    others = cls.worked_out if issubclass(cls, Load | Law) else ()
    return [field for field in dataclasses.fields(cls) if field.name not in others]


def _once(values):
    """The value of all elements if they have the same, as constructors accept it; else [n, ...]."""
    if len(values) > 1 and values.tobytes() == values[:1].tobytes() * len(values):
        return values[0]
    return values


def _encode_numbers(value, where):
    """A number, or an array as nested lists; float32 is marked."""
    array = np.asarray(value)
    if not np.issubdtype(array.dtype, np.number) and array.dtype != bool:
        raise ValueError(f"{where}: an array of {array.dtype} cannot be written to a file")
    if not np.isfinite(array).all():
        index = np.argwhere(~np.isfinite(array))[0].tolist()
        raise ValueError(f"{where}{index or ''}: not finite; a file holds finite numbers only")
    if array.dtype == np.float32 and not isinstance(value, float):
        return {"type": "float32", "values": array.astype(float).tolist()}
    return array.tolist()


def decode(data: Any, where: str, implied: type | None = None, depth: int = 0) -> Any:
    """The object that `encode` has turned into plain data.

    Args:
        data: plain data, as from JSON.
        where: place of the data in the file, in words, for messages.
        implied: class of an object whose data do not name one.
        depth: level of nesting.

    Raises:
        FileError: names the field and what is wrong with it.
    """
    if depth > DEEPEST:
        raise FileError(f"{where}: nested too deeply")
    if data is None or isinstance(data, bool | str):
        return data
    if isinstance(data, float):
        return _decode_numbers(data, where).item()
    if isinstance(data, int):
        if abs(data) > 2**63 - 1:
            raise FileError(f"{where}: a number of more than 64 bits")
        return data
    if isinstance(data, list) and data and all(isinstance(item, str) for item in data):
        return data  # keys of groups
    if isinstance(data, list):
        if not data or any(isinstance(item, dict) for item in data):
            return [decode(item, f"{where}[{k}]", None, depth + 1) for k, item in enumerate(data)]
        return _decode_numbers(data, where)
    name = data.get("type")
    if implied is not None:
        if name in ("float32", "list", "tuple"):
            raise FileError(f"{where}: expected a {implied.__name__}, got {data!r:.60}")
        return _decode_object(data, where, implied, depth)
    if name == "float32":
        return _decode_single(data, where)
    if name in ("list", "tuple"):
        return _decode_items(data, where, name, depth)
    if isinstance(name, str):
        return _decode_object(data, where, None, depth)
    return {key: decode(v, f"{where}[{key!r}]", None, depth + 1) for key, v in data.items()}


def _decode_single(data, where):
    """An array or a number of float32."""
    if data.keys() != {"type", "values"}:
        raise FileError(f'{where}: float32 has the fields "type" and "values" and no other')
    values = _decode_numbers(data["values"], where)
    if np.abs(values).max(initial=0.0) > np.finfo(np.float32).max:
        raise FileError(f"{where}: a number too large for float32")
    return values.astype(np.float32)[()]


def _decode_items(data, where, name, depth):
    """A list or a tuple with "items"."""
    items = data.get("items")
    if data.keys() != {"type", "items"} or not isinstance(items, list):
        raise FileError(f'{where}: a {name} has the fields "type" and "items" and no other')
    return {"list": list, "tuple": tuple}[name](
        decode(item, f"{where}[{k}]", None, depth + 1) for k, item in enumerate(items)
    )


def _decode_object(data, where, implied, depth):
    """An object of a class in `TYPES`; FileError for unknown types and fields, or wrong values."""
    name = data.get("type", implied.__name__ if implied else None)
    if not isinstance(name, str) or name not in TYPES:
        raise FileError(f"{where}: unknown type {name!r}{_meant(name, TYPES)}")
    cls = TYPES[name]
    if implied is not None and cls is not implied:
        raise FileError(f"{where}: expected a {implied.__name__}, got a {name}")
    kinds = {field.name: str(field.type) for field in stated(cls)}
    values = {}
    for key, value in data.items():
        if key == "type" or (key == COMMENT and key not in kinds):
            continue
        if key not in kinds:
            raise FileError(f"{where}: a {name} has no field {key!r}{_meant(key, kinds)}")
        place = f"{where}.{key}"
        values[key] = decode(value, place, IMPLIED.get(key), depth + 1)
        _require_kind(values[key], kinds[key], place)
    if cls is Section and isinstance(values.get("counts"), np.ndarray):
        values["counts"] = tuple(values["counts"].tolist())
    try:
        return cls(**values)
    except FileError:
        raise
    except ValueError as error:
        raise FileError(f"{where}: {error}") from None
    except TypeError as error:
        needed = [f.name for f in dataclasses.fields(cls) if has_no_default(f)]
        missing = [name for name in needed if name not in values]
        if missing:
            raise FileError(f"{where}: {missing[0]}: missing; a {name} needs it") from None
        raise FileError(f"{where}: not the numbers that a {name} needs: {error}") from None
    except (AttributeError, IndexError, KeyError, OverflowError) as error:
        # errors of constructors when a field holds a value of a wrong kind
        raise FileError(f"{where}: not the fields that a {name} needs: {error}") from None


def _require_kind(value, kind, where):
    """FileError for what constructors do not look at, or Python would take for something else."""
    numbers = isinstance(value, np.ndarray | np.generic | list | tuple | str | int | float | None)
    if kind.startswith(("Float[", "Int[", "Bool[")) and not numbers:
        raise FileError(f"{where}: expected numbers, got {type(value).__name__}")
    for base, (words, example) in TYPED.items():
        if kind.startswith(words):
            _require_typed(value, base, example, where)
    if kind == "bool" and not isinstance(value, bool):
        raise FileError(f"{where}: expected true or false, got {value!r:.40}")
    if kind == "Key" and (isinstance(value, bool) or not isinstance(value, str | int | None)):
        raise FileError(f"{where}: expected the key of a group, got {value!r:.40}")


TYPED: dict[type, tuple[tuple[str, ...], str]] = {
    Element: (("PyTree[Element]",), "a group of elements has one, such as Cables"),
    Load: (("Load", "Sequence[Load]"), "a load has one, such as NodalLoads"),
    Law: (("Law", "Sequence[Law]"), "a law has one, such as Elastic"),
}
"""Classes of objects that name theirs: annotations of fields, and words for a message."""


def _require_typed(value, base, example, where):
    """FileError for an object without a "type" where one of a class is expected."""
    if isinstance(value, list | tuple):
        for k, item in enumerate(value):
            _require_typed(item, base, example, f"{where}[{k}]")
    if isinstance(value, dict):
        inner = value.values() if base is Element else ()
        if not inner or not all(isinstance(v, Element | dict | list | tuple | None) for v in inner):
            raise FileError(f'{where}: no "type"; {example}')
        for key, item in value.items():
            _require_typed(item, base, example, f"{where}[{key!r}]")


def has_no_default(field: dataclasses.Field) -> bool:
    """Whether a field must be given to the constructor."""
    return field.default is dataclasses.MISSING and field.default_factory is dataclasses.MISSING


def _meant(name, known):
    """The end of a message on an unknown name: the known name most like it, or all of them."""
    near = difflib.get_close_matches(str(name), list(known), n=1)
    return f"; did you mean {near[0]!r}?" if near else f"; known are {', '.join(known)}"


def _decode_numbers(data, where):
    """An array from nested lists of finite numbers."""
    try:
        array = np.array(data)
    except (ValueError, OverflowError):
        array = None
    if array is None or (array.size and array.dtype.kind not in "bif"):
        place, why = _odd(data) or ("", "expected numbers in lists of equal lengths")
        raise FileError(f"{where}{place}: {why}")
    if array.dtype != bool and holds_boolean(data):  # NumPy would count it as 0 or 1
        raise FileError(f"{where}: expected numbers, got true or false among them")
    if not np.isfinite(array).all():
        index = np.argwhere(~np.isfinite(array))[0].tolist()
        raise FileError(f"{where}{index or ''}: a number too large to be one")
    return array


def _odd(data, place=""):
    """The first place in nested lists that is no number or has another length, and what it is."""
    if not isinstance(data, list):
        number = isinstance(data, int | float)
        return None if number else (place, f"expected a number, got {json.dumps(data):.40}")
    lengths = [len(item) if isinstance(item, list) else 0 for item in data]
    usual = max(lengths, key=lengths.count, default=0)
    for k, length in enumerate(lengths):
        if length != usual and not isinstance(data[k], str | None):
            text = f"expected numbers in lists of equal lengths, got {length or 'no list'} "
            return f"{place}[{k}]", f"{text}where others have {usual or 'no list'}"
    return next(filter(None, (_odd(item, f"{place}[{k}]") for k, item in enumerate(data))), None)
