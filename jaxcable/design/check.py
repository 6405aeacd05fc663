"""What a check is: its items, its utilization in one case, and what a report says of it."""

from __future__ import annotations

import abc
import dataclasses
from collections.abc import Mapping, Sequence
from types import MappingProxyType
from typing import Any, ClassVar, TypeAlias

import jax
import jax.numpy as jnp
import numpy as np

from ..analysis.activation import element_masks
from ..analysis.phases import keys_as_whole_groups
from ..analysis.solution import Solution
from ..common import checks
from ..common.owned import owned_copy
from ..common.selection import Selection
from ..common.types import Array, ArrayLike, Float, Int, PyTree
from ..elements.element import Element
from ..model.result_parts import items_per_group, named_groups_of
from ..model.structure import Structure
from .result_envelopes import extreme_cases

UTILIZATION = "utilization"
"""The term of a check that is compared with 1."""

ULTIMATE = "ultimate", "accidental", "seismic"
SERVICE = "serviceability", "allowable stress"

Terms: TypeAlias = "dict[str, Float[Array, ' n_item']]"


class Check(abc.ABC):
    """Base of checks: a utilization of items, such as elements, in every load case.

    A check of your own is a frozen dataclass with `name`, `of`, and the methods `items` and
    `evaluate`; or an `OwnCheck` of a function.

    Attributes:
        name: of the check, for tables and messages.
        of: names of the limit states or of the rules whose combinations count, such as
            "ultimate"; empty: all cases.
        clause: what the formula is taken from.
        formula: of the utilization.
        units: by the name of a term; those that are missing are "-".
        not_covered: what the check leaves out.

    Example:
        Elements must not become longer than by 1 %:

        >>> import dataclasses
        >>> @dataclasses.dataclass(frozen=True)
        ... class Stretch(jc.design.Check):
        ...     name: str = "stretch"
        ...     of: tuple = ()
        ...     def items(self, structure):
        ...         return [f"element {k}" for k in range(len(structure.elements.links))]
        ...     def evaluate(self, structure, solution):
        ...         long = solution.tension / structure.elements.axial_stiffness
        ...         return {"strain": long, "utilization": long / 0.01}
        >>> structure, phases = jc.scenes.flat_net(load=15.0)
        >>> found = jc.design.checks(structure, jc.solve(structure, phases), Stretch())
        >>> print(found.passed, len(found["stretch"].items))
        True 12
    """

    name: str
    of: Sequence[str]
    clause: str = ""
    formula: str = ""
    units: Mapping[str, str] = MappingProxyType({})
    not_covered: str = ""

    def __post_init__(self):
        for field in dataclasses.fields(self):
            object.__setattr__(self, field.name, owned_copy(getattr(self, field.name)))
        object.__setattr__(self, "of", (self.of,) if isinstance(self.of, str) else tuple(self.of))

    @abc.abstractmethod
    def items(self, structure: Structure) -> list[str]:
        """Return a label of each thing that is checked, such as "stays 3", [n_item]."""

    @abc.abstractmethod
    def evaluate(self, structure: Structure, solution: Solution) -> Terms:
        """Return "utilization", -, and the forces, resistances and so on behind it, [n_item] each.

        It is called for one case under `jax.vmap`: no ``if`` on numbers of the solution.
        """

    def for_case(self, case: Int[ArrayLike, ""], n_case: int) -> Check:
        """Return the check of one of `n_case` cases, of index `case`, which may be traced.

        It is another one where the user has stated a number for each case.
        """
        return self

    def across_cases(
        self, terms: dict[str, Float[Array, "n_case n_item"]]
    ) -> dict[str, Float[Array, "n_case n_item"]]:
        """Return the terms of all cases that count, where one case tells something of another."""
        return terms

    def inputs(self) -> dict[str, Any]:
        """Return what the user stated, numbers and texts, by labels with units such as "f_y (Pa)".

        A report of the check shows them.
        """
        return {}

    def skipped_text(self, structure: Structure) -> str:
        """Return a text that names elements which the check skips for lack of data; "" if none."""
        return ""

    def governing_terms(
        self, terms: dict[str, Float[Array, "n_case n_item"]]
    ) -> tuple[Terms, Int[Array, " n_item"], Int[Array, " n_item"] | None]:
        """Return the terms of each item in its governing case, and the indices of these cases.

        Args:
            terms: of all cases that count, by name; NaN in cases that have failed.

        Returns:
            Terms, [n_item] each; indices of the governing cases, [n_item]; those of second cases,
            [n_item], for ranges between two cases, else None.
        """
        which = extreme_cases(terms[UTILIZATION], 1)
        return {name: values_in_cases(values, which) for name, values in terms.items()}, which, None


def values_in_cases(
    values: Float[Array, "n_case n_item"], which: Int[Array, " n_item"]
) -> Float[Array, " n_item"]:
    """Return from `values` the value of each item in its own case, of index `which`, [n_item]."""
    return jnp.take_along_axis(values, which[None], axis=0)[0]


@dataclasses.dataclass(frozen=True)
class OnElements(Check):
    """Base of checks of elements.

    Args:
        elements: keys of groups, or selections by group such as ``{"stays": only([0, 1])}``; None:
            all elements that the check is made for.
        name, of: as of `Check`.
    """

    elements: str | Sequence[str] | PyTree[Selection] | None = None
    name: str = ""
    of: Sequence[str] = ()

    def __post_init__(self):
        super().__post_init__()
        object.__setattr__(self, "elements", keys_as_whole_groups(self.elements))

    @abc.abstractmethod
    def applies_to(self, group: Element) -> bool:
        """Return whether a group is of a kind that the check concerns, such as cables."""

    def checked_elements(self, structure: Structure) -> list[tuple[int, np.ndarray]]:
        """Return pairs: index of a group, and indices of the elements of it that are checked.

        Raises ValueError if a group is named that the check is not made for, or if no
        element is left.
        """
        if self.elements is None:
            masks = [np.full(len(one.links), self.applies_to(one)) for one in structure.groups]
        else:
            masks = [
                np.asarray(mask)
                for mask in element_masks(self.elements, structure, f"{self.name}: elements")
            ]
        found = [(k, np.flatnonzero(mask)) for k, mask in enumerate(masks) if mask.any()]
        for k, _ in found:
            if not self.applies_to(structure.groups[k]):
                label = named_groups_of(structure)[k][0]
                raise ValueError(f"{self.name}: elements of {label!r} {self.requirement}")
        if not found:
            raise ValueError(f"{self.name}: no group of the structure {self.requirement_met}")
        return found

    requirement: ClassVar[str] = "cannot be checked"
    requirement_met: ClassVar[str] = "can be checked"

    def items(self, structure: Structure) -> list[str]:
        """Return the labels of the checked elements, key of the group and index: "stays 3"."""
        named = named_groups_of(structure)
        return [
            f"{named[k][0] or 'element'} {number}"
            for k, numbers in self.checked_elements(structure)
            for number in numbers
        ]

    def checked_values(self, structure: Structure, values: PyTree[Any] | Sequence[Any]) -> Array:
        """Return the values of the checked elements, [n_item, ...], in the order of `items`.

        `values` are arrays [n_elem, ...] of all elements: a pytree of the shape of the
        structure's elements, or a list by group.
        """
        parts = values if isinstance(values, list) else items_per_group(structure, values)
        return jnp.concatenate(
            [jnp.asarray(parts[k])[numbers] for k, numbers in self.checked_elements(structure)]
        )

    def strengths(self, structure: Structure) -> Array:
        """Return the breaking forces of the checked elements, their `strength`, [n_item], N."""
        known = [
            None if one.strength is None else jnp.broadcast_to(one.strength, len(one.links))
            for one in structure.groups
        ]
        return self.checked_values(structure, known)


def describe_largest(used: Any, terms: Terms, units: Mapping[str, str]) -> tuple[int, str]:
    """Return the index of the item of largest utilization, and a text that says how large it is.

    Of items of infinite utilization it is that of the smallest value, whose text has this value.

    Args:
        used: utilizations, [n_item], -; NaN counts least.
        terms: as of `Check.evaluate`, in the cases that govern, and their units by name. The first
            one is the value that limits are for.
        units: units of terms by name.
    """
    used = np.asarray(used)
    endless = np.isposinf(used)
    names = [name for name in terms if name != UTILIZATION]
    if not endless.any() or not names:
        k = int(np.argmax(np.where(np.isnan(used), -np.inf, used)))
        return k, f"utilization {used[k]:.3f}"
    values = np.asarray(terms[names[0]])
    k = int(np.argmin(np.where(endless & ~np.isnan(values), values, np.inf)))
    unit = f" ({units[names[0]]})" if names[0] in units else ""
    return k, "utilization inf, {} {}".format(*input_with_unit(names[0] + unit, values[k]))


def largest_forces(check: OnElements, structure: Structure, solution: Solution) -> Array:
    """Return the largest axial force along each checked element, [n_item], N."""
    return check.checked_values(structure, solution.peak_tension)


def warn_if_unusual(name: str, value: Any, low: float, high: float, question: str) -> None:
    """Warn, with a `question` about the unit, if a known number is outside of `low` to `high`.

    `value` may be an array, in SI units; None, texts and traced numbers pass.
    """
    known = None if value is None or isinstance(value, str) else checks.array_if_known(value)
    if known is not None and ((known < low) | (known > high)).any():
        checks.warn_user(f"{name} = {input_text(value)}: {question}")


def input_with_unit(name: str, value: Any) -> tuple[str, str]:
    """Return label and text of an input in the unit of reports, with that unit in the label.

    The label's unit in brackets is that of `value`: "f_y (Pa)" becomes "f_y (MPa)", "A (m2)"
    mm2.
    """
    stated, _, unit = name.rpartition(" (")
    other = _SHOWN_UNITS.get(unit.removesuffix(")"))
    known = np.asarray(value) if other and not isinstance(value, jax.core.Tracer) else None
    if other is None or known is None or known.dtype.kind not in "fiu":
        return name, input_text(value)
    shown, factor = other
    return f"{stated} ({shown})", input_text(known * factor)


_SHOWN_UNITS = {
    **{"Pa": ("MPa", 1e-6), "m2": ("mm2", 1e6), "m3": ("cm3", 1e6)},
    **{"N": ("kN", 1e-3), "N m": ("kN m", 1e-3)},
}
"""Units in which reports show inputs of checks, and factors, by those in which they are given."""


def input_text(value: Any) -> str:
    """Return a number as text for reports; of an array its range, of other values their text.

    "traced" stands for numbers that are not known.
    """
    if isinstance(value, str) or value is None:
        return str(value)
    if isinstance(value, jax.core.Tracer):
        return "traced"
    known = np.asarray(value)
    if known.dtype.kind not in "fiu" or not known.size:
        return str(value)
    low, high = known.min(), known.max()
    return f"{low:.6g}" if low == high else f"{low:.6g} to {high:.6g}"
