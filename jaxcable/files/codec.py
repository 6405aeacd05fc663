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
from collections.abc import Callable
from typing import Any, TypeVar

import jax
import numpy as np

from .. import loads
from ..analysis.phases import Phase
from ..common.selection import Only, Selection, WholeGroups
from ..common.tree import Indices
from ..design.actions import Action
from ..design.cable_checks import CableFatigue, CableResistance, CableSafety, CableService
from ..design.check import Check
from ..design.limit_checks import DisplacementLimit, ReactionLimit, TensionLimit
from ..design.member_buckling import MemberBuckling
from ..design.member_checks import MemberSection
from ..elements import (
    Bars,
    Beams,
    Cables,
    Catenaries,
    Contacts,
    FrictionCables,
    GroundContacts,
    SlidingCables,
    SlidingCatenaries,
    Springs,
)
from ..elements.element import Element
from ..loads.load import Load
from ..loads.wind_profiles import WindProfile
from ..materials import Elastic, Parallel, Polygonal
from ..materials.law import Law
from ..model.structure import Structure, is_group
from ..model.supports import Supports
from ..sections import LinearSection, Section
from ..standards import SteelSection
from .number_lists import decode_float32, decode_numbers, encode_numbers, require_only_key
from .reading import FileError

UserClass = TypeVar("UserClass", bound=type)

NAMED_RECORDS: dict[str, Callable[[str], Any]] = {}
"""Functions from a name to a record, by the annotation of the fields that files write as a name.

The catalogue adds its own: "Profile"."""

TYPES: dict[str, type] = {
    cls.__name__: cls
    for cls in (
        *(Structure, Supports, Phase, Only, Selection, Action),
        *(
            Bars,
            Beams,
            GroundContacts,
            Cables,
            Catenaries,
            Contacts,
            FrictionCables,
            SlidingCatenaries,
            SlidingCables,
            Springs,
        ),
        *(loads.AreaLoads, loads.CablePressure, loads.FacePressure, loads.IceLoads),
        *(loads.LineLoads, loads.NodalLoads, loads.PointLoads, loads.PointMasses),
        *(loads.SelfWeight, loads.SupportMovement, loads.Varying, loads.WindLoads),
        *(loads.Crowd, loads.Train),
        *(loads.EurocodeWind, loads.WindPowerLaw, loads.WindTable),
        *(Elastic, Parallel, Polygonal, Section, LinearSection, SteelSection),
        *(CableFatigue, CableResistance, CableSafety, CableService, MemberBuckling, MemberSection),
        *(DisplacementLimit, ReactionLimit, TensionLimit),
    )
}
"""Classes whose objects a file can hold, by name."""


def register(cls: UserClass) -> UserClass:
    """Allow objects of a user's class in files: a group, a load or a law.

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
        raise ValueError(
            f"{cls.__name__}: is not a dataclass; decorate it with jaxcable.common.tree.pytree"
        )
    known = TYPES.get(cls.__name__, cls)
    # a cell of a notebook that runs again defines the same class once more
    if (known.__module__, known.__qualname__) != (cls.__module__, cls.__qualname__):
        where = f"{known.__module__}.{known.__qualname__}"
        raise ValueError(f"{cls.__name__}: another class has this name in files: {where}")
    TYPES[cls.__name__] = cls
    return cls


IMPLIED_CLASSES = {"structure": Structure, "supports": Supports, "section": Section}
"""Classes of objects that need not name theirs, by the field that they stand in."""

ALTERNATIVE_CLASSES: dict[type, tuple[type, ...]] = {Section: (LinearSection,)}
"""Classes that may stand in place of an implied one; their objects name them under "type"."""

COMMENT = "comment"
"""Field of every object of a class that is not read: for people."""

MOST_LEVELS = 32
"""Levels of nested objects that are read: more than any structure needs."""


def encode(value: Any, where: str, implied: type | None = None) -> Any:
    """Return plain data for JSON that stand for an object, a container, an array or a number.

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
                raise ValueError(f"{where}: the key {key!r} is not a text, as keys of JSON are")
        return {key: encode(v, f"{where}[{key!r}]") for key, v in value.items()}
    if isinstance(value, tuple | list):
        items = [encode(v, f"{where}[{k}]") for k, v in enumerate(value)]
        if type(value) is list and any(isinstance(item, dict) for item in items):
            return items
        if type(value) in (list, tuple):
            return {"type": type(value).__name__, "items": items}
    if isinstance(value, np.ndarray | np.generic | jax.Array | int | float):
        return encode_numbers(value, where)
    raise ValueError(f"{where}: a {type(value).__name__} cannot be written to a file")


def _encode_object(value, where, implied):
    """Return the fields of an object as plain data, a dict, except those that equal their default.

    The class is named under "type", unless it is `implied`, the class that a reader expects here.
    `where` is the place in the scene, in words, for messages.
    """
    cls = type(value)
    fields = {} if cls is implied else {"type": cls.__name__}
    for field in user_fields(cls):
        content = getattr(value, field.name)
        if content is None:
            continue
        if field.default is not dataclasses.MISSING and content is field.default:
            continue
        own = cls.__module__.partition(".")[0] == __package__.partition(".")[0]
        if own and is_group(value) and isinstance(content, np.ndarray | jax.Array):
            content = _collapse_equal_values(np.asarray(content))
        place = f"{where}.{field.name}"
        if isinstance(value, Action | Check) and isinstance(content, tuple | list):
            if content == field.default:
                continue
            if all(isinstance(item, str) for item in content):
                fields[field.name] = list(content)
                continue
            content = content if field.name == "loads" else np.asarray(content)
        if cls is Section and field.name == "laws":
            content = list(content)  # its constructor makes a tuple of it again
        record = NAMED_RECORDS.get(str(field.type).partition(" ")[0])
        if record is not None and hasattr(content, "name"):
            if record(content.name) != content:
                raise ValueError(
                    f"{place}: {content.name} is not as in the catalogue; give a SteelSection"
                )
            content = content.name
        fields[field.name] = encode(content, place, IMPLIED_CLASSES.get(field.name))
    return fields


def user_fields(cls: type) -> list[dataclasses.Field]:
    """Return the dataclass fields of a class that users give, not those that are computed."""
    others = cls.worked_out if issubclass(cls, Load | Law) else ()
    return [field for field in dataclasses.fields(cls) if field.name not in others]


def _collapse_equal_values(values):
    """Return the first value of an array [n_elem] if all are equal, otherwise the array.

    Constructors of element groups take one value for all elements.
    """
    if len(values) > 1 and values.tobytes() == values[:1].tobytes() * len(values):
        return values[0]
    return values


def decode(data: Any, where: str, implied: type | None = None, depth: int = 0) -> Any:
    """Return the object, container or numbers that plain data from `encode` stand for.

    Args:
        data: plain data, as from JSON.
        where: place of the data in the file, in words, for messages.
        implied: class of an object whose data do not name one.
        depth: level of nesting.

    Raises:
        FileError: names the field and what is wrong with it.
    """
    if depth > MOST_LEVELS:
        raise FileError(f"{where}: nested in more than {MOST_LEVELS} levels")
    if data is None or isinstance(data, bool | str):
        return data
    if isinstance(data, float):
        return decode_numbers(data, where).item()
    if isinstance(data, int):
        if abs(data) > 2**63 - 1:
            raise FileError(f"{where}: the number has more than 64 bits")
        return data
    if isinstance(data, list) and data and all(isinstance(item, str) for item in data):
        return data  # keys of groups
    if isinstance(data, list):
        if not data or any(isinstance(item, dict) for item in data):
            return [decode(item, f"{where}[{k}]", None, depth + 1) for k, item in enumerate(data)]
        return decode_numbers(data, where)
    name = data.get("type")
    if implied is not None:
        if name in ("float32", "list", "tuple"):
            raise FileError(f"{where}: expected a {implied.__name__}, got {data!r:.60}")
        return _decode_object(data, where, implied, depth)
    if name == "float32":
        return decode_float32(data, where)
    if name in ("list", "tuple"):
        return _decode_sequence(data, where, name, depth)
    if isinstance(name, str):
        return _decode_object(data, where, None, depth)
    return {key: decode(v, f"{where}[{key!r}]", None, depth + 1) for key, v in data.items()}


def _decode_sequence(data, where, name, depth):
    """Return the list or tuple that {"type": "list" or "tuple", "items": [...]} stands for.

    `name` is "list" or "tuple", `where` the place in the file and `depth` the level of nesting.
    """
    require_only_key(data, "items", where)
    items = data["items"]
    if not isinstance(items, list):
        raise FileError(f"{where}.items: expected a list, got {items!r:.40}")
    return {"list": list, "tuple": tuple}[name](
        decode(item, f"{where}[{k}]", None, depth + 1) for k, item in enumerate(items)
    )


def _decode_object(data, where, implied, depth):
    """Return the object of a class in `TYPES` that a dict describes.

    The class is named under "type", or is `implied` by the field that the dict stands in. Raise
    FileError, which names the place `where`, for unknown keys, for values that the constructor
    refuses, and for objects nested too deeply (`depth` levels so far).
    """
    name = data.get("type", implied.__name__ if implied else None)
    if not isinstance(name, str) or name not in TYPES:
        raise FileError(f"{where}: unknown type {name!r}{_suggest_name(name, TYPES)}")
    cls = TYPES[name]
    if implied is not None and cls not in (implied, *ALTERNATIVE_CLASSES.get(implied, ())):
        raise FileError(f"{where}: expected a {implied.__name__}, got a {name}")
    kinds = {field.name: str(field.type) for field in user_fields(cls)}
    values = {}
    for key, value in data.items():
        if key == "type" or (key == COMMENT and key not in kinds):
            continue
        if key not in kinds:
            raise FileError(f"{where}: {name} has no key {key!r}{_suggest_name(key, kinds)}")
        place = f"{where}.{key}"
        values[key] = decode(value, place, IMPLIED_CLASSES.get(key), depth + 1)
        _require_field_type(values[key], kinds[key], place)
        record = NAMED_RECORDS.get(kinds[key].partition(" ")[0])
        if record is not None and isinstance(value, str):
            try:
                values[key] = record(value)
            except ValueError as error:
                raise FileError(f"{place}: {error}") from None
    if cls is Section and isinstance(values.get("counts"), np.ndarray):
        values["counts"] = tuple(values["counts"].tolist())
    try:
        return cls(**values)
    except FileError:
        raise
    except ValueError as error:
        raise FileError(f"{where}: {error}") from None
    except (TypeError, AttributeError, IndexError, KeyError, OverflowError) as error:
        # errors of constructors when a field is missing, or holds a value of a wrong kind
        needed = [f.name for f in dataclasses.fields(cls) if has_no_default(f)]
        missing = [f"{key}: missing; {name} needs it" for key in needed if key not in values]
        text = next(iter(missing), f"these values do not make a {name}: {error}")
        raise FileError(f"{where}: {text}") from None


def _require_field_type(value, kind, where):
    """Raise FileError if a decoded value has a type that its field does not take.

    Only wrong types that the constructor of the class would not notice are refused. `kind` is the
    annotation of the field as text, and `where` its place in the file.
    """
    numbers = isinstance(value, np.ndarray | np.generic | list | tuple | str | int | float | None)
    if kind.startswith(("Float[", "Int[", "Bool[")) and not numbers:
        raise FileError(f"{where}: expected numbers, got {type(value).__name__}")
    for base, (words, example) in EXPLICIT_CLASSES.items():
        if kind.startswith(words):
            _refuse_missing_type(value, base, example, where)
    if kind == "bool" and not isinstance(value, bool):
        raise FileError(f"{where}: expected true or false, got {value!r:.40}")
    if kind == "Key" and (isinstance(value, bool) or not isinstance(value, str | int | None)):
        raise FileError(f"{where}: expected the key of a group, got {value!r:.40}")


EXPLICIT_CLASSES: dict[type, tuple[tuple[str, ...], str]] = {
    Element: (("PyTree[Element]",), 'a group of elements, such as "type": "Cables"'),
    Load: (("Load", "Sequence[Load]"), 'a load, such as "type": "NodalLoads"'),
    Law: (("Law", "Sequence[Law]"), 'a law, such as "type": "Elastic"'),
    WindProfile: (("WindProfile",), 'a wind profile, such as "type": "EurocodeWind"'),
    SteelSection: (("Profile",), 'a section by its numbers, "type": "SteelSection"'),
}
"""Classes of objects that name theirs: annotations of fields, and words for a message."""


def _refuse_missing_type(value, base, example, where):
    """Raise FileError for a dict without "type" where the file must name a class.

    The class derives from `base`, and `example` says so in words. Lists of such objects, and where
    `base` is `Element` dicts of groups, are searched, too.
    """
    if isinstance(value, list | tuple):
        for k, item in enumerate(value):
            _refuse_missing_type(item, base, example, f"{where}[{k}]")
    if isinstance(value, dict):
        inner = value.values() if base is Element else ()
        if not inner or not all(isinstance(v, Element | dict | list | tuple | None) for v in inner):
            raise FileError(f'{where}: "type" is missing; it names the class of {example}')
        for key, item in value.items():
            _refuse_missing_type(item, base, example, f"{where}[{key!r}]")


def has_no_default(field: dataclasses.Field) -> bool:
    """Return whether a dataclass field has no default, so that the constructor must be given it."""
    return field.default is dataclasses.MISSING and field.default_factory is dataclasses.MISSING


def _suggest_name(name, known):
    """Return the end of a message on an unknown name: "; did you mean ...", or all known names."""
    # 0.6, Python's default, takes "stays" for "backstay"
    near = difflib.get_close_matches(str(name), list(known), n=1, cutoff=0.7)
    return f"; did you mean {near[0]!r}?" if near else f"; known are {', '.join(known)}"
