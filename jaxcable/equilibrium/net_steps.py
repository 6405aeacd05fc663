"""Steps of nets of cables: displacements and tensions are unknown, and steps are whole ones.

`tension_unknowns` says which kinds of steps there are, and when each of them is taken. A line
search is what comes last: nets of very stiff sliding cables need it.
"""

from __future__ import annotations

import jax.numpy as jnp

from .. import linear
from ..common.tree import copy_with, pytree, select_tree
from ..common.types import Array, ArrayLike, Bool, Float
from ..mechanics.assembly import System
from ..mechanics.tension_responses import CableTensions, has_load
from ..numerics.line_search import LineSearch
from ..spaces.space import Motion
from .convergence import Convergence
from .globalization import ASTRAY, LevenbergShift
from .newton_state import Evaluation, NewtonState
from .newton_step import max_abs, newton_direction
from .step_method import Choice, NextStep, StepMethod, Trial, Verdict
from .tension_unknowns import TensionUnknowns, largest_load

# Residual allowed without load, in roundings (eps) of the forces at the start.
_RELEASED_ROUNDINGS = 2.0
# Rounding of plain displacements over the tolerance, from which displacements get a fine part: well
# below 1, because the next point may need it more than this one.
_FINE_PART_FROM = 0.05
# Rounding of a residual over the forces up to which it excuses the residual: above it, the forces
# would not be known to two digits.
_MAX_ROUNDING = 1e-2


@pytree
class NetStrategy:
    """State of `NetSteps`.

    Attributes:
        unknowns: tensions as unknowns, and the kind of steps.
        search: which length of a step is tried next, where the kind is a line search.
        shift: Levenberg shift of the matrix, likewise.
    """

    unknowns: TensionUnknowns
    search: LineSearch
    shift: LevenbergShift


class NetSteps(StepMethod):
    """Steps of the iteration in cable nets: of displacements and tensions."""

    farthest = 1e4  # mixed steps of anchored nets end at a part of it

    def __init__(self, system: System, begin: Motion, convergence: Convergence):
        super().__init__(system, begin, convergence)
        self.is_loaded = has_load(system, begin)

    def initial(self) -> NetStrategy:
        """Return the state of the method before the first evaluation."""
        unknowns = TensionUnknowns.initial(self.system, self.begin, is_partial_net=False)
        zero = jnp.zeros((), self.begin.dtype)
        return NetStrategy(unknowns, LineSearch.init(zero), LevenbergShift.initial(zero.dtype))

    def evaluate_at(self, x: Motion, exact: Bool[ArrayLike, ""]) -> Evaluation:
        """Return the `Evaluation` at `x`: residual, its scale and rounding, and cable tensions.

        With `exact`, elongations have the precision of double-double displacements, the sum of
        motion and low-order part (`spaces.translations`), else that of a float.
        """
        elements = CableTensions.at_motion(self.system, x, exact)
        forces = elements.residual_scale_and_rounding(self.system, x)
        return Evaluation(x, *forces, elements, jnp.asarray(exact))

    def evaluate(self, state: NewtonState, x: Motion) -> Evaluation:
        """Return the `Evaluation` at `x`, with double-double displacements where they are needed.

        They are at the first point, and where the rounding of plain displacements could exceed the
        tolerance (`_needs_low_part`).
        """
        return self.evaluate_at(x, ~state.progress.has_begun | self._needs_low_part(state.point))

    def _needs_low_part(self, point):
        """Return whether the next point needs the low-order part of displacements.

        It does if rounding at `point`, N, exceeds a part of the tolerance of the residual, N.
        """
        # rounding is that of a fine part, of eps times the displacement and not eps^2
        eps, least = jnp.finfo(point.scale.dtype).eps, point.scale
        if self.convergence.criterion is not None:
            least = jnp.minimum(least, self.convergence.criterion.added_load)
        return max_abs(point.rounding) > _FINE_PART_FROM * eps * self.convergence.tol * least

    def is_exact_enough(self, point: Evaluation) -> Bool[Array, ""]:
        """Return whether an equilibrium is one with the fine part, where that matters.

        A long step may lead to where it does, from where it did not.
        """
        return point.exact | ~self._needs_low_part(point)

    def accept(self, state: NewtonState, tried: Evaluation, searched: Verdict) -> Verdict:
        """Accept every point with finite forces, but in a line search what that accepts."""
        (fine, again), searches = searched, state.strategy.unknowns.uses_line_search
        return jnp.where(searches, fine, jnp.isfinite(tried.scale)), again & searches

    def start_rounding(self, point: Evaluation) -> Float[Array, ""]:
        """Return the residual that is allowed in a net without load, N.

        What is released ends with the rounding of the forces that it began with. A net under load
        has others to be judged by.
        """
        released = _RELEASED_ROUNDINGS * jnp.finfo(point.scale.dtype).eps * point.scale
        return jnp.where(self.is_loaded, 0.0, released)

    def granted_residual(
        self, rounding: Float[Array, " n_free"], start: Array, scale: Float[Array, ""]
    ) -> Float[Array, " n_free"]:
        """Return which residual the rounding of displacements excuses, [n_free], N."""
        # forces that rounding hides are not found; without any load they may all be lost
        known = jnp.where(self.is_loaded, _MAX_ROUNDING * scale, jnp.inf)
        return jnp.maximum(jnp.minimum(rounding, known), start)

    def choose(
        self, state: NewtonState, trial: Trial, moved: Bool[Array, ""], converged: Bool[Array, ""]
    ) -> Choice:
        """Choose the kind of the next step (`TensionUnknowns.switch_mode`)."""
        point, own, unknowns = state.point, state.strategy, state.strategy.unknowns
        searches, first_shift = unknowns.uses_line_search, LevenbergShift.initial(point.x.dtype)
        shift = select_tree(moved, own.shift.update(trial.accepted, trial.step_length), own.shift)
        shift = select_tree(searches, shift, first_shift)
        astray = self.system.largest_displacement(point.x) > ASTRAY * self.extent
        given = point, self.begin, trial.accepted, astray, self.length
        new, x, elsewhere = unknowns.switch_mode(*given)
        may_switch = moved & ~converged & ~searches
        unknowns, x = select_tree(may_switch, (new, x), (unknowns, point.x))
        return Choice(NetStrategy(unknowns, own.search, shift), x, may_switch & elsewhere)

    def make_step(
        self, state: NewtonState, converged: Bool[Array, ""], wanted: Bool[Array, ""]
    ) -> NextStep:
        """Propose the next step of displacements and tensions: Newton or interior-point method.

        Arguments are those of `StepMethod.make_step`.
        """
        system, point, tension = self.system, state.point, state.point.elements.tension
        load = largest_load(system, system.external_force(point.x), tension)
        unknowns = state.strategy.unknowns.with_interior_mode_if_slack(tension, load)
        given = system, point.x, point.elements, point.residual, load, self.length
        equations = unknowns.step_equations(*given)
        unknowns, residual = equations.unknowns, max_abs(point.residual)
        shift = state.strategy.shift.value(residual, self.length)
        shift = jnp.where(unknowns.uses_line_search, shift, 0.0)
        matrix = linear.add_to_diagonal(equations.matrix(system, point.x, residual), shift)
        # matrices of interior steps differ too much from each other
        similar = ~unknowns.has_interior_matrix
        min_limit = unknowns.interior_point.min_cg_limit
        settings = self.convergence.tol, state.factored, wanted, similar, min_limit
        step, definite, factored = newton_direction(
            system, matrix, equations.rhs, residual / point.scale, *settings
        )
        after, fraction, is_predictor = equations.take_step(system, point.x, step, definite)
        if factored is not None:  # a corrector has the factor of its predictor
            count = jnp.where(unknowns.awaits_corrector, state.factored.count, factored.count)
            factored = copy_with(factored, count=count)
        after, repeats = unknowns.repeat_if_indefinite(after, definite)
        # a fraction that is NaN makes the step an unusable one
        step, stays = fraction * step, converged | is_predictor
        slope = point.residual @ step
        usable = definite & ((slope < 0) | ~unknowns.uses_line_search)
        usable = usable & jnp.isfinite(slope) & ~stays
        own = NetStrategy(after, LineSearch.init(slope), state.strategy.shift)
        return NextStep(own, step, usable, repeats | is_predictor, ~stays, definite, factored)
