"""Bounds on parameters: project into them, find entries that they block; check arguments."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np

from ..common import checks, status
from ..common import rules as _rules
from ..common.tree import pytree
from ..common.types import Array, ArrayLike, Bool, Float, PyTree
from .arguments import check_tolerance, is_valid_tolerance


@pytree(static=("counts",))
class BoxBounds:
    """Lower and upper bounds of all parameters as flat vectors [n]; infinite where there is none.

    Attributes:
        lower, upper: bounds, [n].
        counts: number of entries of each array in the pytree of parameters; they sum to n.
    """

    lower: Float[Array, " n"]
    upper: Float[Array, " n"]
    counts: tuple[int, ...]

    def project(self, x: Float[np.ndarray, " n"]) -> Float[np.ndarray, " n"]:
        """Return the nearest point within the bounds, [n]: each entry clipped to its own bounds."""
        return np.clip(np.asarray(x, self.lower.dtype), self.lower, self.upper)

    def blocked_entries(
        self, x: Float[np.ndarray, " n"], gradient: Float[np.ndarray, " n"]
    ) -> Bool[np.ndarray, " n"]:
        """Return which parameters are at a bound that a step against the gradient would cross, [n].

        Parameters whose two bounds are equal are always blocked.
        """
        low, high = (x <= self.lower) & (gradient > 0), (x >= self.upper) & (gradient < 0)
        return low | high | (self.lower == self.upper)

    def norm_per_array(
        self, norm: Callable[[Float[np.ndarray, " m"]], float], x: Float[np.ndarray, " n"]
    ) -> Float[np.ndarray, " n"]:
        """Return a norm of every array of parameters, repeated for each of its entries, [n].

        `x` has all arrays as one flat vector, [n]; `norm` is a function of one array, [m],
        to a number.
        """
        parts = np.split(x, np.cumsum(self.counts)[:-1])
        return np.concatenate([np.full_like(part, norm(part)) for part in parts])

    def largest_per_array(self, x: Float[np.ndarray, " n"]) -> Float[np.ndarray, " n"]:
        """Return the largest absolute entry of the array that contains each entry of `x`, [n]."""
        return self.norm_per_array(lambda part: np.abs(part).max(initial=0), x)

    def typical_sizes(self, x: Float[np.ndarray, " n"]) -> Float[np.ndarray, " n"]:
        """Return typical sizes [n] of parameters that start at `x`, for scaling them.

        The size of an entry is the largest absolute entry of its array at the start. If all of
        these are zero it is the largest finite bound of the array; without such a bound it is 1.
        """
        ends = (np.where(np.isfinite(b), np.abs(b), 0) for b in (self.lower, self.upper))
        start, bound = self.largest_per_array(x), self.largest_per_array(np.maximum(*ends))
        return np.where(start > 0, start, np.where(bound > 0, bound, np.ones_like(bound)))

    def input_status(self, start: Float[np.ndarray, " n"], tol: Float[ArrayLike, ""]) -> int:
        """Return the status of the input of a search, which may have been traced and so unchecked.

        It is OUTSIDE if the start [n] violates the bounds or these cross each other,
        INVALID_INPUT if the tolerance is not valid, else OK.
        """
        if not is_valid_tolerance(tol):
            return status.INVALID_INPUT
        outside = (start < self.lower) | (start > self.upper) | ~(self.lower <= self.upper)
        return status.OUTSIDE if outside.any() else status.OK


def check_params(
    params: PyTree[Float[ArrayLike, " ..."]], name: str = "params"
) -> PyTree[Float[Array, " ..."]]:
    """Return the parameters as a pytree of float arrays; raise ValueError for anything else."""
    if not any(np.size(leaf) for leaf in jax.tree.leaves(params)):
        raise ValueError(f"{name}: there are no parameters; expected at least one array of floats")

    def as_array(path, x):
        x = checks.as_floats(x, name + jax.tree_util.keystr(path))
        # a weak type would be another program
        dtype = jax.dtypes.canonicalize_dtype(x.dtype)
        return jnp.asarray(x if isinstance(x, jax.core.Tracer) else np.asarray(x, dtype), dtype)

    return jax.tree_util.tree_map_with_path(as_array, params)


def check_search_arguments(
    params: PyTree[Float[ArrayLike, " ..."]],
    bounds: tuple[Any, Any] | None,
    tol: Float[ArrayLike, ""] | None,
) -> tuple[PyTree[Float[Array, " ..."]], BoxBounds, Float[ArrayLike, ""]]:
    """Check arguments that `minimize`, `fit` and others share, and return them converted.

    Returns:
        The start as a pytree of float arrays; the bounds as `BoxBounds`; the tolerance, by default
            1e-6 in float64 and 1e-3 in other float types.
    """
    params = check_params(params)
    double = jnp.result_type(*jax.tree.leaves(params)) == jnp.float64
    return params, make_bounds(bounds, params), check_tolerance(tol, 1e-6 if double else 1e-3)


def broadcast_to_params(
    value: PyTree[Float[ArrayLike, " ..."]] | None,
    params: PyTree[Float[Array, " ..."]],
    name: str,
    absent: float | None = None,
    positive: bool = False,
) -> PyTree[Float[Array, " ..."]]:
    """Expand a scalar, an array or a prefix pytree to a pytree of arrays like `params`.

    Args:
        value: what the user gave, such as a bound; None, as a whole or as a leaf, stands for
            `absent`.
        params: the parameters, a pytree of arrays.
        name: name of the argument `value` in error messages.
        absent: number that replaces None.
        positive: whether every entry has to be positive and finite.

    Raises ValueError for shapes that do not fit, and for values that are not positive.
    """
    if isinstance(value, list | tuple) and jax.tree_util.treedef_is_leaf(
        jax.tree.structure(params)
    ):
        value = checks.as_floats(value, name)
    value = jax.tree.map(lambda v: absent if v is None else v, value, is_leaf=lambda v: v is None)
    try:
        tree = jax.tree.broadcast(value, params)
    except ValueError as error:
        raise ValueError(
            f"{name}: expected a scalar, an array or a prefix pytree of the parameters, got "
            f"{jax.tree.structure(value)} for {jax.tree.structure(params)}"
        ) from error

    def fill(path, v, x):
        where = name + jax.tree_util.keystr(path)
        v = checks.as_floats(v, where)
        if v.shape not in ((), x.shape):
            raise ValueError(f"{where}: expected a scalar or shape {x.shape}, got {v.shape}")
        if positive:
            text = "must be positive and finite"
            sound = _rules.Rule(where, v, lambda v: ~((v > 0) & (v < np.inf)), text)
            v = _rules.nan_if_broken(sound)
        xp = checks.numpy_or_jax(v)
        return xp.broadcast_to(xp.asarray(v, x.dtype), x.shape)

    return jax.tree_util.tree_map_with_path(fill, tree, params)


def make_bounds(bounds: tuple[Any, Any] | None, params: PyTree[Float[Array, " ..."]]) -> BoxBounds:
    """Convert the user's argument `bounds` to `BoxBounds`; check the start against known bounds.

    Args:
        bounds: None, or (lower, upper), each None, a scalar, an array or a prefix pytree of the
            parameters.
        params: the start, a pytree of arrays.

    Raises:
        ValueError: a lower bound above the upper one, NaN in a bound, or a start outside of the
            bounds; the message names the entry.
    """
    if bounds is None:
        bounds = (None, None)
    if not isinstance(bounds, list | tuple) or len(bounds) != 2:
        raise ValueError(
            "bounds: expected (lower, upper), each None, a number or a pytree; not one pair for "
            "each parameter"
        )
    lower, upper = (
        broadcast_to_params(bound, params, f"{name} bound", absent)
        for bound, name, absent in zip(bounds, ("lower", "upper"), (-np.inf, np.inf), strict=True)
    )

    def check(path, x, low, high):
        x, low, high = (checks.array_if_known(v) for v in (x, low, high))
        if low is None or high is None:
            return
        x = low if x is None else x
        for bad, name, rule, *values in (
            (np.isnan(low), "lower bound", "is NaN"),
            (np.isnan(high), "upper bound", "is NaN"),
            (low > high, "lower bound", "above the upper bound", low, high),
            (x < low, "params", "the start is below its lower bound", x, low),
            (x > high, "params", "the start is above its upper bound", x, high),
        ):
            if bad.any():
                index = tuple(map(int, np.argwhere(bad)[0]))
                where = f"{jax.tree_util.keystr(path)}{list(index) or ''}"
                given, limit = [f"{v[index]:g}" for v in values] or ("", "")
                shown = f" = {given}: {rule}, {limit}" if values else f": {rule}"
                raise ValueError(f"{name}{where}{shown}")

    jax.tree_util.tree_map_with_path(check, params, lower, upper)
    counts = tuple(leaf.size for leaf in jax.tree.leaves(params))
    return BoxBounds(flat_vector(lower), flat_vector(upper), counts)


def flat_vector(tree: PyTree[Float[ArrayLike, " ..."]]) -> Float[ArrayLike, " n"]:
    """Return all numbers of a pytree as one array [n], one array of the tree after the other.

    Known numbers give an array of NumPy, so that nothing is compiled; traced ones an array of
    jax.
    """
    xp = checks.numpy_or_jax(tree)
    return xp.concatenate([xp.ravel(x) for x in jax.tree.leaves(tree)])


def entry_names(params: PyTree[Float[ArrayLike, " ..."]]) -> list[str]:
    """Return a label for every number of a pytree, [n], as a user indexes it: ``['stays'][0]``."""
    return [
        jax.tree_util.keystr(path) + "".join(f"[{k}]" for k in index)
        for path, leaf in jax.tree_util.tree_leaves_with_path(params)
        for index in np.ndindex(np.shape(leaf))
    ]


def unflatten_params(
    flat: Float[ArrayLike, " n"] | Bool[ArrayLike, " n"], params: PyTree[Float[Array, " ..."]]
) -> PyTree[Any]:
    """Return parameters from one array [n], as a pytree like `params`: reverse `flat_vector`.

    Floats get the dtypes of `params`; a flag for each parameter stays a bool.
    """
    ends = iter(np.cumsum([x.size for x in jax.tree.leaves(params)]))

    def part(x):
        end = next(ends)
        own = flat[end - x.size : end].reshape(x.shape)
        return own if own.dtype == bool else own.astype(x.dtype)

    return jax.tree.map(part, params)


def check_call_arguments(
    function: Callable[..., Any],
    args: tuple[Any, ...] | list[Any],
    steps: int,
    name: str,
    counted: str = "steps",
) -> tuple[Any, ...]:
    """Check the user's function, its further arguments `args` and the number of steps of a search.

    `name` and `counted` are the names of function and steps in messages. Returns `args` as a tuple.

    Raises:
        ValueError: `function` cannot be called, `args` is no tuple or list, or `steps` is no
            positive integer.
    """
    if not callable(function):
        raise ValueError(f"{name}: expected a function, got {type(function).__name__}")
    if not isinstance(args, tuple | list):
        raise ValueError(f"args: expected a tuple of arguments, got {type(args).__name__}")
    checks.require_whole_number(steps, counted)
    return tuple(args)
