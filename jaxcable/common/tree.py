"""Frozen dataclasses as pytrees, with topology kept apart from numbers.

Numbers (coordinates, stiffness, loads) are leaves; topology (which node, which support) is
static metadata in an `Indices`, hashed by digest. Before the compiled core is entered `thaw`
takes the index arrays out of the metadata and hands them over as arguments, so that two nets
of equal shape share one compilation and no index array becomes a constant of a program.
"""

from __future__ import annotations

import dataclasses
import hashlib
import typing
from collections.abc import Callable, Sequence
from typing import Any, TypeVar

import jax
import jax.numpy as jnp
import numpy as np

from .types import Array, ArrayLike, Bool, Float, Int, PyTree

_T = TypeVar("_T")


class Indices:
    """An immutable NumPy array of integers or booleans that can be static pytree metadata.

    Compares and hashes by content, so that equal topologies are equal cache keys.
    """

    __slots__ = ("_digest", "array")

    def __init__(self, array: Int[ArrayLike, " ..."] | Bool[ArrayLike, " ..."]):
        array = np.array(array)
        array.setflags(write=False)
        self.array: np.ndarray = array
        self._digest = hashlib.blake2b(
            repr((array.shape, array.dtype.str)).encode() + array.tobytes(), digest_size=16
        ).digest()

    @property
    def shape(self) -> tuple[int, ...]:
        """Shape of the array."""
        return self.array.shape

    def __len__(self) -> int:
        return len(self.array)

    def __getitem__(self, key: Any) -> Any:
        return self.array[key]

    def __array__(self, dtype: Any = None, copy: bool | None = None) -> np.ndarray:
        return np.array(self.array, dtype=dtype)

    def __hash__(self) -> int:
        return hash(self._digest)

    def __eq__(self, other: object) -> bool:
        return isinstance(other, Indices) and self._digest == other._digest

    def __repr__(self) -> str:
        return f"Indices{self.array.shape}"


@dataclasses.dataclass(frozen=True)
class _Slot:
    """Stands in a thawed object for the index array of this number."""

    number: int


@typing.dataclass_transform(frozen_default=True, eq_default=False)
def pytree(cls: Any = None, *, static: Sequence[str] = (), indices: Sequence[str] = ()) -> Any:
    """Make `cls` a frozen dataclass and a pytree; `static` and `indices` fields are metadata.

    Unlike `jax.tree_util.register_dataclass`, unflattening does not run `__post_init__`:
    constructors may validate values, while transformations may put any leaf in a field.
    """
    if cls is None:
        return lambda c: pytree(c, static=static, indices=indices)
    cls = dataclasses.dataclass(frozen=True, eq=False)(cls)
    meta = tuple(static) + tuple(indices)
    data = tuple(f.name for f in dataclasses.fields(cls) if f.name not in meta)
    cls._index_fields = tuple(indices)
    cls._static_fields = tuple(static)

    def flatten(obj):
        return [getattr(obj, n) for n in data], tuple(getattr(obj, n) for n in meta)

    def flatten_with_keys(obj):
        children, aux = flatten(obj)
        return [(jax.tree_util.GetAttrKey(n), c) for n, c in zip(data, children, strict=True)], aux

    def unflatten(aux, children):
        obj = object.__new__(cls)
        for name, value in zip(data + meta, (*children, *aux), strict=True):
            object.__setattr__(obj, name, value)
        return obj

    jax.tree_util.register_pytree_with_keys(cls, flatten_with_keys, unflatten, flatten)
    return cls


def copy(obj: _T, **changes: Any) -> _T:
    """Copy a `pytree` object with some fields changed, without running its constructor."""
    new = object.__new__(type(obj))
    for field in dataclasses.fields(obj):  # type: ignore[arg-type]  # whatever `pytree` has made
        object.__setattr__(new, field.name, changes.get(field.name, getattr(obj, field.name)))
    return new


@pytree
class Each:
    """An object of one kind for every element; the leaves have a leading axis, [n_elem].

    It stands in an element group where its elements share one object otherwise: a law, a section.

    Attributes:
        every: all of these objects as one.
    """

    every: PyTree[Float[Array, "n_elem ..."]]


def kind(obj: Any) -> Any:
    """What has the static members of an object that elements share, or have one each (`Each`)."""
    return obj.every if isinstance(obj, Each) else obj


def changed(function: Callable[[Any], Any], obj: Any) -> Any:
    """``function(obj)``; of `Each`, that of every one."""
    return Each(jax.vmap(function)(obj.every)) if isinstance(obj, Each) else function(obj)


def replace(obj: _T, **changes: Any) -> _T:
    """A copy of a structure, group, phase or load with some fields changed; its checks run again.

    Args:
        obj: what is copied.
        changes: new values by the names of its fields.

    Returns:
        An object of the same type.

    Raises:
        ValueError: no such field, or those of the constructor.

    Example:
        >>> structure, phases = jc.scenes.flat_net()
        >>> lifted = jc.replace(structure, nodes=structure.nodes + np.array([[0.0, 0.0, 5.0]]))
        >>> print(structure.nodes[0], lifted.nodes[0])
        [0.4 0.  0. ] [0.4 0.  5. ]
        >>> jc.replace(phases[1], increments=4).increments
        4
    """
    fields = dataclasses.fields(obj)  # type: ignore[arg-type]  # as in `copy`
    unknown = set(changes) - {f.name for f in fields if f.init}
    if unknown:
        raise ValueError(f"replace: {type(obj).__name__} has no field {sorted(unknown)[0]!r}")
    return dataclasses.replace(obj, **changes)  # type: ignore[type-var]


def _holds_indices(obj):
    return bool(getattr(type(obj), "_index_fields", ()))


def plain(indices: Indices | Int[ArrayLike, " ..."]) -> Int[ArrayLike, " ..."]:
    """The array of `Indices`, or of what has taken their place (`thaw`)."""
    return indices.array if isinstance(indices, Indices) else indices


def places(array: Int[ArrayLike, " ..."]) -> Int[np.ndarray, " ..."]:
    """An index array as places in another one: unsigned, so that no program asks for negative ones.

    Only integers that are none are changed; what is not an integer stays as it is.
    """
    array = np.asarray(array)
    if array.dtype.kind != "i" or (array < 0).any():
        return array
    return array.astype(np.uint32)


def thaw(tree: _T) -> tuple[_T, list[Int[ArrayLike, " ..."]]]:
    """Split `tree` into (the same tree with slots for its indices, list of index arrays).

    These may be there in the place of `Indices` already, by `fill`.
    """
    arrays = []

    def visit(obj):
        if not _holds_indices(obj):
            return obj
        slots = {}
        for name in obj._index_fields:
            value = getattr(obj, name)
            if value is not None:
                slots[name] = _Slot(len(arrays))
                arrays.append(places(value.array) if isinstance(value, Indices) else value)
        return copy(obj, **slots)

    return jax.tree.map(visit, tree, is_leaf=_holds_indices), arrays


def cast(tree: _T, dtype: Any) -> _T:
    """A tree of arrays whose floats have this dtype, as exact as the nodes of a structure."""

    def one(x):
        x = jnp.asarray(x)
        return x.astype(dtype) if jnp.issubdtype(x.dtype, jnp.floating) else x

    return jax.tree.map(one, tree)


def fill(tree: _T, arrays: Sequence[Int[ArrayLike, " ..."]]) -> _T:
    """Undo `thaw`, putting (possibly traced) arrays where the slots are."""

    def visit(obj):
        if not _holds_indices(obj):
            return obj
        values = {n: getattr(obj, n) for n in obj._index_fields}
        return copy(obj, **{n: arrays[v.number] for n, v in values.items() if isinstance(v, _Slot)})

    return jax.tree.map(visit, tree, is_leaf=_holds_indices)


def stacked(trees: Sequence[_T]) -> _T:
    """One tree of equal ones, their leaves stacked: by NumPy unless they are being traced."""

    def one(*leaves):
        traced = any(isinstance(x, jax.core.Tracer) for x in leaves)
        return jnp.stack(leaves) if traced else np.stack([np.asarray(x) for x in leaves])

    return jax.tree.map(one, *trees)


def where(condition: Bool[ArrayLike, ""], new: _T, old: _T) -> _T:
    """`new` where the condition holds, else `old`; pytrees."""
    return jax.tree.map(lambda a, b: jnp.where(condition, a, b), new, old)


def joined(arrays: Sequence[ArrayLike]) -> ArrayLike:
    """Arrays one after the other: by NumPy unless they are traced, or on another device."""
    if all(isinstance(x, np.ndarray) or _at_hand(x) for x in arrays):
        return np.concatenate([np.asarray(x) for x in arrays])
    return jnp.concatenate([jnp.asarray(x) for x in arrays])


def _at_hand(x):
    """Whether a `jax.Array` is known, and in the memory of the host."""
    if not isinstance(x, jax.Array) or isinstance(x, jax.core.Tracer):
        return False
    return len(x.devices()) == 1 and next(iter(x.devices())).platform == "cpu"


def computed(function: Callable[[Any, Any], Any], x: ArrayLike) -> ArrayLike:
    """``function(numpy, x)`` of a known array on the host, else ``function(jax.numpy, x)``.

    What NumPy finds is put back where `x` was: by jax every small step would be a program to
    compile.
    """
    if not isinstance(x, jax.Array):
        return function(np, np.asarray(x))
    if _at_hand(x):
        return jax.device_put(function(np, np.asarray(x)), x.sharding)
    return function(jnp, x)
