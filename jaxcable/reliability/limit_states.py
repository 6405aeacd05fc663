"""What a limit state function returns: a number, a vector, or numbers by name."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import jax
import jax.numpy as jnp

from ..common.types import Array, Float
from ..programs.traced_function import TracedFunction, trace_function
from .quantities import Quantities


def require_limit_state(limit_state: Any) -> None:
    """Raise ValueError unless `limit_state` is a function."""
    if not callable(limit_state):
        raise ValueError(
            f"limit_state: expected a function of the values by name, got "
            f"{type(limit_state).__name__}"
        )


def limit_state_vector(outcome: Any) -> Float[Array, " m"]:
    """Return what a limit state function has returned as a vector, [m], sorted by name if named.

    ValueError if it is no scalar float, vector or dict of scalars.
    """
    parts = outcome.values() if isinstance(outcome, dict) else [outcome]
    allowed = (0,) if isinstance(outcome, dict) else (0, 1)
    for part in parts:
        numeric = part is not None and not hasattr(part, "status") and not isinstance(part, str)
        array = jnp.asarray(part) if numeric and not isinstance(part, dict | tuple) else None
        sound = array is not None and jnp.issubdtype(array.dtype, jnp.floating)
        if array is None or not sound or array.ndim not in allowed or array.size == 0:
            got = f"{array.dtype}{list(array.shape)}" if array is not None else type(part).__name__
            raise ValueError(
                "limit_state: expected a scalar float, a vector [m], or a dict of scalars, got "
                + got
            )
    if isinstance(outcome, dict):
        if not outcome:
            raise ValueError("limit_state: expected a dict of scalars, got an empty one")
        return jnp.stack([jnp.asarray(outcome[name]) for name in sorted(outcome)])
    return jnp.ravel(jnp.asarray(outcome))


def names_of_outcome(outcome: Any) -> tuple[str, ...] | None:
    """Return the names of limit states from what their function returned: a dict's sorted keys.

    Those of a vector are "0", "1" and so on; None for a scalar.
    """
    if isinstance(outcome, dict):
        return tuple(sorted(outcome))
    shape = jnp.shape(outcome)
    return tuple(str(k) for k in range(shape[0])) if shape else None


def trace_limit_state(
    limit_state: Callable[..., Any], quantities: Quantities, args: tuple[Any, ...]
) -> TracedFunction:
    """Trace a limit state as a function of values by name and further arguments.

    Raises:
        ValueError: it returns something else than limit states.
    """

    def checked(values, *args):
        outcome = limit_state(values, *args)
        limit_state_vector(outcome)
        return jax.tree.map(jnp.asarray, outcome)

    u = jax.ShapeDtypeStruct((quantities.size,), jax.dtypes.canonicalize_dtype(float))
    return trace_function(checked, jax.eval_shape(quantities.values_at_normals, u), *args)
