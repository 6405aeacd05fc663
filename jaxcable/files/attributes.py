"""Attributes of nodes, edges and faces in JSON of compas: what they mean, and which are left out.

An attribute is read, or is known to say nothing more (looks, results that programs keep), or is
empty; all others are counted in the table of what is left out.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from .omissions import Omissions
from .reading import FileError

SUPPORTS = ("is_support", "is_anchor", "is_fixed")  # of jax_fdm, compas_fofin, compas_fd
NODE = frozenset(("x", "y", "z", "px", "py", "pz", *SUPPORTS))
EDGE = frozenset(("q", "px", "py", "pz", "group", "l0", "_is_edge", "is_edge"))
FACE = frozenset(("px", "py", "pz"))

LOOKS = frozenset(
    "name label text color colour visible show size linewidth width opacity guid uid id key".split()
)
"""Attributes that say nothing of the structure."""

RESULTS = frozenset("rx ry rz f force l length".split())
"""Results that programs keep beside their input: residuals and reactions, forces, lengths."""

WHY = {
    "constraint": "curves that nodes slide along are not read: the node is free",
    "constraints": "curves that nodes slide along are not read",
    "thickness": "the weight of surfaces is not read: give it as loads",
    "t": "the weight of surfaces is not read: give it as loads",
    **dict.fromkeys(("E", "radius"), "give axial_stiffness=..., N (--axial-stiffness)"),
    **dict.fromkeys(("f", "force"), "is not q, which is read, by the length of the edge"),
    **dict.fromkeys(("l", "length"), "is not the distance of the nodes, which is read"),
}
_EMPTY: tuple[Any, ...] = (None, False, 0, "", [], {})


def count_unread(
    attributes: Mapping[str, Any], read: frozenset[str], kind: str, where: str, table: Omissions
) -> None:
    """Count the attributes that are neither read nor known to say nothing more.

    Args:
        attributes: of a node, an edge, a face, or the whole.
        read: names of those that are read.
        kind: what has them, in words.
        where: its place in the file, in words.
        table: what is left out.
    """
    for key, value in attributes.items():
        known = key in read or key in LOOKS or key in RESULTS or key.startswith("_")
        if not (known or empty(value)):
            table.add(f"attribute {key!r} of {kind}", where, WHY.get(key, ""))


def force_density(attributes: Mapping[str, Any], length: float, where: str) -> float:
    """The force density of an edge, N/m: its own, or its force over its length; 0 is none."""
    stated = number(attributes, "q", where)
    if stated == 0 and length > 0:
        for key in ("f", "force"):
            if not empty(attributes.get(key)):
                return number(attributes, key, where) / float(length)
    return stated


def count_results(
    attributes: Mapping[str, Any], density: float, length: float, where: str, table: Omissions
) -> None:
    """Count force and length of an edge unless they agree with its force density and its nodes.

    They then are what the user prescribed to another program, not results of it. A thousandth is
    allowed for numbers that were rounded.
    """
    expected = {"f": density * length, "force": density * length, "l": length, "length": length}
    for key, right in expected.items():
        value = attributes.get(key)
        if not empty(value) and abs(number(attributes, key, where) - right) > 1e-3 * abs(right):
            table.add(f"attribute {key!r} of an edge", where, WHY[key])


def empty(value: Any) -> bool:
    """Whether the value of an attribute says nothing: null, false, zero, or without contents."""
    return any(value == nothing and type(value) is not str for nothing in _EMPTY) or value == ""


def number(attributes: Mapping[str, Any], key: str, where: str) -> float:
    """The finite number under a key of attributes; 0 if there is none."""
    value = attributes.get(key)
    value = 0.0 if value is None else value
    known = not isinstance(value, bool) and isinstance(value, int | float)
    if not known or not abs(value) < 1e300:
        raise FileError(f"{where}.{key}: expected a finite number, got {value!r:.40}")
    return float(value)


def coordinates(attributes: Mapping[str, Any], where: str) -> list[float]:
    """The position of a node; coordinates that are not given are zero, unless none is given."""
    given = [axis for axis in "xyz" if axis in attributes]
    if not given:
        raise FileError(f"{where}: has no coordinates x, y, z")
    for axis in given:
        if attributes[axis] is None:
            raise FileError(f"{where}.{axis}: expected a finite number, got null")
    return [number(attributes, axis, where) for axis in "xyz"]


def load(attributes: Mapping[str, Any], where: str) -> list[float]:
    """The load of a node, an edge or a face along x, y, z; zero where none is given."""
    return [number(attributes, "p" + axis, where) for axis in "xyz"]


def flag(attributes: Mapping[str, Any], key: str, where: str, absent: bool = False) -> bool:
    """Whether the flag under a key is set: true, false, 1 or 0."""
    value = attributes.get(key)
    if value is None:
        return absent
    if not isinstance(value, bool | int | float) or value not in (0, 1):
        raise FileError(f"{where}.{key}: expected true or false, got {value!r:.40}")
    return bool(value)


def merged(attributes: Any, defaults: Mapping[str, Any], where: str) -> dict[str, Any]:
    """Attributes with those that a file states for all."""
    attributes = {} if attributes is None else attributes
    if not isinstance(attributes, dict):
        raise FileError(f"{where}: expected an object of attributes")
    return {**defaults, **attributes}
