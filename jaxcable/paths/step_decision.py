"""Decide after a step of a continuation: whether it is accepted, the next step, and the end."""

from __future__ import annotations

import jax.numpy as jnp

from ..common import status
from ..common.tree import copy_with, select_tree
from .path_state import PathState
from .step_events import NEAR, StepEvents
from .step_length import bracketing_step_length, cosine_between_tangents, low_stiffness_step_length
from .trial_step import ARC, FINISH, LOAD, PathProblem

_EASY = 3  # iterations after which the next step has the same length (Crisfield 1991, ch. 9)
_STRAIGHT = 0.999  # cosine between tangents, 2.6 degrees, from which on a soft path is straight
_SOFT = 0.05  # load factor's part of the unit tangent below which a path counts as soft
_MAX_TRIES = 30  # tried steps per recorded point, on average, before the path counts as lost


class StepDecision(StepEvents):
    """A tried step of a continuation, whether it is accepted, and what comes next (all bool).

    Attributes:
        overshoots: the step passes the last load factor; a step onto that load factor is tried
            next.
        accepted: the end of the step is the point from which the next step starts.
        completes_path: the path is complete with this step.
        stops_at_event: the path ends at the event in this step, as the user wants
            (``through=False``).
        records_point: a point is recorded: the end of the step, or its start if an element fails.
        retry: the step has failed, and a shorter one is tried next.
        cannot_shorten: the step has failed and cannot be shortened any more.
        retry_by_load: such a step is followed by one with a prescribed load factor.
        is_soft: little stiffness along the path is left.
    """

    def __init__(self, problem: PathProblem, current: PathState):
        super().__init__(problem, current)
        settings, p, by_load = problem.settings, self.point, self.is_load_step
        inside = (p.load_factor < settings.until) & (p.load_factor > settings.down_to)
        plain = self.usable & ~self.too_long & ~self.located & (current.step_kind == ARC)
        self.overshoots = plain & ~self.is_first & ~inside
        stays = self.overshoots | self.too_long | self.ends_in_failure | self.on_other_branch
        self.accepted = self.usable & ~stays
        reached = by_load & (p.load_factor >= settings.until)
        self.completes_path = self.accepted & ((current.step_kind == FINISH) | reached)
        self.records_point = self.accepted & (
            ~current.locating | self.located | self.completes_path
        )
        self.records_point = self.records_point | (self.ends_in_failure & current.locating)
        critical = self.has_limit_point | self.has_bifurcation | self.on_other_branch
        self.stops_at_event = self.located & critical & ~self.has_failure & ~settings.through
        # a failed step is tried again, shorter; at last by load, where equilibrium is unique
        self.retry = ~self.usable & ~self.too_far
        self.cannot_shorten = self.retry & (0.25 * current.ds < 0.1 * settings.tol)
        self.retry_by_load = self.cannot_shorten & ~by_load & problem.begin.always_convex
        self.is_soft = (p.rise > 0) & (p.rise < _SOFT) & (p.n_negative == 0)

    def state_after_step(self) -> PathState:
        """Return the `PathState` from which the next step is tried, without its new records."""
        current, settings = self.current, self.problem.settings
        a, p = current.anchor, self.point
        anchor = select_tree(self.accepted, self._commit_end_point(), a)
        # the anchor stays on the path, but counts as behind the bifurcation that was recorded
        passing = self.located & self.on_other_branch
        passed = {
            of: jnp.where(passing, getattr(current.bracket_end, of), getattr(anchor, of))
            for of in ("n_negative", "stiffness")
        }
        anchor = copy_with(anchor, **passed)
        nominal_ds = self._next_nominal_length()
        bracket = jnp.where(
            self.accepted & current.locating, current.bracket - current.ds, current.bracket
        )
        bracket = jnp.where(self.too_long, current.ds, bracket)
        bracket_end = select_tree(
            self.too_long & ~self.on_other_branch, self.bracket_end, current.bracket_end
        )
        close = jnp.where(bracket_end.has_bifurcation, NEAR * settings.step, current.tol)
        over = self.accepted & current.locating & (bracket <= close)
        locating = (current.locating | self.too_long) & ~self.located & ~over & ~self.completes_path
        ahead = bracketing_step_length(anchor, bracket_end, bracket, current.n_tried, close)
        ds = jnp.where(self.retry, 0.25 * current.ds, jnp.where(locating, ahead, nominal_ds))
        by_load = (self.accepted & ~self.corrected.regular) | self.retry_by_load
        by_load = by_load | ((self.retry | self.too_long) & self.is_load_step)
        kind = jnp.where(by_load, LOAD, jnp.where(self.overshoots, FINISH, ARC))
        reach = jnp.where(p.load_factor >= settings.until, settings.until, settings.down_to)
        span = (reach - a.load_factor) / jnp.where(a.rise == 0, 1.0, a.rise)
        ds = jnp.where(self.overshoots, jnp.abs(span), ds)
        onward_by_load = by_load & self.accepted & ~locating
        return copy_with(
            current,
            anchor=anchor,
            step_kind=kind.astype(jnp.int32),
            ds=jnp.where(self.retry_by_load | onward_by_load, settings.step, ds),
            nominal_ds=nominal_ds,
            first_stiffness=jnp.where(
                self.too_long & ~current.locating, self.stiffness, current.first_stiffness
            ),
            displacement_scale=self.displacement_scale,
            locating=locating & ~self.retry_by_load,
            bracket=bracket,
            bracket_end=bracket_end,
            # rounding has moved the event out of its bracket: enlarge the tolerance
            tol=jnp.where(self.located, settings.tol, current.tol * jnp.where(over, 4.0, 1.0)),
            n_tried=current.n_tried + 1,
        )

    def _commit_end_point(self):
        """Return the `PathPoint` at the end of the step, with its history variables committed."""
        if not self.system.has_memory:
            return self.point
        return copy_with(self.point, memory=self.system.commit_memory(self.point.x, self.strains))

    def _next_nominal_length(self):
        """Return the length of the next ordinary step, longer after few corrector iterations."""
        current, settings, p = self.current, self.problem.settings, self.point
        ease = jnp.sqrt(_EASY / jnp.maximum(self.corrected.steps, 1).astype(current.ds.dtype))
        plain = self.accepted & ~current.locating & ~self.located & (current.step_kind == ARC)
        nominal_ds = current.nominal_ds * jnp.where(plain, jnp.clip(ease, 0.5, 2.0), 1.0)
        first = self.is_first | (current.displacement_scale == 0)
        nominal_ds = jnp.where(self.accepted & first, jnp.sqrt(2.0) * settings.step, nominal_ds)
        longest = jnp.sqrt(2.0) * settings.largest
        straight = plain & self.is_soft & (cosine_between_tangents(current.anchor, p) > _STRAIGHT)
        wide_step = low_stiffness_step_length(
            p, self.displacement_scale, self.problem.extent, settings.largest
        )
        longest = jnp.where(straight, jnp.maximum(longest, wide_step), longest)
        return jnp.minimum(nominal_ds, longest)

    def with_status(self, current: PathState) -> PathState:
        """Return `current` with the status after this step, and `done` if the path has ended."""
        n_point, n_event = self.problem.capacity
        code = self.newton_code
        done = self.completes_path | self.stops_at_event | self.ends_in_failure
        many = current.n_event > n_event
        full = ~done & ((current.n_point >= n_point) | many)
        lost = ~done & (current.n_tried > _MAX_TRIES * n_point)
        stopped = jnp.where(self.has_limit_point, status.LIMIT_POINT, status.BIFURCATION)
        given_up, is_load_step = (
            self.cannot_shorten & ~self.retry_by_load,
            self.is_load_step & (code != status.OK),
        )
        first, corrected = self.retry & self.is_first, self.corrected
        happened, codes = zip(
            (self.stops_at_event, stopped),
            (self.ends_in_failure, status.MATERIAL_FAILURE),
            (~self.usable & self.too_far, status.MECHANISM),
            (given_up & is_load_step, code),
            (first & ~jnp.isfinite(corrected.scale), status.NONFINITE),
            (first & corrected.converged & ~corrected.regular, status.SINGULAR),
            (given_up | lost, status.PATH_LOST),
            (full & self.is_soft & (current.n_event == 0), status.EXCESSIVE_DEFORMATION),
            (full & many, status.OUT_OF_EVENTS),
            (full, status.OUT_OF_POINTS),
            strict=True,
        )
        code = jnp.select(happened, codes, status.OK).astype(jnp.int32)
        return copy_with(current, code=code, done=done | (code != status.OK))
