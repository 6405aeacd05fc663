"""Forms that belong to a larger structure: found by an analysis with elements of given forces.

Elements with a prescribed force, force density or length are `PrescribedElements` of this analysis.
All other elements keep their law, with the drawn geometry (or `rest_length`) as their unstressed
shape. Supports, loads, beams and the iteration are those of `solve`, and so are statuses and
derivatives.

Where lengths are given, the forces of these elements are multipliers, found by the method of
multipliers (Hestenes 1969, Powell 1969): an element of given length L has the force
``N = m + k (l - L)``, and after each analysis ``m`` is replaced by N, until ``l = L``. The
derivative follows from the implicit function theorem for ``l(m) = L``.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
from jax import lax

from .. import linear
from ..analysis.phases import Phase
from ..analysis.solver import solve
from ..common import status
from ..common.tree import (
    Indices,
    cast_floats,
    copy_with,
    merge_indices,
    split_indices,
)
from ..common.types import Array, Float
from ..equilibrium.newton import Newton, residual_tolerance
from ..loads import (
    AreaLoads,
    CablePressure,
    LineLoads,
    Load,
    NodalLoads,
    PointMasses,
    SelfWeight,
    Varying,
    as_list,
)
from ..loads.faces import OnFaces
from ..loads.groups import OnGroups
from ..loads.load import DeadLoad
from ..model.structure import Structure
from ..numerics import implicit
from ..programs.program_calls import as_program
from .form import Form, arrange_form_as_elements, make_judged_form, most_shortened_element
from .form_dependent_loads import FormDependentLoads
from .given_lengths import length_error
from .input_checks import input_status
from .prescribed_elements import FormLoads, PrescribedElements
from .prescribed_values import PrescribedValues

# Stiffness times length of the springs of elements of given length: their axial stiffness, but at
# most this many times the largest prescribed force. Each analysis divides the error of a length by
# about this ratio to the stiffness of the rest; more would cost digits of the forces.
_SPRING_FORCE_RATIO = 1e4
# Analyses with given lengths. Where springs are stiffer than the rest, two to six are needed.
_MAX_ANALYSES = 30
# A spring gets ten times its stiffness if an analysis has left more than this part of the error.
_SLOW = 0.1


def needs_analysis(
    structure: Structure,
    loads: Load | Sequence[Load] | None,
    has_lengths: bool = False,
    all_prescribed: bool = True,
) -> bool:
    """Return whether a form has to be found by an analysis.

    It need not if `all_prescribed` (no group keeps its law), supports hold x, y, z, and only loads
    act that `form_dependent_loads` knows; if it `has_lengths` that are given, only those on nodes.
    """
    kinds: tuple[type, ...] = (NodalLoads, PointMasses)
    if not has_lengths:
        kinds = (*kinds, SelfWeight, LineLoads, AreaLoads)
    along_axes = structure.fixed(structure.supports).axes is None
    known = all(isinstance(load, kinds) for load in as_list(loads))
    return not (all_prescribed and along_axes and known)


def force_density_by_analysis(
    structure: Structure,
    densities: Sequence[Any],
    loads: Load | Sequence[Load] | None,
    linear_solver: str | None,
) -> Float[Array, "n_node 3"]:
    """Find the positions of given force densities by an analysis, [n_node, 3], m; NaN without any.

    `densities` are those of every group, [n_elem], N/m; other arguments are as for `force_density`.
    """
    prescribed = PrescribedValues(
        [jnp.zeros(len(group.links)) for group in structure.groups],
        [jnp.asarray(density) for density in densities],
        [None] * len(densities),
        tuple(Indices(np.zeros(len(group.links), bool)) for group in structure.groups),
    )
    method = Newton(linear_solver=linear_solver)
    positions = find_form_by_analysis(structure, prescribed, loads, method).positions
    size = jnp.zeros(len(positions), positions.dtype)
    for group, density in zip(structure.groups, densities, strict=True):
        amounts = jnp.abs(jnp.asarray(density, positions.dtype))[:, None]
        size = size.at[group.links.array].add(jnp.broadcast_to(amounts, group.links.shape))
    # without a force density a node may be anywhere
    held = structure.fixed(structure.supports).array.all(axis=1)
    return implicit.nan_unless(jnp.all(held | (size > 0)), positions, densities)


def find_form_by_analysis(
    structure: Structure,
    prescribed: PrescribedValues,
    loads: Load | Sequence[Load] | None,
    method: Newton,
) -> Form:
    """Find the form in which `prescribed` values hold, by an analysis of the whole structure.

    Arguments and errors are those of `find_form`.
    """
    passed, dependent = split_loads_for_analysis(structure, prescribed.is_prescribed, loads)
    form = _find_form(structure, prescribed, passed, dependent, method)
    return arrange_form_as_elements(form, structure)


def split_loads_for_analysis(
    structure: Structure, prescribed: Sequence[bool], loads: Load | Sequence[Load] | None
) -> tuple[list[Load], list[Any]]:
    """Check loads, and split them into those of an analysis and those that depend on the form.

    Args:
        structure: `Structure`.
        prescribed: for each group whether forces, densities or lengths of its elements are given.
        loads: as for `find_form`.

    Returns:
        passed: loads as the analysis takes them: those on nodes and faces, and on free groups.
        dependent: dead loads on areas, and on groups that are `prescribed`, with indices of groups.

    Raises:
        ValueError: a load that varies, or does not fit the structure; a load whose `on` names both
            prescribed and free groups; pressure per unstressed length on prescribed groups.
    """
    passed: list[Load] = []
    dependent: list[Any] = []
    for k, load in enumerate(as_list(loads)):
        if isinstance(load, Varying):
            raise ValueError(
                f"loads[{k}]: Varying follows the load factor, and a form has none; give its load"
            )
        load.check(structure)
        acts_on_form = isinstance(load, OnGroups) and isinstance(load, DeadLoad)
        if isinstance(load, OnFaces):
            acts_on_form = isinstance(load, AreaLoads) and load.faces is not None
        if not acts_on_form:
            _refuse_unknown_pressure(f"loads[{k}]", load, structure, prescribed)
            passed.append(load)
            continue
        known: Any = load
        known_key = known.on
        if known.needs_begin_nodes:  # the phase begins in the form
            known = copy_with(known, geometry="input")
        known = known.with_group_indices(structure)
        if isinstance(load, OnFaces):
            dependent.append(known)
            continue
        taking = [n for n in known.on if _takes_load(load, structure.groups[n])]
        own = tuple(n for n in taking if prescribed[n])
        if own:
            dependent.append(copy_with(known, on=own))
        if len(own) < len(taking):
            if own and known_key is not None:
                raise ValueError(
                    f"loads[{k}]: on = {known_key!r} means groups with prescribed values and "
                    "groups without; give a load for each group"
                )
            passed.append(load)
    return passed, dependent


def _takes_load(load, group):
    """Return whether a load along elements acts on a group: it has a weight, or a length."""
    return group.weight is not None if isinstance(load, SelfWeight) else group.has_length


def _refuse_unknown_pressure(where, load, structure, prescribed):
    """Raise ValueError, which names `where`, for pressure per unstressed length on given elements.

    Those are elements of groups with prescribed values, `prescribed` [n_group] bool.
    """
    if isinstance(load, CablePressure) and load.per == "unstressed":
        numbers, _ = load.loaded_groups(structure)
        if any(prescribed[n] for n in numbers):
            raise ValueError(
                f'{where}: CablePressure per "unstressed" length is not known on elements of given '
                'force, density or length; give it per "current" length'
            )


@as_program
def _find_form(structure, prescribed, passed, dependent, method):
    """Return the form of a structure with `prescribed` values, a `Form` with lists per group.

    `passed` and `dependent` are loads from `split_loads_for_analysis`.
    """
    nodes = jnp.asarray(structure.nodes)
    parameters = nodes, structure.groups, prescribed, passed, dependent
    prescribed, groups, dependent = cast_floats(
        (prescribed, structure.groups, dependent), nodes.dtype
    )
    allowed = input_status(nodes, structure.groups, method, dependent)

    def analyse(multipliers, springs):
        elements = _elements_of_analysis(groups, prescribed, multipliers, springs)
        loads = list(passed)
        if dependent:
            states = [
                held.form_state() if isinstance(held, PrescribedElements) else None
                for held in elements
            ]
            loads.append(FormLoads(FormDependentLoads(groups, dependent), states))
        whole = copy_with(structure, elements=structure.arrange(elements))
        return solve(whole, Phase(loads=loads or None), method)

    code, steps = allowed, 0
    if prescribed.has_lengths:
        multipliers, code, steps = _find_multipliers(analyse, groups, prescribed, nodes, method)
        code = status.first_failure(allowed, code)
        solution = analyse(*multipliers)
    else:
        solution = analyse(None, None)
    code = status.first_failure(code, solution.status)
    last, path = solution.last, solution.phases[0].path
    tensions, rests = map(structure.group_tree.flatten_up_to, (last.tension, last.rest_length))
    is_prescribed = prescribed.is_prescribed
    groups = merge_indices(*split_indices(groups))
    pairs = zip(groups, prescribed.forces, strict=True)
    chosen, forces = zip(*((group, own) for group, own in pairs if own is not None), strict=True)
    met = most_shortened_element(chosen, *lax.stop_gradient((nodes, last.positions, forces)))
    form = make_judged_form(
        *(groups, last.positions, tensions, code, path.residual[-1], jnp.ones((), nodes.dtype)),
        *(jnp.int32(steps) + jnp.sum(path.iterations), parameters, met, rests, is_prescribed),
    )
    return copy_with(form, relative_residual=path.relative_residual[-1])


def _elements_of_analysis(groups, prescribed, multipliers, springs):
    """Return all groups of elements for the analysis, a list in the order of the structure.

    A group with prescribed values becomes `PrescribedElements` as a whole, others stay.
    `multipliers` are the forces of the elements of given length, [n_all], N, group after group,
    `springs` their spring constants, [n_all], N/m; both None without such elements.
    """
    found, start = [], 0
    lists = prescribed.forces, prescribed.densities, prescribed.lengths
    for group, *values, at in zip(groups, *lists, prescribed.given_elements, strict=True):
        force, density, length = values
        if force is None:
            found.append(group)
            continue
        stiffness, natural = density, jnp.zeros_like(force)
        if len(at):
            end = start + len(at)
            force = force.at[at].set(multipliers[start:end])
            stiffness = stiffness.at[at].set(springs[start:end])
            natural = natural.at[at].set(length[at])
            start = end
        only = group.tension_only and not len(at)
        found.append(PrescribedElements(group.links, only, force, stiffness, natural))
    return found


def _elements_of_given_length(groups, prescribed):
    """Generate the elements of given length, group by group.

    Yields:
        (group, indices of its elements [n], node numbers [n, 2], given lengths [n], m).
    """
    lengths = zip(groups, prescribed.lengths, prescribed.given_elements, strict=True)
    for group, length, at in lengths:
        if len(at):
            yield group, at, group.links.array[at], length[at]


def _spring_constants(groups, prescribed, nodes):
    """Return spring constants of the elements of given length, [n_all], N/m, not differentiated.

    They are EA by the laws of the groups over the length, limited by the largest prescribed
    force.
    """
    forces = []
    for group, force, density in zip(groups, prescribed.forces, prescribed.densities, strict=True):
        if force is not None:
            forces += [force, density * group.chord(nodes[group.links.array])]
    largest = _SPRING_FORCE_RATIO * jnp.max(jnp.abs(jnp.concatenate(forces)))
    found = []
    for group, numbers, _, length in _elements_of_given_length(groups, prescribed):
        zero, one = jnp.zeros(len(group.links), nodes.dtype), jnp.ones(len(group.links))
        memory = group.initial_memory()
        # (B023: the function is called at once, not after the loop)
        _, slope = jax.jvp(lambda e: group.force(e, memory), (zero,), (one.astype(zero.dtype),))  # noqa: B023
        own = slope[numbers]
        found.append(jnp.where(largest > 0, jnp.minimum(own, largest), own) / length)
    return lax.stop_gradient(jnp.concatenate(found))


def _find_multipliers(analyse, groups, prescribed, nodes, method):
    """Find the forces of the elements of given length, with their implicit derivative.

    Args:
        analyse: function of forces, [n_all], N, and spring constants, [n_all], N/m, that returns
            the `Solution`.
        groups, prescribed, nodes, method: of the form.

    Returns:
        The forces and spring constants; the status; the number of linear solves.
    """
    wanted = jnp.concatenate([d[-1] for d in _elements_of_given_length(groups, prescribed)])

    def errors(solution):
        moved = solution.last.displacement
        return jnp.concatenate(
            [
                jax.vmap(length_error)(nodes[links], moved[links], length)
                for _, _, links, length in _elements_of_given_length(groups, prescribed)
            ]
        )

    tol = residual_tolerance(method, nodes.dtype)

    def improve(state):
        forces, springs, worst, _, count, steps = state
        solution = lax.stop_gradient(analyse(forces, springs))
        off = lax.stop_gradient(errors(solution))
        now = jnp.max(jnp.abs(off / wanted))
        forces = forces + springs * off
        springs = jnp.where((now > _SLOW * worst) & (count > 0), 10 * springs, springs)
        steps = steps + jnp.sum(solution.phases[0].path.iterations).astype(jnp.int32)
        return forces, springs, now, solution.status.astype(jnp.int32), count + 1, steps

    def goes_on(state):
        _, _, worst, code, count, _ = state
        return (code == status.OK) & ~(worst <= tol) & (count < _MAX_ANALYSES)

    forces = jnp.zeros_like(wanted)
    begin = forces, _spring_constants(groups, prescribed, nodes), jnp.full((), jnp.inf, nodes.dtype)
    zero = jnp.int32(0)
    frozen = lax.stop_gradient((*begin, jnp.int32(status.OK), zero, zero))
    forces, springs, worst, code, _, steps = lax.while_loop(goes_on, improve, frozen)
    late = jnp.where(worst <= tol, status.OK, status.NOT_CONVERGED)
    code = status.first_failure(code, late)
    valid = code == status.OK

    def residual(forces):
        return errors(analyse(forces, springs)) / wanted

    def tangent_solve(linearized, rhs):
        one = jnp.eye(len(rhs), dtype=rhs.dtype)
        matrix = jax.vmap(linearized, 1, 1)(one)
        return linear.solve_general(jnp.where(valid, matrix, one), rhs)[0]

    found = lax.custom_root(residual, lax.stop_gradient(forces), lambda _, x: x, tangent_solve)
    return (implicit.stop_gradient_unless(valid, found), springs), code, steps
