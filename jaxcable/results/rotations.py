"""Rotations of nodes and elements as rotation vectors, and as tilt and twist."""

from __future__ import annotations

import functools
from typing import Any

import jax
import jax.numpy as jnp

from ..analysis.element_shapes import StateOrPhase, results_of_state
from ..analysis.results import StateResults
from ..common import checks
from ..common.rules import Rule, nan_if_broken
from ..common.tree import pytree
from ..common.types import Array, ArrayLike, Float
from ..model.result_parts import items_per_group
from ..model.structure import Structure
from ..numerics import rotations
from ..numerics.vectors import scalar_product
from ..programs.program_calls import as_program


@pytree
class Tilt:
    """Rotation of an axis as tilt and twist: the result of `node_tilts` and `element_tilts`.

    Attributes:
        tilt: angle between the axis and its initial direction, rad, from 0 to pi.
        twist: angle about the axis, rad, from -pi to pi, right-handed: what is left of the rotation
            after the shortest rotation that takes the initial axis to the present one. Of an
            element at both ends, [..., 2]; None if its nodes have no rotations.

    Example:
        A bar of 5 m whose end moves aside by 3 m and down by 1 m:

        >>> structure = jc.Structure(
        ...     [[0.0, 0.0, 0.0], [0.0, 0.0, 5.0]], jc.Bars([[0, 1]], axial_stiffness=1e6),
        ...     supports=jc.pinned([0, 1]),
        ... )
        >>> moved = jc.Phase(loads=jc.SupportMovement([1], (3.0, 0.0, -1.0)))
        >>> solution = jc.solve(structure, moved)
        >>> found = jc.results.element_tilts(structure, solution)
        >>> print(solution.status, jnp.degrees(found.tilt).round(6))  # atan(3 / 4)
        0 [36.869898]
    """

    tilt: Float[Array, " n"]
    twist: Float[Array, " n"] | Float[Array, "n 2"] | None


def rotation_vectors(structure: Structure, state: StateOrPhase) -> Float[Array, "n_node 3"]:
    """Return the rotations of all nodes against the initial geometry, as rotation vectors.

    A vector has the axis of the rotation as its direction and the angle, from 0 to pi, as its
    length. Vectors of large rotations cannot be added; at half a turn the direction jumps.

    Args:
        structure: the `Structure` that was analysed, with beams.
        state: `Solution` (NaN if it has failed) or `State`, or one of
            ``solution.phases`` for the end of that phase; batches have leading axes.

    Returns:
        [n_node, 3], rad; zero for nodes without beams.

    Raises:
        ValueError: not a state, or a structure without beams.

    Example:
        A cantilever of 2 m under an end moment bends by ``M L / EI``:

        >>> section = jc.Section.rectangle(0.1, 0.2, jc.Elastic(10e9))  # EI = 666667 N m2
        >>> beam = jc.Beams([[0, 1]], section=section)
        >>> nodes = [[0.0, 0.0, 0.0], [2.0, 0.0, 0.0]]
        >>> structure = jc.Structure(nodes, beam, supports=jc.clamped([0]))
        >>> moment = jc.NodalLoads([1], (0.0, 0.0, 0.0), moments=(0.0, 1e4, 0.0))
        >>> solution = jc.solve(structure, jc.Phase(loads=moment))
        >>> turned = jc.results.rotation_vectors(structure, solution)
        >>> print(solution.status, f"{turned[1, 1]:.6f}")
        0 0.030000
    """
    return _rotation_vectors(_quaternions(structure, state))


def node_tilts(
    structure: Structure,
    state: StateOrPhase,
    axis: Float[ArrayLike, " 3"] = (0.0, 0.0, 1.0),
) -> Tilt:
    """Return tilt and twist of an axis that rotates with each node.

    Smooth where the tilt is neither zero (a kink, without derivative) nor half a turn, where the
    twist is not defined.

    Args:
        structure: the `Structure` that was analysed, with beams.
        state: as for `rotation_vectors`.
        axis: initial direction of the axis, [3]; its length has no effect. Default z, as of a mast.

    Returns:
        `Tilt` with arrays [n_node], rad.

    Raises:
        ValueError: not a state, a structure without beams, or an axis of length zero.

    Example:
        >>> section = jc.Section.rectangle(0.1, 0.2, jc.Elastic(10e9))
        >>> mast = jc.Beams([[0, 1]], section=section)
        >>> nodes = [[0.0, 0.0, 0.0], [0.0, 0.0, 2.0]]
        >>> structure = jc.Structure(nodes, mast, supports=jc.clamped([0]))
        >>> moment = jc.NodalLoads([1], (0.0, 0.0, 0.0), moments=(0.0, 1e4, 0.0))
        >>> solution = jc.solve(structure, jc.Phase(loads=moment))
        >>> found = jc.results.node_tilts(structure, solution)
        >>> print(solution.status, f"{jnp.degrees(found.tilt[1]):.4f}", found.twist[1].round(6) + 0)
        0 1.7189 0.0
    """
    axis = checks.floats_of_shape(axis, "axis", (3,))
    text = "axis: expected a vector of length above zero"
    axis = nan_if_broken(Rule("axis", axis, lambda v: (v == 0).all(), lambda *_: text))
    return Tilt(*_node_tilts(_quaternions(structure, state), axis))


def element_tilts(structure: Structure, state: StateOrPhase) -> Any:
    """Return tilt and twist of elements: the rotation of their chords, and about them.

    The chord is the straight line between the first and the last node. The twist is that of the
    nodes at both ends, about the chord: their difference is the torsion of a beam, to which its
    bending contributes in the second order.

    Args:
        structure: the `Structure` that was analysed.
        state: as for `rotation_vectors`; the structure need not have beams.

    Returns:
        `Tilt` in the shape of `elements`, each with tilt [n_elem], rad, and twist [n_elem, 2], rad;
        no twist for groups that give their nodes no rotations. NaN for elements that are not
        active.

    Raises:
        ValueError: not a state, or of another structure.

    Example:
        >>> structure, phases = jc.scenes.guyed_mast()
        >>> solution = jc.solve(structure, phases)
        >>> found = jc.results.element_tilts(structure, solution)["mast"]
        >>> print(solution.status, found.tilt.shape, found.twist.shape)
        0 (12,) (12, 2)
    """
    known = results_of_state(structure, state)
    present = items_per_group(structure, known.present)
    rotations = [known.rotation if group.rotates else None for group in structure.groups]
    ends = [group.links.array[:, [0, -1]] for group in structure.groups]
    given = structure.nodes, known.positions, list(zip(ends, present, rotations, strict=True))
    return structure.arrange(_element_tilts(*given))


def _quaternions(structure: Structure, state: StateOrPhase) -> Float[Array, "n_node 4"]:
    """Return the rotations of all nodes in a state, unit quaternions, scalar first, [n_node, 4].

    Raises ValueError for a structure without beams.
    """
    results: StateResults = results_of_state(structure, state)
    if results.rotation is None:
        raise ValueError("structure: has no beams; its nodes have no rotations")
    return jnp.asarray(results.rotation)


_rotation_vectors = as_program(rotations.rotation_vectors)


@as_program
def _node_tilts(quaternions, axis):
    """Return tilt and twist, rad, of an axis [3] that rotates by quaternions [..., n_node, 4]."""
    axis = jnp.asarray(axis)
    unit = axis / jnp.sqrt(scalar_product(axis, axis))
    return _map_over_leading_axes(functools.partial(_tilt_and_twist, unit=unit), quaternions)


def _map_over_leading_axes(function, quaternions):
    """Map a function of one quaternion, [4], over all leading axes of an array [..., 4]."""
    for _ in range(quaternions.ndim - 1):
        function = jax.vmap(function)
    return function(quaternions)


def _tilt_and_twist(q, unit):
    """Return tilt and twist of an axis that rotates by the unit quaternion `q`, rad.

    With the twist first and the tilt after it the quaternion is their product:
    ``q0 = cos(tilt/2) cos(twist/2)``, and its part along the axis ``cos(tilt/2) sin(twist/2)``.
    """
    along = scalar_product(q[1:], unit)
    across = q[1:] - along * unit
    size = jnp.sqrt(scalar_product(across, across))
    tilt = 2 * jnp.arctan2(size, jnp.sqrt(q[0] ** 2 + along**2))
    return tilt, _twist(q, along)


def _twist(q, along):
    """Return the twist, from -pi to pi, of a quaternion whose part along the axis is `along`."""
    sign = jnp.where(q[0] < 0, -1.0, 1.0)  # q and -q are one rotation
    return 2 * jnp.arctan2(sign * along, sign * q[0])


@as_program
def _element_tilts(nodes, positions, groups):
    """Return the `Tilt` of every group; a program.

    `groups` has, for each, the nodes at both ends, [n_elem, 2], which elements are present, and the
    rotations of all nodes; the last two may be None.
    """
    found = []
    for ends, there, rotation in groups:
        before = nodes[ends[:, 1]] - nodes[ends[:, 0]]
        after = positions[..., ends[:, 1], :] - positions[..., ends[:, 0], :]
        turned = None if rotation is None else rotation[..., ends, :]
        tilt, twist = _chord_tilts(before, after, turned)
        if there is not None:
            tilt = jnp.where(there > 0, tilt, jnp.nan)
            twist = None if twist is None else jnp.where(there[..., None] > 0, twist, jnp.nan)
        found.append(Tilt(tilt, twist))
    return found


def _chord_tilts(before, after, turned):
    """Return tilt [..., n_elem] and twist [..., n_elem, 2] of elements, rad.

    `before` and `after` are vectors along their chords, `turned` the rotations of both nodes as
    quaternions, [..., n_elem, 2, 4], or None: then the twist is None, too.
    """

    def one(first, second, turned):
        a = first / jnp.sqrt(scalar_product(first, first))
        b = second / jnp.sqrt(scalar_product(second, second))
        apart, both = b - a, b + a
        tilt = 2 * jnp.arctan2(
            jnp.sqrt(scalar_product(apart, apart)), jnp.sqrt(scalar_product(both, both))
        )
        if turned is None:
            return tilt, None
        back = rotations.invert(rotations.shortest_rotation(a, b, apart))

        def about(q):
            left = rotations.compose(back, q)
            return _twist(left, scalar_product(left[1:], a))

        return tilt, jax.vmap(about)(turned)

    function = jax.vmap(one)
    for _ in range(after.ndim - 2):
        function = jax.vmap(function, in_axes=(None, 0, 0))
    return function(before, after, turned)
