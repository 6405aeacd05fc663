"""A traced program as a Python function of NumPy."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Any

import numpy as np

from ..common import jax_internals as internals
from . import arrays, control_flow, elementwise, indexing, matrices  # noqa: F401  (rules)
from .block import Names
from .writing import LimitReachedError, count_calls, inner_jaxprs, make_function


def count_equations(program: Any) -> int:
    """Return the number of equations of a closed jaxpr, counting those of a function at each call.

    A deferred function (`common.deferred`) counts as one: it is not traced yet.
    """
    known: dict[int, int] = {}

    def count(jaxpr):
        if id(jaxpr) not in known:
            own = sum(1 + sum(map(count, inner_jaxprs(equation))) for equation in jaxpr.eqns)
            known[id(jaxpr)] = own
        return known[id(jaxpr)]

    return count(program.jaxpr)


def write_program(program: Any) -> Callable[[Sequence[Any], list[float]], list[np.ndarray]]:
    """Return the function that computes a closed jaxpr by NumPy.

    It takes a list of arrays and a list [work done, most work]; it raises `LimitReachedError`
    where more work would be done. Work is counted in calls of a NumPy function with few entries.

    Raises:
        NotImplementedError: an equation has no rule.
    """
    program = internals.without_unused_equations(program)
    functions = {**elementwise.FUNCTIONS, "LimitReachedError": LimitReachedError}
    names = Names(functions, make_function, count_calls(program))
    compute = make_function(names, program)
    dtypes = [np.dtype(x.aval.dtype) for x in program.jaxpr.invars]

    def run(leaves, work):
        given = [np.asarray(x, dtype)[()] for x, dtype in zip(leaves, dtypes, strict=True)]
        with np.errstate(all="ignore"):
            found = compute(work, *given)
        inputs = set(map(id, given))
        # jax may keep the memory of an array: it must be nobody else's
        return [np.array(x) if _is_shared(x, inputs, names.kept) else np.asarray(x) for x in found]

    return run


def _is_shared(x, inputs, constants):
    """Tell whether a result of NumPy must be copied: it is a view, an input, or a constant.

    `inputs` and `constants` are the addresses (`id`) of these.
    """
    if not isinstance(x, np.ndarray):
        return False
    return x.base is not None or id(x) in inputs or id(x) in constants
