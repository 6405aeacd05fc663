"""Write structures and results as JSON of compas: a graph, or a mesh if its faces are given."""

from __future__ import annotations

import json
from os import PathLike
from pathlib import Path
from typing import Any

import numpy as np

from ..analysis.solution import Solution
from ..common import checks
from ..common.types import ArrayLike, Int
from ..common.writing import atomic_write
from ..model.result_parts import named_groups_of, straight_pieces, values_per_group
from ..model.structure import Structure
from .end_of_analysis import concatenate_groups, end_state, require_suffix
from .omissions import Omissions


def save_network(
    path: str | PathLike[str],
    structure: Structure,
    solution: Solution | None = None,
    *,
    faces: Int[ArrayLike, "n_face 3or4"] | None = None,
) -> list[Path]:
    """Write a structure as a Graph, or a Mesh, that compas 2 opens and `read_network` reads.

    - Nodes have ``x, y, z`` (m), and ``is_support`` where all displacements are held. With a
      solution they also have the load ``px, py, pz`` (N). Supports in some directions only are left
      out, with an `InputWarning`.
    - Edges are the straight pieces of elements, with ``group`` and the length ``l`` (m). With a
      solution they also have the force ``f`` (N), the force density ``q = f / l`` (N/m) and, for
      elements of two nodes, the unstressed length ``l0`` (m). The force of a catenary is the mean
      of the tensions at its ends.

    Args:
        path: path of the file, ending with .json.
        structure: `Structure`.
        solution: its `Solution`, for positions and forces at its end; if it has failed, those of
            the last converged state. None writes the nodes as they are in the structure.

    Options:
        faces: node numbers around the faces of a net, as from `net_faces`; every link must be a
            side of one. None writes a Graph.

    Returns:
        Paths of the files written, a list.

    Raises:
        ValueError: another suffix, two elements between the same nodes, a side of a face without an
            element or an element that is none, a batch, another structure than that of the
            solution, numbers that are not finite.
        OSError: the file cannot be written.

    Example:
        >>> import tempfile, pathlib
        >>> structure, phases = jc.scenes.flat_net(load=15.0)
        >>> path = pathlib.Path(tempfile.mkdtemp()) / "net.json"
        >>> solution = jc.solve(structure, phases)
        >>> _ = jc.files.save_network(path, structure, solution)
        >>> net = jc.files.read_network(path)
        >>> bool((net.nodes == solution.positions).all()), len(net.links)
        (True, 12)
    """
    path = require_suffix(path, ".json")
    last = None if solution is None else end_state(structure, solution)
    places = np.asarray(structure.nodes if last is None else last.positions, float)
    loads = None if last is None else np.asarray(last.load, float)[:, :3]
    if not np.isfinite(places).all():
        raise ValueError(f"nodes[{int(np.argwhere(~np.isfinite(places))[0][0])}]: not finite")
    count = structure.supports.fixed(structure.n_node)[:, :3].sum(axis=1)
    table = Omissions(path)
    for k in np.flatnonzero((count > 0) & (count < 3)).tolist():
        table.add(
            "support in some directions", f"node {k}", "in compas a node is fully fixed or free"
        )
    nodes: dict[str, Any] = {}
    for k, place in enumerate(places.tolist()):
        nodes[str(k)] = {**dict(zip("xyz", place, strict=True)), "is_support": bool(count[k] == 3)}
        if loads is not None:
            nodes[str(k)] |= dict(zip(("px", "py", "pz"), loads[k].tolist(), strict=True))
    edges = _edge_attributes(structure, last, places)
    kind, data = "Graph", _graph_data(nodes, edges)
    if faces is not None:
        kind, data = "Mesh", _mesh_data(nodes, edges, faces)
    whole = {"dtype": f"compas.datastructures/{kind}", "data": {"attributes": {}, **data}}
    text = json.dumps(whole, allow_nan=False)
    with atomic_write(path) as stream:
        stream.write(text + "\n")
    table.warn()
    return [path]


def _edge_attributes(structure, last, places):
    """Return a dict from node pairs to attributes of edges, the straight segments of elements.

    Forces (N) and unstressed lengths (m) are those of the state `last`, none if it is None;
    `places` are the positions of the nodes, [n_node, 3], m.
    """
    ends, element, owner = straight_pieces(structure.groups)
    count = np.bincount(element)
    names = [name or type(group).__name__ for name, group in named_groups_of(structure)]
    force = rest = None
    if last is not None:
        force, rest = (
            concatenate_groups(structure.groups, values_per_group(structure, values))
            for values in (last.tension, last.rest_length)
        )
    lengths = np.linalg.norm(places[ends[:, 1]] - places[ends[:, 0]], axis=1)
    found: dict[tuple[int, int], dict[str, Any]] = {}
    for k, (i, j) in enumerate(ends.tolist()):
        if (i, j) in found or (j, i) in found:
            raise ValueError(f"elements: two join nodes {i} and {j}; compas allows one edge there")
        about: dict[str, Any] = {"group": names[owner[k]], "l": float(lengths[k])}
        if force is not None and np.isfinite(force[element[k]]) and lengths[k] > 0:
            pull = float(force[element[k]])
            about |= {"f": pull, "q": pull / float(lengths[k])}
            if count[element[k]] == 1 and np.isfinite(rest[element[k]]):
                about["l0"] = float(rest[element[k]])
        found[i, j] = about
    return found


def _graph_data(nodes, edges):
    """Return the JSON data of a compas Graph.

    `nodes` are attributes by the name of the node, and `edges` by pairs of node numbers.
    """
    table: dict[str, Any] = {name: {} for name in nodes}
    for (i, j), about in edges.items():
        table[str(i)][str(j)] = about
    return {
        "default_node_attributes": {"x": 0.0, "y": 0.0, "z": 0.0, "is_support": False},
        "default_edge_attributes": {},
        "node": nodes,
        "edge": table,
        "max_node": len(nodes) - 1,
    }


def _mesh_data(nodes, edges, faces):
    """Return the JSON data of a compas Mesh; ValueError for faces whose sides are not the edges.

    `nodes` are attributes by the name of the node, `edges` by pairs of node numbers, and `faces`
    node numbers, [n_face, 3 or 4].
    """
    array = np.asarray(faces)
    if array.ndim != 2 or array.shape[1] not in (3, 4):
        raise ValueError(f"faces: expected node numbers [n, 3] or [n, 4], got {array.shape}")
    array = checks.as_indices(array, "faces", width=array.shape[1])
    checks.require_known_nodes(array, len(nodes), "faces")
    rings = [list(dict.fromkeys(face)) for face in array.tolist()]  # triangles repeat a node
    pairs = [pair for ring in rings for pair in zip(ring, ring[1:] + ring[:1], strict=True)]
    sides = {tuple(sorted(pair)) for pair in pairs}
    about = {tuple(sorted(pair)): value for pair, value in edges.items()}
    for pair in sorted(sides ^ set(about)):
        told = "is no side of a face" if pair in about else "is the side of a face, but no element"
        raise ValueError(f"faces: the link {list(pair)} {told}; without faces a Graph is written")
    return {
        "default_vertex_attributes": {"x": 0.0, "y": 0.0, "z": 0.0, "is_support": False},
        "default_edge_attributes": {},
        "default_face_attributes": {},
        "vertex": nodes,
        "face": {str(k): ring for k, ring in enumerate(rings)},
        "facedata": {str(k): {} for k in range(len(rings))},
        "edgedata": {str(pair): value for pair, value in about.items()},
        "max_vertex": len(nodes) - 1,
        "max_face": len(rings) - 1,
    }
