"""The search for a design point: the point of a limit state surface that is nearest to the origin.

The iteration is that of Hasofer and Lind (1974) and Rackwitz and Fiessler (1978), with the merit
function and line search of Zhang and Der Kiureghian (1995), by which it converges from anywhere
where the limit state is smooth.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import NamedTuple

import numpy as np

from ..common import status
from ..common.types import Float

_SUFFICIENT = 0.1  # part of the promised decrease of the merit that a step must bring
_PENALTY = 2.0  # over the least penalty with which the direction is one of descent
_SHORTEST = 2.0**-20  # step, of the full one
_APART = 0.05  # least distance of two design points, over that from the origin (at least 1)


class SearchPoint(NamedTuple):
    """A point in standard normal space, with what is known there.

    Also of traced arrays, except for comparisons.

    Attributes:
        u: standard normal values.
        value, gradient: limit state and its derivative by u.
    """

    u: Float[np.ndarray, " n"]
    value: float
    gradient: Float[np.ndarray, " n"]

    def is_finite(self) -> bool:
        """Return whether limit state and gradient are finite numbers at the point."""
        return bool(np.isfinite(self.value) and np.isfinite(self.gradient).all())

    def radius(self) -> float:
        """Return the distance of the point from the origin of standard normal space."""
        return _norm(self.u)

    def scale(self) -> float:
        """Return the distance from the origin, at least 1, by which tolerances are multiplied."""
        return max(_norm(self.u), 1.0)

    def slope(self) -> float:
        """Return the length of the gradient of the limit state, ``|dG/du|``."""
        return _norm(self.gradient)

    def alpha(self) -> Float[np.ndarray, " n"]:
        """Return the unit vector along which the limit state falls, [n]."""
        return -self.gradient / self.slope()

    def beta(self) -> float:
        """Return the distance of the linearized limit state surface from the origin.

        Negative if the linearized limit state is violated at the origin.
        """
        return self.alpha() @ self.u + self.value / self.slope()

    def distance_to_limit_state(self) -> float:
        """Return the distance to the limit state surface, to first order: ``|G| / |dG/du|``."""
        return abs(self.value) / self.slope()

    def misalignment(self) -> float:
        """Return the distance of the point from the line through the origin along the gradient."""
        return _norm(self.u - (self.alpha() @ self.u) * self.alpha())

    def falls_outward(self) -> bool:
        """Return whether the limit state decreases in the direction away from the origin."""
        return bool(self.gradient @ self.u < 0)

    def is_near(self, others: Sequence[SearchPoint]) -> bool:
        """Return whether a point is the same design point as one of others.

        It is if their distance is below 5 % of that from the origin (at least 1).
        """
        return any(_norm(self.u - other.u) < _APART * self.scale() for other in others)


class SearchEnd(NamedTuple):
    """The end of a search.

    Attributes:
        point: last accepted point.
        code: status; OUT_OF_STEPS also if it has come to a known point.
        iterations, evaluations: accepted steps, and evaluations with that of the start.
    """

    point: SearchPoint
    code: int
    iterations: int
    evaluations: int


def search_from(
    evaluate: Callable[[Float[np.ndarray, " n"]], SearchPoint],
    point: SearchPoint,
    tol: float,
    steps: int,
    trials: float = np.inf,
    known: Sequence[SearchPoint] = (),
) -> SearchEnd:
    """Search for a design point.

    Args:
        evaluate: function of u to a `SearchPoint`.
        point: start.
        tol: tolerance of distance and misalignment, over the distance from the origin (at least 1).
        steps: largest number of accepted steps.
        trials: largest number of evaluations, with that of the start.
        known: design points near which the search ends.
    """
    iterations, evaluations, length = 0, 1, 1.0
    code = _status_at(point, iterations, steps, tol) if point.is_finite() else status.BAD_START
    while code is None and evaluations < trials:
        trial = evaluate(point.u + length * _hlrf_step(point))
        evaluations += 1
        if not _is_accepted(trial, point, length, tol):
            length *= 0.5
            code = status.STALLED if length < _SHORTEST else None
            continue
        point, length, iterations = trial, 1.0, iterations + 1
        code = _status_at(point, iterations, steps, tol)
        if point.is_near(known):
            code = status.OUT_OF_STEPS
    return SearchEnd(point, status.OUT_OF_STEPS if code is None else code, iterations, evaluations)


def _status_at(point, iterations, steps, tol):
    """Return the status with which a search ends at a point; None if it goes on.

    `iterations` have been made, of `steps` allowed; `tol` is as of `search_from`.
    """
    allowed = tol * point.scale()
    if point.slope() == 0:
        return status.STALLED if iterations else status.STATIONARY
    if point.distance_to_limit_state() <= allowed and point.misalignment() <= allowed:
        return status.OK
    return status.OUT_OF_STEPS if iterations == steps else None


def _hlrf_step(point):
    """Return the step, [n], to the nearest point of the linearized limit state surface."""
    return point.beta() * point.alpha() - point.u


def _is_accepted(trial, point, length, tol):
    """Return whether `trial`, at a part `length` of the full step from `point`, lowers the merit.

    It must do so by a part of what the linearized limit state promises (Armijo); `tol` is the
    tolerance of the search.
    """
    step = _hlrf_step(point)
    # of both ends: the origin needs one, and a larger one where the surface is met, as of the ratio
    # of goal and limit state, would forbid to go along a curved surface
    penalty = _PENALTY * max(point.radius(), _norm(point.u + step)) / point.slope()
    before, after = (0.5 * one.u @ one.u + penalty * abs(one.value) for one in (point, trial))
    promised = point.u @ step - penalty * abs(point.value)
    # rounding of the merit, and what the analysis leaves of its residual
    slack = max(64 * np.finfo(point.u.dtype).eps, tol**2) * (1 + before)
    return trial.is_finite() and after <= before + _SUFFICIENT * length * promised + slack


def _norm(vector):
    """Return the Euclidean length of a vector."""
    return (vector @ vector) ** 0.5
