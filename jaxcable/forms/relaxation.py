"""Dynamic relaxation with kinetic damping: a second way to the same forms, for checks.

The net starts at rest and moves under its unbalanced forces R with fictitious masses; whenever its
kinetic energy has passed a peak it is stopped at the peak, and starts again. Central differences
with a time step of 1,

    v(t + 1/2) = v(t - 1/2) + R(t)/m,      x(t + 1) = x(t) + v(t + 1/2),

are stable if the mass of a node is at least half the sum of the stiffnesses of its elements (the
largest eigenvalue is at most twice that sum). A parabola through three energies gives the time of
the peak. There is no stiffness matrix and no Newton step: only the unbalanced forces of the
`System` are shared with `solve`. A prescribed force is that of a jack.

Sources: Day (1965), An introduction to dynamic relaxation; Cundall (1976) for kinetic damping;
Barnes (1999), Form finding and analysis of tension structures by dynamic relaxation.
"""

from __future__ import annotations

from collections.abc import Sequence

import jax
import jax.numpy as jnp
from jax import lax

from ..common import checks, status
from ..common.rules import Rule, or_nan
from ..common.selection import Only
from ..common.tree import cast, copy, fill, pytree, thaw
from ..common.types import Array, ArrayLike, Float, Int, PyTree
from ..elements.prestress import jacked_or, stretch
from ..elements.stated import Stated
from ..loads import Load
from ..mechanics.elementwise import over
from ..model import plausibility
from ..model.structure import Structure
from ..model.supports import Fixed
from ..numerics import implicit, scaled
from ..spaces.freedoms import number_freedoms
from .along import split
from .form import Form, arranged, make_form, nearest
from .members import check_members, require_one, stated, system_at_rest, total, verdict

_AWAY = 1e3  # displacement over the size of the structure that supports would never allow
_SPARE = 1.05  # masses over the least ones that are stable


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
            become slack. An element without a statement has the unstressed length of its group, or
            else the chord between the structure's nodes.

    Options:
        loads: `NodalLoads` or a list of them.
        start: positions at the start, [n_node, 3], m (held coordinates are those of the structure);
            default the structure's nodes.
        tol: largest unbalanced force at a free freedom over the largest, over nodes, of the sum of
            absolute end forces plus the load; not below 64 eps.
        max_steps: largest number of time steps; beyond it the status is OUT_OF_TIME_STEPS.

    Returns:
        `Form`; its `iterations` are time steps. The status of a failure is OUT_OF_TIME_STEPS,
        MECHANISM (a node has moved away), NONFINITE or MATERIAL_FAILURE (an element is strained
        beyond its curve).

    Raises:
        ValueError: as `find_form`; both statements for one element.

    Source: Day (1965); Cundall (1976) for the damping; Barnes (1999).

    Example:
        Three cables with one tension meet at 120 degrees, in the Fermat point of their supports. It
        is ``1 / sqrt(3)`` above the middle of a base of 2 m, however high the third support is:

        >>> nodes = [[-1.0, 0, 0], [1, 0, 0], [0, 3, 0], [0.4, 1, 0.2]]
        >>> cables = jc.Cables([[0, 3], [1, 3], [2, 3]], axial_stiffness=1e5)
        >>> structure = jc.Structure(nodes, cables, supports=jc.pinned([0, 1, 2]))
        >>> form = jc.forms.dynamic_relaxation(structure, tension=500.0)
        >>> print(f"{jc.describe(form.status)}: {form.positions[3, 1]:.6f} m")
        converged: 0.577350 m
    """
    check_members(structure)
    plausibility.precision(structure.nodes)
    loads, _ = split(structure, loads, takes_more=False)
    forces, prescribed = stated(tension, structure, "tension")
    rests, cut = stated(rest_length, structure, "rest_length", is_length=True)
    require_one(structure, ("tension", "rest_length"), (prescribed, cut))
    forces, rests = (
        [None if v is None else Stated(v, which) for v, which in zip(*pair, strict=True)]
        for pair in ((forces, prescribed), (rests, cut))
    )
    tol = or_nan(Rule("tol", tol, lambda v: ~(v > 0), "must be positive"))
    if start is not None:
        start = checks.floats(start, "start")
        if start.shape != structure.nodes.shape:
            raise ValueError(
                f"start: expected shape {structure.nodes.shape}, got {tuple(start.shape)}"
            )
    freedoms = number_freedoms(Fixed(structure.held()))
    thawed, arrays = thaw((structure.nodes, structure.groups, forces, rests, loads, start))
    return arranged(_relax(thawed, arrays, freedoms, tol, max_steps), structure)


def _state(group, ends, force, rest):
    """State of a group with the unstressed lengths and forces that are `Stated`; None for none."""
    state = group.start(ends)
    if rest is not None:
        state = group.restate(state, ends, {"rest_length": rest})
    if force is None:
        return state
    return copy(state, jack_force=force.values, jacked=force.chosen)


def _forces_and_stiffness(member, state, ends, motion):
    """End forces of an element, N, and an upper bound of its stiffness in any direction, N/m.

    A slack element has the bound of a taut one.
    """

    def along():
        slope = jax.grad(lambda strain: member.force(strain, state.memory))
        strain = jnp.maximum(member.strain(state, ends, motion), 0.0)
        return jnp.maximum(slope(strain), slope(jnp.zeros_like(strain))) / state.rest_length

    _, length, _, _ = stretch(ends, motion)
    across = jnp.abs(member.tension(state, ends, motion)) / length
    return member.end_forces(state, ends, motion), jacked_or(state, 0.0, along) + across


def _cut_length(member, state, ends, motion):
    """Unstressed length, m; of an element with a prescribed force that which its law gives it."""
    if state.jack_force is None:
        return state.rest_length
    _, length, change, _ = stretch(ends, motion)
    return member.locked(state, length, change).rest_length


@pytree
class _Motion:
    """State of the moving net, in the free freedoms.

    Attributes:
        x: displacements, [n_free], m.
        v: velocity half a time step ago, [n_free].
        force: unbalanced force at x, [n_free], N.
        mass: mass of every freedom, [n_free].
        energy: kinetic energies of the last two half steps, the latest first, [2]; zero at rest.
        steps: number of time steps so far.
        size: largest unbalanced force over its scale.
        scale: scale of the unbalanced forces, N.
    """

    x: Float[Array, " n_free"]
    v: Float[Array, " n_free"]
    force: Float[Array, " n_free"]
    mass: Float[Array, " n_free"]
    energy: Float[Array, " 2"]
    steps: Int[Array, ""]
    size: Float[Array, ""]
    scale: Float[Array, ""]


@jax.jit
def _relax(thawed, arrays, freedoms, tol, max_steps):
    """The compiled core; results per element are lists with one item per group."""
    parameters = fill(thawed, arrays)
    dtype = parameters[0].dtype
    nodes, groups, forces, rests, loads, start = lax.stop_gradient(cast(parameters, dtype))
    groups = [group.extended() if group.breaks else group for group in groups]
    states = [
        _state(group, nodes[group.links], force, rest)
        for group, force, rest in zip(groups, forces, rests, strict=True)
    ]
    system = system_at_rest(nodes, groups, states, total(loads, nodes.shape, dtype), freedoms)
    origin, away = jnp.zeros_like(nodes), _AWAY * system.extent()
    limit = jnp.maximum(jnp.asarray(tol, dtype), 64 * jnp.finfo(dtype).eps)

    def of_elements(function, motion):
        return [
            over(function, group, state, nodes, motion)
            for group, state in zip(groups, states, strict=True)
        ]

    def balance(x):
        """Unbalanced forces, the largest over its scale, this scale, least masses for stability."""
        motion = system.move(origin, x)
        found = of_elements(_forces_and_stiffness, motion)
        residual, scale = system.residual_and_scale(motion, [forces for forces, _ in found])
        stiffness = system.at_rows([jnp.stack([bound, bound], axis=1) for _, bound in found])
        # a node without stiff elements gets some mass, too
        mass = 0.5 * jnp.maximum(stiffness, 1e-6 * jnp.max(stiffness))
        mass = jnp.where(mass > 0, mass, 1.0)[:, None]
        mass = system.space.collected(jnp.broadcast_to(mass, nodes.shape), motion)
        worst = scaled.relative(jnp.max(jnp.abs(residual), initial=0.0), scale)
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
        v, mass = jnp.where(stop, 0.0, v), jnp.where(stop, _SPARE * mass, motion.mass)
        return _Motion(x, v, force, mass, energies, motion.steps + 1, size, scale)

    def gone(motion):
        return jnp.max(jnp.abs(motion.x), initial=0.0) > away

    def unfinished(motion):
        goes_on = (motion.steps < max_steps) & (motion.size > limit) & ~gone(motion)
        return goes_on | (motion.steps < 0)  # also a start far away has a residual

    x = system.space.collected(origin if start is None else start - nodes, origin)
    # step number 0 does not move, and ends at rest because the energy seems to have had a peak
    still = jnp.zeros_like(x), jnp.zeros_like(x), jnp.ones_like(x), jnp.ones(2, dtype)
    size, scale = jnp.asarray(jnp.finfo(dtype).max, dtype), jnp.zeros((), dtype)
    end = lax.while_loop(unfinished, step, _Motion(x, *still, jnp.int32(-1), size, scale))
    code = jnp.where(end.size <= limit, status.OK, status.OUT_OF_TIME_STEPS)
    code = jnp.where(gone(end), status.MECHANISM, code)
    code = jnp.where(jnp.isfinite(end.size) & jnp.isfinite(end.scale), code, status.NONFINITE)
    motion = system.move(origin, end.x)
    torn = jnp.where(system.beyond(motion), status.MATERIAL_FAILURE, status.OK)
    code = status.first_failure(verdict(*parameters[:2]), status.first_failure(code, torn))
    residual, positions = jnp.max(jnp.abs(end.force), initial=0.0), nodes + motion
    form = make_form(
        *(groups, positions, system.tensions(motion), code, residual, end.scale, end.steps, ()),
        nearest(groups, nodes, positions),
        of_elements(_cut_length, motion),
    )
    names = ("positions", "tension", "length", "rest_length", "force_density")
    values = {name: getattr(form, name) for name in names}
    return copy(form, **implicit.undifferentiated(values, parameters))
