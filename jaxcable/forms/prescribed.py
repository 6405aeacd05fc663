"""Form finding with prescribed forces: the shape in which given tensions balance.

Forces ``T`` and loads ``p`` are given, positions are sought: ``sum_j T_ij (x_i - x_j)/l_ij = p_i``.
They are a stationary point of ``sum T l - p.x``, which is convex where all forces are tensions
(a sum of norms). With equal tensions the form is a minimal net. Elements whose length is given
instead take part with their force as an unknown, the multiplier of that condition (`lengths`).

The iteration is `newton.equilibrate`, with its tangent by autodiff and its line search, on members
that keep their force whatever their length. The derivative is by the implicit function theorem.
"""

from __future__ import annotations

import functools
from collections.abc import Sequence

import jax
import jax.numpy as jnp
from jax import lax

from ..common import status
from ..common.selection import Only
from ..common.tree import Indices, cast, copy, fill, thaw
from ..common.types import ArrayLike, Float, PyTree
from ..equilibrium import newton
from ..equilibrium.newton import Newton
from ..loads import Load
from ..model import plausibility
from ..model.parts import group_path
from ..model.structure import Structure
from ..model.supports import Fixed
from ..numerics import implicit
from ..spaces.freedoms import number_freedoms
from . import lengths
from .along import OnForm, split, touched
from .force_density import draped, number_axes
from .form import Form, arranged, make_form, nearest
from .members import check_members, require_one, stated, total, verdict
from .strings import StringNet

_STIFF = 1e3  # stiffness times length of the springs that keep lengths, over the largest force
_NEAR = 1e-4  # relative residual at which the iteration with springs ends


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

    Every element has one of `tension`, `stress` and `length`; each is a scalar, [n_elem],
    `selection.only(elements, values)`, or a prefix pytree of the structure's elements with such
    leaves and None. This is a pure function of pytrees: jit, vmap, grad, jvp, jacfwd and hessian
    work on it, with respect to forces, lengths, supports and loads.

    If every force is a tension and no length is given, the form minimises ``sum T l - p.x`` and is
    found from any sensible start. It need not exist: forces that cannot balance each other draw
    nodes together until an element has no length, or apart without limit; the status then is
    NOT_CONVERGED, NONFINITE or MECHANISM. If it is not unique (a node whose elements all lie in one
    line may slide) the form found depends on the start, and the derivatives of such a node are NaN.
    With struts or lengths there can be several forms; the form found is near the start.

    Equal tensions all along an edge cable are mostly not in balance with a net that pulls along it,
    and nodes meet then. For nets with edge cables begin with `force_density`, edges at ten to
    fifteen times the net, and give ``tension = q l`` of that shape, if at all; help(force_density)
    has an example with masts and guys.

    Args:
        structure: `Structure` of cables and bars; its nodes are the supports and the start.
        tension: axial force, N; negative in struts, which must be `Bars`.
        loads: `NodalLoads`, `SelfWeight`, `LineLoads` and `AreaLoads`, one or a list of them. Loads
            along elements and on areas are per lengths and areas of the form found, and per
            unstressed lengths that go with its forces, as in an analysis that begins with the form.
            (They depend on the positions of nodes, and the problem is no longer quite convex.)

    Options:
        length: distance of an element's ends in the form, under force, m.
        stress: tension over area, Pa, of groups with an area or a section.
        method: `Newton`, as for `solve`, with the same meaning of `tol`. Lengths are met within
            `tol` relative to them; given lengths exclude the solver PARDISO (default: SuperLU).

    Returns:
        `Form`; check its `status`, or call `raise_if_failed`. The status is PUSHING_CABLE if a
        cable of given length would have to push, and MATERIAL_FAILURE if a force is beyond the
        curve of a law.

    Raises:
        ValueError: elements that are not straight members, an element with two statements or none,
            other loads, lengths together with loads that depend on the form, a negative tension in
            a cable, a length that is not positive.

    Source: Linkwitz and Schek (1971) for nets with prescribed forces and lengths; Weber's problem
    for the convexity and for nodes that meet.

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
    check_members(structure)
    plausibility.precision(structure.nodes)
    method = Newton() if method is None else method
    if not isinstance(method, Newton):
        raise ValueError(f"method: expected Newton, got {type(method).__name__}")
    loads, others = split(structure, loads)
    tensions, sought, given = statements(structure, tension, stress, length)
    mixed = any(mask.any() for mask in sought)
    if mixed and others:
        raise ValueError(
            f"loads: {type(others[0]).__name__} depends on unstressed lengths and places of the "
            "form, which are not known where `length` is given; give tensions, or NodalLoads"
        )
    fixed = Fixed(structure.held())
    links = tuple(group.links for group in structure.groups)
    solver = method.linear_solver
    coupled = (*((ends, 3, ()) for ends in links), *touched(structure, others))
    freedoms = number_freedoms(fixed, None, coupled, solver, not others)
    extra = lengths.number(fixed, links, tuple(map(Indices, sought)), solver) if mixed else None
    convex = not mixed and all(group.tension_only for group in structure.groups)
    net = number_axes(fixed, links, solver) if convex else None
    problem = (structure.nodes, structure.groups, tensions, given, loads, others or None)
    thawed, arrays = thaw(problem)
    return arranged(_find(thawed, arrays, freedoms, extra, net, method, convex), structure)


def statements(structure, tension, stress, length):
    """The statements on all elements, checked: exactly one for every element.

    Returns:
        tensions: prescribed forces per group, [n_elem], zero where the length is given, N.
        sought: whether the length is given and the force sought, per group [n_elem] bool, NumPy.
        given: per group the pair (lengths [n_elem], m, 1 where none is given; where they are given,
            [n_elem] bool), or None for a group without lengths.
    """
    (pulls, pulled), (stresses, stressed), (wanted, sought) = (
        stated(tension, structure, "tension"),
        stated(stress, structure, "stress"),
        stated(length, structure, "length", is_length=True),
    )
    names, chosen = ("tension", "stress", "length"), (pulled, stressed, sought)
    require_one(structure, names, chosen, "has neither tension, stress nor length")
    tensions, given = [], []
    for k, group in enumerate(structure.groups):
        forces = jnp.zeros(len(group.links))
        if pulls[k] is not None:
            forces = jnp.where(pulled[k], pulls[k], forces)
        if stressed[k].any():
            area = group._section()[2]
            if area is None:
                raise ValueError(f"stress: {group_path(structure, k)} has no area; give tension")
            forces = jnp.where(stressed[k], stresses[k] * area, forces)
        tensions.append(forces)
        if wanted[k] is None:
            given.append(None)
        else:
            given.append((jnp.where(sought[k], wanted[k], 1.0), sought[k]))
    return tensions, sought, given


@functools.partial(jax.jit, static_argnames=("convex",))
def _find(thawed, arrays, freedoms, extra, net, method, convex):
    """The compiled core; results per element are lists with one item per group."""
    parameters = fill(thawed, arrays)
    dtype = parameters[0].dtype
    nodes, groups, tensions, given, loads, others = cast(parameters, dtype)
    strings = StringNet(
        nodes,
        [group.links for group in groups],
        tensions,
        [None] * len(groups),
        total(loads, nodes.shape, dtype),
        None if others is None else OnForm(groups, others),
        convex,
    )
    allowed = verdict(parameters[0], parameters[1], method, others)
    frozen = lax.stop_gradient(strings)
    still = jnp.zeros_like(nodes)

    def begin(system):
        if net is None:
            return still
        return draped(system, lambda x: _densities(frozen.forces, x[net[0]]), net)

    if extra is None:
        found, code, attached, motion = strings.equilibrated(begin, method, freedoms, allowed)
        valid = code == status.OK
        steps, residual, scale = found.steps, found.residual, found.scale
        reached, forces = found.x, [state.force for state in attached.states]
    else:
        struts = not all(group.tension_only for group in groups)
        z, code, steps, residual, scale = _with_lengths(
            frozen, lax.stop_gradient(given), still, freedoms, extra, method, struts
        )
        code = status.first_failure(allowed, code)
        valid = code == status.OK
        saddle = _saddle(*implicit.gate(valid, (strings, given)), freedoms, extra)
        reached = saddle.motion(z)
        z = lengths.attach(saddle, z, valid)
        forces, motion = saddle.forces(z), saddle.motion(z)
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
    met = nearest(groups, frozen.nodes, frozen.nodes + lax.stop_gradient(reached))
    return make_form(groups, positions, forces, code, worst, scale, steps, parameters, met)


def _densities(forces, ends):
    """Force densities T/l of all elements, for `force_density.draped`.

    Each form minimises a parabola above ``sum T l - p.x`` that touches it (Weiszfeld 1937), hence
    leads downward from any shape; Newton's method is faster near the end.
    """
    return jnp.concatenate(forces) / jnp.linalg.norm(ends[:, 1] - ends[:, 0], axis=-1)


def _saddle(strings, given, freedoms, extra):
    """The `lengths.Saddle`; its unit gives displacements and forces matrix entries of like size."""
    made = strings.system(freedoms)
    given = [None if pair is None else pair[0] for pair in given]
    unit = lax.stop_gradient(jnp.sqrt(_force(strings) / made.length_scale()))
    return lengths.Saddle(made, given, unit, extra)


def _force(strings):
    """The size of the prescribed forces and loads, N; 1 if there are none."""
    force = jnp.max(jnp.abs(jnp.concatenate([*strings.forces, strings.load.reshape(-1)])))
    return jnp.where(force > 0, force, 1.0)


def _with_lengths(strings, given, start, freedoms, extra, method, struts):
    """Point of the `Saddle`, status, steps, unbalanced forces and their scale.

    For cables alone, stiff springs come first, which lead close to the form from nearly any start;
    then Newton's method on the saddle meets the lengths. With bars, springs may lead away from the
    form sought (a tensegrity under constant forces): then the saddle comes first, from the forces
    that balance best at the start, and springs only if that fails.
    """
    tol = newton.limit(method, start.dtype)
    saddle = _saddle(strings, given, freedoms, extra)
    known = jnp.zeros((), bool)
    if struts:
        first = lengths.settle(saddle, saddle.balanced(start), tol, method.max_steps, ~known)
        known = first[1] == status.OK
    force = _STIFF * _force(strings)
    springs = [
        pair and (jnp.where(pair[1], force / pair[0], 0.0), pair[0])  # None if no length is given
        for pair in given
    ]
    sprung = copy(strings, springs=springs).system(freedoms)
    near, _ = newton.equilibrate(sprung, start, copy(method, tol=_NEAR), ~known)
    z = saddle.join(near.x, sprung.tensions(near.x))
    active = ~known & (near.code == status.OK)
    limit = method.max_steps - near.steps
    z, code, steps, residual, scale = lengths.settle(saddle, z, tol, limit, active)
    second = z, jnp.where(active, code, near.code), near.steps + steps, residual, scale
    if not struts:
        return second
    chosen = list(jax.tree.map(lambda a, b: jnp.where(known, a, b), first, second))
    chosen[2] = first[2] + second[2]
    return chosen
