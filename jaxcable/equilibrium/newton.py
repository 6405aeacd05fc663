"""Newton's method for one state of loading, globalised so that cable nets converge from anywhere.

Each iteration factorises at most once (see 4). Nets of cables under dead loads (straight, hanging,
sliding, with jacks; `System.is_net`) carry their tensions as unknowns beside the displacements,
because stiff cables that swing let plain Newton steps creep: see `tension_unknowns`. Where Newton's
method fails for them, an interior-point method follows, with a second-order cone for every straight
piece (`conic_interior_point`): its steps hardly grow with the size of a net, nor with what is slack
in it. Nets with hanging cables or other laws, and those in float32, have a bound on every length
instead (`interior_point`). So have cables beside other elements, where Newton's method no longer
makes progress: see `partial_net`. For all others:

1. Step ``p`` from ``(K + mu I) p = -R`` with the Levenberg shift ``mu = kappa |R| / l``. Bars, and
   cables beside them, have the axial force that the last step predicts, in ``K`` and in the line
   search, because stiff bars that turn let plain steps creep, too: see `predicted_forces`. The
   shift vanishes with the residual, so that convergence stays quadratic even where nodes without
   stiffness leave ``K`` singular (regularised Newton; Li, Fukushima, Qi, Yamashita 2004). If the
   matrix is not positive definite, the iteration only enlarges ``kappa``.
2. Line search on the directional derivative (`line_search`), which needs no energy. Along any line
   the energy of a structure of tension-only elements is convex.
3. Full steps first (`globalization.FullStepPhase`): a full Newton step often stretches elements
   that should only bend or swing, or slackens cables that the next step tightens. The energy rises,
   although the next full step corrects this; a line search would allow tiny steps only. Structures
   with rotations, those under following loads, and those with unsymmetric elements therefore start
   with up to 20 full Newton steps. If these fail, the iteration starts again with line search, or
   where there are cables beside other elements, with interior-point steps.
   (Where nodal moments, following loads or elements without a potential make the tangent
   unsymmetric, all steps are by the whole of it. A full step may pass an indefinite tangent, but
   not a symmetric one: there full steps have failed. After this phase, a step by an unsymmetric one
   whose symmetric part is indefinite is taken whole if it decreases the residual, or else the shift
   grows.)
4. Sparse matrices: the factor of an earlier step, increment or phase serves as preconditioner of
   conjugate gradients, which stop at the residual that Newton's method leaves anyway. A new factor
   is made where they do not reach it in a few steps (`linear.solve_reusing_factor`).
5. Stability: where the energy need not be convex, one more iteration at the equilibrium factorises
   the tangent without a step.

The energy of a tension-only structure under dead load is convex (a non-decreasing convex function
of lengths), so that its equilibria are its minima.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import jax.numpy as jnp
from jax import lax
from jax.typing import DTypeLike

from .. import linear
from ..common import checks, status
from ..common.rules import Rule, refuse_if_broken, whole_number
from ..common.tree import copy_with, pytree, select_tree
from ..common.types import Array, ArrayLike, Bool, Float, Int, PyTree
from ..linear.sparse import FactorRecord
from ..mechanics.assembly import System
from ..mechanics.chords import without_friction
from ..mechanics.element_output import ElementOutput, evaluate_output
from ..mechanics.load_ramp import LoadRamp
from ..spaces.translations import drop_low_part
from .convergence import AddedLoadCriterion, IterationSettings, residual_tolerance
from .increment_outcome import IncrementOutcome, is_residual_at_rounding, make_outcome
from .iteration import NewtonIteration
from .newton_step import (
    CG_LIMIT,
    max_abs,
    stability_shift,
    with_loose_nodes_held,
    zero_eigenvalue_bound,
)


@pytree(static=("linear_solver", "watch"))
class Newton:
    """Iterate every increment to equilibrium.

    Args:
        tol: largest residual (unbalanced force) at a free degree of freedom, relative to the
            largest, over nodes, of the sum of absolute end forces plus the load. Default 1e-10, in
            float32 1e-5; at least 64 eps.

            - Small loads: where a phase adds dead loads below 1 % of this force, the residual is
              at most 50 tol of the largest of them, too (see `convergence`; not in float32). If
              rounding leaves less than half of the digits of the load, the status is AT_ROUNDING.
            - Rounding: displacements u have a relative error eps, which makes a residual of
              ``8 eps u/L EA`` along an element and ``8 eps u/L 12 EI/L^2`` across. This much is
              allowed, too (`path.rounding`). Nets of cables have twice the digits:
              ``8 eps^2 u/L EA``. Where it is more than 1 % of the forces of a net under load, the
              status is AT_ROUNDING.
        max_steps: steps allowed per increment; after them the status is NOT_CONVERGED, or says
            more exactly why: AT_ROUNDING (which can end an increment before, see `convergence`),
            COLLAPSED.
        linear_solver: "dense", "superlu" (SciPy), "cholmod" (if `cvxopt` is installed) or "pardiso"
            (MKL, if `pypardiso` is installed); None chooses by size: dense up to 150 unknowns,
            LAPACK's banded solver for nets of some hundred, else what is installed of PARDISO,
            CHOLMOD and SuperLU, in this order.
        watch: whether to judge the stability of every increment (`path.stable`), and not only of
            the last one of a phase; costs one factorisation per increment.

    Raises:
        ValueError: a number is not positive, `max_steps` is not whole, the solver is unknown.

    Example:
        >>> structure, phases = jc.scenes.flat_net(load=15.0)
        >>> solution = jc.solve(structure, phases, jc.Newton(max_steps=50))
        >>> print(jc.describe(solution.status), bool(solution.phases[1].path.residual[-1] < 1e-6))
        converged True
    """

    tol: Float[ArrayLike, ""] | None = None
    max_steps: Int[ArrayLike, ""] = 200
    linear_solver: str | None = None
    watch: bool = False

    def __post_init__(self):
        for name in ("tol", "max_steps"):
            value = getattr(self, name)
            if value is not None and jnp.ndim(checks.as_floats(value, name)) != 0:
                shape = jnp.shape(value)
                raise ValueError(f"{name}: expected one number, got an array of shape {shape}")
        refuse_if_broken(self.rules())
        linear.check_solver_name(self.linear_solver)
        if not isinstance(self.watch, bool):
            raise ValueError(f"watch = {self.watch!r}: expected True or False")

    def rules(self) -> list[Rule]:
        """Return the rules 0 < `tol` < 1 and `max_steps` whole, positive; a NaN breaks them."""
        large = "must be below 1: it is relative to the forces, and any state would meet 1"
        return [
            Rule("tol", self.tol, lambda v: ~(v > 0), "must be positive"),
            Rule("tol", self.tol, lambda v: v >= 1, large),
            Rule("max_steps", self.max_steps, lambda v: ~(v > 0), "must be positive"),
            whole_number("max_steps", self.max_steps),
        ]


def adjoint_cg_settings(
    method: IterationSettings, system: System, dtype: DTypeLike
) -> tuple[Float[Array, ""], Int[Array, ""]]:
    """Return tolerance and step limit of conjugate gradients for an adjoint (`linear.factorize`).

    The tolerance is a tenth of that of the equilibrium, so that derivatives are as accurate.
    """
    return 0.1 * residual_tolerance(method, dtype), jnp.where(system.convex, CG_LIMIT, 0)


def equilibrate(
    system: System,
    x: Float[Array, "n_row n_motion"],
    method: Newton,
    active: Bool[ArrayLike, ""],
    factored: FactorRecord | None = None,
    judges_stability: Bool[ArrayLike, ""] = False,
) -> tuple[IncrementOutcome, FactorRecord | None]:
    """Iterate a system to equilibrium, starting from motion `x`.

    Args:
        system: `System` of one load factor.
        x: motion to start from.
        method: `Newton`.
        active: False to return at once (an earlier increment has failed).
        factored: matrix that sparse solves have factorised in earlier increments of the same
            pattern; None: nothing.
        judges_stability: whether to find out if the equilibrium is stable.

    Returns:
        `IncrementOutcome`; the last factored matrix. Not differentiable: its derivative is added
        by `implicit.attach_derivative`.
    """
    system, x, factored = lax.stop_gradient((system, x, factored))
    if factored is None:
        factored = linear.no_factored_matrix(system.dof_map.pattern, x.dtype)
    end = _iterate_until_done(system, x, method, active, factored, judges_stability)
    # the iteration may pass beyond the end of a law's curve, the equilibrium must not be there
    ruptured = system.has_rupture and system.is_ruptured(end.point.x)
    end = end.with_point(x=end.point.x[:, : x.shape[1]])  # with a fine part only if x has one
    return make_outcome(system, end, x, active, ruptured, factored), end.factored


def _iterate_until_done(
    system,
    x,
    method,
    active,
    factored,
    judges_stability,
    criterion=None,
    only_evaluates=False,
):
    """Return the `NewtonState` in which Newton's method ends; arguments as of `NewtonIteration`.

    Nets with softening laws begin with laws that do not soften (`Law.without_softening`), which
    make their energy convex. If this equilibrium is below the peaks of all laws, it is the one that
    is wanted. If it is beyond a peak, no equilibrium is below all peaks: then the iteration goes on
    from it with the laws as they are.
    """

    def iterate(system, x, active, factored, steps):
        newton = NewtonIteration(system, x, method, judges_stability, criterion, only_evaluates)
        start = newton.initial_state(factored, steps)
        end = lax.while_loop(lambda it: active & ~it.done, newton.iterate, start)
        carried = newton.convergence.carried_residual(end.point.scale, end.steps)
        return end.with_point(residual=end.point.residual + carried)

    if any(group.is_chain for group in system.groups):
        return _iterate_with_friction(iterate, system, x, active, factored)
    convex, none = system.without_softening(), jnp.int32(0)
    if system.is_net or not convex.is_net:
        return iterate(system, x, active, factored, none)

    def is_below_peaks(x):
        pairs = zip(system.tensions(x), convex.tensions(x), strict=True)
        apart = [(jnp.abs(force - risen), jnp.abs(risen)) for force, risen in pairs]
        apart, size = (jnp.max(jnp.concatenate(forces)) for forces in zip(*apart, strict=True))
        return apart <= residual_tolerance(method, x.dtype) * size

    x = drop_low_part(x)
    # from beyond a peak the branch is followed on which the increment before has ended
    starts_convex = active & is_below_peaks(x) & ~jnp.asarray(only_evaluates)
    first = iterate(convex, x, starts_convex, factored, none)
    found = starts_convex & (first.code == status.OK)
    at = select_tree(found, drop_low_part(first.point.x), x)
    below = found & is_below_peaks(at)
    # an iteration that has found nothing does not count
    steps = jnp.where(found, first.steps, 0)
    end = iterate(system, at, active & ~below, first.factored, steps)
    lost = (end.code == status.NOT_CONVERGED) | (end.code == status.MECHANISM)
    forces = max_abs(first.point.residual), max_abs(first.point.rounding)
    near = starts_convex & is_residual_at_rounding(convex, *forces)
    near = ~found & near & (end.code == status.NOT_CONVERGED)
    code = jnp.where(near, status.AT_ROUNDING, end.code)
    code = jnp.where(found & lost, status.BEYOND_PEAK, code)
    # whether a curve has ended is judged where the load leads, not where the iteration got lost
    x = select_tree(found & lost, at, end.point.x)
    at_point = [(of.point.residual, of.point.scale) for of in (first, end)]
    residual, scale = select_tree(below, *at_point)
    ends = (first.code, first.steps, first.stable), (code, end.steps, end.stable)
    code, steps, stable = select_tree(below, *ends)
    end = copy_with(end, code=code, steps=steps, stable=stable)
    return end.with_point(x=x, residual=residual, scale=scale)


def _iterate_with_friction(iterate, system, x, active, factored):
    """Return the `NewtonState` of a system with friction; where that fails, begin without friction.

    Where cables slip and are stiff, the symmetric part of the tangent is indefinite, so that there
    is no descent direction: from far, steps creep. From the equilibrium without friction they do
    not. `iterate` is that of `_iterate_until_done`.
    """
    none = jnp.int32(0)
    direct = iterate(system, x, active, factored, none)
    failed = active & (direct.code != status.OK)
    plain = iterate(without_friction(system), x, failed, direct.factored, none)
    found = failed & (plain.code == status.OK)
    near = select_tree(found, drop_low_part(plain.point.x), x)
    begun_near = iterate(system, near, found, plain.factored, none)
    steps = direct.steps + plain.steps + begun_near.steps
    return copy_with(select_tree(found, begun_near, direct), steps=steps)


def is_stable(system: System, x: Float[Array, "n_row n_motion"]) -> Bool[Array, ""]:
    """Return whether the tangent at motion `x` is positive definite, scalar bool: `stable`."""
    if system.always_convex:
        return jnp.ones((), bool)
    matrix = system.tangent(x)
    shift = stability_shift(zero_eigenvalue_bound(matrix))
    shifted = linear.add_to_diagonal(matrix, shift)
    return system.convex | linear.is_definite(with_loose_nodes_held(system, shifted, x))


def solve_increments(
    ramp: LoadRamp,
    x: Float[Array, "n_row n_motion"],
    increments: tuple[Float[Array, " n"], Bool[Array, " n"]],
    method: Newton,
    code: Int[Array, ""],
    factored: FactorRecord | None,
    last_output: ElementOutput,
    is_first: Bool[Array, ""],
    report: Callable[[Float[Array, ""], IncrementOutcome], None] | None = None,
) -> tuple[
    Float[Array, "n n_row n_motion"],
    Float[Array, "n n_log"],
    ElementOutput,
    ElementOutput,
    PyTree[Any],
    FactorRecord | None,
]:
    """Bring a phase to equilibrium at every load factor, each time from the point before.

    Args:
        ramp: the phase, `ramp.system_at(factor)` a `System`; not differentiated.
        x: motion to start from.
        increments: (load factors, whether the phase has them), both [1 + n_inc]; nothing is done
            at factors that the phase does not have. The first factor is 0, where nothing is solved.
        method: `Newton`.
        code: status so far; after a failure nothing moves.
        factored: as for `equilibrate`.
        last_output: `ElementOutput` of the last increment that has converged.
        is_first: whether no increment has converged so far: then the start is evaluated.
        report: function that is called after every increment with its load factor and its
            `IncrementOutcome`, or None.

    Returns:
        xs: points, [1 + n_inc, ...]; those of nets with a low-order part (`spaces.translations`).
        log: `IncrementOutcome.log_row` of every increment, with latched status.
        outputs: `ElementOutput.increment_results` of every increment; after a failure, those of the
            last converged one.
        last_output: `ElementOutput` of the last converged increment.
        memory: history variables at the end.
        factored: last factored matrix.
    """
    begun = ramp.initial_system()
    x = first = begun.with_zero_low_order_part(x)
    largest_added = ramp.largest_added_load(begun, increments[0]) if ramp.has_amplitudes else None

    def solve_increment(carry, increment):
        x, code, memory, factored, last_output, earlier_residual = carry
        factor, live = increment
        system, judges = ramp.system_at(factor, memory), method.watch | (factor == 1)
        good, at_start = code == status.OK, factor == 0
        active, only_evaluates = live & good, at_start & good
        criterion = AddedLoadCriterion.for_increment(
            system, earlier_residual, begun.load, factor, largest_added
        )
        given = method, active | only_evaluates, factored, judges, criterion, only_evaluates
        end = _iterate_until_done(system, x, *given)
        begins, ended = is_first & at_start, active & (end.code == status.OK)
        motion, ruptured = select_tree(begins, first, end.point.x), False
        reading = lax.cond(
            begins | ended,
            lambda: evaluate_output(_with_initial_element_states(system, begun, factor), motion),
            lambda: last_output,
        )
        if system.has_rupture:
            ruptured = jnp.any(system.ruptured_elements(reading.strains))
        outcome = make_outcome(system, end, x, active, ruptured, factored)
        if system.has_rupture:
            reading = select_tree(begins | outcome.equilibrated, reading, last_output)
        code = status.first_failure(code, outcome.code)
        if memory is not None:
            good = outcome.equilibrated
            memory = ramp.commit_memory(system, motion, reading.strains, good, memory)
        outcome = copy_with(outcome, code=code)
        if report is not None:
            lax.cond(live, lambda: report(factor, outcome), lambda: None)
        carry = outcome.x, code, memory, end.factored, reading, end.point.residual
        return carry, (outcome.x, outcome.log_row, reading.increment_results)

    none = jnp.zeros(ramp.dof_map.free.shape[0], x.dtype)
    start = x, code, ramp.memory, factored, last_output, none
    carry, (xs, log, outputs) = lax.scan(solve_increment, start, increments)
    _, _, memory, factored, last_output, _ = carry
    return xs, log, outputs, last_output, memory, factored


def _with_initial_element_states(system, begun, factor):
    """Return the system; at load factor 0 with the element states of `begun`, the phase's start.

    They are exact there, even where the states at the end of the phase are NaN.
    """
    states = []
    for now, then in zip(system.states, begun.states, strict=True):
        if now.jack_force is not None:
            jacked = jnp.ones(now.jack_force.shape, bool) if now.jacked is None else now.jacked
            now = copy_with(now, jacked=jacked)
            then = copy_with(
                then, jack_force=jnp.zeros_like(now.jack_force), jacked=jnp.zeros_like(jacked)
            )
        states.append(select_tree(factor > 0, now, then))
    return copy_with(system, states=states)
