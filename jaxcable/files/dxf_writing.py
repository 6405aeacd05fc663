"""Structures and results as drawings in DXF files (by ezdxf, the extra `dxf`)."""

from __future__ import annotations

import itertools
from os import PathLike
from pathlib import Path

import numpy as np

from ..analysis.solution import Solution
from ..common.units import UnitsLike
from ..common.writing import atomic_write
from ..elements import Bars
from ..model.result_parts import element_faces, named_groups_of
from ..model.structure import Structure
from .dxf import BARS_PROPERTY, METRES_PER_UNIT, SUPPORTS_PROPERTY, import_ezdxf
from .end_of_analysis import end_state, require_suffix
from .net_units import metres_per_drawing_unit

_COLOURS = (5, 1, 3, 6, 4, 2)  # of groups, by the format's numbers: blue, red, green, ...
_GREY = 8  # of points
_IMPERIAL = (1, 2, 3, 8, 9, 10, 21, 22, 23, 24)  # codes of units, from inch to survey mile
_FORBIDDEN = str.maketrans(dict.fromkeys('<>/\\":;?*|=`,', "_"))  # in names of layers


def save_dxf(
    path: str | PathLike[str],
    structure: Structure,
    solution: Solution | None = None,
    scale: float | None = None,
    *,
    units: UnitsLike | None = None,
    node_points: bool = True,
) -> list[Path]:
    """Write a structure as a drawing, with a layer and a color for each group.

    Elements are drawn as lines, cables over several nodes as polylines, and elements with faces as
    3DFACEs, which `read_dxf` leaves out. Nodes are points: supported ones on the layer
    ``supports``, others on the layer ``nodes``. Properties of the drawing tell `read_dxf` which
    layers are bars, and which one has the supports, if all of them hold all displacements.

    Args:
        path: path of the file, ending with .dxf.
        structure: `Structure`.
        solution: its `Solution`, for the positions at its end; if it has failed, those of the last
            converged state. None draws the nodes as they are in the structure.
        scale: metres per unit of the drawing: 1 for metres, 1e-3 for mm, 1e-2 for cm, 0.0254 for
            inches, 0.3048 for feet; None for that of `units`, or metres.

    Options:
        units: units of which coordinates have the length, such as "kip, ft" (see `Units`).
        node_points: whether nodes are drawn, as points.

    Returns:
        Paths of the files written, a list.

    Raises:
        ValueError: another suffix or scale, groups whose names give the same layer, a batch,
            another structure than that of the solution; unknown units, or units beside a scale;
            ezdxf is not installed.
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
    path, scale = require_suffix(path, ".dxf"), metres_per_drawing_unit(units, scale)
    scale = 1.0 if scale is None else scale
    codes = {metres: unit for unit, metres in METRES_PER_UNIT.items()}
    if scale not in codes:
        known = "such as 1.0 (m), 0.001 (mm), 0.0254 (in) or 0.3048 (ft)"
        raise ValueError(f"scale = {scale}: expected metres per drawing unit of DXF, {known}")
    last = None if solution is None else end_state(structure, solution)
    places = np.asarray(structure.nodes if last is None else last.positions, float)
    document = import_ezdxf().new("R2010")
    document.header["$INSUNITS"] = codes[scale]
    document.header["$MEASUREMENT"] = int(codes[scale] not in _IMPERIAL)
    space, points = document.modelspace(), (places / scale).tolist()
    layers = {"0", "defpoints"}
    for number, (name, group) in enumerate(named_groups_of(structure)):
        layer = (name or type(group).__name__).translate(_FORBIDDEN)[:255]
        if layer.lower() in layers:  # the format does not tell small letters from capitals
            raise ValueError(
                f"elements: the layer of group {name!r}, {layer!r}, is used; rename it"
            )
        layers.add(layer.lower())
        document.layers.add(layer, color=_COLOURS[number % len(_COLOURS)])
        if isinstance(group, Bars):
            document.header.custom_vars.append(BARS_PROPERTY, layer)
        for corners in element_faces([group])[0].tolist():
            space.add_3dface([points[k] for k in corners], dxfattribs={"layer": layer})
        for chain in group.links.array.tolist() if group.face is None else ():
            ends = [k for k, _ in itertools.groupby(chain)]  # shorter chains are padded
            if len(ends) == 2:
                space.add_line(points[ends[0]], points[ends[1]], dxfattribs={"layer": layer})
            else:
                space.add_polyline3d([points[k] for k in ends], dxfattribs={"layer": layer})
    fixed = np.asarray(structure.supports.fixed(structure.n_node))
    held, pinned = fixed.any(axis=1), fixed[:, :3].all(axis=1)
    for layer, mask in (("supports", held), ("nodes", ~held)) if node_points else ():
        while layer in layers:
            layer += "_"
        document.layers.add(layer, color=_GREY)
        if mask is held and (held == pinned).all():
            document.header.custom_vars.append(SUPPORTS_PROPERTY, layer)
        for k in np.flatnonzero(mask):
            space.add_point(points[k], dxfattribs={"layer": layer})
    with atomic_write(path) as stream:
        document.write(stream)
    return [path]
