"""Find the net in JSON data of compas: the whole file, or a part deep inside of a session."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any, NamedTuple

from .omissions import Omissions
from .reading import FileError

_DEEPEST = 20  # levels that are searched: a hostile file must not exhaust the stack
_WRAPPING = frozenset(
    "data value dtype datatype inheritance guid name version compas settings root".split()
)
"""Fields around a net that say nothing of it: types, identifiers, settings of a display."""


_PACKAGES = "compas", "jax_fdm"
"""Packages, with those that begin so, whose files are read."""


class FoundNet(NamedTuple):
    """A net in the data of a file.

    Attributes:
        data: the object that has its nodes.
        prefix: its place in the file, in words, to be put before a field; empty for the usual one.
    """

    data: dict[str, Any]
    prefix: str


def find_net(data: dict[str, Any], table: Omissions) -> FoundNet:
    """Return the first network or mesh with edges in a file; count what lies beside it.

    Raises:
        FileError: there is none; the message says what the file holds.
    """
    usual, way = data, []
    for key in ("data", "value"):  # compas 2 and 1 wrap the data of their objects
        if isinstance(usual.get(key), dict):
            usual, way = usual[key], [*way, key]
    _count_foreign_type(data, table)
    if "vertex" in usual or "node" in usual:
        _count_other_contents(data, way, table)
        return FoundNet(usual, "")
    nets = list(_search_nets(data, []))
    if not nets:
        kind = data.get("dtype") or data.get("datatype")
        what = f"an object {kind!r}" if isinstance(kind, str) else f"the fields {', '.join(data)}"
        raise FileError(
            f"node: missing; the file has no network or mesh of compas, but {what:.200}"
        )
    way, net = next((pair for pair in nets if pair[1].get("edge") or pair[1].get("face")), nets[0])
    for other, _ in nets:
        if other != way:
            table.add("net", _format_place(other), "the first net of a file is read")
    _count_other_contents(data, way, table)
    return FoundNet(net, f"{_format_place(way)}.")


def _count_foreign_type(data, table):
    """Count the type of the file, ``package/Class``, if it is that of another program."""
    kind = data.get("dtype") or data.get("datatype")
    if not isinstance(kind, str) or "/" not in kind:
        return
    package = kind.split("/")[0].split(".")[0]
    if package.partition("_")[0] not in _PACKAGES and package not in _PACKAGES:
        why = "of another program; fields with the names of compas are read as those of compas"
        table.add(f"type {kind:.80}", "dtype", why)


def _is_net(data: Any) -> bool:
    """Return whether data have the form of a network or a mesh."""
    return isinstance(data, dict) and (
        isinstance(data.get("vertex"), dict)
        or (isinstance(data.get("node"), dict) and "edge" in data)
    )


def _search_nets(data: Any, way: list[Any]) -> Iterator[tuple[list[Any], Any]]:
    """Generate the nets in nested data: pairs of the keys that lead to it, and the net."""
    if _is_net(data):
        yield way, data
    elif len(way) < _DEEPEST:
        for key, value in _child_items(data):
            yield from _search_nets(value, [*way, key])


def _child_items(data: Any) -> list[tuple[Any, Any]]:
    """Return the pairs (key, value) of an object or a list; none for other data."""
    if isinstance(data, dict):
        return list(data.items())
    return list(enumerate(data)) if isinstance(data, list) else []


def _format_place(way: list[Any]) -> str:
    """Return the place that a path of keys leads to, in words, such as ``scene.objects[2]``."""
    return "".join(f"[{key}]" if isinstance(key, int) else f".{key}" for key in way).lstrip(".")


def _count_other_contents(data: Any, way: list[Any], table: Omissions) -> None:
    """Count what lies beside a net along the path to it; other nets are counted elsewhere."""
    for depth, key in enumerate(way):
        for other, value in _child_items(data):
            if other == key or other in _WRAPPING or not value or any(_search_nets(value, [])):
                continue
            kind = value.get("dtype") if isinstance(value, dict) else None
            what = f"object {kind!r}" if isinstance(kind, str) else "field"
            table.add(f"{what:.80} beside the net", _format_place([*way[:depth], other]))
        data = data[key]
