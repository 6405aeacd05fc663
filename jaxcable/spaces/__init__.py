"""Spaces: what a node's motion is made of, and what the unknowns of an analysis do to it.

`Translations`, where nodes have displacements alone, and `RigidNodes`, where beams give them
rotations as well. `assembly.System` holds elements, loads and a space, and knows no width.
"""

from __future__ import annotations

from collections.abc import Iterable

from .rigid_nodes import RigidNodes
from .space import Group, Space
from .translations import Translations

__all__ = ["RigidNodes", "Space", "Translations", "space_of"]


def space_of(groups: Iterable[Group]) -> type[Space]:
    """The space that a structure of these element groups needs."""
    return RigidNodes if any(group.rotates for group in groups) else Translations
