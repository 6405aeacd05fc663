"""Checks of the input of form finding: structures of straight elements, forces and lengths."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence
from typing import Any

import jax.numpy as jnp
import numpy as np

from ..analysis.group_values import value_per_group
from ..common import checks, status
from ..common.rules import Rule, are_rules_kept, collect_rules, nan_if_broken
from ..common.selection import Only, Selection
from ..common.types import Array, ArrayLike, Bool, Float, Int, PyTree
from ..elements.abilities import Hanging
from ..elements.element import Element, ElementState
from ..elements.straight import Straight
from ..loads import NodalLoads, SelfWeight, as_list
from ..loads.load import Load
from ..mechanics.assembly import System
from ..model.plausibility import NamedGroups, issues_warnings
from ..model.result_parts import group_path, named_groups_of
from ..model.structure import Structure, position_rules
from ..spaces import Translations
from ..spaces.dof_map import DofMap

# Rules of lengths and of forces of cables: which of the elements that are meant break it, its text.
_LENGTHS = (lambda values, meant: meant & (values <= 0)), "must be positive"
_FORCES = (lambda values, meant: meant & (values < 0)), "a cable carries tension only; use Bars"


def require_straight_elements(structure: Structure, of: Sequence[bool] | None = None) -> None:
    """Raise ValueError unless `structure` consists of straight elements (cables, bars) only.

    `of` says for each group whether it must be straight; None: all must.
    """
    require_structure(structure)
    named = structure.named_groups()
    for (where, group), asked in zip(named, of or [True] * len(named), strict=True):
        if not asked:
            continue
        if group.compression_only:
            raise ValueError(
                f"elements{where} ({type(group).__name__}) only presses; form finding takes Bars "
                "in its place: exchange them for the analysis"
            )
        if not is_straight(group):
            raise ValueError(
                f"elements{where} ({type(group).__name__}) is not made of straight elements with "
                "two ends; form finding takes Cables, Bars, and classes that derive from "
                "`elements.straight.Straight`"
            )


def require_structure(structure: Structure) -> None:
    """Raise ValueError unless `structure` is a `Structure`."""
    if not isinstance(structure, Structure):
        raise ValueError(f"structure: expected a Structure, got {type(structure).__name__}")


def is_straight(group: Element) -> bool:
    """Return whether a group is one of straight elements with two ends: cables or bars."""
    return isinstance(group, Straight) and group.links.shape[1] == 2


def input_status(
    nodes: Float[Array, "n_node 3"], groups: Sequence[Element], *others: Any
) -> Int[Array, ""]:
    """Return INVALID_INPUT if traced numbers of a structure break their rules, else OK.

    `others` are further objects that have rules, such as the method.
    """
    rules = [
        *collect_rules([groups, others]),
        *(r for g in groups for r in position_rules(nodes, g)),
    ]
    return jnp.where(are_rules_kept(rules), status.OK, status.INVALID_INPUT).astype(jnp.int32)


def sum_nodal_loads(
    loads: Sequence[NodalLoads], shape: tuple[int, int], dtype: np.dtype
) -> Float[Array, "n_node 3"]:
    """Return the sum of nodal loads at every node, [n_node, 3], N; `shape` is (n_node, 3)."""
    forces: Iterable[Any] = (load.nodal_forces(shape, dtype) for load in loads)
    return sum(forces, start=jnp.zeros(shape, dtype))


def values_by_group(
    value: PyTree[Float[ArrayLike, " ..."] | Only] | None,
    structure: Structure,
    name: str,
    is_length: bool = False,
) -> tuple[list[Float[ArrayLike, " n_elem"] | None], list[Bool[np.ndarray, " n_elem"]]]:
    """Check forces, force densities or lengths of elements, and return them group by group.

    Forces and force densities of cables must not be negative, lengths must be positive: known
    values raise ValueError, traced ones become NaN.

    Args:
        value: a scalar, [n_elem], `only(...)`, or a prefix pytree of the elements.
        structure: `Structure`.
        name: argument that an error message names.
        is_length: whether the values are lengths.

    Returns:
        values: for each group floats [n_elem], zero for elements without a value; or None if no
            element of the group has one.
        chosen: for each group which elements have a value, [n_elem] bool, NumPy.
    """
    values, chosen = [], []
    names = named_groups_of(structure)
    for (label, group), given in zip(names, value_per_group(value, structure, name), strict=True):
        n_elem = len(group.links)
        meant = np.full(n_elem, given is not None)
        if isinstance(given, Selection):
            raise ValueError(f"{name}: only(...) has no values here; give only(elements, values)")
        if isinstance(given, Only):
            meant = given.element_mask(n_elem, name)
            checks.floats_per_element(given.values, len(given.elements), name)
            given = given.merged_with(np.zeros(n_elem))
        given = checks.floats_per_element(given, n_elem, name)
        if given is not None and (is_length or group.tension_only):
            # the argument and the group that it is for, as a user writes it
            key = f"[{int(label) if label.isdigit() else label!r}]" if label else ""
            rule = Rule(f"{name}{key}", (given, meant), *(_LENGTHS if is_length else _FORCES))
            given = nan_if_broken(rule)
        values.append(given)
        chosen.append(meant)
    return values, chosen


def require_single_input(
    structure: Structure,
    names: Sequence[str],
    chosen: Sequence[Sequence[Bool[np.ndarray, " n_elem"]]],
    missing: str | None = None,
    of: Sequence[bool] | None = None,
) -> None:
    """Raise ValueError if an element has several of some inputs (tension, length ...), or none.

    Args:
        structure: `Structure`.
        names: names of the inputs.
        chosen: for each input and group, which elements have it, [n_elem] bool.
        missing: end of the message for an element without input; None if elements may have none.
        of: for each group whether it is asked; None: all are.
    """
    for k, masks in enumerate(zip(*chosen, strict=True)):
        if of is not None and not of[k]:
            continue
        count = np.sum(masks, axis=0)
        wrong = count > 1 if missing is None else count != 1
        if not wrong.any():
            continue
        e = int(wrong.argmax())
        where = f"element {e} of {group_path(structure, k)}"
        if not count[e]:
            raise ValueError(f"{names[0]}: {where} {missing}")
        twice = ", ".join(name for name, mask in zip(names, masks, strict=True) if mask[e])
        several = "both" if len(names) == 2 else "more than one of them"
        raise ValueError(f"{twice}: {where} has {several}; give one")


def system_with_fixed_supports(
    nodes: Float[Array, "n_node 3"],
    groups: list[Element],
    states: list[ElementState],
    load: Float[Array, "n_node 3"],
    dof_map: DofMap,
    followers: list[Any] | None = None,
) -> System:
    """Make a `System` of element groups with given states, in which no support moves.

    `nodes` are positions, [n_node, 3], m; `load` has the nodal loads, [n_node, 3], N; `dof_map`
    numbers the unknowns; `followers` are follower loads.
    """
    space = Translations(dof_map, jnp.zeros_like(nodes))
    return System(nodes, groups, states, load, space, followers)


@issues_warnings
def warn_of_hanging_elements(
    named: NamedGroups, prescribed: Sequence[bool], loads: Load | Sequence[Load] | None
) -> Iterator[str]:
    """Warn of catenaries with given values under their weight: in a form all of them are straight.

    Args:
        named: pairs of (key in the elements as text, group).
        prescribed: whether each group has given values.
        loads: those of the form.
    """
    if not any(isinstance(load, SelfWeight) for load in as_list(loads)):
        return
    for (where, group), is_given in zip(named, prescribed, strict=True):
        weight = checks.array_if_known(group.weight)
        if is_given and isinstance(group, Hanging) and weight is not None and np.any(weight):
            yield (
                f"elements{where} (Catenaries): with given values they are straight in the form, "
                "half of their weight at each end; hanging by the lengths of the form they have "
                "other forces. Take Cables of several elements, or give no values and state "
                "end_tension in an analysis"
            )
