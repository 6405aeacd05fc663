"""Argument checks shared by the constructors: types and shapes; `common.rules` checks values."""

from __future__ import annotations

import contextlib
import difflib
import sys
import warnings
from collections.abc import Iterable, Iterator, Sequence
from contextvars import ContextVar
from pathlib import Path
from types import FrameType
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np

from .types import ArrayLike, Bool, Float, Int

_PACKAGE = str(Path(__file__).parent.parent)


class InputWarning(UserWarning):
    """Input that is legal but most likely not intended; the results are computed all the same.

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
    """An analysis ended in an unstable equilibrium; its results are those of this state.

    It is silenced, or made an exception, in the same way as `InputWarning`.

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


def suspect(text: str, kind: type[Warning] = InputWarning) -> None:
    """Issue a warning that points at the line of the caller outside of this package."""
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
    """Issue no warnings of this package in this thread: they have been issued, or will be.

    Filters of `warnings` belong to all threads: two that change and restore them at once leave the
    filters of one of them behind.
    """
    token = _SUSPECTS.set(False)
    try:
        yield
    finally:
        _SUSPECTS.reset(token)


def concrete(x: ArrayLike | None) -> np.ndarray | None:
    """Return `x` as a NumPy array; None if it is None, or while it is being traced."""
    return None if x is None or isinstance(x, jax.core.Tracer) else np.asarray(x)


def floats(value: Float[ArrayLike, " ..."], name: str) -> Float[ArrayLike, " ..."]:
    """Return `value` as an array of floats; integers become the default float type."""
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
        raise ValueError(f"{name}: expected numbers, got {_contents(array, value)}")
    if jnp.issubdtype(array.dtype, jnp.complexfloating):
        raise ValueError(f"{name}: expected real numbers, got {array.dtype}")
    if array.dtype == np.longdouble and array.dtype != np.float64:
        raise ValueError(f"{name}: expected float32 or float64, got {array.dtype}")
    if not jnp.issubdtype(array.dtype, jnp.floating):
        array = array.astype(float)
    return array


def _contents(array, value):
    """What an array made of `value` holds, for messages."""
    if array.dtype.kind in "US":
        return "text"
    return type(value).__name__ if array.dtype == object else array.dtype


def scalar(value: Float[ArrayLike, ""], name: str) -> Float[ArrayLike, ""]:
    """Return `value` as a float; ValueError for an array with axes."""
    number = floats(value, name)
    if number.ndim:
        raise ValueError(f"{name}: expected a scalar, got shape {number.shape}")
    return number


def shaped(
    value: Float[ArrayLike, " ..."], name: str, *shapes: tuple[int, ...], hint: str = ""
) -> Float[ArrayLike, " ..."]:
    """Return `value` as floats; ValueError unless it has one of the shapes, () for a scalar."""
    array = floats(value, name)
    if array.shape not in shapes:
        words = ["a scalar"] * (() in shapes)
        words += ["shape " + " or ".join(str(shape) for shape in shapes if shape)]
        raise ValueError(f"{name}: expected {' or '.join(words)}, got {array.shape}{hint}")
    return array


def one_of(value: str, name: str, known: Sequence[str]) -> None:
    """Raise ValueError unless `value` is one of the known words."""
    if value not in known:
        raise ValueError(f"{name} = {value!r}: expected one of {', '.join(known)}")


def per_element(
    value: Float[ArrayLike, " n_elem"] | None, n_elem: int, name: str
) -> Float[ArrayLike, " n_elem"] | None:
    """Return `value` (scalar or [n_elem]) as floats [n_elem]; None stays None."""
    if value is None:
        return None
    array = floats(value, name)
    if array.shape not in ((), (n_elem,)):
        raise ValueError(
            f"{name}: expected a scalar or shape ({n_elem},), one value per element, "
            f"got shape {array.shape}"
        )
    if array.shape == ():
        if isinstance(array, jax.Array):
            return jnp.broadcast_to(array, (n_elem,))
        array = np.full(n_elem, array)
    return array


def mask(value: ArrayLike) -> Bool[np.ndarray, " ..."] | None:
    """Return `value` as a NumPy array if it is one of booleans or a list of booleans; else None."""
    try:
        array = np.asarray(value)
    except ValueError:
        return None
    return array if array.dtype == bool else None


def integers(
    value: Int[ArrayLike, " ..."], name: str, width: int | None = None, things: str = "node"
) -> Int[np.ndarray, " ..."]:
    """Return `value`, numbers of `things`, as a NumPy array of int32, [n] or [n, width]."""
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
        hint = "; numpy.flatnonzero makes them of booleans" if array.dtype == bool else ""
        raise ValueError(f"{name}: expected integers, got {_contents(array, value)}{hint}")
    if width is None:
        array = np.atleast_1d(array)
    if array.ndim != (1 if width is None else 2) or (width and array.shape[1] != width):
        shape = "[n]" if width is None else f"[n, {width}]"
        raise ValueError(f"{name}: expected shape {shape}, got {array.shape}")
    for wrong, text in (
        (array < 0, f"{things} numbers start at 0"),
        (array > np.iinfo(np.int32).max, "a number of 32 bits is expected"),
    ):
        if wrong.any():
            index = int(np.argwhere(wrong)[0][0])
            raise ValueError(f"{name}[{index}] = {array[index]}: {text}")
    return array.astype(np.int32)


def whole(value: Any, name: str, least: int = 1) -> None:
    """Raise ValueError unless `value` is a whole number of at least `least`."""
    if isinstance(value, bool) or not isinstance(value, int | np.integer) or value < least:
        raise ValueError(f"{name} = {value!r}: expected a whole number of at least {least}")


def holds_boolean(value: Any) -> bool:
    """Whether a list, at any depth, contains a boolean, which NumPy would take as 0 or 1."""
    if isinstance(value, list | tuple):
        return any(holds_boolean(v) for v in value)
    return isinstance(value, bool | np.bool_)


def known(numbers: Int[np.ndarray, " ..."], n_node: int, name: str) -> None:
    """Raise ValueError naming the first of `numbers`, [n] or [n, n_end], that is not a node."""
    unknown = (numbers >= n_node).reshape(len(numbers), -1 if numbers.size else 0).any(axis=1)
    if unknown.any():
        k = int(unknown.argmax())
        hint = ""
        if numbers.max() == n_node and numbers.min() > 0:
            hint = "; they seem to be numbered from 1: node numbers start at 0, subtract 1"
        raise ValueError(
            f"{name}[{k}] = {numbers[k].tolist()}: the structure has nodes 0 to {n_node - 1}{hint}"
        )


def kind(thing: object, example: str) -> str:
    """The kind of `thing` for an error message; for a class, with the advice to call it."""
    if isinstance(thing, type):
        return f"the class {thing.__name__} itself; call it, as in {example}"
    return type(thing).__name__


def meant(name: object, names: Iterable[object]) -> str:
    """The end of a message on an unknown name: the known names, and the one most like it."""
    known = list(names)
    near = difflib.get_close_matches(str(name), [str(one) for one in known], n=1)
    hint = f"; did you mean {near[0]!r}?" if near else ""
    return f"; there are {', '.join(map(repr, known)) or 'none'}{hint}"
