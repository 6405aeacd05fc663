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
6. Is it stable? Where the energy need not be convex, one more turn of the loop at the equilibrium
   factorises the tangent, and moves nothing.

The energy of a tension-only structure under dead load is convex (a non-decreasing convex function
of lengths), hence the iteration converges from any start, until the rounding of the displacements
themselves (EA eps) shows in the residual.
"""

import jax
import jax.numpy as jnp
from jax import lax

from . import _check, linear, status
from ._rules import Rule, refuse
from ._tree import copy, pytree
from .newton_step import WORTH, direction, go_along, largest
from .search import SHORT

_KAPPA = 1e-3  # initial shift: harmless in a taut net, a step of 1000 lengths in a slack one
_KAPPA_MIN, _KAPPA_MAX = 1e-10, 1e14
_PATIENCE = 15  # short steps before a tension-only structure is softened
_SETTLED = 0.1  # relative residual at which the added softness is taken back a step
_HARDEN = 0.1  # by this factor
_STIFF = 0.01  # added strain, relative to the elastic one, that is dropped altogether
_SPRINT = 20  # plain Newton steps that may be tried first
_ASTRAY = 10.0  # displacement, in structure sizes, at which they have led nowhere
_RELEASED = 2.0  # roundings of the first forces that the last ones may have
_ZERO = 64  # roundings of the largest stiffness, below which an eigenvalue is none
_RUNAWAY = 1e6  # displacement, in structure sizes, that no anchored structure reaches


def default_tolerance(dtype):
    """Relative tolerance that a dtype can be expected to reach: 1e-10, or 1e-5 in float32."""
    return 1e-10 if jnp.finfo(dtype).eps < 1e-12 else 1e-5


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

    tol: object = None
    max_steps: object = 200
    linear_solver: str | None = None
    watch: bool = False

    def __post_init__(self):
        for name in ("tol", "max_steps"):
            value = getattr(self, name)
            if value is not None and jnp.ndim(_check.floats(value, name)) != 0:
                shape = jnp.shape(value)
                raise ValueError(f"{name}: expected one number, got an array of shape {shape}")
        refuse(self.rules())
        linear.check(self.linear_solver)
        if not isinstance(self.watch, bool):
            raise ValueError(f"watch = {self.watch!r}: expected True or False")

    def rules(self):
        """What its numbers keep, see `_rules`; a NaN keeps none: no residual would exceed it."""
        large = "relative to the forces: from 1 on any state would pass"
        return [
            Rule("tol", self.tol, lambda v: ~(v > 0), "must be positive"),
            Rule("tol", self.tol, lambda v: v >= 1, large),
            Rule("max_steps", self.max_steps, lambda v: ~(v > 0), "must be positive"),
            Rule("max_steps", self.max_steps, lambda v: v % 1 != 0, "expected a whole number"),
        ]


@pytree
class _Iterate:
    """Where the iteration stands."""

    x: object  # unknowns
    residual: object  # R(x)
    scale: object  # force that R is judged by
    kappa: object  # Levenberg shift, in |R| / length
    softness: object  # compliance added to every element for the time being
    short: object  # short steps so far
    steps: object  # so far
    code: object  # OK while nothing has gone wrong
    memory: object  # of sparse solves, see `linear.solve_next`
    stiffness: object = None  # largest on the diagonal, times a length, where it may be softened
    sprint: object = None  # whether plain steps are being tried; None where they never are
    stable: object = None  # whether the tangent at the end is definite; None where it always is
    judged: object = None  # whether that has been asked


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

    x: object
    code: object
    steps: object
    factorizations: object
    residual: object
    scale: object
    equilibrated: object
    stable: object


def limit(method, dtype):
    """The relative residual that counts as converged."""
    tol = default_tolerance(dtype) if method.tol is None else method.tol
    return jnp.maximum(jnp.asarray(tol, dtype), 64 * jnp.finfo(dtype).eps)


def adjoint_effort(method, system, dtype):
    """Tolerance and number of conjugate gradient steps for derivatives, see `implicit.attach`.

    As exact as the state whose derivative it is: its residual is below `tol` times the forces.
    """
    return 0.1 * limit(method, dtype), WORTH if system.convex else 0


def newton(system, x, method, active, memory=None, judge=False):
    """Bring `system` to equilibrium from `x`.

    Args:
        system: `System` of one load factor.
        x: start, a point of the system, [n_free] or a motion.
        method: `Newton`.
        active: False to return at once (an earlier increment has failed).
        memory: of sparse solves in earlier increments, if they were on the same pattern.
        judge: whether to ask if the equilibrium is stable.

    Returns:
        `Outcome`, and the memory after it. Not differentiable: `implicit.attach` gives the
        derivative.
    """
    if memory is None:
        memory = linear.no_memory(system.freedoms.pattern, x.dtype)
    tol = limit(method, x.dtype)
    length, extent = system.length_scale(), system.extent()

    came_from = system.rounding(system.place(x)) if system.rounds else None

    def converged(it):
        rigid = it.softness == 0
        # what is released ends at the rounding of the forces that it began with
        allowed = jnp.maximum(tol * it.scale, released)
        if system.rounds:
            rounding = jnp.maximum(system.rounding(it.x), came_from)
            allowed = jnp.maximum(allowed, rounding)
            return rigid & jnp.all(jnp.abs(it.residual) <= allowed)
        return rigid & (largest(it.residual) <= allowed)

    soften = system.convex

    def unfinished(it):
        more = it.steps < method.max_steps
        if not soften:
            more = jnp.where(converged(it), judge & ~it.judged, more)
            return (it.code == status.OK) & more
        return (it.code == status.OK) & ~converged(it) & more

    def at_softness(c):
        return system.softened(c) if soften else system

    def iterate(it):
        working, wanted = at_softness(it.softness), unfinished(it)
        shift = it.kappa * largest(it.residual) / length
        if system.turning:
            shift = jnp.where(it.sprint, 0.0, shift)
        matrix = working.tangent(it.x)
        if not soften:  # the turn that only judges?
            last = converged(it)
            shift = jnp.where(last, no_stiffness(matrix), shift)
            if it.sprint is not None:
                it = copy(it, sprint=it.sprint & ~last)
        matrix = linear.plus_diagonal(matrix, shift)
        step, definite, memory = direction(working, matrix, it, tol, wanted)
        slope = it.residual @ step
        usable = definite & jnp.isfinite(slope) & (slope < 0)
        if it.sprint is not None:
            usable = usable | (it.sprint & definite & jnp.isfinite(slope))
        stable, judged, count = it.stable, it.judged, 1
        if not soften:
            usable, stable = usable & ~last, jnp.where(last, definite, stable)
            judged, count = judged | last, jnp.where(last, 0, 1)
        step = jnp.where(usable, step, 0.0)
        # in a batch, nobody waits for the search of a case that has finished
        new, residual, scale, taken, found = go_along(working, it, step, slope, usable & wanted)
        sprint = it.sprint
        if sprint is not None:
            found = found & ~(sprint & (largest(new) > _ASTRAY * extent))
            on = sprint & found & (it.steps + 1 < _SPRINT)
            reached = converged(copy(it, x=new, residual=residual, scale=scale))
            restart = sprint & ~on & ~reached
            new, residual, scale = jax.tree.map(
                lambda a, b: jnp.where(restart, b, a), (new, residual, scale), (x, *begun)
            )
            sprint, found = on, found | restart
            taken = jnp.where(restart, 0.5, taken)  # leaves kappa as it is
        kappa = jnp.where(
            found,
            it.kappa * jnp.where(taken >= 1, 0.1, jnp.where(taken < 0.1, 10.0, 1.0)),
            it.kappa * 100,
        )
        # keeps the shift a usable float; it steers the steps and is no part of the result
        kappa = jnp.clip(kappa, _KAPPA_MIN, _KAPPA_MAX)
        if it.sprint is not None:
            kappa = jnp.where(restart, _KAPPA, kappa)
        short, stiffness = it.short, it.stiffness
        if soften:
            short = short + jnp.where((taken < SHORT) | ~found, 1, 0)
            stiffness = jnp.max(linear.diagonal(matrix), initial=0.0) * length
        runaway = jnp.max(jnp.abs(new), initial=0.0) > _RUNAWAY * extent
        code = jnp.where(runaway, status.MECHANISM, status.OK).astype(jnp.int32)
        return copy(
            it,
            x=new,
            residual=residual,
            scale=scale,
            kappa=kappa,
            short=short,
            steps=it.steps + count,
            code=code,
            memory=memory,
            stiffness=stiffness,
            sprint=sprint,
            stable=stable,
            judged=judged,
        )

    def due(it):
        """Whether the added softness has to change before the next step."""
        begin = (it.short == _PATIENCE) & (softest > 0)
        settled = (it.softness > 0) & (largest(it.residual) <= _SETTLED * it.scale)
        return begin | settled

    def change(it):
        begin = (it.short == _PATIENCE) & (softest > 0)
        harder = jnp.where(it.softness * it.stiffness < _STIFF, 0.0, it.softness * _HARDEN)
        softness = jnp.where(begin, softest, harder)
        residual, scale = at_softness(softness).residual_and_scale(it.x)
        short = jnp.where(begin, it.short + 1, it.short)
        kappa = zero + _KAPPA
        return copy(it, softness=softness, residual=residual, scale=scale, short=short, kappa=kappa)

    def stage(it):
        """Steps with one softness, and the change to the next one."""
        it = lax.while_loop(lambda it: active & unfinished(it) & ~due(it), iterate, it)
        return lax.cond(due(it) & unfinished(it), change, lambda it: it, it)

    begin, x = x, system.place(x)
    load = jnp.max(jnp.sqrt(jnp.sum(system.load**2, axis=-1)))
    softest = 1 / jnp.where(load > 0, load, jnp.inf)  # strain 1 under the largest load
    residual, scale = system.residual_and_scale(x)
    bad_start = ~(jnp.all(jnp.isfinite(residual)) & jnp.isfinite(scale))
    code = jnp.where(bad_start & active, status.NONFINITE, status.OK).astype(jnp.int32)
    zero = jnp.zeros((), x.dtype)
    begun = residual, scale
    released = (_RELEASED * jnp.finfo(x.dtype).eps if soften else 0.0) * scale
    start = _Iterate(
        *(x, residual, scale, zero + _KAPPA, zero, jnp.int32(0), jnp.int32(0), code, memory)
    )
    if system.turning or soften or system.followers is not None:
        start = copy(start, sprint=jnp.ones((), bool))
    if soften:
        start = copy(start, stiffness=zero)
    else:
        start = copy(start, stable=jnp.zeros((), bool), judged=jnp.zeros((), bool))
    end = lax.while_loop(lambda it: active & unfinished(it), stage if soften else iterate, start)
    stuck = (end.code == status.OK) & ~converged(end)
    code = jnp.where(active & stuck, status.NOT_CONVERGED, end.code)
    if system.breaks:  # the iteration follows curves beyond their ends, an answer does not
        broken = active & (code != status.NONFINITE) & system.beyond(system.motion(end.x))
        code = jnp.where(broken, status.MATERIAL_FAILURE, code)
    good = active & (code == status.OK)
    residual, scale = end.residual, end.scale
    if soften:  # it may have stopped while softened: report the residual of the real system
        residual, scale = lax.cond(
            end.softness > 0,
            lambda: system.residual_and_scale(end.x),
            lambda: (end.residual, end.scale),
        )
    x = jnp.where(good, end.x, begin)
    factorizations = end.steps if memory is None else end.memory.count - memory.count
    stable = good if soften else good & end.stable
    outcome = Outcome(x, code, end.steps, factorizations, largest(residual), scale, good, stable)
    return outcome, end.memory


def no_stiffness(matrix):
    """Size of eigenvalues of a tangent that rounding makes of zero, N/m; positive."""
    size = jnp.max(jnp.abs(linear.diagonal(matrix)), initial=0.0)
    return _ZERO * jnp.finfo(size.dtype).eps * size + jnp.finfo(size.dtype).tiny


def is_stable(system, x):
    """Whether the tangent at a point has no negative eigenvalue."""
    if system.convex:
        return jnp.ones((), bool)
    matrix = system.tangent(x)
    return linear.is_definite(linear.plus_diagonal(matrix, no_stiffness(matrix)))


def march(ramp, x, factors, method, code, memory=None, tell=None):
    """Bring a phase to equilibrium at each load factor in turn, each from the one before.

    Args:
        ramp: the phase, `ramp.at(factor)` a `System`; not differentiated.
        x: start, [n_free].
        factors: load factors, [n_inc].
        method: `Newton`.
        code: status so far; if it is a failure, or from the first failure on, nothing moves.
        memory: as for `newton`.
        tell: function of a load factor and its `Outcome` that is called after each, or None.

    Returns:
        `Outcome` with a leading axis [n_inc], codes latched; and the memory after it.
    """
    if memory is None:
        memory = linear.no_memory(ramp.freedoms.pattern, x.dtype)

    def step(carry, factor):
        x, code, plastic, memory = carry
        system, judge = ramp.at(factor, plastic), method.watch | (factor == factors[-1])
        outcome, memory = newton(system, x, method, code == status.OK, memory, judge)
        code = status.first_failure(code, outcome.code)
        plastic = ramp.settle(system, outcome.x, code, plastic)
        outcome = copy(outcome, code=code)
        if tell is not None:
            tell(factor, outcome)
        return (outcome.x, code, plastic, memory), outcome

    (*_, memory), outcome = lax.scan(step, (x, code, ramp.plastic, memory), factors)
    return outcome, memory
