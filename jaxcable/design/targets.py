"""Targets of `tune`: values that results of phases shall have."""

from __future__ import annotations

import dataclasses
from collections.abc import Callable, Sequence
from types import EllipsisType
from typing import Any, TypeAlias

import jax
import jax.numpy as jnp
import numpy as np

from ..analysis.phase_results import PhaseResult
from ..analysis.results import RESULT_NAMES
from ..analysis.solution import Solution
from ..common import checks
from ..common.owned import owned_copy
from ..common.rules import Rule, nan_if_broken
from ..common.types import Array, ArrayLike, Bool, Float, Int

Part: TypeAlias = "int | slice | EllipsisType | Int[ArrayLike, ' n'] | Bool[ArrayLike, ' n']"
Index: TypeAlias = "Part | tuple[Part, ...]"
"""Index of an array: an integer, a slice, integers or booleans, or a tuple of these."""

_IN_PHASE = "displacement_in_phase"

WITHIN = {
    **dict.fromkeys(("positions", "displacement", _IN_PHASE, "rest_length"), 1e-3),
    **dict.fromkeys(("tension", "peak_tension", "reactions", "load"), 1.0),
    **dict.fromkeys(("section_forces", "reaction_moments"), 1.0),
    "rotation": 0.5e-3,
}
"""Default tolerances of results by name: m, N, N m; quaternions half of 1e-3 rad."""

_COMMON = "displacement", "positions", "tension", "peak_tension"
"""Results that share one compiled program of `tune`."""


@dataclasses.dataclass(frozen=True)
class Target:
    """A wanted value, with tolerance, for a result of a phase: what `tune` is to achieve.

    Args:
        of: name of a result of a phase: "positions", "displacement" (from the start),
            "displacement_in_phase", "tension", "reactions", "section_forces" and so on; or a
            function of the result of the phase, `results.PhaseResult`, to an array.
        value: wanted value, a number or an array, m, N or N m.
        at: index into the result, as into a NumPy array: ``[4, 5, 10]`` are elements 4, 5 and 10,
            ``(slice(1, 9), 2)`` or ``np.s_[1:9, 2]`` the z of nodes 1 to 8. Default all.
        on: key of the group in the structure's elements, for results of elements.
        phase: number of the phase, from 0, or from the end as -1, the default.
        within: tolerance of the deviation, in the unit of the result; targets that cannot all be
            met are weighted by its inverse. Default by the kind of the result: 1e-3 m for lengths
            ("positions", "displacement", "displacement_in_phase", "rest_length"), 1 N for forces
            ("tension", "peak_tension", "reactions", "load"), 1 N and 1 N m for "section_forces",
            1 N m for "reaction_moments", 5e-4 for the unit quaternions of "rotation", which is
            1e-3 rad. The unit of a function, or of results of your own elements, is not known: the
            default is 1 of it, which may be a whole metre.

    Raises:
        ValueError: `within` is not positive, `phase` is no integer, the value is not finite, `at`
            is no index, `of` no name or function. When the target is compared with a solution: an
            unknown result, group or index, no group where there are several, or another number of
            values.

    Example:
        >>> level = jc.design.Target("positions", 0.0, at=np.s_[1:9, 2], within=1e-4)
        >>> level.phase
        -1
        >>> print(jc.design.Target("positions").within, jc.design.Target("tension").within)  # m, N
        0.001 1.0
    """

    of: str | Callable[[PhaseResult], Array]
    value: Float[ArrayLike, " ..."] = 0.0
    at: Index = ...
    on: str | int | None = None
    phase: int = -1
    within: float = None  # type: ignore[assignment]  # its default is put in

    def __post_init__(self):
        if not callable(self.of) and not isinstance(self.of, str):
            got = type(self.of).__name__
            raise ValueError(f"of: expected the name of a result or a function, got {got}")
        value = checks.as_floats(self.value, "value")
        if isinstance(self.phase, bool) or not isinstance(self.phase, int | np.integer):
            raise ValueError(f"phase = {self.phase!r}: expected the number of a phase")
        finite = Rule("value", value, lambda v: ~(abs(v) < np.inf), "must be finite")
        object.__setattr__(self, "value", owned_copy(nan_if_broken(finite)))
        object.__setattr__(self, "at", owned_copy(_checked_index(self.at)))
        usual = 1.0 if callable(self.of) else WITHIN.get(self.of, 1.0)
        within = checks.as_scalar(usual if self.within is None else self.within, "within")
        text = "must be positive and finite"
        rule = Rule("within", within, lambda v: ~((v > 0) & (v < np.inf)), text)
        object.__setattr__(self, "within", owned_copy(nan_if_broken(rule)))

    def measured_values(self, solution: Solution) -> Float[Array, " n"]:
        """Return the entries of a solution's result that the target is set for, [n]."""
        found = self._find_result(solution.phases[self.phase])
        try:
            np.broadcast_to(0, found.shape)[self.at]  # jax would take the nearest number there is
        except IndexError as error:
            shape = list(found.shape)
            raise ValueError(f"at: {error}; the result has shape {shape}") from None
        chosen = checks.numpy_or_jax(found).ravel(found[self.at])
        if not chosen.size:
            raise ValueError(
                f"at: selects no entry of the result, which has shape {list(found.shape)}"
            )
        return chosen

    def _find_result(self, result):
        """Return the array of the result `of` (for group `on`) from the results of a phase.

        Raises ValueError if there is no such result or group, or if it is no array of floats.
        """
        name = "of" if callable(self.of) else f"of = {self.of!r}"
        if callable(self.of):
            found = self.of(result)
        elif self.of in (*RESULT_NAMES, _IN_PHASE):
            found = getattr(result, self.of)
        else:
            found = result.element_results.get(self.of)
            if found is None:
                known = [*(one for one in RESULT_NAMES if one != "results"), _IN_PHASE]
                there = checks.suggest_names(
                    self.of, dict.fromkeys([*known, *result.element_results])
                )
                raise ValueError(f"{name}: a phase has no such result{there}")
        if self.on is not None:
            if not isinstance(found, dict | list | tuple):
                text = "not of several groups; leave out `on`"
                raise ValueError(f"on = {self.on!r}: the result {name} is {text}")
            try:
                found = found[self.on]
            except (KeyError, IndexError, TypeError):
                there = checks.suggest_names(self.on, _group_keys(found))
                raise ValueError(f"on = {self.on!r}: not a group{there}") from None
        if found is None:
            whose = "this structure" if self.on is None else f"group {self.on!r}"
            raise ValueError(f"{name}: {whose} has no such result")
        if isinstance(found, dict | list | tuple):
            text = "there are several groups; give the key of one by `on`"
            raise ValueError(f"{name}: {text}{checks.suggest_names('', _group_keys(found))}")
        if not isinstance(found, jax.Array | np.ndarray | np.generic | float):
            raise ValueError(f"{name}: expected an array of floats, got {type(found).__name__}")
        found = checks.as_numpy_if_known(found)
        if not jnp.issubdtype(found.dtype, jnp.floating):
            raise ValueError(f"{name}: expected an array of floats, got {found.dtype}")
        return found

    def deviation(self, solution: Solution) -> Float[Array, " n"]:
        """Return measured minus wanted values of this target in a solution, [n], in its unit.

        They are an array of NumPy where all numbers are known.
        """
        measured = self.measured_values(solution)
        xp = checks.numpy_or_jax(self.value)
        value = xp.ravel(xp.asarray(self.value, measured.dtype))
        if value.size not in (1, measured.size):
            text = f"`of`, `on` and `at` select {measured.size}"
            raise ValueError(f"value: has {value.size} numbers, but {text}")
        return measured - (value if value.size > 1 else value.reshape(()))


def deviations(targets: Sequence[Target], solution: Solution) -> list[Float[Array, " n"]]:
    """Return the deviation of every target in a solution, a list of [n]; errors name the target."""
    found = []
    for number, target in enumerate(targets):
        try:
            found.append(target.deviation(solution))
        except ValueError as error:
            raise ValueError(f"targets[{number}]: {error}") from None
    return found


def _group_keys(groups):
    """Return the keys of groups of elements: those of a dict, indices of a list or tuple."""
    return list(groups) if isinstance(groups, dict) else range(len(groups))


def result_names_for_targets(targets: Sequence[Target]) -> tuple[str, ...]:
    """Return the names of the phase results that must be differentiated for these targets.

    If all targets are of common results (positions, tensions and so on) it is always the same
    tuple, so that they share one compiled program; otherwise it has the names of all results.
    """
    usual = all(target.of in (*_COMMON, _IN_PHASE) for target in targets)
    return _COMMON if usual else (*RESULT_NAMES, "began")


def _checked_index(at):
    """Return an array index with its lists as NumPy arrays; ValueError if it is no index."""
    if isinstance(at, tuple):
        return tuple(map(_checked_index, at))
    if at is ... or at is None or isinstance(at, slice):
        return at
    array = np.asarray(at)
    if array.dtype.kind not in "iub":
        raise ValueError(f"at = {at!r}: expected an index: numbers, a slice, or a tuple of these")
    return array if array.ndim else at


def require_targets(targets: Sequence[Any], count: int) -> None:
    """Raise ValueError if `targets` is empty, or has any item but a `Target` of an existing phase.

    `count` is the number of phases.
    """
    if not targets:
        raise ValueError("targets: there are none; give at least one Target")
    for number, target in enumerate(targets):
        if not isinstance(target, Target):
            given = checks.describe_type(target, "Target(...)")
            raise ValueError(f"targets[{number}]: expected a Target, got {given}")
        if not -count <= target.phase < count:
            raise ValueError(
                f"targets[{number}].phase = {target.phase}: there are phases 0 to {count - 1}"
            )
