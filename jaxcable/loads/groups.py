"""The groups, and the elements of a group, that a load along elements acts on."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, ClassVar, Self, TypeAlias

import jax
import jax.numpy as jnp
import numpy as np
from jax.typing import DTypeLike

from ..common import checks
from ..common.selection import Selection
from ..common.tree import Indices, copy_with, index_array, set_fields
from ..common.types import Array, ArrayLike, Bool, Float, Int
from ..common.units import SI, Units
from ..elements.element_state import ElementState
from ..model.result_parts import group_path
from ..model.structure import Structure
from ..programs.joining import add_to_zeros
from .load import Bundles, OnEveryNode, PersistentLoad

Key: TypeAlias = Any
"""Key of a group in the structure's elements: a dict's key or a list's index; None means all
groups. In an analysis, a tuple of indices of groups."""

_ALL = 1.0  # factor of all elements of a group


class OnGroups(PersistentLoad):
    """Base of loads on elements: of all groups, of one group, or of some elements of one group.

    Attributes:
        on: `Key` of the loaded group.
        elements: the loaded elements of this group; None means all.
        varies: (name of the field that may have a value for every element, shape of one value);
            None if no field does.
        element_factors: by index of group, factors of its elements, [n_elem], or of each component
            of their values, [n_elem, ...]; set by the analysis.
    """

    on: Key
    elements: Selection | None = None
    varies: ClassVar[tuple[str, tuple[int, ...]] | None] = None
    element_factors: dict[int, Float[Array, "n_elem ..."]] | None

    def _check_selection(self):
        """Raise ValueError unless `elements` is a `Selection` or None."""
        if self.elements is not None and not isinstance(self.elements, Selection):
            raise ValueError(
                "elements: expected a selection of elements such as only([4, 5]), without values, "
                f"got {type(self.elements).__name__}"
            )

    def _location_text(self):
        """Return a text such as " on guys" with the key of the loaded group; "" in an analysis."""
        return "" if self.on is None or isinstance(self.on, tuple) else f" on {self.on}"

    def describe(self, units: Units = SI) -> str:
        """Return a text for reports: the class of the load and the key of its group."""
        return f"{type(self).__name__}{self._location_text()}"

    def loaded_groups(
        self, structure: Structure
    ) -> tuple[tuple[int, ...], Bool[np.ndarray, " n_elem"] | None]:
        """Return indices of the loaded groups, and a mask of their loaded elements, [n_elem].

        The mask is None if all elements are loaded.

        Raises:
            ValueError: there is no such group or element, or elements of several groups.
        """
        numbers = indices_of_groups(self.on, structure)
        if self.elements is None:
            return numbers, None
        if len(numbers) != 1:
            raise ValueError(
                f"elements: on = {self.on!r} means {len(numbers)} groups; give on=... the group "
                "that has these elements"
            )
        label = f"elements of {group_path(structure, numbers[0])}"
        return numbers, self.elements.element_mask(len(structure.groups[numbers[0]].links), label)

    def _check_value_shape(self, count: int | None = None) -> None:
        """Raise ValueError unless the field named by `varies` has one value, or one per element.

        `count` is the number of elements; None if it is not known yet.
        """
        name, one = self.varies  # type: ignore[misc]  # asked only of loads that have such a field
        value = getattr(self, name)
        if value is None:
            raise ValueError(f"{name}: missing; give {type(self).__name__}({name}=...)")
        values = checks.as_floats(value, name)
        if count is None:
            count = len(values) if values.ndim else 1
        set_fields(self, **{name: checks.floats_of_shape(values, name, one, (count, *one))})

    def _check_value_counts(self, structure: Structure, numbers: tuple[int, ...]) -> None:
        """Raise ValueError unless the field named by `varies` fits the groups `numbers`.

        It has one value, or one for every element of each of these groups (indices).
        """
        name, one = self.varies  # type: ignore[misc]
        for number in numbers:
            count = len(structure.groups[number].links)
            hint = f"; {group_path(structure, number)} has {count} elements"
            checks.floats_of_shape(getattr(self, name), name, one, (count, *one), hint=hint)

    def with_group_indices(self, structure: Structure) -> Self:
        """Return the load in the form of an analysis: `on` becomes indices of groups.

        Which elements are loaded (1 or 0), times the value of each, becomes `element_factors`; a
        field that has had values per element becomes ones.
        """
        numbers, mask = self.loaded_groups(structure)
        load = copy_with(self, on=numbers, elements=None)
        factors: Any = None if mask is None else mask.astype(float)
        if self.varies is not None and numbers:
            name, one = self.varies
            values: Any = getattr(self, name)
            if jnp.ndim(values) > len(one):
                load = copy_with(load, **{name: jnp.ones_like(values[0])})
                factors = values
                if mask is not None:
                    factors = jnp.where(mask.reshape(-1, *(1,) * len(one)), values, 0.0)
        return copy_with(
            load, element_factors=None if factors is None else dict.fromkeys(numbers, factors)
        )

    def on_bundles(self, bundles: Bundles) -> Self:
        """Return the load on bundles (groups evaluated as one) in place of groups.

        `on` becomes the indices of these bundles, and `element_factors` the factors of all
        elements of each bundle in one array: those of its groups, 1 or 0 for groups that
        have none.
        """
        if bundles.are_groups:
            return self
        given = self.element_factors or {}
        spread = bundles.join_values(
            self.on, {number: given.get(number, _ALL) for number in self.on}
        )
        part = {number: factors for number, factors in spread.items() if factors is not _ALL}
        return copy_with(self, on=tuple(spread), element_factors=part or None)

    def with_bundle_indices(self, bundles: Bundles) -> Self:
        """Return the load with indices of bundles in place of groups, but factors as they were."""
        return copy_with(self, on=bundles.containing(self.on))

    def apply_element_factors(
        self,
        number: int,
        amounts: Float[ArrayLike, "n_elem ..."],
        state: ElementState | None = None,
    ) -> Float[Array, "n_elem ..."]:
        """Multiply amounts of a group by factors of its elements; zero for inactive elements.

        `number` is the index of the group (or bundle), `amounts` are loads or lengths, [n_elem,
        ...]; its `state` says which elements are active (None: all).
        """
        if (factors := self._factors_in_group(number)) is not None:
            across = (1,) * (amounts.ndim - factors.ndim)
            amounts = amounts * factors.astype(amounts.dtype).reshape(*factors.shape, *across)
        return amounts if state is None else state.zero_where_absent(amounts)

    def _factors_in_group(self, number):
        """Return the factors of a group's elements, [n_elem, ...]; None if all of them are 1."""
        return None if self.element_factors is None else self.element_factors.get(number)


def indices_of_groups(on: Key, structure: Structure) -> tuple[int, ...]:
    """Return indices of the groups under key `on` of the elements, a tuple; all for None.

    Raises:
        ValueError: there is no such key.
    """
    numbers = structure.arrange(list(range(len(structure.groups))))
    try:
        return tuple(jax.tree.leaves(numbers if on is None else numbers[on]))
    except (KeyError, IndexError, TypeError):
        keys: Any = range(len(numbers)) if isinstance(numbers, list | tuple) else numbers
        known = checks.suggest_names(on, keys) if isinstance(keys, dict | range) else ""
        raise ValueError(f"on = {on!r}: no such key in the structure's elements{known}") from None


def scatter_to_nodes(
    nodes: Indices | Int[Array, " n"],
    parts: Sequence[Float[ArrayLike, "... 3"] | None],
    shape: tuple[int, int],
    dtype: DTypeLike,
) -> OnEveryNode:
    """Scatter vectors to nodes; return an array of `shape`, NumPy unless something is traced.

    Args:
        nodes: node numbers, `Indices` [n] or a traced array; contributions to a node add up.
        parts: (forces, moments) or (displacements, rotations), each [3], [n, 3] or None.
        shape: shape of the result, (n_node, 3 or 6).
        dtype: dtype of the result.
    """
    nodes = index_array(nodes)
    known = [checks.array_if_known(part) for part in parts]
    traced = any(a is None and b is not None for a, b in zip(known, parts, strict=True))
    traced = traced or isinstance(nodes, jax.core.Tracer)
    given = [(x, 3 * k) for k, x in enumerate(parts[: shape[1] // 3]) if x is not None]
    if traced:
        return add_to_zeros(given, nodes, shape=shape, dtype=dtype)
    total = np.zeros(shape, dtype)
    for part, first in given:
        np.add.at(total[:, first : first + 3], nodes, np.full((len(nodes), 3), part, dtype))
    return total


def scatter_to_elements(
    count: int, index: Int[np.ndarray, " n"], values: Float[ArrayLike, "n ..."]
) -> Float[Array | np.ndarray, "n_elem ..."]:
    """Return values [n, ...] at elements `index` of `count`, [n_elem, ...], and zeros elsewhere.

    NumPy unless the values are traced.
    """
    shape = (count, *np.shape(values)[1:])
    if isinstance(values, jax.core.Tracer):
        return jnp.zeros(shape, values.dtype).at[index].set(values)
    found = np.zeros(shape, np.asarray(values).dtype)
    found[index] = np.asarray(values)
    return found


def concatenate_last_axis(
    parts: Sequence[Float[ArrayLike, "... k"]],
) -> Float[Array | np.ndarray, "... n"]:
    """Concatenate arrays along the last axis, by NumPy unless one is traced."""
    return checks.numpy_or_jax(parts).concatenate(parts, axis=-1)
