"""Tensions of cables as unknowns beside the displacements, so that stiff nets converge.

A step sideways lengthens a cable in second order. Where EA is large, the force EA e at the next
point is then larger than the true tension by orders of magnitude, and so is the geometric stiffness
N/l that resists the next step sideways: the iteration creeps. Two remedies keep the tension N of
every cable as a number of its own, which follows the linear equations of a step. Both solve one
system of the size of the tangent per step,

    (sum of k g g^T + N hess(l)) p = F - sum of B g,     N_new = B + k g.p,     g = grad(l),

with the length l of a cable (over all pieces of a sliding one) and its elastic law N = D(l).

*Mixed*: ``B = D(l)``, ``k = D'(l)``: Newton's method, but where D(l) exceeds it by far with the
geometric stiffness of the tension that the step before predicts (Magisano, Leonetti, Garcea 2017).
Few steps, often; no guarantee.

*Interior*: a cable is a bound on its length, ``l <= L(N)`` with the length L(N) that it has under
the tension N, and the room y that is left: ``N >= 0, y >= 0, N y = 0``. An interior-point method
follows ``N y = m`` as m goes to zero. Eliminating y and N from the linear equations gives

    w = y + N L'(N),     k = N / w,     B = N + (m - N (L(N) - l)) / w.

A taut cable (y to 0) has k = 1/L' = D', a slack one (N to 0) none; in between a cable is softened
by a spring of compliance y/N of its own. The number of steps hardly depends on EA/N.

A hanging cable has a bound, too, less the length s(N) that its sag takes (`hanging_springs`): in
balance ``y = s``, where a straight cable has y = 0, and a step aims at ``N y = m + N s``. Its sag
keeps N from zero as m does, so that the elimination is the same.

The iteration is mixed as long as the residual falls; then interior, from the start of the
increment; near the end mixed again, because interior steps become inaccurate where slack and taut
cannot be told apart; and if all of this fails, plain Newton steps with a line search.

Sources: Magisano, Leonetti, Garcea, "How to improve efficiency and robustness of the Newton method
in geometrically non-linear structural problem discretized via displacement-based finite elements"
(2017); Wright, "Primal-dual interior-point methods" (1997).
"""

from __future__ import annotations

import jax.numpy as jnp
from jax import lax

from .. import linear
from ..common.tree import copy, pytree, where
from ..common.types import Array, Bool, Float, Int
from ..linear import Matrix
from ..mechanics.assembly import System
from ..mechanics.pulls import Pulls, held, lengthened, rest_lengths, stiffness, turned

MIXED, INTERIOR, LAST, SEARCH = range(4)

_PATIENCE = 8, 4  # evaluations within which the residual must halve: mixed, and at the end
_LONGEST = 60, 20  # mixed steps, and at the end
_INTERIOR = 100  # interior steps
_STALLED = 6, 1e-2  # steps without halving a residual below this part: rounding stalls it
_TRIES = 5  # how often the end is tried
_PLAIN = 3.0  # tension over (predicted tension + load) up to which it makes the stiffness itself
_BEGINNING = 2  # first steps, whose residuals begin anew: what starts in balance must leave it
_NEAR = 1e-5  # relative residual from which the end is tried
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
class Tensions:
    """Tensions as unknowns, and what the iteration does with them.

    Attributes:
        mode: `MIXED`, `INTERIOR`, `LAST` or `SEARCH`.
        guess: tensions for the geometric stiffness of mixed steps, [n], N, of all groups.
        tension, room: N and y of the interior iteration, [n], N and m.
        centring: m of the next interior step over the present mean of N y.
        damping: shift of the matrix of interior steps, N/m: more after a step that was too long.
        fresh: whether the mode begins at its next step.
        best: smallest residual since the mode began, N.
        since, count: steps since it was halved, and since the mode began.
        blocked: interior steps in succession that a bound has blocked.
        near: relative residual at which the end is tried.
        tries: how often it was.
        inside: point of the interior iteration, while the end is tried.
        doubtful: whether rounding has left a matrix of the mode indefinite.
    """

    mode: Int[Array, ""]
    guess: Float[Array, " n"]
    tension: Float[Array, " n"]
    room: Float[Array, " n"]
    centring: Float[Array, ""]
    damping: Float[Array, ""]
    fresh: Bool[Array, ""]
    best: Float[Array, ""]
    since: Int[Array, ""]
    count: Int[Array, ""]
    blocked: Int[Array, ""]
    near: Float[Array, ""]
    tries: Int[Array, ""]
    inside: Float[Array, "n_row n_motion"]
    doubtful: Bool[Array, ""]

    @classmethod
    def init(cls, system: System, x: Float[Array, "n_row n_motion"]) -> Tensions:
        """The start: mixed."""
        none = jnp.zeros(sum(len(group.links) for group in system.groups), x.dtype)
        zero, first = jnp.zeros((), x.dtype), jnp.int32(0)
        return cls(
            mode=jnp.int32(MIXED),
            guess=none,
            tension=none,
            room=none,
            centring=zero,
            damping=zero,
            fresh=jnp.ones((), bool),
            best=jnp.full_like(zero, jnp.inf),
            since=first,
            count=first,
            blocked=first,
            near=jnp.full_like(zero, _NEAR),
            tries=first,
            inside=x,
            doubtful=jnp.zeros((), bool),
        )

    @property
    def searching(self) -> Bool[Array, ""]:
        """Whether steps are plain Newton steps with a line search."""
        return self.mode == SEARCH

    @property
    def interior(self) -> Bool[Array, ""]:
        """Whether the iteration is interior."""
        return self.mode == INTERIOR

    def halved(self, residual: Float[Array, ""]) -> Bool[Array, ""]:
        """Whether the largest `residual`, N, is less than half of the smallest so far."""
        return self.fresh | (residual < 0.5 * self.best)

    def steered(
        self,
        x: Float[Array, "n_row n_motion"],
        begin: Float[Array, "n_row n_motion"],
        found: Bool[Array, ""],
        residual: Float[Array, ""],
        scale: Float[Array, ""],
        astray: Bool[Array, ""],
    ) -> tuple[Tensions, Float[Array, "n_row n_motion"], Bool[Array, ""]]:
        """The mode after a step.

        Args:
            x, begin: the point reached, and the start of the increment.
            found: whether the step led to finite forces.
            residual, scale: largest residual at x and the force it is judged by, N.
            astray: whether the point is far from the structure.

        Returns:
            The policy, the point to go on from, whether this is another one than x.
        """
        mixed, last, interior = self.mode == MIXED, self.mode == LAST, self.mode == INTERIOR
        halved = found & self.halved(residual)
        best = jnp.where(halved | (mixed & (self.count <= _BEGINNING)), residual, self.best)
        since = jnp.where(halved, 0, self.since + 1)
        patience, longest = (jnp.where(mixed, *pair) for pair in (_PATIENCE, _LONGEST))
        lost = (mixed | last) & ((since >= patience) | (self.count >= longest) | astray | ~found)
        begins, returns = mixed & lost, last & lost
        stalled = (since >= _STALLED[0]) & (residual <= _STALLED[1] * scale)
        stuck = (self.blocked >= 2) | stalled
        ends = interior & found & ((residual <= self.near * scale) | stuck)
        searches = (interior & ((self.count >= _INTERIOR) | ~found) & ~ends) | (
            returns & (self.tries >= _TRIES)
        )
        mode = jnp.select(
            [searches, begins | returns, ends], [SEARCH, INTERIOR, LAST], self.mode
        ).astype(jnp.int32)
        changed = mode != self.mode
        after = copy(
            self,
            mode=mode,
            guess=where(ends, self.tension, self.guess),
            centring=jnp.where(begins, _CENTRING[1], self.centring),
            damping=jnp.where(begins, 0.0, self.damping),
            fresh=(begins | searches) | (self.fresh & ~changed),
            best=jnp.where(changed, residual, best),
            since=jnp.where(changed, 0, since),
            count=jnp.where(changed & ~returns, 0, self.count),
            blocked=jnp.where(ends, jnp.where(stuck, -4, 0), self.blocked),
            near=jnp.where(ends, 0.1 * jnp.minimum(self.near, residual / scale), self.near),
            tries=self.tries + ends,
            inside=where(ends, x, self.inside),
            doubtful=self.doubtful & ~changed,
        )
        x = where(begins, begin, where(returns, self.inside, x))
        return after, x, begins | returns

    def equations(
        self,
        system: System,
        x: Float[Array, "n_row n_motion"],
        pulls: Pulls,
        residual: Float[Array, " n_free"],
    ) -> Equations:
        """The linear equations of the next step from x.

        `pulls` and `residual` are those of the system at x.
        """
        load, jacked = jnp.max(jnp.abs(system.load), initial=0.0), held(system)
        load = jnp.maximum(load, jnp.max(jnp.where(jacked, pulls.tension, 0.0)))
        guess = where(self.fresh | self.searching, pulls.tension, self.guess)
        guess = jnp.where(pulls.tension <= _PLAIN * (guess + load), pulls.tension, guess)
        best = jnp.where(self.fresh, jnp.max(jnp.abs(residual), initial=0.0), self.best)
        none = jnp.zeros_like(pulls.tension)
        mixed = Equations(
            base=pulls.tension,
            slope=pulls.slope,
            along=pulls.along,
            jacked=jacked,
            rhs=-residual,
            gap=none,
            compliance=none,
            load=load,
            policy=copy(self, guess=guess, best=best),
        )
        return lax.cond(self.interior, mixed.inner, lambda *_: mixed, system, x, pulls)


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
        policy: `Tensions` with the numbers that its mode begins with.
    """

    base: Float[Array, " n"]
    slope: Float[Array, " n"]
    along: list[Float[Array, "n_elem n_end 3"]]
    jacked: Bool[Array, " n"]
    rhs: Float[Array, " n_free"]
    gap: Float[Array, " n"]
    compliance: Float[Array, " n"]
    load: Float[Array, ""]
    policy: Tensions

    def inner(self, system: System, x: Float[Array, "n_row n_motion"], pulls: Pulls) -> Equations:
        """Those of an interior step, where these are those of a mixed step; `pulls` are at x."""
        policy, free = self.policy, ~self.jacked
        first = jnp.maximum(self.load, _UNLOADED * jnp.max(pulls.tension))
        least, most = (part * first for part in _FORCE)
        # a first guess only: steps change it freely
        start = jnp.clip(pulls.tension, least, most)
        tension = where(policy.fresh, start, policy.tension)
        under = pulls.under(system, tension)
        wide = jnp.maximum(under.gap, _ROOM * rest_lengths(system))
        wide = wide if under.sag is None else jnp.maximum(wide, under.sag)
        room = where(policy.fresh, wide, policy.room)
        product = jnp.where(free, tension * under.spare(room), 0.0)
        target, falls = under.aim(
            policy.centring * jnp.sum(product) / jnp.maximum(jnp.sum(free), 1)
        )
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
            policy=copy(policy, tension=tension, room=room),
        )

    def matrix(
        self,
        system: System,
        x: Float[Array, "n_row n_motion"],
        residual: Float[Array, ""],
        length: Float[Array, ""],
    ) -> Matrix:
        """Matrix of the equations, regularised; `residual` the largest, `length` of elements."""
        policy = self.policy
        tensions = where(policy.interior, policy.tension, policy.guess)
        matrix = system.tangent(x, [*stiffness(system, x, self.along, self.slope, tensions)])
        size = jnp.max(jnp.abs(linear.diagonal(matrix)), initial=0.0)
        eps = jnp.where(policy.doubtful | policy.searching, jnp.finfo(x.dtype).eps, 0.0)
        rounding = eps * size + jnp.finfo(x.dtype).tiny
        shift = _SHIFT * jnp.minimum(residual, jnp.max(tensions) + self.load) / length
        shift = jnp.where(policy.interior, policy.damping, shift)
        return linear.plus_diagonal(matrix, jnp.maximum(shift, rounding))

    def taken(
        self,
        system: System,
        x: Float[Array, "n_row n_motion"],
        step: Float[Array, " n_free"],
        length: Float[Array, ""],
    ) -> tuple[Tensions, Float[Array, ""]]:
        """The policy after a step from x, and the part of the step that is taken.

        Args:
            step: solution of the equations.
            length: of elements, m.
        """
        spread, policy = system.space.spread(x, step), self.policy
        longer = lengthened(system, self.along, spread)
        now = self.base + self.slope * longer
        mixed = copy(policy, guess=jnp.maximum(now, 0.0)), jnp.ones_like(length)
        after, part = lax.cond(
            policy.interior,
            lambda: self._inside(now, longer, jnp.max(turned(system, spread)), length),
            lambda: mixed,
        )
        return copy(after, fresh=jnp.zeros((), bool), count=policy.count + 1), part

    def _inside(self, now, longer, widest, length):
        """`taken` of an interior step to tensions `now`, [n], N, before it is cut."""
        policy = self.policy
        change = jnp.where(self.jacked, 0.0, now - policy.tension)
        room = self.gap + self.compliance * change - longer
        wider = jnp.where(self.jacked, 0.0, room - policy.room)
        part_n, part = _inside(policy.tension, change), _inside(policy.room, wider)
        far = widest > _TURN
        part = jnp.minimum(part, jnp.where(far, _TURN / jnp.where(far, widest, 1.0), 1.0))
        shorter = jnp.minimum(part_n, part)
        blocked = jnp.where(shorter < _BLOCKED, policy.blocked + 1, jnp.minimum(policy.blocked, 0))
        after = copy(
            policy,
            tension=policy.tension + part_n * change,
            room=policy.room + part * wider,
            centring=jnp.maximum((1 - shorter) ** 2, _CENTRING[0]),
            damping=self._damping(far, length),
            blocked=blocked.astype(jnp.int32),
        )
        return after, part

    def _damping(self, far, length):
        """Shift for the next interior step: larger after a step that led too far."""
        least = _DAMPING * jnp.max(self.policy.tension) / length
        more = jnp.maximum(_DAMPED * self.policy.damping, least)
        less = self.policy.damping / _DAMPED
        return jnp.where(far, more, jnp.where(less > _UNDAMPED * least, less, 0.0))


def _inside(values, changes):
    """Part of the changes, at most 1, up to which positive values stay positive."""
    falls = changes < 0
    ratio = jnp.where(falls, -values / jnp.where(falls, changes, -1.0), jnp.inf)
    return jnp.minimum(1.0, _INSIDE * jnp.min(ratio, initial=jnp.inf))
