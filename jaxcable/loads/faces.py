"""Faces of three or four nodes, as triangles."""

from __future__ import annotations

import jax.numpy as jnp
import numpy as np

from ..common import checks
from ..common.tree import Indices
from ..common.types import Array, ArrayLike, Float, Int
from ..model.structure import Structure

_SPLITS = {
    3: [((0, 1, 2), 1.0)],
    # A quadrilateral is the mean of both ways to split it: its area vector, and the volume under
    # it, are then those of the bilinear surface between its edges.
    4: [((0, 1, 2), 0.5), ((0, 2, 3), 0.5), ((0, 1, 3), 0.5), ((1, 2, 3), 0.5)],
}


def checked(faces: Int[ArrayLike, "n 3or4"]) -> Indices:
    """Faces [n, 3] or [n, 4] as `Indices`; ValueError for other shapes and degenerate faces."""
    if isinstance(faces, Indices):
        return faces
    array = np.asarray(faces)
    if array.ndim != 2 or array.shape[1] not in (3, 4) or len(array) == 0:
        raise ValueError(f"faces: expected node numbers [n, 3] or [n, 4], got shape {array.shape}")
    array = checks.integers(array, "faces", width=array.shape[1])
    few = np.array([len(set(face)) < 3 for face in array.tolist()])
    if few.any():
        k = int(few.argmax())
        raise ValueError(f"faces[{k}] = {array[k].tolist()}: a face has at least 3 different nodes")
    return Indices(array)


def known(faces: Indices, structure: Structure) -> None:
    """Raise ValueError if a node of the faces is unknown to the structure."""
    checks.known(faces.array, structure.n_node, "faces")


def area_vectors(
    corners: Float[Array, "*n 3or4 3"],
) -> list[tuple[tuple[int, int, int], Float[Array, "*n 3"]]]:
    """Area vectors of the triangles of faces with `corners` [..., 3 or 4, 3], m.

    Returns:
        List of (indices of the triangle's corners, area vector [..., 3], m2). The area vectors of a
        face add up to its own: triangles of a quadrilateral have half of theirs.
    """
    parts = []
    for numbers, share in _SPLITS[corners.shape[-2]]:
        a, b, c = (corners[..., k, :] for k in numbers)
        parts.append((numbers, 0.5 * share * jnp.cross(b - a, c - a)))
    return parts
