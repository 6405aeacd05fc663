"""The search of `fit` and `tune`: the Levenberg-Marquardt method on a flat vector.

Parameters without influence (columns of the Jacobian that are zero or rounding) are left out of the
steps: scaled by their own norms, as the method scales columns, they would lead anywhere.
"""

from __future__ import annotations

import numpy as np

from ..common import status
from ..common.progress import Trial
from ..common.tree import pytree
from ..common.types import Array, Bool, Float, Int
from .trials import ParameterSearch, TrialPoint, unevaluated_point

_FIRST_DAMPING = 1e-3  # columns of the scaled Jacobian have norms of at most 1: nearly a whole step
_SINGULAR = 1e-12  # damping of a whole step: it leaves out smaller squared singular values
_LARGEST_DAMPING = 1e20  # damping from which a step is too short to matter
_ACCEPTABLE = 1e-4  # least part of the promised decrease to accept a step, as in MINPACK
_MAX_ROUNDS = 8  # how often a step is computed again because entries have met a bound
_NOISE = 1e-9  # changes of the squared misfit, relative to it, within the tolerance of an analysis
_WINDOW, _PROGRESS = 10, 1e-4  # trial points, and the least decrease of the squared misfit in them
_COSINE_OF_NOISE = 1e-2  # cosine of residuals and Jacobian above which noise is no reason to end
_ROUNDING = 2.0**12  # rounding of a Jacobian over eps: an analysis solves ill-conditioned systems
_LEAST_FACTOR = 0.1  # least factor on the damping after an accepted step; Nielsen (1999) has 1 / 3


@pytree
class FitHistory:
    """History of the trial points of a `fit`, the start first; padded with NaN or -1.

    Attributes:
        misfit: Euclidean norm of the residuals at the point, NaN where the analysis failed,
            [steps + 1].
        accepted: 1 if the point was accepted, else 0, [steps + 1].
        damping: damping ``mu`` of the step to the point, [steps + 1].
        status: status code of the structural analysis at the point, [steps + 1].

    Example:
        >>> strain, force = jnp.array([1e-3, 2e-3, 3e-3]), jnp.array([101.0, 199.0, 301.0])  # -, N
        >>> found = jc.fit(lambda EA: EA * strain - force, jnp.array(5e4))
        >>> history = found.history
        >>> print(found.status, f"{history.misfit[0]:.1f} N", int(history.accepted[1]))
        0 187.6 N 1
    """

    misfit: Float[Array, " steps+1"]
    accepted: Int[Array, " steps+1"]
    damping: Float[Array, " steps+1"]
    status: Int[Array, " steps+1"]


class LevenbergMarquardt(ParameterSearch):
    """The Levenberg-Marquardt method of `fit`; `current` is a `TrialPoint`."""

    def run(self) -> int:
        """Search from the start for least squares, and return the status code."""
        point = self.evaluate_at(self.start)
        self._record(point, not point.failed, _FIRST_DAMPING)
        if point.failed:
            self.current = unevaluated_point(point.x, len(point.values), point.code)
            return status.BAD_START
        self._first, self._size = np.linalg.norm(point.values), np.zeros_like(point.x)
        self._least = np.finfo(point.x.dtype).eps * self._array_norms(point.x)
        self._accept_point(point)
        code = self._status_of_start()
        return self._take_steps() if code is None else code

    def _accept_point(self, point):
        """Make a trial point the current one; update column norms and parameters that are held."""
        self.current = point
        self._size = np.maximum(self._size, np.linalg.norm(point.jacobian, axis=0))
        self._held = np.logical_or(*self.blocked_and_without_influence(point))

    def _status_of_start(self):
        """Return the status if the search ends at its start; None if it goes on."""
        has_misfit = self._first > 0
        blocked = self.blocked_and_without_influence(self.current)[0]
        # if no parameter can be changed this is no minimum
        if has_misfit and self._held.all() and not blocked.all():
            return status.STALLED
        if not self._has_converged(tried=False):
            return None
        # a start without slope may as well be a maximum, but for one without a misfit
        level = blocked | (self.current.values @ self.current.jacobian == 0)
        blind = has_misfit and level.all() and not blocked.all()
        return status.STATIONARY if blind else status.OK

    def _take_steps(self):
        """Take damped steps until the search ends, and return the status code."""
        damping, growth = _FIRST_DAMPING, 2.0
        noise = max(_NOISE, 64 * np.finfo(self.current.x.dtype).eps)
        for _ in range(self.steps):
            before = self.current
            x = self._trial_point_within_bounds(damping)
            if not self.rows[-1][1] and (x == before.x).all():
                return status.STALLED
            change = before.jacobian @ (x - before.x)
            promised = -(before.values @ change) - 0.5 * (change @ change)
            point = self.evaluate_at(x)
            squares, new = (0.5 * (r @ r) for r in (before.values, point.values))
            fallen = squares - new
            accepted = not point.failed and promised > 0 and fallen > _ACCEPTABLE * promised
            self._record(point, accepted, damping)
            if accepted:
                self._accept_point(point)
                factor = 1 - (2 * fallen / promised - 1) ** 3
                damping, growth = damping * max(_LEAST_FACTOR, factor), 2.0
            else:
                damping, growth = damping * growth, 2 * growth
            # a change within the noise of the analysis cannot be judged
            refused = not point.failed and not accepted
            only_noise = refused and max(abs(fallen), promised) <= noise * squares
            if self._has_converged(refused=refused, only_noise=only_noise):
                return status.OK
            if (not accepted and damping > _LARGEST_DAMPING) or self._zigzags(noise):
                return status.STALLED
        return status.OUT_OF_STEPS

    def _zigzags(self, noise):
        """Return whether steps get nowhere, as between cables that go slack and taut by turns.

        Half of the last trial points were refused then, and the others improve the misfit by
        hardly anything together, but by far more than `noise`, a part of the squared misfit.
        """
        accepted = np.array([row[1] for row in self.rows[-_WINDOW:]], bool)
        if len(self.rows) <= _WINDOW or not 0 < accepted.sum() <= _WINDOW // 2:
            return False
        least = np.minimum.accumulate([row[0] if row[1] else np.inf for row in self.rows])
        return 1e3 * noise < 1 - (least[-1] / least[-1 - _WINDOW]) ** 2 < _PROGRESS

    def _record(self, point, accepted, damping):
        """Append misfit, acceptance, damping and status of a point to the history; report it."""
        misfit = np.nan if point.failed else np.linalg.norm(point.values)
        news = misfit, int(accepted), point.code
        self.record((misfit, int(accepted), damping, point.code), Trial, *news)

    def _has_converged(self, tried=True, refused=False, only_noise=False):
        """Return whether the last accepted point meets a criterion of convergence of `fit`.

        It is judged by the undamped step, since damping can make a step short anywhere.

        Args:
            tried: whether a step has been tried.
            refused: whether the last trial point was not accepted although its analysis succeeded.
            only_noise: whether the squared misfit changed there by no more than the noise of an
                analysis, and the linear model had predicted no more than that either.
        """
        x, residual, jacobian, _ = self.current
        size = np.linalg.norm(jacobian, axis=0)
        whole = _solve_damped_step(residual, jacobian, size, _SINGULAR, self._held)
        misfit = np.linalg.norm(residual)
        gain = np.linalg.norm(jacobian @ whole)  # over the misfit: cosine of r and range of J
        if tried and gain <= self.tol * misfit:
            return True
        # zero: beside the misfit at the start, and beside what the parameters contribute
        eps = np.finfo(x.dtype).eps
        beside = min(self._first, np.max(size * np.abs(x)))
        if misfit <= max(self.tol**2, eps) * beside or (refused and misfit <= _NOISE * beside):
            return True
        if only_noise and gain <= _COSINE_OF_NOISE * misfit:
            return True
        sizes = np.maximum(self._array_norms(x), self._least)
        return (np.abs(whole) <= self.tol**1.5 * sizes).all()

    def _trial_point_within_bounds(self, damping):
        """Return the next trial point, [n]: a step with this damping mu, within the bounds.

        A parameter that meets a bound stops there; the step of the other ones is then
        computed again.
        """
        x, residual, jacobian, _ = self.current
        move, stopped = np.zeros_like(x), self._held
        for _ in range(_MAX_ROUNDS):
            known = np.where(stopped, move, 0)
            others = _solve_damped_step(
                residual + jacobian @ known, jacobian, self._size, damping, stopped
            )
            wanted = x + np.where(stopped, known, others)
            trial = self.box.project(wanted)
            beyond = trial != wanted
            if not beyond.any():
                break
            move, stopped = trial - x, stopped | beyond
        return trial

    def blocked_and_without_influence(
        self, point: TrialPoint
    ) -> tuple[Bool[np.ndarray, " n"], Bool[np.ndarray, " n"]]:
        """Return which parameters a bound blocks, and which have no influence, [n] bool each.

        Without influence on the residuals, to rounding, are parameters whose change by their whole
        size (that of their array, or the range between their bounds if it is larger) changes the
        residuals by less than 4096 eps of their norm and of what any other parameter contributes to
        them, ``|J_k| |x_k|``. Units do not matter.
        """
        x, residual, jacobian, _ = point
        columns = np.linalg.norm(jacobian, axis=0)
        span = self.box.upper - self.box.lower
        whole = np.maximum(self._array_norms(x), np.where(np.isfinite(span), span, 0))
        beside = max(np.linalg.norm(residual), np.max(columns * np.abs(x)))
        little = columns * whole <= _ROUNDING * np.finfo(x.dtype).eps * beside
        blocked = self.box.blocked_entries(x, residual @ jacobian)
        return blocked, (columns == 0) | ((whole > 0) & little)

    def _array_norms(self, x):
        """Return, for every entry of `x` [n], the norm of the array that contains it."""
        return self.box.norm_per_array(np.linalg.norm, x)


def _solve_damped_step(residual, jacobian, size, damping, blocked):
    """Solve ``(J^T J + mu D^2) d = -J^T r`` for the step d, [n], by QR of ``[J/D; sqrt(mu) I]``.

    `residual` is r, `jacobian` J, `damping` mu; `size` is D, [n], with 1 used in place of 0. The
    step of `blocked` parameters, [n] bool, is zero.
    """
    size = np.where(size > 0, size, np.ones_like(size))
    scaled = np.where(blocked, 0, jacobian / size)
    damper = np.sqrt(damping) * np.eye(size.size, dtype=size.dtype)
    q, r = np.linalg.qr(np.concatenate([scaled, damper.astype(size.dtype)]))
    return -np.linalg.solve(r, residual @ q[: residual.size]) / size
