"""One beam: forces, tangent, energy and results from the motion of its two ends.

`beam.Beams` evaluates this for every element of a group, with `corotation` (the frame, statics) and
`bending` (strains along the axis). An element whose section is not linear, or whose ends rotate
against their nodes, has inner unknowns, in rows of motion after those of its ends
(`inner_unknowns`).
"""

from __future__ import annotations

import abc
from collections.abc import Sequence
from functools import cache, partial
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np

from ..common.types import Array, ArrayLike, Bool, Float, PyTree
from ..numerics.rotations import (
    compose,
    conjugate_moment,
    from_stereographic,
    invert,
    moment_conjugate_to_stereographic,
    move_node_by_series,
    rotate,
    stereographic_to_rotation_vector,
)
from . import beam_statics, bending, corotation
from .bending import split_strains
from .element import Ends, Forces, Motion, Scalar
from .inner_unknowns import InnerUnknowns
from .prestress import AxialState, measure_chord

_FINITE_STEP = move_node_by_series, conjugate_moment
_FIRST_ORDER_STEP = partial(move_node_by_series, order=1), partial(conjugate_moment, order=1)


class BeamElement(InnerUnknowns):
    """Forces, tangent, energy, mass and results of one element of `beam.Beams`.

    The group has `section`, `springs`, `torsional_stiffness`, `points` and `axes(ends)`.
    """

    torsional_stiffness: Float[ArrayLike, " n_elem"] | None

    @abc.abstractmethod
    def axes(self, ends: Ends) -> Float[Array, "3 3"]:
        """Return the initial axes of one element in rows: along it, the section's y and z."""

    def _axes_and_pose(self, state, ends, motion):
        """Return the initial axes, [3, 3], and the `corotation.Pose` (frame and end rotations)."""
        axes = self.axes(ends)
        turns = [motion[k, 3:] for k in (0, 1)]
        if self.springs is not None:  # the ends turn against their nodes
            turns = [
                compose(turn, from_stereographic(joint @ axes))
                for turn, joint in zip(turns, self._hinge_rotations(state, motion), strict=True)
            ]
        return axes, corotation.pose(axes, ends, motion[:2, :3], jnp.stack(turns), state.kinks)

    def _strain_field_and_load(self, state, axes, pose, motion):
        """Return the `bending.StrainField`, and the line load on rotated axes [3], N/m, or None."""
        load = None
        if state.line_load is not None:
            load = pose.axes @ state.line_load
        if state.pressures is not None:
            pressed = corotation.pressure_load(pose, state.pressures, state.rest_length)[0]
            load = pressed if load is None else load + pressed
        length = state.rest_length
        inner = None if self.section.is_elastic else self._strain_coefficients(motion, length)
        stretch = (state.elongation + pose.change) / length
        stiffness = self.section.stiffness() if inner is None else None
        angles = self._shear_angles(motion, pose.rotations, length, load, stiffness)
        at = pose.rotations, stretch, length, load, stiffness, inner, angles
        field = bending.strain_field(*at)
        return bending.with_point_loads(field, pose, length, state.point_loads, stiffness), load

    @jax.jit  # traced once, although a program calls it many times
    def _deformation(self, state, ends, motion):
        """Return initial axes, `corotation.Pose`, `bending.StrainField`, line load (None: none)."""
        axes, pose = self._axes_and_pose(state, ends, motion)
        return axes, pose, *self._strain_field_and_load(state, axes, pose, motion)

    def _strains_at_integration_points(self, field):
        """Return section strains e0, ky, kz (-, 1/m) of a `bending.StrainField`, [n_point, 3]."""
        return field.strains_at(bending.gauss_lobatto(self.points)[0])

    def _torsional_stiffness(self):
        """Return the torsional stiffness GJ, N m2: the given one, or else that of the section."""
        given = self.torsional_stiffness
        return self.section.torsional_stiffness() if given is None else given

    def _section_force_integrals(self, state, field, force_law=None):
        """Return integrals of N, My, Mz (columns) times Legendre polynomials (rows), [3, 3].

        `force_law` gives N, My, Mz from section strains in place of the fibres.
        """
        if self.section.is_elastic:
            return bending.linear_section_integrals(self.section.stiffness(), field.strain)
        strain = self._strains_at_integration_points(field)
        if force_law is None:
            forces_of_fibres = self.section.forces(*split_strains(strain), state.memory)
            force = jnp.stack(forces_of_fibres, axis=-1)
        else:
            force = force_law(strain)
        places, weight = (jnp.asarray(v, force.dtype) for v in bending.gauss_lobatto(self.points))
        return (weight[:, None] * bending.legendre_basis(places)).T @ force

    @jax.jit  # traced once
    def _internal_forces(self, state, ends, motion):
        """Return the force on the second end [3], moments on both ends [2, 3], inner forces [k]."""
        return self._forces_from_deformation(state, motion, self._deformation(state, ends, motion))

    def _forces_from_deformation(self, state, motion, deformation, force_law=None):
        """Return `_internal_forces` from `_deformation`; `force_law`: N, My, Mz from strains."""
        axes, pose, field, load = deformation
        length, rotations = state.rest_length, pose.rotations
        following = None
        if state.pressures is not None:
            following = corotation.pressure_load(pose, state.pressures, length)[1:]
        sums = self._section_force_integrals(state, field, force_law)
        force, moments, torque, unbalanced = bending.generalized_forces(
            field, rotations, length, sums, self._torsional_stiffness(), load, following
        )
        pull, moments = corotation.end_forces(pose, force, moments, torque)
        inner = []
        if self._n_strain_rows:
            inner = [unbalanced[0, : self._n_strain_rows] / length]
        if self._n_strain_rows == 2:
            inner.append(unbalanced[1] * 32 / length**2)
        for _, about in self._shear_angle_indices:
            inner.append(unbalanced[2, about : about + 1] / length)
        if self.springs is not None:
            for k, joint in enumerate(self._hinge_rotations(state, motion)):
                moment = axes @ rotate(invert(motion[k, 3:]), moments[k])
                moment = moment_conjugate_to_stereographic(joint, moment)
                angle, pull_back = jax.vjp(stereographic_to_rotation_vector, joint)
                inner.append((moment + pull_back(self.springs[k] * angle)[0]) / (4 * length))
        return pull, moments, jnp.concatenate(inner) if inner else jnp.zeros(0, pull.dtype)

    def _reduced_forces_after_step(self, state, ends, motion, step, force_law=None, linear=False):
        """Return forces conjugate to a step: relative translation, spins, inner unknowns, [9 + k].

        With `linear` they are correct to first order in the step, which is enough for a tangent.
        """
        turning, conjugate = _FIRST_ORDER_STEP if linear else _FINITE_STEP
        zero, spins = jnp.zeros_like(step[:3]), step[3:9].reshape(2, 3)
        moved = jnp.concatenate([jnp.stack([zero, step[:3]]), spins], axis=1)
        new = jax.vmap(turning)(motion[:2], moved)
        if self.inner_unknowns:
            new = jnp.concatenate([new, motion[2:].at[self._inner_indices].add(step[9:])])
        if force_law is None:
            forces = self._internal_forces(state, ends, new)
        else:
            deformation = self._deformation(state, ends, new)
            forces = self._forces_from_deformation(state, new, deformation, force_law)
        pull, moments, inner = forces
        moments = jax.vmap(conjugate)(spins, moments)
        return jnp.concatenate([pull, moments.ravel(), inner])

    def end_forces_after_step(
        self, state: AxialState, ends: Ends, motion: Motion, step: Forces
    ) -> Forces:
        """Return end forces after a `step`, conjugate to its translations and spins, [n_end, 6]."""
        inner = step[2:][self._inner_indices] if self.inner_unknowns else jnp.zeros(0, step.dtype)
        reduced = jnp.concatenate([step[1, :3] - step[0, :3], step[:2, 3:].ravel(), inner])
        force = self._reduced_forces_after_step(state, ends, motion, reduced)
        return self._expand_reduced_forces(force)

    def end_forces(self, state: AxialState, ends: Ends, motion: Motion) -> Forces:
        """Return internal forces and spatial moments at both ends, N and N m, [n_end, 6].

        The rows after the two ends contain the forces conjugate to inner unknowns.
        """
        return self._join_end_forces(*self._internal_forces(state, ends, motion))

    @jax.jit  # traced once
    def forces_and_tangent(
        self, state: AxialState, ends: Ends, motion: Motion
    ) -> tuple[Forces, Float[Array, "12+k 12+k"]]:
        """Return `end_forces`, and their derivative, the tangent stiffness, [12 + k, 12 + k].

        Unknowns are translation and spin of the first end, of the second end, and inner ones. By
        autodiff; the section is linearized first, so that its fibres are evaluated once and not for
        every column. Forces depend on the relative translation of the ends only, so that
        derivatives by nine unknowns give those by all twelve.
        """
        force_law = None
        if not self.section.is_elastic:
            at = self.section_strain(state, ends, motion)
            force, stiffness = self.section.forces_and_tangent(*split_strains(at), state.memory)

            def force_law(strain):
                return force + jnp.einsum("pij,pj->pi", stiffness, strain - at)

        def stepped(step):
            force = self._reduced_forces_after_step(state, ends, motion, step, force_law, True)
            return force, force

        step = jnp.zeros(9 + len(self.inner_unknowns), ends.dtype)
        slope, force = jax.jacfwd(stepped, has_aux=True)(step)
        for axis in (0, 1):
            pull, first, second, inner = jnp.split(slope, [3, 6, 9], axis)
            slope = jnp.concatenate([-pull, first, pull, second, inner], axis)
        return self._expand_reduced_forces(force), slope

    def tangent(self, state: AxialState, ends: Ends, motion: Motion) -> Float[Array, "12+k 12+k"]:
        """Return the tangent stiffness: by both ends' translations and spins, k inner unknowns."""
        return self.forces_and_tangent(state, ends, motion)[1]

    def evaluates_forces_with_tangent(self, state: AxialState) -> bool:
        """Return True: forces and tangent are evaluated together, which compiles in less time."""
        return True

    def mass_matrix(
        self,
        state: AxialState,
        ends: Ends,
        motion: Motion,
        mass: Scalar,
        distribution: str | None = None,
    ) -> Float[Array, "12+k 12+k"]:
        """Return the matrix of a `mass`, kg, uniform along the axis, [12 + k, 12 + k], kg.

        The mass matrix "consistent" takes the deflections of `bending` (cubic without load),
        "lumped" has halves at the ends, "mean" is the mean of both. None is "consistent" across the
        chord, "mean" along it, both of order 4 in the length. Sections have no rotary inertia.
        """
        halves = np.zeros(12 + len(self.inner_unknowns))
        halves[[0, 1, 2, 6, 7, 8]] = 0.5
        lumped = mass * jnp.diag(jnp.asarray(halves, ends.dtype))
        if distribution == "lumped":
            return lumped
        at, by = np.polynomial.legendre.leggauss(4)  # exact for squares of cubics
        places, weight = (jnp.asarray(v, ends.dtype) for v in (0.5 + 0.5 * at, 0.5 * by))

        def moved(step):
            steps = step[:12].reshape(2, 6)
            new = jax.vmap(lambda m, s: move_node_by_series(m, s, order=1))(motion[:2], steps)
            if self.inner_unknowns:
                new = jnp.concatenate([new, motion[2:].at[self._inner_indices].add(step[12:])])
            _, pose, field, _ = self._deformation(state, ends, new)
            at = pose.rotations, state.rest_length, pose.length, places
            way = bending.deflected_axis(field, *at)[0]
            return step[None, :3] + way @ pose.axes, pose.length

        still = jnp.zeros(12 + len(self.inner_unknowns), ends.dtype)
        slope, along = jax.jacfwd(moved)(still)
        matrix = mass * jnp.einsum("p,pai,paj->ij", weight, slope, slope)
        if distribution is None:
            return matrix + mass / 12 * jnp.outer(along, along)
        return matrix if distribution == "consistent" else 0.5 * (lumped + matrix)

    def energy(self, state: AxialState, ends: Ends, motion: Motion) -> Scalar:
        """Return the stored energy minus the work of the line load on the deflected axis, J."""
        _, pose, field, load = self._deformation(state, ends, motion)
        length = state.rest_length
        # the energy of a linear section is a polynomial of degree 4 along the axis
        count = max(4, self.points) if self.section.is_elastic else self.points
        places, weight = (jnp.asarray(v, field.strain.dtype) for v in bending.gauss_lobatto(count))
        strain = bending.legendre_basis(places) @ field.strain
        total = length * weight @ self.section.energy(*split_strains(strain), state.memory)
        total = total + 0.5 * self._torsional_stiffness() * field.twist**2 / length
        if field.shear is not None:
            total = total + field.shear.energy(length)
        if load is not None:
            total = total - length * load @ bending.mean_deflection(field, pose.rotations, length)
        if field.points is not None:
            total = total - bending.work_of_point_loads(field, pose.rotations)
        if self.springs is not None:
            turns = jax.vmap(stereographic_to_rotation_vector)(self._hinge_rotations(state, motion))
            total = total + 0.5 * jnp.sum(self.springs * turns**2)
        return total

    def has_result(self, name: str, state: AxialState) -> bool:
        """Return whether elements have the result `name`; a peak tension only under a load."""
        if name == "peak_tension":
            return state.line_load is not None or state.point_loads is not None
        if name == "point_loads":
            return state.point_loads is not None
        return super().has_result(name, state)

    def results_by_name(
        self, state: AxialState, ends: Ends, motion: Motion, names: Sequence[str]
    ) -> dict[str, Array]:
        """Return results of one element by name; shared pose and strains are computed once."""
        if len(names) < 2:
            return super().results_by_name(state, ends, motion, names)
        deformation = self._deformation(state, ends, motion)
        forces = cache(lambda: self._forces_from_deformation(state, motion, deformation))
        tension = cache(lambda: self._mean_tension(state, deformation[2]))
        known: dict[str, Any] = {
            "tension": tension,
            "peak_tension": lambda: self._peak_from_mean_tension(state, ends, motion, tension()),
            "section_strain": lambda: self.section_strain(state, ends, motion),
            "section_forces": lambda: self._deformed_section_forces(state, deformation, forces()),
            "end_forces": lambda: self._join_end_forces(*forces()),
        }
        others = super().results_by_name(
            state, ends, motion, [name for name in names if name not in known]
        )
        return others | {name: known[name]() for name in names if name in known}

    def tension(self, state: AxialState, ends: Ends, motion: Motion) -> Scalar:
        """Return the axial force of one element, its mean along the element, N."""
        return self._mean_tension(state, self._deformation(state, ends, motion)[2])

    def _mean_tension(self, state, field):
        """Return the axial force, its mean along the element, N, from a `bending.StrainField`."""
        return self._section_force_integrals(state, field)[0, 0]

    def peak_tension(self, state: AxialState, ends: Ends, motion: Motion) -> Scalar:
        """Return the axial force of largest absolute value, N; it is at an end, or at a load."""
        return self._peak_from_mean_tension(state, ends, motion, self.tension(state, ends, motion))

    def _peak_from_mean_tension(self, state, ends, motion, mean):
        """Return the axial force of largest absolute value, N, from the `mean` in the element."""
        vector, length, _, _ = measure_chord(ends, motion[:2, :3])
        loads = state.rest_length, state.line_load, state.point_loads
        return beam_statics.peak_axial_force(mean, vector / length, *loads)

    def point_loads(self, state: AxialState, ends: Ends, motion: Motion) -> Float[Array, "k 7"]:
        """Return the concentrated loads along the rotated axes, as of `POINT_LOADS`, [k, 7]."""
        axes = self._axes_and_pose(state, ends, motion)[1].axes
        return beam_statics.point_loads_along(axes, state.point_loads)  # type: ignore[arg-type]

    def section_strain(self, state: AxialState, ends: Ends, motion: Motion) -> Float[Array, "n 3"]:
        """Return strain and curvatures ``e0, ky, kz`` at the integration points, [n_point, 3]."""
        field = self._deformation(state, ends, motion)[2]
        if not beam_statics.lacks_clamped_end_strains(field):
            return self._strains_at_integration_points(field)
        found = self.section_forces(state, ends, motion)
        return beam_statics.strains_of_linear_section(self.section.stiffness(), found)

    def section_forces(
        self,
        state: AxialState,
        ends: Ends,
        motion: Motion,
        places: Float[ArrayLike, " n_place"] | None = None,
    ) -> Float[Array, "n_place 6"]:
        """Return ``N, Vy, Vz, T, My, Mz`` of one element at `places`, [n_place, 6], N and N m.

        Places are from 0 to 1; None: integration points. By equilibrium of the part before the
        section, hence exact for the end forces and the load, whatever the laws of the fibres.
        Components are along the axes of the section there, which follows the deflected axis.
        """
        at = state, ends, motion
        deformation, forces = self._deformation(*at), self._internal_forces(*at)
        return self._deformed_section_forces(state, deformation, forces, places)

    def _deformed_section_forces(self, state, deformation, forces, places=None):
        """Return `section_forces` from what `_deformation` and `_internal_forces` have returned."""
        places = bending.gauss_lobatto(self.points)[0] if places is None else places
        _, pose, field, load = deformation
        at = forces[:2], state.rest_length, places
        return beam_statics.section_forces_by_equilibrium(pose, field, load, *at)

    def absolute_force(self, state: AxialState, ends: Ends, motion: Motion) -> Scalar:
        """Return the sum of the absolute forces of all fibres, mean along one element, N."""
        strains = split_strains(self.section_strain(state, ends, motion))
        size = self.section.absolute_force(*strains, state.memory)
        return jnp.asarray(bending.gauss_lobatto(self.points)[1], size.dtype) @ size

    def rounding_error(self, state: AxialState, ends: Ends, motion: Motion) -> Forces:
        """Return an estimate of the absolute rounding error of `end_forces`, N, N m, [n_end, 6]."""
        vector, length, _, _ = measure_chord(ends, motion[:2, :3])
        stiffness = jnp.diagonal(self.section.stiffness())
        across = 12 * jnp.maximum(stiffness[1], stiffness[2]) / length**2
        moved = jnp.max(jnp.abs(motion[:2, :3])) / length
        force = stiffness[0] * jnp.abs(vector) / length + across
        both = jnp.append(force, jnp.full(3, across * length, force.dtype))
        # inner unknowns are lengths along and across, too
        rows = jnp.broadcast_to(stiffness[0] + across, (self.n_inner_row, 6))
        each = jnp.concatenate([jnp.stack([both, both]), rows])
        return 8 * jnp.finfo(force.dtype).eps * moved * each

    def commit_memory(
        self,
        strain: Float[Array, "n_point 3"],
        memory: PyTree[Float[Array, "n_point n_fibre n_memory"]],
        duration: float = 0.0,
    ) -> PyTree[Float[Array, "n_point n_fibre n_memory"]]:
        """Return the history variables after an increment that ended at these section strains."""
        return self.section.commit_memory(*split_strains(strain), memory, duration)

    def fibre_stress(
        self,
        strain: Float[Array, "n_point 3"],
        memory: PyTree[Float[Array, "n_point n_fibre n_memory"]] | None = None,
    ) -> Float[Array, "n_point n_fibre"]:
        """Return the stress of every fibre, Pa, at section strains e0, ky, kz."""
        return self.section.fibre_stress(*split_strains(strain), memory)

    def is_ruptured(self, strain: Float[Array, "n_point 3"]) -> Bool[Array, ""]:
        """Return whether section strains e0, ky, kz take a fibre beyond its rupture strain."""
        return jnp.any(self.section.is_ruptured(*split_strains(strain)))
