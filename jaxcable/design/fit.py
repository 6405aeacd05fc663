"""Nonlinear least squares within bounds: Levenberg-Marquardt on exact Jacobians."""

import functools
from typing import NamedTuple

import jax
import jax.numpy as jnp
from jax import lax
from jax.flatten_util import ravel_pytree

from .. import status
from .._tree import pytree
from .box import Box, default_tol, make_box, numbers
from .descent import worst_code

_DAMPING = 1e-3  # at the start, over the largest column of the scaled Jacobian, which is 1
_SINGULAR = 1e-12  # damping of a whole step: directions this weak (squared) count as none
_LARGEST = 1e20  # damping at which no step is left
_WORTH = 1e-4  # part of the promised decrease that makes a step acceptable


@pytree
class FitHistory:
    """What happened at each trial point, first of all the start; NaN or -1 after the last one.

    Attributes:
        misfit: Euclidean norm of the residuals at the point, NaN where the analysis failed,
            [steps + 1].
        accepted: 1 if the point was accepted, else 0, [steps + 1].
        damping: that led to it, [steps + 1].
        status: code of the inner analysis, [steps + 1].
    """

    misfit: object
    accepted: object
    damping: object
    status: object


@pytree
class Fit:
    """Result of `fit`.

    Attributes:
        params: in the shape of the start.
        residual: flattened, [n_residual].
        jacobian: of the flattened residuals with respect to the flattened parameters,
            [n_residual, n_param].
        misfit: Euclidean norm of the residuals.
        free: which parameters are not at a bound that holds them, in the shape of `params`.
        history: `FitHistory`.
        status: 0 if it has converged; `describe` has the texts.
        steps: number of trial points after the start, accepted or not.
    """

    params: object
    residual: object
    jacobian: object
    misfit: object
    free: object
    history: FitHistory
    status: object
    steps: object


class _State(NamedTuple):
    trial: object
    x: object
    residual: object
    jacobian: object
    size: object
    damping: object
    growth: object
    n: object
    first: object
    promised: object
    history: object
    code: object
    running: object


def fit(residuals, params, bounds=None, steps=100, tol=None, *, args=()):
    """Minimise the sum of squared residuals, within bounds.

    Levenberg-Marquardt: ``(J^T J + mu D^2) d = -J^T r`` by a QR factorisation of the stacked
    matrix, with ``D`` the largest norm that each column of J has had, so that units of the
    parameters do not matter (Moré 1978); the damping ``mu`` follows the ratio of the decrease to
    the one promised (Nielsen 1999). The Jacobian is exact, in forward mode if there are at most as
    many parameters as residuals and in reverse mode else.

    Args:
        residuals: function ``residuals(params, *args)`` to an array, or any pytree of them, or
            (residuals, `Solution`) or (residuals, status codes). Divide them by their standard
            deviations where these differ.
        params: start, any pytree of floats.
        bounds: (lower, upper), each None, a scalar, an array or a prefix pytree of `params`.
        steps: number of trial points after the start, at most.
        tol: stop when the undamped step would change the residuals by at most `tol` of the misfit,
            or every parameter by at most ``tol^1.5`` of its size (the norm of its array),
            or when the misfit is at most ``tol^2`` of that at the start. Default: 1e-6 in float64,
            1e-3 in float32.
        args: further arguments of the residuals; what changes from call to call (see `minimize`).

    Returns:
        `Fit`. Works under jit and vmap; has no derivative.

    Raises:
        ValueError: residuals that are no floats, bounds that leave no room, a start outside them.

    A trial point at which the analysis fails is never accepted: the damping grows until a shorter
    step works, or the status is STALLED. Parameters that nothing depends on stay where they are.
    """
    if not callable(residuals):
        raise ValueError(f"residuals: expected a function, got {type(residuals).__name__}")
    if isinstance(steps, bool) or not isinstance(steps, int) or steps < 1:
        raise ValueError(f"steps = {steps!r}: expected a positive integer")
    params = numbers(params)
    tol = default_tol(params) if tol is None else tol
    return _compiled(residuals, steps)(params, tuple(args), make_box(bounds, params), tol)


@functools.lru_cache(maxsize=32)
def _compiled(residuals, steps):
    """The program for a function of residuals; see `minimize`."""

    @jax.jit
    def run(params, args, box, tol):
        start, back = ravel_pytree(params)
        if not jnp.issubdtype(start.dtype, jnp.floating):
            raise ValueError("params: expected floats")
        flat = Box(ravel_pytree(box.lower)[0], ravel_pytree(box.upper)[0])
        sizes = ravel_pytree(
            jax.tree.map(lambda x: jnp.full_like(x, jnp.linalg.norm(x.ravel())), params)
        )[0]

        def flattened(x):
            told, code = residuals(back(x), *args), ()
            if isinstance(told, tuple) and len(told) == 2 and _tells(told[1]):
                told, code = told
            r = ravel_pytree(told)[0]
            if r.size == 0 or not jnp.issubdtype(r.dtype, jnp.floating):
                raise ValueError("residuals: expected arrays of floats")
            return r, worst_code(code, "residuals")

        end = _levenberg_marquardt(flattened, start, flat, sizes, steps, tol)
        held = flat.blocked(end.x, end.residual @ end.jacobian)
        return Fit(
            params=back(end.x),
            residual=end.residual,
            jacobian=end.jacobian,
            misfit=jnp.linalg.norm(end.residual),
            free=jax.tree.map(lambda f: f > 0.5, back((~held).astype(start.dtype))),
            history=FitHistory(*end.history),
            status=jnp.where(box.holds(params), end.code, status.OUTSIDE),
            steps=jnp.maximum(end.n, 0),
        )

    return run


def _tells(item):
    """Whether an item beside the residuals is a solution or codes, and no residuals."""
    leaves = jax.tree.leaves(item, is_leaf=lambda leaf: hasattr(leaf, "status"))
    return all(
        hasattr(leaf, "status") or jnp.issubdtype(jnp.asarray(leaf).dtype, jnp.integer)
        for leaf in leaves
    )


def _evaluate(flattened, x):
    """Residuals, Jacobian and code at a point; the code says so if a number is not finite."""
    shape, _ = jax.eval_shape(flattened, x)
    basis = jnp.eye(x.size, dtype=x.dtype)
    if x.size <= shape.size:
        residual, push, code = jax.linearize(flattened, x, has_aux=True)
        jacobian = jax.vmap(push, out_axes=1)(basis)
    else:
        residual, pull, code = jax.vjp(flattened, x, has_aux=True)
        jacobian = jax.vmap(pull)(jnp.eye(shape.size, dtype=shape.dtype))[0]
    sound = jnp.all(jnp.isfinite(residual)) & jnp.all(jnp.isfinite(jacobian))
    code = jnp.where((code == status.OK) & ~sound, status.NONFINITE, code)
    return residual, jacobian, code


def _step(residual, jacobian, size, damping, held):
    """Damped Gauss-Newton step, zero where held: ``[J/D; sqrt(mu) I] D d = [-r; 0]``."""
    n = size.size
    scaled = jnp.where(held, 0.0, jacobian / size)
    stacked = jnp.concatenate([scaled, jnp.sqrt(damping) * jnp.eye(n, dtype=size.dtype)])
    q, r = jnp.linalg.qr(stacked)
    return jax.scipy.linalg.solve_triangular(r, -(residual @ q[: residual.size])) / size


def _levenberg_marquardt(flattened, start, box, sizes, steps, tol):
    """The loop: one trial point a turn."""
    shape, _ = jax.eval_shape(flattened, start)
    dtype = start.dtype
    least = jnp.finfo(dtype).eps

    def turn(s):
        residual, jacobian, code = _evaluate(flattened, s.trial)
        sound, begun = code == status.OK, s.n >= 0
        cost, before = (0.5 * jnp.sum(r**2) for r in (residual, s.residual))
        gain = jnp.where(begun, (before - cost) / s.promised, 1.0)
        good = sound & (~begun | ((gain > _WORTH) & (s.promised > 0)))
        misfit = jnp.where(sound, jnp.sqrt(2 * cost), jnp.nan)
        first = jnp.where(begun, s.first, misfit)

        entries = (misfit, good, s.damping, code)
        history = [
            h.at[s.n + 1].set(e.astype(h.dtype)) for h, e in zip(s.history, entries, strict=True)
        ]
        x = jnp.where(good, s.trial, s.x)
        residual = jnp.where(good, residual, s.residual)
        jacobian = jnp.where(good, jacobian, s.jacobian)
        column = jnp.linalg.norm(jacobian, axis=0)
        size = jnp.maximum(s.size, column)
        factor = jnp.maximum(0.1, 1 - (2 * gain - 1) ** 3)
        damping = jnp.where(
            good, jnp.where(begun, s.damping * factor, s.damping), s.damping * s.growth
        )
        growth = jnp.where(good, 2.0, 2 * s.growth)

        held = box.blocked(x, residual @ jacobian)
        unit = jnp.where(size > 0, size, 1.0)
        trial = box.project(x + _step(residual, jacobian, unit, damping, held))
        move = trial - x
        change = jacobian @ move
        promised = -(residual @ change) - 0.5 * jnp.sum(change**2)

        # whether to stop is asked of the whole step: a damped one is short for other reasons
        whole = _step(residual, jacobian, unit, _SINGULAR, held)
        misfit = jnp.linalg.norm(residual)
        stationary = jnp.linalg.norm(jacobian @ whole) <= tol * misfit
        settled = jnp.all(jnp.abs(whole) <= tol**1.5 * sizes)
        exact = misfit <= jnp.maximum(tol**2, least) * first
        converged = (begun | sound) & (stationary | settled | exact)
        n = s.n + 1
        hopeless = ~good & ((damping > _LARGEST) | jnp.all(trial == x))
        running = ~converged & (begun | sound) & (n < steps) & ~hopeless
        code = jnp.where(
            converged,
            status.OK,
            jnp.where(
                ~begun & ~sound,
                status.BAD_START,
                jnp.where(hopeless, status.STALLED, status.OUT_OF_STEPS),
            ),
        ).astype(jnp.int32)
        return _State(
            trial,
            x,
            residual,
            jacobian,
            size,
            damping.astype(dtype),
            growth.astype(dtype),
            n,
            first,
            promised,
            history,
            code,
            running,
        )

    empty = jnp.full(steps + 1, jnp.nan, dtype)
    count = jnp.full(steps + 1, -1, jnp.int32)
    state = _State(
        trial=start,
        x=start,
        residual=jnp.full(shape.shape, jnp.nan, shape.dtype),
        jacobian=jnp.full((shape.size, start.size), jnp.nan, dtype),
        size=jnp.zeros(start.size, dtype),
        damping=jnp.asarray(_DAMPING, dtype),
        growth=jnp.asarray(2.0, dtype),
        n=jnp.int32(-1),
        first=jnp.zeros((), dtype),
        promised=jnp.ones((), dtype),
        history=[empty, count, empty, count],
        code=jnp.int32(0),
        running=jnp.ones((), bool),
    )
    return lax.while_loop(lambda s: s.running, turn, state)
