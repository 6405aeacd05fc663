"""Interior-point method for nets with hanging cables or curved laws: a bound on every length.

A cable is a bound on its length, ``l <= L(N)`` with the length L(N) that it has under the tension
N, and the slack y of the bound: ``N >= 0, y >= 0, N y = 0``. An interior-point method follows
``N y = m`` as m goes to zero. Eliminating y and N from the linear equations gives

    w = y + N L'(N),     k = N / w,     B = N + (m - N (L(N) - l)) / w.

A taut cable (y to 0) has k = 1/L' = D', a slack one (N to 0) none; in between a cable is softened
by a spring of compliance y/N of its own. A hanging cable has a bound, too, less the length s(N)
that its sag takes (`hanging_springs`): in equilibrium ``y = s``, where a straight cable has y = 0,
and a step aims at ``N y = m + N s``. Its sag keeps N from zero as m does, so that the elimination
is the same.

The forces of a hanging cable are not its tension times a unit vector, so that it has no cone as
that of `conic_interior_point`.

Source: Wright, "Primal-dual interior-point methods" (1997).
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, ClassVar

import jax.numpy as jnp
from jax import lax

from .. import linear
from ..common.deferred import deferred
from ..common.tree import copy_with, pytree, select_tree
from ..common.types import Array, ArrayLike, Bool, Float, Int, PyTree
from ..linear import Matrix
from ..mechanics.assembly import EndForces, System
from ..mechanics.tension_responses import (
    CableTensions,
    largest_relative_motion_per_cable,
    linearized_elongation,
    net_stiffness,
    prescribed_tensions,
    rest_lengths,
)
from ..spaces.space import Motion, Step
from .globalization import MIXED_SHIFT
from .interior_methods import BLOCKED, MAX_INTERIOR_STEPS, UNLOADED, FinishDecision

# Steps without halving a residual below this part: rounding keeps it from falling.
_STALLED_STEPS, _STALLED_BELOW = 6, 1e-2
_TO_BOUND = 0.9995  # fraction of the way to the bound that a step may go
_FIRST_TENSION = 0.1, 10.0  # least and largest tension at the start, over the load
_FIRST_SLACK = 0.1  # least slack at the start, in unstressed lengths
_MIN_DAMPING = 0.1  # least damping, over tension per length
_DAMPING_FACTOR = 10.0  # factor by which the damping changes
_UNDAMPED = 1e-7  # part of the least damping below which there is none
# Largest relative motion of the ends of a cable in an interior step, in lengths.
_MAX_INTERIOR_MOTION = 1.0
_MIN_CENTERING, _FIRST_CENTERING = 0.01, 0.2  # m over the mean of N y: least, and of the first step


@pytree
class InteriorPointState:
    """State of the interior-point method with a bound on the length of every cable.

    Attributes:
        tension: tensions N, [n], N.
        length_slack: slacks y of the bounds: how much longer each cable could be, [n], m.
        centering: aim for the products N y after the next step, over their present mean.
        damping: shift of the matrix, N/m: larger after a step that was too long.
    """

    tension: Float[Array, " n"]
    length_slack: Float[Array, " n"]
    centering: Float[Array, ""]
    damping: Float[Array, ""]

    # relative residual from which finishing steps are tried
    initial_threshold: ClassVar[float] = 1e-5
    max_finishes: ClassVar[int] = 5  # how often finishing steps are tried
    min_cg_limit: ClassVar[int] = 0  # as `limit` of `linear.solve_reusing_factor`

    @classmethod
    def zeros(cls, system: System, x: Motion) -> InteriorPointState:
        """Return the state before the method begins: all numbers zero."""
        none, zero = jnp.zeros_like(rest_lengths(system)), jnp.zeros((), x.dtype)
        return cls(none, none, zero, zero)

    def decide_finish(
        self,
        unknowns: Any,
        accepted: Bool[Array, ""],
        steps_since_halved: Int[Array, ""],
        relative_residual: Float[Array, ""],
        length: Float[Array, ""],
    ) -> FinishDecision:
        """Decide whether to try finishing steps; return a `FinishDecision`.

        Args:
            unknowns: `TensionUnknowns`.
            accepted: whether the last step was accepted.
            steps_since_halved: steps since the residual was halved.
            relative_residual: residual over the force it is compared with.
            length: mean length of elements, m.
        """
        stalled = (steps_since_halved >= _STALLED_STEPS) & (relative_residual <= _STALLED_BELOW)
        stuck = (unknowns.blocked_steps >= 2) | stalled
        now = accepted & ((relative_residual <= unknowns.finish_threshold) | stuck)
        failed = ((unknowns.steps_in_mode >= MAX_INTERIOR_STEPS) | ~accepted) & ~now
        return FinishDecision(now, stuck, relative_residual, failed=failed)


@pytree
class TensionStepEquations:
    """Linear equations of one step of a net with hanging cables or curved laws.

    The mode of `unknowns` decides whether it is a mixed step (Newton's for displacements and
    tensions) or an interior one (of the interior-point method, by bounds on the lengths).
    After the step, the tension of a cable is ``base_tension + slope (change of length)``.

    Attributes:
        base_tension: tensions after a step without a change of length, [n], N.
        slope: derivatives of the tensions by the changes of length, [n], N/m.
        unit_forces: derivatives of the lengths by the ends, per group [n_elem, n_end, 3].
        jacked: which cables have a tension that does not follow their length, [n].
        rhs: right side, [n_free], N.
        spare_length: length that each cable has under its tension, less its present length, [n], m.
        compliance: derivatives of `spare_length` by the tensions, [n], m/N.
        load: largest dead load at a node or force of a jack, N.
        length: mean length of elements, m.
        unknowns: `TensionUnknowns`, with the numbers that its mode begins with.
    """

    base_tension: Float[Array, " n"]
    slope: Float[Array, " n"]
    unit_forces: list[Float[Array, "n_elem n_end 3"]]
    jacked: Bool[Array, " n"]
    rhs: Float[Array, " n_free"]
    spare_length: Float[Array, " n"]
    compliance: Float[Array, " n"]
    load: Float[Array, ""]
    length: Float[Array, ""]
    unknowns: PyTree[Array]

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
        assemble_residual: Callable[[EndForces], Step] | None = None,
    ) -> TensionStepEquations:
        """Return the equations of the next step from `x`, as the mode of `unknowns` says.

        A *mixed* step is Newton's for displacements and tensions, an *interior* step one of the
        interior-point method. Arguments are those of `ConicEquations.at_point`, and:

        Args:
            assemble_residual: where the structure has other elements, too: function that returns
                the residual of the whole structure, [n_free], N, for given end forces of the
                cables, per group [n_elem, n_end, 3], N. None for a net.
        """
        none, jacked = jnp.zeros_like(responses.tension), prescribed_tensions(system)
        mixed = cls(
            base_tension=responses.tension,
            slope=responses.slope,
            unit_forces=responses.unit_forces,
            jacked=jnp.zeros(none.shape, bool) if jacked is None else jacked,
            rhs=-residual,
            spare_length=none,
            compliance=none,
            load=load,
            length=length,
            unknowns=copy_with(unknowns, guess=guess),
        )
        given = mixed, system, x, responses
        if assemble_residual is None:
            interior = deferred(
                lambda own, *given: own._interior_step_equations(*given, None), mixed
            )
        else:  # which may hold traced values

            def interior(own, *given):
                return own._interior_step_equations(*given, assemble_residual)

        return lax.cond(unknowns.uses_interior_point, lambda: interior(*given), lambda: mixed)

    def _interior_step_equations(self, system, x, responses, assemble_residual):
        """Return the equations of an interior-point step at x, made from these of a mixed step."""
        unknowns, free = self.unknowns, ~self.jacked
        first = jnp.maximum(self.load, UNLOADED * jnp.max(responses.tension))
        least, most = (part * first for part in _FIRST_TENSION)
        # a first guess only: steps change it freely
        start = jnp.clip(responses.tension, least, most)
        tension = select_tree(unknowns.is_new_mode, start, unknowns.interior_point.tension)
        under = responses.under_tensions(system, tension)
        first_slack = jnp.maximum(under.spare_length, _FIRST_SLACK * rest_lengths(system))
        if under.sag is not None:
            first_slack = jnp.maximum(first_slack, under.sag)
        slack = select_tree(unknowns.is_new_mode, first_slack, unknowns.interior_point.length_slack)
        product = jnp.where(free, tension * under.slack_beyond_sag(slack), 0.0)
        centering = unknowns.interior_point.centering
        centering = jnp.where(unknowns.is_new_mode, _FIRST_CENTERING, centering)
        target, falls = under.target_product_and_slope(
            centering * jnp.sum(product) / jnp.maximum(jnp.sum(free), 1)
        )
        damping = jnp.where(unknowns.is_new_mode, 0.0, unknowns.interior_point.damping)
        width = falls * slack + tension * under.compliance
        width = jnp.where(width > 0, width, 1.0)
        base = tension + (target - tension * under.spare_length) / width
        base = jnp.where(free, base, self.base_tension)
        if assemble_residual is None:
            rhs = under.residual(system, x, base)
        else:
            rhs = assemble_residual(under.end_forces(system, base))
        return copy_with(
            self,
            base_tension=base,
            slope=jnp.where(free, tension / width, self.slope),
            unit_forces=under.unit_forces,
            rhs=-rhs,
            spare_length=under.spare_length,
            compliance=under.compliance,
            unknowns=copy_with(
                unknowns, interior_point=InteriorPointState(tension, slack, centering, damping)
            ),
        )

    def matrix(
        self,
        system: System,
        x: Motion,
        residual: Float[Array, ""],
    ) -> Matrix:
        """Assemble the matrix of the equations at `x`, of the displacements only, N/m.

        The tensions are eliminated. The diagonal has a shift, which exceeds its rounding: interior
        steps have that of their own `damping`; for mixed steps it follows from `residual`, the
        largest residual, N.
        """
        unknowns = self.unknowns
        tensions = select_tree(
            unknowns.uses_interior_point, unknowns.interior_point.tension, unknowns.guess
        )
        matrix = system.tangent(
            x, [*net_stiffness(system, x, self.unit_forces, self.slope, tensions)]
        )
        size = jnp.max(jnp.abs(linear.diagonal(matrix)), initial=0.0)
        eps, tiny = jnp.finfo(x.dtype).eps, jnp.finfo(x.dtype).tiny
        rounding = unknowns.min_shift_in_eps * (eps * size) + tiny
        shift = MIXED_SHIFT * jnp.minimum(residual, jnp.max(tensions) + self.load) / self.length
        shift = jnp.where(unknowns.uses_interior_point, unknowns.interior_point.damping, shift)
        return linear.add_to_diagonal(matrix, jnp.maximum(shift, rounding))

    def take_step(
        self,
        system: System,
        x: Motion,
        step: Float[Array, " n_free"],
        definite: Bool[Array, ""],
    ) -> tuple[Any, Float[Array, ""], Bool[ArrayLike, ""]]:
        """Update the tensions by the solution `step` of the equations, [n_free].

        Returns:
            `TensionUnknowns` after the step; the fraction of it that displacements are to take;
            False, because no step is a predictor.
        """
        spread, unknowns = system.space.prolong(x, step), self.unknowns
        elongation = linearized_elongation(system, self.unit_forces, spread)
        now = self.base_tension + self.slope * elongation
        mixed = copy_with(unknowns, guess=jnp.maximum(now, 0.0)), jnp.ones_like(self.length)

        def take(own, now, elongation, system, spread):
            motion = jnp.max(largest_relative_motion_per_cable(system, spread))
            return own._take_interior_step(now, elongation, motion)

        interior, given = deferred(take, mixed), (self, now, elongation, system, spread)
        after, fraction = lax.cond(
            unknowns.uses_interior_point, lambda: interior(*given), lambda: mixed
        )
        new, count = jnp.zeros((), bool), unknowns.steps_in_mode + 1
        return copy_with(after, is_new_mode=new, steps_in_mode=count), fraction, jnp.zeros((), bool)

    def _take_interior_step(self, tension, elongation, motion):
        """Return `TensionUnknowns` after an interior step, and the fraction of it that is taken.

        Args:
            tension: tensions to which the whole step leads, [n], N.
            elongation: changes of the lengths by the whole step, [n], m.
            motion: largest relative motion of the ends of a cable, over its length.
        """
        unknowns, inner = self.unknowns, self.unknowns.interior_point
        change = jnp.where(self.jacked, 0.0, tension - inner.tension)
        slack = self.spare_length + self.compliance * change - elongation
        wider = jnp.where(self.jacked, 0.0, slack - inner.length_slack)
        of_tension, fraction = (
            _fraction_to_zero(inner.tension, change),
            _fraction_to_zero(inner.length_slack, wider),
        )
        far = motion > _MAX_INTERIOR_MOTION
        far_fraction = jnp.where(far, _MAX_INTERIOR_MOTION / jnp.where(far, motion, 1.0), 1.0)
        fraction = jnp.minimum(fraction, far_fraction)
        shorter = jnp.minimum(of_tension, fraction)
        blocked = unknowns.blocked_steps
        blocked = jnp.where(shorter < BLOCKED, blocked + 1, jnp.minimum(blocked, 0))
        inner = InteriorPointState(
            tension=inner.tension + of_tension * change,
            length_slack=inner.length_slack + fraction * wider,
            centering=jnp.maximum((1 - shorter) ** 2, _MIN_CENTERING),
            damping=self.next_damping(far),
        )
        after = copy_with(unknowns, interior_point=inner, blocked_steps=blocked.astype(jnp.int32))
        return after, fraction

    def next_damping(self, was_too_long: Bool[ArrayLike, ""]) -> Float[Array, ""]:
        """Return the shift of the next interior step, N/m: larger if this one was too long."""
        inner = self.unknowns.interior_point
        least = _MIN_DAMPING * jnp.max(inner.tension) / self.length
        more = jnp.maximum(_DAMPING_FACTOR * inner.damping, least)
        less = inner.damping / _DAMPING_FACTOR
        return jnp.where(was_too_long, more, jnp.where(less > _UNDAMPED * least, less, 0.0))


def _fraction_to_zero(values, changes):
    """Return which fraction (up to 1) of `changes` positive `values` can take and stay positive."""
    falls = changes < 0
    ratio = jnp.where(falls, -values / jnp.where(falls, changes, -1.0), jnp.inf)
    return jnp.minimum(1.0, _TO_BOUND * jnp.min(ratio, initial=jnp.inf))
