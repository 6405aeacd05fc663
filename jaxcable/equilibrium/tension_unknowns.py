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
cone for every straight piece of linear cables (`conic_interior_point`), or in nets with hanging
cables and other laws, and in float32, a bound on every length (`interior_point`).

The iteration is mixed as long as the residual falls; then interior, from the start of the
increment; then it is finished by mixed steps, or with cones by finishing steps of their own,
because interior steps become inaccurate where slack and taut cannot be told apart; and if all of
this fails, it goes on by plain Newton steps with a line search. Nets with cones begin with the
interior iteration where no cable has tension, because mixed steps do not help there
(`with_interior_mode_if_slack`), and leave mixed steps early. Every later change of the mode is one
of `switch_mode`.

Source: Magisano, Leonetti, Garcea, "How to improve efficiency and robustness of the Newton method
in geometrically non-linear structural problem discretized via displacement-based finite elements"
(2017).
"""

from __future__ import annotations

from typing import Any

import jax.numpy as jnp

from ..common.tree import copy_with, pytree, select_tree
from ..common.types import Array, ArrayLike, Bool, Float, Int
from ..mechanics.assembly import System
from ..mechanics.pieces import all_suit_cone_solver
from ..mechanics.tension_responses import CableTensions, prescribed_tensions, rest_lengths
from ..spaces.space import Motion
from .conic_equations import ConicEquations
from .conic_interior_point import ConicInteriorPointState
from .interior_point import InteriorPointState, TensionStepEquations
from .newton_state import Evaluation
from .newton_step import max_abs

FIRST, INTERIOR, FINISH, LINE_SEARCH = range(4)

# Steps within which the residual must halve, and all steps, of a mode: first, finishing, and
# finishing with cones (there all steps of the first mode, too). A mode that makes progress may go
# on for long, one that does not costs little more than its patience.
_PATIENCE, _MAX_STEPS_OF_MODE = (8, 4, 14), (60, 20, 25)
# The patience of the first mode if there are other elements. It counts full steps, too, so that it
# can end these before there are 20.
_FIRST_PATIENCE_WITH_OTHERS = 12
_EARLY = 5, 0.3  # with cones: steps after which a residual over this part of the scale ends a mode
_SLACK = 1e-3  # tension over load up to which cables are slack at the start
# Repeats of steps, in one stay of a net in a mode, with a larger least shift. The shift stays until
# the mode changes; a further indefinite matrix counts as a step that was refused.
_MAX_SHIFTS = 3
# Tension over (predicted tension + load) up to which it makes the geometric stiffness itself: only
# far above the predicted one it comes from a step sideways.
_OWN_TENSION = 3.0
_FIRST_STEPS = 2  # steps whose residuals count as the start: what starts in balance must leave it
_STUCK_BLOCKED = -4  # blocked steps to begin with after a stuck finish: it takes that many more


@pytree
class TensionUnknowns:
    """Tensions as unknowns, and the mode in which the iteration solves for them.

    Attributes:
        mode: `FIRST` (in a net: mixed steps), `INTERIOR` (steps of the interior-point method),
            `FINISH` (Newton steps from its end) or `LINE_SEARCH` (Newton steps with line search).
            In structures with other elements, too (`partial_net`), `FIRST` covers all steps of
            `structure_steps`: full ones, and those with predicted or true axial forces; `FINISH`
            and `LINE_SEARCH` are Newton steps for displacements only, with predicted axial forces.
        guess: tensions for the geometric stiffness of mixed steps, [n], N, of all groups.
        interior_point: state of the interior-point method.
        is_new_mode: whether the mode begins at its next step.
        best_residual: residual when it was last halved, or at the start of the mode, N.
        steps_since_halved: steps since then.
        steps_in_mode: steps since the mode began. An interior iteration that goes on after failed
            finishing steps counts from the first of these, not from zero.
        blocked_steps: interior steps in succession that a bound has made short.
        finish_threshold: `FinishDecision.remaining` below which finishing steps are tried.
        finishes: how often they were tried.
        interior_motion: point of the interior iteration, while finishing steps are tried.
        indefinite_count: in a net, indefinite matrices since the mode began, up to three
            (`repeat_if_indefinite`); beside other elements, indefinite matrices of interior steps
            in succession (`PartialNet.take_step`).
    """

    mode: Int[Array, ""]
    guess: Float[Array, " n"]
    interior_point: ConicInteriorPointState | InteriorPointState
    is_new_mode: Bool[Array, ""]
    best_residual: Float[Array, ""]
    steps_since_halved: Int[Array, ""]
    steps_in_mode: Int[Array, ""]
    blocked_steps: Int[Array, ""]
    finish_threshold: Float[Array, ""]
    finishes: Int[Array, ""]
    interior_motion: Motion
    indefinite_count: Int[Array, ""]

    @classmethod
    def initial(cls, system: System, x: Motion, is_partial_net: bool) -> TensionUnknowns:
        """Return the state at the start of an increment: the first mode, zero tensions.

        Args:
            system: `System`, a net.
            x: motion of all nodes (rows).
            is_partial_net: whether the net is part of a structure with other elements, too. Then
                its interior-point method is that of `interior_point`, not the one with cones.
        """
        zero, first = jnp.zeros((), x.dtype), jnp.int32(0)
        # in float32 the slacks of cones lose their digits before the iteration can be finished
        cones = (
            all_suit_cone_solver(system) and jnp.finfo(x.dtype).eps < 1e-12 and not is_partial_net
        )
        kind = ConicInteriorPointState if cones else InteriorPointState
        return cls(
            mode=jnp.int32(FIRST),
            guess=jnp.zeros_like(rest_lengths(system)),
            interior_point=kind.zeros(system, x),
            is_new_mode=jnp.ones((), bool),
            best_residual=jnp.full_like(zero, jnp.inf),
            steps_since_halved=first,
            steps_in_mode=first,
            blocked_steps=first,
            finish_threshold=jnp.full_like(zero, kind.initial_threshold),
            finishes=first,
            interior_motion=x,
            indefinite_count=first,
        )

    @property
    def has_cones(self) -> bool:
        """Whether the interior-point method is the one with a cone for every piece."""
        return isinstance(self.interior_point, ConicInteriorPointState)

    @property
    def uses_line_search(self) -> Bool[Array, ""]:
        """Whether the mode is `LINE_SEARCH`: Newton steps with a line search."""
        return self.mode == LINE_SEARCH

    @property
    def uses_interior_point(self) -> Bool[Array, ""]:
        """Whether the mode is `INTERIOR`: steps of the interior-point method."""
        return self.mode == INTERIOR

    @property
    def takes_finishing_steps(self) -> Bool[Array, ""]:
        """Whether the mode is `FINISH`: finishing steps after an interior iteration."""
        return self.mode == FINISH

    @property
    def takes_interior_or_finishing_steps(self) -> Bool[Array, ""]:
        """Whether the mode is `INTERIOR` or `FINISH`, whose steps need no line search."""
        return self.uses_interior_point | self.takes_finishing_steps

    def with_first_mode_if(self, wanted: Bool[Array, ""]) -> TensionUnknowns:
        """Return a copy whose mode is `FIRST` if `wanted`, else the same as before."""
        return copy_with(self, mode=jnp.where(wanted, FIRST, self.mode))

    def with_interior_mode_if_slack(
        self, tension: Float[Array, " n"], load: Float[Array, ""]
    ) -> TensionUnknowns:
        """Return a copy whose mode is `INTERIOR` if it has cones, and begins without any tension.

        `tension` are those of all cables, [n], N; `load` is the `largest_load`, N.
        """
        if not self.has_cones:
            return self
        slack = self.is_new_mode & (self.mode == FIRST) & (jnp.max(tension) <= _SLACK * load)
        return copy_with(self, mode=jnp.where(slack, INTERIOR, self.mode))

    @property
    def has_interior_matrix(self) -> Bool[Array, ""]:
        """Whether the matrix is that of an interior step, or of a finishing step with cones.

        They differ too much from each other for conjugate gradients with an earlier factor.
        """
        has_cones = self.has_cones
        return self.takes_interior_or_finishing_steps if has_cones else self.uses_interior_point

    @property
    def awaits_corrector(self) -> Bool[ArrayLike, ""]:
        """Whether a predictor step has been made, and its corrector is the next step."""
        point = self.interior_point
        if not isinstance(point, ConicInteriorPointState):
            return False
        return self.uses_interior_point & point.has_predicted

    @property
    def min_shift_in_eps(self) -> Int[Array, ""]:
        """Least shift of the matrix's diagonal, as a multiple of eps times its largest entry.

        It covers what rounding makes of a zero stiffness, and grows with `indefinite_count`.
        """
        return jnp.where(self.uses_line_search, 1, self.indefinite_count**6)  # 0, 1, 64, 729

    def switch_mode(
        self,
        point: Evaluation,
        begin: Motion,
        accepted: Bool[Array, ""],
        astray: Bool[Array, ""],
        length: Float[Array, ""],
        full_steps_failed: Bool[Array, ""] | None = None,
    ) -> tuple[TensionUnknowns, Motion, Bool[Array, ""]]:
        """Choose the mode after a step: the same, interior, finishing, or line search.

        Args:
            point: `Evaluation` of the point reached.
            begin: start of the increment (motion of all rows).
            accepted: whether the step was accepted (`Trial.accepted`).
            astray: whether the point is far from the structure.
            length: mean length of elements, m.
            full_steps_failed: where the structure has other elements, too: whether the full Newton
                steps with which the iteration began have just failed. The first mode is then left
                if this is true, but not because a step was refused. None for a net.

        Returns:
            The state; the point to go on from; whether this is another one than `point`.
        """
        x, scale, residual = point.x, point.scale, max_abs(point.residual)
        first, interior = self.mode == FIRST, self.uses_interior_point
        finishing = self.takes_finishing_steps
        halved = accepted & (self.is_new_mode | (residual < 0.5 * self.best_residual))
        starts = first & (self.steps_in_mode <= _FIRST_STEPS)
        best = jnp.where(halved | starts, residual, self.best_residual)
        since = jnp.where(halved, 0, self.steps_since_halved + 1)
        lost = astray | ~accepted
        if full_steps_failed is not None:
            lost = jnp.where(first, full_steps_failed, lost)
        if self.has_cones:
            early = (self.steps_in_mode >= _EARLY[0]) & (residual > _EARLY[1] * scale)
            early = early | (since >= jnp.where(first, _PATIENCE[0], _PATIENCE[2]))
            lost = lost | early | (self.steps_in_mode >= _MAX_STEPS_OF_MODE[2])
        else:
            of_first = _PATIENCE[0] if full_steps_failed is None else _FIRST_PATIENCE_WITH_OTHERS
            pairs = (of_first, _PATIENCE[1]), _MAX_STEPS_OF_MODE[:2]
            patience, longest = (jnp.where(first, *pair) for pair in pairs)
            lost = lost | (since >= patience) | (self.steps_in_mode >= longest)
        begins, returns = first & lost, finishing & lost
        given = self, accepted, since, residual / scale, length
        finish = self.interior_point.decide_finish(*given)
        finishes = interior & finish.now
        searches = returns & (self.finishes >= self.interior_point.max_finishes)
        if finish.failed is not None:
            searches = searches | (interior & finish.failed)
        mode = jnp.where(finishes, FINISH, self.mode)  # fewer kernels than `jnp.select`
        mode = jnp.where(searches, LINE_SEARCH, jnp.where(begins | returns, INTERIOR, mode))
        changed = mode != self.mode
        count = self.finishes + 1
        if finish.final is not None:
            count = jnp.where(finish.final, self.interior_point.max_finishes, count)
        blocked = jnp.where(finish.stuck, _STUCK_BLOCKED, 0)
        threshold = 0.1 * jnp.minimum(self.finish_threshold, finish.remaining)
        after = copy_with(
            self,
            mode=mode,
            guess=select_tree(finishes, self.interior_point.tension, self.guess),
            is_new_mode=(begins | searches) | (self.is_new_mode & ~changed),
            best_residual=jnp.where(changed, residual, best),
            steps_since_halved=jnp.where(changed, 0, since),
            steps_in_mode=jnp.where(changed & ~returns, 0, self.steps_in_mode),
            blocked_steps=jnp.where(finishes, blocked, self.blocked_steps),
            finish_threshold=jnp.where(finishes, threshold, self.finish_threshold),
            finishes=jnp.where(finishes, count, self.finishes),
            interior_motion=select_tree(finishes, x, self.interior_motion),
            indefinite_count=jnp.where(changed, 0, self.indefinite_count),
        )
        x = select_tree(begins, begin, select_tree(returns, self.interior_motion, x))
        return after, x, begins | returns

    def repeat_if_indefinite(
        self, after: TensionUnknowns, definite: Bool[Array, ""]
    ) -> tuple[TensionUnknowns, Bool[Array, ""]]:
        """Return the state after a step, and whether to repeat the step with a larger shift.

        It is repeated if its matrix was not `definite`, because rounding can make a zero stiffness
        negative; but only three times in one stay in a mode, and not before a line search.
        Otherwise the state is `after`.
        """
        repeats = ~definite & (self.indefinite_count < _MAX_SHIFTS) & ~self.uses_line_search
        same = copy_with(self, indefinite_count=self.indefinite_count + 1)
        return select_tree(repeats, same, after), repeats

    def step_equations(
        self,
        system: System,
        x: Motion,
        responses: CableTensions,
        residual: Float[Array, " n_free"],
        load: Float[Array, ""],
        length: Float[Array, ""],
    ) -> ConicEquations | TensionStepEquations:
        """Return the linear equations of the next step from x.

        Args:
            system: `System`, a net.
            x: motion of all nodes (rows).
            responses: tensions and end forces at x.
            residual: residual at x, [n_free], N.
            load: `largest_load` at x, N.
            length: mean length of elements, m.
        """
        tension = responses.tension
        guess = select_tree(self.is_new_mode | self.uses_line_search, tension, self.guess)
        guess = jnp.where(tension <= _OWN_TENSION * (guess + load), tension, guess)
        best = jnp.where(self.is_new_mode, max_abs(residual), self.best_residual)
        unknowns = copy_with(self, best_residual=best)
        kind: Any = ConicEquations if self.has_cones else TensionStepEquations
        return kind.at_point(unknowns, system, x, responses, residual, guess, load, length)


def largest_load(
    system: System, force: Float[Array, "n_row 3"], tension: Float[Array, " n"]
) -> Float[Array, ""]:
    """Return the largest load: component of the loads on nodes, or tension set by a jack, N.

    `force` are the loads on all nodes (rows), N; `tension` the tensions of all cables, [n], N.
    """
    load = jnp.max(jnp.abs(force), initial=0.0)
    if (jacked := prescribed_tensions(system)) is not None:
        load = jnp.maximum(load, jnp.max(jnp.where(jacked, tension, 0.0)))
    return load
