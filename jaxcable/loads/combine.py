"""Load combinations: factors times load cases."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import jax
import jax.numpy as jnp

from ..common import checks
from ..common.types import ArrayLike, Float
from .load import Load


def combine(
    cases: Mapping[Any, Load | Sequence[Load]] | Sequence[Load | Sequence[Load]],
    factors: Float[ArrayLike, "... n_case"],
) -> list[Load]:
    """Combine load cases with factors: the loads of a phase, as a batch of combinations.

    Results of cable structures cannot be superposed: every combination needs its own analysis.
    Map over the batch::

        loads = combine({"dead": dead, "snow": snow}, [[1.35, 1.5], [1.0, 0.0]])
        jax.vmap(lambda one: solve(structure, [Phase(loads=one)], start=first).tension)(loads)

    Args:
        cases: dict or list of load cases, each a load or a list of loads.
        factors: [n_combination, n_case], in the order of the cases; or [n_case] for a single
            combination, which is returned without a leading axis.

    Returns:
        List of loads whose numbers have a leading axis [n_combination].

    Raises:
        ValueError: no case, or the numbers of factors and cases differ.

    Example:
        >>> dead = jc.NodalLoads([1], (0.0, 0.0, -400.0))
        >>> snow = jc.NodalLoads([1], (0.0, 0.0, -1000.0))
        >>> loads = jc.combine({"dead": dead, "snow": snow}, [[1.35, 1.5], [1.0, 0.0]])
        >>> dead, snow = loads
        >>> print(dead.forces[:, 2] + snow.forces[:, 2])  # N, by combination
        [-2040.  -400.]
    """
    if not isinstance(cases, dict | list | tuple):
        raise ValueError(f"cases: expected a dict or a list of loads, got {type(cases).__name__}")
    cases = list(cases.values()) if isinstance(cases, dict) else list(cases)
    factors = checks.as_floats(factors, "factors")
    if not cases:
        raise ValueError("cases: at least one load case is needed")
    if factors.ndim not in (1, 2) or factors.shape[-1] != len(cases):
        raise ValueError(
            f"factors: expected shape [n_combination, {len(cases)}], one column a case, "
            f"got {factors.shape}"
        )
    listed = [list(c) if isinstance(c, list | tuple) else [c] for c in cases]
    for k, loads in enumerate(listed):
        for load in loads:
            if not isinstance(load, Load):
                raise ValueError(f"cases[{k}]: {type(load).__name__} is not a load")

    def combined(shares):
        return [
            jax.tree.map(jnp.asarray, load.scaled(shares[k]))
            for k, loads in enumerate(listed)
            for load in loads
        ]

    factors = jnp.asarray(factors)
    return combined(factors) if factors.ndim == 1 else jax.vmap(combined)(factors)
