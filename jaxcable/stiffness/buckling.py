"""Linear buckling: an estimate of the load factor at which the tangent becomes singular."""

from __future__ import annotations

import functools

import jax
import jax.numpy as jnp

from .. import linear
from ..analysis.solution import Solution, State
from ..common import checks
from ..common.tree import Indices, copy, pytree
from ..common.types import Array, ArrayLike, Bool, Float
from ..elements.abilities import Sagging
from ..elements.element import Element
from ..linear import unbatched
from ..mechanics.carry import make_system, unloaded
from ..model.structure import Structure
from ..numerics.scaled import unit_shapes
from .tangent import (
    displaced_by,
    filled,
    prepared,
    require_memory,
    require_symmetric,
    tangent_at,
)

_DENSE = 14  # matrices at once, measured
_ROUNDING = 64  # an eigenvalue below this, times eps and the sums it is a difference of, is zero


@pytree
class Buckling:
    """Buckling factors and shapes, lowest first.

    Attributes:
        factor: factor on the loads at which the tangent is singular, [n], -; inf where there is no
            such factor, NaN where there is no estimate.
        shapes: displacements, scaled to 1 at the node that moves most, [n, n_node, 3].

    Example:
        >>> structure, phases = jc.scenes.von_mises_truss(load=100.0)
        >>> solution = jc.solve(structure, phases)
        >>> found = jc.stiffness.buckling_factor(structure, solution)
        >>> print(solution.status, found.factor.shape, found.shapes[0, 1])  # the apex goes down
        0 (1,) [0. 0. 1.]
    """

    factor: Float[Array, " n"]
    shapes: Float[Array, "n n_node 3"]


def buckling_factor(
    structure: Structure,
    state: Solution | State,
    reference: Solution | State | None = None,
    n: int = 1,
    *,
    fixed: Bool[ArrayLike, "n_row n_freedom"] | None = None,
) -> Buckling:
    """Factors on the loads of a state at which it buckles, by linear theory.

    The tangent stiffness is taken to change in proportion to the loads, from that of a reference
    to that of the state: ``K(f) = K_ref + f (K_state - K_ref)``. The results are the lowest factors
    ``f > 0`` with ``K(f) phi = 0``: with ``f`` times the loads the structure buckles. Laws that are
    not linear, and the sag of catenaries, enter by their tangents.

    The change of stiffness comes from displacements as well as from stress. Factors are exact where
    elements hardly turn before the structure buckles, and an estimate otherwise, which may be too
    high or too low. From small loads it is 1.7 times the limit load of a shallow truss that snaps.
    For a mast between slack guys whose top moves by 4 % of its height it is 1.15 although the mast
    carries 6 times the load, because a stiff element that has turned looks softer to first order. A
    turn is large in this sense from about the square root of the element's strain. `trace_path`
    follows the exact path.

    With a `reference`, such as the prestressed state, factors multiply the loads added since, and
    the forces of the reference stay as they are. Without it, K_ref is that of the structure without
    any stress, straight between its initial nodes: all forces of the state grow in proportion,
    those of prestress too. This is no useful estimate for a net whose form changes with its forces.

    A pure function. Derivatives are those of simple eigenvalues; for equal eigenvalues the
    derivatives of the shapes are not finite. Dense, meant for some hundred unknowns.

    Args:
        structure: the `Structure` that was analysed.
        state: `Solution` (its last converged state is used) or `State`.
        reference: `Solution` or `State` before the loads, ``jc.solve(structure, phases[:1])``;
            None for the structure without stress.
        n: number of factors; fewer if there are fewer freedoms.

    Options:
        fixed: freedoms to leave out, as in `stiffness.tangent_of`; default those held in `state`.

    Returns:
        `Buckling`. A factor is inf where the loads stiffen the structure, or change its stiffness
        by no more than rounding. It is below 1 where the state has buckled already. If the state is
        stable and the reference is not (such as a net without prestress), only factors above 1 are
        found. Factors are NaN where neither is stable (mechanisms), and where cables are slack, or
        elements there, in one of the two only, since the stiffness jumps in between. (Without a
        reference slack cables and elements that are not there are left out.)

    Moments on nodes that rotate about several axes keep their direction and have no potential. The
    factors are those of the symmetric part of the tangent: of semi-tangential moments, which turn
    with half of the rotation of their nodes (Ziegler 1968). An `InputWarning` says so, outside of
    transformations.

    Raises:
        ValueError: wrong arguments; following loads, or elements that are not `symmetric`;
            catenaries under load, or slack elements that cannot be made unstressed
            (`Element.unstressed`), without a reference; more unknowns than dense matrices have
            memory for.

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
    checks.whole(n, "n")
    require_symmetric(structure, "buckling_factor")
    thawed, arrays, freedoms = prepared(structure, state, fixed)
    require_memory(freedoms, _DENSE, "buckling_factor")
    _refuse_following(thawed[2], "state")
    catenary = any(isinstance(group, Sagging) for group in structure.groups)
    if reference is None and catenary and thawed[2].loads:
        raise ValueError(
            "reference: missing; catenaries under load have no stiffness in common with those "
            "without, give the state before the loads to be multiplied"
        )
    after, slack = tangent_at(thawed, arrays, freedoms), _slack(thawed, arrays)
    alike: Bool[ArrayLike, ""]
    if reference is None:
        alike = _have_unstressed(structure, slack)
        bare = _without_stress(thawed, arrays, slack)
        before = tangent_at((*thawed[:2], bare), arrays, freedoms)
    else:
        if not isinstance(reference, Solution | State):
            raise ValueError(
                "reference: expected a Solution or its last, such as jc.solve(structure, "
                f"phases[:1]), got {type(reference).__name__}"
            )
        held = Indices(freedoms.fixed)
        reference_frame, reference_arrays, reference_freedoms = prepared(structure, reference, held)
        _refuse_following(reference_frame[2], "reference")
        before = tangent_at(reference_frame, reference_arrays, reference_freedoms)
        pairs = zip(_slack(reference_frame, reference_arrays), slack, strict=True)
        alike = jnp.all(jnp.stack([jnp.all(a == b) for a, b in pairs]))
        alike &= _same_elements(reference_frame[2], thawed[2])
    symmetric = linear.is_symmetric(before) & linear.is_symmetric(after)
    if checks.concrete(symmetric) is not None and not symmetric:
        if not _has_moments(thawed, arrays):
            raise ValueError(
                "state: its tangent stiffness is unsymmetric, and no moments act on nodes; a class "
                "of elements of your own has to say symmetric = False (`elements.check`)"
            )
        checks.suspect(
            "state: moments that keep their direction act on nodes and have no potential; the "
            "factors are those of moments that turn with half of the rotation of their nodes "
            "(semi-tangential), by the symmetric part of the tangent; trace_path takes any loads"
        )
    factor, vectors = _solve(before, after, min(n, len(after)))
    factor = jnp.where(alike, factor, jnp.nan)
    moved = displaced_by(thawed, arrays, freedoms)[: structure.n_node]
    shapes = jnp.moveaxis(jnp.tensordot(moved, vectors, 1), -1, 0)
    return Buckling(factor, unit_shapes(shapes, vectors.T))


def _refuse_following(carry, name):
    """Raise ValueError if following loads act."""
    if any(stack.follows for stack in carry.loads):
        raise ValueError(
            f"{name}: loads that follow act on it; linear buckling multiplies loads that keep "
            "their direction, trace_path takes any"
        )


def _have_unstressed(structure, slack):
    """Whether slack elements have a state without stress in which they are slack.

    Raises:
        ValueError: they are known to be slack and have none.
    """
    sound = jnp.ones((), bool)
    for (where, group), own in zip(structure.named_groups(), slack, strict=True):
        if not group.tension_only or type(group).unstressed is not Element.unstressed:
            continue
        sound &= ~jnp.any(own)
        known = checks.concrete(own)
        if known is not None and known.any():
            raise ValueError(
                f"reference: missing; elements{where} ({type(group).__name__}) has slack elements "
                "and no method `unstressed`, give the state before the loads to be multiplied"
            )
    return sound


@jax.jit
def _has_moments(thawed, arrays):
    """Whether moments act on nodes in a state, scalar bool."""
    nodes, groups, carry = filled(thawed, arrays)
    system = make_system(nodes, groups, carry, None, None)
    moments = system.space.moments(system.load)
    return jnp.any(jnp.zeros(()) if moments is None else moments != 0)


def _same_elements(first, second):
    """Whether the same elements are there in two carries; None in a state means all of them."""
    same: Bool[ArrayLike, ""] = True
    for a, b in zip(first.states, second.states, strict=True):
        if a.present is not None or b.present is not None:
            there = [jnp.asarray(True if x is None else x) for x in (a.present, b.present)]
            same &= jnp.all(there[0] == there[1])
    return same


@jax.jit
def _slack(thawed, arrays):
    """Slack elements of a state, one boolean array [n_elem] per group."""
    nodes, groups, carry = filled(thawed, arrays)
    return make_system(nodes, groups, carry, None, None).slack(carry.motion)


def _without_stress(thawed, arrays, slack):
    """`Carry` of the structure without stress: every element as long as its chord, or slack.

    It has the loads of the state times zero, so that one program serves for both tangents.
    """
    bare, carry = _bare(thawed, arrays, slack), thawed[2]
    amounts = [copy(amount, factors=0.0 * amount.factors) for amount in carry.amounts]
    return copy(bare, loads=carry.loads, amounts=amounts)


@jax.jit
def _bare(thawed, arrays, slack):
    """`Carry` of the structure without stress and without loads."""
    nodes, groups, carry = filled(thawed, arrays)
    bare = unloaded(nodes, groups)
    states = []
    present = [state.present for state in carry.states]
    for group, is_slack, there in zip(groups, slack, present, strict=True):
        state = group.unstressed(nodes[group.links], is_slack)
        states.append(state if there is None else copy(state, present=there))
    return copy(bare, states=states)


@jax.jit
def _stable(matrix):
    """Whether a symmetric matrix is positive definite beyond its rounding."""
    values = unbatched.eigvalsh(jax.lax.stop_gradient(matrix))
    return values[0] > 4 * len(values) * jnp.finfo(matrix.dtype).eps * values[-1]


@functools.partial(jax.jit, static_argnames=("n",))
def _solve(before, after, n):
    """The lowest `n` factors and their vectors [n_free, n].

    M is K_ref if that is stable, else K_state. With ``(K_state - K_ref) phi = kappa M phi``, K(f)
    is singular at ``f = -1 / kappa`` if M is K_ref, and at ``f = 1 - 1 / kappa`` if M is K_state.
    """
    before, after = 0.5 * (before + before.T), 0.5 * (after + after.T)
    change = after - before
    first, second = _stable(before), _stable(after)
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
    softens = kappa < -_ROUNDING * jnp.finfo(kappa.dtype).eps * rounding
    factor = jnp.where(first, 0.0, 1.0) - 1 / jnp.where(softens, kappa, -1.0)
    factor = jnp.where(softens, factor, jnp.inf)
    return jnp.where(known, factor, jnp.nan), modes
