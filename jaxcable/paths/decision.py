"""Decides after a step of a continuation: whether it is taken, the next step, and the end."""

from __future__ import annotations

import jax.numpy as jnp

from ..common import status
from ..common.tree import copy, where
from .attempt import ARC, FINISH, LOAD, Course
from .detection import NEAR, Detection
from .run import Run
from .steps import cosine, guess_ahead, stride

_EASY = 3  # iterations after which the next step has the same length
_STRAIGHT = 0.999  # cosine of the angle between tangents where a soft path counts as straight
_SOFT = 0.05  # part of the load factor in the tangent below which a path counts as soft
_TRIES = 30  # tries per point of the path, on average, before giving up


class Decision(Detection):
    """What is decided about a step that was tried, all bool.

    Attributes:
        outside: it passes the last load factor; next, a step onto that load factor is tried.
        accept: it is taken, and its end is the next anchor.
        last: with this step the path is complete.
        stopping: the path stops at the event in this step.
        record: a point is recorded: the end of the step, or its start if an element fails in it.
        again: it has failed, and a shorter one is tried next.
        exhausted: it has failed and cannot be shortened any more.
        rescue: it is exhausted, and a step of the load factor is tried next.
        soft: little stiffness along the path is left.
    """

    def __init__(self, course: Course, run: Run):
        super().__init__(course, run)
        settings, p, by_load = course.settings, self.point, self.by_newton
        inside = (p.factor < settings.until) & (p.factor > settings.down_to)
        plain = self.usable & ~self.wide & ~self.hit & (run.mode == ARC)
        self.outside = plain & ~self.fresh & ~inside
        self.accept = self.usable & ~self.outside & ~self.wide & ~self.fatal & ~self.astray
        reached = by_load & (p.factor >= settings.until)
        self.last = self.accept & ((run.mode == FINISH) | reached)
        self.record = self.accept & (~run.hunting | self.hit | self.last)
        self.record = self.record | (self.fatal & run.hunting)
        critical = self.limit | self.branch | self.astray
        self.stopping = self.hit & critical & ~self.failed & ~settings.through
        # a failed step is tried again, shorter; at last by load, where equilibrium is unique
        self.again = ~self.usable & ~self.far
        self.exhausted = self.again & (0.25 * run.ds < 0.1 * settings.tol)
        self.rescue = self.exhausted & ~by_load & course.begin.always_convex
        self.soft = (p.rise > 0) & (p.rise < _SOFT) & (p.negative == 0)

    def proceed(self) -> Run:
        """The `Run` after the step, without its records, status and end."""
        run, settings, a, p = self.run, self.course.settings, self.run.anchor, self.point
        anchor = where(self.accept, self._settled(), a)
        # the anchor stays on the path, but counts as beyond the bifurcation that was recorded
        passed = {
            of: jnp.where(self.hit & self.astray, getattr(run.beyond, of), getattr(anchor, of))
            for of in ("negative", "stiffness")
        }
        anchor = copy(anchor, **passed)
        nominal = self._nominal()
        bracket = jnp.where(self.accept & run.hunting, run.bracket - run.ds, run.bracket)
        bracket = jnp.where(self.wide, run.ds, bracket)
        beyond = where(self.wide & ~self.astray, self.beyond, run.beyond)
        close = jnp.where(beyond.branch, NEAR * settings.step, run.tol)
        over = self.accept & run.hunting & (bracket <= close)
        hunting = (run.hunting | self.wide) & ~self.hit & ~over & ~self.last
        ahead = guess_ahead(anchor, beyond, bracket, run.tries, close)
        ds = jnp.where(self.again, 0.25 * run.ds, jnp.where(hunting, ahead, nominal))
        by_load = (self.accept & ~self.found.regular) | self.rescue
        by_load = by_load | ((self.again | self.wide) & self.by_newton)
        mode = jnp.where(by_load, LOAD, jnp.where(self.outside, FINISH, ARC))
        reach = jnp.where(p.factor >= settings.until, settings.until, settings.down_to)
        span = (reach - a.factor) / jnp.where(a.rise == 0, 1.0, a.rise)
        ds = jnp.where(self.outside, jnp.abs(span), ds)
        onward_by_load = by_load & self.accept & ~hunting
        return copy(
            run,
            anchor=anchor,
            mode=mode.astype(jnp.int32),
            ds=jnp.where(self.rescue | onward_by_load, settings.step, ds),
            nominal=nominal,
            reference=jnp.where(self.wide & ~run.hunting, self.stiffness, run.reference),
            weight=self.weight,
            hunting=hunting & ~self.rescue,
            bracket=bracket,
            beyond=beyond,
            # rounding has moved the event out of its bracket: enlarge the tolerance
            tol=jnp.where(self.hit, settings.tol, run.tol * jnp.where(over, 4.0, 1.0)),
            tries=run.tries + 1,
        )

    def _settled(self):
        """The end of the step, with the memory of laws after the increment to it."""
        if not self.system.remembers:
            return self.point
        return copy(self.point, memory=self.system.settle(self.point.x, self.strains))

    def _nominal(self):
        """Length of an ordinary step, longer after few iterations; it affects no result."""
        run, settings, p = self.run, self.course.settings, self.point
        ease = jnp.sqrt(_EASY / jnp.maximum(self.found.steps, 1).astype(run.ds.dtype))
        plain = self.accept & ~run.hunting & ~self.hit & (run.mode == ARC)
        nominal = run.nominal * jnp.where(plain, jnp.clip(ease, 0.5, 2.0), 1.0)
        first = self.fresh | (run.weight == 0)
        nominal = jnp.where(self.accept & first, jnp.sqrt(2.0) * settings.step, nominal)
        longest = jnp.sqrt(2.0) * settings.largest
        straight = plain & self.soft & (cosine(run.anchor, p) > _STRAIGHT)
        wide_step = stride(p, self.weight, self.course.extent, settings.largest)
        longest = jnp.where(straight, jnp.maximum(longest, wide_step), longest)
        return jnp.minimum(nominal, longest)

    def ended(self, run: Run) -> Run:
        """The `Run` after the step and its records, with its status, and whether it has ended."""
        n_row, n_event = self.course.capacity
        code = self.newton_code
        done = self.last | self.stopping | self.fatal
        many = run.n_event > n_event
        full = ~done & ((run.n_row >= n_row) | many)
        lost = ~done & (run.tries > _TRIES * n_row)
        stopped = jnp.where(self.limit, status.LIMIT_POINT, status.BIFURCATION)
        given_up, by_newton = self.exhausted & ~self.rescue, self.by_newton & (code != status.OK)
        first, found = self.again & self.fresh, self.found
        happened, codes = zip(
            (self.stopping, stopped),
            (self.fatal, status.MATERIAL_FAILURE),
            (~self.usable & self.far, status.MECHANISM),
            (given_up & by_newton, code),
            (first & ~jnp.isfinite(found.scale), status.NONFINITE),
            (first & found.converged & ~found.regular, status.SINGULAR),
            (given_up | lost, status.PATH_LOST),
            (full & self.soft & (run.n_event == 0), status.EXCESSIVE_DEFORMATION),
            (full & many, status.OUT_OF_EVENTS),
            (full, status.OUT_OF_POINTS),
            strict=True,
        )
        code = jnp.select(happened, codes, status.OK).astype(jnp.int32)
        return copy(run, code=code, done=done | (code != status.OK))
