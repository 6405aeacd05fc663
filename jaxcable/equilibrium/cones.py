"""Interior-point method for nets of straight and sliding cables: one cone per straight piece.

The energy is a function of lengths alone. With a bound u of the length of each straight piece,
whose vector X is linear in the displacements, equilibrium is a second-order cone program,

    minimise  sum of Phi(sum of u) - F.x    such that    |X| <= u,        N = Phi'(sum of u).

The force V that a piece has at its end and the tension N of its cable are multipliers: (u, X) and
(N, -V) are in the cone ``v0 >= |v1|``, and complementary. A step follows the linear equations of

    balance   sum of V at nodes = F
    law       sum of u over the pieces of a cable = L(N)       (held by a jack: N is stated instead)
    cone      (u, X) o (N, -V) = m (1, 0)                      (Jordan product)

as m goes to zero. At the end taut pieces have ``u = |X|`` and ``V = N X/|X|``, slack ones N = 0.
The law is linear (at the kink of one that is not, steps wander): then only the product is
linearised, and nothing of the geometry. How many steps that takes grows little with the size of a
net, and hardly with how much of it is slack, nor with EA/N. With the scaling of `numerics.cones`,
all but the displacements is eliminated cable by cable. What remains is a matrix of the form of the
tangent,

    sum over cables of k h h' + sum over pieces of q (I - c c'),         k = 1 / (L'(N) + sum of b).

An iteration is half a step: the first one predicts, with the aim m = 0; the second, which has the
same matrix, corrects for the products of changes, with an aim m that follows from how far the
prediction could go (Mehrotra 1992). All unknowns go the same part of the way to the boundary.

The *end* takes the last digits by Newton's method on the cables that are active. A cable is, if its
tension outweighs what it lacks in length: ``N > min(c, 1/L'(N)) (L(N) - l)`` with a stiffness c of
the net. (By its length alone a stiff cable would slacken that is too short by a rounding error.)

Sources: Lobo, Vandenberghe, Boyd, Lebret, "Applications of second-order cone programming" (1998);
Nesterov, Todd, "Primal-dual interior-point methods for self-scaled cones" (1998); Mehrotra, "On
the implementation of a primal-dual interior point method" (1992); Andersen, Roos, Terlaky, "On
implementing a primal-dual interior-point method for conic quadratic optimization" (2003).
"""

from __future__ import annotations

from typing import Any, ClassVar

import jax.numpy as jnp
from jax import lax

from ..common.tree import copy, pytree
from ..common.types import Array, Bool, Float, Int
from ..mechanics import pieces
from ..mechanics.assembly import System
from ..mechanics.pulls import rest_lengths
from ..numerics.cones import (
    Scaling,
    correction,
    norm,
    products,
    rate_to_boundary,
    slack_after,
    wide,
)
from ..spaces.space import Motion
from .ending import Ending

_LONGEST = 100  # interior steps
_ENDED = 0.77  # power of eps, m over tension and length from which the end is tried
_STUCK = 1e-6, 10.0  # m, and m over that of the end, below which two blocked steps end it, too
_UNLOADED = 1e-3  # the load that stands for none, over the largest tension at the start
_WIDE = 0.1  # by how much bounds exceed lengths at the start, in unstressed lengths
_INSIDE = 0.98  # part of the way to the boundary that a step may go
_CENTRING = 1e-6  # least m of a predicted step over that of its start


@pytree
class Cones:
    """State of the interior-point method.

    Attributes:
        tension: N, [n], N.
        pull: V, [n_piece, 3], N.
        room, rest: the slacks ``u - |X|`` and ``N - |V|``, [n_piece], m and N; positive.
        force, back: what the prediction adds to the equations of the products, a point
            for every piece, [n_piece] and [n_piece, 3], N.
        predicted: whether a step has been predicted, so that the next one is to be corrected.
        load: load, jack force or part of the tension at the start: the force that measures, N.
        product: mean of ``u N - X.V``, N m.
        aim: mean m that the next step aims at, less that of the products of changes, N m.
    """

    tension: Float[Array, " n"]
    pull: Float[Array, "n_piece 3"]
    room: Float[Array, " n_piece"]
    rest: Float[Array, " n_piece"]
    force: Float[Array, " n_piece"]
    back: Float[Array, "n_piece 3"]
    predicted: Bool[Array, ""]
    load: Float[Array, ""]
    product: Float[Array, ""]
    aim: Float[Array, ""]

    near: ClassVar[float] = 1.0  # m over that at which the end is tried
    tries: ClassVar[int] = 3  # how often the end is tried
    least: ClassVar[int] = -1  # as `limit` of `linear.solve_next`: pivots may have few digits

    @classmethod
    def init(cls, system: System, x: Motion) -> Cones:
        """Return the state before the method begins: zeros."""
        n = sum(len(group.links) for group in system.groups)
        number, vector = (jnp.zeros(s, x.dtype) for s in pieces.shapes(system))
        none, zero, no = jnp.zeros(n, x.dtype), jnp.zeros((), x.dtype), jnp.zeros((), bool)
        return cls(none, vector, number, number, number, vector, no, zero, zero, zero)

    @property
    def measure(self) -> Float[Array, ""]:
        """The force that measures what is left, N."""
        return jnp.maximum(jnp.max(self.tension), self.load)

    def begun(self, equations: Any, system: System, x: Motion) -> Cones:
        """Return the start: cables without force, all alike, in bounds that leave them room."""
        size, base, load = norm(equations.vector), equations.base, equations.load
        load = jnp.where(load > 0, load, _UNLOADED * jnp.max(base))
        loads = jnp.sum(jnp.abs(system.space.collected(system.external_force(x), x)))
        tension = jnp.full_like(base, jnp.maximum(load, jnp.sqrt(load * loads)))
        if equations.held is not None:
            least = jnp.finfo(x.dtype).eps * load  # a jack may have no force
            tension = jnp.where(equations.held, jnp.maximum(base, least), tension)
        rest = rest_lengths(system)
        room = _WIDE * rest + jnp.maximum(rest - pieces.total(system, size), 0.0)
        room, of_pieces = pieces.shared(system, room), pieces.repeated(system, tension)
        return copy(
            self,
            tension=tension,
            pull=jnp.zeros_like(self.pull),
            room=room,
            rest=of_pieces,
            force=jnp.zeros_like(size),
            back=jnp.zeros_like(self.pull),
            predicted=jnp.zeros((), bool),
            load=load,
            product=pieces.mean(system, (room + size) * of_pieces),
            aim=jnp.zeros_like(load),
        )

    def ending(
        self,
        policy: Any,
        found: Bool[Array, ""],
        since: Int[Array, ""],
        relative: Float[Array, ""],
        length: Float[Array, ""],
    ) -> Ending:
        """Return whether to try the end; the true residual says little; arguments as of `Hung`."""
        least = float(jnp.finfo(relative.dtype).eps) ** _ENDED
        left = self.product / (least * length * self.measure)
        most = max(_STUCK[0] / least, _STUCK[1])
        stuck = (policy.blocked >= 2) & (left < most)
        final = ~found | (policy.count >= _LONGEST)
        return Ending((left <= policy.near) | stuck | final, stuck, left, final=final)

    def stepped(
        self,
        equations: Any,
        system: System,
        now: Float[Array, " n"],
        across: Float[Array, " n_piece"],
        moved: Float[Array, "n_piece 3"],
        definite: Bool[Array, ""],
    ) -> tuple[Cones, Float[Array, ""], Bool[Array, ""]]:
        """Return the state after half a step, the part that is taken, and if it was the first half.

        Args:
            equations: `cone_equations.Equations` of the step.
            system: `System`.
            now: tensions to which the whole step leads, [n], N.
            across: changes of vectors along c, [n_piece], m.
            moved: changes of vectors, [n_piece, 3], m.
            definite: whether the matrix of the equations is.
        """
        at, v = equations.vector, self.pull
        u, tension = self.room + norm(at), pieces.repeated(system, self.tension)
        after = pieces.repeated(system, now)
        away, longer = after - self.force, equations.ratio * across
        wider = pieces.real(system, longer - equations.spring * away)
        along = wide(equations.ratio * away - equations.stiff * across, v)
        pull = along * equations.across + wide(equations.stiff, v) * moved - self.back
        more, change = after - tension, pull - v
        first = rate_to_boundary(u, at, self.room, wider, moved)
        second = rate_to_boundary(tension, v, self.rest, more, change)
        inside = jnp.where(self.predicted, _INSIDE, 1.0)
        rate = jnp.maximum(first, second)
        part = inside / jnp.maximum(rate, inside)
        beyond = products(wider, moved, more, change)
        mean = pieces.mean(system, beyond)
        product = self.product + part * (self.aim - self.product + part * mean)

        def predicted():
            left = jnp.maximum(_CENTRING, product / self.product)
            m = jnp.minimum(left * left * left, 1.0) * self.product
            scaled = Scaling(equations.stiff, equations.across, equations.ratio, equations.spring)
            second, steps = (tension, v, self.rest), (wider, moved, more, change)
            force, back = correction(scaled, second, steps, m - beyond)
            new = copy(self, force=force, back=back, aim=m - mean, predicted=~self.predicted)
            return new, jnp.zeros_like(part)

        def taken():
            return copy(
                self,
                tension=self.tension + part * (now - self.tension),
                pull=v + part * change,
                room=slack_after(at, self.room, wider, moved, part),
                rest=slack_after(v, self.rest, more, change, part),
                force=jnp.zeros_like(u),
                back=jnp.zeros_like(v),
                predicted=~self.predicted,
                product=product,
                aim=jnp.zeros_like(part),
            ), part

        sound = definite & jnp.isfinite(rate)
        kind = jnp.where(sound, jnp.where(self.predicted, 2, 1), 0)
        # without a part that can be taken the step is of no use, and the end is tried
        nothing = self, jnp.full_like(part, jnp.nan)
        new, part = lax.switch(kind, [lambda: nothing, predicted, taken])
        return new, part, sound & new.predicted
