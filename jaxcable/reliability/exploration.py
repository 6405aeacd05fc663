"""The search for all design points: minima of the distance, from starts spread over directions.

A search (`search`) may end at a stationary point that is no minimum, or at a minimum that is not
the nearest one. So the curvature of the surface is looked at where it ends, a saddle is left along
the direction of negative curvature, and further searches begin elsewhere. Those that begin with
the surface bulged out around the points that are known follow Der Kiureghian and Dakessian,
Multiple design points in first and second-order reliability (Structural Safety 20, 1998).
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, NamedTuple

import jax
import numpy as np

from ..common import status
from ..common.types import Float, Int
from .curvature import difference_step, smallest_curvature
from .search import SearchPoint, search_from

_RADIUS, _RISE = 1.1, 0.75  # of bulges, over the distance from the origin, as published
_BULGED_TRIALS = 15  # evaluations; what follows is a search on the true surface
_FURTHER_TRIALS = 50  # evaluations of each search but the first
_INSIDE = 0.95  # of the distance of the first point, that of further starts: none fails there
_ESCAPES = 3  # restarts from saddles in a search
_LEAST_CURVATURE = 0.01  # that tightens the tolerance of the misalignment


class DesignPoint(NamedTuple):
    """A design point that is known.

    Attributes:
        point: place, with limit state and gradient.
        curvature: smallest principal curvature of the distance there; NaN if unknown.
        direction: unit vector in which the surface bends so, [n]; zero if there is none.
    """

    point: SearchPoint
    curvature: float
    direction: Float[np.ndarray, " n"]

    def estimated_error(self) -> float:
        """Return the estimated distance from the minimum: the misalignment over the curvature."""
        return self.point.misalignment() / self.curvature_within_limits()

    def curvature_within_limits(self) -> float:
        """Return the curvature, from 0.01 to 1; 1 where it is unknown.

        Near a sphere, below 0.01, all points are as near as the minimum, and no search could meet a
        tolerance of the direction: `FirstOrder.curvature` has the value itself, and shows where it
        is so. Above 1 the misalignment is the larger error already.
        """
        return min(max(np.nan_to_num(self.curvature, nan=1.0), _LEAST_CURVATURE), 1.0)


class ExplorationOutcome(NamedTuple):
    """Result of the search for all design points of one limit state.

    Attributes:
        status, iterations, evaluations, failures, distance, misalignment: as of `FirstOrder`.
        last: u at the nearest point, or where the last search ended, [n].
        points: `DesignPoint` of arrays with a leading axis [k], nearest first; NaN where there are
            fewer.
    """

    status: Int[np.ndarray, " *m"]
    iterations: Int[np.ndarray, " *m"]
    evaluations: Int[np.ndarray, " *m"]
    failures: Int[np.ndarray, " *m"]
    distance: Float[np.ndarray, " *m"]
    misalignment: Float[np.ndarray, " *m"]
    last: Float[np.ndarray, "*m n"]
    points: DesignPoint


class Exploration:
    """The search for all design points of a limit state.

    Args:
        limit_state: function of u to limit state and gradient.
        start: u where the first search begins, [n].
        tol: as for `search_from`.
        steps: largest number of accepted steps of each search.

    Attributes:
        code: status; INVALID_INPUT until it has run.
        last: u at the nearest point, or where the last search ended, [n].
        points: design points with an index of the same sign, nearest first.
        found: all design points in the order in which they were found.
        iterations, evaluations, failures: sums over all searches.
        nearest: least distances from the origin of points that fail (True), and that do not.
    """

    def __init__(
        self,
        limit_state: Callable[[Any], tuple[Any, Any]],
        start: Float[np.ndarray, " n"],
        tol: float,
        steps: int,
    ):
        self.limit_state, self.start, self.tol, self.steps = limit_state, start, tol, steps
        self.code, self.last = status.INVALID_INPUT, start
        self.points: list[DesignPoint] = []
        self.found: list[DesignPoint] = []
        self.iterations = self.evaluations = self.failures = 0
        self.nearest = {True: np.inf, False: np.inf}

    @np.errstate(all="ignore")
    def run(self, most: int) -> None:
        """Search from the start, then from other points, until `most` design points are known."""
        ends: list[Any] = []
        for start, is_bulged in self._start_points():
            ends.append(self._find_point(start, is_bulged, _FURTHER_TRIALS if ends else np.inf))
            goes_on = self.found or ends[0].code in (status.STATIONARY, status.NOT_NEAREST)
            if not goes_on or len(self.found) == most:
                break
        self.code, self.last = ends[0].code, ends[-1].point.u
        if self.found:
            near = sorted(self.found, key=lambda one: one.point.radius())
            first, falls = near[0].point, near[0].point.falls_outward()
            self.code = status.NOT_NEAREST  # if another point fails that is nearer
            if self.nearest[falls] >= (1 - difference_step(first.u.dtype)) * first.radius():
                # where it does not fall as there, the failed region ends, seen from the origin
                self.points = [one for one in near if one.point.falls_outward() == falls]
                self.code, self.last = status.OK, first.u

    def outcome(self, rows: int) -> ExplorationOutcome:
        """Return the outcome, with exactly `rows` rows of points, NaN in unused ones."""

        vector, number = np.full_like(self.start, np.nan), self.start.dtype.type(np.nan)
        none = DesignPoint(SearchPoint(vector, number, vector), number, vector)
        nearest, *_ = every = (self.points + [none] * rows)[:rows]
        numbers = self.code, self.iterations, self.evaluations, self.failures
        return ExplorationOutcome._make(
            [
                *(np.array(number, np.int32) for number in numbers),
                *(nearest.point.distance_to_limit_state(), nearest.estimated_error(), self.last),
                jax.tree.map(lambda *parts: np.stack(parts), *every),
            ]
        )

    def _start_points(self):
        """Yield where searches begin, and whether with a bulged surface, until they find nothing.

        They begin at the user's start and the origin; opposite to the first point, and beside it on
        either side in the direction in which the surface bends most; then on bulged surfaces.
        """
        start, (somewhere, aside, inside) = self.start, _fixed_random_directions(self.start)
        yield start, False
        if start.any():
            yield np.zeros_like(start), False
        yield -(self.found[0].point.u if self.found else somewhere), False
        if start.size == 1:  # one quantity has two directions
            return
        for side in (_INSIDE, -_INSIDE):
            size, along = 1.0, aside
            if self.found:
                point, _, direction = self.found[0]
                size, along = point.scale(), direction if direction.any() else aside
            yield side * size * along, False
        count = 0
        while len(self.found) > count:
            count = len(self.found)
            yield _INSIDE * self.found[0].point.scale() * inside, True

    def _find_point(self, start, is_bulged, trials):
        """Search for a design point from `start`, [n], and add it to those found if it is new.

        Args:
            is_bulged: whether to search first with the surface bulged out around known points.
            trials: largest number of evaluations.

        Returns:
            The `SearchEnd` of the last search.
        """
        known = [one.point for one in self.found]
        if is_bulged:
            end = self._search(self._bulged_at, self._bulged_at(start), self.tol, _BULGED_TRIALS)
            if end.code == status.BAD_START:
                return end
            start = end.point.u
        for escapes in range(_ESCAPES + 1):
            end = self._search(self._point_at, self._point_at(start), self.tol, trials, known)
            if end.code != status.OK:
                return end
            point = end.point
            one = DesignPoint(point, *smallest_curvature(self._point_at, point))
            if not one.curvature < -10 * difference_step(point.u.dtype):
                break
            side = 0.5 if escapes % 2 == 0 else -0.5
            start = point.u + side * point.scale() * one.direction
        else:
            return end._replace(code=status.NOT_NEAREST)
        if one.estimated_error() > self.tol * point.scale():
            least = min(64 * np.finfo(point.u.dtype).eps, self.tol)
            tol = max(one.curvature_within_limits() * self.tol, least)
            rest = trials - end.evaluations + 1
            end = self._search(self._point_at, point, tol, rest, known)._replace(code=status.OK)
        if not end.point.is_near(known):
            self.found.append(one._replace(point=end.point))
        return end

    def _search(self, evaluate, point, tol, trials, known=()):
        """Return the `SearchEnd` of `search_from`, whose arguments these are; count iterations."""
        end = search_from(evaluate, point, tol, self.steps, trials, known)
        self.iterations += end.iterations
        return end

    def _point_at(self, u):
        """Evaluate limit state and gradient at u, [n]: return the `SearchPoint`.

        It is counted, and so is the least distance from the origin of points that fail or
        not.
        """
        point = SearchPoint(u, *self.limit_state(u))
        self.evaluations += 1
        self.failures += not point.is_finite()
        if abs(point.value) > 0:
            fails = bool(point.value < 0)
            self.nearest[fails] = min(self.nearest[fails], point.radius())
        return point

    def _bulged_at(self, u):
        """Return the `SearchPoint` at u on the surface bulged out around all known points."""
        point = self._point_at(u)
        value, gradient = point.value, point.gradient
        for known, *_ in self.found:
            size, away = known.scale(), u - known.u
            inside = max((_RADIUS * size) ** 2 - away @ away, 0.0)
            rise = (-_RISE if known.gradient @ known.u > 0 else _RISE) * size * known.slope()
            factor = rise / ((_RADIUS**2 - _RISE**2) * size**2) ** 2
            value, gradient = value + factor * inside**2, gradient - 4 * factor * inside * away
        return SearchPoint(u, value, gradient)


def _fixed_random_directions(like):
    """Return three unit vectors in random directions, always the same, [3, n], for `like` [n]."""
    rows = np.random.default_rng(1).standard_normal((3, like.size))
    return (rows / np.linalg.norm(rows, axis=1, keepdims=True)).astype(like.dtype)
