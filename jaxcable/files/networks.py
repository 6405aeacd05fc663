"""Nets from JSON files of compas and jax_fdm: networks (graphs) and meshes."""

from __future__ import annotations

from os import PathLike
from typing import Any

import numpy as np

from . import attributes as about
from .finding import Found, find_net
from .nets import Net
from .omissions import Omissions
from .reading import LARGEST, FileError, read_json
from .spreading import Spread, nodal_loads

_LISTED = frozenset(
    "node edge vertex face edgedata facedata dna dea dva dfa default_node_attributes "
    "default_edge_attributes default_vertex_attributes default_face_attributes".split()
)
_ORDER = frozenset("max_node max_vertex max_face max_edge adjacency halfedge name".split())
"""Fields of a net that follow from others."""


def read_network(path: str | PathLike[str], largest: int = LARGEST) -> Net:
    """Read a network, graph or mesh that compas 1 or 2, compas_fd or jax_fdm has written as JSON.

    The file may also be the session of a program, such as compas_fofin: its first net is read. The
    net has

    - positions of nodes, and supports: ``is_support``, ``is_anchor`` or ``is_fixed`` (true or 1);
    - edges (of a mesh those of its faces) with force densities ``q``, N/m; zero is none. Of an edge
      without one a force ``f`` or ``force``, N, over its length in the file is it. Edges with a
      negative force density become bars. If none has one, unstressed lengths ``l0``, m, are
      read. ``group`` names the group of an edge;
    - loads ``px, py, pz``: of nodes in newtons, of edges in N/m, of faces in N/m2, along x, y, z.
      Loads of edges and faces become loads of nodes as in jax_fdm, in the positions of the file:
      half of the load of an edge acts at each end; the load of a face acts through its edges, each
      with the triangle up to the mean of the corners. Files of results have these loads in those of
      nodes already: if the loads of nodes alone are in balance with ``q``, none is added.

    Everything else that is not empty is counted in an `InputWarning` and in ``Net.omissions``. Not
    counted are names, colors, and results: forces and lengths that agree with ``q`` and the
    positions, ``l0`` beside ``q``, residuals, and attributes whose names begin with ``_``.

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
    with Omissions(path) as table:
        return _net(find_net(data, table), table)


def _net(found: Found, table: Omissions) -> Net:
    """The `Net` in the data of a file."""
    data, inside = found
    mesh = "vertex" in data
    kind = "vertex" if mesh else "node"
    nodes = _table(data, kind, inside)
    if not nodes:
        raise FileError(f"{inside}{kind}: missing; no network or mesh of compas")
    defaults = _defaults(data, kind, "dva" if mesh else "dna")
    positions, fixed, own = [], [], []
    for name, given in nodes.items():
        where = f"{kind}[{name!r}]"
        node = about.merged(given, defaults, inside + where)
        about.count_unread(node, about.NODE, f"a {kind}", where, table)
        where = inside + where
        positions.append(about.coordinates(node, where))
        own.append(about.load(node, where))
        # every flag is looked at, so that none is wrong
        fixed.append([max([about.flag(node, word, where) for word in about.SUPPORTS])] * 3)
    names = {name: k for k, name in enumerate(nodes)}
    faces = _faces(data, names, inside) if mesh else {}
    found = _sides(data, faces, names, table) if mesh else _edges(data, names, inside, table)
    if not found:
        what = "face: the mesh has no faces, hence" if mesh else "edge: the network has"
        raise FileError(f"{inside}{what} no edges")
    links, edges = _included(found, _defaults(data, "edge", "dea"), list(names))
    if not edges:
        raise FileError(f"{inside}edge: no edge of the mesh is one of the net")
    places = np.array(positions)
    lengths = np.linalg.norm(places[links[:, 1]] - places[links[:, 0]], axis=1)
    densities, on_edges = _numbers_of_edges(edges, lengths, table)
    on_faces = _loads_of_faces(data, faces, table)
    _count_whole(data, table)
    held = np.array(fixed)
    spread = Spread(places, links, on_edges, list(faces.values()), on_faces)
    loads = nodal_loads(np.array(own), spread, densities, held[:, 0], table)
    return Net(
        nodes=places,
        links=links,
        fixed=held,
        loads=loads if loads.any() else None,
        values=_values(edges, densities, table),
        **_kinds(edges, densities, table),
        names=tuple(names),
        omissions=table.table(),
    )


def _included(found, of_all, names):
    """The edges that belong to the net: nodes [n_edge, 2], and pairs (place, attributes)."""
    pairs, edges = [], []
    for pair, given in found.items():
        where, edge = f"edge {names[pair[0]]}-{names[pair[1]]}", {**of_all, **given}
        flags = [about.flag(edge, word, where, absent=True) for word in ("_is_edge", "is_edge")]
        if all(flags):
            pairs.append(pair)
            edges.append((where, edge))
    return np.array(pairs, np.int32), edges


def _numbers_of_edges(edges, lengths, table):
    """Force densities [n_edge] and loads per length [n_edge, 3]; counts what is not read."""
    densities, loads = [], []
    for (where, edge), length in zip(edges, lengths, strict=True):
        densities.append(about.force_density(edge, length, where))
        loads.append(about.load(edge, where))
        about.count_unread(edge, about.EDGE, "an edge", where, table)
        about.count_results(edge, densities[-1], float(length), where, table)
    return np.array(densities), np.array(loads)


def _values(edges, densities, table):
    """Force densities, or else unstressed lengths, by name of the property."""
    known = densities != 0
    if known.any():
        for (where, edge), stated in zip(edges, known, strict=True):
            if not stated and not about.empty(edge.get("l0")):
                why = "other edges have force densities"
                table.add("attribute 'l0' of an edge", where, why)
        return {"force_density": np.where(known, densities, np.nan)}
    rest = np.array([about.number(edge, "l0", where) for where, edge in edges])
    if (rest < 0).any():
        where, _ = edges[int((rest < 0).argmax())]
        raise FileError(f"{where}.l0: expected a length, got {rest.min()}")
    return {"rest_length": np.where(rest > 0, rest, np.nan)} if rest.any() else {}


def _kinds(edges, densities, table):
    """Kinds and groups of the edges; a group with a negative force density is one of bars."""
    labels = []
    for where, edge in edges:
        label = edge.get("group")
        if not isinstance(label, str | None):
            table.add("attribute 'group' of an edge", where, "is no text")
            label = None
        labels.append(label or "")
    negative = (densities < 0).tolist()
    several = len(set(labels)) > 1
    pushed = {label for label, bar in zip(labels, negative, strict=True) if bar and label}
    bars = [
        bar or (several and label in pushed) for label, bar in zip(labels, negative, strict=True)
    ]
    kinds = tuple("bar" if bar else "cable" for bar in bars)
    groups = tuple(label or f"{kind}s" for label, kind in zip(labels, kinds, strict=True))
    return {"kinds": kinds, "groups": groups if several else None}


def _loads_of_faces(data, faces, table):
    """Loads of faces per area, [n_face, 3]; counts attributes that are not read."""
    defaults = _defaults(data, "face", "dfa")
    given = _table(data, "facedata", "")
    for name in given.keys() - faces.keys():
        table.add("attributes of a face that is not there", f"facedata[{name!r}]")
    loads = []
    for name in faces:
        where = f"facedata[{name!r}]"
        face = about.merged(given.get(name), defaults, where)
        about.count_unread(face, about.FACE, "a face", where, table)
        loads.append(about.load(face, where))
    return np.array(loads).reshape(-1, 3)


def _count_whole(data, table):
    """Count what a net has beside nodes, edges and faces."""
    whole = data.get("attributes")
    if isinstance(whole, dict):
        # the density of surfaces; without a thickness, which is counted, it has no weight
        about.count_unread(whole, frozenset(("density",)), "the whole", "attributes", table)
    for key, value in data.items():
        if key not in _LISTED | _ORDER | {"attributes"} | about.LOOKS and not about.empty(value):
            table.add(f"field {key!r}", "", about.WHY.get(key, ""))


def _table(data, key, inside):
    """The object under a key, a dict; empty if there is none."""
    found = data.get(key)
    found = {} if found is None else found
    if not isinstance(found, dict):
        raise FileError(f"{inside}{key}: expected an object")
    return found


def _defaults(data, kind, short):
    """Attributes that a file states for all nodes, edges or faces, a dict."""
    for key in (f"default_{kind}_attributes", short):
        if data.get(key) is not None:
            return _table(data, key, "")
    return {}


def _edges(data, names, inside, table):
    """Edges of a network, each once: dict from pairs of node numbers to attributes."""
    found: dict[tuple[int, int], Any] = {}
    for i, others in _table(data, "edge", inside).items():
        if not isinstance(others, dict):
            raise FileError(f"{inside}edge[{i!r}]: expected an object")
        for j, given in others.items():
            where = f"edge[{i!r}][{j!r}]"
            _put(found, names, (i, j), about.merged(given, {}, inside + where), where, table)
    return found


def _faces(data, names, inside):
    """Faces of a mesh: dict from their names to node numbers around them."""
    found = {}
    for name, face in _table(data, "face", inside).items():
        where = f"{inside}face[{name!r}]"
        if not isinstance(face, list) or len(face) < 2:
            raise FileError(f"{where}: expected a list of vertices")
        for vertex in map(str, face):
            if vertex not in names:
                raise FileError(f"{where}: there is no node {vertex!r}")
        found[name] = [names[str(vertex)] for vertex in face]
    return found


def _sides(data, faces, names, table):
    """Edges of the faces of a mesh, each once: dict from pairs of node numbers to attributes."""
    of_pair = {}
    for key, given in _table(data, "edgedata", "").items():
        words = key.replace("(", "").replace(")", "").replace(",", "-").split("-")
        where = f"edgedata[{key!r}]"
        of_pair[frozenset(word.strip(" '\"") for word in words)] = (
            where,
            about.merged(given, {}, where),
        )
    found: dict[tuple[int, int], Any] = {}
    shown, used = list(names), set()
    for name, ring in faces.items():
        for i, j in zip(ring, ring[1:] + ring[:1], strict=True):
            pair = frozenset((shown[i], shown[j]))
            used.add(pair)
            if (j, i) not in found:
                given = of_pair.get(pair, ("", {}))[1]
                _put(found, names, (shown[i], shown[j]), given, f"face[{name!r}]", table)
    for pair in of_pair.keys() - used:
        where, given = of_pair[pair]
        if not all(map(about.empty, given.values())):
            table.add("edge that is no side of a face", where)
    return found


def _put(found, names, ends, given, where, table):
    """Add an edge between two named nodes to a dict, unless it is in it already."""
    for name in ends:
        if name not in names:
            raise FileError(f"{where}: there is no node {name!r}")
    pair = names[ends[0]], names[ends[1]]
    if pair[0] == pair[1]:
        raise FileError(f"{where}: an edge from a node to itself")
    there = found.get(pair, found.get(pair[::-1]))
    if there is None:
        found[pair] = given
    elif there != given:
        table.add("edge that occurs again", where, "with other attributes; the first is read")
