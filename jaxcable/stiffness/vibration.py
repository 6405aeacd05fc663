"""Small free vibrations about a loaded state."""

from __future__ import annotations

import functools
from collections.abc import Sequence
from typing import Literal

import jax
import jax.numpy as jnp
import numpy as np
from jax import lax

from ..analysis.solution import Solution, State
from ..common import checks
from ..common.rules import nan_if_broken, not_negative, positive
from ..common.tree import pytree
from ..common.types import Array, ArrayLike, Bool, Float
from ..elements.abilities import Hanging
from ..linear import unbatched
from ..loads.masses import STANDARD_GRAVITY, PointMasses
from ..mechanics.elementwise import evaluate_elements
from ..mechanics.restart_state import make_system
from ..model.structure import Structure
from ..numerics.scaled import normalize_mode_shapes
from ..programs.program_calls import as_program
from .tangent import (
    merge_solution_state,
    require_dense_memory,
    require_symmetric_elements,
    split_solution_state,
    tangent_and_displacements,
)

# Smallest w^2, over a mean w^2, for which no shift is needed: a slower mode, such as a mechanism,
# would drown the others in rounding.
_SLOW = 1e-6
_SHIFT = 1e-4  # smallest shift, over a mean w^2: modes a million times slower keep ten digits
_DENSE_MATRICES = 15  # dense matrices in memory at once, measured
_DISTRIBUTIONS = ("lumped", "consistent", "mean")
# A mode has no mass if its mu, which is 1 / w^2, is below this times eps and the largest mu: it is
# then rounding. Modes faster than the slowest by 1 / sqrt(1e3 eps), two million, are lost with it.
_MASSLESS = 1e3


@pytree
class Vibration:
    """Natural frequencies and modes, slowest first: the result of `natural_frequencies`.

    Attributes:
        frequency: natural frequencies, [n], Hz; NaN for a mode without positive stiffness (the
            state is unstable or a mechanism: see `squared`).
        squared: squared circular frequencies, [n], 1/s2; negative where the state is unstable.
        shapes: displacements, scaled to 1 at the node that moves most, [n, n_node, 3].

    Example:
        12 kg on a tripod of 108, 108 and 384 kN/m, see `flexibility`:

        >>> around = 2 * np.pi * np.arange(3) / 3
        >>> feet = np.column_stack([3 * np.cos(around), 3 * np.sin(around), 0 * around])
        >>> legs = jc.Bars([[0, 3], [1, 3], [2, 3]], axial_stiffness=1e6)
        >>> structure = jc.Structure([*feet, [0.0, 0.0, 4.0]], legs, supports=jc.pinned([0, 1, 2]))
        >>> solution = jc.solve(structure, jc.Phase())
        >>> found = jc.stiffness.natural_frequencies(structure, solution, masses=12.0)
        >>> print(solution.status, jnp.round(found.squared, 6))  # K / m
        0 [ 9000.  9000. 32000.]
    """

    frequency: Float[Array, " n"]
    squared: Float[Array, " n"]
    shapes: Float[Array, "n n_node 3"]


def natural_frequencies(
    structure: Structure,
    state: Solution | State,
    n: int = 6,
    *,
    masses: Float[ArrayLike, " n_node"]
    | Float[ArrayLike, ""]
    | PointMasses
    | Sequence[PointMasses]
    | None = None,
    fixed: Bool[ArrayLike, "n_row n_freedom"] | None = None,
    gravity: Float[ArrayLike, ""] = STANDARD_GRAVITY,
    distribution: Literal["lumped", "consistent", "mean"] | None = None,
) -> Vibration:
    """Find natural frequencies and modes about the state of a solution: ``(K - w^2 M) phi = 0``.

    K is the tangent stiffness of the state, which includes prestress and loads. M has the masses of
    the element groups, from their weights and `gravity`, and `masses`. Rotations of nodes and of
    sections of beams have no inertia of their own. Dense, meant for some hundred unknowns.

    A state has forces, and does not know which of them are weights: masses of which only the weight
    was a load, `PointMasses` included, count here if they are given as `masses`. Without `masses`
    an `InputWarning` is issued (outside of transformations) where downward nodal loads are larger
    than the weights of the elements.

    A catenary is one element for a whole span: half of its mass moves with each end, and modes
    within the span are not found. An `InputWarning` is issued (outside of transformations) if the
    first of them is slower than a mode that is returned; a chain of `Cables` has all modes.

    A pure function. Derivatives are those of simple eigenvalues; equal eigenvalues have no definite
    modes, and derivatives of their shapes are not finite.

    Args:
        structure: the `Structure` that was analysed.
        state: `Solution` (its last converged state is used) or `State`.
        n: number of modes; fewer if fewer have mass (if traced, the remaining frequencies are inf).

    Options:
        masses: added masses at the nodes, [n_node] or scalar, kg; or `PointMasses`, one or several
            in a list, such as those that were loads of the analysis; default none. Give 0.0 where
            nodal loads are no weights.
        fixed: degrees of freedom to leave out, as in `stiffness.tangent_stiffness`.
        gravity: acceleration that weights are divided by, m/s2; default 9.80665.
        distribution: of an element's mass m. "lumped": half at each end. "consistent" with the
            displacements between the ends: m/3 and m/6 for straight cables and bars, cubic
            deflections for beams. "mean" of both, whose errors cancel in cables and bars. None
            (default): the choice with an error of order 4 in the length of elements, which is the
            mean for cables, bars and along beams, and consistent across beams. Cables over several
            nodes are always lumped.

    Returns:
        `Vibration`.

    Raises:
        ValueError: wrong arguments; no mass at all, or none that can move; a tangent that is not
            symmetric (follower loads without a potential, nodal moments, elements that are not
            `symmetric`), whose frequencies may be complex (if traced, they are NaN); too many
            unknowns for dense matrices in the memory there is.

    Source: Goudreau and Taylor, Comp. Meth. Appl. Mech. Eng. 2 (1973), for the mean.

    Example:
        A seconds pendulum, ``sqrt(g / l) / 2 pi`` = 1/2 Hz, stiff by its weight:

        >>> gravity, mass = 9.80665, 2.0
        >>> length = gravity / np.pi**2  # 0.9936 m
        >>> rope = jc.Cables([[0, 1]], axial_stiffness=1e6)
        >>> structure = jc.Structure([[0.0, 0, 0], [0, 0, -length]], rope, supports=jc.pinned([0]))
        >>> weight = jc.NodalLoads([1], (0.0, 0.0, -mass * gravity))
        >>> solution = jc.solve(structure, jc.Phase(pretension=mass * gravity, loads=weight))
        >>> found = jc.stiffness.natural_frequencies(structure, solution, n=2, masses=mass)
        >>> print(solution.status, jnp.round(found.frequency, 6))  # Hz, in x and in y
        0 [0.5 0.5]
    """
    checks.require_whole_number(n, "n")
    if distribution is not None and distribution not in _DISTRIBUTIONS:
        names = ", ".join(map(repr, _DISTRIBUTIONS))
        raise ValueError(f"distribution = {distribution!r}: expected one of {names}")
    gravity = nan_if_broken(positive("gravity", gravity))
    if masses is not None:
        masses = nodal_masses(structure, masses)
    require_symmetric_elements(structure, "natural_frequencies")
    without_indices, index_arrays, dof_map = split_solution_state(structure, state, fixed)
    if masses is None:
        _warn_of_weights_without_mass(structure, state)
    require_dense_memory(dof_map, _DENSE_MATRICES, "natural_frequencies")
    weights = [group.weight for group in structure.groups]
    known = [checks.array_if_known(amount) for amount in (*weights, masses) if amount is not None]
    if not any(amount is None or (amount > 0).any() for amount in known):
        raise ValueError(
            "masses: no element group has a weight; give weight=... in N/m, or masses=... in kg"
        )
    split = without_indices, index_arrays, dof_map
    given = {"distribution": distribution, "n_node": structure.n_node}
    matrices = _modal_matrices(*split, gravity, masses, **given)
    symmetric, has_mass = matrices[-2:]
    if checks.array_if_known(symmetric) is not None and not symmetric:
        raise ValueError(
            "state: follower loads or nodal moments make its tangent stiffness unsymmetric; "
            "frequencies may be complex, and only symmetric problems are solved"
        )
    if checks.array_if_known(has_mass) is not None and not has_mass:
        hint = ""
        if any(isinstance(group, Hanging) for group in structure.groups):
            hint = "; catenaries have no modes within their span: use a chain of Cables"
        raise ValueError(f"masses: no node that is free to move has mass{hint}")
    found = _without_massless_modes(_find_vibration_modes(matrices, n=min(n, len(matrices[0]))))
    _warn_of_modes_within_spans(structure, without_indices, index_arrays, gravity, found)
    return found


def nodal_masses(structure, masses):
    """Return the argument `masses` of `natural_frequencies` as an array [n_node], kg."""
    several = masses if isinstance(masses, list | tuple) else [masses]
    if any(isinstance(one, PointMasses) for one in several):
        for k, one in enumerate(several):
            if not isinstance(one, PointMasses):
                raise ValueError(f"masses[{k}]: expected PointMasses, got {type(one).__name__}")
            one.check(structure)
        return sum(one.nodal_masses(structure.n_node) for one in several)
    hint = "; one mass for each node, one for all, or PointMasses"
    masses = checks.floats_of_shape(masses, "masses", (), (structure.n_node,), hint=hint)
    if checks.array_if_known(masses) is None:
        masses = jnp.broadcast_to(masses, structure.n_node)
    else:
        masses = np.broadcast_to(masses, structure.n_node)
    return nan_if_broken(not_negative("masses", masses))


def _warn_of_weights_without_mass(structure, state):
    """Warn if downward nodal loads of a state, which have no mass, are more than its weights."""
    restart = (state.last if isinstance(state, Solution) else state).restart
    weights = [
        group.weights(own)
        for group, own in zip(structure.groups, restart.states, strict=True)
        if group.weight is not None
    ]
    known = [checks.array_if_known(x) for x in (restart.nodal_load, *weights)]
    if any(x is None for x in known):
        return
    nodal, *weights = known
    down = -np.minimum(nodal[: structure.n_node, 2], 0.0).sum()
    weight = sum(float(np.sum(x)) for x in weights)
    if down > weight > 0:
        checks.warn_user(
            f"masses: nodal loads of {down:.4g} N downwards have no mass here, elements weigh "
            f"{weight:.4g} N; give masses=..., such as the PointMasses of the analysis, or "
            "masses=0.0 if these loads are no weights"
        )


@functools.partial(as_program, static=("distribution", "n_node"))
def _modal_matrices(without_indices, index_arrays, dof_map, gravity, masses, distribution, n_node):
    """Assemble tangent stiffness and mass matrix of a split state; a program.

    Args:
        without_indices, index_arrays, dof_map: as from `split_solution_state`.
        gravity, distribution: as for `natural_frequencies`.
        masses: added masses of the nodes, [n_node], kg, or None.
        n_node: number of nodes.

    Returns:
        Stiffness, N/m, and mass, kg, [n_free, n_free]; derivatives of displacements by unknowns,
        [n_node, 3, n_free]; whether the stiffness is symmetric; whether anything that moves has
        mass.
    """
    stiffness, symmetric, moved = tangent_and_displacements(without_indices, index_arrays, dof_map)
    nodes, groups, restart = merge_solution_state(without_indices, index_arrays)
    system = make_system(nodes, groups, restart, restart.motion, dof_map)
    gravity, moved = jnp.asarray(gravity, nodes.dtype), moved[:n_node]
    mass = system.mass_matrix(restart.motion, gravity, distribution)
    if masses is not None:
        mass = mass + jnp.einsum("nci,n,ncj->ij", moved, masses.astype(mass.dtype), moved)
    return stiffness, mass, moved, symmetric, jnp.trace(mass) > 0


def _warn_of_modes_within_spans(structure, without_indices, index_arrays, gravity, found):
    """Warn if a catenary vibrates within its span more slowly than one of the modes `found`.

    Nothing happens while frequencies are traced. `found` is a `Vibration`; the state is given as to
    `_modal_matrices`.
    """
    frequency = checks.array_if_known(found.frequency)
    if frequency is None or not any(isinstance(group, Hanging) for group in structure.groups):
        return
    highest = np.nanmax(np.append(frequency, -np.inf))
    nodes, groups, restart = merge_solution_state(without_indices, index_arrays)
    named = structure.named_groups()
    for number, (group, state) in enumerate(zip(groups, restart.states, strict=True)):
        where = named[number][0]
        if not isinstance(group, Hanging) or group.weight is None:
            continue
        system = make_system(nodes, groups, restart, None, None)
        tension = evaluate_elements("tension", group, system.states[number], nodes, restart.motion)
        # first frequency of a taut string with the mass of the catenary: exact across a shallow one
        mass = group.weights(state) / gravity
        span_frequency = (
            jnp.sqrt(tension / jnp.where(mass > 0, mass, jnp.nan) / state.rest_length) / 2
        )
        span_frequency = checks.array_if_known(span_frequency)
        if span_frequency is None:
            return
        slow = np.flatnonzero(span_frequency < highest)
        if len(slow):
            k = int(slow[np.argmin(span_frequency[slow])])
            checks.warn_user(
                f"structure: catenary {k} of elements{where} vibrates within its span at about "
                f"{span_frequency[k]:.3g} Hz, slower than a mode that is returned "
                f"({highest:.3g} Hz); modes within a span are not found: use a chain of Cables, or "
                "ask for fewer modes"
            )


@functools.partial(as_program, static=("n",))
def _find_vibration_modes(matrices, n):
    """Return the slowest `n` modes, a `Vibration`; NaN if the stiffness is unsymmetric; a program.

    `matrices` are the results of `_modal_matrices`.
    """
    stiffness, mass, moved, symmetric, _ = matrices
    stiffness = jnp.where(symmetric, stiffness, jnp.nan)
    return _solve_vibration_problem(stiffness, mass, moved, n)


def _solve_vibration_problem(stiffness, mass, moved, n):
    """Solve ``(K - w^2 M) phi = 0`` for the slowest `n` modes; return them as a `Vibration`.

    It is solved as ``M v = mu (K + s M) v`` with ``mu = 1 / (w^2 + s)``: unknowns without mass have
    mu = 0 and need no special treatment, and slow modes, with the largest mu, are the most precise.
    The shift s is zero where K is positive definite. `moved` has the derivatives of displacements
    by unknowns, [n_node, 3, n_free].
    """
    stiffness = 0.5 * (stiffness + stiffness.T)
    size = jnp.sum(jnp.abs(jnp.diagonal(stiffness))) / jnp.trace(mass)

    def standardized(shift):
        """Return the Cholesky factor of K + s M, and M transformed by it, with eigenvalues mu."""
        root = unbatched.cholesky(stiffness + shift * mass)
        half = unbatched.solve_triangular(root, mass)
        return root, unbatched.solve_triangular(root, half.T)

    def needs_shift(shift):  # indefinite, or a mechanism, whose large mu would drown the others
        fine = jnp.trace(standardized(shift)[1]) * size * _SLOW < 1
        return ~fine & (shift < size / _SLOW)

    def next_shift(shift):
        return jnp.where(shift > 0, 10 * shift, _SHIFT * size)

    shift = lax.stop_gradient(lax.while_loop(needs_shift, next_shift, jnp.zeros_like(size)))
    root, standard = standardized(shift)
    mu, vectors = unbatched.eigh(0.5 * (standard + standard.T))
    mu, vectors = mu[::-1][:n], vectors[:, ::-1][:, :n]
    massive = ~(mu <= _MASSLESS * jnp.finfo(mu.dtype).eps * mu[0])
    squared = jnp.where(massive, 1 / jnp.where(massive, mu, 1.0) - shift, jnp.inf)
    modes = unbatched.solve_triangular(root, vectors, transposed=True)
    shapes = normalize_mode_shapes(jnp.moveaxis(jnp.tensordot(moved, modes, 1), -1, 0), modes.T)
    positive = squared > 0
    frequency = jnp.sqrt(jnp.where(positive, squared, 1.0)) / (2 * jnp.pi)
    frequency = jnp.where(positive, frequency, jnp.nan)
    return Vibration(frequency, squared, shapes)


def _without_massless_modes(found):
    """Return a `Vibration` without its modes of infinite frequency; unchanged while traced."""
    known = checks.array_if_known(found.squared)
    if known is None:
        return found
    count = int(np.sum(~np.isposinf(known)))
    if count == len(known):
        return found
    return jax.tree.map(lambda a: jnp.asarray(np.asarray(a)[:count]), found)
