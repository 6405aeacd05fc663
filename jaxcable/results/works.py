"""Work, stored energy and dissipated energy in each increment of an analysis.

Work is computed from forces and displacements at both ends of an increment, by the trapezoidal
rule; energies are those of the elements.
"""

from __future__ import annotations

import functools

import jax
import jax.numpy as jnp
import numpy as np
from jax import lax

from ..analysis.preparation import ready
from ..common import status
from ..common.compilation import program
from ..common.tree import copy, fill, pytree
from ..common.types import Array, Float
from ..elements.element_state import Amounts, ElementState
from ..mechanics.carry import Carry, knowing
from ..mechanics.elementwise import each
from ..mechanics.ramp import Ramp
from ..spaces import space_of

_SMALL = 1e-6  # of the largest load in the phase: stands for no load, and has a direction


@functools.partial(program, static=("bundles",))
def works(thawed, arrays, paths, bundles):
    """Works and energies of all increments.

    Args:
        thawed, arrays: structure and phases, as `preparation.prepare` gives them.
        paths: for each phase the codes of its increments, [n_inc], and their displacements, or
            their motions in a structure with beams.
        bundles: as `preparation.prepare` gives them.

    Returns:
        phase_terms: for each phase the terms of its increments, [6, n_inc], J: work of dead loads,
            of following loads, of supports, of prestress, change of stored energy, dissipated
            energy; and the stored energy at the end of the phase.
        end: `marks` of the end of the analysis.
    """
    nodes, groups, carry, schedule = ready(fill(thawed, arrays), bundles)

    def marks_of(carry):
        return marks(copy(carry, states=bundles.apart(carry.states)))

    phase_terms, end, loads = [], marks_of(carry), carry.loads
    for k, (codes, path) in enumerate(paths):
        before = knowing(carry, loads, k)
        ramp = Ramp.build(nodes, groups, before, schedule.phase(k))
        terms, level, carry = _phase(ramp, codes, path)
        reached = jnp.any(codes == status.OK)
        end = jax.tree.map(lambda a, b, ok=reached: jnp.where(ok, a, b), marks_of(carry), end)
        phase_terms.append((terms, level))
    return phase_terms, end


def marks(carry: Carry) -> list[Array]:
    """Arrays that identify the end of an analysis: motion, nodal load, unstressed lengths."""
    lengths = [state.rest_length for state in carry.states]
    return jax.tree.leaves((carry.motion, carry.nodal_load, lengths))


def _phase(ramp, codes, path):
    """Terms of the increments of a phase, [6, n_inc], stored energy at its end, and its `Carry`."""
    begin, n_inc, space = ramp.begin.motion, len(codes), space_of(ramp.groups)
    good, n_good = codes == status.OK, jnp.sum(codes == status.OK)
    path = path if space.kept(path) is not None else begin[None] + path
    path = jnp.where(good[:, None, None], path, begin[None])
    motions = jnp.concatenate([begin[None], path])
    factors = jnp.arange(n_inc + 1, dtype=begin.dtype) / n_inc
    memories = None if ramp.memory is None else _memories(ramp, factors, motions)
    small = _small_loads(ramp, factors)
    points = lax.map(lambda point: _point(ramp, small, *point), (factors, motions, memories))
    old, new = (jax.tree.map(lambda x, s=s: x[s], points) for s in (np.s_[:-1], np.s_[1:]))
    moved = jax.vmap(space.between)(old.motion, new.motion)

    def work(name):
        force = getattr(points, name)
        if force is None:
            return jnp.zeros(n_inc, begin.dtype)
        return 0.5 * jnp.sum((force[:-1] + force[1:]) * moved, axis=(1, 2))

    dead, following = _works_within(old, new)
    prestress, dissipated = _exchanged(ramp, points)
    terms = jnp.stack(
        [
            work("load") + dead,
            work("following") + following,
            work("supports"),
            prestress,
            new.level - old.level,
            dissipated,
        ]
    )
    end = jax.tree.map(lambda x: x[n_good], (factors, motions, memories))
    return jnp.where(good, terms, 0.0), points.level[n_good], ramp.leave(*end)


def _memories(ramp, factors, motions):
    """Memory at the beginning of a phase and at the end of every increment."""

    def follow(memory, increment):
        factor, motion = increment
        system = ramp.at(factor, memory)
        memory = system.settle(motion)
        return memory, memory

    _, later = lax.scan(follow, ramp.memory, (factors[1:], motions[1:]))
    return jax.tree.map(lambda a, b: jnp.concatenate([a[None], b]), ramp.memory, later)


@pytree
class _Point:
    """Forces and energies at one load factor of a phase.

    The energy E of an element includes the potential of the loads q along it, as far as they work
    on deflections between its ends (`elements`). Its stored energy is ``U = E - q dE/dq``, and
    ``dU = dE/dm dm + dE/ds ds - q d(dE/dq)`` is the sum of the work at its ends, the work of
    changes of its unstressed length s, and the work of the loads q. Here q is the load on the whole
    element, which does not depend on s; a pressure is a q as it is.

    Attributes:
        motion: of all rows.
        load: dead loads on every row, without reactions that are ramped out, N and N m.
        following: following loads, or None.
        supports: forces of supports that move, and reactions that are ramped out, or None.
        states: of the elements, with jacks anchored at this load factor: a jack takes unstressed
            length in.
        alongs: loads q along the elements of each group, or None.
        slopes: dE/dq, in the same form as `alongs`.
        energies: E of each group, J.
    """

    motion: Float[Array, "n_row n_motion"]
    load: Float[Array, "n_row n_freedom"]
    following: Float[Array, "n_row n_freedom"] | None
    supports: Float[Array, "n_row n_freedom"] | None
    states: list[ElementState]
    alongs: list[Amounts | None]
    slopes: list[Amounts | None]
    energies: list[Float[Array, ""]]

    @property
    def level(self):
        """Stored energy U of all elements, J; of stacked points, for each of them."""
        total = sum(self.energies)
        for along, slopes in zip(self.alongs, self.slopes, strict=True):
            if along is not None:
                total = total - sum(_products(along, slopes))
        return total


def _small_loads(ramp, factors):
    """A small part of the largest load along every element in the phase, in the form of `_along`.

    The shape of an element without load is that under it.
    """

    def small(load):
        size = jnp.abs(load).reshape(*load.shape[:2], -1).sum(axis=-1)
        return _SMALL * load[jnp.argmax(size, axis=0), jnp.arange(load.shape[1])]

    alongs = lax.map(lambda factor: [_along(state) for state in ramp.at(factor).states], factors)
    return jax.tree.map(small, alongs)


def _point(ramp, small, factor, motion, memory):
    """`_Point` at a load factor; `small` as of `_small_loads`."""
    system = ramp.at(factor, memory)
    load, following, supports = system.load, None, None
    if ramp.released is not None:
        supports = (1 - factor) * ramp.released
        load = load - supports
    if ramp.moved is not None:
        supports = system.reactions(motion) + (0.0 if supports is None else supports)
    if system.followers is not None:
        following = system.space.padded(system.following(system.nodes + motion[:, :3]))
    lists = [[], [], [], []]
    for group, state, least in zip(system.groups, system.states, small, strict=True):
        if state.jack_force is not None:
            state = each("lock", group, state, system.nodes, motion)
        along, slopes = _along(state), None
        if along is None:
            energy = _energy(group, state, system.nodes, motion)
        else:
            along = jax.tree.map(lambda a, b: jnp.where(_none(a), b, a), along, least)
            energy, slopes = jax.value_and_grad(
                lambda q, group=group, state=state: _energy(
                    group, _under(state, q), system.nodes, motion
                )
            )(along)
            # an element that is never loaded may have no shape, and then no finite slope
            slopes = jax.tree.map(lambda q, s: jnp.where(_none(q), 0.0, s), along, slopes)
            state = _under(state, along)
        for items, item in zip(lists, (state, along, slopes, energy), strict=True):
            items.append(item)
    return _Point(motion, load, following, supports, *lists)


def _energy(group, state, nodes, motion):
    """Energy E of a group, J, see `_Point`."""
    return jnp.sum(each("energy", group, state, nodes, motion))


def _works_within(old, new):
    """Work of dead loads and of pressures on deflections within elements, [n_inc] each."""
    works = [0.0, 0.0]
    for before, after, *slopes in zip(old.alongs, new.alongs, old.slopes, new.slopes, strict=True):
        if after is not None:
            change = jax.tree.map(lambda a, b: b - a, *slopes)
            mean = jax.tree.map(lambda a, b: 0.5 * (a + b), before, after)
            works = [w - part for w, part in zip(works, _products(mean, change), strict=True)]
    return works


def _exchanged(ramp, points):
    """Work of changes of unstressed lengths, and energy dissipated by laws, [n_inc] each.

    The force that works on a change of length is the derivative of E at the memory before the
    increment.
    """
    n = len(points.motion) - 1
    old, new = np.arange(n), np.arange(1, n + 1)
    prestress, dissipated = jnp.zeros((2, n), points.motion.dtype)
    for k, group in enumerate(ramp.groups):
        changes = ramp.end_states[k] is not None or ramp.jacks[k] is not None
        if not (changes or group.remembers):
            continue
        # energies with unstressed lengths, motions and memory from before or after an increment
        sources = [(new, old, old), (old, new, old)] if changes else []
        sources += [(new, new, old)] if group.remembers else []
        indices = (np.concatenate(source) for source in zip(*sources, strict=True))
        mixed = _mixed(ramp, points, k, *indices)
        energies = points.energies[k]
        last = mixed[-n:] if group.remembers else energies[1:]
        if changes:
            prestress = prestress + 0.5 * (mixed[:n] - energies[:-1] + last - mixed[n : 2 * n])
        if group.remembers:
            dissipated = dissipated + last - energies[1:]
    return prestress, dissipated


def _mixed(ramp, points, k, lengths, at, memory):
    """E of a group with the unstressed lengths, motions and memory of given points, J.

    Args:
        ramp: the phase.
        points: stacked `_Point`.
        k: number of the group.
        lengths, at, memory: indices of the points from which to take unstressed lengths, motions
            and loads, and memory, [n] each.
    """
    states, along = points.states[k], points.alongs[k]

    def of_increment(indices):
        from_length, from_motion, from_memory = indices
        state, load = _at(states, from_length), _at(along, from_motion)
        state = copy(state, memory=_at(states.memory, from_memory))
        state = state if load is None else _under(state, load)
        return _energy(ramp.groups[k], state, ramp.nodes, points.motion[from_motion])

    return lax.map(of_increment, tuple(map(jnp.asarray, (lengths, at, memory))))


def _at(tree, k):
    """Entry k of all arrays of a tree."""
    return jax.tree.map(lambda x: x[k], tree)


def _along(state):
    """Loads along the elements of a group, `Amounts`; None if none act."""
    acting = state.element_load
    return None if acting is None else acting.amounts(state.rest_length)


def _under(state, along):
    """The state with the loads `along` the elements."""
    acting = state.element_load.with_amounts(along, state.rest_length)
    return copy(state, element_load=acting)


def _none(load):
    """Whether an element has no load, in a shape that broadcasts against `load`."""
    return load == 0 if load.ndim == 1 else jnp.all(load == 0, axis=-1, keepdims=True)


def _products(loads, slopes):
    """Sums of load times slope at every point, a list for the two kinds of load, [n_point] each."""

    def product(load, slope):
        return jnp.sum(load * slope, axis=tuple(range(1, load.ndim)))

    return [
        sum(jax.tree.leaves(jax.tree.map(product, *pair)))
        for pair in zip(loads, slopes, strict=True)
    ]
