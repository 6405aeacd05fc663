"""Loads that depend on the form that is sought: self-weight, line and area loads.

Where they act in an analysis that begins with the form found, they are what they are there: per
unstressed length that which is cut, ``l / (1 + e)`` with the strain e that belongs to the force by
the group's law, per initial or projected length and area the form's own. While the form is sought
they follow the nodes, with exact derivatives.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import jax
import jax.numpy as jnp

from ..common.tree import Indices, copy, pytree
from ..common.types import Array, Bool, Float, Int
from ..elements.bar import Straight
from ..elements.element import Element, ElementState
from ..elements.prestress import AxialState, element
from ..loads import AreaLoads, LineLoads, Load, NodalLoads, SelfWeight, as_list
from ..model.structure import Structure


def split(
    structure: Structure, loads: Load | Sequence[Load] | None, takes_more: bool = True
) -> tuple[list[NodalLoads], list[SelfWeight | LineLoads | AreaLoads]]:
    """Loads as checked lists: `NodalLoads`, and those that depend on the form.

    Raises:
        ValueError: a load of another kind; with `takes_more` false any but a nodal one.
    """
    given: list[Any] = as_list(loads)  # of the kinds that are asked for below
    nodal, others = [], []
    for k, load in enumerate(given):
        more = takes_more and isinstance(load, SelfWeight | LineLoads | AreaLoads)
        if not more and not isinstance(load, NodalLoads):
            kinds = (
                "NodalLoads, SelfWeight, LineLoads and AreaLoads" if takes_more else "NodalLoads"
            )
            raise ValueError(
                f"loads[{k}]: {type(load).__name__} is not known before the form is: it depends on "
                f"unstressed lengths, follows or moves supports; this takes {kinds}"
            )
        load.check(structure)
        if not more:
            nodal.append(load)
            continue
        if load.asks_begun:  # the form is where the analysis begins
            load = copy(load, geometry="input")
        others.append(load.among(structure))
    return nodal, others


def touched(
    structure: Structure, others: Sequence[Load]
) -> tuple[tuple[Indices, int, tuple[()]], ...]:
    """(nodes that a load couples, 3, ()) for `number_freedoms`, as `OnForm` gives its blocks."""
    nodes = []
    for load in others:
        if isinstance(load, AreaLoads):
            nodes.append(load.faces)
        else:
            nodes += [group.links for _, group in _loaded(load, structure.groups)]
    return tuple((own if isinstance(own, Indices) else Indices(own), 3, ()) for own in nodes)


def _loaded(load, groups):
    """Pairs (number, group) of those that a load along elements acts on."""
    for number, group in enumerate(groups):
        weightless = isinstance(load, SelfWeight) and group.weight is None
        if not weightless and number in load.on:
            yield number, group


@pytree
class OnForm:
    """Loads of `split` on members of given forces, as a load that follows (see `loads`).

    Attributes:
        groups: element groups of the structure, their links arrays.
        loads: `SelfWeight`, `LineLoads` and `AreaLoads`.
    """

    groups: list[Element]
    loads: list[SelfWeight | LineLoads | AreaLoads]

    def _parts(self, states, moved):
        """Function, what it takes of each element or face, its nodes [n, k]; one after the other.

        States are those of `strings.Strings`.
        """
        for load in self.loads:
            if isinstance(load, AreaLoads):
                forces = jnp.broadcast_to(load.forces, (len(load.faces), 3))
                yield _on_face(load), (forces,), load.faces
                continue
            for number, group in _loaded(load, self.groups):
                part = None if load.part is None else load.part[number]
                own = group.properties(), group.initial_memory(), states[number], part
                yield _on_element(load, number, group), own, group.links

    @property
    def acts(self) -> Bool[Array, ""]:
        """They do act."""
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
        for function, own, links in self._parts(states, moved):
            total = total.at[links].add(jax.vmap(function)(moved[links], *own))
        return total

    def following_blocks(
        self,
        groups: Sequence[Element] | None,
        states: Sequence[ElementState],
        nodes: Float[Array, "n_node 3"] | None,
        moved: Float[Array, "n_node 3"],
    ) -> list[tuple[Float[Array, "n k 3 k 3"], Int[Array, "n k"]]]:
        """Its derivative: list of (blocks [n, k, 3, k, 3], nodes [n, k])."""
        return [
            (jax.vmap(jax.jacfwd(function))(moved[links], *own), links)
            for function, own, links in self._parts(states, moved)
        ]


def _on_face(load):
    """Force on the corners of a face [k, 3], as a function of them and the force per area."""

    def force(corners, forces):
        alone = copy(load, faces=jnp.arange(len(corners))[None], forces=forces)
        return alone.element_forces([], [], corners, corners.shape, corners.dtype)

    return force


def _on_element(load, number, group):
    """Force on both ends of an element, [2, 3], as a function of these and its properties."""

    def force(ends, properties, memory, string, part):
        vector = ends[1] - ends[0]
        length = jnp.sqrt(vector @ vector)
        # springs of strings are about the length 0 here: forces are held, or densities
        axial = string.force + string.stiffness * length
        strain = element(group, properties).strain_at(axial, memory)
        # beyond its law the form has a status; here it must not become NaN
        strain = jnp.where(jnp.isfinite(strain) & (strain > -1), strain, 0.0)
        rest_length = (length / (1 + strain))[None]
        alone = copy(
            group, links=jnp.arange(2)[None], **{k: v[None] for k, v in properties.items()}
        )
        state = AxialState(rest_length, length[None] - rest_length)
        own = load if part is None else copy(load, part={number: part[None]})
        whole = rest_length * own.per_length(number, alone, state, ends)[0]
        return jnp.stack([0.5 * whole, 0.5 * whole])

    return force


def carries(
    groups: Sequence[Straight], tensions: Sequence[Float[Array, " n_elem"]]
) -> Bool[Array, ""]:
    """Whether the law of every element has an unstressed length for its force, bool."""
    fine = jnp.ones((), bool)
    for group, tension in zip(groups, tensions, strict=True):
        low, high = group.capacity()
        strain = group.strain_at(tension, group.initial_memory())
        fine = fine & jnp.all((tension >= low) & (tension <= high) & (strain > -1))
    return fine
