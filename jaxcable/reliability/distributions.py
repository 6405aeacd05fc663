"""Distributions of random quantities, stated by mean and scatter, and their standard normal form.

A quantity X with the distribution function F belongs to the standard normal variable
``u = Phi^-1(F(x))`` (Rosenblatt 1952). Both ways avoid the difference 1 - F: what is small, the
probability above or below, is computed by itself, so that both tails keep their digits.
"""

from __future__ import annotations

import math
from typing import Any, ClassVar, TypeAlias

import jax.numpy as jnp
import numpy as np
from jax.scipy.special import log_ndtr, ndtr, ndtri

from ..common import checks
from ..common.rules import Rule, are_rules_kept, positive, refuse_if_broken
from ..common.tree import pytree, set_fields
from ..common.types import Array, ArrayLike, Float

_Values: TypeAlias = 'Float[ArrayLike, " ..."]'
_TINY = 1e-8  # below it, -log(1 - t) / t = 1 + t / 2 to rounding


@pytree
class Distribution:
    """Base of distributions that a mean and a standard deviation determine; for your own ones.

    A class of your own writes `from_normal` and `to_normal`; the conditions on its numbers, beside
    those of mean and scatter, go into `own_rules`.

    Attributes:
        mean: mean, any shape: an array stands for as many independent quantities.
        deviation: standard deviation, in the unit of the mean; or None.
        variation: coefficient of variation, standard deviation over absolute mean; or None. One of
            the two is given. Derivatives are by what is given: with `variation` the standard
            deviation changes with the mean.

    Raises:
        ValueError: neither or both of `deviation` and `variation`, shapes that do not fit, or a
            scatter that is not positive. If it is traced, values are NaN.

    Example:
        The square of a quantity that is normal, mean and deviation being those of the root:

        >>> from jaxcable.common.tree import pytree
        >>> @pytree
        ... class Squared(jc.reliability.Distribution):
        ...     def from_normal(self, mean, deviation, u):
        ...         return (mean + deviation * u) ** 2
        ...     def to_normal(self, mean, deviation, x):
        ...         return (jnp.sqrt(x) - mean) / deviation
        >>> print(Squared(mean=10.0, deviation=1.0).value_at_normal(2.0))
        144.0
    """

    _shown: ClassVar[str] = "mean, deviation, variation"

    mean: Float[ArrayLike, " ..."]
    deviation: Float[ArrayLike, " ..."] | None = None
    variation: Float[ArrayLike, " ..."] | None = None

    def __post_init__(self) -> None:
        if (self.deviation is None) == (self.variation is None):
            raise ValueError("deviation: give either a standard deviation or a variation")
        for name in ("mean", "deviation", "variation"):
            value = getattr(self, name)
            if value is not None:
                set_fields(self, **{name: checks.as_floats(value, name)})
        scatter: Any = self.deviation if self.variation is None else self.variation
        try:
            np.broadcast_shapes(jnp.shape(self.mean), jnp.shape(scatter))
        except ValueError:
            raise ValueError(
                f"mean: has shape {jnp.shape(self.mean)}, its scatter {jnp.shape(scatter)}"
            ) from None
        refuse_if_broken(self.rules())

    def rules(self) -> list[Rule]:
        """Return the conditions on the numbers, a list of `Rule`.

        Deviation or variation is positive; the mean is not zero where a variation is given. Those
        of `own_rules` follow.
        """
        rules = [positive("deviation", self.deviation), positive("variation", self.variation)]
        if self.variation is not None:
            text = "is zero, which a coefficient of variation cannot refer to; give a deviation"
            rules.append(Rule("mean", self.mean, lambda mean: mean == 0, text))
        return [*rules, *self.own_rules()]

    def own_rules(self) -> list[Rule]:
        """Return further conditions of this kind of distribution, a list of `Rule`."""
        return []

    @property
    def shape(self) -> tuple[int, ...]:
        """Shape of the quantity, that of mean and scatter broadcast together."""
        scatter: Any = self.deviation if self.variation is None else self.variation
        return np.broadcast_shapes(jnp.shape(self.mean), jnp.shape(scatter))

    def _mean_and_deviation(self) -> tuple[Any, Any]:
        """Return both as arrays of the shape of the quantity, NaN if a traced one is refused."""
        mean = jnp.asarray(self.mean)
        if self.variation is None:
            deviation = jnp.asarray(self.deviation)
        else:
            deviation = jnp.asarray(self.variation) * jnp.abs(mean)
        deviation = jnp.where(are_rules_kept(self.rules()), deviation, jnp.nan)
        return jnp.broadcast_to(mean, self.shape), jnp.broadcast_to(deviation, self.shape)

    def value_at_normal(self, u: Float[ArrayLike, " ..."]) -> Float[Array, " ..."]:
        """Return the values x with ``F(x) = Phi(u)``, of standard normal values u."""
        return self.from_normal(*self._mean_and_deviation(), jnp.asarray(u))

    def normal_at_value(self, x: Float[ArrayLike, " ..."]) -> Float[Array, " ..."]:
        """Return the standard normal values u of values x; NaN outside of the distribution."""
        return self.to_normal(*self._mean_and_deviation(), jnp.asarray(x))

    def from_normal(self, mean: _Values, deviation: _Values, u: _Values) -> Float[Array, " ..."]:
        """Return the values x with ``F(x) = Phi(u)`` of standard normal values `u`.

        All arrays have one shape; `deviation` is the standard deviation.
        """
        raise NotImplementedError(f"{type(self).__name__}.from_normal")

    def to_normal(self, mean: _Values, deviation: _Values, x: _Values) -> Float[Array, " ..."]:
        """Return the standard normal values u with ``Phi(u) = F(x)`` of values `x`.

        All arrays have one shape; `deviation` is the standard deviation.
        """
        raise NotImplementedError(f"{type(self).__name__}.to_normal")


@pytree
class Normal(Distribution):
    """Normal distribution, by mean and standard deviation or coefficient of variation.

    See `Distribution` for the arguments. A length or a stiffness that is normal may be negative,
    with a probability that hardly counts.

    Example:
        Cutting errors of three cables, m; the value that 97.7 % of them do not exceed:

        >>> error = jc.reliability.Normal(mean=np.zeros(3), deviation=2e-3)
        >>> print(error.value_at_normal(2.0 * np.ones(3)))
        [0.004 0.004 0.004]
    """

    def from_normal(self, mean: _Values, deviation: _Values, u: _Values) -> Float[Array, " ..."]:
        """Return the values of standard normal values `u`, ``mean + deviation u``."""
        return mean + deviation * u

    def to_normal(self, mean: _Values, deviation: _Values, x: _Values) -> Float[Array, " ..."]:
        """Return the standard normal values of values `x`, ``(x - mean) / deviation``."""
        return (x - mean) / deviation


@pytree
class Lognormal(Distribution):
    """Lognormal distribution, by the mean and scatter of the quantity (not of its logarithm).

    See `Distribution` for the arguments. The mean is positive. ``log X`` has the variance
    ``log(1 + V^2)``, with the coefficient of variation V of X.

    Example:
        The median of a strength is below its mean:

        >>> strength = jc.reliability.Lognormal(mean=500e3, variation=0.1)  # N
        >>> print(f"{strength.value_at_normal(0.0):.1f} N")
        497518.6 N
    """

    def own_rules(self) -> list[Rule]:
        """Return the rule that the mean is positive."""
        return [positive("mean", self.mean)]

    def from_normal(self, mean: _Values, deviation: _Values, u: _Values) -> Float[Array, " ..."]:
        """Return the values of standard normal values `u`, ``exp(E[log X] + D[log X] u)``."""
        square = jnp.log1p((deviation / mean) ** 2)
        return mean * jnp.exp(jnp.sqrt(square) * u - square / 2)

    def to_normal(self, mean: _Values, deviation: _Values, x: _Values) -> Float[Array, " ..."]:
        """Return ``(log x - E[log X]) / D[log X]``, standard normal; NaN where x is negative."""
        square = jnp.log1p((deviation / mean) ** 2)
        return (jnp.log(x / mean) + square / 2) / jnp.sqrt(square)


@pytree
class Gumbel(Distribution):
    """Gumbel distribution of largest values (type I), as of yearly largest wind or snow.

    ``F(x) = exp(-exp(-a (x - b)))`` with ``a = pi / (sqrt(6) deviation)`` and
    ``b = mean - 0.5772 / a`` (Gumbel 1958). See `Distribution` for the arguments.

    Example:
        The pressure that is exceeded once in 50 years, from the yearly largest one:

        >>> from scipy.stats import norm
        >>> pressure = jc.reliability.Gumbel(mean=300.0, variation=0.25)  # Pa
        >>> print(f"{pressure.value_at_normal(norm.ppf(0.98)):.2f} Pa")
        494.42 Pa
    """

    def from_normal(self, mean: _Values, deviation: _Values, u: _Values) -> Float[Array, " ..."]:
        """Return the values of standard normal values `u`, ``b - log(-log Phi(u)) / a``."""
        scale = deviation * math.sqrt(6) / math.pi
        low = u < 0  # each branch sees its own half only: no NaN in derivatives
        lower = jnp.where(low, u, -1.0)
        above = log_ndtr(-jnp.where(low, 1.0, u))  # log of the probability of larger values
        t = jnp.exp(above)
        small = t < _TINY
        ratio = -jnp.log1p(-jnp.where(small, 0.5, t)) / jnp.where(small, 0.5, t)
        upper = above + jnp.log(jnp.where(small, 1 + t / 2, ratio))
        loglog = jnp.where(low, jnp.log(-log_ndtr(lower)), upper)
        return mean - scale * (np.euler_gamma + loglog)

    def to_normal(self, mean: _Values, deviation: _Values, x: _Values) -> Float[Array, " ..."]:
        """Return the standard normal values of values `x`, by the smaller one of F and 1 - F."""
        scale = deviation * math.sqrt(6) / math.pi
        minus_log = jnp.exp(-((x - mean) / scale + np.euler_gamma))  # -log F(x)
        high = minus_log < math.log(2)
        below = ndtri(jnp.exp(-jnp.where(high, 1.0, minus_log)))
        return jnp.where(high, -ndtri(-jnp.expm1(-jnp.where(high, minus_log, 0.5))), below)


@pytree
class Uniform(Distribution):
    """Uniform distribution, by mean and scatter: from ``mean - sqrt(3) deviation`` upward.

    See `Distribution` for the arguments. A tolerance of plus or minus t that is used evenly has
    the standard deviation ``t / sqrt(3)``.

    Example:
        >>> error = jc.reliability.Uniform(mean=0.0, deviation=3e-3 / np.sqrt(3))  # within 3 mm
        >>> print(f"{1e3 * error.value_at_normal(8.0):.3f} mm")
        3.000 mm
    """

    def from_normal(self, mean: _Values, deviation: _Values, u: _Values) -> Float[Array, " ..."]:
        """Return the values of standard normal values `u`, counted from the nearer bound."""
        half = math.sqrt(3) * deviation
        return jnp.where(u < 0, mean - half + 2 * half * ndtr(u), mean + half - 2 * half * ndtr(-u))

    def to_normal(self, mean: _Values, deviation: _Values, x: _Values) -> Float[Array, " ..."]:
        """Return the standard normal values of values `x`; NaN outside of the bounds."""
        half = math.sqrt(3) * deviation
        low, high = (x - (mean - half)) / (2 * half), ((mean + half) - x) / (2 * half)
        nearer = jnp.where(low < high, low, high)
        value = ndtri(nearer)
        return jnp.where(low < high, value, -value)
