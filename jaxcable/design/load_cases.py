"""Load cases from one prestressed state, envelopes over them, and utilization."""

from __future__ import annotations

import functools
from collections.abc import Callable, Mapping, Sequence
from typing import Any, overload

import jax
import jax.numpy as jnp
import numpy as np

from ..analysis.phase_checks import before_phases
from ..analysis.phases import Phase
from ..analysis.results import ElementResults
from ..analysis.solution import Solution, State
from ..analysis.solver import solve
from ..common import checks, status
from ..common.tree import apply_numpy_or_jax, pytree
from ..common.types import Array, ArrayLike, Float, Int, PyTree
from ..equilibrium.incremental import Incremental
from ..equilibrium.newton import Newton
from ..loads import SelfWeight, as_list
from ..model.structure import Structure
from ..programs.joining import stack_trees
from .arguments import require_structure
from .combinations import Combinations
from .result_envelopes import ResultEnvelope, result_envelope


def solve_cases(
    structure: Structure,
    phases: Phase | Sequence[Phase] | None,
    cases: Phase | Sequence[Phase] | Combinations,
    method: Newton | Incremental | None = None,
    *,
    start: Solution | State | None = None,
) -> Solution:
    """Solve many load cases from one prestressed state, all at once (`jax.vmap`).

    Args:
        structure, phases, method: as for `solve`; `phases` lead to the prestressed state; None if
            the cases begin at `start`.
        cases: list of `Phase`, one per case, which differ in numbers only (the same kinds of loads
            on the same nodes, zero where a case has none); or one `Phase` whose arrays all have a
            leading axis [n_case]; or `Combinations`.

    Options:
        start: as for `solve`: the state at which `phases` begin.

    Returns:
        `Solution` of the cases, with a leading axis [n_case] in every array.

    Raises:
        ValueError: cases that differ in more than numbers.

    Warns:
        UnstableWarning: cases end in an unstable equilibrium.
        InputWarning: an action of `Combinations` is a self-weight that the phases have already.

    Example:
        A small push on a tripod with legs of 5 m, downward and sideways; its stiffness is
        ``3 EA/l 0.8^2`` = 384 kN/m and ``3/2 EA/l 0.6^2`` = 108 kN/m:

        >>> around = 2 * np.pi * np.arange(3) / 3
        >>> feet = np.column_stack([3 * np.cos(around), 3 * np.sin(around), 0 * around])
        >>> legs = jc.Bars([[0, 3], [1, 3], [2, 3]], axial_stiffness=1e6)
        >>> structure = jc.Structure([*feet, [0.0, 0.0, 4.0]], legs, supports=jc.pinned([0, 1, 2]))
        >>> pushes = (0.0, 0.0, -38.4), (10.8, 0.0, 0.0)
        >>> cases = [jc.Phase(loads=jc.NodalLoads([3], push)) for push in pushes]
        >>> solutions = jc.design.solve_cases(structure, jc.Phase(), cases)
        >>> print(solutions.status, jnp.round(1e3 * solutions.displacement[:, 3], 3) + 0.0)  # mm
        [0 0] [[ 0.   0.  -0.1]
         [ 0.1  0.   0. ]]
    """
    names: Sequence[str] | None = None
    if isinstance(cases, Combinations):
        _warn_of_weight_twice(phases, start, cases)
        names, cases = cases.names, cases.cases
    if not isinstance(cases, Phase | list | tuple):
        raise ValueError(f"cases: expected a list of Phase, got {type(cases).__name__}")
    if not isinstance(cases, Phase):
        cases = list(cases)
        if not cases:
            raise ValueError("cases: expected at least one Phase")
        shapes: list[Any] = [jax.tree.structure(case) for case in cases]
        sizes = [[jnp.shape(leaf) for leaf in jax.tree.leaves(case)] for case in cases]
        for k, case in enumerate(cases):
            if not isinstance(case, Phase):
                raise ValueError(f"cases[{k}]: expected a Phase, got {type(case).__name__}")
            if shapes[k] != shapes[0] or sizes[k] != sizes[0]:
                raise ValueError(
                    f"cases[{k}]: differs from cases[0] in more than numbers; give all cases the "
                    "same kinds of loads on the same nodes, zero where there is none"
                )
        cases = stack_trees(cases)
    first: Solution | State
    if start is not None and (phases is None or (isinstance(phases, list | tuple) and not phases)):
        first = start
    else:
        with before_phases([cases]):
            first = solve(structure, phases, method, start=start)
    solutions = jax.vmap(lambda case: solve(structure, [case], method, start=first))(cases)
    _warn_of_unstable_cases(solutions, names)
    return solutions


def _warn_of_weight_twice(phases, start, combinations):
    """Warn if the phases before the cases have a `SelfWeight`, and so has an action of the cases.

    Actions of `combinations` that are `in_phases` do not count; from a `start` nothing is
    known.
    """
    before = [
        load
        for phase in ([phases] if isinstance(phases, Phase) else phases or ())
        for load in as_list(phase.loads)
    ]
    if start is not None or not any(isinstance(load, SelfWeight) for load in before):
        return
    for one in combinations.actions:
        if not one.in_phases and any(isinstance(load, SelfWeight) for load in as_list(one.loads)):
            checks.warn_user(
                f"actions: {one.name!r} is a SelfWeight, and the phases before the cases have one, "
                "too: it acts twice; give the action in_phases=True if it is the same weight"
            )


def _warn_of_unstable_cases(solutions, names):
    """Warn of cases that end in an unstable equilibrium, unless they are traced.

    `solutions` is a batch, [n_case]; `names` are those of the cases, or None.
    """
    codes, stable = (checks.array_if_known(x) for x in (solutions.status, solutions.stable))
    if codes is None or stable is None or codes.ndim != 1:
        return
    found = np.flatnonzero((codes == status.OK) & ~stable)
    if len(found):
        shown = ", ".join(f"case {k}" if names is None else names[k] for k in found[:5])
        more = f" and {len(found) - 5} more" if len(found) > 5 else ""
        checks.warn_user(
            f"{shown}{more}: end in an unstable equilibrium, in which the structure will not stay: "
            "the tangent stiffness has an eigenvalue below zero, or of zero",
            checks.UnstableWarning,
        )


@pytree
class Envelope:
    """Extreme values over load cases, and the cases in which they occur: result of `envelope`.

    All are pytrees like the results of a single case.

    Attributes:
        lowest, highest: least and largest value over all cases; NaN where the analysis of a case
            has failed.
        lowest_case, highest_case: indices of the cases in which these occur.

    Example:
        >>> tension = jnp.array([[200.0, 250.0], [230.0, 210.0]])  # [n_case, n_elem], N
        >>> extremes = jc.design.envelope(tension)
        >>> print(extremes.lowest, extremes.lowest_case)
        [200. 210.] [0 1]
    """

    lowest: PyTree[Float[Array, " ..."]]
    highest: PyTree[Float[Array, " ..."]]
    lowest_case: PyTree[Int[Array, " ..."]]
    highest_case: PyTree[Int[Array, " ..."]]


@overload
def envelope(values: PyTree[Float[ArrayLike, "n_case ..."]]) -> Envelope:
    """Find the extremes of arrays [n_case, ...] over load cases, and the cases that govern them."""


@overload
def envelope(
    values: Structure,
    solutions: Solution,
    names: Sequence[str] | None = None,
    *,
    also: Mapping[str, Callable[[Solution], PyTree[Array]]] | None = None,
    places: int = 11,
) -> ResultEnvelope:
    """Find the extremes of all results of a structure over load cases, and the governing cases."""


def envelope(
    values: PyTree[Float[ArrayLike, "n_case ..."]] | Structure,
    solutions: Solution | None = None,
    names: Sequence[str] | None = None,
    *,
    also: Mapping[str, Callable[[Solution], PyTree[Array]]] | None = None,
    places: int = 11,
) -> Envelope | ResultEnvelope:
    """Find the least and the largest values over load cases, and the cases in which they occur.

    ``envelope(values)`` is that of any values. ``envelope(structure, solutions, names)`` is that of
    all results, with the names of the cases that govern: "tension" (the largest along each
    element), "displacement", "reactions"; with beams "rotation", "reaction_moments" and "N", "Vy",
    "Vz", "T", "My", "Mz" along them; "sag" of catenaries at midspan; "stress" of fibres. Cases that
    have failed have no part in it.

    Args:
        values: a pytree with the cases on the leading axes, such as ``solution.peak_tension``; or
            the `Structure` of `solutions`.
        solutions: `Solution` with a leading axis [n_case], as of `solve_cases`.
        names: of the cases, such as ``combinations.names``; default "case 0" and so on.

    Options:
        also: further results by name, functions of the `Solution` of one case, such as
            ``{"used": lambda solution: jc.design.utilization(structure, solution)}``.
        places: number of places along beams of their section forces, from end to end.

    Returns:
        `Envelope`, its entries in the shape of one case; or `ResultEnvelope`. Derivatives are those
        of the cases that govern.

    Raises:
        ValueError: values without a leading axis; solutions of one case, or of another structure; a
            wrong number of names, or one that occurs twice.

    Example:
        >>> tension = {"net": jnp.array([[200.0, 250.0], [230.0, 210.0]])}  # [n_case, n_elem], N
        >>> extremes = jc.design.envelope(tension)
        >>> print(extremes.highest["net"], extremes.highest_case["net"])
        [230. 250.] [1 0]
    """
    if isinstance(values, Structure):
        if solutions is None:
            raise ValueError("solutions: missing; give envelope(structure, solutions)")
        return result_envelope(values, solutions, names, also, places)
    if any(np.ndim(v) == 0 or not np.shape(v)[0] for v in jax.tree.leaves(values)):
        raise ValueError("values: expected arrays with the cases on their leading axis")
    functions = (jnp.min, jnp.max, jnp.argmin, jnp.argmax)
    return Envelope(*(jax.tree.map(lambda v, f=f: f(v, axis=0), values) for f in functions))


def utilization(
    structure: Structure, tension: ElementResults | PyTree[Float[ArrayLike, "... n_elem"] | None]
) -> PyTree[Float[Array, "... n_elem"] | None]:
    """Compute force over breaking force of elements, -, which reports call force / strength.

    The utilization of `checks` is another one, by resistances with partial factors. This one is
    ``N / strength`` of cables, and ``|N| / strength`` of other elements. Compression is compared
    with the strength alone, without buckling: `stiffness.buckling_factor` and `trace_path` show how
    far a state is from that. Of beams only the axial force counts (`fibre_stress` includes
    bending).

    Args:
        structure: `Structure` whose groups have a `strength`, or a law with a rupture strain.
        tension: `Solution`, `State`, or the result or path of a phase: then the largest force along
            each element counts, its `peak_tension`. Or forces in the shape of the elements, N.
            (Then give `peak_tension` of catenaries: their `tension` is the mean of both ends.)
            Leading axes (load cases, increments) are kept.

    Returns:
        Utilization in the shape of the elements, -; None for groups of unknown strength. It is
        differentiable in forces and strengths.

    Raises:
        ValueError: no group has a strength, or forces of another number of groups.

    Example:
        A guy that is 300 m high has 150 kN more at its top than at its foot:

        >>> nodes = [[0.0, 0.0, 0.0], [200.0, 0.0, 300.0]]
        >>> guy = jc.Catenaries([[0, 1]], axial_stiffness=80e6, weight=500.0, strength=1e6)
        >>> structure = jc.Structure(nodes, guy, supports=jc.pinned([0, 1]))
        >>> solution = jc.solve(structure, jc.Phase(sag=40.0, loads=jc.SelfWeight()))
        >>> used = jc.design.utilization(structure, solution)
        >>> mean = jc.design.utilization(structure, solution.tension)
        >>> print(solution.status, f"{used[0]:.3f}, by the mean {mean[0]:.3f}")
        0 0.292, by the mean 0.217

        A given force:

        >>> print(jc.design.utilization(structure, jnp.array([250e3])))
        [0.25]
    """
    require_structure(structure)
    groups = structure.groups
    forces = getattr(tension, "peak_tension", tension)
    leaves = jax.tree.leaves(forces, is_leaf=lambda leaf: leaf is None)
    if len(leaves) != len(groups):
        raise ValueError(f"tension: has {len(leaves)} arrays, the structure {len(groups)} groups")
    found = []
    for group, force in zip(groups, leaves, strict=True):
        if force is None:  # a group without axial forces
            found.append(None)
            continue
        force = checks.as_floats(force, f"tension: group {len(found)}")
        if force.shape[-1:] != (len(group.links),):
            raise ValueError(
                f"tension: group {len(found)} has {len(group.links)} elements, the forces have "
                f"shape {force.shape}"
            )
        limit = group.strength
        if limit is None and group.has_rupture:
            low, high = group.capacity()
            limit = jnp.where(force < 0, -low, high)
        if limit is None:
            found.append(None)
            continue
        ratio = functools.partial(_ratio_to_limit, absolute=not group.tension_only)
        found.append(apply_numpy_or_jax(ratio, jnp.asarray(force), limit))
    if all(f is None for f in found):
        raise ValueError(
            "strength: no group has one; give strength=..., N, or a law with a rupture strain"
        )
    return structure.arrange(found)


def _ratio_to_limit(xp, force, limit, absolute):
    """Return forces over their limits, [..., n_elem], -; with `absolute` their absolute values.

    `xp` is NumPy or jax.numpy; `force` [..., n_elem] and `limit`, a scalar or [n_elem], are in
    N.
    """
    return (xp.abs(force) if absolute else force) / xp.broadcast_to(limit, force.shape)
