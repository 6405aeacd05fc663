"""Dynamic relaxation with kinetic damping: a second way to the same forms, for checks.

The net starts at rest and moves under its unbalanced forces R with fictitious masses; whenever its
kinetic energy has passed a peak it is stopped at the peak, and starts again. Central differences
with a time step of 1,

    v(t + 1/2) = v(t - 1/2) + R(t)/m,      x(t + 1) = x(t) + v(t + 1/2),

are stable if the mass of a node is at least half the sum of the stiffnesses of its elements (the
largest eigenvalue is at most twice that sum). A parabola through three energies gives the time of
the peak. There is no stiffness matrix, no Newton step, and nothing of `assembly`: only the laws of
elements are shared with `solve`.

Sources: Day (1965), An introduction to dynamic relaxation; Cundall (1976) for kinetic damping;
Barnes (1999), Form finding and analysis of tension structures by dynamic relaxation.
"""

from __future__ import annotations

from collections.abc import Sequence

import jax
import jax.numpy as jnp
import numpy as np
from jax import lax

from ..common import checks, status
from ..common.rules import Rule, not_negative, or_nan
from ..common.selection import Only
from ..common.tree import cast, copy, fill, pytree, thaw
from ..common.types import Array, ArrayLike, Bool, Float, Int, PyTree
from ..elements.element import Element
from ..elements.prestress import element
from ..loads import Load
from ..model import plausibility
from ..model.parts import group_path
from ..model.structure import Structure
from ..numerics import implicit, scaled
from .along import split
from .form import Form, arranged, make_form, nearest
from .members import check_members, stated, total, verdict

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
            absolute end forces plus the load; not below 64 eps. Strains are differences of lengths
            here, whose rounding leaves a relative residual of eps EA/N.
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
    rests, cut = stated(rest_length, structure, "rest_length")
    for k, group in enumerate(structure.groups):
        both = prescribed[k] & cut[k]
        if both.any():
            raise ValueError(
                f"tension, rest_length: element {int(both.argmax())} of "
                f"{group_path(structure, k)} has both; give one"
            )
        if forces[k] is not None and group.tension_only:
            text = "a cable carries tension only; use Bars"
            forces[k] = or_nan(not_negative("tension", forces[k], text))
        if rests[k] is not None:
            lengths = rests[k], cut[k]
            text = "must be positive"
            rests[k] = or_nan(Rule("rest_length", lengths, lambda v, mask: mask & (v <= 0), text))
    tol = or_nan(Rule("tol", tol, lambda v: ~(v > 0), "must be positive"))
    if start is not None:
        start = checks.floats(start, "start")
        if start.shape != structure.nodes.shape:
            raise ValueError(
                f"start: expected shape {structure.nodes.shape}, got {tuple(start.shape)}"
            )
    members = [
        _Members(group, force, rest, with_force, with_length)
        for group, force, rest, with_force, with_length in zip(
            structure.groups, forces, rests, prescribed, cut, strict=True
        )
    ]
    fixed = structure.held()
    thawed, arrays = thaw((structure.nodes, members, loads, start))
    return arranged(_relax(thawed, arrays, fixed, tol, max_steps), structure)


@pytree
class _Members:
    """A group and the statements on its elements.

    Attributes:
        group: element group.
        force: prescribed forces, [n_elem], N, or None.
        rest: stated unstressed lengths, [n_elem], m, or None.
        prescribed, cut: which elements have a prescribed force, and which a stated unstressed
            length, [n_elem] bool.
    """

    group: Element
    force: Float[Array | np.ndarray, " n_elem"] | None
    rest: Float[Array | np.ndarray, " n_elem"] | None
    prescribed: Bool[Array | np.ndarray, " n_elem"]
    cut: Bool[Array | np.ndarray, " n_elem"]

    def unstressed(self, nodes: Float[Array, "n_node 3"]) -> Float[Array, " n_elem"]:
        """Unstressed lengths of all elements, [n_elem], m."""
        group = self.group
        rest = group.rest_length
        if rest is None:
            ends = nodes[group.links]
            rest = jnp.sqrt(jnp.sum((ends[:, 1] - ends[:, 0]) ** 2, axis=-1))
        return rest if self.rest is None else jnp.where(self.cut, self.rest, rest)

    def vectors(
        self, x: Float[Array, "n_node 3"]
    ) -> tuple[Float[Array, "n_elem 3"], Float[Array, " n_elem"]]:
        """Vectors from first to second ends, [n_elem, 3], and their lengths, [n_elem], m."""
        ends = x[self.group.links]
        d = ends[:, 1] - ends[:, 0]
        return d, jnp.sqrt(jnp.sum(d * d, axis=-1))

    def _law(self, strain, function):
        """Values of ``function(element, strain, memory)`` of all elements."""
        memory = self.group.initial_memory()
        return jax.vmap(lambda p, e, m: function(element(self.group, p), e, m))(
            self.group.properties(), strain, memory
        )

    def tension(
        self, length: Float[Array, " n_elem"], rest: Float[Array, " n_elem"]
    ) -> Float[Array, " n_elem"]:
        """Axial forces, [n_elem], N."""
        force = self._law((length - rest) / rest, lambda member, e, memory: member.force(e, memory))
        return force if self.force is None else jnp.where(self.prescribed, self.force, force)

    def stiffness(
        self, length: Float[Array, " n_elem"], rest: Float[Array, " n_elem"]
    ) -> Float[Array, " n_elem"]:
        """An upper bound of the stiffness of every element in any direction, [n_elem], N/m."""
        strain = jnp.maximum((length - rest) / rest, 0.0)

        def slope(member, e, memory):
            rate = jax.grad(lambda e: member.force(e, memory))
            return jnp.maximum(rate(e), rate(jnp.zeros_like(e)))

        along = self._law(strain, slope) / rest
        if self.force is not None:
            along = jnp.where(self.prescribed, 0.0, along)
        return along + jnp.abs(self.tension(length, rest)) / length

    def beyond(
        self, length: Float[Array, " n_elem"], rest: Float[Array, " n_elem"]
    ) -> Bool[Array, ""]:
        """Whether an element is strained beyond its curve."""
        if not self.group.breaks:
            return jnp.zeros((), bool)
        broken = self._law(
            (length - rest) / rest, lambda member, e, memory: member._section()[1].beyond(e)
        )
        return jnp.any(broken if self.force is None else broken & ~self.prescribed)


@pytree
class _Motion:
    """State of the moving net.

    Attributes:
        x: positions, [n_node, 3].
        v: velocity half a time step ago, [n_node, 3].
        force: unbalanced force at x, [n_node, 3], zero at held freedoms.
        mass: mass of every node, [n_node, 1].
        energy: kinetic energies of the last two half steps, the latest first, [2].
        rest: whether the net has just been stopped.
        steps: number of time steps so far.
        size: largest unbalanced force over its scale.
        scale: scale of the unbalanced forces, N.
    """

    x: Float[Array, "n_node 3"]
    v: Float[Array, "n_node 3"]
    force: Float[Array, "n_node 3"]
    mass: Float[Array, "n_node 1"]
    energy: Float[Array, " 2"]
    rest: Bool[Array, ""]
    steps: Int[Array, ""]
    size: Float[Array, ""]
    scale: Float[Array, ""]


@jax.jit
def _relax(thawed, arrays, fixed, tol, max_steps):
    """The compiled core; results per element are lists with one item per group."""
    parameters = fill(thawed, arrays)
    dtype = parameters[0].dtype
    nodes, members, loads, start = lax.stop_gradient(cast(parameters, dtype))
    members = [copy(m, group=m.group.extended() if m.group.breaks else m.group) for m in members]
    load = total(loads, nodes.shape, dtype)
    rests = [m.unstressed(nodes) for m in members]
    limit = jnp.maximum(jnp.asarray(tol, dtype), 64 * jnp.finfo(dtype).eps)
    extent = jnp.sqrt(jnp.sum((jnp.max(nodes, axis=0) - jnp.min(nodes, axis=0)) ** 2))

    def balance(x):
        """Unbalanced forces, the largest over its scale, this scale, least masses for stability."""
        force, size = load, jnp.sqrt(jnp.sum(load**2, axis=-1))
        stiffness = jnp.zeros_like(size)
        for m, rest in zip(members, rests, strict=True):
            d, length = m.vectors(x)
            tension = m.tension(length, rest)
            pull = (tension / length)[:, None] * d
            first, second = m.group.links[:, 0], m.group.links[:, 1]
            force = force.at[first].add(pull).at[second].add(-pull)
            bound = m.stiffness(length, rest)
            for end in (first, second):
                size = size.at[end].add(jnp.abs(tension))
                stiffness = stiffness.at[end].add(bound)
        force, scale = jnp.where(fixed, 0.0, force), jnp.max(size)
        # a node without stiff elements gets some mass, too
        mass = 0.5 * jnp.maximum(stiffness, 1e-6 * jnp.max(stiffness))[:, None]
        mass = jnp.where(mass > 0, mass, 1.0)
        worst = scaled.relative(jnp.max(jnp.abs(force)), scale)
        return force, worst, scale, mass

    def stopped(motion, x):
        """The motion at rest at x, with masses for the stiffness at x."""
        force, size, scale, mass = balance(x)
        return copy(
            motion,
            x=x,
            v=jnp.zeros_like(x),
            force=force,
            mass=_SPARE * mass,
            energy=jnp.zeros(2, dtype),
            rest=jnp.ones((), bool),
            size=size,
            scale=scale,
        )

    def step(motion):
        pace = motion.force / motion.mass
        v = motion.v + jnp.where(motion.rest, 0.5, 1.0) * pace
        x = motion.x + v
        energy = jnp.sum(0.5 * motion.mass * v * v)
        force, size, scale, mass = balance(x)
        moved = _Motion(
            *(x, v, force, motion.mass, jnp.stack([energy, motion.energy[0]])),
            *(jnp.zeros((), bool), motion.steps + 1, size, scale),
        )
        peak = energy < motion.energy[0]
        fall, rise = energy - motion.energy[0], motion.energy[0] - motion.energy[1]
        # part of a time step between the peak and the last energy
        q = fall / jnp.where(peak, fall - rise, 1.0)
        back = x - (1 + q) * v + 0.5 * q * pace
        heavier = jnp.any(mass > motion.mass) & ~(size <= limit)  # the masses are no longer stable
        at = jnp.where(peak, back, x)
        return lax.cond(peak | heavier, lambda: stopped(moved, at), lambda: moved)

    def unfinished(motion):
        gone = jnp.max(jnp.abs(motion.x - nodes)) > _AWAY * extent
        return (motion.steps < max_steps) & (motion.size > limit) & ~gone

    begin = nodes if start is None else jnp.where(fixed, nodes, start)
    zero = jnp.zeros((), dtype)
    at_rest = _Motion(begin, begin, begin, begin, zero, zero, jnp.int32(0), zero, zero)
    end = lax.while_loop(unfinished, step, stopped(at_rest, begin))
    code = jnp.where(end.size <= limit, status.OK, status.OUT_OF_TIME_STEPS)
    gone = jnp.max(jnp.abs(end.x - nodes)) > _AWAY * extent
    code = jnp.where(gone, status.MECHANISM, code)
    return _ended(members, rests, end, code, parameters)


def _ended(members, rests, end, code, parameters):
    """The `Form` at the end of the motion; `code` is the status by its residual and positions."""
    code = jnp.where(jnp.isfinite(end.size) & jnp.isfinite(end.scale), code, status.NONFINITE)
    found = [(m, m.vectors(end.x)[1], rest) for m, rest in zip(members, rests, strict=True)]
    torn = jnp.any(jnp.stack([m.beyond(length, rest) for m, length, rest in found]))
    code = status.first_failure(code, jnp.where(torn, status.MATERIAL_FAILURE, status.OK))
    code = status.first_failure(verdict(parameters[0], [m.group for m in parameters[1]]), code)
    forces = [m.tension(length, rest) for m, length, rest in found]
    cut = []
    for (m, length, rest), force in zip(found, forces, strict=True):
        if m.force is not None:
            strain = m.group.strain_at(force, m.group.initial_memory())
            rest = jnp.where(m.prescribed, length / (1 + strain), rest)
        cut.append(rest)
    groups = [m.group for m in members]
    residual = jnp.max(jnp.abs(end.force))
    met = nearest(groups, lax.stop_gradient(parameters[0]), end.x)
    form = make_form(groups, end.x, forces, code, residual, end.scale, end.steps, (), met, cut)
    names = ("positions", "tension", "length", "rest_length", "force_density")
    values = {name: getattr(form, name) for name in names}
    return copy(form, **implicit.undifferentiated(values, parameters))
