"""The incremental scheme of the paper: a fixed number of linear solves per increment.

Tangent form: the unbalanced load is carried into the next increment,
``K_t du = dF + (F - f_int)``, followed by a fixed number of equilibrium iterations. With 0, 1, 2
corrections the error in an increment is of order 2, 4, 8.

Secant form: ``u = K_s(u)^-1 (F - f_int(0))`` with the secant stiffness of the increment before. For
a start in equilibrium this is the paper's eqs. 2-8 with the two inverses of eq. 5 in the order in
which the scheme converges: ``du_i = (K_i^-1 - K_{i-1}^-1) F_{i-1} + K_i^-1 dF_i`` telescopes to
``u_i = K_i^-1 F_i``, one Picard step per increment, of first order. Where stiffness grows fast, an
eigenvalue of this step passes -1, and rounding grows from increment to increment: with increments
below some size this form diverges (`experiments/accession_curves.py`), the tangent form does not.

Source: Mihanovic, Trogrlic, Zivaljic (2011), section 3.
"""

from __future__ import annotations

from collections.abc import Callable

import jax
import jax.numpy as jnp
import numpy as np
from jax import lax

from .. import linear
from ..common import checks, status
from ..common.rules import Rule, refuse_if_broken
from ..common.tree import pytree
from ..common.types import Array, ArrayLike, Bool, Float, Int
from ..mechanics.load_ramp import LoadRamp
from ..numerics import implicit
from .increment_outcome import IncrementOutcome
from .newton import Newton, equilibrate


@pytree(static=("corrections", "stiffness", "linear_solver"))
class Incremental:
    """A fixed number of linear solves per increment, as in the paper.

    Where the stiffness at the start of a phase is singular (a slack cable, a mechanism before its
    prestress) the first increment is solved to equilibrium instead; `path.equilibrated` shows it.
    Derivatives are those of the algorithm itself, also along the path.

    Args:
        corrections: equilibrium iterations after each increment's first solve.
        stiffness: "tangent" or "secant".
        tol: largest unbalanced force at the end of an increment over the load (Euclidean norms over
            the free degrees of freedom; without load, over the largest sum of absolute end forces
            at a node); above it the status is DRIFTED. The paper uses 0.05; `numpy.inf` allows
            everything.
        linear_solver: as for `Newton`.

    Raises:
        ValueError: `corrections` below 0, an unknown `stiffness` or solver, a `tol` that is not
            positive; in an analysis, "secant" for elements or loads that have no secant stiffness.

    Source: Mihanovic, Trogrlic, Zivaljic (2011), section 3.

    Example:
        The load ``P = 2 EA (l - L0)/L0 (3 + w)/l`` moves the node of two cables down by w = 0.3 m:

        >>> nodes = [[-4.0, 0.0, 3.0], [0.0, 0.0, 0.0], [4.0, 0.0, 3.0]]
        >>> cables = jc.Cables([[0, 1], [1, 2]], axial_stiffness=1e5)
        >>> structure = jc.Structure(nodes, cables, supports=jc.pinned([0, 2]))
        >>> length = np.hypot(4.0, 3.3)
        >>> load = 2 * 1e5 * (length - 5.0) / 5.0 * 3.3 / length  # N
        >>> phase = jc.Phase(loads=jc.NodalLoads([1], (0.0, 0.0, -load)), increments=10)
        >>> solution = jc.solve(structure, phase, jc.Incremental(corrections=1))
        >>> print(f"{jc.describe(solution.status)}: {solution.displacement[1, 2]:.6f} m")
        converged: -0.300000 m
    """

    corrections: int = 0
    stiffness: str = "tangent"
    tol: Float[ArrayLike, ""] = 0.05
    linear_solver: str | None = None

    def __post_init__(self):
        if not isinstance(self.corrections, int | np.integer) or self.corrections < 0:
            raise ValueError(f"corrections = {self.corrections!r}: expected a whole number >= 0")
        if self.stiffness not in ("tangent", "secant"):
            raise ValueError(f'stiffness = {self.stiffness!r}: expected "tangent" or "secant"')
        tol = checks.as_floats(self.tol, "tol")
        if tol.shape != ():
            raise ValueError(f"tol: expected one number, got an array of shape {tol.shape}")
        refuse_if_broken(self.rules())
        linear.check_solver_name(self.linear_solver)

    def rules(self) -> list[Rule]:
        """Return the rule that `tol` is positive and no NaN."""
        return [Rule("tol", self.tol, lambda v: ~(v > 0), "must be positive")]


def solve_increments(
    ramp: LoadRamp,
    x: Float[Array, "n_row n_motion"],
    increments: tuple[Float[Array, " n"], Bool[Array, " n"]],
    method: Incremental,
    code: Int[Array, ""],
    report: Callable[[Float[Array, ""], IncrementOutcome], None] | None = None,
) -> tuple[Float[Array, "n n_row n_motion"], Float[Array, "n n_log"]]:
    """Solve the increments of a phase one after the other by linear solves.

    It is differentiable; increments are checkpointed, so that the backward pass stores one point of
    each and no stiffness matrix.

    Args:
        ramp: the phase, whose ``system_at(factor)`` is the `System` at a load factor.
        x: motion to start from, [n_row, n_motion].
        increments: (load factors, whether the phase has them), both [n]; others are skipped.
        method: `Incremental`.
        code: status so far; after a failure nothing moves.
        report: function called after each increment with its load factor and `IncrementOutcome`.

    Returns:
        Points after each increment, [n, n_row, n_motion]; log, `IncrementOutcome.log_row` of each.
    """

    @jax.checkpoint
    def solve_if_live(carry, increment):
        factor, live, first = increment
        x, code, memory = carry

        def solve(x, code, memory):
            outcome, memory = _solve_increment(ramp, factor, x, method, code, memory, first)
            if report is not None:
                report(factor, outcome)
            return outcome, memory

        def skip(x, code, memory):
            zero, none = jnp.zeros((), x.dtype), jnp.int32(0)
            no = jnp.zeros((), bool)
            return IncrementOutcome(x, code, none, none, zero, zero, zero, no, no), memory

        outcome, memory = lax.cond(live, solve, skip, x, code, memory)
        return (outcome.x, outcome.code, memory), (outcome.x, outcome.log_row)

    first = jnp.arange(len(increments[0])) == 0
    return lax.scan(solve_if_live, (x, code, ramp.memory), (*increments, first))[1]


def _solve_increment(ramp, factor, x, method, code, memory, first):
    """Solve one increment; return its `IncrementOutcome`, and the history variables after it.

    The `first` increment of a phase is solved to equilibrium if its stiffness is singular.
    """
    active, system, begin = code == status.OK, ramp.system_at(factor, memory), x
    frozen = lax.stop_gradient(system)
    x, regular = _solve_linear_step(system, x, ramp, method)

    def iterate_to_equilibrium(x):
        point, newton = lax.stop_gradient(begin), Newton(linear_solver=method.linear_solver)
        found, _ = equilibrate(frozen, point, newton, active & ~regular)
        iterated = found.equilibrated
        x = jnp.where(iterated, implicit.attach_derivative(system, found.x, iterated), x)
        return x, iterated, jnp.where(iterated, found.steps, 1)

    def keep(x):
        return x, jnp.zeros((), bool), jnp.int32(1)

    x, iterated, steps = lax.cond(first, iterate_to_equilibrium, keep, x)
    regular = regular | iterated
    for _ in range(method.corrections):
        corrected, ok = _solve_linear_step(system, x, ramp, method)
        x = jnp.where(iterated, x, corrected)
        steps = steps + jnp.where(iterated, 0, 1)
        regular = regular & (ok | iterated)
    reached = lax.stop_gradient(x)
    residual, scale = frozen.residual_and_scale(reached)
    load, unbalanced = frozen.load_norm(reached), jnp.linalg.norm(residual)
    largest = jnp.max(jnp.abs(residual), initial=0.0)
    outcomes = [
        (~(jnp.isfinite(scale) & jnp.isfinite(largest)), status.NONFINITE),
        (~regular, status.SINGULAR),
        (unbalanced > method.tol * jnp.where(load > 0, load, scale), status.DRIFTED),
    ]
    if system.has_rupture:
        outcomes.insert(1, (frozen.is_ruptured(reached), status.MATERIAL_FAILURE))
    new = jnp.select([hit for hit, _ in outcomes], [code for _, code in outcomes], status.OK)
    code = status.first_failure(code, jnp.asarray(new, jnp.int32))
    good = code == status.OK
    x = jnp.where(good, x, begin)
    steps = jnp.where(active, steps, 0)
    # nothing is judged by it; it tells which part of the residual no correction can remove
    rounding = jnp.max(frozen.rounding_error(reached), initial=0.0)
    # where the energy is not convex, `one_phase` judges stability at the end of the phase
    stable = good & system.convex
    outcome = IncrementOutcome(x, code, steps, steps, largest, scale, rounding, iterated, stable)
    if memory is not None:
        memory = ramp.commit_memory(system, x, None, good, memory)
    return outcome, memory


def _solve_linear_step(system, x, ramp, method):
    """Return the next motion by one linear solve, and whether the stiffness was regular."""
    if method.stiffness == "tangent":
        function, numbers, back = system.local_residual(x)
        residual, linearized = jax.linearize(function, numbers)
        # supports are where this increment has them, as in the residual
        tangent = lax.stop_gradient(system).tangent(lax.stop_gradient(system.impose_supports(x)))
        factor = linear.factorize(tangent)
        rhs = implicit.stop_gradient_unless(factor.regular, residual)
        return back(numbers - factor.identity_if_singular().solve(rhs, linearized)), factor.regular
    # the secant form begins at the geometry at the start of the phase
    origin = system.impose_supports(ramp.start.motion)
    matrix = system.secant(origin, system.impose_supports(x))
    factor = linear.factorize(matrix)
    rhs = implicit.stop_gradient_unless(factor.regular, system.residual(origin))
    matrix = implicit.stop_gradient_unless(factor.regular, matrix)
    step = factor.identity_if_singular().solve(-rhs, lambda v: matrix @ v)
    return system.move(origin, step), factor.regular
