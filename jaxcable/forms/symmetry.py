"""Which elements are images of each other under the symmetry of a structure."""

from __future__ import annotations

import numpy as np

from ..common import checks
from ..common.types import Int, PyTree
from ..model.result_parts import group_path
from ..model.structure import Structure
from .equilibrium_matrix import arrange_as_elements, links_and_tension_only, nodes_as_numpy


def symmetric_groups(
    structure: Structure,
    fold: int,
    mirror: float | None = None,
    *,
    centre: tuple[float, float] = (0.0, 0.0),
    tol: float = 1e-6,
) -> PyTree[Int[np.ndarray, " n_elem"]]:
    """Number the elements so that elements that are images of each other have the same number.

    Only positions count. Supports need not be symmetric, since a self-stress does not load those
    of a free-standing structure. Elements of different element groups never share a number.

    Args:
        structure: `Structure` of `Bars` and `Cables`.
        fold: a rotation by 2 pi / fold about a vertical axis maps the structure on itself; 1 for no
            rotational symmetry.
        mirror: direction, rad from x, of a vertical plane of symmetry through the axis, or None.

    Options:
        centre: position of the axis, x and y, m.
        tol: allowed distance of an image from a node, relative to the size of the structure.

    Returns:
        Group numbers from 0 in the shape of the elements, each [n_elem], for `feasible_prestress`.

    Raises:
        ValueError: a node or an element has no image.

    Example:
        A prism is symmetric under a rotation by 120 degrees, which does not map one of its two
        triangles on the other:

        >>> structure, _ = jc.scenes.simplex()
        >>> groups = jc.forms.symmetric_groups(structure, fold=3)
        >>> {kind: number.tolist() for kind, number in groups.items()}
        {'struts': [0, 0, 0], 'triangles': [1, 1, 1, 2, 2, 2], 'verticals': [3, 3, 3]}
    """
    checks.require_whole_number(fold, "fold")
    from scipy.sparse import coo_array
    from scipy.sparse.csgraph import connected_components
    from scipy.spatial import cKDTree

    links, _ = links_and_tension_only(structure)
    nodes = nodes_as_numpy(structure, "symmetric_groups")
    nodes = nodes - np.array([*centre, 0.0])
    owner = np.repeat(np.arange(len(structure.groups)), [len(g.links) for g in structure.groups])
    ends = np.sort(links, axis=1)
    number = {(o, *pair): k for k, (o, pair) in enumerate(zip(owner, ends.tolist(), strict=True))}
    angle, maps = 2 * np.pi / int(fold), []
    if fold > 1:
        maps.append([[np.cos(angle), -np.sin(angle)], [np.sin(angle), np.cos(angle)]])
    if mirror is not None:
        maps.append(
            [
                [np.cos(2 * mirror), np.sin(2 * mirror)],
                [np.sin(2 * mirror), -np.cos(2 * mirror)],
            ]
        )
    tree, size = cKDTree(nodes), np.ptp(nodes, axis=0).max()
    joined = [(k, k) for k in range(len(links))]
    for matrix in maps:
        moved = nodes.copy()
        moved[:, :2] = nodes[:, :2] @ np.array(matrix).T
        distance, image = map(np.asarray, tree.query(moved))
        if distance.max() > tol * size:
            k = int(distance.argmax())
            raise ValueError(
                f"nodes[{k}]: its image under the symmetry is {distance[k]:.3g} m from any node; "
                "check `fold`, `mirror` and `centre`, or raise `tol` if coordinates are rounded"
            )
        for k, (group, pair) in enumerate(zip(owner, np.sort(image[links], axis=1), strict=True)):
            other = number.get((group, *pair.tolist()))
            if other is None:
                raise ValueError(
                    f"links: no element of {group_path(structure, int(group))} joins nodes "
                    f"{pair.tolist()}, the image of {links[k].tolist()} under the symmetry"
                )
            joined.append((k, other))
    first, second = np.array(joined).T
    graph = coo_array((np.ones(len(first)), (first, second)), shape=(len(links),) * 2)
    return arrange_as_elements(structure, connected_components(graph, directed=False)[1])
