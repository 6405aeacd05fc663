"""The decision of an interior-point method whether finishing steps are tried."""

from __future__ import annotations

from typing import NamedTuple

from ..common.types import Array, Bool, Float


class FinishDecision(NamedTuple):
    """Whether an interior-point iteration is near enough to its solution for finishing steps.

    Attributes:
        now: whether to try finishing steps now.
        stuck: whether the reason is that interior steps have become short or useless.
        remaining: what the iteration still has to reduce, relative; finishing steps are tried from
            a threshold of it.
        final: whether the iteration cannot go on if the finishing steps fail; None: it can.
        failed: whether the iteration cannot go on, and finishing steps are of no use; None: it can.
    """

    now: Bool[Array, ""]
    stuck: Bool[Array, ""]
    remaining: Float[Array, ""]
    final: Bool[Array, ""] | None = None
    failed: Bool[Array, ""] | None = None
