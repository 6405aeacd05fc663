"""Probability of failure by sampling, around design points or crude; on the host, in rounds."""

from __future__ import annotations

import functools
from collections.abc import Callable, Mapping, Sequence
from typing import Any, ClassVar

import jax
import jax.numpy as jnp
import numpy as np
from jax.scipy.special import logsumexp

from ..analysis.batches import batched
from ..common import checks
from ..common.jax_internals import is_tracing
from ..common.tree import pytree
from ..common.types import Array, Float
from ..programs.program_calls import as_program
from .distributions import Distribution
from .first_order_result import FirstOrder
from .limit_states import limit_state_vector, require_limit_state, trace_limit_state
from .quantities import Quantities, as_quantities
from .systems import stacked_results

_ROUND = 2**11  # samples at a time: one program for all larger numbers of them
_LISTED = 100  # failed samples whose values are kept
_EQUAL_PART = 0.1  # of the samples, shared out to all design points alike


@pytree
class SamplingResult:
    """Result of `importance_sampling`: a probability with its error, and the analyses that failed.

    A sample is a violation if any limit state is negative. Where none is, and one is NaN, the
    analysis has failed, and the outcome is unknown.

    Attributes:
        probability: estimated probability that any limit state is violated; NaN if the outcome of
            a sample is unknown: `low` and `high` are for that case.
        standard_error: standard error of `probability` (of `high`, if outcomes are unknown); NaN if
            no sample fails: the probability 0 says nothing more than that it is small.
        variation: coefficient of variation of the estimate, `standard_error` over `high`.
        low, high: estimates with unknown outcomes counted as safe, and as violations.
        of_each: estimated probability of every limit state, [m]; NaN where outcomes are unknown.
        samples: number of samples.
        n_violated: number of samples in which a limit state is violated.
        n_unknown: number of samples of unknown outcome.
        unknown_values: values by name of the first 100 of these, with a leading axis.

    Example:
        >>> Normal = jc.reliability.Normal
        >>> quantities = {"R": Normal(30.0, 3.0), "S": Normal(18.0, 4.0)}
        >>> crude = jc.reliability.importance_sampling(
        ...     lambda x: x["R"] - x["S"], quantities, samples=100_000
        ... )
        >>> bool(abs(crude.probability - 8.1975e-3) < 3 * crude.standard_error), crude.n_unknown
        (True, 0)
    """

    _shown: ClassVar[str] = "probability, standard_error, low, high, samples, n_violated, n_unknown"

    probability: float
    standard_error: float
    variation: float
    low: float
    high: float
    of_each: Float[np.ndarray, " m"]
    samples: int
    n_violated: int
    n_unknown: int
    unknown_values: dict[str, Float[np.ndarray, " ..."]]


def importance_sampling(
    limit_state: Callable[..., Any],
    quantities: Quantities | Mapping[str, Distribution],
    center: FirstOrder | Sequence[FirstOrder] | None = None,
    *,
    samples: int = 10_000,
    key: int | Array = 0,
    spread: float = 1.0,
    args: tuple[Any, ...] = (),
    chunk: int | None = None,
    devices: Sequence[jax.Device] | None = None,
) -> SamplingResult:
    """Estimate the probability that any limit state is violated, by random samples.

    With a `center` samples are normal around all its design points (Melchers 1989): a mixture, if
    there are several, with the weight of each by its probability, a tenth shared out evenly. Each
    sample counts with its density over that of the mixture. Without a center it is the crude Monte
    Carlo method. Called from Python only: neither it nor its result can be traced.

    Args:
        limit_state, quantities: as for `first_order`.
        center: result of `first_order`, of one or several limit states, or a list of results; None
            for samples of the quantities as they are.

    Options:
        samples: number of samples.
        key: number or key of jax, from which all samples follow.
        spread: standard deviation of the samples around design points.
        args: tuple of further arguments of the limit state, any pytrees.
        chunk, devices: as for `batched`, which evaluates the limit state.

    Returns:
        `SamplingResult`. Its standard error says how far off the estimate may be only if
        samples have met all regions that matter: add design points, or compare with the crude
        method.

    Raises:
        ValueError: a center that has not converged or is for other quantities, a number of samples
            below 2, a spread that is not positive, or a call that is traced.

    Example:
        A bar between two limits, each of which has a design point of half the probability:

        >>> normal = jc.reliability.Normal(np.zeros(2), 1.0)
        >>> margin = lambda x: 4.0 - jnp.abs(x["x"][0]) - 1e-3 * x["x"][1]
        >>> begin = {"x": [1.0, 0.0]}
        >>> found = jc.reliability.first_order(margin, {"x": normal}, start=begin)
        >>> result = jc.reliability.importance_sampling(margin, {"x": normal}, found)
        >>> print(found.points.beta, f"{result.probability / found.probability:.1f}")
        [3.999998 3.999998] 1.0
    """
    require_limit_state(limit_state)
    quantities = as_quantities(quantities)
    checks.require_whole_number(samples, "samples", 2)
    if not 0 < checks.as_scalar(spread, "spread") < np.inf:
        raise ValueError(f"spread = {spread}: must be positive and finite")
    if is_tracing() or any(isinstance(x, jax.core.Tracer) for x in jax.tree.leaves(quantities)):
        raise ValueError("importance_sampling: is being traced; call it outside of jit and grad")
    centers, shares = _mixture_components(center, quantities)
    if not isinstance(key, jax.Array):
        checks.require_whole_number(key, "key", 0)
        key = jax.random.key(key)
    generator, key = str(jax.random.key_impl(key)), jax.random.key_data(key)
    traced = trace_limit_state(limit_state, quantities, tuple(args))
    one = functools.partial(_limit_states, traced, args)
    evaluate = batched(one, chunk, devices=devices)
    size = min(samples, max(_ROUND, chunk or 1))
    rounds = -(-samples // size)
    sums: Any = 0.0
    unknown_values: list[Any] = []
    for number in range(rounds):
        count = min(size, samples - number * size)
        draw = key, np.uint32(number), centers, shares, spread
        values, weight = _draw_samples(quantities, *draw, count=size, generator=generator)
        g = np.asarray(evaluate(values))[:count]
        weight = np.asarray(weight, float)[:count, None]
        violated = (g < 0).any(axis=1, keepdims=True)
        unknown = np.isnan(g).any(axis=1, keepdims=True) & ~violated
        events = np.hstack([violated, violated | unknown, unknown, g < 0, np.isnan(g)])
        sums = sums + np.stack(
            [(weight * events).sum(axis=0), (weight**2 * events).sum(axis=0), events.sum(axis=0)]
        )
        rows = np.flatnonzero(unknown)[: _LISTED - sum(len(part[0]) for part in unknown_values)]
        unknown_values.append([np.asarray(values[name])[rows] for name, _ in quantities.layout])
    return _make_sampling_result(sums, samples, quantities, unknown_values)


def _make_sampling_result(sums, samples, quantities, unknown_values):
    """Return the `SamplingResult` from sums over all samples.

    Args:
        sums: for each event the sum of weights, that of their squares, and the count,
            [3, n_event]. Events are: a limit state is violated; one is violated or the outcome
            unknown; it is unknown; then, for each limit state, it is violated; it is NaN.
        samples: number of samples.
        quantities: the `Quantities`.
        unknown_values: values of samples with unknown outcome, for each round a list by quantity.
    """
    mean, square, counts = sums[0] / samples, sums[1] / samples, sums[2].astype(int)
    low, high = float(mean[0]), float(mean[1])
    n_violated, n_unknown = int(counts[0]), int(counts[2])
    error = np.sqrt(max(square[1] - mean[1] ** 2, 0.0) / (samples - 1)) if counts[1] else np.nan
    n_limit = (len(counts) - 3) // 2
    each, nothing = mean[3 : 3 + n_limit], counts[3 + n_limit :] == 0
    parts = [np.concatenate(arrays) for arrays in zip(*unknown_values, strict=True)]
    return SamplingResult(
        probability=np.nan if n_unknown else high,
        standard_error=float(error),
        variation=float(error / high) if counts[1] else np.nan,
        low=low,
        high=high,
        of_each=np.where(nothing, each, np.nan),
        samples=samples,
        n_violated=n_violated,
        n_unknown=n_unknown,
        unknown_values=dict(zip([name for name, _ in quantities.layout], parts, strict=True)),
    )


def _mixture_components(center, quantities):
    """Return the centers of a mixture of normal samples, [k, n], and their shares of samples, [k].

    `center` is as of `importance_sampling`; None gives the origin.
    """
    if center is None:
        return np.zeros((1, quantities.size)), np.ones(1)
    betas, alphas = stacked_results(center, "center")
    first = center if isinstance(center, FirstOrder) else center[0]
    if first.layout != quantities.layout:
        raise ValueError("center: is for other quantities")
    if jnp.isnan(betas).any():
        raise ValueError("center: a search has not converged; look at its status, or leave it out")
    probability = jax.scipy.special.ndtr(-betas)
    shares = (1 - _EQUAL_PART) * probability / jnp.sum(probability) + _EQUAL_PART / len(betas)
    return betas[:, None] * alphas, shares


@functools.partial(as_program, static=("count", "generator"))
def _draw_samples(quantities, key, number, centers, shares, spread, *, count, generator):
    """Return values by name, and weights, of `count` samples of a mixture of normal distributions.

    Args:
        quantities: the `Quantities`.
        key: data of a random key of this `generator`.
        number: index of the round, which has random numbers of its own.
        centers, shares: as of `_mixture_components`.
        spread: standard deviation around the centers.
    """
    key = jax.random.wrap_key_data(key, impl=generator)
    which, normal = jax.random.split(jax.random.fold_in(key, number))
    k = jax.random.categorical(which, jnp.log(shares), shape=(count,))
    u = centers[k] + spread * jax.random.normal(normal, (count, quantities.size))
    squares = jnp.sum(((u[:, None] - centers[None]) / spread) ** 2, axis=-1)
    logs = jnp.log(shares)[None] - 0.5 * squares - quantities.size * jnp.log(spread)
    weight = jnp.exp(-0.5 * jnp.sum(u**2, axis=1) - logsumexp(logs, axis=1))
    return jax.vmap(quantities.values_at_normals)(u), weight


def _limit_states(limit_state, args, values):
    """Return all limit states for values of the quantities by name, as a vector [m]."""
    return limit_state_vector(limit_state(values, *args))
