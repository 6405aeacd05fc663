"""Minimise a loss subject to inequalities and bounds, by a library whose end is verified."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, ClassVar

import jax
import jax.numpy as jnp
import numpy as np
from jax.flatten_util import ravel_pytree

from ..analysis.solution import Solution
from ..common import checks, status
from ..common.progress import Step, compiling, listener
from ..common.tree import pytree
from ..common.types import Array, ArrayLike, Float, Int, PyTree
from .arguments import tolerance
from .box import checked_call, default_tol, make_box, numbers, sizes_of, spread
from .optimality import Optimality, optimality
from .outcome import split_loss
from .programs import Programs
from .solvers import solver_named
from .trials import Elastic, Point, Scaled, Trials, evaluated, trial_code

_PART = 0.3  # typical change of a parameter over its size
_FIRST = 0.1  # part of the loss at the start that changes are compared with
_WORTH = 0.5  # KKT residual, or violation, after a run that is of use, over that before it
_USELESS = 2  # runs in a row without gain after which the search ends
_SHORTER = 0.1  # factor on the first step of a run after one without gain


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
    kkt_residual: float
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
    solver: str = "slsqp",
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
    box, tol = make_box(bounds, params), float(tolerance(tol, default_tol(params)))
    solve, listen, program = solver_named(solver), listener(progress), _programs(problem)
    start, back = ravel_pytree(params)
    least = jax.tree.map(sizes_of, params, box.lower, box.upper)
    if scale is None:
        step = jax.tree.map(lambda size: _PART * size, least)
    else:
        step = spread(scale, params, "scale", absent=1.0, positive=True)

    def sizes(x):
        entries = jax.tree.map(lambda v, s: jnp.maximum(s, jnp.max(jnp.abs(v))), back(x), least)
        return _flat(entries)

    trials = Trials(
        lambda x: program(jnp.asarray(x, start.dtype), params, args),
        _flat(box.lower),
        _flat(box.upper),
    )
    with compiling(listen):  # most of the time before the first report
        first = trials.at(_flat(params))
    search = _Search(trials, first, solve, sizes, _flat(step), tol, int(steps), listen)
    end, code, count = search.run(rounds)
    found = search.judged(end)
    return ConstrainedDesign(
        params=back(jnp.asarray(end.x, start.dtype)),
        loss=jnp.asarray(end.loss, start.dtype),
        constraints=jnp.asarray(end.constraints, start.dtype),
        multipliers=found.multipliers,
        kkt_residual=found.missing,
        status=jnp.int32(code),
        rounds=count,
        evaluations=trials.evaluations,
        failures=trials.failures,
    )


class _Search:
    """Runs of a library, each from where the one before has ended, until the end is a minimum.

    Args:
        trials: the trial points.
        first: the start.
        solve: a function of `solvers`.
        sizes: function of the parameters to the largest entries of their arrays, [n].
        step: typical changes of the parameters, [n].
        tol, steps, listen: as for `minimize_subject_to`.
    """

    def __init__(self, trials, first, solve, sizes, step, tol, steps, listen):
        self.trials, self.first, self.solve, self.sizes = trials, first, solve, sizes
        self.step, self.tol, self.steps, self.listen = step, tol, steps, listen
        self.number = self.known = 0

    def run(self, rounds: int) -> tuple[Point, int, int]:
        """Return the end, the status, and the number of runs."""
        if self.first.failed:
            return self.first, status.BAD_START, 0
        self.tell(self.first)
        point, missing, useless, best = self.first, np.inf, 0, self.first
        for number in range(1, rounds + 1):
            point = self.minimized(point)
            if point.excess > 0:  # what has met the constraints before, or comes nearest to that
                point = self.trials.best
            if point.excess > 0:
                point = self.least_violation(point)
            if point.excess > _WORTH * best.excess > 0:
                return point, status.CONSTRAINTS_VIOLATED, number
            left = self.judged(point).missing
            if point.excess <= 0 and left <= self.tol:
                return point, status.OK, number
            fallen = best.loss - self.trials.best.loss > self.tol * self.against(point)
            gained = fallen or left <= _WORTH * missing or best.excess > 0
            useless = 0 if gained else useless + 1
            if useless >= _USELESS:
                return self.trials.best, status.STALLED, number
            if not gained:
                self.step = _SHORTER * self.step
            best, missing = self.trials.best, min(left, missing)
        code = status.CONSTRAINTS_VIOLATED if best.excess > 0 else status.OUT_OF_STEPS
        return best, code, rounds

    def minimized(self, point: Point) -> Point:
        """Run the library once: where it ends, or the last sound point if the analysis fails there.

        Its parameters and its loss are scaled so that the first step is one of typical size.
        """
        steep = np.linalg.norm(point.gradient * self.step)
        unit = 1 / (steep if steep > 0 else self.against(point))
        problem = Scaled(self.trials, self.step, unit, self.tol)
        # a gradient of tol leaves its square of the loss to gain
        least = self.tol**2 * unit * self.against(point)
        start = point.x / self.step
        end = problem.point(self.solve(problem, start, self.steps, least, self.after(problem)))
        return self.trials.sound if end.failed else end

    def least_violation(self, point: Point) -> Point:
        """Run the library for the smallest violation: the best point that is known then."""
        problem = Elastic(Scaled(self.trials, self.step, 1.0, self.tol))
        start = np.append(point.x / self.step, point.excess + self.tol)
        self.solve(problem, start, self.steps, self.tol**2, self.after(problem))
        return self.trials.best

    def judged(self, point: Point) -> Optimality:
        """The multipliers at a point, and its KKT residual over the size of the loss."""
        if point.failed:
            return Optimality(np.zeros(len(point.constraints)), np.nan)
        found = optimality(
            point, self.trials.lower, self.trials.upper, self.sizes(point.x), self.tol
        )
        return found._replace(missing=found.missing / self.against(point))

    def against(self, point: Point) -> float:
        """The size of the loss: the present one, or a part of the first one; else its change."""
        size = max(abs(point.loss), _FIRST * abs(self.first.loss))
        return size or float(np.abs(point.gradient * self.step).max()) or 1.0

    def after(self, problem):
        """The function to be called after every step of the library: whether its end is reached."""

        def note(y):
            point = problem.point(y)
            self.number += 1
            self.tell(point)
            if point.failed or point.excess > 0:
                return False
            return isinstance(problem, Elastic) or self.judged(point).missing <= self.tol

        return note

    def tell(self, point: Point) -> None:
        """Report a step, if somebody listens."""
        if self.listen is None:
            return
        missing = self.judged(point).missing
        failures = self.trials.failures - self.known
        self.known = self.trials.failures
        self.listen(Step(self.number, self.steps, point.loss, missing, failures))


def _flat(tree):
    """All entries of a pytree in one vector of NumPy."""
    return np.asarray(ravel_pytree(tree)[0], float)


def _make(reference):
    """The compiled loss and constraints, with their Jacobian, of what `reference()` returns."""

    def parts(params, args):
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
        return value, constraints, code

    @jax.jit
    def evaluate(x, params, args):
        _, back = ravel_pytree(params)

        def flattened(x):
            value, constraints, code = parts(back(x), args)
            values = jnp.concatenate([value[None], constraints]).astype(x.dtype)
            return values, code

        count = jax.eval_shape(flattened, x)[0].size
        found = evaluated(flattened, x, count)
        return found._replace(code=trial_code(found.code, found.values, found.jacobian))

    return evaluate


_programs = Programs(_make)
