"""A constrained problem as optimization libraries get it; their runs until a point is verified.

Parameters and loss are scaled to a size of about 1. Where an analysis fails, the library gets a
loss so high that it shortens the step, and the constraints of the last point that succeeded. If it
asks for the gradient there, it has given up: its run ends.
"""

from __future__ import annotations

import contextlib
from collections.abc import Callable

import numpy as np

from ..common import status
from ..common.progress import Step
from ..common.types import Float
from .optimality import solve_kkt_conditions
from .trials import ParameterSearch, TrialPoint

FAILED_LOSS = 1e10
"""Scaled loss of a failed analysis: no library accepts it, since the gradient at the start is 1."""
MAX_TRIALS = 20
"""Largest number of evaluations per allowed step, so that a library cannot loop."""
_FIRST = 0.1  # part of the first loss that changes are compared with, see `minimum_criteria`
# A run was of use if the KKT residual, or the violation, has fallen to below this part.
_USEFUL = 0.5
_SHORTER = 0.1  # first step of a run over that of the run before it


class RunEnded(Exception):  # noqa: N818 - not an error
    """Raised by a function that an optimization library calls, to end the run of the library."""


class ConstrainedSearch(ParameterSearch):
    """A search that runs an optimization library repeatedly until the KKT conditions hold.

    Every run starts from the best point so far. (KKT: Karush, Kuhn and Tucker.) The values of trial
    points are the loss, then the constraints; the library gets these plus the tolerance. Arguments
    are those of `ParameterSearch`, with bounds in double precision.

    Attributes:
        best: the `TrialPoint` of lowest loss that meets all constraints; if none does, that of the
            smallest violation.
        reached: the last point that the library has accepted.
        first, current: the start, and the last trial point.
        sound: the last trial point that has not failed.
        scaled_start, lower, upper: scaled start and bounds as the library gets them, [n].
    """

    def run_library(
        self,
        solve: Callable[[ConstrainedSearch, int, float], None],
        step: Float[np.ndarray, " n"],
        rounds: int,
    ) -> tuple[TrialPoint, int, int]:
        """Run a library at most `rounds` times.

        Args:
            solve: function of `nlp_solvers` that runs one library.
            step: typical changes of the parameters in the first step, [n].
            rounds: largest number of runs.

        Returns:
            The final point, the status, and the number of runs.
        """
        missing = np.inf
        best = self.first = self.evaluate_at(self.start)
        if best.failed:
            return best, status.BAD_START, 0
        self.is_verified(best)
        for number in range(1, rounds + 1):
            steep = float(np.linalg.norm(best.gradient * step))
            unit = 1 / (steep if steep > 0 else self.loss_size(best))
            self.begin_run(best, step, unit, MAX_TRIALS * self.steps)
            with contextlib.suppress(RunEnded):
                solve(self, self.steps, self.tol)
            for point in (self.reached, self.best):
                left = self.multipliers_and_residual(point)[1]
                if point.violation <= 0 and left <= self.tol:
                    # where the gradient of the start is zero, it may as well be a maximum
                    free = (point.x > self.box.lower) & (point.x < self.box.upper)
                    moved = (point.x != self.first.x).any() or point.gradient[free].any()
                    blind = free.any() and not moved
                    return point, status.STATIONARY if blind else status.OK, number
            before, best = best, self.best
            if best.violation > _USEFUL * before.violation > 0:
                return best, status.CONSTRAINTS_VIOLATED, number
            fallen = before.loss - best.loss > self.tol**2 * self.loss_size(best)
            if not (fallen or left <= _USEFUL * missing or before.violation > 0):
                return best, status.STALLED, number
            missing, step = min(left, missing), _SHORTER * step
        code = status.CONSTRAINTS_VIOLATED if best.violation > 0 else status.OUT_OF_STEPS
        return best, code, rounds

    def multipliers_and_residual(self, point: TrialPoint) -> tuple[np.ndarray, float]:
        """Return the Lagrange multipliers at a point, [m], and its KKT residual over the loss."""
        sizes = self.typical_sizes(point.x)
        multipliers, residual = solve_kkt_conditions(point, self.box, sizes, self.tol)
        return multipliers, residual / self.loss_size(point)

    def typical_sizes(self, x: Float[np.ndarray, " n"]) -> Float[np.ndarray, " n"]:
        """Return the typical sizes of parameters at `x`, [n], at least those at the start."""
        return np.maximum(self.box.typical_sizes(self.start), self.box.largest_per_array(x))

    def loss_size(self, point: TrialPoint) -> float:
        """Return the size of the loss at a point, positive, which residuals are divided by.

        It is the larger of the present loss and a part of that at the start; if both are zero, the
        change of the loss by a change of one parameter by its typical size.
        """
        size = max(abs(point.loss), _FIRST * abs(self.first.loss))
        return float(size or np.abs(point.gradient * self.typical_sizes(point.x)).max() or 1.0)

    def is_verified(self, point: TrialPoint) -> bool:
        """Return whether an accepted point meets all constraints and the KKT conditions; report it.

        If so the run of the library is to end.
        """
        residual = self.multipliers_and_residual(point)[1]
        known = self.rows[-1][0] if self.rows else 0
        news = point.loss, residual, self.failures - known
        self.record((self.failures,), Step, *news)
        return point.violation <= 0 and residual <= self.tol

    # --- what libraries call

    def begin_run(self, start: TrialPoint, size: np.ndarray, unit: float, most: int) -> None:
        """Set the start of the next run of a library, and the scales of what it gets.

        These are parameters over `size` [n], and the loss times `unit`. After `most` evaluations
        the run ends.
        """
        self.size, self.unit, self.most = size, unit, self.evaluations + most
        self.scaled_start, self.reached = start.x / size, start
        self.lower, self.upper = self.box.lower / size, self.box.upper / size

    def evaluate_at(self, x: Float[np.ndarray, " n"]) -> TrialPoint:
        """Evaluate the problem at parameters x, [n], projected into the bounds; count the point.

        Evaluating the last point again costs nothing.
        """
        # libraries leave bounds by rounding; numbers belong to the point within, which is kept
        if self.current is None or (self.box.project(x) != self.current.x).any():
            self.current = super().evaluate_at(x)
            if not self.current.failed:
                self.sound = self.current
                self.best = self.sound if self.sound.is_better_than(self.best) else self.best
        return self.current

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
        return FAILED_LOSS if found.failed else self.unit * found.loss

    def gradient(self, y: Float[np.ndarray, " n"]) -> np.ndarray:
        """Return the gradient of the scaled loss, [n], at scaled parameters y, [n].

        Libraries ask for it where they accept a point, so that it also reports the point. Raises
        RunEnded if the analysis fails there, or if the point is verified.
        """
        found = self.evaluate_scaled(y)
        if found.failed:
            raise RunEnded
        if (found.x != self.reached.x).any():
            self.reached = found
            if self.is_verified(found):
                raise RunEnded
        return self.unit * found.gradient * self.size

    def constraints(self, y: Float[np.ndarray, " n"]) -> np.ndarray:
        """Return the constraints plus the tolerance, [m], at scaled parameters y [n]."""
        return self._last_successful_point(y).constraints + self.tol

    def jacobian(self, y: Float[np.ndarray, " n"]) -> np.ndarray:
        """Return the Jacobian of the constraints by the scaled parameters, [m, n], at y, [n]."""
        return self._last_successful_point(y).jacobian[1:] * self.size

    def _last_successful_point(self, y):
        """Return the trial point at scaled parameters y; if it failed, the last that succeeded."""
        found = self.evaluate_scaled(y)
        return self.sound if found.failed else found
