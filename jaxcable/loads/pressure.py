"""Follower pressure: on cables and beams, and on faces of nets and surfaces.

The forces depend on the positions of the nodes, so that their derivative belongs to the tangent; it
is found by automatic differentiation. The assembled derivative is symmetric where the loads derive
from a potential: if all nodes at the border are held, and the pressure is uniform and per current
size.
"""

from __future__ import annotations

import abc
from typing import Literal

import jax
import jax.numpy as jnp

from ..common import checks
from ..common.rules import Rule, refuse_if_broken
from ..common.selection import Selection
from ..common.tree import Indices, pytree, set_fields
from ..common.types import Array, ArrayLike, Float, Int
from ..elements.element import Element
from ..model.result_parts import group_path
from ..model.structure import Structure
from .faces import OnFaces, area_vectors
from .groups import Key, OnGroups
from .load import Blocks, FollowerLoad, Groups, Positions, States

PRESSURE_REFERENCES = ("current", "unstressed")


class Pressure(FollowerLoad):
    """Base of follower pressure on elements or faces, here called patches."""

    scales = ("pressure",)

    @abc.abstractmethod
    def _loaded_patches(self, groups, states, moved):
        """Iterate over loaded groups, or the given faces, as arrays of n patches with k corners.

        `states` are those of all groups, `moved` current positions of all nodes, [n_row,
        3], m.

        Yields:
            Current positions of corners, [n, k, 3], m; numbers of each patch that `_force_on_patch`
            needs, such as its pressure; node numbers of corners, [n, k].
        """

    @abc.abstractmethod
    def _force_on_patch(self, corners, numbers):
        """Return the forces on the corners of one patch, [k, 3], N.

        `corners` are their current positions, [k, 3], m, `numbers` those of
        `_loaded_patches`.
        """

    def following_forces(
        self, groups: Groups, states: States, nodes: Positions, moved: Positions
    ) -> Positions:
        """Return the force on every node, [n_row, 3], N, with nodes at `moved` [n_row, 3], m."""
        total = jnp.zeros_like(moved)
        for corners, numbers, links in self._loaded_patches(groups, states, moved):
            total = total.at[links].add(jax.vmap(self._force_on_patch)(corners, numbers))
        return total

    def following_blocks(
        self, groups: Groups, states: States, nodes: Positions, moved: Positions
    ) -> Blocks:
        """Return derivatives of the forces by current positions `moved`, [n_row, 3].

        The list has pairs (blocks [n, k, 3, k, 3], N/m, nodes [n, k]) for n patches with k corners.
        """
        return [
            (jax.vmap(jax.jacfwd(self._force_on_patch))(corners, numbers), links)
            for corners, numbers, links in self._loaded_patches(groups, states, moved)
        ]


@pytree(static=("on", "per"))
class CablePressure(OnGroups, Pressure):
    """Follower pressure on cables, bars and beams, across them and across an axis.

    For a cable with chord ``d``, ``axis x d`` is the area vector of a strip of width 1 that the
    axis spans along the cable. A cable in a plane normal to the axis is pressed at right angles to
    itself, and its equilibrium under pressure alone is a circle. Half of an element's force goes to
    each end. On beams the pressure also works on the deflection, as with `LineLoads`: it bends them
    between their nodes. Per current length, the force on a chord equals that on any arc between the
    same ends, and so does its moment; the positions of the nodes of a bent beam therefore converge
    at the fourth order in the length of its elements. Like all loads of elements it goes on acting,
    and following, in later phases.

    Args:
        pressure: force per length, N/m, scalar, or [n_elem] for the one group that `on` names.
            Positive along ``axis x d``.
        axis: direction, [3], of any length, without unit.
        on: key of the loaded group in the structure's elements, such as "guys", or its place from 0
            where these are a list; None loads all groups. Only groups of cables, bars or beams can
            be loaded.
        per: "current" length (as seen along the axis), or "unstressed": the force then keeps its
            magnitude and only turns with the element, which has no potential.

    Raises:
        ValueError: wrong shapes, a zero axis, an unknown `per`; where a phase is analysed, a group
            that cannot be pressed.

    Example:
        150 N/m on two chords of 5 m, 4 m in plan: 600 N at the node, balanced by 500 N in each:

        >>> nodes = [[-4.0, 0.0, 3.0], [0.0, 0.0, 0.0], [4.0, 0.0, 3.0]]
        >>> cables = jc.Cables([[0, 1], [1, 2]], axial_stiffness=1e5)
        >>> structure = jc.Structure(nodes, cables, supports=jc.pinned([0, 2]))
        >>> pressure = jc.CablePressure(150.0, axis=(0.0, 1.0, 0.0))
        >>> solution = jc.solve(structure, jc.Phase(pretension=500.0, loads=pressure))
        >>> print(solution.status, jnp.round(solution.tension, 6), f"{solution.load[1, 2]:.3f}")
        0 [500. 500.] -600.000
    """

    pressure: Float[ArrayLike, ""] | Float[ArrayLike, " n_elem"]
    axis: Float[ArrayLike, " 3"]
    on: Key = None
    per: Literal["current", "unstressed"] = "current"
    element_factors: dict[int, Float[Array, " n_elem"]] | None = (
        None  # by index of group: factor of the pressure on each element; set by the analysis
    )

    varies = ("pressure", ())

    def __post_init__(self):
        set_fields(self, axis=checks.floats_of_shape(self.axis, "axis", (3,)))
        refuse_if_broken(self.rules())
        self._check_value_shape()
        checks.require_one_of(self.per, "per", PRESSURE_REFERENCES)

    def rules(self) -> list[Rule]:
        """Return the rule that the axis is not zero, a list of one `Rule`."""
        text = "is zero; give the normal of the plane in which the cable bends"
        return [Rule("axis", self.axis, lambda v: (v == 0).all(), text)]

    def check(self, structure: Structure) -> None:
        """Raise ValueError if the structure lacks the loaded group, or it takes no pressure."""
        numbers, _ = self.loaded_groups(structure)
        for number in numbers:
            group = structure.groups[number]
            if group.links.shape[1] != 2 or (group.shaped_by_load and not group.rotates):
                raise ValueError(
                    f"on = {self.on!r}: {group_path(structure, number)} "
                    f"({type(group).__name__}) takes no pressure; only cables and bars of two "
                    "nodes, and beams do: name such a group by on"
                )
            if self.per == "unstressed" and not group.has_length:
                raise ValueError(
                    f'per = "unstressed": {group_path(structure, number)} '
                    f'({type(group).__name__}) has no unstressed length; give per="current"'
                )
        self._check_value_counts(structure, numbers)

    def coupled_nodes(self, groups: Groups) -> list[Indices]:
        """Return both ends of loaded elements, whose forces are coupled, [n_elem, 2] per group."""
        return [Indices(groups[number].links.array[:, :2]) for number in self.on]

    def bending_pressure(
        self, number: int, group: Element
    ) -> tuple[str, Float[Array, " n_elem"], Float[Array, "n_elem 3"]] | None:
        """Return (`per`, pressure [n_elem], N/m, axes [n_elem, 3]) that bend a group, or None.

        None: the load does not act on the group, or its elements cannot bend.
        """
        if number not in self.on or not group.rotates:
            return None
        count = len(group.links)
        axis = self.axis / _norm_or_one(self.axis)
        pressure = self.apply_element_factors(number, jnp.broadcast_to(self.pressure, (count,)))
        return self.per, pressure, jnp.broadcast_to(axis, (count, 3))

    def _loaded_patches(self, groups, states, moved):
        """Iterate over groups: ends [n, 2, 3], (pressure, unstressed length) [n], nodes [n, 2]."""
        for number in self.on:
            group, state = groups[number], states[number]
            pressure = jnp.broadcast_to(self.pressure, (len(group.links),)).astype(moved.dtype)
            pressure = self.apply_element_factors(number, pressure, state)
            links = group.links[:, :2]  # without the inner numbers of beams
            yield moved[links], (pressure, state.rest_length), links

    def _force_on_patch(self, corners, numbers):
        """Return the forces of a pressure at both ends of one chord, [2, 3], N.

        `corners` are its ends, [2, 3], m, `numbers` pressure, N/m, and unstressed length,
        m.
        """
        pressure, rest_length = numbers
        axis = self.axis.astype(corners.dtype)
        axis = axis / _norm_or_one(axis)
        across = jnp.cross(axis, corners[1] - corners[0])
        if self.per == "unstressed":
            across = rest_length * across / _norm_or_one(across)
        half = 0.5 * pressure * across
        return jnp.stack([half, half])


@pytree(static=("on",), indices=("faces",))
class FacePressure(OnFaces, Pressure):
    """Follower pressure on faces: along their normals, times their current areas.

    A third of the force on each triangle acts at each of its corners. Positive pressure acts along
    the normal about which the nodes of a face are in anticlockwise order (`net_faces`: upwards).
    On a group it presses on elements whenever they are there (`Phase`), on `faces` always.

    Args:
        faces: node numbers, [n_face, 3] or [n_face, 4], as in `AreaLoads`; None for the faces of
            groups whose elements have some.
        pressure: pressure, N/m2, scalar or [n_face]; positive along the normal about which the
            nodes of a face are in anticlockwise order. Of a group [n_elem], one for each of its
            elements.
        on: key of the group whose faces are pressed, such as "membrane", or its place from 0 where
            these are a list; None presses on `faces`, or without them on all groups that have
            faces.
        elements: `Selection` of the elements of that group that are pressed; None means all.

    Raises:
        ValueError: wrong shapes, a face with fewer than three nodes, both `faces` and a group;
            where a phase is analysed, a node, group or element that the structure does not have,
            or a group without faces.

    Example:
        Snow, and wind uplift, on a net with a level border that spans 1.12 m2 in plan:

        >>> structure, _ = jc.scenes.flat_net()
        >>> faces = jc.net_faces(structure.nodes, structure.elements.links, border="ends")
        >>> snow, wind = jc.AreaLoads(faces, (0.0, 0.0, -1000.0)), jc.FacePressure(faces, 400.0)
        >>> solution = jc.solve(structure, jc.Phase(pretension=200.0, loads=[snow, wind]))
        >>> print(f"{jc.describe(solution.status)}: {solution.load[:, 2].sum():.3f} N")
        converged: -672.000 N
    """

    faces: Int[ArrayLike, "n_face 3or4"] | None = None
    pressure: Float[ArrayLike, ""] | Float[ArrayLike, " n_face"] = None
    on: Key = None
    elements: Selection | None = None
    element_factors: dict[int, Float[Array, " n_elem"]] | None = (
        None  # by index of group: factor of the pressure on each element; set by the analysis
    )

    varies = ("pressure", ())

    def __post_init__(self):
        self._check_faces()

    def _loaded_patches(self, groups, states, moved):
        """Iterate over faces: current corners [n, k, 3], m, pressure [n], N/m2, nodes [n, k]."""
        for faces, pressure in self._faces_and_values(groups, states, moved.dtype):
            yield moved[faces], pressure, faces

    def _force_on_patch(self, corners, numbers):
        """Return the forces of a pressure at the corners of one face, [k, 3], N.

        `corners` are their positions, [k, 3], m, `numbers` is the pressure, N/m2.
        """
        force, pressure = jnp.zeros_like(corners), numbers
        for triangle, vector in area_vectors(corners):
            force = force.at[jnp.array(triangle)].add(pressure * vector / 3)
        return force


def _norm_or_one(vector):
    """Return the length of a vector; 1 for the zero vector, which has no direction."""
    square = vector @ vector
    return jnp.sqrt(jnp.where(square > 0, square, 1.0))
