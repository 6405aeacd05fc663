"""Beam: two nodes with displacements and finite rotations, fibre sections along the axis.

Corotational (Crisfield 1990; Battini and Pacoste 2002). The element's own frame follows its chord
and the mean of the rotations of its ends; in it only small rotations remain:

- ``theta_1, theta_2``: rotations of the ends out of the frame, the vector of ``q_E^-1 q_i``;
- deflections are cubic (Bernoulli), so the curvature at the place s of the axis, 0 to 1, is
  ``[(6 s - 4) theta_1 + (6 s - 2) theta_2] / L0``;
- axial strain ``e0 = (l - L0)/L0 + sum_{y,z} (2 theta_1^2 - theta_1 theta_2 + 2 theta_2^2)/30``,
  the mean over the element with the shortening of the deflected axis (a mean, or it would lock);
- twist ``theta_2x - theta_1x``, elastic and uniform.

Forces are the derivative of these strains times the section's forces at Gauss-Lobatto points, by
autodiff, with respect to a translation and a spin of each end. A rigid motion of any size changes
none of the strains. Shear flexibility and warping are not modelled.
"""

import jax
import jax.numpy as jnp
import numpy as np

from .. import _check
from .._tree import Indices, copy, pytree
from ..rotations import (
    cross,
    inverse,
    middle,
    product,
    rotate,
    shortest,
    small_vector,
    turning,
)
from ..sections import Section
from .prestress import Prestressed, checked_links, stretch

_PROPERTIES = ("torsional_stiffness", "up", "rest_length", "weight", "expansion", "strength")
_UPRIGHT = 1e-3  # sine of the angle to z below which an element counts as vertical


@pytree(indices=("links", "hinges"), static=("points",))
class Beams(Prestressed):
    """A group of beam elements; their nodes have rotations.

    Args:
        links: node numbers, [n_elem, 2].
        section: `Section` of all elements of the group.
        up: vector in the plane of the element's axis and the section's z, [3] or [n_elem, 3];
            default the global z, for vertical elements (within 0.06 degrees) the global x.
        torsional_stiffness: GJ, scalar or [n_elem], N m2; default from the section's torsion
            constant with Poisson's ratio 0.3.
        rest_length, weight, expansion, strength: as for `Bars`. Weight bends the element.
        hinges: True where the rotation of an end is released (ball and socket), [n_elem, 2].
        points: number of integration points, ends included; default 3 for linear laws (exact), else
            5.

    Raises:
        ValueError: wrong shapes, non-positive values, `up` along an element, both ends hinged.

    Source: Crisfield (1990); Battini and Pacoste (2002).

    Example:
        Cantilever of 2 m with 100 N at its tip: ``P L^3 / 3 EI`` = 4 mm, and 1 % more because ten
        layers of fibres have 1 % less inertia:

        >>> section = jc.Section.rectangle(0.04, 0.1, jc.Elastic(20e9))
        >>> nodes = np.linspace([0.0, 0.0, 0.0], [2.0, 0.0, 0.0], 3)
        >>> beam = jc.Beams([[0, 1], [1, 2]], section=section)
        >>> structure = jc.Structure(nodes, beam, supports=jc.clamped([0]))
        >>> solution = jc.solve(structure, jc.Phase(loads=jc.NodalLoads([2], (0.0, 0.0, -100.0))))
        >>> print(f"{jc.describe(solution.status)}: {1e3 * solution.displacement[2, 2]:.2f} mm")
        converged: -4.04 mm
        >>> print(f"{solution.reaction_moments[0, 1]:.1f} N m")  # about y, at the clamp
        -200.0 N m
    """

    links: object
    section: Section = None
    up: object = None
    torsional_stiffness: object = None
    rest_length: object = None
    weight: object = None
    expansion: object = None
    strength: object = None
    hinges: object = None
    points: int = None

    tension_only = False
    rising = False  # bending energy is not convex in the positions
    n_freedom = 6
    shaped_by_load = True

    def __post_init__(self):
        put = object.__setattr__
        put(self, "links", checked_links(self.links))
        n_elem = len(self.links)
        if not isinstance(self.section, Section):
            raise ValueError("section: missing; a group of beams needs a Section")
        for name in ("torsional_stiffness", "rest_length", "weight", "expansion", "strength"):
            put(self, name, _check.per_element(getattr(self, name), n_elem, name))
        for name in ("torsional_stiffness", "rest_length", "strength"):
            if getattr(self, name) is not None:
                _check.require(getattr(self, name), lambda v: v > 0, name, "must be positive")
        if self.weight is not None:
            _check.require(self.weight, lambda v: v >= 0, "weight", "must not be negative")
        if self.torsional_stiffness is None and self.section.torsion is None:
            raise ValueError(
                "torsional_stiffness: missing; this section has no known torsion constant"
            )
        if self.up is not None:
            up = _check.floats(self.up, "up")
            if up.shape not in ((3,), (n_elem, 3)):
                raise ValueError(f"up: expected shape (3,) or ({n_elem}, 3), got {up.shape}")
            pack = jnp if isinstance(up, jax.Array) else np
            put(self, "up", pack.broadcast_to(up, (n_elem, 3)))
        if self.points is None:
            put(self, "points", 3 if self.section.is_elastic else 5)
        if not isinstance(self.points, int | np.integer) or self.points < 3:
            raise ValueError(f"points = {self.points!r}: expected an integer >= 3")
        self._check_hinges()

    def _check_hinges(self):
        if self.hinges is None or isinstance(self.hinges, Indices):
            return
        hinges = np.asarray(self.hinges)
        if hinges.dtype != bool or hinges.shape != (len(self.links), 2):
            raise ValueError(
                f"hinges: expected booleans [{len(self.links)}, 2], "
                f"got {hinges.dtype} {hinges.shape}"
            )
        both = hinges.all(axis=1)
        if both.any():
            raise ValueError(
                f"hinges[{int(both.argmax())}]: both ends are released, the element could spin "
                "about its axis; make it a bar"
            )
        object.__setattr__(self, "hinges", Indices(hinges) if hinges.any() else None)

    def check(self, nodes):
        """Raise ValueError if `up` is along an element, for initial positions [n_node, 3]."""
        up = None if self.up is None else _check.concrete(self.up)
        if up is None:
            return
        chord = nodes[self.links.array[:, 1]] - nodes[self.links.array[:, 0]]
        off = np.linalg.norm(np.cross(chord, up), axis=1)
        along = off <= 1e-9 * np.linalg.norm(chord, axis=1) * np.linalg.norm(up, axis=1)
        if along.any():
            k = int(along.argmax())
            raise ValueError(f"up[{k}] = {up[k].tolist()}: must not be along the element")

    def properties(self):
        """The arrays with one value per element, by name."""
        values = {name: getattr(self, name) for name in _PROPERTIES}
        return {name: value for name, value in values.items() if value is not None}

    # --- the group

    @property
    def remembers(self):
        """Whether its fibres have plastic strains."""
        return self.section.remembers

    @property
    def breaks(self):
        """Whether a fibre can be strained beyond its curve."""
        return self.section.breaks

    def virgin(self):
        """Plastic strains of unused elements, per law, or None."""
        return self.section.virgin((len(self.links), self.points)) if self.remembers else None

    def continued(self):
        """The group for an iteration: its laws go on beyond their ends."""
        return copy(self, section=self.section.continued())

    def capacity(self):
        """Smallest and largest axial force without bending, N."""
        area, law = self.section.axial()
        low, high = law.capacity
        return low * area, high * area

    def strain_at(self, force, plastic=None):
        """Strain at an axial force without bending, N."""
        if plastic is not None:
            raise ValueError("pretension: state that of an elastic-plastic beam as prestrain")
        area, law = self.section.axial()
        return law.strain_at(force / area)

    # --- one element

    def axes(self, ends):
        """Initial axes of the element as rows: along, section's y, section's z, [3, 3]."""
        chord = ends[1] - ends[0]
        along = chord / jnp.sqrt(chord @ chord)
        if self.up is None:
            upright = along[0] ** 2 + along[1] ** 2 < _UPRIGHT**2
            up = jnp.where(upright, *jnp.eye(3, dtype=along.dtype)[jnp.array([0, 2])])
        else:
            up = self.up
        z = up - (up @ along) * along
        z = z / jnp.sqrt(z @ z)
        return jnp.stack([along, cross(z, along), z])

    def deformation(self, ends, motion):
        """Change of length, rotations of the ends in element axes [2, 3], rotation of the axes."""
        axes = self.axes(ends)
        vector, length, change, _ = stretch(ends, motion[:, :3])
        mean = middle(motion[0, 3:], motion[1, 3:])
        frame = product(shortest(rotate(mean, axes[0]), vector / length), mean)
        back = inverse(frame)
        rotations = jax.vmap(lambda q: axes @ small_vector(product(back, q)))(motion[:, 3:])
        return change, rotations, frame

    @jax.jit  # traced once for all its uses; a compilation has it many times over
    def _strains(self, state, ends, motion):
        """Section strains [n_point, 3], twist, and the line load's work on the bent axis."""
        change, (first, second), frame = self.deformation(ends, motion)
        bend = 2 * first[1:] ** 2 - first[1:] * second[1:] + 2 * second[1:] ** 2
        e0 = (state.elongation + change) / state.rest_length + jnp.sum(bend) / 30
        place = jnp.asarray(_lobatto(self.points)[0], e0.dtype)[:, None]
        curvature = (6 * place - 4) * first[None, 1:] + (6 * place - 2) * second[None, 1:]
        strain = jnp.column_stack([jnp.full(self.points, e0), curvature / state.rest_length])
        work = jnp.zeros((), e0.dtype)
        if state.line_load is not None:
            # mean deflection of a cubic: L/12 (theta_1 - theta_2) about the axis across it
            about = state.rest_length / 12 * (first - second)
            _, y, z = self.axes(ends)
            mean = rotate(frame, about[2] * y - about[1] * z)
            work = state.rest_length * state.line_load @ mean
        return strain, second[0] - first[0], work

    def _twisting(self):
        """Torsional stiffness, N m2."""
        given = self.torsional_stiffness
        return self.section.torsional_stiffness() if given is None else given

    @jax.jit  # as above
    def end_forces_about(self, state, ends, motion, step):
        """Forces and moments conjugate to `step` (translation and spin, [2, 6]), [2, 6]."""

        def forces(strain):
            return jnp.stack(self.section.forces(*strain.T, state.plastic), axis=-1)

        return self._balance(state, ends, motion, step, forces)

    def _balance(self, state, ends, motion, step, forces):
        """Forces conjugate to `step`, for any section forces [n_point, 3] from section strains."""
        (strain, twist, work), pull = jax.vjp(
            lambda s: self._strains(state, ends, jax.vmap(turning)(motion, s)), step
        )
        weight = jnp.asarray(_lobatto(self.points)[1], twist.dtype) * state.rest_length
        torque = self._twisting() * twist / state.rest_length
        return pull((weight[:, None] * forces(strain), torque, -jnp.ones_like(work)))[0]

    def end_forces(self, state, ends, motion):
        """Internal forces and spatial moments at both ends, [2, 6], N and N m."""
        return self.end_forces_about(state, ends, motion, jnp.zeros((2, 6), ends.dtype))

    @jax.jit  # as above
    def tangent(self, state, ends, motion):
        """Tangent stiffness, [2, 6, 2, 6]: symmetric, being a Hessian in the steps.

        By autodiff, of the section first: its tangent is the same for all 12 columns, and linear
        forces with this tangent save going through all fibres for each of them.
        """
        at = self.section_strain(state, ends, motion)
        force, stiffness = self.section.linearized(*at.T, state.plastic)

        def forces(strain):
            return force + jnp.einsum("pij,pj->pi", stiffness, strain - at)

        step = jnp.zeros((2, 6), ends.dtype)
        return jax.jacfwd(lambda s: self._balance(state, ends, motion, s, forces))(step)

    def energy(self, state, ends, motion):
        """Stored energy less the line load's work on the bent axis, J."""
        strain, twist, work = self._strains(state, ends, motion)
        weight = jnp.asarray(_lobatto(self.points)[1], twist.dtype) * state.rest_length
        bending = weight @ self.section.energy(*strain.T, state.plastic)
        return bending + 0.5 * self._twisting() * twist**2 / state.rest_length - work

    def tension(self, state, ends, motion):
        """Axial force, mean over the element, N."""
        force = self.section_forces(state, ends, motion)[:, 0]
        return jnp.asarray(_lobatto(self.points)[1], force.dtype) @ force

    def section_strain(self, state, ends, motion):
        """Strain and curvatures ``e0, ky, kz`` at the integration points, [n_point, 3]."""
        return self._strains(state, ends, motion)[0]

    def section_forces(self, state, ends, motion):
        """``N, My, Mz`` and torque at the integration points, [n_point, 4], N and N m.

        Those of the cubic deflection: of a line load they have its work at the ends, not the
        ``q L^2 / 12`` that its own element adds there. Use several elements where it matters.
        """
        strain, twist, _ = self._strains(state, ends, motion)
        torque = jnp.full(self.points, self._twisting() * twist / state.rest_length)
        return jnp.stack([*self.section.forces(*strain.T, state.plastic), torque], axis=-1)

    def size(self, state, ends, motion):
        """Sum of the absolute forces of all fibres, mean over the element, N."""
        size = self.section.size(*self.section_strain(state, ends, motion).T, state.plastic)
        return jnp.asarray(_lobatto(self.points)[1], size.dtype) @ size

    def rounding(self, state, ends, motion):
        """What the rounding of its displacements leaves of its end forces, [2, 6], N and N m."""
        vector, length, _, _ = stretch(ends, motion[:, :3])
        stiffness = jnp.diagonal(self.section.stiffness())
        bending = 12 * jnp.maximum(stiffness[1], stiffness[2]) / length**2
        moved = jnp.max(jnp.abs(motion[:, :3])) / length
        force = stiffness[0] * jnp.abs(vector) / length + bending
        both = jnp.append(force, jnp.full(3, bending * length, force.dtype))
        return 8 * jnp.finfo(force.dtype).eps * moved * jnp.stack([both, both])

    def settle(self, state, ends, motion):
        """Plastic strains after an increment that ended here, as `state.plastic`."""
        return self.settle_at(self.section_strain(state, ends, motion), state.plastic)

    def settle_at(self, strain, plastic):
        """Plastic strains after an increment that ended at section strains [n_point, 3]."""
        return self.section.settle(*strain.T, plastic)

    def fibre_stress(self, strain, plastic=None):
        """Stress of every fibre at section strains [n_point, 3], [n_point, n_fibre], Pa."""
        return self.section.fibre_stress(*strain.T, plastic)

    def beyond(self, state, ends, motion):
        """Whether a fibre is strained beyond its curve."""
        return jnp.any(self.section.beyond(*self.section_strain(state, ends, motion).T))

    def is_slack(self, state, ends, motion):
        """A beam holds in compression too: never slack."""
        return jnp.zeros((), bool)


def _lobatto(n):
    """Gauss-Lobatto points from 0 to 1 and weights, [n] each (exact to degree 2 n - 3)."""
    legendre = np.polynomial.legendre.Legendre.basis(n - 1)
    points = np.concatenate([[-1.0], np.sort(legendre.deriv().roots().real), [1.0]])
    return 0.5 + 0.5 * points, 1 / (n * (n - 1) * legendre(points) ** 2)
