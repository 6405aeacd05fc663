"""The result of the first-order reliability method."""

from __future__ import annotations

from typing import ClassVar

import jax

from ..common import checks
from ..common.tree import copy_with, pytree
from ..common.types import Array, Float, Int
from .quantities import Layout


@pytree
class DesignPoints:
    """All design points found of a limit state, nearest first, in rows of an axis [k].

    Under jit there are as many rows as `first_order` looks for, of which those not found are NaN.

    Attributes:
        beta: their indices, [k]: distances of the points from the origin, all of one sign.
        curvature: smallest principal curvature of the distance there, as of `FirstOrder`, [k].
        design_point, u, alpha: by name with a leading axis [k], as of `FirstOrder`.

    Example:
        A member that fails beyond either of two limits:

        >>> quantities = {"load": jc.reliability.Normal(1.0, 10.0)}  # kN
        >>> found = jc.reliability.first_order(lambda x: 31.0**2 - x["load"] ** 2, quantities)
        >>> print(found.status, found.points.beta, found.points.design_point["load"])
        0 [3.  3.2] [ 31. -31.]
    """

    beta: Float[Array, "*m k"]
    curvature: Float[Array, "*m k"]
    design_point: dict[str, Float[Array, " ..."]]
    u: dict[str, Float[Array, " ..."]]
    alpha: dict[str, Float[Array, " ..."]]


@pytree(static=("limit_states", "layout"))
class FirstOrder:
    """Result of `first_order`; of several limit states, each array has a leading axis [m].

    All but `status`, `last_point` and the counts is NaN if the search has failed.

    Attributes:
        status: status code, 0 (OK) if converged. OUT_OF_STEPS; STALLED: no step lowers the merit,
            as at a kink, beyond which the analysis fails, or where the surface cannot be reached;
            BAD_START: limit state or gradient are not finite at the start; STATIONARY: the gradient
            is zero there and the other starts find nothing, so give another `start`; NOT_NEAREST:
            the point found is no minimum, or a nearer one fails; INVALID_INPUT: a traced number is
            not allowed.
        beta: reliability index: distance of the design point from the origin in standard normal
            space, negative if the limit state is violated at the origin (all medians). Of several
            design points that of the nearest one, as all that follows but `points`.
        probability: of failure to first order: ``Phi(-beta)``, or of several design points that of
            the series system of their linearized surfaces, exact for two, Ditlevsen's upper bound
            for more (`series_system`). Where the origin fails it is that of the nearest point.
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
        misalignment: estimated distance of the point found from the minimum, in u: that from the
            line along the gradient, over `curvature` (between 0.01 and 1).
        curvature: smallest principal curvature of the distance along the surface at the design
            point, ``1 + beta lambda`` with the least eigenvalue ``lambda`` of ``d2G/du2 / |dG/du|``
            in the tangent plane: 1 for a plane, 0 for a sphere around the origin. Near 0 the
            surface bends around the origin, and the probability to first order is too small. It is
            not the sum of all curvatures: of many quantities those add up. NaN if the limit state
            is not finite beside the point.
        points: all design points found, as `DesignPoints`.
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
    curvature: Float[Array, " *m"]
    points: DesignPoints
    last_point: dict[str, Float[Array, " ..."]]
    limit_states: tuple[str, ...] | None
    layout: Layout

    @property
    def alpha_squared(self) -> dict[str, Float[Array, " ..."]]:
        """Squares of `alpha` by name, of sum 1: parts in the variance of the linearized state."""
        return {name: self.alpha[name] ** 2 for name, _ in self.layout}

    def select_limit_state(self, limit_state: str) -> FirstOrder:
        """Return the result of one of several limit states, by its name."""
        names = self.limit_states or ()
        if limit_state not in names:
            raise ValueError(f"limit_state: none{checks.suggest_names(limit_state, names)}")
        one = jax.tree.map(lambda leaf: leaf[names.index(limit_state)], self)
        return copy_with(one, limit_states=None)
