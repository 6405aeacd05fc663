"""Nets from drawings in DXF files (by ezdxf, the extra `dxf`)."""

from __future__ import annotations

import dataclasses
import io
import logging
from os import PathLike
from types import ModuleType
from typing import NamedTuple

import numpy as np
import scipy  # its parts are imported where they are first used

from ..common import checks
from ..common.compilation import without_garbage_collection
from ..common.units import UnitsLike
from .arcs import points_along_entity
from .net_units import metres_per_drawing_unit
from .nets import Net
from .omissions import Omissions
from .polylines import Polyline, net_from_polylines
from .reading import LARGEST, FileError, read_bytes

METRES_PER_UNIT = {
    **{1: 0.0254, 2: 0.3048, 3: 1609.344, 4: 1e-3, 5: 1e-2, 6: 1.0, 7: 1e3, 8: 2.54e-8, 9: 2.54e-5},
    **{10: 0.9144, 11: 1e-10, 12: 1e-9, 13: 1e-6, 14: 0.1, 15: 10.0, 16: 100.0, 17: 1e9},
    **{18: 149_597_870_700.0, 19: 9_460_730_472_580_800.0, 20: 648_000 / np.pi * 149_597_870_700.0},
    **{21: 1200 / 3937, 22: 100 / 3937, 23: 3600 / 3937, 24: 6_336_000 / 3937},
}
"""Metres per unit, by the code in the header ($INSUNITS in the DXF reference)."""

BARS_PROPERTY, SUPPORTS_PROPERTY = "jaxcable bars", "jaxcable supports"
"""Properties of a drawing that `save_dxf` has written: names of layers."""

_SPLINE_FIT = 4  # bit in the flags of a POLYLINE, whose vertices then are not all on its curve
_ARCS = "to replace arcs by chords, give sagitta=..., m (--sagitta)"
_CURVED = "convert it to a polyline first, in the drawing"
_WHY = {
    **dict.fromkeys(("ARC", "LWPOLYLINE with arcs", "POLYLINE with arcs"), _ARCS),
    **dict.fromkeys(("SPLINE", "ELLIPSE", "CIRCLE", "POLYLINE fitted by a spline"), _CURVED),
    "3DFACE": "faces are not read: draw their edges as lines",
    "INSERT": "blocks are not read: explode blocks first, in the drawing",
}
"""Why kinds of entities are left out, or what to do."""


def read_dxf(
    path: str | PathLike[str],
    scale: float | None = None,
    *,
    tolerance: float = 1e-6,
    supports: str | None = None,
    sagitta: float | None = None,
    hidden: bool = False,
    largest: int = LARGEST,
    units: UnitsLike | None = None,
) -> Net:
    """Read the lines and polylines of a drawing; its layers become groups.

    Each straight piece of a LINE, LWPOLYLINE or POLYLINE in model space becomes a link. Ends closer
    than `tolerance` become one node, and a link that occurs twice is taken once. Lines that cross
    or touch have no node there: see `Net.split`. What is left out (arcs, faces, texts, blocks,
    layers that are off or frozen, paper space, links that occur again) is counted in an
    `InputWarning` and in ``Net.omissions``.

    Args:
        path: path of the file, DXF in ASCII.
        scale: metres per unit of the file; None takes what the header says ($INSUNITS), of all
            24 codes: mm, cm, m, inches, feet, US survey feet and so on.

    Options:
        tolerance: largest distance of points that become one node, m.
        supports: layer whose POINTs are supports, "*" for all layers. None takes the supports of a
            drawing that `save_dxf` has written, and none from other drawings.
        sagitta: largest distance of arcs (ARC, and polylines with bulges) from the chords that take
            their place, m; None leaves them out.
        hidden: whether to read layers that are off or frozen, and invisible entities, too.
        largest: largest size that is read, bytes.
        units: units of the file, such as "kN, mm", of which coordinates have the length (see
            `Units`), for drawings whose header has no unit.

    Returns:
        `Net`, without stiffness; ``net.scene(axial_stiffness=...)`` makes a scene of it. Its
        `marks` are the nodes at POINTs, by layer. Bars that `save_dxf` has written stay bars.

    Raises:
        FileError: no drawing, no lines, no unit, another unit in the header than in `units`, a
            line without length, a number that is not finite, a support that is not at a node; the
            message names the entity by its handle.
        ValueError: ezdxf is not installed; a wrong `scale`, `tolerance` or `sagitta`; unknown
            units, or units beside a scale.
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
    stated = metres_per_drawing_unit(units, None)
    scale = metres_per_drawing_unit(units, scale)
    if (scale is not None and not 0 < scale < np.inf) or not 0 <= tolerance < np.inf:
        raise ValueError(f"scale = {scale}, tolerance = {tolerance}: expected positive numbers")
    if sagitta is not None and not 0 < sagitta < np.inf:
        raise ValueError(f"sagitta = {sagitta}: expected a positive number")
    ezdxf = import_ezdxf()
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
                metres = float(METRES_PER_UNIT.get(unit, 0.0) if scale is None else scale)
                sag = sagitta / metres if sagitta is not None and metres else None
                entities = _read_visible_entities(document, sag, hidden, table)
                own = [(str(key), str(layer)) for key, layer in document.header.custom_vars]
        except Exception as error:  # whatever a foreign parser makes of a damaged file
            told = " ".join(str(error).split())[:120]
            raise FileError(f"not a DXF drawing, or a damaged one: {told}") from error
        if not metres:
            raise FileError(
                f"the drawing does not say its unit ($INSUNITS = {unit}); give metres per drawing "
                'unit: scale=0.001 for mm (--scale 0.001), or units="N, mm" (--units "N, mm")'
            )
        if stated is not None and METRES_PER_UNIT.get(unit, stated) != stated:
            raise FileError(
                f"the drawing says that its unit is {METRES_PER_UNIT[unit]:g} m, and units = "
                f'"{units}" that it is {stated:g} m; give the right one by scale=... (--scale)'
            )
        if supports is None:
            marked = {entity.layer for entity in entities if entity.kind == "POINT"}
            supports = next(
                (name for key, name in own if key == SUPPORTS_PROPERTY and name in marked), None
            )
        net = _net_of_entities(entities, metres, tolerance, supports, table)
        bars = [("bar" if (BARS_PROPERTY, group) in own else "cable") for group in net.groups or ()]
        return dataclasses.replace(net, kinds=tuple(bars), omissions=table.rows())


def _read_visible_entities(document, sagitta, hidden, table):
    """Return the `_Entity` of each visible entity in model space; count the hidden ones in `table`.

    With `hidden` they are read, too. `sagitta` is the largest distance of arcs from the chords that
    replace them, in units of the drawing, or None to leave out arcs.
    """
    layers, files = _hidden_layers(document), _external_references(document)
    found = []
    for entity in document.modelspace():
        content = _read_entity(entity, sagitta, layers)
        name = str(entity.dxf.get("name", "")).lower() if content.kind == "INSERT" else ""
        if content.why_hidden and not hidden:
            why = f"{content.why_hidden} in the drawing; to read it, give hidden=True (--hidden)"
            table.add(content.kind, f"layer {content.layer!r}", why)
        elif name in files:
            why = "drawings that this one refers to (xrefs) are not read: bind them first"
            table.add("external reference", repr(files[name]), why)
        else:
            found.append(content)
    _record_paper_space_entities(document, table)
    return found


def import_ezdxf() -> ModuleType:
    """Import and return the module `ezdxf`; raise ValueError if it is not installed."""
    ezdxf = checks.import_library("ezdxf", "DXF", "dxf")
    logging.getLogger("ezdxf").addHandler(logging.NullHandler())  # else it prints by itself
    return ezdxf


class _Entity(NamedTuple):
    """Entity of a drawing (line, polyline, arc, ...) as points, with its layer.

    Attributes:
        kind: its kind in the words of the format, such as "LINE".
        where: its place, in words, for messages.
        layer: name of its layer.
        points: points (x, y, z) along the entity, in units of the drawing; none if it is left out.
        why_hidden: why the drawing does not show it, in words; empty if it is shown.
    """

    kind: str
    where: str
    layer: str
    points: list[tuple[float, float, float]]
    why_hidden: str


def _read_entity(entity, sagitta, layers):
    """Return the `_Entity` of an entity of ezdxf.

    Args:
        entity: object of ezdxf.
        sagitta: largest distance of arcs from the chords that replace them, in units of the
            drawing; None leaves out arcs.
        layers: dict from the name of a hidden layer, in small letters, to why it is hidden.
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
        points = [] if sagitta is None else points_along_entity(entity, sagitta)
    elif kind in ("LWPOLYLINE", "POLYLINE"):
        points = [*(entity.points_in_wcs() if kind == "POLYLINE" else entity.vertices_in_wcs())]
        points += points[:1] if entity.is_closed else []
    layer = str(entity.dxf.get("layer", "0"))
    where = f"{kind} {entity.dxf.get('handle', '?')} on layer {layer!r}"
    unseen = layers.get(layer.lower(), "")
    if entity.dxf.get("invisible", 0):
        unseen = "invisible"
    return _Entity(kind, where, layer, [tuple(point) for point in points], unseen)


def _hidden_layers(document):
    """Return a dict from the name of each hidden layer, in small letters, to "frozen" or "off"."""
    why = {}
    for layer in document.layers:
        if layer.is_frozen() or layer.is_off():
            why[layer.dxf.name.lower()] = "frozen" if layer.is_frozen() else "off"
    return why


def _record_paper_space_entities(document, table):
    """Add the entities in paper space, other than viewports, to the table of omissions."""
    for layout in document.layouts:
        if layout.is_any_paperspace:
            count = sum(entity.dxftype() != "VIEWPORT" for entity in layout)
            why = "only model space is read"
            table.add("entity in paper space", f"layout {layout.name!r}", why, count)


def _external_references(document):
    """Return the files that a drawing refers to, by the names of their blocks in small letters."""
    return {
        block.name.lower(): str(block.block.dxf.get("xref_path", "?"))
        for block in document.blocks
        if block.block is not None and block.block.is_xref
    }


def _net_of_entities(entities, metres, tolerance, supports, table):
    """Make the `Net` of a list of `_Entity`: lines become links, POINTs supports or marks.

    `metres` are the metres per unit of the drawing, `tolerance` is the largest distance of points
    that become one node, m, and `supports` the layer whose POINTs are supports ("*" for all), or
    None.
    What is left out is counted in `table`.
    """
    places, lines, marks = [], [], []
    for kind, where, layer, points, _ in entities:
        if not np.isfinite(np.array(points, float)).all():
            raise FileError(f"{where}: a coordinate is not finite")
        if kind == "POINT":
            marks.append((where, layer, points[0]))
        elif len(points) < 2:
            table.add(kind, f"layer {layer!r}", _WHY.get(kind, ""))
        else:
            lines.append(Polyline(where, layer, range(len(places), len(places) + len(points))))
            places += points
    if not lines:
        told = "".join(f"; {row}" for row in table.rows())
        raise FileError(f"has no lines or polylines in model space: {len(marks)} POINT{told:.500}")
    net = net_from_polylines(metres * np.array(places, float), lines, tolerance, table, "link")
    distance, node = np.array([]), np.array([], int)
    if marks:
        distance, node = scipy.spatial.cKDTree(net.nodes).query(
            metres * np.array([p for *_, p in marks])
        )
    on: dict[str, set[int]] = {}
    fixed = net.fixed.copy()
    held = [supports in ("*", layer) for _, layer, _ in marks]
    for (where, layer, _), off, number, support in zip(marks, distance, node, held, strict=True):
        on.setdefault(layer, set()).update([int(number)] if off <= tolerance else [])
        if support and off > tolerance:
            raise FileError(f"{where}: a support, but {off:.3g} m from the nearest node")
        if support:
            fixed[number] = True
        elif off > tolerance:
            table.add("POINT", f"layer {layer!r}", "is not at a node")
    if supports is not None and not any(held):
        layers = ", ".join(map(repr, on)) or "none"
        raise FileError(
            f"supports = {supports!r}: there is no POINT on this layer, only on: {layers}"
        )
    by_layer = {layer: np.array(sorted(nodes), np.int32) for layer, nodes in on.items()}
    return dataclasses.replace(net, fixed=fixed, marks=by_layer)
