"""Detect events between the last accepted point of a continuation and the end of a tried step."""

from __future__ import annotations

import jax.numpy as jnp

from ..mechanics.slips import elements_at_places
from .negative_eigenvalues import eigenvalue_changed_sign, is_unstable, load_mode_alignment
from .path_state import BracketEnd, PathState
from .trial_step import PathProblem, TrialStep

_SHORT = 1e-3  # steps below this part of the first step are accepted around any corner of the path
_ALIGNED = 1e-4  # above this, phi.F / |phi||F| is not zero, as it is at a bifurcation
_FLAT = 1e-3  # below this, the load factor's part of a unit tangent is that of a limit point
# Stiffness near an event over that at its first detection. A smooth one falls with the length of
# the step, which ends at NEAR or below; above this the stiffness jumps (a corner of a law).
_LOW = 1e-3
NEAR = 5e-4
"""Part of the first step within which a bifurcation is interpolated and not approached further.

Nearer, rounding leads corrections onto the other branch. Interpolation leaves an error of the order
of the square of this.
"""


class StepEvents(TrialStep):
    """A tried step of a continuation, and the events in it; attributes are bool unless stated.

    Attributes:
        usable: the end of the step is valid; the path can go on there unless `on_other_branch`.
        newly_slack, newly_taut, newly_slipping, ruptured: elements that go slack, that become taut,
            that begin to slip, and that are strained beyond their rupture strain in the step, those
            of all groups one after the other.
        has_limit_point, has_bifurcation, has_slackening, has_tightening, has_slip, has_failure: the
            step contains an event of this kind.
        on_other_branch: the step has ended on the other branch, close to a bifurcation.
        too_long: the step contains an event but is too long to locate it.
        located: the step contains an event and is short enough to locate it.
        ends_in_failure: the path ends in this step, in which an element fails.
        interpolated: the event is a bifurcation whose load factor is interpolated linearly.
        has_null_vector: the eigenvalue nearest to zero is small enough for its eigenvector to be a
            null vector.
        stiffness: the larger absolute `PathPoint.stiffness` of both ends, N/m.
        bracket_end: `BracketEnd` with the values at the end of the step.
    """

    def __init__(self, problem: PathProblem, current: PathState):
        super().__init__(problem, current)
        settings, a, p, ds = problem.settings, current.anchor, self.point, current.ds
        # close to a bifurcation corrections can end on the other branch; the values there still
        # help to locate the bifurcation
        self.on_other_branch = on_other_branch = (
            self.sound & self.turns_sharply & current.locating & current.bracket_end.has_bifurcation
        )
        turns = self.turns_sharply & ~on_other_branch & (ds > _SHORT * settings.step)
        self.usable = self.sound & ~turns
        known = self.usable & ~self.is_first & ~on_other_branch
        self.has_limit_point = known & ~self.is_load_step & ((p.rise > 0) != (a.rise > 0))
        # the inertia changes at a limit point, too, by rounding just before or after the rise does
        of_limit = (jnp.abs(p.rise) < _FLAT) & (load_mode_alignment(p) > _ALIGNED)
        crossed = known & self.corrected.regular & eigenvalue_changed_sign(p, a) & ~of_limit
        unstable_start = self.usable & self.is_first & is_unstable(p)
        self.has_bifurcation = crossed | unstable_start
        self.newly_slack, self.newly_taut = p.is_slack & ~a.is_slack, a.is_slack & ~p.is_slack
        self.ruptured = jnp.zeros_like(p.is_slack)
        if self.system.has_rupture:
            self.ruptured = self.system.ruptured_elements(self.strains)
        self.has_slackening = known & jnp.any(self.newly_slack)
        self.has_tightening = known & jnp.any(self.newly_taut)
        self.newly_slipping, self.has_slip = jnp.zeros_like(p.is_slack), jnp.zeros((), bool)
        if p.slipping is not None and a.slipping is not None:
            begins = p.slipping & ~a.slipping
            self.newly_slipping = elements_at_places(self.system, p.x, begins)
            self.has_slip = known & jnp.any(begins)
        self.has_failure = self.usable & jnp.any(self.ruptured) & ~on_other_branch
        corner = self.has_slackening | self.has_tightening | self.has_failure
        corner = corner if p.slipping is None else corner | self.has_slip
        smooth = (self.has_limit_point | self.has_bifurcation) & ~corner
        crossing = self.has_limit_point | self.has_bifurcation | corner | on_other_branch
        # Very near to a bifurcation the tangent is lost in rounding. At some distance the stiffness
        # is nearly a straight line through zero, which is interpolated.
        near = ds <= NEAR * settings.step
        self.stiffness = jnp.maximum(jnp.abs(p.stiffness), jnp.abs(a.stiffness))
        self.has_null_vector = current.locating & (self.stiffness <= _LOW * current.first_stiffness)
        low = self.has_null_vector & (p.stiffness * a.stiffness < 0)
        self.interpolated = (
            ((self.has_bifurcation & smooth) | on_other_branch) & ~self.has_limit_point & low & near
        )
        stray = on_other_branch & near  # on the other branch, and no nearer point can be found
        self.too_long = crossing & (ds > current.tol) & ~self.interpolated & ~self.is_first & ~stray
        self.located = crossing & ~self.too_long
        self.ends_in_failure = self.located & self.has_failure
        # where the stiffness is not low near the event, it jumps there
        forks = smooth & self.has_bifurcation & ~self.has_limit_point & (low | ~near)
        self.bracket_end = BracketEnd(p.rise, p.stiffness, p.n_negative, smooth, forks)
