"""The search for a design point: the point of a limit state surface that is nearest to the origin.

The iteration is that of Hasofer and Lind (1974) and Rackwitz and Fiessler (1978), with the merit
function and line search of Zhang and Der Kiureghian (1995), by which it converges from anywhere
where the limit state is smooth.
"""

from __future__ import annotations

from typing import NamedTuple

import jax.numpy as jnp

from ..common import status
from ..common.tree import select_tree
from ..common.types import Array, Bool, Float, Int

_SUFFICIENT = 0.1  # part of the promised decrease of the merit that a step must bring
_PENALTY = 2.0  # over the least penalty with which the direction is one of descent
_SHORTEST = 2.0**-20  # step, of the full one


class Point(NamedTuple):
    """A point in standard normal space, with what is known there.

    Attributes:
        u: standard normal values.
        value, gradient: limit state and its derivative by u.
    """

    u: Float[Array, " n"]
    value: Float[Array, ""]
    gradient: Float[Array, " n"]

    def slope(self) -> Float[Array, ""]:
        """Return the length of the gradient."""
        return jnp.sqrt(jnp.sum(self.gradient**2))

    def alpha(self) -> Float[Array, " n"]:
        """Return the unit vector along which the limit state falls."""
        return -self.gradient / self.slope()

    def beta(self) -> Float[Array, ""]:
        """Return the distance of the linearized surface, negative if the origin fails."""
        return self.alpha() @ self.u + self.value / self.slope()

    def distance(self) -> Float[Array, ""]:
        """Return the distance to the surface, to first order."""
        return jnp.abs(self.value) / self.slope()

    def misalignment(self) -> Float[Array, ""]:
        """Return the length of the part of u that is not along the gradient."""
        alpha = self.alpha()
        return jnp.sqrt(jnp.sum((self.u - (alpha @ self.u) * alpha) ** 2))


class SearchState(NamedTuple):
    """State of the search.

    Attributes:
        point: last accepted point.
        step: full step from there.
        length: part of it that is tried next; zero at the start, where nothing is known yet.
        penalty: factor of the absolute limit state in the merit.
        iterations, evaluations, failures: accepted steps; evaluations of the limit state; those
            among them that were NaN or infinite.
        code: status; below zero while the search goes on.
        running: whether it goes on.
    """

    point: Point
    step: Float[Array, " n"]
    length: Float[Array, ""]
    penalty: Float[Array, ""]
    iterations: Int[Array, ""]
    evaluations: Int[Array, ""]
    failures: Int[Array, ""]
    code: Int[Array, ""]
    running: Bool[Array, ""]

    def trial(self) -> Float[Array, " n"]:
        """Return the point that is evaluated next."""
        return self.point.u + self.length * self.step


_RUNNING = -1  # no status


def begin_search(start: Float[Array, " n"], valid: Bool[Array, ""]) -> SearchState:
    """Return the state before the first evaluation.

    Args:
        start: where the search begins, [n].
        valid: whether the numbers of the task keep their rules.
    """
    unknown = jnp.full((), jnp.nan, start.dtype)
    zero, count = jnp.zeros((), start.dtype), jnp.zeros((), jnp.int32)
    return SearchState(
        Point(start, unknown, jnp.full_like(start, jnp.nan)),
        jnp.zeros_like(start),
        *(zero, zero, count, count, count),
        jnp.where(valid, _RUNNING, status.INVALID_INPUT).astype(jnp.int32),
        jnp.asarray(valid),
    )


def advance_search(
    state: SearchState,
    value: Float[Array, ""],
    gradient: Float[Array, " n"],
    tol: Float[Array, ""],
    steps: int,
) -> SearchState:
    """Return the next state, by limit state and gradient at ``state.trial()``.

    Args:
        state: present state.
        value, gradient: limit state and its derivative at the trial point.
        tol: tolerance of distance and misalignment, over the distance from the origin (at least 1).
        steps: largest number of accepted steps.
    """
    first, old = state.evaluations == 0, state.point
    trial = Point(state.trial(), value, gradient)
    sound = jnp.isfinite(value) & jnp.all(jnp.isfinite(gradient))
    before = _merit(old, state.penalty)
    promised = old.u @ state.step - state.penalty * jnp.abs(old.value)
    # rounding of the merit, and what the analysis leaves of its residual
    rounding = 64 * float(jnp.finfo(value.dtype).eps)
    slack = jnp.maximum(rounding, tol**2) * (1 + before)
    limit = before + _SUFFICIENT * state.length * promised + slack
    accepted = sound & (first | (_merit(trial, state.penalty) <= limit))
    point = select_tree(accepted, trial, old)
    length = jnp.where(accepted, 1.0, 0.5 * state.length).astype(value.dtype)
    iterations = state.iterations + (accepted & ~first)
    step, penalty = _next_step(point)
    code = _decide(point, accepted, first, length, iterations >= steps, tol)
    return SearchState(
        point,
        jnp.where(accepted, step, state.step),
        length,
        jnp.where(accepted, penalty, state.penalty),
        iterations,
        state.evaluations + 1,
        state.failures + ~sound,
        code,
        code == _RUNNING,
    )


def _merit(point, penalty):
    """Return the merit that the steps lower."""
    return 0.5 * jnp.sum(point.u**2) + penalty * jnp.abs(point.value)


def _next_step(point):
    """Return the step to the nearest point of the linearized surface, and the penalty."""
    step = point.beta() * point.alpha() - point.u
    # of both ends: the origin needs one, and a larger one where the surface is met, as of the ratio
    # of goal and limit state, would forbid to go along a curved surface
    far = jnp.maximum(jnp.sum(point.u**2), jnp.sum((point.u + step) ** 2))
    return step, _PENALTY * jnp.sqrt(far) / point.slope()


def _decide(point, accepted, first, length, is_last, tol):
    """Return the status after a trial."""
    allowed = tol * jnp.maximum(jnp.sqrt(jnp.sum(point.u**2)), 1.0)
    close = (point.distance() <= allowed) & (point.misalignment() <= allowed)
    flat = point.slope() == 0
    code = jnp.where(is_last, status.OUT_OF_STEPS, _RUNNING)
    code = jnp.where(flat, jnp.where(first, status.STATIONARY, status.STALLED), code)
    code = jnp.where(close & ~flat, status.OK, code)
    refused = jnp.where(length < _SHORTEST, status.STALLED, _RUNNING)
    refused = jnp.where(first, status.BAD_START, refused)
    return jnp.where(accepted, code, refused).astype(jnp.int32)
