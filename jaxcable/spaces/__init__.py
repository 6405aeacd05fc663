"""Spaces: what a node's motion is made of, and what the unknowns of an analysis do to it.

In `Translations` nodes have displacements only; in `RigidNodes` beams give them rotations, too.
`assembly.System` contains elements, loads and a space, and works with both alike.
"""

from __future__ import annotations

from collections.abc import Iterable

from .rigid_nodes import RigidNodes
from .space import Group, Space
from .translations import Translations

__all__ = ["RigidNodes", "Space", "Translations", "space_of"]


def space_of(groups: Iterable[Group]) -> type[Space]:
    """The space that a structure with these element groups needs."""
    return RigidNodes if any(group.rotates for group in groups) else Translations
