"""Prestress as built: the unstressed lengths with which what phases state holds in equilibrium.

A tension at an end, a horizontal force or a sag of a hanging cable is what gauges read on the
structure as it stands: under all loads of the phase, where nodes have moved to. The unstressed
lengths with which this is so are the unknowns of further equations,

    measured at the end of the phase / stated - 1 = 0,

or of sags, which are nearly proportional to the inverse of a force, ``stated / measured - 1 = 0``.

Newton's method solves them: each step analyses the phases, and the Jacobian is exact. The unknown
of a cable is ``log(L0 / d)`` with its unstressed length L0 and the chord d as drawn: in it forces
of taut cables are nearly linear, also where guys nearly let a mast sway. The search begins with
the lengths of cables between ends that do not move,
``L0 = d sqrt(1 + 2 x) / (1 + t / EA)`` with ``x = (w l / t)^2 / 24``, the tension t, the span l and
the weight w: those of parabolas where cables are taut, and lengths in proportion to the sag where
they hang deep. The derivative of the lengths is that of an implicit root. (Derived for this
package.)

The end tension of straight elements is a jack's, whose analysis needs no search, unless the
structure does not stand under constant forces: three equal guys push a hinged tower over, but hold
it by their lengths. Then these are found, too (`topples_under_jacks`).
"""

from __future__ import annotations

import functools
from collections.abc import Callable, Sequence
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
from jax import lax

from ..common import checks, status
from ..common.compilation import is_top_level_call
from ..common.selection import only
from ..common.tree import copy_with, replace
from ..common.types import Array, Float, Int
from ..elements.abilities import Hanging
from ..elements.phase_input import InputValues
from ..elements.prestress import call_each_element
from ..equilibrium.incremental import Incremental
from ..equilibrium.newton import Newton, residual_tolerance
from ..model.plausibility import largest_movement
from ..model.structure import Structure
from ..model.supports import FixedDofs
from ..numerics.implicit_root import TangentSolver, implicit_root
from ..programs.program_calls import as_program
from ..programs.search_call import run_search
from .activation import element_masks, make_activation
from .as_built_inputs import (
    describe_unmet,
    find_as_built_inputs,
    refuse_lengths_beyond_digits,
)
from .element_shapes import ElementShapes, element_shapes, map_shapes
from .length_search import newton_search, solve_dense
from .phase_inputs import AS_BUILT_INPUTS, end_tensions_as_jacking, may_have_as_built_inputs
from .phases import Phase, as_phases
from .preparation import prepare
from .recalled_derivative import without_derivatives
from .sensitivity import MeasuredAnalysis
from .solution import Solution, State

Run = Callable[..., Solution]
"""Function of structure, phases in which nothing is stated as built, method and start: `solve`."""

_MEASURED = "displacement", "positions", "tension", "rest_length", "results"


def with_lengths_as_built(
    structure: Structure,
    phases: Phase | Sequence[Phase] | None,
    method: Newton | Incremental | None,
    start: Solution | State | None,
    run: Run,
    straight: bool = False,
) -> tuple[list[Phase], Int[Array, ""] | None]:
    """Return phases with strains in place of what they state as built, and a status.

    Args:
        structure, phases, method, start: as for `solve`.
        run: function that analyses phases without such inputs: `solve`.
        straight: whether end tensions of straight elements are met by lengths, too, and not by
            jacks.

    Returns:
        The phases, with derivatives by all arguments; and OK, NOT_AS_BUILT if no lengths are found,
            or the status of the analysis that the search begins with. None if nothing is stated.

    Raises:
        ValueError: as of `solve`.
    """
    phases = as_phases(structure, phases)
    hangs = any(isinstance(group, Hanging) for group in structure.groups)
    if not any(may_have_as_built_inputs(phase, hangs) for phase in phases):
        return phases, None
    with checks.without_warnings():
        stated = find_as_built_inputs(structure, phases, start, straight=straight)
    if not stated:  # an end tension of straight elements is a jack's
        return phases, None
    prepare(structure, phases, method, start)  # for its warnings, which name what is stated
    with checks.without_warnings():
        found, code, errors = _with_found_lengths(
            structure, phases, method, start, run, stated, straight
        )
    if errors is not None and int(code) == status.NOT_AS_BUILT:
        checks.warn_user(describe_unmet(stated, np.asarray(errors)))
    return found, code


def topples_under_jacks(phases: Sequence[Phase], solution: Solution, fixed: FixedDofs) -> bool:
    """Return whether end tensions of straight elements, as of jacks, have tipped a structure over.

    So it is if the analysis has failed, the end is unstable, or a node has moved by half the extent
    of the structure more than the supports, `fixed`. Nothing is known of a `solution` that is
    traced: False.
    """
    stands = all(phase.end_tension is None for phase in phases)
    traced = any(isinstance(x, jax.core.Tracer) for x in (solution.status, solution.positions))
    if stands or traced:
        return False
    if int(solution.status) != status.OK or not bool(solution.stable):
        return True
    _, moved, extent = largest_movement(solution, fixed)
    return moved > 0.5 * extent


def _with_found_lengths(structure, phases, method, start, run, stated, straight):
    """Return the phases with the strains that are found, a status, and the errors that are left.

    `stated` is a list of `AsBuiltInput`, at least one. The relative errors, [n], are None if
    traced. Other arguments are those of `with_lengths_as_built`.
    """
    last = 1 + max(one.phase for one in stated)  # what comes later changes nothing
    arguments = structure, _first_phases(structure, phases, last, start), method, start
    known = without_derivatives(arguments)
    concrete = is_top_level_call(jax.tree.leaves(known))
    m, code, left = _find_log_lengths(known, run, concrete, straight)
    leaves, tree = jax.tree.flatten(arguments)
    if concrete and not any(isinstance(leaf, jax.core.Tracer) for leaf in leaves):
        return _with_prestrains(structure, phases, stated, m), code, left
    moving = [k for k, leaf in enumerate(leaves) if _has_derivative(leaf)]

    def errors(m, values):
        every = list(leaves)
        for k, value in zip(moving, values, strict=True):
            every[k] = value
        structure, phases, method, start = tree.unflatten(every)
        given = structure, phases, find_as_built_inputs(structure, phases, start, straight=straight)
        solution = run(structure, _with_prestrains(*given, m), method, start=start)
        return _relative_errors(solution, *given)

    values = [leaves[k] for k in moving]
    m = implicit_root(errors, m, values, TangentSolver(solve_dense, solve_dense))
    return _with_prestrains(structure, phases, stated, m), code, left if concrete else None


def _first_phases(structure, phases, count, start):
    """Return the first phases of an analysis, without the elements that only later ones add."""
    first = list(phases[:count])
    if start is not None:  # it knows which elements are there
        return first
    every, alone = (make_activation(structure, some, None) for some in (phases, first))
    if every is None:
        return first
    later = [~there for there in every.present_at_start]
    if alone is not None:
        pairs = zip(later, alone.present_at_start, strict=True)
        later = [absent & there for absent, there in pairs]
    masks = element_masks(first[0].removes, structure, "phases[0].removes")
    removes = [mask | absent for mask, absent in zip(masks, later, strict=True)]
    known = [checks.array_if_known(absent) for absent in later]
    if all(absent is not None and not absent.any() for absent in known):
        return first
    return [replace(first[0], removes=structure.arrange(removes)), *first[1:]]


def _has_derivative(leaf):
    """Return whether a leaf of the arguments is traced, or a number by which derivatives exist."""
    return isinstance(leaf, jax.core.Tracer) or jnp.issubdtype(jnp.result_type(leaf), jnp.floating)


# --- lengths


def _with_prestrains(structure, phases, stated, m):
    """Return the phases with prestrains ``exp(-m) - 1`` in place of what they state as built.

    `stated` is a list of `AsBuiltInput`, `m` are the unknowns ``log(L0 / d)``, [n].
    """
    found, at = list(phases), 0
    for k, phase in enumerate(phases):
        if not may_have_as_built_inputs(phase):
            continue
        every = phase.inputs(structure)
        strains: list[Any] = [own.get("prestrain") for own in every]
        jacked = end_tensions_as_jacking(structure, every)
        for number in {one.group for one in stated if one.phase == k}:
            jacked[number] = every[number]  # lengths meet its end tensions
        jacks = [
            None if isinstance(group, Hanging) else own.get("jacking")
            for group, own in zip(structure.groups, jacked, strict=True)
        ]
        for one in (one for one in stated if one.phase == k):
            count = len(structure.groups[one.group].links)
            part = np.arange(at, at + len(one.elements))
            at += len(one.elements)
            strains[one.group] = _set_prestrains(strains[one.group], one.elements, m, part, count)
        found[k] = replace(
            phase,
            **dict.fromkeys(AS_BUILT_INPUTS),
            prestrain=_as_phase_argument(structure, strains),
            jacking=_as_phase_argument(structure, jacks),
        )
    return found


def _set_prestrains(stated, elements, m, part, count):
    """Return the `InputValues` of a prestrain with ``exp(-m[part]) - 1`` at `elements`.

    The unknowns m are ``log(L0 / d)``, of unstressed length and chord. `stated` has the values of
    the group, of `count` elements, or is None; those of other elements stay.
    """
    mask = np.zeros(count, bool) if stated is None else stated.element_mask()
    before = np.zeros(count, m.dtype) if stated is None else stated.values
    mask[elements] = True
    return InputValues(_insert_strains(before, elements, m, part), None if mask.all() else mask)


@as_program
def _insert_strains(values, elements, m, part):
    """Return `values`, [n_elem], with the strains ``exp(-m[part]) - 1`` at `elements`."""
    return jnp.asarray(values).at[elements].set(jnp.expm1(-m[part]))


@as_program
def _at_indices(values, chosen):
    """Return ``values[chosen]``, the values of elements with the indices `chosen`, [n]."""
    return values[chosen]


def _as_phase_argument(structure, stated):
    """Return `InputValues` (or None) of all groups as `Phase` takes them; None if all are None."""
    if all(one is None for one in stated):
        return None
    found = [
        one
        if one is None or one.chosen is None
        else only(np.flatnonzero(one.chosen), _at_indices(one.values, np.flatnonzero(one.chosen)))
        for one in stated
    ]
    return structure.arrange([x.values if isinstance(x, InputValues) else x for x in found])


def _hanging_parameters(structure, cables, elements):
    """Return chords, m, horizontal spans, m, stiffnesses, N, weights, N/m, of elements, [n] each.

    Chords and spans are initial. The axial stiffness is that of cable and end spring in series
    (`stiffness_with_spring`); a weight that is not stated is zero.
    """
    weight = 0.0 if cables.weight is None else cables.weight
    given = structure.nodes, cables.stiffness_with_spring, weight
    xp = checks.numpy_or_jax(given)
    nodes, *numbers = map(xp.asarray, given)
    ends = nodes[cables.links.array[elements]]
    vector = ends[:, 1] - ends[:, 0]
    chord, span = xp.linalg.norm(vector, axis=1), xp.linalg.norm(vector[:, :2], axis=1)
    every = [xp.broadcast_to(x, len(cables.links)) for x in numbers]
    return chord, span, *(x[elements] for x in every)


def _guess_log_lengths(structure, stated):
    """Return guesses of the unknowns ``log(L0 / d)``, [n], of parabolas whose ends do not move."""
    parts = []
    for one in stated:
        cables = structure.groups[one.group]
        if not isinstance(cables, Hanging):
            parts.append(_straight_unstressed_lengths(cables, one.elements, one.values))
            continue
        chord, span, stiffness, weight = _hanging_parameters(structure, cables, one.elements)
        tension = one.values
        if one.name == "horizontal_tension":
            tension = tension * chord / span
        if one.name == "built_sag":
            tension = weight * span * chord / (8 * one.values)
        slope = (weight * span / tension) ** 2 / 24 if one.loaded else 0.0
        xp = checks.numpy_or_jax(slope, tension, stiffness)
        parts.append(0.5 * xp.log1p(2 * slope) - xp.log1p(tension / stiffness))
    return checks.numpy_or_jax(parts).concatenate(parts).astype(structure.nodes.dtype)


@as_program
def _straight_unstressed_lengths(group, elements, tension):
    """Return the logarithm of unstressed length over length under a `tension`, N, [n]."""
    every = jnp.zeros(len(group.links), tension.dtype).at[elements].set(tension)
    strain = call_each_element("strain_at", group, every, group.initial_memory())
    return -jnp.log1p(strain[elements])


# --- equations


def _relative_errors(solution, structure, phases, stated):
    """Return ``measured / stated - 1`` (of sags ``stated / measured - 1``) of all cables, [n].

    Measured is what the end of the phase in `solution` has; zero for cables absent there.
    """
    shapes = {one.phase: element_shapes(structure, solution.phases[one.phase]) for one in stated}
    parts = []
    for one in stated:
        tension = structure.group_tree.flatten_up_to(solution.phases[one.phase].tension)
        own, there = jax.tree.map(lambda x, k=one.elements: x[k], shapes[one.phase][one.group])
        # some force, so that derivatives of the one that is not there are finite
        own = copy_with(own, pull=jnp.where(there[:, None], own.pull, 1.0))
        measured = map_shapes(_MEASURES[one.name], own)
        if one.name == "end_tension":
            measured = jnp.where(one.at_first, measured[:, 0], measured[:, 1])
            measured = jnp.where(own.hangs, measured, tension[one.group][one.elements])
        measured = jnp.where(there, measured, lax.stop_gradient(one.values))
        inverse = one.name == "built_sag"
        error = (one.values / measured if inverse else measured / one.values) - 1
        parts.append(jnp.where(there, error, 0.0))
    return jnp.concatenate(parts)


def _end_tensions(shape: ElementShapes) -> Float[Array, " 2"]:
    """Return the tensions at the first and the last end of one catenary, [2], N."""
    ends = jnp.stack([shape.pull, shape.pull - shape.load])
    return jnp.sqrt(jnp.sum(ends * ends, axis=1))


_MEASURES: dict[str, Callable[[ElementShapes], Any]] = {
    "end_tension": _end_tensions,
    "horizontal_tension": ElementShapes.horizontal_part,
    "built_sag": ElementShapes.midspan_sag,
}


# --- the search


def _find_log_lengths(arguments, run, concrete, straight):
    """Return the unknowns, [n], without derivatives, a status, and the errors that are left, [n].

    `arguments` are structure, phases, method and start. `concrete` says that all numbers are known:
    then the analyses run by the compiled programs of `solve`.
    """
    structure, phases, method, start = arguments
    stated = find_as_built_inputs(structure, phases, start, straight=straight)
    m = _guess_log_lengths(structure, stated)
    tol = _search_tolerance(method or Newton(), m)
    if concrete:
        refuse_lengths_beyond_digits(stated, np.asarray(m))
        given = structure, phases, stated
        measured = MeasuredAnalysis(
            structure,
            lambda m: _with_prestrains(*given, m),
            lambda solution: _relative_errors(solution, *given),
            *(_MEASURED, method, start),
        )
        m, code, left = newton_search(measured, np.asarray(m), np.asarray(tol))
    else:

        def search_lengths(problem):
            own, m, tol = problem
            of = functools.partial(_errors_and_jacobian, *own, run=run, straight=straight)
            return newton_search(of, np.asarray(m), tol)

        like = m, jax.ShapeDtypeStruct((), np.int32), m
        m, code, left = run_search(search_lengths, (arguments, m, tol), like)
    for one in stated:
        code = checks.numpy_or_jax(one.allowed, code).where(one.allowed, code, status.INVALID_INPUT)
    return m, code, left


@functools.partial(as_program, static=("run", "straight"))
def _errors_and_jacobian(structure, phases, method, start, m, *, run, straight):
    """Return relative errors for unknowns `m`, [n], their Jacobian, [n, n], and the status."""
    given = structure, phases, find_as_built_inputs(structure, phases, start, straight=straight)

    def errors(m):
        solution = run(structure, _with_prestrains(*given, m), method, start=start)
        return _relative_errors(solution, *given), solution.status

    found, push, code = jax.linearize(errors, m, has_aux=True)
    return found, jax.vmap(push, out_axes=1)(jnp.eye(len(m), dtype=m.dtype)), code


@as_program
def _search_tolerance(method, m):
    """Return the tolerance of relative errors and steps: above what equilibria leave, a scalar."""
    tol = 8 * jnp.sqrt(jnp.asarray(jnp.finfo(m.dtype).eps, m.dtype))
    if isinstance(method, Incremental):
        return tol
    return jnp.maximum(tol, 10 * residual_tolerance(method, m.dtype))  # what equilibria leave
