"""Cables with friction on saddles that rotate with their nodes, and give them their moments.

`FrictionCables` know the displacements of their nodes only. Where a beam or a spring gives the node
of a saddle rotations, `Structure.motion_rows` replaces them by the group of this module: the saddle
is a rigid part of its node (`cable_path`).
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np

from ..common.checks import array_if_known
from ..common.tree import copy_with, index_array, pytree, set_fields
from ..common.types import ArrayLike, Bool, Float, Int
from ..numerics.rotations import conjugate_moment, move_node_by_series
from .cable_path import CablePath, path_over_saddles, saddle_moments
from .element import Element, Ends, Forces, Motion
from .element_state import OwnState
from .friction_cables import FrictionCables
from .friction_state import FrictionState
from .sliding import forces_of_segments

_PARALLEL = 1e-9  # sine of the angle between axes of rounding


@pytree(indices=("links",), kw_only=True)
class CablesOnRotatingSaddles(FrictionCables):
    """A group of `FrictionCables` with a radius whose saddles rotate with their nodes.

    It is made by `with_rotating_saddles`. The group gives no node rotations.

    Args:
        rotating: 1 where the node of a deviator has rotations, else 0, [n_elem, n_deviator]. A node
            without rotations gets no moment.
    """

    rotating: Float[ArrayLike, "n_elem n_deviator"] = None  # always given

    rotates = True
    gives_rotations = False  # other elements give them
    per_element = (*FrictionCables.per_element, "rotating")  # type: ignore[assignment]  # one more

    def without_friction(self, state: OwnState) -> tuple[CablesOnRotatingSaddles, FrictionState]:
        """Return the cables and their state as they slide without friction, and without clamps."""
        group = copy_with(self, friction=None, axle_friction=None, wobble=None)
        return group, copy_with(state, clamped=jnp.zeros_like(state.clamped))

    def path(self, ends: Ends, motion: Motion) -> CablePath:
        """Return the path of one cable over its nodes, whose saddles have rotated with them."""
        return path_over_saddles(self.radius, self.axis, ends, motion[:, :3], motion[1:-1, 3:])

    def end_forces(self, state: OwnState, ends: Ends, motion: Motion) -> Forces:
        """Return the internal force and moment of one cable at every node, [n_end, 6], N, N m."""
        path = self.path(ends, motion)
        segments, found = self._segments_with_tensions(state, ends, motion)
        tension = jnp.where(segments.length > 0, found.tension, 0.0)
        force = forces_of_segments(tension[:, None] * path.along)
        if state.line_load is not None:
            force = force - self.sliding_load_forces(state, ends, motion)
        radius = jnp.asarray(self.radius) * jnp.asarray(self.rotating)
        moment = saddle_moments(path, radius, *found.deviator_tensions())
        return jnp.concatenate([force, jnp.pad(-moment, ((1, 1), (0, 0)))], axis=1)

    def end_forces_after_step(
        self, state: OwnState, ends: Ends, motion: Motion, step: Forces
    ) -> Forces:
        """Return end forces after a `step` from a motion, work-conjugate to this step."""
        moved = jax.vmap(move_node_by_series)(motion, step)
        forces = self.end_forces(state, ends, moved)
        moments = jax.vmap(conjugate_moment)(step[:, 3:], forces[:, 3:])
        return jnp.concatenate([forces[:, :3], moments], axis=1)

    def sliding_load_forces(self, state: OwnState, ends: Ends, motion: Motion) -> Forces:
        """Return nodal forces of the sliding load of one cable minus its shares, [n_end, 3], N."""
        return super().sliding_load_forces(state, ends, motion[:, :3])

    def rounding_error(self, state: OwnState, ends: Ends, motion: Motion) -> Forces:
        """Return the error of the end forces from rounding, [n_end, 6], N and N m."""
        force = super().rounding_error(state, ends, motion)
        moment = jnp.pad(jnp.asarray(self.radius), 1) * jnp.sum(force, axis=1)
        return jnp.concatenate([force, jnp.repeat(moment[:, None], 3, axis=1)], axis=1)


def with_rotating_saddles(
    groups: Sequence[Element], rotating_nodes: Bool[np.ndarray, " n_node"], dtype: Any
) -> list[Element]:
    """Return groups as they are evaluated in a structure where some nodes rotate, [n_node] bool.

    `FrictionCables` with a radius become `CablesOnRotatingSaddles` if any of their deviators is a
    node that rotates; others stay as they are. `dtype` is that of the nodes.
    """

    def one(group):
        if type(group) is not FrictionCables or group.radius is None:
            return group
        rotating = rotating_nodes[np.asarray(index_array(group.links))[:, 1:-1]]
        if not rotating.any():
            return group
        found = object.__new__(CablesOnRotatingSaddles)
        set_fields(found, **vars(copy_with(group)), rotating=rotating.astype(dtype))
        return found

    return [one(group) for group in groups]


def resists_spin(
    group: Element,
    nodes: Float[np.ndarray, "n_node 3"],
    spinning: Int[ArrayLike, " n"],
    along: Float[np.ndarray, " 3"],
) -> bool:
    """Return whether cables on saddles, while taut, resist a rotation of nodes about a direction.

    If the axis of a saddle is parallel to the direction, only friction does: it drags the cable
    along, and the tensions differ by what has come over. Equal tensions have no moment about the
    axis. About another direction the tangent points leave the plane of the tensions, which pull
    them back: on a mast with the stiffness ``T s x / l`` for a segment of tension T, with tangent
    point and anchor at distances s and x from the axis of the mast, and l apart. A clamp resists,
    too, but only phases know of it.

    Args:
        group: group of any kind; only `FrictionCables` have saddles.
        nodes: initial positions, [n_node, 3], m.
        spinning: numbers of the nodes that rotate about the direction.
        along: unit vector of the direction, [3].
    """
    if not isinstance(group, FrictionCables) or group.radius is None:
        return False
    links = np.asarray(index_array(group.links))
    at = np.isin(links[:, 1:-1], spinning) & (links[:, 1:-1] != links[:, 2:])  # no fillers

    def is_positive(value):
        known = np.zeros(1) if value is None else array_if_known(value)
        known = np.ones(1) if known is None else known  # traced: it may have any value
        return np.broadcast_to(known.reshape(len(known), -1) > 0, at.shape)

    rough = [is_positive(x) for x in (group.friction, group.axle_friction, group.wobble)]
    axis = array_if_known(group.axis)
    if axis is None:
        start = nodes[links[:, 1:]] - nodes[links[:, :-1]]
        axis = np.cross(start[:, :-1], start[:, 1:])
    off = np.linalg.norm(np.cross(axis, along), axis=-1) > _PARALLEL * np.linalg.norm(axis, axis=-1)
    return bool((at & is_positive(group.radius) & np.any([off, *rough], axis=0)).any())
