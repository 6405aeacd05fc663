"""Checks of limits: displacements, tensions that must remain, reactions, own functions.

A value is compared with a lower or an upper limit. Its utilization is above 1 where the limit is
passed: ``value / upper``; ``lower / value`` for a lower limit above zero (infinite where nothing is
left of the value), ``value / lower`` for one below; for a lower limit of zero it is infinite where
the value is negative, and 0 elsewhere.
"""

from __future__ import annotations

import dataclasses
import inspect
from collections.abc import Callable, Sequence
from typing import Any, ClassVar, Literal

import jax.numpy as jnp
import numpy as np

from ..analysis.solution import Solution, State
from ..common import checks
from ..common.rules import Rule, nan_if_broken
from ..common.types import Array, ArrayLike, Float, Int
from ..elements.element import TENSION, Element
from ..model.result_parts import active_nodes, loose_nodes, present_elements
from ..model.structure import Structure
from .check import (
    SERVICE,
    ULTIMATE,
    UTILIZATION,
    Check,
    OnElements,
    Terms,
    largest_forces,
    values_in_cases,
    warn_if_unusual,
)
from .result_envelopes import extreme_cases

_DISPLACEMENTS, _TENSIONS, _REACTIONS = {"displacement": "m"}, {"tension": "N"}, {"reaction": "N"}


def limit_utilization(
    value: Float[Array, " ..."],
    lower: Float[ArrayLike, ""] | None = None,
    upper: Float[ArrayLike, ""] | None = None,
) -> Float[Array, " ..."]:
    """Return the utilization of limits, - (formulas: see the module); of two the larger one.

    `value`, `lower` and `upper` have one unit; a limit that is None does not count.
    """
    found = []
    if upper is not None:
        found.append(value / upper)
    if lower is not None:
        lower = jnp.asarray(lower)
        left = value > 0
        part = jnp.where(left, lower / jnp.where(left, value, 1.0), jnp.inf)
        below = jnp.where(value < 0, jnp.inf, 0.0)
        ratio = value / jnp.where(lower == 0, 1.0, lower)
        used = jnp.where(lower > 0, part, jnp.where(lower < 0, ratio, below))
        found.append(jnp.where(jnp.isnan(value) | jnp.isnan(lower), jnp.nan, used))
    return jnp.stack(found).max(axis=0)


def _validate_limits(check, lower, upper, text="lower, upper: missing; give at least one limit"):
    """Raise ValueError for limits that break the rules; replace traced ones that do by NaN.

    There must be a limit (`text` is the message else); the upper one is positive and above the
    lower one. The fields `lower` and `upper` of the frozen `check` are set.
    """
    name = check.name
    if lower is None and upper is None:
        raise ValueError(f"{name}: {text}")
    if upper is not None:
        is_low = Rule(f"{name}: upper", upper, lambda v: ~(v > 0), "expected a positive limit")
        object.__setattr__(check, "upper", nan_if_broken(is_low))
    if lower is not None and upper is not None:
        text = f"expected below upper = {upper}"
        pair = Rule(f"{name}: lower", (lower, upper), lambda low, high: ~(low < high), text)
        object.__setattr__(check, "lower", nan_if_broken(pair))


def _unit_vector(direction, name):
    """Return a direction as a unit vector [3]; ValueError for another shape, or zero."""
    vector = np.zeros(0) if isinstance(direction, str) else np.asarray(direction, float)
    if vector.shape != (3,) or not np.linalg.norm(vector) > 0:
        raise ValueError(f"{name}: direction = {direction}: expected three numbers, not all zero")
    return vector / np.linalg.norm(vector)


@dataclasses.dataclass(frozen=True)
class OwnCheck(Check):
    """A check by a function: its values against limits.

    Args:
        name: of the check.
        function: of the structure and the `Solution` of one case: values, [n_item] or one. JAX
            traces it: no ``if`` on results, `jax.numpy` instead of `math`.
        lower, upper: limits; upper is positive. Default: the values are utilizations, at most 1.
        of: limit states or rules whose combinations count, see `Check`.
        unit: of the values.
        labels: names of the items, [n_item]; default "value 0" and so on.
        clause: what a report shows as the source.

    Example:
        The horizontal thrust on a support must not exceed 12 kN:

        >>> rope = jc.Cables([[0, 1], [1, 2]], axial_stiffness=1e7)
        >>> nodes = [[0.0, 0, 0], [2.0, 0, 0], [4.0, 0, 0]]
        >>> structure = jc.Structure(nodes, rope, supports=jc.pinned([0, 2]))
        >>> solution = jc.solve(structure, jc.Phase(pretension=9e3))
        >>> def push(structure, solution):
        ...     return -solution.reactions[0, 0]
        >>> thrust = jc.design.OwnCheck("thrust", push, upper=12e3, unit="N")
        >>> print(jc.design.checks(structure, solution, thrust)["thrust"].utilization)
        [0.75]
    """

    name: str
    function: Callable[[Structure, Solution], Float[Array, " n_item"]]
    lower: Float[ArrayLike, ""] | None = None
    upper: Float[ArrayLike, ""] | None = None
    of: Sequence[str] = ()
    unit: str = "-"
    labels: Sequence[str] | None = None
    clause: str = ""

    formula = "value / upper limit, or lower limit / value"

    def __post_init__(self):
        super().__post_init__()
        if not callable(self.function):
            kind = checks.describe_type(self.function, "lambda structure, solution: ...")
            raise ValueError(f"function: expected a function, got {kind}")
        try:
            inspect.signature(self.function).bind(None, None)
        except TypeError:
            raise ValueError(
                f"{self.name}: function: expected two arguments, the structure and the solution"
            ) from None
        except ValueError:
            pass  # a signature that Python does not know
        if self.lower is None and self.upper is None:
            object.__setattr__(self, "upper", 1.0)
        _validate_limits(self, self.lower, self.upper)
        object.__setattr__(self, "units", {"value": self.unit})

    def inputs(self) -> dict[str, Any]:
        """Return the given limits by the labels "lower" and "upper" with their unit."""
        given = {"lower": self.lower, "upper": self.upper}
        return {f"{k} ({self.unit})": v for k, v in given.items() if v is not None}

    def items(self, structure: Structure) -> list[str]:
        """Return the given labels of the values; an empty list if there are none."""
        return list(self.labels or ())

    def evaluate(self, structure: Structure, solution: Solution) -> Terms:
        """Return "value", what the function returns, [n_item], and "utilization" in one case."""
        value = self.function(structure, solution)
        if isinstance(value, str | dict) or value is None:
            kind = type(value).__name__
            raise ValueError(f"{self.name}: function: expected numbers, [n_item], got {kind}")
        value = jnp.atleast_1d(jnp.asarray(value))
        if value.ndim != 1:
            raise ValueError(f"{self.name}: function: expected [n_item], got shape {value.shape}")
        return {"value": value, UTILIZATION: limit_utilization(value, self.lower, self.upper)}


@dataclasses.dataclass(frozen=True)
class DisplacementLimit(Check):
    """Limit of displacements of nodes.

    A node that only slack elements hold has no definite place, and no value: see
    `Checks.unchecked`. Utilizations of nodes all of whose elements are inactive are zero.

    Args:
        upper: largest displacement, m.
        nodes: indices of nodes; None: all.
        direction: along which the displacement is taken, either way, [3], without unit; None: its
            size.
        since: "last phase" for displacements within the last phase, which of cases is the case on
            the prestressed structure; or the `Solution` or `State` from which they count; None:
            from the nodes of the input.
        name, of: as of `Check`; by default combinations of serviceability count, and not ultimate
            ones.

    Example:
        >>> structure, phases = jc.scenes.flat_net(load=15.0)
        >>> calm = jc.solve(structure, phases[:1])
        >>> limit = jc.design.DisplacementLimit(0.02, [3], (0, 0, 1), since=calm)
        >>> found = jc.design.checks(structure, jc.solve(structure, phases), limit)
        >>> print(found)
        displacement: utilization 0.642, node 3, case 0, given limit
    """

    upper: Float[ArrayLike, ""]
    nodes: Int[ArrayLike, " n"] | None = None
    direction: Float[ArrayLike, " 3"] | None = None
    since: Literal["last phase"] | Solution | State | None = None
    name: str = "displacement"
    of: Sequence[str] = SERVICE

    clause = "given limit"
    formula = "displacement / limit"
    not_covered = "nodes while only slack elements hold them, which have no definite place"
    units = _DISPLACEMENTS

    def __post_init__(self):
        super().__post_init__()
        _validate_limits(self, None, self.upper)
        warn_if_unusual(f"{self.name}: upper", self.upper, 0.0, 10.0, "is the limit in m?")
        if self.direction is not None:
            _unit_vector(self.direction, self.name)
        if isinstance(self.since, str):
            checks.require_one_of(self.since, f"{self.name}: since", ["last phase"])

    def _checked_nodes(self, structure):
        """Return the indices of the nodes whose displacements are checked, [n_item]."""
        return _checked_node_indices(self.nodes, structure, self.name)

    def inputs(self) -> dict[str, Any]:
        """Return the limit, m, direction and reference state, by the labels that a report shows."""
        along = {} if self.direction is None else {"direction": str(list(self.direction))}
        given = self.since if isinstance(self.since, str) else "the state that was given"
        since = {} if self.since is None else {"displacement since": given}
        return {"limit (m)": self.upper, **along, **since}

    def items(self, structure: Structure) -> list[str]:
        """Return the labels of the checked nodes, "node 12" and so on, [n_item]."""
        return [f"node {k}" for k in self._checked_nodes(structure)]

    def evaluate(self, structure: Structure, solution: Solution) -> Terms:
        """Return "displacement", m, and "utilization" in one case, [n_item] each.

        Both are NaN for nodes that only slack elements hold. Where no element of a node is active,
        its displacement is NaN and its utilization zero.
        """
        if isinstance(self.since, str):
            moved = solution.displacement_since(-1)
        else:
            begin = 0.0 if self.since is None else self.since.displacement
            moved = solution.displacement - begin
        nodes = self._checked_nodes(structure)
        moved, active = moved[nodes], jnp.asarray(active_nodes(structure, solution.present))[nodes]
        fixed = solution.last.fixed[-1].array
        is_loose = jnp.asarray(loose_nodes(structure, solution, fixed))[nodes]
        if self.direction is None:
            square = jnp.sum(moved**2, axis=-1)
            # a node at rest has no direction, and no derivative
            value = jnp.where(square > 0, jnp.sqrt(jnp.where(square > 0, square, 1.0)), square)
        else:
            value = jnp.abs(moved @ _unit_vector(self.direction, self.name))
        used = jnp.where(is_loose, jnp.nan, jnp.where(active, value / self.upper, 0.0))
        value = jnp.where(is_loose | ~active, jnp.nan, value)
        return {"displacement": value, UTILIZATION: used}


@dataclasses.dataclass(frozen=True)
class TensionLimit(OnElements):
    """Smallest tension that cables must keep, so that none goes slack; inactive ones do not count.

    Args:
        lower: smallest tension, N, above zero; a slack cable has infinite utilization.
        elements: keys of groups, or selections by group; None: all cables.
        name, of: as of `Check`; by default combinations of serviceability count, and not ultimate
            ones: ``of=()`` counts all.

    Example:
        >>> structure, phases = jc.scenes.flat_net(load=15.0)
        >>> taut = jc.design.TensionLimit(lower=100.0)
        >>> print(jc.design.checks(structure, jc.solve(structure, phases), taut).passed)
        True
    """

    lower: Float[ArrayLike, ""] | None = None
    name: str = "tension that remains"
    of: Sequence[str] = SERVICE

    clause = "given limit"
    formula = "smallest tension / tension"
    units = _TENSIONS
    requirement: ClassVar[str] = "are no cables"
    requirement_met: ClassVar[str] = "has cables"

    def __post_init__(self):
        super().__post_init__()
        _validate_limits(self, self.lower, None, "lower: missing; give the smallest tension, N")
        text = "expected a positive tension, N"
        above_zero = Rule(f"{self.name}: lower", self.lower, lambda v: ~(v > 0), text)
        object.__setattr__(self, "lower", nan_if_broken(above_zero))

    def applies_to(self, group: Element) -> bool:
        """Return whether the elements bear tension only, and have a tension as a result."""
        return bool(group.tension_only) and any(one.name == TENSION.name for one in group.results)

    def inputs(self) -> dict[str, Any]:
        """Return the smallest allowed tension, N, by the label that a report shows."""
        return {"smallest tension (N)": self.lower}

    def evaluate(self, structure: Structure, solution: Solution) -> Terms:
        """Return "tension", N, the largest along each element, and "utilization", [n_item] each.

        Inactive elements have NaN and a utilization of 0.
        """
        force = largest_forces(self, structure, solution)
        active = self.checked_values(structure, present_elements(structure, solution.present))
        used = jnp.where(active, limit_utilization(force, self.lower), 0.0)
        return {"tension": jnp.where(active, force, jnp.nan), UTILIZATION: used}


@dataclasses.dataclass(frozen=True)
class ReactionLimit(Check):
    """Limits of a component of the reactions: uplift, anchors, bearings.

    Args:
        nodes: indices of supported nodes.
        direction: along which the reaction on the structure is taken, [3], without unit; upward by
            default.
        lower: smallest reaction, N: 0 where nothing holds a support down, minus the resistance of
            an anchor where one does.
        upper: largest reaction, N.
        name, of: as of `Check`; by default ultimate, accidental and seismic combinations count.

    Example:
        >>> rope = jc.Cables([[0, 1]], axial_stiffness=1e7)
        >>> structure = jc.Structure([[0, 0, 0], [0, 0, -2.0]], rope, supports=jc.pinned([0]))
        >>> solution = jc.solve(structure, jc.Phase(loads=jc.NodalLoads([1], (0, 0, -9e3))))
        >>> hook = jc.design.ReactionLimit([0], upper=12e3)
        >>> print(jc.design.checks(structure, solution, hook)["reaction"].utilization)
        [0.75]
    """

    nodes: Int[ArrayLike, " n"]
    direction: Float[ArrayLike, " 3"] = (0.0, 0.0, 1.0)
    lower: Float[ArrayLike, ""] | None = None
    upper: Float[ArrayLike, ""] | None = None
    name: str = "reaction"
    of: Sequence[str] = ULTIMATE

    clause = "given limit"
    formula = "reaction / limit"
    units = _REACTIONS

    def __post_init__(self):
        super().__post_init__()
        _validate_limits(self, self.lower, self.upper)
        _unit_vector(self.direction, self.name)

    def inputs(self) -> dict[str, Any]:
        """Return the limits, N, and the direction, by the labels that a report shows."""
        given = {"lower (N)": self.lower, "upper (N)": self.upper}
        known = {name: value for name, value in given.items() if value is not None}
        return {**known, "direction": str(list(self.direction))}

    def items(self, structure: Structure) -> list[str]:
        """Return the labels of the checked nodes, "node 12" and so on, [n_item]."""
        return [f"node {k}" for k in _checked_node_indices(self.nodes, structure, self.name)]

    def evaluate(self, structure: Structure, solution: Solution) -> Terms:
        """Return "reaction", the component along the direction, N, and "utilization", [n_item].

        Raises ValueError if a node has no support.
        """
        numbers = _checked_node_indices(self.nodes, structure, self.name)
        for k in numbers:
            if not np.asarray(solution.last.fixed[-1])[k, :3].any():
                raise ValueError(f"{self.name}: nodes: node {k} has no support")
        value = solution.reactions[numbers] @ _unit_vector(self.direction, self.name)
        return {"reaction": value, UTILIZATION: limit_utilization(value, self.lower, self.upper)}

    def governing_terms(
        self, terms: dict[str, Float[Array, "n_case n_item"]]
    ) -> tuple[Terms, Int[Array, " n_item"], None]:
        """Return the terms as `Check`; of cases of infinite utilization the largest uplift governs.

        Arguments and results are those of `Check.governing_terms`.
        """
        used = terms[UTILIZATION]
        endless = jnp.isposinf(used)
        uplift = jnp.where(endless, -terms["reaction"], -jnp.inf)
        which = extreme_cases(jnp.where(endless.any(axis=0), uplift, used), 1)
        return {name: values_in_cases(values, which) for name, values in terms.items()}, which, None


def _checked_node_indices(nodes: Any, structure, name):
    """Return valid indices of nodes, [n], from `nodes`; those of all nodes for None.

    Raises ValueError, which begins with the `name` of the check, for unknown nodes.
    """
    if nodes is None:
        return np.arange(structure.n_node)
    numbers = checks.as_indices(nodes, f"{name}: nodes")
    checks.require_known_nodes(numbers, structure.n_node, f"{name}: nodes")
    return numbers
