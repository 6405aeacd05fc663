"""Check arguments of the functions of this room: tolerances, phases, values of elements."""

from __future__ import annotations

from typing import Any

import jax
import numpy as np

from ..common import checks
from ..common.rules import Rule, nan_if_broken, positive, refuse_if_broken
from ..common.types import Array, ArrayLike, Bool, Float, PyTree
from ..model.structure import Structure


def check_tolerance(tol: Float[ArrayLike, ""] | None, default: float) -> Float[ArrayLike, ""]:
    """Return the tolerance of a search, or `default` if it is None.

    Raises ValueError unless a known tolerance is at least 0 and below 1; traced ones are left to
    `is_valid_tolerance`.
    """
    if tol is None:
        return default
    tol = checks.as_scalar(tol, "tol")
    refuse_if_broken(
        [Rule("tol", tol, lambda v: ~((v >= 0) & (v < 1)), "must be at least 0 and below 1")]
    )
    return tol


def is_valid_tolerance(tol: Float[ArrayLike, ""]) -> Bool[Array, ""]:
    """Return whether a tolerance (which may be traced) is at least 0 and below 1; scalar bool."""
    return (tol >= 0) & (tol < 1)


def checked_smoothing_width(width: Float[ArrayLike, ""]) -> Float[ArrayLike, ""]:
    """Return the smoothing width of `smooth_max` and the like, if it is positive.

    Raises ValueError for a known width that is not positive; a traced one becomes NaN.
    """
    return nan_if_broken(positive("width", checks.as_scalar(width, "width")))


def require_result(solution: Any, name: str) -> None:
    """Raise ValueError unless `solution` has an attribute `name`, such as "tension"."""
    if not hasattr(solution, name):
        got = checks.describe_type(solution, "solve(structure, phases)")
        raise ValueError(f"solution: expected a Solution, got {got}, which has no {name}")


def require_structure(structure: Any) -> None:
    """Raise ValueError unless `structure` is a `Structure`."""
    if not isinstance(structure, Structure):
        got = checks.describe_type(structure, "Structure(nodes, elements, supports)")
        raise ValueError(f"structure: expected a Structure, got {got}")


def result_of_phase(solution: Any, phase: int) -> Any:
    """Return `solution.phases[phase]`; negative indices count from the last phase.

    Raises ValueError if there is no phase with this index.
    """
    require_result(solution, "phases")
    require_phase_index(phase, len(solution.phases), -len(solution.phases))
    return solution.phases[phase]


def require_phase_index(phase: Any, count: int, least: int = 0) -> None:
    """Raise ValueError unless `phase` is an integer with ``least <= phase < count``.

    `count` is the number of phases; `least` is 0, or ``-count`` where indices may count from
    the end.
    """
    whole = isinstance(phase, int | np.integer) and not isinstance(phase, bool)
    if not whole or not least <= phase < count:
        raise ValueError(f"phase = {phase!r}: there are phases 0 to {count - 1}")


def broadcast_to_elements(
    value: PyTree[Float[ArrayLike, " ..."]], tree: PyTree[Float[Array, " ..."]], name: str
) -> PyTree[Float[ArrayLike, " ..."]]:
    """Expand `value` to a pytree like `tree`, in which each leaf is a scalar or an array [n_elem].

    Args:
        value: a scalar, an array [n_elem] or a prefix pytree of `tree`.
        tree: results of all element groups, arrays [..., n_elem].
        name: name of the argument `value` in error messages.

    Raises:
        ValueError: `value` has another pytree structure, or another number of elements.
    """
    if isinstance(value, list | tuple) and isinstance(tree, jax.Array | np.ndarray):
        value = checks.as_floats(value, name)
    try:
        value = jax.tree.broadcast(value, tree)
    except ValueError:
        shape = jax.tree.structure(tree)
        raise ValueError(
            f"{name}: expected a number, or a pytree like the elements, {shape}; got "
            f"{jax.tree.structure(value)}"
        ) from None

    def checked(path, one, of):
        where = name + jax.tree_util.keystr(path)
        one = checks.as_floats(one, where)
        fits = one.ndim <= of.ndim and one.shape == of.shape[of.ndim - one.ndim :]
        if not fits:
            raise ValueError(
                f"{where}: expected a number or shape {of.shape[-1:]}, one value per element, got "
                f"{one.shape}"
            )
        return one

    return jax.tree_util.tree_map_with_path(checked, value, tree)
