"""Faces of three or four nodes: their areas as triangles, and loads on them."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

import jax.numpy as jnp
import numpy as np

from ..common import checks
from ..common.tree import Indices, set_fields
from ..common.types import Array, ArrayLike, Bool, Float, Int
from ..model.result_parts import group_path
from ..model.structure import Structure
from ..numerics import scaled
from .groups import OnGroups
from .load import Groups, States

_SPLITS = {
    3: [((0, 1, 2), 1.0)],
    # A quadrilateral is the mean of both ways to split it: its area vector, and the volume under
    # it, are then those of the bilinear surface between its edges.
    4: [((0, 1, 2), 0.5), ((0, 2, 3), 0.5), ((0, 1, 3), 0.5), ((1, 2, 3), 0.5)],
}


def as_faces(faces: Int[ArrayLike, "n 3or4"]) -> Indices:
    """Check node numbers of faces, [n, 3] or [n, 4] (ValueError); return them as `Indices`."""
    if isinstance(faces, Indices):
        return faces
    array = np.asarray(faces)
    if array.ndim != 2 or array.shape[1] not in (3, 4) or len(array) == 0:
        raise ValueError(f"faces: expected node numbers [n, 3] or [n, 4], got shape {array.shape}")
    array = checks.as_indices(array, "faces", width=array.shape[1])
    few = np.array([len(set(face)) < 3 for face in array.tolist()])
    if few.any():
        k = int(few.argmax())
        raise ValueError(f"faces[{k}] = {array[k].tolist()}: a face has at least 3 different nodes")
    return Indices(array)


def area_vectors(
    corners: Float[Array, "*n 3or4 3"],
) -> list[tuple[tuple[int, int, int], Float[Array, "*n 3"]]]:
    """Return the area vectors of the triangles of faces with `corners` [..., 3 or 4, 3], m.

    Returns:
        List of (indices of the triangle's corners, area vector [..., 3], m2), whose vectors add up
        to the area vector of the face. A quadrilateral has four triangles, from both ways to split
        it in two, each with half of its area vector.
    """
    parts = []
    for numbers, share in _SPLITS[corners.shape[-2]]:
        a, b, c = (corners[..., k, :] for k in numbers)
        parts.append((numbers, 0.5 * share * jnp.cross(b - a, c - a)))
    return parts


def face_areas(corners: Float[Array, "*n 3or4 3"]) -> Float[Array, "*n"]:
    """Return the areas of faces, m2, with `corners` [..., 3 or 4, 3], m.

    The area of a quadrilateral is the mean over both ways to split it into two triangles.
    """
    return sum(scaled.safe_norm(vector) for _, vector in area_vectors(corners))  # type: ignore[return-value]  # not empty


class OnFaces(OnGroups):
    """Base of loads on faces: either given faces, or those of element groups (`Element.face`).

    Attributes:
        faces: node numbers, `Indices` [n_face, 3] or [n_face, 4]; None for faces of groups.
        on: `Key` of the group whose faces are loaded; None means `faces`, or without them all
            groups that have some.
    """

    faces: Int[ArrayLike, "n_face 3or4"] | None

    def _check_faces(self):
        """Raise ValueError for wrong faces or values, or faces beside `on` or `elements`."""
        self._check_selection()
        if self.faces is None:
            return self._check_value_shape()
        for name in ("on", "elements"):
            if getattr(self, name) is not None:
                raise ValueError(
                    f"faces, {name}: both are given; give either faces, or a group whose elements "
                    "have faces"
                )
        set_fields(self, faces=as_faces(self.faces))
        return self._check_value_shape(len(self.faces))

    def _location_text(self):
        """Return the loaded faces or group in words, " on 4 faces"."""
        return super()._location_text() if self.faces is None else f" on {len(self.faces)} faces"

    def loaded_groups(
        self, structure: Structure
    ) -> tuple[tuple[int, ...], Bool[np.ndarray, " n_elem"] | None]:
        """Return indices of the loaded groups, and a mask of their loaded elements, [n_elem].

        The mask is None if all elements are loaded. There are no groups if `faces` are given.
        """
        if self.faces is not None:
            return (), None
        numbers, mask = super().loaded_groups(structure)
        groups = structure.groups
        kept = tuple(number for number in numbers if groups[number].face is not None)
        if not kept or (self.on is not None and len(kept) < len(numbers)):
            k = next(number for number in numbers if number not in kept)
            given = "faces: missing" if self.on is None else f"on = {self.on!r}"
            raise ValueError(
                f"{given}: {group_path(structure, k)} "
                f"({type(groups[k]).__name__}) has no faces; give "
                "faces=... (net_faces finds those of a net), or on=... a group of surfaces "
                "(a class with face = (0, 1, 2), the ends around the face of an element)"
            )
        return kept, mask

    def check(self, structure: Structure) -> None:
        """Raise ValueError if a node is unknown to the structure, or a group has no faces."""
        if self.faces is not None:
            checks.require_known_nodes(self.faces.array, structure.n_node, "faces")
        self._check_value_counts(structure, self.loaded_groups(structure)[0])

    def coupled_nodes(self, groups: Groups) -> list[Indices]:
        """Return nodes whose forces are coupled: around each loaded face, a list of [n, 3 or 4]."""
        if self.faces is not None:
            return [self.faces]
        found = [groups[number] for number in self.on]
        return [Indices(np.asarray(group.links)[:, group.face]) for group in found]

    def _faces_and_values(
        self, groups: Groups, states: States, dtype: Any
    ) -> Iterator[tuple[Any, Float[Array, "n_face ..."]]]:
        """Iterate over loaded faces, group by group, with the value of the load on each.

        Yields:
            Node numbers around faces, [n_face, 3 or 4]; values of the field named by `varies`,
            [n_face, ...], zero where the load does not act or the element is inactive.
        """
        name, one = self.varies  # type: ignore[misc]  # loads on faces have such a field
        values = getattr(self, name).astype(dtype)
        if self.faces is not None:
            yield self.faces, jnp.broadcast_to(values, (len(self.faces), *one))
            return
        for number in self.on:
            faces = groups[number].links[:, np.array(groups[number].face)]
            own = jnp.broadcast_to(values, (len(faces), *one))
            yield faces, self.apply_element_factors(number, own, states[number])
