"""Names that annotations use. Type checkers and people read them; nothing checks them at run time.

Shapes are written as in jaxtyping: ``Float[Array, "n_node 3"]`` is an array of floats with these
axes, ``#n_elem`` an axis of this length or of length 1, a leading space (``" n_elem"``) has no
meaning and keeps linters from taking one name for Python.
"""

from typing import TYPE_CHECKING, Any, TypeAlias

from jax import Array

if TYPE_CHECKING:
    from jaxtyping import Bool, Float, Int, PyTree
else:  # jaxtyping is a tool of the tests: annotations are text, which nobody evaluates
    Bool = Float = Int = PyTree = Any

ArrayLike: TypeAlias = Any
"""What becomes an array: lists, NumPy's and JAX's arrays, traced ones. A constructor turns it into
one, which type checkers cannot follow; to them it is anything."""

__all__ = ["Array", "ArrayLike", "Bool", "Float", "Int", "PyTree"]
