"""Elements without a material: a prescribed force, and a spring about a given length.

Form finding iterates with these elements. Their force is ``N = T + k (l - L)``: with ``k = 0`` an
element keeps its force whatever its length, as a string over a pulley with a weight does; with a
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
from ..elements.prestress import measure_chord
from ..elements.straight import Straight
from ..equilibrium import newton
from ..equilibrium.newton import Newton
from ..mechanics.assembly import System
from ..numerics import implicit
from ..spaces.dof_map import DofMap
from .form_dependent_loads import FormDependentLoads, laws_can_carry_tensions
from .input_checks import system_with_fixed_supports


@pytree
class ForceElementState(ElementState):
    """State of elements with a prescribed force T and a spring: ``N = T + k (l - L)``.

    Attributes:
        force: T, [n_elem], N.
        stiffness: stiffness k of the spring, [n_elem], N/m.
        excess: initial length minus the unstressed length L of the spring, [n_elem], m.
    """

    force: Float[Array, " n_elem"]
    stiffness: Float[Array, " n_elem"]
    excess: Float[Array, " n_elem"] | None


@pytree(static=("tension_only",), indices=("links",))
class ForceElements(Axial):
    """Elements for form finding with the axial force ``T + k (l - L)``, whatever their law.

    T is a prescribed force, N, k the constant of a spring, N/m, and L its unstressed length, m.

    Attributes:
        links: node numbers, [n_elem, 2].
        tension_only: whether all forces are known to be tensions, and no element has a spring.
    """

    links: Indices
    tension_only: bool = False

    monotone = True

    def start(self, ends):
        """Return a state with zero forces and springs, which form finding replaces by its own."""
        nothing = jnp.zeros(len(ends), ends.dtype)
        return ForceElementState(nothing, nothing, nothing)

    def tension(self, state, ends, motion):
        """Return the axial force of one element, ``T + k (l - L)``, N; arguments as of `energy`."""
        return state.force + state.stiffness * (state.excess + measure_chord(ends, motion)[2])

    def energy(self, state, ends, motion):
        """Return work of the prescribed force plus energy of the spring of one element, J.

        `ends` are initial positions, `motion` displacements of both ends, [2, 3], m.
        """
        change = measure_chord(ends, motion)[2]
        elongation = state.excess + change
        return state.force * change + 0.5 * state.stiffness * elongation**2

    def is_slack(self, state, ends, motion):
        """Return whether an element has neither force nor spring, so that it does nothing; bool."""
        return (state.force == 0) & (state.stiffness == 0)


@pytree(static=("tension_only",))
class ForceElementNet:
    """A net of `ForceElements` under loads, which form finding brings to equilibrium.

    Attributes:
        nodes: positions of the supports, and start positions of other nodes, [n_node, 3], m.
        links: node numbers of every group, a list of [n_elem, 2].
        forces: prescribed forces of every group, a list of [n_elem], N.
        springs: stiffness, zero without a spring, and unstressed length of the springs of every
            group, a list of pairs of [n_elem], N/m and m.
        load: nodal loads, [n_node, 3], N.
        others: loads that depend on the form, or None.
        tension_only: whether all forces are tensions and there are no springs.
    """

    nodes: Float[Array, "n_node 3"]
    links: list[Any]  # arrays in place of `Indices`
    forces: list[Float[Array, " n_elem"]]
    springs: list[tuple[Float[Array, " n_elem"], Float[Array, " n_elem"]]]
    load: Float[Array, "n_node 3"]
    others: FormDependentLoads | None = None
    tension_only: bool = False

    def make_system(self, dof_map: DofMap) -> System:
        """Make the `System` of equilibrium equations, with the unknowns numbered by `dof_map`."""
        groups: list[Any] = [ForceElements(links, self.tension_only) for links in self.links]
        followers = None if self.others is None else [self.others]
        states: list[Any] = [
            ForceElementState(force, stiffness, group.chord(self.nodes[group.links]) - length)
            for group, force, (stiffness, length) in zip(
                groups, self.forces, self.springs, strict=True
            )
        ]
        return system_with_fixed_supports(self.nodes, groups, states, self.load, dof_map, followers)

    def find_equilibrium(
        self,
        begin: Callable[[System], Float[Array, "n_node 3"]],
        method: Newton,
        dof_map: DofMap,
        allowed: Int[Array, ""],
        laws: Sequence[Straight] = (),
    ) -> tuple[newton.IncrementOutcome, Int[Array, ""], System, Float[Array, "n_node 3"]]:
        """Find the equilibrium of the net by Newton's method, with an implicit derivative.

        Args:
            begin: function of the `System` that returns start displacements, [n_node, 3], m.
            method: `Newton`.
            dof_map: numbering of the unknowns.
            allowed: status of the input; unless it is OK there is no iteration.
            laws: element groups whose laws must be able to carry the forces, with links as arrays.

        Returns:
            outcome: result of Newton's method, without derivatives.
            status: status code of input, iteration and laws together.
            system: the equations, with derivatives only where the status is OK.
            displacements: [n_node, 3], m, with their derivatives.
        """
        frozen = lax.stop_gradient(self)
        system = frozen.make_system(dof_map)
        start = begin(system)
        found, factored = newton.equilibrate(system, start, method, allowed == status.OK)
        code = status.first_failure(allowed, found.code)
        if laws:
            carried = laws_can_carry_tensions(laws, system.tensions(found.x))
            law_code = jnp.where(carried, status.OK, status.MATERIAL_FAILURE)
            code = status.first_failure(code, law_code)
        valid = code == status.OK
        system = implicit.stop_gradient_unless(valid, self).make_system(dof_map)
        tol, worth = newton.adjoint_cg_settings(method, system, start.dtype)
        motion, *_ = implicit.attach_derivative_with_marks(
            system, found.x, valid, factored, tol, worth
        )
        return found, code, system, motion
