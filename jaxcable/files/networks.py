"""Nets from JSON files of compas and jax_fdm: networks (graphs) and meshes."""

from __future__ import annotations

from os import PathLike

import numpy as np

from .nets import Net
from .reading import LARGEST, FileError, read_json

_SUPPORTS = ("is_support", "is_anchor", "is_fixed")  # of jax_fdm, compas_fofin, compas_fd


def read_network(path: str | PathLike[str], largest: int = LARGEST) -> Net:
    """Read a network, graph or mesh that compas 1 or 2, compas_fd or jax_fdm has written as JSON.

    The net has the positions of nodes, supports (``is_support``, ``is_anchor`` or ``is_fixed``),
    loads ``px, py, pz`` in newtons, edges, and force densities ``q`` in N/m; an edge without ``q``,
    or with zero, has no force density. Edges with a negative force density become bars. The edges
    of a mesh are those of its faces.

    Args:
        path: path of the file.
        largest: largest size that is read, bytes.

    Returns:
        `Net`; ``net.scene(axial_stiffness=...)`` makes a scene of it.

    Raises:
        FileError: the file holds no such net; the message names the field.
        OSError: there is no such file, or it cannot be read.

    Example:
        >>> import json, tempfile, pathlib
        >>> node = {"0": {"x": 0, "y": 0, "is_support": True}, "1": {"x": 1, "y": 0}}
        >>> data = {"node": node, "edge": {"0": {"1": {"q": 2.0}}}}
        >>> path = pathlib.Path(tempfile.mkdtemp()) / "net.json"
        >>> _ = path.write_text(json.dumps({"dtype": "compas.datastructures/Graph", "data": data}))
        >>> jc.files.read_network(path).values["force_density"].tolist()
        [2.0]
    """
    data = read_json(path, largest)
    try:
        return _net(data)
    except FileError as error:
        raise FileError(f"{path}: {error}") from None


def _net(data):
    """The `Net` in the data of a file."""
    for key in ("data", "value"):  # compas 2 and 1 wrap the data of their objects
        if isinstance(data.get(key), dict):
            data = data[key]
    mesh = "vertex" in data
    kind = "vertex" if mesh else "node"
    nodes = _table(data, kind)
    if not nodes:
        raise FileError(f"{kind}: missing; no network or mesh of compas")
    defaults = data.get(f"default_{kind}_attributes") or data.get("dva" if mesh else "dna") or {}
    names = {name: k for k, name in enumerate(nodes)}
    places, fixed, loads = [], [], []
    for name, attributes in nodes.items():
        where = f"{kind}[{name!r}]"
        if not isinstance(attributes, dict) or not isinstance(defaults, dict):
            raise FileError(f"{where}: expected an object of attributes")
        attributes = {**defaults, **attributes}
        places.append([_number(attributes, axis, where) for axis in "xyz"])
        fixed.append([any(attributes.get(word) is True for word in _SUPPORTS)] * 3)
        loads.append([_number(attributes, "p" + axis, where) for axis in "xyz"])
    edges = _mesh_edges(data, names) if mesh else _edges(data, names)
    if not edges:
        raise FileError("edge: the network has no edges")
    default = data.get("default_edge_attributes") or data.get("dea") or {}
    default = default if isinstance(default, dict) else {}
    densities = np.array(
        [_number({**default, **attributes}, "q", f"edge {ij}") for ij, attributes in edges.items()]
    )
    loads = np.array(loads)
    known = densities != 0
    return Net(
        nodes=np.array(places),
        links=np.array(list(edges), np.int32),
        fixed=np.array(fixed),
        loads=loads if loads.any() else None,
        values={"force_density": np.where(known, densities, np.nan)} if known.any() else {},
        kinds=tuple("bar" if q < 0 else "cable" for q in densities),
        names=tuple(names),
    )


def _table(data, key):
    """The object under a key, a dict; empty if there is none."""
    found = data.get(key, {})
    if not isinstance(found, dict):
        raise FileError(f"{key}: expected an object")
    return found


def _number(attributes, key, where):
    """The finite number under a key of attributes; 0 if there is none."""
    value = attributes.get(key)
    value = 0.0 if value is None else value
    number = not isinstance(value, bool) and isinstance(value, int | float)
    if not number or not abs(value) < 1e300:
        raise FileError(f"{where}.{key}: expected a finite number, got {value!r:.40}")
    return float(value)


def _edges(data, names):
    """Edges of a network, each once: dict from pairs of node numbers to attributes."""
    found = {}
    for i, others in _table(data, "edge").items():
        if not isinstance(others, dict):
            raise FileError(f"edge[{i!r}]: expected an object")
        for j, attributes in others.items():
            attributes = {} if attributes is None else attributes
            if not isinstance(attributes, dict):
                raise FileError(f"edge[{i!r}][{j!r}]: expected an object of attributes")
            _put(found, names, i, j, attributes, f"edge[{i!r}][{j!r}]")
    return found


def _mesh_edges(data, names):
    """Edges of the faces of a mesh, each once: dict from pairs of node numbers to attributes."""
    of_pair = {}
    for key, attributes in _table(data, "edgedata").items():
        pair = frozenset(key.replace("(", "").replace(")", "").replace(",", "-").split("-"))
        of_pair[frozenset(word.strip() for word in pair)] = (
            attributes if isinstance(attributes, dict) else {}
        )
    found = {}
    for name, face in _table(data, "face").items():
        if not isinstance(face, list) or len(face) < 2:
            raise FileError(f"face[{name!r}]: expected a list of vertices")
        for i, j in zip(face, face[1:] + face[:1], strict=True):
            attributes = of_pair.get(frozenset((str(i), str(j))), {})
            _put(found, names, str(i), str(j), attributes, f"face[{name!r}]")
    return found


def _put(found, names, i, j, attributes, where):
    """Add an edge between two named nodes to a dict, unless it is in it already."""
    for name in (i, j):
        if name not in names:
            raise FileError(f"{where}: there is no node {name!r}")
    pair = names[i], names[j]
    if pair[0] == pair[1]:
        raise FileError(f"{where}: an edge from a node to itself")
    if pair[::-1] not in found:
        found.setdefault(pair, attributes)
