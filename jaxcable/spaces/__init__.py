"""Spaces: degrees of freedom of nodes, and how the unknowns of an analysis move them.

In `Translations` nodes have displacements only (three degrees of freedom); in `RigidNodes`, which
beams need, also rotations (six). `assembly.System` contains elements, loads and a space, and works
with both alike.
"""

from __future__ import annotations

from collections.abc import Iterable

from .rigid_nodes import RigidNodes
from .space import ElementGroup, Space
from .translations import Translations

__all__ = ["RigidNodes", "Space", "Translations", "space_of"]


def space_of(groups: Iterable[ElementGroup]) -> type[Space]:
    """Return the class of `Space` that these element groups need: with rotations, or without."""
    return RigidNodes if any(group.rotates for group in groups) else Translations
