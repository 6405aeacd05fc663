"""The contract of the methods that make steps, and how the iteration uses them.

There are two: `NetSteps` for nets of cables, `StructureSteps` for everything else. `iteration` has
what they share: it evaluates the point to which a step leads, compares the residual with the
tolerances, counts steps, and ends. In each iteration it calls, in this order,

    trial_point -> evaluate -> judge -> granted_residual -> choose -> make_step

where all but the last run in every iteration, and `make_step` only if a step is wanted. What a
method remembers from step to step is a pytree of its own, ``state.strategy``. (`start_rounding` and
`is_exact_enough` belong to the comparison.)
"""

from __future__ import annotations

from typing import Any, NamedTuple, TypeAlias

import jax.numpy as jnp

from ..common.tree import copy_with
from ..common.types import Array, ArrayLike, Bool, Float, PyTree
from ..linear.sparse import FactorRecord
from ..mechanics.assembly import System
from ..spaces.space import Motion
from .convergence import Convergence
from .newton_state import Evaluation, NewtonState

Verdict: TypeAlias = 'tuple[Bool[Array, ""], Bool[Array, ""]]'
"""Whether a point is accepted, and whether to try another length of the step."""


class Trial(NamedTuple):
    """Verdict on a trial point: whether it is accepted, and at which length of the step.

    Attributes:
        accepted: whether the iteration goes to this point. False, too, after `NextStep` was neither
            usable nor repeated: then there was no trial, and what is decided is that on a step
            that was refused.
        step_length: the length of the line search that was tried, as a part of the step, from 0
            to 1.
        search_over: whether no other length of the same step is to be tried.
    """

    accepted: Bool[Array, ""]
    step_length: Float[ArrayLike, ""]
    search_over: Bool[Array, ""]


class Choice(NamedTuple):
    """How an iteration goes on after a step.

    Attributes:
        strategy: state of the method.
        x: motion from which it goes on.
        elsewhere: whether this is another point than that of the last evaluation.
    """

    strategy: PyTree[Array]
    x: Motion
    elsewhere: Bool[Array, ""]


class NextStep(NamedTuple):
    """The next step of an iteration.

    Attributes:
        strategy: state of the method.
        step: the step, [n_free], already cut to the fraction that may be tried.
        usable: whether it is to be tried.
        repeats: whether it is no failure if it is not: another one is made from the same point.
            Without this an unusable step counts as one that was refused.
        counts: whether it is one of the steps that are counted: not if it only judges stability, or
            is the first half of a step.
        definite: whether the symmetric part of its matrix is positive definite.
        factored: last factored sparse matrix, or None.
    """

    strategy: PyTree[Array]
    step: Float[Array, " n_free"]
    usable: Bool[Array, ""]
    repeats: Bool[Array, ""]
    counts: Bool[Array, ""]
    definite: Bool[Array, ""]
    factored: FactorRecord | None


class StepMethod:
    """A method that makes the steps of an iteration to equilibrium: what both have in common.

    Args:
        system: `System`.
        begin: motion at the start of the increment.
        convergence: `Convergence` of the increment.

    Attributes:
        farthest: displacement, in structure sizes, beyond which the structure is a mechanism.
        length, extent: mean length of elements, and size of the structure, m.
    """

    farthest: float

    def __init__(self, system: System, begin: Motion, convergence: Convergence):
        self.system, self.begin, self.convergence = system, begin, convergence
        self.length, self.extent = system.length_scale(), system.extent()

    def initial(self) -> Any:
        """Return the state of the method before the first evaluation."""
        raise NotImplementedError

    def trial_point(self, state: NewtonState) -> Motion:
        """Return the motion after the length of the step that is tried."""
        return self.system.move(state.point.x, state.strategy.search.length * state.step)

    def evaluate_at(self, x: Motion, exact: Bool[ArrayLike, ""]) -> Evaluation:
        """Return the `Evaluation` at `x`; if `exact`, with the precision of low-order parts."""
        raise NotImplementedError

    def evaluate(self, state: NewtonState, x: Motion) -> Evaluation:
        """Return the `Evaluation` at `x`, in the precision that the iteration needs there."""
        return self.evaluate_at(x, True)

    def judge(
        self, state: NewtonState, tried: Evaluation
    ) -> tuple[Any, Float[ArrayLike, ""], Bool[Array, ""], Bool[Array, ""]]:
        """Judge a trial point: by its line search, unless `accept` says otherwise.

        Returns:
            State of the method; the length of the step that was tried; whether the point is
            accepted; whether to try another length.
        """
        own, slope = state.strategy, self.energy_slope(state, tried)
        slope = jnp.where(jnp.isfinite(tried.scale), slope, jnp.inf)
        search, fine, again = own.search.update(slope)
        fine, again = self.accept(state, tried, (fine, again))
        return copy_with(own, search=search), own.search.length, fine, again

    def energy_slope(self, state: NewtonState, tried: Evaluation) -> Float[Array, ""]:
        """Return the derivative of the energy at the point `tried` along the step, J."""
        return tried.residual @ state.step

    def accept(self, state: NewtonState, tried: Evaluation, searched: Verdict) -> Verdict:
        """Return whether a point is accepted, and whether to try another length of the step.

        Args:
            state, tried: `NewtonState` and the `Evaluation` at the point.
            searched: what the line search decides of both.
        """
        raise NotImplementedError

    def start_rounding(self, point: Evaluation) -> Array | None:
        """Return which residual the rounding of the first point excuses throughout, N."""
        return point.rounding

    def granted_residual(
        self, rounding: Float[Array, " n_free"], start: Array, scale: Float[Array, ""]
    ) -> Float[Array, " n_free"]:
        """Return which residual the rounding of displacements excuses, [n_free], N.

        Args:
            rounding: `Evaluation.rounding` of the point.
            start: `start_rounding` of the first point.
            scale: force that residuals are compared with, N.
        """
        return jnp.maximum(rounding, start)

    def is_exact_enough(self, point: Evaluation) -> Bool[ArrayLike, ""]:
        """Return whether an equilibrium at `point` is one in the precision that it needs."""
        return True

    def choose(
        self, state: NewtonState, trial: Trial, moved: Bool[Array, ""], converged: Bool[Array, ""]
    ) -> Choice:
        """Choose how the iteration goes on.

        Args:
            state: `NewtonState` after the trial.
            trial: `Trial`.
            moved: whether a step has come to its end.
            converged: whether the point is an equilibrium.
        """
        raise NotImplementedError

    def make_step(
        self, state: NewtonState, converged: Bool[Array, ""], wanted: Bool[Array, ""]
    ) -> NextStep:
        """Propose the next step; at an equilibrium only find out whether the tangent is definite.

        The step is not taken: a `NextStep` has its direction, whether it is usable, and the state
        of the method after it.

        Args:
            state: `NewtonState`, with the chosen kind of step.
            converged: whether its point is an equilibrium.
            wanted: False if the result does not matter (a finished case of a batch).
        """
        raise NotImplementedError
