"""Conditions of Karush, Kuhn and Tucker (KKT) at a point: Lagrange multipliers and residual.

This verifies the end of a search from its numbers alone, whatever a library says of it. The
conditions are of first order: minima meet them, and so do saddle points and maxima.
"""

from __future__ import annotations

import numpy as np
import scipy  # its parts are imported where they are first used

from ..common.types import Float
from .bounds import BoxBounds
from .trials import TrialPoint

_NEAR = 1e-3  # constraints further below zero, and bounds further away over sizes, are not active
_ITERATIONS = 30  # of nonnegative least squares, for each active limit: ten times the usual limit


def solve_kkt_conditions(
    point: TrialPoint,
    box: BoxBounds,
    size: Float[np.ndarray, " n"],
    margin: float,
) -> tuple[Float[np.ndarray, " m"], float]:
    """Find the Lagrange multipliers with which the KKT conditions of a minimum hold best.

    They are nonnegative, found by least squares. (KKT: Karush, Kuhn and Tucker.)

    Args:
        point: parameters [n], loss and constraints [m] with their derivatives.
        box: `BoxBounds` of the parameters; they get multipliers, too.
        size: typical sizes of the parameters, [n].
        margin: a constraint counts as active at ``c = -margin``.

    Returns:
        The multipliers of the constraints, [m], and the KKT residual. This is the largest of two
            kinds of terms, both changes of the loss to first order: an entry of the gradient of the
            Lagrangian times the size of its parameter; a multiplier times the distance of its
            constraint or bound from being active. NaN and infinity if the analysis has failed.
    """
    n, m = len(point.x), len(point.constraints)
    if point.failed:
        return np.full(m, np.nan), np.inf
    rows = np.concatenate([point.jacobian[1:] * size, -np.eye(n), np.eye(n)])
    below = np.maximum(0.0, -(point.constraints + margin))
    slack = np.concatenate([below, (point.x - box.lower) / size, (box.upper - point.x) / size])
    near = np.flatnonzero(slack <= _NEAR)
    gradient = point.gradient * size
    force = np.zeros(m + 2 * n)
    largest = np.abs(gradient).max()
    if len(near) and largest > 0:
        matrix = np.concatenate([rows[near].T, np.diag(slack[near])])
        target = np.concatenate([-gradient / largest, np.zeros(len(near))])
        try:
            force[near] = (
                largest * scipy.optimize.nnls(matrix, target, maxiter=_ITERATIONS * len(near))[0]
            )
        except RuntimeError:  # it has not ended
            return np.full(m, np.nan), np.inf
    left = np.abs(gradient + rows.T @ force).max()
    return force[:m], float(max(left, (force[near] * slack[near]).max(initial=0.0)))
