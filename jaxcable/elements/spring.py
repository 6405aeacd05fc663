"""Springs between single nodes and the ground: linear ones, and bearings that can lift off.

The ground is where the springs are unstressed; it moves with no support. Forces of linear springs
and bearings keep their directions however far nodes move. A spring against rotation has the energy
``theta.K theta / 2`` of the rotation vector ``theta`` of its node, which is below half a turn.
"""

from __future__ import annotations

from typing import ClassVar

import jax
import jax.numpy as jnp
import numpy as np

from ..common import checks
from ..common.rules import Rule, not_negative, positive, refuse_if_broken
from ..common.tree import Indices, copy_with, pytree, set_fields
from ..common.types import Array, ArrayLike, Bool, Float, Int
from ..numerics.rotations import (
    IDENTITY,
    compose,
    invert,
    move_node_by_series,
    stereographic_to_rotation_vector,
    to_stereographic,
)
from .abilities import RoundingEstimate
from .contact import OPENING
from .element import TENSION, Ends, Forces, Motion, Result, Scalar
from .element_state import ElementState

SPRING_FORCE = Result("spring_force", "N", ("x", "y", "z"))
"""Force of the ground on the node of a spring or bearing, along x, y, z."""
SPRING_MOMENT = Result("spring_moment", "N m", ("x", "y", "z"))
"""Moment of the ground on the node of a spring, about x, y, z."""
_RIGHT_ANGLES = 1e-6  # largest difference of axes A from unit vectors at right angles, of A A^T


@pytree
class SpringState(ElementState):
    """State of a group of springs to the ground: where they are unstressed.

    Attributes:
        origin: displacement of each node at which its spring is unstressed, [n_elem, 3], m: zero,
            or that at which the spring was added.
        origin_rotation: the same of the rotation, unit quaternions [n_elem, 4]; None without
            springs against rotation.
        gap: of bearings the distance from the node to the ground at `origin`, [n_elem], m.
        present: which elements are active, [n_elem] bool; None if all are, in all phases.
    """

    origin: Float[Array, "n_elem 3"]
    origin_rotation: Float[Array, "n_elem 4"] = None  # type: ignore[assignment]  # of springs
    gap: Float[Array, " n_elem"] = None  # type: ignore[assignment]  # given for bearings
    present: Bool[Array, " n_elem"] | None = None


class GroundElement(RoundingEstimate):
    """Elements of one node that join it to the ground; a base class of springs and bearings."""

    def spring_force(self, state: SpringState, ends: Ends, motion: Motion) -> Float[Array, " 3"]:
        """Return the force of the ground on the node of one element along x, y, z, [3], N."""
        return -self.end_forces(state, ends, motion)[0, :3]

    def unstressed_state(
        self, ends: Float[Array, "n_elem 1 3"], slack: Bool[Array, " n_elem"]
    ) -> ElementState:
        """Return the state before the first phase, in which springs without preload have no force.

        No spring is slack, so that `slack` has no effect.
        """
        return self.start(ends)

    def _displacement_from_origin(self, state, motion):
        """Return the displacement of the node from where its spring is unstressed, [3], m."""
        return motion[0, :3] - state.origin


@pytree(indices=("links",))
class Springs(GroundElement):
    """A group of linear springs from nodes to the ground, along and about fixed axes.

    The ground pulls a displaced node back with ``-K u``; with `rotational_stiffness` it turns it
    back with a moment of the potential ``theta.K theta / 2``, where ``theta`` is the rotation
    vector of the node (angle times axis, below half a turn): about a single axis, and with the same
    stiffness about all axes, this is ``-K theta``. Elastic foundations and soft anchorages are such
    springs. One that only presses is one of `GroundContacts`.

    Args:
        links: node numbers, [n_elem] or [n_elem, 1]. Several springs may be at a node.
        stiffness: spring constants along the axes, a scalar for all three, [3], or [n_elem, 3],
            N/m; zero along an axis where there is no spring.
        rotational_stiffness: spring constants about the axes, scalar, [3] or [n_elem, 3], N m/rad.
            The nodes then rotate, as those of beams do. Default: no springs against rotation.
        axes: directions that replace x, y, z, [3, 3] or [n_elem, 3, 3], without unit, one in each
            row of a matrix, of length 1 and at right angles. They do not change while the structure
            moves.
        preload: force of the ground on the undisplaced node along the axes, [3] or [n_elem, 3], N;
            it acts as long as the spring is there. Default zero.

    Raises:
        ValueError: wrong shapes, negative stiffness, axes that are not at right angles.

    Example:
        A post on a spring of 50 kN/m takes 600 N; the spring yields by 12 mm:

        >>> nodes = [[0.0, 0.0, 0.0], [0.0, 0.0, 3.0]]
        >>> elements = {"post": jc.Bars([[0, 1]], 1e6), "ground": jc.Springs([0], (0, 0, 50e3))}
        >>> held = jc.restrained([0, 1], "xy")
        >>> structure = jc.Structure(nodes, elements, held)
        >>> load = jc.NodalLoads([1], (0.0, 0.0, -600.0))
        >>> solution = jc.solve(structure, jc.Phase(loads=load))
        >>> print(solution.status, jnp.round(solution.displacement[0, 2], 6))
        0 -0.012
        >>> print(jnp.round(solution.element_results["spring_force"]["ground"], 3))
        [[  0.   0. 600.]]
    """

    links: Int[ArrayLike, " n_elem"] | Int[ArrayLike, "n_elem 1"]
    stiffness: Float[ArrayLike, ""] | Float[ArrayLike, " 3"] | Float[ArrayLike, "n_elem 3"]
    rotational_stiffness: (
        Float[ArrayLike, ""] | Float[ArrayLike, " 3"] | Float[ArrayLike, "n_elem 3"] | None
    ) = None
    axes: Float[ArrayLike, "3 3"] | Float[ArrayLike, "n_elem 3 3"] | None = None
    preload: Float[ArrayLike, " 3"] | Float[ArrayLike, "n_elem 3"] | None = None

    results: ClassVar[tuple[Result, ...]] = (SPRING_FORCE, SPRING_MOMENT)
    per_element = ("stiffness", "rotational_stiffness", "axes", "preload")
    monotone = True

    def __post_init__(self):
        links = one_node_links(self.links)
        set_fields(self, links=links)
        for name in ("stiffness", "rotational_stiffness", "preload"):
            value = vectors_per_element(getattr(self, name), len(links), name, name != "preload")
            set_fields(self, **{name: value})
        if self.axes is not None:
            shapes = (3, 3), (len(links), 3, 3)
            axes = checks.floats_of_shape(self.axes, "axes", *shapes)
            set_fields(self, axes=_broadcast_per_element(axes, (len(links), 3, 3)))
        refuse_if_broken(self.rules())

    def rules(self) -> list[Rule]:
        """Return the rules: stiffness is not negative, axes are unit vectors at right angles."""
        text = "expected three unit vectors at right angles, one in each row"
        return [
            not_negative("stiffness", self.stiffness),
            not_negative("rotational_stiffness", self.rotational_stiffness),
            Rule("axes", self.axes, _are_not_at_right_angles, text),
        ]

    @property
    def rotates(self) -> bool:  # type: ignore[override]  # read only
        """Whether the springs resist rotation, so that their nodes rotate."""
        return self.rotational_stiffness is not None

    def has_result(self, name: str, state: SpringState) -> bool:
        """Return whether elements have a result; moments only with springs against rotation."""
        return super().has_result(name, state) and (name != "spring_moment" or self.rotates)

    def start(self, ends: Float[Array, "n_elem 1 3"]) -> SpringState:
        """Return the state before the first phase: unstressed where the nodes are."""
        origin = jnp.zeros_like(ends[:, 0])
        if not self.rotates:
            return SpringState(origin)
        still = jnp.tile(jnp.asarray(IDENTITY, ends.dtype), (len(ends), 1))
        return SpringState(origin, still)

    def state_at_activation(self, state: SpringState, ends: Ends, motion: Motion) -> SpringState:
        """Return the state of a spring added here: unstressed where its node is."""
        rotation = motion[0, 3:] if self.rotates else None
        return copy_with(state, origin=motion[0, :3], origin_rotation=rotation)

    def energy(self, state: SpringState, ends: Ends, motion: Motion) -> Scalar:
        """Return the stored energy of one spring, J; of a preload less its work."""
        moved = self._to_local_axes(self._displacement_from_origin(state, motion))
        energy = 0.5 * jnp.sum(self.stiffness * moved**2)
        if self.preload is not None:
            energy = energy - jnp.sum(self.preload * moved)
        if not self.rotates:
            return energy
        turned = compose(motion[0, 3:], invert(state.origin_rotation))
        angles = self._to_local_axes(stereographic_to_rotation_vector(to_stereographic(turned)))
        return energy + 0.5 * jnp.sum(self.rotational_stiffness * angles**2)

    def rounding_error(self, state: SpringState, ends: Ends, motion: Motion) -> Forces:
        """Return an estimate of the rounding error of the end forces, [1, 3] or [1, 6], N, N m."""
        rounding = 8 * jnp.finfo(motion.dtype).eps
        force = jnp.full(3, jnp.max(self.stiffness) * jnp.max(jnp.abs(motion[0, :3])))
        if self.rotates:  # quaternions have entries up to 1
            force = jnp.append(force, jnp.full(3, jnp.max(jnp.asarray(self.rotational_stiffness))))
        return (rounding * force)[None]

    def end_forces(self, state: SpringState, ends: Ends, motion: Motion) -> Forces:
        """Return the internal force at the node of one spring, [1, 3] or [1, 6], N and N m."""
        if self.rotates:
            return self.end_forces_after_step(state, ends, motion, jnp.zeros_like(motion[:, :6]))
        moved = self._to_local_axes(self._displacement_from_origin(state, motion))
        force = self.stiffness * moved
        if self.preload is not None:
            force = force - self.preload
        return (force if self.axes is None else force @ self.axes)[None]

    def end_forces_after_step(
        self, state: SpringState, ends: Ends, motion: Motion, step: Forces
    ) -> Forces:
        """Return end forces after a `step` from a motion: the derivative of the energy by it."""
        if not self.rotates:
            return super().end_forces_after_step(state, ends, motion, step)
        return jax.grad(
            lambda step: self.energy(state, ends, jax.vmap(move_node_by_series)(motion, step))
        )(step)

    def spring_moment(self, state: SpringState, ends: Ends, motion: Motion) -> Float[Array, " 3"]:
        """Return the moment of the ground on the node of one spring about x, y, z, [3], N m."""
        return -self.end_forces(state, ends, motion)[0, 3:]

    def _to_local_axes(self, vector):
        """Return the components of a vector [3] along the axes of one spring, [3]."""
        return vector if self.axes is None else self.axes @ vector


@pytree(indices=("links",))
class GroundContacts(GroundElement):
    """A group of unilateral contacts of nodes with the ground, such as bearings that can lift off.

    The ground presses a node along `normal` with ``k d``, where d is the depth by which the node
    has come below the surface of the ground, which is plane; it does not hold it along the surface
    (no friction). A contact closes after its node has moved by `gap` towards the ground. At exactly
    ``d = 0`` the tangent is that of the closed contact. Reports count open contacts among the slack
    elements. (Unlike one of `Contacts`, it keeps its direction, and so its energy is convex.)

    Args:
        links: node numbers, [n_elem] or [n_elem, 1].
        stiffness: spring constant k, scalar or [n_elem], N/m; for rigid ground some hundred times
            the stiffness of the structure.
        normal: direction in which the ground presses the structure, [3] or [n_elem, 3], without
            unit, of any length but zero; default upwards.
        gap: distance from the node to the ground at the start, scalar or [n_elem], m; default
            zero. Negative: the ground has been pressed in by so much. Of a bearing that a phase
            adds it is measured from where its node is then.

    Raises:
        ValueError: wrong shapes, stiffness that is not positive, a normal of no length.

    Example:
        A beam of 3 m on two bearings, 2 m apart, lifts off the first one under 300 N at its free
        end, unless 150 N or more hold it down there; here 200 N, by statics:

        >>> nodes = [[0.0, 0.0, 0.0], [2.0, 0.0, 0.0], [3.0, 0.0, 0.0]]
        >>> section = jc.Section.rectangle(0.1, 0.2, jc.Elastic(10e9), (4, 4))
        >>> elements = {"beam": jc.Beams([[0, 1], [1, 2]], section=section),
        ...             "ground": jc.GroundContacts([0, 1], 1e9)}
        >>> held = jc.restrained([0, 1], "xy", about="x")
        >>> structure = jc.Structure(nodes, elements, held)
        >>> loads = jc.NodalLoads([0, 2], [(0.0, 0.0, -200.0), (0.0, 0.0, -300.0)])
        >>> solution = jc.solve(structure, jc.Phase(loads=loads))
        >>> print(solution.status, jnp.round(solution.tension["ground"], 2))
        0 [ -50. -450.]
    """

    links: Int[ArrayLike, " n_elem"] | Int[ArrayLike, "n_elem 1"]
    stiffness: Float[ArrayLike, " n_elem"]
    normal: Float[ArrayLike, " 3"] | Float[ArrayLike, "n_elem 3"] = (0.0, 0.0, 1.0)
    gap: Float[ArrayLike, " n_elem"] = 0.0

    results: ClassVar[tuple[Result, ...]] = (TENSION, SPRING_FORCE, OPENING)
    per_element = ("stiffness", "normal", "gap")
    compression_only = True
    monotone = True

    def __post_init__(self):
        links = one_node_links(self.links)
        set_fields(self, links=links)
        for name in ("stiffness", "gap"):
            value = checks.floats_per_element(getattr(self, name), len(links), name)
            set_fields(self, **{name: value})
        set_fields(self, normal=vectors_per_element(self.normal, len(links), "normal"))
        refuse_if_broken(self.rules())

    def rules(self) -> list[Rule]:
        """Return the rules that stiffness is positive, and the normal is not zero, a list."""

        def has_no_length(normal):
            return (normal == 0).all(axis=-1)

        text = "a bearing needs a direction in which it presses; must not be zero"
        return [
            positive("stiffness", self.stiffness),
            Rule("normal", self.normal, has_no_length, text),
        ]

    def start(self, ends: Float[Array, "n_elem 1 3"]) -> SpringState:
        """Return the state before the first phase: the ground is `gap` away from the nodes."""
        gap = jnp.broadcast_to(jnp.asarray(self.gap, ends.dtype), ends.shape[:1])
        return SpringState(jnp.zeros_like(ends[:, 0]), gap=gap)

    def state_at_activation(self, state: SpringState, ends: Ends, motion: Motion) -> SpringState:
        """Return the state of a bearing added here: the ground is `gap` away from its node."""
        return copy_with(state, origin=motion[0, :3], gap=self.gap)

    def unstressed_state(
        self, ends: Float[Array, "n_elem 1 3"], slack: Bool[Array, " n_elem"]
    ) -> SpringState:
        """Return a state without stress: the nodes touch the ground, those `slack` are 1 m off."""
        state = self.start(ends)
        return copy_with(state, gap=jnp.where(slack, jnp.ones_like(state.gap), 0.0))

    def opening(self, state: SpringState, ends: Ends, motion: Motion) -> Scalar:
        """Return the distance of the node of one bearing above the ground, m.

        Where the ground is compressed it is negative.
        """
        return self._unit_normal() @ self._displacement_from_origin(state, motion) + state.gap

    def tension(self, state: SpringState, ends: Ends, motion: Motion) -> Scalar:
        """Return the axial force of one bearing, N: minus its pressure, zero where it is open."""
        opening = self.opening(state, ends, motion)
        return jnp.where(opening > 0, 0.0, self.stiffness * opening)

    def rounding_error(self, state: SpringState, ends: Ends, motion: Motion) -> Forces:
        """Return an estimate of the absolute error of the end forces, [1, 3], N, from rounding."""
        moved = jnp.max(jnp.abs(motion[0, :3])) + jnp.abs(state.gap)
        size = 8 * jnp.finfo(motion.dtype).eps * self.stiffness * moved
        force = jnp.where(self.is_slack(state, ends, motion), 0.0, size)
        return (force * jnp.abs(self._unit_normal()))[None]

    def end_forces(self, state: SpringState, ends: Ends, motion: Motion) -> Forces:
        """Return the internal force at the node of one bearing, [1, 3], N."""
        return (self.tension(state, ends, motion) * self._unit_normal())[None]

    def energy(self, state: SpringState, ends: Ends, motion: Motion) -> Scalar:
        """Return the stored energy of one bearing, J."""
        opening = self.opening(state, ends, motion)
        return jnp.where(opening > 0, 0.0, 0.5 * self.stiffness * opening**2)

    def is_slack(self, state: SpringState, ends: Ends, motion: Motion) -> Bool[Array, ""]:
        """Return whether one bearing is open: its node is off the ground."""
        return self.opening(state, ends, motion) > 0

    def at_kink(self, state: SpringState, ends: Ends, motion: Motion) -> Bool[Array, ""]:
        """Return whether the node of one bearing just touches the ground, up to rounding."""
        opening = self.opening(state, ends, motion)
        return jnp.abs(opening) <= 4 * jnp.finfo(opening.dtype).eps * jnp.abs(state.gap)

    def _unit_normal(self):
        """Return the normal of one bearing with length 1, [3]."""
        return self.normal / jnp.sqrt(jnp.sum(self.normal**2))


def one_node_links(links: Int[ArrayLike, "n_elem 1"]) -> Indices:
    """Return node numbers, [n] or [n, 1], as `Indices` [n, 1]; ValueError without any."""
    if isinstance(links, Indices):
        return links
    if np.ndim(links) == 2:
        array = checks.as_indices(links, "links", width=1)
    else:
        array = checks.as_indices(links, "links")[:, None]
    if not len(array):
        raise ValueError("links: a group needs at least one element")
    return Indices(array)


def vectors_per_element(
    value: Float[ArrayLike, "n_elem 3"] | None, n_elem: int, name: str, scalar: bool = False
) -> Float[ArrayLike, "n_elem 3"] | None:
    """Return three floats per element, [n_elem, 3]; None stays None.

    One vector [3] is that of all elements, a number, if a `scalar` is allowed, all components.
    ValueError, which names the argument `name`, if `value` has another shape.
    """
    if value is None:
        return None
    shapes = *([()] if scalar else []), (3,), (n_elem, 3)
    array = checks.floats_of_shape(value, name, *shapes)
    return _broadcast_per_element(array, (n_elem, 3))


def _broadcast_per_element(array, shape):
    """Broadcast an array to a shape with a value for every element: NumPy stays NumPy."""
    if isinstance(array, jax.Array):
        return jnp.broadcast_to(array, shape)
    return np.array(np.broadcast_to(array, shape))


def _are_not_at_right_angles(axes):
    """Return for axes [n_elem, 3, 3] whether rows are no unit vectors at right angles, [n_elem]."""
    products = (axes[:, :, None, :] * axes[:, None, :, :]).sum(axis=-1)
    return (abs(products - np.eye(3)[None]) > _RIGHT_ANGLES).any(axis=(1, 2))
