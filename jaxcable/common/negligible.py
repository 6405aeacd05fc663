"""When a number is zero beside the others of its kind: one rule for tables, texts and pictures."""

from __future__ import annotations

import numpy as np

from .types import ArrayLike, Float

NEGLIGIBLE = 1e-7
"""Share of the largest number of a kind up to which a number is zero.

Analyses end with a residual of 1e-10 of the forces (`Newton.tol`), which makes moments of up to
1e-8 of the largest in slender beams.
"""


def zero_negligible(
    values: Float[ArrayLike, " ..."], largest: float | None = None
) -> Float[np.ndarray, " ..."]:
    """Return numbers with zeros in place of those at most 1e-7 of the largest magnitude; NaN stays.

    Args:
        values: numbers of one unit.
        largest: magnitude of the largest number of the kind, in the same unit; None for that of
            `values` themselves.
    """
    values = np.asarray(values, float)
    if largest is None:
        largest = float(np.nanmax(np.abs(values), initial=0.0))
    return np.where(np.abs(values) <= NEGLIGIBLE * largest, 0.0, values)


def vector_text(values: Float[ArrayLike, " n"]) -> str:
    """Return a vector as text, such as "(0, 0, -1)": six digits, negligible components as zero."""
    return f"({', '.join(f'{value:.6g}' for value in zero_negligible(values).tolist())})"
