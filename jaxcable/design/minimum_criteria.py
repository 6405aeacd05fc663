"""When `minimize` has converged: what is small compared with the loss and the parameters.

Gill, Murray and Wright, Practical Optimization (1981), section 8.2.3, ask for a small gradient, a
small change of the loss and a small step, all at once, because each alone can be small far from a
minimum. The size of a loss that falls to zero is taken from the loss at the start, which may be
huge: the present loss is compared with, too.
"""

from __future__ import annotations

import dataclasses
from typing import Any, NamedTuple

import numpy as np

from ..common.types import Bool, Float
from .bounds import BoxBounds
from .trials import TrialPoint

# Part of the loss at the start that changes are compared with when the loss falls to zero. A larger
# one would let `tol` mean less, the worse the start is.
_FIRST = 0.1


class AcceptedPoint(NamedTuple):
    """A point that the search of `minimize` has accepted, with what the criteria say of it.

    Attributes:
        point: the `TrialPoint`.
        blocked: whether a bound blocks the parameter, [n] bool.
        inside: gradient with zeros where a bound blocks the parameter, [n].
        measure: dimensionless size of the gradient, which `tol` bounds (`minimize`).
        small: whether the gradient is small enough for a minimum in any case.
        at_rest: whether it is small enough for a minimum, provided that no step lowers the loss.
    """

    point: TrialPoint
    blocked: Bool[np.ndarray, " n"]
    inside: Float[np.ndarray, " n"]
    measure: float
    small: bool
    at_rest: bool


@dataclasses.dataclass
class MinimumCriteria:
    """Criteria by which `minimize` decides that a point is a minimum within the bounds.

    Args:
        box: `BoxBounds` of the flat parameters.
        floor: typical sizes of the parameters at the start, [n]; sizes never count as smaller.
        tol: largest dimensionless gradient (`assess`) at convergence.
        first: loss at the start.
        steepest: largest absolute value that each entry of the gradient has had, [n].
    """

    box: BoxBounds
    floor: Float[np.ndarray, " n"]
    tol: float
    first: float
    steepest: Float[np.ndarray, " n"]

    def assess(self, point: TrialPoint) -> AcceptedPoint:
        """Compute the dimensionless size of the gradient at a point, and judge whether it is small.

        It is the largest entry times the size of its parameter, over the size of the loss. Every
        single entry must be small, too: compared with the present loss (unless that has fallen to
        zero), or with the largest value that this entry has had. The loss at the start says nothing
        of parameters that hardly contribute to it.
        """
        loss, first = point.loss, self.first
        blocked = self.box.blocked_entries(point.x, point.gradient)
        inside = np.where(blocked, 0, point.gradient)
        promises = np.abs(inside) * np.maximum(self.floor, self.box.largest_per_array(point.x))
        largest = promises.max()
        # the loss, or a part of the first one if that is more, since no change is small beside a
        # loss that falls to zero; of a loss above the first one only the part counts
        least = _FIRST * abs(first)
        against = max(abs(loss), least) if loss <= first else least
        measure = largest / against if largest > 0 else 0 * largest
        beside, zero = promises <= self.tol * abs(loss), self._is_zero(loss)
        surely, at_rest = (
            measure <= self.tol
            and (zero or (beside | (np.abs(inside) <= part * self.steepest)).all())
            for part in (self.tol**2, self.tol)
        )
        return AcceptedPoint(point, blocked, inside, measure, surely, at_rest)

    def _is_zero(self, loss):
        """Return whether a loss counts as zero: at most tol^3 of that at the start."""
        return abs(loss) <= self.tol**3 * abs(self.first)

    def step_is_short(self, step: Float[np.ndarray, " n"], x: Float[np.ndarray, " n"]) -> bool:
        """Return whether a step [n] from `x` [n] changes every parameter by a negligible amount.

        Negligible is sqrt(tol) of the present size of the parameter, as for a loss that is known to
        a relative precision of `tol` (Gill, Murray and Wright, 1981, section 8.2.3), or tol^1.5 of
        its size at the start.
        """
        allowed = np.maximum(self.box.largest_per_array(x), self.tol * self.floor)
        return bool((np.abs(step) <= np.sqrt(self.tol) * allowed).all())

    def step_is_negligible(
        self, step: Float[np.ndarray, " n"], promised: Any, point: TrialPoint
    ) -> bool:
        """Return whether a step [n] from a point is short, and the decrease that it promises small.

        It is small beside the loss, or if the loss is zero beside that at the start.
        """
        small = promised <= self.tol * abs(point.loss) or self._is_zero(point.loss)
        return bool(small and self.step_is_short(step, point.x))

    def minimum_is_near(self, before: TrialPoint, accepted: AcceptedPoint) -> bool:
        """Return whether the minimum along the step from `before` to a point is near this point.

        It is found by the secant method.
        """
        point = accepted.point
        moved = np.where(accepted.blocked, 0, point.x - before.x)
        slope = point.gradient @ moved
        bend = slope - before.gradient @ moved
        left = abs(slope) / bend
        return bool(bend > 0 and self.step_is_negligible(left * moved, left * abs(slope), point))
