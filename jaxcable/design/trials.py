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
import numpy as np

from ..common import jax_internals as internals
from ..common import status
from ..common.progress import as_listener
from ..common.types import Array, ArrayLike, Float, Int, PyTree
from ..programs.program_calls import as_program
from ..programs.search_call import run_search
from ..programs.traced_function import TracedFunction
from .bounds import BoxBounds, flat_vector
from .no_derivative import warn_of_undefined_derivative

_T = TypeVar("_T")


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


def unevaluated_point(x: Float[np.ndarray, " n"], count: int, code: int) -> TrialPoint:
    """Return a `TrialPoint` at `x`, [n], that is not evaluated: its `count` values are NaN."""
    nan = np.full((count, 1 + x.size), np.nan, x.dtype)
    return TrialPoint(x, nan[:, 0], nan[:, 1:], code)


class ParameterSearch:
    """Base of iterative searches for parameters within bounds, such as `Descent`, on the host.

    It evaluates a function at trial points, and keeps the history; `run` of a subclass steps.

    Args:
        evaluate: function of flat parameters [n] to values [m] (or a loss), their derivatives
            [m, n] (or [n]) and a status code.
        params: the start, a pytree of floats.
        box: `BoxBounds`; every trial point is projected into them, and gets their dtype.
        tol, steps: tolerance, and the largest number of steps, as of `minimize`.
        listen: function of a report of progress, or None.

    Attributes:
        start: the start, [n].
        evaluations, failures: numbers of trial points, and of those that have failed.
        rows: rows of the history, numbers.
        current, best: the last accepted point and the best one, records of the search; or None.
    """

    def __init__(
        self,
        evaluate: Callable[[Any], Sequence[Any]],
        params: PyTree[Float[Array, " ..."]],
        box: BoxBounds,
        tol: Float[ArrayLike, ""],
        steps: int,
        listen: Callable[[Any], Any] | None,
    ):
        self.params, self.box = jax.tree.map(np.asarray, (params, box))
        self.start: Any = flat_vector(self.params)
        self.evaluate, self.tol, self.steps, self.listen = evaluate, float(tol), steps, listen
        self.evaluations = self.failures = 0
        self.current: Any = None
        self.best: Any = None
        self.rows: list[tuple[float, ...]] = []

    def run_if_valid(self) -> int:
        """Run the search, unless traced numbers turn out to be invalid; return the status code."""
        code = self.box.input_status(self.start, self.tol)
        with np.errstate(all="ignore"):
            return self.run() if code == status.OK else code

    def run(self) -> int:
        """Search from the start, and return the status code; subclasses implement it."""
        raise NotImplementedError

    def evaluate_at(self, x: Float[np.ndarray, " n"]) -> TrialPoint:
        """Evaluate the function at parameters x, [n], projected into the bounds; count it."""
        x = self.box.project(x)
        values, jacobian, code = self.evaluate(x.astype(self.start.dtype))
        if self.evaluations == 0:
            warn_of_undefined_derivative(values, jacobian, code, params=self.params)
        values, jacobian = (np.asarray(part, x.dtype) for part in (values, jacobian))
        point = TrialPoint(x, values.ravel(), jacobian.reshape(-1, x.size), int(code))
        if not point.failed and not all(np.isfinite(part).all() for part in point[1:3]):
            point = point._replace(code=status.NONFINITE)
        self.evaluations += 1
        self.failures += point.failed
        return point

    def record(self, row: tuple[float, ...], kind: Callable[..., Any], *news: Any) -> None:
        """Append a row of numbers to the history, and call `listen` with a report.

        The report is `kind`, a class of `progress`, with the index of the row, the largest
        number of steps and the numbers `news`.
        """
        self.rows.append(row)
        if self.listen is not None:
            numbers = (np.asarray(x).item() for x in news)
            self.listen(kind(len(self.rows) - 1, self.steps, *numbers))

    def history(self, *is_float: bool) -> list[Any]:
        """Return the columns of the history, [steps + 1]: floats padded with NaN, integers with -1.

        `is_float` says of each number of a row whether it is a float.
        """
        nothing = [np.nan if own else -1 for own in is_float]
        rows = [*self.rows, *[nothing] * (self.steps + 1 - len(self.rows))]
        dtypes = [self.start.dtype if own else np.int32 for own in is_float]
        return [np.array(x, dtype) for *x, dtype in zip(*rows, dtypes, strict=True)]


@as_program
def values_and_jacobian(
    function: TracedFunction, args: tuple[Any, ...], x: Float[Array, " n"]
) -> tuple[Float[Array, " m"], Float[Array, "m n"], Int[Array, ""]]:
    """Evaluate a function of parameters `x` [n] and further arguments, and its Jacobian.

    The function returns values [m] and a status code. Forward mode is used for at most as many
    parameters as values, else reverse mode.

    Returns:
        The values [m], their Jacobian [m, n], and the status code.
    """

    def with_values(x):
        values, code = function(x, args)
        return values, (values, code)

    # not `jax.linearize`: separate forward and linear parts make a program half as long again
    differentiate = jax.jacfwd if x.size <= function.result[0].size else jax.jacrev
    jacobian, (values, code) = differentiate(with_values, has_aux=True)(x)
    return values, jacobian, code


def call_search(
    search: Callable[..., _T],
    functions: tuple[Any, ...],
    numbers: tuple[Any, ...],
    tol: Float[ArrayLike, ""],
    steps: int,
    progress: Any,
) -> _T:
    """Return ``search(*functions, *numbers, tol, steps, listen)``, also for traced numbers.

    Args:
        search: function of known arrays, see `run_search`. An invalid tolerance ends it at once,
            with a result in the shapes of others.
        functions: traced functions and what they take, pytrees of arrays.
        numbers: pytrees of what the search itself computes with.
        tol, steps, progress: as of `fit`.

    Returns:
        The result in arrays of jax.
    """
    listen = as_listener(progress)

    def run(problem):
        return search(*problem, int(steps), listen)

    shapes = jax.tree.map(lambda x: np.zeros(x.shape, x.dtype), numbers)
    like, problem = run((*functions, *shapes, np.nan)), (*functions, *numbers, tol)
    return internals.as_jax_arrays(run_search(run, problem, like, reports=listen is not None))
