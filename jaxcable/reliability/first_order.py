"""Reliability index and design point by the first-order reliability method (FORM)."""

from __future__ import annotations

import functools
from collections.abc import Callable, Mapping
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
from jax import lax
from jax.scipy.special import ndtr

from ..common import checks, status
from ..common.jax_internals import convert_closure
from ..common.types import ArrayLike, Float
from ..design.arguments import check_tolerance, is_valid_tolerance
from ..design.search_loop import is_plain_call, search_in_program, search_on_host
from ..linear import unbatched
from ..programs.known import KnownPrograms
from ..programs.program_calls import as_program
from .distributions import Distribution
from .first_order_result import FirstOrder
from .index_derivative import attach_derivative, without_derivative
from .limit_states import (
    limit_state_vector,
    names_of_outcome,
    require_limit_state,
    trace_limit_state,
)
from .quantities import Quantities, as_quantities, split_by_name
from .search import advance_search, begin_search

_TOLERANCE = {"float64": 1e-6, "float32": 1e-3}


def first_order(
    limit_state: Callable[..., Any],
    quantities: Quantities | Mapping[str, Distribution],
    *,
    args: tuple[Any, ...] = (),
    start: Mapping[str, Float[ArrayLike, " ..."]] | None = None,
    steps: int = 100,
    tol: Float[ArrayLike, ""] | None = None,
) -> FirstOrder:
    """Find reliability index and design point by the first-order reliability method (FORM).

    The limit state is linearized at its most probable point in standard normal space, by exact
    gradients (iHL-RF iteration: Zhang and Der Kiureghian 1995).

    Args:
        limit_state: function ``limit_state(values, *args)`` of the values of all quantities by
            name, negative where the structure fails; any function of a solution. It returns a
            scalar, or several limit states of one analysis: a vector [m], or a dict of scalars by
            name, each with a search of its own. NaN where the analysis fails.
        quantities: `Quantities`, or a dict of independent distributions by name.

    Options:
        args: tuple of further arguments of the limit state, any pytrees. The limit state is traced
            once in every call, so that it sees what it reads from outside now.
        start: values by name at which the search begins; those that it lacks are at their medians,
            where all are by default. A design point is the nearest one around: other starts may
            lead to others.
        steps: largest number of accepted steps.
        tol: largest distance of the point found from the surface and from the line along the
            gradient, in standard normal space, over the distance from the origin (at least 1). The
            error of `beta` is of its second order. Default: 1e-6 in float64, 1e-3 in float32.

    Returns:
        `FirstOrder`. Works under jit and vmap. The derivatives of `beta` and `probability` by
        means and scatters, correlations and all floats in `args`, or that the limit state captures,
        are exact: ``dG/dp / |dG/du|`` at the design point, which is stationary (envelope
        theorem). The other results, and second derivatives, have NaN for a derivative.

    Called from Python, every trial point is a program of one limit state and its gradient; under
    jit, vmap or a derivative the whole search is a part of the program.

    Raises:
        ValueError: no function, quantities that are none, or a limit state that returns something
            else.

    Example:
        A cable under its pretension and wind, and how the index rises with the mean strength:

        >>> def margin(x):
        ...     return x["strength"] - x["tension"] - 150.0 * x["pressure"]  # N
        >>> def index(mean):
        ...     quantities = {
        ...         "strength": jc.reliability.Lognormal(mean, variation=0.08),
        ...         "tension": jc.reliability.Normal(100e3, 5e3),
        ...         "pressure": jc.reliability.Gumbel(350.0, variation=0.25),
        ...     }
        ...     found = jc.reliability.first_order(margin, quantities)
        ...     return found.beta, found
        >>> (beta, found), slope = jax.value_and_grad(index, has_aux=True)(250e3)
        >>> print(found.status, f"{beta:.4f}, {1e3 * slope:.5f} per kN")
        0 3.5031, 0.02250 per kN
    """
    require_limit_state(limit_state)
    quantities = as_quantities(quantities)
    checks.require_whole_number(steps, "steps")
    dtype = jax.dtypes.canonicalize_dtype(float)
    tol = check_tolerance(tol, _TOLERANCE[str(dtype)])
    tol = jnp.asarray(tol, dtype) if isinstance(tol, jax.core.Tracer) else np.asarray(tol, dtype)
    begin = np.zeros(quantities.size, dtype) if start is None else quantities.normal_at(start)
    task = quantities, tuple(args), begin
    traced = trace_limit_state(limit_state, quantities, tuple(args))
    if is_plain_call((traced, *task, tol)):
        return _search_on_host(traced, *task, steps, tol)
    within = _within_program.find((traced.equations, steps), lambda: _make_traced_search(steps))
    return within(traced, *task, tol)


def _vector(limit_state, quantities, args, u):
    """Return all limit states at u."""
    return limit_state_vector(limit_state(quantities.values_at(u), *args))


@as_program
def _evaluate(limit_state, number, quantities, args, state):
    """Return one of the limit states, the one with this number, at a trial point, and its gradient.

    `limit_state` is a `TracedFunction`; the gradient is [n].
    """
    return jax.value_and_grad(lambda u: _vector(limit_state, quantities, args, u)[number])(
        state.trial()
    )


def _search_on_host(limit_state, quantities, args, begin, steps, tol):
    """Search in Python, one limit state after the other."""
    start, names = _initial_state(quantities, begin, tol), names_of_outcome(limit_state.result)
    advance, results = functools.partial(_advance, tol=tol, steps=steps), []
    for number in range(1 if names is None else len(names)):

        def evaluate(state, number=number):
            return _evaluate(limit_state, np.int32(number), quantities, args, state)

        results.append(_fields(search_on_host(evaluate, advance, start), quantities))
    fields = results[0]
    if names is not None:
        fields = jax.tree.map(lambda *parts: jnp.asarray(np.stack(parts)), *results)
    return FirstOrder(*fields, limit_states=names, layout=quantities.layout)


@as_program
def _initial_state(quantities, begin, tol):
    """Return the state before a search."""
    return begin_search(begin, quantities.are_valid() & is_valid_tolerance(tol))


def _advance(state, found, tol, steps):
    """Return the next state of a search, by what is `found`: limit state and gradient."""
    return _advance_program(state, *found, tol, steps=steps)


_advance_program = as_program(advance_search, static=("steps",))


def _make_traced_search(steps):
    """Return `first_order` as a part of another program; the limit state is a `TracedFunction`."""

    def run(limit_state, quantities, args, begin, tol):
        names = names_of_outcome(limit_state.result)
        # `numbers` are all that has a part in it but u: quantities, args, captured variables
        function, numbers = convert_closure(
            lambda u: _vector(limit_state, quantities, args, u), begin
        )
        numbers = [jnp.asarray(number) for number in numbers]
        held = lax.stop_gradient(numbers)
        own, start, within = lax.stop_gradient((quantities, begin, tol))

        def search(number):
            def evaluate(state):
                return jax.value_and_grad(lambda u: function(u, held)[number])(state.trial())

            advance = functools.partial(_advance, tol=within, steps=steps)
            state = search_in_program(evaluate, advance, _initial_state(own, start, within))
            code, beta, _, *others = _fields(state, own)
            beta = attach_derivative(function, number, beta, state.point, numbers)
            floats = [isinstance(x, dict) or x.dtype == beta.dtype for x in others]
            others = [
                without_derivative(x, numbers) if has_derivative else x
                for x, has_derivative in zip(others, floats, strict=True)
            ]
            return code, beta, ndtr(-beta), *others

        found = jax.vmap(search)(jnp.arange(1 if names is None else len(names)))
        if names is None:
            found = jax.tree.map(lambda leaf: leaf[0], found)
        return FirstOrder(*found, limit_states=names, layout=quantities.layout)

    return jax.jit(run)


@as_program
def _fields(state, quantities):
    """Return the fields of `FirstOrder`, without derivatives, of a search that has ended."""
    layout, point, factor = quantities.layout, state.point, quantities.factor()
    good = state.code == status.OK
    values = point.alpha(), point.alpha() @ point.u, point.u
    alpha, beta, u = (jnp.where(good, value, jnp.nan) for value in values)
    importance = alpha
    if factor is not None:  # z = L u: the linearized limit state is beta - alpha . L^-1 z
        importance = unbatched.solve_triangular(factor, alpha, transposed=True)
        importance = importance / jnp.sqrt(jnp.sum(importance**2))
    by_name = [split_by_name(layout, x) for x in (u, alpha, importance)]
    counts = state.iterations, state.evaluations, state.failures
    far = [jnp.where(good, x, jnp.nan) for x in (point.distance(), point.misalignment())]
    last = quantities.values_at(point.u)
    return (
        *(state.code, beta, ndtr(-beta), quantities.values_at(u)),
        *(*by_name, *counts, *far, last),
    )


_within_program = KnownPrograms()
