"""Reliability index and design point by the first-order reliability method (FORM)."""

from __future__ import annotations

import functools
from collections.abc import Callable, Mapping
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
from jax.scipy.special import ndtr

from ..analysis.recalled_derivative import without_derivatives
from ..common import checks, status
from ..common.compilation import is_top_level_call
from ..common.tree import copy_with
from ..common.types import ArrayLike, Float
from ..design.arguments import check_tolerance, is_valid_tolerance
from ..design.no_derivative import warn_of_undefined_derivative
from ..linear import unbatched
from ..programs.program_calls import as_program
from ..programs.search_call import run_search
from .distributions import Distribution
from .exploration import Exploration
from .first_order_result import DesignPoints, FirstOrder
from .index_derivative import attach_index_derivatives
from .limit_states import (
    limit_state_vector,
    names_of_outcome,
    require_limit_state,
    trace_limit_state,
)
from .quantities import Quantities, as_quantities, split_by_name
from .search import SearchPoint
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

    The search is a loop in Python, in which every trial point is a program of one limit state and
    its gradient. Within `jax.jit` the compiled program calls it: its cases under `jax.vmap` are
    searched one after the other, and NumPy evaluates the limit state.

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
    begin = np.zeros(quantities.size, dtype) if start is None else quantities.normal_at_value(start)
    task = trace_limit_state(limit_state, quantities, tuple(args)), quantities, tuple(args)
    problem = *task, begin, tol
    search = functools.partial(_search_design_points, steps=steps, points=points)
    if is_top_level_call(jax.tree.leaves(problem)):
        return search(problem, rows=None)[0]
    unknown = Exploration(_limit_state_and_gradient, np.zeros(quantities.size, dtype), 0.0, steps)
    every = [unknown] * _count_limit_states(task[0])
    like = jax.eval_shape(functools.partial(_make_results, every, rows=points), task[0], quantities)
    search = functools.partial(search, rows=points)
    return _with_derivatives(*run_search(search, without_derivatives(problem), like), *task)


def _limit_states(limit_state, quantities, args, u):
    """Return all limit states at u, [n], as a vector [m]; `args` are their further arguments."""
    return limit_state_vector(limit_state(quantities.values_at_normals(u), *args))


@as_program
def _limit_state_and_gradient(limit_state, number, quantities, args, u):
    """Return the limit state with index `number`, and its gradient [n], at the point u, [n].

    `limit_state` is a `TracedFunction` of values by name and of `args`.
    """
    return jax.value_and_grad(lambda u: _limit_states(limit_state, quantities, args, u)[number])(u)


@as_program
def _is_problem_valid(quantities, tol):
    """Return whether the numbers of all quantities, and the tolerance, keep their rules."""
    return quantities.are_valid() & is_valid_tolerance(tol)


def _search_design_points(problem, *, steps, points, rows):
    """Search for the design points of all limit states, one after the other.

    Return the `FirstOrder`, without derivatives, and the `SearchPoint` of every design point, in as
    many `rows` as given; None: as many as there are points.
    """
    limit_state, quantities, args, begin, tol = problem
    begin, tol = np.asarray(begin), np.asarray(tol)[()]
    is_valid, every = _is_problem_valid(quantities, tol), []
    for number in range(_count_limit_states(limit_state)):

        def evaluate(u, number=number):
            found = _limit_state_and_gradient(limit_state, np.int32(number), quantities, args, u)
            value, gradient = map(np.asarray, found)
            return value[()], gradient

        every.append(Exploration(evaluate, begin, tol, steps))
        if is_valid:
            every[-1].run(points)
        if every[-1].code == status.BAD_START:
            by_name = [{name: np.zeros(shape)} for name, shape in quantities.layout]
            warn_of_undefined_derivative(*evaluate(begin), params=by_name)
    rows = rows or max(1, *(len(one.points) for one in every))
    return _make_results(every, limit_state, quantities, rows=rows)


def _count_limit_states(limit_state):
    """Return how many limit states a `TracedFunction` returns."""
    return sum(x.size for x in jax.tree.leaves(limit_state.result))


def _make_results(explorations, limit_state, quantities, *, rows):
    """Return the `FirstOrder`, without derivatives, and the `SearchPoint` of every design point.

    `explorations` has one `Exploration` for each limit state, of which `rows` points are kept.
    """
    outcomes = [one.outcome(rows) for one in explorations]
    outcome = jax.tree.map(lambda *parts: np.stack(parts), *outcomes)
    names = names_of_outcome(limit_state.result)
    return _make_result(outcome, quantities, names=names), outcome.points.point


@functools.partial(as_program, static=("names",))
def _make_result(outcome, quantities, *, names):
    """Return the `FirstOrder`, without derivatives, of an `ExplorationOutcome` with an axis [m].

    `names` are those of the limit states; None for a single one, without that axis.
    """
    found = jax.vmap(functools.partial(_single_result, quantities))(outcome)
    if names is None:
        found = jax.tree.map(lambda leaf: leaf[0], found)
    return copy_with(found, limit_states=names)


def _single_result(quantities, outcome):
    """Return the `FirstOrder`, without derivatives, of one limit state's `ExplorationOutcome`."""
    layout, factor = quantities.layout, quantities.factor()
    points = outcome.points
    alphas, betas = (jax.vmap(of)(points.point) for of in (SearchPoint.alpha, SearchPoint.beta))
    importance = alphas[0]
    if factor is not None:  # z = L u: the linearized limit state is beta - alpha . L^-1 z
        importance = unbatched.solve_triangular(factor, importance, transposed=True)
        importance = importance / jnp.sqrt(jnp.sum(importance**2))
    absent = rows_without_point(betas)
    system = union_bounds(jnp.where(absent, NEVER, betas), jnp.where(absent[:, None], 0.0, alphas))
    several = jnp.sum(~absent) > 1
    every = DesignPoints(
        *(betas, points.curvature, jax.vmap(quantities.values_at_normals)(points.point.u)),
        *(split_by_name(layout, x) for x in (points.point.u, alphas)),
    )
    nearest = jax.tree.map(lambda leaf: leaf[0], every)
    return FirstOrder(
        *(outcome.status, nearest.beta, jnp.where(several, system.high, ndtr(-nearest.beta))),
        *(nearest.design_point, nearest.u, nearest.alpha, split_by_name(layout, importance)),
        *(outcome.iterations, outcome.evaluations, outcome.failures),
        *(outcome.distance, outcome.misalignment, nearest.curvature),
        *(every, quantities.values_at_normals(outcome.last)),
        limit_states=None,
        layout=layout,
    )


@as_program
def _with_derivatives(found, points, *task):
    """Return `found`, a `FirstOrder`, with its derivatives by the numbers of `task`, else NaN ones.

    `points` are all design points; `task` is (limit state, quantities, arguments).
    """
    return attach_index_derivatives(_limit_states, found, points, task)
