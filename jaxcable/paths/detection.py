"""Detects events between the anchor of a continuation and the end of a step that was tried."""

from __future__ import annotations

import jax.numpy as jnp

from .attempt import Attempt, Course
from .inertia import alignment, crossed, unstable
from .run import Beyond, Run

_SHORT = 1e-3  # steps below this part of the first step are taken around any corner
_ALIGNED = 1e-4  # above this, phi.F / |phi||F| is not zero
_FLAT = 1e-3  # below this, the rise of a unit tangent is that of a limit point
_LOW = 1e-3  # stiffness near an event over that at its first detection; above, stiffness jumps
NEAR = 5e-4  # part of the first step within which a bifurcation is interpolated


class Detection(Attempt):
    """The events in a step that was tried; bool unless said otherwise.

    Attributes:
        usable: its end is valid; the path can go on from there unless `astray`.
        gone_slack, gone_taut, broken: elements that go slack, that become taut, that are strained
            beyond their curve, all groups one after the other.
        limit, branch, slackened, tightened, failed: the step contains a limit point, a bifurcation,
            elements that go slack, elements that become taut, an element strained beyond its curve.
        astray: close to a bifurcation, the step has ended on the other branch.
        wide: the step contains an event and is too long to locate it.
        hit: the step contains an event and is short enough.
        fatal: the path ends in the step with an element that has failed.
        line: the event is a bifurcation that is located by linear interpolation.
        null: the eigenvector of the smallest eigenvalue is a null vector.
        stiffness: the larger `Point.stiffness` of both ends, in size, N/m.
        beyond: `Beyond` at the end of the step.
    """

    def __init__(self, course: Course, run: Run):
        super().__init__(course, run)
        settings, a, p, ds = course.settings, run.anchor, self.point, run.ds
        # close to a bifurcation corrections can end on the other branch; the values there still
        # help to locate the bifurcation
        self.astray = astray = self.sound & self.bent & run.hunting & run.beyond.branch
        turns = self.bent & ~astray & (ds > _SHORT * settings.step)
        self.usable = self.sound & ~turns
        known = self.usable & ~self.fresh & ~astray
        self.limit = known & ~self.by_newton & ((p.rise > 0) != (a.rise > 0))
        # the inertia changes at a limit point, too, by rounding just before or after the rise does
        of_limit = (jnp.abs(p.rise) < _FLAT) & (alignment(p) > _ALIGNED)
        branch = known & self.found.regular & crossed(p, a) & ~of_limit
        self.branch = branch | (self.usable & self.fresh & unstable(p))  # unstable from the start
        self.gone_slack, self.gone_taut = p.slack & ~a.slack, a.slack & ~p.slack
        self.broken = jnp.zeros_like(p.slack)
        if self.system.breaks:
            self.broken = self.system.broken(self.strains)
        self.slackened = known & jnp.any(self.gone_slack)
        self.tightened = known & jnp.any(self.gone_taut)
        self.failed = self.usable & jnp.any(self.broken) & ~astray
        corner = self.slackened | self.tightened | self.failed
        smooth = (self.limit | self.branch) & ~corner
        crossing = self.limit | self.branch | corner | astray
        # Very near to a bifurcation the tangent is lost in rounding. At some distance the stiffness
        # is nearly a straight line through zero, which is interpolated.
        near = ds <= NEAR * settings.step
        self.stiffness = jnp.maximum(jnp.abs(p.stiffness), jnp.abs(a.stiffness))
        self.null = run.hunting & (self.stiffness <= _LOW * run.reference)
        low = self.null & (p.stiffness * a.stiffness < 0)
        self.line = ((self.branch & smooth) | astray) & ~self.limit & low & near
        stray = astray & near  # on the other branch, and no nearer point can be found
        self.wide = crossing & (ds > run.tol) & ~self.line & ~self.fresh & ~stray
        self.hit = crossing & ~self.wide
        self.fatal = self.hit & self.failed
        forks = smooth & self.branch & ~self.limit & (low | ~near)  # otherwise the stiffness jumps
        self.beyond = Beyond(p.rise, p.stiffness, p.negative, smooth, forks)
