"""Reliability index and design point by the first-order reliability method (FORM)."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import Any, ClassVar

import jax
import jax.numpy as jnp
from jax import lax
from jax.scipy.special import ndtr

from ..common import checks, status
from ..common.compilation import call_announced
from ..common.function_programs import ProgramCache
from ..common.jax_internals import convert_closure
from ..common.tree import copy_with, pytree
from ..common.types import Array, ArrayLike, Float, Int
from ..design.arguments import check_tolerance, is_valid_tolerance
from ..linear import unbatched
from .distributions import Distribution
from .index_derivative import attach_derivative, without_derivative
from .limit_states import limit_state_names, limit_state_vector, require_limit_state
from .quantities import Layout, Quantities, as_quantities, split_by_name
from .search import find_design_point, value_and_gradient

_TOLERANCE = {"float64": 1e-6, "float32": 1e-3}


@pytree(static=("limit_states", "layout"))
class FirstOrder:
    """Result of `first_order`; of several limit states, each array has a leading axis [m].

    All but `status`, `last_point` and the counts is NaN if the search has failed.

    Attributes:
        status: status code, 0 (OK) if converged. OUT_OF_STEPS; STALLED: no step lowers the merit,
            as at a kink, beyond which the analysis fails, or where the surface cannot be reached;
            BAD_START: limit state or gradient are not finite at the start; STATIONARY: the gradient
            is zero there, so give another `start`; INVALID_INPUT: a traced number is not allowed.
        beta: reliability index: distance of the design point from the origin in standard normal
            space, negative if the limit state is violated at the origin (all medians).
        probability: of failure to first order, ``Phi(-beta)``.
        design_point: values of all quantities at the design point, by name.
        u: its independent standard normal values, by name.
        alpha: sensitivity factors by name: the unit vector ``u / beta``; positive where a larger
            value is adverse. With a correlation they belong to the independent variables u, and
            depend on the order of the quantities.
        importance: sensitivity factors of the correlated standard normal variables, scaled to unit
            length (Der Kiureghian 2005); they do not depend on the order. Without correlation they
            are `alpha`.
        iterations: number of accepted steps.
        evaluations: number of evaluations of limit state and gradient.
        failures: number of these at which limit state or gradient were not finite, as where the
            analysis failed: there the step was shortened.
        distance: distance of the point found from the surface, to first order, in u.
        misalignment: distance of the point found from the line along the gradient, in u.
        last_point: values by name where the search ended, whatever its status.
        limit_states: names of the limit states: those of the dict, "0", "1" and so on of a vector,
            None of a single one.
        layout: names and shapes of the quantities, in their order.

    Example:
        >>> Normal = jc.reliability.Normal
        >>> quantities = {"R": Normal(30.0, 3.0), "S": Normal(18.0, 4.0)}
        >>> found = jc.reliability.first_order(lambda x: x["R"] - x["S"], quantities)
        >>> print(jc.describe(found.status), f"{found.beta:.3f} {found.probability:.3e}")
        converged 2.400 8.198e-03
        >>> {name: round(float(share), 4) for name, share in found.alpha_squared.items()}
        {'R': 0.36, 'S': 0.64}
    """

    _shown: ClassVar[str] = "beta, probability, design_point, alpha, iterations, failures"

    status: Int[Array, " *m"]
    beta: Float[Array, " *m"]
    probability: Float[Array, " *m"]
    design_point: dict[str, Float[Array, " ..."]]
    u: dict[str, Float[Array, " ..."]]
    alpha: dict[str, Float[Array, " ..."]]
    importance: dict[str, Float[Array, " ..."]]
    iterations: Int[Array, " *m"]
    evaluations: Int[Array, " *m"]
    failures: Int[Array, " *m"]
    distance: Float[Array, " *m"]
    misalignment: Float[Array, " *m"]
    last_point: dict[str, Float[Array, " ..."]]
    limit_states: tuple[str, ...] | None
    layout: Layout

    @property
    def alpha_squared(self) -> dict[str, Float[Array, " ..."]]:
        """Squares of `alpha` by name, of sum 1: parts in the variance of the linearized state."""
        return {name: self.alpha[name] ** 2 for name, _ in self.layout}

    def of(self, limit_state: str) -> FirstOrder:
        """Return the result of one of several limit states, by its name."""
        names = self.limit_states or ()
        if limit_state not in names:
            raise ValueError(f"limit_state: none{checks.suggest_names(limit_state, names)}")
        one = jax.tree.map(lambda leaf: leaf[names.index(limit_state)], self)
        return copy_with(one, limit_states=None)


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
        args: tuple of further arguments of the limit state, any pytrees. It is compiled once per
            function object: variables that it captures become constants of the program.
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
    dtype = jnp.zeros(0).dtype
    tol = jnp.asarray(check_tolerance(tol, _TOLERANCE[str(dtype)]), dtype)
    begin = quantities.normal_at({} if start is None else start)
    return call_announced(_programs(limit_state, steps), quantities, tuple(args), begin, tol)


def _compile_first_order(reference, steps):
    """Return the program of `first_order` for the limit state ``reference()``."""

    def run(quantities, args, begin, tol):
        def outcome(values):
            return reference()(values, *args)

        names = limit_state_names(outcome, quantities.values_at(begin))
        count = 1 if names is None else len(names)
        # `numbers` are all that has a part in it but u: quantities, args, captured variables
        function, numbers = convert_closure(
            lambda u: limit_state_vector(outcome(quantities.values_at(u))), begin
        )
        numbers = [jnp.asarray(number) for number in numbers]
        held = lax.stop_gradient(numbers)
        valid = lax.stop_gradient(quantities.are_valid()) & is_valid_tolerance(tol)
        factor = quantities.factor()

        def search(number):
            evaluate = value_and_gradient(lambda u: function(u, held), number)
            start, within = lax.stop_gradient((begin, tol))
            state = find_design_point(evaluate, start, steps, within, valid)
            return _results(state, number, function, numbers, factor, quantities)

        found = jax.vmap(search)(jnp.arange(count))
        if names is None:
            found = jax.tree.map(lambda leaf: leaf[0], found)
        return FirstOrder(*found, limit_states=names, layout=quantities.layout)

    return jax.jit(run)


_programs = ProgramCache(_compile_first_order)


def _results(state, number, function, numbers, factor, quantities):
    """Return the fields of `FirstOrder` of one limit state."""
    layout, point = quantities.layout, state.point
    good = state.code == status.OK
    alpha, beta, slope, u = (
        jnp.where(good, value, jnp.nan)
        for value in (point.alpha(), point.alpha() @ point.u, point.slope(), point.u)
    )
    importance = alpha
    if factor is not None:  # z = L u: the linearized limit state is beta - alpha . L^-1 z
        importance = unbatched.solve_triangular(lax.stop_gradient(factor), alpha, transposed=True)
        importance = importance / jnp.sqrt(jnp.sum(importance**2))
    held = lax.stop_gradient(quantities)
    apart = held.values_at(u), *(split_by_name(layout, x) for x in (u, alpha, importance))
    further = point.distance(), point.misalignment(), held.values_at(point.u)
    beta = attach_derivative(function, number, beta, u, slope, numbers)
    apart, (distance, misalignment, last) = without_derivative((apart, further), numbers)
    code = state.code
    counts = state.iterations, state.evaluations, state.failures
    good_only = [jnp.where(good, value, jnp.nan) for value in (distance, misalignment)]
    return code, beta, ndtr(-beta), *apart, *counts, *good_only, last
