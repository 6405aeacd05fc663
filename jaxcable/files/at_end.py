"""What files of a structure at the end of an analysis share: a path, its state, its numbers."""

from __future__ import annotations

from collections.abc import Sequence
from os import PathLike
from pathlib import Path

import numpy as np

from ..analysis.solution import Solution, State
from ..common.types import Float
from ..elements.element import Element
from ..model.parts import one_case
from ..model.structure import Structure
from ..model.topology import require_same


def file_path(path: str | PathLike[str], suffix: str) -> Path:
    """The path of a file; ValueError unless it ends with `suffix`."""
    path = Path(path)
    if path.suffix.lower() != suffix:
        raise ValueError(f"path = {str(path)!r}: expected a name that ends with {suffix}")
    return path


def end_state(structure: Structure, solution: Solution) -> State:
    """The last state of one analysis of a structure; ValueError for a batch, or another one's."""
    one_case(solution)
    require_same(structure, solution.last.topology, "solution")
    return solution.last


def of_all_elements(
    groups: Sequence[Element], values: Sequence[Float[np.ndarray, " n_elem"] | None]
) -> Float[np.ndarray, " n_all"]:
    """Values of all elements, [n_elem] through all groups; NaN where a group has none."""
    parts = zip(groups, values, strict=True)
    return np.concatenate([np.full(len(g.links), np.nan) if v is None else v for g, v in parts])
