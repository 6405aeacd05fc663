"""Tensions of cables as unknowns beside the displacements, so that stiff nets converge.

A step sideways lengthens a cable in second order. Where EA is large, the force EA e at the next
point is then larger than the true tension by orders of magnitude, and so is the geometric stiffness
N/l that resists the next step sideways: the iteration creeps. Two remedies keep the tension N of
every cable as a number of its own, which follows the linear equations of a step. Both solve one
system of the size of the tangent per step,

    (sum of k g g^T + N hess(l)) p = F - sum of B g,     N_new = B + k g.p,     g = grad(l),

with the length l of a cable (over all pieces of a sliding one) and its elastic law N = D(l).

*Mixed*: ``B = D(l)``, ``k = D'(l)``: Newton's method, but with the geometric stiffness of the
tension that the step before predicts (Magisano, Leonetti, Garcea 2017). Few steps, often; no
guarantee.

*Interior*: a cable is a bound on its length, ``l <= L(N)`` with the length L(N) that it has under
the tension N, and the room y that is left: ``N >= 0, y >= 0, N y = 0``. An interior-point method
follows ``N y = m`` as m goes to zero. Eliminating y and N from the linear equations gives

    w = y + N L'(N),     k = N / w,     B = N + (m - N (L(N) - l)) / w.

A taut cable (y to 0) has k = 1/L' = D', a slack one (N to 0) none; in between a cable is softened
by a spring of compliance y/N of its own. The number of steps hardly depends on EA/N.

The iteration is mixed as long as the residual falls; then interior, from the start of the
increment; near the end mixed again, because interior steps become inaccurate where slack and taut
cannot be told apart; and if all of this fails, plain Newton steps with a line search.

Sources: Magisano, Leonetti, Garcea, "How to improve efficiency and robustness of the Newton method
in geometrically non-linear structural problem discretized via displacement-based finite elements"
(2017); Wright, "Primal-dual interior-point methods" (1997).
"""

from __future__ import annotations

import jax.numpy as jnp

from .. import linear
from ..common.tree import copy, pytree, where
from ..common.types import Array, Bool, Float, Int
from ..elements.prestress import of_each
from ..linear import Matrix
from ..mechanics.assembly import System
from ..mechanics.strings import PerGroup, Strings

MIXED, INTERIOR, LAST, SEARCH = range(4)

_PATIENCE = 8, 4  # evaluations within which the residual must halve: mixed, and at the end
_LONGEST = 60, 20  # mixed steps, and at the end
_INTERIOR = 100  # interior steps
_TRIES = 5  # how often the end is tried
_NEAR = 1e-5  # relative residual from which the end is tried
_SHIFT = 1e-6  # Levenberg shift over tension per length
_ROUNDING = 1.0
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
        guess: tensions for the geometric stiffness of mixed steps, per group [n_elem], N.
        tension, room: N and y of the interior iteration, per group [n_elem], N and m.
        centring: m of the next interior step over the present mean of N y.
        damping: shift of the matrix of interior steps, N/m: more after a step that was too long.
        fresh: whether the mode begins at its next step.
        best: smallest residual since the mode began, N.
        since, count: steps since it was halved, and since the mode began.
        blocked: interior steps in succession that a bound has blocked.
        near: relative residual at which the end is tried.
        tries: how often it was.
        inside: point of the interior iteration, while the end is tried.
    """

    mode: Int[Array, ""]
    guess: PerGroup
    tension: PerGroup
    room: PerGroup
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

    @classmethod
    def init(cls, system: System, x: Float[Array, "n_row n_motion"]) -> Tensions:
        """The start: mixed."""
        none = [jnp.zeros(len(group.links), x.dtype) for group in system.groups]
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
        return ~self.fresh & (residual < 0.5 * self.best)

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
        best = jnp.where(halved, residual, self.best)
        since = jnp.where(halved, 0, self.since + 1)
        patience, longest = (jnp.where(mixed, *pair) for pair in (_PATIENCE, _LONGEST))
        lost = (mixed | last) & ((since >= patience) | (self.count >= longest) | astray | ~found)
        begins, returns = mixed & lost, last & lost
        stuck = self.blocked >= 2
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
            inside=jnp.where(ends, x, self.inside),
        )
        x = jnp.where(begins, begin, jnp.where(returns, self.inside, x))
        return after, x, begins | returns

    def equations(
        self,
        system: System,
        x: Float[Array, "n_row n_motion"],
        strings: Strings,
        residual: Float[Array, " n_free"],
    ) -> Equations:
        """The linear equations of the next step from x.

        `strings` and `residual` are those of the system at x.
        """
        forces, slopes = strings.force, strings.slope
        held = [jnp.where(_held(s), n, 0.0) for s, n in zip(system.states, forces, strict=True)]
        load = jnp.maximum(jnp.max(jnp.abs(system.load), initial=0.0), _largest(held))
        first = jnp.maximum(load, _UNLOADED * _largest(forces))
        guess = where(self.fresh | self.searching, forces, self.guess)
        started = [jnp.clip(force, *(part * first for part in _FORCE)) for force in forces]
        tension = where(self.fresh & self.interior, started, self.tension)
        rooms, compliances = _rooms(system, strings, tension)
        least = [_ROOM * state.rest_length for state in system.states]
        wide = [jnp.maximum(*pair) for pair in zip(rooms, least, strict=True)]
        room = where(self.fresh & self.interior, wide, self.room)
        free = [~_held(state) for state in system.states]
        product = [jnp.where(f, n * y, 0.0) for f, n, y in zip(free, tension, room, strict=True)]
        count = sum(jnp.sum(f) for f in free)
        target = self.centring * sum(jnp.sum(p) for p in product) / jnp.maximum(count, 1)
        base, slope = [], []
        for k, (n, y) in enumerate(zip(tension, room, strict=True)):
            width = y + n * compliances[k]
            width = jnp.where(width > 0, width, 1.0)
            inside = free[k] & self.interior
            base.append(jnp.where(inside, n + (target - n * rooms[k]) / width, forces[k]))
            slope.append(jnp.where(inside, n / width, slopes[k]))
        geometric = where(self.interior, tension, guess)
        best = jnp.where(self.fresh, jnp.max(jnp.abs(residual), initial=0.0), self.best)
        # mixed steps have the residual of the structure on the right side
        across = strings.residual(system, x, base)
        return Equations(
            base=base,
            slope=slope,
            strings=strings,
            geometric=geometric,
            rhs=-jnp.where(self.interior, across, residual),
            rooms=rooms,
            compliances=compliances,
            load=load,
            policy=copy(self, guess=guess, tension=tension, room=room, best=best),
        )


@pytree
class Equations:
    """The linear equations of a step.

    Attributes:
        base, slope: B and k of every element, per group [n_elem], N and N/m.
        strings: `Strings` at the point.
        geometric: tensions of the geometric stiffness, per group [n_elem], N.
        rhs: right side, [n_free], N.
        rooms, compliances: L(N) - l and L'(N), per group [n_elem], m and m/N.
        load: largest dead load at a node, N.
        policy: `Tensions` with the numbers that its mode begins with.
    """

    base: PerGroup
    slope: PerGroup
    strings: Strings
    geometric: PerGroup
    rhs: Float[Array, " n_free"]
    rooms: PerGroup
    compliances: PerGroup
    load: Float[Array, ""]
    policy: Tensions

    def matrix(
        self,
        system: System,
        x: Float[Array, "n_row n_motion"],
        residual: Float[Array, ""],
        length: Float[Array, ""],
    ) -> Matrix:
        """Matrix of the equations, regularised; `residual` the largest, `length` of elements."""
        blocks = self.strings.stiffness(system, x, self.slope, self.geometric)
        matrix = system.tangent(x, blocks)
        largest = jnp.max(jnp.abs(linear.diagonal(matrix)), initial=0.0)
        rounding = _ROUNDING * jnp.finfo(x.dtype).eps * largest + jnp.finfo(x.dtype).tiny
        shift = _SHIFT * jnp.minimum(residual, _largest(self.geometric) + self.load) / length
        return linear.plus_diagonal(
            matrix,
            jnp.maximum(jnp.where(self.policy.interior, self.policy.damping, shift), rounding),
        )

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
        policy, spread = self.policy, system.space.spread(x, step)
        guess, dn, dy = [], [], []
        widest = jnp.zeros((), x.dtype)
        for k, (group, state) in enumerate(zip(system.groups, system.states, strict=True)):
            longer = jnp.sum(self.strings.along[k] * spread[group.links][..., :3], axis=(1, 2))
            now = self.base[k] + self.slope[k] * longer
            guess.append(jnp.maximum(now, 0.0))
            change = jnp.where(_held(state), 0.0, now - policy.tension[k])
            room = self.rooms[k] + self.compliances[k] * change - longer
            dn.append(change)
            dy.append(jnp.where(_held(state), 0.0, room - policy.room[k]))
            apart = jnp.diff(spread[group.links][..., :3], axis=1)
            piece = state.rest_length / apart.shape[1]
            turned = jnp.max(jnp.sqrt(jnp.sum(apart**2, axis=-1)), axis=1) / piece
            widest = jnp.maximum(widest, jnp.max(turned))
        part_n, part = _inside(policy.tension, dn), _inside(policy.room, dy)
        far = widest > _TURN
        part = jnp.minimum(part, jnp.where(far, _TURN / jnp.where(far, widest, 1.0), 1.0))
        least = _DAMPING * _largest(policy.tension) / length
        more = jnp.maximum(_DAMPED * policy.damping, least)
        less = policy.damping / _DAMPED
        damping = jnp.where(far, more, jnp.where(less > _UNDAMPED * least, less, 0.0))
        interior, shorter = policy.interior, jnp.minimum(part_n, part)
        tension = [n + part_n * d for n, d in zip(policy.tension, dn, strict=True)]
        room = [y + part * d for y, d in zip(policy.room, dy, strict=True)]
        blocked = jnp.where(shorter < _BLOCKED, policy.blocked + 1, jnp.minimum(policy.blocked, 0))
        after = copy(
            policy,
            guess=where(interior, policy.guess, guess),
            tension=where(interior, tension, policy.tension),
            room=where(interior, room, policy.room),
            centring=jnp.where(
                interior, jnp.maximum((1 - shorter) ** 2, _CENTRING[0]), policy.centring
            ),
            damping=jnp.where(interior, damping, policy.damping),
            blocked=jnp.where(interior, blocked, policy.blocked).astype(jnp.int32),
            fresh=jnp.zeros((), bool),
            count=policy.count + 1,
        )
        return after, jnp.where(interior, part, 1.0)


def _rooms(system, strings, tensions):
    """L(N) - l and L'(N) of all elements, two lists of [n_elem]."""
    pairs = [
        of_each("room", group, state, tension, strain)
        for group, state, tension, strain in zip(
            system.groups, system.states, tensions, strings.strain, strict=True
        )
    ]
    return [list(values) for values in zip(*pairs, strict=True)]


def _held(state):
    """Which elements a jack holds, [n_elem]."""
    if state.jack_force is None:
        return jnp.zeros(state.rest_length.shape, bool)
    return jnp.ones(state.rest_length.shape, bool) if state.jacked is None else state.jacked


def _largest(arrays):
    return jnp.max(jnp.concatenate(arrays), initial=0.0)


def _inside(values, changes):
    """Part of the changes, at most 1, up to which positive values stay positive."""
    value, change = jnp.concatenate(values), jnp.concatenate(changes)
    ratio = jnp.where(change < 0, -value / jnp.where(change < 0, change, -1.0), jnp.inf)
    return jnp.minimum(1.0, _INSIDE * jnp.min(ratio, initial=jnp.inf))
