"""What an interior iteration says of its end, for the policy of `tensions`."""

from __future__ import annotations

from typing import NamedTuple

from ..common.types import Array, Bool, Float


class Ending(NamedTuple):
    """Whether an interior iteration is near enough to its end to try that.

    Attributes:
        now: whether to try the end now.
        stuck: whether that is because steps have become short or useless.
        measure: what is left, relative; the end is tried from a limit of it.
        final: whether the iteration cannot go on, if the end fails; None: it can.
        lost: whether it cannot go on, and there is no use in trying the end; None: it can.
    """

    now: Bool[Array, ""]
    stuck: Bool[Array, ""]
    measure: Float[Array, ""]
    final: Bool[Array, ""] | None = None
    lost: Bool[Array, ""] | None = None
