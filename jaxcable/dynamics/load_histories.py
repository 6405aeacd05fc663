"""Loads in time as arrays: turbulent wind from a random key, loads that fall off."""

from __future__ import annotations

import functools

import jax
import jax.numpy as jnp
import numpy as np
from jax import lax

from ..common import checks
from ..common.rules import are_rules_kept
from ..common.types import Array, ArrayLike, Float, PyTree
from ..linear import unbatched
from ..programs.program_calls import as_program
from .turbulence import Turbulence, inverse_velocity

_CHUNK_SIZE = 256  # times at once: all waves at these times are a table in memory
# Share of the spectral density on the diagonal that is added to coherences, which are nearly 1 in
# slow waves: their matrix has a Cholesky factor in spite of rounding.
_DIAGONAL_SHIFT = 1e-9


def wind_velocities(
    turbulence: Turbulence,
    points: Float[ArrayLike, "n 3"],
    *,
    dt: Float[ArrayLike, ""],
    steps: int,
    key: PyTree[Array],
) -> Float[Array, "steps+1 n"]:
    """Return the fluctuation of the wind velocity at points in time, from a random key.

    A sum of waves with random phases, whose spectra and coherence are those of the turbulence
    (spectral representation), without those slower than ``1 / (steps dt)`` and faster than
    ``1 / (2 dt)``. It repeats after about ``steps dt``; over this time the mean is zero, and the
    variance of the first point is exact. That of other points, and the coherence, scatter from key
    to key about theirs: standard deviations by some 5 % in 600 s. A pure function of all numbers,
    and of the key, over which `jax.vmap` makes a batch.

    Args:
        turbulence: `Turbulence`.
        points: positions, m, such as those of loaded nodes. The work grows with their third power:
            some hundred.

    Options:
        dt: time step, s.
        steps: number of steps; the slowest wave takes ``steps dt``.
        key: random key, ``jax.random.key(0)``.

    Returns:
        Velocity at the times k dt less its mean, [steps + 1, n], m/s.

    Raises:
        ValueError: wrong shapes, `steps` below 2, a step that is not positive.

    Source: Shinozuka and Deodatis, Appl. Mech. Rev. 44 (1991).

    Example:
        >>> wind = jc.dynamics.Turbulence(jc.WindTable(velocities=20.0), 3.0, 150.0)
        >>> points = [[0.0, 0.0, 10.0], [0.0, 2.0, 10.0]]
        >>> options = {"dt": 0.1, "steps": 6000, "key": jax.random.key(1)}
        >>> velocity = jc.dynamics.wind_velocities(wind, points, **options)
        >>> print(velocity.shape, velocity.std(axis=0).round(1))  # less than 3: slow waves lack
        (6001, 2) [2.9 2.9]
    """
    if not isinstance(turbulence, Turbulence):
        kind = checks.describe_type(turbulence, "dynamics.Turbulence(...)")
        raise ValueError(f"turbulence: expected Turbulence, got {kind}")
    checks.require_whole_number(steps, "steps")
    if steps < 2:
        raise ValueError(f"steps = {steps}: expected at least 2")
    points = checks.as_floats(points, "points")
    if points.ndim != 2 or points.shape[1] != 3:
        raise ValueError(f"points: expected shape [n, 3], got {points.shape}")
    dt = checks.as_scalar(dt, "dt")
    known = checks.array_if_known(dt)
    if known is not None and not known > 0:
        raise ValueError(f"dt = {float(known)}: must be positive")
    count = (steps + 1) // 2  # waves; their period is an even number of steps
    phases = jax.random.uniform(key, (count, len(points)), jnp.result_type(points), 0.0, 2 * np.pi)
    return _wind_velocity_fluctuations(turbulence, points, phases, dt, steps=steps)


@functools.partial(as_program, static=("steps",))
def _wind_velocity_fluctuations(turbulence, points, phases, dt, steps):
    """Return fluctuations of the wind velocity, [steps + 1, n], m/s, as a sum of waves.

    `phases` has the random phases of all waves at points, [n_wave, n], rad; other arguments and
    the result are those of `wind_velocities`.
    """
    count = len(phases)
    period = 2 * count
    mean, distances = turbulence.velocity_at(points), turbulence.decay_distances(points)
    number = jnp.arange(1, count + 1)
    rise = 1.0 / (period * dt)
    floor = _DIAGONAL_SHIFT * jnp.eye(len(mean), dtype=mean.dtype)

    def amplitudes(wave):
        """Return cosine and sine amplitudes of a wave at all points, [2, n]."""
        frequency, phase = wave
        spectrum = turbulence.cross_spectrum(frequency, mean, distances)
        own = jnp.diagonal(spectrum)
        spectrum = spectrum + floor * jnp.where(own > 0, own, 1.0)[:, None]
        blown = (own > 0)[:, None]  # not where the mean wind is zero
        root = jnp.where(blown, unbatched.cholesky(spectrum), 0.0) * jnp.sqrt(2 * rise)
        return jnp.stack([root @ jnp.cos(phase), -root @ jnp.sin(phase)])

    waves = lax.map(amplitudes, (number * rise, phases))

    def chunk(times):
        # the angles of a period are multiples of its part: whole numbers keep all digits
        turns = (times[:, None] * number[None, :]) % period
        angle = (2 * np.pi / period) * turns.astype(mean.dtype)
        return jnp.cos(angle) @ waves[:, 0] + jnp.sin(angle) @ waves[:, 1]

    chunks = -(-(steps + 1) // _CHUNK_SIZE)
    times = jnp.arange(chunks * _CHUNK_SIZE).reshape(chunks, _CHUNK_SIZE) % period
    found = lax.map(chunk, times).reshape(chunks * _CHUNK_SIZE, -1)[: steps + 1]
    return jnp.where(are_rules_kept(turbulence.rules()) & (dt > 0), found, jnp.nan)


def wind_forces(
    turbulence: Turbulence,
    positions: Float[ArrayLike, "n_node 3"],
    mean_forces: Float[ArrayLike, "n_node 3"],
    *,
    dt: Float[ArrayLike, ""],
    steps: int,
    key: PyTree[Array],
    quadratic: bool = False,
) -> Float[Array, "steps+1 n_node 3"]:
    """Return the fluctuation of wind forces on nodes in time, without the mean wind.

    The wind at each loaded node is that of `wind_velocities`, u beside the mean V, and forces are
    quasi-steady: the mean force times ``2 u / V``, or ``2 u / V + (u / V)^2`` if `quadratic`.
    There are no gusts where the mean wind is zero, such as on the ground.

    Args:
        turbulence: `Turbulence`.
        positions: of all nodes in the mean wind, m.
        mean_forces: forces of the mean wind on nodes, N, known: of an analysis with `WindLoads` of
            the same profile, ``windy.load - still.load``. Nodes without one have no wind.

    Options:
        dt, steps, key: as of `wind_velocities`.
        quadratic: whether the square of the fluctuation counts.

    Returns:
        Forces less their mean at the times k dt, [steps + 1, n_node, 3], N.

    Raises:
        ValueError: those of `wind_velocities`, wrong shapes, traced or no mean forces.

    Example:
        >>> wind = jc.dynamics.Turbulence(jc.WindTable(velocities=20.0), 3.0, 150.0)
        >>> mean = np.array([[0.0, 0.0, 0.0], [500.0, 0.0, 0.0]])  # N
        >>> options = {"dt": 0.1, "steps": 6000, "key": jax.random.key(1)}
        >>> positions = [[0.0, 0.0, 0.0], [0.0, 0.0, 10.0]]
        >>> forces = jc.dynamics.wind_forces(wind, positions, mean, **options)
        >>> print(forces.shape, f"{forces[:, 1, 0].std():.0f} N")  # 2 x 500 N x 2.9 / 20
        (6001, 2, 3) 145 N
    """
    positions = checks.as_floats(positions, "positions")
    loaded = nodes_with_mean_force(mean_forces, positions)
    own = jnp.asarray(mean_forces)[loaded]
    options = {"dt": dt, "steps": steps, "key": key}
    velocity = wind_velocities(turbulence, positions[loaded], **options)
    ratio = velocity * inverse_velocity(turbulence.velocity_at(positions[loaded]))[None]
    ratio = 2 * ratio + ratio**2 if quadratic else 2 * ratio
    whole = jnp.zeros((len(ratio), len(positions), 3), ratio.dtype)
    return whole.at[:, loaded].set(ratio[..., None] * own[None])


def nodes_with_mean_force(
    mean_forces: Float[ArrayLike, "n_node 3"], positions: Float[ArrayLike, "n_node 3"]
) -> np.ndarray:
    """Return the indices of the nodes whose mean force is not zero, ascending.

    Raises:
        ValueError: wrong shapes, traced forces, or none.
    """
    known = checks.array_if_known(mean_forces)
    if known is None:
        raise ValueError("mean_forces: is traced; which nodes have wind must be known")
    if known.shape != positions.shape:
        raise ValueError(f"mean_forces: expected shape {positions.shape}, got {known.shape}")
    loaded = np.flatnonzero((known != 0).any(axis=1))
    if not len(loaded):
        raise ValueError("mean_forces: no node has one")
    return loaded


def falling_load(
    forces: Float[ArrayLike, "n_node 3"],
    *,
    dt: float,
    steps: int,
    at: float = 0.0,
    duration: float = 0.0,
) -> Float[np.ndarray, "steps+1 n_node 3"]:
    """Return the change of nodal forces in time when a load of the start falls off, such as ice.

    Args:
        forces: what falls off, a load of the start state, [n_node, 3], N; of ice
            ``iced.load - bare.load``.

    Options:
        dt, steps: time step, s, and number of steps.
        at: time at which it begins to fall, s.
        duration: time in which it falls, linearly, s; 0: at once.

    Returns:
        Forces at the times k dt beside those of the start state, [steps + 1, n_node, 3], N: zero,
        then ``-forces``.

    Raises:
        ValueError: wrong shapes or numbers.

    Example:
        >>> ice = np.array([[0.0, 0.0, 0.0], [0.0, 0.0, -80.0]])  # N
        >>> history = jc.dynamics.falling_load(ice, dt=0.1, steps=4, at=0.1, duration=0.2)
        >>> print(history[:, 1, 2])
        [ 0.  0. 40. 80. 80.]
    """
    given = np.asarray(checks.as_floats(forces, "forces"))
    if given.ndim != 2 or given.shape[1] != 3:
        raise ValueError(f"forces: expected shape [n_node, 3], got {given.shape}")
    checks.require_whole_number(steps, "steps")
    if not dt > 0 or not duration >= 0 or not at >= 0:
        raise ValueError(f"dt, at, duration = {dt}, {at}, {duration}: expected a time step above 0")
    if at > steps * dt * (1 + 1e-9):
        raise ValueError(f"at = {at}: after the end of the history at {steps * dt:g} s")
    # steps are compared, not sums of them, whose rounding could miss one
    passed = np.round(np.arange(steps + 1) - at / dt, 9)
    part = np.clip(passed * dt / duration, 0, 1) if duration > 0 else (passed >= 0).astype(float)
    return -part[:, None, None] * given
