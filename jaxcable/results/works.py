"""What each increment of an analysis does: work of all that acts, stored and dissipated energy.

From forces and displacements at both ends of an increment, by the trapezoidal rule; energies are
those of the elements.
"""

from __future__ import annotations

import functools
from typing import TypeAlias

import jax
import jax.numpy as jnp
import numpy as np
from jax import lax

from ..analysis.preparation import ready
from ..common import status
from ..common.compilation import program
from ..common.tree import copy, fill, pytree
from ..common.types import Array, Float
from ..elements.element import ElementState
from ..mechanics.elementwise import each
from ..mechanics.ramp import Carry, Ramp, knowing
from ..spaces import space_of

_FIRST = 1e-6  # part of the first increment's load that stands for none: it has a direction

_Along: TypeAlias = (
    "tuple[Float[Array, 'n_elem 3'] | None, dict[str, list[Float[Array, ' n_elem']]] | None]"
)
"""Loads along the elements of a group: dead ones, and pressures by the length that they are per."""


@functools.partial(program, static=("bundles",))
def works(thawed, arrays, paths, bundles):
    """Works and energies of all increments.

    Args:
        thawed, arrays: structure and phases, as `preparation.prepare` gives them.
        paths: by phase its codes, [n_inc], and displacements, or motions in a structure with beams.
        bundles: as `preparation.prepare` gives them.

    Returns:
        rows: by phase the terms of its increments, [6, n_inc], J: work of dead loads, of following
            ones, of supports, of prestress, change of stored energy, dissipated energy; and the
            stored energy at its end.
        end: `marks` of the end.
    """
    nodes, groups, carry, schedule = ready(fill(thawed, arrays), bundles)

    def seen(carry):
        return marks(copy(carry, states=bundles.apart(carry.states)))

    rows, end, loads = [], seen(carry), carry.loads
    for k, (codes, path) in enumerate(paths):
        before = knowing(copy(carry, loads=loads), k)
        ramp = Ramp.build(nodes, groups, before, schedule.phase(k))
        terms, level, carry = _phase(ramp, codes, path)
        reached = jnp.any(codes == status.OK)
        end = jax.tree.map(lambda a, b, ok=reached: jnp.where(ok, a, b), seen(carry), end)
        rows.append((terms, level))
    return rows, end


def marks(carry: Carry) -> list[Array]:
    """What tells one end of an analysis from another."""
    lengths = [state.rest_length for state in carry.states]
    return jax.tree.leaves((carry.motion, carry.nodal_load, lengths))


def _phase(ramp, codes, path):
    """Terms of the increments of a phase, [6, n_inc], its level, and the `Carry` that it leaves."""
    begin, n_inc, space = ramp.begin.motion, len(codes), space_of(ramp.groups)
    good, n_good = codes == status.OK, jnp.sum(codes == status.OK)
    path = path if space.kept(path) is not None else begin[None] + path
    path = jnp.where(good[:, None, None], path, begin[None])
    motions = jnp.concatenate([begin[None], path])
    factors = jnp.arange(n_inc + 1, dtype=begin.dtype) / n_inc
    memories = None if ramp.memory is None else _memories(ramp, factors, motions)
    points = lax.map(lambda own: _point(ramp, n_inc, *own), (factors, motions, memories))
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
    """Memory at all points of a phase."""

    def step(memory, point):
        factor, motion = point
        system = ramp.at(factor, memory)
        memory = system.settle(system.strains(motion))
        return memory, memory

    _, later = lax.scan(step, ramp.memory, (factors[1:], motions[1:]))
    return jax.tree.map(lambda a, b: jnp.concatenate([a[None], b]), ramp.memory, later)


@pytree
class _Point:
    """Forces and energies at a point of a phase.

    The energy E of an element has the potential of the loads q along it in it, as far as these act
    beyond its ends (`elements`). Its own is ``U = E - q dE/dq``, and
    ``dU = dE/dm dm + dE/ds ds - q d(dE/dq)``: the work of its ends, of what changes its unstressed
    length s, and of these loads. A load q is that on the whole element, which no change of s
    changes; a pressure is one.

    Attributes:
        motion: of all rows.
        load: dead loads on every row, without reactions that are ramped out, N and N m.
        following: loads that follow, or None. supports: forces of supports that move, and of those
            that are ramped out, or None.
        states: of the elements, with jacks anchored here: a jack reels unstressed length in.
        alongs: loads along the elements of each group, (dead or None, pressures or None), or None.
        slopes: dE/dq, as these.
        energies: E of each group, J.
    """

    motion: Float[Array, "n_row n_motion"]
    load: Float[Array, "n_row n_freedom"]
    following: Float[Array, "n_row n_freedom"] | None
    supports: Float[Array, "n_row n_freedom"] | None
    states: list[ElementState]
    alongs: list[_Along | None]
    slopes: list[_Along | None]
    energies: list[Float[Array, ""]]

    @property
    def level(self):
        """Stored energy U of all elements, at every point, J."""
        total = sum(self.energies)
        for along, slopes in zip(self.alongs, self.slopes, strict=True):
            if along is not None:
                total = total - sum(_products(along, slopes))
        return total


def _point(ramp, n_inc, factor, motion, memory):
    """`_Point` at a load factor."""
    system = ramp.at(factor, memory)
    load, following, supports = system.load, None, None
    if ramp.released is not None:
        supports = (1 - factor) * ramp.released
        load = load - supports
    if ramp.moved is not None:
        supports = system.reactions(motion) + (0.0 if supports is None else supports)
    if system.followers is not None:
        following = system.space.padded(system.following(system.nodes + motion[:, :3]))
    # what has no load at first has the shape of its first small part
    first = ramp.at(jnp.where(factor > 0, factor, _FIRST / n_inc), memory).states
    own = [[], [], [], []]
    for group, state, soon in zip(system.groups, system.states, first, strict=True):
        if state.jack_force is not None:
            state = each("lock", group, state, system.nodes, motion)
        along, slopes = _along(state), None
        if along is None:
            energy = _energy(group, state, system.nodes, motion)
        else:
            along = jax.tree.map(lambda a, b: jnp.where(_none(a), b, a), along, _along(soon))
            energy, slopes = jax.value_and_grad(
                lambda q, group=group, state=state: _energy(
                    group, _under(state, q), system.nodes, motion
                )
            )(along)
            # an element without load need not have a shape
            slopes = jax.tree.map(lambda q, s: jnp.where(_none(q), 0.0, s), along, slopes)
            state = _under(state, along)
        for items, item in zip(own, (state, along, slopes, energy), strict=True):
            items.append(item)
    return _Point(motion, load, following, supports, *own)


def _energy(group, state, nodes, motion):
    """E of a group, J."""
    return jnp.sum(each("energy", group, state, nodes, motion))


def _works_within(old, new):
    """Work of dead loads, and of pressures, on what they deflect within elements, 2 x [n_inc]."""
    works = [0.0, 0.0]
    for before, after, *slopes in zip(old.alongs, new.alongs, old.slopes, new.slopes, strict=True):
        if after is not None:
            change = jax.tree.map(lambda a, b: b - a, *slopes)
            mean = jax.tree.map(lambda a, b: 0.5 * (a + b), before, after)
            works = [w - own for w, own in zip(works, _products(mean, change), strict=True)]
    return works


def _exchanged(ramp, points):
    """Work of what changes unstressed lengths, and what laws with memory dissipate, 2 x [n_inc].

    The force is the derivative of E at the memory before the increment.
    """
    n = len(points.motion) - 1
    old, new = np.arange(n), np.arange(1, n + 1)
    prestress, dissipated = jnp.zeros((2, n), points.motion.dtype)
    for k, group in enumerate(ramp.groups):
        changes = ramp.end_states[k] is not None or ramp.jacks[k] is not None
        if not (changes or group.remembers):
            continue
        # energies with unstressed lengths, at motions, and with the memory of these points
        pairs = [(new, old, old), (old, new, old)] if changes else []
        pairs += [(new, new, old)] if group.remembers else []
        mixed = _mixed(ramp, points, k, *(np.concatenate(own) for own in zip(*pairs, strict=True)))
        own = points.energies[k]
        last = mixed[-n:] if group.remembers else own[1:]
        if changes:
            prestress = prestress + 0.5 * (mixed[:n] - own[:-1] + last - mixed[n : 2 * n])
        if group.remembers:
            dissipated = dissipated + last - own[1:]
    return prestress, dissipated


def _mixed(ramp, points, k, lengths, at, memory):
    """E of a group at points `at`, with unstressed lengths and memory of others, J."""
    states, along = points.states[k], points.alongs[k]

    def one(numbers):
        length, place, strains = numbers
        state, load = _at(states, length), _at(along, place)
        state = copy(state, memory=_at(states.memory, strains))
        state = state if load is None else _under(state, load)
        return _energy(ramp.groups[k], state, ramp.nodes, points.motion[place])

    return lax.map(one, tuple(map(jnp.asarray, (lengths, at, memory))))


def _at(tree, k):
    """One of the points that all arrays of a tree have."""
    return jax.tree.map(lambda x: x[k], tree)


def _along(state):
    """Loads along the elements of a group, (dead or None, pressures or None); None without any."""
    line, pressed = state.line_load, state.pressed
    if line is None and pressed is None:
        return None
    if line is not None:
        line = line * state.rest_length[:, None]
    if pressed is not None:
        pressed = {per: [pressure for pressure, _ in own] for per, own in pressed.items()}
    return line, pressed


def _under(state, along):
    """The state with other loads along the elements."""
    line, pressed = along
    if line is not None:
        line = line / state.rest_length[:, None]
    if pressed is not None:
        pressed = {
            per: [(new, axis) for new, (_, axis) in zip(own, state.pressed[per], strict=True)]
            for per, own in pressed.items()
        }
    return copy(state, line_load=line, pressed=pressed)


def _none(load):
    """Whether an element has no load, in a shape that broadcasts against it."""
    return load == 0 if load.ndim == 1 else jnp.all(load == 0, axis=-1, keepdims=True)


def _products(loads, slopes):
    """Sums of the products at every point, of the two kinds of load apart, [2][n_point]."""

    def product(load, slope):
        return jnp.sum(load * slope, axis=tuple(range(1, load.ndim)))

    return [
        sum(jax.tree.leaves(jax.tree.map(product, *own))) for own in zip(loads, slopes, strict=True)
    ]
