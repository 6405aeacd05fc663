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

An iteration is half a step: the first one is a predictor, with the target m = 0; the second, a
corrector with the same matrix, accounts for the products of changes, with a target m that follows
from how far the predictor could go (Mehrotra 1992). All unknowns go the same part of the way to the
boundary.

*Finishing steps* take the last digits by Newton's method on the active set of cables. A cable is
active if its tension outweighs what it lacks in length: ``N > min(c, 1/L'(N)) (L(N) - l)`` with a
stiffness c of the net. (By length alone, a stiff cable that is too short by a rounding error would
go slack.)

Sources: Lobo, Vandenberghe, Boyd, Lebret, "Applications of second-order cone programming" (1998);
Nesterov, Todd, "Primal-dual interior-point methods for self-scaled cones" (1998); Mehrotra, "On
the implementation of a primal-dual interior point method" (1992); Andersen, Roos, Terlaky, "On
implementing a primal-dual interior-point method for conic quadratic optimization" (2003).
"""

from __future__ import annotations

from typing import Any, ClassVar

import jax.numpy as jnp
from jax import lax

from ..common.tree import copy_with, pytree
from ..common.types import Array, Bool, Float, Int
from ..mechanics import pieces
from ..mechanics.assembly import System
from ..mechanics.tension_responses import rest_lengths
from ..numerics.cones import (
    ConeScaling,
    inverse_step_to_boundary,
    lorentz_products,
    norm,
    repeat_for_vectors,
    second_order_corrector,
    slack_after_step,
)
from ..spaces.space import Motion
from .interior_methods import MAX_INTERIOR_STEPS, UNLOADED, FinishDecision

# Power of eps: m over tension and length from which finishing steps are tried. With a larger power
# interior steps run out of digits, with a smaller one the active set is not yet clear.
_FINISH_POWER = 0.77
_STUCK = 1e-6, 10.0  # m, and m over that of the finish, below which two blocked steps end it, too
_INITIAL_SLACK = 0.1  # by how much bounds exceed lengths at the start, in unstressed lengths
_TO_BOUNDARY = 0.98  # fraction of the way to the boundary that a step may go
_MIN_CENTERING = 1e-6  # least m of a predictor step over that of its start


@pytree
class ConicInteriorPointState:
    """State of the interior-point method with a second-order cone for every straight piece.

    Letters are those of the module: u is the bound of a piece's length, X its vector, N the tension
    of its cable, V the force at its end.

    Attributes:
        tension: tensions N, [n], N.
        pull: forces V, [n_piece, 3], N.
        length_slack: ``u - |X|``, positive, [n_piece], m.
        force_slack: ``N - |V|``, positive, [n_piece], N.
        corrector_tension, corrector_pull: what the predictor adds to the equations of the products,
            a point (tension, vector) for every piece, [n_piece] and [n_piece, 3], N.
        has_predicted: whether a predictor step has been made, so that the next one is to correct.
        load: load, jack force or part of the tension at the start: the scale of forces, N.
        product: mean of ``u N - X.V``, the duality measure, N m.
        target: mean product that the next step aims at, less that of the products of changes, N m.
    """

    tension: Float[Array, " n"]
    pull: Float[Array, "n_piece 3"]
    length_slack: Float[Array, " n_piece"]
    force_slack: Float[Array, " n_piece"]
    corrector_tension: Float[Array, " n_piece"]
    corrector_pull: Float[Array, "n_piece 3"]
    has_predicted: Bool[Array, ""]
    load: Float[Array, ""]
    product: Float[Array, ""]
    target: Float[Array, ""]

    initial_threshold: ClassVar[float] = 1.0  # m over that from which finishing steps are tried
    max_finishes: ClassVar[int] = 3  # how often finishing steps are tried
    # as `limit` of `linear.solve_reusing_factor`: -1 because pivots may have few digits
    min_cg_limit: ClassVar[int] = -1

    @classmethod
    def zeros(cls, system: System, x: Motion) -> ConicInteriorPointState:
        """Return the state before the method begins: all numbers zero."""
        n = sum(len(group.links) for group in system.groups)
        number, vector = (jnp.zeros(s, x.dtype) for s in pieces.piece_shapes(system))
        none, zero, no = jnp.zeros(n, x.dtype), jnp.zeros((), x.dtype), jnp.zeros((), bool)
        return cls(none, vector, number, number, number, vector, no, zero, zero, zero)

    @property
    def force_scale(self) -> Float[Array, ""]:
        """Force that unbalanced forces are compared with, scalar, N."""
        return jnp.maximum(jnp.max(self.tension), self.load)

    def at_start(self, equations: Any, system: System, x: Motion) -> ConicInteriorPointState:
        """Return the starting point: equal tensions, pieces without force, bounds with slack.

        Args:
            equations: `ConicEquations` at x.
            system: `System`.
            x: motion of all nodes (rows).
        """
        size, base, load = norm(equations.vector), equations.base_tension, equations.load
        load = jnp.where(load > 0, load, UNLOADED * jnp.max(base))
        loads = jnp.sum(jnp.abs(system.space.restrict(system.external_force(x), x)))
        tension = jnp.full_like(base, jnp.maximum(load, jnp.sqrt(load * loads)))
        if equations.jacked is not None:
            least = jnp.finfo(x.dtype).eps * load  # a jack may have no force
            tension = jnp.where(equations.jacked, jnp.maximum(base, least), tension)
        rest = rest_lengths(system)
        slack = _INITIAL_SLACK * rest + jnp.maximum(rest - pieces.sum_per_cable(system, size), 0.0)
        slack, of_pieces = (
            pieces.share_among_pieces(system, slack),
            pieces.repeat_per_piece(system, tension),
        )
        return copy_with(
            self,
            tension=tension,
            pull=jnp.zeros_like(self.pull),
            length_slack=slack,
            force_slack=of_pieces,
            corrector_tension=jnp.zeros_like(size),
            corrector_pull=jnp.zeros_like(self.pull),
            has_predicted=jnp.zeros((), bool),
            load=load,
            product=pieces.mean_over_pieces(system, (slack + size) * of_pieces),
            target=jnp.zeros_like(load),
        )

    def decide_finish(
        self,
        unknowns: Any,
        accepted: Bool[Array, ""],
        steps_since_halved: Int[Array, ""],
        relative_residual: Float[Array, ""],
        length: Float[Array, ""],
    ) -> FinishDecision:
        """Decide whether to try finishing steps, by the mean product of tensions and slacks.

        Arguments are those of `InteriorPointState.decide_finish`; the residual says little here.
        """
        least = float(jnp.finfo(relative_residual.dtype).eps) ** _FINISH_POWER
        remaining = self.product / (least * length * self.force_scale)
        most = max(_STUCK[0] / least, _STUCK[1])
        stuck = (unknowns.blocked_steps >= 2) & (remaining < most)
        final = ~accepted | (unknowns.steps_in_mode >= MAX_INTERIOR_STEPS)
        now = (remaining <= unknowns.finish_threshold) | stuck | final
        return FinishDecision(now, stuck, remaining, final=final)

    def take_half_step(
        self,
        equations: Any,
        system: System,
        tension: Float[Array, " n"],
        moved_along: Float[Array, " n_piece"],
        moved: Float[Array, "n_piece 3"],
        definite: Bool[Array, ""],
    ) -> tuple[ConicInteriorPointState, Float[Array, ""], Bool[Array, ""]]:
        """Make a predictor step (which only sets the corrector), or else a corrector step.

        If the matrix is not positive definite or the step not finite, the state stays as it is.

        Args:
            equations: `ConicEquations` of the step.
            system: `System`.
            tension: tensions to which the whole step leads, [n], N.
            moved_along: component of `moved` along ``equations.axis``, [n_piece], m.
            moved: changes of the vectors of pieces in the whole step, [n_piece, 3], m.
            definite: whether the matrix of the equations is positive definite.

        Returns:
            The state after it; the fraction of the step that is taken (0 by a predictor, NaN if the
            step is unusable); whether it was a predictor.
        """
        at, v = equations.vector, self.pull
        u, before = self.length_slack + norm(at), pieces.repeat_per_piece(system, self.tension)
        after = pieces.repeat_per_piece(system, tension)
        away, longer = after - self.corrector_tension, equations.ratio * moved_along
        wider = pieces.zero_void_pieces(system, longer - equations.spring * away)
        along = repeat_for_vectors(equations.ratio * away - equations.stiff * moved_along, v)
        pull = (
            along * equations.axis
            + repeat_for_vectors(equations.stiff, v) * moved
            - self.corrector_pull
        )
        more, change = after - before, pull - v
        first = inverse_step_to_boundary(u, at, self.length_slack, wider, moved)
        second = inverse_step_to_boundary(before, v, self.force_slack, more, change)
        inside = jnp.where(self.has_predicted, _TO_BOUNDARY, 1.0)
        rate = jnp.maximum(first, second)
        fraction = inside / jnp.maximum(rate, inside)
        beyond = lorentz_products(wider, moved, more, change)
        mean = pieces.mean_over_pieces(system, beyond)
        product = self.product + fraction * (self.target - self.product + fraction * mean)

        def predict():
            left = jnp.maximum(_MIN_CENTERING, product / self.product)
            m = jnp.minimum(left * left * left, 1.0) * self.product
            scaled = ConeScaling(equations.stiff, equations.axis, equations.ratio, equations.spring)
            second, steps = (before, v, self.force_slack), (wider, moved, more, change)
            force, back = second_order_corrector(scaled, second, steps, m - beyond)
            new = copy_with(
                self,
                corrector_tension=force,
                corrector_pull=back,
                target=m - mean,
                has_predicted=~self.has_predicted,
            )
            return new, jnp.zeros_like(fraction)

        def correct():
            return copy_with(
                self,
                tension=self.tension + fraction * (tension - self.tension),
                pull=v + fraction * change,
                length_slack=slack_after_step(at, self.length_slack, wider, moved, fraction),
                force_slack=slack_after_step(v, self.force_slack, more, change, fraction),
                corrector_tension=jnp.zeros_like(u),
                corrector_pull=jnp.zeros_like(v),
                has_predicted=~self.has_predicted,
                product=product,
                target=jnp.zeros_like(fraction),
            ), fraction

        sound = definite & jnp.isfinite(rate)
        kind = jnp.where(sound, jnp.where(self.has_predicted, 2, 1), 0)
        # without a fraction that can be taken the step is of no use, and finishing steps are tried
        nothing = self, jnp.full_like(fraction, jnp.nan)
        new, fraction = lax.switch(kind, [lambda: nothing, predict, correct])
        return new, fraction, sound & new.has_predicted
