"""Trial points of a search: what is evaluated there, when it has failed, and what is then done.

The rules are the same in `minimize`, `fit`, `tune` and `minimize_subject_to`. A trial point has
failed if its analysis has, or if one of its numbers is not finite. It is never accepted, it is
counted, and the search goes on with a shorter step. A loss, constraints or residuals are one
vector here, evaluated with their Jacobian by one program.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np

from ..common import status
from ..common.types import Array, Float, Int

_WALL = 1e10
"""Scaled loss of a failed analysis, whose gradient at the start is 1: no search accepts that."""


class Evaluation(NamedTuple):
    """Values [m] of a function, their Jacobian [m, n] and the status code, at a trial point."""

    values: Float[Array, " m"]
    jacobian: Float[Array, "m n"]
    code: Int[Array, ""]


def trial_code(code: Int[Array, ""], *numbers: Float[Array, " ..."]) -> Int[Array, ""]:
    """Return the status code of a trial point; NONFINITE if it is OK and a number is not finite."""
    finite = jnp.all(jnp.stack([jnp.all(jnp.isfinite(number)) for number in numbers]))
    return jnp.where((code == status.OK) & ~finite, status.NONFINITE, code)


def evaluated(
    function: Callable[[Float[Array, " n"]], tuple[Float[Array, " m"], Int[Array, ""]]],
    x: Float[Array, " n"],
    count: int,
) -> Evaluation:
    """Evaluate a function that returns (values [count], code), and its Jacobian, at `x`.

    The Jacobian is taken in forward mode for at most as many parameters as values, else in reverse.
    """
    if x.size <= count:
        # not `linearize`: forward and linear part apart would be a program half as long again
        def push(direction):
            return jax.jvp(function, (x,), (direction,), has_aux=True)

        out = None, 1, None  # values are those of every direction
        return Evaluation(*jax.vmap(push, out_axes=out)(jnp.eye(x.size, dtype=x.dtype)))
    values, pull, code = jax.vjp(function, x, has_aux=True)
    jacobian = jax.vmap(pull)(jnp.eye(count, dtype=values.dtype))[0]
    return Evaluation(values, jacobian, code)


class Point(NamedTuple):
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
        """The largest constraint; minus infinity if there is none."""
        return float(self.constraints.max(initial=-np.inf))

    def better(self, other: Point) -> bool:
        """Whether it meets the constraints at a lower loss than another, or violates them less."""
        if min(self.violation, other.violation) > 0:
            return self.violation < other.violation
        return (self.violation > 0, self.loss) < (other.violation > 0, other.loss)


class Trials:
    """Evaluate the trial points of one search by a library: within bounds, counted, remembered.

    Args:
        evaluate: function of the parameters [n] to an `Evaluation` of loss and constraints, the
            loss first.
        lower, upper: bounds, [n].

    Attributes:
        evaluations, failures: numbers of trial points, and of those that have failed.
        last: the last trial point.
        sound: the last one that has not failed; None before there is one.
        best: the one of lowest loss that meets all constraints; if none does, that of the smallest
            violation.
    """

    def __init__(self, evaluate: Callable[[Any], Evaluation], lower: np.ndarray, upper: np.ndarray):
        self.evaluate, self.lower, self.upper = evaluate, lower, upper
        self.evaluations = self.failures = 0
        self.last: Point | None = None
        self.sound: Point | None = None
        self.best: Point | None = None

    def at(self, x: Float[np.ndarray, " n"]) -> Point:
        """Evaluate a point, projected into the bounds; the last one is not evaluated again."""
        x = np.clip(x, self.lower, self.upper)
        if self.last is not None and np.array_equal(x, self.last.x):
            return self.last
        values, jacobian, code = (np.asarray(one) for one in self.evaluate(x))
        values, jacobian = values.astype(float), jacobian.astype(float)
        self.last = Point(x, float(values[0]), jacobian[0], values[1:], jacobian[1:], int(code))
        self.evaluations += 1
        if self.last.failed:
            self.failures += 1
            return self.last
        self.sound = self.last
        if self.best is None or self.last.better(self.best):
            self.best = self.last
        return self.last


class RunEnd(Exception):  # noqa: N818 - not an error
    """A run of a library is to end, at the last point that it has accepted."""


class Scaled:
    """Show trial points to a library: parameters and loss of size 1, and no failed analysis.

    In place of a failed point the library gets the last sound one with a loss that no search
    accepts, so that all of them shorten the step. A library that asks for the gradient there has
    given up: its run ends.

    Args:
        trials: the `Trials`.
        start: the `Point` where the run starts.
        size: the library gets the parameters divided by it, [n].
        unit: factor on the loss.
        margin: the library gets the constraints plus this.
        follow: function of every `Point` that the library has accepted; True ends the run.
        most: largest number of evaluations of the run.

    Attributes:
        start, lower, upper: start and bounds as the library gets them, [n].
        reached: the last `Point` that the library has accepted.
    """

    def __init__(self, trials, start, size, unit, margin, follow, most):
        self.trials, self.size, self.unit, self.margin = trials, size, unit, margin
        self.follow, self.most = follow, trials.evaluations + most
        self.start, self.reached = start.x / size, start
        self.lower, self.upper = trials.lower / size, trials.upper / size

    def point(self, y: Float[np.ndarray, " n"]) -> Point:
        """Evaluate scaled parameters; those at a bound are at that of the user exactly."""
        if self.trials.evaluations >= self.most:
            raise RunEnd
        x = np.where(y <= self.lower, self.trials.lower, y * self.size)
        return self.trials.at(np.where(y >= self.upper, self.trials.upper, x))

    def sound(self, y: Float[np.ndarray, " n"]) -> Point:
        """Evaluate scaled parameters; the last sound point if the analysis fails there."""
        found = self.point(y)
        return self.trials.sound if found.failed else found

    def loss(self, y: Float[np.ndarray, " n"]) -> float:
        """The scaled loss."""
        found = self.point(y)
        return _WALL if found.failed else self.unit * found.loss

    def gradient(self, y: Float[np.ndarray, " n"]) -> np.ndarray:
        """The gradient of the scaled loss, [n]: libraries ask for it at points they accept."""
        found = self.point(y)
        if found.failed:
            raise RunEnd
        if not np.array_equal(found.x, self.reached.x):
            self.reached = found
            if self.follow(found):
                raise RunEnd
        return self.unit * found.gradient * self.size

    def constraints(self, y: Float[np.ndarray, " n"]) -> np.ndarray:
        """The constraints, [m], which are to be at most zero."""
        return self.sound(y).constraints + self.margin

    def jacobian(self, y: Float[np.ndarray, " n"]) -> np.ndarray:
        """The Jacobian of the constraints, [m, n]."""
        return self.sound(y).jacobian * self.size
