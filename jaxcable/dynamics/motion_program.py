"""The compiled core of a motion in time: from prepared arguments to histories."""

from __future__ import annotations

import functools
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp

from ..analysis.preparation import complete_input, traced_input_status
from ..common import status
from ..common.rules import are_rules_kept, collect_rules
from ..common.tree import Indices, copy_with, merge_indices, pytree
from ..common.types import Array, Bool, Float
from ..elements.beam import Beams
from ..mechanics.assembly import System
from ..mechanics.bundles import Bundles
from ..mechanics.elementwise import map_elements_at_ends
from ..mechanics.load_ramp import LoadRamp
from ..mechanics.restart_state import with_loads_until
from ..numerics import implicit
from ..programs.program_calls import as_program
from .conserving_system import ConservingSystem
from .damping import Dashpots, ModalDamping, modal_matrix, rayleigh_matrices
from .energy_balance import EnergyBalance
from .generalized_alpha import AlphaNumbers, TimeStep
from .inertial_system import Inertia, InertialSystem
from .march import (
    Running,
    StepSettings,
    advance,
    begin_motion,
    run_steps,
    velocity_in_space,
)

NODAL_HISTORIES = ("displacement", "velocity", "acceleration", "rotation", "reactions")
"""Histories of nodes by name; others are results of elements."""


class MotionPlan(NamedTuple):
    """What is static in a motion.

    Attributes:
        bundles: which groups are evaluated together.
        steps: number of steps.
        first: number of steps before elements are removed; all of them without removal.
        histories: names of the histories that are kept.
        nodes: nodes whose histories are kept, `Indices`; None: all.
        n_node: number of nodes.
        distribution: as for `transient`.
        halvings: how often a step may be halved.
        conserves: whether energy and momentum are conserved.
    """

    bundles: Bundles
    steps: int
    first: int
    histories: tuple[str, ...]
    nodes: Indices | None
    n_node: int
    distribution: str | None
    halvings: int
    conserves: bool


@pytree
class MotionData:
    """Numbers of a motion.

    Attributes:
        duration: duration of a step, s.
        radius: spectral radius at high frequencies.
        gravity: acceleration that weights are divided by, m/s2.
        masses: masses added to nodes, [n_node], kg, or None.
        velocity: velocity at the start, [n_node, 3 or 6], or None.
        forces: forces on nodes in time, [steps + 1, n_node, 3 or 6], N and N m, or None.
        base: acceleration of the base in time, [steps + 1, 3], m/s2, or None.
        dampings: list of dampings.
        stays: which elements are not removed, per bundle [n_elem] bool; None if none is.
        release: duration over which the forces of removed elements end, s.
    """

    duration: Float[Array, ""]
    radius: Float[Array, ""]
    gravity: Float[Array, ""]
    masses: Float[Array, " n_node"] | None
    velocity: Float[Array, "n_node n"] | None
    forces: Float[Array, "m n_node n"] | None
    base: Float[Array, "m 3"] | None
    dampings: list[Any]
    stays: list[Bool[Array, " n_elem"]] | None
    release: Float[Array, ""]


class MotionHistories(NamedTuple):
    """What the program of a motion returns; arrays have a leading axis [steps + 1].

    Attributes:
        codes: status after every step.
        parts: number of parts into which each step was divided.
        histories: histories by name; of elements a list with an item per group.
        energy: `EnergyBalance`.
    """

    codes: Array
    parts: Array
    histories: dict[str, Any]
    energy: EnergyBalance


@functools.partial(as_program, static=("plan",))
def compute_motion(without_indices, arrays, method, code, data, plan):
    """Compute a motion in time as one program.

    Args:
        without_indices, arrays, method, code: as in `preparation.PreparedAnalysis`.
        data: `MotionData`.
        plan: `MotionPlan`.

    Returns:
        `MotionHistories`.
    """
    parameters = merge_indices(without_indices, arrays)
    structure_ok, codes = traced_input_status(parameters, method, data.dampings)
    nodes, groups, restart, schedule = complete_input(parameters, plan.bundles)
    data = jax.tree.map(lambda x: jnp.asarray(x, nodes.dtype) if _is_float(x) else x, data)
    sound = structure_ok & are_rules_kept(collect_rules(data.dampings))
    code = status.first_failure(code, jnp.where(sound, codes[0], status.INVALID_INPUT))
    phase = schedule.phase(0)
    before = with_loads_until(restart, restart.loads, phase.number)
    ramp = LoadRamp.build(nodes, groups, before, phase)
    if data.stays is not None:
        ramp = _with_presence(ramp, [jnp.ones(len(g.links), bool) for g in groups])
    touched = implicit.gradient_probe((parameters, data))
    entries = _load_entries(ramp, data, plan)
    model = _MotionModel(ramp, data, plan, method)
    x = ramp.start.motion
    first = jax.tree.map(lambda a: a[0], entries)
    settings = model.settings(first, x)
    running = begin_motion(
        model.system_at(first, ramp.memory), _row_values(ramp, data.velocity), settings, code, x
    )
    found = [_at_start(model.record(running, first, settings, jnp.int32(1)))]
    running, part = model.run(running, entries, settings, 0, plan.first)
    found.append(part)
    if plan.first < plan.steps:
        running, part = _go_on_after_removal(model, running, entries, plan)
        found.append(part)
    whole = jax.tree.map(lambda *parts: jnp.concatenate(parts), *found)
    codes, parts, histories, energy = whole
    ok = codes == status.OK
    histories, energy = implicit.nan_unless_probed(ok, (histories, energy), touched)
    names = {k: v for k, v in histories.items() if k not in NODAL_HISTORIES}
    histories |= {k: plan.bundles.split(v, axis=1) for k, v in names.items()}
    return MotionHistories(codes, parts, histories, energy)


def _go_on_after_removal(model, running, entries, plan):
    """Return `Running` and histories of the steps after elements have been removed.

    The forces that the removed elements exert, and the loads on them, act on as loads that end over
    the duration of the removal.
    """
    data, at = model.data, jax.tree.map(lambda a: a[plan.first], entries)
    whole, x = model.system_at(at, running.memory), running.state.motion
    left = _MotionModel(_with_presence(model.ramp, data.stays), data, plan, model.method)
    settings = left.settings(at, x)
    left.released = left.system_at(at, running.memory).unbalanced(x) - whole.unbalanced(x)
    passed = jnp.arange(plan.steps + 1 - plan.first) * data.duration
    share = jnp.where(data.release > 0, 1 - passed / jnp.where(data.release > 0, data.release, 1), 0)
    share = jnp.concatenate([jnp.zeros(plan.first, share.dtype), jnp.clip(share, 0.0, 1.0)])
    entries = {**entries, "released": share}
    at = jax.tree.map(lambda a: a[plan.first], entries)
    velocity = velocity_in_space(running.state)[0]
    begun = begin_motion(
        left.system_at(at, running.memory), velocity, settings, running.code, x
    )
    energy = running.energy.go_on_from(begun.energy)
    begun = copy_with(begun, energy=energy, memory=running.memory)
    return left.run(begun, entries, settings, plan.first, plan.steps - plan.first)


class _MotionModel:
    """The structure in motion: its systems in time, and what is recorded of them.

    Args:
        ramp: `LoadRamp`, whose parameter is time over the whole duration.
        data: `MotionData`.
        plan: `MotionPlan`.
        method: `Newton`.

    Attributes:
        released: loads that removed elements leave, [n_row, n_freedom], N and N m, or None.
    """

    def __init__(self, ramp, data, plan, method):
        self.ramp, self.data, self.plan, self.method = ramp, data, plan, method
        self.released = self.masses = None

    def system_at(self, entry: dict[str, Any], memory: Any) -> System:
        """Return the system without inertia under the loads of an entry of the histories."""
        system = self.ramp.system_at(entry["parameter"], memory)
        load = system.load
        if "forces" in entry:
            load = load + _row_values(self.ramp, entry["forces"])
        if "base" in entry:
            load = load - self._base_forces(system, entry["base"])
        if "released" in entry:
            load = load + entry["released"] * self.released
        return copy_with(system, load=load)

    def _base_forces(self, system, acceleration):
        """Return masses times an acceleration of the base, [3], as forces on all rows, N."""
        masses, nodal = self.masses
        ends = []
        for group, blocks in zip(system.groups, masses, strict=True):
            n_end = blocks.shape[1] // 3
            own = (blocks @ jnp.tile(acceleration, n_end)).reshape(len(blocks), n_end, 3)
            own = jnp.pad(own, [(0, 0), (0, group.links.shape[1] - n_end), (0, 0)])
            ends.append(system.space.pad_moments(own))
        return system.sum_at_rows(ends).at[:, :3].add(nodal[:, None] * acceleration)

    def settings(self, entry: dict[str, Any], x: Any) -> StepSettings:
        """Return the settings of all steps, with the masses of the elements that are there."""
        bare = self.ramp.system_at(entry["parameter"], self.ramp.memory)
        given = x, self.data.gravity, self.plan.distribution
        masses = [_translations_only(g, m) for g, m in zip(
            bare.groups, self._mass_matrices(bare, *given), strict=True
        )]
        nodal = _row_values(self.ramp, self.data.masses, width=1)[:, 0]
        self.masses = masses, nodal
        rotary = _rotary_inertia(bare, x, self.data.gravity) if bare.space.rotates else None
        damping, nodal_damping = rayleigh_matrices(self.data.dampings, bare, masses, nodal, x)
        inertia = Inertia(masses, nodal, rotary, damping, nodal_damping, [])
        momentum = functools.partial(_momentum, bare, inertia, self.plan.n_node)

        def make_system(system, inertia, step, load_before=None):
            # a state alone, without a step to it, has no other forces
            conserves = self.plan.conserves and load_before is not None
            kind = ConservingSystem if conserves else InertialSystem
            dampers = self._dampers(system, step, momentum)
            own = copy_with(inertia, dampers=dampers)
            return kind.from_system(system, own, step, load_before)

        numbers = AlphaNumbers.from_spectral_radius(self.data.radius)
        return StepSettings(
            inertia, numbers, self.data.duration, self.method, self.plan.halvings, make_system
        )

    def _mass_matrices(self, system, x, gravity, distribution):
        """Return mass matrices of elements; beams have those of straight elements."""
        own = system.mass_matrices(x, gravity, "lumped" if system.space.rotates else distribution)
        found = []
        for group, state, blocks in zip(system.groups, system.states, own, strict=True):
            weights = group.weights(state)
            if group.n_freedom == 6 and distribution != "lumped" and weights is not None:
                same, other = (5 / 12, 1 / 12) if distribution != "consistent" else (1 / 3, 1 / 6)
                shares = jnp.asarray([[same, other], [other, same]], x.dtype)
                blocks = weights[:, None, None] / gravity * jnp.kron(shares, jnp.eye(3))
            elif group.n_freedom == 3 and system.space.rotates and weights is not None:
                kind = _MassMatrix(distribution)
                at = (system.nodes[group.links], x[group.links])
                blocks = map_elements_at_ends(kind, group, state, at, (weights / gravity,))
            found.append(blocks)
        return found

    def _dampers(self, system, step: TimeStep, momentum):
        """Return the matrices of dampers that join nodes, where the step is expected to end."""
        found, motion = [], None
        for one in self.data.dampings:
            if isinstance(one, Dashpots):
                if motion is None and not one.is_grounded:
                    motion = step.predicted_motion(system.space)
                found.append(one.matrices(system.nodes, motion))
            elif isinstance(one, ModalDamping):
                found.append(modal_matrix(one, jax.vmap(momentum)(one.shapes)))
        return found

    def run(
        self, running: Running, entries: dict[str, Array], settings: StepSettings, at: int, n: int
    ) -> tuple[Running, MotionHistories]:
        """Run `n` steps from time step `at` on: return `Running`, and their histories."""

        def one(run, entry):
            before, here = entry
            after, parts = advance(run, self.system_at, here, before, settings)
            return after, self.record(after, here, settings, parts)

        ends = [jax.tree.map(lambda a, k=k: a[at + k : at + k + n], entries) for k in (0, 1)]
        return run_steps(running, one, tuple(ends), n)

    def record(self, running: Running, entry: Any, settings: StepSettings, parts) -> Any:
        """Return what is kept of a time, `MotionHistories` without axis of time."""
        plan, state, found = self.plan, running.state, {}
        x, count = state.motion, self.plan.n_node
        velocity, acceleration = velocity_in_space(state)
        values = {"displacement": x[:, :3], "velocity": velocity, "acceleration": acceleration}
        if x.shape[1] == 7:
            values["rotation"] = x[:, 3:]
        which = slice(count) if plan.nodes is None else plan.nodes.array
        wanted = [name for name in plan.histories if name not in NODAL_HISTORIES]
        if wanted or "reactions" in plan.histories:
            system = self.system_at(entry, running.memory)
            output = system.results_by_name(x, *wanted, "end_forces")
            if "reactions" in plan.histories:
                step = TimeStep(state, settings.duration, settings.numbers)
                own = settings.make_system(system, settings.inertia, step)
                force = own.inertia_force(state) + own.damping_force(state)
                bare = system.unbalanced(x, output["end_forces"]) + force
                values["reactions"] = _sum_of_nodes(
                    system, system.space.reactions(bare, x), count
                )
            found = {name: output[name] for name in wanted}
        found |= {n: values[n][which] for n in plan.histories if n in values}
        return MotionHistories(running.code, parts, found, running.energy)


class _MassMatrix(NamedTuple):
    """The mass matrix of one element as a function: equal ones are the same function to jax."""

    distribution: str | None

    def __call__(self, one, state, ends, motion, mass):
        return one.mass_matrix(state, ends, motion, mass, self.distribution)


def _translations_only(group, blocks):
    """Return mass matrices by translations of ends alone, [n_elem, 3 n_end, 3 n_end], kg."""
    n_end = group.links.shape[1] - group.n_inner_row
    if blocks.shape[1] == 3 * n_end:
        return blocks
    width = group.n_freedom
    size = n_end * width
    own = blocks[:, :size, :size].reshape(len(blocks), n_end, width, n_end, width)
    return own[:, :, :3, :, :3].reshape(len(blocks), 3 * n_end, 3 * n_end)


def _rotary_inertia(system, x, gravity):
    """Return the rotary inertia of rows in the axes of their nodes, [n_row, 3, 3], kg m2.

    It is that of the sections of beams, half at each end: mass times the squared radii of gyration
    of the section, which are those of its stiffness.
    """
    rotary = jnp.zeros((len(system.nodes), 3, 3), x.dtype)
    for group, state in zip(system.groups, system.states, strict=True):
        weights = group.weights(state) if isinstance(group, Beams) else None
        if weights is None:
            continue
        at = system.nodes[group.links], x[group.links]
        own = map_elements_at_ends(_gyration_tensor, group, state, at)
        own = (0.5 * weights / gravity)[:, None, None] * own
        rotary = rotary.at[group.links[:, :2]].add(own[:, None])
    return rotary


def _gyration_tensor(one, state, ends, motion):
    """Return squared radii of gyration of a section of one beam as a tensor, [3, 3], m2."""
    axes, stiffness = one.axes(ends), one.section.stiffness()
    y, z = stiffness[1, 1] / stiffness[0, 0], stiffness[2, 2] / stiffness[0, 0]
    return axes.T @ (jnp.stack([y + z, y, z])[:, None] * axes)


def _momentum(system, inertia, n_node, shape):
    """Return masses times a shape [n_node, 3], kg m, as a field [n_node, 3]."""
    rows = jnp.zeros((len(system.nodes), 3), shape.dtype).at[:n_node].set(shape)
    if system.dof_map.node_of_row is not None:
        rows = rows[system.dof_map.node_of_row]
    total = inertia.nodal_mass[:, None] * rows
    for group, blocks in zip(system.groups, inertia.masses, strict=True):
        ends = group.links[:, : blocks.shape[1] // 3]
        own = jnp.einsum("eij,ej->ei", blocks, rows[ends].reshape(len(blocks), -1))
        total = total.at[ends].add(own.reshape(*ends.shape, 3))
    return _sum_of_nodes(system, total, n_node)


def _sum_of_nodes(system, values, n_node):
    """Return values of rows with those of hinged ends added to their nodes, [n_node, ...]."""
    if system.dof_map.node_of_row is None:
        return values[:n_node]
    rows = jnp.asarray(system.dof_map.node_of_row)
    return jnp.zeros_like(values).at[rows].add(values)[:n_node]


def _row_values(ramp, values, width=None):
    """Return values of nodes, [n_node, n] or [n_node], as those of rows with zeros beside them.

    `width` is the number of columns, by default that of the space; None as `values` gives zeros.
    """
    n_row, width = len(ramp.nodes), ramp.start.nodal_load.shape[1] if width is None else width
    found = jnp.zeros((n_row, width), ramp.nodes.dtype)
    if values is None:
        return found
    values = values.reshape(len(values), -1)
    return found.at[: len(values), : values.shape[1]].set(values)


def _with_presence(ramp, present):
    """Return a `LoadRamp` of which the elements `present`, per group [n_elem] bool, are there."""
    groups, start = ramp.groups, ramp.start
    there = [
        own if state.present is None else own & state.present
        for state, own in zip(start.states, present, strict=True)
    ]
    triples = zip(groups, start.states, there, strict=True)
    states = [group.with_activation(state, own) for group, state, own in triples]
    return copy_with(ramp, start=copy_with(start, states=states))


def _load_entries(ramp, data, plan):
    """Return the histories of loads, a dict of arrays [steps + 1, ...]."""
    dtype = ramp.nodes.dtype
    parameter = jnp.arange(plan.steps + 1, dtype=dtype) / max(plan.steps, 1)
    # at the start loads are those that act from then on
    entries = {"parameter": jnp.maximum(parameter, jnp.finfo(dtype).tiny)}
    entries |= {} if data.forces is None else {"forces": data.forces}
    return entries | ({} if data.base is None else {"base": data.base})


def _at_start(record):
    """Return what is kept of the start with an axis of time, [1, ...]."""
    return jax.tree.map(lambda x: jnp.asarray(x)[None], record)


def _is_float(x):
    """Return whether a leaf of numbers is a float."""
    return jnp.issubdtype(jnp.result_type(x), jnp.floating)

