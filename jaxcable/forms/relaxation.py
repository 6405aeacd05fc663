"""Dynamic relaxation with kinetic damping: a second way to the same forms, for checks.

The net is let go and moves under its unbalanced forces R with fictitious masses; whenever its
kinetic energy has passed a peak it is stopped there, and let go again. Central differences with a
time step of 1,

    v(t + 1/2) = v(t - 1/2) + R(t)/m,      x(t + 1) = x(t) + v(t + 1/2),

are stable if the mass of a node is at least half the sum of the stiffnesses of its elements (the
largest eigenvalue is at most twice that sum). The peak is placed by a parabola through three
energies. No stiffness matrix, no Newton step, and nothing of `assembly`: only the elements' laws
are shared with `solve`.

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
from ..model.structure import Structure
from ..numerics import implicit
from .along import split
from .form import Form, arranged, make_form
from .members import check_members, stated, total, verdict

_AWAY = 1e3  # displacement, in structure sizes, that no held structure reaches
_SPARE = 1.05  # of the masses, over what stability asks for


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
    """Find the equilibrium of a net of held forces, or of elastic elements, by letting it move.

    An independent check of `find_form` and `solve`, slower than both. Works under jit and vmap. Its
    derivative is not offered: it is NaN; differentiate `find_form` or `solve`.

    Args:
        structure: `Structure` of cables and bars.
        tension: axial force held whatever the length, N: a scalar, [n_elem],
            `selection.only(elements, values)`, or a prefix pytree of the structure's elements with
            such leaves and None; negative in `Bars` only.
        rest_length: unstressed length, m, likewise, of elements that follow their law; cables may
            go slack. An element without a statement has the unstressed length of its group, or else
            the chord between the structure's nodes.
        loads: `NodalLoads` or a list of them.
        start: positions to start from, [n_node, 3], m (held coordinates are those of the
            structure); default the structure's nodes.
        tol: largest unbalanced force at a free freedom over the largest, over nodes, of the sum of
            absolute end forces plus the load; not below 64 eps. Strains are differences of lengths
            here: what rounding leaves is eps EA/N.
        max_steps: steps allowed; beyond, the status is NOT_CONVERGED.

    Returns:
        `Form`; its `iterations` are steps. Status NOT_CONVERGED, MECHANISM (a node has gone
        away), NONFINITE or MATERIAL_FAILURE (an element strained beyond its curve).

    Raises:
        ValueError: as `find_form`; both statements for one element.

    Source: Day (1965); Cundall (1976) for the damping; Barnes (1999).

    Example:
        600 N on two cables of 500 N: a 3-4-5 triangle, wherever they are let go.

        >>> nodes = [[-4.0, 0.0, 3.0], [1.0, 0.0, 2.0], [4.0, 0.0, 3.0]]
        >>> cables = jc.Cables([[0, 1], [1, 2]], axial_stiffness=1e5)
        >>> structure = jc.Structure(nodes, cables, supports=jc.pinned([0, 2]))
        >>> weight = jc.NodalLoads([1], (0.0, 0.0, -600.0))
        >>> form = jc.forms.dynamic_relaxation(structure, tension=500.0, loads=weight)
        >>> print(f"{jc.describe(form.status)}: {form.length[0]:.6f} m")
        converged: 5.000000 m
    """
    check_members(structure)
    plausibility.precision(structure.nodes)
    loads, _ = split(structure, loads, takes_more=False)
    forces, held = stated(tension, structure, "tension")
    rests, cut = stated(rest_length, structure, "rest_length")
    for k, group in enumerate(structure.groups):
        both = held[k] & cut[k]
        if both.any():
            raise ValueError(
                f"tension, rest_length: element {int(both.argmax())} of group {k} has both; "
                "give one"
            )
        if forces[k] is not None and group.tension_only:
            text = "a cable carries tension only; use Bars"
            forces[k] = or_nan(not_negative("tension", forces[k], text))
        if rests[k] is not None:
            own = rests[k], cut[k]
            text = "must be positive"
            rests[k] = or_nan(Rule("rest_length", own, lambda v, own: own & (v <= 0), text))
    tol = or_nan(Rule("tol", tol, lambda v: ~(v > 0), "must be positive"))
    if start is not None:
        start = checks.floats(start, "start")
        if start.shape != structure.nodes.shape:
            raise ValueError(
                f"start: expected shape {structure.nodes.shape}, got {tuple(start.shape)}"
            )
    members = [
        _Members(group, force, rest, own_held, own_cut)
        for group, force, rest, own_held, own_cut in zip(
            structure.groups, forces, rests, held, cut, strict=True
        )
    ]
    fixed = structure.held()
    thawed, arrays = thaw((structure.nodes, members, loads, start))
    return arranged(_relax(thawed, arrays, fixed, tol, max_steps), structure)


@pytree
class _Members:
    """A group and what is said about it.

    Attributes:
        group: element group.
        force: held forces, [n_elem], N, or None.
        rest: unstressed lengths, [n_elem], m, or None.
        held, cut: which elements these concern, [n_elem] bool.
    """

    group: Element
    force: Float[Array | np.ndarray, " n_elem"] | None
    rest: Float[Array | np.ndarray, " n_elem"] | None
    held: Bool[Array | np.ndarray, " n_elem"]
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
        memory = self.group.initial_memory()
        return jax.vmap(lambda p, e, own: function(element(self.group, p), e, own))(
            self.group.properties(), strain, memory
        )

    def tension(
        self, length: Float[Array, " n_elem"], rest: Float[Array, " n_elem"]
    ) -> Float[Array, " n_elem"]:
        """Axial forces, [n_elem], N."""
        own = self._law((length - rest) / rest, lambda one, e, memory: one.force(e, memory))
        return own if self.force is None else jnp.where(self.held, self.force, own)

    def stiffness(
        self, length: Float[Array, " n_elem"], rest: Float[Array, " n_elem"]
    ) -> Float[Array, " n_elem"]:
        """A bound of the stiffness of a taut element in any direction, [n_elem], N/m."""
        strain = jnp.maximum((length - rest) / rest, 0.0)

        def slope(one, e, memory):
            rate = jax.grad(lambda e: one.force(e, memory))
            return jnp.maximum(rate(e), rate(jnp.zeros_like(e)))

        along = self._law(strain, slope) / rest
        if self.force is not None:
            along = jnp.where(self.held, 0.0, along)
        return along + jnp.abs(self.tension(length, rest)) / length

    def beyond(
        self, length: Float[Array, " n_elem"], rest: Float[Array, " n_elem"]
    ) -> Bool[Array, ""]:
        """Whether an element is strained beyond its curve."""
        if not self.group.breaks:
            return jnp.zeros((), bool)
        broken = self._law(
            (length - rest) / rest, lambda one, e, memory: one._section()[1].beyond(e)
        )
        return jnp.any(broken if self.force is None else broken & ~self.held)


@pytree
class _Motion:
    """Where the net is.

    Attributes:
        x: positions, [n_node, 3].
        v: velocity half a step ago, [n_node, 3].
        force: unbalanced force at x, [n_node, 3], zero where held.
        mass: of every node, [n_node, 1].
        energy: kinetic energies of the last two half steps, the latest first, [2].
        rest: whether it has just been stopped.
        steps: so far.
        size: largest unbalanced force over its scale.
        scale: N.
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
    """The compiled core; results per element are lists, one item per group."""
    parameters = fill(thawed, arrays)
    dtype = parameters[0].dtype
    nodes, members, loads, start = lax.stop_gradient(cast(parameters, dtype))
    members = [copy(m, group=m.group.extended() if m.group.breaks else m.group) for m in members]
    load = total(loads, nodes.shape, dtype)
    rests = [m.unstressed(nodes) for m in members]
    limit = jnp.maximum(jnp.asarray(tol, dtype), 64 * jnp.finfo(dtype).eps)
    extent = jnp.sqrt(jnp.sum((jnp.max(nodes, axis=0) - jnp.min(nodes, axis=0)) ** 2))

    def balance(x):
        """Unbalanced forces, largest one over its scale, scale, masses that are stable."""
        force, size = load, jnp.sqrt(jnp.sum(load**2, axis=-1))
        stiffness = jnp.zeros_like(size)
        for m, rest in zip(members, rests, strict=True):
            d, length = m.vectors(x)
            tension = m.tension(length, rest)
            pull = (tension / length)[:, None] * d
            first, second = m.group.links[:, 0], m.group.links[:, 1]
            force = force.at[first].add(pull).at[second].add(-pull)
            own = m.stiffness(length, rest)
            for end in (first, second):
                size = size.at[end].add(jnp.abs(tension))
                stiffness = stiffness.at[end].add(own)
        force, scale = jnp.where(fixed, 0.0, force), jnp.max(size)
        # a node that nothing holds gets some mass to move with
        mass = 0.5 * jnp.maximum(stiffness, 1e-6 * jnp.max(stiffness))[:, None]
        mass = jnp.where(mass > 0, mass, 1.0)
        worst = jnp.max(jnp.abs(force)) / jnp.where(scale > 0, scale, 1.0)
        return force, worst, scale, mass

    def stopped(motion, x):
        """At rest at x, with masses made for it."""
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
        q = fall / jnp.where(peak, fall - rise, 1.0)  # part of a step between peak and last energy
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
    code = jnp.where(end.size <= limit, status.OK, status.NOT_CONVERGED)
    gone = jnp.max(jnp.abs(end.x - nodes)) > _AWAY * extent
    code = jnp.where(gone, status.MECHANISM, code)
    return _ended(members, rests, end, code, parameters)


def _ended(members, rests, end, code, parameters):
    """The `Form` that the motion `end` stands for, `code` what its size and place say of it."""
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
            rest = jnp.where(m.held, length / (1 + strain), rest)
        cut.append(rest)
    groups = [m.group for m in members]
    residual = jnp.max(jnp.abs(end.force))
    form = make_form(groups, end.x, forces, code, residual, end.scale, end.steps, (), cut)
    names = ("positions", "tension", "length", "rest_length", "force_density")
    values = {name: getattr(form, name) for name in names}
    return copy(form, **implicit.undifferentiated(values, parameters))
