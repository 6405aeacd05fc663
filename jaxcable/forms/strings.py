"""Members without a material: a prescribed force, and a spring about a given length.

Form finding iterates with these members. Their force is ``N = T + k (l - L)``: with ``k = 0`` a
member keeps its force whatever its length, as a string over a pulley with a weight does; with a
large ``k`` it nearly keeps its length.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Any

import jax.numpy as jnp
from jax import lax

from ..common import status
from ..common.tree import Indices, pytree
from ..common.types import Array, Float, Int
from ..elements.axial import Axial
from ..elements.element_state import ElementState
from ..elements.prestress import stretch
from ..elements.straight import Straight
from ..equilibrium import newton
from ..equilibrium.newton import Newton
from ..mechanics.assembly import System
from ..numerics import implicit
from ..spaces.freedoms import Freedoms
from .along import OnForm, carries
from .members import system_at_rest


@pytree
class StringState(ElementState):
    """Force and spring of the members of a group.

    Attributes:
        force: T, [n_elem], N.
        stiffness: k, [n_elem], N/m.
        excess: initial length less L, [n_elem], m.
    """

    force: Float[Array, " n_elem"]
    stiffness: Float[Array, " n_elem"]
    excess: Float[Array, " n_elem"] | None


@pytree(static=("tension_only",), indices=("links",))
class Strings(Axial):
    """A group of members with prescribed forces and springs; see `elements` for the methods.

    Attributes:
        links: node numbers, [n_elem, 2].
        tension_only: whether all forces are known to be tensions, and no member has a spring.
    """

    links: Indices
    tension_only: bool = False

    rising = True

    def start(self, ends):
        """A state without force and spring; form finding makes the states that it uses."""
        nothing = jnp.zeros(len(ends), ends.dtype)
        return StringState(nothing, nothing, nothing)

    def tension(self, state, ends, motion):
        """Axial force, N."""
        return state.force + state.stiffness * (state.excess + stretch(ends, motion)[2])

    def energy(self, state, ends, motion):
        """Work of the force and of the spring, J."""
        change = stretch(ends, motion)[2]
        gap = state.excess + change
        return state.force * change + 0.5 * state.stiffness * gap**2

    def is_slack(self, state, ends, motion):
        """Whether a member has neither force nor spring."""
        return (state.force == 0) & (state.stiffness == 0)


@pytree(static=("tension_only",))
class StringNet:
    """Strings between nodes under loads: all numbers that a form depends on.

    Attributes:
        nodes: positions of the supports and of the start, [n_node, 3], m.
        links: node numbers of every group, a list of [n_elem, 2].
        forces: T of every group, a list of [n_elem], N.
        springs: pairs (k, L) of every group, N/m and m, or None for a group without springs.
        load: nodal loads, [n_node, 3], N.
        others: loads that depend on the form, or None.
        tension_only: as of `Strings`.
    """

    nodes: Float[Array, "n_node 3"]
    links: list[Any]  # arrays in place of `Indices`
    forces: list[Float[Array, " n_elem"]]
    springs: list[tuple[Float[Array, " n_elem"], Float[Array, " n_elem"]] | None]
    load: Float[Array, "n_node 3"]
    others: OnForm | None = None
    tension_only: bool = False

    def system(self, freedoms: Freedoms) -> System:
        """The `System` of the strings, with this numbering of the unknowns."""
        groups: list[Any] = [Strings(links, self.tension_only) for links in self.links]
        followers = None if self.others is None else [self.others]
        states: list[Any] = []
        for group, force, spring in zip(groups, self.forces, self.springs, strict=True):
            stiffness = excess = jnp.zeros_like(force)
            if spring is not None:
                stiffness, length = spring
                excess = group.chord(self.nodes[group.links]) - length
            states.append(StringState(force, stiffness, excess))
        return system_at_rest(self.nodes, groups, states, self.load, freedoms, followers)

    def equilibrated(
        self,
        begin: Callable[[System], Float[Array, "n_node 3"]],
        method: Newton,
        freedoms: Freedoms,
        allowed: Int[Array, ""],
        laws: Sequence[Straight] = (),
    ) -> tuple[newton.Outcome, Int[Array, ""], System, Float[Array, "n_node 3"]]:
        """Bring the strings to equilibrium.

        Args:
            begin: the displacements to start from, [n_node, 3], m, of the system.
            method: `Newton`.
            freedoms: the numbering of the unknowns.
            allowed: status of the input.
            laws: element groups that must be able to carry the forces, with links as arrays.

        Returns:
            What Newton's method ended with; the status; the system, whose derivatives pass only
            where this is OK; and the displacements of its equilibrium, with their derivative.
        """
        frozen = lax.stop_gradient(self)
        sought = frozen.system(freedoms)
        start = begin(sought)
        found, factored = newton.equilibrate(sought, start, method, allowed == status.OK)
        code = status.first_failure(allowed, found.code)
        if laws:
            borne = carries(laws, sought.tensions(found.x))
            code = status.first_failure(code, jnp.where(borne, status.OK, status.MATERIAL_FAILURE))
        valid = code == status.OK
        system = implicit.gate(valid, self).system(freedoms)
        tol, worth = newton.adjoint_effort(method, system, start.dtype)
        motion, *_ = implicit.attach_apart(system, found.x, valid, factored, tol, worth)
        return found, code, system, motion
