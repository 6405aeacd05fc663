"""Prestress that a structure can carry in its geometry, equal within groups of elements.

Let ``A`` be the equilibrium matrix, and ``G`` [n_elem, n_group] one where an element belongs to a
group, else zero. Tensions ``G t`` are in equilibrium if ``A G t = 0``: the integral prestress modes
span the null space of ``A G``. Most structures with the symmetry of their groups have one mode. If
the tension of one group is given, the others are the least squares solution of a system of full
rank, which is differentiable.

Source: Yuan and Dong (2002, 2003), integral feasible prestress of cable domes.
"""

from __future__ import annotations

import jax
import jax.numpy as jnp
import numpy as np

from ..common import checks
from ..common.rules import Rule, nan_if_broken
from ..common.tree import pytree
from ..common.types import Array, ArrayLike, Float, Int, PyTree
from ..model.structure import Structure
from .equilibrium_matrix import (
    arrange_as_elements,
    equilibrium_matrix,
    links_and_tension_only,
    nodes_as_numpy,
    rank_tolerance,
    values_of_all_elements,
)


@pytree
class Prestress:
    """A prestress with equal tensions within groups: the result of `feasible_prestress`.

    Attributes:
        tension: tensions in the shape of the elements, each [n_elem], N, for
            `Phase(pretension=...)`.
        group_tension: tension of every group, [n_group], N.
        unbalanced: largest unbalanced force at a free degree of freedom, relative to the largest
            tension; of the order of rounding if the geometry has the symmetry of the groups.
        modes: states of self-stress with equal tensions within groups (integral prestress modes),
            an orthonormal basis, [n_mode, n_group]; None if the nodes were traced.

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
        """Number of independent states of self-stress with equal tensions within groups."""
        return len(self.modes)  # type: ignore[arg-type]  # None of traced nodes


def feasible_prestress(
    structure: Structure,
    groups: PyTree[Int[ArrayLike, " n_elem"]] | None = None,
    group: int | None = None,
    *,
    tension: Float[ArrayLike, ""] = 1.0,
    tol: float | None = None,
) -> Prestress:
    """Find tensions in self-equilibrium, equal within groups of elements, with every cable taut.

    If there are several such states (modes), a linear program combines them so that the smallest
    cable tension is as large as possible relative to the largest force.

    The result is differentiable with respect to the nodes and `tension`. Where the nodes are
    traced, give `group`. The number of modes and the signs are not checked there; check them once
    outside. There must be one mode; with several the result is NaN. Derivatives are those of the
    least squares solution. They are exact if the nodes keep the symmetry of the groups.

    Args:
        structure: `Structure` of `Bars` and `Cables`; its supports count.
        groups: group numbers from 0, [n_elem] of all elements group after group, or in the shape of
            the elements; elements with the same number have equal tensions. Default: every element
            is a group of its own. `symmetric_groups` finds them.
        group: number of the group whose tension is given; None: the largest force is given.

    Options:
        tension: tension of that group, N, negative for struts; without `group` the largest absolute
            force, N.
        tol: singular values up to `tol` times the largest count as zero, as in `self_stress`.

    Returns:
        `Prestress`.

    Raises:
        ValueError: no state of self-stress has equal tensions within the groups, or none has all
            cables taut (the message names the group); wrong group numbers.

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
    links, cable = links_and_tension_only(structure)
    group_number = _checked_group_numbers(structure, groups, len(links))
    n_group = group_number.max() + 1
    if group is not None and not 0 <= group < n_group:
        raise ValueError(f"group = {group}: there are groups 0 to {n_group - 1}")
    free = ~structure.held_displacements().ravel()
    membership = np.zeros((len(links), n_group))
    membership[np.arange(len(links)), group_number] = 1.0
    pulled = (membership * cable[:, None]).any(axis=0)
    modes, tol = None, rank_tolerance(structure, tol)
    if checks.array_if_known(structure.nodes) is None:
        if group is None:
            raise ValueError(
                "group: the nodes are traced by jax, so that signs cannot be checked; give the "
                "group whose tension is known"
            )
    else:
        nodes = nodes_as_numpy(structure, "feasible_prestress")
        sums = equilibrium_matrix(nodes, links)[0][free] @ membership
        modes = _null_space_basis(sums / np.sqrt(membership.sum(0)), tol) / np.sqrt(
            membership.sum(0)
        )
        taut = _combine_to_taut_state(modes, pulled)
        if group is None:
            group = int(np.abs(taut).argmax())
            tension = np.sign(taut[group]) * tension
        elif abs(taut[group]) <= 1e-9:
            raise ValueError(
                f"group = {group}: has no force in any feasible prestress; give another group"
            )
        else:
            text = f"with this tension in group {group}, cables would be in compression"
            forces = tension, taut[group]
            tension = nan_if_broken(
                Rule("tension", forces, lambda force, taut: force * taut <= 0, text)
            )
        modes = np.linalg.qr(modes.T)[0].T
        if len(modes) > 1:
            return _make_prestress(
                structure, free, links, group_number, taut / taut[group] * tension, modes
            )
    solved = _solve_other_groups(structure, free, links, membership, group, tension, tol)
    if isinstance(solved, jax.Array) and pulled.any():  # not checked above where nodes are traced
        solved = jnp.where(jnp.any(pulled & (solved <= 0)), jnp.nan, solved)
    return _make_prestress(structure, free, links, group_number, solved, modes)


def _checked_group_numbers(structure, groups, n_elem):
    """Return the group number of every element, [n_elem]; ValueError if `groups` is invalid."""
    if groups is None:
        return np.arange(n_elem)
    group_number = np.asarray(values_of_all_elements(structure, groups, "groups"))
    if not np.issubdtype(group_number.dtype, np.integer):
        raise ValueError(f"groups: expected integers, got {group_number.dtype}")
    if group_number.min() < 0:
        k = int(group_number.argmin())
        raise ValueError(f"groups[{k}] = {group_number[k]}: group numbers start at 0")
    empty = np.bincount(group_number) == 0
    if empty.any():
        raise ValueError(f"groups: no element is in group {int(empty.argmax())}")
    return group_number


def _null_space_basis(matrix, tol):
    """Return an orthonormal basis of the null space of a matrix, [n_mode, n_group].

    Singular values up to `tol` times the largest count as zero; ValueError if there is no such
    mode.
    """
    _, values, right = np.linalg.svd(matrix)
    rank = int((values > tol * values[0]).sum())
    if rank == matrix.shape[1]:
        raise ValueError(
            "groups: no state of self-stress has equal tensions within these groups (smallest "
            f"singular value {values[-1] / values[0]:.2g} of the largest, tol {tol:.2g}); the "
            "geometry or the groups must change"
        )
    return right[rank:]


def _combine_to_taut_state(modes, cable):
    """Combine states of self-stress to one in which all cables are in tension.

    If there are several, the smallest cable tension becomes as large as possible beside the largest
    force.

    Args:
        modes: basis of the states of self-stress, tensions [n_mode, n_group].
        cable: whether a group has cables, [n_group].

    Returns:
        Tensions of the groups, [n_group], scaled to a largest force of 1; the first state if there
            are no cables.

    Raises:
        ValueError: no combination has all cables in tension.
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
            raise ValueError(f"groups: the linear program found no prestress: {found.message}")
        state = found.x[:-1] @ modes
        if np.abs(state).max() < 1e-9:
            raise ValueError(
                f"groups: no combination of the {n_mode} states of self-stress has all cables in "
                "tension"
            )
        state = state / np.abs(state).max()
    loose = cable & (state <= 1e-9)
    if loose.any():
        k = int(np.flatnonzero(loose)[0])
        raise ValueError(
            f"groups: the cables of group {k} are not in tension in the only state of self-stress "
            f"(their force is {state[k]:.3g} times the largest)"
            if len(modes) == 1
            else f"groups: no combination of the {len(modes)} states of self-stress has the cables "
            f"of group {k} in tension"
        )
    return state


def _solve_other_groups(structure, free, links, membership, group, tension, tol):
    """Return the tensions of all groups, [n_group], N, from the `tension` of group number `group`.

    They balance each other at the free degrees of freedom, by least squares (QR). They are NaN,
    with NaN derivatives, if the other groups alone have a state of self-stress: then they are not
    unique. `membership` [n_elem, n_group] is 1 where an element belongs to a group.
    """
    nodes, xp = _nodes_and_array_module(structure.nodes, tension)
    sums = equilibrium_matrix(nodes, links)[0][free] @ membership.astype(nodes.dtype)
    rest = np.delete(np.arange(membership.shape[1]), group)
    given = xp.reshape(xp.asarray(tension, nodes.dtype), (1,))
    if not len(rest):
        return given
    orthogonal, upper = xp.linalg.qr(sums[:, rest])
    pivots = xp.abs(xp.diagonal(upper))
    unique = xp.where(xp.min(pivots) > tol * xp.max(pivots), 1.0, xp.nan).astype(nodes.dtype)
    others = xp.linalg.solve(upper, -(orthogonal.T @ (sums[:, group] * given[0])))
    return xp.concatenate([given, others * unique])[np.argsort(np.append(group, rest))]


def _nodes_and_array_module(nodes, tension):
    """Return the nodes, and the module to compute with: `jax.numpy` if one argument is of jax.

    `tension` is an array or a number; without jax arrays the module is `numpy`.
    """
    if isinstance(nodes, jax.Array) or isinstance(tension, jax.Array):
        return jnp.asarray(nodes), jnp
    return nodes, np


def _make_prestress(structure, free, links, group_number, group_tension, modes):
    """Return the `Prestress` with tensions `group_tension` of the groups, [n_group], N.

    `free` says which degrees of freedom are free, [3 n_node]; `links` and `group_number` are
    those of all elements; `modes` is the basis for the result, or None.
    """
    nodes, xp = _nodes_and_array_module(structure.nodes, group_tension)
    tension = xp.asarray(group_tension, nodes.dtype)[group_number]
    unbalanced = equilibrium_matrix(nodes, links)[0][free] @ tension
    return Prestress(
        tension=arrange_as_elements(structure, tension),
        group_tension=group_tension,
        unbalanced=xp.max(xp.abs(unbalanced)) / xp.max(xp.abs(tension)),
        modes=modes,
    )
