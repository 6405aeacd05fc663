"""Tries one step of a continuation; whether it is taken is decided later (`decision`)."""

from __future__ import annotations

import jax.numpy as jnp

from .. import linear
from ..common import status
from ..common.types import Array, Bool
from ..elements.abilities import Uniaxial
from ..equilibrium import newton
from ..equilibrium.newton import Newton
from ..mechanics.elementwise import each
from ..mechanics.ramp import Ramp
from .correction import correct, loose_unknowns
from .run import Point, Run, Settings
from .steps import cosine, scale_of

ARC, FINISH, LOAD = 0, 1, 2  # kinds of step: by arc length, to the last load factor, by load
_BEND = 0.9  # cosine of the largest angle between tangents of neighbouring points
_LEAP = 4.0  # longest way of a correction, in longest steps; beyond is another part of the path
_UNSURE = 64  # strains of so many roundings (eps) are neither taut nor slack
_FAR = 100.0  # displacement, in structure sizes, at which a structure counts as a mechanism


class Course:
    """What stays the same along a path.

    Args:
        ramp: the phase.
        method: `Newton`.
        settings: `Settings`.
        capacity: numbers of points and of events that there is room for.

    Attributes:
        begin: `System` at load factor 0.
        tol: relative residual that counts as equilibrium.
        extent: size of the structure, m.
    """

    def __init__(self, ramp: Ramp, method: Newton, settings: Settings, capacity: tuple[int, int]):
        self.ramp, self.method, self.settings, self.capacity = ramp, method, settings, capacity
        dtype = ramp.begin.motion.dtype
        self.begin = ramp.at(jnp.zeros((), dtype))
        self.tol, self.extent = newton.limit(method, dtype), self.begin.extent()


class Attempt:
    """A step that is tried from the anchor of a `Run`.

    Attributes:
        course, run: the path, and where it stands before the step.
        fresh: whether it is the first point of the path.
        by_newton: whether the step is one of the load factor (`LOAD`).
        newton_code: status of Newton's method in such a step; OK where the energy is not convex,
            because only corrections are made there.
        found: `Corrected`.
        system: `System` at the end of the step.
        point: `Point` there.
        strains: section strains there; empty if no law breaks or has a memory.
        sound: whether an equilibrium was found, not too far away, with a tangent to the path. (With
            a convex energy a step of the load factor needs no tangent.)
        bent: whether the direction of the path changes sharply in the step.
        far: whether displacements are so large that the structure counts as a mechanism.
        weight: `Run.weight` after the step.
    """

    def __init__(self, course: Course, run: Run):
        self.course, self.run = course, run
        self.fresh, self.by_newton = run.n_row == 0, run.mode == LOAD
        self._correct()
        settings, begin, a, found = course.settings, course.begin, run.anchor, self.found
        free = run.mode == ARC
        weight = jnp.where(run.weight > 0, run.weight, scale_of(found, begin))
        self.system = system = course.ramp.at(found.factor, a.memory)
        self.point = self._point(weight)
        looks = system.breaks or system.remembers
        self.strains = system.strains(found.x) if looks else []
        self.bent = (cosine(a, self.point) < _BEND) & free & ~self.fresh
        self.far = begin.reach(found.x) > _FAR * course.extent
        regular = found.regular | (self.by_newton & begin.always_convex)
        gone = jnp.sqrt(jnp.sum((found.moved / weight) ** 2) + (found.factor - a.factor) ** 2)
        longest = jnp.maximum(jnp.sqrt(2.0) * settings.largest, run.ds)
        leapt = free & ~self.fresh & (gone > _LEAP * longest)
        self.sound = found.converged & regular & ~self.far & ~leapt
        self.weight = jnp.where(found.regular, weight, run.weight)

    def _correct(self):
        """Go along the tangent, or by Newton's method to a load factor, and onto the path."""
        ramp, settings, by_newton = self.course.ramp, self.course.settings, self.by_newton
        run, a, ds = self.run, self.run.anchor, self.run.ds
        free = run.mode == ARC
        factor = a.factor + ds * jnp.where(by_newton, 1.0, a.rise)
        factor = jnp.where(by_newton, jnp.minimum(factor, settings.until), factor)
        end = jnp.where(a.rise > 0, settings.until, settings.down_to)
        factor = jnp.where(run.mode == FINISH, end, factor)
        along = jnp.where(by_newton, 0.0, ds * a.direction * run.weight)
        system = ramp.at(factor, a.memory)
        x, self.newton_code = system.move(a.x, along), jnp.int32(status.OK)
        if system.always_convex:  # else equilibrium is not unique, and Newton could end anywhere
            ended, _ = newton.equilibrate(system, a.x, self.course.method, by_newton)
            x, self.newton_code = jnp.where(by_newton, ended.x, x), ended.code
        sense = jnp.where(a.rise < 0, -1.0, 1.0)  # so that the tangent at the end points onward
        condition = (
            jnp.where(free, a.direction / jnp.where(free, run.weight, 1.0), 0.0),
            jnp.where(free, a.rise, sense),
            jnp.where(free, ds, sense * (factor - a.factor)),
        )
        guess, active = (x, along, factor), ~by_newton | (self.newton_code == status.OK)
        tol = self.course.tol
        self.found = correct(ramp, a.memory, guess, a.factor, condition, tol, active)

    def _point(self, weight):
        """The `Point` at the end of the step, its tangent in displacements over `weight`."""
        a, found, system = self.run.anchor, self.found, self.system
        direction, rise = found.direction / weight, found.rise
        size = jnp.sqrt(direction @ direction + rise**2)
        size = jnp.where((size > 0) & jnp.isfinite(size), size, 1.0)
        closing = self.run.hunting & self.run.beyond.branch  # a bifurcation is being located
        loose = loose_unknowns(system, found.x)
        inertia = linear.spectrum(found.matrix, loose, system.may_be_unsymmetric, closing)
        return Point(
            *(found.x, found.factor, direction / size, rise / size, a.memory),
            *inertia,
            *(found.pull, self._slack()),
        )

    def _slack(self) -> Bool[Array, " n_elem"]:
        """Slack elements, all groups one after the other; as before where strain is rounding."""
        system, x = self.system, self.found.x

        def is_unsure(group, state):
            if not (group.tension_only and isinstance(group, Uniaxial)):
                return jnp.zeros(len(group.links), bool)
            strain = each("strain", group, state, system.nodes, x)
            return jnp.abs(strain) <= _UNSURE * jnp.finfo(strain.dtype).eps

        unsure = jnp.concatenate([*map(is_unsure, system.groups, system.states)])
        return jnp.where(unsure, self.run.anchor.slack, jnp.concatenate(system.slack(x)))
