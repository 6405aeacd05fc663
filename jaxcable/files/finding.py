"""The net in JSON of compas: the whole file, or deep inside of a session; what lies beside it."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any, NamedTuple

from .omissions import Omissions
from .reading import FileError

_DEEPEST = 20  # levels that are searched
_WRAPPING = frozenset(
    "data value dtype datatype inheritance guid name version compas settings root".split()
)
"""Fields around a net that say nothing of it: types, identifiers, settings of a display."""


_PACKAGES = "compas", "jax_fdm"
"""Packages, with those that begin so, whose files are read."""


class Found(NamedTuple):
    """A net in the data of a file.

    Attributes:
        data: the object that has its nodes.
        inside: its place in the file, in words, to be put before a field; empty for the usual one.
    """

    data: dict[str, Any]
    inside: str


def find_net(data: dict[str, Any], table: Omissions) -> Found:
    """The first network or mesh with edges in a file; what lies beside it is counted.

    Raises:
        FileError: there is none; the message says what the file holds.
    """
    usual = data
    for key in ("data", "value"):  # compas 2 and 1 wrap the data of their objects
        if isinstance(usual.get(key), dict):
            usual = usual[key]
    _count_foreign(data, table)
    if "vertex" in usual or "node" in usual:
        _count_beside(data, usual, table)
        return Found(usual, "")
    nets = list(_nets(data, "", 0))
    if not nets:
        kind = data.get("dtype") or data.get("datatype")
        what = f"an object {kind!r}" if isinstance(kind, str) else f"the fields {', '.join(data)}"
        raise FileError(f"node: missing; no network or mesh of compas in it, but {what:.200}")
    chosen = next((net for net in nets if net.data.get("edge") or net.data.get("face")), nets[0])
    for other in nets:
        if other is not chosen:
            table.add("net", other.inside[:-1], "the first net of a file is read")
    _count_beside(data, chosen.data, table)
    return Found(chosen.data, chosen.inside)


def _count_foreign(data, table):
    """Count the type of the whole, ``package/Class``, if that is of another program."""
    kind = data.get("dtype") or data.get("datatype")
    if not isinstance(kind, str) or "/" not in kind:
        return
    package = kind.split("/")[0].split(".")[0]
    if package.partition("_")[0] not in _PACKAGES and package not in _PACKAGES:
        why = "is of another program; what has the names of compas is read as it is there"
        table.add(f"type {kind:.80}", "dtype", why)


def _is_net(data: Any) -> bool:
    """Whether data are those of a network or a mesh."""
    return isinstance(data, dict) and (
        isinstance(data.get("vertex"), dict)
        or (isinstance(data.get("node"), dict) and "edge" in data)
    )


def _nets(data: Any, where: str, depth: int) -> Iterator[Found]:
    """Generate the nets in nested data."""
    if _is_net(data):
        yield Found(data, f"{where}.")
        return
    if depth < _DEEPEST:
        for key, value in _items(data):
            place = f"{where}[{key}]" if isinstance(data, list) else f"{where}.{key}".lstrip(".")
            yield from _nets(value, place, depth + 1)


def _items(data: Any) -> list[tuple[Any, Any]]:
    """Pairs (key, value) of an object or a list; none of other data."""
    if isinstance(data, dict):
        return list(data.items())
    return list(enumerate(data)) if isinstance(data, list) else []


def _count_beside(data: Any, net: dict[str, Any], table: Omissions, where: str = "") -> bool:
    """Count what lies beside a net, on the way to it; returns whether it is in these data."""
    if data is net:
        return True
    inside = [_contains(value, net, 0) for _, value in _items(data)]
    if not any(inside):
        return False
    for (key, value), on_way in zip(_items(data), inside, strict=True):
        place = f"{where}[{key}]" if isinstance(data, list) else f"{where}.{key}".lstrip(".")
        if on_way:
            _count_beside(value, net, table, place)
        elif not (isinstance(key, str) and key in _WRAPPING) and value and not _holds_net(value):
            kind = value.get("dtype") if isinstance(value, dict) else None
            what = f"object {kind!r}" if isinstance(kind, str) else "field"
            table.add(f"{what:.80} beside the net", place)
    return True


def _contains(data: Any, net: dict[str, Any], depth: int) -> bool:
    """Whether a net, this object, is in nested data."""
    return data is net or (
        depth < _DEEPEST and any(_contains(value, net, depth + 1) for _, value in _items(data))
    )


def _holds_net(data: Any) -> bool:
    """Whether there is a net in nested data, which is counted as such."""
    return next(_nets(data, "", 0), None) is not None
