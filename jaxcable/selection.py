"""Values for some elements of a group only, so that statements can be mixed cable by cable."""

import jax.numpy as jnp
import numpy as np

from . import _check
from ._tree import Indices, pytree


@pytree(static=("count",), indices=("elements",))
class Only:
    """Values for some elements of one group; `only` makes it.

    Args:
        elements: numbers of the elements in their group, [n].
        values: one value for all of them, or [n].
        count: number of elements of the group, if it is known.
    """

    elements: object
    values: object
    count: object = None

    def __post_init__(self):
        if not isinstance(self.elements, Indices):
            elements = _check.integers(self.elements, "elements")
            if len(np.unique(elements)) < len(elements):
                repeated = np.flatnonzero(np.bincount(elements) > 1)[0]
                raise ValueError(f"elements: element {repeated} is named twice")
            object.__setattr__(self, "elements", Indices(elements))
        object.__setattr__(
            self, "values", _check.per_element(self.values, len(self.elements), "values")
        )

    def chosen(self, n_elem, name):
        """Which elements are meant, [n_elem] bool, NumPy; ValueError if there is no such one."""
        if self.count not in (None, n_elem):
            raise ValueError(
                f"{name}: {self.count} booleans say which elements, the group has {n_elem}"
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

    def spread(self, others):
        """The values at their elements and `others`, [n_elem], elsewhere."""
        values = jnp.asarray(self.values)
        return jnp.asarray(others, values.dtype).at[self.elements.array].set(values)


def only(elements, values):
    """Values for some elements of a group: ``Phase(pretension=only([0, 3], 200.0))``.

    Args:
        elements: numbers of the elements in their group, [n], or booleans [n_elem].
        values: one value for all of them, or [n].

    Returns:
        `Only`, which stands for the values wherever a phase or form finding takes some.

    Raises:
        ValueError: an element twice, or as many values as do not fit.

    Example:
        >>> stated = jc.only([0, 3], 200.0)
        >>> phase = jc.Phase(pretension=stated)  # nothing is said of the others
        >>> print(stated.spread(np.zeros(5)))
        [200.   0.   0. 200.   0.]
    """
    count = None
    if not isinstance(elements, Indices):
        elements = np.asarray(elements)
        if elements.dtype == bool:
            elements, count = np.flatnonzero(elements), len(elements)
    return Only(elements, values, count)
