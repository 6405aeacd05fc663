"""Numbers of members, such as diameters: one for all elements of a load, or one for each."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Any, TypeVar

import numpy as np

from ..common import checks
from ..common.tree import copy_with, set_fields
from ..model.result_parts import group_path
from ..model.structure import Structure

OwnLoad = TypeVar("OwnLoad", bound=Any)


def check_member_values(load: Any, names: Sequence[str]) -> None:
    """Convert the fields `names` of a load to floats, a scalar or [n_elem]; None stays None.

    Raises ValueError for other shapes, and for fields with different numbers of elements.
    """
    counts = {}
    for name in names:
        if getattr(load, name) is None:
            continue
        values = checks.as_floats(getattr(load, name), name)
        if values.ndim > 1:
            raise ValueError(f"{name}: expected a scalar or shape [n_elem], got {values.shape}")
        set_fields(load, **{name: values})
        if values.ndim:
            counts[name] = len(values)
    if len(set(counts.values())) > 1:
        given = ", ".join(f"{name} [{count}]" for name, count in counts.items())
        raise ValueError(f"{', '.join(counts)}: have different numbers of elements: {given}")


def require_members(load: Any, structure: Structure, names: Sequence[str] = ()) -> None:
    """Raise ValueError unless the loaded groups have lengths, and the fields `names` fit them."""
    numbers, _ = load.loaded_groups(structure)
    without = [number for number in numbers if not structure.groups[number].has_length]
    if without and (load.on is not None or len(without) == len(numbers)):
        path, kind = group_path(structure, without[0]), type(structure.groups[without[0]])
        raise ValueError(
            f"on = {load.on!r}: {path} ({kind.__name__}) has no length to load; "
            "loads per length act along cables, bars, beams and catenaries"
        )
    members = [number for number in numbers if number not in without]
    for name in names:
        values = getattr(load, name)
        if values is None or not np.ndim(values):
            continue
        if len(members) != 1:
            raise ValueError(
                f"{name}: has a value for each element, but on = {load.on!r} means {len(members)} "
                "groups; name one group by on, in a load for each group"
            )
        count = len(structure.groups[members[0]].links)
        hint = f"; {group_path(structure, members[0])} has {count} elements"
        checks.floats_of_shape(values, name, (count,), hint=hint)


def with_member_factors(
    load: OwnLoad, structure: Structure, names: Sequence[str], product: Callable[[Any], Any]
) -> OwnLoad:
    """Return a load whose `element_factors` are multiplied by a product of its members' numbers.

    The fields `names` become scalars, by which the analysis knows whether they keep their rules:
    the smallest of their values. Loads of one kind thus have the same shapes.

    Args:
        load: load in the form of an analysis (`OnGroups.with_group_indices`).
        structure: the `Structure`.
        names: names of the fields that may have a value for each element.
        product: function of the load that returns what its elements are multiplied by, a scalar or
            [n_elem].
    """
    given = {name: getattr(load, name) for name in names if getattr(load, name) is not None}
    pack = checks.numpy_or_jax(given)
    values = {name: checks.as_numpy_if_known(value) for name, value in given.items()}
    amounts = product(copy_with(load, **values))
    factors = {}
    for number in load.on:
        chosen = None if load.element_factors is None else load.element_factors[number]
        own = pack.broadcast_to(amounts, (len(structure.groups[number].links),))
        factors[number] = own if chosen is None else pack.where(chosen != 0, own, 0.0)
    smallest = {name: pack.min(value) for name, value in values.items()}
    return copy_with(load, element_factors=factors, **smallest)
