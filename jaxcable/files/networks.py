"""Read nets from JSON files of compas and jax_fdm: networks (graphs) and meshes."""

from __future__ import annotations

from os import PathLike
from typing import Any

import numpy as np

from ..common.units import UnitsLike, as_units
from . import attributes as about
from .distributed_loads import DistributedLoads, add_missing_distributed_loads
from .net_search import FoundNet, find_net
from .net_units import net_in_si_or_warn
from .nets import Net
from .omissions import Omissions
from .reading import LARGEST, FileError, read_json

_LISTED = frozenset(
    "node edge vertex face edgedata facedata dna dea dva dfa default_node_attributes "
    "default_edge_attributes default_vertex_attributes default_face_attributes".split()
)
_ORDER = frozenset("max_node max_vertex max_face max_edge adjacency halfedge name".split())
"""Fields of a net that follow from others."""


def read_network(
    path: str | PathLike[str], largest: int = LARGEST, *, units: UnitsLike | None = None
) -> Net:
    """Read a network, graph or mesh that compas 1 or 2, compas_fd or jax_fdm has written as JSON.

    The file may also be the session of a program, such as compas_fofin: its first net is read.

    - **Nodes** have positions and supports: ``is_support``, ``is_anchor`` or ``is_fixed`` (true or
      1).
    - **Edges** (in a mesh, the sides of its faces) have force densities ``q``, N/m; zero means
      none. Without ``q``, a force ``f`` or ``force``, N, is divided by the length in the file.
      Edges with a negative force density become bars. If no edge has a force density, unstressed
      lengths ``l0``, m, are read. ``group`` names the group of an edge.
    - **Loads** ``px, py, pz`` along x, y, z are in N of nodes, in N/m of edges, in N/m2 of faces.
      Those of edges and faces become loads of nodes as in jax_fdm, in the positions of the file.
      Half of the load of an edge acts at each end. Each side of a face takes the load on the
      triangle between it and the mean of the corners. Files of results contain these loads in
      those of nodes already: if the loads of nodes alone are in balance with ``q``, none is added.

    Everything else that is not empty is counted in an `InputWarning` and in ``Net.omissions``. Not
    counted are names, colors, and results: forces and lengths that agree with ``q`` and the
    positions, ``l0`` beside ``q``, residuals, and attributes whose names begin with ``_``.

    Args:
        path: path of the file.
        largest: largest size that is read, bytes.

    Options:
        units: units of all numbers in the file, such as "kN, m" (see `Units`); default: SI units.
            An `InputWarning` asks for them if the net is larger than 1 km.

    Returns:
        `Net`, in SI units; ``net.scene(axial_stiffness=...)`` makes a scene of it.

    Raises:
        FileError: the file holds no such net; the message names the field.
        ValueError: unknown units.
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
    shown = None if units is None else as_units(units)
    data = read_json(path, largest)
    with Omissions(path) as table:
        net = _net_from_data(find_net(data, table), table)
    return net_in_si_or_warn(net, path, shown)


def _net_from_data(found: FoundNet, table: Omissions) -> Net:
    """Make the `Net` of a network or mesh in JSON data.

    What is not read is added to `table`, the omissions.
    """
    data, inside = found
    mesh = "vertex" in data
    kind = "vertex" if mesh else "node"
    nodes = _optional_object(data, kind, inside)
    if not nodes:
        raise FileError(f"{inside}{kind}: missing; no network or mesh of compas")
    defaults = _default_attributes(data, kind, "dva" if mesh else "dna")
    positions, fixed, own = [], [], []
    for name, given in nodes.items():
        where = f"{kind}[{name!r}]"
        node = about.with_defaults(given, defaults, inside + where)
        about.record_unread_attributes(node, about.NODE_KEYS, f"a {kind}", where, table)
        where = inside + where
        positions.append(about.node_coordinates(node, where))
        own.append(about.load_vector(node, where))
        # every flag is looked at, so that none is wrong
        fixed.append([max([about.read_flag(node, word, where) for word in about.SUPPORT_KEYS])] * 3)
    names = {name: k for k, name in enumerate(nodes)}
    faces = _mesh_faces(data, names, inside) if mesh else {}
    found = (
        _mesh_edges(data, faces, names, table)
        if mesh
        else _network_edges(data, names, inside, table)
    )
    if not found:
        what = "face: the mesh has no faces, hence" if mesh else "edge: the network has"
        raise FileError(f"{inside}{what} no edges")
    links, edges = _select_edges_of_net(
        found, _default_attributes(data, "edge", "dea"), list(names)
    )
    if not edges:
        raise FileError(f"{inside}edge: no edge of the mesh is one of the net")
    places = np.array(positions)
    lengths = np.linalg.norm(places[links[:, 1]] - places[links[:, 0]], axis=1)
    densities, on_edges = _edge_densities_and_loads(edges, lengths, table)
    on_faces = _face_loads(data, faces, table)
    _record_unread_fields(data, table)
    held = np.array(fixed)
    spread = DistributedLoads(places, links, on_edges, list(faces.values()), on_faces)
    loads = add_missing_distributed_loads(np.array(own), spread, densities, held[:, 0], table)
    return Net(
        nodes=places,
        links=links,
        fixed=held,
        loads=loads if loads.any() else None,
        values=_force_densities_or_lengths(edges, densities, table),
        **_edge_kinds_and_groups(edges, densities, table),
        names=tuple(names),
        omissions=table.rows(),
    )


def _select_edges_of_net(attributes, defaults, names):
    """Return the edges that their flags ``_is_edge`` and ``is_edge`` do not exclude from the net.

    Returns:
        Node numbers, [n_edge, 2], and for each edge a pair: its place in the file, in words, and
        its attributes.

    Args:
        attributes: attributes of edges by pairs of node numbers.
        defaults: attributes that all edges have unless they state others.
        names: names of the nodes in order, a list.
    """
    pairs, edges = [], []
    for pair, given in attributes.items():
        where, edge = f"edge {names[pair[0]]}-{names[pair[1]]}", {**defaults, **given}
        flags = [
            about.read_flag(edge, word, where, absent=True) for word in ("_is_edge", "is_edge")
        ]
        if all(flags):
            pairs.append(pair)
            edges.append((where, edge))
    return np.array(pairs, np.int32), edges


def _edge_densities_and_loads(edges, lengths, table):
    """Return the force densities, [n_edge], N/m, and line loads, [n_edge, 3], N/m, of edges.

    `edges` are pairs (place in the file, attributes), and `lengths` are those of the edges, m.
    Attributes that are not read are counted in the omissions `table`.
    """
    densities, loads = [], []
    for (where, edge), length in zip(edges, lengths, strict=True):
        densities.append(about.edge_force_density(edge, length, where))
        loads.append(about.load_vector(edge, where))
        about.record_unread_attributes(edge, about.EDGE_KEYS, "an edge", where, table)
        about.record_conflicting_results(edge, densities[-1], float(length), where, table)
    return np.array(densities), np.array(loads)


def _force_densities_or_lengths(edges, densities, table):
    """Return the force densities of the edges, N/m, or if none has one the unstressed lengths, m.

    The result is a dict from the name of the property in ``Net.values`` to [n_edge], NaN where
    there is no value; empty if no edge has either. `edges` are pairs (place in the file,
    attributes), `densities` are [n_edge] with 0 for none, and `table` counts lengths that are not
    read.
    """
    known = densities != 0
    if known.any():
        for (where, edge), stated in zip(edges, known, strict=True):
            if not stated and not about.is_empty(edge.get("l0")):
                why = "other edges have force densities"
                table.add("attribute 'l0' of an edge", where, why)
        return {"force_density": np.where(known, densities, np.nan)}
    rest = np.array([about.read_finite_number(edge, "l0", where) for where, edge in edges])
    if (rest < 0).any():
        where, _ = edges[int((rest < 0).argmax())]
        raise FileError(f"{where}.l0: expected a length, got {rest.min()}")
    return {"rest_length": np.where(rest > 0, rest, np.nan)} if rest.any() else {}


def _edge_kinds_and_groups(edges, densities, table):
    """Return {"kinds": "cable" or "bar" of each edge, "groups": their group names or None}.

    A negative force density makes all edges of its group bars. The groups are None if there is only
    one. `edges` are pairs (place in the file, attributes), and `densities` [n_edge], N/m.
    """
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


def _face_loads(data, faces, table):
    """Return the loads of faces per area, [n_face, 3], N/m2, in the order of `faces`.

    `data` are those of the mesh, and `faces` has the node numbers around each face by its name.
    Attributes that are not read are added to `table`, the omissions.
    """
    defaults = _default_attributes(data, "face", "dfa")
    given = _optional_object(data, "facedata", "")
    for name in given.keys() - faces.keys():
        table.add("attributes of a face that is not there", f"facedata[{name!r}]")
    loads = []
    for name in faces:
        where = f"facedata[{name!r}]"
        face = about.with_defaults(given.get(name), defaults, where)
        about.record_unread_attributes(face, about.FACE_KEYS, "a face", where, table)
        loads.append(about.load_vector(face, where))
    return np.array(loads).reshape(-1, 3)


def _record_unread_fields(data, table):
    """Add to the omissions `table` the fields of a net other than nodes, edges and faces."""
    whole = data.get("attributes")
    if isinstance(whole, dict):
        # the density of surfaces; without a thickness, which is counted, it has no weight
        about.record_unread_attributes(
            whole, frozenset(("density",)), "the whole", "attributes", table
        )
    for key, value in data.items():
        if key not in _LISTED | _ORDER | {
            "attributes"
        } | about.APPEARANCE_KEYS and not about.is_empty(value):
            table.add(f"field {key!r}", "", about.REASONS.get(key, ""))


def _optional_object(data, key, inside):
    """Return the JSON object under `key`, {} if it is missing or null.

    Raise FileError for other data; `inside` is the place of `data` in the file, before the key.
    """
    found = data.get(key)
    found = {} if found is None else found
    if not isinstance(found, dict):
        raise FileError(f"{inside}{key}: expected an object")
    return found


def _default_attributes(data, kind, short):
    """Return the default attributes that a file states for a kind ("node", "edge", "face"), a dict.

    `short` is the name of the field in older files, such as "dna".
    """
    for key in (f"default_{kind}_attributes", short):
        if data.get(key) is not None:
            return _optional_object(data, key, "")
    return {}


def _network_edges(data, names, inside, table):
    """Return the edges of a network, each once: a dict from pairs of node numbers to attributes.

    `names` has the number of each node; `inside` is the place of the net in the file, for messages.
    """
    found: dict[tuple[int, int], Any] = {}
    for i, others in _optional_object(data, "edge", inside).items():
        if not isinstance(others, dict):
            raise FileError(f"{inside}edge[{i!r}]: expected an object")
        for j, given in others.items():
            where = f"edge[{i!r}][{j!r}]"
            _add_edge(
                found, names, (i, j), about.with_defaults(given, {}, inside + where), where, table
            )
    return found


def _mesh_faces(data, names, inside):
    """Return the faces of a mesh: a dict from the name of a face to the node numbers around it.

    `names` has the number of each node; `inside` is the place of the mesh in the file.
    """
    found = {}
    for name, face in _optional_object(data, "face", inside).items():
        where = f"{inside}face[{name!r}]"
        if not isinstance(face, list) or len(face) < 2:
            raise FileError(f"{where}: expected a list of vertices")
        for vertex in map(str, face):
            if vertex not in names:
                raise FileError(f"{where}: there is no node {vertex!r}")
        found[name] = [names[str(vertex)] for vertex in face]
    return found


def _mesh_edges(data, faces, names, table):
    """Return the sides of the faces, each once: a dict from pairs of node numbers to attributes.

    `faces` has the node numbers around each face by its name, and `names` the number of each node.
    """
    of_pair = {}
    for key, given in _optional_object(data, "edgedata", "").items():
        words = key.replace("(", "").replace(")", "").replace(",", "-").split("-")
        where = f"edgedata[{key!r}]"
        of_pair[frozenset(word.strip(" '\"") for word in words)] = (
            where,
            about.with_defaults(given, {}, where),
        )
    found: dict[tuple[int, int], Any] = {}
    shown, used = list(names), set()
    for name, ring in faces.items():
        for i, j in zip(ring, ring[1:] + ring[:1], strict=True):
            pair = frozenset((shown[i], shown[j]))
            used.add(pair)
            if (j, i) not in found:
                given = of_pair.get(pair, ("", {}))[1]
                _add_edge(found, names, (shown[i], shown[j]), given, f"face[{name!r}]", table)
    for pair in of_pair.keys() - used:
        where, given = of_pair[pair]
        if not all(map(about.is_empty, given.values())):
            table.add("edge that is no side of a face", where)
    return found


def _add_edge(edges, names, ends, attributes, where, table):
    """Add an edge between two named nodes to the dict `edges`, unless it is there already.

    `names` has the number of each node, `ends` the names of two; `where` is the place in the file.
    An edge that occurs again with other attributes is counted in `table`, the omissions. Raise
    FileError for an unknown node, or an edge from a node to itself.
    """
    for name in ends:
        if name not in names:
            raise FileError(f"{where}: there is no node {name!r}")
    pair = names[ends[0]], names[ends[1]]
    if pair[0] == pair[1]:
        raise FileError(f"{where}: an edge from a node to itself")
    there = edges.get(pair, edges.get(pair[::-1]))
    if there is None:
        edges[pair] = attributes
    elif there != attributes:
        table.add("edge that occurs again", where, "with other attributes; the first is read")
