"""A phase as a function of its load factor: the system that has to be in equilibrium.

The phase begins with what earlier phases left (`Carry`) and adds its own data (`PhaseData`), both
with index arrays in place of topology. `Ramp.build` turns the prestress statements into start and
end states once; `Ramp.at` interpolates.
"""

import jax
import jax.numpy as jnp

from . import status
from ._tree import copy, pytree
from .assembly import System, each
from .frames import FrameSystem
from .freedoms import along, combined
from .rotations import IDENTITY, turned


@pytree
class Carry:
    """What a phase hands to the next one.

    Attributes:
        motion: displacement from the initial nodes, [n_node, 3], m; in a structure with beams
            [n_node, 7], with the unit quaternion of the node's rotation.
        states: element states, one per group.
        nodal_load: sum of the nodal loads so far, [n_node, 3], N; with moments [n_node, 6].
        element_loads: list of (element load, its factor).
        bearing: `FrameSystem.bearing`: rotation in which the support of every row was set.
    """

    motion: object
    states: object
    nodal_load: object
    element_loads: object
    bearing: object = None


def unloaded(nodes, groups):
    """The `Carry` of a structure that nothing has happened to."""
    states = [group.start(nodes[group.links]) for group in groups]
    if all(group.n_freedom == 3 for group in groups):
        return Carry(jnp.zeros_like(nodes), states, jnp.zeros_like(nodes), [])
    still = jnp.broadcast_to(jnp.asarray(IDENTITY, nodes.dtype), (len(nodes), 4))
    motion = jnp.concatenate([jnp.zeros_like(nodes), still], axis=1)
    return Carry(motion, states, jnp.zeros((len(nodes), 6), nodes.dtype), [])


@pytree(static=("increments", "other_pattern"))
class PhaseData:
    """A phase, prepared on the host.

    Attributes:
        inputs: prestress statements, per group a dict from name to `Stated`.
        nodal_loads, element_loads, movements: loads by kind, lists.
        freedoms: numbering of this phase's unknowns.
        freedoms_before: numbering of the phase before, if the supports change, else None.
        increments: number of steps.
        other_pattern: whether its matrices are not those of the phase before.
    """

    inputs: object
    nodal_loads: object
    element_loads: object
    movements: object
    freedoms: object
    freedoms_before: object
    increments: int = 1
    other_pattern: bool = False


@pytree
class Ramp:
    """The phase between load factor 0 and 1.

    Attributes:
        nodes, groups: the structure.
        begin: what the phase starts from, a `Carry` (loads on newly fixed freedoms taken off).
        end_states: element states at load factor 1; None for a group that does not change.
        held: (force at the start, `Stated` at the end) for a jacked group, else None.
        added_load: nodal loads of this phase, as `Carry.nodal_load`, or None.
        added_element_loads: element loads of this phase.
        moved: steps of the supports in this phase, [n_node, 3 or 6], or None.
        released: reactions of newly freed freedoms, ramped out, as `Carry.nodal_load`, or None.
        freedoms: numbering of the unknowns.
    """

    nodes: object
    groups: object
    begin: object
    end_states: object
    held: object
    added_load: object
    added_element_loads: object
    moved: object
    released: object
    freedoms: object

    @classmethod
    def build(cls, nodes, groups, carry, data):
        """Work out start and end of the phase from the carry and the phase's data."""
        released = None
        if data.freedoms_before is not None:
            carry, released = _change_supports(nodes, groups, carry, data)
        end_states, held = [], []
        for group, state, inputs in zip(groups, carry.states, data.inputs, strict=True):
            end_state = jack = None
            if "jacking" in inputs:
                force = each("tension", group, state, nodes, carry.motion)
                jack = (force, inputs["jacking"])
            statements = {name: own for name, own in inputs.items() if name != "jacking"}
            if statements:
                end_state = group.restate(state, nodes[group.links], statements)
            end_states.append(end_state)
            held.append(jack)
        added = None
        if data.nodal_loads:
            shape = carry.nodal_load.shape
            added = sum(load.nodal_forces(shape, nodes.dtype) for load in data.nodal_loads)
        moved = None
        if data.movements:
            shape = carry.nodal_load.shape
            moved = sum(movement.steps(shape, nodes.dtype) for movement in data.movements)
            freedoms = data.freedoms
            if freedoms.rows is not None:
                moved = moved[freedoms.rows]
            if freedoms.inner is not None:
                moved = jnp.where(freedoms.inner[:, None], 0.0, moved)
            # a traced movement may turn out to be one of a free node: there is no such state
            shift = moved[:, :3]
            if freedoms.axes is not None:
                rounding = 8 * jnp.finfo(shift.dtype).eps * jnp.max(jnp.abs(shift))
                shift = along(freedoms.axes, shift)
                shift = jnp.where(jnp.abs(shift) <= rounding, 0.0, shift)
            loose = ~freedoms.fixed[:, :3] & (shift != 0)
            moved = jnp.where(jnp.any(loose), jnp.nan, moved)
        return cls(
            nodes,
            groups,
            carry,
            end_states,
            held,
            added,
            [_begun(load, nodes, carry) for load in data.element_loads],
            moved,
            released,
            data.freedoms,
        )

    @property
    def plastic(self):
        """Plastic strains at the start of the phase, per group; None if no law remembers any."""
        if not any(group.remembers for group in self.groups):
            return None
        return [state.plastic for state in self.begin.states]

    def states(self, factor, plastic=None):
        """Element states at a load factor; plastic strains per group, if not the start's."""
        now = []
        for start, end, jack in zip(self.begin.states, self.end_states, self.held, strict=True):
            state = start
            if end is not None:
                mixed = jax.tree.map(lambda a, b: _mix(a, b, factor), start, end)
                # taken in altogether: no such cable, and NaN becomes the status NONFINITE
                length = jnp.where(mixed.rest_length > 0, mixed.rest_length, jnp.nan)
                state = copy(mixed, rest_length=length)
            if jack is not None:
                force, stated = jack
                held = _mix(force, stated.values, factor)
                state = copy(state, held=held, jacked=stated.chosen)
            now.append(state)
        if plastic is not None:
            now = [copy(state, plastic=own) for state, own in zip(now, plastic, strict=True)]
        return now

    def nodal_load(self, factor):
        """Nodal loads and reactions being ramped out, at a load factor."""
        load = self.begin.nodal_load
        if self.added_load is not None:
            load = load + factor * self.added_load
        if self.released is not None:
            load = load + (1 - factor) * self.released
        return load

    def element_loads(self, factor):
        """Element loads at a load factor, with their factors."""
        return [*self.begin.element_loads, *((load, factor) for load in self.added_element_loads)]

    def held_motion(self, factor):
        """Motion of all nodes as the supports prescribe it at a load factor."""
        begin = self.begin.motion
        if self.moved is None:
            return begin
        if begin.shape[1] == 3:
            return begin + factor * self.moved
        return jax.vmap(turned)(begin, factor * self.moved)

    def at(self, factor, plastic=None):
        """The system at a load factor."""
        states = self.states(factor, plastic)
        loads = self.nodal_load(factor), self.element_loads(factor)
        now = Carry(self.begin.motion, states, *loads, self.begin.bearing)
        return make_system(self.nodes, self.groups, now, self.held_motion(factor), self.freedoms)

    def settle(self, system, x, code, plastic):
        """Plastic strains after an increment that ended at `x`; frozen by a failure."""
        if plastic is None:
            return None
        ok, after = code == status.OK, system.settle(system.motion(x))
        return jax.tree.map(lambda new, old: jnp.where(ok, new, old), after, plastic)

    def leave(self, factor, motion, plastic=None):
        """What the phase leaves when it ends at `factor`; anchors the jacks."""
        states = []
        for group, state in zip(self.groups, self.states(factor, plastic), strict=True):
            state = copy(state, line_load=None)
            locked = state.held is not None
            states.append(each("lock", group, state, self.nodes, motion) if locked else state)
        loads = self.nodal_load(factor), self.element_loads(factor)
        return Carry(motion, states, *loads, self.begin.bearing)


def _change_supports(nodes, groups, carry, data):
    """Carry with loads on newly held freedoms taken off, and reactions of freed ones, or None.

    Where a node is held in part before and after, it is along the same directions (`preparation`).
    """
    before = make_system(nodes, groups, carry, carry.motion, data.freedoms_before)
    was, now = data.freedoms_before.fixed, data.freedoms.fixed
    if data.freedoms.axes is None:
        released = jnp.where(was & ~now, before.unbalanced(carry.motion), 0.0)
        return copy(carry, nodal_load=jnp.where(now & ~was, 0.0, carry.nodal_load)), released
    reaction, load = before.reactions(carry.motion), carry.nodal_load
    if carry.bearing is not None:
        turned_anew = jnp.any((was != now)[:, 3:], axis=1, keepdims=True)
        bearing = jnp.where(turned_anew, carry.motion[:, 3:], carry.bearing)
        carry = copy(carry, bearing=bearing)
    after = make_system(nodes, groups, carry, carry.motion, data.freedoms)
    released, left = [], []
    for k in range(0, was.shape[1], 3):
        part = slice(k, k + 3)
        own, own_before = (
            system.freedoms.axes if k == 0 else system._spin_axes(carry.motion)
            for system in (after, before)
        )
        gone = jnp.where(now[:, part], 0.0, along(own, reaction[:, part]))
        released.append(combined(own, gone))
        whole = jnp.all(now[:, part], axis=1)[:, None, None]
        own = jnp.where(whole, own_before, own)
        newly = now[:, part] & ~was[:, part]
        left.append(combined(own, jnp.where(newly, 0.0, along(own, load[: len(was), part]))))
    return copy(carry, nodal_load=jnp.concatenate(left, axis=1)), jnp.concatenate(released, axis=1)


def make_system(nodes, groups, carry, held, freedoms, load=None):
    """The system of a state: a net's, or a frame's if nodes rotate; shapes elements by their loads.

    `held` is the motion that supports prescribe, None if it is not asked for; `load` the loads of
    the carry, if at hand.
    """
    if load is None:
        load = dead_load(nodes, groups, carry)
    states = [
        _shaped(number, group, state, nodes, carry.element_loads) if group.shaped_by_load else state
        for number, (group, state) in enumerate(zip(groups, carry.states, strict=True))
    ]
    followers = [pair for pair in carry.element_loads if follows(pair[0])] or None
    if carry.motion.shape[1] == 3:
        if held is not None:
            axes = freedoms.axes
            held = (held if axes is None else along(axes, held)).reshape(-1)
        return System(nodes, groups, states, load, held, freedoms, followers)
    return FrameSystem(nodes, groups, states, load, held, freedoms, followers, carry.bearing)


def follows(load):
    """Whether a load depends on where the nodes are."""
    return hasattr(load, "following_forces")


def _shaped(number, group, state, nodes, element_loads):
    """State of a group with what acts along its elements and shapes them."""
    pressed = {}
    for load, factor in element_loads:
        own = load.pressing(number, group) if hasattr(load, "pressing") else None
        if own is not None:
            per, pressure, axis = own
            pressed.setdefault(per, []).append((factor * pressure, axis))
    line_load = _line_load(number, group, state, nodes, element_loads)
    return copy(state, line_load=line_load, pressed=pressed or None)


def _begun(load, nodes, carry):
    """An element load that knows where the phase begins, if it asks for that."""
    if getattr(load, "begun", None) is None:
        return load
    return copy(load, begun=nodes + carry.motion[:, :3])


def _line_load(number, group, state, nodes, element_loads):
    """Load per unstressed length, [n_elem, 3], N/m, that shapes elements of a group, or None."""
    loads = [
        factor * along
        for load, factor in element_loads
        if not follows(load) and (along := load.per_length(number, group, state, nodes)) is not None
    ]
    return sum(loads) if loads else None


def _mix(start, end, factor):
    return (1 - factor) * start + factor * end


def dead_load(nodes, groups, carry):
    """All dead loads of a `Carry` on every node, [n_node, 3 or 6], N and N m."""
    load = carry.nodal_load
    for element_load, factor in carry.element_loads:
        if not follows(element_load):
            arguments = groups, carry.states, nodes, load.shape, nodes.dtype
            load = load + factor * element_load.element_forces(*arguments)
    return load
