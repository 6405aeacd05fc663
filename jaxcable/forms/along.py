"""Loads that depend on the form that is sought: self-weight, line and area loads.

They are the loads of an analysis that begins with the form found. There the unstressed length is
``l / (1 + e)``, with the strain e that belongs to the force by the group's law, and initial or
projected lengths and areas are those of the form. While the form is sought the loads follow the
nodes, with exact derivatives.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import jax
import jax.numpy as jnp

from ..common.tree import Indices, copy, pytree
from ..common.types import Array, Bool, Float, Int
from ..elements.bar import Straight
from ..elements.element import Element
from ..elements.element_state import ElementState
from ..elements.prestress import AxialState, element
from ..loads import AreaLoads, LineLoads, Load, NodalLoads, SelfWeight, as_list
from ..model.structure import Structure


def split(
    structure: Structure, loads: Load | Sequence[Load] | None, takes_more: bool = True
) -> tuple[list[NodalLoads], list[SelfWeight | LineLoads | AreaLoads]]:
    """Loads as two checked lists: `NodalLoads`, and loads that depend on the form.

    Raises:
        ValueError: a load of another kind; with `takes_more` false any load but `NodalLoads`.
    """
    given: list[Any] = as_list(loads)  # their kinds are checked below
    nodal, others = [], []
    for k, load in enumerate(given):
        more = takes_more and isinstance(load, SelfWeight | LineLoads | AreaLoads)
        if not more and not isinstance(load, NodalLoads):
            kinds = (
                "NodalLoads, SelfWeight, LineLoads and AreaLoads" if takes_more else "NodalLoads"
            )
            raise ValueError(
                f"loads[{k}]: {type(load).__name__} is not known before the form is: it depends on "
                f"unstressed lengths, follows, varies or moves supports; this takes {kinds}"
            )
        load.check(structure)
        if not more:
            nodal.append(load)
            continue
        if load.asks_begun:  # the phase begins in the form: its geometry is the input geometry
            load = copy(load, geometry="input")
        others.append(load.among(structure))
    return nodal, others


def touched(
    structure: Structure, others: Sequence[Load]
) -> tuple[tuple[Indices, int, tuple[()]], ...]:
    """Triples (nodes that a load couples, 3, ()) for `number_freedoms`, ordered as in `OnForm`."""
    nodes = []
    for load in others:
        if isinstance(load, AreaLoads):
            nodes.append(load.faces)
        else:
            nodes += [group.links for _, group in _loaded(load, structure.groups)]
    return tuple((ends if isinstance(ends, Indices) else Indices(ends), 3, ()) for ends in nodes)


def _loaded(load, groups):
    """Pairs (number, group) of the groups that a load along elements acts on."""
    for number, group in enumerate(groups):
        weightless = isinstance(load, SelfWeight) and group.weight is None
        if not weightless and number in load.on:
            yield number, group


@pytree
class OnForm:
    """Loads that depend on the form, on members with given forces, as a following load.

    Attributes:
        groups: element groups of the structure, with links as arrays.
        loads: `SelfWeight`, `LineLoads` and `AreaLoads`, as `split` returns them.
    """

    groups: list[Element]
    loads: list[SelfWeight | LineLoads | AreaLoads]

    def _parts(self, states, moved):
        """Generate (function, its arguments of every element or face, their nodes [n, k]).

        States are those of `strings.Strings`.
        """
        for load in self.loads:
            if isinstance(load, AreaLoads):
                forces = jnp.broadcast_to(load.forces, (len(load.faces), 3))
                yield _on_face(load), (forces,), load.faces
                continue
            for number, group in _loaded(load, self.groups):
                part = None if load.part is None else load.part[number]
                arguments = group.properties(), group.initial_memory(), states[number], part
                yield _on_element(load, number, group), arguments, group.links

    @property
    def acts(self) -> Bool[Array, ""]:
        """Whether the load acts: always."""
        return jnp.ones((), bool)

    def following_forces(
        self,
        groups: Sequence[Element] | None,
        states: Sequence[ElementState],
        nodes: Float[Array, "n_node 3"] | None,
        moved: Float[Array, "n_node 3"],
    ) -> Float[Array, "n_node 3"]:
        """Force on every node, [n_node, 3], N, at the positions `moved` [n_node, 3]."""
        total = jnp.zeros_like(moved)
        for function, arguments, links in self._parts(states, moved):
            total = total.at[links].add(jax.vmap(function)(moved[links], *arguments))
        return total

    def following_blocks(
        self,
        groups: Sequence[Element] | None,
        states: Sequence[ElementState],
        nodes: Float[Array, "n_node 3"] | None,
        moved: Float[Array, "n_node 3"],
    ) -> list[tuple[Float[Array, "n k 3 k 3"], Int[Array, "n k"]]]:
        """Derivative of the forces: list of (blocks [n, k, 3, k, 3], nodes [n, k])."""
        return [
            (jax.vmap(jax.jacfwd(function))(moved[links], *arguments), links)
            for function, arguments, links in self._parts(states, moved)
        ]


def _on_face(load):
    """The function from corners of a face and force per area to forces on the corners, [k, 3]."""

    def force(corners, forces):
        alone = copy(load, faces=jnp.arange(len(corners))[None], forces=forces)
        return alone.element_forces([], [], corners, corners.shape, corners.dtype)

    return force


def _on_element(load, number, group):
    """The function from ends and properties of an element to the force on both ends, [2, 3]."""

    def force(ends, properties, memory, string, part):
        vector = ends[1] - ends[0]
        length = jnp.sqrt(vector @ vector)
        # prescribed force, or force density times length (a spring of length 0)
        axial = string.force + string.stiffness * length
        strain = element(group, properties).strain_at(axial, memory)
        # a force beyond the law ends in a status of the form; until then avoid NaN
        strain = jnp.where(jnp.isfinite(strain) & (strain > -1), strain, 0.0)
        rest_length = (length / (1 + strain))[None]
        alone = copy(
            group, links=jnp.arange(2)[None], **{k: v[None] for k, v in properties.items()}
        )
        state = AxialState(rest_length, length[None] - rest_length)
        acting = load if part is None else copy(load, part={number: part[None]})
        whole = rest_length * acting.per_length(number, alone, state, ends)[0]
        return jnp.stack([0.5 * whole, 0.5 * whole])

    return force


def carries(
    groups: Sequence[Straight], tensions: Sequence[Float[Array, " n_elem"]]
) -> Bool[Array, ""]:
    """Whether the law of every element has an unstressed length for its force, bool."""
    carried = jnp.ones((), bool)
    for group, tension in zip(groups, tensions, strict=True):
        low, high = group.capacity()
        strain = group.strain_at(tension, group.initial_memory())
        carried = carried & jnp.all((tension >= low) & (tension <= high) & (strain > -1))
    return carried
