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

*Interior*: an interior-point method, whose number of steps hardly depends on EA/N: a second-order
cone for every straight piece of linear cables (`cones`), or in nets with hanging cables and other
laws, and in float32, a bound on every length (`hung`).

The iteration is mixed as long as the residual falls; then interior, from the start of the
increment; near the end mixed again, or with cones by steps of their own, because interior steps
become inaccurate where slack and taut cannot be told apart; and if all of this fails, plain Newton
steps with a line search. Nets with cones begin with the interior iteration where no cable has
tension, because mixed steps do not help there, and leave mixed steps early.

Source: Magisano, Leonetti, Garcea, "How to improve efficiency and robustness of the Newton method
in geometrically non-linear structural problem discretized via displacement-based finite elements"
(2017).
"""

from __future__ import annotations

from typing import Any

import jax.numpy as jnp

from ..common.tree import copy, pytree, where
from ..common.types import Array, ArrayLike, Bool, Float, Int
from ..mechanics.assembly import System
from ..mechanics.pieces import all_fit_cones
from ..mechanics.pulls import Pulls, held, rest_lengths
from ..spaces.space import Motion
from . import cone_equations, hung
from .cones import Cones
from .hung import Hung
from .newton_step import largest

MIXED, INTERIOR, LAST, SEARCH = range(4)

# steps within which the residual must halve, and all: mixed, at the end, and at the end with cones
# (there all mixed steps, too)
_PATIENCE, _LONGEST = (8, 4, 14), (60, 20, 25)
_EARLY = 5, 0.3  # steps after which a residual over this part of the scale ends a mode
_SLACK = 1e-3  # tension over load up to which cables are slack at the start
_DOUBTS = 3  # times that a matrix gets a larger shift until it is definite
_PLAIN = 3.0  # tension over (predicted tension + load) up to which it makes the stiffness itself
_BEGINNING = 2  # first steps, whose residuals begin anew: what starts in balance must leave it


@pytree
class Tensions:
    """Tensions as unknowns, and what the iteration does with them.

    Attributes:
        mode: `MIXED`, `INTERIOR`, `LAST` or `SEARCH`.
        guess: tensions for the geometric stiffness of mixed steps, [n], N, of all groups.
        inner: state of the interior iteration.
        fresh: whether the mode begins at its next step.
        best: smallest residual since the mode began, N.
        since, count: steps since it was halved, and since the mode began; after an end that has
            failed, the count goes on.
        blocked: interior steps in succession that a bound has blocked.
        near: what may be left (`Ending.measure`) where the end is tried.
        tries: how often it was.
        inside: point of the interior iteration, while the end is tried.
        doubtful: how often rounding has left a matrix of the mode indefinite.
    """

    mode: Int[Array, ""]
    guess: Float[Array, " n"]
    inner: Cones | Hung
    fresh: Bool[Array, ""]
    best: Float[Array, ""]
    since: Int[Array, ""]
    count: Int[Array, ""]
    blocked: Int[Array, ""]
    near: Float[Array, ""]
    tries: Int[Array, ""]
    inside: Motion
    doubtful: Int[Array, ""]

    @classmethod
    def init(cls, system: System, x: Motion) -> Tensions:
        """Return the start: mixed."""
        zero, first = jnp.zeros((), x.dtype), jnp.int32(0)
        # in float32 the slacks of cones lose their digits before the end is near
        cones = all_fit_cones(system) and jnp.finfo(x.dtype).eps < 1e-12
        kind = Cones if cones else Hung
        return cls(
            mode=jnp.int32(MIXED),
            guess=jnp.zeros_like(rest_lengths(system)),
            inner=kind.init(system, x),
            fresh=jnp.ones((), bool),
            best=jnp.full_like(zero, jnp.inf),
            since=first,
            count=first,
            blocked=first,
            near=jnp.full_like(zero, kind.near),
            tries=first,
            inside=x,
            doubtful=first,
        )

    @property
    def searching(self) -> Bool[Array, ""]:
        """Whether steps are plain Newton steps with a line search."""
        return self.mode == SEARCH

    @property
    def interior(self) -> Bool[Array, ""]:
        """Whether the iteration is interior."""
        return self.mode == INTERIOR

    @property
    def bounded(self) -> Bool[Array, ""]:
        """Whether matrices differ too much from each other for conjugate gradients."""
        return (self.interior | self.last) if isinstance(self.inner, Cones) else self.interior

    @property
    def halfway(self) -> Bool[ArrayLike, ""]:
        """Whether a step has been predicted that is to be corrected."""
        return self.interior & self.inner.predicted if isinstance(self.inner, Cones) else False

    @property
    def last(self) -> Bool[Array, ""]:
        """Whether the end of an interior iteration is tried."""
        return self.mode == LAST

    @property
    def roundings(self) -> Int[Array, ""]:
        """What rounding may make of no stiffness, in roundings (eps) of the largest stiffness."""
        return jnp.where(self.searching, 1, self.doubtful**6)  # 0, 1, 64, 729

    def steered(
        self,
        x: Motion,
        begin: Motion,
        found: Bool[Array, ""],
        residual: Float[Array, ""],
        scale: Float[Array, ""],
        astray: Bool[Array, ""],
        length: Float[Array, ""],
    ) -> tuple[Tensions, Motion, Bool[Array, ""]]:
        """Return the mode after a step.

        Args:
            x, begin: the point reached, and the start of the increment.
            found: whether the step led to finite forces.
            residual, scale: largest residual at x and the force it is judged by, N.
            astray: whether the point is far from the structure.
            length: of elements, m.

        Returns:
            The policy, the point to go on from, whether this is another one than x.
        """
        mixed, last, interior = self.mode == MIXED, self.last, self.interior
        halved = found & (self.fresh | (residual < 0.5 * self.best))
        best = jnp.where(halved | (mixed & (self.count <= _BEGINNING)), residual, self.best)
        since = jnp.where(halved, 0, self.since + 1)
        lost = astray | ~found
        if isinstance(self.inner, Cones):
            early = (self.count >= _EARLY[0]) & (residual > _EARLY[1] * scale)
            early = early | (since >= jnp.where(mixed, _PATIENCE[0], _PATIENCE[2]))
            lost = lost | early | (self.count >= _LONGEST[2])
        else:
            patience, longest = (jnp.where(mixed, *pair) for pair in (_PATIENCE[:2], _LONGEST[:2]))
            lost = lost | (since >= patience) | (self.count >= longest)
        begins, returns = mixed & lost, last & lost
        ending = self.inner.ending(self, found, since, residual / scale, length)
        ends = interior & ending.now
        searches = returns & (self.tries >= self.inner.tries)
        if ending.lost is not None:
            searches = searches | (interior & ending.lost)
        mode = jnp.where(ends, LAST, self.mode)  # fewer kernels than `jnp.select`
        mode = jnp.where(searches, SEARCH, jnp.where(begins | returns, INTERIOR, mode))
        changed = mode != self.mode
        tries = self.tries + 1
        if ending.final is not None:
            tries = jnp.where(ending.final, self.inner.tries, tries)
        after = copy(
            self,
            mode=mode,
            guess=where(ends, self.inner.tension, self.guess),
            fresh=(begins | searches) | (self.fresh & ~changed),
            best=jnp.where(changed, residual, best),
            since=jnp.where(changed, 0, since),
            count=jnp.where(changed & ~returns, 0, self.count),
            blocked=jnp.where(ends, jnp.where(ending.stuck, -4, 0), self.blocked),
            near=jnp.where(ends, 0.1 * jnp.minimum(self.near, ending.measure), self.near),
            tries=jnp.where(ends, tries, self.tries),
            inside=where(ends, x, self.inside),
            doubtful=jnp.where(changed, 0, self.doubtful),
        )
        x = where(begins, begin, where(returns, self.inside, x))
        return after, x, begins | returns

    def repeated_if_indefinite(
        self, taken: Tensions, definite: Bool[Array, ""]
    ) -> tuple[Tensions, Bool[Array, ""]]:
        """Return the policy after a step, and whether to make the step again.

        That is with a shift above what rounding may have made of no stiffness, if its matrix was
        not `definite`. If it was, the policy is `taken`.
        """
        again = ~definite & (self.doubtful < _DOUBTS) & ~self.searching
        return where(again, copy(self, doubtful=self.doubtful + 1), taken), again

    def equations(
        self,
        system: System,
        x: Motion,
        pulls: Pulls,
        residual: Float[Array, " n_free"],
        length: Float[Array, ""],
    ) -> cone_equations.Equations | hung.Equations:
        """Return the linear equations of the next step from x.

        Args:
            system: `System`.
            x: the point.
            pulls, residual: those of the system at x.
            length: of elements, m.
        """
        load, tension = jnp.max(jnp.abs(system.external_force(x)), initial=0.0), pulls.tension
        if (jacked := held(system)) is not None:
            load = jnp.maximum(load, jnp.max(jnp.where(jacked, tension, 0.0)))
        guess = where(self.fresh | self.searching, tension, self.guess)
        guess = jnp.where(tension <= _PLAIN * (guess + load), tension, guess)
        policy = copy(self, best=jnp.where(self.fresh, largest(residual), self.best))
        kind: Any = hung
        if isinstance(self.inner, Cones):
            kind = cone_equations
            slack = self.fresh & (self.mode == MIXED) & (jnp.max(tension) <= _SLACK * load)
            mode = jnp.where(slack, INTERIOR, self.mode)
            policy = copy(policy, mode=mode)
        return kind.Equations.of(policy, system, x, pulls, residual, guess, load, length)
