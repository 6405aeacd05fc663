"""Names for annotations, for readers and type checkers; nothing checks them at run time.

Shapes are written as in jaxtyping: ``Float[Array, "n_node 3"]`` is an array of floats with these
axes, and ``#n_elem`` is an axis of this length or of length 1. A leading space (``" n_elem"``) has
no meaning; it keeps linters from taking a single name for Python.
"""

from typing import TYPE_CHECKING, Any, TypeAlias

from jax import Array

if TYPE_CHECKING:
    from jaxtyping import Bool, Float, Int, PyTree
else:  # jaxtyping is installed for tests only: annotations are text that is never evaluated
    Bool = Float = Int = PyTree = Any

ArrayLike: TypeAlias = Any
"""A value that can become an array: lists, arrays of NumPy and JAX, traced arrays. Constructors
convert it to an array, which type checkers cannot follow: to them it is `Any`."""

__all__ = ["Array", "ArrayLike", "Bool", "Float", "Int", "PyTree"]
