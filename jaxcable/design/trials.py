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
    """Result of an evaluation at a trial point: values, their derivatives, and the status code.

    Values are an array [m] with a Jacobian [m, n], or a scalar with a gradient [n].
    """

    values: Float[Array, " *m"]
    jacobian: Float[Array, "*m n"]
    code: Int[Array, ""]

    def mark_nonfinite(self) -> Evaluation:
        """Return the same, with NONFINITE in place of OK if a number is not finite."""
        finite = jnp.all(jnp.isfinite(self.values)) & jnp.all(jnp.isfinite(self.jacobian))
        code = jnp.where((self.code == status.OK) & ~finite, status.NONFINITE, self.code)
        return self._replace(code=code)


def final_status(
    sound: Bool[Array, ""],
    blind: Bool[Array, ""],
    converged: Bool[Array, ""],
    stalled: Bool[Array, ""],
) -> Int[Array, ""]:
    """Return the status with which a search ends, if it ends now.

    Args:
        sound: whether the start could be evaluated.
        blind: whether it has converged where nothing shows that this is a minimum: STATIONARY.
        converged: whether it has converged.
        stalled: whether no further step is possible.
    """
    code = jnp.where(stalled, status.STALLED, status.OUT_OF_STEPS)
    code = jnp.where(sound, code, status.BAD_START)
    code = jnp.select([blind, converged], [status.STATIONARY, status.OK], code)
    return code.astype(jnp.int32)


def values_and_jacobian(
    function: Callable[[Float[Array, " n"]], tuple[Float[Array, " m"], Int[Array, ""]]],
    x: Float[Array, " n"],
    count: int,
) -> Evaluation:
    """Evaluate a function, which returns (values [count], code), and its Jacobian at `x`.

    The Jacobian is taken in forward mode for at most as many parameters as values, else in reverse.
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


class TrialPoint(NamedTuple):
    """A trial point of a library: parameters, loss, gradient, constraints, Jacobian and status.

    All arrays are those of NumPy: [n], [n], [m], [m, n].
    """

    x: np.ndarray
    loss: float
    gradient: np.ndarray
    constraints: np.ndarray
    jacobian: np.ndarray
    code: int

    @property
    def failed(self) -> bool:
        """Whether the analysis has failed here, or a number is not finite."""
        return self.code != status.OK

    @property
    def violation(self) -> float:
        """Largest constraint; minus infinity if there are no constraints."""
        return float(self.constraints.max(initial=-np.inf))

    def is_better_than(self, other: TrialPoint | None) -> bool:
        """Whether this point has a lower loss within the constraints, or violates them less."""
        if other is None or min(self.violation, other.violation) > 0:
            return other is None or self.violation < other.violation
        return (self.violation > 0, self.loss) < (other.violation > 0, other.loss)


class RunEnded(Exception):  # noqa: N818 - not an error
    """Raised in a call from a library to end its run, at the last point that it has accepted."""


class ScaledProblem:
    """A problem as libraries see it: parameters and loss of size 1, and no failed analysis.

    Every trial point is within the bounds, counted and remembered. Where an analysis fails, the
    library gets the last point that succeeded with a loss that no search accepts, so that it
    shortens the step. A library that asks for the gradient there has given up: its run ends.

    Args:
        evaluate: function of the parameters [n] to an `Evaluation` of loss and constraints, the
            loss first.
        bounds: lower and upper bounds, [n] each.
        margin: the library gets the constraints plus this.
        on_accept: called with every `TrialPoint` that the library has accepted; if it returns True
            the run ends.

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
        """Begin a run at a point, with parameters divided by `size` and the loss times `unit`.

        The run ends after `most` evaluations.
        """
        self.size, self.unit, self.most = size, unit, self.evaluations + most
        self.start, self.reached = start.x / size, start
        self.lower, self.upper = (bound / size for bound in self.bounds)

    def evaluate_at(self, x: Float[np.ndarray, " n"]) -> TrialPoint:
        """Evaluate parameters, projected into the bounds; remember the last point."""
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
        """Evaluate scaled parameters; at a bound they get exactly the value that the user gave."""
        if self.evaluations >= self.most:
            raise RunEnded
        lower, upper = self.bounds
        x = np.where(y <= self.lower, lower, y * self.size)
        return self.evaluate_at(np.where(y >= self.upper, upper, x))

    def loss(self, y: Float[np.ndarray, " n"]) -> float:
        """Return the scaled loss."""
        found = self.evaluate_scaled(y)
        return _FAILED_LOSS if found.failed else self.unit * found.loss

    def gradient(self, y: Float[np.ndarray, " n"]) -> np.ndarray:
        """Return the gradient of the scaled loss, [n]; asked for at points that are accepted."""
        found = self.evaluate_scaled(y)
        if found.failed:
            raise RunEnded
        if not np.array_equal(found.x, self.reached.x):
            self.reached = found
            if self.on_accept(found):
                raise RunEnded
        return self.unit * found.gradient * self.size

    def constraints(self, y: Float[np.ndarray, " n"]) -> np.ndarray:
        """Return the constraints, [m], plus `margin`; they are to be at most zero."""
        return self._sound_point(y).constraints + self.margin

    def jacobian(self, y: Float[np.ndarray, " n"]) -> np.ndarray:
        """Return the Jacobian of the constraints by scaled parameters, [m, n]."""
        return self._sound_point(y).jacobian * self.size

    def _sound_point(self, y):
        """Return the trial point, or the last one whose analysis succeeded if this one fails."""
        found = self.evaluate_scaled(y)
        return self.sound if found.failed else found
