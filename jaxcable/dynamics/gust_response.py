"""Response of natural modes to turbulent wind in the frequency domain, and its peaks."""

from __future__ import annotations

from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
from jax import lax

from ..analysis.solution import Solution, State
from ..common import checks
from ..common.rules import are_rules_kept, nan_if_broken, positive
from ..common.tree import pytree
from ..common.types import Array, ArrayLike, Float, PyTree
from ..model.structure import Structure
from ..programs.program_calls import as_program
from .damping import warn_of_large_damping_ratios
from .inertia import make_system_with_nodal_masses, split_state_for_modes
from .load_histories import nodes_with_mean_force
from .modes import NaturalModes
from .turbulence import Turbulence, inverse_velocity

_EULER_CONSTANT = 0.5772156649015329
# Frequencies of the integrals: a geometric series over the slow waves of the wind and all modes,
# and around each mode points that are dense where its resonance is narrow: its share of the
# integral is that of an arctangent, which they divide evenly.
_SLOWEST, _FASTEST, _SERIES = 1e-4, 3.0, 400  # Hz; over the fastest mode; points
_WIDEST, _AROUND = 1.53, 81  # rad, a distance of 24 half-widths; points


@pytree
class GustResponse:
    """Response to turbulent wind beside that to the mean wind: the result of `gust_response`.

    Example:
        With one mode all responses go together, and have one peak factor: see `gust_response`.

        >>> parts = {"pole": jc.Bars([[0, 1]], 1e8), "clamp": jc.Springs([1], (2e3, 2e3, 0.0))}
        >>> mast = jc.Structure([[0.0, 0, 0], [0, 0, 10]], parts, jc.pinned([0]))
        >>> still = jc.solve(mast, jc.Phase(loads=jc.NodalLoads([1], (60.0, 0.0, 0.0))))
        >>> found = jc.dynamics.modes(mast, still, masses=np.array([0.0, 40.0]))
        >>> wind = jc.dynamics.Turbulence(jc.WindTable(velocities=20.0), 3.0, 150.0)
        >>> mean = np.array([[0.0, 0.0, 0.0], [60.0, 0.0, 0.0]])  # N
        >>> gust = jc.dynamics.gust_response(mast, still, found, mean, wind, damping=0.005)
        >>> print(still.status, f"{gust.peak_factor[1, 0]:.2f}")
        0 3.75

    Attributes:
        displacement: standard deviations along x, y, z, [n_node, 3], m.
        tension: standard deviation of the tension of every element, in the shape of the elements,
            N; of axial forces of bars and beams, too; None of groups without one.
        displacement_peak: largest displacement to be expected within the duration, from the mean,
            [n_node, 3], m: peak factor times standard deviation.
        tension_peak: likewise of tensions, N.
        peak_factor: peak factor of the displacements, [n_node, 3]; zero where nothing moves.
        covariance: of the amplitudes of the modes in their scale, [n, n], m2.
    """

    displacement: Float[Array, "n_node 3"]
    tension: PyTree[Float[Array, " n_elem"]]
    displacement_peak: Float[Array, "n_node 3"]
    tension_peak: PyTree[Float[Array, " n_elem"]]
    peak_factor: Float[Array, "n_node 3"]
    covariance: Float[Array, "n n"]


def peak_factor(rate: Float[ArrayLike, ...], duration: Float[ArrayLike, ""]) -> Any:
    """Return the largest value of a Gaussian process to be expected, over its standard deviation.

    ``g = sqrt(2 ln(v T)) + 0.5772 / sqrt(2 ln(v T))``, NaN where v T is below 1.

    Args:
        rate: v, mean number of upward crossings of the mean in a second, Hz.
        duration: T, s.

    Source: Davenport, Proc. ICE 28 (1964).

    Example:
        >>> print(f"{jc.dynamics.peak_factor(0.5, 600.0):.2f}")
        3.55
    """
    count = jnp.asarray(rate) * jnp.asarray(duration)
    root = jnp.sqrt(2 * jnp.log(jnp.where(count > 1, count, jnp.nan)))
    return root + _EULER_CONSTANT / root


def gust_response(
    structure: Structure,
    state: Solution | State,
    modes: NaturalModes,
    mean_forces: Float[ArrayLike, "n_node 3"],
    turbulence: Turbulence,
    *,
    damping: Float[ArrayLike, ""] | Float[ArrayLike, " n"] = 0.01,
    duration: Float[ArrayLike, ""] = 600.0,
) -> GustResponse:
    """Compute the response to turbulent wind about the state in the mean wind, by its modes.

    Forces are quasi-steady, the mean force times ``2 u / V``, as in `wind_forces`; the structure is
    linear about the state, and what modes leave out does not move. All pairs of modes and all
    frequencies count, so that the slow response, resonance, and modes of neighbouring frequencies
    are in it. Tensions that would fall below zero are not seen: compare the peak with the tension.

    A pure function of all numbers but of which nodes have wind.

    Args:
        structure: the `Structure` that was analysed.
        state: `Solution` or `State` in the mean wind.
        modes: result of `modes` about this state, of all degrees of freedom that are free in it.
        mean_forces: forces of the mean wind on nodes, as of `wind_forces`, N.
        turbulence: `Turbulence`.

    Options:
        damping: ratio of damping to the critical one, for all modes or [n]; that of the moving air
            included.
        duration: in which peaks are to be expected, s.

    Returns:
        `GustResponse`; NaN where a mode has no positive stiffness.

    Raises:
        ValueError: wrong arguments, modes of another structure, traced or no mean forces; a damping
            or duration that is not positive (if traced, the result is NaN).

    Source: Davenport, J. Struct. Div. ASCE 93 (1967), with all cross-spectra.

    Example:
        A lamp of 40 kg on a pole of 10 m, 2 kN/m: resonance at 1.13 Hz more than doubles what slow
        waves do, 60 N x 2 x 3 / 20 over the stiffness.

        >>> parts = {"pole": jc.Bars([[0, 1]], 1e8), "clamp": jc.Springs([1], (2e3, 2e3, 0.0))}
        >>> mast = jc.Structure([[0.0, 0, 0], [0, 0, 10]], parts, jc.pinned([0]))
        >>> mean = np.array([[0.0, 0.0, 0.0], [60.0, 0.0, 0.0]])  # N
        >>> still = jc.solve(mast, jc.Phase(loads=jc.NodalLoads([1], mean[1])))
        >>> found = jc.dynamics.modes(mast, still, masses=np.array([0.0, 40.0]))
        >>> wind = jc.dynamics.Turbulence(jc.WindTable(velocities=20.0), 3.0, 150.0)
        >>> gust = jc.dynamics.gust_response(mast, still, found, mean, wind, damping=0.005)
        >>> slow = 60.0 * 2 * 3.0 / 20.0 / 2e3
        >>> print(f"{1e3 * slow:.1f} mm, {1e3 * gust.displacement[1, 0]:.1f} mm")
        9.0 mm, 22.5 mm
    """
    if not isinstance(turbulence, Turbulence):
        kind = checks.describe_type(turbulence, "dynamics.Turbulence(...)")
        raise ValueError(f"turbulence: expected Turbulence, got {kind}")
    if not isinstance(modes, NaturalModes):
        kind = checks.describe_type(modes, "dynamics.modes(structure, solution)")
        raise ValueError(f"modes: expected NaturalModes, got {kind}")
    split = split_state_for_modes(structure, state, None, None)
    n, n_node = modes.shape.shape[:2]
    if n_node != structure.n_node or modes.unknowns.shape[1] != len(split[2].free):
        raise ValueError(
            f"modes: have {modes.unknowns.shape[1]} unknowns and {n_node} nodes, the state "
            f"{len(split[2].free)} and {structure.n_node}; give those about this state, without "
            "`fixed`"
        )
    last = state.last if isinstance(state, Solution) else state
    loaded = nodes_with_mean_force(mean_forces, last.positions)
    damping = checks.floats_of_shape(damping, "damping", (), (n,), hint="; one, or one for each")
    warn_of_large_damping_ratios(damping, "damping")
    damping = jnp.broadcast_to(nan_if_broken(positive("damping", damping)), (n,))
    duration = nan_if_broken(positive("duration", duration))
    own = last.positions[loaded], jnp.asarray(mean_forces)[loaded], modes.shape[:, loaded]
    covariance, rates = _modal_covariances(
        turbulence, *own, modes.squared, modes.modal_mass, damping
    )
    tensions = _modal_tensions(split, modes.unknowns)
    displacement, factor = _deviations_and_factors(modes.shape, covariance, rates, duration)
    found = [
        (None, None) if own is None else _deviations_and_factors(own, covariance, rates, duration)
        for own in tensions
    ]
    return GustResponse(
        displacement,
        structure.arrange([deviation for deviation, _ in found]),
        displacement * factor,
        structure.arrange([None if own is None else own * factor for own, factor in found]),
        factor,
        covariance,
    )


@as_program
def _modal_covariances(turbulence, points, mean_forces, shape, squared, modal_mass, damping):
    """Return covariances of the amplitudes of modes and of their velocities, [n, n] each.

    Args:
        turbulence: `Turbulence`.
        points: positions of the loaded nodes, [n_loaded, 3], m.
        mean_forces, shape: forces of the mean wind, and modes, at these, [n_loaded, 3] and
            [n, n_loaded, 3].
        squared, modal_mass, damping: of the modes, [n].
    """
    mean, distances = turbulence.velocity_at(points), turbulence.decay_distances(points)
    push = 2 * jnp.einsum("nac,ac->na", shape, mean_forces) * inverse_velocity(mean)[None]
    own = jnp.sqrt(jnp.where(squared > 0, squared, jnp.nan))
    frequency = _integration_frequencies(own / (2 * jnp.pi), damping)
    step = jnp.diff(frequency)
    weight = 0.5 * (jnp.append(step, 0.0) + jnp.append(0.0, step))

    def add(sums, wave):
        frequency, weight = wave
        spectrum = push @ turbulence.cross_spectrum(frequency, mean, distances) @ push.T
        circular = 2 * jnp.pi * frequency
        # of 1 / (w0^2 - w^2 + 2 i d w0 w) the real and the imaginary part
        real, imaginary = squared - circular**2, 2 * damping * own * circular
        size = (real**2 + imaginary**2) * modal_mass
        real, imaginary = real / size, imaginary / size
        gain = real[:, None] * real[None] + imaginary[:, None] * imaginary[None]
        part = weight * spectrum * gain
        return (sums[0] + part, sums[1] + circular**2 * part), None

    zero = jnp.zeros((len(own), len(own)), own.dtype)
    (covariance, rates), _ = lax.scan(add, (zero, zero), (frequency, weight))
    kept = are_rules_kept(turbulence.rules())
    return jnp.where(kept, covariance, jnp.nan), jnp.where(kept, rates, jnp.nan)


def _integration_frequencies(natural, damping):
    """Return the frequencies at which spectra are integrated, ascending, Hz.

    `natural` has the natural frequencies of the modes, [n], Hz, `damping` their damping ratios.
    """
    fastest = _FASTEST * jnp.max(natural)
    part = jnp.linspace(0.0, 1.0, _SERIES, dtype=natural.dtype)
    series = _SLOWEST * (fastest / _SLOWEST) ** part
    around = jnp.tan(jnp.linspace(-_WIDEST, _WIDEST, _AROUND, dtype=natural.dtype))
    near = natural[:, None] * (1 + damping[:, None] * around[None])
    near = jnp.where(near > _SLOWEST, near, natural[:, None])
    return jnp.sort(jnp.concatenate([series, near.reshape(-1)]))


@as_program
def _modal_tensions(split, unknowns):
    """Return the changes of tensions by a unit amplitude of each mode, per group [n, n_elem], N."""
    n_node = split[0][0].shape[0]
    system, x = make_system_with_nodal_masses(split, np.zeros(n_node))

    def tension(step):
        return system.results_by_name(system.move(x, step), "tension")["tension"]

    def change(own):
        return jax.jvp(tension, (jnp.zeros_like(own),), (own,))[1]

    return jax.vmap(change)(unknowns)


@as_program
def _deviations_and_factors(parts, covariance, rates, duration):
    """Return standard deviations and peak factors of responses that are sums over modes, [...].

    Args:
        parts: response to an amplitude of each mode, [n, ...].
        covariance, rates: of amplitudes of modes and of their velocities, [n, n].
        duration: of peaks, s.
    """
    variance, speed = (
        jnp.einsum("i...,ij,j...->...", parts, matrix, parts) for matrix in (covariance, rates)
    )
    moves = ~(variance <= 0)
    positive_variance = jnp.where(moves, variance, 1.0)
    rate = jnp.sqrt(jnp.where(moves, speed, 1.0) / positive_variance) / (2 * jnp.pi)
    factor = jnp.where(moves, peak_factor(rate, duration), 0.0)
    return jnp.where(moves, jnp.sqrt(positive_variance), 0.0), factor
