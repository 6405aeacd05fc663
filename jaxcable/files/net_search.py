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
    """A net in the data of a JSON file.

    Attributes:
        data: the JSON object that has the nodes and edges of the net, a dict.
        prefix: place of this object in the file, such as "scene.objects[2].", for messages on its
            fields; empty for the usual place.
    """

    data: dict[str, Any]
    prefix: str


def find_net(data: dict[str, Any], table: Omissions) -> FoundNet:
    """Return the first network or mesh with edges in the data of a file.

    What lies beside it in the file, such as other nets, is counted in the table of omissions.

    Raises:
        FileError: there is none; the message says what the file holds.
    """
    usual, key_path = data, []
    for key in ("data", "value"):  # compas 2 and 1 wrap the data of their objects
        if isinstance(usual.get(key), dict):
            usual, key_path = usual[key], [*key_path, key]
    _record_foreign_type(data, table)
    if "vertex" in usual or "node" in usual:
        _record_contents_beside_net(data, key_path, table)
        return FoundNet(usual, "")
    nets = list(_search_nets(data, []))
    if not nets:
        kind = data.get("dtype") or data.get("datatype")
        what = f"an object {kind!r}" if isinstance(kind, str) else f"the fields {', '.join(data)}"
        raise FileError(
            f"node: missing; the file has no network or mesh of compas, but {what:.200}"
        )
    key_path, net = next(
        (pair for pair in nets if pair[1].get("edge") or pair[1].get("face")), nets[0]
    )
    for other, _ in nets:
        if other != key_path:
            table.add("net", _format_key_path(other), "the first net of a file is read")
    _record_contents_beside_net(data, key_path, table)
    return FoundNet(net, f"{_format_key_path(key_path)}.")


def _record_foreign_type(data, table):
    """Add the type of a file, ``package/Class``, to the table of omissions if it is not of compas.

    `data` are those of the whole file.
    """
    kind = data.get("dtype") or data.get("datatype")
    if not isinstance(kind, str) or "/" not in kind:
        return
    package = kind.split("/")[0].split(".")[0]
    if package.partition("_")[0] not in _PACKAGES and package not in _PACKAGES:
        why = "of another program; fields with the names of compas are read as those of compas"
        table.add(f"type {kind:.80}", "dtype", why)


def _is_net(data: Any) -> bool:
    """Return whether JSON data have the fields of a network or a mesh of compas."""
    return isinstance(data, dict) and (
        isinstance(data.get("vertex"), dict)
        or (isinstance(data.get("node"), dict) and "edge" in data)
    )


def _search_nets(data: Any, key_path: list[Any]) -> Iterator[tuple[list[Any], Any]]:
    """Generate the nets (see `_is_net`) in nested JSON data: pairs (keys that lead to one, object).

    `key_path` has the keys that lead to `data` itself. Nets inside of a net are left out, as are
    those below `_DEEPEST` levels.
    """
    if _is_net(data):
        yield key_path, data
    elif len(key_path) < _DEEPEST:
        for key, value in _keys_and_values(data):
            yield from _search_nets(value, [*key_path, key])


def _keys_and_values(data: Any) -> list[tuple[Any, Any]]:
    """Return the pairs (key, value) of an object, or (index, item) of a list; [] for other data."""
    if isinstance(data, dict):
        return list(data.items())
    return list(enumerate(data)) if isinstance(data, list) else []


def _format_key_path(key_path: list[Any]) -> str:
    """Return the keys that lead to a place in nested data as text, such as ``scene.objects[2]``."""
    return "".join(f"[{key}]" if isinstance(key, int) else f".{key}" for key in key_path).lstrip(
        "."
    )


def _record_contents_beside_net(data: Any, key_path: list[Any], table: Omissions) -> None:
    """Add contents of a file beside its net, apart from other nets, to the table of omissions.

    `data` are those of the whole file, and `key_path` has the keys that lead to the net.
    """
    for depth, key in enumerate(key_path):
        for other, value in _keys_and_values(data):
            if other == key or other in _WRAPPING or not value or any(_search_nets(value, [])):
                continue
            kind = value.get("dtype") if isinstance(value, dict) else None
            what = f"object {kind!r}" if isinstance(kind, str) else "field"
            table.add(f"{what:.80} beside the net", _format_key_path([*key_path[:depth], other]))
        data = data[key]
