"""Some elements of a group, and values for them, so that statements are mixed cable by cable."""

from __future__ import annotations

import jax
import jax.numpy as jnp
import numpy as np

from . import checks
from .tree import Indices, pytree
from .types import Array, ArrayLike, Bool, Float, Int


@pytree(static=("count",), indices=("elements",))
class Selection:
    """Some elements of one group; `only` without values makes it.

    Args:
        elements: numbers of the elements in their group, [n], or booleans [n_elem].
        count: number of elements of the group, if it is known.

    Raises:
        ValueError: `elements` traced, no integers or booleans, or one of them twice.
    """

    elements: Int[ArrayLike, " n"] | Bool[ArrayLike, " n_elem"]
    count: int | None = None

    def __post_init__(self):
        _number(self)

    def chosen(self, n_elem: int, name: str) -> Bool[np.ndarray, " n_elem"]:
        """Which elements are meant, [n_elem] bool, NumPy; ValueError if there is no such one."""
        return _chosen(self, n_elem, name)


@pytree(static=("count",), indices=("elements",))
class Only:
    """Values for some elements of one group; `only` makes it.

    Args:
        elements: numbers of the elements in their group, [n], or booleans [n_elem].
        values: one value for all of them, or [n].
        count: number of elements of the group, if it is known.

    Raises:
        ValueError: those of `Selection`, or as many values as do not fit.
    """

    elements: Int[ArrayLike, " n"] | Bool[ArrayLike, " n_elem"]
    values: Float[ArrayLike, " n"]
    count: int | None = None

    def __post_init__(self):
        _number(self)
        object.__setattr__(
            self, "values", checks.per_element(self.values, len(self.elements), "values")
        )

    def chosen(self, n_elem: int, name: str) -> Bool[np.ndarray, " n_elem"]:
        """Which elements are meant, [n_elem] bool, NumPy; ValueError if there is no such one."""
        return _chosen(self, n_elem, name)

    def spread(self, others: Float[ArrayLike, " n_elem"]) -> Float[Array, " n_elem"]:
        """The values at their elements and `others`, [n_elem], elsewhere."""
        values = jnp.asarray(self.values)
        return jnp.asarray(others, values.dtype).at[self.elements.array].set(values)


def only(
    elements: Int[ArrayLike, " n"] | Bool[ArrayLike, " n_elem"],
    values: Float[ArrayLike, " n"] | None = None,
) -> Selection | Only:
    """Some elements of a group, and values for them: ``Phase(pretension=only([0, 3], 200.0))``.

    Args:
        elements: numbers of the elements in their group, [n], or booleans [n_elem]; NumPy, since
            which elements are meant is topology: what is traced has no numbers yet.
        values: one value for all of them, or [n] in the order of `elements`; without values it is
            a selection, as ``LineLoads(..., elements=only([4, 5]))`` takes it.

    Returns:
        `Only`, which stands for the values wherever a phase or form finding takes some; without
        values a `Selection`.

    Raises:
        ValueError: `elements` traced, an element twice, or as many values as do not fit.

    Example:
        >>> stated = jc.only([0, 3], 200.0)
        >>> phase = jc.Phase(pretension=stated)  # nothing is said of the others
        >>> print(stated.spread(np.zeros(5)))
        [200.   0.   0. 200.   0.]
        >>> print(jc.only([0, 3]).chosen(5, "elements"))
        [ True False False  True False]
    """
    return Selection(elements) if values is None else Only(elements, values)


def _number(own):
    """Put the numbers of the elements into `own`, and with booleans how many these are."""
    if isinstance(own.elements, Indices):
        return
    if any(isinstance(leaf, jax.core.Tracer) for leaf in jax.tree.leaves(own.elements)):
        raise ValueError(
            "elements: which elements are meant is topology and cannot be traced; pass NumPy "
            "integers or booleans, or trace the values: jnp.where(mask, values, others)"
        )
    elements = own.elements
    mask = checks.mask(elements)
    if mask is not None:
        if mask.ndim != 1:
            raise ValueError(f"elements: expected booleans [n_elem], got shape {mask.shape}")
        object.__setattr__(own, "count", len(mask))
        elements = np.flatnonzero(mask)
    elements = checks.integers(elements, "elements", things="element")
    if len(np.unique(elements)) < len(elements):
        repeated = np.flatnonzero(np.bincount(elements) > 1)[0]
        raise ValueError(f"elements: element {repeated} is named twice")
    object.__setattr__(own, "elements", Indices(elements))


def _chosen(own, n_elem, name):
    if own.count not in (None, n_elem):
        raise ValueError(f"{name}: {own.count} booleans say which elements, the group has {n_elem}")
    unknown = own.elements.array >= n_elem
    if unknown.any():
        k = int(unknown.argmax())
        raise ValueError(
            f"{name}: elements[{k}] = {own.elements[k]}: the group has elements 0 to {n_elem - 1}"
        )
    chosen = np.zeros(n_elem, bool)
    chosen[own.elements.array] = True
    return chosen
