"""Prestress that a structure can carry in its geometry, equal within groups of elements.

Let ``G`` [n_elem, n_group] be one where an element belongs to a group, else zero. Tensions ``G t``
are in equilibrium if ``A G t = 0``: the null space of ``A G`` is spanned by the integral prestress
modes. Most structures with the symmetry of their groups have one mode. If the tension of one group
is given, the others are the least squares solution of a system of full rank, which is
differentiable.

Source: Yuan and Dong (2002, 2003), integral feasible prestress of cable domes.
"""

from __future__ import annotations

import jax
import jax.numpy as jnp
import numpy as np

from ..common import checks
from ..common.rules import Rule, or_nan
from ..common.tree import pytree
from ..common.types import Array, ArrayLike, Float, Int, PyTree
from ..model.structure import Structure
from ._balance import arranged, balance, host_nodes, members, of_all_members, rank_tolerance


@pytree
class Prestress:
    """A prestress with equal tensions within groups: the result of `feasible_prestress`.

    Attributes:
        tension: tensions in the shape of the elements, each [n_elem], N, for
            `Phase(pretension=...)`.
        group_tension: tension of every group, [n_group], N.
        unbalanced: largest unbalanced force at a free freedom over the largest tension; of the
            order of rounding if the geometry has the symmetry of the groups.
        modes: integral prestress modes, an orthonormal basis, [n_mode, n_group]; None if the nodes
            were traced.

    Example:
        >>> structure, _ = jc.scenes.simplex()
        >>> found = jc.forms.feasible_prestress(structure, group=9, tension=1e3)
        >>> found.n_mode, bool(found.unbalanced < 1e-12)
        (1, True)
        >>> print(np.round(found.tension["verticals"], 6))
        [1000. 1000. 1000.]
    """

    tension: PyTree[Float[Array | np.ndarray, " n_elem"]]
    group_tension: Float[Array | np.ndarray, " n_group"]
    unbalanced: Float[Array, ""] | float
    modes: Float[np.ndarray, "n_mode n_group"] | None = None

    @property
    def n_mode(self) -> int:
        """Number of independent integral prestress modes."""
        return len(self.modes)  # type: ignore[arg-type]  # None of traced nodes


def feasible_prestress(
    structure: Structure,
    groups: PyTree[Int[ArrayLike, " n_elem"]] | None = None,
    group: int | None = None,
    *,
    tension: Float[ArrayLike, ""] = 1.0,
    tol: float | None = None,
) -> Prestress:
    """Self-equilibrated tensions, equal within groups, with every cable taut.

    If there are several modes, a linear program combines them so that the smallest cable tension is
    as large as possible relative to the largest force.

    The result is differentiable in the nodes and in `tension`. Where the nodes are traced, `group`
    must be given, and neither the number of modes nor the signs are checked: check them once
    outside. There must be one mode (with several the result is NaN). Derivatives are those of the
    least squares solution, exact if nodes change without losing the symmetry of the groups.

    Args:
        structure: `Structure` of `Bars` and `Cables`; its supports count.
        groups: group numbers from 0, [n_elem] of all elements group after group, or in the shape of
            the elements; elements with the same number have equal tensions. Default: every element
            is a group of its own. `symmetric_groups` finds them.
        group: number of the group whose tension is given, or None to give the largest force.

    Options:
        tension: tension of that group, N, negative for struts; or the largest absolute force, N.
        tol: singular values up to `tol` times the largest count as zero, as in `self_stress`.

    Returns:
        `Prestress`.

    Raises:
        ValueError: no state of self-stress is equal within the groups, or none has all cables taut
            (the message names the group); wrong group numbers.

    Source: Yuan and Dong (2002, 2003).

    Example:
        A prism with 1 kN in its verticals; struts have the same force density and are longer:

        >>> structure, _ = jc.scenes.simplex()
        >>> groups = jc.forms.symmetric_groups(structure, fold=3)
        >>> number = int(groups["verticals"][0])
        >>> found = jc.forms.feasible_prestress(structure, groups, group=number, tension=1e3)
        >>> print({kind: round(float(force[0]), 1) for kind, force in found.tension.items()})  # N
        {'struts': -1541.4, 'triangles': 630.2, 'verticals': 1000.0}
    """
    links, cable = members(structure)
    number = _numbers(structure, groups, len(links))
    n_group = number.max() + 1
    if group is not None and not 0 <= group < n_group:
        raise ValueError(f"group = {group}: there are groups 0 to {n_group - 1}")
    free = ~structure.held().ravel()
    spread = np.zeros((len(links), n_group))
    spread[np.arange(len(links)), number] = 1.0
    pulled = (spread * cable[:, None]).any(axis=0)
    modes, tol = None, rank_tolerance(structure, tol)
    if checks.concrete(structure.nodes) is None:
        if group is None:
            raise ValueError("group: must be given where nodes are traced")
    else:
        nodes = host_nodes(structure, "feasible_prestress")
        sums = balance(nodes, links)[0][free] @ spread
        modes = _null(sums / np.sqrt(spread.sum(0)), tol) / np.sqrt(spread.sum(0))
        taut = _taut(modes, pulled)
        if group is None:
            group = int(np.abs(taut).argmax())
            tension = np.sign(taut[group]) * tension
        elif abs(taut[group]) <= 1e-9:
            raise ValueError(f"group = {group}: has no force in the prestress; give another group")
        else:
            text = f"with group {group} so, cables would be in compression"
            forces = tension, taut[group]
            tension = or_nan(Rule("tension", forces, lambda force, taut: force * taut <= 0, text))
        modes = np.linalg.qr(modes.T)[0].T
        if len(modes) > 1:
            return _result(structure, free, links, number, taut / taut[group] * tension, modes)
    solved = _others(structure, free, links, spread, group, tension, tol)
    if isinstance(solved, jax.Array) and pulled.any():  # not checked above where nodes are traced
        solved = jnp.where(jnp.any(pulled & (solved <= 0)), jnp.nan, solved)
    return _result(structure, free, links, number, solved, modes)


def _numbers(structure, groups, n_elem):
    """Group number of every element, [n_elem], checked."""
    if groups is None:
        return np.arange(n_elem)
    number = np.asarray(of_all_members(structure, groups, "groups"))
    if not np.issubdtype(number.dtype, np.integer):
        raise ValueError(f"groups: expected integers, got {number.dtype}")
    if number.min() < 0:
        k = int(number.argmin())
        raise ValueError(f"groups[{k}] = {number[k]}: group numbers start at 0")
    empty = np.bincount(number) == 0
    if empty.any():
        raise ValueError(f"groups: no element is in group {int(empty.argmax())}")
    return number


def _null(matrix, tol):
    """Orthonormal basis of the null space, [n_mode, n_group]; ValueError if it is empty."""
    _, values, right = np.linalg.svd(matrix)
    rank = int((values > tol * values[0]).sum())
    if rank == matrix.shape[1]:
        raise ValueError(
            "groups: no state of self-stress has equal tensions within these groups (smallest "
            f"singular value {values[-1] / values[0]:.2g} of the largest, tol {tol:.2g}); the "
            "geometry or the groups must change"
        )
    return right[rank:]


def _taut(modes, cable):
    """Combination of the modes with all cables taut, largest force 1, [n_group].

    Without cables it is the first mode.
    """
    if len(modes) == 1 or not cable.any():
        state = modes[0] / np.abs(modes[0]).max()
        if cable.any() and state[cable].sum() < 0:
            state = -state
        elif not cable.any() and state[np.abs(state).argmax()] < 0:
            state = -state
    else:
        # unknowns: factors of the modes, and t, the smallest cable tension; forces from -1 to 1
        from scipy.optimize import linprog

        n_mode, cable_modes = len(modes), modes[:, cable].T
        zero = np.zeros((modes.shape[1], 1))
        found = linprog(
            np.append(np.zeros(n_mode), -1.0),
            A_ub=np.block(
                [[-cable_modes, np.ones((len(cable_modes), 1))], [modes.T, zero], [-modes.T, zero]],
            ),
            b_ub=np.concatenate([np.zeros(len(cable_modes)), np.ones(2 * modes.shape[1])]),
            bounds=[(None, None)] * n_mode + [(None, 1.0)],
        )
        if not found.success:
            raise ValueError(f"groups: no prestress was found: {found.message}")
        state = found.x[:-1] @ modes
        if np.abs(state).max() < 1e-9:
            raise ValueError(
                f"groups: none of the {n_mode} states of self-stress and their combinations has "
                "all cables in tension"
            )
        state = state / np.abs(state).max()
    loose = cable & (state <= 1e-9)
    if loose.any():
        k = int(np.flatnonzero(loose)[0])
        raise ValueError(
            f"groups: the cables of group {k} are not in tension in any prestress "
            f"({state[k]:.3g} of the largest force)"
            if len(modes) == 1
            else f"groups: no combination of {len(modes)} states has group {k} in tension"
        )
    return state


def _others(structure, free, links, spread, group, tension, tol):
    """Tensions of all groups, [n_group], N, from that of one group: least squares by QR.

    The other tensions are NaN, with NaN derivatives, if these groups alone have a state of
    self-stress.
    """
    nodes, xp = _numbers_of(structure.nodes, tension)
    sums = balance(nodes, links)[0][free] @ spread.astype(nodes.dtype)
    rest = np.delete(np.arange(spread.shape[1]), group)
    given = xp.reshape(xp.asarray(tension, nodes.dtype), (1,))
    if not len(rest):
        return given
    orthogonal, upper = xp.linalg.qr(sums[:, rest])
    pivots = xp.abs(xp.diagonal(upper))
    unique = xp.where(xp.min(pivots) > tol * xp.max(pivots), 1.0, xp.nan).astype(nodes.dtype)
    others = xp.linalg.solve(upper, -(orthogonal.T @ (sums[:, group] * given[0])))
    return xp.concatenate([given, others * unique])[np.argsort(np.append(group, rest))]


def _numbers_of(nodes, tension):
    """Nodes, and the module for them: jax.numpy if nodes or tension are a jax array, else NumPy."""
    if isinstance(nodes, jax.Array) or isinstance(tension, jax.Array):
        return jnp.asarray(nodes), jnp
    return nodes, np


def _result(structure, free, links, number, group_tension, modes):
    """The `Prestress` of tensions of all groups."""
    nodes, xp = _numbers_of(structure.nodes, group_tension)
    tension = xp.asarray(group_tension, nodes.dtype)[number]
    unbalanced = balance(nodes, links)[0][free] @ tension
    return Prestress(
        tension=arranged(structure, tension),
        group_tension=group_tension,
        unbalanced=xp.max(xp.abs(unbalanced)) / xp.max(xp.abs(tension)),
        modes=modes,
    )
