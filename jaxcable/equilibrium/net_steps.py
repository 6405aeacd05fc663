"""Steps of nets of cables: displacements and tensions are unknown; whole steps, no line search.

`tension_unknowns` says which kinds of steps there are, and when each of them is taken.
"""

from __future__ import annotations

import jax.numpy as jnp

from ..common.tree import copy_with, select_tree
from ..common.types import Array, ArrayLike, Bool, Float
from ..mechanics.assembly import System
from ..mechanics.tension_responses import TensionResponses, has_load
from ..spaces.space import Motion
from .convergence import Convergence
from .newton_state import Evaluation, NewtonState
from .newton_step import max_abs, newton_direction
from .step_method import ASTRAY, Choice, NextStep, StepMethod, Trial
from .tension_unknowns import TensionUnknowns

# Residual allowed without load, in roundings (eps) of the forces at the start.
_RELEASED_ROUNDINGS = 2.0
# Rounding of plain displacements over the tolerance, from which displacements get a fine part: well
# below 1, because the next point may need it more than this one.
_FINE_PART_FROM = 0.05
# Rounding of a residual over the forces up to which it excuses the residual: above it, the forces
# would not be known to two digits.
_MAX_ROUNDING = 1e-2


class NetSteps(StepMethod):
    """The method of nets of cables."""

    farthest = 1e4  # mixed steps of anchored nets end at a part of it

    def __init__(self, system: System, begin: Motion, convergence: Convergence):
        super().__init__(system, begin, convergence)
        self.is_loaded = has_load(system, begin)

    def initial(self) -> TensionUnknowns:
        """Return the state of the method before the first evaluation."""
        return TensionUnknowns.initial(self.system, self.begin, is_partial_net=False)

    def evaluate_at(self, x: Motion, exact: Bool[ArrayLike, ""]) -> Evaluation:
        """Return the `Evaluation` at `x`, with low-order parts in full if `exact`."""
        elements = TensionResponses.of(self.system, x, exact)
        forces = elements.residual_scale_and_rounding(self.system, x)
        return Evaluation(x, *forces, elements, jnp.asarray(exact))

    def evaluate(self, state: NewtonState, x: Motion) -> Evaluation:
        """Return the `Evaluation` at `x`, with low-order parts in full if they matter."""
        return self.evaluate_at(x, ~state.progress.has_begun | self._needs_fine_part(state.point))

    def _needs_fine_part(self, point):
        """Return whether the next point needs the low-order part of displacements."""
        # rounding is that of a fine part, of eps times the displacement and not eps^2
        eps, least = jnp.finfo(point.scale.dtype).eps, point.scale
        if self.convergence.criterion is not None:
            least = jnp.minimum(least, self.convergence.criterion.added_load)
        return max_abs(point.rounding) > _FINE_PART_FROM * eps * self.convergence.tol * least

    def is_exact_enough(self, point: Evaluation) -> Bool[Array, ""]:
        """Return whether an equilibrium is one with the fine part, where that matters.

        A long step may lead to where it does, from where it did not.
        """
        return point.exact | ~self._needs_fine_part(point)

    def trial_point(self, state: NewtonState) -> Motion:
        """Return the motion after the whole step."""
        return self.system.move(state.point.x, state.step)

    def judge(
        self, state: NewtonState, tried: Evaluation
    ) -> tuple[TensionUnknowns, float, Bool[Array, ""], Bool[Array, ""]]:
        """Accept every point with finite forces."""
        return state.strategy, 1.0, jnp.isfinite(tried.scale), jnp.zeros((), bool)

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
        point, unknowns, may_switch = state.point, state.strategy, moved & ~converged
        astray = self.system.largest_displacement(point.x) > ASTRAY * self.extent
        given = point, self.begin, trial.accepted, astray, self.length
        new, x, elsewhere, gives_up = unknowns.switch_mode(*given)
        after, x = select_tree(may_switch, (new, x), (unknowns, point.x))
        return Choice(after, x, may_switch & elsewhere, may_switch & gives_up)

    def make_step(
        self, state: NewtonState, converged: Bool[Array, ""], wanted: Bool[Array, ""]
    ) -> NextStep:
        """Make the next step, of displacements and tensions."""
        system, point = self.system, state.point
        given = system, point.x, point.elements, point.residual, self.length
        equations = state.strategy.step_equations(*given)
        unknowns, residual = equations.unknowns, max_abs(point.residual)
        matrix = equations.matrix(system, point.x, residual)
        # matrices of interior steps differ too much from each other
        similar = system.convex & ~unknowns.has_interior_matrix
        min_limit = unknowns.interior_point.min_cg_limit
        given = system, matrix, equations.rhs, residual / point.scale, self.convergence.tol
        step, definite, factored = newton_direction(
            *given, state.factored, wanted, similar, min_limit
        )
        after, fraction, is_predictor = equations.take_step(system, point.x, step, definite)
        if factored is not None:  # a corrector has the factor of its predictor
            count = jnp.where(unknowns.awaits_corrector, state.factored.count, factored.count)
            factored = copy_with(factored, count=count)
        after, again = unknowns.repeat_if_indefinite(after, definite)
        step, stays = fraction * step, converged | is_predictor
        usable = definite & jnp.isfinite(point.residual @ step) & ~stays
        return NextStep(after, step, usable, again | is_predictor, ~stays, definite, factored)
