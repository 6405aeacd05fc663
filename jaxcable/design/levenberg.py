"""The search of `fit` and `tune`: the Levenberg-Marquardt method on a flat vector.

Parameters without influence (columns of the Jacobian that are zero or rounding) are left out of the
steps: scaled by their own norms, as the method scales columns, they would lead anywhere.
"""

from __future__ import annotations

from typing import NamedTuple

import jax
import jax.numpy as jnp
from jax import lax

from ..common import status
from ..common.tree import pytree, select_tree
from ..common.types import Array, ArrayLike, Bool, Float, Int
from ..linear import unbatched
from .bounds import BoxBounds
from .trials import Evaluation, final_status

_FIRST_DAMPING = 1e-3  # columns of the scaled Jacobian have norms of at most 1: nearly a whole step
_SINGULAR = 1e-12  # damping of a whole step: it leaves out smaller squared singular values
_LARGEST_DAMPING = 1e20  # damping from which a step is too short to matter
_ACCEPTABLE = 1e-4  # least part of the promised decrease to accept a step, as in MINPACK
_MAX_ROUNDS = 8  # how often a step is computed again because entries have met a bound
_NOISE = 1e-9  # changes of the squared misfit, relative to it, within the tolerance of an analysis
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


class LevenbergState(NamedTuple):
    """State of the search of `fit` between two evaluations.

    Attributes:
        trial: flat parameters to be evaluated next, [n].
        x, residual, jacobian: the last accepted point, its residuals and its Jacobian.
        size: largest norm that each column of the Jacobian has had, [n].
        damping: damping ``mu`` of the step to the trial point.
        growth: factor on the damping if the trial point is not accepted.
        promised: decrease of half the squared misfit that the linear model predicts.
        first: misfit at the start.
        least: sizes of the parameters below which steps cannot be told from zero, [n].
        n_trial: number of trial points after the start; -1 before the start is evaluated.
        history: `FitHistory`.
        code, running: status, and whether the search goes on.
    """

    trial: Float[Array, " n"]
    x: Float[Array, " n"]
    residual: Float[Array, " n_residual"]
    jacobian: Float[Array, "n_residual n"]
    size: Float[Array, " n"]
    damping: Float[Array, ""]
    growth: Float[Array, ""]
    promised: Float[Array, ""]
    first: Float[Array, ""]
    least: Float[Array, " n"]
    n_trial: Int[Array, ""]
    history: FitHistory
    code: Int[Array, ""]
    running: Bool[Array, ""]


@pytree(static=("steps",))
class LevenbergMarquardt:
    """The Levenberg-Marquardt method of `fit`: `advance` maps a `LevenbergState` to the next one.

    The caller computes residuals and Jacobian at the trial point of each state, an `Evaluation`,
    and passes them to `advance`, until the state is no longer `running`.

    Args:
        box: `BoxBounds` of the flat parameters.
        tol: tolerance of convergence, as in `fit`.
        steps: largest number of trial points after the start.
    """

    box: BoxBounds
    tol: Float[ArrayLike, ""]
    steps: int

    def initial_state(self, x: Float[Array, " n"], count: int) -> LevenbergState:
        """Return the state before the start `x`, [n], is evaluated; there are `count` residuals."""
        one, none = jnp.ones((), x.dtype), jnp.int32(0)
        real, whole = jnp.full(self.steps + 1, jnp.nan * one), jnp.full(self.steps + 1, none - 1)
        return LevenbergState(
            trial=x,
            x=x,
            residual=jnp.full(count, jnp.nan * one),
            jacobian=jnp.full((count, x.size), jnp.nan * one),
            size=jnp.zeros_like(x),
            damping=_FIRST_DAMPING * one,
            growth=2 * one,
            promised=one,
            first=one,
            least=jnp.finfo(x.dtype).eps * self._array_norms(x),
            n_trial=none - 1,
            history=FitHistory(real, whole, real, whole),
            code=none,
            running=jnp.ones((), bool),
        )

    def advance(self, s: LevenbergState, found: Evaluation) -> LevenbergState:
        """Accept or refuse the trial point of state `s`, and return the next state.

        `found` has residuals, Jacobian and status at the trial point. The next state has the next
        trial point, or `running` False and the final status.
        """
        residual, jacobian, code = found.mark_nonfinite()
        sound, begun = code == status.OK, s.n_trial >= 0
        before, after = (0.5 * jnp.sum(r**2) for r in (s.residual, residual))
        gain = jnp.where(begun, (before - after) / s.promised, 1.0)
        accepted = sound & (~begun | ((gain > _ACCEPTABLE) & (s.promised > 0)))
        promised = s.promised
        misfit = jnp.where(sound, jnp.sqrt(2 * after), jnp.nan)
        entries = FitHistory(misfit, accepted.astype(jnp.int32), s.damping, code)
        reduced = s.damping * jnp.maximum(_LEAST_FACTOR, 1 - (2 * gain - 1) ** 3)
        damping = jnp.where(accepted, jnp.where(begun, reduced, s.damping), s.damping * s.growth)
        new, old = (s.trial, residual, jacobian), (s.x, s.residual, s.jacobian)
        x, residual, jacobian = select_tree(accepted, new, old)
        size = jnp.maximum(s.size, jnp.linalg.norm(jacobian, axis=0))
        blocked = self.box.blocked_entries(x, residual @ jacobian)
        no_influence = self.lacks_influence(x, residual, jacobian)
        held = blocked | no_influence
        trial = self._trial_point_within_bounds(x, residual, jacobian, size, damping, held)
        change = jacobian @ (trial - x)
        s = s._replace(
            trial=trial,
            x=x,
            residual=residual,
            jacobian=jacobian,
            size=size,
            damping=damping,
            growth=jnp.where(accepted, 2.0, 2 * s.growth),
            promised=-(residual @ change) - 0.5 * jnp.sum(change**2),
            first=jnp.where(begun, s.first, misfit),
            n_trial=s.n_trial + 1,
            history=jax.tree.map(lambda h, e: h.at[s.n_trial + 1].set(e), s.history, entries),
        )
        # a change within the noise of the analysis cannot be judged
        noise = max(_NOISE, 64 * float(jnp.finfo(x.dtype).eps)) * before
        refused = begun & sound & ~accepted
        only_noise = refused & (jnp.abs(before - after) <= noise) & (promised <= noise)
        converged = (begun | sound) & self._has_converged(s, held, begun, refused, only_noise)
        # if no parameter can be changed, and none has been, this is no minimum
        moved = jnp.sum(jnp.maximum(s.history.accepted, 0)) > 1
        useless = sound & ~moved & jnp.all(held) & jnp.any(no_influence & ~blocked)
        useless &= jnp.any(s.residual != 0)
        converged &= ~useless
        # a start without slope may as well be a maximum, but for one without a misfit
        level = jnp.all(blocked | (s.residual @ s.jacobian == 0)) & jnp.any(~blocked)
        blind = converged & ~begun & level & jnp.any(s.residual != 0)
        hopeless = useless | (~accepted & ((damping > _LARGEST_DAMPING) | jnp.all(trial == x)))
        return s._replace(
            code=final_status(begun | sound, blind, converged, hopeless),
            running=~converged & (begun | sound) & (s.n_trial < self.steps) & ~hopeless,
        )

    def _has_converged(self, s, held, begun, refused, only_noise):
        """Return whether the last accepted point meets a criterion of convergence of `fit`.

        It is judged by the undamped step, since damping can make a step short anywhere.

        Args:
            s: state of the search.
            held: parameters that do not move, [n] bool: blocked by a bound, or without influence.
            begun: whether a step has been tried.
            refused: whether the last trial point was not accepted although its analysis succeeded.
            only_noise: whether the squared misfit changed there by no more than the noise of an
                analysis, and the linear model had predicted no more than that either.
        """
        size = jnp.linalg.norm(s.jacobian, axis=0)
        whole = _solve_damped_step(s.residual, s.jacobian, size, _SINGULAR, held)
        misfit = jnp.linalg.norm(s.residual)
        gain = jnp.linalg.norm(s.jacobian @ whole)  # over the misfit: cosine of r and range of J
        stationary = begun & (gain <= self.tol * misfit)
        settled = jnp.all(
            jnp.abs(whole) <= self.tol**1.5 * jnp.maximum(self._array_norms(s.x), s.least)
        )
        # zero: beside the misfit at the start, and beside what the parameters contribute
        beside = jnp.minimum(s.first, jnp.max(size * jnp.abs(s.x)))
        zero = misfit <= jnp.maximum(self.tol**2, jnp.finfo(misfit.dtype).eps) * beside
        zero |= refused & (misfit <= _NOISE * beside)
        return stationary | settled | zero | (only_noise & (gain <= _COSINE_OF_NOISE * misfit))

    def _trial_point_within_bounds(self, x, residual, jacobian, size, damping, blocked):
        """Return the next trial point, [n]: `x` plus a damped step that stays within the bounds.

        A parameter that meets a bound stops there; the step of the other ones is then computed
        again. `size` and `damping` are as in `_solve_damped_step`; `blocked` parameters, [n] bool,
        do not move.
        """

        def again(s):
            move, stopped, _, count = s
            known = jnp.where(stopped, move, 0.0)
            others = _solve_damped_step(
                residual + jacobian @ known, jacobian, size, damping, stopped
            )
            wanted = x + jnp.where(stopped, known, others)
            trial = self.box.project(wanted)
            return trial - x, stopped | (trial != wanted), jnp.any(trial != wanted), count + 1

        start = (jnp.zeros_like(x), blocked, jnp.ones((), bool), 0)
        move, *_ = lax.while_loop(lambda s: s[2] & (s[3] < _MAX_ROUNDS), again, start)
        return self.box.project(x + move)

    def lacks_influence(
        self,
        x: Float[Array, " n"],
        residual: Float[Array, " n_residual"],
        jacobian: Float[Array, "n_residual n"],
    ) -> Bool[Array, " n"]:
        """Return which parameters have no influence on the residuals, to rounding, [n] bool.

        These are parameters whose change by their whole size (that of their array, or the range
        between their bounds if it is larger) changes the residuals by less than 4096 eps of their
        norm and of what any other parameter contributes to them, ``|J_k| |x_k|``. Units do not
        matter.
        """
        columns = jnp.linalg.norm(jacobian, axis=0)
        span = self.box.upper - self.box.lower
        whole = jnp.maximum(self._array_norms(x), jnp.where(jnp.isfinite(span), span, 0.0))
        beside = jnp.maximum(jnp.linalg.norm(residual), jnp.max(columns * jnp.abs(x)))
        little = columns * whole <= _ROUNDING * jnp.finfo(x.dtype).eps * beside
        return (columns == 0) | ((whole > 0) & little)

    def _array_norms(self, x):
        """Return, for every parameter, the norm of the array that contains it, [n]."""
        return self.box.norm_per_array(jnp.linalg.norm, x)


def _solve_damped_step(residual, jacobian, size, damping, blocked):
    """Solve ``(J^T J + mu D^2) d = -J^T r`` for the step d, [n], by QR of ``[J/D; sqrt(mu) I]``.

    `residual` is r, `jacobian` J, `damping` mu; `size` is D, [n], with 1 used in place of 0. The
    step of `blocked` parameters, [n] bool, is zero.
    """
    size = jnp.where(size > 0, size, 1.0)
    scaled = jnp.where(blocked[None, :], 0.0, jacobian / size[None, :])
    damper = jnp.sqrt(jnp.asarray(damping, size.dtype)) * jnp.eye(size.size, dtype=size.dtype)
    # a search has no derivative, and `no_derivative.refuse_derivative` says so of its result
    q, r = unbatched.qr(lax.stop_gradient(jnp.concatenate([scaled, damper])))
    return unbatched.solve_triangular(r, -(residual @ q[: residual.size]), lower=False) / size
