"""A phase as a function of its load factor: the system that has to be in equilibrium.

The phase begins with what earlier phases left (`Carry`) and adds its own data (`PhaseData`), both
with index arrays in place of topology. `Ramp.build` turns the prestress statements into start and
end states once; `Ramp.at` interpolates.
"""

import jax
import jax.numpy as jnp

from ._tree import copy, pytree
from .assembly import System, each


@pytree
class Carry:
    """What a phase hands to the next one.

    Attributes:
        displacement: from the initial nodes, [n_node, 3], m.
        states: element states, one per group.
        nodal_load: sum of the nodal loads so far, [n_node, 3], N.
        element_loads: list of (element load, its factor).
    """

    displacement: object
    states: object
    nodal_load: object
    element_loads: object


@pytree(static=("increments",))
class PhaseData:
    """A phase, prepared on the host.

    Attributes:
        inputs: prestress statements, per group a dict from name to [n_elem].
        nodal_loads, element_loads: loads by kind, lists.
        freedoms: numbering of this phase's unknowns.
        freedoms_before: numbering of the phase before, if the supports change, else None.
        increments: number of steps.
    """

    inputs: object
    nodal_loads: object
    element_loads: object
    freedoms: object
    freedoms_before: object
    increments: int = 1


@pytree
class Ramp:
    """The phase between load factor 0 and 1.

    Attributes:
        nodes, groups: the structure.
        begin: what the phase starts from, a `Carry` (loads on newly fixed freedoms taken off).
        end_states: element states at load factor 1; None for a group that does not change.
        held: (force at the start, force at the end) for a jacked group, else None.
        added_load: nodal loads of this phase, [n_node, 3], N, or None.
        added_element_loads: element loads of this phase.
        released: reactions of newly freed freedoms, ramped out, [n_node, 3], N, or None.
        freedoms: numbering of the unknowns.
    """

    nodes: object
    groups: object
    begin: object
    end_states: object
    held: object
    added_load: object
    added_element_loads: object
    released: object
    freedoms: object

    @classmethod
    def build(cls, nodes, groups, carry, data):
        """Work out start and end of the phase from the carry and the phase's data."""
        released = None
        if data.freedoms_before is not None:
            was, now = data.freedoms_before.fixed, data.freedoms.fixed
            before = System(
                nodes,
                groups,
                carry.states,
                total_load(nodes, groups, carry),
                carry.displacement.reshape(-1),
                data.freedoms_before,
            )
            released = jnp.where(was & ~now, before.unbalanced(carry.displacement), 0.0)
            carry = copy(carry, nodal_load=jnp.where(now & ~was, 0.0, carry.nodal_load))
        end_states, held = [], []
        for group, state, inputs in zip(groups, carry.states, data.inputs, strict=True):
            end_state = jack = None
            if "jacking" in inputs:
                force = each("tension", group, state, nodes, carry.displacement)
                jack = (force, inputs["jacking"])
            elif inputs:
                chord = jnp.linalg.norm(nodes[group.links[:, 1]] - nodes[group.links[:, 0]], axis=1)
                end_state = group.restate(state, chord, inputs)
            end_states.append(end_state)
            held.append(jack)
        added = None
        if data.nodal_loads:
            added = sum(load.nodal_forces(len(nodes), nodes.dtype) for load in data.nodal_loads)
        return cls(
            nodes,
            groups,
            carry,
            end_states,
            held,
            added,
            data.element_loads,
            released,
            data.freedoms,
        )

    def states(self, factor):
        """Element states at a load factor."""
        now = []
        for start, end, jack in zip(self.begin.states, self.end_states, self.held, strict=True):
            if jack is not None:
                now.append(copy(start, held=_mix(*jack, factor)))
            elif end is not None:
                mixed = jax.tree.map(lambda a, b: _mix(a, b, factor), start, end)
                # taken in altogether: no such cable, and NaN becomes the status NONFINITE
                length = jnp.where(mixed.rest_length > 0, mixed.rest_length, jnp.nan)
                now.append(copy(mixed, rest_length=length))
            else:
                now.append(start)
        return now

    def nodal_load(self, factor):
        """Nodal loads and reactions being ramped out, at a load factor, [n_node, 3], N."""
        load = self.begin.nodal_load
        if self.added_load is not None:
            load = load + factor * self.added_load
        if self.released is not None:
            load = load + (1 - factor) * self.released
        return load

    def element_loads(self, factor):
        """Element loads at a load factor, with their factors."""
        return [*self.begin.element_loads, *((load, factor) for load in self.added_element_loads)]

    def at(self, factor):
        """The `System` at a load factor."""
        states, begin = self.states(factor), self.begin.displacement
        now = Carry(begin, states, self.nodal_load(factor), self.element_loads(factor))
        load = total_load(self.nodes, self.groups, now)
        return System(self.nodes, self.groups, states, load, begin.reshape(-1), self.freedoms)

    def leave(self, factor, displacement):
        """What the phase leaves when it ends at `factor`; anchors the jacks."""
        states = []
        for group, state in zip(self.groups, self.states(factor), strict=True):
            locked = state.held is not None
            states.append(each("lock", group, state, self.nodes, displacement) if locked else state)
        return Carry(displacement, states, self.nodal_load(factor), self.element_loads(factor))


def _mix(start, end, factor):
    return (1 - factor) * start + factor * end


def total_load(nodes, groups, carry):
    """All loads of a `Carry` on every node, [n_node, 3], N."""
    load = carry.nodal_load
    for element_load, factor in carry.element_loads:
        added = element_load.nodal_forces(groups, carry.states, len(nodes), nodes.dtype)
        load = load + factor * added
    return load
