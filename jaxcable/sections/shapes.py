"""Constructors of fibre sections: closed shapes, polygons with holes, meshes.

Meshes are made on the host. Dimensions may be traced, so that derivatives with respect to a
diameter or a width exist.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from ..common import checks
from ..common.rules import Rule, nan_if_broken, positive
from ..common.types import ArrayLike, Float, Int
from ..materials.law import Law
from ..programs.joining import stack_trees
from . import meshes, outlines
from .composites import NewSection, composite, group_by_law
from .torsion import bredt_torsion, rectangle_torsion

_CELL_KINDS = ("quadrilaterals", "triangles")
_SQUARE_CORNERS = np.array([[-1.0, -1.0], [1.0, -1.0], [1.0, 1.0], [-1.0, 1.0]])
_IY_IZ = np.array([1.0, 1.0, 0.0])  # 1 for the second moments about the axes, 0 for the product


def disc(
    cls: type[NewSection],
    diameter: Float[ArrayLike, ""],
    law: Law,
    shape: tuple[int, int] = (10, 10),
    cells: str = "quadrilaterals",
) -> NewSection:
    """Make a solid circle; area and torsion constant, ``pi d^4 / 32``, are exact.

    Args:
        diameter: scalar, m.
        law: uniaxial law.
        shape: cells along both sides of the square mesh that is mapped to the circle, a pair.
        cells: "quadrilaterals" or "triangles".

    Returns:
        `Section`.

    Raises:
        ValueError: a diameter that is not positive, or an impossible mesh.

    Example:
        >>> section = jc.Section.disc(0.05, jc.Elastic(210e9))
        >>> print(f"{1e4 * section.total_area:.3f} cm2")  # pi d^2 / 4
        19.635 cm2
    """
    diameter = _positive_length(diameter, "diameter")
    points, quads = meshes.disc_mesh(*_checked_mesh_shape(shape))
    inertia = np.pi / 64 * diameter**4
    quads = _quads_or_triangles(quads, cells)
    return _mesh_section(cls, diameter * points, quads, law, 2 * inertia, round_inertia=inertia)


def ring(
    cls: type[NewSection],
    diameter: Float[ArrayLike, ""],
    thickness: Float[ArrayLike, ""],
    law: Law,
    shape: tuple[int, int] = (4, 32),
    cells: str = "quadrilaterals",
) -> NewSection:
    """Make a circular tube; area and torsion constant, ``pi (d^4 - d_i^4) / 32``, are exact.

    Args:
        diameter: outer, scalar, m.
        thickness: of the wall, scalar, m.
        law: uniaxial law.
        shape: number of cells through the wall and around it, a pair.
        cells: "quadrilaterals" or "triangles".

    Returns:
        `Section`.

    Raises:
        ValueError: a length that is not positive, a wall that is too thick, or an impossible mesh.

    Example:
        >>> section = jc.Section.ring(0.4064, 0.0088, jc.Elastic(210e9), shape=(2, 24))
        >>> print(f"{section.n_fibre} fibres, {1e4 * section.total_area:.1f} cm2")  # pi t (d - t)
        48 fibres, 109.9 cm2
    """
    diameter = _positive_length(diameter, "diameter")
    thickness = _positive_length(thickness, "thickness")
    thickness = _length_if_allowed(
        thickness, 2 * thickness >= diameter, "thickness", "twice is too thick"
    )
    fraction, direction, quads = meshes.polar_ring_mesh(*_checked_mesh_shape(shape, (1, 3)))
    inner = diameter / 2 - thickness
    points = (inner + fraction * thickness)[:, None] * direction
    inertia = np.pi / 64 * (diameter**4 - (2 * inner) ** 4)
    return _mesh_section(
        cls, points, _quads_or_triangles(quads, cells), law, 2 * inertia, round_inertia=inertia
    )


def rectangle(
    cls: type[NewSection],
    width: Float[ArrayLike, ""],
    height: Float[ArrayLike, ""],
    law: Law,
    shape: tuple[int, int] = (10, 10),
    cells: str = "quadrilaterals",
) -> NewSection:
    """Make a rectangle; its torsion constant is Saint-Venant's series.

    Args:
        width: along y, scalar, m.
        height: along z, scalar, m.
        law: uniaxial law.
        shape: number of cells along y and z, a pair.
        cells: "quadrilaterals" or "triangles".

    Returns:
        `Section`.

    Raises:
        ValueError: a length that is not positive, or an impossible mesh.

    Source: Timoshenko and Goodier, Theory of Elasticity, art. 109 (torsion constant).

    Example:
        >>> section = jc.Section.rectangle(0.1, 0.2, jc.Elastic(200e9), shape=(5, 10))
        >>> print(f"{section.n_fibre} fibres, {1e4 * section.total_area:.1f} cm2")
        50 fibres, 200.0 cm2
    """
    width, height = _positive_length(width, "width"), _positive_length(height, "height")
    points, quads = meshes.biunit_square_mesh(*_checked_mesh_shape(shape))
    points = points * stack_trees([width / 2, height / 2])[None, :]
    return _mesh_section(
        cls, points, _quads_or_triangles(quads, cells), law, rectangle_torsion(width, height)
    )


def i_shape(
    cls: type[NewSection],
    height: Float[ArrayLike, ""],
    width: Float[ArrayLike, ""],
    web: Float[ArrayLike, ""],
    flange: Float[ArrayLike, ""],
    law: Law,
    shape: tuple[int, int, int] = (8, 2, 12),
) -> NewSection:
    """Make a doubly symmetric I without fillets.

    The torsion constant is that of thin walls, ``sum b t^3 / 3``; warping is not modelled.

    Args:
        height: of the whole section, along z, scalar, m.
        width: of the flanges, along y, scalar, m.
        web, flange: thicknesses, scalars, m.
        law: uniaxial law.
        shape: number of cells along a flange, through a flange, and along the web, a triple.

    Returns:
        `Section`.

    Raises:
        ValueError: a length that is not positive, flanges or a web that are too thick, or an
            impossible mesh.

    Example:
        An IPE 200 without its fillets:

        >>> section = jc.Section.i_shape(0.2, 0.1, 0.0056, 0.0085, jc.Elastic(210e9))
        >>> print(f"{1e4 * section.total_area:.3f} cm2")  # 2 b t_f + (h - 2 t_f) t_w
        27.248 cm2
    """
    numbers = {"height": height, "width": width, "web": web, "flange": flange}
    height, width, web, flange = (_positive_length(value, name) for name, value in numbers.items())
    flange = _length_if_allowed(flange, 2 * flange >= height, "flange", "twice is too thick")
    web = _length_if_allowed(web, web > width, "web", "wider than the flange")
    along, through, tall = _checked_mesh_shape(shape, (1, 1, 1))
    top = rectangle(cls, width, flange, law, (along, through))
    middle = rectangle(cls, web, height - 2 * flange, law, (max(1, through), tall))
    z = (height - flange) / 2
    torsion = (2 * width * flange**3 + (height - 2 * flange) * web**3) / 3
    return composite(cls, [top.shifted(z=z), middle, top.shifted(z=-z)], torsion).shifted()


def box(
    cls: type[NewSection],
    width: Float[ArrayLike, ""],
    height: Float[ArrayLike, ""],
    thickness: Float[ArrayLike, ""],
    law: Law,
    flange: Float[ArrayLike, ""] | None = None,
    shape: tuple[int, int, int] = (8, 2, 8),
) -> NewSection:
    """Make a rectangular hollow section with sharp corners, doubly symmetric.

    The torsion constant is Bredt's, ``4 A^2 / sum(l / t)`` of the middle line of the walls.

    Args:
        width, height: of the whole section, along y and z, scalars, m.
        thickness: of the two webs, and of the flanges unless they have their own, scalar, m.
        law: uniaxial law.
        flange: thickness of the upper and the lower wall, scalar, m; default that of the webs.
        shape: number of cells along a flange, through a wall, and along a web, a triple.

    Returns:
        `Section`.

    Raises:
        ValueError: a length that is not positive, walls that are too thick, or an impossible mesh.

    Example:
        The deck of a footbridge:

        >>> section = jc.Section.box(1.2, 0.5, 0.012, jc.Elastic(210e9))
        >>> print(f"{1e4 * section.total_area:.2f} cm2")  # 2 t (b + h - 2 t)
        402.24 cm2
        >>> print(f"{1e4 * section.torsion[0]:.2f} dm4")  # 2 t (b - t)^2 (h - t)^2 / (b + h - 2 t)
        48.13 dm4
    """
    numbers = {"width": width, "height": height, "thickness": thickness}
    numbers["flange"] = thickness if flange is None else flange
    width, height, web, plate = (_positive_length(value, name) for name, value in numbers.items())
    web = _length_if_allowed(web, 2 * web >= width, "thickness", "twice is too thick")
    name = "thickness" if flange is None else "flange"
    plate = _length_if_allowed(plate, 2 * plate >= height, name, "twice is too thick")
    along, through, tall = _checked_mesh_shape(shape, (1, 1, 1))
    lying = rectangle(cls, width, plate, law, (along, through))
    standing = rectangle(cls, web, height - 2 * plate, law, (through, tall))
    y, z = (width - web) / 2, (height - plate) / 2
    middle = _SQUARE_CORNERS * stack_trees([y, z])[None, :]
    torsion = bredt_torsion(middle, stack_trees([plate, web, plate, web]))
    plates = [lying.shifted(z=z), lying.shifted(z=-z), standing.shifted(y), standing.shifted(-y)]
    return composite(cls, plates, torsion).shifted()


def polygon(
    cls: type[NewSection],
    points: Float[ArrayLike, "n 2"],
    holes: Sequence[Float[ArrayLike, "_ 2"]] | None,
    law: Law,
    size: float,
    cells: str = "quadrilaterals",
) -> NewSection:
    """Make a polygon with holes; its axis is at the origin of the points (see `Section.centred`).

    The points cannot be traced, because the mesh depends on them (use `mesh`). The torsion constant
    is not known: give the element its torsional stiffness.

    Args:
        points: corners (y, z) of the outline, [n, 2], m.
        holes: list of the corners of each hole, [n, 2] each, or None.
        law: uniaxial law.
        size: largest size of the cells, m.
        cells: "quadrilaterals" or "triangles".

    Returns:
        `Section`; beams warn of an axis off the centroid unless `Section.centred` or
        `Section.shifted` has put it in its place.

    Raises:
        ValueError: wrong shapes, traced points, a size that is not positive, an outline that
            crosses itself or a hole.

    Example:
        A box of 1 m with walls of 0.25 m:

        >>> outline = [[0.0, 0.0], [1.0, 0.0], [1.0, 1.0], [0.0, 1.0]]
        >>> hole = [[0.25, 0.25], [0.75, 0.25], [0.75, 0.75], [0.25, 0.75]]
        >>> section = jc.Section.polygon(outline, [hole], jc.Elastic(30e9), size=0.1)
        >>> print(f"{section.total_area:.6f} m2")
        0.750000 m2
        >>> print(f"{section.centred().inertia()[0]:.6f} m4")  # (1 - 0.5^4) / 12
        0.078125 m4
    """
    outline = outlines.checked_corners(points, "points")
    holes = [outlines.checked_corners(hole, f"holes[{k}]") for k, hole in enumerate(holes or [])]
    _positive_length(size, "size")
    if size != size or not np.isfinite(size):
        raise ValueError(f"size = {size}: must be finite")
    made = meshes.polygon_mesh(outline, holes, float(size))
    whole, *inner = (abs(outlines.signed_area(ring)) for ring in (outline, *holes))
    net = whole - sum(inner)
    meshed = meshes.cell_areas(*made).sum() if len(made[1]) else 0.0
    # sums of areas agree to some 1e-13; crossing edges or holes outside change them by far more
    if not abs(meshed - net) <= 1e-9 * whole or meshed == 0:
        raise ValueError(outlines.describe_polygon_fault(outline, holes))
    quads = _quads_or_triangles(made[1], cells)
    # a strip that ends in a point has cells without area: leave them out
    quads = quads[meshes.cell_areas(made[0], quads) > 1e-14 * float(size) ** 2]
    return _mesh_section(cls, made[0], quads, law, placed=False)


def mesh(
    cls: type[NewSection],
    points: Float[ArrayLike, "n_point 2"],
    cells: Int[ArrayLike, "n_cell 3or4"],
    laws: Law | Sequence[Law],
) -> NewSection:
    """Make a section from a given mesh; its axis is at the origin of the points, as in `polygon`.

    Args:
        points: [n_point, 2] (y, z), m.
        cells: indices of points, [n_cell, 3] for triangles or [n_cell, 4] for quadrilaterals (where
            a triangle repeats its last point), clockwise or anticlockwise.
        laws: one law, or a list of laws, one for each cell.

    Returns:
        `Section` without torsion constant; beams warn of its axis as for `polygon`.

    Raises:
        ValueError: wrong shapes, unknown points, or the numbers of laws and cells differ.

    Example:
        Two triangles of different stiffness make a square of 0.1 m:

        >>> points = [[0.0, 0.0], [0.1, 0.0], [0.1, 0.1], [0.0, 0.1]]
        >>> laws = [jc.Elastic(100e9), jc.Elastic(200e9)]
        >>> section = jc.Section.mesh(points, [[0, 1, 2], [0, 2, 3]], laws)
        >>> print(f"{section.stiffness()[0, 0] / 1e6:.1f} MN")  # sum E A
        1500.0 MN
    """
    cells = np.asarray(cells)
    if cells.ndim != 2 or cells.shape[1] not in (3, 4):
        raise ValueError(f"cells: expected shape [n_cell, 3] or [n_cell, 4], got {cells.shape}")
    cells = checks.as_indices(cells, "cells", cells.shape[1])
    if cells.shape[1] == 3:
        cells = np.column_stack([cells, cells[:, 2]])
    points = checks.as_floats(points, "points")
    if points.ndim != 2 or points.shape[1] != 2:
        raise ValueError(f"points: expected shape [n_point, 2], got {points.shape}")
    if (cells >= len(points)).any():
        k = int((cells >= len(points)).any(axis=1).argmax())
        raise ValueError(f"cells[{k}] = {cells[k].tolist()}: there are {len(points)} points")
    if isinstance(laws, list | tuple):
        if len(laws) != len(cells):
            raise ValueError(f"laws: expected one, or {len(cells)}, one per cell, got {len(laws)}")
        laws, order, counts = group_by_law(laws)
        return _mesh_section(cls, points, cells[order], laws, counts=counts, placed=False)
    return _mesh_section(cls, points, cells, laws, placed=False)


def _mesh_section(
    cls, points, cells, laws, torsion=None, counts=None, round_inertia=None, placed=True
):
    """Return a section whose fibres are the cells of a mesh.

    `round_inertia` is the exact second moment of a circular shape, m4, which corrects that of the
    mesh; other arguments as the fields of `Section`.
    """
    area, centroid, moments = meshes.cell_moments(points, cells)
    y, z = centroid[:, 0], centroid[:, 1]
    if torsion is not None:
        torsion = stack_trees([torsion])
    if round_inertia is not None:
        # A polygon with the area of a circle has a little more inertia than the circle: the
        # difference is shared among the cells in proportion to their areas.
        total = moments.sum(0) + (area @ centroid[:, ::-1] ** 2)[np.array([0, 1, 1])]
        moments = moments + (area / area.sum())[:, None] * ((round_inertia - total) * _IY_IZ)[None]
    return cls(y, z, area, laws, counts, torsion, points, cells, moments, placed)


def _quads_or_triangles(quads, kind):
    """Return quadrilaterals [m, 4] as they are, or split if `kind` is "triangles"."""
    if kind not in _CELL_KINDS:
        raise ValueError(f"cells = {kind!r}: expected one of {_CELL_KINDS}")
    return quads if kind == "quadrilaterals" else meshes.split_into_triangles(quads)


def _checked_mesh_shape(shape, least=(1, 1)):
    """Return the `shape` of a mesh; ValueError unless it has integers, at least `least`."""
    ok = isinstance(shape, list | tuple) and len(shape) == len(least)
    ok = ok and all(
        isinstance(n, int | np.integer) and n >= m for n, m in zip(shape, least, strict=False)
    )
    if not ok:
        raise ValueError(f"shape = {shape}: expected {len(least)} integers, at least {least}")
    return shape


def _positive_length(value, name):
    """Return a dimension as a float; one that is not positive: ValueError, or NaN if traced."""
    return _float_if_known(nan_if_broken(positive(name, checks.as_floats(value, name))))


def _length_if_allowed(value, broken, name, text):
    """Return a dimension, m, as a float; where `broken` is true: ValueError, or NaN if traced."""
    return _float_if_known(nan_if_broken(Rule(name, (value, broken), lambda _, bad: bad, text)))


def _float_if_known(value):
    """Return a scalar dimension as a float, or unchanged if it is traced."""
    value = checks.as_scalar(value, "dimension")
    return value if checks.array_if_known(value) is None else float(value)
