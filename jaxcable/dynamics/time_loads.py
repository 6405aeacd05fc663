"""Loads in time: forces as arrays, functions of time, and loads of the package that move."""

from __future__ import annotations

import functools
import operator
from collections.abc import Callable, Sequence
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np

from ..analysis.preparation import PreparedAnalysis
from ..common import checks
from ..common.tree import copy_with
from ..common.types import Array, ArrayLike, Float
from ..loads.load import Load, OnNodes, PersistentLoad
from ..loads.varying import Varying
from ..mechanics.load_stacks import LoadStack
from ..model.structure import Structure
from .motion_checks import require_finite


class TimeLoads(NamedTuple):
    """The argument `loads` of `transient`, sorted into loads of a phase, forces and functions.

    Attributes:
        phase_loads: loads of the package for a phase whose load factor is time over its duration.
        forces: sum of the forces on nodes in time, [steps + 1, n_node, 3 or 6], N and N m, or None.
        moving_by_index: functions of time that return loads, by their index in `phase_loads`.
    """

    phase_loads: list[Varying]
    forces: Float[ArrayLike, "m n_node n"] | None
    moving_by_index: dict[int, Callable[[Array], Any]]


def times_of_steps(duration: Float[ArrayLike, ""], steps: int) -> Float[Array, " m"]:
    """Return the times of all steps of a `duration`, s, and of the start: [steps + 1], s."""
    known = checks.array_if_known(duration)
    if known is None:
        return jnp.arange(steps + 1) * duration
    # jax would compile the product for every number of steps
    return jnp.asarray(np.arange(steps + 1) * known, jnp.asarray(duration).dtype)


def sort_time_loads(loads: Any, structure: Structure, times: Float[Array, " m"]) -> TimeLoads:
    """Sort the argument `loads` of `transient` by kind; ValueError for wrong ones.

    `times` are those of the steps, [steps + 1], s, at which functions of time are evaluated.
    """
    given = [] if loads is None else loads
    given = list(given) if isinstance(given, list | tuple) else [given]
    kept, forces, moving = [], [], {}
    shapes = [(structure.n_node, 3)] + [(structure.n_node, 6)] * structure.space.rotates
    begin = jnp.asarray(checks.as_numpy_if_known(times)[0])
    for k, one in enumerate(given):
        first = one(begin) if callable(one) else one
        if isinstance(first, OnNodes) and callable(one):
            first.check(structure)
            shape = shapes[-1], structure.nodes.dtype
            forces.append(
                _evaluate_at_times(
                    lambda t, one=one, shape=shape: one(t).nodal_forces(*shape),
                    f"loads[{k}]",
                    times,
                )
            )
        elif isinstance(first, Load):
            if callable(one):
                if not isinstance(first, PersistentLoad):
                    raise ValueError(f"loads[{k}]: a function cannot return a {type(first)}")
                moving[len(kept)] = one
            acts: Any = first.load if isinstance(first, Varying) else first
            for name in acts.scales:
                value = getattr(acts, name)
                if value is not None:
                    require_finite(value, f"loads[{k}].{name}")
            # all of it acts from the start on
            kept.append(first if isinstance(first, Varying) else Varying(first, (0, 1), (1, 1)))
        else:
            values = sample_in_time(one, f"loads[{k}]", times, *shapes)
            require_finite(values, f"loads[{k}]")
            xp, more = checks.numpy_or_jax(values), shapes[-1][-1] - values.shape[-1]
            values = xp.asarray(values, jnp.result_type(values))  # in float32 NumPy has more digits
            forces.append(xp.pad(values, [(0, 0), (0, 0), (0, more)]))
    return TimeLoads(kept, functools.reduce(operator.add, forces) if forces else None, moving)


def sample_in_time(
    given: Any, name: str, times: Float[Array, " m"], *shapes: tuple[int, ...]
) -> Float[ArrayLike, "m ..."]:
    """Return values at all times, [steps + 1, ...], of an array or of a function of time, s.

    They have one of the `shapes` at each time; ValueError, which names the argument, otherwise.
    """
    if callable(given):
        values = _evaluate_at_times(given, name, times)
        found = getattr(values, "shape", None)
        if found is None or found[1:] not in shapes:
            right = " or ".join(map(str, shapes))
            got = type(given(times[0])).__name__ if found is None else found[1:]
            raise ValueError(f"{name}(time): expected an array of shape {right}, got {got}")
        return values
    hint = f"; {len(times)} = steps + 1"
    whole = [(len(times), *shape) for shape in shapes]
    values = checks.floats_of_shape(given, name, *whole, hint=hint)
    require_finite(values, name)
    return values


def _evaluate_at_times(function, name, times):
    """Return the values of a function at all times; ValueError if it cannot be traced by jax."""
    try:
        return jax.vmap(function)(times)
    except (jax.errors.ConcretizationTypeError, jax.errors.TracerArrayConversionError) as error:
        raise ValueError(
            f"{name}: functions of time are traced, so that `if` and NumPy do not know the time; "
            "use jax.numpy, and jnp.where(time < ..., ..., ...) in place of `if`"
        ) from error


def moving_load_values(
    loads: TimeLoads, task: PreparedAnalysis, structure: Structure, times: Float[Array, " m"]
) -> tuple[list[list[Float[Array, "m ..."]]], tuple[tuple[int, int], ...]]:
    """Return the values of moving loads in time, and where the analysis stores these loads.

    Returns:
        For every moving load its leaves, [steps + 1, ...]; index of its `LoadStack` among the loads
        of the `RestartState`, and its index in the stack.
    """

    def prepared(load):
        found = load.with_group_indices(structure)
        return found if task.bundles.are_groups else found.on_bundles(task.bundles)

    kinds: list[Any] = []
    for load in (own.load for own in loads.phase_loads):
        if isinstance(load, PersistentLoad):
            found = load.with_group_indices(structure)
            kinds.append((jax.tree.structure(found), tuple(map(np.shape, jax.tree.leaves(found)))))
        else:
            kinds.append(None)
    order = list(dict.fromkeys(kind for kind in kinds if kind is not None))
    earlier = len(task.loads) - len(order)
    numbers, places = [], []
    for k, function in loads.moving_by_index.items():
        places.append((earlier + order.index(kinds[k]), kinds[:k].count(kinds[k])))
        numbers.append(
            _evaluate_at_times(
                lambda t, function=function: jax.tree.leaves(prepared(function(t))), "loads", times
            )
        )
    return numbers, tuple(places)


def set_moving_loads(
    stacks: Sequence[LoadStack],
    places: Sequence[tuple[int, int]],
    numbers: Sequence[Sequence[Array]],
) -> list[LoadStack]:
    """Return load stacks in which moving loads have their values of one time.

    `places` are those of `moving_load_values`, `numbers` the leaves of each load at this time.
    """
    found = list(stacks)
    for (k, i), leaves in zip(places, numbers, strict=True):
        before, tree = jax.tree.flatten(found[k].load)
        changed = [x.at[i].set(new.astype(x.dtype)) for x, new in zip(before, leaves, strict=True)]
        found[k] = copy_with(found[k], load=jax.tree.unflatten(tree, changed))
    return found
