"""The correlation of quantities that are not normal, and that of their normal variables."""

from __future__ import annotations

import jax
import jax.numpy as jnp
import numpy as np
from jax import lax

from ..common import checks
from ..common.types import Array, ArrayLike, Float
from ..programs.program_calls import as_program
from .quantities import Quantities, join_by_name

_NODES, _TERMS, _STEPS = 80, 40, 30


def normal_correlation(
    quantities: Quantities, correlation: Float[ArrayLike, "n n"]
) -> Float[Array, "n n"]:
    """Compute the correlation of the normal variables from that of the quantities (Nataf's model).

    With the coefficients ``a_k = E[x(z) He_k(z)] / sqrt(k!)`` of every quantity in Hermite
    polynomials, the correlation of two quantities is ``sum_k a_k b_k rho^k / (s_a s_b)`` (Mehler's
    formula), a rising function of the correlation rho of their normal variables, which Newton's
    method inverts. The same follows from the double integral of Liu and Der Kiureghian (1986).

    Args:
        quantities: `Quantities`, whose own `correlation` has no part in it.
        correlation: wanted correlation matrix of the quantities themselves, [n, n], in the order of
            ``quantities.layout``.

    Returns:
        Correlation matrix of the standard normal variables, [n, n]: the `correlation` that
        `Quantities` takes. NaN for a correlation that no normal variables give, as two different
        skew distributions cannot have a correlation of -1.

    Raises:
        ValueError: a matrix of another shape.

    Example:
        Two lognormal quantities, for which ``rho = log(1 + r V^2) / log(1 + V^2)``:

        >>> loads = jc.reliability.Quantities({
        ...     "snow": jc.reliability.Lognormal(mean=1.0, variation=0.5),
        ...     "wind": jc.reliability.Lognormal(mean=1.0, variation=0.5),
        ... })
        >>> matrix = jc.reliability.normal_correlation(loads, [[1.0, 0.4], [0.4, 1.0]])
        >>> print(f"{matrix[0, 1]:.6f} {np.log(1 + 0.4 * 0.25) / np.log(1.25):.6f}")
        0.427125 0.427125
    """
    if not isinstance(quantities, Quantities):
        got = checks.describe_type(quantities, "Quantities({...})")
        raise ValueError(f"quantities: expected Quantities, got {got}")
    n = quantities.size
    wanted = jnp.asarray(checks.floats_of_shape(correlation, "correlation", (n, n)))
    return _correlation_of_normals(quantities, wanted)


@as_program
def _correlation_of_normals(quantities, wanted):
    """Return the correlation matrix of the normal variables, [n, n], by Newton's method (Mehler).

    `wanted` is that of the quantities, [n, n]; NaN where no correlation of normal variables
    gives it.
    """
    n = quantities.size
    nodes, weights = np.polynomial.hermite_e.hermegauss(_NODES)
    every = jnp.broadcast_to(jnp.asarray(nodes)[:, None], (_NODES, n))
    x = join_by_name(quantities.layout, jax.vmap(quantities.values_at_correlated)(every))
    polynomials = [np.ones(_NODES), nodes]
    for k in range(1, _TERMS):  # divided by sqrt(k!)
        following = nodes * polynomials[k] - np.sqrt(k) * polynomials[k - 1]
        polynomials.append(following / np.sqrt(k + 1))
    rows = np.array(polynomials[1:]) * (weights / np.sum(weights))
    coefficients = jnp.asarray(rows) @ x  # [n_term, n]
    scaled = coefficients / jnp.sqrt(jnp.sum(coefficients**2, axis=0, keepdims=True))
    products = scaled[:, :, None] * scaled[:, None, :]
    powers = jnp.arange(1, _TERMS + 1)[:, None, None]

    def reached(rho):
        return jnp.sum(products * rho[None] ** powers, axis=0)

    def slope(rho):
        return jnp.sum(products * powers * rho[None] ** (powers - 1), axis=0)

    # the last step, from a point without derivative, gives the derivative of the root
    stopped = lax.stop_gradient
    held, target = stopped(products), stopped(wanted)

    def improve(_, rho):
        error = jnp.sum(held * rho[None] ** powers, axis=0) - target
        rate = jnp.sum(held * powers * rho[None] ** (powers - 1), axis=0)
        # a step beyond the range of correlations ends at its bound; below, what misses the target
        # is NaN
        return jnp.clip(rho - error / rate, -1.0, 1.0)

    rho = lax.fori_loop(0, _STEPS, improve, target)
    found = rho - (reached(rho) - wanted) / stopped(slope(rho))
    tight = 1e-4 if found.dtype == jnp.float32 else 1e-9
    found = jnp.where(abs(reached(rho) - wanted) <= tight, found, jnp.nan)
    return jnp.where(np.eye(n, dtype=bool), 1.0, found)
