"""The prestress of a state, in all the forms in which a phase can state it."""

from __future__ import annotations

import jax
import jax.numpy as jnp

from ..analysis.solution import Solution, State
from ..common.tree import pytree
from ..common.types import Array, Float, PyTree
from ..elements.abilities import Sagging, Uniaxial
from ..elements.prestress import of_each
from ..mechanics.carry import make_system
from ..mechanics.elementwise import each
from ..model.structure import Structure
from ..stiffness.tangent import merge_state, split_state


@pytree
class Statements:
    """The prestress of a state in its geometry, in all the forms that `Phase` accepts.

    Each absolute statement (not the increments `shortening` and `temperature`) leads to the state
    again if it is given to a `Phase` of the same structure with its nodes moved to the positions of
    the state. All are in the shape of `elements`, each [n_elem], NaN where a group (of beams, or of
    elements that are not `abilities.Uniaxial`) or an element has no such value.

    Attributes:
        pretension: axial force, N; of a catenary that of the straight element without load.
        force_density: this force over the length between the ends, N/m.
        prestrain: strain, relative to the unstressed length.
        rest_length: unstressed length, m.
        shortening: length between the ends less the unstressed length, m: the shortening by a
            turnbuckle if the element were built in unstressed.
        temperature: change of temperature with the same effect by contraction, K.
        sag: of catenaries, distance from the chord at midspan, along the load, m.
        length: length between the ends, m.

    Example:
        >>> nodes = [[-4.0, 0.0, 3.0], [0.0, 0.0, 0.0], [4.0, 0.0, 3.0]]
        >>> cables = jc.Cables([[0, 1], [1, 2]], axial_stiffness=1e5)
        >>> structure = jc.Structure(nodes, cables, supports=jc.pinned([0, 2]))
        >>> weight = jc.NodalLoads([1], (0.0, 0.0, -600.0))
        >>> solution = jc.solve(structure, jc.Phase(pretension=500.0, loads=weight))
        >>> found = jc.forms.statements(structure, solution)
        >>> print(solution.status, jnp.round(found.shortening, 6), jnp.round(found.length, 6))  # m
        0 [0.024876 0.024876] [5. 5.]
    """

    pretension: PyTree[Float[Array, " n_elem"]]
    force_density: PyTree[Float[Array, " n_elem"]]
    prestrain: PyTree[Float[Array, " n_elem"]]
    rest_length: PyTree[Float[Array, " n_elem"]]
    shortening: PyTree[Float[Array, " n_elem"]]
    temperature: PyTree[Float[Array, " n_elem"]]
    sag: PyTree[Float[Array, " n_elem"]]
    length: PyTree[Float[Array, " n_elem"]]


def statements(structure: Structure, solution: Solution | State) -> Statements:
    """The prestress of a solution in all the forms that a `Phase` accepts: the inverse of stating.

    A state with slack cables is determined by their `rest_length`, `prestrain` or `shortening`, not
    by their tension, which is zero whatever their length.

    Args:
        structure: the `Structure` that was analysed.
        solution: `Solution` (its last converged state is used) or `State`.

    Returns:
        `Statements`; differentiable like the solution.

    Example:
        A tensegrity of three struts: ``1 / sqrt(3)`` in triangles, 1 in verticals, -1 in struts.

        >>> structure, phases = jc.scenes.simplex()
        >>> solution = jc.solve(structure, phases[:1])
        >>> density = jc.forms.statements(structure, solution).force_density
        >>> one = density["verticals"][0]
        >>> ratio = {kind: round(float(q[0] / one), 6) for kind, q in density.items()}
        >>> print(solution.status, ratio)
        0 {'struts': -1.0, 'triangles': 0.57735, 'verticals': 1.0}
    """
    thawed, arrays, _ = split_state(structure, solution)
    per_group = _say(thawed, arrays)
    names = per_group[0].keys()
    return Statements(**{n: structure.arrange([values[n] for values in per_group]) for n in names})


@jax.jit
def _say(thawed, arrays):
    """The compiled core: statements of every group, a list of dicts."""
    nodes, groups, carry = merge_state(thawed, arrays)
    system = make_system(nodes, groups, carry, None, None, carry.nodal_load)
    return [
        _group(group, state, nodes, carry.motion)
        for group, state in zip(groups, system.states, strict=True)
    ]


def _group(group, state, nodes, motion):
    """The statements of one group, dict of [n_elem]."""
    unknown = jnp.full(len(group.links), jnp.nan, nodes.dtype)
    values = dict.fromkeys(Statements.__dataclass_fields__, unknown)
    if state.rest_length is None:
        return values
    values["rest_length"] = state.rest_length
    if not isinstance(group, Uniaxial):
        return values
    strain = each("strain", group, state, nodes, motion)
    length = state.rest_length * (1 + strain)

    pretension = of_each("force", group, strain, state.memory)
    values |= {
        "pretension": pretension,
        "force_density": pretension / length,
        "prestrain": strain,
        "shortening": state.rest_length * strain,
        "length": length,
    }
    if group.expansion is not None:
        # if the element were cut to its length under force: L0 (1 + strain) (1 + expansion dt) = L0
        values["temperature"] = -strain / (1 + strain) / group.expansion
    if isinstance(group, Sagging) and state.line_load is not None:
        values["sag"] = each("sag", group, state, nodes, motion)
    return values
