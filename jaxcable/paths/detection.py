"""Detects events between the anchor of a continuation and the end of a step that was tried."""

from __future__ import annotations

import jax.numpy as jnp

from ..common.tree import pytree
from ..common.types import Array, Bool, Float
from .attempt import Course, Tried
from .inertia import alignment, crossed, unstable
from .run import Beyond, Run

_SHORT = 1e-3  # steps below this part of the first step are taken around any corner
_ALIGNED = 1e-4  # above this, phi.F / |phi||F| is not zero
_FLAT = 1e-3  # below this, the rise of a unit tangent is that of a limit point
_LOW = 1e-3  # stiffness near an event over that at its first detection; above, stiffness jumps
NEAR = 5e-4  # part of the first step within which a bifurcation is interpolated


@pytree
class Seen:
    """What was detected in a step; bool unless said otherwise.

    Attributes:
        usable: its end is valid; the path can go on from there unless `astray`.
        limit, branch, slackened, tightened, failed: the step contains a limit point, a bifurcation,
            elements that go slack, elements that become taut, an element strained beyond its curve.
        astray: close to a bifurcation, the step has ended on the other branch.
        wide: the step contains an event and is too long to locate it.
        hit: the step contains an event and is short enough.
        line: the event is a bifurcation that is located by linear interpolation.
        null: the eigenvector of the smallest eigenvalue is a null vector.
        stiffness: the larger `Point.stiffness` of both ends, in size, N/m.
        now: `Beyond` at the end of the step.
    """

    usable: Bool[Array, ""]
    limit: Bool[Array, ""]
    branch: Bool[Array, ""]
    slackened: Bool[Array, ""]
    tightened: Bool[Array, ""]
    failed: Bool[Array, ""]
    astray: Bool[Array, ""]
    wide: Bool[Array, ""]
    hit: Bool[Array, ""]
    line: Bool[Array, ""]
    null: Bool[Array, ""]
    stiffness: Float[Array, ""]
    now: Beyond

    @property
    def crossing(self) -> Bool[Array, ""]:
        """Whether the step contains an event."""
        return self.wide | self.hit

    @property
    def fatal(self) -> Bool[Array, ""]:
        """Whether the path ends with an element that has failed."""
        return self.hit & self.failed


def detect(course: Course, run: Run, tried: Tried) -> Seen:
    """The `Seen` of a step that was tried."""
    settings, a, p, ds = course.settings, run.anchor, tried.point, run.ds
    # close to a bifurcation corrections can end on the other branch; the values there still help to
    # locate the bifurcation
    astray = tried.sound & tried.bent & run.hunting & run.beyond.branch
    usable = tried.sound & ~(tried.bent & ~astray & (ds > _SHORT * settings.step))
    known = usable & ~tried.fresh & ~astray
    limit = known & ~tried.by_newton & ((p.rise > 0) != (a.rise > 0))
    # the inertia changes at a limit point, too, by rounding just before or after the rise does
    of_limit = (jnp.abs(p.rise) < _FLAT) & (alignment(p) > _ALIGNED)
    branch = known & tried.found.regular & crossed(p, a) & ~of_limit
    branch = branch | (usable & tried.fresh & unstable(p))  # unstable from the start
    slackened = known & jnp.any(p.slack & ~a.slack)
    tightened = known & jnp.any(a.slack & ~p.slack)
    failed = usable & _broken(course, a, p) & ~astray
    smooth = (limit | branch) & ~(slackened | tightened | failed)
    crossing = limit | branch | slackened | tightened | failed | astray
    # Very near to a bifurcation the tangent is lost in rounding. At some distance the stiffness is
    # nearly a straight line through zero, which is interpolated.
    near = ds <= NEAR * settings.step
    stiffness = jnp.maximum(jnp.abs(p.stiffness), jnp.abs(a.stiffness))
    null = run.hunting & (stiffness <= _LOW * run.reference)
    low = null & (p.stiffness * a.stiffness < 0)
    line = ((branch & smooth) | astray) & ~limit & low & near
    stray = astray & near  # on the other branch, and no nearer point can be found
    wide = crossing & (ds > run.tol) & ~line & ~tried.fresh & ~stray
    forks = smooth & branch & ~limit & (low | ~near)  # otherwise the stiffness jumps
    now = Beyond(p.rise, p.stiffness, p.negative, smooth, forks)
    kinds = limit, branch, slackened, tightened, failed
    return Seen(usable, *kinds, astray, wide, crossing & ~wide, line, null, stiffness, now)


def _broken(course, a, p):
    """Whether an element is strained beyond its curve at a point."""
    system = course.ramp.at(p.factor, a.memory)
    return system.beyond(p.x) if system.breaks else jnp.zeros((), bool)
