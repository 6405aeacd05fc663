"""Spaces: degrees of freedom of nodes, and how the unknowns of an analysis move them.

In `Translations` nodes have displacements only (three degrees of freedom); in `RotatingNodes`,
which beams need, also rotations (six). `assembly.System` contains elements, loads and a space, and
works with both alike.
"""

from __future__ import annotations

from collections.abc import Iterable

from .rotating_nodes import RotatingNodes
from .space import ElementGroup, Space
from .translations import Translations

__all__ = ["RotatingNodes", "Space", "Translations", "space_class"]


def space_class(groups: Iterable[ElementGroup]) -> type[Space]:
    """Return the class of `Space` that these element groups need: with rotations, or without."""
    return RotatingNodes if any(group.gives_rotations for group in groups) else Translations
