"""Form finding with prescribed forces: the shape in which given tensions balance.

Forces ``T`` and loads ``p`` are given, positions are sought: ``sum_j T_ij (x_i - x_j)/l_ij = p_i``.
They are a stationary point of ``sum T l - p.x``, which is convex where all forces are tensions
(a sum of norms). With equal tensions the form is a minimal net. Where the length of an element is
given instead, its force is an unknown: the Lagrange multiplier of that condition (`given_lengths`).

`newton.equilibrate` iterates, with a tangent by autodiff and a line search, on elements that keep
their force whatever their length (`force_elements`). The derivative follows from the implicit
function theorem.
"""

from __future__ import annotations

import functools
from collections.abc import Sequence

import jax
import jax.numpy as jnp
from jax import lax

from ..common import status
from ..common.selection import Only
from ..common.tree import Indices, cast_floats, copy_with, merge_indices, split_indices
from ..common.types import ArrayLike, Float, PyTree
from ..equilibrium import newton
from ..equilibrium.newton import Newton
from ..loads import Load
from ..model import plausibility
from ..model.result_parts import path_of_group
from ..model.structure import Structure
from ..model.supports import FixedDofs
from ..numerics import implicit
from ..spaces.dof_map import make_dof_map
from . import given_lengths
from .force_density import number_unknowns_by_axis, start_displacements_by_force_density
from .force_elements import ForceElementNet
from .form import Form, arrange_form_as_elements, make_form, most_shortened_element
from .form_dependent_loads import FormDependentLoads, nodes_coupled_by_loads, split_loads
from .input_checks import (
    input_status,
    require_single_input,
    require_straight_elements,
    sum_nodal_loads,
    values_by_group,
)

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
    method: Newton | None = None,
) -> Form:
    """Find the shape in which prescribed forces, and lengths of other elements, are in equilibrium.

    Every element has exactly one of `tension`, `stress` and `length`. Each of these is a scalar,
    [n_elem], `selection.only(elements, values)`, or a prefix pytree of the structure's elements
    with such leaves and None. This is a pure function of pytrees: jit, vmap, grad, jvp, jacfwd and
    hessian work on it, with respect to forces, lengths, supports and loads.

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
        structure: `Structure` of cables and bars; its nodes are the supports and the start.
        tension: axial force, N; negative in struts, which must be `Bars`.
        loads: `NodalLoads`, `PointMasses`, `SelfWeight`, `LineLoads` and `AreaLoads`, one or a
            list of them. Loads along elements and on areas refer to the lengths and areas of the
            form found, and to the unstressed lengths that follow from its forces, as in an analysis
            that begins with the form. (They depend on the positions of nodes; the problem is no
            longer strictly convex.)

    Options:
        length: distance of an element's ends in the form, under force, m.
        stress: tension over area, Pa, of groups with an area or a section.
        method: `Newton`, as for `solve`, with the same meaning of `tol`. Relative errors of lengths
            are at most `tol`. Given lengths exclude the solver PARDISO (default: SuperLU).

    Returns:
        `Form`; check its `status`, or call `raise_if_failed`. The status is PUSHING_CABLE if a
        cable of given length would be in compression, and MATERIAL_FAILURE if a force is beyond the
        curve of a law.

    Raises:
        ValueError: elements that are not straight, an element with two of these inputs or none,
            other loads, lengths together with loads that depend on the form, a negative tension in
            a cable, a length that is not positive.

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
    """
    require_straight_elements(structure)
    plausibility.warn_of_lost_precision(structure.nodes)
    method = Newton() if method is None else method
    if not isinstance(method, Newton):
        raise ValueError(f"method: expected Newton, got {type(method).__name__}")
    loads, others = split_loads(structure, loads)
    tensions, sought, given = tensions_and_lengths(structure, tension, stress, length)
    mixed = any(mask.any() for mask in sought)
    if mixed and others:
        raise ValueError(
            f"loads: {type(others[0]).__name__} depends on the shape and the unstressed lengths of "
            "the form, which cannot be combined with given lengths (`length`); give tensions "
            "instead, or NodalLoads"
        )
    fixed = FixedDofs(structure.held_displacements())
    links = tuple(group.links for group in structure.groups)
    solver = method.linear_solver
    coupled = (*((ends, 3, ()) for ends in links), *nodes_coupled_by_loads(structure, others))
    dof_map = make_dof_map(fixed, None, coupled, solver, not others)
    saddle_numbering = (
        given_lengths.number_saddle_point_unknowns(
            fixed, links, tuple(map(Indices, sought)), solver
        )
        if mixed
        else None
    )
    convex = not mixed and all(group.tension_only for group in structure.groups)
    axis_numbering = number_unknowns_by_axis(fixed, links, solver) if convex else None
    problem = (structure.nodes, structure.groups, tensions, given, loads, others or None)
    without_indices, index_arrays = split_indices(problem)
    numberings = dof_map, saddle_numbering, axis_numbering
    return arrange_form_as_elements(
        _solve_form(without_indices, index_arrays, *numberings, method, convex), structure
    )


def tensions_and_lengths(structure, tension, stress, length):
    """Check that every element has one of tension, stress and length; return forces and lengths.

    Returns:
        tensions: for each group the prescribed forces, [n_elem], N; zero where the length is given.
        sought: for each group whether the length is given and the force sought, [n_elem] bool,
            NumPy.
        given: for each group the pair (lengths [n_elem], m, with 1 where none is given; whether the
            length is given, [n_elem] bool), or None for a group without lengths.
    """
    (pulls, pulled), (stresses, stressed), (wanted, sought) = (
        values_by_group(tension, structure, "tension"),
        values_by_group(stress, structure, "stress"),
        values_by_group(length, structure, "length", is_length=True),
    )
    names, chosen = ("tension", "stress", "length"), (pulled, stressed, sought)
    require_single_input(structure, names, chosen, "has neither tension, stress nor length")
    tensions, given = [], []
    for k, group in enumerate(structure.groups):
        forces = jnp.zeros(len(group.links))
        if pulls[k] is not None:
            forces = jnp.where(pulled[k], pulls[k], forces)
        if stressed[k].any():
            area = group._axial_section()[2]
            if area is None:
                raise ValueError(f"stress: {path_of_group(structure, k)} has no area; give tension")
            forces = jnp.where(stressed[k], stresses[k] * area, forces)
        tensions.append(forces)
        if wanted[k] is None:
            given.append(None)
        else:
            given.append((jnp.where(sought[k], wanted[k], 1.0), sought[k]))
    return tensions, sought, given


@functools.partial(jax.jit, static_argnames=("convex",))
def _solve_form(
    without_indices, index_arrays, dof_map, saddle_numbering, axis_numbering, method, convex
):
    """Find the form with prescribed forces and lengths, a `Form` with lists per group; compiled.

    `dof_map`, `saddle_numbering` (None if no lengths are given) and `axis_numbering` (None unless
    `convex`) number the unknowns. `convex` says that there are tensions only, and no lengths.
    """
    parameters = merge_indices(without_indices, index_arrays)
    dtype = parameters[0].dtype
    nodes, groups, tensions, given, loads, others = cast_floats(parameters, dtype)
    force_net = ForceElementNet(
        nodes,
        [group.links for group in groups],
        tensions,
        [None] * len(groups),
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

        def densities(x):
            return _force_densities(frozen.forces, x[links])

        return start_displacements_by_force_density(system, densities, axis_numbering)

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
    # without a form take the start, so that lengths and their derivatives stay finite
    positions = jnp.where(valid, attached.nodes + motion, nodes)
    pushing = [
        jnp.any(force < 0)
        for group, force in zip(groups, forces, strict=True)
        if group.tension_only
    ]
    slack = jnp.any(jnp.stack([jnp.zeros((), bool), *pushing]))
    code = status.first_failure(code, jnp.where(slack, status.PUSHING_CABLE, status.OK))
    worst = jnp.max(jnp.abs(residual), initial=0.0)
    met = most_shortened_element(groups, frozen.nodes, frozen.nodes + lax.stop_gradient(reached))
    return make_form(groups, positions, forces, code, worst, scale, steps, parameters, met)


def _force_densities(forces, ends):
    """Return the force densities T/l of all elements, [n_elem], N/m, for given end positions.

    The form with these force densities minimises a parabola that lies above ``sum T l - p.x`` and
    touches it at these ends (Weiszfeld 1937): it decreases this function from any shape. Newton's
    method is faster near the minimum.
    """
    return jnp.concatenate(forces) / jnp.linalg.norm(ends[:, 1] - ends[:, 0], axis=-1)


def _make_saddle_point_system(force_net, given, dof_map, saddle_numbering):
    """Make the `SaddlePointSystem` of a net in which some lengths are given.

    `given` has for each group the pair of lengths and where they are given, or None.
    """
    made = force_net.make_system(dof_map)
    given = [None if pair is None else pair[0] for pair in given]
    unit = lax.stop_gradient(jnp.sqrt(_force_scale(force_net) / made.length_scale()))
    return given_lengths.SaddlePointSystem(made, given, unit, saddle_numbering)


def _force_scale(force_net):
    """Return the largest absolute prescribed force or load, N; 1 if there are none."""
    force = jnp.max(jnp.abs(jnp.concatenate([*force_net.forces, force_net.load.reshape(-1)])))
    return jnp.where(force > 0, force, 1.0)


def _solve_with_lengths(force_net, given, start, dof_map, saddle_numbering, method, struts):
    """Find the form with given lengths: a solution of the `SaddlePointSystem`.

    For cables alone, stiff springs in place of the lengths lead close to the form from nearly any
    start; then Newton's method on the system meets the lengths. With bars, springs may lead away
    from the form (a tensegrity under constant forces): then the system is solved first, from the
    forces that leave the smallest residual at the start, and springs are used only if that fails.

    Args:
        force_net: `ForceElementNet` without springs.
        given: for each group lengths and where they are given, from `tensions_and_lengths`.
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
        first = given_lengths.solve_saddle_point(
            saddle, saddle.unknowns_of_least_residual(start), tol, method.max_steps, ~known
        )
        known = first[1] == status.OK
    force = _SPRING_FORCE_RATIO * _force_scale(force_net)
    springs = [
        pair and (jnp.where(pair[1], force / pair[0], 0.0), pair[0])  # None if no length is given
        for pair in given
    ]
    sprung = copy_with(force_net, springs=springs).make_system(dof_map)
    near, _ = newton.equilibrate(sprung, start, copy_with(method, tol=_SPRING_TOLERANCE), ~known)
    z = saddle.join_unknowns(near.x, sprung.tensions(near.x))
    active = ~known & (near.code == status.OK)
    limit = method.max_steps - near.steps
    z, code, steps, residual, scale = given_lengths.solve_saddle_point(
        saddle, z, tol, limit, active
    )
    second = z, jnp.where(active, code, near.code), near.steps + steps, residual, scale
    if not struts:
        return second
    chosen = list(jax.tree.map(lambda a, b: jnp.where(known, a, b), first, second))
    chosen[2] = first[2] + second[2]
    return chosen
