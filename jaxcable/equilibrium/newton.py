"""Newton's method for one state of loading, globalised so that cable nets converge from anywhere.

Each iteration factorises once, at most (see 5):

1. Step ``p`` from ``(K + mu I) p = -R`` with the Levenberg shift ``mu = kappa |R| / l``. The shift
   dies with the residual, so that convergence stays quadratic even where loose nodes leave ``K``
   singular (regularised Newton; Li, Fukushima, Qi, Yamashita 2004). If the matrix is not positive
   definite, only ``kappa`` grows.
2. Line search on the directional derivative (`search`), which needs no energy. Along any line the
   energy of a cable-only structure is convex.
3. Sprint: a full Newton step first stretches what only wants to bend or to swing, or slackens
   what the next one tightens. The energy rises, and the search would creep along; the next full
   step puts it right. Nets of cables and structures with rotations therefore start with up to 20
   plain Newton steps, and begin again, searched, if these lead nowhere (in frames also through an
   indefinite tangent, which is allowed under nodal moments: they have no potential). A slack
   saddle of 30 000 unknowns takes 18 steps instead of 142.
4. Stiff cables that swing: a step sideways lengthens a cable in second order, and at EA/N = 1e5
   the search then allows only tiny ones. After 15 short steps a tension-only structure is softened
   by a spring in series with every element (strain 1 under the largest load), which keeps the
   energy convex, and stiffened by tens as it settles. It costs an ordinary net nothing.
5. Sparse matrices: the factor of an earlier step, increment or phase serves as preconditioner of
   conjugate gradients, which stop at the residual that Newton's method will leave anyway; a new
   factor is made where they do not get there in a few steps (`linear.solve_next`).
6. Is it stable? Where the energy need not be convex, one more iteration at the equilibrium
   factorises the tangent, and moves nothing.

The energy of a tension-only structure under dead load is convex (a non-decreasing convex function
of lengths), hence the iteration converges from any start, until the rounding of the displacements
themselves (EA eps) shows in the residual.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import jax.numpy as jnp
from jax import lax
from jax.typing import DTypeLike

from .. import linear
from ..common import checks, status
from ..common.rules import Rule, refuse
from ..common.tree import copy, pytree, where
from ..common.types import Array, ArrayLike, Bool, Float, Int, PyTree
from ..linear.sparse import Factored
from ..mechanics.assembly import System
from ..mechanics.ramp import Ramp
from ..mechanics.reading import Reading, read
from .iteration import Method, Task, limit, no_stiffness
from .newton_step import WORTH, largest


@pytree(static=("linear_solver", "watch"))
class Newton:
    """Iterate every increment to equilibrium.

    Args:
        tol: largest residual at a free freedom, relative to the largest over nodes of (sum of
            absolute end forces + load); not below 64 eps, nor, in cable nets under dead load, below
            2 eps of that force where the increment begins. Default 1e-10, in float32 1e-5. At bars
            and beams a residual is also allowed that the rounding of their displacements leaves,
            ``8 eps u/L (EA along, 12 EI/L^2 across)``: they may move far without force.
        max_steps: steps allowed per increment; beyond it the status is NOT_CONVERGED.
        linear_solver: "dense", "superlu" (SciPy) or "pardiso" (MKL, if `pypardiso` is installed);
            None chooses by size: dense up to 150 unknowns, LAPACK's banded solver for nets of
            some hundred, else PARDISO where installed, else SuperLU.
        watch: whether to judge the stability of every increment (`path.stable`), and not only of
            the last one of a phase: a factorisation more for each.

    Raises:
        ValueError: a number that is not positive, `max_steps` not whole, an unknown solver.

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
            if value is not None and jnp.ndim(checks.floats(value, name)) != 0:
                shape = jnp.shape(value)
                raise ValueError(f"{name}: expected one number, got an array of shape {shape}")
        refuse(self.rules())
        linear.check(self.linear_solver)
        if not isinstance(self.watch, bool):
            raise ValueError(f"watch = {self.watch!r}: expected True or False")

    def rules(self) -> list[Rule]:
        """What its numbers keep, see `rules`; a NaN keeps none: no residual would exceed it."""
        large = "relative to the forces: from 1 on any state would pass"
        return [
            Rule("tol", self.tol, lambda v: ~(v > 0), "must be positive"),
            Rule("tol", self.tol, lambda v: v >= 1, large),
            Rule("max_steps", self.max_steps, lambda v: ~(v > 0), "must be positive"),
            Rule("max_steps", self.max_steps, lambda v: v % 1 != 0, "expected a whole number"),
        ]


@pytree
class Outcome:
    """What an increment ended with.

    Attributes:
        x: the point reached; the one it began with if it failed.
        code: status.
        steps: Newton steps.
        factorizations: of the tangent; with sparse matrices fewer than steps.
        residual: largest unbalanced force at a free freedom, N.
        scale: the force that it is judged by, N.
        equilibrated: whether it was iterated to equilibrium.
        stable: whether the tangent there is known to have no negative eigenvalue.
    """

    x: Float[Array, "n_row n_motion"]
    code: Int[Array, ""]
    steps: Int[Array, ""]
    factorizations: Int[Array, ""]
    residual: Float[Array, ""]
    scale: Float[Array, ""]
    equilibrated: Bool[Array, ""]
    stable: Bool[Array, ""]

    @property
    def log(self) -> Float[Array, " n_log"]:
        """All but the point as numbers side by side, in the order of `solution.LOG`."""
        noted = (self.code, self.steps, self.factorizations, self.residual, self.scale)
        whether = (self.equilibrated, self.stable)
        return jnp.stack([jnp.asarray(x, self.x.dtype) for x in (*noted, *whether)])


def adjoint_effort(
    method: Method, system: System, dtype: DTypeLike
) -> tuple[Float[Array, ""], Int[Array, ""]]:
    """Tolerance and number of conjugate gradient steps for derivatives, see `implicit.attach`.

    As exact as the state whose derivative it is: its residual is below `tol` times the forces.
    """
    return 0.1 * limit(method, dtype), jnp.where(system.convex, WORTH, 0)


def equilibrate(
    system: System,
    x: Float[Array, "n_row n_motion"],
    method: Newton,
    active: Bool[ArrayLike, ""],
    factored: Factored | None = None,
    judge: Bool[ArrayLike, ""] = False,
) -> tuple[Outcome, Factored | None]:
    """Bring `system` to equilibrium from `x`.

    Args:
        system: `System` of one load factor.
        x: start, a motion.
        method: `Newton`.
        active: False to return at once (an earlier increment has failed).
        factored: what sparse solves factorised in earlier increments, if on the same pattern.
        judge: whether to ask if the equilibrium is stable.

    Returns:
        `Outcome`, and what was factored after it. Not differentiable: `implicit.attach` gives the
        derivative.
    """
    if factored is None:
        factored = linear.nothing_factored(system.freedoms.pattern, x.dtype)
    end = _iterated(system, x, method, active, factored, judge)
    # the iteration follows curves beyond their ends, an answer does not
    broken = system.breaks and system.beyond(end.x)
    return _outcome(end, x, active, broken, factored), end.factored


def _iterated(system, x, method, active, factored, judge):
    """The `iteration.Iterate` in which Newton's method ends."""
    task = Task(system, x, method, judge)
    return lax.while_loop(lambda it: active & ~it.done, task.iterate, task.start(factored))


def _outcome(end, x, active, broken, factored):
    """`Outcome` of an iteration from `x`; `broken`: whether it ended beyond a curve."""
    code = jnp.maximum(end.code, status.OK)
    broken = active & (code != status.NONFINITE) & broken
    code = jnp.where(broken, status.MATERIAL_FAILURE, code)
    good = active & (code == status.OK)
    x = jnp.where(good, end.x, x)
    count = end.steps if factored is None else end.factored.count - factored.count
    # nothing is evaluated after a failure
    residual = jnp.where(active, largest(end.residual), jnp.nan)
    return Outcome(x, code, end.steps, count, residual, end.scale, good, good & end.stable)


def is_stable(system: System, x: Float[Array, "n_row n_motion"]) -> Bool[Array, ""]:
    """Whether the tangent at a point has no negative eigenvalue."""
    if system.always_convex:
        return jnp.ones((), bool)
    matrix = system.tangent(x)
    return system.convex | linear.is_definite(linear.plus_diagonal(matrix, no_stiffness(matrix)))


def march(
    ramp: Ramp,
    x: Float[Array, "n_row n_motion"],
    increments: tuple[Float[Array, " n"], Bool[Array, " n"]],
    method: Newton,
    code: Int[Array, ""],
    factored: Factored | None,
    seen: Reading,
    fresh: Bool[Array, ""],
    tell: Callable[[Float[Array, ""], Outcome], None] | None = None,
) -> tuple[
    Float[Array, "n n_row n_motion"],
    Float[Array, "n n_log"],
    Reading,
    Reading,
    PyTree[Any],
    Factored | None,
]:
    """Bring a phase to equilibrium at each load factor in turn, each from the one before.

    Args:
        ramp: the phase, `ramp.at(factor)` a `System`; not differentiated.
        x: start, a point of the system.
        increments: load factors, and which of them there are, both [1 + n_inc]; others pass by. The
            first is 0: there is nothing to solve, but to read.
        method: `Newton`.
        code: status so far; if it is a failure, or from the first failure on, nothing moves.
        factored: as for `equilibrate`.
        seen: `Reading` of the last good increment.
        fresh: whether there is none, so that the start is read.
        tell: function of a load factor and its `Outcome` that is called after each, or None.

    Returns:
        Points, [1 + n_inc, ...]; the log of each (`Outcome.log`), codes latched; `Reading`s, each
        that of the last good increment; the last of these; memory of laws at the end; and what was
        factored.
    """
    begun = ramp.begun()

    def step(carry, increment):
        x, code, memory, factored, seen = carry
        factor, live = increment
        system, judge = ramp.at(factor, memory), method.watch | (factor == 1)
        active = live & (code == status.OK)
        end = _iterated(system, x, method, active, factored, judge)
        begins, ended = fresh & (factor == 0), active & (end.code <= status.OK)
        motion, broken = jnp.where(begins, ramp.begin.motion, end.x), False
        new = lax.cond(
            begins | ended,
            lambda: read(_as_begun(system, begun, factor), motion),
            lambda: seen,
        )
        if system.breaks:
            broken = jnp.any(system.broken(new.strains))
        outcome = _outcome(end, x, active, broken, factored)
        if system.breaks:
            new = where(begins | outcome.equilibrated, new, seen)
        code = status.first_failure(code, outcome.code)
        if memory is not None:
            memory = ramp.settle(system, new.strains, outcome.equilibrated, memory)
        outcome = copy(outcome, code=code)
        if tell is not None:
            lax.cond(live, lambda: tell(factor, outcome), lambda: None)
        carry = outcome.x, code, memory, end.factored, new
        return carry, (outcome.x, outcome.log, new.of_path)

    start = x, code, ramp.memory, factored, seen
    (_, _, memory, factored, seen), (xs, log, rows) = lax.scan(step, start, increments)
    return xs, log, rows, seen, memory, factored


def _as_begun(system, begun, factor):
    """The system, but at the load factor 0 that in which the phase begins, if its end is NaN."""
    states = []
    for now, then in zip(system.states, begun.states, strict=True):
        if now.jack_force is not None:
            jacked = jnp.ones(now.jack_force.shape, bool) if now.jacked is None else now.jacked
            now = copy(now, jacked=jacked)
            then = copy(
                then, jack_force=jnp.zeros_like(now.jack_force), jacked=jnp.zeros_like(jacked)
            )
        states.append(where(factor > 0, now, then))
    return copy(system, states=states)
