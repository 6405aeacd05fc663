"""What an increment ends with: its outcome, and the status that says why it has failed."""

from __future__ import annotations

import jax.numpy as jnp

from ..common import status
from ..common.tree import pytree, select_tree
from ..common.types import Array, ArrayLike, Bool, Float, Int
from ..linear.sparse import FactorRecord
from ..mechanics.assembly import System
from ..mechanics.pieces import chain_differences
from .newton_state import NewtonState
from .newton_step import max_abs

_MET = 1e-6  # length over initial length at which two nodes have met
# Residual over its rounding up to which the status is AT_ROUNDING: an iteration that rounding stops
# ends near the rounding, not below it.
_NEAR_ROUNDING = 8.0


@pytree
class IncrementOutcome:
    """Outcome of an increment.

    Attributes:
        x: the point reached; if the increment failed, the point that it began with.
        code: status.
        steps: number of Newton steps.
        factorizations: of the tangent; with sparse matrices there can be fewer than steps.
        residual: largest unbalanced force at a free degree of freedom, N.
        scale: the force that the residual is compared with, N.
        rounding: largest residual that the rounding of displacements leaves at a free degree of
            freedom, N; 0 if no element states any (`abilities.RoundingEstimate`).
        equilibrated: whether the increment was iterated to equilibrium.
        stable: whether the tangent at x is known to be positive definite.
    """

    x: Float[Array, "n_row n_motion"]
    code: Int[Array, ""]
    steps: Int[Array, ""]
    factorizations: Int[Array, ""]
    residual: Float[Array, ""]
    scale: Float[Array, ""]
    rounding: Float[Array, ""]
    equilibrated: Bool[Array, ""]
    stable: Bool[Array, ""]

    @property
    def log_row(self) -> Float[Array, " n_log"]:
        """Numbers of the first eight `phase_results.LOG_COLUMNS`, [8]: all fields but x."""
        noted = (self.code, self.steps, self.factorizations, self.residual, self.scale)
        rest = (self.rounding, self.equilibrated, self.stable)
        return jnp.stack([jnp.asarray(x, self.x.dtype) for x in (*noted, *rest)])


def _find_failure_cause(system, end, residual, rounding):
    """Return the status of an iteration; COLLAPSED or AT_ROUNDING if that is why it stopped.

    Args:
        system: `System`.
        end: `NewtonState` in which it has ended.
        residual, rounding: largest residual and its largest rounding error, N.
    """
    ends = [(system.nodes[g.links], end.point.x[g.links][..., :3]) for g in system.groups]
    pieces = [chain_differences(at) for at, _ in ends], [chain_differences(sum(at)) for at in ends]
    before, after = (
        jnp.concatenate([jnp.sum(piece**2, axis=-1).reshape(-1) for piece in of]) for of in pieces
    )
    met = jnp.any((before > 0) & (after <= _MET**2 * before))
    stuck = end.code == status.NOT_CONVERGED
    code = jnp.where(stuck & met, status.COLLAPSED, end.code)
    if end.point.rounding is not None:
        near = is_residual_at_rounding(system, residual, rounding)
        code = jnp.where(stuck & near & ~met, status.AT_ROUNDING, code)
    return code


def is_residual_at_rounding(
    system: System, residual: Float[Array, ""], rounding: Float[Array, ""]
) -> Bool[Array, ""]:
    """Return whether a residual is about as small as the rounding of displacements allows.

    `residual` and `rounding` are the largest residual and its largest rounding error, N.
    """
    # in a net the matrix, which has no fine part, is what cannot tell less than this apart
    plain = jnp.finfo(rounding.dtype).eps if system.is_net else 1.0
    return residual <= _NEAR_ROUNDING * rounding / plain


def make_outcome(
    system: System,
    end: NewtonState,
    x: Float[Array, "n_row n_motion"],
    active: Bool[ArrayLike, ""],
    ruptured: Bool[ArrayLike, ""],
    factored: FactorRecord | None,
) -> IncrementOutcome:
    """Make the `IncrementOutcome` from the end of an iteration.

    Args:
        system: `System`.
        end: `NewtonState` in which the iteration has ended.
        x: motion that it began with, the result if it has failed.
        active: False if an earlier increment has failed.
        ruptured: whether an element ended beyond its rupture strain.
        factored: factored matrix at its start, to count factorizations; None with dense ones.
    """
    forces = max_abs(end.point.residual), _largest_rounding(system, end)
    code = _find_failure_cause(system, end, *forces)
    if system.has_rupture:
        ruptured = active & (code != status.NONFINITE) & ruptured
        code = jnp.where(ruptured, status.MATERIAL_FAILURE, code)
    good = active & (code == status.OK)
    x = select_tree(good, end.point.x, x)
    if factored is None or end.factored is None:
        count = end.steps
    else:
        count = end.factored.count - factored.count
    # after an earlier failure nothing was evaluated
    residual, rounding = (jnp.where(active, force, jnp.nan) for force in forces)
    stable, scale = good & end.stable, end.point.scale
    return IncrementOutcome(x, code, end.steps, count, residual, scale, rounding, good, stable)


def _largest_rounding(system, end):
    """Return the largest residual that the rounding of displacements leaves, N.

    That is at the end of an iteration (a `NewtonState`), or at its start if it was larger there
    and the structure is no net.
    """
    rounding = end.point.rounding
    if rounding is None:
        return jnp.zeros_like(end.point.scale)
    if not system.is_net:
        rounding = jnp.maximum(rounding, end.progress.start_rounding)
    return jnp.max(rounding, initial=0.0)
