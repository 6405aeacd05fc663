"""Checks of the arguments of `transient`, and the warning of energy gained or lost."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np

from ..analysis.activation import Activation, element_masks
from ..analysis.solution import Solution, State
from ..common import checks
from ..common.tree import Indices
from ..common.types import Array, ArrayLike, Bool, Float
from ..equilibrium.newton import Newton
from ..loads.load import PrescribedMovement
from ..loads.varying import Varying
from ..model.structure import Structure
from ..model.supports import FixedDofs
from .energy_balance import EnergyBalance
from .motion_plan import NODAL_HISTORIES

_ENERGY_ERROR = 0.05  # of the largest energy, from which on a motion gets a warning
# Of the stored energy: what the tolerance of steps leaves of it is no error of a motion. Of the
# largest energy: smaller ones, of a motion that has not begun, have no error.
_UNSEEN_OF_STORED, _UNSEEN_OF_LARGEST = 1e-10, 1e-6


def newton_or_default(method: Any) -> Newton:
    """Return `method`, or `Newton()` for None; ValueError for any other method than `Newton`."""
    method = Newton() if method is None else method
    if not isinstance(method, Newton):
        raise ValueError(
            f"method: expected Newton, got {checks.describe_type(method, 'Newton()')}; a step in "
            "time has no increments"
        )
    return method


def require_finite(value: Any, name: str) -> None:
    """Raise ValueError, which names the argument and the index, for a known NaN or infinity."""
    known = checks.array_if_known(value)
    if known is None or np.isfinite(known).all():
        return
    index = tuple(int(i) for i in np.argwhere(~np.isfinite(known))[0])
    where = f"[{', '.join(map(str, index))}]" if index else ""
    raise ValueError(f"{name}{where} = {known[index]}: must be finite")


def require_mass(structure: Structure, masses: Float[ArrayLike, " n_node"] | None) -> None:
    """Raise ValueError if elements have no weight and nodes no added `masses`, [n_node], kg."""
    amounts = [group.weight for group in structure.groups if group.weight is not None]
    known = [checks.array_if_known(amount) for amount in amounts]
    if masses is not None:
        known.append(checks.array_if_known(masses))
    if not any(amount is None or (amount > 0).any() for amount in known):
        raise ValueError(
            "masses: no element group has a weight; give weight=... in N/m, or masses=... in kg"
        )


def initial_velocity(
    velocity: Float[ArrayLike, "n_node n"],
    structure: Structure,
    fixed: FixedDofs,
    loads: Sequence[Varying],
) -> Float[ArrayLike, "n_node n"]:
    """Return the checked argument `velocity` of `transient`, [n_node, 3 or 6], m/s and rad/s.

    Traced velocities of held degrees of freedom make all of it NaN.

    Supports that a load moves may have a velocity.

    Args:
        velocity: argument of `transient`.
        structure: `Structure`.
        fixed: degrees of freedom that are held.
        loads: loads of the package.

    Raises:
        ValueError: wrong shape; no finite number; velocity of a degree of freedom that is held.
    """
    count, width = structure.n_node, structure.space.n_freedom
    shapes = [(count, 3)] + [(count, 6)] * (width == 6)
    velocity = checks.floats_of_shape(velocity, "velocity", *shapes)
    require_finite(velocity, "velocity")
    if any(isinstance(one.load, PrescribedMovement) for one in loads):
        return velocity
    xp, held = checks.numpy_or_jax(velocity), fixed.array[:count, : velocity.shape[1]]
    along, least = velocity, 0.0
    if fixed.axes is not None:
        by_part = velocity.reshape(count, -1, 3)
        along = xp.einsum("nij,npj->npi", fixed.axes.array[:count], by_part)
        along = along.reshape(velocity.shape)
        least = 1e-9 * xp.abs(velocity).max(axis=1, keepdims=True)
    moves = held & (xp.abs(along) > least)
    known = checks.array_if_known(moves)
    if known is None:
        return jnp.where(jnp.any(moves), jnp.nan, velocity)
    if known.any():
        node, k = (int(i) for i in np.argwhere(known)[0])
        word = "" if k < 3 else "rotation "
        raise ValueError(
            f"velocity[{node}]: node {node} is held along {word}{'xyz'[k % 3]}, and cannot have a "
            "velocity there; move a support by a movement that is a load"
        )
    return velocity


def removal_masks(
    removes: Any, structure: Structure, start: Solution | State | None
) -> list[Bool[ArrayLike, " n_elem"]]:
    """Return which elements a `Removal` removes, per group [n_elem] bool.

    ValueError if one is absent from `start` already.
    """
    gone = element_masks(removes.elements, structure, "removes.elements")
    last = start.last if isinstance(start, Solution) else start
    if last is None:
        return gone
    named = structure.named_groups()
    for (where, _), mask, state in zip(named, gone, last.restart.states, strict=True):
        pair: list[Any] = [checks.array_if_known(v) for v in (mask, state.present)]
        if any(known is None for known in pair) or not (pair[0] & ~pair[1]).any():
            continue
        k = int((pair[0] & ~pair[1]).argmax())
        raise ValueError(f"removes.elements: element {k} of elements{where} is not there in start")
    return gone


def warn_of_nodes_without_elements(
    gone: Sequence[Bool[ArrayLike, " n_elem"]],
    structure: Structure,
    start: Solution | State | None,
    fixed: FixedDofs,
    masses: Float[ArrayLike, " n_node"] | None,
) -> None:
    """Warn of nodes with added mass that only removed elements have held; not while traced.

    Args:
        gone: which elements are removed, per group [n_elem] bool.
        structure: `Structure`.
        start: as for `transient`.
        fixed: degrees of freedom that supports hold.
        masses: masses added to nodes, [n_node], kg, or None.
    """
    last = start.last if isinstance(start, Solution) else start
    there: list[Any] = [np.ones(len(group.links), bool) for group in structure.groups]
    if last is not None:
        states = zip(there, last.restart.states, strict=True)
        there = [own if state.present is None else state.present for own, state in states]
    known: list[Any] = [checks.array_if_known(value) for value in (masses, *gone, *there)]
    if any(value is None for value in known):
        return
    n_group, mass = len(gone), known[0]
    before = known[1 + n_group :]
    left = [(own & ~out)[None] for own, out in zip(before, known[1 : 1 + n_group], strict=True)]
    idle = Activation(before, left).inactive_dofs(structure, structure.motion_rows()[1])
    freed = np.asarray(idle[1] & ~idle[0])[: structure.n_node, :3]
    freed = (freed & ~fixed.array[: structure.n_node, :3]).any(axis=1) & (mass > 0)
    if freed.any():
        number = int(freed.sum())
        nodes = "node with a mass" if number == 1 else "nodes with masses"
        checks.warn_user(
            f"removes.elements: no element is left at {number} {nodes}, such as node "
            f"{int(freed.argmax())}: what no element holds falls freely, and its energy counts"
        )


def step_of_removal(removes: Any, duration: Float[ArrayLike, ""], steps: int) -> int:
    """Return the number of steps before a `Removal`: its time over the duration of a step.

    Raises:
        ValueError: its time is no whole number of steps, the end of the motion, or traced; its
            forces end after the motion.
    """
    given = removes.time, duration, removes.duration
    known: list[Any] = [checks.array_if_known(v) for v in given]
    time, step, release = known
    if not (time is not None and time == 0) and (time is None or step is None):
        raise ValueError("removes.time, dt: are traced; the step of a removal is topology")
    number = 0.0 if time == 0 else float(time) / float(step)
    # times of steps, and durations up to the last one, are rounded
    eps = max(np.finfo(v.dtype).eps for v in known if v is not None and v.dtype.kind == "f")
    if abs(number - round(number)) > 1e-6 + 4 * eps * number or round(number) >= steps:
        raise ValueError(
            f"removes.time = {time}: expected a whole number of steps of {step} s, fewer than "
            f"{steps}, after which the motion ends"
        )
    least = 1e-6 + 4 * eps * steps
    if step is not None and release is not None and release > (steps - number + least) * step:
        raise ValueError(
            f"removes.duration = {release}: forces of removed elements end at {time + release:g} "
            f"s, after the motion, which ends at {steps * float(step):g} s"
        )
    return round(number)


def checked_history_names(names: str | Sequence[str], structure: Structure) -> tuple[str, ...]:
    """Return the argument `histories` as a tuple of names; ValueError for unknown ones."""
    names = (names,) if isinstance(names, str) else tuple(names)
    of_groups = [result.name for group in structure.groups for result in group.results]
    known = list(dict.fromkeys([*NODAL_HISTORIES, "tension", "peak_tension", *of_groups]))
    if not structure.space.rotates:
        known.remove("rotation")
    for name in names:
        if name == "rotation" and not structure.space.rotates:
            raise ValueError('histories: has "rotation", but nodes of this structure do not rotate')
        if name not in known:
            raise ValueError(f"histories: {name!r} is unknown{checks.suggest_names(name, known)}")
    return names


def checked_node_indices(nodes: Any, count: int) -> Indices | None:
    """Return the argument `nodes` as `Indices`, or None for all; ValueError for unknown nodes."""
    if nodes is None:
        return None
    numbers = checks.as_indices(nodes, "nodes")
    checks.require_known_nodes(numbers, count, "nodes")
    return Indices(numbers)


def warn_of_energy_error(
    energy: EnergyBalance, time: Float[Array, " m"], structure: Structure
) -> None:
    """Warn if the steps gain or lose more than 5 % of `EnergyBalance.largest`; not while traced.

    What friction and plastic strains dissipate counts as lost in `EnergyBalance.error`: with
    history variables energy that is gained alone is wrong.
    """
    if any(isinstance(leaf, jax.core.Tracer) for leaf in jax.tree.leaves((energy, time))):
        return
    known: Any = jax.tree.map(np.asarray, energy)  # jax would compile sums for each length
    stored, error = known.stored, known.error
    if any(group.has_memory for group in structure.groups):
        error = np.maximum(error, 0.0)
    largest = known.largest_so_far()  # without steps that failed, which the status says
    precision = 100 * np.finfo(error.dtype).eps
    least = max(_UNSEEN_OF_STORED, precision) * np.nanmax(np.abs(stored), initial=0.0)
    size = np.nan_to_num(np.abs(error))
    if not size.max() > _ENERGY_ERROR * largest[-1] + least:
        return
    scale = np.maximum(largest, _UNSEEN_OF_LARGEST * largest[-1])
    first = int(np.argmax(size > _ENERGY_ERROR * scale + least))
    worst = error[int(np.argmax(size))]
    verb = "gain" if worst > 0 else "lose"
    advice = (
        'a smaller spectral_radius, or scheme="energy-momentum"'
        if worst > 0
        else "or a spectral_radius nearer to 1"
    )
    checks.warn_user(
        f"dt: from t = {time[first]:.4g} s on the steps {verb} more than "
        f"{100 * _ENERGY_ERROR:.0f} % of the largest energy (energy.error up to "
        f"{worst:.3g} J, energy.largest {largest[-1]:.3g} J): take a smaller dt, {advice}"
    )
