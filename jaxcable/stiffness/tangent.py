"""The tangent stiffness matrix at the end of an analysis."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, TypeAlias

import jax
import jax.numpy as jnp
import numpy as np

from .. import linear
from ..analysis.activation import find_inactive_dofs
from ..analysis.solution import Solution, State, last_state_or_nan
from ..common import memory_limit
from ..common.tree import cast_floats, merge_indices, split_indices
from ..common.types import Array, ArrayLike, Bool, Float
from ..elements.element import Element
from ..mechanics.restart_state import RestartState, make_system
from ..model.structure import Structure
from ..model.supports import FixedDofs
from ..model.topology import require_same_topology
from ..programs.program_calls import as_program
from ..spaces.dof_map import DofMap, MotionRows, make_dof_map

_SplitModel: TypeAlias = "tuple[Float[Array, 'n_row 3'], list[Element], RestartState]"
_IndexArrays: TypeAlias = "list[np.ndarray]"


def tangent_stiffness(
    structure: Structure,
    state: Solution | State,
    fixed: Bool[ArrayLike, "n_row n_freedom"] | None = None,
) -> Float[Array, "n_free n_free"]:
    """Return the dense tangent stiffness at the state of a solution.

    It is the derivative of the element forces by automatic differentiation: elastic and geometric
    stiffness, and that of follower loads.

    A state is stable if its tangent is positive definite. Slack cables give no stiffness. This is a
    pure function, which jit, vmap and grad can transform.

    Args:
        structure: the `Structure` that was analysed.
        state: `Solution` (NaN if it has failed) or `State`.
        fixed: degrees of freedom to leave out, [n_node, 3] bool, in a structure with beams
            [n_row, 6]; default those held in the phase of the state. All False gives the tangent of
            the structure without supports.

    Returns:
        [n_free, n_free], N/m; unknowns node by node, x, y, z. With beams, the three rotations of a
        node follow its displacements, times a length (`spaces.RotatingNodes.rotation_length`).

    Raises:
        ValueError: not a state, or `fixed` of the wrong shape.

    Example:
        ``2 (EA/L0 c^2 + N/l (1 - c^2))`` in x, y and z, with the direction cosine c of the cables:

        >>> nodes = [[-4.0, 0.0, 3.0], [0.0, 0.0, 0.0], [4.0, 0.0, 3.0]]
        >>> cables = jc.Cables([[0, 1], [1, 2]], axial_stiffness=1e5)
        >>> structure = jc.Structure(nodes, cables, supports=jc.pinned([0, 2]))
        >>> weight = jc.NodalLoads([1], (0.0, 0.0, -600.0))
        >>> solution = jc.solve(structure, jc.Phase(pretension=500.0, loads=weight))
        >>> tangent = jc.stiffness.tangent_stiffness(structure, solution)
        >>> print(solution.status, jnp.round(jnp.diagonal(tangent), 3))  # N/m
        0 [25800.   200. 14600.]
    """
    at = split_solution_state(structure, state, fixed)
    require_dense_memory(at[2], 2, "tangent_stiffness")
    return tangent_matrix(*at)


@as_program
def tangent_matrix(
    without_indices: _SplitModel, index_arrays: _IndexArrays, dof_map: DofMap
) -> Float[Array, "n_free n_free"]:
    """Return the tangent stiffness, [n_free, n_free], N/m, of a split state; a program."""
    nodes, groups, restart = merge_solution_state(without_indices, index_arrays)
    system = make_system(nodes, groups, restart, restart.motion, dof_map)
    stiffness: Any = system.tangent(restart.motion)  # dense
    return stiffness


@as_program
def tangent_and_displacements(
    without_indices: _SplitModel, index_arrays: _IndexArrays, dof_map: DofMap
) -> tuple[Float[Array, "n_free n_free"], Bool[Array, ""], Float[Array, "n_row 3 n_free"]]:
    """Return what modes of a split state are made of; a program.

    Args:
        without_indices, index_arrays, dof_map: what `split_solution_state` returns.

    Returns:
        The tangent stiffness, N/m; whether it is symmetric; the derivatives of all displacements by
        the unknowns. Hinged ends of beams are rows behind the nodes.
    """
    nodes, groups, restart = merge_solution_state(without_indices, index_arrays)
    system = make_system(nodes, groups, restart, restart.motion, dof_map)
    stiffness: Any = system.tangent(restart.motion)  # dense
    moved = system.displacement_jacobian(restart.motion)
    return stiffness, linear.is_symmetric(stiffness), moved


def split_solution_state(
    structure: Structure,
    state: Solution | State,
    fixed: Bool[ArrayLike, "n_row n_freedom"] | None = None,
    *,
    unknowns: bool = True,
    number: Callable[[FixedDofs, MotionRows | None], DofMap] | None = None,
) -> tuple[_SplitModel, _IndexArrays, DofMap]:
    """Split the state of a solution into what programs such as `tangent_matrix` take.

    Args:
        structure, state, fixed: as for `tangent_stiffness`.
        unknowns: False for a numbering without unknowns, which does not depend on which elements
            are there: this can then be traced.
        number: function of the fixed degrees of freedom and the rows of motion that numbers the
            unknowns; None for a numbering of dense matrices.

    Returns:
        Nodes, element groups and `RestartState`, all without their integer index arrays; these
            index arrays, which `merge_solution_state` puts back; the numbering of the unknowns.
    """
    state = last_state_or_nan(state)
    if not isinstance(state, State):
        raise ValueError(f"state: expected a Solution or its .last, got {type(state).__name__}")
    require_same_topology(structure, state.topology, "state")
    rows, groups = structure.motion_rows()
    held = state.fixed[-1] if fixed is not None else _fixed_dofs_in_phase_of(state)
    fixed = held if fixed is None else FixedDofs(np.asarray(fixed, bool), held.axes)
    idle = find_inactive_dofs(structure, state.restart.states) if unknowns else None
    if idle is not None:
        fixed = FixedDofs(fixed.array | idle, fixed.axes, fixed.mechanisms)
    if fixed.shape != state.fixed[-1].shape:
        n_row, width = state.fixed[-1].shape
        raise ValueError(
            f"fixed: expected booleans of shape {(n_row, width)}, got {fixed.shape}; those that "
            f"supports hold at nodes are supports.fixed({structure.n_node})[:, :{width}]"
        )
    nodes = structure.nodes if rows is None else structure.nodes[rows.node_of_row]
    if number is None:
        dof_map = make_dof_map(fixed, rows, rigid=structure.rigid)
    else:
        dof_map = number(fixed, rows)
    dof_map = dof_map if unknowns else dof_map.without_unknowns
    return *split_indices((nodes, groups, state.restart)), dof_map


def require_symmetric_elements(structure: Structure, what: str) -> None:
    """Raise ValueError if a group of elements declares that its tangent is not symmetric.

    Args:
        structure: `Structure`.
        what: name of the calling function, for the message.
    """
    for where, group in structure.named_groups():
        if not group.symmetric:
            raise ValueError(
                f"{what}: elements{where} ({type(group).__name__}) has symmetric = False: its "
                "tangent stiffness is unsymmetric; use trace_path"
            )


def require_dense_memory(dof_map: DofMap, count: int, what: str) -> None:
    """Raise ValueError if `count` dense matrices of all unknowns do not fit into memory.

    Args:
        dof_map: numbering of the unknowns.
        count: how many matrices there are at once.
        what: name of the calling function, for the message.
    """
    n = len(dof_map.free)
    memory_limit.require_memory(
        count * n**2 * jax.dtypes.canonicalize_dtype(float).itemsize,
        f"{what}: {count} dense matrices of {n} unknowns",
        "leave out degrees of freedom by `fixed`, or take a coarser structure",
    )


def merge_solution_state(without_indices: _SplitModel, index_arrays: _IndexArrays) -> _SplitModel:
    """Return nodes, element groups and `RestartState` from what `split_solution_state` returns.

    All floats get the float type of the nodes.
    """
    frame = merge_indices(without_indices, index_arrays)
    return cast_floats(frame, jnp.asarray(frame[0]).dtype)


def _fixed_dofs_in_phase_of(state):
    """Return the degrees of freedom that supports hold in the phase that ended in `state`."""
    if all(fixed == state.fixed[-1] for fixed in state.fixed):
        return state.fixed[-1]
    if isinstance(state.phase, jax.core.Tracer):
        raise ValueError(
            "state: is traced, and supports change from phase to phase; give fixed=..."
        )
    return state.fixed[int(state.phase) + 1]
