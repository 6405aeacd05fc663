"""Events on a path: limit points, bifurcations, slackening, tightening, slip, failure."""

from __future__ import annotations

from collections.abc import Iterator
from typing import ClassVar

import numpy as np

from ..common.tree import pytree
from ..common.types import Array, Bool, Float, Int, PyTree

LIMIT_POINT = 1
BIFURCATION = 2
SLACKENING = 3
TIGHTENING = 4
MATERIAL_FAILURE = 5
SLIP = 6

NAMES = {
    LIMIT_POINT: "limit point",
    BIFURCATION: "bifurcation",
    SLACKENING: "slackening",
    TIGHTENING: "tightening",
    MATERIAL_FAILURE: "material failure",
    SLIP: "slip",
}
"""Kinds of events, in words."""

FAILURES = (LIMIT_POINT, BIFURCATION, MATERIAL_FAILURE)
"""Kinds of events at which a structure under growing dead load fails."""


@pytree
class Events:
    """Events on an equilibrium path (limit points, bifurcations ...), in the order of the path.

    Every array has one entry for each event; ``len(events)`` is their number, ``events[k]`` is the
    event k. The load factors `lower` and `upper` are those of two points, just before and just
    after the event. Along the path these points are within the tolerance of `trace_path`, except at
    smooth bifurcations: there they are some 5e-4 of `step` apart, since nearer points are lost in
    rounding. `load_factor` is then interpolated linearly to zero stiffness; its error is of the
    order of the square of that distance.

    Attributes:
        kind: `LIMIT_POINT`, `BIFURCATION`, `SLACKENING`, `TIGHTENING`, `MATERIAL_FAILURE` or `SLIP`
            of `jc.paths`, [n] int; 0 in places that are not used (under a transformation).
        load_factor: load factor of the event, [n]; differentiable at smooth limit points.
        lower, upper: load factors of the points before and after the event, in this order, [n].
        row: index of the point of the path that follows the event, [n] int.
        displacement: displacements of the nodes at the event, from the initial nodes,
            [n, n_node, 3], m.
        mode: null vector of the tangent at limit points and bifurcations as displacements, the
            largest of a node 1, [n, n_node, 3]; where stiffness jumps below zero (a corner of a
            law) the softest mode; NaN at other events.
        alignment: ``|phi.F| / (|phi| |F|)`` at limit points and bifurcations, with the left null
            vector phi and the load F that the phase adds: zero at a bifurcation, not zero at a
            limit point, [n]; NaN at other events.
        multiplicity: number of eigenvalues of the tangent that change their sign at limit points
            and bifurcations, [n] int: 2 where two modes cross together (within the bracket), as in
            a ring under pressure; -1 where they are not counted (`TracedPath.n_negative`), 0 at
            other events.
        elements: which elements slackened (contacts: opened), tightened (closed), failed, or began
            to slip at a deviator at which they stuck, in the shape of `elements`, each [n, n_elem]
            bool. The result "friction_used" of the path at `row` says at which deviator.

    Example:
        >>> path = jc.trace_path(*jc.scenes.von_mises_truss(rise=0.1, load=500.0))
        >>> print(path.status, path.events.names)
        0 ['limit point', 'limit point']
        >>> print(jnp.round(500 * path.events.load_factor, 6))  # N: down, and up again
        [ 381.08719 -381.08719]
        >>> first = path.events[0]
        >>> print(jnp.round(first.mode[1], 6), f"{first.displacement[1, 2]:.6f} m")
        [0. 0. 1.] -0.042361 m
    """

    _shown: ClassVar[str] = "kind, load_factor, row, multiplicity"

    kind: Int[Array, " n"]
    load_factor: Float[Array, " n"]
    lower: Float[Array, " n"]
    upper: Float[Array, " n"]
    row: Int[Array, " n"]
    displacement: Float[Array, "n n_node 3"]
    mode: Float[Array, "n n_node 3"]
    alignment: Float[Array, " n"]
    multiplicity: Int[Array, " n"]
    elements: PyTree[Bool[Array, "n n_elem"]]

    @property
    def names(self) -> list[str]:
        """The kinds of the events in words, such as "limit point"."""
        return [NAMES.get(int(kind), "none") for kind in np.atleast_1d(np.asarray(self.kind))]

    def __len__(self) -> int:
        return len(self.kind)

    def __getitem__(self, key: int | slice) -> Events:
        import jax

        return jax.tree.map(lambda a: a[key], self)

    def __iter__(self) -> Iterator[Events]:
        return (self[k] for k in range(len(self)))
