"""The linear equations of a step of nets of straight and sliding cables.

Mixed steps (`tension_unknowns`), interior steps and finishing steps (both `conic_interior_point`)
differ in the numbers of one form: a spring of every cable along the change of its length, and one
of every piece across it.
"""

from __future__ import annotations

from typing import Any

import jax.numpy as jnp
from jax import lax

from .. import linear
from ..common.deferred import deferred
from ..common.tree import copy_with, pytree
from ..common.types import Array, ArrayLike, Bool, Float, PyTree
from ..linear import Matrix
from ..mechanics import pieces
from ..mechanics.assembly import System
from ..mechanics.tension_responses import CableTensions, prescribed_tensions
from ..numerics.cones import nesterov_todd_scaling, norm, repeat_for_vectors
from ..spaces.space import Motion
from .globalization import MIXED_SHIFT
from .interior_methods import BLOCKED
from .newton_step import max_abs

_NET_STIFFNESS = 1e-4  # stiffness c that decides which cables are active, over tension per length
# Largest relative motion of the ends of a piece in a finishing step, in lengths.
_MAX_FINISHING_MOTION = 0.5
# Largest stiffness of a cable in finishing steps: tension per length over so many roundings (eps),
# and the factor by which it grows with each step. Above it, rounding would hide what tensions
# resist.
_STIFFNESS_LIMIT, _LIMIT_GROWTH = 64.0, 4.0
_MIN_SHIFT = 32.0  # least Levenberg shift over tension per length, in roundings (eps)


@pytree
class ConicEquations:
    """Linear equations of one step of a net of straight and sliding cables.

    Their matrix is that of `pieces.cable_matrices`. After the step, the tension of a cable is
    ``base_tension + slope (change of length)``, where the change of length is the sum over its
    pieces of ``ratio axis . (change of the piece's vector)``.

    Attributes:
        unknowns: `TensionUnknowns`, with the numbers that its mode begins with.
        base_tension: tensions after a step without a change of length, [n], N.
        slope: derivatives of the tensions by the changes of length, [n], N/m.
        vector: present vectors of pieces from end to end, [n_piece, 3], m.
        stiff: stiffness of pieces at right angles to `axis`, [n_piece], N/m.
        axis: vectors along pieces, of length 1 or less (c of `numerics.cones`), [n_piece, 3].
        ratio: factors of `axis` in the change of length, [n_piece].
        spring: compliance that the cone of a piece adds to its cable, [n_piece], m/N.
        rhs: right side, [n_free], N.
        guess: tensions for the geometric stiffness of pieces, [n], N.
        jacked: which cables have a tension that does not follow their length, [n], or None.
        load: largest dead load at a node or force of a jack, N.
        length: mean length of elements, m.
    """

    unknowns: PyTree[Array]
    base_tension: Float[Array, " n"]
    slope: Float[Array, " n"]
    vector: Float[Array, "n_piece 3"]
    stiff: Float[Array, " n_piece"]
    axis: Float[Array, "n_piece 3"]
    ratio: Float[Array, " n_piece"]
    spring: Float[Array, " n_piece"]
    rhs: Float[Array, " n_free"]
    guess: Float[Array, " n"]
    jacked: Bool[Array, " n"] | None
    load: Float[Array, ""]
    length: Float[Array, ""]

    @classmethod
    def at_point(
        cls,
        unknowns: Any,
        system: System,
        x: Motion,
        responses: CableTensions,
        residual: Float[Array, " n_free"],
        guess: Float[Array, " n"],
        load: Float[Array, ""],
        length: Float[Array, ""],
    ) -> ConicEquations:
        """Return the equations of the next step from `x`, as the mode of `unknowns` says.

        A *mixed* step is Newton's for displacements and tensions, an *interior* step one of the
        interior-point method, a *finishing* step Newton's for the cables that are taut there.

        Args:
            unknowns: `TensionUnknowns`.
            system: `System`, a net.
            x: motion of all nodes (rows).
            responses: tensions and end forces at x.
            residual: residual at x, [n_free], N.
            guess, load, length: as in `ConicEquations`.
        """
        vector = pieces.piece_vectors(system, x)
        piece_length = norm(vector)
        piece_length = jnp.where(piece_length > 0, piece_length, 1.0)
        none = jnp.zeros_like(piece_length)
        mixed = cls(
            unknowns=unknowns,
            base_tension=responses.tension,
            slope=responses.slope,
            vector=vector,
            stiff=pieces.repeat_per_piece(system, guess) / piece_length,
            axis=vector / repeat_for_vectors(piece_length, vector),
            ratio=jnp.ones_like(piece_length),
            spring=none,
            rhs=-residual,
            guess=guess,
            jacked=prescribed_tensions(system),
            load=load,
            length=length,
        )
        given = mixed, system, x, responses, piece_length
        interior = deferred(lambda own, *given: own._with_interior_matrix(*given), mixed)
        return lax.cond(unknowns.has_interior_matrix, lambda: interior(*given), lambda: mixed)

    def _with_interior_matrix(self, system, x, responses, piece_length):
        """Return the equations of an interior or finishing step, made from those of a mixed step.

        Args:
            system, x: `System`, and motion of all nodes (rows).
            responses: tensions and end forces at x.
            piece_length: lengths of pieces, [n_piece], m.
        """
        unknowns = self.unknowns
        inner = unknowns.interior_point
        inner = lax.cond(
            unknowns.is_new_mode, lambda: inner.at_start(self, system, x), lambda: inner
        )
        new = copy_with(self, unknowns=copy_with(unknowns, interior_point=inner))
        guess = jnp.where(unknowns.uses_interior_point, inner.tension, unknowns.guess)
        under = responses.under_tensions(system, jnp.maximum(guess, 0.0))
        given = system, guess, under.spare_length, under.compliance
        ways = (
            (lambda: new._interior_step_equations(*given)),
            (lambda: new._finishing_step_equations(*given, piece_length)),
        )
        new, pull = lax.cond(unknowns.uses_interior_point, *ways)
        unbalanced = system.external_force(x) - pieces.sum_piece_forces(system, pull)
        return copy_with(new, rhs=system.space.restrict(unbalanced, x))

    def _interior_step_equations(self, system, tension, spare_length, compliance):
        """Return the equations of an interior step, and the forces of pieces if nothing moves.

        Args:
            system: `System`.
            tension: tensions of the interior point, [n], N.
            spare_length: by how much straight cables could be longer at these tensions, [n], m.
            compliance: its derivative by the tensions, [n], m/N.

        Returns:
            `ConicEquations`; forces at the ends of pieces, [n_piece, 3], N.
        """
        inner = self.unknowns.interior_point
        single = pieces.repeat_per_piece(system, tension)
        points = inner.length_slack + norm(self.vector), self.vector, single, inner.pull
        scaled = nesterov_todd_scaling(*points, inner.length_slack, inner.force_slack)
        lacks = spare_length - pieces.sum_per_cable(system, inner.length_slack)
        slope = 1 / (compliance + pieces.sum_per_cable(system, scaled.spring))
        if self.jacked is not None:
            slope = jnp.where(self.jacked, 0.0, slope)
        wider = pieces.sum_per_cable(system, scaled.spring * (inner.corrector_tension - single))
        base = tension + slope * (wider - lacks)
        away = pieces.repeat_per_piece(system, base) - inner.corrector_tension
        pull = (
            repeat_for_vectors(scaled.ratio * away, inner.pull) * scaled.axis - inner.corrector_pull
        )
        return copy_with(self, base_tension=base, slope=slope, **scaled._asdict()), pull

    def _finishing_step_equations(self, system, guess, spare_length, compliance, piece_length):
        """Return the equations of a finishing step: Newton's, of the cables that are taut there.

        `guess` are tensions, [n], N, which may be negative; `piece_length` are present lengths of
        pieces, [n_piece], m. Other arguments, and both results (equations, and forces of pieces if
        nothing moves), are as in `_interior_step_equations`.
        """
        unknowns, eps = self.unknowns, jnp.finfo(spare_length.dtype).eps
        force_per_length = unknowns.interior_point.force_scale / self.length
        net_stiffness = _NET_STIFFNESS * force_per_length / unknowns.finish_threshold
        positive = jnp.maximum(guess, 0.0)
        lacks = spare_length + compliance * (guess - positive)
        stiff = jnp.where(compliance > 0, 1 / compliance, self.slope)  # 0 on a plateau of the law
        # rounding of more would hide what the tensions resist; a softer law ends at the same point
        growth = _LIMIT_GROWTH ** unknowns.steps_in_mode.astype(spare_length.dtype)
        most = force_per_length * (growth / (_STIFFNESS_LIMIT * eps))
        stiff = jnp.minimum(stiff, most)
        active = guess > jnp.minimum(net_stiffness, stiff) * lacks
        inactive = none = jnp.zeros_like(spare_length)
        if self.jacked is not None:
            active, inactive = active & ~self.jacked, jnp.where(self.jacked, self.base_tension, 0.0)
        base = lax.select(active, positive - stiff * spare_length, inactive)
        tension = lax.select(active, positive, inactive)
        new = copy_with(
            self,
            base_tension=base,
            slope=lax.select(active, stiff, none),
            stiff=pieces.repeat_per_piece(system, tension) / piece_length,
            guess=tension,
        )
        return new, repeat_for_vectors(pieces.repeat_per_piece(system, base), self.axis) * self.axis

    def matrix(self, system: System, x: Motion, residual: Float[Array, ""]) -> Matrix:
        """Assemble the matrix of the equations at `x`, with a shift of its diagonal, N/m.

        `residual` is the largest residual, N, by which the shift of mixed steps is chosen.
        """
        unknowns = self.unknowns
        blocks = pieces.cable_matrices(system, self.slope, self.stiff, self.axis, self.ratio)
        matrix = system.tangent(x, [*blocks])
        size = max_abs(linear.diagonal(matrix))
        force = jnp.max(self.guess) + self.load
        # rounding of the forces then moves nodes without stiffness by some part of a length only
        least = _MIN_SHIFT * jnp.finfo(force.dtype).eps * force
        shift = jnp.maximum(MIXED_SHIFT * jnp.minimum(residual, force), least) / self.length
        shift = jnp.where(unknowns.uses_interior_point, 0.0, shift)
        eps, tiny = jnp.finfo(size.dtype).eps, jnp.finfo(size.dtype).tiny
        rounding = unknowns.min_shift_in_eps * (eps * size) + tiny
        return linear.add_to_diagonal(matrix, jnp.maximum(shift, rounding))

    def take_step(
        self,
        system: System,
        x: Motion,
        step: Float[Array, " n_free"],
        definite: Bool[Array, ""],
    ) -> tuple[Any, Float[Array, ""], Bool[ArrayLike, ""]]:
        """Update the tensions by the solution of the equations.

        Args:
            system: `System`.
            x: motion of all nodes (rows).
            step: solution of the equations, [n_free].
            definite: whether their matrix is positive definite.

        Returns:
            `TensionUnknowns` after the step; the fraction of it that displacements are to take;
            whether it was a predictor, which moves nothing.
        """
        unknowns = self.unknowns
        moved = pieces.piece_differences(system, system.space.prolong(x, step))
        moved_along = jnp.sum(self.axis * moved, axis=-1)
        now = self.base_tension + self.slope * pieces.sum_per_cable(
            system, self.ratio * moved_along
        )

        def newton_step():
            far = jnp.max(norm(moved)) / (_MAX_FINISHING_MOTION * self.length)
            fraction = jnp.where(unknowns.takes_finishing_steps, 1 / jnp.maximum(far, 1.0), 1.0)
            guess = jnp.where(unknowns.takes_finishing_steps, now, jnp.maximum(now, 0.0))
            after = copy_with(unknowns, guess=guess, steps_in_mode=unknowns.steps_in_mode + 1)
            return after, fraction, jnp.zeros((), bool)

        def interior_step(own, *given):
            unknowns = own.unknowns
            inner, fraction, predicted = unknowns.interior_point.take_half_step(own, *given)
            blocked = unknowns.blocked_steps
            short = jnp.where(fraction < BLOCKED, blocked + 1, jnp.minimum(blocked, 0))
            after = copy_with(
                unknowns,
                interior_point=inner,
                blocked_steps=jnp.where(predicted, blocked, short),
                steps_in_mode=unknowns.steps_in_mode + ~predicted,
            )
            return after, fraction, predicted

        mixed, given = newton_step(), (self, system, now, moved_along, moved, definite)
        interior = deferred(interior_step, mixed)
        after, fraction, predicted = lax.cond(
            unknowns.uses_interior_point, lambda: interior(*given), lambda: mixed
        )
        return copy_with(after, is_new_mode=jnp.zeros((), bool)), fraction, predicted
