"""Trial points of a search: their evaluation, when they count as failed, and what is recorded.

The rules are the same in `minimize`, `fit`, `tune` and `minimize_subject_to`. A trial point has
failed if its analysis has, or if one of its numbers is not finite. It is counted, never accepted,
and the search goes on with a shorter step. A loss, constraints or residuals are evaluated with
their derivatives by one program.

A search is a loop on the host over such programs, and computes with NumPy only: within another
program it is a call of the host (`programs.search_call`).
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Any, NamedTuple, TypeVar

import jax
import jax.numpy as jnp
import numpy as np

from ..common import jax_internals as internals
from ..common import status
from ..common.types import Array, ArrayLike, Float, Int, PyTree
from ..programs.search_call import run_search
from .bounds import BoxBounds
from .no_derivative import warn_of_undefined_derivative

_T = TypeVar("_T")

_FAILED_LOSS = 1e10
"""Scaled loss of a failed analysis: no search accepts it, since the gradient at the start is 1."""


class TrialPoint(NamedTuple):
    """A trial point of a search: parameters, values with their derivatives, and the status.

    Attributes:
        x: parameters, [n].
        values: residuals, or the loss followed by the constraints, [m].
        jacobian: derivatives of the values, [m, n].
        code: status code; NONFINITE if a number is not finite although the analysis has converged.
    """

    x: np.ndarray
    values: np.ndarray
    jacobian: np.ndarray
    code: int

    @property
    def failed(self) -> bool:
        """Whether the analysis at this point has failed, or a number of it is not finite."""
        return self.code != status.OK

    @property
    def loss(self) -> Any:
        """The loss, a scalar."""
        return self.values[0]

    @property
    def gradient(self) -> np.ndarray:
        """The gradient of the loss, [n]."""
        return self.jacobian[0]

    @property
    def constraints(self) -> np.ndarray:
        """The constraints, [m - 1]."""
        return self.values[1:]

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

    def without_values(self) -> TrialPoint:
        """Return the point with NaN in place of its values and derivatives."""
        nan = np.full_like(self.values, np.nan), np.full_like(self.jacobian, np.nan)
        return self._replace(values=nan[0], jacobian=nan[1])


def unevaluated_point(x: Float[np.ndarray, " n"], count: int, code: int) -> TrialPoint:
    """Return the record of a start `x`, [n], that is not evaluated, with `count` values of NaN."""
    nan = np.full((count, 1 + x.size), np.nan, x.dtype)
    return TrialPoint(x, nan[:, 0], nan[:, 1:], code)


class Problem:
    """A function of parameters within bounds, evaluated at the trial points of a search.

    Args:
        evaluate: function of flat parameters [n] to values [m] (or a loss), their derivatives
            [m, n] (or [n]) and a status code.
        box: `BoxBounds`; every trial point is projected into them.
        params: pytree of the parameters, to name those by which the start has no derivative.

    Attributes:
        evaluations, failures: numbers of trial points, and of those that have failed.
    """

    def __init__(
        self, evaluate: Callable[[Any], Sequence[Any]], box: BoxBounds, params: PyTree[Any]
    ):
        self.evaluate, self.box, self.params = evaluate, box, params
        self.evaluations = self.failures = 0

    def evaluate_at(self, x: Float[np.ndarray, " n"]) -> TrialPoint:
        """Evaluate the function at parameters x, [n], projected into the bounds; count it."""
        x = self.box.project(x)
        values, jacobian, code = self.evaluate(x)
        if self.evaluations == 0:
            warn_of_undefined_derivative(values, jacobian, code, params=self.params)
        values, jacobian = (np.asarray(part, x.dtype) for part in (values, jacobian))
        point = TrialPoint(x, values.ravel(), jacobian.reshape(-1, x.size), int(code))
        if not point.failed and not all(np.isfinite(part).all() for part in point[1:3]):
            point = point._replace(code=status.NONFINITE)
        self.evaluations += 1
        self.failures += point.failed
        return point


def padded_columns(
    rows: Sequence[Sequence[float]], dtypes: Sequence[Any], count: int
) -> list[np.ndarray]:
    """Return the columns of a history as arrays [count], padded with NaN, or -1 for integers.

    Args:
        rows: rows of the history, as many numbers each as there are `dtypes`.
        dtypes: dtypes of the columns.
        count: number of entries of each array.
    """
    columns = [np.full(count, np.nan if np.dtype(d).kind == "f" else -1, d) for d in dtypes]
    for number, row in enumerate(rows):
        for column, entry in zip(columns, row, strict=True):
            column[number] = entry
    return columns


def values_and_jacobian(
    function: Callable[[Float[Array, " n"]], tuple[Float[Array, " m"], Int[Array, ""]]],
    x: Float[Array, " n"],
    count: int,
) -> tuple[Float[Array, " m"], Float[Array, "m n"], Int[Array, ""]]:
    """Evaluate a function of parameters `x` [n] to (values [count], status code) and its Jacobian.

    Forward mode is used for at most as many parameters as values, else reverse mode.
    """
    if x.size <= count:
        # not `jax.linearize`: separate forward and linear parts make a program half as long again
        def push(direction):
            return jax.jvp(function, (x,), (direction,), has_aux=True)

        out = None, 1, None  # values are those of every direction
        return jax.vmap(push, out_axes=out)(jnp.eye(x.size, dtype=x.dtype))
    values, pull, code = jax.vjp(function, x, has_aux=True)
    return values, jax.vmap(pull)(jnp.eye(count, dtype=values.dtype))[0], code


def call_search(
    search: Callable[..., _T],
    functions: tuple[Any, ...],
    numbers: tuple[Any, ...],
    tol: Float[ArrayLike, ""],
    reports: bool,
) -> _T:
    """Return ``search(*functions, *numbers, tol)`` in arrays of jax, also for traced numbers.

    Args:
        search: function of known arrays, see `run_search`. An invalid tolerance ends it at once,
            with a result in the shapes of others.
        functions: traced functions and what they take, pytrees of arrays.
        numbers: pytrees of what the search itself computes with.
        tol: its tolerance.
        reports: whether it reports progress.
    """
    shapes = jax.tree.map(lambda x: np.zeros(x.shape, x.dtype), numbers)
    like = search(*functions, *shapes, np.nan)
    problem = *functions, *numbers, tol
    found = run_search(lambda problem: search(*problem), problem, like, reports=reports)
    return internals.as_jax_arrays(found)


class RunEnded(Exception):  # noqa: N818 - not an error
    """Raised by a function that an optimization library calls, to end the run of the library."""


class ScaledProblem(Problem):
    """A constrained problem in the form that optimization libraries get.

    Parameters and loss are scaled to a size of about 1. Every trial point is projected into the
    bounds, counted and remembered. Where an analysis fails, the library gets a loss so high that it
    shortens the step, and the constraints of the last point that succeeded. If it asks for the
    gradient there, it has given up: its run ends.

    Args:
        evaluate, box, params: as for `Problem`; the values are the loss, then the constraints.
        margin: the library gets the constraints plus this.
        on_accept: function called with every `TrialPoint` that the library has accepted; if it
            returns True the run ends.

    Attributes:
        evaluations, failures: as of `Problem`.
        best: the point of lowest loss that meets all constraints; if none does, that of the
            smallest violation.
        reached: the last point that the library has accepted.
        last, sound: the last trial point, and the last one whose analysis succeeded.
        start, lower, upper: scaled start and bounds as the library gets them, [n].
    """

    def __init__(
        self,
        evaluate: Callable[[Any], Sequence[Any]],
        box: BoxBounds,
        params: PyTree[Any],
        margin: float,
        on_accept: Callable[[TrialPoint], bool],
    ):
        super().__init__(evaluate, box, params)
        self.margin, self.on_accept = margin, on_accept
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
        self.lower, self.upper = self.box.lower / size, self.box.upper / size

    def evaluate_at(self, x: Float[np.ndarray, " n"]) -> TrialPoint:
        """Evaluate the problem at parameters x, [n], projected into the bounds; count the point.

        Evaluating the last point again costs nothing.
        """
        # libraries leave bounds by rounding; numbers belong to the point within, which is kept
        if self.last is None or not np.array_equal(self.box.project(x), self.last.x):
            self.last = super().evaluate_at(x)
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
        x = np.where(y <= self.lower, self.box.lower, y * self.size)
        return self.evaluate_at(np.where(y >= self.upper, self.box.upper, x))

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
        return self._sound_point(y).jacobian[1:] * self.size

    def _sound_point(self, y):
        """Return the trial point at scaled parameters y; if it failed, the last that succeeded."""
        found = self.evaluate_scaled(y)
        return self.sound if found.failed else found
