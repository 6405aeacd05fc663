"""What is read off a point of equilibrium, and the shape in which users get it."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Any, TypeVar

import jax
import jax.numpy as jnp

from ..common.tree import copy, fill, pytree, thaw, where
from ..common.types import Array, Float, Int, PyTree
from ..elements.element import Element
from ..mechanics.assembly import System
from ..mechanics.elementwise import each
from ..mechanics.ramp import Carry, PhaseData, make_system
from ..model.structure import Structure
from ..model.topology import topology_of
from ..numerics.rooted import told
from .preparation import Prepared
from .schedule import Schedule
from .solution import Solution, State
from .told import named

_PER_ELEMENT = (
    *("tension", "peak_tension", "rest_length", "section_forces", "strain", "began", "results"),
)

Part = TypeVar("Part")


def per_element(part: Part, function: Callable[[PyTree[Array]], PyTree[Array]]) -> Part:
    """A result with a function of what has an item a group, each a list of them."""
    own = {name: getattr(part, name, None) for name in _PER_ELEMENT}
    others = own.pop("results") or {}
    changes = {name: function(value) for name, value in own.items() if value is not None}
    others = {name: function(value) for name, value in others.items()}
    return copy(part, **changes, results=others)


@pytree
class Reached:
    """Where an analysis stands: what the last good increment belongs to.

    Attributes:
        number: of the phase, -1 before the first increment.
        factor: load factor of that phase.
        held: what supports hold there of what they change, by name (`Schedule.before`).
    """

    number: Int[Array, ""]
    factor: Float[Array, ""]
    held: dict[str, Array]

    @classmethod
    def none(cls, schedule: Schedule, dtype: Any) -> Reached:
        """Before the first increment."""
        held = {} if schedule.before is None else schedule.before
        first = {name: value[0] for name, value in held.items()}
        return cls(jnp.int32(-1), jnp.zeros((), dtype), first)

    def after(self, data: PhaseData, factor: Float[Array, ""]) -> Reached:
        """With a phase that has come to a load factor, 0 if it has no good increment."""
        held = {name: getattr(data.freedoms, name) for name in self.held}
        new = Reached(data.number, factor, held)
        return where(factor > 0, new, self)


def system_of(
    frame: tuple[Float[Array, "n_row 3"], list[Element]],
    carry: Carry,
    reached: Reached,
    schedule: Schedule,
) -> System:
    """The system in which an analysis stands, of which only what supports hold is asked."""
    freedoms = copy(schedule.freedoms.of_supports, **reached.held)
    return make_system(*frame, carry, None, freedoms)


def state_of(frame, carry, point, reached, schedule, seen=None):
    """The `State` that a carry stands for, rows of motion put onto their nodes.

    `point` are its motion without what has no derivative, and the marks of that
    (`implicit.attach_apart`), or None; `seen` is the `Reading` there, without derivatives, if at
    hand.
    """
    nodes, groups = frame
    system = system_of(frame, carry, reached, schedule)
    (motion, marks), n_node, freedoms = point, schedule.n_node, system.freedoms
    space = system.space
    beside, within = _marked(groups, marks)

    def summed(values, marked=True):  # a hinge passes its force to the node
        if marked and marks is not None:
            values = values + beside[:, None]
        if freedoms.rows is None:
            return values
        return jnp.zeros_like(values[:n_node]).at[freedoms.rows].add(values)

    displacement = carry.motion[:n_node, :3]
    problem = thaw((system, motion))
    if seen is None:
        found = _read(problem)
    else:
        found = {name: seen.found[name] for name in (*seen.of_ends, "end_forces")}
        found = told(_read, found, problem)
    reactions = summed(system.reactions(motion, found.pop("end_forces")))
    follow = system.followers is not None or any(group.slides for group in groups)
    load = summed(_acting(system, motion), follow)  # dead loads do not depend on where nodes are
    return State(
        displacement=displacement,
        positions=nodes[:n_node] + displacement,
        rest_length=[state.rest_length for state in carry.states],
        reactions=reactions[:, :3],
        load=load[:, :3],
        phase=reached.number,
        load_factor=reached.factor,
        carry=None,
        fixed=None,
        rotation=space.rotations(carry.motion[:n_node]),
        reaction_moments=space.moments(reactions),
        **named({name: within(own) for name, own in found.items()}),
    )


def _read(problem):
    """What the end of a phase has of its elements, by name, from a system and a motion."""
    system, motion = fill(*problem)
    names = [name for name, own in system.results().items() if own.ends]
    return system.reading(motion, *names, "end_forces")


def _marked(groups, marks):
    """Marks of rows [n_row] as those of rows that elements join to them, and a function.

    It adds them to what is read off elements, a list of arrays [n_elem, ...] or None.
    """
    if marks is None:
        return None, lambda parts: parts
    own = [jnp.sum(marks[group.links], axis=1) for group in groups]
    beside = marks
    for group, mark in zip(groups, own, strict=True):
        beside = beside.at[group.links].add(mark[:, None])

    def within(parts):
        return [
            None if part is None else part + mark.reshape(-1, *(1,) * (part.ndim - 1))
            for part, mark in zip(parts, own, strict=True)
        ]

    return beside, within


def _acting(system, motion):
    """All loads on every node, with what slides along ropes where it is now."""
    load = system.all_load(motion)
    for group, state in zip(system.groups, system.states, strict=True):
        if group.slides and state.line_load is not None:
            slid = each("slid", group, state, system.nodes, motion)
            load = load.at[group.links, :3].add(slid)
    return load


def with_peaks(part):
    """Peak tensions put where a group has none of its own: its tensions, the same arrays."""
    pairs = zip(part.tension, part.peak_tension, strict=True)
    return copy(part, peak_tension=[own if peak is None else peak for own, peak in pairs])


def on_nodes(structure: Structure, part: Part, per_node: Sequence[str] = ("displacement",)) -> Part:
    """Rows of motion put onto their nodes.

    Args:
        structure: `Structure`.
        part: result of the compiled core.
        per_node: names of what has an entry for each row of motion, on its second axis.
    """
    if structure.rows()[0] is None:
        return part
    return copy(part, **{name: getattr(part, name)[:, : structure.n_node] for name in per_node})


def arranged(structure: Structure, solution: Solution, task: Prepared) -> Solution:
    """Put lists with an item per group into the shape of the elements; topology where it belongs.

    Args:
        structure: `Structure`.
        solution: what the compiled core gives.
        task: `preparation.Prepared`.
    """

    def arrange(part):
        return per_element(with_peaks(part), structure.arrange)

    parts = solution, solution.last, solution.phases.ends, solution.phases.paths
    solution, last, ends, paths = map(arrange, parts)
    phases = copy(solution.phases, ends=ends, paths=paths)
    loads = [
        copy(stack, load=jax.tree.unflatten(jax.tree.structure(stack.load), leaves))
        for stack, leaves in zip(task.loads, last.carry.loads, strict=True)
    ]
    carry = copy(last.carry, loads=loads)
    last = copy(last, carry=carry, fixed=task.fixed, topology=topology_of(structure))
    links = tuple(group.links for group in structure.groups)
    return copy(solution, phases=phases, last=last, links=links)
