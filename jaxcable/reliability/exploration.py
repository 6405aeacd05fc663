"""The search for all design points: minima of the distance, from starts spread over directions.

A search (`search`) may end at a stationary point that is no minimum, or at a minimum that is not
the nearest one. So the curvature of the surface is looked at where it ends, a saddle is left along
the direction of negative curvature, and further searches begin elsewhere. Those that begin with
the surface bulged out around the points that are known follow Der Kiureghian and Dakessian,
Multiple design points in first and second-order reliability (Structural Safety 20, 1998).
"""

from __future__ import annotations

from typing import NamedTuple

import jax.numpy as jnp
import numpy as np

from ..common import status
from ..common.tree import select_tree
from ..common.types import Array, Bool, Float, Int
from .curvature import Curvature, begin_curvature, difference_step, probe_curvature
from .search import Point, SearchState, advance_search, begin_search

_RADIUS, _RISE = 1.1, 0.75  # of bulges, over the distance from the origin, as published
_BULGED_TRIALS = 15  # evaluations; what follows is a search on the true surface
_FURTHER_TRIALS = 50  # evaluations of each search but the first
_INSIDE = 0.95  # of the distance of the first point, that of further starts: none fails there
_APART = 0.05  # least distance of two design points, over that from the origin (at least 1)
_ESCAPES = 3  # restarts from saddles in a search
_LEAST_CURVATURE = 0.01  # that tightens the tolerance of the misalignment
# further starts by their numbers, and from `_BULGED` on bulged surfaces; the first is the user's
_ORIGIN, _OPPOSITE, _ALONG, _AGAINST, _BULGED = range(1, 6)


class DesignPointSet(NamedTuple):
    """Design points that are known, in rows of which the first `n_points` are filled.

    Attributes:
        points: `Point`, each array with a leading axis [k].
        curvature: smallest principal curvature of the distance there, [k].
        n_points: number of them.
    """

    points: Point
    curvature: Float[Array, " k"]
    n_points: Int[Array, ""]

    def filled(self) -> Bool[Array, " k"]:
        """Return which rows are filled, [k]."""
        return jnp.arange(len(self.curvature)) < self.n_points

    def distances_to(self, u: Float[Array, " n"]) -> Float[Array, " k"]:
        """Return the distances of a point from those known, [k]; infinite for empty rows."""
        apart = jnp.sqrt(jnp.sum((self.points.u - u[None]) ** 2, axis=1))
        return jnp.where(self.filled(), apart, jnp.inf)

    def bulges_at(self, u: Float[Array, " n"]) -> tuple[Float[Array, ""], Float[Array, " n"]]:
        """Return what bulges around all known points add to limit state and gradient at u."""
        points = self.points
        slope = jnp.sqrt(jnp.sum(points.gradient**2, axis=1))
        falls = jnp.sum(points.gradient * points.u, axis=1) <= 0
        size = jnp.maximum(jnp.sqrt(jnp.sum(points.u**2, axis=1)), 1.0)
        away = u[None] - points.u
        inside = (_RADIUS * size) ** 2 - jnp.sum(away**2, axis=1)
        inside = jnp.where(self.filled(), jnp.maximum(inside, 0.0), 0.0)
        rise = jnp.where(falls, _RISE, -_RISE) * size * slope
        factor = rise / ((_RADIUS**2 - _RISE**2) * size**2) ** 2
        gradient = -4 * (factor * inside) @ away
        return jnp.sum(factor * inside**2), gradient

    def include(self, point: Point, curvature: Float[Array, ""]) -> DesignPointSet:
        """Return the set with a further point, unless it is known or there is no empty row."""
        size = jnp.maximum(jnp.sqrt(jnp.sum(point.u**2)), 1.0)
        is_new = jnp.min(self.distances_to(point.u)) > _APART * size
        row = is_new & (np.arange(len(self.curvature)) == self.n_points)

        def put(array, new):
            return jnp.where(row if array.ndim == 1 else row[:, None], new[None], array)

        points = Point(*(put(*pair) for pair in zip(self.points, point, strict=True)))
        return DesignPointSet(points, put(self.curvature, curvature), self.n_points + jnp.any(row))

    def by_distance(self) -> tuple[Point, Float[Array, " k"], Int[Array, ""]]:
        """Return points and curvatures, nearest first, and how many have the sign of the nearest.

        A point where the index has the other sign is one at which the failed region ends, seen from
        the origin. Further rows repeat the nearest point.
        """
        radius, falls = self._radius_and_sign()
        is_like = self.filled() & (falls == jnp.any(falls & (radius == jnp.min(radius))))
        radius = jnp.where(is_like, radius, jnp.inf)
        row, count = np.arange(len(radius)), jnp.sum(is_like)
        earlier = (radius[:, None] < radius[None]) | (
            (radius[:, None] == radius[None]) & (row[:, None] < row[None])
        )
        rank = jnp.sum(earlier, axis=0)
        wanted = jnp.where(row < count, row, 0)
        chosen = jnp.where(wanted[:, None] == rank[None], 1.0, 0.0).astype(radius.dtype)
        points = Point(*(chosen @ array for array in self.points))
        unknown = jnp.isnan(self.curvature)
        curvature = chosen @ jnp.where(unknown, 0.0, self.curvature)
        unknown = (chosen @ unknown.astype(radius.dtype)) > 0
        return points, jnp.where(unknown, jnp.nan, curvature), count

    def nearest(self) -> tuple[Float[Array, ""], Bool[Array, ""]]:
        """Return the distance of the nearest point, and whether the origin has not failed."""
        radius, falls = self._radius_and_sign()
        return jnp.min(radius), jnp.any(falls & (radius == jnp.min(radius)))

    def _radius_and_sign(self):
        """Return the distances from the origin, [k], and where the limit state falls outward."""
        radius = self.distances_to(jnp.zeros_like(self.points.u[0]))
        return radius, jnp.sum(self.points.gradient * self.points.u, axis=1) < 0


class Exploration(NamedTuple):
    """State of the search for all design points.

    Attributes:
        trial: point that is evaluated next, [n].
        search: present search.
        curvature: what is known of the curvature where it has ended.
        is_probing: whether the next point is one of those for the curvature.
        is_bulged: whether the surface is bulged out around known points.
        tightening: factor of the tolerance, below 1 where the surface is nearly a sphere.
        number: number of the start of the present search (0: the user's; 1: the origin).
        escapes: number of restarts from saddles in this search.
        count_before: number of design points before this search.
        direction: direction in which the surface bends most to the origin at the first point, [n].
        found: known design points.
        nearest: least distance from the origin of points that failed, and that did not, [2].
        iterations, evaluations, failures: sums over all searches.
        code: status of the first search, and of all in the end; below zero before.
        running: whether it goes on.
    """

    trial: Float[Array, " n"]
    search: SearchState
    curvature: Curvature
    is_probing: Bool[Array, ""]
    is_bulged: Bool[Array, ""]
    tightening: Float[Array, ""]
    number: Int[Array, ""]
    escapes: Int[Array, ""]
    count_before: Int[Array, ""]
    direction: Float[Array, " n"]
    found: DesignPointSet
    nearest: Float[Array, " 2"]
    iterations: Int[Array, ""]
    evaluations: Int[Array, ""]
    failures: Int[Array, ""]
    code: Int[Array, ""]
    running: Bool[Array, ""]


def begin_exploration(
    start: Float[Array, " n"], valid: Bool[Array, ""], points: int
) -> Exploration:
    """Return the state before the first evaluation.

    Args:
        start: where the first search begins, [n].
        valid: whether the numbers of the task keep their rules.
        points: largest number of design points.
    """
    search = begin_search(start, valid)
    count, no = jnp.zeros((), jnp.int32), jnp.zeros((), bool)
    rows, one = jnp.zeros((points, start.size), start.dtype), jnp.ones((), start.dtype)
    none = Point(rows, rows[:, 0], rows)
    return Exploration(
        *(start, search, begin_curvature(search.point), no, no, one),
        *(jnp.where(jnp.any(start != 0), 0, _ORIGIN).astype(jnp.int32), count, count),
        _spread_directions(start)[1],
        DesignPointSet(none, rows[:, 0], count),
        jnp.full(2, jnp.inf, start.dtype),
        *(count, count, count, search.code, search.running),
    )


def advance_exploration(
    state: Exploration,
    value: Float[Array, ""],
    gradient: Float[Array, " n"],
    tol: Float[Array, ""],
    steps: int,
) -> Exploration:
    """Return the next state, by limit state and gradient at ``state.trial``.

    Args:
        state: present state.
        value, gradient: limit state and its derivative at the trial point.
        tol: as for `advance_search`.
        steps: largest number of accepted steps of each search.
    """
    radius = jnp.sqrt(jnp.sum(state.trial**2))
    seen = jnp.where(jnp.stack([value < 0, value > 0]), radius, jnp.inf)
    state = state._replace(nearest=jnp.minimum(state.nearest, seen))
    probed = _after_probe(state, gradient)
    searched = _after_step(state, value, gradient, tol, steps)
    state, is_over = select_tree(state.is_probing, probed, searched)
    judged = _judge_point(state, tol)
    state, is_over = select_tree(is_over & state.is_probing, judged, (state, is_over))
    state = select_tree(is_over, _begin_next(state), state)
    trial = state.search.trial()
    probe = state.curvature.trial(state.search.point)
    return state._replace(trial=jnp.where(state.is_probing, probe, trial))


def _after_probe(state, gradient):
    """Return the state after a probe of the curvature, and whether it is known now."""
    curvature = probe_curvature(state.curvature, state.search.point, gradient)
    sound = jnp.all(jnp.isfinite(gradient))
    counts = {"evaluations": state.evaluations + 1, "failures": state.failures + ~sound}
    return state._replace(curvature=curvature, **counts), curvature.is_known


def _after_step(state, value, gradient, tol, steps):
    """Return the state after a trial of the search, and whether this search has failed."""
    rise, slope = state.found.bulges_at(state.trial)
    value = value + jnp.where(state.is_bulged, rise, 0.0)
    gradient = gradient + jnp.where(state.is_bulged, slope, 0.0)
    least = 64 * float(jnp.finfo(value.dtype).eps)
    tight = jnp.maximum(state.tightening * tol, jnp.minimum(least, tol))
    before = state.search
    search = advance_search(before, value, gradient, tight, steps)
    state = state._replace(
        search=search,
        iterations=state.iterations + (search.iterations - before.iterations),
        evaluations=state.evaluations + 1,
        failures=state.failures + (search.failures - before.failures),
    )
    most = jnp.where(state.is_bulged, _BULGED_TRIALS, _FURTHER_TRIALS)
    is_late = (state.code >= 0) & (search.evaluations == most)  # no longer the first search
    ended = ~search.running | is_late
    # where the bulged search has ended, one on the true surface begins
    again = ended & state.is_bulged & (search.code != status.BAD_START)
    size = jnp.maximum(jnp.sqrt(jnp.sum(search.point.u**2)), 1.0)
    apart = jnp.min(state.found.distances_to(search.point.u))
    returns = ~state.is_bulged & (search.iterations > 0) & (apart < _APART * size)
    onward = state._replace(
        search=begin_search(search.point.u, jnp.ones((), bool)), is_bulged=jnp.zeros((), bool)
    )
    # a search that was tightened has been at a minimum before
    reached = ended & ~again & ~returns & ((search.code == status.OK) | (state.tightening < 1))
    kept = state.tightening < 1
    curvature = select_tree(kept, state.curvature, begin_curvature(search.point))
    probing = state._replace(curvature=curvature, is_probing=jnp.ones((), bool))
    state = select_tree(again, onward, select_tree(reached, probing, state))
    return state, returns | (ended & ~again & (~reached | curvature.is_known))


def _judge_point(state, tol):
    """Return the state where the curvature is known, and whether the search is over.

    A saddle is left, a minimum is included, or sought with a smaller tolerance first.
    """
    point, lowest = state.search.point, state.curvature.lowest
    size = jnp.maximum(jnp.sqrt(jnp.sum(point.u**2)), 1.0)
    no, yes = jnp.zeros((), bool), jnp.ones((), bool)
    state = state._replace(is_probing=no)
    is_saddle = lowest < -10 * difference_step(point.u.dtype)
    leaves = is_saddle & (state.escapes < _ESCAPES)
    side = jnp.where(state.escapes % 2 == 0, 0.5, -0.5) * size  # one side, then the other
    left = state._replace(
        search=begin_search(point.u + side * state.curvature.direction(), yes),
        escapes=state.escapes + 1,
    )
    ended = state._replace(search=state.search._replace(code=jnp.int32(status.NOT_NEAREST)))
    share = _curvature_within_limits(lowest)
    refines = (state.tightening == 1) & (estimated_error(point, lowest) > tol * size)
    finer = state._replace(
        search=state.search._replace(
            code=jnp.int32(-1), running=yes, iterations=jnp.int32(0), length=jnp.ones_like(share)
        ),
        tightening=share,
    )
    direction = state.curvature.direction()
    first = state.found.n_points == 0
    included = state._replace(
        found=state.found.include(point, lowest),
        direction=jnp.where(first & jnp.any(direction != 0), direction, state.direction),
    )
    minimum = select_tree(refines, finer, included)
    state = select_tree(is_saddle, select_tree(leaves, left, ended), minimum)
    return state, ~jnp.where(is_saddle, leaves, refines)


def estimated_error(point: Point, curvature: Float[Array, ""]) -> Float[Array, ""]:
    """Return the distance of a point from the minimum: its misalignment over the curvature."""
    return point.misalignment() / _curvature_within_limits(curvature)


def _curvature_within_limits(curvature):
    """Return the curvature, from 0.01 to 1; 1 where it is unknown.

    Near a sphere, below 0.01, all points are as near as the minimum, and no search could meet a
    tolerance of the direction: `FirstOrder.curvature` has the value itself, and shows where it is
    so. Above 1 the misalignment is the larger error already.
    """
    known = jnp.where(jnp.isnan(curvature), 1.0, curvature)
    return jnp.clip(known, _LEAST_CURVATURE, 1.0)


def _begin_next(state):
    """Return the state at the begin of the next search, or at the end."""
    yes, first = jnp.ones((), bool), state.code < 0
    own = state.search.code
    code = jnp.where(first, own, state.code)
    known = state.found.n_points > 0
    size = jnp.maximum(jnp.sqrt(jnp.sum(state.found.points.u[0] ** 2)), 1.0)
    anchor, other, third = _spread_directions(state.trial)
    anchor = jnp.where(known, state.found.points.u[0], anchor)
    along = _INSIDE * size * jnp.where(known, state.direction, other)
    number = state.number + 1
    last = _OPPOSITE if state.trial.size == 1 else _BULGED  # one quantity has two directions
    is_bulged = number >= _BULGED
    is_idle = is_bulged & (
        (~known) | ((number > _BULGED) & (state.found.n_points == state.count_before))
    )
    start = jnp.where(is_bulged, _INSIDE * size * third, jnp.zeros_like(third))
    for which, place in ((_OPPOSITE, -anchor), (_ALONG, along), (_AGAINST, -along)):
        start = jnp.where(number == which, place, start)
    search = begin_search(start, yes)
    begun = state._replace(
        search=search,
        is_bulged=is_bulged,
        tightening=jnp.ones_like(state.tightening),
        number=number,
        escapes=jnp.zeros_like(state.escapes),
        count_before=state.found.n_points,
        code=code,
    )
    is_over = state.found.n_points == len(state.found.curvature)
    is_over |= is_idle | ((number > last) if last == _OPPOSITE else False)
    is_over |= first & ~known & (own != status.STATIONARY) & (own != status.NOT_NEAREST)
    radius, falls = state.found.nearest()
    nearer = jnp.where(falls, state.nearest[0], state.nearest[1])
    contradicted = nearer < (1 - difference_step(radius.dtype)) * radius
    judged = jnp.where(contradicted, status.NOT_NEAREST, status.OK)
    ended = state._replace(
        code=jnp.where(known, judged, code).astype(jnp.int32), running=jnp.zeros((), bool)
    )
    return select_tree(is_over, ended, begun)


def _spread_directions(like):
    """Return three unit vectors in no particular direction."""
    rows = np.random.default_rng(1).standard_normal((3, like.size))
    return jnp.asarray((rows / np.linalg.norm(rows, axis=1, keepdims=True)).astype(like.dtype))
