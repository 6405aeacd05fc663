"""Nets from drawings in DXF files (by ezdxf, the extra `dxf`)."""

from __future__ import annotations

import dataclasses
import io
import logging
from os import PathLike
from types import ModuleType
from typing import NamedTuple

import numpy as np
from scipy.spatial import cKDTree

from ..common.compilation import without_garbage_collection
from .arcs import curve
from .lines import Polyline, net_of
from .nets import Net
from .omissions import Omissions
from .reading import LARGEST, FileError, read_bytes

METRES = {1: 0.0254, 2: 0.3048, 4: 1e-3, 5: 1e-2, 6: 1.0}
"""Metres per unit, by the code in the header: inch, foot, mm, cm, m."""

BARS, SUPPORTS = "jaxcable bars", "jaxcable supports"
"""Properties of a drawing that `save_dxf` has written: names of layers."""

_SPLINE_FIT = 4  # bit in the flags of a POLYLINE, whose vertices then are not all on its curve
_ARCS = "give sagitta=..., m (--sagitta), for chords of arcs"
_CURVED = "convert it to a polyline first, in the drawing"
_WHY = {
    **dict.fromkeys(("ARC", "LWPOLYLINE with arcs", "POLYLINE with arcs"), _ARCS),
    **dict.fromkeys(("SPLINE", "ELLIPSE", "CIRCLE", "POLYLINE fitted by a spline"), _CURVED),
    "3DFACE": "faces carry no link",
    "INSERT": "blocks are not read: explode blocks first, in the drawing",
}
"""Why kinds of entities are left out, or what to do."""


def read_dxf(
    path: str | PathLike[str],
    scale: float | None = None,
    *,
    tol: float = 1e-6,
    supports: str | None = None,
    sagitta: float | None = None,
    hidden: bool = False,
    largest: int = LARGEST,
) -> Net:
    """Read the lines and polylines of a drawing; its layers become groups.

    LINE, LWPOLYLINE and POLYLINE in model space become links, one for each straight piece; ends
    nearer than `tol` become one node, and a link that occurs twice is taken once. What is left out
    (arcs, faces, texts, blocks, layers that are off or frozen, paper space, links that occur again)
    is counted in an `InputWarning` and in ``Net.omissions``. Lines that cross or touch have no node
    there: see `Net.split`.

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
        hidden: whether to read layers that are off or frozen, and invisible entities, too.
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
    ezdxf = library()
    data = read_bytes(path, largest)
    try:
        text = data.decode("utf-8-sig")
    except UnicodeDecodeError:  # before 2007 names of layers were in the code page of a country
        text = data.decode("cp1252", "replace")
    with Omissions(path) as table:
        try:
            with without_garbage_collection():  # a drawing has no garbage while it is read
                # lines may end as Windows ends them, which the parser leaves to its stream
                document = ezdxf.read(io.StringIO(text, newline=None))
                unit = document.header.get("$INSUNITS", 0)
                metres = float(METRES.get(unit, 0.0) if scale is None else scale)
                sag = sagitta / metres if sagitta is not None and metres else None
                entities = _shown(document, sag, hidden, table)
                own = [(str(key), str(layer)) for key, layer in document.header.custom_vars]
        except Exception as error:  # whatever a foreign parser makes of a damaged file
            told = " ".join(str(error).split())[:120]
            raise FileError(f"no DXF drawing, or a damaged one: {told}") from error
        if not metres:
            raise FileError(
                f"$INSUNITS = {unit}: no unit that is known; give scale=..., m (--scale)"
            )
        if supports is None:
            marked = {entity.layer for entity in entities if entity.kind == "POINT"}
            supports = next((name for key, name in own if key == SUPPORTS and name in marked), None)
        net = _net(entities, metres, tol, supports, table)
        bars = [("bar" if (BARS, group) in own else "cable") for group in net.groups or ()]
        return dataclasses.replace(net, kinds=tuple(bars), omissions=table.table())


def _shown(document, sagitta, hidden, table):
    """Entities of model space that are shown, a list; counts what is not shown in the drawing."""
    layers, files = _unseen_layers(document), _references(document)
    found = []
    for entity in document.modelspace():
        content = _content(entity, sagitta, layers)
        name = str(entity.dxf.get("name", "")).lower() if content.kind == "INSERT" else ""
        if content.unseen and not hidden:
            why = f"{content.unseen} in the drawing; hidden=True (--hidden) reads it"
            table.add(content.kind, f"layer {content.layer!r}", why)
        elif name in files:
            why = "drawings that this one refers to are not read: bind them first"
            table.add("external reference", repr(files[name]), why)
        else:
            found.append(content)
    _count_paper(document, table)
    return found


def library() -> ModuleType:
    """The module `ezdxf`."""
    try:
        import ezdxf
    except ImportError:
        raise ValueError("DXF: needs ezdxf; pip install 'jaxcable[dxf]'") from None
    logging.getLogger("ezdxf").addHandler(logging.NullHandler())  # else it prints by itself
    return ezdxf


class _Entity(NamedTuple):
    """What of an entity is read.

    Attributes:
        kind: its kind, in the words of the format.
        where: its place in words.
        layer: its layer.
        points: those along it, in units of the drawing; none if it is left out.
        unseen: why it is not shown in the drawing, in words; empty if it is.
    """

    kind: str
    where: str
    layer: str
    points: list[tuple[float, float, float]]
    unseen: str


def _content(entity, sagitta, layers):
    """The `_Entity` of an entity of ezdxf.

    Args:
        sagitta: of chords in place of arcs, in units of the drawing; None leaves out arcs.
        layers: dict from name of a layer, in small letters, to why it is not shown.
    """
    kind, points = entity.dxftype(), []
    if kind == "LINE":
        points = [entity.dxf.start, entity.dxf.end]
    elif kind == "POINT":
        points = [entity.dxf.location]
    elif kind == "POLYLINE" and not (entity.is_2d_polyline or entity.is_3d_polyline):
        kind = "POLYLINE mesh"
    elif kind == "POLYLINE" and entity.dxf.flags & _SPLINE_FIT:
        kind = "POLYLINE fitted by a spline"
    elif kind == "ARC" or (kind in ("LWPOLYLINE", "POLYLINE") and entity.has_arc):
        kind = "ARC" if kind == "ARC" else f"{kind} with arcs"
        points = [] if sagitta is None else curve(entity, sagitta)
    elif kind in ("LWPOLYLINE", "POLYLINE"):
        points = [*(entity.points_in_wcs() if kind == "POLYLINE" else entity.vertices_in_wcs())]
        points += points[:1] if entity.is_closed else []
    layer = str(entity.dxf.get("layer", "0"))
    where = f"{kind} {entity.dxf.get('handle', '?')} on layer {layer!r}"
    unseen = layers.get(layer.lower(), "")
    if entity.dxf.get("invisible", 0):
        unseen = "invisible"
    return _Entity(kind, where, layer, [tuple(point) for point in points], unseen)


def _unseen_layers(document):
    """Why layers are not shown: dict from their names, in small letters, to "frozen" or "off"."""
    why = {}
    for layer in document.layers:
        if layer.is_frozen() or layer.is_off():
            why[layer.dxf.name.lower()] = "frozen" if layer.is_frozen() else "off"
    return why


def _count_paper(document, table):
    """Count what is drawn on layouts of paper, but for the windows on the model."""
    for layout in document.layouts:
        if layout.is_any_paperspace:
            count = sum(entity.dxftype() != "VIEWPORT" for entity in layout)
            why = "model space alone is read"
            table.add("entity in paper space", f"layout {layout.name!r}", why, count)


def _references(document):
    """Names of files that blocks refer to, by the name of the block in small letters."""
    return {
        block.name.lower(): str(block.block.dxf.get("xref_path", "?"))
        for block in document.blocks
        if block.block is not None and block.block.is_xref
    }


def _net(entities, metres, tol, supports, table):
    """The `Net` of the entities of a drawing that are shown.

    Args:
        entities: `_Entity` of what is read, a list.
        table: `Omissions`, which counts what is left out.
    """
    places, lines, marks = [], [], []
    for kind, where, layer, points, _ in entities:
        if not np.isfinite(np.array(points, float)).all():
            raise FileError(f"{where}: a coordinate that is not finite")
        if kind == "POINT":
            marks.append((where, layer, points[0]))
        elif len(points) < 2:
            table.add(kind, f"layer {layer!r}", _WHY.get(kind, ""))
        else:
            lines.append(Polyline(where, layer, range(len(places), len(places) + len(points))))
            places += points
    if not lines:
        told = "".join(f"; {row}" for row in table.table())
        raise FileError(f"has no lines or polylines in model space: {len(marks)} POINT{told:.500}")
    net = net_of(metres * np.array(places, float), lines, tol, table, "link")
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
            table.add("POINT", f"layer {layer!r}", "off the nodes")
    if supports is not None and not any(held):
        layers = ", ".join(map(repr, on)) or "none"
        raise FileError(
            f"supports = {supports!r}: there is no POINT on this layer; there are on: {layers}"
        )
    by_layer = {layer: np.array(sorted(nodes), np.int32) for layer, nodes in on.items()}
    return dataclasses.replace(net, fixed=fixed, marks=by_layer)
