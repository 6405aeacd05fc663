"""Warning of coordinates so large that single precision leaves nothing of the elements."""

from __future__ import annotations

from collections.abc import Iterator, Sequence

import jax
import numpy as np

from ..common.types import Float
from ..elements.element import Element
from .plausibility import issues_warnings

MAX_RELATIVE_SPACING = 1e-4
"""Resolution of coordinates over the length of an element, beyond which strains are nothing but
rounding: prestrains are of order 1e-3."""


@issues_warnings
def warn_of_coarse_coordinates(
    nodes: Float[np.ndarray, "n_node 3"], named: Sequence[tuple[str, Element]]
) -> Iterator[str]:
    """Warn if coordinates, such as those of maps, are too large for single precision.

    That is so if their resolution in float32 exceeds 1e-4 of the shortest element. Nothing in
    double precision.

    Args:
        nodes: initial positions as they were given, [n_node, 3], m, NumPy.
        named: pairs of (key in the elements as text, group).
    """
    dtype = np.dtype(jax.dtypes.canonicalize_dtype(nodes.dtype))
    largest = np.abs(nodes).max(initial=0.0)
    if dtype != np.float32 or not np.isfinite(largest):
        return
    apart = float(np.spacing(np.float32(largest)))
    for where, group in named:
        links = group.links.array
        if links.shape[1] < 2 or links.max() >= len(nodes):
            continue
        chord = np.linalg.norm(np.diff(nodes[links].astype(float), axis=1), axis=2).sum(axis=1)
        if apart > MAX_RELATIVE_SPACING * chord.min():
            yield (
                f"nodes: a coordinate of {largest:.6g} m has a resolution of {apart:.2g} m in "
                f"float32, too coarse for elements{where}, which are {chord.min():.3g} m long and "
                "longer; put the origin near the structure (subtract in float64), or give float64 "
                'with jax.config.update("jax_enable_x64", True)'
            )
            return
