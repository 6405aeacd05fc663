"""Cables beside other elements: interior-point steps for them where Newton's method fails.

A structure with bars, beams or elements of users is solved by Newton steps with predicted axial
forces (`predicted_forces`). Many slack cables can make these steps cycle. Where the residual no
longer halves, or the full steps at the start of the iteration have failed, the iteration begins
again from the start of the increment, with steps of the interior-point method of `interior_point`:
the tensions of the cables are unknowns then, which follow from the same linear equations as the
displacements. In these equations the cables have the tensions and slopes of the interior-point
method, all other elements their forces and tangents. Newton steps with predicted forces finish the
iteration; they begin with the tensions that the interior-point method has found.

Other elements need not have a convex energy. If the matrix of an interior-point step is not
positive definite, the step is repeated: first without the geometric stiffness of bars in
compression, then with a shift of the diagonal that grows from try to try. Repeats count as steps,
and only `max_steps` ends them. Where the tangent is unsymmetric, an indefinite symmetric part says
little of a step: it is taken.
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
from ..mechanics.chords import has_chord, n_chord
from ..mechanics.tension_responses import CableTensions, net_stiffness
from ..spaces.space import Motion, Step
from .interior_point import TensionStepEquations
from .newton_step import max_abs
from .tension_unknowns import TensionUnknowns, largest_load


class PartialNet:
    """The cables of a structure that has other elements, too.

    Elements with a *chord* have two ends and no rotations (`mechanics.chords`): bars, and cables
    with two ends.

    Attributes:
        system: `System` of the whole structure.
        is_cable: whether a group is one of cables, a list with a bool for every group.
        net: `System` with the groups of cables only.
        others: `System` with all other groups only.
        cable_of_chord: index of the cable, among all cables, for every element with a chord; -1
            for an element that is no cable; [n_chord], NumPy.
    """

    def __init__(self, system: System, is_cable: list[bool]):
        self.system, self.is_cable = system, is_cable
        self.net = _with_some_groups(system, is_cable)
        self.others = _with_some_groups(system, [not cable for cable in is_cable])
        self.cable_of_chord = _index_cables_of_chords(system, is_cable)

    @classmethod
    def from_system(cls, system: System) -> PartialNet | None:
        """Return the cables of a structure; None if it has no cables, or nothing but cables.

        Cables count if their tensions can be unknowns, their law does not soften, and their
        tangent is symmetric.
        """
        is_cable = [
            isinstance(group, TensionElement)
            and group.has_tension_unknown(state)
            and group.monotone
            and group.symmetric
            for group, state in zip(system.groups, system.states, strict=True)
        ]
        only_cables = all(isinstance(group, TensionElement) for group in system.groups)
        return cls(system, is_cable) if any(is_cable) and not only_cables else None

    def evaluate(self, x: Motion) -> tuple[CableTensions, tuple[EndForces, list[Any]]]:
        """Evaluate the forces of all elements at motion `x`.

        Returns:
            Tensions and end forces of the cables; what `System.forces_and_tangents` returns for all
            other elements: their end forces, N, and what `tangents` can reuse of the evaluation.
        """
        return CableTensions.at_motion(self.net, x, True), self.others.forces_and_tangents(x)

    def equations(
        self,
        x: Motion,
        elements: tuple[CableTensions, tuple[EndForces, list[Any]]],
        unknowns: TensionUnknowns,
        residual: Step,
        length: Float[Array, ""],
    ) -> TensionStepEquations:
        """Return the linear equations of the cables for the next step from `x`.

        Their right side, [n_free], N, is that of the whole structure.

        Args:
            x: motion of all nodes (rows).
            elements: result of `evaluate` at x.
            unknowns: tensions of the cables as unknowns, and the mode of the iteration.
            residual: residual of the whole structure at x, [n_free], N.
            length: mean length of elements, m.
        """
        responses, (other_forces, _) = elements
        load = self.system.external_force(x)

        def assemble_residual(cable_forces: EndForces) -> Step:
            """Return the residual of the structure under other end forces of the cables, N."""
            of_groups = self.merge(cable_forces, other_forces)
            ends = [self.system.space.pad_moments(forces) for forces in of_groups]
            return self.system.space.restrict(self.system.sum_at_rows(ends) - load, x)

        largest = largest_load(self.net, load[:, :3], responses.tension)
        best = jnp.where(unknowns.is_new_mode, max_abs(residual), unknowns.best_residual)
        unknowns = copy_with(unknowns, best_residual=best)
        given = unknowns, self.net, x, responses, residual, unknowns.guess, largest, length
        return TensionStepEquations.at_point(*given, assemble_residual=assemble_residual)

    def tangents(
        self,
        x: Motion,
        elements: tuple[CableTensions, tuple[EndForces, list[Any]]],
        equations: TensionStepEquations,
    ) -> list[Float[Array, "n_elem d d"]]:
        """Return the stiffness matrices of all elements at `x`, [n_elem, d, d] per group, N/m.

        In interior-point steps those of cables have the slopes and tensions of that method, in all
        other steps they are tangents. `elements` is the result of `evaluate` at `x`.
        """
        (responses, (_, known)), unknowns = elements, equations.unknowns
        tensions = select_tree(
            unknowns.uses_interior_point, unknowns.interior_point.tension, responses.tension
        )
        unit_forces, slopes = equations.unit_forces, equations.slope
        of_cables = net_stiffness(self.net, x, unit_forces, slopes, tensions)
        return self.merge(of_cables, self.others.tangents(x, known))

    def geometric_forces(
        self,
        predicted: Float[Array, " n_chord"],
        present: Float[Array, " n_chord"],
        unknowns: TensionUnknowns,
    ) -> Float[Array, " n_chord"]:
        """Return the axial forces for the geometric stiffness of a step, [n_chord], N.

        Outside of interior-point steps these are the predicted forces. In interior-point steps
        cables have their present forces, with which
        `Chords.tangents_with_geometric_stiffness` adds nothing
        to the matrices of `tangents`. All others have predicted forces, of which those in
        compression are zero if the same step has had an indefinite matrix before.

        Args:
            predicted: predicted axial forces of all elements with a chord, N, tension positive.
            present: axial forces of these elements at the present point, N.
            unknowns: the mode of the iteration, and how often the matrix was indefinite.
        """
        was_indefinite = unknowns.indefinite_count > 0
        of_others = jnp.where(was_indefinite, jnp.maximum(predicted, 0.0), predicted)
        interior = jnp.where(self.cable_of_chord >= 0, present, of_others)
        return jnp.where(unknowns.uses_interior_point, interior, predicted)

    def predicted_forces(
        self, predicted: Float[Array, " n_chord"], unknowns: TensionUnknowns
    ) -> Float[Array, " n_chord"]:
        """Return `predicted` axial forces with the tensions that interior-point steps have found.

        Both are forces of all elements with a chord after a step, [n_chord], N. Only forces of
        cables are replaced, and only after an interior-point step.
        """
        tensions = unknowns.interior_point.tension[self.cable_of_chord]
        replaced = unknowns.uses_interior_point & (self.cable_of_chord >= 0)
        return jnp.where(replaced, tensions, predicted)

    def take_step(
        self, x: Motion, step: Step, sound: Bool[Array, ""], equations: TensionStepEquations
    ) -> tuple[TensionUnknowns, Float[Array, ""]]:
        """Update the tensions of the cables by a step, the solution of the linear equations.

        Args:
            x: motion of all nodes (rows) before the step.
            step: the solution, [n_free].
            sound: whether the matrix is positive definite, or unsymmetric and regular. If not, an
                interior-point step is not taken but repeated: tensions stay as they are,
                `indefinite_count` grows by one, and if it was not zero, the damping grows, too.
            equations: linear equations of the cables, whose solution `step` is.

        Returns:
            `TensionUnknowns` after the step; the fraction of it that displacements are to take.
        """
        before = equations.unknowns
        after, fraction, _ = equations.take_step(self.net, x, step, sound)
        refused = before.uses_interior_point & ~sound
        damped = before.indefinite_count > 0
        damping = jnp.where(damped, equations.next_damping(True), before.interior_point.damping)
        same = copy_with(before.interior_point, damping=damping)
        count: Int[Array, ""] = jnp.where(refused, before.indefinite_count + 1, 0)
        after = copy_with(
            after,
            interior_point=select_tree(refused, same, after.interior_point),
            blocked_steps=jnp.where(refused, before.blocked_steps, after.blocked_steps),
            indefinite_count=count,
        )
        return after, fraction

    def merge(self, of_cables: Sequence[Any], of_others: Sequence[Any]) -> list[Any]:
        """Return values of all groups, in their order in the structure.

        `of_cables` has a value for every group of cables, `of_others` one for every other group.
        """
        left, right = iter(of_cables), iter(of_others)
        return [next(left if cable else right) for cable in self.is_cable]


def _with_some_groups(system, wanted):
    """Return a `System` with the groups for which `wanted` is true, without following loads."""
    groups = [group for group, yes in zip(system.groups, wanted, strict=True) if yes]
    states = [state for state, yes in zip(system.states, wanted, strict=True) if yes]
    return copy_with(system, groups=groups, states=states, followers=None)


def _index_cables_of_chords(system, is_cable):
    """Return the index of the cable for every element with a chord, -1 for others, [n_chord]."""
    indices, n_cable = [np.zeros(0, int)], 0
    for group, cable in zip(system.groups, is_cable, strict=True):
        n = len(group.links)
        if has_chord(group):
            indices.append(n_cable + np.arange(n) if cable else np.full(n_chord(group), -1))
        n_cable += n * cable
    return np.concatenate(indices)
