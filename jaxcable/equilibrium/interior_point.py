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
from ..common.tree import copy_with, pytree, select_tree
from ..common.types import Array, ArrayLike, Bool, Float, Int, PyTree
from ..linear import Matrix
from ..mechanics.assembly import EndForces, System
from ..mechanics.tension_responses import (
    TensionResponses,
    linearized_elongation,
    net_stiffness,
    prescribed_tensions,
    relative_node_motion,
    rest_lengths,
)
from ..spaces.space import Motion, Step
from .finish_decision import FinishDecision

_MAX_STEPS = 100  # interior steps
# Steps without halving a residual below this part: rounding keeps it from falling.
_STALLED_STEPS, _STALLED_BELOW = 6, 1e-2
_SHIFT = 1e-6  # Levenberg shift of mixed steps over tension per length
_TO_BOUND = 0.9995  # fraction of the way to the bound that a step may go
_BLOCKED = 0.05  # a step of which a smaller fraction is taken is blocked by a bound
_FIRST_TENSION = 0.1, 10.0  # least and largest tension at the start, over the load
_UNLOADED = 1e-3  # the load that stands for none, over the largest tension at the start
_FIRST_SLACK = 0.1  # least slack at the start, in unstressed lengths
_MIN_DAMPING = 0.1  # least damping, over tension per length
_DAMPING_FACTOR = 10.0  # factor by which the damping changes
_UNDAMPED = 1e-7  # part of the least damping below which there is none
_MAX_MOTION = 1.0  # largest relative motion of the ends of a cable in an interior step, in lengths
_MIN_CENTERING, _FIRST_CENTERING = 0.01, 0.2  # m over the mean of N y: least, and of the first step


@pytree
class InteriorPoint:
    """State of the interior-point method with a bound on every length.

    Attributes:
        tension, length_slack: N and y, [n], N and m.
        centering: m of the next step over the present mean of N y.
        damping: shift of the matrix, N/m: more after a step that was too long.
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
    def zeros(cls, system: System, x: Motion) -> InteriorPoint:
        """Return zeros: the state before the method begins."""
        none, zero = jnp.zeros_like(rest_lengths(system)), jnp.zeros((), x.dtype)
        return cls(none, none, zero, zero)

    def decide_finish(
        self,
        unknowns: Any,
        finite: Bool[Array, ""],
        steps_since_halved: Int[Array, ""],
        relative_residual: Float[Array, ""],
        length: Float[Array, ""],
    ) -> FinishDecision:
        """Return whether to try finishing steps.

        Args:
            unknowns: `tension_unknowns.TensionUnknowns`.
            finite: whether the last step led to finite forces.
            steps_since_halved: steps since the residual was halved.
            relative_residual: residual over the force it is compared with.
            length: of elements, m.
        """
        stalled = (steps_since_halved >= _STALLED_STEPS) & (relative_residual <= _STALLED_BELOW)
        stuck = (unknowns.blocked_steps >= 2) | stalled
        now = finite & ((relative_residual <= unknowns.finish_threshold) | stuck)
        failed = ((unknowns.steps_in_mode >= _MAX_STEPS) | ~finite) & ~now
        return FinishDecision(now, stuck, relative_residual, failed=failed)


@pytree
class LengthBoundEquations:
    """Linear equations of a step of a net with hanging cables or curved laws.

    Attributes:
        base_tension, slope: B and k of every cable, [n], N and N/m.
        unit_forces: derivatives of the lengths by the ends, per group [n_elem, n_end, 3].
        jacked: which cables have a tension that does not follow their length, [n].
        rhs: right side, [n_free], N.
        spare_length, compliance: L(N) - l and L'(N), [n], m and m/N.
        load: largest dead load at a node or force of a jack, N.
        length: of elements, m.
        unknowns: `tension_unknowns.TensionUnknowns` with the numbers that its mode begins with.
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
        pulls: TensionResponses,
        residual: Float[Array, " n_free"],
        guess: Float[Array, " n"],
        load: Float[Array, ""],
        length: Float[Array, ""],
        residual_with: Callable[[EndForces], Step] | None = None,
    ) -> LengthBoundEquations:
        """Return the equations of the next step from x, see `ConicEquations.at_point`.

        `residual_with` returns the residual with given end forces of the cables, where there are
        other elements, too.
        """
        none, jacked = jnp.zeros_like(pulls.tension), prescribed_tensions(system)
        mixed = cls(
            base_tension=pulls.tension,
            slope=pulls.slope,
            unit_forces=pulls.unit_forces,
            jacked=jnp.zeros(none.shape, bool) if jacked is None else jacked,
            rhs=-residual,
            spare_length=none,
            compliance=none,
            load=load,
            length=length,
            unknowns=copy_with(unknowns, guess=guess),
        )
        interior, given = mixed._interior_equations, (system, x, pulls, residual_with)
        return lax.cond(unknowns.is_interior, lambda: interior(*given), lambda: mixed)

    def _interior_equations(self, system, x, pulls, residual_with):
        """Return the equations of an interior step, from these of a mixed step; `pulls` at x."""
        unknowns, free = self.unknowns, ~self.jacked
        first = jnp.maximum(self.load, _UNLOADED * jnp.max(pulls.tension))
        least, most = (part * first for part in _FIRST_TENSION)
        # a first guess only: steps change it freely
        start = jnp.clip(pulls.tension, least, most)
        tension = select_tree(unknowns.is_new_mode, start, unknowns.interior_point.tension)
        under = pulls.under_tensions(system, tension)
        first_slack = jnp.maximum(under.spare_length, _FIRST_SLACK * rest_lengths(system))
        if under.sag is not None:
            first_slack = jnp.maximum(first_slack, under.sag)
        slack = select_tree(unknowns.is_new_mode, first_slack, unknowns.interior_point.length_slack)
        product = jnp.where(free, tension * under.beyond_sag(slack), 0.0)
        centering = unknowns.interior_point.centering
        centering = jnp.where(unknowns.is_new_mode, _FIRST_CENTERING, centering)
        target, falls = under.target_product(
            centering * jnp.sum(product) / jnp.maximum(jnp.sum(free), 1)
        )
        damping = jnp.where(unknowns.is_new_mode, 0.0, unknowns.interior_point.damping)
        width = falls * slack + tension * under.compliance
        width = jnp.where(width > 0, width, 1.0)
        base = tension + (target - tension * under.spare_length) / width
        base = jnp.where(free, base, self.base_tension)
        if residual_with is None:
            rhs = under.residual(system, x, base)
        else:
            rhs = residual_with(under.end_forces(system, base))
        return copy_with(
            self,
            base_tension=base,
            slope=jnp.where(free, tension / width, self.slope),
            unit_forces=under.unit_forces,
            rhs=-rhs,
            spare_length=under.spare_length,
            compliance=under.compliance,
            unknowns=copy_with(
                unknowns, interior_point=InteriorPoint(tension, slack, centering, damping)
            ),
        )

    def matrix(
        self,
        system: System,
        x: Motion,
        residual: Float[Array, ""],
    ) -> Matrix:
        """Return the matrix of the equations, regularized; `residual` is the largest, N."""
        unknowns = self.unknowns
        tensions = select_tree(
            unknowns.is_interior, unknowns.interior_point.tension, unknowns.guess
        )
        matrix = system.tangent(
            x, [*net_stiffness(system, x, self.unit_forces, self.slope, tensions)]
        )
        size = jnp.max(jnp.abs(linear.diagonal(matrix)), initial=0.0)
        eps, tiny = jnp.finfo(x.dtype).eps, jnp.finfo(x.dtype).tiny
        rounding = unknowns.min_shift_in_eps * (eps * size) + tiny
        shift = _SHIFT * jnp.minimum(residual, jnp.max(tensions) + self.load) / self.length
        shift = jnp.where(unknowns.is_interior, unknowns.interior_point.damping, shift)
        return linear.add_to_diagonal(matrix, jnp.maximum(shift, rounding))

    def take_step(
        self,
        system: System,
        x: Motion,
        step: Float[Array, " n_free"],
        definite: Bool[Array, ""],
    ) -> tuple[Any, Float[Array, ""], Bool[ArrayLike, ""]]:
        """Return the state after a step, the fraction that is taken, and False: no predictor."""
        spread, unknowns = system.space.prolong(x, step), self.unknowns
        longer = linearized_elongation(system, self.unit_forces, spread)
        now = self.base_tension + self.slope * longer
        mixed = copy_with(unknowns, guess=jnp.maximum(now, 0.0)), jnp.ones_like(self.length)
        after, fraction = lax.cond(
            unknowns.is_interior,
            lambda: self._take_interior_step(
                now, longer, jnp.max(relative_node_motion(system, spread))
            ),
            lambda: mixed,
        )
        new, count = jnp.zeros((), bool), unknowns.steps_in_mode + 1
        return copy_with(after, is_new_mode=new, steps_in_mode=count), fraction, jnp.zeros((), bool)

    def _take_interior_step(self, tension, longer, motion):
        """Return the state after an interior step, and the fraction of it that is taken.

        Args:
            tension: tensions to which the whole step leads, [n], N.
            longer: changes of the lengths by the whole step, [n], m.
            motion: largest relative motion of the ends of a cable, in its lengths.
        """
        unknowns, inner = self.unknowns, self.unknowns.interior_point
        change = jnp.where(self.jacked, 0.0, tension - inner.tension)
        slack = self.spare_length + self.compliance * change - longer
        wider = jnp.where(self.jacked, 0.0, slack - inner.length_slack)
        of_tension, fraction = (
            _fraction_to_zero(inner.tension, change),
            _fraction_to_zero(inner.length_slack, wider),
        )
        far = motion > _MAX_MOTION
        far_fraction = jnp.where(far, _MAX_MOTION / jnp.where(far, motion, 1.0), 1.0)
        fraction = jnp.minimum(fraction, far_fraction)
        shorter = jnp.minimum(of_tension, fraction)
        blocked = unknowns.blocked_steps
        blocked = jnp.where(shorter < _BLOCKED, blocked + 1, jnp.minimum(blocked, 0))
        inner = InteriorPoint(
            tension=inner.tension + of_tension * change,
            length_slack=inner.length_slack + fraction * wider,
            centering=jnp.maximum((1 - shorter) ** 2, _MIN_CENTERING),
            damping=self.damping_after(far),
        )
        after = copy_with(unknowns, interior_point=inner, blocked_steps=blocked.astype(jnp.int32))
        return after, fraction

    def damping_after(self, was_too_long: Bool[ArrayLike, ""]) -> Float[Array, ""]:
        """Return the shift for the next interior step: larger after one that was too long."""
        inner = self.unknowns.interior_point
        least = _MIN_DAMPING * jnp.max(inner.tension) / self.length
        more = jnp.maximum(_DAMPING_FACTOR * inner.damping, least)
        less = inner.damping / _DAMPING_FACTOR
        return jnp.where(was_too_long, more, jnp.where(less > _UNDAMPED * least, less, 0.0))


def _fraction_to_zero(values, changes):
    """Return the fraction of the changes, at most 1, up to which positive values stay positive."""
    falls = changes < 0
    ratio = jnp.where(falls, -values / jnp.where(falls, changes, -1.0), jnp.inf)
    return jnp.minimum(1.0, _TO_BOUND * jnp.min(ratio, initial=jnp.inf))
