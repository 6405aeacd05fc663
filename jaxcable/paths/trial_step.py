"""Try one step of a continuation: predictor and corrector. `step_decision` accepts it or not."""

from __future__ import annotations

import jax.numpy as jnp

from .. import linear
from ..common import status
from ..common.types import Array, Bool
from ..elements.abilities import Uniaxial, is_one_sided
from ..equilibrium import newton
from ..equilibrium.newton import Newton
from ..mechanics.elementwise import evaluate_elements
from ..mechanics.load_ramp import LoadRamp
from ..mechanics.slips import slipping_places
from .corrector import correct_onto_path, unknowns_without_stiffness
from .path_state import PathPoint, PathSettings, PathState
from .step_length import cosine_between_tangents, displacement_per_load

ARC, FINISH, LOAD = 0, 1, 2  # kinds of step: by arc length, to the last load factor, by load
# Least cosine of the angle between the tangents at both ends of a step, 26 degrees: a step that
# turns more is tried again, shorter. The arc length would no longer be the length of the path.
_LEAST_COSINE = 0.9
# Longest distance between both ends of a step, in longest allowed steps: a correction that ends
# farther away has found another part of the path.
_LONGEST_JUMP = 4.0
# Strains below this, in eps, are rounding: they tell neither taut from slack nor slack from taut.
_UNSURE_STRAIN = 64
# Displacement, in sizes of the structure, from which on a structure counts as a mechanism.
_MECHANISM = 100.0


class PathProblem:
    """The path to be followed: the phase, the method, the options; the same for all steps.

    Args:
        ramp: the phase as a function of its load factor.
        method: `Newton`.
        settings: `PathSettings`.
        capacity: largest number of recorded points, and of recorded events.

    Attributes:
        begin: `System` at load factor 0.
        tol: relative residual that counts as equilibrium.
        extent: size of the structure, m.
    """

    def __init__(
        self, ramp: LoadRamp, method: Newton, settings: PathSettings, capacity: tuple[int, int]
    ):
        self.ramp, self.method, self.settings, self.capacity = ramp, method, settings, capacity
        dtype = ramp.start.motion.dtype
        self.begin = ramp.system_at(jnp.zeros((), dtype))
        self.tol, self.extent = newton.residual_tolerance(method, dtype), self.begin.extent()


class TrialStep:
    """One step of a continuation, tried from the last accepted point: predicted, then corrected.

    Args:
        problem: the path.
        current: `PathState` before the step.

    Attributes:
        problem, current: as given.
        is_first: whether the step leads to the first point of the path.
        is_load_step: whether the load factor of its end is prescribed (`LOAD`), and Newton's method
            finds the equilibrium there.
        newton_code: status of Newton's method in such a step; OK where the energy is not convex,
            because only corrections are made there.
        corrected: result of the corrector.
        system, point: `System` and `PathPoint` at the end of the step.
        strains: section strains there; empty if no law has a rupture strain or history variables.
        sound: whether an equilibrium was found, not too far away, with a tangent to the path. (With
            a convex energy a step of prescribed load factor needs no tangent.)
        turns_sharply: whether the direction of the path changes sharply in the step.
        too_far: whether displacements are so large that the structure counts as a mechanism.
        displacement_scale: `PathState.displacement_scale` after the step.
    """

    def __init__(self, problem: PathProblem, current: PathState):
        self.problem, self.current = problem, current
        self.is_first, self.is_load_step = current.n_point == 0, current.step_kind == LOAD
        self._predict_and_correct()
        settings, begin, a = problem.settings, problem.begin, current.anchor
        corrected, free = self.corrected, current.step_kind == ARC
        known, new = current.displacement_scale, displacement_per_load(corrected, begin)
        scale = jnp.where(known > 0, known, new)
        self.system = system = problem.ramp.system_at(corrected.load_factor, a.memory)
        self.point = self._end_point(scale)
        looks = system.has_rupture or system.has_memory
        self.strains = system.strains(corrected.x) if looks else []
        self.turns_sharply = (
            (cosine_between_tangents(a, self.point) < _LEAST_COSINE) & free & ~self.is_first
        )
        self.too_far = begin.largest_displacement(corrected.x) > _MECHANISM * problem.extent
        regular = corrected.regular | (self.is_load_step & begin.always_convex)
        gone = jnp.sqrt(
            jnp.sum((corrected.moved / scale) ** 2) + (corrected.load_factor - a.load_factor) ** 2
        )
        longest = jnp.maximum(jnp.sqrt(2.0) * settings.largest, current.ds)
        leapt = free & ~self.is_first & (gone > _LONGEST_JUMP * longest)
        self.sound = corrected.converged & regular & ~self.too_far & ~leapt
        self.displacement_scale = jnp.where(corrected.regular, scale, known)

    def _predict_and_correct(self):
        """Predict and correct the end of the step, and set `corrected` and `newton_code`."""
        ramp, settings, is_load_step = self.problem.ramp, self.problem.settings, self.is_load_step
        current, a, ds = self.current, self.current.anchor, self.current.ds
        free = current.step_kind == ARC
        factor = a.load_factor + ds * jnp.where(is_load_step, 1.0, a.rise)
        factor = jnp.where(is_load_step, jnp.minimum(factor, settings.until), factor)
        end = jnp.where(a.rise > 0, settings.until, settings.down_to)
        factor = jnp.where(current.step_kind == FINISH, end, factor)
        along = jnp.where(is_load_step, 0.0, ds * a.direction * current.displacement_scale)
        system = ramp.system_at(factor, a.memory)
        x, self.newton_code = system.move(a.x, along), jnp.int32(status.OK)
        if system.always_convex:  # else equilibrium is not unique, and Newton could end anywhere
            ended, _ = newton.equilibrate(system, a.x, self.problem.method, is_load_step)
            x, self.newton_code = jnp.where(is_load_step, ended.x, x), ended.code
        sense = jnp.where(a.rise < 0, -1.0, 1.0)  # so that the tangent at the end points onward
        condition = (
            jnp.where(free, a.direction / jnp.where(free, current.displacement_scale, 1.0), 0.0),
            jnp.where(free, a.rise, sense),
            jnp.where(free, ds, sense * (factor - a.load_factor)),
        )
        guess, active = (x, along, factor), ~is_load_step | (self.newton_code == status.OK)
        of_path = a.load_factor, condition, self.problem.tol
        self.corrected = correct_onto_path(ramp, a.memory, guess, *of_path, active)

    def _end_point(self, scale):
        """Return the `PathPoint` at the end of the step, with its eigenvalues and unit tangent.

        `scale` is the displacement that counts as much as a unit of the load factor, m.
        """
        a, corrected, system = self.current.anchor, self.corrected, self.system
        direction, rise = corrected.direction / scale, corrected.rise
        size = jnp.sqrt(direction @ direction + rise**2)
        size = jnp.where((size > 0) & jnp.isfinite(size), size, 1.0)
        near_bifurcation = self.current.locating & self.current.bracket_end.has_bifurcation
        loose = unknowns_without_stiffness(system, corrected.x)
        inertia = linear.inertia_and_nearest_mode(
            corrected.matrix, loose, system.may_be_unsymmetric, near_bifurcation
        )
        return PathPoint(
            *(corrected.x, corrected.load_factor, direction / size, rise / size, a.memory),
            *inertia,
            *(
                corrected.residual_by_factor,
                self._is_element_slack(),
                slipping_places(system, corrected.x),
            ),
        )

    def _is_element_slack(self) -> Bool[Array, " n_elem"]:
        """Return which elements are slack, all groups one after the other.

        Elements whose strain is only rounding count as they did at the last accepted point.
        """
        system, x = self.system, self.corrected.x

        def is_unsure(group, state):
            if not (is_one_sided(group) and isinstance(group, Uniaxial)):
                return jnp.zeros(len(group.links), bool)
            strain = evaluate_elements("strain", group, state, system.nodes, x)
            return jnp.abs(strain) <= _UNSURE_STRAIN * jnp.finfo(strain.dtype).eps

        unsure = jnp.concatenate([*map(is_unsure, system.groups, system.states)])
        return jnp.where(unsure, self.current.anchor.is_slack, jnp.concatenate(system.slack(x)))
