"""Tries one step of a continuation; whether it is taken is decided later (`decision`)."""

from __future__ import annotations

import jax.numpy as jnp

from .. import linear
from ..common import status
from ..common.tree import pytree
from ..common.types import Array, Bool, Float, Int
from ..elements.abilities import Uniaxial
from ..equilibrium import newton
from ..equilibrium.newton import Newton
from ..mechanics.assembly import System
from ..mechanics.elementwise import each
from ..mechanics.ramp import Ramp
from .correction import Condition, Corrected, by_load, correct, loose_unknowns
from .run import Point, Run, Settings
from .steps import cosine, scale_of

ARC, FINISH, LOAD = 0, 1, 2  # kinds of step: by arc length, to the last load factor, by load
_BEND = 0.9  # cosine of the largest angle between tangents of neighbouring points
_LEAP = 4.0  # longest way of a correction, in longest steps; beyond is another part of the path
_UNSURE = 64  # strains of so many roundings (eps) are neither taut nor slack
_FAR = 100.0  # displacement, in structure sizes, at which a structure counts as a mechanism


@pytree(static=("capacity",))
class Course:
    """What stays the same along a path.

    Attributes:
        ramp: the phase.
        begin: `System` at load factor 0.
        method: `Newton`.
        settings: `Settings`.
        tol: relative residual that counts as equilibrium.
        extent: size of the structure, m.
        capacity: numbers of points and of events that there is room for.
    """

    ramp: Ramp
    begin: System
    method: Newton
    settings: Settings
    tol: Float[Array, ""]
    extent: Float[Array, ""]
    capacity: tuple[int, int]

    @classmethod
    def of(
        cls, ramp: Ramp, method: Newton, settings: Settings, capacity: tuple[int, int]
    ) -> Course:
        """The course of a phase."""
        dtype = ramp.begin.motion.dtype
        begin = ramp.at(jnp.zeros((), dtype))
        tol = newton.limit(method, dtype)
        return cls(ramp, begin, method, settings, tol, begin.extent(), capacity)


@pytree
class Tried:
    """The result of a step that was tried.

    Attributes:
        found: `Corrected`.
        point: `Point` at its end.
        fresh: whether it is the first point of the path.
        by_newton: whether the step was one of the load factor (`LOAD`).
        newton_code: status of Newton's method in such a step; OK where the energy is not convex,
            because only corrections are made there.
        sound: whether an equilibrium was found, not too far away, with a tangent to the path. (With
            a convex energy a step of the load factor needs no tangent.)
        bent: whether the direction of the path changes sharply in the step.
        far: whether displacements are so large that the structure counts as a mechanism.
        weight: `Run.weight` after the step.
    """

    found: Corrected
    point: Point
    fresh: Bool[Array, ""]
    by_newton: Bool[Array, ""]
    newton_code: Int[Array, ""]
    sound: Bool[Array, ""]
    bent: Bool[Array, ""]
    far: Bool[Array, ""]
    weight: Float[Array, ""]


def attempt(course: Course, run: Run) -> Tried:
    """Try a step from the anchor of a `Run`."""
    ramp, begin, settings = course.ramp, course.begin, course.settings
    a, ds = run.anchor, run.ds
    fresh, by_newton, free = run.n_row == 0, run.mode == LOAD, run.mode == ARC
    factor = a.factor + ds * jnp.where(by_newton, 1.0, a.rise)
    factor = jnp.where(by_newton, jnp.minimum(factor, settings.until), factor)
    end = jnp.where(a.rise > 0, settings.until, settings.down_to)
    factor = jnp.where(run.mode == FINISH, end, factor)
    along = jnp.where(by_newton, 0.0, ds * a.direction * run.weight)
    guess, newton_code = ramp.at(factor, a.memory).move(a.x, along), jnp.int32(status.OK)
    if begin.always_convex:  # else equilibrium is not unique, and Newton could end anywhere
        moved, newton_code = by_load(ramp, a.memory, a.x, factor, course.method, by_newton)
        guess = jnp.where(by_newton, moved, guess)
    sense = jnp.where(a.rise < 0, -1.0, 1.0)  # so that the tangent at the end points onward
    condition = Condition(
        jnp.where(free, a.direction / jnp.where(free, run.weight, 1.0), 0.0),
        jnp.where(free, a.rise, sense),
        jnp.where(free, ds, sense * (factor - a.factor)),
    )
    active = ~by_newton | (newton_code == status.OK)
    found = correct(ramp, a.memory, guess, along, factor, a.factor, condition, course.tol, active)
    weight = jnp.where(run.weight > 0, run.weight, scale_of(found, begin))
    direction, rise = found.direction / weight, found.rise
    size = jnp.sqrt(direction @ direction + rise**2)
    size = jnp.where((size > 0) & jnp.isfinite(size), size, 1.0)
    closing = run.hunting & run.beyond.branch
    point = _point(ramp, a, found, direction / size, rise / size, closing)
    bent = (cosine(a, point) < _BEND) & free
    far = begin.reach(found.x) > _FAR * course.extent
    regular = found.regular | (by_newton & begin.always_convex)
    gone = jnp.sqrt(jnp.sum((found.moved / weight) ** 2) + (found.factor - a.factor) ** 2)
    leapt = free & ~fresh & (gone > _LEAP * jnp.maximum(jnp.sqrt(2.0) * settings.largest, ds))
    sound = found.converged & regular & ~far & ~leapt
    weight = jnp.where(found.regular, weight, run.weight)
    return Tried(found, point, fresh, by_newton, newton_code, sound, bent & ~fresh, far, weight)


def _point(ramp, a, found, direction, rise, closing):
    """The `Point` of a correction from `a`; `closing`: whether a bifurcation is being located."""
    system = ramp.at(found.factor, a.memory)
    loose = loose_unknowns(system, found.x)
    found_out = linear.spectrum(found.matrix, loose, system.may_be_unsymmetric, closing)
    slack = _slack(system, found.x, a.slack)
    return Point(found.x, found.factor, direction, rise, a.memory, *found_out, found.pull, slack)


def _slack(system, motion, before):
    """Slack elements, all groups one after the other; as `before` where strain is rounding only."""
    parts, at = [], 0
    for group, state, now in zip(system.groups, system.states, system.slack(motion), strict=True):
        was, at = before[at : at + len(now)], at + len(now)
        if group.tension_only and isinstance(group, Uniaxial):
            strain = each("strain", group, state, system.nodes, motion)
            unsure = jnp.abs(strain) <= _UNSURE * jnp.finfo(strain.dtype).eps
            now = jnp.where(unsure, was, now)
        parts.append(now)
    return jnp.concatenate(parts)
