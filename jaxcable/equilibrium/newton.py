"""Newton's method for one state of loading, globalised so that cable nets converge from anywhere.

Each iteration factorises at most once (see 4). Nets of cables under dead loads (straight, hanging,
sliding, with jacks; `System.is_net`) carry their tensions as unknowns beside the displacements,
because stiff cables that swing let plain Newton steps creep: see `tensions`. Where Newton's method
fails for them, an interior-point method follows, with a second-order cone for every straight piece
(`cones`): its steps hardly grow with the size of a net, nor with what is slack in it. For all
others:

1. Step ``p`` from ``(K + mu I) p = -R`` with the Levenberg shift ``mu = kappa |R| / l``. Bars, and
   cables beside them, have the axial force that the last step predicts, in ``K`` and in the line
   search, because stiff bars that turn let plain steps creep, too: see `predicted`. The shift
   vanishes with the residual, so that convergence stays quadratic even where loose nodes leave
   ``K`` singular (regularised Newton; Li, Fukushima, Qi, Yamashita 2004). If the matrix is not
   positive definite, the iteration only enlarges ``kappa``.
2. Line search on the directional derivative (`search`), which needs no energy. Along any line the
   energy of a structure of tension-only elements is convex.
3. Sprint: a full Newton step often stretches members that should only bend or swing, or slackens
   cables that the next step tightens. The energy rises, although the next full step corrects this;
   a line search would allow tiny steps only. Structures with rotations, those under following
   loads, and cables along which loads slide therefore start with up to 20 full Newton steps. If
   these fail, the iteration begins again with line search. (Where nodal moments, following loads
   or elements without a potential make the tangent unsymmetric, all steps are by the whole of it.
   A sprint may pass an indefinite tangent; after it, a step by one whose symmetric part is
   indefinite is taken whole if it decreases the residual, or else the shift grows.)
4. Sparse matrices: the factor of an earlier step, increment or phase serves as preconditioner of
   conjugate gradients, which stop at the residual that Newton's method leaves anyway. A new factor
   is made where they do not reach it in a few steps (`linear.solve_next`).
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
from ..common.rules import Rule, refuse, whole
from ..common.tree import copy, pytree, where
from ..common.types import Array, ArrayLike, Bool, Float, Int, PyTree
from ..linear.sparse import Factored
from ..mechanics.assembly import System
from ..mechanics.pieces import along_chain
from ..mechanics.ramp import Ramp
from ..mechanics.reading import Reading, read
from ..spaces.translations import coarse
from .balance import Balance, Method, limit
from .iteration import Task
from .newton_step import WORTH, largest, no_stiffness

_MET = 1e-6  # length over initial length at which two nodes have met
_NEARLY = 8.0  # residual over its rounding up to which it is at rounding


@pytree(static=("linear_solver", "watch"))
class Newton:
    """Iterate every increment to equilibrium.

    Args:
        tol: largest residual at a free freedom, relative to the largest over nodes of (sum of
            absolute end forces + load); at least 64 eps. Default 1e-10, in float32 1e-5. Where a
            phase adds dead loads below 1 % of this force, the residual is at most 50 tol of the
            largest of these, too, and what earlier increments have left is carried along; if
            rounding leaves less than half of the digits of the load, the status is AT_ROUNDING
            (`balance`; not in float32). The residual that the rounding of the displacements leaves,
            ``8 eps u/L (EA along, 12 EI/L^2 across)``, is allowed, too (`path.rounding`). Nets of
            cables are iterated with nearly twice the digits: there it is ``8 eps^2 u/L EA``. Where
            it is more than 1 % of the forces of a net under load, the status is AT_ROUNDING.
        max_steps: steps allowed per increment; after them the status is NOT_CONVERGED, or says
            more exactly why: AT_ROUNDING, COLLAPSED.
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
            if value is not None and jnp.ndim(checks.floats(value, name)) != 0:
                shape = jnp.shape(value)
                raise ValueError(f"{name}: expected one number, got an array of shape {shape}")
        refuse(self.rules())
        linear.check(self.linear_solver)
        if not isinstance(self.watch, bool):
            raise ValueError(f"watch = {self.watch!r}: expected True or False")

    def rules(self) -> list[Rule]:
        """Rules of its numbers, see `common.rules`; a NaN breaks them."""
        large = "relative to the forces: from 1 on any state would pass"
        return [
            Rule("tol", self.tol, lambda v: ~(v > 0), "must be positive"),
            Rule("tol", self.tol, lambda v: v >= 1, large),
            Rule("max_steps", self.max_steps, lambda v: ~(v > 0), "must be positive"),
            whole("max_steps", self.max_steps),
        ]


@pytree
class Outcome:
    """What an increment ended with.

    Attributes:
        x: the point reached; if the increment failed, the point that it began with.
        code: status.
        steps: number of Newton steps.
        factorizations: of the tangent; with sparse matrices there can be fewer than steps.
        residual: largest unbalanced force at a free freedom, N.
        scale: the force that the residual is judged by, N.
        rounding: largest residual that the rounding of displacements leaves at a free freedom, N;
            0 if no element states any (`abilities.Rounding`).
        equilibrated: whether the increment was iterated to equilibrium.
        stable: whether the tangent at x is known to have no negative eigenvalue.
    """

    x: Float[Array, "n_row n_motion"]
    code: Int[Array, ""]
    steps: Int[Array, ""]
    factorizations: Int[Array, ""]
    residual: Float[Array, ""]
    scale: Float[Array, ""]
    rounding: Float[Array, ""]
    equilibrated: Bool[Array, ""]
    stable: Bool[Array, ""]

    @property
    def log(self) -> Float[Array, " n_log"]:
        """The first eight numbers of `solution.LOG`, an array: all fields but the point."""
        noted = (self.code, self.steps, self.factorizations, self.residual, self.scale)
        rest = (self.rounding, self.equilibrated, self.stable)
        return jnp.stack([jnp.asarray(x, self.x.dtype) for x in (*noted, *rest)])


def adjoint_effort(
    method: Method, system: System, dtype: DTypeLike
) -> tuple[Float[Array, ""], Int[Array, ""]]:
    """Tolerance and limit of conjugate gradient steps for derivatives, see `linear.factorize`.

    The tolerance follows that of the state (`Method.tol`), so that derivatives are as exact.
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
        x: motion to start from.
        method: `Newton`.
        active: False to return at once (an earlier increment has failed).
        factored: what sparse solves have factorised in earlier increments of the same pattern;
            None: nothing.
        judge: whether to find out if the equilibrium is stable.

    Returns:
        `Outcome`, and what is factored now. Not differentiable: `implicit.attach` adds the
        derivative.
    """
    if factored is None:
        factored = linear.nothing_factored(system.freedoms.pattern, x.dtype)
    end = _iterated(system, x, method, active, factored, judge)
    # the iteration may pass beyond the end of a law's curve, the equilibrium must not be there
    broken = system.breaks and system.beyond(end.x)
    end = copy(end, x=end.x[:, : x.shape[1]])  # with a fine part only if x has one
    return _outcome(system, end, x, active, broken, factored), end.factored


def _iterated(system, x, method, active, factored, judge, balance=None, only=False):
    """The `iteration.Iterate` in which Newton's method ends; options as of `iteration.Task`.

    Nets whose laws fall begin with laws that do not (`Law.risen`), which make their energy convex.
    Below all peaks their equilibrium is the one that is wanted. If it is beyond one, there is no
    equilibrium below all peaks: then the iteration goes on from it with the laws as they are.
    """

    def ended(system, x, active, factored, steps):
        task = Task(system, x, method, judge, balance, only)
        start = copy(task.start(factored), steps=steps)
        end = lax.while_loop(lambda it: active & ~it.done, task.iterate, start)
        return copy(end, residual=end.residual + task.carried(end.scale, end.steps))

    convex, none = system.risen(), jnp.int32(0)
    if system.is_net or not convex.is_net:
        return ended(system, x, active, factored, none)

    def below_peaks(x):
        pairs = zip(system.tensions(x), convex.tensions(x), strict=True)
        apart = [(jnp.abs(force - risen), jnp.abs(risen)) for force, risen in pairs]
        apart, size = (jnp.max(jnp.concatenate(forces)) for forces in zip(*apart, strict=True))
        return apart <= limit(method, x.dtype) * size

    x = coarse(x)
    # from beyond a peak the branch is followed on which the increment before has ended
    first = ended(convex, x, active & below_peaks(x) & ~jnp.asarray(only), factored, none)
    found = active & (first.code == status.OK)
    at = where(found, coarse(first.x), x)
    below = found & below_peaks(at)
    # an iteration that has found nothing does not count
    steps = jnp.where(found, first.steps, 0)
    end = ended(system, at, active & ~below, first.factored, steps)
    lost = (end.code == status.NOT_CONVERGED) | (end.code == status.MECHANISM)
    near = _is_at_rounding(convex, largest(first.residual), largest(first.rounding))
    near = ~found & near & (end.code == status.NOT_CONVERGED)
    code = jnp.where(near, status.AT_ROUNDING, end.code)
    code = jnp.where(found & lost, status.BEYOND_PEAK, code)
    # whether a curve has ended is judged where the load leads, not where the iteration got lost
    end = copy(end, code=code, x=where(found & lost, at, end.x))
    known = ("residual", "scale", "code", "steps", "stable")
    return copy(end, **{k: where(below, getattr(first, k), getattr(end, k)) for k in known})


def _cause(system, end, residual, rounding):
    """Status of an iteration that has ended: what `NOT_CONVERGED` means is told apart.

    `residual` and `rounding` are the largest, N.
    """
    ends = [(system.nodes[g.links], end.x[g.links][..., :3]) for g in system.groups]
    pieces = [along_chain(at) for at, _ in ends], [along_chain(sum(at)) for at in ends]
    before, after = (
        jnp.concatenate([jnp.sum(piece**2, axis=-1).reshape(-1) for piece in of]) for of in pieces
    )
    met = jnp.any((before > 0) & (after <= _MET**2 * before))
    stuck = end.code == status.NOT_CONVERGED
    code = jnp.where(stuck & met, status.COLLAPSED, end.code)
    if end.rounding is not None:
        near = _is_at_rounding(system, residual, rounding)
        code = jnp.where(stuck & near & ~met, status.AT_ROUNDING, code)
    return code


def _is_at_rounding(system, residual, rounding):
    """Whether a residual is as small as its rounding leaves it; both the largest, N."""
    # in a net the matrix, which has no fine part, is what cannot tell less than this apart
    plain = jnp.finfo(rounding.dtype).eps if system.is_net else 1.0
    return residual <= _NEARLY * rounding / plain


def _outcome(system, end, x, active, broken, factored):
    """`Outcome` of an iteration from `x`; `broken`: whether it ended beyond the curve of a law."""
    forces = largest(end.residual), _rounding(end)
    code = jnp.maximum(_cause(system, end, *forces), status.OK)
    if system.breaks:
        broken = active & (code != status.NONFINITE) & broken
        code = jnp.where(broken, status.MATERIAL_FAILURE, code)
    good = active & (code == status.OK)
    x = where(good, end.x, x)
    count = end.steps if factored is None else end.factored.count - factored.count
    # after an earlier failure nothing was evaluated
    residual, rounding = (jnp.where(active, force, jnp.nan) for force in forces)
    whether = good, good & end.stable
    return Outcome(x, code, end.steps, count, residual, end.scale, rounding, *whether)


def _rounding(end):
    """Largest residual that the rounding of displacements leaves in an `Iterate`, N.

    Of the displacements at its end or, where that is more, of those that it came from.
    """
    if end.rounding is None:
        return jnp.zeros_like(end.scale)
    rounding = end.rounding
    if end.came_from is not None:
        rounding = jnp.maximum(rounding, end.came_from)
    return jnp.max(rounding, initial=0.0)


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
    """Bring a phase to equilibrium at every load factor, each time from the point before.

    Args:
        ramp: the phase, `ramp.at(factor)` a `System`; not differentiated.
        x: motion to start from.
        increments: (load factors, whether the phase has them), both [1 + n_inc]; nothing is done
            at factors that the phase does not have. The first factor is 0, where nothing is solved.
        method: `Newton`.
        code: status so far; after a failure nothing moves.
        factored: as for `equilibrate`.
        seen: `Reading` of the last good increment.
        fresh: whether no increment has been good so far: then the start is read.
        tell: function of a load factor and its `Outcome` that is called after every increment, or
            None.

    Returns:
        xs: points, [1 + n_inc, ...]; those of nets with a fine part (`spaces.translations`).
        log: `Outcome.log` of every increment, with latched status.
        readings: `Reading.of_path` at every increment, or at the last good one after a failure.
        seen: `Reading` of the last good increment.
        memory: memory of laws at the end.
        factored: what is factored at the end.
    """
    begun = ramp.begun()
    x = first = begun.refined(x)
    most = ramp.most_added(begun, increments[0]) if ramp.varies else None

    def step(carry, increment):
        x, code, memory, factored, seen, left = carry
        factor, live = increment
        system, judge = ramp.at(factor, memory), method.watch | (factor == 1)
        good, at_start = code == status.OK, factor == 0
        active, starts = live & good, at_start & good
        balance = Balance.of(system, left, begun.load, factor, most)
        end = _iterated(system, x, method, active | starts, factored, judge, balance, starts)
        begins, ended = fresh & at_start, active & (end.code <= status.OK)
        motion, broken = where(begins, first, end.x), False
        new = lax.cond(
            begins | ended,
            lambda: read(_as_begun(system, begun, factor), motion),
            lambda: seen,
        )
        if system.breaks:
            broken = jnp.any(system.broken(new.strains))
        outcome = _outcome(system, end, x, active, broken, factored)
        if system.breaks:
            new = where(begins | outcome.equilibrated, new, seen)
        code = status.first_failure(code, outcome.code)
        if memory is not None:
            memory = ramp.settle(system, motion, new.strains, outcome.equilibrated, memory)
        outcome = copy(outcome, code=code)
        if tell is not None:
            lax.cond(live, lambda: tell(factor, outcome), lambda: None)
        carry = outcome.x, code, memory, end.factored, new, end.residual
        return carry, (outcome.x, outcome.log, new.of_path)

    left = jnp.zeros(ramp.freedoms.free.shape[0], x.dtype)
    start = x, code, ramp.memory, factored, seen, left
    (_, _, memory, factored, seen, _), (xs, log, readings) = lax.scan(step, start, increments)
    return xs, log, readings, seen, memory, factored


def _as_begun(system, begun, factor):
    """The system, at load factor 0 with the states of the start exactly (the end may be NaN)."""
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
