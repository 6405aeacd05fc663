"""Linear buckling: an estimate of the load factor at which the tangent becomes singular."""

from __future__ import annotations

import functools

import jax
import jax.numpy as jnp
import numpy as np

from .. import linear
from ..analysis.solution import Solution, State
from ..common import checks
from ..common.tree import Indices, copy_with, pytree
from ..common.types import Array, ArrayLike, Bool, Float
from ..elements.abilities import Hanging, is_one_sided
from ..elements.element import Element
from ..linear import unbatched
from ..mechanics.restart_state import initial_restart_state, make_system
from ..model.structure import Structure
from ..numerics.scaled import normalize_mode_shapes
from ..programs.program_calls import as_program
from .tangent import (
    merge_solution_state,
    require_dense_memory,
    require_symmetric_elements,
    split_solution_state,
    tangent_and_displacements,
    tangent_matrix,
)

_DENSE_MATRICES = 14  # dense matrices in memory at once, measured
# An eigenvalue counts as zero below this, times eps and the sums of which it is a difference: a
# sum of n rounded terms is wrong by up to n eps, mostly by far less.
_ROUNDING_FACTOR = 64


@pytree
class Buckling:
    """Linear buckling factors and shapes, lowest factor first: the result of `buckling_factor`.

    Attributes:
        factor: factor on the loads at which the tangent is singular, [n], -; inf where there is no
            such factor, NaN where there is no estimate.
        shapes: displacements, scaled to 1 at the node that moves most, [n, n_node, 3].
        semi_tangential: whether nodal moments without a potential act, so that the factors are
            those of semi-tangential moments (see `buckling_factor`), scalar bool.

    Example:
        >>> structure, phases = jc.scenes.von_mises_truss(load=100.0)
        >>> solution = jc.solve(structure, phases)
        >>> found = jc.stiffness.buckling_factor(structure, solution)
        >>> print(solution.status, found.factor.shape, found.shapes[0, 1])  # the apex goes down
        0 (1,) [0. 0. 1.]
    """

    factor: Float[Array, " n"]
    shapes: Float[Array, "n n_node 3"]
    semi_tangential: Bool[Array, ""]


def buckling_factor(
    structure: Structure,
    state: Solution | State,
    reference: Solution | State | None = None,
    n: int = 1,
    *,
    fixed: Bool[ArrayLike, "n_row n_freedom"] | None = None,
) -> Buckling:
    """Find the factors on the loads of a state at which it buckles, by linear theory.

    The tangent stiffness is assumed to change in proportion to the loads, from that of a reference
    to that of the state: ``K(f) = K_ref + f (K_state - K_ref)``. Its change contains the geometric
    stiffness. The results are the lowest factors ``f > 0`` with ``K(f) phi = 0``: with ``f`` times
    the loads the structure buckles. Laws that are not linear, and the sag of catenaries, enter by
    their tangents.

    The change of stiffness comes from displacements as well as from stress. Factors are exact where
    elements hardly rotate before the structure buckles. Otherwise they are an estimate, too high or
    too low. For a shallow truss that snaps through, small loads give 1.7 times the limit load. For
    a mast between slack guys whose top moves by 4 % of its height the factor is 1.15, although the
    mast carries 6 times the load: a stiff element that has rotated looks softer to first order. A
    rotation is large in this sense from about the square root of the element's strain. `trace_path`
    follows the exact path.

    Lateral buckling of slender I-beams is such a case: they are far stiffer about z than in
    torsion. For an HEA 200 of 8 m under equal end moments M, small M times its factor is 42.6 kN m;
    the classical moment ``pi/L sqrt(EIz GJ)`` is 85.7 kN m, and 107.4 kN m with the deflection
    before buckling, which is where `solve` finds it. Repeat the call at the load found, with
    a new analysis, until the factor is 1: there it is exact.

    With a `reference`, such as the prestressed state, factors multiply the loads added since, and
    the forces of the reference stay as they are. Without it, K_ref is that of the structure without
    any stress, straight between its initial nodes: all forces of the state grow in proportion,
    those of prestress too. This is no useful estimate for a net whose form changes with its forces.

    A pure function. Derivatives are those of simple eigenvalues; for equal eigenvalues the
    derivatives of the shapes are not finite. Dense, meant for some hundred unknowns.

    Args:
        structure: the `Structure` that was analysed.
        state: `Solution` (NaN if it has failed) or `State`.
        reference: `Solution` or `State` before the loads, ``jc.solve(structure, phases[:1])``;
            None for the structure without stress.
        n: number of factors; fewer if there are fewer unknowns.

    Options:
        fixed: degrees of freedom to leave out, as in `stiffness.tangent_stiffness`; default those
            held in `state`.

    Returns:
        `Buckling`. A factor is inf where the loads stiffen the structure, or change its stiffness
        by no more than rounding. It is below 1 where the state has buckled already. If the state is
        stable and the reference is not (such as a net without prestress), only factors above 1 are
        found. Factors are NaN where neither is stable (mechanisms). They are NaN, too, where cables
        are slack, or elements present, in only one of the two: the stiffness jumps in between.
        (Without a reference, slack cables and elements that are not present are left out.)

    Moments on nodes that rotate about several axes keep their direction, have no potential and make
    the tangent unsymmetric. The factors are then those of its symmetric part, that is of
    semi-tangential moments, which follow half of the rotation of their nodes (Ziegler 1968).
    `Buckling.semi_tangential` says so, and outside of transformations an `InputWarning`. This is
    the answer for moments that a pair of dead forces on a cross arm makes; moments about a fixed
    axis may let a free end flutter instead, at no load of divergence at all. Where supports hold
    the rotation about one of two axes, as a fork does, all kinds of moments agree and the tangent
    is symmetric: a strip under end moments in forks buckles at ``pi / L sqrt(EI GJ)``.

    Raises:
        ValueError: wrong arguments; follower loads, or elements that are not `symmetric`;
            catenaries under load, or slack elements that have no unstressed state
            (`Element.unstressed_state`), without a reference; too many unknowns for dense matrices
            in the memory there is.

    Example:
        A rigid strut of 2 m whose top is stayed by two cables of 4 m with 8 kN. It buckles out of
        their plane at ``2 N / l h`` = 8 kN, which is 4 times the load:

        >>> nodes = [[0.0, 0.0, 0.0], [0.0, 0.0, 2.0], [-4.0, 0.0, 2.0], [4.0, 0.0, 2.0]]
        >>> strut = jc.Bars([[0, 1]], axial_stiffness=1e12)
        >>> cables = jc.Cables([[1, 2], [1, 3]], axial_stiffness=1e6)
        >>> parts = {"cables": cables, "strut": strut}
        >>> structure = jc.Structure(nodes, parts, supports=jc.pinned([0, 2, 3]))
        >>> tight = jc.Phase(pretension={"cables": 8e3, "strut": None})
        >>> loaded = jc.Phase(loads=jc.NodalLoads([1], (0.0, 0.0, -2e3)))
        >>> reference = jc.solve(structure, tight)
        >>> solution = jc.solve(structure, loaded, start=reference)
        >>> found = jc.stiffness.buckling_factor(structure, solution, reference)
        >>> print(solution.status, jnp.round(found.factor, 5), found.shapes[0, 1])
        0 [4.] [0. 1. 0.]
    """
    checks.require_whole_number(n, "n")
    require_symmetric_elements(structure, "buckling_factor")
    without_indices, index_arrays, dof_map = split_solution_state(structure, state, fixed)
    require_dense_memory(dof_map, _DENSE_MATRICES, "buckling_factor")
    _refuse_follower_loads(without_indices[2], "state")
    catenary = any(isinstance(group, Hanging) for group in structure.groups)
    if reference is None and catenary and without_indices[2].loads:
        raise ValueError(
            "reference: missing; loads change the stiffness of catenaries, so that there is no "
            "unstressed state to compare with; give the state before the loads to be multiplied"
        )
    after, slack = _tangent_and_slack(without_indices, index_arrays, dof_map)
    if reference is None:
        pairs = _pairs_that_forbid_slack(structure, slack)
        bare = _unstressed_state_with_zero_loads(without_indices, index_arrays, slack)
        before = tangent_matrix((*without_indices[:2], bare), index_arrays, dof_map)
    else:
        if not isinstance(reference, Solution | State):
            raise ValueError(
                "reference: expected a Solution or its last, such as jc.solve(structure, "
                f"phases[:1]), got {type(reference).__name__}"
            )
        held = Indices(dof_map.fixed)
        reference_frame, reference_arrays, reference_freedoms = split_solution_state(
            structure, reference, held
        )
        _refuse_follower_loads(reference_frame[2], "reference")
        given = reference_frame, reference_arrays, reference_freedoms
        before, slack_before = _tangent_and_slack(*given)
        pairs = list(zip(slack_before, slack, strict=True))
        pairs += _pairs_of_presence_masks(reference_frame[2], without_indices[2])
    split = without_indices, index_arrays, dof_map
    sizes = {"n": min(n, len(after)), "n_node": structure.n_node}
    found = _find_buckling_modes(split, before, after, pairs, **sizes)
    if checks.array_if_known(found.semi_tangential) is not None and found.semi_tangential:
        if not _nodal_moments_act(without_indices, index_arrays):
            raise ValueError(
                "state: its tangent stiffness is unsymmetric although no moments act on nodes; if "
                "an element class of your own is the cause, declare symmetric = False in it "
                "(`elements.check` tests this)"
            )
        checks.warn_user(
            "state: moments that keep their direction act on nodes and have no potential; the "
            "factors are those of semi-tangential moments, which follow half of the rotation of "
            "their nodes (symmetric part of the tangent); trace_path follows the given moments"
        )
    return found


@functools.partial(as_program, static=("n", "n_node"))
def _find_buckling_modes(split, before, after, pairs, n, n_node):
    """Return the lowest `n` factors of a split state with their shapes, `Buckling`; a program.

    `before` and `after` are the tangents; factors are NaN unless the arrays of each of the `pairs`
    are equal.
    """
    symmetric = linear.is_symmetric(before) & linear.is_symmetric(after)
    factor, vectors = _solve_buckling_problem(before, after, n)
    alike = jnp.all(jnp.stack([jnp.all(jnp.equal(a, b)) for a, b in pairs] or [True]))
    moved = tangent_and_displacements(*split)[2][:n_node]
    shapes = jnp.moveaxis(jnp.tensordot(moved, vectors, 1), -1, 0)
    shapes = normalize_mode_shapes(shapes, vectors.T)
    return Buckling(jnp.where(alike, factor, jnp.nan), shapes, ~symmetric)


def _refuse_follower_loads(restart, name):
    """Raise ValueError if follower loads act in a state; `name` is its argument in the message."""
    if any(stack.follows for stack in restart.loads):
        raise ValueError(
            f"{name}: follower loads act on it; linear buckling multiplies loads that keep their "
            "direction; use trace_path"
        )


def _pairs_that_forbid_slack(structure, slack):
    """Return pairs (slack elements, False), whose two items must be equal: none may be slack.

    There is a pair for each group whose elements can be slack, but have no state that is slack and
    unstressed. `slack` has a boolean array [n_elem] for each group.

    Raises:
        ValueError: an element is slack, and its class has no method `unstressed_state`.
    """
    pairs = []
    for (where, group), own in zip(structure.named_groups(), slack, strict=True):
        if not is_one_sided(group) or type(group).unstressed_state is not Element.unstressed_state:
            continue
        pairs.append((own, np.zeros((), bool)))
        known = checks.array_if_known(own)
        if known is not None and known.any():
            raise ValueError(
                f"reference: missing; elements{where} ({type(group).__name__}) has slack elements, "
                "whose unstressed state is not known (no method `unstressed_state`); give the "
                "state before the loads to be multiplied"
            )
    return pairs


@as_program
def _nodal_moments_act(without_indices, index_arrays):
    """Return whether any node carries an external moment in a state; scalar bool; a program."""
    nodes, groups, restart = merge_solution_state(without_indices, index_arrays)
    system = make_system(nodes, groups, restart, None, None)
    moments = system.space.moments(system.load)
    return jnp.any(jnp.zeros(()) if moments is None else moments != 0)


def _pairs_of_presence_masks(first, second):
    """Return pairs (present in `first`, present in `second`), masks [n_elem], two `RestartState`.

    There is a pair for each group that has absent elements in either; a scalar True stands for a
    group whose elements are all present.
    """
    pairs = []
    for a, b in zip(first.states, second.states, strict=True):
        if a.present is not None or b.present is not None:  # None: all are present
            pairs.append(
                tuple(np.ones((), bool) if x is None else x for x in (a.present, b.present))
            )
    return pairs


@as_program
def _tangent_and_slack(without_indices, index_arrays, dof_map):
    """Return the tangent of a state, and which elements are slack, [n_elem] bool for each group."""
    stiffness = tangent_matrix(without_indices, index_arrays, dof_map)
    nodes, groups, restart = merge_solution_state(without_indices, index_arrays)
    return stiffness, make_system(nodes, groups, restart, None, None).slack(restart.motion)


def _unstressed_state_with_zero_loads(without_indices, index_arrays, slack):
    """Return the `RestartState` of the structure without stress, with loads times zero.

    It keeps the loads' arrays, so that one program gives both tangents. Slack elements remain
    slack; others get the distance of their initial nodes as unstressed length.
    """
    restart = without_indices[2]
    bare, factors = _unstressed_state(without_indices, index_arrays, slack)
    pairs = zip(restart.loads, factors, strict=True)
    return copy_with(bare, loads=[copy_with(stack, factors=zero) for stack, zero in pairs])


@as_program
def _unstressed_state(without_indices, index_arrays, slack):
    """Return the `RestartState` without stress and loads, and zeros for the factors of the loads.

    Elements that are `slack`, [n_elem] bool per group, are slack in it; a program.
    """
    nodes, groups, restart = merge_solution_state(without_indices, index_arrays)
    bare = initial_restart_state(nodes, groups)
    states = []
    present = [state.present for state in restart.states]
    for group, is_slack, there in zip(groups, slack, present, strict=True):
        state = group.unstressed_state(nodes[group.links], is_slack)
        states.append(state if there is None else copy_with(state, present=there))
    return copy_with(bare, states=states), [0.0 * stack.factors for stack in restart.loads]


def _is_positive_definite(matrix):
    """Return whether the lowest eigenvalue of a symmetric matrix is positive beyond rounding."""
    values = unbatched.eigvalsh(jax.lax.stop_gradient(matrix))
    return values[0] > 4 * len(values) * jnp.finfo(matrix.dtype).eps * values[-1]


def _solve_buckling_problem(before, after, n):
    """Find the lowest `n` factors f at which ``K_ref + f (K_state - K_ref)`` is singular.

    Solves ``(K_state - K_ref) phi = kappa M phi``. If K_ref (`before`) is positive definite, M is
    K_ref and ``f = -1 / kappa``; else M is K_state (`after`) and ``f = 1 - 1 / kappa``.

    Returns:
        The factors, [n], inf or NaN where there is none, and their vectors phi, [n_free, n].
    """
    before, after = 0.5 * (before + before.T), 0.5 * (after + after.T)
    change = after - before
    first, second = _is_positive_definite(before), _is_positive_definite(after)
    identity = jnp.eye(len(after), dtype=after.dtype)
    known = first | second
    metric = jnp.where(first, before, jnp.where(second, after, identity))
    change = jnp.where(known, change, identity)
    root = unbatched.cholesky(metric)
    half = unbatched.solve_triangular(root, change)
    standard = unbatched.solve_triangular(root, half.T)
    kappa, vectors = unbatched.eigh(0.5 * (standard + standard.T))
    modes = unbatched.solve_triangular(root, vectors[:, :n], transposed=True)
    kappa = kappa[:n]
    # the change of stiffness is a difference of two sums, each with rounding errors
    size = jnp.abs(jax.lax.stop_gradient(modes))
    rounding = jnp.sum(size * ((jnp.abs(before) + jnp.abs(after)) @ size), axis=0)
    softens = kappa < -_ROUNDING_FACTOR * jnp.finfo(kappa.dtype).eps * rounding
    factor = jnp.where(first, 0.0, 1.0) - 1 / jnp.where(softens, kappa, -1.0)
    factor = jnp.where(softens, factor, jnp.inf)
    return jnp.where(known, factor, jnp.nan), modes
