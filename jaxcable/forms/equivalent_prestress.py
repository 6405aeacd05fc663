"""The prestress of a state, expressed as each of the prestress inputs of a `Phase`."""

from __future__ import annotations

import jax.numpy as jnp

from ..analysis.solution import Solution, State
from ..common.tree import pytree
from ..common.types import Array, Float, PyTree
from ..elements.abilities import Hanging, Uniaxial
from ..elements.prestress import call_each_element
from ..mechanics.elementwise import evaluate_elements
from ..mechanics.restart_state import make_system
from ..model.structure import Structure
from ..programs.program_calls import as_program
from ..stiffness.tangent import merge_solution_state, split_solution_state


@pytree
class EquivalentPrestress:
    """The prestress of a state, expressed as each of the prestress inputs of a `Phase`.

    Move the nodes of the structure to the positions of the state, and give any one of the absolute
    inputs (not the increments `shortening` and `temperature`) to a `Phase`: the analysis leads to
    the same state. All fields are in the shape of `elements`, each [n_elem]. They are NaN for
    elements without such a value, such as beams and others that are not `abilities.Uniaxial`.

    Attributes:
        pretension: axial force, N; of a catenary, that of a straight element of the same unstressed
            length without load.
        force_density: this force over the length between the ends, N/m.
        prestrain: strain, relative to the unstressed length.
        rest_length: unstressed length, m.
        shortening: length between the ends minus the unstressed length, m: by so much a turnbuckle
            would shorten the element if it were built in unstressed.
        temperature: change of temperature that would contract the element by as much, K.
        sag: of catenaries, distance from the chord at midspan, along the load, m.
        length: length between the ends, m.

    Example:
        >>> nodes = [[-4.0, 0.0, 3.0], [0.0, 0.0, 0.0], [4.0, 0.0, 3.0]]
        >>> cables = jc.Cables([[0, 1], [1, 2]], axial_stiffness=1e5)
        >>> structure = jc.Structure(nodes, cables, supports=jc.pinned([0, 2]))
        >>> weight = jc.NodalLoads([1], (0.0, 0.0, -600.0))
        >>> solution = jc.solve(structure, jc.Phase(pretension=500.0, loads=weight))
        >>> found = jc.forms.equivalent_prestress(structure, solution)
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


def equivalent_prestress(structure: Structure, solution: Solution | State) -> EquivalentPrestress:
    """Return the prestress of a solution as tension, force density, unstressed length, and so on.

    Each of these is an input of a `Phase` that leads to the same state. A slack cable is determined
    by its `rest_length`, `prestrain` or `shortening`, not by its tension, which is zero at any
    length.

    Args:
        structure: the `Structure` that was analysed.
        solution: `Solution` (NaN if it has failed) or `State`.

    Returns:
        `EquivalentPrestress`; differentiable like the solution.

    Example:
        Force densities of a tensegrity: ``1 / sqrt(3)`` in triangles, 1 in verticals, -1 in struts.

        >>> structure, phases = jc.scenes.simplex()
        >>> solution = jc.solve(structure, phases[:1])
        >>> density = jc.forms.equivalent_prestress(structure, solution).force_density
        >>> one = density["verticals"][0]
        >>> ratio = {kind: round(float(q[0] / one), 6) for kind, q in density.items()}
        >>> print(solution.status, ratio)
        0 {'struts': -1.0, 'triangles': 0.57735, 'verticals': 1.0}
    """
    without_indices, index_arrays, _ = split_solution_state(structure, solution)
    per_group = _evaluate_prestress(without_indices, index_arrays)
    names = per_group[0].keys()
    values = {name: structure.arrange([group[name] for group in per_group]) for name in names}
    return EquivalentPrestress(**values)


@as_program
def _evaluate_prestress(without_indices, index_arrays):
    """Return the fields of `EquivalentPrestress`, a list of dicts of [n_elem], one for each group.

    Arguments are those of `merge_solution_state`.
    """
    nodes, groups, restart = merge_solution_state(without_indices, index_arrays)
    system = make_system(nodes, groups, restart, None, None, restart.nodal_load)
    return [
        _prestress_of_group(group, state, nodes, restart.motion)
        for group, state in zip(groups, system.states, strict=True)
    ]


def _prestress_of_group(group, state, nodes, motion):
    """Return the fields of `EquivalentPrestress` for one group: [n_elem] each, NaN if unknown.

    `state` is that of the group; `nodes` are initial positions, `motion` displacements, m.
    """
    unknown = jnp.full(len(group.links), jnp.nan, nodes.dtype)
    values = dict.fromkeys(EquivalentPrestress.__dataclass_fields__, unknown)
    if state.rest_length is None:
        return values
    values["rest_length"] = state.rest_length
    if not isinstance(group, Uniaxial):
        return values
    strain = evaluate_elements("strain", group, state, nodes, motion)
    length = state.rest_length * (1 + strain)

    pretension = call_each_element("force", group, strain, state.memory)
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
    if isinstance(group, Hanging) and state.line_load is not None:
        values["sag"] = evaluate_elements("sag", group, state, nodes, motion)
    return values
