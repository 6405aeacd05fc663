"""Axial forces predicted by the last step, so that stiff bars that turn converge.

A step sideways lengthens a bar in second order. Where EA is large, its force EA e at the next point
is then larger than the true one by orders of magnitude: the geometric stiffness N/l resists the
next step, and the line search allows tiny steps only. Nets of cables have their tensions as
unknowns (`tension_unknowns`). In all other structures, but for nets beyond a peak of their law,
every bar and cable has a predicted force N^ beside its force N: that at the end of the last step,
linearized at the start of that step,

    (K + sum of (N^ - N)/l (I - n n^T)) p = -R,      N^_new = N + k n.p,

with the chord's direction n and length l, and k the derivative of N by l. The residual R is the
true one, so that the iteration ends in equilibrium. The line search sees forces cut to 3 |N^_new|:
the exact penalty of the constraint l = L(N) in the sense of sequential quadratic programming, of
which p is a descent direction where the matrix is positive definite. At the end N^ = N, and the
iteration is Newton's.

Contacts press only. A step sideways lengthens them, too, so that a contact opens which stays closed
by the linear equations of the step: without it the next step is that of another structure. An open
contact with a predicted compression is a spring in the next step, which pulls it closed again: the
one that it was when it was last closed, with its force k (l - l_0) in R, at the length l_0 of
opening. It is left out where such a step was not accepted. The line search sees contacts as they
are, and never cuts their compression, because no step sideways makes any: cut off, what closes
within a step would be missing in the search.

Predicted forces can cycle: every 40 such steps are followed by 10 of Newton's own with the line
search on true forces.

Source: Magisano, Leonetti, Garcea, "How to improve efficiency and robustness of the Newton method
in geometrically non-linear structural problem discretized via displacement-based finite elements"
(2017); Nocedal, Wright, "Numerical optimization" (2006), chapter 18, for the penalty.
"""

from __future__ import annotations

from collections.abc import Sequence

import jax.numpy as jnp
import numpy as np
from jax import lax
from jax.typing import DTypeLike

from ..common.tree import copy_with, pytree
from ..common.types import Array, Bool, Float, Int
from ..mechanics.assembly import System
from ..mechanics.chords import (
    Chords,
    compression_only_chords,
    second_minus_first_end,
    tension_only_chords,
)
from ..spaces.space import Forces, Motion, Step

_CYCLE = 50, 40  # steps of a cycle, and how many of them have predicted forces
# Largest force in the line search, over the predicted one: from 2 to 5 alike in the bank of bars.
_MAX_OF_PREDICTED = 3.0
# Force that the line search never cuts, over the largest load at a node: without it, bars with a
# predicted force near zero could take no load in the search.
_NEVER_CUT = 1e-3


@pytree
class PredictedForces:
    """Predicted axial forces along all `Chords`: elements with two ends, and segments of chains.

    Attributes:
        force: predicted axial forces, [n], N; tension positive.
        cut_off: size up to which the line search counts axial forces, [n], N.
        is_known: whether the last step has predicted forces; if not, current ones are used.
        springs: what contacts are as long as they are closed: derivatives of their forces by their
            lengths, N/m, and the lengths at which they open, m, [n] each; derivatives are zero
            where an element is no contact, or was open. None without contacts.
    """

    force: Float[Array, " n"]
    cut_off: Float[Array, " n"]
    is_known: Bool[Array, ""]
    springs: tuple[Float[Array, " n"], Float[Array, " n"]] | None

    @classmethod
    def initial(cls, system: System, dtype: DTypeLike) -> PredictedForces:
        """Return the state before any force is predicted: nothing known, nothing cut off."""
        n, presses = len(tension_only_chords(system.groups)), compression_only_chords(system.groups)
        none = jnp.zeros(n, dtype)
        springs = (none, none) if presses.any() else None
        return cls(none, jnp.full(n, jnp.inf, dtype), jnp.zeros((), bool), springs)

    def excess_force(self, force: Float[Array, " n"]) -> Float[Array, " n"]:
        """Return the parts of axial forces that the line search ignores, beyond its cut-off, N."""
        return force - lax.clamp(-self.cut_off, force, self.cut_off)

    def geometric_forces(self, chords: Chords, predicting: Bool[Array, ""]) -> Float[Array, " n"]:
        """Return axial forces for the geometric stiffness, [n], N: predicted if `predicting`."""
        return jnp.where(predicting & self.is_known, self.force, chords.force)

    def hold_contacts_closed(
        self,
        system: System,
        x: Motion,
        chords: Chords,
        tangents: Sequence[Float[Array, "n_elem d d"]],
        predicting: Bool[Array, ""],
    ) -> tuple[Chords, Sequence[Float[Array, "n_elem d d"]], Step | None]:
        """Return `Chords.with_springs` in contacts that are open but have a predicted compression.

        Without contacts chords and tangents are returned as they are, and None. Arguments are those
        of `after_step`, and the motion `x` before the step.
        """
        if self.springs is None:
            return chords, tangents, None
        slope, length = self.springs
        held = predicting & self.is_known & (self.force < 0) & (chords.force == 0)
        slope = jnp.where(held, slope, 0.0)
        force = jnp.where(held, slope * (chords.length - length), 0.0)
        return chords.with_springs(system, x, tangents, force, slope)

    def after_trial(self, accepted: Bool[Array, ""], moved: Bool[Array, ""]) -> PredictedForces:
        """Return a copy that holds no contact closed after a step that was not accepted.

        Arguments are those of `StepMethod.choose`.
        """
        if self.springs is None:
            return self
        slope, length = self.springs
        return copy_with(self, springs=(jnp.where(accepted | ~moved, slope, 0.0), length))

    def for_step(
        self, system: System, force: Float[Array, " n"], predicting: Bool[Array, ""]
    ) -> PredictedForces:
        """Return the predicted forces after a step, with their cut-off.

        Args:
            system: `System`.
            force: forces to which the step leads by its linear equations, [n], N.
            predicting: whether the step's matrix has predicted forces; else nothing is cut off.
        """
        least = np.where(tension_only_chords(system.groups), 0.0, -np.inf).astype(force.dtype)
        force = jnp.maximum(force, least)
        load = system.largest_load()
        cut_off = jnp.maximum(_MAX_OF_PREDICTED * jnp.abs(force), _NEVER_CUT * load)
        presses = compression_only_chords(system.groups)
        if presses.any():
            force = jnp.where(presses, jnp.minimum(force, 0.0), force)
            # steps sideways lengthen: no compression comes from them
            cut_off = jnp.where(presses, jnp.inf, cut_off)
        cut_off = jnp.where(predicting, cut_off, jnp.inf)
        return copy_with(self, force=force, cut_off=cut_off, is_known=predicting)

    def after_step(
        self,
        system: System,
        chords: Chords,
        row_step: Forces,
        tangents: Sequence[Float[Array, "n_elem d d"]],
        predicting: Bool[Array, ""],
    ) -> tuple[PredictedForces, Float[Array, ""], Float[Array, ""]]:
        """Return `PredictedForces` after a step, the fraction to take, the work of cut forces, J.

        The fraction is the one that moves no element's ends apart by more than its length. The work
        is that which axial forces beyond the cut-off do in the whole step.

        Args:
            system: `System`.
            chords: `Chords` of all elements that have them, before the step.
            row_step: the step, of all nodes (rows).
            tangents: element tangents before the step, per group [n_elem, d, d], N/m.
            predicting: whether the step's matrix has predicted forces; else the fraction is 1.
        """
        apart = second_minus_first_end(system, row_step)
        longer = chords.linearized_elongation(apart)
        force, slope = chords.forces_after_step(system, tangents, row_step, longer)
        predicted = self.for_step(system, force, predicting)
        if self.springs is not None:
            slope = jnp.where(compression_only_chords(system.groups), jnp.maximum(slope, 0.0), 0.0)
            length = chords.length - chords.force / jnp.where(slope > 0, slope, jnp.inf)
            predicted = copy_with(predicted, springs=(slope, length))
        fraction = step_fraction_within_length(chords.max_relative_motion_squared(apart))
        fraction = jnp.where(predicting, fraction, 1.0)
        return predicted, fraction, predicted.excess_force(chords.force) @ longer


def is_prediction_step(steps: Int[Array, ""]) -> Bool[Array, ""]:
    """Return whether the step after so many `steps` is to use predicted forces (40 of 50 are)."""
    cycle, predicted = _CYCLE
    return steps % cycle < predicted


def step_fraction_within_length(squared_motion: Float[Array, ""]) -> Float[Array, ""]:
    """Return the fraction of a step that moves no element's ends apart by more than its length.

    `squared_motion` is `Chords.max_relative_motion_squared` of the whole step.
    """
    return lax.rsqrt(jnp.maximum(squared_motion, 1.0))
