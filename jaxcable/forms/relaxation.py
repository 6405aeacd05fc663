"""Dynamic relaxation with kinetic damping: a second way to the same forms, for checks.

The net starts at rest and moves under its unbalanced forces R with fictitious masses. Whenever its
kinetic energy has passed a peak, it is stopped at the peak and starts again. Central differences
with a time step of 1,

    v(t + 1/2) = v(t - 1/2) + R(t)/m,      x(t + 1) = x(t) + v(t + 1/2),

are stable if the mass of a node is at least half the sum of the stiffnesses of its elements (the
largest eigenvalue is at most twice that sum). A parabola through three energies gives the time of
the peak. There is no stiffness matrix and no Newton step; only the unbalanced forces of the
`System` are shared with `solve`. A prescribed force is modelled as the force of a jack.

All time steps are one program: a step takes 20 us once it is compiled, and as a call from Python
more than ten times as long.

Sources: Day (1965), An introduction to dynamic relaxation; Cundall (1976) for kinetic damping;
Barnes (1999), Form finding and analysis of tension structures by dynamic relaxation.
"""

from __future__ import annotations

from collections.abc import Sequence

import jax
import jax.numpy as jnp
from jax import lax

from ..common import checks, status
from ..common.rules import Rule, nan_if_broken
from ..common.selection import Only
from ..common.tree import cast_floats, copy_with, merge_indices, pytree, split_indices
from ..common.types import Array, ArrayLike, Float, Int, PyTree
from ..elements.phase_input import InputValues
from ..elements.prestress import jack_value_or, measure_chord
from ..loads import Load
from ..mechanics.elementwise import map_elements_at_ends
from ..model import plausibility
from ..model.structure import Structure
from ..model.supports import FixedDofs
from ..numerics import implicit, scaled
from ..programs.program_calls import as_program
from ..spaces.dof_map import make_dof_map
from .form import Form, arrange_form_as_elements, make_judged_form, most_shortened_element
from .form_dependent_loads import split_loads
from .input_checks import (
    input_status,
    require_single_input,
    require_straight_elements,
    sum_nodal_loads,
    system_with_fixed_supports,
    values_by_group,
)

# A node that has moved this many times the size of the structure is held by nothing: the status is
# MECHANISM. Forms lie within a few sizes; with a tenth or ten times it, tests end alike.
_MAX_TRAVEL = 1e3
# Masses over the least stable ones. Without a margin masses are raised, and the net is stopped,
# more often; heavier nets move more slowly. A net of 16 free nodes with given forces takes 141 time
# steps; with a margin of 1.0 or 1.5 it takes 529 or 225.
_MASS_MARGIN = 1.05


def dynamic_relaxation(
    structure: Structure,
    tension: PyTree[Float[ArrayLike, " ..."] | Only] | None = None,
    rest_length: PyTree[Float[ArrayLike, " ..."] | Only] | None = None,
    *,
    loads: Load | Sequence[Load] | None = None,
    start: Float[ArrayLike, "n_node 3"] | None = None,
    tol: Float[ArrayLike, ""] = 1e-10,
    max_steps: int = 100_000,
) -> Form:
    """Find the equilibrium of prescribed forces, or of elastic elements, by damped motion.

    This is an independent check of `find_form` and `solve`, slower than both. It works under jit
    and vmap. Its derivatives are NaN; differentiate `find_form` or `solve`.

    Args:
        structure: `Structure` of cables and bars.
        tension: axial force that an element keeps whatever its length, N: a scalar, [n_elem],
            `selection.only(elements, values)`, or a prefix pytree of the structure's elements with
            such leaves and None; negative in `Bars` only.
        rest_length: unstressed length, m, likewise, of elements that follow their law; cables may
            become slack. An element with neither input has the unstressed length of its group, or
            else the chord between the structure's nodes.

    Options:
        loads: `NodalLoads` or a list of them.
        start: positions at the start, [n_node, 3], m (held coordinates are those of the structure);
            default the structure's nodes.
        tol: tolerance of the `relative_residual` of the `Form`; not below 64 eps.
        max_steps: largest number of time steps; beyond it the status is OUT_OF_TIME_STEPS.

    Returns:
        `Form`; its `iterations` are time steps. The status of a failure is OUT_OF_TIME_STEPS,
        MECHANISM (a node has moved far away), NONFINITE or MATERIAL_FAILURE (an element is strained
        beyond its curve).

    Raises:
        ValueError: as `find_form`; tension and unstressed length of one element.

    Source: Day (1965); Cundall (1976) for the damping; Barnes (1999).

    Example:
        Three cables with equal tensions meet at 120 degrees, in the Fermat point of their supports.
        It is ``1 / sqrt(3)`` above the middle of a base of 2 m, however high the third support is:

        >>> nodes = [[-1.0, 0, 0], [1, 0, 0], [0, 3, 0], [0.4, 1, 0.2]]
        >>> cables = jc.Cables([[0, 3], [1, 3], [2, 3]], axial_stiffness=1e5)
        >>> structure = jc.Structure(nodes, cables, supports=jc.pinned([0, 1, 2]))
        >>> form = jc.forms.dynamic_relaxation(structure, tension=500.0)
        >>> print(f"{jc.describe(form.status)}: {form.positions[3, 1]:.6f} m")
        converged: 0.577350 m
    """
    require_straight_elements(structure)
    plausibility.warn_of_lost_precision(structure.nodes)
    loads, _ = split_loads(structure, loads, nodal_only=True)
    forces, prescribed = values_by_group(tension, structure, "tension")
    rests, cut = values_by_group(rest_length, structure, "rest_length", is_length=True)
    require_single_input(structure, ("tension", "rest_length"), (prescribed, cut))
    forces, rests = (
        [None if v is None else InputValues(v, which) for v, which in zip(*pair, strict=True)]
        for pair in ((forces, prescribed), (rests, cut))
    )
    tol = nan_if_broken(Rule("tol", tol, lambda v: ~(v > 0), "must be positive"))
    if start is not None:
        start = checks.as_floats(start, "start")
        if start.shape != structure.nodes.shape:
            raise ValueError(
                f"start: expected shape {structure.nodes.shape}, got {tuple(start.shape)}"
            )
    dof_map = make_dof_map(FixedDofs(structure.held_displacements()))
    without_indices, index_arrays = split_indices(
        (structure.nodes, structure.groups, forces, rests, loads, start)
    )
    return arrange_form_as_elements(
        _relax_to_equilibrium(without_indices, index_arrays, dof_map, tol, max_steps), structure
    )


def _start_element_states(group, ends, force, rest):
    """Return the states of the elements of a group at the start of the relaxation.

    Args:
        group: element group.
        ends: initial positions of the ends, [n_elem, 2, 3], m.
        force: forces that some elements keep, `InputValues` (values and which elements), or None.
        rest: unstressed lengths of some elements, `InputValues`, or None.
    """
    state = group.start(ends)
    if rest is not None:
        state = group.apply_phase_inputs(state, ends, {"rest_length": rest})
    if force is None:
        return state
    return copy_with(state, jack_force=force.values, jacked=force.chosen)


def _forces_and_stiffness_bound(element, state, ends, motion):
    """Return the end forces of an element, [2, 3], N, and an upper bound of its stiffness, N/m.

    The bound holds in any direction; a slack element has the bound of a taut one. `ends` are
    initial positions, `motion` displacements of both ends, [2, 3], m.
    """

    def along():
        slope = jax.grad(lambda strain: element.force(strain, state.memory))
        strain = jnp.maximum(element.strain(state, ends, motion), 0.0)
        return jnp.maximum(slope(strain), slope(jnp.zeros_like(strain))) / state.rest_length

    _, length, _, _ = measure_chord(ends, motion)
    across = jnp.abs(element.tension(state, ends, motion)) / length
    return element.end_forces(state, ends, motion), jack_value_or(state, 0.0, along) + across


def _unstressed_length(element, state, ends, motion):
    """Return the unstressed length of one element at displacements `motion` of its ends, m.

    If its force is prescribed, this is the length with which its law gives the force.
    """
    if state.jack_force is None:
        return state.rest_length
    _, length, change, _ = measure_chord(ends, motion)
    return element.locked_off_state(state, length, change).rest_length


@pytree
class _RelaxationState:
    """State of the moving net in dynamic relaxation, at its free degrees of freedom.

    Attributes:
        x: displacements, [n_free], m.
        v: velocity half a time step ago, [n_free], m per time step.
        force: unbalanced force at x, [n_free], N.
        mass: fictitious mass of every degree of freedom, [n_free].
        energy: kinetic energies at the last two half steps, the latest first, [2]; zero at rest.
        steps: number of time steps so far.
        relative_residual: largest unbalanced force over `scale`.
        scale: force that unbalanced forces are compared with, N.
    """

    x: Float[Array, " n_free"]
    v: Float[Array, " n_free"]
    force: Float[Array, " n_free"]
    mass: Float[Array, " n_free"]
    energy: Float[Array, " 2"]
    steps: Int[Array, ""]
    relative_residual: Float[Array, ""]
    scale: Float[Array, ""]


@as_program
def _relax_to_equilibrium(without_indices, index_arrays, dof_map, tol, max_steps):
    """Find the equilibrium by dynamic relaxation; return a `Form` with a list item per group.

    The first two arguments are `split_indices` of the nodes, groups, forces, unstressed lengths,
    loads and start positions; the others are the `DofMap`, relative tolerance and step limit.
    """
    parameters = merge_indices(without_indices, index_arrays)
    dtype = parameters[0].dtype
    nodes, groups, forces, rests, loads, start = lax.stop_gradient(cast_floats(parameters, dtype))
    groups = [group.extrapolated() if group.has_rupture else group for group in groups]
    states = [
        _start_element_states(group, nodes[group.links], force, rest)
        for group, force, rest in zip(groups, forces, rests, strict=True)
    ]
    system = system_with_fixed_supports(
        nodes, groups, states, sum_nodal_loads(loads, nodes.shape, dtype), dof_map
    )
    origin, away = jnp.zeros_like(nodes), _MAX_TRAVEL * system.extent()
    limit = jnp.maximum(jnp.asarray(tol, dtype), 64 * jnp.finfo(dtype).eps)

    def of_elements(function, motion):
        return [
            map_elements_at_ends(function, group, state, (nodes[group.links], motion[group.links]))
            for group, state in zip(groups, states, strict=True)
        ]

    def balance(x):
        """Return unbalanced forces, their largest over its scale, the scale, and stable masses."""
        motion = system.move(origin, x)
        found = of_elements(_forces_and_stiffness_bound, motion)
        residual, scale = system.residual_and_scale(motion, [forces for forces, _ in found])
        stiffness = system.sum_at_rows([jnp.stack([bound, bound], axis=1) for _, bound in found])
        # a node without stiff elements gets some mass, too
        mass = 0.5 * jnp.maximum(stiffness, 1e-6 * jnp.max(stiffness))
        mass = jnp.where(mass > 0, mass, 1.0)[:, None]
        mass = system.space.restrict(jnp.broadcast_to(mass, nodes.shape), motion)
        worst = scaled.relative_residual(jnp.max(jnp.abs(residual), initial=0.0), scale)
        return -residual, worst, scale, mass

    def step(motion):
        pace = motion.force / motion.mass
        v = motion.v + jnp.where(motion.energy[0] > 0, 1.0, 0.5) * pace
        x = motion.x + v
        energy = jnp.sum(0.5 * motion.mass * v * v)
        peak = energy < motion.energy[0]
        fall, rise = energy - motion.energy[0], motion.energy[0] - motion.energy[1]
        # part of a time step between the peak and the last energy
        q = fall / jnp.where(peak, fall - rise, 1.0)
        x = jnp.where(peak, x - (1 + q) * v + 0.5 * q * pace, x)
        force, size, scale, mass = balance(x)
        heavier = jnp.any(mass > motion.mass) & ~(size <= limit)  # the masses are no longer stable
        stop = peak | heavier
        energies = jnp.where(stop, 0.0, jnp.stack([energy, motion.energy[0]]))
        v, mass = jnp.where(stop, 0.0, v), jnp.where(stop, _MASS_MARGIN * mass, motion.mass)
        return _RelaxationState(x, v, force, mass, energies, motion.steps + 1, size, scale)

    def gone(motion):
        return jnp.max(jnp.abs(motion.x), initial=0.0) > away

    def unfinished(motion):
        goes_on = (motion.steps < max_steps) & (motion.relative_residual > limit) & ~gone(motion)
        return goes_on | (motion.steps < 0)  # also a start far away has a residual

    x = system.space.restrict(origin if start is None else start - nodes, origin)
    # step number 0 does not move, and ends at rest because the energy seems to have had a peak
    still = jnp.zeros_like(x), jnp.zeros_like(x), jnp.ones_like(x), jnp.ones(2, dtype)
    size, scale = jnp.asarray(jnp.finfo(dtype).max, dtype), jnp.zeros((), dtype)
    end = lax.while_loop(unfinished, step, _RelaxationState(x, *still, jnp.int32(-1), size, scale))
    code = jnp.where(end.relative_residual <= limit, status.OK, status.OUT_OF_TIME_STEPS)
    code = jnp.where(gone(end), status.MECHANISM, code)
    code = jnp.where(
        jnp.isfinite(end.relative_residual) & jnp.isfinite(end.scale), code, status.NONFINITE
    )
    motion = system.move(origin, end.x)
    torn = jnp.where(system.is_ruptured(motion), status.MATERIAL_FAILURE, status.OK)
    code = status.first_failure(input_status(*parameters[:2]), status.first_failure(code, torn))
    residual, positions = jnp.max(jnp.abs(end.force), initial=0.0), nodes + motion
    form = make_judged_form(
        *(groups, positions, system.tensions(motion), code, residual, end.scale, end.steps, ()),
        most_shortened_element(groups, nodes, positions),
        of_elements(_unstressed_length, motion),
    )
    names = ("positions", "tension", "length", "rest_length", "force_density")
    values = {name: getattr(form, name) for name in names}
    return copy_with(form, **implicit.with_nan_derivative(values, parameters))
