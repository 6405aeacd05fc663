"""Section forces of beams at any place along them."""

from __future__ import annotations

import jax
import numpy as np

from ..analysis.phase_results import PhaseResult
from ..analysis.solution import Solution, State
from ..common import checks
from ..common.rules import Rule, nan_if_broken
from ..common.types import Array, ArrayLike, Float, PyTree
from ..elements.abilities import POINT_LOADS, Bending
from ..elements.prestress import single_element
from ..mechanics.restart_state import make_system
from ..model.result_parts import items_per_group
from ..model.structure import Structure
from ..programs.program_calls import as_program
from ..stiffness.tangent import merge_solution_state, split_solution_state
from .interpolation import interpolate_recorded_forces


def section_forces(
    structure: Structure,
    state: Solution | State | PhaseResult,
    places: int | Float[ArrayLike, " n"] = 11,
) -> PyTree[Float[Array, "n_elem n 6"]]:
    """Compute section forces ``N, Vy, Vz, T, My, Mz`` of beams at any place along them.

    They follow from equilibrium of the part of the element before the place, in its deflected shape
    and under the loads along the element, whatever the laws of its fibres. They are exerted by the
    part beyond the place on the part before it, along the axes of the section there::

             z                         N   along x, the axis: tension is positive
             |                         Vy, Vz  along y and z
        =====|====]--> x, N, T         T   about x
            /                          My  about y: positive where the side of +z is in tension
           y                           Mz  about z: positive where the side of -y is in tension

    so that a fibre at (y, z) of a linear section has the stress
    ``N/A + My z / Iy - Mz y / Iz``. With loads ``q`` per length along the element's axes
    ``N' = -qx, Vy' = -qy, Vz' = -qz, My' = Vz, Mz' = -Vy``: a downward load on a level beam with z
    up makes ``My = -q L^2 / 8`` in the middle of a span. At the place of a `PointLoads` shear
    forces have a jump and moments a kink: at this very place the forces are those just before the
    load (towards the first node), or just beyond it if it is at the first node.

    A pure function, differentiable like the solution.

    Args:
        structure: the `Structure` that was analysed.
        state: `Solution` (NaN if it has failed) or `State`; or one of
            ``solution.phases``, for the end of that phase. There the forces are known at a few
            places and are interpolated, with the shear forces as slopes of the moments. Under
            uniform loads this is exact except for moments of the axial force on deflections: an
            error of 1e-4 of the largest where the element rotates by some 1e-2 rad.
        places: distances from the first node, [n], as fractions of the unstressed length from 0 to
            1; or an integer n for n equally spaced places from end to end.

    Returns:
        Pytree like the structure's `elements`, each [n_elem, n, 6], N and N m; None for groups that
        are no beams.

    Raises:
        ValueError: not a state, places outside of 0 to 1, no beams in the structure, or results of
            another one.

    Example:
        A beam of 6 m on two supports under 1 kN/m, a single element:

        >>> section = jc.Section.rectangle(0.1, 0.2, jc.Elastic(10e9))
        >>> beam = jc.Beams([[0, 1]], section=section)
        >>> ends = jc.restrained([0], "xyz", "x") + jc.restrained([1], "yz")
        >>> structure = jc.Structure([[0.0, 0.0, 0.0], [6.0, 0.0, 0.0]], beam, supports=ends)
        >>> solution = jc.solve(structure, jc.Phase(loads=jc.LineLoads((0.0, 0.0, -1e3))))
        >>> forces = jc.section_forces(structure, solution, places=[0.0, 1 / 6, 0.5])[0]
        >>> print(solution.status, jnp.abs(forces[:, 4]).round())  # q L^2 / 8 = 4500 N m
        0 [   0. 2500. 4500.]
    """
    if not any(isinstance(group, Bending) for group in structure.groups):
        raise ValueError(
            "structure: has no beams; its elements have a tension and no other section forces"
        )
    if isinstance(places, int | np.integer) and not isinstance(places, bool):
        if places < 2:
            raise ValueError(f"places = {places}: expected at least 2, the two ends")
        places = np.linspace(0.0, 1.0, places)
    places = checks.as_floats(places, "places")
    if places.ndim != 1 or not places.size:
        raise ValueError(
            f"places: expected a whole number, or an array [n], got shape {places.shape}"
        )
    text = "expected from 0 to 1"
    places = nan_if_broken(Rule("places", places, lambda v: (v < 0) | (v > 1), text))
    if isinstance(state, PhaseResult):
        if isinstance(places, jax.core.Tracer):
            raise ValueError("places: cannot be traced for the end of a phase; give known numbers")
        forces = items_per_group(structure, state.section_forces)
        loads = (state.results or {}).get(POINT_LOADS.name)
        loads = None if loads is None else items_per_group(structure, loads)
        at = state.positions, np.asarray(places), loads
        return structure.arrange(interpolate_recorded_forces(structure.groups, forces, *at))
    split = split_solution_state(structure, state, unknowns=False)
    return structure.arrange(_section_forces_at(*split, places))


@as_program
def _section_forces_at(without_indices, index_arrays, dof_map, places):
    """Return section forces of all groups at `places`, [n_elem, n_place, 6]; None if no beams.

    The first two arguments are those of `merge_solution_state`; `dof_map` numbers the unknowns.
    """
    nodes, groups, restart = merge_solution_state(without_indices, index_arrays)
    system = make_system(nodes, groups, restart, restart.motion, dof_map)
    places = places.astype(nodes.dtype)

    def along(group, state):
        def of_element(properties, state, ends, motion):
            return single_element(group, properties).section_forces(state, ends, motion, places)

        ends, motion = nodes[group.links], restart.motion[group.links]
        return jax.vmap(of_element)(group.properties(), state, ends, motion)

    pairs = zip(groups, system.states, strict=True)
    return [along(*pair) if isinstance(pair[0], Bending) else None for pair in pairs]
