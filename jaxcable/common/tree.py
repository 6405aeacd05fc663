"""Frozen dataclasses as pytrees, with topology kept apart from numbers.

Numbers (coordinates, stiffness, loads) are leaves. Topology (numbers of nodes, supports) is static
metadata in an `Indices`, hashed by digest. Before the compiled core is entered, `split_indices`
takes the index arrays out of the metadata, so that they become arguments: two nets of equal shape
then share one compilation, and no index array becomes a constant of a program.
"""

from __future__ import annotations

import dataclasses
import functools
import hashlib
import typing
from collections.abc import Callable, Sequence
from typing import Any, TypeVar

import jax
import jax.numpy as jnp
import numpy as np
from jax import lax

from .owned import owned_copy
from .summary import summarize
from .types import Array, ArrayLike, Bool, Float, Int, PyTree

_T = TypeVar("_T")


class Indices:
    """An immutable array of integers or booleans that can be static metadata of a pytree.

    Two are equal if their contents are, and they hash by content: structures of equal topology
    share compiled programs.
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


_NO_INDICES = "_no_indices"
_LEAF_TYPES = {np.ndarray, type(None), float, int, bool}
"""Common types of leaves."""


@dataclasses.dataclass(frozen=True)
class _IndexSlot:
    """Placeholder for an index array that was split from a tree: its position in a list."""

    number: int


@typing.dataclass_transform(frozen_default=True, eq_default=False)
def pytree(
    cls: Any = None,
    *,
    static: Sequence[str] = (),
    indices: Sequence[str] = (),
    kw_only: bool = False,
) -> Any:
    """Make a class a frozen dataclass and a pytree of jax (a decorator).

    The leaves are all fields but those named in `static` and `indices`. Constructors keep read-only
    copies of NumPy arrays, lists and dicts (`owned_copy`). Unlike with
    `jax.tree_util.register_dataclass`, unflattening does not run `__post_init__`: constructors may
    validate values, while transformations of jax may put any leaf in a field.

    Options:
        static: names of fields that are metadata.
        indices: names of fields with `Indices`, which are metadata too.
        kw_only: whether the constructor takes the fields that the class adds by name only.
    """
    if cls is None:
        return lambda c: pytree(c, static=static, indices=indices, kw_only=kw_only)
    cls = dataclasses.dataclass(frozen=True, eq=False, repr=False, kw_only=kw_only)(cls)
    if cls.__repr__ is object.__repr__:
        cls.__repr__ = summarize
    meta = tuple(static) + tuple(indices)
    data = tuple(f.name for f in dataclasses.fields(cls) if f.name not in meta)
    cls._index_fields = tuple(indices)
    cls._static_fields = tuple(static)
    cls._data_fields = data
    cls._all_fields = tuple(f.name for f in dataclasses.fields(cls))
    construct = cls.__init__

    @functools.wraps(construct)
    def init(obj, *arguments, **options):
        construct(obj, *arguments, **options)
        values = obj.__dict__
        for name in data:
            values[name] = owned_copy(values[name])

    cls.__init__ = init

    def flatten(obj):
        values = obj.__dict__
        return [values[n] for n in data], tuple([values[n] for n in meta])

    def flatten_with_keys(obj):
        children, aux = flatten(obj)
        return [(jax.tree_util.GetAttrKey(n), c) for n, c in zip(data, children, strict=True)], aux

    def unflatten(aux, children):
        obj = object.__new__(cls)
        obj.__dict__.update(zip(data + meta, (*children, *aux), strict=True))
        return obj

    jax.tree_util.register_pytree_with_keys(cls, flatten_with_keys, unflatten, flatten)
    return cls


def computed_once(function: Callable[[Any], _T]) -> Callable[[Any], _T]:
    """Decorate a function of one immutable object so that its result is stored in the object."""
    name = f"_{function.__name__}_once"

    @functools.wraps(function)
    def kept(obj):
        known = vars(obj)
        if name not in known:
            known[name] = function(obj)
        return known[name]

    return kept


def set_fields(obj: object, **values: Any) -> None:
    """Set fields of an object of a frozen class, for use in its constructor."""
    vars(obj).update(values)


def copy_with(obj: _T, **changes: Any) -> _T:
    """Copy a `pytree` object with some fields changed; its constructor and checks do not run."""
    new, values = object.__new__(type(obj)), obj.__dict__
    fields = type(obj)._all_fields  # type: ignore[attr-defined]  # an object of a `pytree` class
    new.__dict__.update({n: changes[n] if n in changes else values[n] for n in fields})
    return new


@pytree
class PerElement:
    """One object for every element, such as a law or a section, in place of one that all share.

    Attributes:
        every: all these objects as one object, whose leaves have the leading axis [n_elem].
    """

    every: PyTree[Float[Array, "n_elem ..."]]


def is_hashable(value: object) -> bool:
    """Tell whether a value has a hash. A tree structure with traced indices in it has none."""
    try:
        hash(value)
    except TypeError:
        return False
    return True


def shared_or_stacked(obj: Any) -> Any:
    """Return an object with the properties that laws or sections of all elements have in common.

    It is `obj` itself or, for a `PerElement`, its objects stacked as one, whose leaves are
    [n_elem].
    """
    return obj.every if isinstance(obj, PerElement) else obj


def map_over_elements(function: Callable[[Any], Any], obj: Any) -> Any:
    """Return ``function(obj)``; of a `PerElement` one with the results of its objects, [n_elem]."""
    return (
        PerElement(jax.vmap(function)(obj.every)) if isinstance(obj, PerElement) else function(obj)
    )


def replace(obj: _T, **changes: Any) -> _T:
    """Copy a structure, group, phase or load with some fields changed; its checks run again.

    Args:
        obj: the object to copy.
        changes: new values, by the names of the fields.

    Returns:
        An object of the same type.

    Raises:
        ValueError: there is no such field; or an error of the constructor.

    Example:
        >>> structure, phases = jc.scenes.flat_net()
        >>> lifted = jc.replace(structure, nodes=structure.nodes + np.array([[0.0, 0.0, 5.0]]))
        >>> print(structure.nodes[0], lifted.nodes[0])
        [0.4 0.  0. ] [0.4 0.  5. ]
        >>> jc.replace(phases[1], increments=4).increments
        4
    """
    fields = dataclasses.fields(obj)  # type: ignore[arg-type]  # as in `copy_with`
    unknown = set(changes) - {f.name for f in fields if f.init}
    if unknown:
        raise ValueError(f"replace: {type(obj).__name__} has no field {sorted(unknown)[0]!r}")
    return dataclasses.replace(obj, **changes)  # type: ignore[type-var]  # as in `copy_with`


def index_field(obj: Any, name: str) -> Indices | None:
    """Return the `Indices` in a field of an object; None if it has no index field of this name."""
    return vars(obj).get(name) if name in getattr(type(obj), "_index_fields", ()) else None


def _has_index_fields(obj):
    """Tell whether an object is of a `pytree` class that has fields with `Indices`."""
    return bool(getattr(type(obj), "_index_fields", ()))


def index_array(indices: Indices | Int[ArrayLike, " ..."]) -> Int[ArrayLike, " ..."]:
    """Return the NumPy array in `Indices`; an array, as programs have it, is returned as it is."""
    return indices.array if isinstance(indices, Indices) else indices


def unsigned_indices(array: Int[ArrayLike, " ..."]) -> Int[np.ndarray, " ..."]:
    """Return indices as uint32, so that compiled programs need no code for negative ones.

    Arrays with negative entries, and arrays that are not signed integers, are returned unchanged.
    """
    array = np.asarray(array)
    if array.dtype.kind != "i" or (array < 0).any():
        return array
    return array.astype(np.uint32)


def split_indices(tree: _T) -> tuple[_T, list[Int[ArrayLike, " ..."]]]:
    """Take the index arrays out of a tree, so that they can be arguments of a compiled program.

    In a tree that `merge_indices` has made, they stand in the place of `Indices`.

    Returns:
        The tree with placeholders instead of `Indices`; the list of index arrays.
    """
    arrays = []

    def slot(value):
        arrays.append(unsigned_indices(value.array) if isinstance(value, Indices) else value)
        return _IndexSlot(len(arrays) - 1)

    def visit(obj):
        kind = type(obj)
        if kind in _LEAF_TYPES or isinstance(obj, jax.Array):
            return obj
        if kind is list or kind is tuple:
            items = list(map(visit, obj))
            return obj if all(a is b for a, b in zip(items, obj, strict=True)) else kind(items)
        if not hasattr(kind, "_all_fields"):
            return jax.tree.map(
                lambda x: visit(x) if _has_index_fields(x) else x, obj, is_leaf=_has_index_fields
            )
        values = vars(obj)
        if _has_index_fields(obj):
            names = (name for name in obj._index_fields if values[name] is not None)
            return copy_with(obj, **{name: slot(values[name]) for name in names})
        if _NO_INDICES in values:
            return obj
        changes = {name: visit(values[name]) for name in obj._data_fields}
        changes = {name: value for name, value in changes.items() if value is not values[name]}
        if changes:
            return copy_with(obj, **changes)
        values[_NO_INDICES] = True  # it need not be searched again
        return obj

    return visit(tree), arrays


def cast_floats(tree: _T, dtype: Any) -> _T:
    """Return a tree with all its leaves as jax arrays, and those of floats converted to `dtype`."""

    def cast_leaf(x):
        x = jnp.asarray(x)
        return x.astype(dtype) if jnp.issubdtype(x.dtype, jnp.floating) else x

    return jax.tree.map(cast_leaf, tree)


def merge_indices(tree: _T, arrays: Sequence[Int[ArrayLike, " ..."]]) -> _T:
    """Undo `split_indices`: return the tree with index arrays in the place of placeholders.

    Inside of a compiled program these arrays are traced.
    """

    def visit(obj):
        if not _has_index_fields(obj):
            return obj
        values = {n: getattr(obj, n) for n in obj._index_fields}
        return copy_with(
            obj, **{n: arrays[v.number] for n, v in values.items() if isinstance(v, _IndexSlot)}
        )

    return jax.tree.map(visit, tree, is_leaf=_has_index_fields)


def select_tree(condition: Bool[ArrayLike, ""], new: _T, old: _T) -> _T:
    """Return the pytree `new` if a condition holds, else `old`, by a select of every leaf."""

    def one(a, b):
        same = a is b  # as a leaf that a step leaves as it was
        a, b = jnp.asarray(a), jnp.asarray(b)
        if same and jnp.ndim(condition) == 0:
            return a
        if jnp.ndim(condition) == 0 and (a.shape, a.dtype) == (b.shape, b.dtype):
            return lax.select(jnp.asarray(condition), a, b)  # less code than `jnp.where`
        return jnp.where(condition, a, b)

    return jax.tree.map(one, new, old)


def entry(tree: _T, index: Int[Array, ""]) -> _T:
    """Return a pytree of the entries of all leaves at `index` (>= 0) of their first axis."""
    index = jnp.asarray(index).astype(jnp.uint32)  # less code than a signed index
    return jax.tree.map(lambda x: lax.dynamic_index_in_dim(x, index, 0, False), tree)


def is_on_host(x: Any) -> bool:
    """Tell whether `x` is a jax array that is not traced and lies in the memory of the CPU."""
    if not isinstance(x, jax.Array) or isinstance(x, jax.core.Tracer):
        return False
    return len(x.devices()) == 1 and next(iter(x.devices())).platform == "cpu"


def apply_numpy_or_jax(function: Callable[..., Any], *arrays: ArrayLike) -> ArrayLike:
    """Return ``function(numpy, *arrays)`` for known ones on the CPU, else with ``jax.numpy``.

    `function` takes the module and the arrays. The result is a jax array if one of them is, on the
    same device. NumPy is preferred because jax would compile a program for every small operation.
    """
    of_jax = [x for x in arrays if isinstance(x, jax.Array)]
    if not all(map(is_on_host, of_jax)):
        return function(jnp, *arrays)
    found = function(np, *map(np.asarray, arrays))
    return jax.device_put(found, of_jax[0].sharding) if of_jax else found
