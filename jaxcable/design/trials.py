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
from ..common.types import Array, Bool, Float, Int

_WALL = 1.0
"""Rise of a scaled loss, whose gradient at the start is 1, where a library is to turn back."""


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
    """A trial point of a library: parameters, loss, gradient, constraints and their Jacobian.

    `code` is its status. Arrays are those of NumPy; [n], [n], [m], [m, n].
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
    def excess(self) -> float:
        """The largest constraint; minus infinity if there is none."""
        return float(self.constraints.max(initial=-np.inf))


class Trials:
    """Trial points of one search by a library: they are within bounds, counted and remembered.

    Args:
        evaluate: function of the parameters [n] to an `Evaluation` of loss and constraints, the
            loss first.
        lower, upper: bounds, [n].

    Attributes:
        evaluations, failures: numbers of trial points, and of those that have failed.
        failure: code of the last failure; 0 if there was none.
        sound: last `Point` that has not failed; None before there is one.
        best: the one of lowest loss that meets all constraints; if there is none, that of the
            smallest violation.
    """

    def __init__(self, evaluate: Callable[[Any], Evaluation], lower: np.ndarray, upper: np.ndarray):
        self.evaluate, self.lower, self.upper = evaluate, lower, upper
        self.evaluations = self.failures = self.failure = 0
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
        point = Point(x, float(values[0]), jacobian[0], values[1:], jacobian[1:], int(code))
        self.evaluations += 1
        self.last = point
        if point.failed:
            self.failures, self.failure = self.failures + 1, point.code
            return point
        self.sound = point
        if self.best is None or _better(point, self.best):
            self.best = point
        return point


def _better(one, other):
    """Whether a point meets constraints at a lower loss than another one, or violates them less."""
    if one.excess <= 0 or other.excess <= 0:
        return (one.excess > 0, one.loss) < (other.excess > 0, other.loss)
    return one.excess < other.excess


class Scaled:
    """Trial points as a library sees them: with parameters and loss of size 1, and never NaN.

    In place of a failed point it sees the last sound one behind a wall: a loss that is higher by
    the change that a gradient of 1 makes. No search accepts that, so all of them shorten the step.

    Args:
        trials: the `Trials`.
        size: the library gets the parameters divided by it, [n].
        unit: factor on the loss.
        margin: constraints are tightened by it.
    """

    def __init__(self, trials: Trials, size: np.ndarray, unit: float, margin: float):
        self.trials, self.size, self.unit, self.margin = trials, size, unit, margin
        self.lower, self.upper = trials.lower / size, trials.upper / size

    def point(self, y: np.ndarray) -> Point:
        """The `Point` of scaled parameters, in units of the user."""
        x = np.where(y <= self.lower, self.trials.lower, y * self.size)
        return self.trials.at(np.where(y >= self.upper, self.trials.upper, x))

    def at(self, y: np.ndarray) -> tuple[float, np.ndarray, np.ndarray, np.ndarray]:
        """Loss, gradient, constraints and Jacobian of scaled parameters."""
        found, wall = self.point(y), 0.0
        if found.failed:
            found, wall = self.trials.sound, _WALL
        return (
            self.unit * found.loss + wall,
            self.unit * found.gradient * self.size,
            found.constraints + self.margin,
            found.jacobian * self.size,
        )


class Elastic:
    """The problem of the least violation: ``t`` such that all constraints are at most ``t``.

    Args:
        scaled: the `Scaled` problem; one more parameter, the violation, comes last.
    """

    def __init__(self, scaled: Scaled):
        self.scaled = scaled
        self.lower = np.append(scaled.lower, 0.0)
        self.upper = np.append(scaled.upper, np.inf)

    def point(self, y: np.ndarray) -> Point:
        """The `Point` of scaled parameters, in units of the user."""
        return self.scaled.point(y[:-1])

    def at(self, y: np.ndarray) -> tuple[float, np.ndarray, np.ndarray, np.ndarray]:
        """Violation, its gradient, constraints and Jacobian."""
        _, _, constraints, jacobian = self.scaled.at(y[:-1])
        wall = _WALL if self.point(y).failed else 0.0
        column = np.full((len(constraints), 1), -1.0)
        gradient = np.append(np.zeros(len(y) - 1), 1.0)
        return y[-1] + wall, gradient, constraints - y[-1], np.hstack([jacobian, column])
