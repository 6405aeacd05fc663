"""What writers of the end of an analysis share: the path, the end state, values of all groups."""

from __future__ import annotations

from collections.abc import Sequence
from os import PathLike
from pathlib import Path

import numpy as np

from ..analysis.solution import Solution, State
from ..common.types import Float
from ..elements.element import Element
from ..model.result_parts import require_single_case
from ..model.structure import Structure
from ..model.topology import require_same_topology


def require_suffix(path: str | PathLike[str], suffix: str) -> Path:
    """Return the path as a `Path`; raise ValueError unless it ends with a suffix such as ".dxf"."""
    path = Path(path)
    if path.suffix.lower() != suffix:
        raise ValueError(f"path = {str(path)!r}: expected a name that ends with {suffix}")
    return path


def end_state(structure: Structure, solution: Solution) -> State:
    """Return the last converged state of an analysis, ``solution.last``.

    Raise ValueError for a batch, or if `structure` has another topology than the one analysed.
    """
    require_single_case(solution)
    require_same_topology(structure, solution.last.topology, "solution")
    return solution.last


def concatenate_groups(
    groups: Sequence[Element], values: Sequence[Float[np.ndarray, " n_elem"] | None]
) -> Float[np.ndarray, " n_all"]:
    """Concatenate element values of all groups to an array, [n_all]; NaN for groups without values.

    `values` has an array [n_elem], or None, for each of the `groups`.
    """
    parts = zip(groups, values, strict=True)
    return np.concatenate([np.full(len(g.links), np.nan) if v is None else v for g, v in parts])
