"""Bundles: element groups that differ in numbers only, evaluated as one group.

A user may define many groups; a program contains every kind of element once. Groups of one class,
whose laws or sections are of one kind, are joined before the compiled core, in their order. Results
are split into the user's groups at the end.
"""

from __future__ import annotations

import dataclasses
import functools
from collections.abc import Collection, Mapping, Sequence
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np

from ..common.tree import Indices, PerElement, copy_with
from ..common.types import Array, ArrayLike, Float, PyTree
from ..elements.element import Element
from ..programs.joining import concatenate
from ..sections import Section, padding

_NEUTRAL_VALUES = {"weight": 0.0, "expansion": 0.0}
"""Values without effect, for groups without these numbers in a bundle that has them."""


class Bundles(NamedTuple):
    """Which groups are evaluated together (a bundle); hashable, static in a program.

    Attributes:
        group_indices: indices of the groups of every bundle, in ascending order.
        sizes: number of elements of every group.
    """

    group_indices: tuple[tuple[int, ...], ...]
    sizes: tuple[int, ...]

    @classmethod
    def from_groups(cls, groups: Sequence[Element]) -> Bundles:
        """Find which element groups differ in numbers only, and put them into one bundle."""
        found = {}
        for number, group in enumerate(groups):
            found.setdefault(_key_of_joinable_groups(group, number), []).append(number)
        members = tuple(tuple(numbers) for numbers in found.values())
        return cls(members, tuple(len(group.links) for group in groups))

    @property
    def are_groups(self) -> bool:
        """Whether no groups are joined: every bundle is one group, in the order of the groups."""
        return len(self.group_indices) == len(self.sizes)

    def join_groups(self, groups: list[Element]) -> list[Element]:
        """Return one element group for every bundle, with the elements of all its groups."""
        return (
            groups
            if self.are_groups
            else [_join_groups([groups[k] for k in numbers]) for numbers in self.group_indices]
        )

    def join(self, per_group: Any) -> list[PyTree[Float[Array, "n_elem ..."]]]:
        """Concatenate pytrees of arrays [n_elem, ...], one per group, to one per bundle."""
        if self.are_groups:
            return per_group

        def one(*parts):
            return parts[0] if len(parts) == 1 else concatenate(parts)

        return [
            jax.tree.map(one, *(per_group[k] for k in numbers)) for numbers in self.group_indices
        ]

    def split(self, per_bundle: Any, axis: int = 0) -> list[PyTree[Float[Array, "n_elem ..."]]]:
        """Split pytrees of arrays, one per bundle with elements on `axis`, into one per group."""
        if self.are_groups:
            return per_bundle
        found: list[Any] = [None] * len(self.sizes)
        for numbers, whole in zip(self.group_indices, per_bundle, strict=True):
            start = 0
            for k in numbers:
                count = self.sizes[k]
                found[k] = jax.tree.map(
                    lambda x, start=start, count=count: _slice(x, start, count, axis), whole
                )
                start += count
        return found

    def containing(self, on: Collection[int]) -> tuple[int, ...]:
        """Return the indices of bundles with any of the groups `on`, given by index; ascending."""
        return tuple(b for b, numbers in enumerate(self.group_indices) if set(numbers) & set(on))

    def join_values(
        self,
        on: Collection[int],
        values: Mapping[int, Float[ArrayLike, "n_elem ..."]],
        fill: float = 0.0,
    ) -> dict[int, Float[ArrayLike, "n_elem ..."]]:
        """Join values of groups, [n_elem, ...] or scalars, to values of bundles.

        Args:
            on: indices of groups.
            values: values by index of a group.
            fill: value of the other groups in these bundles.

        Returns:
            Values by index of a bundle; a scalar where all of its groups have the same scalar.
        """
        found = {}
        for b in self.containing(on):
            given = [values.get(k, fill) for k in self.group_indices[b]]
            if all(x is given[0] for x in given) and np.ndim(given[0]) == 0:
                found[b] = given[0]
                continue
            sizes = [self.sizes[k] for k in self.group_indices[b]]
            each = max((np.shape(x)[1:] for x in given), key=len)  # components of values
            parts = [_broadcast(x, (n, *each)) for x, n in zip(given, sizes, strict=True)]
            found[b] = concatenate(parts)
        return found


def _key_of_joinable_groups(group, index):
    """Return a hashable key of a group, which is equal for groups that are joined to one bundle.

    It has all but numbers: class, static fields, shapes, which fields are None. The `index` of the
    group is part of it if the group has arrays of indices besides its links.
    """
    key = [type(group)]
    for field in dataclasses.fields(group):
        value = getattr(group, field.name)
        if field.name == "links":
            key.append(value.shape[1:])
        elif field.name in group.per_element:
            key.append(value is None and field.name not in _NEUTRAL_VALUES)
        elif field.name in group._static_fields:
            key.append(value)
        elif field.name in group._index_fields:
            # the index of the group makes its key unique: groups with such an array are not bundled
            key.append(None if value is None else index)
        elif isinstance(value, Section):
            key.append(padding.padding_key(value))
        else:
            leaves, shape = jax.tree.flatten(value)
            key.append((shape, tuple(map(np.shape, leaves))))
    return tuple(key)


def _join_groups(groups):
    """Return one group with the elements of several groups of equal `_key_of_joinable_groups`."""
    first = groups[0]
    if len(groups) == 1:
        return first
    sizes, changes = [len(group.links) for group in groups], {}
    for field in dataclasses.fields(first):
        values = [getattr(group, field.name) for group in groups]
        if field.name == "links":
            changes["links"] = _join_links(tuple(values))
        elif field.name in first.per_element:
            if any(value is not None for value in values):
                fill = _NEUTRAL_VALUES.get(field.name)
                pairs = zip(values, sizes, strict=True)
                changes[field.name] = concatenate(
                    [np.full(n, fill) if x is None else x for x, n in pairs]
                )
        elif field.name not in first._static_fields:
            changes[field.name] = _join_values(values, sizes)
    return copy_with(first, **changes)


@functools.lru_cache(maxsize=64)
def _join_links(links):
    """Concatenate the node indices of the elements of several groups; cached."""
    return Indices(np.concatenate([indices.array for indices in links]))


def _join_values(values, sizes):
    """Join a field, such as a law, of several groups: one common value, or `PerElement` values.

    `values` has the field of each group, `sizes` the number of its elements.
    """
    if isinstance(values[0], Section):
        values = padding.pad_to_equal(values)
    leaves = [jax.tree.leaves(value) for value in values]
    if all(a is b for others in leaves for a, b in zip(leaves[0], others, strict=True)):
        return values[0]

    def one(*parts):
        return concatenate([_repeat_for_elements(x, n) for x, n in zip(parts, sizes, strict=True)])

    return PerElement(jax.tree.map(one, *values))


def _repeat_for_elements(x, count):
    """Broadcast an array to `count` elements, [count, ...], without a copy."""
    return _broadcast(x, (count, *np.shape(x)))


def _slice(x, start, count, axis):
    """Return `count` entries of an array along an axis, from index `start`; `x` if they are all."""
    if x.shape[axis] == count:
        return x
    return x[(*(slice(None),) * axis, slice(start, start + count))]


def _broadcast(x, shape):
    """Broadcast an array to a shape, without a copy unless it is traced."""
    pack = jnp if isinstance(x, jax.core.Tracer) else np
    return pack.broadcast_to(x, shape)
