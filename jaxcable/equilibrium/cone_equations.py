"""The linear equations of a step of nets of straight and sliding cables.

Mixed steps (`tensions`), interior steps and steps of the end (both `cones`) differ in the numbers
of one form: a spring of every cable along the change of its length, and one of every piece across.
"""

from __future__ import annotations

from typing import Any

import jax.numpy as jnp
from jax import lax

from .. import linear
from ..common.tree import copy, pytree
from ..common.types import Array, ArrayLike, Bool, Float, PyTree
from ..linear import Matrix
from ..mechanics import pieces
from ..mechanics.assembly import System
from ..mechanics.pulls import Pulls, held
from ..numerics.cones import norm, scaling, wide
from ..spaces.space import Motion
from .newton_step import largest

_BLOCKED = 0.05  # a step shorter than this is blocked by the boundary
_FIRM = 1e-4  # stiffness c over tension per length
_TURN = 0.5  # largest relative motion of the ends of a piece in a step of the end, in lengths
_HIDDEN = 64.0, 4.0  # roundings (eps) of the stiffness of a cable over tension per length
_ROUNDED = 32.0  # the same over roundings (eps) of the tension, at least
_SHIFT = 1e-6  # Levenberg shift over tension per length


@pytree
class Equations:
    """The linear equations of a step.

    They lead to the tensions ``base + slope`` times the change of length. That is the sum over the
    pieces of a cable of ``r c`` times the change of their vectors.

    Attributes:
        policy: `tensions.Tensions` with the numbers that its mode begins with.
        base, slope: tensions without a change of length, and k, [n], N and N/m.
        vector: X of every piece, [n_piece, 3], m.
        stiff, across, ratio, spring: `numerics.cones.Scaling`, or what has its place.
        rhs: right side, [n_free], N.
        guess: tensions that give pieces their stiffness, [n], N.
        held: which cables have a tension that does not follow their length, [n], or None.
        load: largest dead load at a node or force of a jack, N.
        length: of elements, m.
    """

    policy: PyTree[Array]
    base: Float[Array, " n"]
    slope: Float[Array, " n"]
    vector: Float[Array, "n_piece 3"]
    stiff: Float[Array, " n_piece"]
    across: Float[Array, "n_piece 3"]
    ratio: Float[Array, " n_piece"]
    spring: Float[Array, " n_piece"]
    rhs: Float[Array, " n_free"]
    guess: Float[Array, " n"]
    held: Bool[Array, " n"] | None
    load: Float[Array, ""]
    length: Float[Array, ""]

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
        """Return the equations of the next step from x.

        Args:
            policy: `tensions.Tensions`.
            system: `System`.
            x: the point.
            pulls, residual: those of the system at x.
            guess, load, length: as of `Equations`.
        """
        vector = pieces.vectors(system, x)
        size = norm(vector)
        size = jnp.where(size > 0, size, 1.0)
        none = jnp.zeros_like(size)
        mixed = cls(
            policy=policy,
            base=pulls.tension,
            slope=pulls.slope,
            vector=vector,
            stiff=pieces.repeated(system, guess) / size,
            across=vector / wide(size, vector),
            ratio=jnp.ones_like(size),
            spring=none,
            rhs=-residual,
            guess=guess,
            held=held(system),
            load=load,
            length=length,
        )
        given = system, x, pulls, size
        return lax.cond(policy.bounded, lambda: mixed._interior_or_end(*given), lambda: mixed)

    def _interior_or_end(self, system, x, pulls, size):
        """Those of an interior step or of the end, where these are those of a mixed step."""
        policy = self.policy
        inner = policy.inner
        inner = lax.cond(policy.fresh, lambda: inner.begun(self, system, x), lambda: inner)
        new = copy(self, policy=copy(policy, inner=inner))
        guess = jnp.where(policy.interior, inner.tension, policy.guess)
        under = pulls.under(system, jnp.maximum(guess, 0.0))
        given = system, guess, under.gap, under.compliance
        ways = (lambda: new._interior(*given)), (lambda: new._end(*given, size))
        new, pull = lax.cond(policy.interior, *ways)
        unbalanced = system.external_force(x) - pieces.at_nodes(system, pull)
        return copy(new, rhs=system.space.collected(unbalanced, x))

    def _interior(self, system, tension, gap, compliance):
        """Those of an interior step, and V of a step without motion, [n_piece, 3], N."""
        inner = self.policy.inner
        single = pieces.repeated(system, tension)
        points = inner.room + norm(self.vector), self.vector, single, inner.pull
        scaled = scaling(*points, inner.room, inner.rest)
        lacks = gap - pieces.total(system, inner.room)
        slope = 1 / (compliance + pieces.total(system, scaled.spring))
        if self.held is not None:
            slope = jnp.where(self.held, 0.0, slope)
        wider = pieces.total(system, scaled.spring * (inner.force - single))
        base = tension + slope * (wider - lacks)
        away = pieces.repeated(system, base) - inner.force
        pull = wide(scaled.ratio * away, inner.pull) * scaled.across - inner.back
        return copy(self, base=base, slope=slope, **scaled._asdict()), pull

    def _end(self, system, guess, gap, compliance, size):
        """Those of a step of the end, from tensions that may be compressions; forces likewise."""
        policy, eps = self.policy, jnp.finfo(gap.dtype).eps
        force_per_length = policy.inner.measure / self.length
        firm = _FIRM * force_per_length / policy.near
        positive = jnp.maximum(guess, 0.0)
        lacks = gap + compliance * (guess - positive)
        stiff = jnp.where(compliance > 0, 1 / compliance, self.slope)  # 0 on a plateau of the law
        # rounding of more would hide what the tensions resist; a softer law ends at the same point
        limit, growth = _HIDDEN
        most = force_per_length * (growth ** policy.count.astype(gap.dtype) / (limit * eps))
        stiff = jnp.minimum(stiff, most)
        active = guess > jnp.minimum(firm, stiff) * lacks
        inactive = none = jnp.zeros_like(gap)
        if self.held is not None:
            active, inactive = active & ~self.held, jnp.where(self.held, self.base, 0.0)
        base = lax.select(active, positive - stiff * gap, inactive)
        tension = lax.select(active, positive, inactive)
        new = copy(
            self,
            base=base,
            slope=lax.select(active, stiff, none),
            stiff=pieces.repeated(system, tension) / size,
            guess=tension,
        )
        return new, wide(pieces.repeated(system, base), self.across) * self.across

    def matrix(self, system: System, x: Motion, residual: Float[Array, ""]) -> Matrix:
        """Return the matrix of the equations, regularised; `residual` is the largest, N."""
        policy = self.policy
        blocks = pieces.matrices(system, self.slope, self.stiff, self.across, self.ratio)
        matrix = system.tangent(x, [*blocks])
        size = largest(linear.diagonal(matrix))
        force = jnp.max(self.guess) + self.load
        # of what rounds the forces, nodes without stiffness move some part of a length
        least = _ROUNDED * jnp.finfo(force.dtype).eps * force
        shift = jnp.maximum(_SHIFT * jnp.minimum(residual, force), least) / self.length
        shift = jnp.where(policy.interior, 0.0, shift)
        eps, tiny = jnp.finfo(size.dtype).eps, jnp.finfo(size.dtype).tiny
        rounding = policy.roundings * (eps * size) + tiny
        return linear.plus_diagonal(matrix, jnp.maximum(shift, rounding))

    def taken(
        self,
        system: System,
        x: Motion,
        step: Float[Array, " n_free"],
        definite: Bool[Array, ""],
    ) -> tuple[Any, Float[Array, ""], Bool[ArrayLike, ""]]:
        """Return the policy after a step from x.

        And the part of the step that is taken, and whether this has only been predicted.

        Args:
            system: `System`.
            x: the point.
            step: solution of the equations.
            definite: whether their matrix is.
        """
        policy = self.policy
        moved = pieces.differences(system, system.space.spread(x, step))
        across = jnp.sum(self.across * moved, axis=-1)
        now = self.base + self.slope * pieces.total(system, self.ratio * across)

        def newton_step():
            far = jnp.max(norm(moved)) / (_TURN * self.length)
            part = jnp.where(policy.last, 1 / jnp.maximum(far, 1.0), 1.0)
            guess = jnp.where(policy.last, now, jnp.maximum(now, 0.0))
            return copy(policy, guess=guess, count=policy.count + 1), part, jnp.zeros((), bool)

        def interior_step():
            given = self, system, now, across, moved, definite
            inner, part, first = policy.inner.stepped(*given)
            short = jnp.where(part < _BLOCKED, policy.blocked + 1, jnp.minimum(policy.blocked, 0))
            blocked = jnp.where(first, policy.blocked, short)
            count = policy.count + ~first
            return copy(policy, inner=inner, blocked=blocked, count=count), part, first

        after, part, predicted = lax.cond(policy.interior, interior_step, newton_step)
        return copy(after, fresh=jnp.zeros((), bool)), part, predicted
