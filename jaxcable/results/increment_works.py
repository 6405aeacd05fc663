"""Work, stored energy and dissipated energy of each increment of an analysis.

Work is computed from forces and displacements at both ends of an increment, by the trapezoidal
rule; energies are those of the elements.
"""

from __future__ import annotations

import functools

import jax
import jax.numpy as jnp
import numpy as np
from jax import lax

from ..analysis.preparation import complete_input
from ..common import status
from ..common.tree import copy_with, merge_indices, pytree
from ..common.types import Array, Float
from ..elements.element_state import ElementState, TotalLoads
from ..mechanics.elementwise import evaluate_elements
from ..mechanics.load_ramp import LoadRamp
from ..mechanics.restart_state import RestartState, with_loads_until
from ..programs.program_calls import as_program
from ..spaces import space_class

# Part of the largest load in the phase that stands for no load: it has a direction. Its own work is
# a millionth of that of the load.
_SMALL = 1e-6


@functools.partial(as_program, static=("bundles",))
def increment_works(without_indices, index_arrays, paths, bundles):
    """Compute works and energies of all increments of an analysis; a program.

    Args:
        without_indices, index_arrays, bundles: structure and phases, from `preparation.prepare`.
        paths: for each phase the status codes of its increments, [n_inc], and the displacements at
            their ends, [n_inc, n_node, 3] (with beams, also rotations).

    Returns:
        phase_terms: for each phase a pair. The terms of its increments, [6, n_inc], J, are the work
            of dead loads, of follower loads, of supports and of prestress, the change of stored
            energy, and the dissipated energy. The second item is the stored energy at the end, J.
        end: arrays that identify the end of the analysis (`end_fingerprint`).
    """
    nodes, groups, restart, schedule = complete_input(
        merge_indices(without_indices, index_arrays), bundles
    )

    def marks_of(restart):
        return end_fingerprint(copy_with(restart, states=bundles.split(restart.states)))

    phase_terms, end, loads = [], marks_of(restart), restart.loads
    for k, (codes, path) in enumerate(paths):
        before = with_loads_until(restart, loads, k)
        ramp = LoadRamp.build(nodes, groups, before, schedule.phase(k))
        terms, stored_energy, restart = _work_terms_of_phase(ramp, codes, path)
        reached = jnp.any(codes == status.OK)
        end = jax.tree.map(lambda a, b, ok=reached: jnp.where(ok, a, b), marks_of(restart), end)
        phase_terms.append((terms, stored_energy))
    return phase_terms, end


def end_fingerprint(restart: RestartState) -> list[Array]:
    """Return arrays that identify the end of an analysis: motion, loads, unstressed lengths."""
    lengths = [state.rest_length for state in restart.states]
    return jax.tree.leaves((restart.motion, restart.nodal_load, lengths))


def _work_terms_of_phase(ramp, codes, path):
    """Return the terms [6, n_inc] of one phase for `increment_works`, and its end.

    `codes` and `path` are status codes and displacements of its increments. The end is the stored
    energy, J, and the `RestartState`.
    """
    begin, n_inc, space = ramp.start.motion, len(codes), space_class(ramp.groups)
    good, n_good = codes == status.OK, jnp.sum(codes == status.OK)
    path = jnp.where(good[:, None, None], path, begin[None])
    motions = jnp.concatenate([begin[None], path])
    factors = jnp.arange(n_inc + 1, dtype=begin.dtype) / n_inc
    memories = (
        None if ramp.memory is None else _history_variables_along_phase(ramp, factors, motions)
    )
    small = _nearly_zero_element_loads(ramp, factors)
    points = lax.map(
        lambda point: _forces_and_energies_at(ramp, small, *point), (factors, motions, memories)
    )
    old, new = (jax.tree.map(lambda x, s=s: x[s], points) for s in (np.s_[:-1], np.s_[1:]))
    moved = jax.vmap(space.displacement_between)(old.motion, new.motion)

    def work(name):
        force = getattr(points, name)
        if force is None:
            return jnp.zeros(n_inc, begin.dtype)
        return 0.5 * jnp.sum((force[:-1] + force[1:]) * moved, axis=(1, 2))

    dead, following = _work_within_elements(old, new)
    prestress, dissipated = _prestress_work_and_dissipation(ramp, points)
    terms = jnp.stack(
        [
            work("load") + dead,
            work("following") + following,
            work("supports"),
            prestress,
            new.stored_energy - old.stored_energy,
            dissipated,
        ]
    )
    end = jax.tree.map(lambda x: x[n_good], (factors, motions, memories))
    return jnp.where(good, terms, 0.0), points.stored_energy[n_good], ramp.commit(*end)


def _history_variables_along_phase(ramp, factors, motions):
    """Return the history variables at the start and after every increment, arrays [n_inc + 1, ...].

    `factors` and `motions` are load factors and displacements at these points.
    """

    def follow(memory, increment):
        factor, motion = increment
        system = ramp.system_at(factor, memory)
        memory = system.commit_memory(motion)
        return memory, memory

    _, later = lax.scan(follow, ramp.memory, (factors[1:], motions[1:]))
    return jax.tree.map(lambda a, b: jnp.concatenate([a[None], b]), ramp.memory, later)


@pytree
class _ForcesAndEnergies:
    """Forces and energies of the structure at one load factor of a phase.

    The energy E of an element includes the potential of the loads q along it, as far as they work
    on deflections between its ends. Its stored energy is ``U = E - q dE/dq``. Then ``dU = dE/dm dm
    + dE/ds ds - q d(dE/dq)`` is the sum of the work at its ends (displacements m), of the work of
    changes of its unstressed length s, and of the work of the loads q. Here q is the load on the
    whole element, N, which does not depend on s; q of a pressure is its load per length, N/m.

    Attributes:
        motion: displacements (and rotations) of the nodes, [n_row, n_motion].
        load: dead loads on the nodes, without reactions of released supports, N and N m.
        following: follower loads on the nodes, or None.
        supports: forces of supports that move, and reactions of released supports, or None.
        states: states of the element groups, with jacks locked off at this load factor, so that
            their unstressed lengths include what the jacks have pulled in.
        element_loads: loads q along the elements of each group, or None.
        slopes: dE/dq, in the same form as `element_loads`.
        energies: E of each group, J.
    """

    motion: Float[Array, "n_row n_motion"]
    load: Float[Array, "n_row n_freedom"]
    following: Float[Array, "n_row n_freedom"] | None
    supports: Float[Array, "n_row n_freedom"] | None
    states: list[ElementState]
    element_loads: list[TotalLoads | None]
    slopes: list[TotalLoads | None]
    energies: list[Float[Array, ""]]

    @property
    def stored_energy(self):
        """Stored energy U of all elements, J; [n_point] if several load factors are stacked."""
        total = sum(self.energies)
        for along, slopes in zip(self.element_loads, self.slopes, strict=True):
            if along is not None:
                total = total - sum(_sums_of_load_times_slope(along, slopes))
        return total


def _nearly_zero_element_loads(ramp, factors):
    """Return a millionth of the largest load along each element in a phase, per group.

    It replaces the load at load factors at which an element has none: its direction gives the
    element a shape. `factors` are the load factors at which the largest load is looked for.
    """

    def small(load):
        size = jnp.abs(load).reshape(*load.shape[:2], -1).sum(axis=-1)
        return _SMALL * load[jnp.argmax(size, axis=0), jnp.arange(load.shape[1])]

    def loads_at(factor):
        return [_total_element_loads(state) for state in ramp.system_at(factor).states]

    return jax.tree.map(small, lax.map(loads_at, factors))


def _forces_and_energies_at(ramp, small, factor, motion, memory):
    """Evaluate forces and energies at a load factor, as a `_ForcesAndEnergies`.

    `motion` and `memory` are displacements and history variables there; `small` are the element
    loads that stand for none, from `_nearly_zero_element_loads`.
    """
    system = ramp.system_at(factor, memory)
    load, following, supports = system.load, None, None
    if ramp.released is not None:
        supports = (1 - factor) * ramp.released
        load = load - supports
    if ramp.moved is not None:
        supports = system.reactions(motion) + (0.0 if supports is None else supports)
    if system.followers is not None:
        following = system.space.pad_moments(system.follower_forces(system.nodes + motion[:, :3]))
    lists = [[], [], [], []]
    for group, state, least in zip(system.groups, system.states, small, strict=True):
        if state.jack_force is not None:
            state = evaluate_elements("lock_off", group, state, system.nodes, motion)
        along, slopes = _total_element_loads(state), None
        if along is None:
            energy = _group_energy(group, state, system.nodes, motion)
        else:
            along = jax.tree.map(lambda a, b: jnp.where(_is_unloaded(a), b, a), along, least)
            energy, slopes = jax.value_and_grad(
                lambda q, group=group, state=state: _group_energy(
                    group, _with_element_loads(state, q), system.nodes, motion
                )
            )(along)
            # an element that is never loaded may have no shape, and then no finite slope
            slopes = jax.tree.map(lambda q, s: jnp.where(_is_unloaded(q), 0.0, s), along, slopes)
            state = _with_element_loads(state, along)
        for items, item in zip(lists, (state, along, slopes, energy), strict=True):
            items.append(item)
    return _ForcesAndEnergies(motion, load, following, supports, *lists)


def _group_energy(group, state, nodes, motion):
    """Return the energy E of all elements of a group (see `_ForcesAndEnergies`), J, scalar.

    `state` is that of the group; `nodes` are initial positions, `motion` displacements, m.
    """
    return jnp.sum(evaluate_elements("energy", group, state, nodes, motion))


def _work_within_elements(old, new):
    """Return the work of loads along elements on deflections between their ends, [n_inc], J.

    `old` and `new` are the `_ForcesAndEnergies` before and after the increments. The two items of
    the list are for dead loads and for pressures.
    """
    works = [0.0, 0.0]
    for before, after, *slopes in zip(
        old.element_loads, new.element_loads, old.slopes, new.slopes, strict=True
    ):
        if after is not None:
            change = jax.tree.map(lambda a, b: b - a, *slopes)
            mean = jax.tree.map(lambda a, b: 0.5 * (a + b), before, after)
            works = [
                w - part
                for w, part in zip(works, _sums_of_load_times_slope(mean, change), strict=True)
            ]
    return works


def _prestress_work_and_dissipation(ramp, points):
    """Return the work of changes of unstressed lengths and the dissipated energy, [n_inc] each, J.

    `points` are the stacked `_ForcesAndEnergies` of the phase. The force that works on a change of
    length is the derivative of E with the history variables from before the increment.
    """
    n = len(points.motion) - 1
    old, new = np.arange(n), np.arange(1, n + 1)
    prestress, dissipated = jnp.zeros((2, n), points.motion.dtype)
    for k, group in enumerate(ramp.groups):
        changes = ramp.end_states[k] is not None or ramp.jacks[k] is not None
        if not (changes or group.has_memory):
            continue
        # energies with lengths, motions and history variables from before or after an increment
        sources = [(new, old, old), (old, new, old)] if changes else []
        sources += [(new, new, old)] if group.has_memory else []
        indices = (np.concatenate(source) for source in zip(*sources, strict=True))
        mixed = _group_energies_of_mixed_points(ramp, points, k, *indices)
        energies = points.energies[k]
        last = mixed[-n:] if group.has_memory else energies[1:]
        if changes:
            prestress = prestress + 0.5 * (mixed[:n] - energies[:-1] + last - mixed[n : 2 * n])
        if group.has_memory:
            dissipated = dissipated + last - energies[1:]
    return prestress, dissipated


def _group_energies_of_mixed_points(ramp, points, k, lengths, motions, memory):
    """Return the energy E of a group for states mixed from several points of a phase, [n], J.

    Args:
        ramp: the phase.
        points: stacked `_ForcesAndEnergies`.
        k: index of the group.
        lengths, motions, memory: indices of the points from which to take unstressed lengths,
            displacements with their loads, and history variables, [n] each.
    """
    states, along = points.states[k], points.element_loads[k]

    def for_increment(indices):
        from_length, from_motion, from_memory = indices
        state, load = (
            _entry_of_all_arrays(states, from_length),
            _entry_of_all_arrays(along, from_motion),
        )
        state = copy_with(state, memory=_entry_of_all_arrays(states.memory, from_memory))
        state = state if load is None else _with_element_loads(state, load)
        return _group_energy(ramp.groups[k], state, ramp.nodes, points.motion[from_motion])

    return lax.map(for_increment, tuple(map(jnp.asarray, (lengths, motions, memory))))


def _entry_of_all_arrays(tree, k):
    """Return a pytree with the entry of index `k` on the first axis of each array of a pytree."""
    return jax.tree.map(lambda x: x[k], tree)


def _total_element_loads(state):
    """Return the loads on whole elements of a group, `TotalLoads`; None if none act."""
    acting = state.element_load
    return None if acting is None else acting.total_loads(state.rest_length)


def _with_element_loads(state, along):
    """Return the state of a group with the `TotalLoads` `along` in place of its loads."""
    acting = state.element_load.with_total_loads(along, state.rest_length)
    return copy_with(state, element_load=acting)


def _is_unloaded(load):
    """Return whether each element has no load, in a shape that broadcasts against `load`."""
    return load == 0 if load.ndim == 1 else jnp.all(load == 0, axis=-1, keepdims=True)


def _sums_of_load_times_slope(loads, slopes):
    """Return the sums of load times slope dE/dq, [n_point], J, of dead loads and of pressures."""

    def product(load, slope):
        return jnp.sum(load * slope, axis=tuple(range(1, load.ndim)))

    return [
        sum(jax.tree.leaves(jax.tree.map(product, *pair)))
        for pair in zip(loads, slopes, strict=True)
    ]
