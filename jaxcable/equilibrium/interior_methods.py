"""What both interior-point methods share: some limits, and the decision to finish."""

from __future__ import annotations

from typing import NamedTuple

from ..common.types import Array, Bool, Float

MAX_INTERIOR_STEPS = 100  # a slack net of 60 x 60 nodes takes 33 in all
BLOCKED = 0.05  # a step of which a smaller fraction is taken is blocked by the boundary
UNLOADED = 1e-3  # the load that stands for none, over the largest tension at the start


class FinishDecision(NamedTuple):
    """Decision of an interior-point method whether its solution is near enough for finishing steps.

    Finishing steps are Newton steps on the cables that are taut there.

    Attributes:
        now: whether to try finishing steps now.
        stuck: whether the reason is that interior steps have become short or useless.
        remaining: what the iteration still has to reduce, relative; finishing steps are tried when
            it falls below a threshold.
        final: whether the iteration cannot go on if the finishing steps fail; None: it can.
        failed: whether the iteration cannot go on, and finishing steps are of no use; None: it can.
    """

    now: Bool[Array, ""]
    stuck: Bool[Array, ""]
    remaining: Float[Array, ""]
    final: Bool[Array, ""] | None = None
    failed: Bool[Array, ""] | None = None
