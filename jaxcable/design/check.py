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
from ..common.types import Array, Float, Int, PyTree
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
    `terms`; or an `OwnCheck` of a function.

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
        ...     def terms(self, structure, solution):
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
        """Return the names of what is checked, such as "stays 3", [n_item]."""

    @abc.abstractmethod
    def terms(self, structure: Structure, solution: Solution) -> Terms:
        """Return "utilization" and the terms of which it is made, by name, [n_item] each.

        It sees one case, under `jax.vmap`.
        """

    def inputs(self) -> dict[str, Any]:
        """Return the numbers and words that the user gave, for reports."""
        return {}

    def left_out(self, structure: Structure) -> str:
        """Return which elements of a structure it might be made for, and is not; "" if none."""
        return ""

    def over_cases(
        self, terms: dict[str, Float[Array, "n_case n_item"]]
    ) -> tuple[Terms, Int[Array, " n_item"], Int[Array, " n_item"] | None]:
        """Return the terms that govern, and the cases they come from.

        Args:
            terms: of all cases that count; NaN in cases that have failed.

        Returns:
            Terms, [n_item]; indices of the cases, [n_item]; of second cases, or None.
        """
        which = extreme_cases(terms[UTILIZATION], 1)
        return {name: in_cases(values, which) for name, values in terms.items()}, which, None


def in_cases(
    values: Float[Array, "n_case n_item"], which: Int[Array, " n_item"]
) -> Float[Array, " n_item"]:
    """Return the values of each item in the case `which`, [n_item]."""
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
    def is_meant_for(self, group: Element) -> bool:
        """Return whether the check is made for the elements of a group."""

    def chosen(self, structure: Structure) -> list[tuple[int, np.ndarray]]:
        """Return the indices of the groups that are checked, and of their elements.

        Raises ValueError if a group is named that the check is not made for, or if no element is
        left.
        """
        if self.elements is None:
            masks = [np.full(len(one.links), self.is_meant_for(one)) for one in structure.groups]
        else:
            masks = [
                np.asarray(mask)
                for mask in element_masks(self.elements, structure, f"{self.name}: elements")
            ]
        found = [(k, np.flatnonzero(mask)) for k, mask in enumerate(masks) if mask.any()]
        for k, _ in found:
            if not self.is_meant_for(structure.groups[k]):
                label = named_groups_of(structure)[k][0]
                raise ValueError(f"{self.name}: elements of {label!r} {self.requirement}")
        if not found:
            raise ValueError(f"{self.name}: no group of the structure {self.requirement_met}")
        return found

    requirement: ClassVar[str] = "cannot be checked"
    requirement_met: ClassVar[str] = "can be checked"

    def items(self, structure: Structure) -> list[str]:
        """Return the names of the elements: group and number."""
        named = named_groups_of(structure)
        return [
            f"{named[k][0] or 'element'} {number}"
            for k, numbers in self.chosen(structure)
            for number in numbers
        ]

    def taken(self, structure: Structure, values: PyTree[Any] | Sequence[Any]) -> Array:
        """Return values of the checked elements, [n_item, ...], from a pytree or list by group."""
        parts = values if isinstance(values, list) else items_per_group(structure, values)
        return jnp.concatenate(
            [jnp.asarray(parts[k])[numbers] for k, numbers in self.chosen(structure)]
        )

    def strengths(self, structure: Structure) -> Array:
        """Return the breaking forces of the checked elements, [n_item], N."""
        known = [
            None if one.strength is None else jnp.broadcast_to(one.strength, len(one.links))
            for one in structure.groups
        ]
        return self.taken(structure, known)


def largest_forces(check: OnElements, structure: Structure, solution: Solution) -> Array:
    """Return the largest axial force along each checked element, [n_item], N."""
    return check.taken(structure, solution.peak_tension)


def doubt(name: str, value: Any, low: float, high: float, question: str) -> None:
    """Warn if a known number, or one of several, is outside of what is usual in SI units."""
    known = None if value is None or isinstance(value, str) else checks.array_if_known(value)
    if known is not None and ((known < low) | (known > high)).any():
        checks.warn_user(f"{name} = {text_of_input(value)}: {question}")


def input_with_unit(name: str, value: Any) -> tuple[str, str]:
    """Return an input of a check as name and text, "f_y (Pa)" in MPa and "A (m2)" in mm2."""
    stated, _, unit = name.rpartition(" (")
    other = _SHOWN_UNITS.get(unit.removesuffix(")"))
    known = np.asarray(value) if other and not isinstance(value, jax.core.Tracer) else None
    if other is None or known is None or known.dtype.kind not in "fiu":
        return name, text_of_input(value)
    shown, factor = other
    return f"{stated} ({shown})", text_of_input(known * factor)


_SHOWN_UNITS = {
    **{"Pa": ("MPa", 1e-6), "m2": ("mm2", 1e6), "m3": ("cm3", 1e6)},
    **{"N": ("kN", 1e-3), "N m": ("kN m", 1e-3)},
}
"""Units in which reports show inputs of checks, and factors, by those in which they are given."""


def text_of_input(value: Any) -> str:
    """Return a number, or the range of several, as text for reports."""
    if isinstance(value, str) or value is None:
        return str(value)
    if isinstance(value, jax.core.Tracer):
        return "traced"
    known = np.asarray(value)
    if known.dtype.kind not in "fiu" or not known.size:
        return str(value)
    low, high = known.min(), known.max()
    return f"{low:.6g}" if low == high else f"{low:.6g} to {high:.6g}"
