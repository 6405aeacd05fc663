"""Checks of the structures that form finding takes (straight members), of loads and statements."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from typing import Any

import jax.numpy as jnp
import numpy as np

from ..analysis.phases import spread
from ..common import checks, status
from ..common.rules import kept, rules_of
from ..common.selection import Only, Selection
from ..common.types import Array, ArrayLike, Bool, Float, Int, PyTree
from ..elements.element import Element
from ..elements.straight import Straight
from ..loads import NodalLoads
from ..model.parts import groups_by_name
from ..model.structure import Structure, place_rules


def check_members(structure: Structure) -> None:
    """Raise ValueError unless `structure` is one of cables and bars only."""
    if not isinstance(structure, Structure):
        raise ValueError(f"structure: expected a Structure, got {type(structure).__name__}")
    for where, group in structure.named_groups():
        if not isinstance(group, Straight) or group.links.shape[1] != 2:
            raise ValueError(
                f"elements{where} ({type(group).__name__}) is not made of straight members with "
                "two ends; form finding takes Cables and Bars, and what derives from "
                "`elements.straight.Straight`"
            )


def argument(name: str, structure: Structure, k: int) -> str:
    """An argument and the group that it is for, as a user writes it: ``q['MAST']``, or ``q``."""
    label = groups_by_name(structure)[k][0]
    return f"{name}[{int(label) if label.isdigit() else label!r}]" if label else name


def verdict(
    nodes: Float[Array, "n_node 3"], groups: Sequence[Element], *others: Any
) -> Int[Array, ""]:
    """Status: INVALID_INPUT if numbers of a structure or of `others` break their rules, else OK.

    It can be traced.
    """
    rules = [*rules_of([groups, others]), *(r for g in groups for r in place_rules(nodes, g))]
    return jnp.where(kept(rules), status.OK, status.INVALID_INPUT).astype(jnp.int32)


def total(
    loads: Sequence[NodalLoads], shape: tuple[int, int], dtype: np.dtype
) -> Float[Array, "n_node 3"]:
    """Sum of nodal loads, `shape` [n_node, 3], N."""
    forces: Iterable[Any] = (load.nodal_forces(shape, dtype) for load in loads)
    return sum(forces, start=jnp.zeros(shape, dtype))


def stated(
    value: PyTree[Float[ArrayLike, " ..."] | Only] | None, structure: Structure, name: str
) -> tuple[list[Float[ArrayLike, " n_elem"] | None], list[Bool[np.ndarray, " n_elem"]]]:
    """A scalar, [n_elem], `only(...)`, or a prefix pytree of the elements, spread over the groups.

    Returns:
        values: per group floats [n_elem], zero for elements without a value, or None if no element
            of the group has a value.
        chosen: per group the elements that have a value, [n_elem] bool, NumPy.
    """
    values, chosen = [], []
    for group, given in zip(structure.groups, spread(value, structure, name), strict=True):
        n_elem = len(group.links)
        meant = np.full(n_elem, given is not None)
        if isinstance(given, Selection):
            raise ValueError(f"{name}: only(...) has no values here; give only(elements, values)")
        if isinstance(given, Only):
            meant = given.chosen(n_elem, name)
            given = given.spread(np.zeros(n_elem))
        values.append(checks.per_element(given, n_elem, name))
        chosen.append(meant)
    return values, chosen
