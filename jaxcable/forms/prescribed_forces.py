"""Form finding with prescribed forces: the shape in which given tensions balance.

Forces ``T`` and loads ``p`` are given, positions are sought: ``sum_j T_ij (x_i - x_j)/l_ij = p_i``.
They are a stationary point of ``sum T l - p.x``, which is convex where all forces are tensions
(a sum of norms). With equal tensions the form is a minimal net. A force density q adds
``q l^2 / 2``. Where the length of an element is given instead, its force is an unknown: the
Lagrange multiplier of that condition (`given_lengths`).

`newton.equilibrate` iterates, with a tangent by autodiff and a line search, on elements that keep
their force whatever their length (`force_elements`). The derivative follows from the implicit
function theorem. Where elements keep their own law, a support holds another direction than x, y,
z, or other loads act, the form is that of an analysis (`forms_by_analysis`).
"""

from __future__ import annotations

import functools
from collections.abc import Sequence
from typing import Any

import jax.numpy as jnp
from jax import lax

from ..common import status
from ..common.selection import Only
from ..common.tree import cast_floats, copy_with, merge_indices, split_indices
from ..common.types import ArrayLike, Float, PyTree
from ..equilibrium import newton
from ..equilibrium.newton import Newton
from ..loads import Load
from ..model import plausibility
from ..model.structure import Structure
from ..model.supports import FixedDofs
from ..numerics import implicit
from ..numerics.vectors import chord_lengths
from ..programs.program_calls import as_program
from ..spaces.dof_map import make_dof_map
from . import given_lengths
from .force_density import number_unknowns_by_axis, start_displacements_by_force_density
from .force_elements import ForceElementNet
from .form import Form, arrange_form_as_elements, make_judged_form, most_shortened_element
from .form_dependent_loads import FormDependentLoads, nodes_coupled_by_loads, split_loads
from .forms_by_analysis import find_form_by_analysis, needs_analysis
from .input_checks import (
    input_status,
    require_structure,
    sum_nodal_loads,
    warn_of_hanging_elements,
)
from .prescribed_values import read_prescribed_values

# Stiffness times length of the springs that nearly keep lengths, over the largest force. Where a
# third of the elements of a saddle net of 64 free nodes has given lengths, 43 steps lead to the
# form. Half or twice the ratio takes 44 or 51, a tenth 86; a hundredth finds no form.
_SPRING_FORCE_RATIO = 1e3
# Relative residual at which the iteration with springs ends. The number of steps hardly depends on
# it (42 at 1e-2, 43 at 1e-3): Newton's method converges quadratically here.
_SPRING_TOLERANCE = 1e-4


def find_form(
    structure: Structure,
    tension: PyTree[Float[ArrayLike, " ..."] | Only] | None = None,
    loads: Load | Sequence[Load] | None = None,
    *,
    length: PyTree[Float[ArrayLike, " ..."] | Only] | None = None,
    stress: PyTree[Float[ArrayLike, " ..."] | Only] | None = None,
    force_density: PyTree[Float[ArrayLike, " ..."] | Only] | None = None,
    method: Newton | None = None,
) -> Form:
    """Find the shape in which prescribed forces, force densities and lengths are in equilibrium.

    Every element of a group of cables or bars has one of `tension`, `stress`, `force_density` and
    `length`, or the whole group has none. Each of these is a number for all such groups, [n_elem],
    `selection.only(elements, values)`, or a prefix pytree of the structure's elements with such
    leaves and None. Groups without any of them belong to the structure as they are: bars, beams,
    cables and all other elements, with the drawn geometry (or their `rest_length`) as their
    unstressed shape. This is a pure function of pytrees: jit, vmap, grad, jvp, jacfwd and hessian
    work on it, with respect to forces, densities, lengths, supports, loads and stiffnesses.

    If every force is a tension and no length is given, the form minimises ``sum T l - p.x`` and is
    found from any sensible start. It need not exist: forces that are not in equilibrium in any
    shape draw nodes together until an element has zero length, or drive them apart without limit.
    The status then is NOT_CONVERGED, NONFINITE or MECHANISM. The form need not be unique: a node
    whose elements all lie in one line may slide. Then the form found depends on the start, and the
    derivatives of such a node are NaN. With struts or lengths there can be several forms; the one
    near the start is found.

    Equal tensions all along an edge cable are rarely in equilibrium with a net that pulls along it;
    nodes meet then. For nets with edge cables begin with `force_density`, with force densities of
    the edges ten to fifteen times those of the net. If prescribed tensions are needed at all, take
    ``tension = q l`` of that shape. help(force_density) has an example with masts and guys.

    Args:
        structure: `Structure`; its nodes are the supports and the start. Supports may hold any
            directions (`restrained`), such as radial bearings of a ring.
        tension: axial force, N; negative in struts, which must be `Bars`.
        loads: any loads that `solve` takes except `Varying`, one or a list of them. Dead loads on
            areas and along elements with prescribed values refer to the areas and lengths of the
            form found, and to the unstressed lengths that follow from its forces, as in an analysis
            that begins with the form. (They depend on the positions of nodes; the problem is no
            longer strictly convex.) On other groups they are those of `solve`.

    Options:
        length: distance of an element's ends in the form, under force, m.
        stress: tension over area, Pa, of groups with an area or a section.
        force_density: tension over length, N/m.
        method: `Newton`, as for `solve`, with the same meaning of `tol`. Relative errors of lengths
            are at most `tol`. Where nothing but forces, densities and lengths is in the problem,
            given lengths exclude the solver PARDISO (default: SuperLU).

    Returns:
        `Form`; check its `status`, or call `raise_if_failed`. The status is PUSHING_CABLE if a
        cable of given length would be in compression, and MATERIAL_FAILURE if a force is beyond the
        curve of a law.

    Raises:
        ValueError: values for elements that are not straight, an element with two of these values,
            or with none although others of its group have one, nothing prescribed, a load that
            varies, a load that names groups with and without values, a pressure per unstressed
            length on elements with values, a negative tension in a cable, a length that is not
            positive.

    Source: Linkwitz and Schek (1971) for nets with prescribed forces and lengths. Convexity, and
    nodes that meet, are known from Weber's problem.

    Example:
        600 N on two cables of 500 N: a 3-4-5 triangle, found from any start.

        >>> nodes = [[-4.0, 0.0, 3.0], [1.0, 0.0, 2.0], [4.0, 0.0, 3.0]]
        >>> cables = jc.Cables([[0, 1], [1, 2]], axial_stiffness=1e5)
        >>> structure = jc.Structure(nodes, cables, supports=jc.pinned([0, 2]))
        >>> weight = jc.NodalLoads([1], (0.0, 0.0, -600.0))
        >>> form = jc.find_form(structure, tension=500.0, loads=weight)
        >>> print(f"{jc.describe(form.status)}: {form.length[0]:.6f} m")
        converged: 5.000000 m

        The analysis of this form begins in equilibrium:

        >>> found = jc.replace(structure, nodes=form.positions)
        >>> solution = jc.solve(found, jc.Phase(pretension=form.tension, loads=weight))
        >>> print(solution.status, f"{jnp.abs(solution.displacement).max():.6f} m")
        0 0.000000 m

        Two guys of 20 kN at an elastic mast, which gets shorter, and a cable of 500 N/m beside it:

        >>> nodes = [[0.0, 0, 0], [0, 0, 3], [-4, 0, 0], [4, 0, 0], [0, 4, 3], [0, 2, 3]]
        >>> elements = {
        ...     "mast": jc.Bars([[0, 1]], axial_stiffness=1e6),
        ...     "guys": jc.Cables([[1, 2], [1, 3]], axial_stiffness=2e6),
        ...     "cable": jc.Cables([[1, 5], [5, 4]], axial_stiffness=2e6),
        ... }
        >>> ground = jc.pinned([0, 2, 3, 4]) + jc.restrained([1], along="xy")
        >>> roof = jc.Structure(nodes, elements, supports=ground)
        >>> weight = jc.NodalLoads([5], (0.0, 0.0, -300.0))
        >>> form = jc.find_form(roof, {"guys": 20e3}, weight, force_density={"cable": 500.0})
        >>> print(form.status, form.positions[1, 2].round(4), form.tension["mast"].round(1))
        0 2.9287 [-23762.5]

        What is bent or strained is built from the drawn shape, with the lengths of the form:

        >>> rest = {name: form.rest_length[name] for name in ("guys", "cable")}
        >>> built = jc.solve(roof, jc.Phase(rest_length=rest, loads=weight))
        >>> print(built.status, bool(jnp.abs(built.positions - form.positions).max() < 1e-9))
        0 True
    """
    require_structure(structure)
    plausibility.warn_of_lost_precision(structure.nodes)
    method = Newton() if method is None else method
    if not isinstance(method, Newton):
        raise ValueError(f"method: expected Newton, got {type(method).__name__}")
    prescribed = read_prescribed_values(structure, tension, stress, length, force_density)
    warn_of_hanging_elements(structure.named_groups(), prescribed.is_prescribed, loads)
    if needs_analysis(structure, loads, prescribed.has_lengths, all(prescribed.is_prescribed)):
        return find_form_by_analysis(structure, prescribed, loads, method)
    loads, others = split_loads(structure, loads)
    tensions: Any = prescribed.forces
    fixed = FixedDofs(structure.held_displacements())
    links = tuple(group.links for group in structure.groups)
    solver = method.linear_solver
    loaded = nodes_coupled_by_loads(structure.groups, others)
    coupled = (*((ends, 3, ()) for ends in links), *loaded)
    dof_map = make_dof_map(fixed, None, coupled, solver, not others)
    mixed = prescribed.has_lengths
    given, sought = prescribed.given_lengths, prescribed.sought
    saddle_numbering = (
        given_lengths.number_saddle_point_unknowns(fixed, links, sought, solver) if mixed else None
    )
    convex = not mixed and all(group.tension_only for group in structure.groups)
    axis_numbering = number_unknowns_by_axis(fixed, links, solver) if convex else None
    problem = (
        *(structure.nodes, structure.groups, tensions, prescribed.densities, given, loads),
        others or None,
    )
    without_indices, index_arrays = split_indices(problem)
    numberings = dof_map, saddle_numbering, axis_numbering
    return arrange_form_as_elements(
        _solve_form(without_indices, index_arrays, *numberings, method, convex=convex), structure
    )


@functools.partial(as_program, static=("convex",))
def _solve_form(
    without_indices, index_arrays, dof_map, saddle_numbering, axis_numbering, method, convex
):
    """Find the form with prescribed forces and lengths, a `Form` with lists per group; a program.

    `dof_map`, `saddle_numbering` (None if no lengths are given) and `axis_numbering` (None unless
    `convex`) number the unknowns. `convex` says that there are tensions only, and no lengths.
    """
    parameters = merge_indices(without_indices, index_arrays)
    dtype = parameters[0].dtype
    nodes, groups, tensions, densities, given, loads, others = cast_floats(parameters, dtype)
    force_net = ForceElementNet(
        nodes,
        [group.links for group in groups],
        tensions,
        [(q, jnp.zeros_like(q)) for q in densities],
        sum_nodal_loads(loads, nodes.shape, dtype),
        None if others is None else FormDependentLoads(groups, others),
        convex,
    )
    allowed = input_status(parameters[0], parameters[1], method, others)
    frozen = lax.stop_gradient(force_net)
    still = jnp.zeros_like(nodes)

    def begin(system):
        if axis_numbering is None:
            return still
        links = axis_numbering[0]

        def densities_at(x):
            return _force_densities(frozen, x[links])

        return start_displacements_by_force_density(system, densities_at, axis_numbering)

    if saddle_numbering is None:
        found, code, attached, motion = force_net.find_equilibrium(begin, method, dof_map, allowed)
        valid = code == status.OK
        steps, residual, scale = found.steps, found.residual, found.scale
        reached, forces = found.x, [state.force for state in attached.states]
    else:
        struts = not all(group.tension_only for group in groups)
        z, code, steps, residual, scale = _solve_with_lengths(
            frozen, lax.stop_gradient(given), still, dof_map, saddle_numbering, method, struts
        )
        code = status.first_failure(allowed, code)
        valid = code == status.OK
        saddle = _make_saddle_point_system(
            *implicit.stop_gradient_unless(valid, (force_net, given)), dof_map, saddle_numbering
        )
        reached = saddle.nodal_motion(z)
        z = given_lengths.attach_saddle_point_derivative(saddle, z, valid)
        forces, motion = saddle.axial_forces(z), saddle.nodal_motion(z)
        attached = saddle.system
    found_nodes = attached.nodes + motion
    forces = [
        force + state.stiffness * chord_lengths(found_nodes[group.links])
        for force, state, group in zip(forces, attached.states, groups, strict=True)
    ]
    # without a form take the start, so that lengths and their derivatives stay finite
    positions = jnp.where(valid, found_nodes, nodes)
    worst = jnp.max(jnp.abs(residual), initial=0.0)
    moved = frozen.nodes + lax.stop_gradient(reached)
    met = most_shortened_element(groups, frozen.nodes, moved, lax.stop_gradient(tensions))
    return make_judged_form(groups, positions, forces, code, worst, scale, steps, parameters, met)


def _force_densities(net, ends):
    """Return the force densities T/l + q of all elements, [n_elem], N/m, for given end positions.

    The form with these force densities minimises a parabola that lies above ``sum T l - p.x`` and
    touches it at these ends (Weiszfeld 1937): it decreases this function from any shape. Newton's
    method is faster near the minimum.
    """
    stiffnesses = jnp.concatenate([stiffness for stiffness, _ in net.springs])
    return jnp.concatenate(net.forces) / chord_lengths(ends) + stiffnesses


def _make_saddle_point_system(force_net, given, dof_map, saddle_numbering):
    """Return the `SaddlePointSystem` of a `ForceElementNet` in which some lengths are given.

    `given` has for each group the pair of lengths, m, and where they are given; `dof_map` and
    `saddle_numbering` number the unknowns.
    """
    made = force_net.make_system(dof_map)
    given = [lengths for lengths, _ in given]
    unit = lax.stop_gradient(jnp.sqrt(_force_scale(force_net) / made.length_scale()))
    return given_lengths.SaddlePointSystem(made, given, unit, saddle_numbering)


def _force_scale(force_net):
    """Return the largest absolute prescribed force or load, N; 1 if there are none.

    Force densities count by the lengths at the start.
    """
    forces = [*force_net.forces, force_net.load.reshape(-1)]
    for links, (stiffness, _) in zip(force_net.links, force_net.springs, strict=True):
        forces.append(stiffness * chord_lengths(force_net.nodes[links]))
    force = jnp.max(jnp.abs(jnp.concatenate(forces)))
    return jnp.where(force > 0, force, 1.0)


def _springs_for_lengths(force, pair, spring):
    """Return stiffness and natural length of springs in place of the given lengths of a group.

    `force` is stiffness times length, N; `pair` has the lengths and where they are given; `spring`
    are stiffness and natural length of the springs of its force densities.
    """
    length, mask = pair
    return jnp.where(mask, force / length, spring[0]), jnp.where(mask, length, spring[1])


def _solve_with_lengths(force_net, given, start, dof_map, saddle_numbering, method, struts):
    """Find the form with given lengths: a solution of the `SaddlePointSystem`.

    For cables alone, stiff springs in place of the lengths lead close to the form from nearly any
    start; then Newton's method on the system meets the lengths. With bars, springs may lead away
    from the form (a tensegrity under constant forces): then the system is solved first, from the
    forces that leave the smallest residual at the start, and springs are used only if that fails.

    Args:
        force_net: `ForceElementNet`, whose springs are force densities.
        given: for each group lengths and where they are given (`PrescribedValues.given_lengths`).
        start: displacements at the start, [n_node, 3], m.
        dof_map: numbering of the free displacements.
        saddle_numbering: `SaddlePointNumbering`.
        method: `Newton`.
        struts: whether there are bars.

    Returns:
        The unknowns [n_all]; the status; the number of steps; the unbalanced forces [n_free], N;
            the force that they are compared with, N.
    """
    tol = newton.residual_tolerance(method, start.dtype)
    saddle = _make_saddle_point_system(force_net, given, dof_map, saddle_numbering)
    known = jnp.zeros((), bool)
    if struts:
        first, code, first_steps = given_lengths.solve_saddle_point(
            saddle, saddle.unknowns_of_least_residual(start), tol, method.max_steps
        )
        known = code == status.OK
    force = _SPRING_FORCE_RATIO * _force_scale(force_net)
    springs = [
        _springs_for_lengths(force, *both) for both in zip(given, force_net.springs, strict=True)
    ]
    sprung = copy_with(force_net, springs=springs).make_system(dof_map)
    near, _ = newton.equilibrate(sprung, start, copy_with(method, tol=_SPRING_TOLERANCE), ~known)
    z = saddle.join_unknowns(near.x, sprung.tensions(near.x))
    active = ~known & (near.code == status.OK)
    limit = jnp.where(active, method.max_steps - near.steps, 0)
    z, code, steps = given_lengths.solve_saddle_point(saddle, z, tol, limit)
    code, steps = jnp.where(active, code, near.code), near.steps + steps
    if struts:
        z, code = jnp.where(known, first, z), jnp.where(known, status.OK, code)
        steps = first_steps + steps
    return z, code, steps, *saddle.convergence_measures(z)[:2]
