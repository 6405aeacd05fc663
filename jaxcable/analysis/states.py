"""From a point of equilibrium to a `State`, and results in the shape of the user's elements."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import jax
import jax.numpy as jnp

from ..common.tree import copy_with, merge_indices, pytree, select_tree, split_indices
from ..common.types import Array, Float, Int
from ..elements.element import Element
from ..mechanics.assembly import System
from ..mechanics.carry import Carry, make_system
from ..mechanics.elementwise import each
from ..mechanics.ramp import PhaseData
from ..model.structure import Structure
from ..model.topology import topology_of
from ..numerics.implicit_root import with_deferred_derivative
from .preparation import Prepared
from .results import Part, element_fields, per_element, with_peaks
from .schedule import Schedule
from .solution import Solution, State


@pytree
class Reached:
    """Where an analysis stands: phase, load factor and supports of the last converged increment.

    Attributes:
        number: number of the phase, -1 before the first increment.
        factor: load factor of that phase.
        held: the arrays of `Freedoms` that depend on the supports, as they are there, by name
            (as `Schedule.before`); empty if the supports never change.
    """

    number: Int[Array, ""]
    factor: Float[Array, ""]
    held: dict[str, Array]

    @classmethod
    def none(cls, schedule: Schedule, dtype: Any) -> Reached:
        """The `Reached` before the first increment."""
        held = {} if schedule.before is None else schedule.before
        first = {name: value[0] for name, value in held.items()}
        return cls(jnp.int32(-1), jnp.zeros((), dtype), first)

    def after(self, data: PhaseData, factor: Float[Array, ""]) -> Reached:
        """The `Reached` after a phase that came to `factor`; 0 if no increment has converged."""
        held = {name: getattr(data.dof_map, name) for name in self.held}
        new = Reached(data.number, factor, held)
        return select_tree(factor > 0, new, self)


def system_of(
    frame: tuple[Float[Array, "n_row 3"], list[Element]],
    carry: Carry,
    reached: Reached,
    schedule: Schedule,
) -> System:
    """The system of a carry with the supports of `reached`, without numbering of unknowns."""
    dof_map = copy_with(schedule.dof_map.without_unknowns, **reached.held)
    return make_system(*frame, carry, None, dof_map)


def state_of(frame, carry, point, reached, schedule, seen=None):
    """The `State` of a carry, with results of rows of motion summed at their nodes.

    Args:
        frame: (nodes, groups).
        carry: `Carry`.
        point: (motion of the carry, marks) as `bare` and `marks` of
            `implicit.attach_derivative_with_marks`; marks may be None.
        reached: `Reached`.
        schedule: `Schedule`.
        seen: `Reading` of the carry's motion, without derivatives; None to read it now.
    """
    nodes, groups = frame
    system = system_of(frame, carry, reached, schedule)
    (motion, marks), n_node, dof_map = point, schedule.n_node, system.dof_map
    space = system.space
    beside, within = _marked(system, marks)

    def summed(values, marked=True):  # a hinged end passes its force to its node
        if marked and marks is not None:
            values = values + beside[:, None]
        if dof_map.node_of_row is None:
            return values
        return jnp.zeros_like(values[:n_node]).at[dof_map.node_of_row].add(values)

    displacement = carry.motion[:n_node, :3]
    problem = split_indices((system, motion))
    if seen is None:
        found = _read(problem)
    else:
        found = {name: seen.found[name] for name in (*seen.of_ends, "end_forces")}
        found = with_deferred_derivative(_read, found, problem)
    reactions = summed(system.reactions(motion, found.pop("end_forces")))
    follow = system.followers is not None or any(group.slides for group in groups)
    load = summed(_acting(system, motion), follow)  # dead loads do not depend on the motion
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
        **element_fields({name: within(values) for name, values in found.items()}),
    )


def _read(problem):
    """What elements tell at the end of a phase, by name, from a thawed (system, motion)."""
    system, motion = merge_indices(*problem)
    names = [name for name, result in system.results().items() if result.ends]
    return system.reading(motion, *names, "end_forces")


def _marked(system, marks):
    """Spread the marks of rows over elements and neighbouring rows.

    Marks are zero; their derivative is NaN where there is no derivative.

    Returns:
        beside: marks of every row and of the rows that share an element with it, [n_row], or None.
        within: function that adds its marks to every element's results, a list of arrays
            [n_elem, ...] or None.
    """
    if marks is None:
        return None, lambda parts: parts
    of_elements = [jnp.sum(at, axis=1) for at in system.at_ends(marks)]
    pairs = zip(of_elements, system.groups, strict=True)
    ends = [jnp.broadcast_to(mark[:, None], group.links.shape) for mark, group in pairs]
    beside = marks + system.at_rows(ends)

    def within(parts):
        return [
            None if part is None else part + mark.reshape(-1, *(1,) * (part.ndim - 1))
            for part, mark in zip(parts, of_elements, strict=True)
        ]

    return beside, within


def _acting(system, motion):
    """All loads on every row, with loads that slide along ropes where they are now."""
    load = system.external_force(motion)
    for group, state in zip(system.groups, system.states, strict=True):
        if group.slides and state.line_load is not None:
            slid = each("slid", group, state, system.nodes, motion)
            load = load.at[group.links, :3].add(slid)
    return load


def on_nodes(structure: Structure, part: Part, per_node: Sequence[str] = ("displacement",)) -> Part:
    """A result without the rows of motion that are no nodes.

    Args:
        structure: `Structure`.
        part: result of the compiled core.
        per_node: names of the fields whose second axis is that of the rows of motion.
    """
    if structure.rows()[0] is None:
        return part
    return copy_with(
        part, **{name: getattr(part, name)[:, : structure.n_node] for name in per_node}
    )


def arranged(structure: Structure, solution: Solution, task: Prepared) -> Solution:
    """The solution for the user: results in the shape of `elements`, topology put back.

    Args:
        structure: `Structure`.
        solution: `Solution` of the compiled core, with lists that have an item per group.
        task: `preparation.Prepared`.
    """

    def arrange(part: Part, **changes) -> Part:
        return per_element(with_peaks(part), structure.arrange, **changes)

    ends, paths = arrange(solution.phases.ends), arrange(solution.phases.paths)
    carry = solution.last.carry
    stacks: Any = carry.loads  # of leaves each
    loads = [
        copy_with(
            stack, load=jax.tree.unflatten(jax.tree.structure(stack.load), leaves), amplitude=None
        )
        for stack, leaves in zip(task.loads, stacks, strict=True)
    ]
    return arrange(
        solution,
        phases=copy_with(solution.phases, ends=ends, paths=paths),
        last=arrange(
            solution.last,
            carry=copy_with(carry, loads=loads),
            fixed=task.fixed,
            topology=topology_of(structure),
        ),
        links=tuple(group.links for group in structure.groups),
    )
