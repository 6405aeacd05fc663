"""How well data determine parameters: confidence intervals, undetermined combinations."""

from __future__ import annotations

from typing import ClassVar

import jax
import numpy as np
from jax.flatten_util import ravel_pytree

from ..common import checks, status
from ..common.tree import pytree
from ..common.types import Array, Float, PyTree
from .bounds import entry_names
from .fit import Fit


@pytree
class Confidence:
    """Confidence intervals of the parameters of a fit, from its Jacobian, to first order.

    Attributes:
        half_width: half width of the confidence interval of every parameter, a pytree like the
            parameters; infinite if the data do not determine the parameter (such as those in
            `Fit.without_influence`), NaN if a bound blocks it.
        standard_error: standard error of every parameter, a pytree like the parameters.
        correlation: correlation of the flattened parameters, [n_param, n_param]; NaN where not
            determined.
        deviation: standard deviation of a residual, given or estimated.
        singular_values: singular values of the Jacobian with columns scaled to length one,
            descending, [n_free]; a small one belongs to a combination of parameters that hardly
            changes the residuals.
        directions: the combination of parameters of each singular value, [n_free, n_param], in
            units of the parameters, each with a largest entry of 1.
        rank: number of combinations that are determined.
        degrees: statistical degrees of freedom, n_residual - rank.

    Example:
        >>> strain, force = jnp.array([1e-3, 2e-3, 3e-3]), jnp.array([101.0, 199.0, 301.0])  # -, N
        >>> found = jc.fit(lambda EA: EA * strain - force, jnp.array(5e4))
        >>> sure = jc.design.confidence(found)
        >>> print(found.status, sure.rank, sure.degrees, f"{sure.deviation:.3f} N")
        0 1 2 1.165 N
    """

    _shown: ClassVar[str] = "half_width, deviation, rank, degrees"

    half_width: PyTree[Float[Array, " ..."]]
    standard_error: PyTree[Float[Array, " ..."]]
    correlation: Float[np.ndarray, "n_param n_param"]
    deviation: float
    singular_values: Float[np.ndarray, " n_free"]
    directions: Float[np.ndarray, "n_free n_param"]
    rank: int
    degrees: int


def confidence(
    fit: Fit, level: float = 0.95, deviation: float | None = None, *, rcond: float = 1e-6
) -> Confidence:
    """Compute confidence intervals from the Jacobian of a `Fit`; on the host, not to be traced.

    The covariance is ``C = s^2 (J^T J)^-1`` over the parameters that no bound blocks, with
    ``s^2 = |r|^2 / (n - rank)`` unless `deviation` is given; half widths are Student's t (the
    normal quantile with a given deviation) times the square root of the diagonal. This is linear
    theory: it assumes that the model is true, the residuals are independent and equally
    distributed, and the curvature of the model is small.

    Args:
        fit: result of `fit`.
        level: probability of the intervals, between 0 and 1.
        deviation: known standard deviation of the residuals; None to estimate it.

    Options:
        rcond: combinations with singular values below this part of the largest one count as not
            determined, and so does every parameter that takes part in one.

    Returns:
        `Confidence`.

    Raises:
        ValueError: a fit that has failed or a batch of fits, a level outside of 0 to 1, a deviation
            that is not positive, or no `deviation` and no more residuals than determined
            combinations.

    A fit that is STALLED or OUT_OF_STEPS gets an `InputWarning`: it is no minimum, but `directions`
    show what its data do not determine, which often is the reason. A parameter at a bound is taken
    as known; there is a warning if the interval of another one would otherwise be more than twice
    as wide.

    Example:
        An axial stiffness from three measured forces, with ``s / sqrt(sum(e^2))`` and Student's
        t = 4.303 of two degrees of freedom:

        >>> strain, force = jnp.array([1e-3, 2e-3, 3e-3]), jnp.array([101.0, 199.0, 301.0])  # -, N
        >>> found = jc.fit(lambda EA: EA * strain - force, jnp.array(5e4))
        >>> sure = jc.design.confidence(found)
        >>> print(found.status, f"{found.params:.0f} +- {sure.half_width:.0f} N")
        0 100143 +- 1340 N
    """
    if not isinstance(fit, Fit):
        raise ValueError(
            f"fit: expected the result of fit, got {checks.describe_type(fit, 'fit(...)')}"
        )
    if np.ndim(fit.status):
        raise ValueError(f"fit: a batch of shape {np.shape(fit.status)}; give one of its fits")
    if not 0 < checks.as_scalar(level, "level") < 1:
        raise ValueError(f"level = {level}: must be between 0 and 1")
    if not 0 <= checks.as_scalar(rcond, "rcond") < 1:
        raise ValueError(f"rcond = {rcond}: must be at least 0 and below 1")
    if deviation is not None and not 0 < checks.as_scalar(deviation, "deviation") < np.inf:
        raise ValueError(f"deviation = {deviation}: must be positive and finite")
    from scipy import special  # slow to import

    if int(fit.status) not in (status.OK, status.STALLED, status.OUT_OF_STEPS):
        raise ValueError(f"fit: has failed ({status.describe(fit.status)})")
    if int(fit.status) != status.OK:
        checks.warn_user(
            f"fit: has not converged ({status.NAMES[int(fit.status)]}); the intervals are of "
            "linear theory, which holds at a minimum only: take from them what is not determined "
            "(`directions`), not how exactly the rest is"
        )
    jacobian = np.array(fit.jacobian, float)
    back = ravel_pytree(jax.tree.map(lambda x: np.asarray(x, float), fit.params))[1]
    n_residual, n_param = jacobian.shape
    varied = np.concatenate([np.ravel(f) for f in jax.tree.leaves(fit.free)]).astype(bool)
    no_influence = [np.ravel(f) for f in jax.tree.leaves(fit.without_influence)]
    jacobian[:, np.concatenate(no_influence).astype(bool)] = 0.0  # their columns are rounding
    columns = np.linalg.norm(jacobian[:, varied], axis=0)
    unit = np.where(columns > 0, columns, 1.0)
    left, values, combinations = np.linalg.svd(jacobian[:, varied] / unit, full_matrices=True)
    n_free = len(unit)
    values = np.pad(values, (0, n_free - len(values)))
    determined = values > rcond * values.max(initial=0.0)
    rank = int(determined.sum())
    degrees = n_residual - rank
    if deviation is None:
        if degrees < 1:
            raise ValueError(
                f"deviation: {n_residual} residuals cannot tell their own scatter besides {rank} "
                "combinations of parameters; give the standard deviation of the data"
            )
        deviation = float(np.linalg.norm(fit.residual)) / np.sqrt(degrees)
        quantile = special.stdtrit(degrees, 0.5 + level / 2)
    else:
        quantile = special.ndtri(0.5 + level / 2)

    half = combinations[determined] / values[determined, None] / unit  # C = s^2 half^T half
    covariance = np.full((n_param, n_param), np.nan)
    inside = deviation**2 * half.T @ half
    undetermined = (np.abs(combinations[~determined]) > 1e-3).any(axis=0)
    inverse = half.T @ left[:, :rank].T
    _warn_of_blocked_parameters(fit, jacobian, varied, undetermined, inverse, rcond)
    inside[undetermined] = np.nan
    inside[:, undetermined] = np.nan
    covariance[np.ix_(varied, varied)] = inside
    error = np.sqrt(np.diagonal(covariance))
    error[np.flatnonzero(varied)[undetermined]] = np.inf
    with np.errstate(invalid="ignore"):
        correlation = covariance / np.outer(error, error)
    directions = np.zeros((n_free, n_param))
    directions[:, varied] = combinations / unit
    peak = np.abs(directions).max(axis=1, keepdims=True)
    return Confidence(
        half_width=back(quantile * error),
        standard_error=back(error),
        correlation=correlation,
        deviation=deviation,
        singular_values=values,
        directions=directions / np.where(peak > 0, peak, 1.0),
        rank=rank,
        degrees=degrees,
    )


def _warn_of_blocked_parameters(fit, jacobian, varied, undetermined, inverse, rcond):
    """Warn of parameters that a bound blocks, and that others cannot be told apart from.

    Intervals take what is blocked as known. With its column ``a`` of the Jacobian J the variance of
    another parameter would be larger by ``c^2 / |a - J c|^2``, where ``c = J^+ a``.

    Args:
        fit, jacobian, rcond: as in `confidence`; without influence are columns of zeros.
        varied, undetermined: parameters that no bound blocks, [n_param]; which of these are not
            determined anyway, [n_free].
        inverse: pseudo-inverse of their columns, [n_free, n_residual].
    """
    size = np.linalg.norm(jacobian, axis=0)
    blocked = np.flatnonzero(~varied & (size > 0))
    columns = jacobian[:, blocked]
    effect = inverse @ columns
    apart = np.linalg.norm(columns - jacobian[:, varied] @ effect, axis=0)
    effect[np.abs(effect) * size[varied, None] <= 1e-3 * size[blocked]] = 0.0
    with np.errstate(divide="ignore", invalid="ignore"):
        added = np.abs(effect) / np.where(apart > rcond * size[blocked], apart, 0.0)
    alone = np.linalg.norm(inverse, axis=1)
    wide = (added > np.sqrt(3.0) * alone[:, None]) & ~undetermined[:, None]  # twice as wide
    names = entry_names(fit.params)
    for k in np.flatnonzero(wide.any(axis=0)):
        affected = np.flatnonzero(varied)[wide[:, k]]
        others = ", ".join(f"params{names[i]}" for i in affected[:5]) + ", ..." * (
            len(affected) > 5
        )
        how = "be infinite" if np.isinf(added[:, k]).any() else "be more than twice as wide"
        checks.warn_user(
            f"fit: params{names[blocked[k]]} is at a bound, and is taken as known; without that "
            f"the interval of {others} would {how}: measure what tells them apart, or widen the "
            "bound"
        )
