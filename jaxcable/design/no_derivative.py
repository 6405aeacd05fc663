"""Missing derivatives of users' functions, as at a norm of zero: a warning."""

from __future__ import annotations

from typing import Any

import numpy as np

from ..common import status
from ..common.checks import warn_user
from ..common.types import ArrayLike, Float, Int, PyTree
from .bounds import entry_names


def warn_of_undefined_derivative(
    values: Float[ArrayLike, " *m"],
    jacobian: Float[ArrayLike, "*m n"],
    code: Int[ArrayLike, ""] = status.OK,
    *,
    params: PyTree[Any],
) -> None:
    """Warn if the derivative of a user's function is not finite where its value is.

    Args:
        values, jacobian, code: value or values, derivative and status at the start of a search.
        params: pytree of arrays, whose entries are named, in the order of the n parameters.
    """
    bad = ~np.isfinite(np.asarray(jacobian))
    if int(code) != status.OK or not np.isfinite(np.asarray(values)).all() or not bad.any():
        return
    names = entry_names(params)
    found = [f"params{names[k]}" for k in np.flatnonzero(bad.reshape(-1, len(names)).any(axis=0))]
    rows = np.flatnonzero(bad.any(axis=1)) if bad.ndim == 2 else []
    of = f" of value {', '.join(map(str, rows[:5]))}{', ...' * (len(rows) > 5)}" * (len(rows) > 0)
    warn_user(
        f"the derivative{of} by {', '.join(found[:5])}{', ...' * (len(found) > 5)} is not finite, "
        "though the value is, and the analysis has converged. Does the function take a norm or a "
        "square root of zero, as of the displacement of a support? Leave out such entries, or take "
        "their squares"
    )
