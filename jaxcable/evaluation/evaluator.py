"""A traced program as a Python function of NumPy."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Any

import numpy as np

from ..common import jax_internals as internals
from . import arrays, control_flow, elementwise, indexing, matrices  # noqa: F401  (rules)
from .block import Names
from .writing import LimitReached, count_calls, make_function


def write_program(program: Any) -> Callable[[Sequence[Any], list[float]], tuple[np.ndarray, ...]]:
    """Return the function that computes a closed jaxpr by NumPy.

    It takes a list of arrays and a list [work done, most work]; it raises `LimitReached` where more
    work would be done. Work is counted in calls of a NumPy function with few entries.

    Raises:
        NotImplementedError: an equation has no rule.
    """
    program = internals.without_unused_equations(program)
    functions = {**elementwise.FUNCTIONS, "LimitReached": LimitReached}
    names = Names(functions, make_function, count_calls(program))
    compute = make_function(names, program)
    dtypes = [np.dtype(x.aval.dtype) for x in program.jaxpr.invars]

    def run(leaves, work):
        arrays = [np.asarray(x, dtype)[()] for x, dtype in zip(leaves, dtypes, strict=True)]
        with np.errstate(all="ignore"):
            found = compute(work, *arrays)
        inputs = set(map(id, arrays))
        return [
            np.array(x) if getattr(x, "base", None) is not None or id(x) in inputs else x
            for x in found
        ]

    return run
