"""Elements of a form whose force, force density or length is given, as groups of an analysis.

In a form that belongs to a larger structure, they take the place of the groups of the user:
`forms_by_analysis` solves the structure with them. Their force is ``N = T + k (l - L)``: a
prescribed force has ``k = 0``, a force density ``T = L = 0`` and ``k = q``. Loads along them depend
on the form, as `form_dependent_loads` says; `FormLoads` is the follower load of such an analysis.
"""

from __future__ import annotations

from typing import Any

import jax.numpy as jnp

from ..common.tree import Indices, pytree
from ..common.types import Array, Bool, Float
from ..elements.element import Ends, Motion
from ..loads.load import Blocks, FollowerLoad, Groups, Positions, States
from .force_elements import ForceElements, ForceElementState
from .form_dependent_loads import FormDependentLoads, nodes_coupled_by_loads


@pytree(static=("tension_only",), indices=("links",))
class PrescribedElements(ForceElements):
    """A group of elements with a prescribed force T and a spring: ``N = T + k (l - L)``.

    Attributes:
        links: node numbers, [n_elem, 2].
        tension_only: whether no force can be a compression.
        force: T, [n_elem], N.
        stiffness: stiffness k of the spring, [n_elem], N/m.
        natural_length: length L of the spring without force, [n_elem], m.
    """

    # always given: a dataclass allows no field without default after one that has it
    force: Float[Array, " n_elem"] = None  # type: ignore[assignment]
    stiffness: Float[Array, " n_elem"] = None  # type: ignore[assignment]
    natural_length: Float[Array, " n_elem"] = None  # type: ignore[assignment]

    per_element = ("force", "stiffness", "natural_length")

    def start(self, ends: Float[Array, "n_elem 2 3"]) -> ForceElementState:
        """Return the state of the group for initial positions `ends`, [n_elem, 2, 3], m."""
        excess = self.chord(ends) - self.natural_length
        return ForceElementState(self.force, self.stiffness, excess)

    def at_kink(self, state: ForceElementState, ends: Ends, motion: Motion) -> Bool[Array, ""]:
        """Return False: the force of such an element has no kink."""
        return jnp.zeros((), bool)

    def form_state(self) -> ForceElementState:
        """Return the state with the spring length 0 in place of L, and the force ``T - k L``.

        From it `FormDependentLoads` computes axial forces by lengths alone.
        """
        return ForceElementState(
            self.force - self.stiffness * self.natural_length, self.stiffness, None
        )


@pytree
class FormLoads(FollowerLoad):
    """Loads that depend on the form, as a follower load of an analysis.

    Attributes:
        acting: the loads, with the groups whose laws give the unstressed lengths.
        states: for each group of the structure its `PrescribedElements.form_state`; None for
            a group that keeps its law.
    """

    acting: FormDependentLoads
    states: list[ForceElementState | None]

    def coupled_nodes(self, groups: Groups) -> list[Indices]:
        """Return sets of k nodes whose forces depend on each other's positions, list of [n, k]."""
        coupled = nodes_coupled_by_loads(self.acting.groups, self.acting.loads)
        return [nodes for nodes, *_ in coupled]

    def following_forces(
        self, groups: Groups, states: States, nodes: Positions, moved: Positions
    ) -> Positions:
        """Return the force on every node, [n_row, 3], N, with nodes at `moved` [n_row, 3], m."""
        known: Any = self.states  # of all groups that these loads act on
        return self.acting.following_forces(None, known, None, moved)

    def following_blocks(
        self, groups: Groups, states: States, nodes: Positions, moved: Positions
    ) -> Blocks:
        """Return derivatives of the forces by current positions `moved`, in blocks.

        For each load and group a pair: blocks [n, k, 3, k, 3], N/m, and nodes [n, k].
        """
        known: Any = self.states
        blocks: Any = self.acting.following_blocks(None, known, None, moved)
        return blocks
