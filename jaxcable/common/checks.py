"""Argument checks shared by the constructors: types and shapes; `common.rules` checks values."""

from __future__ import annotations

import contextlib
import difflib
import importlib
import sys
import warnings
from collections.abc import Iterable, Iterator, Sequence
from contextvars import ContextVar
from pathlib import Path
from types import FrameType, ModuleType
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np

from .types import ArrayLike, Bool, Float, Int

_PACKAGE = str(Path(__file__).parent.parent)


class InputWarning(UserWarning):
    """Warn of input that is legal but most likely not intended; results are computed all the same.

    ``warnings.simplefilter("ignore", jc.InputWarning)`` silences it, "error" makes it an exception.

    Example:
        >>> import warnings
        >>> with warnings.catch_warnings(record=True) as seen:
        ...     warnings.simplefilter("always")
        ...     law = jc.Polygonal([0, 0.2, 3.0], [0, 4e8, 5e8])
        >>> print(seen[0].category.__name__, seen[0].message)
        InputWarning strain[2] = 3: more than 1; it is a ratio, not a percentage
    """


class UnstableWarning(UserWarning):
    """Warn that an analysis ended in an unstable equilibrium, whose results are returned.

    ``warnings.simplefilter("ignore", jc.UnstableWarning)`` silences it, "error" makes it an
    exception.

    Example:
        A strut that is pushed along its axis by more than the springs at its top can stabilise:

        >>> import warnings
        >>> nodes = [[0.0, 0.0, 0.0], [0.0, 0.0, 1.0], [5.0, 0.0, 1.0], [0.0, 5.0, 1.0]]
        >>> strut = jc.Bars([[0, 1]], axial_stiffness=1e6)
        >>> springs = jc.Bars([[1, 2], [1, 3]], axial_stiffness=50.0)  # 10 N/m each
        >>> structure = jc.Structure(nodes, [strut, springs], jc.pinned([0, 2, 3]))
        >>> push = jc.Phase(loads=jc.NodalLoads([1], (0.0, 0.0, -20.0)))
        >>> with warnings.catch_warnings(record=True) as seen:
        ...     warnings.simplefilter("always")
        ...     solution = jc.solve(structure, push)
        >>> print(solution.status, solution.stable, seen[0].category.__name__)
        0 False UnstableWarning
    """


def warn_user(text: str, kind: type[Warning] = InputWarning) -> None:
    """Issue a warning that points at the user's line of code, the first outside of this package.

    Nothing is issued within `without_warnings`. `kind` is the class of the warning.
    """
    if not _SUSPECTS.get():
        return
    frame: FrameType | None = sys._getframe(1)
    level = 2
    while frame is not None and frame.f_code.co_filename.startswith((_PACKAGE, "<string>")):
        frame, level = frame.f_back, level + 1
    warnings.warn(text, kind, stacklevel=level)


_SUSPECTS: ContextVar[bool] = ContextVar("suspects", default=True)


@contextlib.contextmanager
def without_warnings() -> Iterator[None]:
    """Silence the warnings of `warn_user` in this thread while a ``with`` block runs.

    For work whose warnings are issued elsewhere. Python's own filters would not do: they belong to
    all threads, and two threads that change and restore them at once leave one of the changes
    behind.
    """
    token = _SUSPECTS.set(False)
    try:
        yield
    finally:
        _SUSPECTS.reset(token)


def array_if_known(x: ArrayLike | None) -> np.ndarray | None:
    """Return `x` as a NumPy array if its values are known; None if it is None or traced by jax."""
    return None if x is None or isinstance(x, jax.core.Tracer) else np.asarray(x)


def numpy_or_jax(*values: Any) -> Any:
    """Return the module to compute with: jax.numpy if anything in `values` is traced, else NumPy.

    Known arrays of jax belong to NumPy: jax would compile a program for every small operation.
    """
    traced = any(isinstance(leaf, jax.core.Tracer) for leaf in jax.tree.leaves(values))
    return jnp if traced else np


def as_numpy_if_known(x: ArrayLike) -> ArrayLike:
    """Return an array as one of NumPy, but as it is if it is traced by jax."""
    return x if isinstance(x, jax.core.Tracer) else np.asarray(x)


def as_floats(value: Float[ArrayLike, " ..."], name: str) -> Float[ArrayLike, " ..."]:
    """Return `value` as an array of floats; integers become the default float type.

    Numbers and lists become NumPy arrays, or arrays of jax if the list contains one; arrays of jax
    stay as they are. ValueError, which names the argument `name`, if `value` is not a rectangular
    array of real numbers.
    """
    if isinstance(value, jax.Array):
        array: ArrayLike = value
    elif any(isinstance(leaf, jax.Array) for leaf in jax.tree.leaves(value)):
        array = jnp.asarray(value)  # a list or tuple that may hold tracers
    else:
        try:
            array = np.asarray(value)
        except ValueError as error:
            raise ValueError(f"{name}: not a rectangular array of numbers") from error
    if not (np.issubdtype(array.dtype, np.number) or jnp.issubdtype(array.dtype, jnp.floating)):
        raise ValueError(f"{name}: expected numbers, got {_describe_content(array, value)}")
    if jnp.issubdtype(array.dtype, jnp.complexfloating):
        raise ValueError(f"{name}: expected real numbers, got {array.dtype}")
    if array.dtype == np.longdouble and array.dtype != np.float64:
        raise ValueError(f"{name}: expected float32 or float64, got {array.dtype}")
    if not jnp.issubdtype(array.dtype, jnp.floating):
        array = array.astype(float)
    return array


def _describe_content(array, value):
    """Return, for a message, what an array has instead of numbers: "text", a type or a dtype.

    The array was made of `value`, whose type is named if the array has Python objects.
    """
    if array.dtype.kind in "US":
        return "text"
    return type(value).__name__ if array.dtype == object else array.dtype


def as_scalar(value: Float[ArrayLike, ""], name: str) -> Float[ArrayLike, ""]:
    """Return `value` as an array of floats without axes.

    Raises ValueError, which names the argument `name`, if it has axes or is not a real number.
    """
    number = as_floats(value, name)
    if number.ndim:
        raise ValueError(f"{name}: expected a scalar, got shape {number.shape}")
    return number


def floats_of_shape(
    value: Float[ArrayLike, " ..."], name: str, *shapes: tuple[int, ...], hint: str = ""
) -> Float[ArrayLike, " ..."]:
    """Return `value` as an array of floats, which must have one of the given shapes.

    Raises ValueError, which names the argument `name` and ends with `hint`, for another shape.
    """
    array = as_floats(value, name)
    if array.shape not in shapes:
        words = ["a scalar"] * (() in shapes)
        words += ["shape " + " or ".join(map(str, filter(None, shapes)))] * any(shapes)
        raise ValueError(f"{name}: expected {' or '.join(words)}, got {array.shape}{hint}")
    return array


def require_one_of(value: str, name: str, known: Sequence[str]) -> None:
    """Raise ValueError, which names the argument, unless `value` is one of the words `known`."""
    if not isinstance(value, str) or value not in known:
        raise ValueError(f"{name} = {value!r}: expected one of {', '.join(known)}")


def floats_per_element(
    value: Float[ArrayLike, " n_elem"] | None, n_elem: int, name: str
) -> Float[ArrayLike, " n_elem"] | None:
    """Return one float per element, [n_elem]: a scalar is repeated, and None stays None.

    Raises ValueError, which names the argument `name`, if `value` has another shape.
    """
    if value is None:
        return None
    array = as_floats(value, name)
    if array.shape not in ((), (n_elem,)):
        raise ValueError(
            f"{name}: expected a scalar or shape ({n_elem},), one value per element, "
            f"got shape {array.shape}"
        )
    if array.shape == ():
        if isinstance(array, jax.core.Tracer):
            return jnp.broadcast_to(array, (n_elem,))
        array = np.full(n_elem, np.asarray(array))
    return array


def as_boolean_mask(value: ArrayLike) -> Bool[np.ndarray, " ..."] | None:
    """Return `value` as a NumPy array if all its entries are booleans; None if they are not."""
    try:
        array = np.asarray(value)
    except ValueError:
        return None
    return array if array.dtype == bool else None


def as_indices(
    value: Int[ArrayLike, " ..."], name: str, width: int | None = None, things: str = "node"
) -> Int[np.ndarray, " ..."]:
    """Return indices as a NumPy array of int32, [n], or [n, width] if a `width` is given.

    Raises ValueError, which names the argument `name`, for another shape, for traced values, and
    for entries that are negative or are not integers; `things` is what the indices number.
    """
    if isinstance(value, jax.core.Tracer):
        raise ValueError(f"{name}: indices are topology and cannot be traced; pass NumPy integers")
    try:
        array = np.asarray(value)
    except ValueError as error:
        raise ValueError(f"{name}: not a rectangular array of integers") from error
    if array.dtype != bool and holds_boolean(value):
        raise ValueError(f"{name}: expected integers, got some booleans among them")
    if array.size == 0:
        array = array.astype(np.int32).reshape((0,) if width is None else (0, width))
    if not np.issubdtype(array.dtype, np.integer):
        hint = "; numpy.flatnonzero(mask) gives the indices" if array.dtype == bool else ""
        raise ValueError(f"{name}: expected integers, got {_describe_content(array, value)}{hint}")
    if width is None:
        array = np.atleast_1d(array)
    if array.ndim != (1 if width is None else 2) or (width and array.shape[1] != width):
        shape = "[n]" if width is None else f"[n, {width}]"
        raise ValueError(f"{name}: expected shape {shape}, got {array.shape}")
    for wrong, text in (
        (array < 0, f"{things} numbers start at 0"),
        (array > np.iinfo(np.int32).max, "too large for an index of 32 bits"),
    ):
        if wrong.any():
            index = int(np.argwhere(wrong)[0][0])
            raise ValueError(f"{name}[{index}] = {array[index]}: {text}")
    return array.astype(np.int32)


def require_whole_number(value: Any, name: str, least: int = 1) -> None:
    """Raise ValueError, which names the argument, unless `value` is an integer >= `least`."""
    if isinstance(value, bool) or not isinstance(value, int | np.integer) or value < least:
        raise ValueError(f"{name} = {value!r}: expected a whole number of at least {least}")


def holds_boolean(value: Any) -> bool:
    """Tell whether `value` is a boolean, or a list that contains one at any depth."""
    if isinstance(value, list | tuple):
        return any(holds_boolean(v) for v in value)
    return isinstance(value, bool | np.bool_)


def require_known_nodes(numbers: Int[np.ndarray, " ..."], n_node: int, name: str) -> None:
    """Raise ValueError if any of these node numbers is not a node of the structure.

    Args:
        numbers: indices of nodes, [n] or [n, n_end].
        n_node: number of nodes of the structure.
        name: of the argument, for the message.
    """
    unknown = (numbers >= n_node).reshape(len(numbers), -1 if numbers.size else 0).any(axis=1)
    if unknown.any():
        k = int(unknown.argmax())
        hint = ""
        if numbers.max() == n_node and numbers.min() > 0:
            hint = "; they seem to be numbered from 1: node numbers start at 0, subtract 1"
        raise ValueError(
            f"{name}[{k}] = {numbers[k].tolist()}: the structure has nodes 0 to {n_node - 1}{hint}"
        )


def import_library(name: str, what: str, extra: str) -> ModuleType:
    """Import and return a library; raise ValueError if it is not installed.

    `what` says what needs it, and `extra` is the extra of this package that installs it; the
    message has both.
    """
    try:
        return importlib.import_module(name)
    except ImportError:
        raise ValueError(f"{what}: needs {name}; pip install 'jaxcable[{extra}]'") from None


def describe_type(thing: object, example: str) -> str:
    """Return how an error message names an object of a wrong type: by the name of its type.

    For a class that was given in place of an object it says to call the class, as in `example`.
    """
    if isinstance(thing, type):
        return f"the class {thing.__name__} itself; call it, as in {example}"
    return type(thing).__name__


def suggest_names(name: object, names: Iterable[object]) -> str:
    """Return the end of a message on an unknown name: the known names and the most similar one."""
    known = list(names)
    near = difflib.get_close_matches(str(name), [str(one) for one in known], n=1)
    hint = f"; did you mean {near[0]!r}?" if near else ""
    return f"; there are {', '.join(map(repr, known)) or 'none'}{hint}"
