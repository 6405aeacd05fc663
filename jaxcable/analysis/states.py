"""From a point of equilibrium to a `State`, and results in the shape of the user's elements."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import jax
import jax.numpy as jnp

from ..common.tree import apply_numpy_or_jax, copy_with, pytree, select_tree
from ..common.types import Array, Float, Int
from ..elements.element import Element
from ..mechanics.assembly import System
from ..mechanics.element_output import evaluate_output
from ..mechanics.elementwise import evaluate_elements
from ..mechanics.load_ramp import PhaseData
from ..mechanics.restart_state import RestartState, make_system
from ..model.structure import Structure
from ..model.topology import topology_of
from .preparation import PreparedAnalysis
from .results import Part, fields_of_element_results, fill_peak_tensions, map_element_fields
from .schedule import Schedule
from .solution import Solution, State


@pytree
class LastConvergedIncrement:
    """The last converged increment of an analysis: its phase, load factor and supports.

    Attributes:
        number: index of the phase, -1 before the first increment.
        factor: load factor of that phase.
        held: the arrays of `DofMap` that depend on the supports, as they are there, by name
            (as `Schedule.phases`); empty if the supports never change.
    """

    number: Int[Array, ""]
    factor: Float[Array, ""]
    held: dict[str, Array]

    @classmethod
    def before_first_increment(cls, schedule: Schedule, dtype: Any) -> LastConvergedIncrement:
        """Return the value before the first increment: number -1, load factor 0."""
        held: Any = schedule.phases.dof_map_before or {}
        first = {name: value[0] for name, value in held.items()}
        return cls(jnp.int32(-1), jnp.zeros((), dtype), first)

    def updated(self, data: PhaseData, factor: Float[Array, ""]) -> LastConvergedIncrement:
        """Return the last converged increment after a phase that reached the load factor `factor`.

        It is unchanged if that is 0: no increment of the phase has converged. `data` is the phase.
        """
        held = {name: getattr(data.dof_map, name) for name in self.held}
        new = LastConvergedIncrement(data.number, factor, held)
        return select_tree(factor > 0, new, self)


def system_at_last_converged(
    frame: tuple[Float[Array, "n_row 3"], list[Element]],
    restart: RestartState,
    reached: LastConvergedIncrement,
    schedule: Schedule,
) -> System:
    """Return the `System` of a `RestartState`, all degrees of freedom held.

    `frame` is (nodes, groups), `reached` the increment that it belongs to, with its supports.
    """
    dof_map = copy_with(schedule.dof_map.without_unknowns, **reached.held)
    return make_system(*frame, restart, None, dof_map)


def make_state(frame, restart, point, reached, schedule, last_output=None):
    """Compute all results of a `RestartState`; return its `State`.

    Forces at hinged ends and other rows of motion are summed at their nodes.

    Args:
        frame: (nodes, groups).
        restart: `RestartState`.
        point: (motion of `restart`, marks) as `bare` and `marks` of
            `implicit.attach_derivative_with_marks`; marks may be None.
        reached: `LastConvergedIncrement`.
        schedule: `Schedule`.
        last_output: `ElementOutput` of this motion; None: it is evaluated.
    """
    nodes, groups = frame
    system = system_at_last_converged(frame, restart, reached, schedule)
    (motion, marks), n_node, dof_map = point, schedule.n_node, system.dof_map
    space = system.space

    def summed(values):  # a hinged end passes its force to its node
        if dof_map.node_of_row is None:
            return values
        return jnp.zeros_like(values[:n_node]).at[dof_map.node_of_row].add(values)

    displacement = restart.motion[:n_node, :3]
    seen = evaluate_output(system, motion) if last_output is None else last_output
    found = {name: seen.by_name[name] for name in (*seen.of_ends, "end_forces")}
    reactions = system.reactions(motion, found.pop("end_forces"))
    load = _acting_loads(system, motion)
    if marks is not None:
        reactions = reactions + marks.of_forces
        if system.followers is not None or any(group.slides for group in groups):
            load = load + _add_marks_of_neighbors(system, marks.of_rows)[:, None]
        found = _add_derivative_marks(system, marks, found)
    reactions, load = summed(reactions), summed(load)
    return State(
        displacement=displacement,
        positions=nodes[:n_node] + displacement,
        rest_length=[state.rest_length for state in restart.states],
        reactions=reactions[:, :3],
        load=load[:, :3],
        phase=reached.number,
        load_factor=reached.factor,
        restart=None,
        fixed=None,
        rotation=space.rotations(restart.motion[:n_node]),
        reaction_moments=space.moments(reactions),
        **fields_of_element_results(found),
    )


def _marks_of_elements(system, marks):
    """Return the sums of `marks` of rows, [n_row], over the ends of elements, [n_elem] per group.

    Marks are zeros whose derivative may be NaN (`numerics.implicit.DerivativeMarks`).
    """
    return [jnp.sum(at, axis=1) for at in system.gather_at_ends(marks)]


def _add_marks_of_neighbors(system, marks):
    """Return `marks` of rows plus those of rows that an element joins to them, [n_row]."""
    pairs = zip(_marks_of_elements(system, marks), system.groups, strict=True)
    ends = [jnp.broadcast_to(mark[:, None], group.links.shape) for mark, group in pairs]
    return marks + system.sum_at_rows(ends)


def _add_derivative_marks(system, marks, found):
    """Add marks to results of elements, so that derivatives are NaN where they are not defined.

    Args:
        system: the system of the results.
        marks: `DerivativeMarks`. Results in N get `of_forces`, others the marks of all ends of the
            element.
        found: results by name, a list with [n_elem, ...] or None per group; so is what is returned.
    """
    declared, of_elements = system.results(), _marks_of_elements(system, marks.of_rows)
    marked = {}
    for name, parts in found.items():
        is_force = declared[name].unit.startswith("N")
        own = [marks.of_forces] * len(parts) if is_force else of_elements
        marked[name] = [
            None if part is None else part + mark.reshape(-1, *(1,) * (part.ndim - 1))
            for part, mark in zip(parts, own, strict=True)
        ]
    return marked


def _acting_loads(system, motion):
    """Return all loads on every row, [n_row, n_freedom], N and N m.

    Those that slide along cables over several nodes act where they are at `motion`.
    """
    load = system.external_force(motion)
    for group, state in zip(system.groups, system.states, strict=True):
        if group.slides and state.line_load is not None:
            slid = evaluate_elements("sliding_load_forces", group, state, system.nodes, motion)
            load = load.at[group.links, :3].add(slid)
    return load


def without_extra_rows(structure: Structure, part: Part, per_node: Sequence[str]) -> Part:
    """Cut rows of motion that are no nodes (hinged ends, inner unknowns) from results.

    Args:
        structure: `Structure`.
        part: result of the compiled program.
        per_node: names of the fields whose second axis is that of the rows of motion.
    """
    if structure.motion_rows()[0] is None:
        return part

    def of_nodes(values):
        return apply_numpy_or_jax(lambda _, x: x[:, : structure.n_node], values)

    return copy_with(part, **{name: of_nodes(getattr(part, name)) for name in per_node})


def as_user_solution(structure: Structure, solution: Solution, task: PreparedAnalysis) -> Solution:
    """Return the solution for the user: results in the shape of `elements`, node numbers restored.

    Peak tensions that an analysis does not compute are filled in. The restart state gets the loads
    as the user gave them, without amplitudes; `last` gets `fixed` and `topology`, by which a later
    analysis checks that it continues the same structure.

    Args:
        structure: `Structure`.
        solution: `Solution` of the compiled program, with lists that have an item per group.
        task: `preparation.PreparedAnalysis`.
    """

    def arrange(part: Part, **changes) -> Part:
        return map_element_fields(fill_peak_tensions(part), structure.arrange, **changes)

    ends, paths = arrange(solution.phases.ends), arrange(solution.phases.paths)
    restart: Any = solution.last.restart  # whose loads have lists of leaves
    loads = [
        copy_with(stack, load=jax.tree.unflatten(jax.tree.structure(stack.load), own.load))
        for stack, own in zip(task.loads, restart.loads, strict=True)
    ]
    loads = [copy_with(stack, amplitude=None) for stack in loads]
    return arrange(
        solution,
        phases=copy_with(solution.phases, ends=ends, paths=paths),
        last=arrange(
            solution.last,
            restart=restart.with_loads(loads),
            fixed=task.fixed,
            topology=topology_of(structure),
        ),
        links=tuple(group.links for group in structure.groups),
    )
