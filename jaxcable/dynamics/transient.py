"""`transient`: the motion of a structure in time."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Any, Literal

import jax.numpy as jnp

from ..analysis.phases import Phase, keys_as_whole_groups
from ..analysis.preparation import prepare
from ..analysis.solution import Solution, State
from ..common import checks
from ..common.rules import Rule, nan_if_broken, not_negative, positive
from ..common.selection import Selection
from ..common.tree import pytree, set_fields
from ..common.types import Array, ArrayLike, Bool, Float, Int, PyTree
from ..equilibrium.newton import Newton
from ..loads.masses import STANDARD_GRAVITY, PointMasses
from ..model.structure import Structure
from .conserving_system import require_energy_momentum_input
from .damping import Dashpots, ModalDamping, Rayleigh, as_dampings, rows_coupled_by_damping
from .inertia import nodal_masses
from .masses import DISTRIBUTIONS
from .motion_checks import (
    checked_history_names,
    checked_node_indices,
    initial_velocity,
    newton_or_default,
    removal_masks,
    require_finite,
    require_mass,
    step_of_removal,
    warn_of_energy_error,
    warn_of_nodes_without_elements,
)
from .motion_plan import NODAL_HISTORIES, LoadsInTime, MotionData, MotionPlan
from .motion_program import compute_motion
from .response import Transient
from .time_loads import moving_load_values, sample_in_time, sort_time_loads, times_of_steps

SCHEMES = "generalized-alpha", "energy-momentum"


@pytree
class Removal:
    """Removal of elements at a time within a motion, such as a cable that breaks.

    The forces that they exert at this moment, and the loads on them, are ramped to zero over the
    duration. Their masses go at once; nodes keep their velocity. An `InputWarning` names nodes with
    masses of their own at which no element is left: they fall freely, and their energy counts.

    Args:
        elements: as `Phase.removes`: keys of groups, or a `Selection` or booleans [n_elem] by
            group.
        time: when they are removed, s, a whole number of steps; default 0.
        duration: over which their forces end, s; default 0, at once.

    Raises:
        ValueError: no scalars, or negative ones.

    Example:
        >>> jc.dynamics.Removal({"stays": jc.only([3])}, time=0.5).time
        array(0.5)
    """

    elements: str | Sequence[str] | PyTree[Bool[ArrayLike, " n_elem"] | Selection]
    time: Float[ArrayLike, ""] = 0.0
    duration: Float[ArrayLike, ""] = 0.0

    def __post_init__(self):
        set_fields(self, elements=keys_as_whole_groups(self.elements))
        duration = not_negative("duration", checks.as_scalar(self.duration, "duration"))
        set_fields(self, time=checks.as_scalar(self.time, "time"), duration=nan_if_broken(duration))
        time = checks.array_if_known(self.time)
        if time is not None and not time >= 0:
            raise ValueError(f"time = {time}: must not be negative")


def transient(
    structure: Structure,
    loads: Any = None,
    *,
    start: Solution | State | None = None,
    dt: Float[ArrayLike, ""],
    steps: int,
    damping: Rayleigh | ModalDamping | Dashpots | Sequence[Any] | None = None,
    spectral_radius: Float[ArrayLike, ""] = 1.0,
    scheme: Literal["generalized-alpha", "energy-momentum"] = "generalized-alpha",
    masses: Float[ArrayLike, " n_node"] | PointMasses | Sequence[PointMasses] | None = None,
    velocity: Float[ArrayLike, "n_node 3"] | None = None,
    base_acceleration: Float[ArrayLike, "m 3"] | Callable[[Array], Array] | None = None,
    removes: Removal | None = None,
    histories: Sequence[str] = ("displacement", "tension"),
    nodes: Int[ArrayLike, " n"] | None = None,
    halvings: int = 0,
    gravity: Float[ArrayLike, ""] = STANDARD_GRAVITY,
    distribution: Literal["lumped", "consistent", "mean"] | None = None,
    method: Newton | None = None,
) -> Transient:
    """Compute the motion of a structure in time, step by step.

    Every step is iterated to balance of forces, inertia and damping by the solvers of equilibrium:
    cables go slack and taut, beams rotate as far as they do. A pure function: jit, vmap, grad and
    jvp work on it. A gradient keeps the state of every 32nd step, within `jax.jit` of about
    ``sqrt(steps)`` steps, and computes each step once more.

    An `InputWarning` is issued (outside of transformations) where the steps gain or lose more than
    5 % of the largest energy (`EnergyBalance.error`, `largest`). Such steps are too long, often for
    the axial vibrations of cables that go taut, of period ``2 pi sqrt(m l / EA)`` with a mass m at
    the end.

    Loads of `start` go on acting; `loads` are added to them from t = 0 on. Masses are those of the
    weights of elements, and `masses`. Beams also have the rotary inertia of their sections.

    Args:
        structure: `Structure`.
        loads: one or several in a list of: forces in time, [steps + 1, n_node, 3] (with rotations
            also 6), N and N m, at the times k dt; loads of the package, which act at once and stay,
            or which vary (`Varying`, whose parameter is time over ``steps dt``), movements of
            supports included; functions of time, s, that return forces [n_node, 3], or a load such
            as a `Train` that moves.

    Options:
        start: `Solution` or `State` from which the motion begins; default: the initial geometry.
        dt: duration of a step, s.
        steps: number of steps.
        damping: `Rayleigh`, `ModalDamping` or `Dashpots`, or several in a list.
        spectral_radius: what the scheme leaves of very fast oscillations in a step, from 0 to 1;
            default 1: it dissipates nothing. Below 1 the noise of cables that go taut dies out.
        scheme: "generalized-alpha", or "energy-momentum", which conserves energy, momentum and
            angular momentum of straight cables and bars for any duration of a step.
        masses: masses added to nodes, [n_node] or scalar, kg; or `PointMasses`.
        velocity: velocities of the nodes at the start, [n_node, 3], with rotations also 6 (angular
            velocities along x, y, z), m/s and rad/s; none of what is held.
        base_acceleration: acceleration of the ground, [steps + 1, 3] or a function of time, m/s2;
            displacements, velocities and accelerations are then those against the ground.
        removes: `Removal`, elements that are removed at a time, such as a cable that breaks.
        histories: names of what is kept: "displacement", "velocity", "acceleration", "rotation"
            (unit quaternions), "reactions", and results of elements, such as "tension".
        nodes: nodes whose histories are kept; default: all.
        halvings: how often a step that fails may be divided in two; the result says in how many
            parts each step was divided (`Transient.parts`). Default 0: it fails.
        gravity: acceleration that weights are divided by, m/s2; default 9.80665.
        distribution: of the mass of an element: "lumped", "consistent" (linear between the ends),
            or "mean" of both. None: the mean for cables and bars, of order 4 in their length, and
            lumped for beams, which is of order 4 where their ends are held. At a free end it is of
            order 2: the first frequency of a cantilever is 10.2, 2.8, 0.7, 0.18 % too low with 2,
            4, 8, 16 elements, and 2.5, 0.49, 0.12, 0.03 % with "consistent". Take 8 or more
            elements there, or "consistent". (`modes` has cubic masses across beams, and therefore
            other frequencies.)
        method: `Newton`, whose tolerance is that of every step.

    Returns:
        `Transient`.

    Raises:
        ValueError: wrong arguments; no mass; elements or loads that a scheme does not know; a
            velocity of what is held (NaN if traced); a removal at no whole number of steps, whose
            forces end after the motion, or of elements that are not there.

    Source: Chung, Hulbert, J. Appl. Mech. 60 (1993) 371; Bruels, Cardona, J. Comput. Nonlinear Dyn.
    5 (2010) 031002.

    Example:
        A pendulum of 1 m falls from the horizontal: at the bottom its speed is ``sqrt(2 g l)``.

        >>> rope = jc.Cables([[0, 1]], axial_stiffness=1e6)
        >>> structure = jc.Structure([[0.0, 0, 0], [1.0, 0, 0]], rope, supports=jc.pinned([0]))
        >>> bob = jc.PointMasses([1], 2.0)
        >>> times = {"dt": 0.005, "steps": 150, "spectral_radius": 0.8}
        >>> wanted = ["displacement", "velocity"]
        >>> moved = jc.dynamics.transient(structure, bob, **times, masses=bob, histories=wanted)
        >>> speed = jnp.linalg.norm(moved.velocity[:, 1], axis=1).max()
        >>> print(moved.status, f"{speed:.2f} m/s, {np.sqrt(2 * 9.80665):.2f}")
        0 4.43 m/s, 4.43
    """
    checks.require_whole_number(steps, "steps")
    checks.require_whole_number(halvings, "halvings", 0)
    checks.require_one_of(scheme, "scheme", SCHEMES)
    if distribution is not None:
        checks.require_one_of(distribution, "distribution", DISTRIBUTIONS)
    if removes is not None and not isinstance(removes, Removal):
        kind = checks.describe_type(removes, "Removal(jc.only([3]))")
        raise ValueError(f"removes: expected a dynamics.Removal, got {kind}")
    require_finite(dt, "dt")
    duration = nan_if_broken(positive("dt", checks.as_scalar(dt, "dt")))
    radius = checks.as_scalar(spectral_radius, "spectral_radius")
    text = "must be from 0 to 1"
    radius = nan_if_broken(Rule("spectral_radius", radius, lambda v: (v < 0) | (v > 1), text))
    gravity = nan_if_broken(positive("gravity", gravity))
    method = newton_or_default(method)
    added = None if masses is None else nodal_masses(structure, masses)
    require_mass(structure, added)
    dampings = as_dampings(damping, structure)
    count = structure.n_node
    times = times_of_steps(duration, steps)
    time_loads = sort_time_loads(loads, structure, times)
    phase = Phase(loads=time_loads.phase_loads or None)
    coupled = rows_coupled_by_damping(structure, dampings)
    conserves = scheme == "energy-momentum"
    if conserves:
        require_energy_momentum_input(structure, time_loads.phase_loads, start)
    coupling: Any = {"coupled": coupled, "symmetric": not conserves, "in_motion": True}
    task = prepare(structure, phase, method, start, to_end=True, **coupling)
    if velocity is not None:
        velocity = initial_velocity(velocity, structure, task.fixed[-1], time_loads.phase_loads)
    base = None
    if base_acceleration is not None:
        base = sample_in_time(base_acceleration, "base_acceleration", times, (3,))
    remaining, first = None, steps
    release: ArrayLike = 0.0
    if removes is not None:
        gone = removal_masks(removes, structure, start)
        remaining = task.bundles.join([~one for one in gone])
        first, release = step_of_removal(removes, duration, steps), removes.duration
        warn_of_nodes_without_elements(gone, structure, start, task.fixed[-1], added)
    moving, places = moving_load_values(time_loads, task, structure, times)
    data = MotionData(
        duration=duration,
        spectral_radius=radius,
        gravity=gravity,
        masses=added,
        velocity=velocity,
        dampings=dampings,
        remaining=remaining,
        release_duration=release,
    )
    acting = LoadsInTime(time_loads.forces, base, moving)
    kept_nodes = checked_node_indices(nodes, count)
    plan = MotionPlan(
        bundles=task.bundles,
        histories=checked_history_names(histories, structure),
        nodes=kept_nodes,
        n_node=count,
        distribution=distribution,
        halvings=halvings,
        conserves=conserves,
        moving_loads=places,
    )
    prepared = task.without_indices, task.arrays, task.method, task.code
    found = compute_motion(*prepared, data, acting, plan, steps, first)
    arranged = {
        name: values if name in NODAL_HISTORIES else structure.arrange(values)
        for name, values in found.histories.items()
    }
    warn_of_energy_error(found.energy, times, structure)
    codes = found.codes
    code = jnp.asarray(checks.as_numpy_if_known(codes)[-1])
    return Transient(code, codes, found.parts, times, found.energy, arranged, kept_nodes)
