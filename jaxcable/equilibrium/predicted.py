"""Axial forces predicted by the last step, so that stiff bars that turn converge.

A step sideways lengthens a bar in second order. Where EA is large, its force EA e at the next point
is then larger than the true one by orders of magnitude: the geometric stiffness N/l resists the
next step, and the line search allows tiny steps only. Nets of cables have their tensions as
unknowns (`tensions`). In all other structures, but for nets beyond a peak of their law, every bar
and cable has a predicted force N^ beside its force N: that at the end of the last step, linearized
at the start of that step,

    (K + sum of (N^ - N)/l (I - n n^T)) p = -R,      N^_new = N + k n.p,

with the chord's direction n and length l, and k the derivative of N by l. The residual R is the
true one, so that the iteration ends in equilibrium. The line search sees forces cut to 3 |N^_new|:
the exact penalty of the constraint l = L(N) in the sense of sequential quadratic programming, of
which p is a descent direction where the matrix is positive definite. At the end N^ = N, and the
iteration is Newton's.

Predicted forces can cycle, for example where a cable alternates between slack and taut: every 40
such steps are followed by 10 of Newton's own with the line search on true forces.

Source: Magisano, Leonetti, Garcea, "How to improve efficiency and robustness of the Newton method
in geometrically non-linear structural problem discretized via displacement-based finite elements"
(2017); Nocedal, Wright, "Numerical optimization" (2006), chapter 18, for the penalty.
"""

from __future__ import annotations

import jax.numpy as jnp
import numpy as np
from jax import lax
from jax.typing import DTypeLike

from ..common.tree import copy, pytree
from ..common.types import Array, Bool, Float, Int
from ..mechanics.assembly import System
from ..mechanics.chords import Chords, tension_only

_CYCLE = 50, 40  # steps of a cycle, and how many of them are predicted
_CUT = 3.0  # forces in the line search over predicted ones: from 2 to 5 alike in the bank
_LEAST = 1e-3  # force in the line search that is never cut, over the largest load at a node


@pytree
class Predicted:
    """Policy of structures with axial forces that are predicted.

    Attributes:
        force: N^ of every element with a chord, [n], N.
        limit: force beyond which the line search does not follow, [n], N.
        known: whether the last step has predicted N^; if not, the current forces are used.
    """

    force: Float[Array, " n"]
    limit: Float[Array, " n"]
    known: Bool[Array, ""]

    @classmethod
    def init(cls, system: System, dtype: DTypeLike) -> Predicted:
        """The start, before any force is known."""
        n = len(tension_only(system.groups))
        return cls(jnp.zeros(n, dtype), jnp.full(n, jnp.inf, dtype), jnp.zeros((), bool))

    def beyond_limit(self, force: Float[Array, " n"]) -> Float[Array, " n"]:
        """The part of a force that is cut in the line search, [n], N."""
        return force - lax.clamp(-self.limit, force, self.limit)

    def forces_at(self, chords: Chords, on: Bool[Array, ""]) -> Float[Array, " n"]:
        """Forces of the geometric stiffness: predicted ones where these are `on`, [n], N."""
        return jnp.where(on & self.known, self.force, chords.force)

    def stepped(self, system: System, force: Float[Array, " n"], on: Bool[Array, ""]) -> Predicted:
        """The policy for a step that leads to `force` [n], N, by linear equations.

        Without prediction (`on` False) the line search uses true forces.
        """
        least = np.where(tension_only(system.groups), 0.0, -np.inf).astype(force.dtype)
        force = jnp.maximum(force, least)
        load = jnp.max(system.space.size(system.load))
        limit = jnp.maximum(_CUT * jnp.abs(force), _LEAST * load)
        return copy(self, force=force, limit=jnp.where(on, limit, jnp.inf), known=on)


def in_turn(steps: Int[Array, ""]) -> Bool[Array, ""]:
    """Whether the step after so many is one with predicted forces."""
    cycle, predicted = _CYCLE
    return steps % cycle < predicted


def part_of_turn(turn: Float[Array, ""]) -> Float[Array, ""]:
    """The part of a step that moves no element's ends apart by more than its length.

    Args:
        turn: largest square of their relative motion over the length (`Chords.turn`).
    """
    return lax.rsqrt(jnp.maximum(turn, 1.0))
