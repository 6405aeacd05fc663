"""Loads that depend on the form that is sought: self-weight, line loads and area loads.

They are the loads of an analysis that begins with the form found. There the unstressed length is
``l / (1 + e)``, where the strain e follows from the force by the group's law; initial or projected
lengths and areas are those of the form. During form finding the loads follow the nodes, with exact
derivatives.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import jax
import jax.numpy as jnp

from ..common.tree import Indices, copy_with, pytree
from ..common.types import Array, Bool, Float, Int
from ..elements.bar import Straight
from ..elements.element import Element
from ..elements.element_state import ElementState
from ..elements.prestress import AxialState, single_element
from ..loads import AreaLoads, LineLoads, Load, NodalLoads, PointMasses, SelfWeight, as_list
from ..model.structure import Structure


def split_loads(
    structure: Structure, loads: Load | Sequence[Load] | None, nodal_only: bool = False
) -> tuple[list[NodalLoads], list[SelfWeight | LineLoads | AreaLoads]]:
    """Check loads, and split them into nodal loads and loads that depend on the form.

    Weights of `PointMasses` are nodal loads. With `nodal_only` all others are refused. Raises
    ValueError for a load of another kind, or one that does not fit the structure.
    """
    given: list[Any] = as_list(loads)  # their kinds are checked below
    given = [one.as_nodal_loads() if isinstance(one, PointMasses) else one for one in given]
    nodal, others = [], []
    for k, load in enumerate(given):
        depends = not nodal_only and isinstance(load, SelfWeight | LineLoads | AreaLoads)
        if not depends and not isinstance(load, NodalLoads):
            kinds = (
                "NodalLoads and PointMasses"
                if nodal_only
                else "NodalLoads, PointMasses, SelfWeight, LineLoads and AreaLoads"
            )
            raise ValueError(
                f"loads[{k}]: {type(load).__name__} is not known before the form is: it depends on "
                "unstressed lengths, follows the nodes, varies, or moves supports; this function "
                f"takes {kinds}"
            )
        load.check(structure)
        if not depends:
            nodal.append(load)
            continue
        if (
            load.needs_begin_nodes
        ):  # the phase begins in the form: its geometry is the input geometry
            load = copy_with(load, geometry="input")
        others.append(load.with_group_indices(structure))
    return nodal, others


def nodes_coupled_by_loads(
    groups: Sequence[Element], others: Sequence[Load]
) -> tuple[tuple[Indices, int, tuple[()]], ...]:
    """Return, for each load in `others`, the nodes whose positions determine its nodal forces.

    Such nodes need places for each other in a sparse tangent stiffness.

    Returns:
        Triples (nodes of every element or face [n, k], 3, ()), as `make_dof_map` takes them.
    """
    nodes = []
    for load in others:
        if isinstance(load, AreaLoads):
            nodes.append(load.faces)
        else:
            nodes += [group.links for _, group in _loaded_groups(load, groups)]
    return tuple((ends if isinstance(ends, Indices) else Indices(ends), 3, ()) for ends in nodes)


def _loaded_groups(load, groups):
    """Generate (index, group) for each element group on which a load along elements acts."""
    for index, group in enumerate(groups):
        weightless = isinstance(load, SelfWeight) and group.weight is None
        if not weightless and index in load.on:
            yield index, group


@pytree
class FormDependentLoads:
    """Loads that depend on the form, as one follower load in the equations of form finding.

    Attributes:
        groups: element groups of the structure, with links as arrays; their laws give the
            unstressed lengths on which such loads depend.
        loads: `SelfWeight`, `LineLoads` and `AreaLoads`, as `split_loads` returns them.
    """

    groups: list[Element]
    loads: list[SelfWeight | LineLoads | AreaLoads]

    def _force_functions(self, states, moved):
        """Generate, for each load and group, a function for the forces of one element or face.

        Args:
            states: state of each group, `ForceElementState`.
            moved: positions of all nodes, [n_node, 3], m.

        Yields:
            function: function of the positions of k nodes, [k, 3], and arguments to forces on them,
                N.
            arguments: its arguments, with a leading axis of elements or faces.
            nodes: node numbers of every element or face, [n, k].
        """
        for load in self.loads:
            if isinstance(load, AreaLoads):
                forces = jnp.broadcast_to(load.forces, (len(load.faces), 3))
                yield _corner_force_function(load), (forces,), load.faces
                continue
            for index, group in _loaded_groups(load, self.groups):
                part = None if load.element_factors is None else load.element_factors[index]
                arguments = group.properties(), group.initial_memory(), states[index], part
                yield _element_force_function(load, index, group), arguments, group.links

    @property
    def is_acting(self) -> Bool[Array, ""]:
        """Whether the load acts, always True here; the equations ask each follower load."""
        return jnp.ones((), bool)

    def following_forces(
        self,
        groups: Sequence[Element] | None,
        states: Sequence[ElementState],
        nodes: Float[Array, "n_node 3"] | None,
        moved: Float[Array, "n_node 3"],
    ) -> Float[Array, "n_node 3"]:
        """Return the force on every node, [n_node, 3], N, at the positions `moved`, [n_node, 3]."""
        total = jnp.zeros_like(moved)
        for function, arguments, links in self._force_functions(states, moved):
            total = total.at[links].add(jax.vmap(function)(moved[links], *arguments))
        return total

    def following_blocks(
        self,
        groups: Sequence[Element] | None,
        states: Sequence[ElementState],
        nodes: Float[Array, "n_node 3"] | None,
        moved: Float[Array, "n_node 3"],
    ) -> list[tuple[Float[Array, "n k 3 k 3"], Int[Array, "n k"]]]:
        """Return the derivative of the nodal forces by the positions `moved`, in blocks.

        Returns:
            For each load and group a pair: blocks [n, k, 3, k, 3], N/m, of its n elements or faces,
                and their node numbers [n, k].
        """
        return [
            (jax.vmap(jax.jacfwd(function))(moved[links], *arguments), links)
            for function, arguments, links in self._force_functions(states, moved)
        ]


def _corner_force_function(load):
    """Return the function that gives the forces at the corners of a face, [k, 3], N.

    It takes the positions of the corners, [k, 3], m, and the load per area, [3], N/m2.
    """

    def force(corners, forces):
        alone = copy_with(load, faces=jnp.arange(len(corners))[None], forces=forces)
        return alone.element_forces([], [], corners, corners.shape, corners.dtype)

    return force


def _element_force_function(load, index, group):
    """Return the function from an element's ends [2, 3] and properties to its loads there, N."""

    def force(ends, properties, memory, given, part):
        vector = ends[1] - ends[0]
        length = jnp.sqrt(vector @ vector)
        # a prescribed force, or a force density times the length: then a spring of length zero
        axial = given.force + given.stiffness * length
        strain = single_element(group, properties).strain_at(axial, memory)
        # a force beyond the law ends in a status of the form; until then avoid NaN
        strain = jnp.where(jnp.isfinite(strain) & (strain > -1), strain, 0.0)
        rest_length = (length / (1 + strain))[None]
        alone = copy_with(
            group, links=jnp.arange(2)[None], **{k: v[None] for k, v in properties.items()}
        )
        state = AxialState(rest_length, length[None] - rest_length)
        acting = load if part is None else copy_with(load, element_factors={index: part[None]})
        if not isinstance(load, SelfWeight | LineLoads):  # wind need not be even along an element
            acting, shape = copy_with(acting, on=(0,)), (2, 3)
            if part is not None:
                acting = copy_with(acting, element_factors={0: part[None]})
            return acting.element_forces([alone], [state], ends, shape, ends.dtype)
        whole = rest_length * acting.load_per_length(index, alone, state, ends)[0]
        return jnp.stack([0.5 * whole, 0.5 * whole])

    return force


def laws_can_carry_tensions(
    groups: Sequence[Straight], tensions: Sequence[Float[Array, " n_elem"]]
) -> Bool[Array, ""]:
    """Return whether the laws of all groups can carry axial forces [n_elem], N: a strain exists."""
    carried = jnp.ones((), bool)
    for group, tension in zip(groups, tensions, strict=True):
        low, high = group.capacity()
        strain = group.strain_at(tension, group.initial_memory())
        carried = carried & jnp.all((tension >= low) & (tension <= high) & (strain > -1))
    return carried
