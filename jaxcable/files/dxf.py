"""Nets from drawings in DXF files, and structures as such drawings (by ezdxf, the extra `dxf`)."""

from __future__ import annotations

import collections
import contextlib
import dataclasses
import gc
import io
import itertools
import logging
from os import PathLike
from pathlib import Path
from types import ModuleType

import numpy as np
from scipy.spatial import cKDTree

from ..analysis.solution import Solution
from ..common.checks import suspect
from ..common.writing import written
from ..elements import Bars
from ..model.parts import groups_by_name, one_case
from ..model.structure import Structure
from ..model.topology import require_same
from .arcs import curve
from .lines import net_of
from .nets import Net
from .reading import LARGEST, FileError, read_bytes

_METRES = {1: 0.0254, 2: 0.3048, 4: 1e-3, 5: 1e-2, 6: 1.0}
"""Metres per unit, by the code in the header: inch, foot, mm, cm, m."""

_COLOURS = (5, 1, 3, 6, 4, 2)  # of groups, by the format's numbers: blue, red, green, ...
_GREY = 8  # of points
_BARS, _SUPPORTS = "jaxcable bars", "jaxcable supports"  # properties of a drawing: names of layers
_FORBIDDEN = str.maketrans(dict.fromkeys('<>/\\":;?*|=`,', "_"))  # in names of layers


def read_dxf(
    path: str | PathLike[str],
    scale: float | None = None,
    *,
    tol: float = 1e-6,
    supports: str | None = None,
    sagitta: float | None = None,
    largest: int = LARGEST,
) -> Net:
    """Read the lines and polylines of a drawing; its layers become groups.

    LINE, LWPOLYLINE and POLYLINE in model space become links, one for each straight piece; ends
    nearer than `tol` become one node, and a link that occurs twice is taken once. What is left out
    (arcs, faces, texts, blocks, links that occur again) is counted in an `InputWarning`. Lines that
    cross or touch have no node there: see `Net.split`.

    Args:
        path: path of the file, DXF in ASCII.
        scale: metres per unit of the file; None takes what the header says ($INSUNITS): mm, cm, m,
            inches or feet.

    Options:
        tol: largest distance of points that become one node, m.
        supports: layer whose POINTs are supports, "*" for those of all layers; None for those that
            `save_dxf` has written, if the drawing is its own, and else for no support.
        sagitta: largest distance of arcs (ARC, and polylines with bulges) from the chords that take
            their place, m; None leaves them out.
        largest: largest size that is read, bytes.

    Returns:
        `Net`, without stiffness; ``net.scene(axial_stiffness=...)`` makes a scene of it. Its
        `marks` are the nodes with POINTs, by layer. Bars that `save_dxf` has written stay bars.

    Raises:
        FileError: no drawing, no lines, no unit, a line without length, a number that is not
        finite, a
            support off the nodes; the message names the entity by its handle.
        ValueError: ezdxf is not installed; a wrong `scale`, `tol` or `sagitta`.
        OSError: there is no such file, or it cannot be read.

    Example:
        >>> import tempfile, pathlib
        >>> structure, _ = jc.scenes.flat_net()
        >>> path = pathlib.Path(tempfile.mkdtemp()) / "net.dxf"
        >>> _ = jc.files.save_dxf(path, structure)
        >>> net = jc.files.read_dxf(path, supports="supports")
        >>> len(net.links), set(net.groups), int(net.fixed[:, 0].sum())
        (12, {'Cables'}, 8)
    """
    if (scale is not None and not 0 < scale < np.inf) or not 0 <= tol < np.inf:
        raise ValueError(f"scale = {scale}, tol = {tol}: expected positive numbers")
    if sagitta is not None and not 0 < sagitta < np.inf:
        raise ValueError(f"sagitta = {sagitta}: expected a positive number")
    library = _library()
    data = read_bytes(path, largest)
    try:
        text = data.decode("utf-8-sig")
    except UnicodeDecodeError:  # before 2007 names of layers were in the code page of a country
        text = data.decode("cp1252", "replace")
    try:
        with _no_collection():
            # lines may end as Windows ends them, which the parser leaves to its stream
            document = library.read(io.StringIO(text, newline=None))
            unit = document.header.get("$INSUNITS", 0)
            metres = float(_METRES.get(unit, 0.0) if scale is None else scale)
            sag = sagitta / metres if sagitta is not None and metres else None
            entities = [_content(entity, sag) for entity in document.modelspace()]
            own = [(str(key), str(layer)) for key, layer in document.header.custom_vars]
    except Exception as error:  # whatever a foreign parser makes of a damaged file
        told = " ".join(str(error).split())[:120]
        raise FileError(f"{path}: no DXF drawing, or a damaged one: {told}") from error
    if not metres:
        raise FileError(
            f"{path}: $INSUNITS = {unit}: no unit that is known; give scale=..., m (--scale)"
        )
    if supports is None:
        marked = {layer for kind, _, layer, _ in entities if kind == "POINT"}
        supports = next((name for key, name in own if key == _SUPPORTS and name in marked), None)
    try:
        net = _net(path, entities, metres, tol, supports)
    except FileError as error:
        raise FileError(f"{path}: {error}") from None
    bars = [("bar" if (_BARS, group) in own else "cable") for group in net.groups or ()]
    return dataclasses.replace(net, kinds=tuple(bars))


def _library() -> ModuleType:
    """The module `ezdxf`."""
    try:
        import ezdxf
    except ImportError:
        raise ValueError("DXF: needs ezdxf; pip install 'jaxcable[dxf]'") from None
    logging.getLogger("ezdxf").addHandler(logging.NullHandler())  # else it prints by itself
    return ezdxf


@contextlib.contextmanager
def _no_collection():
    """Without looking for garbage: a drawing has none while it is read, and it takes a fifth."""
    was = gc.isenabled()
    gc.disable()
    try:
        yield
    finally:
        if was:
            gc.enable()


def _content(entity, sagitta):
    """Kind, place in words, layer, and points of an entity; no points if it is left out.

    Args:
        sagitta: of chords in place of arcs, in units of the drawing; None leaves out arcs.
    """
    kind, points = entity.dxftype(), []
    if kind == "LINE":
        points = [entity.dxf.start, entity.dxf.end]
    elif kind == "POINT":
        points = [entity.dxf.location]
    elif kind == "LWPOLYLINE":
        if entity.has_arc:
            kind = "LWPOLYLINE with arcs"
            points = [] if sagitta is None else curve(entity, sagitta)
        else:
            points = [*entity.vertices_in_wcs()]
            points += points[:1] if entity.closed else []
    elif kind == "ARC":
        points = [] if sagitta is None else curve(entity, sagitta)
    elif kind == "POLYLINE":
        if not (entity.is_2d_polyline or entity.is_3d_polyline):
            kind = "POLYLINE mesh"
        elif entity.has_arc:
            kind = "POLYLINE with arcs"
            points = [] if sagitta is None else curve(entity, sagitta)
        else:
            points = [*entity.points_in_wcs()]
            points += points[:1] if entity.is_closed else []
    where = f"{kind} {entity.dxf.handle} on layer {entity.dxf.layer!r}"
    return kind, where, entity.dxf.layer, [tuple(point) for point in points]


def _net(path, entities, metres, tol, supports):
    """The `Net` of the entities of a drawing."""
    places, lines, marks, left = [], [], [], collections.Counter()
    for kind, where, layer, points in entities:
        if not np.isfinite(np.array(points, float)).all():
            raise FileError(f"{where}: a coordinate that is not finite")
        if kind == "POINT":
            marks.append((where, layer, points[0]))
        elif len(points) < 2:
            left[kind] += 1
        else:
            first = len(places)
            places += points
            numbers = range(first, len(places))
            lines += [(where, layer, i, j) for i, j in itertools.pairwise(numbers)]
    if not lines:
        told = "".join(f", {count} {kind}" for kind, count in sorted(left.items()))
        told += _hint(left)
        raise FileError(f"has no lines or polylines in model space: {len(marks)} POINT{told}")
    net, repeated = net_of(metres * np.array(places, float), lines, tol)
    left["links that occur again"] += repeated
    distance, node = np.array([]), np.array([], int)
    if marks:
        distance, node = cKDTree(net.nodes).query(metres * np.array([p for *_, p in marks]))
    on: dict[str, set[int]] = {}
    fixed = net.fixed.copy()
    held = [supports in ("*", layer) for _, layer, _ in marks]
    for (where, layer, _), off, number, support in zip(marks, distance, node, held, strict=True):
        on.setdefault(layer, set()).update([int(number)] if off <= tol else [])
        if support and off > tol:
            raise FileError(f"{where}: a support that is {off:.3g} m off the nearest node")
        if support:
            fixed[number] = True
        elif off > tol:
            left["POINT"] += 1
    if supports is not None and not any(held):
        layers = ", ".join(map(repr, on)) or "none"
        raise FileError(
            f"supports = {supports!r}: there is no POINT on this layer; there are on: {layers}"
        )
    told = ", ".join(f"{count} {kind}" for kind, count in sorted(left.items()) if count)
    if told:
        suspect(f"{path}: left out: {told}{_hint(left)}")
    by_layer = {layer: np.array(sorted(nodes), np.int32) for layer, nodes in on.items()}
    return dataclasses.replace(net, fixed=fixed, marks=by_layer)


def _hint(left):
    """What to do about what is left out, as text; `left` counts it by kind."""
    arcs = any(left[kind] for kind in ("ARC", "LWPOLYLINE with arcs", "POLYLINE with arcs"))
    hint = "; give sagitta=..., m (--sagitta), for chords of arcs" if arcs else ""
    blocks = "; blocks (INSERT) are not read: explode blocks first, in the drawing"
    return hint + (blocks if left["INSERT"] else "")


def save_dxf(
    path: str | PathLike[str],
    structure: Structure,
    solution: Solution | None = None,
    scale: float = 1.0,
) -> list[Path]:
    """Write a structure as a drawing, with a layer and a colour for each group.

    Elements are lines, and cables over several nodes polylines. Nodes are points: those that are
    held on the layer ``supports``, others on the layer ``nodes``. Properties of the drawing say
    which layers are bars, and which one has supports that are held in all directions, so that
    `read_dxf` finds both.

    Args:
        path: path of the file, ending with .dxf.
        structure: `Structure`.
        solution: its `Solution`, for the positions in its end; if it has failed, those of the last
            converged state. None draws the nodes as they are in the structure.
        scale: metres per unit of the drawing: 1 for metres, 1e-3 for mm, 1e-2 for cm, 0.0254 for
            inches, 0.3048 for feet.

    Returns:
        Paths of the files written, a list.

    Raises:
        ValueError: another suffix or scale, groups whose names are one layer, a batch, another
            structure than that of the solution; ezdxf is not installed.
        OSError: the file cannot be written.

    Example:
        >>> import tempfile, pathlib
        >>> structure, phases = jc.scenes.flat_net(load=15.0)
        >>> path = pathlib.Path(tempfile.mkdtemp()) / "net.dxf"
        >>> _ = jc.files.save_dxf(path, structure, jc.solve(structure, phases))
        >>> net = jc.files.read_dxf(path)
        >>> print(f"{net.nodes[:, 2].min():.6f} m")
        -0.012838 m
    """
    path = Path(path)
    if path.suffix.lower() != ".dxf":
        raise ValueError(f"path = {str(path)!r}: expected a name that ends with .dxf")
    units = {metres: unit for unit, metres in _METRES.items()}
    if scale not in units:
        known = ", ".join(map(str, sorted(units)))
        raise ValueError(f"scale = {scale}: expected the metres of a unit, one of {known}")
    places = np.asarray(structure.nodes, float)
    if solution is not None:
        one_case(solution)
        require_same(structure, solution.last.topology, "solution")
        places = np.asarray(solution.last.positions, float)
    document = _library().new("R2010")
    document.header["$INSUNITS"], document.header["$MEASUREMENT"] = units[scale], 1
    space, points = document.modelspace(), (places / scale).tolist()
    layers = {"0", "defpoints"}
    for number, (name, group) in enumerate(groups_by_name(structure)):
        layer = (name or type(group).__name__).translate(_FORBIDDEN)[:255]
        if layer.lower() in layers:  # the format does not tell small letters from capitals
            raise ValueError(f"elements: a group {name!r} needs the layer {layer!r}; rename it")
        layers.add(layer.lower())
        document.layers.add(layer, color=_COLOURS[number % len(_COLOURS)])
        if isinstance(group, Bars):
            document.header.custom_vars.append(_BARS, layer)
        for chain in group.links.array.tolist():
            ends = [k for k, _ in itertools.groupby(chain)]  # shorter chains are padded
            if len(ends) == 2:
                space.add_line(points[ends[0]], points[ends[1]], dxfattribs={"layer": layer})
            else:
                space.add_polyline3d([points[k] for k in ends], dxfattribs={"layer": layer})
    fixed = np.asarray(structure.supports.fixed(structure.n_node))
    held, pinned = fixed.any(axis=1), fixed[:, :3].all(axis=1)
    for layer, mask in (("supports", held), ("nodes", ~held)):
        while layer in layers:
            layer += "_"
        document.layers.add(layer, color=_GREY)
        if mask is held and (held == pinned).all():
            document.header.custom_vars.append(_SUPPORTS, layer)
        for k in np.flatnonzero(mask):
            space.add_point(points[k], dxfattribs={"layer": layer})
    with written(path) as stream:
        document.write(stream)
    return [path]
