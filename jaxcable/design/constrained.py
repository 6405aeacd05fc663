"""Minimise a loss subject to inequalities: the method of multipliers around `minimize`."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, ClassVar

import jax
import jax.numpy as jnp
import numpy as np

from ..analysis.solution import Solution
from ..common import checks, status
from ..common.progress import Step, compiling, listener
from ..common.tree import pytree
from ..common.types import Array, ArrayLike, Float, Int, PyTree
from .arguments import tolerance
from .box import checked_call, default_tol, numbers
from .minimize import minimize
from .outcome import split_loss
from .programs import Programs

_PENALTY = 10.0  # first penalty, over the size of the loss at the start
_HARDER = 10.0  # factor on the penalty when a round has not reduced the violations enough
_ENOUGH = 0.25  # violations after a round over those before it, at most
_USELESS = 0.9  # the same ratio from which the penalty is far too small: it grows by a factor more


@pytree
class ConstrainedDesign:
    """Result of `minimize_subject_to`.

    Attributes:
        params: parameters found, in the shape of the start.
        loss: loss at `params`.
        constraints: constraints at `params`, [n]; all at most 0 if the status is OK.
        multipliers: [n]; by how much the smallest loss would fall if a constraint were relaxed by
            1; zero for a constraint without influence.
        status: 0 if converged, else the status of the last round; CONSTRAINTS_VIOLATED if its
            search has converged and a constraint is above 0.
        rounds: number of rounds of `minimize`.
        evaluations: number of evaluations of loss, constraints and gradient, in all rounds.
        failures: number of trial points at which the inner analysis failed.

    Example:
        >>> problem = lambda area: (area, jnp.array([50e3 / (area * 200.0) - 1.0]))
        >>> found = jc.design.minimize_subject_to(problem, jnp.array(400.0), bounds=(10.0, 1000.0))
        >>> print(jc.describe(found.status), bool((found.constraints <= 0).all()))
        converged True
        >>> print(f"{found.multipliers[0]:.0f} mm2")  # saved if c = 1 were allowed, to 1st order
        250 mm2
    """

    _shown: ClassVar[str] = "loss, constraints, params, rounds, evaluations"

    params: PyTree[Float[Array, " ..."]]
    loss: Float[Array, ""]
    constraints: Float[Array, " n"]
    multipliers: Float[np.ndarray, " n"]
    status: Int[Array, ""]
    rounds: int
    evaluations: int
    failures: int


def minimize_subject_to(
    problem: Callable[
        ...,
        tuple[Float[ArrayLike, ""], Float[ArrayLike, " n"]]
        | tuple[
            Float[ArrayLike, ""], Float[ArrayLike, " n"], PyTree[Solution | Int[ArrayLike, " ..."]]
        ],
    ],
    params: PyTree[Float[ArrayLike, " ..."]],
    bounds: tuple[PyTree[Float[ArrayLike, " ..."]] | None, PyTree[Float[ArrayLike, " ..."]] | None]
    | None = None,
    *,
    rounds: int = 30,
    steps: int = 100,
    tol: float | None = None,
    args: tuple[Any, ...] = (),
    scale: PyTree[Float[ArrayLike, " ..."]] | None = None,
    progress: bool | Callable[[Step], Any] | None = None,
) -> ConstrainedDesign:
    """Minimise a loss subject to ``constraints <= 0`` and bounds.

    This is the method of multipliers (Hestenes, Powell; with inequalities Rockafellar 1973). Each
    round minimises ``f + sum(max(0, m + p c)^2 - m^2) / (2 p)`` by `minimize` with its default
    optimizer, and then sets ``m = max(0, m + p c)``.

    Args:
        problem: function ``problem(params, *args)`` that returns (loss, constraints) or (loss,
            constraints, `Solution` or status codes). The constraints are floats [n] without
            dimension, scaled so that a violation of 1 is a gross one: ``deflection / limit - 1``.
        params, bounds: as for `minimize`.

    Options:
        rounds: largest number of rounds.
        steps: largest number of accepted steps in every round.
        tol: tolerance of `minimize` in the last round, and of the constraints, which are met on
            their safe side: within ``[-2 tol, 0]`` where they are active. Default: 1e-6 in float64,
            1e-3 in float32.
        args, scale, progress: as for `minimize`.

    Returns:
        `ConstrainedDesign`; computed on the host, not to be traced. If the constraints cannot be
        met the status is CONSTRAINTS_VIOLATED and `constraints` shows by how much.

    Raises:
        ValueError: as `minimize`.

    Example:
        The least area, mm2, that carries 50 kN with at most 200 N/mm2:

        >>> problem = lambda area: (area, jnp.array([50e3 / (area * 200.0) - 1.0]))
        >>> found = jc.design.minimize_subject_to(problem, jnp.array(400.0), bounds=(10.0, 1000.0))
        >>> print(f"{jc.describe(found.status)}: {found.params:.2f} mm2")
        converged: 250.00 mm2
    """
    args = checked_call(problem, args, rounds, "problem", "rounds")
    checks.whole(steps, "steps")
    params = numbers(params)
    tol = tolerance(tol, default_tol(params))
    loss, evaluate = _programs(problem)
    with compiling(listener(progress)):
        (value, (constraints, code)), slope = evaluate(params, *args)
    multipliers = np.zeros(constraints.shape[0])
    # the loss may be zero at the start: its change with the parameters gives it a size, too
    sizes = jax.tree.map(lambda x, g: jnp.max(jnp.abs(x), initial=0.0) * jnp.abs(g), params, slope)
    change = max(float(jnp.max(leaf, initial=0.0)) for leaf in jax.tree.leaves(sizes))
    penalty = _PENALTY * (max(abs(float(value)), change) or 1.0)
    worst, count, evaluations, failures = np.inf, 0, 0, 0
    accuracy = max(tol, 1e-3)
    for _ in range(rounds):
        inner = minimize(
            loss,
            params,
            bounds,
            steps=steps,
            tol=accuracy,
            args=(multipliers, penalty, tol, args),
            scale=scale,
            progress=progress,
        )
        count += 1
        evaluations += int(inner.evaluations)
        failures += int(inner.failures)
        code = int(inner.status)
        if code in (status.BAD_START, status.OUTSIDE):
            break
        params = inner.params
        (value, (constraints, _)), _ = evaluate(params, *args)
        tightened = np.asarray(constraints) + tol
        # zero where a constraint is met and either active or without multiplier
        gap = np.abs(np.maximum(tightened, -multipliers / penalty)).max(initial=0.0)
        multipliers = np.maximum(0.0, multipliers + penalty * tightened)
        if gap <= tol and accuracy <= tol and code == status.OK:
            break
        if gap > _ENOUGH * worst:
            penalty *= _HARDER * (_HARDER if gap > _USELESS * worst else 1.0)
        worst, accuracy = gap, max(tol, 0.1 * accuracy)
    else:
        if code == status.OK:
            violated = not np.all(np.asarray(constraints) <= 0)
            code = status.CONSTRAINTS_VIOLATED if violated else status.OUT_OF_STEPS
    return ConstrainedDesign(
        params=params,
        loss=value,
        constraints=constraints,
        multipliers=multipliers,
        status=jnp.int32(code),
        rounds=count,
        evaluations=evaluations,
        failures=failures,
    )


def _make(reference):
    """The augmented loss of the problem that `reference()` returns, and the compiled problem."""

    def parts(params, *args):
        returned = reference()(params, *args)
        if not isinstance(returned, tuple) or len(returned) not in (2, 3):
            raise ValueError(
                "problem: expected (loss, constraints) or (loss, constraints, solution)"
            )
        value, code = split_loss((returned[0], returned[2:]))
        constraints = jnp.asarray(returned[1])
        if constraints.ndim != 1 or not jnp.issubdtype(constraints.dtype, jnp.floating):
            raise ValueError(
                f"constraints: expected floats [n], got {constraints.dtype}"
                f"{list(constraints.shape)}"
            )
        return value, (constraints, code)

    def loss(params, multipliers, penalty, margin, args):
        value, (constraints, code) = parts(params, *args)
        pushed = jnp.maximum(0.0, multipliers + penalty * (constraints + margin))
        return value + jnp.sum(pushed**2 - multipliers**2) / (2 * penalty), code

    return loss, jax.jit(jax.value_and_grad(parts, has_aux=True))


_programs = Programs(_make)
