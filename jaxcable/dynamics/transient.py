"""`transient`: the motion of a structure in time."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Any, ClassVar, Literal

import jax
import jax.numpy as jnp
import numpy as np

from ..analysis.activation import element_masks
from ..analysis.phases import Phase, keys_as_whole_groups
from ..analysis.preparation import prepare
from ..analysis.solution import Solution, State
from ..common import checks
from ..common.rules import Rule, nan_if_broken, not_negative, positive
from ..common.tree import Indices, pytree, set_fields
from ..common.types import Array, ArrayLike, Bool, Float, Int, PyTree
from ..equilibrium.newton import Newton
from ..loads.load import Load
from ..loads.masses import STANDARD_GRAVITY, PointMasses
from ..loads.varying import Varying
from ..model.structure import Structure
from ..stiffness.vibration import nodal_masses
from .conserving_system import require_conserving
from .damping import Dashpots, ModalDamping, Rayleigh, as_dampings, coupled_rows
from .energy_balance import EnergyBalance
from .motion_program import NODAL_HISTORIES, MotionData, MotionPlan, compute_motion

SCHEMES = "generalized-alpha", "energy-momentum"


@pytree
class Removal:
    """Elements that are removed within a motion, such as a cable that breaks.

    The forces that they exert at this moment, and the loads on them, are ramped to zero over the
    duration. Their masses go at once; nodes keep their velocity.

    Args:
        elements: as `Phase.removes`: keys of groups, or a `Selection` or booleans [n_elem] by group.
        time: when they are removed, s, a whole number of steps; default 0.
        duration: over which their forces end, s; default 0, at once.

    Raises:
        ValueError: no scalars, or negative ones.

    Example:
        >>> jc.dynamics.Removal({"stays": jc.only([3])}, time=0.5).time
        array(0.5)
    """

    elements: Any
    time: Float[ArrayLike, ""] = 0.0
    duration: Float[ArrayLike, ""] = 0.0

    def __post_init__(self):
        set_fields(self, elements=keys_as_whole_groups(self.elements))
        for name in ("time", "duration"):
            set_fields(self, **{name: checks.as_scalar(getattr(self, name), name)})
            nan_if_broken(not_negative(name, getattr(self, name)))


@pytree
class Transient:
    """A motion in time: the result of `transient`. Histories have a leading axis [steps + 1].

    Everything but the status is NaN, with NaN derivatives, from the first step that fails.

    Attributes:
        status: code of the first failure, or 0; `describe` has the texts.
        step_status: status after every step, [steps + 1].
        parts: number of parts into which each step was divided (`halvings`), [steps + 1].
        time: times, [steps + 1], s.
        energy: `EnergyBalance` with arrays [steps + 1], J.
        histories: histories by name: of nodes, "displacement" (from the initial nodes), "velocity",
            "acceleration", "reactions" [steps + 1, n, 3 or 6] and "rotation" (unit quaternions), and
            of elements in the shape of `elements`, each [steps + 1, n_elem, ...].
    """

    _shown: ClassVar[str] = "status, time s, histories"

    status: Int[Array, ""]
    step_status: Int[Array, " m"]
    parts: Int[Array, " m"]
    time: Float[Array, " m"]
    energy: EnergyBalance
    histories: dict[str, PyTree[Float[Array, "m ..."]]]

    @property
    def displacement(self) -> Float[Array, "m n 3"]:
        """Displacements of the nodes from the initial ones, [steps + 1, n, 3], m."""
        return self._history("displacement")

    @property
    def velocity(self) -> Float[Array, "m n n_freedom"]:
        """Velocities of the nodes, [steps + 1, n, 3 or 6], m/s and rad/s."""
        return self._history("velocity")

    @property
    def acceleration(self) -> Float[Array, "m n n_freedom"]:
        """Accelerations of the nodes, [steps + 1, n, 3 or 6], m/s2 and rad/s2; without mass no
        meaning."""
        return self._history("acceleration")

    @property
    def tension(self) -> PyTree[Float[Array, "m n_elem"]]:
        """Axial forces in the shape of `elements`, each [steps + 1, n_elem], N."""
        return self._history("tension")

    def _history(self, name):
        """Return a history; ValueError if it was not asked for."""
        if name not in self.histories:
            raise ValueError(f"histories: has no {name!r}; ask for it by histories=[...]")
        return self.histories[name]


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
    """Compute the motion of a structure in time, step by step."""
    checks.require_whole_number(steps, "steps")
    checks.require_whole_number(halvings, "halvings", 0)
    checks.require_one_of(scheme, "scheme", SCHEMES)
    duration = nan_if_broken(positive("dt", checks.as_scalar(dt, "dt")))
    radius = checks.as_scalar(spectral_radius, "spectral_radius")
    text = "must be from 0 to 1"
    radius = nan_if_broken(Rule("spectral_radius", radius, lambda v: (v < 0) | (v > 1), text))
    gravity = nan_if_broken(positive("gravity", gravity))
    method = Newton() if method is None else method
    dampings = as_dampings(damping, structure)
    count = structure.n_node
    times = jnp.arange(steps + 1) * jnp.asarray(duration)
    kept, forces = _split_loads(loads, structure, times)
    phase = Phase(loads=kept or None, increments=steps)
    coupled = coupled_rows(structure, dampings)
    conserves = scheme == "energy-momentum"
    if conserves:
        require_conserving(structure, kept, start)
    options = {"to_end": True, "coupled": coupled, "symmetric": not conserves}
    task = prepare(structure, phase, method, start, **options)
    wide = (count, 6) if structure.space.rotates else (count, 3)
    if velocity is not None:
        velocity = checks.floats_of_shape(velocity, "velocity", (count, 3), wide)
    base = None
    if base_acceleration is not None:
        base = _in_time(base_acceleration, "base_acceleration", times, (3,))
    stays, first, release = None, steps, 0.0
    if removes is not None:
        gone = element_masks(removes.elements, structure, "removes.elements")
        stays = task.bundles.join([~one for one in gone])
        first, release = _step_of_removal(removes, duration, steps), removes.duration
    data = MotionData(
        duration=duration,
        radius=radius,
        gravity=gravity,
        masses=None if masses is None else nodal_masses(structure, masses),
        velocity=velocity,
        forces=forces,
        base=base,
        dampings=dampings,
        stays=stays,
        release=release,
    )
    plan = MotionPlan(
        bundles=task.bundles,
        steps=steps,
        first=first,
        histories=_checked_histories(histories, structure),
        nodes=None if nodes is None else _chosen_nodes(nodes, count),
        n_node=count,
        distribution=distribution,
        halvings=halvings,
        conserves=conserves,
    )
    found = compute_motion(
        task.without_indices, task.arrays, task.method, task.code, data, plan=plan
    )
    arranged = {
        name: values if name in NODAL_HISTORIES else structure.arrange(values)
        for name, values in found.histories.items()
    }
    return Transient(
        found.codes[-1], found.codes, found.parts, times, found.energy, arranged
    )


def _split_loads(loads, structure, times):
    """Split the argument `loads` into loads of the package and the sum of forces in time."""
    given = [] if loads is None else loads
    given = list(given) if isinstance(given, list | tuple) else [given]
    kept, forces = [], None
    shapes = [(structure.n_node, 3)] + [(structure.n_node, 6)] * structure.space.rotates
    for k, one in enumerate(given):
        if isinstance(one, Varying):
            kept.append(one)
        elif isinstance(one, Load):
            kept.append(Varying(one, (0.0, 1.0), (1.0, 1.0)))
        else:
            values = jnp.asarray(_in_time(one, f"loads[{k}]", times, *shapes))
            if values.shape[-1] < shapes[-1][-1]:
                values = jnp.pad(values, [(0, 0), (0, 0), (0, 3)])
            forces = values if forces is None else forces + values
    return kept, forces


def _in_time(given, name, times, *shapes):
    """Return values in time, [steps + 1, ...], of an array or of a function of time, s."""
    if callable(given):
        return _in_time(jax.vmap(given)(times), f"{name}(time)", times, *shapes)
    return checks.floats_of_shape(given, name, *((len(times), *shape) for shape in shapes))


def _step_of_removal(removes, duration, steps):
    """Return after how many steps elements are removed; ValueError if that is no whole number."""
    time, step = (checks.array_if_known(v) for v in (removes.time, duration))
    if time is not None and time == 0:
        return 0
    if time is None or step is None:
        raise ValueError("removes.time, dt: are traced; the step of a removal is topology")
    number = float(time) / float(step)
    if abs(number - round(number)) > 1e-6 or round(number) > steps:
        raise ValueError(
            f"removes.time = {time}: expected a whole number of steps of {step} s, up to {steps}"
        )
    return round(number)


def _checked_histories(names, structure):
    """Return the names of histories as a tuple; ValueError for one that nothing has."""
    names = (names,) if isinstance(names, str) else tuple(names)
    known = [*NODAL_HISTORIES, "tension", "peak_tension"]
    known += [result.name for group in structure.groups for result in group.results]
    for name in names:
        if name not in known:
            raise ValueError(
                f"histories: {name!r} is unknown{checks.suggest_names(name, known)}"
            )
    return names


def _chosen_nodes(nodes, count):
    """Return node numbers as `Indices`."""
    array = np.atleast_1d(np.asarray(nodes))
    checks.require_known_nodes(array, count, "nodes")
    return Indices(array.astype(np.int32))
