"""Conditions of Karush, Kuhn and Tucker at a point: multipliers, and by how much they are missed.

This judges the end of a search from its numbers alone, whatever a library says of it.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from scipy import optimize

from ..common.types import Float
from .trials import Point

_NEAR = 1e-3  # constraints further below zero, and bounds further away over sizes, have no force
_TURNS = 30  # of nonnegative least squares for each of these; three times as many are usual


class Optimality(NamedTuple):
    """Multipliers of the constraints [m], and what is missing to a minimum.

    `missing` is the largest of two numbers: what the gradient of the Lagrangian leaves, times the
    size of the parameter; and a multiplier times the distance from its limit. Both are changes of
    the loss to first order.
    """

    multipliers: Float[np.ndarray, " m"]
    missing: float


def optimality(
    point: Point,
    lower: Float[np.ndarray, " n"],
    upper: Float[np.ndarray, " n"],
    size: Float[np.ndarray, " n"],
    margin: float,
) -> Optimality:
    """Find the multipliers, none negative, that miss the conditions least, in the least squares.

    Args:
        point: a sound point.
        lower, upper: bounds on its parameters, which have multipliers, too.
        size: sizes of the parameters.
        margin: constraints are active at minus this.
    """
    n, m = len(point.x), len(point.constraints)
    rows = np.concatenate([point.jacobian * size, -np.eye(n), np.eye(n)])
    slack = np.concatenate(
        [
            np.maximum(0.0, -(point.constraints + margin)),
            (point.x - lower) / size,
            (upper - point.x) / size,
        ]
    )
    near = np.flatnonzero(slack <= _NEAR)
    gradient = point.gradient * size
    matrix = np.concatenate([rows[near].T, np.diag(slack[near])])
    target = np.concatenate([-gradient, np.zeros(len(near))])
    force = np.zeros(m + 2 * n)
    largest = np.abs(gradient).max(initial=0.0)
    if len(near) and largest > 0:
        force[near] = largest * optimize.nnls(matrix, target / largest, maxiter=_TURNS * len(near))[0]
    left = np.abs(gradient + rows.T @ force).max(initial=0.0)
    return Optimality(force[:m], float(max(left, (force[near] * slack[near]).max(initial=0.0))))
