"""Trial points of a search: their evaluation, when they count as failed, and the final status.

The rules are the same in `minimize`, `fit`, `tune` and `minimize_subject_to`. A trial point has
failed if its analysis has, or if one of its numbers is not finite. It is counted, never accepted,
and the search goes on with a shorter step. A loss, constraints or residuals are evaluated with
their derivatives by one program.

The searches of `minimize` and `fit` have one form: a state with the point to be evaluated next,
``state.trial``, as long as it is ``running``, and ``advance(state, evaluation)``, which accepts the
point or not. So the program of a search evaluates at one place, and `tune` can do it outside.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np

from ..common import status
from ..common.types import Array, Bool, Float, Int

_FAILED_LOSS = 1e10
"""Scaled loss of a failed analysis: no search accepts it, since the gradient at the start is 1."""


class Evaluation(NamedTuple):
    """Values of a function at a trial point with their derivatives and the status code.

    Values are an array [m] with a Jacobian [m, n], or a scalar loss with a gradient [n].
    """

    values: Float[Array, " *m"]
    jacobian: Float[Array, "*m n"]
    code: Int[Array, ""]

    def mark_nonfinite(self) -> Evaluation:
        """Return the evaluation, with NONFINITE in place of OK if a number is NaN or infinite."""
        finite = jnp.all(jnp.isfinite(self.values)) & jnp.all(jnp.isfinite(self.jacobian))
        code = jnp.where((self.code == status.OK) & ~finite, status.NONFINITE, self.code)
        return self._replace(code=code)


def final_status(
    start_ok: Bool[Array, ""],
    stationary: Bool[Array, ""],
    converged: Bool[Array, ""],
    stalled: Bool[Array, ""],
) -> Int[Array, ""]:
    """Return the status that a search gets if it ends at this point.

    Args:
        start_ok: whether the analysis at the start has succeeded; if not: BAD_START.
        stationary: whether it has converged where nothing tells a minimum from a maximum, as at a
            start without slope: STATIONARY.
        converged: whether it has converged: OK.
        stalled: whether no further step is possible: STALLED, else OUT_OF_STEPS.
    """
    code = jnp.where(stalled, status.STALLED, status.OUT_OF_STEPS)
    code = jnp.where(start_ok, code, status.BAD_START)
    code = jnp.select([stationary, converged], [status.STATIONARY, status.OK], code)
    return code.astype(jnp.int32)


def values_and_jacobian(
    function: Callable[[Float[Array, " n"]], tuple[Float[Array, " m"], Int[Array, ""]]],
    x: Float[Array, " n"],
    count: int,
) -> Evaluation:
    """Evaluate a function of parameters `x` [n] to (values [count], status code) and its Jacobian.

    Forward mode is used for at most as many parameters as values, else reverse mode.
    """
    if x.size <= count:
        # not `jax.linearize`: separate forward and linear parts make a program half as long again
        def push(direction):
            return jax.jvp(function, (x,), (direction,), has_aux=True)

        out = None, 1, None  # values are those of every direction
        return Evaluation(*jax.vmap(push, out_axes=out)(jnp.eye(x.size, dtype=x.dtype)))
    values, pull, code = jax.vjp(function, x, has_aux=True)
    jacobian = jax.vmap(pull)(jnp.eye(count, dtype=values.dtype))[0]
    return Evaluation(values, jacobian, code)


def loss_and_gradient(
    function: Callable[[Float[Array, " n"]], tuple[Float[Array, ""], Int[Array, ""]]],
    x: Float[Array, " n"],
) -> Evaluation:
    """Evaluate a function of parameters `x` [n] to (loss, status code) and its gradient [n]."""
    (value, code), gradient = jax.value_and_grad(function, has_aux=True)(x)
    return Evaluation(value, gradient, code)


class TrialPoint(NamedTuple):
    """A trial point of an optimization library: parameters, loss, constraints, derivatives, status.

    Attributes:
        x: parameters, [n].
        loss, gradient: loss, and its gradient, [n].
        constraints, jacobian: constraints, [m], and their Jacobian, [m, n].
        code: status code.
    """

    x: np.ndarray
    loss: float
    gradient: np.ndarray
    constraints: np.ndarray
    jacobian: np.ndarray
    code: int

    @property
    def failed(self) -> bool:
        """Whether the analysis at this point has failed, or a number of it is not finite."""
        return self.code != status.OK

    @property
    def violation(self) -> float:
        """The largest constraint, positive if one is violated; minus infinity if there are none."""
        return float(self.constraints.max(initial=-np.inf))

    def is_better_than(self, other: TrialPoint | None) -> bool:
        """Return whether this point is better than another one (or than None).

        Points that meet the constraints are better than others; among them the loss decides, among
        others the violation.
        """
        if other is None or min(self.violation, other.violation) > 0:
            return other is None or self.violation < other.violation
        return (self.violation > 0, self.loss) < (other.violation > 0, other.loss)


class RunEnded(Exception):  # noqa: N818 - not an error
    """Raised by a function that an optimization library calls, to end the run of the library."""


class ScaledProblem:
    """A constrained problem in the form that optimization libraries get.

    Parameters and loss are scaled to a size of about 1. Every trial point is projected into the
    bounds, counted and remembered. Where an analysis fails, the library gets a loss so high that it
    shortens the step, and the constraints of the last point that succeeded. If it asks for the
    gradient there, it has given up: its run ends.

    Args:
        evaluate: function of the parameters [n] to an `Evaluation` of loss and constraints, the
            loss first.
        bounds: lower and upper bounds, [n] each.
        margin: the library gets the constraints plus this.
        on_accept: function called with every `TrialPoint` that the library has accepted; if it
            returns True the run ends.

    Attributes:
        evaluations, failures: numbers of trial points, and of those that have failed.
        best: the point of lowest loss that meets all constraints; if none does, that of the
            smallest violation.
        reached: the last point that the library has accepted.
        last, sound: the last trial point, and the last one whose analysis succeeded.
        start, lower, upper: scaled start and bounds as the library gets them, [n].
    """

    def __init__(
        self,
        evaluate: Callable[[Any], Evaluation],
        bounds: tuple[np.ndarray, np.ndarray],
        margin: float,
        on_accept: Callable[[TrialPoint], bool],
    ):
        self.evaluate, self.bounds, self.margin = evaluate, bounds, margin
        self.on_accept = on_accept
        self.evaluations = self.failures = 0
        self.last: Any = None
        self.sound: Any = None
        self.best: Any = None

    def begin_run(self, start: TrialPoint, size: np.ndarray, unit: float, most: int) -> None:
        """Set the start of the next run of a library, and the scales of what it gets.

        These are parameters over `size` [n], and the loss times `unit`. After `most` evaluations
        the run ends.
        """
        self.size, self.unit, self.most = size, unit, self.evaluations + most
        self.start, self.reached = start.x / size, start
        self.lower, self.upper = (bound / size for bound in self.bounds)

    def evaluate_at(self, x: Float[np.ndarray, " n"]) -> TrialPoint:
        """Evaluate the problem at parameters x, [n], projected into the bounds; count the point.

        Evaluating the last point again costs nothing.
        """
        # libraries leave bounds by rounding; numbers belong to the point within, which is kept
        x = np.clip(x, *self.bounds)
        if self.last is not None and np.array_equal(x, self.last.x):
            return self.last
        values, jacobian, code = (np.asarray(one) for one in self.evaluate(x))
        values, jacobian = values.astype(float), jacobian.astype(float)
        self.last = TrialPoint(
            x, float(values[0]), jacobian[0], values[1:], jacobian[1:], int(code)
        )
        self.evaluations += 1
        self.failures += self.last.failed
        if not self.last.failed:
            self.sound = self.last
            self.best = self.last if self.last.is_better_than(self.best) else self.best
        return self.last

    def evaluate_scaled(self, y: Float[np.ndarray, " n"]) -> TrialPoint:
        """Evaluate the problem at scaled parameters y, [n], at a bound with exactly that bound.

        Raises RunEnded if the run has had its number of evaluations.
        """
        if self.evaluations >= self.most:
            raise RunEnded
        lower, upper = self.bounds
        x = np.where(y <= self.lower, lower, y * self.size)
        return self.evaluate_at(np.where(y >= self.upper, upper, x))

    def loss(self, y: Float[np.ndarray, " n"]) -> float:
        """Return the scaled loss at scaled parameters y, [n]; huge if the analysis fails."""
        found = self.evaluate_scaled(y)
        return _FAILED_LOSS if found.failed else self.unit * found.loss

    def gradient(self, y: Float[np.ndarray, " n"]) -> np.ndarray:
        """Return the gradient of the scaled loss, [n], at scaled parameters y, [n].

        Libraries ask for it where they accept a point, so that it also reports the point. Raises
        RunEnded if the analysis fails there, or if `on_accept` ends the run.
        """
        found = self.evaluate_scaled(y)
        if found.failed:
            raise RunEnded
        if not np.array_equal(found.x, self.reached.x):
            self.reached = found
            if self.on_accept(found):
                raise RunEnded
        return self.unit * found.gradient * self.size

    def constraints(self, y: Float[np.ndarray, " n"]) -> np.ndarray:
        """Return the constraints plus `margin`, [m], at scaled parameters y [n]; met if <= 0."""
        return self._sound_point(y).constraints + self.margin

    def jacobian(self, y: Float[np.ndarray, " n"]) -> np.ndarray:
        """Return the Jacobian of the constraints by the scaled parameters, [m, n], at y, [n]."""
        return self._sound_point(y).jacobian * self.size

    def _sound_point(self, y):
        """Return the trial point at scaled parameters y; if it failed, the last that succeeded."""
        found = self.evaluate_scaled(y)
        return self.sound if found.failed else found
