"""Nets from the lines of an OBJ file, as modelling programs write them."""

from __future__ import annotations

import itertools
from os import PathLike

import numpy as np
from scipy.sparse import coo_matrix
from scipy.sparse.csgraph import connected_components
from scipy.spatial import cKDTree

from . import reading
from .nets import Net
from .reading import LARGEST, FileError, read_text

_FARTHEST = 1e12  # largest coordinate, m; squares of distances are useless beyond it
_CROWD = 50  # largest average number of points within the tolerance of a point


def read_obj(
    path: str | PathLike[str],
    scale: float = 1.0,
    *,
    tolerance: float = 1e-6,
    largest: int = LARGEST,
) -> Net:
    """Read points (``v``), lines, polylines (``l``) and edges of faces (``f``) of an OBJ file.

    Programs often write separate points for every line: points nearer than `tolerance` become one
    node, and a link that occurs twice is taken once. Groups (``g``, ``o``) become groups of the
    net. Everything else in the file is skipped.

    Args:
        path: path of the file.
        scale: metres per unit of the file: 1e-3 for millimetres.

    Options:
        tolerance: largest distance of points that become one node, m.
        largest: largest size that is read, bytes.

    Returns:
        `Net`, without supports and stiffness; add them by
        ``net.scene(anchors, axial_stiffness=...)``.

    Raises:
        FileError: no points or lines, an unknown point, a line without length; the message names
            the line.
        OSError: there is no such file, or it cannot be read.

    Example:
        >>> import tempfile, pathlib
        >>> path = pathlib.Path(tempfile.mkdtemp()) / "net.obj"
        >>> _ = path.write_text("v 0 0 0\\nv 1000 0 0\\nv 2000 0 0\\nl 1 2 3\\n")
        >>> jc.files.read_obj(path, scale=1e-3).links.tolist()
        [[0, 1], [1, 2]]
    """
    if not 0 < scale < np.inf or not 0 <= tolerance < np.inf:
        raise ValueError(f"scale = {scale}, tolerance = {tolerance}: expected positive numbers")
    points, lines, group, named = [], [], "", False
    for number, text in enumerate(read_text(path, largest).splitlines(), 1):
        words = text.split("#")[0].split()
        kind, words = (words[0], words[1:]) if words else ("", [])
        try:
            if kind == "v":
                points.append([reading.number(word) for word in words[:3]])
                if len(points[-1]) != 3 or not np.isfinite(points[-1]).all():
                    raise ValueError("a point has three finite coordinates")
            elif kind in ("l", "f"):
                chain = [_point(word, len(points)) for word in words]
                if len(chain) < 2:
                    raise ValueError("a line has at least two points")
                chain += chain[:1] if kind == "f" else []
                lines += [(number, group, *pair) for pair in itertools.pairwise(chain)]
            elif kind in ("g", "o"):
                group, named = " ".join(words), True
        except ValueError as error:
            raise FileError(f"{path}: line {number}: {error}") from None
    if not points or not lines:
        raise FileError(f"{path}: has {len(points)} points (v) and {len(lines)} lines (l): no net")
    with np.errstate(over="ignore"):
        places = scale * np.array(points)
    if not np.abs(places).max() < _FARTHEST:
        raise FileError(f"{path}: coordinates beyond {_FARTHEST:.0e} m; is the scale right?")
    try:
        node = _joined(places, tolerance)
    except ValueError as error:
        raise FileError(f"{path}: {error}") from None
    found = {}
    for number, label, i, j in lines:
        first, second = int(node[i]), int(node[j])
        if first == second:
            raise FileError(f"{path}: line {number}: a line without length")
        found.setdefault((min(first, second), max(first, second)), (first, second, label))
    links: np.ndarray = np.array([(i, j) for i, j, _ in found.values()], np.int32)
    used, links = np.unique(links, return_inverse=True)  # drop points without a line
    origin = np.unique(node, return_index=True)[1]
    groups = tuple(label for *_, label in found.values())
    return Net(
        nodes=places[origin][used],
        links=links.reshape(-1, 2).astype(np.int32),
        fixed=np.zeros((len(used), 3), bool),
        kinds=("cable",) * len(links.reshape(-1, 2)),
        groups=groups if named and len(set(groups)) > 1 else None,
        names=tuple(str(k + 1) for k in origin[used]),
    )


def _point(word, count):
    """Index of a point, from 0, of a word like "7", "7/1" or "-1" (the last point so far)."""
    try:
        number = reading.whole(word.split("/")[0])
    except ValueError:
        raise ValueError(f"{word!r} is no point; points are numbered from 1") from None
    index = number - 1 if number > 0 else count + number
    if number == 0 or not 0 <= index < count:
        raise ValueError(f"point {number} is not among the {count} before this line")
    return index


def _joined(places, tolerance):
    """Node number of each point; nodes are numbered in the order of their first points."""
    distinct, which = np.unique(places, axis=0, return_inverse=True)
    tree = cKDTree(distinct)
    if tree.count_neighbors(tree, tolerance) > _CROWD * len(distinct):
        raise ValueError(f"too many points within {tolerance} m of each other; is the scale right?")
    pairs = tree.query_pairs(tolerance, output_type="ndarray")
    size = (len(distinct),) * 2
    graph = coo_matrix((np.ones(len(pairs)), (pairs[:, 0], pairs[:, 1])), shape=size)
    label = connected_components(graph, directed=False)[1][which.ravel()]
    first = np.unique(label, return_index=True)[1]
    order = np.empty(len(first), int)
    order[np.argsort(first)] = np.arange(len(first))
    return order[label]
