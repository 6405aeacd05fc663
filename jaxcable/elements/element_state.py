"""State of a group of elements, which phases change, and the load along it."""

from __future__ import annotations

from typing import Any, Self, TypeAlias

import jax
import jax.numpy as jnp

from ..common.tree import copy_with, pytree
from ..common.types import Array, Bool, Float, PyTree

Pressures: TypeAlias = 'dict[str, list[tuple[Float[Array, " n_elem"], Float[Array, "n_elem 3"]]]]'
"""Pressures on beams per "current" or "unstressed" length: lists of pairs (pressure, unit axis)."""
OwnState: TypeAlias = Any
"""The `ElementState` that belongs to a class of elements. Type checkers see it as Any: otherwise a
method that takes only this state could not override one that takes every state."""
TotalLoads: TypeAlias = (
    "tuple[PyTree[Array] | None, dict[str, list[Float[Array, ' n_elem']]] | None]"
)
"""Loads of an `ElementLoad` that do not depend on the unstressed length: dead load on the whole
element, [n_elem, 3], N, or a pair of it and of the concentrated loads, [n_elem, k, 3 or 6], N and
N m; and pressures by "current" or "unstressed" length, N/m."""


@pytree
class ElementLoad:
    """Loads along the elements of a group at one load factor; leading axis [n_elem].

    Attributes:
        line: dead load per unstressed length, [n_elem, 3], N/m, or None.
        pressures: pressures that follow beams, or None: under the key "current" or "unstressed", by
            the length that they are per, a list of pairs (pressure [n_elem], N/m; unit axis
            [n_elem, 3]). A pressure acts along the cross product of its axis and the chord.
        points: concentrated loads, [n_elem, k, 4 or 7], or None: the place from 0 to 1, the force,
            N, and the moment, N m, of each.
    """

    line: Float[Array, "n_elem 3"] | None = None
    pressures: Pressures | None = None
    points: Float[Array, "n_elem k 4or7"] | None = None

    def total_loads(self, rest_length: Float[Array, " n_elem"]) -> TotalLoads:
        """Return the loads that stay the same where the unstressed length [n_elem], m, changes.

        These are the dead loads on whole elements, N, and the pressures, N/m (`TotalLoads`).
        """
        line, pressures = self.line, self.pressures
        if line is not None:
            line = line * rest_length[:, None]
        dead = line if self.points is None else (line, self.points[..., 1:])
        if pressures is None:
            return dead, None
        return dead, {per: [p for p, _ in pairs] for per, pairs in pressures.items()}

    def with_total_loads(
        self, amounts: TotalLoads, rest_length: Float[Array, " n_elem"]
    ) -> ElementLoad:
        """Return these loads with other amounts, at the same places and along the same axes.

        Args:
            amounts: dead loads on whole elements, N, and pressures, N/m, as `total_loads` has them.
            rest_length: unstressed lengths over which dead loads are distributed, [n_elem], m.
        """
        line, pressures = amounts
        points = self.points
        if points is not None:
            line, values = line  # type: ignore[misc]  # a pair
            points = jnp.concatenate([points[..., :1], values], axis=-1)
        if line is not None:
            line = line / rest_length[:, None]
        if pressures is None or self.pressures is None:
            return copy_with(self, line=line, points=points)
        axes = {per: [axis for _, axis in pairs] for per, pairs in self.pressures.items()}
        pairs = {per: list(zip(p, axes[per], strict=True)) for per, p in pressures.items()}
        return copy_with(self, line=line, pressures=pairs, points=points)


class ElementState:
    """State of a group, which phases change: a pytree whose arrays have a leading axis [n_elem].

    A class of states has those of the fields below that its elements use; others are None, and an
    analysis that has to set one raises ValueError (`with_fields`). Elements that phases activate
    need `present`, and the method `state_at_activation` of their group.

    Attributes:
        rest_length: unstressed length, [n_elem], m.
        elongation: initial chord minus unstressed length, [n_elem], m.
        jack_force: axial force that a jack prescribes, [n_elem], N; None outside of jacking.
        jacked: which elements have a jack, [n_elem] bool; None: all, if there is a `jack_force`.
        thermal_stretch: unstressed length over that at the reference temperature, [n_elem].
        memory: history variables, such as plastic strains, a pytree of arrays [n_elem, ...].
        element_load: loads along the elements that shape them, an `ElementLoad`.
        present: which elements are active, [n_elem] bool; None if all are, in all phases.
    """

    rest_length: Float[Array, " n_elem"] | None = None
    elongation: Float[Array, " n_elem"] | None = None
    jack_force: Float[Array, " n_elem"] | None = None
    jacked: Bool[Array, " n_elem"] | None = None
    thermal_stretch: Float[Array, " n_elem"] | None = None
    memory: PyTree[Float[Array, "n_elem ..."]] | None = None
    element_load: ElementLoad | None = None
    present: Bool[Array, " n_elem"] | None = None

    @property
    def load_bearing_length(self) -> Float[Array, " n_elem"]:
        """Length on which weight and loads per unstressed length act, [n_elem], m."""
        if self.rest_length is None:
            raise ValueError(
                f"{type(self).__name__}: has no `rest_length`, which the state of a group with "
                "`has_length` needs"
            )
        return self.rest_length

    def reset_load_bearing_length(self) -> Self:
        """Return the state with `load_bearing_length` set to the present unstressed length.

        It is called at the start of every phase. The default is the state as it is, for elements
        whose `load_bearing_length` is always the unstressed length.
        """
        return self

    @property
    def line_load(self) -> Float[Array, "n_elem 3"] | None:
        """Dead load along the elements per unstressed length, [n_elem, 3], N/m; None if none."""
        return None if self.element_load is None else self.element_load.line

    @property
    def pressures(self) -> Pressures | None:
        """Pressures that follow the elements, by the length that they are per; None if none."""
        return None if self.element_load is None else self.element_load.pressures

    @property
    def point_loads(self) -> Float[Array, "n_elem k 4or7"] | None:
        """Concentrated loads on the elements, as of `ElementLoad.points`; None if none."""
        return None if self.element_load is None else self.element_load.points

    def zero_where_absent(self, values: PyTree[Array]) -> PyTree[Array]:
        """Return a tree of arrays [n_elem, ...] with zero, or False, for inactive elements."""
        present = self.present
        if present is None:
            return values

        def one(x):
            return jnp.where(present.reshape(-1, *(1,) * (x.ndim - 1)), x, jnp.zeros((), x.dtype))

        return jax.tree.map(one, values)


def with_fields(state: OwnState, **changes: Any) -> Any:
    """Return a state with some fields changed; ValueError if its class lacks one of them."""
    for name in changes:
        if name not in getattr(type(state), "_all_fields", ()):
            raise ValueError(
                f"{type(state).__name__}: a state of elements without the field `{name}`, which "
                "this analysis has to set"
            )
    return copy_with(state, **changes)
