"""The tangent stiffness of a state that an analysis ended in."""

from __future__ import annotations

from typing import TypeAlias

import jax
import jax.numpy as jnp
import numpy as np

from ..analysis.presence import idle_of
from ..analysis.solution import Solution, State
from ..common import memory
from ..common.tree import cast, fill, thaw
from ..common.types import Array, ArrayLike, Bool, Float
from ..elements.element import Element
from ..mechanics.carry import Carry, make_system
from ..model.structure import Structure
from ..model.supports import Fixed
from ..model.topology import require_same
from ..spaces.freedoms import Freedoms, number_freedoms

_Frame: TypeAlias = "tuple[Float[Array, 'n_row 3'], list[Element], Carry]"
_Indices: TypeAlias = "list[np.ndarray]"


def tangent_of(
    structure: Structure,
    state: Solution | State,
    fixed: Bool[ArrayLike, "n_row n_freedom"] | None = None,
) -> Float[Array, "n_free n_free"]:
    """Dense tangent stiffness at the state of a solution, by autodiff of the element forces.

    A state is stable if its tangent is positive definite. Slack cables give no stiffness. This is a
    pure function, which can be transformed like `solve`.

    Args:
        structure: the `Structure` that was analysed.
        state: `Solution` (its last converged state is used) or `State`.
        fixed: freedoms to leave out, [n_node, 3] bool, in a structure with beams [n_row, 6];
            default those held in the phase of the state. All False gives the tangent of the
            structure without supports.

    Returns:
        [n_free, n_free], N/m; unknowns node by node, x, y, z. With beams, spins follow the three
        displacements of a node, times a length (`spaces.RigidNodes.arm`).

    Raises:
        ValueError: not a state, or `fixed` of the wrong shape.

    Example:
        ``2 (EA/L0 c^2 + N/l (1 - c^2))`` in x, y and z, with the direction cosine c of the cables:

        >>> nodes = [[-4.0, 0.0, 3.0], [0.0, 0.0, 0.0], [4.0, 0.0, 3.0]]
        >>> cables = jc.Cables([[0, 1], [1, 2]], axial_stiffness=1e5)
        >>> structure = jc.Structure(nodes, cables, supports=jc.pinned([0, 2]))
        >>> weight = jc.NodalLoads([1], (0.0, 0.0, -600.0))
        >>> solution = jc.solve(structure, jc.Phase(pretension=500.0, loads=weight))
        >>> tangent = jc.stiffness.tangent_of(structure, solution)
        >>> print(solution.status, jnp.round(jnp.diagonal(tangent), 3))  # N/m
        0 [25800.   200. 14600.]
    """
    at = prepared(structure, state, fixed)
    require_memory(at[2], 2, "tangent_of")
    return tangent_at(*at)


@jax.jit
def tangent_at(thawed, arrays, freedoms):
    """Tangent stiffness from the results of `prepared`, [n_free, n_free], N/m."""
    nodes, groups, carry = filled(thawed, arrays)
    system = make_system(nodes, groups, carry, carry.motion, freedoms)
    return system.tangent(carry.motion)


@jax.jit
def displaced_by(
    thawed: _Frame, arrays: _Indices, freedoms: Freedoms
) -> Float[Array, "n_row 3 n_free"]:
    """Displacements of all rows per unknown, [n_row, 3, n_free], from the results of `prepared`."""
    nodes, groups, carry = filled(thawed, arrays)
    system = make_system(nodes, groups, carry, carry.motion, freedoms)
    return system.displaced_by(carry.motion)


def prepared(
    structure: Structure,
    state: Solution | State,
    fixed: Bool[ArrayLike, "n_row n_freedom"] | None = None,
) -> tuple[_Frame, _Indices, Freedoms]:
    """Arguments of `tangent_at`: (nodes, groups, carry) thawed, index arrays, freedoms."""
    state = state.last if isinstance(state, Solution) else state
    if not isinstance(state, State):
        raise ValueError(f"state: expected a Solution or its last, got {type(state).__name__}")
    require_same(structure, state.topology, "state")
    rows, groups = structure.rows()
    held = state.fixed[-1] if fixed is not None else _held(state)
    fixed = held if fixed is None else Fixed(np.asarray(fixed, bool), held.axes)
    idle = idle_of(structure, state.carry.states)
    if idle is not None:
        fixed = Fixed(fixed.array | idle, fixed.axes, fixed.spins)
    if fixed.shape != state.fixed[-1].shape:
        raise ValueError(
            f"fixed: expected booleans of shape {state.fixed[-1].shape}, got {fixed.shape}"
        )
    nodes = structure.nodes if rows is None else structure.nodes[rows.node]
    freedoms = number_freedoms(fixed, rows, rigid=structure.rigid)
    return *thaw((nodes, groups, state.carry)), freedoms


def require_symmetric(structure: Structure, what: str) -> None:
    """Raise ValueError if elements of a structure have an unsymmetric tangent.

    Args:
        structure: `Structure`.
        what: needs a symmetric tangent, in words; begins the message.
    """
    for where, group in structure.named_groups():
        if not group.symmetric:
            raise ValueError(
                f"{what}: elements{where} ({type(group).__name__}) has symmetric = False, and the "
                "tangent stiffness no potential; trace_path takes any elements"
            )


def require_memory(freedoms: Freedoms, count: int, what: str) -> None:
    """Raise ValueError if dense matrices of all unknowns do not fit into memory.

    Args:
        freedoms: numbering of the unknowns.
        count: how many matrices there are at once.
        what: needs them, in words; begins the message.
    """
    n = len(freedoms.free)
    memory.require(
        count * n**2 * jnp.zeros(0).dtype.itemsize,
        f"{what}: {count} dense matrices of {n} unknowns",
        "hold more freedoms by `fixed`, or take a coarser structure",
    )


def filled(thawed: _Frame, arrays: _Indices) -> _Frame:
    """Nodes, groups and carry of `prepared` with index arrays, floats in the dtype of the nodes."""
    frame = fill(thawed, arrays)
    return cast(frame, jnp.asarray(frame[0]).dtype)


def _held(state):
    """Freedoms held in the phase that a state belongs to, `Indices`."""
    if all(fixed == state.fixed[-1] for fixed in state.fixed):
        return state.fixed[-1]
    if isinstance(state.phase, jax.core.Tracer):
        raise ValueError("state: supports change and the state is traced; give fixed=...")
    return state.fixed[int(state.phase) + 1]
