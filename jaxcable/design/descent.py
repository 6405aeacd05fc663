"""The search of `minimize`: accept a trial point or shorten the step, and propose the next one.

Where no optimizer is given, this is L-BFGS with a backtracking line search (Armijo). Parameters are
one flat vector here; only the optimizer gets them in the shape that users gave.
"""

from __future__ import annotations

import collections
from typing import Any

import numpy as np

from ..common import status
from ..common.progress import Step
from ..common.tree import pytree
from ..common.types import Array, Float, Int
from .minimum_criteria import MinimumCriteria
from .trials import ParameterSearch, TrialPoint

# Typical change of a parameter over its size, by which the default optimizer scales: the length of
# its first step, before L-BFGS has learned the curvature.
_TYPICAL_CHANGE = 0.1
_MEMORY = 10  # number of steps from which L-BFGS knows the curvature, the usual value
_MAX_SHORTENED = 40  # how often a step is shortened before the search stalls: to below 1e-12 of it
_PATIENCE = 10  # how often a step is shortened before L-BFGS starts again without its memory
_ARMIJO = 1e-4  # least decrease of the loss over that predicted by the slope, the usual value
# Slope at the end of a step over that at its beginning, at most, where the loss has no digits left
# to show a decrease (Hager and Zhang 2006, with delta = 0.1: 2 delta - 1 = -0.8).
_FLATTER = 0.8
_GROWTH = 4.0  # factor on the longest step allowed, from step to step, after a failed analysis
_NOISE = 1e-9  # changes of the loss, relative to it, within the tolerance of an analysis (1e-10)


@pytree
class History:
    """History of the points that `minimize` accepted, the start first; padded with NaN or -1.

    Attributes:
        loss: loss at the point, [steps + 1].
        gradient_norm: dimensionless size of the gradient, which `tol` limits (`minimize` has the
            formula), [steps + 1].
        status: 0, or the code of the last analysis that failed in the step to the point and so
            shortened the step, [steps + 1].
        failures: number of such failures in the step to the point, [steps + 1].
        shortened: how often the step was shortened, because an analysis failed or because the loss
            did not fall, [steps + 1].

    Example:
        >>> loss = lambda x: (x[0] - 3.0) ** 2 + 10.0 * (x[1] - 1.0) ** 2 + 5.0
        >>> found = jc.minimize(loss, jnp.array([0.0, 0.0]), bounds=(0.0, 2.0))
        >>> losses = np.asarray(found.history.loss[: found.steps + 1])
        >>> print(found.status, losses[0], losses[-1].round(4), (np.diff(losses) < 0).all())
        0 24.0 6.0 True
    """

    loss: Float[Array, " steps+1"]
    gradient_norm: Float[Array, " steps+1"]
    status: Int[Array, " steps+1"]
    failures: Int[Array, " steps+1"]
    shortened: Int[Array, " steps+1"]


class LBFGS:
    """The quasi-Newton steps of L-BFGS, as of `optax.lbfgs` without its line search.

    Source: Nocedal and Wright, Numerical Optimization (2006), algorithm 7.4; the first step is no
    longer than 1.
    """

    def __init__(self) -> None:
        self.changes: Any = collections.deque(maxlen=_MEMORY)
        self._last: Any = None

    def step(
        self, x: Float[np.ndarray, " n"], gradient: Float[np.ndarray, " n"]
    ) -> Float[np.ndarray, " n"]:
        """Return the quasi-Newton step at `x` with this gradient, [n], and remember both."""
        scale = min(1.0, 1 / np.linalg.norm(gradient))
        if self._last is not None:
            moved, change = x - self._last[0], gradient - self._last[1]
            curvature, square = moved @ change, change @ change
            self.changes.append((moved, change, 1 / curvature if curvature != 0 else 0 * curvature))
            scale = curvature / square if square > 0 else 1.0
        self._last, step, parts = (x, gradient), -gradient, []
        for moved, change, weight in reversed(self.changes):
            parts.append(weight * (moved @ step))
            step = step - parts[-1] * change
        step = scale * step
        for (moved, change, weight), part in zip(self.changes, reversed(parts), strict=True):
            step = step + (part - weight * (change @ step)) * moved
        return step


class Descent(ParameterSearch):
    """The search of `minimize` for a minimum of one loss; its points are of `AcceptedPoint`.

    Args:
        given: arguments of `ParameterSearch`.
        scale: the optimizer gets the parameters divided by this, [n]; None for the default.
        propose: function of an `AcceptedPoint` to the step, [n], that a user's optimizer proposes;
            None for L-BFGS with a line search. It then must lower the loss.
    """

    def __init__(self, *given: Any, scale: Any, propose: Any):
        super().__init__(*given)
        sizes = self.box.typical_sizes(self.start)
        self.scale = _TYPICAL_CHANGE * sizes if scale is None else scale
        self.sizes, self.propose = sizes, propose
        self.memory, self._longest_step = LBFGS(), np.inf
        self._noise = max(_NOISE, 64 * np.finfo(self.scale.dtype).eps)

    def run(self) -> int:
        """Search from the start for a minimum, and return the status code."""
        point = self.evaluate_at(self.start)
        known = point.loss, np.abs(point.gradient)
        self.criteria = MinimumCriteria(self.box, self.sizes, self.tol, *known)
        self._accept_point(point, 0, int(point.failed), point.code)
        if point.failed:
            self.best = None
            return status.BAD_START
        norm = np.linalg.norm(self.current.inside * self.scale)
        self._loss_factor = 1 / norm if norm > 0 else 1.0
        near, code = False, None
        while code is None:
            before, number = self.current.point, len(self.rows) - 1
            # At the start the sizes of the parameters may be meaningless, and a small measure with
            # them: ask for one accepted step. A point above the best one is no minimum.
            level, least = self.current.measure == 0, self.best.point.loss
            lowest = before.loss <= least + self._noise * abs(least)
            small = self.current.small and lowest and (number > 0 or level)
            if small and (level or near):
                # where no entry was ever anything but zero, nothing has been learned of the loss
                blind = number == 0 and (~self.current.blocked & (before.gradient == 0)).any()
                return status.STATIONARY if blind else status.OK
            if number == self.steps and not (small and self.propose is None):
                return status.OUT_OF_STEPS
            step = self._propose_step()
            if small and self.memory.changes:  # the whole step, by the curvature
                moved = self.box.project(before.x + step) - before.x
                if self.criteria.step_is_negligible(moved, -self.current.inside @ step, before):
                    return status.OK
            if number == self.steps:
                return status.OUT_OF_STEPS
            code = self._search_along(step)
            near = self.propose is not None and self.criteria.minimum_is_near(before, self.current)
        return code

    def _accept_point(self, point, shortened, failures, code):
        """Make a trial point the current one, update the best one, and record the step to it.

        `shortened` is how often the step was shortened, `failures` at how many trial points
        of it the analysis failed, `code` the status of the last failure, or 0.
        """
        before, self.current = self.current, self.criteria.assess(point)
        if before is not None and (before.blocked != self.current.blocked).any():
            self.memory = LBFGS()  # it was made with other entries
        if self.best is None or not point.loss >= self.best.point.loss:
            self.best = self.current
        numbers = point.loss, self.current.measure
        self.record((*numbers, code, failures, shortened), Step, *numbers, failures)

    def _propose_step(self):
        """Return the next step, [n]: that of the user's optimizer or of L-BFGS, zero where blocked.

        L-BFGS forgets its memory if that leads uphill.
        """
        current = self.current
        if self.propose is not None:
            return np.where(current.blocked, 0, self.propose(current))
        given = current.point.x / self.scale, self._loss_factor * self.scale * current.inside
        for _ in range(2):
            step = np.where(current.blocked, 0, self.memory.step(*given) * self.scale)
            if current.inside @ step < 0:
                break
            self.memory = LBFGS()  # the memory of the curvature is misleading
        return step

    def _search_along(self, step):
        """Shorten a step [n] until a point is accepted; return None, or the status if none is."""
        x = self.current.point.x
        length = self._first_trial_length(step)
        shortened = failures = code = 0
        while True:
            point = self.evaluate_at(x + length * step)
            if point.failed:
                failures, code = failures + 1, point.code
            else:
                self.criteria.steepest = np.maximum(self.criteria.steepest, np.abs(point.gradient))
            accepted, factor = self._judge_trial(point)
            if accepted:
                # an analysis will fail again where it has failed: bound steps by the last length
                if failures:
                    self._longest_step = length * np.linalg.norm(step / self.scale)
                self._longest_step *= _GROWTH
                return self._accept_point(point, shortened, failures, code)
            shortened += 1
            if self.propose is None and self.memory.changes and shortened >= _PATIENCE:
                self.memory = LBFGS()  # its step leads nowhere
                step, shortened = self._propose_step(), 0
                length = self._first_trial_length(step)
                continue
            # if no step lowers the loss, a point at rest is a minimum
            at_rest = self.current.at_rest and self.criteria.step_is_short(point.x - x, x)
            if shortened > (_PATIENCE if at_rest else _MAX_SHORTENED):
                return status.OK if at_rest else status.STALLED
            length *= factor

    def _first_trial_length(self, step):
        """Return the fraction of a step [n] to try first: 1, or less where longer steps failed."""
        norm = np.linalg.norm(step / self.scale)
        return min(1.0, self._longest_step / norm) if norm > 0 else 1.0

    def _judge_trial(self, point: TrialPoint) -> tuple[bool, float]:
        """Return whether to accept a trial point, and the factor to shorten the step by if not.

        With the line search the loss has to fall by a part of what its slope predicts (Armijo).
        Where rounding hides such a decrease, the loss must not rise, and its slope must have become
        flatter. With the user's optimizer every point at which the analysis succeeds is accepted.
        """
        if self.propose is not None or point.failed:
            return not point.failed, 0.5
        before = self.current.point
        moved, rise = point.x - before.x, point.loss - before.loss
        promised = self.current.inside @ moved
        level = rise <= self._noise * abs(before.loss)
        level &= point.gradient @ moved <= -_FLATTER * promised
        falls = promised < 0 and (rise <= _ARMIJO * promised or level)
        # curvature of the parabola through loss, slope and trial; the next trial is its minimum
        bend = rise - promised
        return falls, np.clip(-0.5 * promised / bend, 0.1, 0.5) if bend > 0 else 0.5
