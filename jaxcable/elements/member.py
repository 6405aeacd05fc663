"""One beam: forces, tangent, energy and results from the motion of its two ends.

`beam.Beams` evaluates this for every element of a group, with `corotation` (the frame, statics) and
`bending` (strains along the axis). An element whose section is not linear, or whose ends turn
against their nodes, has further unknowns: inner numbers, in rows of motion after those of its ends
(`inner`).
"""

from __future__ import annotations

import abc
from collections.abc import Sequence
from functools import cache, partial

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
    rotation_vector,
)
from . import bending, corotation
from .element import Ends, Forces, Motion, Scalar
from .inner import Inner
from .prestress import AxialState, stretch

_FINITE = move_node_by_series, conjugate_moment
_NEAR = partial(move_node_by_series, order=1), partial(conjugate_moment, order=1)


class Member(Inner):
    """Methods of `beam.Beams` that concern one element.

    The group has `section`, `springs`, `torsional_stiffness`, `points` and `axes(ends)`.
    """

    torsional_stiffness: Float[ArrayLike, " n_elem"] | None

    @abc.abstractmethod
    def axes(self, ends: Ends) -> Float[Array, "3 3"]:
        """Initial axes of the element, [3, 3]: ``axes[0]`` along it, then the section's y and z."""

    def _pose(self, state, ends, motion):
        """Initial axes, and `corotation.Pose` of the element."""
        axes = self.axes(ends)
        turns = [motion[k, 3:] for k in (0, 1)]
        if self.springs is not None:  # the ends turn against their nodes
            turns = [
                compose(turn, from_stereographic(joint @ axes))
                for turn, joint in zip(turns, self._joints(state, motion), strict=True)
            ]
        return axes, corotation.pose(axes, ends, motion[:2, :3], jnp.stack(turns), state.kinks)

    def _field(self, state, axes, pose, motion):
        """`bending.Field` of the element, and its line load along the turned axes, or None."""
        load = None
        if state.line_load is not None:
            load = pose.axes @ state.line_load
        if state.pressures is not None:
            pressed = corotation.pressed(pose, state.pressures, state.rest_length)[0]
            load = pressed if load is None else load + pressed
        length, inner = state.rest_length, None
        if not self.section.is_elastic:
            inner = jnp.zeros((2, 2), length.dtype)
            if self._n_field_row == 1:
                inner = inner.at[0, 0].set(motion[2, 0] / length)
            else:
                size = jnp.stack([length, length**2 / 32])
                inner = motion[2:4, :2] / size[:, None]
        stretch = (state.elongation + pose.change) / length
        stiffness = self.section.stiffness() if inner is None else None
        return bending.field(pose.rotations, stretch, length, load, stiffness, inner), load

    @jax.jit  # traced once, although a program calls it many times
    def _bent(self, state, ends, motion):
        """Initial axes, `corotation.Pose`, `bending.Field`, and line load along the turned axes."""
        axes, pose = self._pose(state, ends, motion)
        return axes, pose, *self._field(state, axes, pose, motion)

    def _strains(self, field):
        """Section strains at the integration points, [n_point, 3]."""
        places = bending.lobatto(self.points)[0]
        return bending.basis(jnp.asarray(places, field.strain.dtype)) @ field.strain

    def _twisting(self):
        """Torsional stiffness, N m2."""
        given = self.torsional_stiffness
        return self.section.torsional_stiffness() if given is None else given

    def _sums(self, state, field, forces=None):
        """Integrals over the axis of section forces times 1, P1, P2, [3, 3], N and N m."""
        if self.section.is_elastic:
            return bending.linear_sums(self.section.stiffness(), field.strain)
        strain = self._strains(field)
        if forces is None:
            force = jnp.stack(self.section.forces(*_columns(strain), state.memory), axis=-1)
        else:
            force = forces(strain)
        places, weight = (jnp.asarray(v, force.dtype) for v in bending.lobatto(self.points))
        return (weight[:, None] * bending.basis(places)).T @ force

    @jax.jit  # traced once
    def _resistance(self, state, ends, motion):
        """Pull on the second end [3], moments on both ends [2, 3], forces of inner numbers [k]."""
        return self._balance(state, motion, self._bent(state, ends, motion))

    def _balance(self, state, motion, bent, forces=None):
        axes, pose, field, load = bent
        length, rotations = state.rest_length, pose.rotations
        following = None
        if state.pressures is not None:
            following = corotation.pressed(pose, state.pressures, length)[1:]
        sums = self._sums(state, field, forces)
        force, moments, torque, unbalanced = bending.generalized(
            field, rotations, length, sums, self._twisting(), load, following
        )
        pull, moments = corotation.end_forces(pose, force, moments, torque)
        inner = []
        if self._n_field_row:
            inner = [unbalanced[0, : self._n_field_row] / length]
        if self._n_field_row == 2:
            inner.append(unbalanced[1] * 32 / length**2)
        if self.springs is not None:
            for k, joint in enumerate(self._joints(state, motion)):
                moment = axes @ rotate(invert(motion[k, 3:]), moments[k])
                moment = moment_conjugate_to_stereographic(joint, moment)
                angle, pull_back = jax.vjp(rotation_vector, joint)
                inner.append((moment + pull_back(self.springs[k] * angle)[0]) / (4 * length))
        return pull, moments, jnp.concatenate(inner) if inner else jnp.zeros(0, pull.dtype)

    def _step(self, state, ends, motion, step, forces=None, near=False):
        """Forces conjugate to a step: relative translation, spins, inner numbers, [9 + k].

        With `near` they are correct to the first order of the step, as a tangent needs them.
        """
        turning, conjugate = _NEAR if near else _FINITE
        zero, spins = jnp.zeros_like(step[:3]), step[3:9].reshape(2, 3)
        moved = jnp.concatenate([jnp.stack([zero, step[:3]]), spins], axis=1)
        new = jax.vmap(turning)(motion[:2], moved)
        if self.inner:
            new = jnp.concatenate([new, motion[2:].at[self._places].add(step[9:])])
        pull, moments, inner = (
            self._resistance(state, ends, new)
            if forces is None
            else self._balance(state, new, self._bent(state, ends, new), forces)
        )
        moments = jax.vmap(conjugate)(spins, moments)
        return jnp.concatenate([pull, moments.ravel(), inner])

    def end_forces_about(
        self, state: AxialState, ends: Ends, motion: Motion, step: Forces
    ) -> Forces:
        """Forces and moments conjugate to `step` (translation and spin), both [n_end, 6]."""
        inner = step[2:][self._places] if self.inner else jnp.zeros(0, step.dtype)
        reduced = jnp.concatenate([step[1, :3] - step[0, :3], step[:2, 3:].ravel(), inner])
        return self._spread(self._step(state, ends, motion, reduced))

    def end_forces(self, state: AxialState, ends: Ends, motion: Motion) -> Forces:
        """Internal forces and spatial moments at both ends, N and N m, [n_end, 6].

        The rows of inner numbers, after those of the two ends, contain the forces of these.
        """
        return self._joined(*self._resistance(state, ends, motion))

    @jax.jit  # traced once
    def linearized(
        self, state: AxialState, ends: Ends, motion: Motion
    ) -> tuple[Forces, Float[Array, "12+k 12+k"]]:
        """End forces as `end_forces`, and tangent stiffness, [12 + k, 12 + k].

        The tangent is a Hessian in the steps, hence symmetric. The order of its unknowns is
        translation and spin of the first end, of the second end, inner numbers.

        By autodiff. The section is linearized first, so that its fibres are evaluated once and not
        for every column. Forces depend on the relative translation of the ends only, so that
        derivatives by nine numbers give those by all twelve.
        """
        forces = None
        if not self.section.is_elastic:
            at = self.section_strain(state, ends, motion)
            force, stiffness = self.section.forces_and_tangent(*_columns(at), state.memory)

            def forces(strain):
                return force + jnp.einsum("pij,pj->pi", stiffness, strain - at)

        def stepped(step):
            force = self._step(state, ends, motion, step, forces, True)
            return force, force

        step = jnp.zeros(9 + len(self.inner), ends.dtype)
        slope, force = jax.jacfwd(stepped, has_aux=True)(step)
        for axis in (0, 1):
            pull, first, second, inner = jnp.split(slope, [3, 6, 9], axis)
            slope = jnp.concatenate([-pull, first, pull, second, inner], axis)
        return self._spread(force), slope

    def tangent(self, state: AxialState, ends: Ends, motion: Motion) -> Float[Array, "12+k 12+k"]:
        """Tangent stiffness, see `linearized`."""
        return self.linearized(state, ends, motion)[1]

    def finds_both(self, state: AxialState) -> bool:
        """True: pose and strains, which both need, take more than half of the time to compile."""
        return True

    def mass_matrix(
        self,
        state: AxialState,
        ends: Ends,
        motion: Motion,
        mass: Scalar,
        distribution: str | None = None,
    ) -> Float[Array, "12+k 12+k"]:
        """Mass matrix of `mass`, kg, spread evenly along the axis, [12 + k, 12 + k], kg.

        Sections have no rotary inertia. The matrix is consistent with the deflections of `bending`
        (without loads cubic), hence of order 4 in the length. Displacements along the chord are
        linear: by default their part is the mean of the consistent matrix and of halves at the
        ends, which is of order 4, too.
        """
        halves = np.zeros(12 + len(self.inner))
        halves[[0, 1, 2, 6, 7, 8]] = 0.5
        lumped = mass * jnp.diag(jnp.asarray(halves, ends.dtype))
        if distribution == "lumped":
            return lumped
        at, by = np.polynomial.legendre.leggauss(4)  # exact for squares of cubics
        places, weight = (jnp.asarray(v, ends.dtype) for v in (0.5 + 0.5 * at, 0.5 * by))

        def moved(step):
            steps = step[:12].reshape(2, 6)
            new = jax.vmap(lambda m, s: move_node_by_series(m, s, order=1))(motion[:2], steps)
            if self.inner:
                new = jnp.concatenate([new, motion[2:].at[self._places].add(step[12:])])
            _, pose, field, _ = self._bent(state, ends, new)
            way = bending.curve(field, pose.rotations, state.rest_length, pose.length, places)[0]
            return step[None, :3] + way @ pose.axes, pose.length

        still = jnp.zeros(12 + len(self.inner), ends.dtype)
        slope, along = jax.jacfwd(moved)(still)
        matrix = mass * jnp.einsum("p,pai,paj->ij", weight, slope, slope)
        if distribution is None:
            return matrix + mass / 12 * jnp.outer(along, along)
        return matrix if distribution == "consistent" else 0.5 * (lumped + matrix)

    def energy(self, state: AxialState, ends: Ends, motion: Motion) -> Scalar:
        """Stored energy minus the work of the line load on the deflected axis, J."""
        _, pose, field, load = self._bent(state, ends, motion)
        length = state.rest_length
        # the energy of a linear section is a polynomial of degree 4 along the axis
        count = max(4, self.points) if self.section.is_elastic else self.points
        places, weight = (jnp.asarray(v, field.strain.dtype) for v in bending.lobatto(count))
        strain = bending.basis(places) @ field.strain
        total = length * weight @ self.section.energy(*_columns(strain), state.memory)
        total = total + 0.5 * self._twisting() * field.twist**2 / length
        if load is not None:
            total = total - length * load @ bending.displaced(field, pose.rotations, length)
        if self.springs is not None:
            turned = jax.vmap(rotation_vector)(self._joints(state, motion))
            total = total + 0.5 * jnp.sum(self.springs * turned**2)
        return total

    def has_result(self, name: str, state: AxialState) -> bool:
        """Whether it has a result; a peak tension only where there is a load."""
        if name == "peak_tension":
            return state.line_load is not None
        return super().has_result(name, state)

    def reading(
        self, state: AxialState, ends: Ends, motion: Motion, names: Sequence[str]
    ) -> dict[str, Array]:
        """Results by name: pose and strains are found once for all of them."""
        if len(names) < 2:
            return super().reading(state, ends, motion, names)
        bent = self._bent(state, ends, motion)
        resistance = cache(lambda: self._balance(state, motion, bent))
        known = {
            "tension": lambda: self._tension(state, bent[2]),
            "peak_tension": lambda: self._peak(state, ends, motion, self._tension(state, bent[2])),
            "section_strain": lambda: self._strains(bent[2]),
            "section_forces": lambda: self._section_forces(state, bent, resistance()),
            "end_forces": lambda: self._joined(*resistance()),
        }
        others = super().reading(state, ends, motion, [name for name in names if name not in known])
        return others | {name: known[name]() for name in names if name in known}

    def tension(self, state: AxialState, ends: Ends, motion: Motion) -> Scalar:
        """Axial force, mean over the element, N."""
        return self._tension(state, self._bent(state, ends, motion)[2])

    def _tension(self, state, field):
        return self._sums(state, field)[0, 0]

    def peak_tension(self, state: AxialState, ends: Ends, motion: Motion) -> Scalar:
        """Axial force of largest size along the element, N; a load along it puts it at an end."""
        return self._peak(state, ends, motion, self.tension(state, ends, motion))

    def _peak(self, state, ends, motion, force):
        vector, length, _, _ = stretch(ends, motion[:2, :3])
        half = 0.5 * state.rest_length * jnp.abs(state.line_load @ vector / length)
        return force + jnp.where(force < 0, -half, half)

    def section_strain(
        self, state: AxialState, ends: Ends, motion: Motion
    ) -> Float[Array, "n_point 3"]:
        """Strain and curvatures ``e0, ky, kz`` at the integration points, [n_point, 3]."""
        return self._strains(self._bent(state, ends, motion)[2])

    def section_forces(
        self,
        state: AxialState,
        ends: Ends,
        motion: Motion,
        places: Float[ArrayLike, " n"] | None = None,
    ) -> Float[Array, "n 6"]:
        """``N, Vy, Vz, T, My, Mz`` at places from 0 to 1, default the integration points, [n, 6].

        N and N m, by equilibrium of the part before the section, hence exact for the end forces
        and the load, whatever the laws of the fibres. Their axes are those of the section there,
        which follows the deflected axis.
        """
        bent, resistance = (f(state, ends, motion) for f in (self._bent, self._resistance))
        return self._section_forces(state, bent, resistance, places)

    def _section_forces(self, state, bent, resistance, places=None):
        places = bending.lobatto(self.points)[0] if places is None else places
        _, pose, field, load = bent
        pull, moments, _ = resistance
        length, s = state.rest_length, jnp.asarray(places, pull.dtype)
        load = jnp.zeros(3, pull.dtype) if load is None else load * length
        start = -(pose.axes @ pull) - load / 2  # force of the node on the element
        twist = pose.axes @ moments[0]
        place, area, turn = bending.curve(field, pose.rotations, length, pose.length, s)
        carried = start[None] + jnp.outer(s, load)
        moment = _cross(place, carried) - _cross(area, load[None]) - twist[None]
        both = jnp.stack([-carried, moment], axis=1)
        # into the axes of the section by its small rotation, to second order like everything here
        spin = turn[:, None]
        change = _cross(spin, both)
        return (both - change + 0.5 * _cross(spin, change)).reshape(-1, 6)

    def size(self, state: AxialState, ends: Ends, motion: Motion) -> Scalar:
        """Sum of the absolute forces of all fibres, mean over the element, N."""
        size = self.section.absolute_force(
            *_columns(self.section_strain(state, ends, motion)), state.memory
        )
        return jnp.asarray(bending.lobatto(self.points)[1], size.dtype) @ size

    def rounding(self, state: AxialState, ends: Ends, motion: Motion) -> Forces:
        """Error that the rounding of displacements leaves in `end_forces`, in their shape."""
        vector, length, _, _ = stretch(ends, motion[:2, :3])
        stiffness = jnp.diagonal(self.section.stiffness())
        across = 12 * jnp.maximum(stiffness[1], stiffness[2]) / length**2
        moved = jnp.max(jnp.abs(motion[:2, :3])) / length
        force = stiffness[0] * jnp.abs(vector) / length + across
        both = jnp.append(force, jnp.full(3, across * length, force.dtype))
        # inner numbers are lengths along and across, too
        rows = jnp.broadcast_to(stiffness[0] + across, (self.n_inner_row, 6))
        each = jnp.concatenate([jnp.stack([both, both]), rows])
        return 8 * jnp.finfo(force.dtype).eps * moved * each

    def commit_memory(
        self,
        strain: Float[Array, "n_point 3"],
        memory: PyTree[Float[Array, "n_point n_fibre n_memory"]],
        duration: float = 0.0,
    ) -> PyTree[Float[Array, "n_point n_fibre n_memory"]]:
        """Memory after an increment that ended at section strains [n_point, 3]."""
        return self.section.commit_memory(*_columns(strain), memory, duration)

    def fibre_stress(
        self,
        strain: Float[Array, "n_point 3"],
        memory: PyTree[Float[Array, "n_point n_fibre n_memory"]] | None = None,
    ) -> Float[Array, "n_point n_fibre"]:
        """Stress of every fibre at section strains [n_point, 3], [n_point, n_fibre], Pa."""
        return self.section.fibre_stress(*_columns(strain), memory)

    def is_ruptured(self, strain: Float[Array, "n_point 3"]) -> Bool[Array, ""]:
        """Whether section strains [n_point, 3] take a fibre beyond its curve."""
        return jnp.any(self.section.is_ruptured(*_columns(strain)))


def _columns(strain: Float[Array, "n_point 3"]) -> tuple[Array, Array, Array]:
    """Strain and both curvatures of section strains."""
    strain, about_y, about_z = strain.T
    return strain, about_y, about_z


def _cross(a, b):
    """Vector products of arrays [..., 3], by shifts instead of many small contractions."""
    return jnp.roll(a, -1, -1) * jnp.roll(b, 1, -1) - jnp.roll(a, 1, -1) * jnp.roll(b, -1, -1)
