"""Cables beside other elements: their tensions are unknowns, too, where Newton's method fails.

A structure with bars, beams or elements of users is solved by steps with predicted axial forces
(`predicted_forces`). Many slack cables let these steps cycle. Hence its cables form a net within
the structure. Where the residual no longer halves, or full steps have failed, the iteration goes on
with interior-point steps from the start of the increment (`interior_point`): the cables enter the
linear equations with the slopes and tensions of the interior-point method, all other elements with
their forces and tangents. Finishing steps are again those with predicted forces, which begin with
the tensions of the interior-point method.

Other elements need not have a convex energy. If the matrix of an interior step is not positive
definite, the step is tried again without the geometric stiffness of compressed bars, then with more
and more damping.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import jax.numpy as jnp
import numpy as np

from ..common.tree import copy_with, select_tree
from ..common.types import Array, Bool, Float, Int
from ..elements.abilities import TensionElement
from ..mechanics.assembly import EndForces, System
from ..mechanics.chords import has_chord
from ..mechanics.tension_responses import TensionResponses, net_stiffness
from ..spaces.space import Motion, Step
from .interior_point import LengthBoundEquations
from .newton_step import max_abs
from .tension_unknowns import TensionUnknowns, largest_load


class PartialNet:
    """The cables of a structure that has other elements, too.

    Attributes:
        net, others: the `System` with the cables only, and that with all other elements.
        is_cable: whether a group is one of cables, for every group.
        cable_of_chord: number of the cable for every element with a chord, -1 for others, [n].
    """

    def __init__(self, system: System, is_cable: list[bool]):
        self.system, self.is_cable = system, is_cable
        self.net, self.others = _only(system, is_cable), _only(system, [not c for c in is_cable])
        self.cable_of_chord = _cables_of_chords(system, is_cable)

    @classmethod
    def of(cls, system: System) -> PartialNet | None:
        """Return the cables of a structure; None if it has no cables, or nothing but cables."""
        is_cable = [
            isinstance(group, TensionElement)
            and group.has_tension_unknown(state)
            and group.monotone
            and group.symmetric
            for group, state in zip(system.groups, system.states, strict=True)
        ]
        only_cables = all(isinstance(group, TensionElement) for group in system.groups)
        return cls(system, is_cable) if any(is_cable) and not only_cables else None

    def evaluate(self, x: Motion) -> tuple[TensionResponses, list[Any]]:
        """Return the tension responses of the cables at `x`, and what others give.

        That is the two lists of `System.forces_and_tangents`.
        """
        return TensionResponses.of(self.net, x, True), self.others.forces_and_tangents(x)

    def equations(
        self,
        x: Motion,
        elements: tuple[Any, ...],
        unknowns: TensionUnknowns,
        residual: Step,
        length: Float[Array, ""],
    ) -> LengthBoundEquations:
        """Return the equations of the cables for the next step from x.

        Args:
            x: the point.
            elements: `evaluate` there.
            unknowns: tensions as unknowns, and the mode of the iteration.
            residual: of the structure at x, [n_free], N.
            length: of elements, m.
        """
        pulls, (others, _) = elements
        force = self.system.external_force(x)

        def residual_with(forces: EndForces) -> Step:
            ends = [self.system.space.pad_moments(f) for f in self.merge(forces, others)]
            return self.system.space.restrict(self.system.sum_at_rows(ends) - force, x)

        load = largest_load(self.net, force[:, :3], pulls.tension)
        best = jnp.where(unknowns.is_new_mode, max_abs(residual), unknowns.best_residual)
        unknowns = copy_with(unknowns, best_residual=best)
        given = unknowns, self.net, x, pulls, residual, unknowns.guess, load, length
        return LengthBoundEquations.at_point(*given, residual_with=residual_with)

    def tangents(
        self, x: Motion, elements: tuple[Any, ...], equations: LengthBoundEquations
    ) -> list[Float[Array, "n_elem d d"]]:
        """Return the matrices of all elements at x, where `elements` are those of `evaluate`."""
        (pulls, (_, known)), unknowns = elements, equations.unknowns
        tensions = select_tree(unknowns.is_interior, unknowns.interior_point.tension, pulls.tension)
        along, slopes = equations.unit_forces, equations.slope
        own = net_stiffness(self.net, x, along, slopes, tensions)
        return self.merge(own, self.others.tangents(x, known))

    def geometric_forces(
        self, forces: Float[Array, " n"], own: Float[Array, " n"], unknowns: TensionUnknowns
    ) -> Float[Array, " n"]:
        """Return axial forces for the geometric stiffness of elements with chords, [n], N.

        Args:
            forces: predicted forces.
            own: forces that the matrices of the elements contain.
            unknowns: in interior steps the matrices of cables are complete, and after one that was
                indefinite, compressed bars have no geometric stiffness.
        """
        positive = jnp.where(unknowns.indefinite_count > 0, jnp.maximum(forces, 0.0), forces)
        interior = jnp.where(self.cable_of_chord >= 0, own, positive)
        return jnp.where(unknowns.is_interior, interior, forces)

    def predicted_forces(
        self, forces: Float[Array, " n"], unknowns: TensionUnknowns
    ) -> Float[Array, " n"]:
        """Return the predicted forces of elements with chords, [n], N.

        Those of cables are the tensions of the interior-point method after its steps.
        """
        tensions = unknowns.interior_point.tension[self.cable_of_chord]
        return jnp.where(unknowns.is_interior & (self.cable_of_chord >= 0), tensions, forces)

    def take_step(
        self, x: Motion, step: Step, definite: Bool[Array, ""], equations: LengthBoundEquations
    ) -> tuple[TensionUnknowns, Float[Array, ""]]:
        """Return the tension unknowns after a step, and the fraction of the step that is taken."""
        before = equations.unknowns
        after, fraction, _ = equations.take_step(self.net, x, step, definite)
        refused = before.is_interior & ~definite
        damped = before.indefinite_count > 0
        damping = jnp.where(damped, equations.damping_after(True), before.interior_point.damping)
        again = copy_with(before.interior_point, damping=damping)
        count: Int[Array, ""] = jnp.where(refused, before.indefinite_count + 1, 0)
        after = copy_with(
            after,
            interior_point=select_tree(refused, again, after.interior_point),
            blocked_steps=jnp.where(refused, before.blocked_steps, after.blocked_steps),
            indefinite_count=count,
        )
        return after, fraction

    def merge(self, cables: Sequence[Any], others: Sequence[Any]) -> list[Any]:
        """Return the values of all groups from those of the cables and those of others."""
        left, right = iter(cables), iter(others)
        return [next(left if cable else right) for cable in self.is_cable]


def _only(system, wanted):
    """Return a system with the wanted groups only, which has no following loads."""
    groups = [group for group, yes in zip(system.groups, wanted, strict=True) if yes]
    states = [state for state, yes in zip(system.states, wanted, strict=True) if yes]
    return copy_with(system, groups=groups, states=states, followers=None)


def _cables_of_chords(system, is_cable):
    """Return the number of the cable for every element with a chord, -1 for others, [n]."""
    numbers, count = [np.zeros(0, int)], 0
    for group, cable in zip(system.groups, is_cable, strict=True):
        n = len(group.links)
        if has_chord(group):
            numbers.append(count + np.arange(n) if cable else np.full(n, -1))
        count += n * cable
    return np.concatenate(numbers)
