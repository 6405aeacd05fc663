"""The groups, and the elements of a group, that a load along elements acts on."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, Self, TypeAlias

import jax
import jax.numpy as jnp
import numpy as np
from jax.typing import DTypeLike

from ..common import checks
from ..common.selection import Selection
from ..common.tree import Indices, copy, plain
from ..common.types import Array, ArrayLike, Bool, Float, Int
from ..elements.element_state import ElementState
from ..model.structure import Structure
from .load import Acting, Bundles, OnEveryNode

Key: TypeAlias = Any
"""Key of a group in the structure's elements: a dict's key or a list's index; None means all
groups. In an analysis, a tuple of numbers of groups."""

_ALL = 1.0  # factor of all elements of a group


class OnGroups(Acting):
    """A load along elements: of all groups, of one, or of some elements of one.

    Attributes:
        on: `Key` of the loaded group.
        elements: the loaded elements of this group; None means all.
        part: by number of group, factors of its elements, [n_elem]; set by the analysis.
    """

    on: Key
    elements: Selection | None = None
    part: dict[int, Float[Array, " n_elem"]] | None

    def _check_elements(self):
        """Raise ValueError unless `elements` is a selection or None."""
        if self.elements is not None and not isinstance(self.elements, Selection):
            raise ValueError(
                "elements: expected a selection such as only([4, 5]), got "
                f"{type(self.elements).__name__}"
            )

    def selected(
        self, structure: Structure
    ) -> tuple[tuple[int, ...], Bool[np.ndarray, " n_elem"] | None]:
        """Numbers of the loaded groups, and a mask of the loaded elements, [n_elem] bool, NumPy.

        The mask is None if all elements are loaded.

        Raises:
            ValueError: there is no such group or element, or elements of several groups.
        """
        numbers = _chosen(self.on, structure)
        if self.elements is None:
            return numbers, None
        if len(numbers) != 1:
            raise ValueError(
                f"elements: on = {self.on!r} means {len(numbers)} groups; name the one whose "
                "elements these are"
            )
        return numbers, self.elements.chosen(len(structure.groups[numbers[0]].links), "elements")

    def among(self, structure: Structure) -> Self:
        """The load with groups as numbers, and with factors for elements: 1 if loaded, else 0."""
        numbers, mask = self.selected(structure)
        part = None if mask is None else {numbers[0]: mask.astype(float)}
        return copy(self, on=numbers, elements=None, part=part)

    def bundled(self, bundles: Bundles) -> Self:
        """The load, after `among`, on bundles of groups, see `mechanics.bundles`."""
        if bundles.plain:
            return self
        given = self.part or {}
        spread = bundles.spread(self.on, {number: given.get(number, _ALL) for number in self.on})
        part = {number: factors for number, factors in spread.items() if factors is not _ALL}
        return copy(self, on=tuple(spread), part=part or None)

    def touched(self, bundles: Bundles) -> Self:
        """The load with the numbers of the bundles that it acts on."""
        return copy(self, on=bundles.numbers(self.on))

    def partly(
        self,
        number: int,
        amounts: Float[ArrayLike, "n_elem ..."],
        state: ElementState | None = None,
    ) -> Float[Array, "n_elem ..."]:
        """Amounts of the elements of a group, [n_elem, ...], zero where the load is not.

        They are zero where an element is not there, too, if the `state` of the group says so.
        """
        across = -1, *(1,) * (amounts.ndim - 1)
        if self.part is not None and number in self.part:
            amounts = amounts * self.part[number].astype(amounts.dtype).reshape(across)
        return amounts if state is None else state.only_present(amounts)


def _chosen(on, structure):
    """Numbers of the groups that a key of the structure's elements names, a tuple; all if None."""
    numbers = structure.arrange(list(range(len(structure.groups))))
    try:
        return tuple(jax.tree.leaves(numbers if on is None else numbers[on]))
    except (KeyError, IndexError, TypeError):
        keys: Any = range(len(numbers)) if isinstance(numbers, list | tuple) else numbers
        known = checks.meant(on, keys) if isinstance(keys, dict | range) else ""
        raise ValueError(f"on = {on!r}: no such key in the structure's elements{known}") from None


def scattered(
    nodes: Indices | Int[Array, " n"],
    parts: Sequence[Float[ArrayLike, "... 3"] | None],
    shape: tuple[int, int],
    dtype: DTypeLike,
) -> OnEveryNode:
    """Add vectors at their nodes: an array of `shape`, NumPy unless something is traced.

    Args:
        nodes: `Indices` [n], or a traced array.
        parts: vectors for the first three columns of the result and for the last three: one for all
            nodes [3], or one for each [n, 3], or None.
        shape: of the result, [n_node, 3 or 6].
        dtype: of the result.
    """
    nodes = plain(nodes)
    known = [checks.concrete(part) for part in parts]
    traced = any(a is None and b is not None for a, b in zip(known, parts, strict=True))
    traced = traced or isinstance(nodes, jax.core.Tracer)
    total: ArrayLike = jnp.zeros(shape, dtype) if traced else np.zeros(shape, dtype)
    for k, part in enumerate((parts if traced else known)[: shape[1] // 3]):
        if part is None:
            continue
        columns = slice(3 * k, 3 * k + 3)
        if traced:
            values = jnp.broadcast_to(jnp.asarray(part, dtype), (len(nodes), 3))
            total = total.at[nodes, columns].add(values)
        else:
            np.add.at(total[:, columns], nodes, np.full((len(nodes), 3), part, dtype))
    return total
