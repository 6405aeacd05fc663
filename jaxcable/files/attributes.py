"""Attributes of nodes, edges and faces in JSON files of compas: their meaning, and what is ignored.

An attribute is read, or is known to be of no meaning here (appearance, results that programs keep),
or is empty; all others are counted in the table of what is left out.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from .omissions import Omissions
from .reading import FileError

SUPPORT_KEYS = ("is_support", "is_anchor", "is_fixed")  # of jax_fdm, compas_fofin, compas_fd
NODE_KEYS = frozenset(("x", "y", "z", "px", "py", "pz", *SUPPORT_KEYS))
EDGE_KEYS = frozenset(("q", "px", "py", "pz", "group", "l0", "_is_edge", "is_edge"))
FACE_KEYS = frozenset(("px", "py", "pz"))

APPEARANCE_KEYS = frozenset(
    "name label text color colour visible show size linewidth width opacity guid uid id key".split()
)
"""Attributes that say nothing of the structure."""

RESULT_KEYS = frozenset("rx ry rz f force l length".split())
"""Results that programs keep beside their input: residuals and reactions, forces, lengths."""

REASONS = {
    "constraint": "curves that nodes slide along are not read: the node is free",
    "constraints": "curves that nodes slide along are not read",
    "thickness": "the weight of surfaces is not read: give it as loads",
    "t": "the weight of surfaces is not read: give it as loads",
    **dict.fromkeys(("E", "radius"), "give axial_stiffness=..., N (--axial-stiffness)"),
    **dict.fromkeys(("f", "force"), "differs from q times the length of the edge; q is read"),
    **dict.fromkeys(("l", "length"), "differs from the distance of the nodes, which is read"),
}
_EMPTY: tuple[Any, ...] = (None, False, 0, "", [], {})


def record_unread_attributes(
    attributes: Mapping[str, Any], read: frozenset[str], kind: str, where: str, table: Omissions
) -> None:
    """Add a row to the table of omissions for each attribute that a reader does not know.

    Attributes that are read, empty, of appearance only, or results of programs get no row.

    Args:
        attributes: attributes by name, of a node, an edge, a face, or the whole net.
        read: names of the attributes that are read.
        kind: what has the attributes, in words, such as "a node".
        where: place in the file, in words.
        table: table to which the rows are added.
    """
    for key, value in attributes.items():
        known = key in read or key in APPEARANCE_KEYS or key in RESULT_KEYS or key.startswith("_")
        if not (known or is_empty(value)):
            table.add(f"attribute {key!r} of {kind}", where, REASONS.get(key, ""))


def edge_force_density(attributes: Mapping[str, Any], length: float, where: str) -> float:
    """Return the force density of an edge, N/m: ``q``, else its force over its length, else 0.

    Args:
        attributes: attributes of the edge by name; its force, N, is under ``f`` or ``force``.
        length: distance of its nodes in the file, m.
        where: place in the file, in words, for the message of a FileError.
    """
    stated = read_finite_number(attributes, "q", where)
    if stated == 0 and length > 0:
        for key in ("f", "force"):
            if not is_empty(attributes.get(key)):
                return read_finite_number(attributes, key, where) / float(length)
    return stated


def record_conflicting_results(
    attributes: Mapping[str, Any], density: float, length: float, where: str, table: Omissions
) -> None:
    """Add rows to the table of omissions where force or length of an edge disagree with the net.

    The force is compared with `density` (N/m) times `length` (m), the length with `length`. If they
    disagree, they were prescribed to another program, and are not its results. A relative deviation
    of 1e-3 is allowed, because files hold rounded numbers.
    """
    expected = {"f": density * length, "force": density * length, "l": length, "length": length}
    for key, right in expected.items():
        value = attributes.get(key)
        if is_empty(value):
            continue
        if abs(read_finite_number(attributes, key, where) - right) > 1e-3 * abs(right):
            table.add(f"attribute {key!r} of an edge", where, REASONS[key])


def is_empty(value: Any) -> bool:
    """Return whether a value has no content: null, false, zero, an empty text, list or object."""
    return any(value == nothing and type(value) is not str for nothing in _EMPTY) or value == ""


def read_finite_number(attributes: Mapping[str, Any], key: str, where: str) -> float:
    """Return the number under `key` as a float, 0 if there is none or it is null.

    Raise FileError, which names the place `where`, for anything but a finite number.
    """
    value = attributes.get(key)
    value = 0.0 if value is None else value
    known = not isinstance(value, bool) and isinstance(value, int | float)
    if not known or not abs(value) < 1e300:
        raise FileError(f"{where}.{key}: expected a finite number, got {value!r:.40}")
    return float(value)


def node_coordinates(attributes: Mapping[str, Any], where: str) -> list[float]:
    """Return x, y, z of a node; one or two missing ones are zero, three raise FileError."""
    given = [axis for axis in "xyz" if axis in attributes]
    if not given:
        raise FileError(f"{where}: has no coordinates x, y, z")
    for axis in given:
        if attributes[axis] is None:
            raise FileError(f"{where}.{axis}: expected a finite number, got null")
    return [read_finite_number(attributes, axis, where) for axis in "xyz"]


def load_vector(attributes: Mapping[str, Any], where: str) -> list[float]:
    """Return the load ``px, py, pz`` of a node, an edge or a face as a list; zero where none is."""
    return [read_finite_number(attributes, "p" + axis, where) for axis in "xyz"]


def read_flag(attributes: Mapping[str, Any], key: str, where: str, absent: bool = False) -> bool:
    """Return whether the flag under `key` is set (true or 1); if there is none, return `absent`.

    Raise FileError, which names the place `where`, for other values than true, false, 1 and 0.
    """
    value = attributes.get(key)
    if value is None:
        return absent
    if not isinstance(value, bool | int | float) or value not in (0, 1):
        raise FileError(f"{where}.{key}: expected true or false, got {value!r:.40}")
    return bool(value)


def with_defaults(attributes: Any, defaults: Mapping[str, Any], where: str) -> dict[str, Any]:
    """Return the attributes of a node, edge or face as a dict, completed by `defaults`.

    None stands for no attributes. Raise FileError, which names the place `where`, unless the data
    are a JSON object.
    """
    attributes = {} if attributes is None else attributes
    if not isinstance(attributes, dict):
        raise FileError(f"{where}: expected an object of attributes")
    return {**defaults, **attributes}
