"""Stresses of the fibres along the path of a phase, from the recorded strains."""

from __future__ import annotations

import jax

from ..analysis.phase_results import PhaseResult
from ..common.tree import merge_indices, split_indices
from ..common.types import Array, Float, PyTree
from ..elements.prestress import single_element
from ..model.result_parts import items_per_group
from ..model.structure import Structure
from ..programs.program_calls import as_program
from ..sections import LinearSection


def fibre_stress(
    structure: Structure, phase: PhaseResult
) -> PyTree[Float[Array, "n_inc n_elem ..."]]:
    """Return the stress of every fibre at every increment of a phase.

    Args:
        structure: the `Structure` that was analysed.
        phase: results of a phase, one of ``solution.phases``.

    Returns:
        Pytree like the structure's `elements`, Pa, NaN from a failure on: for bars and cables with
        a section [n_inc, n_elem, n_fibre], with one law [n_inc, n_elem]; for beams
        [n_inc, n_elem, n_point, n_fibre], the fibres in the order of the section's `y` and `z`;
        None for a group that has stiffnesses instead of fibres or a law.

    Raises:
        ValueError: `phase` is not the results of a phase.

    Differentiable if `solve` was called with `differentiate_path`, else its derivative is NaN.
    Laws with history variables are followed through the increments, from their values at the
    beginning of the phase.

    Example:
        A rope of 1 cm2 that carries 22 kN, loaded in two increments; its law bends at 200 MPa:

        >>> law = jc.Polygonal([0.0, 1e-3, 3e-3], [0.0, 200e6, 240e6])
        >>> rope = jc.Cables([[0, 1]], area=1e-4, law=law)
        >>> structure = jc.Structure([[0.0, 0, 0], [0, 0, -2]], rope, supports=jc.pinned([0]))
        >>> hung = jc.Phase(loads=jc.NodalLoads([1], (0.0, 0.0, -22e3)), increments=2)
        >>> solution = jc.solve(structure, hung)
        >>> stress = jc.fibre_stress(structure, solution.phases[0])  # [n_inc, n_elem]
        >>> print(solution.status, jnp.round(stress[:, 0] / 1e6, 6))  # MPa
        0 [110. 220.]
    """
    if not hasattr(phase, "path"):
        raise ValueError(f"phase: expected one of solution.phases, got {type(phase).__name__}")
    path = phase.path
    records = [
        items_per_group(structure, tree) for tree in (path.strain, path.tension, phase.began)
    ]
    return structure.arrange(_stresses_of_groups(*split_indices((structure.groups, *records))))


@as_program
def _stresses_of_groups(without_indices, index_arrays):
    """Return fibre stresses of all groups, [n_inc, n_elem, ...], Pa; None without section or law.

    Arguments are `split_indices` of groups, strains, tensions, and initial history variables.
    """
    stresses = []
    for group, strain, tension, memory in zip(
        *merge_indices(without_indices, index_arrays), strict=True
    ):
        if isinstance(group.section, LinearSection):
            stresses.append(None)
        elif strain is not None:
            stresses.append(_stress_history(group, strain, memory))
        else:  # no strains are recorded for a linear law: its stress follows from the tension
            area = group.area
            stresses.append(None if area is None else tension / area[None, :])
    return stresses


def _stress_history(group, strain, memory):
    """Return the stresses of a group after every increment, [n_inc, n_elem, ...], Pa.

    `strain` has the section strains, [n_inc, n_elem, ...], `memory` the initial history variables.
    """

    def of_all(method, strain, memory):
        def of_element(properties, strain, memory):
            return getattr(single_element(group, properties), method)(strain, memory)

        return jax.vmap(of_element)(group.properties(), strain, memory)

    if memory is None:
        return jax.vmap(lambda e: of_all("fibre_stress", e, None))(strain)

    def increment(memory, e):
        return of_all("commit_memory", e, memory), of_all("fibre_stress", e, memory)

    return jax.lax.scan(increment, memory, strain)[1]
