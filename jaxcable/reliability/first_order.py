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
from ..common.tree import copy_with
from ..common.types import ArrayLike, Float
from ..design.arguments import check_tolerance, is_valid_tolerance
from ..design.search_loop import is_plain_call, search_in_program, search_on_host
from ..linear import unbatched
from ..programs.known import KnownPrograms
from ..programs.program_calls import as_program
from .distributions import Distribution
from .exploration import advance_exploration, begin_exploration, estimated_error
from .first_order_result import DesignPoints, FirstOrder
from .index_derivative import attach_derivative, without_derivative, without_derivative_where
from .limit_states import (
    limit_state_vector,
    names_of_outcome,
    require_limit_state,
    trace_limit_state,
)
from .quantities import Quantities, as_quantities, split_by_name
from .search import Point
from .systems import NEVER, rows_without_point, union_bounds

_TOLERANCE = {"float64": 1e-6, "float32": 1e-3}


def first_order(
    limit_state: Callable[..., Any],
    quantities: Quantities | Mapping[str, Distribution],
    *,
    args: tuple[Any, ...] = (),
    start: Mapping[str, Float[ArrayLike, " ..."]] | None = None,
    steps: int = 100,
    tol: Float[ArrayLike, ""] | None = None,
    points: int = 3,
) -> FirstOrder:
    """Find reliability index and design point by the first-order reliability method (FORM).

    The limit state is linearized at its most probable point in standard normal space, by exact
    gradients (iHL-RF iteration: Zhang and Der Kiureghian 1995). Where the search ends, differences
    of the gradient tell whether the distance is a minimum; if not, it goes on along the direction
    of negative curvature. Searches for other design points begin at the origin, opposite to the
    first point, and on either side in the direction in which the surface bends most; then, while
    they find some, with the surface bulged out around known points (Der Kiureghian and Dakessian
    1998). No search proves that there is no other point: `importance_sampling` without a center is
    the independent check.

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
            where all are by default. It leads to the nearest design point around.
        steps: largest number of accepted steps of each search.
        tol: largest distance of the point found from the surface and, estimated by the curvature,
            from the minimum, in standard normal space, over the distance from the origin (at least
            1): so far off are `u` and `alpha`. The error of `beta` is of its second order. If a
            surface is nearly a sphere (curvature below 0.01), or rounding prevents it,
            `misalignment` says what was reached. Default: 1e-6 in float64, 1e-3 in float32.
        points: largest number of design points of each limit state. With 1 there is no further
            search, which takes a half to a fifth of the evaluations and may miss a nearer point.

    Returns:
        `FirstOrder`. Works under jit and vmap. The derivatives of `beta` and `probability` by
        means and scatters, correlations and all floats in `args`, or that the limit state captures,
        are exact: ``dG/dp / |dG/du|`` at the design point, which is stationary (envelope
        theorem); so are those of ``points.beta``. The derivative of `probability` is NaN if there
        are several design points. The other results, and second derivatives, have NaN.

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
    checks.require_whole_number(points, "points")
    dtype = jax.dtypes.canonicalize_dtype(float)
    tol = check_tolerance(tol, _TOLERANCE[str(dtype)])
    tol = jnp.asarray(tol, dtype) if isinstance(tol, jax.core.Tracer) else np.asarray(tol, dtype)
    begin = np.zeros(quantities.size, dtype) if start is None else quantities.normal_at(start)
    task = quantities, tuple(args), begin
    traced = trace_limit_state(limit_state, quantities, tuple(args))
    if is_plain_call((traced, *task, tol)):
        return _search_on_host(traced, *task, tol, steps, points)
    key = traced.equations, steps, points
    within = _within_program.find(key, lambda: _make_traced_search(steps, points))
    return within(traced, *task, tol)


def _vector(limit_state, quantities, args, u):
    """Return all limit states at u."""
    return limit_state_vector(limit_state(quantities.values_at(u), *args))


@as_program
def _evaluate(limit_state, number, quantities, args, u):
    """Return one of the limit states, the one with this number, at the point u, and its gradient.

    `limit_state` is a `TracedFunction`; the gradient is [n].
    """
    return jax.value_and_grad(lambda u: _vector(limit_state, quantities, args, u)[number])(u)


def _search_on_host(limit_state, quantities, args, begin, tol, steps, points):
    """Search in Python, one limit state after the other."""
    start = _initial_state(quantities, begin, tol, points=points)
    names, results = names_of_outcome(limit_state.result), []
    by_name = [{name: np.zeros(shape)} for name, shape in quantities.layout]
    advance = functools.partial(_advance, tol=tol, steps=steps)
    for number in range(1 if names is None else len(names)):

        def evaluate(state, number=number):
            return _evaluate(limit_state, np.int32(number), quantities, args, state.trial)

        end = search_on_host(evaluate, advance, start, params=by_name)
        results.append(_result(end, quantities))
    found = results[0]
    if names is not None:
        found = jax.tree.map(lambda *parts: jnp.asarray(np.stack(parts)), *results)
    count = max(int((~np.isnan(found.points.beta)).sum(axis=-1).max()), 1)
    axis = 0 if names is None else 1
    used = jax.tree.map(lambda leaf: leaf[(slice(None),) * axis + (slice(count),)], found.points)
    return copy_with(found, points=used, limit_states=names)


@functools.partial(as_program, static=("points",))
def _initial_state(quantities, begin, tol, *, points):
    """Return the state before a search."""
    return begin_exploration(begin, quantities.are_valid() & is_valid_tolerance(tol), points)


def _advance(state, found, tol, steps):
    """Return the next state of a search, by what is `found`: limit state and gradient."""
    return _advance_program(state, *found, tol, steps=steps)


_advance_program = as_program(advance_exploration, static=("steps",))


def _make_traced_search(steps, points):
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
                return jax.value_and_grad(lambda u: function(u, held)[number])(state.trial)

            advance = functools.partial(_advance, tol=within, steps=steps)
            state = search_in_program(
                evaluate, advance, _initial_state(own, start, within, points=points)
            )
            return _result(state, own), state.found.by_distance()[0]

        each = jnp.arange(1 if names is None else len(names))
        found, near = jax.vmap(search)(each)
        betas = _with_own_derivatives(function, each, found, near, numbers)
        found = jax.vmap(functools.partial(_with_derivatives, numbers=numbers))(found, betas)
        if names is None:
            found = jax.tree.map(lambda leaf: leaf[0], found)
        return copy_with(found, limit_states=names)

    return jax.jit(run)


def _with_own_derivatives(function, each, found, near, numbers):
    """Return the indices of all design points of all limit states, [m, k], with derivatives."""
    absent = jnp.isnan(found.points.beta) & ~jnp.isnan(found.beta[:, None])
    # rows that repeat the first point: a NaN there would enter the derivatives of others
    betas = jnp.where(absent, found.beta[:, None], found.points.beta)
    m, k = betas.shape
    flat = Point(*(array.reshape(m * k, *array.shape[2:]) for array in near))
    attach = functools.partial(attach_derivative, function, numbers=numbers)
    attached = jax.vmap(lambda *row: attach(*row))(jnp.repeat(each, k), betas.ravel(), flat)
    return jnp.where(absent, jnp.nan, attached.reshape(m, k))


def _with_derivatives(found, betas, *, numbers):
    """Return a result with the derivatives that it has, by `betas`, and NaN for all others."""
    several = jnp.sum(~rows_without_point(betas)) > 1
    alone = ndtr(-betas[0])
    probability = alone + lax.stop_gradient(found.probability - alone)
    bare = jax.tree.map(
        lambda leaf: (
            without_derivative(leaf, numbers) if jnp.issubdtype(leaf.dtype, jnp.floating) else leaf
        ),
        found,
    )
    return copy_with(
        bare,
        beta=betas[0],
        probability=without_derivative_where(several, probability, numbers),
        points=copy_with(bare.points, beta=betas),
    )


@as_program
def _result(state, quantities):
    """Return the `FirstOrder`, without derivatives, of a search that has ended."""
    layout, factor = quantities.layout, quantities.factor()
    near, curvature, count = state.found.by_distance()
    good = state.code == status.OK
    found = good & (np.arange(len(curvature)) < count)
    alphas = jax.vmap(Point.alpha)(near)
    betas = jnp.where(found, jax.vmap(Point.beta)(near), jnp.nan)
    u, alphas = (jnp.where(found[:, None], x, jnp.nan) for x in (near.u, alphas))
    curvature = jnp.where(found, curvature, jnp.nan)
    first = Point(near.u[0], near.value[0], near.gradient[0])
    importance = alphas[0]
    if factor is not None:  # z = L u: the linearized limit state is beta - alpha . L^-1 z
        importance = unbatched.solve_triangular(factor, importance, transposed=True)
        importance = importance / jnp.sqrt(jnp.sum(importance**2))
    absent = rows_without_point(betas)
    system = union_bounds(jnp.where(absent, NEVER, betas), jnp.where(absent[:, None], 0.0, alphas))
    several = jnp.sum(~absent) > 1
    far = [
        jnp.where(good, x, jnp.nan)
        for x in (first.distance(), estimated_error(first, curvature[0]))
    ]
    last = quantities.values_at(jnp.where(good, first.u, state.search.point.u))
    every = DesignPoints(
        betas,
        curvature,
        jax.vmap(quantities.values_at)(u),
        *(split_by_name(layout, x) for x in (u, alphas)),
    )
    nearest = jax.tree.map(lambda leaf: leaf[0], every)
    return FirstOrder(
        *(state.code, nearest.beta, jnp.where(several, system.high, ndtr(-nearest.beta))),
        *(nearest.design_point, nearest.u, nearest.alpha),
        split_by_name(layout, importance),
        *(state.iterations, state.evaluations, state.failures),
        *(*far, nearest.curvature, every, last),
        limit_states=None,
        layout=layout,
    )


_within_program = KnownPrograms()
