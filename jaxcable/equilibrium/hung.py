"""Interior iteration of nets with hanging cables or curved laws: a bound on every cable's length.

A cable is a bound on its length, ``l <= L(N)`` with the length L(N) that it has under the tension
N, and the room y that is left: ``N >= 0, y >= 0, N y = 0``. An interior-point method follows
``N y = m`` as m goes to zero. Eliminating y and N from the linear equations gives

    w = y + N L'(N),     k = N / w,     B = N + (m - N (L(N) - l)) / w.

A taut cable (y to 0) has k = 1/L' = D', a slack one (N to 0) none; in between a cable is softened
by a spring of compliance y/N of its own. A hanging cable has a bound, too, less the length s(N)
that its sag takes (`hanging_springs`): in balance ``y = s``, where a straight cable has y = 0, and
a step aims at ``N y = m + N s``. Its sag keeps N from zero as m does, so that the elimination is
the same.

The forces of a hanging cable are not its tension times a unit vector, so that it has no cone as
that of `cones`.

Source: Wright, "Primal-dual interior-point methods" (1997).
"""

from __future__ import annotations

from typing import Any, ClassVar

import jax.numpy as jnp
from jax import lax

from .. import linear
from ..common.tree import copy, pytree, where
from ..common.types import Array, ArrayLike, Bool, Float, Int, PyTree
from ..linear import Matrix
from ..mechanics.assembly import System
from ..mechanics.pulls import Pulls, held, lengthened, rest_lengths, stiffness, turned
from ..spaces.space import Motion
from .ending import Ending

_INTERIOR = 100  # interior steps
_STALLED = 6, 1e-2  # steps without halving a residual below this part: rounding stalls it
_SHIFT = 1e-6  # Levenberg shift over tension per length
_INSIDE = 0.9995  # part of the way to the bound that a step may go
_BLOCKED = 0.05  # a step shorter than this is blocked by a bound
_FORCE = 0.1, 10.0  # tensions at the start of the interior iteration, over the load
_UNLOADED = 1e-3  # the load that stands for none, over the largest tension at the start
_ROOM = 0.1  # room at the start, in unstressed lengths
_DAMPING = 0.1  # least damping, over tension per length
_DAMPED = 10.0  # factor by which it changes
_UNDAMPED = 1e-7  # part of the least damping below which there is none
_TURN = 1.0  # relative motion of the ends of a cable in an interior step, in its lengths
_CENTRING = 0.01, 0.2  # least centring, and centring of the first step


@pytree
class Hung:
    """State of the interior iteration.

    Attributes:
        tension, room: N and y, [n], N and m.
        centring: m of the next step over the present mean of N y.
        damping: shift of the matrix, N/m: more after a step that was too long.
    """

    tension: Float[Array, " n"]
    room: Float[Array, " n"]
    centring: Float[Array, ""]
    damping: Float[Array, ""]

    near: ClassVar[float] = 1e-5  # relative residual from which the end is tried
    tries: ClassVar[int] = 5  # how often the end is tried
    least: ClassVar[int] = 0  # as `limit` of `linear.solve_next`

    @classmethod
    def init(cls, system: System, x: Motion) -> Hung:
        """Return the state before the iteration begins: zeros."""
        none, zero = jnp.zeros_like(rest_lengths(system)), jnp.zeros((), x.dtype)
        return cls(none, none, zero, zero)

    def ending(
        self,
        policy: Any,
        found: Bool[Array, ""],
        since: Int[Array, ""],
        relative: Float[Array, ""],
        length: Float[Array, ""],
    ) -> Ending:
        """Return whether to try the end.

        Args:
            policy: `tensions.Tensions`.
            found: whether the last step led to finite forces.
            since: steps since the residual was halved.
            relative: residual over the force it is judged by.
            length: of elements, m.
        """
        stalled = (since >= _STALLED[0]) & (relative <= _STALLED[1])
        stuck = (policy.blocked >= 2) | stalled
        now = found & ((relative <= policy.near) | stuck)
        lost = ((policy.count >= _INTERIOR) | ~found) & ~now
        return Ending(now, stuck, relative, lost=lost)


@pytree
class Equations:
    """The linear equations of a step.

    Attributes:
        base, slope: B and k of every cable, [n], N and N/m.
        along: change of the lengths by the ends, per group [n_elem, n_end, 3].
        jacked: which cables a jack holds, [n].
        rhs: right side, [n_free], N.
        gap, compliance: L(N) - l and L'(N), [n], m and m/N.
        load: largest dead load at a node or force of a jack, N.
        length: of elements, m.
        policy: `tensions.Tensions` with the numbers that its mode begins with.
    """

    base: Float[Array, " n"]
    slope: Float[Array, " n"]
    along: list[Float[Array, "n_elem n_end 3"]]
    jacked: Bool[Array, " n"]
    rhs: Float[Array, " n_free"]
    gap: Float[Array, " n"]
    compliance: Float[Array, " n"]
    load: Float[Array, ""]
    length: Float[Array, ""]
    policy: PyTree[Array]

    @classmethod
    def of(
        cls,
        policy: Any,
        system: System,
        x: Motion,
        pulls: Pulls,
        residual: Float[Array, " n_free"],
        guess: Float[Array, " n"],
        load: Float[Array, ""],
        length: Float[Array, ""],
    ) -> Equations:
        """Return the equations of the next step from x, see `cone_equations.Equations.of`."""
        none, jacked = jnp.zeros_like(pulls.tension), held(system)
        mixed = cls(
            base=pulls.tension,
            slope=pulls.slope,
            along=pulls.along,
            jacked=jnp.zeros(none.shape, bool) if jacked is None else jacked,
            rhs=-residual,
            gap=none,
            compliance=none,
            load=load,
            length=length,
            policy=copy(policy, guess=guess),
        )
        inner = mixed._inner
        return lax.cond(policy.interior, lambda: inner(system, x, pulls), lambda: mixed)

    def _inner(self, system, x, pulls):
        """Those of an interior step, where these are those of a mixed step; `pulls` are at x."""
        policy, free = self.policy, ~self.jacked
        first = jnp.maximum(self.load, _UNLOADED * jnp.max(pulls.tension))
        least, most = (part * first for part in _FORCE)
        # a first guess only: steps change it freely
        start = jnp.clip(pulls.tension, least, most)
        tension = where(policy.fresh, start, policy.inner.tension)
        under = pulls.under(system, tension)
        wide = jnp.maximum(under.gap, _ROOM * rest_lengths(system))
        wide = wide if under.sag is None else jnp.maximum(wide, under.sag)
        room = where(policy.fresh, wide, policy.inner.room)
        product = jnp.where(free, tension * under.spare(room), 0.0)
        centring = jnp.where(policy.fresh, _CENTRING[1], policy.inner.centring)
        target, falls = under.aim(centring * jnp.sum(product) / jnp.maximum(jnp.sum(free), 1))
        damping = jnp.where(policy.fresh, 0.0, policy.inner.damping)
        width = falls * room + tension * under.compliance
        width = jnp.where(width > 0, width, 1.0)
        base = jnp.where(free, tension + (target - tension * under.gap) / width, self.base)
        return copy(
            self,
            base=base,
            slope=jnp.where(free, tension / width, self.slope),
            along=under.along,
            rhs=-under.residual(system, x, base),
            gap=under.gap,
            compliance=under.compliance,
            policy=copy(policy, inner=Hung(tension, room, centring, damping)),
        )

    def matrix(
        self,
        system: System,
        x: Motion,
        residual: Float[Array, ""],
    ) -> Matrix:
        """Return the matrix of the equations, regularised; `residual` is the largest, N."""
        policy = self.policy
        tensions = where(policy.interior, policy.inner.tension, policy.guess)
        matrix = system.tangent(x, [*stiffness(system, x, self.along, self.slope, tensions)])
        size = jnp.max(jnp.abs(linear.diagonal(matrix)), initial=0.0)
        eps, tiny = jnp.finfo(x.dtype).eps, jnp.finfo(x.dtype).tiny
        rounding = policy.roundings * (eps * size) + tiny
        shift = _SHIFT * jnp.minimum(residual, jnp.max(tensions) + self.load) / self.length
        shift = jnp.where(policy.interior, policy.inner.damping, shift)
        return linear.plus_diagonal(matrix, jnp.maximum(shift, rounding))

    def taken(
        self,
        system: System,
        x: Motion,
        step: Float[Array, " n_free"],
        definite: Bool[Array, ""],
    ) -> tuple[Any, Float[Array, ""], Bool[ArrayLike, ""]]:
        """Return what `cone_equations.Equations.taken` does."""
        spread, policy = system.space.spread(x, step), self.policy
        longer = lengthened(system, self.along, spread)
        now = self.base + self.slope * longer
        mixed = copy(policy, guess=jnp.maximum(now, 0.0)), jnp.ones_like(self.length)
        after, part = lax.cond(
            policy.interior,
            lambda: self._interior_step(now, longer, jnp.max(turned(system, spread))),
            lambda: mixed,
        )
        return (
            copy(after, fresh=jnp.zeros((), bool), count=policy.count + 1),
            part,
            jnp.zeros((), bool),
        )

    def _interior_step(self, now, longer, widest):
        """`taken` of an interior step to tensions `now`, [n], N, before it is cut."""
        policy = self.policy
        change = jnp.where(self.jacked, 0.0, now - policy.inner.tension)
        room = self.gap + self.compliance * change - longer
        wider = jnp.where(self.jacked, 0.0, room - policy.inner.room)
        part_n, part = (
            _part_to_bounds(policy.inner.tension, change),
            _part_to_bounds(policy.inner.room, wider),
        )
        far = widest > _TURN
        part = jnp.minimum(part, jnp.where(far, _TURN / jnp.where(far, widest, 1.0), 1.0))
        shorter = jnp.minimum(part_n, part)
        blocked = jnp.where(shorter < _BLOCKED, policy.blocked + 1, jnp.minimum(policy.blocked, 0))
        inner = Hung(
            tension=policy.inner.tension + part_n * change,
            room=policy.inner.room + part * wider,
            centring=jnp.maximum((1 - shorter) ** 2, _CENTRING[0]),
            damping=self._damping(far),
        )
        after = copy(policy, inner=inner, blocked=blocked.astype(jnp.int32))
        return after, part

    def _damping(self, far):
        """Shift for the next interior step: larger after a step that led too far."""
        least = _DAMPING * jnp.max(self.policy.inner.tension) / self.length
        more = jnp.maximum(_DAMPED * self.policy.inner.damping, least)
        less = self.policy.inner.damping / _DAMPED
        return jnp.where(far, more, jnp.where(less > _UNDAMPED * least, less, 0.0))


def _part_to_bounds(values, changes):
    """Part of the changes, at most 1, up to which positive values stay positive."""
    falls = changes < 0
    ratio = jnp.where(falls, -values / jnp.where(falls, changes, -1.0), jnp.inf)
    return jnp.minimum(1.0, _INSIDE * jnp.min(ratio, initial=jnp.inf))
