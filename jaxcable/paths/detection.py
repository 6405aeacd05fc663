"""What has changed between the anchor of a continuation and the point that a step led to."""

from __future__ import annotations

import jax.numpy as jnp

from ..common.tree import pytree
from ..common.types import Array, Bool, Float
from .attempt import Course, Tried
from .inertia import alignment, crossed, unstable
from .run import Beyond, Run

_SHORT = 1e-3  # steps of this part of the first one are taken round any corner
_ALIGNED = 1e-4  # phi.F / |phi||F| above this is not zero
_FLAT = 1e-3  # rise of a unit tangent this small is that of a limit point
_LOW = 1e-3  # stiffness beside an event over that where it was first seen; else it jumps
NEAR = 5e-4  # part of the first step within which a bifurcation is interpolated


@pytree
class Seen:
    """What a step shows; bool unless said otherwise.

    Attributes:
        usable: whether its end says anything; one may go on from there unless it is astray.
        limit, branch, slackened, tightened, failed: what lies in it: a limit point, a bifurcation,
            elements that go slack or taut, one strained beyond its curve.
        astray: close to a bifurcation it has ended on the other branch.
        wide: something lies in it, and it is too long to tell where.
        hit: something lies in it, and it is short enough.
        line: a bifurcation, whose place is interpolated on a line.
        null: whether the eigenvector of the smallest eigenvalue is a null vector.
        stiffness: the larger one at both ends, N/m.
        now: the state at its end, `Beyond`.
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
        """Whether anything lies in the step."""
        return self.wide | self.hit

    @property
    def fatal(self) -> Bool[Array, ""]:
        """Whether the path ends with an element that has failed."""
        return self.hit & self.failed


def detect(course: Course, run: Run, tried: Tried) -> Seen:
    """`Seen` of a step that was tried."""
    settings, a, p, ds = course.settings, run.anchor, tried.point, run.ds
    # close to a bifurcation corrections can end on the other branch: what is there still tells
    # of the bifurcation
    astray = tried.sound & tried.bent & run.hunting & run.beyond.branch
    usable = tried.sound & ~(tried.bent & ~astray & (ds > _SHORT * settings.step))
    known = usable & ~tried.fresh & ~astray
    limit = known & ~tried.by_newton & ((p.rise > 0) != (a.rise > 0))
    # the inertia changes at a limit point too, a hair before or after the load factor turns
    of_limit = (jnp.abs(p.rise) < _FLAT) & (alignment(p) > _ALIGNED)
    branch = known & tried.found.regular & crossed(p, a) & ~of_limit
    branch = branch | (usable & tried.fresh & unstable(p))  # unstable from the start
    slackened = known & jnp.any(p.slack & ~a.slack)
    tightened = known & jnp.any(a.slack & ~p.slack)
    failed = usable & _broken(course, a, p) & ~astray
    smooth = (limit | branch) & ~(slackened | tightened | failed)
    crossing = limit | branch | slackened | tightened | failed | astray
    # Too near to a bifurcation the tangent is lost in rounding; at some distance its stiffness is
    # a straight line through zero.
    near = ds <= NEAR * settings.step
    stiffness = jnp.maximum(jnp.abs(p.stiffness), jnp.abs(a.stiffness))
    null = run.hunting & (stiffness <= _LOW * run.reference)
    low = null & (p.stiffness * a.stiffness < 0)
    line = ((branch & smooth) | astray) & ~limit & low & near
    stray = astray & near  # on the other branch already, and as near as one gets
    wide = crossing & (ds > run.tol) & ~line & ~tried.fresh & ~stray
    forks = smooth & branch & ~limit & (low | ~near)  # or else the stiffness jumps
    now = Beyond(p.rise, p.stiffness, p.negative, smooth, forks)
    kinds = limit, branch, slackened, tightened, failed
    return Seen(usable, *kinds, astray, wide, crossing & ~wide, line, null, stiffness, now)


def _broken(course, a, p):
    """Whether an element is strained beyond its curve at a point."""
    system = course.ramp.at(p.factor, a.memory)
    return system.beyond(p.x) if system.breaks else jnp.zeros((), bool)
