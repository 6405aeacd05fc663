"""Some elements of a group, and values for them: inputs may differ from cable to cable."""

from __future__ import annotations

from collections.abc import Sequence

import jax
import jax.numpy as jnp
import numpy as np

from . import checks
from .tree import Indices, pytree, set_fields
from .types import ArrayLike, Bool, Float, Int


class _ElementSubset:
    """Base of `Selection` and `Only`: the indices of some elements of one group."""

    elements: Int[ArrayLike, " n"] | Bool[ArrayLike, " n_elem"]
    count: int | None

    def _set_element_indices(self):
        """Check the field `elements` and store it as `Indices`; a boolean mask also sets `count`.

        Raises ValueError for traced values, wrong types or shapes, and repeated elements.
        """
        elements = self.elements
        if isinstance(elements, Indices):
            return
        if any(isinstance(leaf, jax.core.Tracer) for leaf in jax.tree.leaves(elements)):
            raise ValueError(
                "elements: a selection of elements is topology and cannot be traced; pass NumPy "
                "integers or booleans, or trace the values: jnp.where(mask, values, others)"
            )
        mask = checks.as_boolean_mask(elements)
        if mask is not None:
            if mask.ndim != 1:
                raise ValueError(f"elements: expected booleans [n_elem], got shape {mask.shape}")
            set_fields(self, count=len(mask))
            elements = np.flatnonzero(mask)
        elements = checks.as_indices(elements, "elements", things="element")
        if len(np.unique(elements)) < len(elements):
            repeated = np.flatnonzero(np.bincount(elements) > 1)[0]
            raise ValueError(f"elements: element {repeated} is named twice")
        set_fields(self, elements=Indices(elements))

    def element_mask(self, n_elem: int, name: str) -> Bool[np.ndarray, " n_elem"]:
        """Return a NumPy mask [n_elem] that is True for the chosen elements.

        Raises ValueError, which names the argument `name`, if the group has no such element.
        """
        if self.count not in (None, n_elem):
            raise ValueError(
                f"{name}: expected a boolean for each of {n_elem} elements, got {self.count}"
            )
        unknown = self.elements.array >= n_elem
        if unknown.any():
            k = int(unknown.argmax())
            raise ValueError(
                f"{name}: elements[{k}] = {self.elements[k]}: the group has elements 0 to "
                f"{n_elem - 1}"
            )
        chosen = np.zeros(n_elem, bool)
        chosen[self.elements.array] = True
        return chosen


@pytree(static=("count",), indices=("elements",))
class Selection(_ElementSubset):
    """Some elements of one group, such as those that a load acts on.

    The function `only` makes it from elements alone.

    Args:
        elements: numbers of the elements in their group, [n], or booleans [n_elem].
        count: number of elements of the group, if known; set by `elements` that are booleans.

    Raises:
        ValueError: `elements` are traced, are neither integers nor booleans, or repeat an element.
    """

    elements: Int[ArrayLike, " n"] | Bool[ArrayLike, " n_elem"]
    count: int | None = None

    def __post_init__(self):
        self._set_element_indices()


@pytree(static=("count",), indices=("elements",))
class Only(_ElementSubset):
    """Values for some elements of one group, such as the pretension of two cables.

    The function `only` makes it from elements and values.

    Args:
        elements: numbers of the elements in their group, [n], or booleans [n_elem].
        values: one value for all of them, or [n], in the unit of what is stated; [n, n_component]
            for elements of your own that take several numbers each (`Prestressable.components`).
        count: number of elements of the group, if known; set by `elements` that are booleans.

    Raises:
        ValueError: `elements` are traced, neither integers nor booleans, or repeated, or the number
            of values does not fit.
    """

    elements: Int[ArrayLike, " n"] | Bool[ArrayLike, " n_elem"]
    values: Float[ArrayLike, ""] | Float[ArrayLike, " n"] | Float[ArrayLike, "n n_component"]
    count: int | None = None

    def __post_init__(self):
        self._set_element_indices()
        values, count = checks.as_floats(self.values, "values"), len(self.elements)
        if values.ndim < 2 or len(values) != count:  # components are checked by the group
            checks.floats_per_element(values, count, "values")
        # one value for all stays one: a search then has one unknown (`design.tune`)
        set_fields(self, values=values)

    def merged_with(self, others: Float[ArrayLike, " n_elem"]) -> Float[ArrayLike, " n_elem"]:
        """Return an array [n_elem]: the values at the chosen elements, and `others` elsewhere."""
        if checks.numpy_or_jax(self.values, others) is np:
            dtype = jax.dtypes.canonicalize_dtype(np.asarray(self.values).dtype)
            merged = np.array(others, dtype)
            merged[self.elements.array] = np.asarray(self.values)
            return merged
        values = jnp.asarray(self.values)
        return jnp.asarray(others, values.dtype).at[self.elements.array].set(values)


@pytree(static=("names",))
class WholeGroups:
    """Whole groups of elements, named by their keys in ``Structure.elements``.

    Args:
        names: a key, or a list of keys.

    Raises:
        ValueError: no key is given.
    """

    names: str | Sequence[str]

    def __post_init__(self):
        names = (self.names,) if isinstance(self.names, str) else tuple(self.names)
        set_fields(self, names=names)
        if not names:
            raise ValueError("names: an empty list names no group")


def only(
    elements: Int[ArrayLike, " n"] | Bool[ArrayLike, " n_elem"],
    values: Float[ArrayLike, ""] | Float[ArrayLike, " n"] | None = None,
) -> Selection | Only:
    """Choose some elements of a group, with values for them: ``pretension=only([0, 3], 200.0)``.

    Args:
        elements: numbers of the elements in their group, [n], or booleans [n_elem]. They are
            topology and cannot be traced.
        values: one value for all of them, or [n] in the order of `elements`; None for a selection
            without values, as in ``LineLoads(..., elements=only([4, 5]))``.

    Returns:
        `Only`, which can be given wherever a phase or form finding takes values of elements;
        without values a `Selection`.

    Raises:
        ValueError: `elements` are traced, an element is repeated, or the number of values does not
            fit.

    Example:
        >>> stated = jc.only([0, 3], 200.0)
        >>> phase = jc.Phase(pretension=stated)  # the other elements keep their state
        >>> print(stated.merged_with(np.zeros(5)))
        [200.   0.   0. 200.   0.]
        >>> print(jc.only([0, 3]).element_mask(5, "elements"))
        [ True False False  True False]
    """
    return Selection(elements) if values is None else Only(elements, values)
