"""Trains that move along a path of beams: analyses at many positions, and the worst position."""

from __future__ import annotations

from collections.abc import Sequence

import jax
import jax.numpy as jnp
import numpy as np

from ..analysis.phases import Phase, as_phases
from ..analysis.solution import Solution, State
from ..analysis.solver import solve
from ..common import checks
from ..common.tree import pytree, replace
from ..common.types import ArrayLike, Float
from ..equilibrium.incremental import Incremental
from ..equilibrium.newton import Newton
from ..loads import Train
from ..model.structure import Structure
from .arguments import require_structure
from .influence_line import SAMPLES, TO_CUBIC, InfluenceLine


@pytree
class WorstPosition:
    """The position of a train that makes a result largest or smallest: of `worst_position`.

    Attributes:
        position: of the first axle from the beginning of the path, m, in the shape of the result.
        value: the part of the result that is due to the train, by the influence line.

    Example:
        >>> worst = jc.design.WorstPosition(position=np.array(5.0), value=np.array(290e3))
        >>> print(f"{worst.value / 1e3:.0f} kN m at {worst.position:.1f} m")
        290 kN m at 5.0 m
    """

    position: Float[ArrayLike, " ..."]
    value: Float[ArrayLike, " ..."]


def worst_position(
    line: InfluenceLine,
    train: Train,
    *,
    largest: bool = True,
) -> WorstPosition:
    """Find the position of a train that makes a result largest, or smallest, by an influence line.

    The search is exact: between the positions at which an axle is at the end of a piece of the line
    the result is a cubic. Axles on a peak are among these positions; so are trains of which only
    some axles are on the path. Where the line has a jump the position is beside it, by a billionth
    of the path, and the result that with the axle on the better side.

    For structures that respond nonlinearly analyse the train at the position found. The derivative
    of the largest result by any number of the structure is that at this position.

    Args:
        line: `InfluenceLine`, of one or several results; not traced.
        train: `loads.Train`, at any position; its forces count by their component along the
            direction of the line.

    Options:
        largest: False finds the smallest result.

    Returns:
        `WorstPosition`, in the shape of the results.

    Raises:
        ValueError: not a line or a train, or traced ones.

    Example:
        The reaction of the first support of a beam of 8 m under two axles of 100 kN, 2 m apart: it
        is largest when the last one stands on it, ``100 + 100 6 / 8``.

        >>> section = jc.Section.rectangle(0.4, 0.8, jc.Elastic(30e9))
        >>> beam = jc.Beams([[0, 1]], section=section)
        >>> ends = jc.restrained([0], "xyz", "x") + jc.restrained([1], "yz")
        >>> structure = jc.Structure([[0, 0, 0], [8.0, 0, 0]], beam, supports=ends)
        >>> line = jc.design.influence_line(
        ...     structure, jc.Phase(), [0], lambda s: s.reactions[0, 2])
        >>> train = jc.loads.Train([0], 0.0, (0.0, 0.0, -100e3), spacings=[2.0])
        >>> worst = jc.design.worst_position(line, train)
        >>> print(f"{worst.position:.3f} m: {worst.value / 1e3:.1f} kN")
        2.000 m: 175.0 kN
    """
    if not isinstance(line, InfluenceLine) or not isinstance(train, Train):
        raise ValueError("worst_position: expected an InfluenceLine and a loads.Train")
    if line.path is not None:
        here, there = np.asarray(train.path).tolist(), np.asarray(line.path).tolist()
        if here != there or (None not in (train.on, line.on) and train.on != line.on):
            raise ValueError(
                f"train: stands on the path {here}, the line is that of {there}; give both the same"
            )
    stations, every = line.known_stations_and_coefficients()
    forces, spacings, way = (
        checks.array_if_known(x) for x in (train.forces, train.spacings, line.direction)
    )
    if forces is None or spacings is None or way is None:
        raise ValueError("train: is traced; find positions outside of jit and grad")
    behind = np.concatenate([[0.0], np.cumsum(spacings)])
    along = np.broadcast_to(forces, (len(behind), 3)) @ way / (way @ way)
    sign = 1.0 if largest else -1.0
    found = [_best_position(stations, sign * own, along, behind) for own in every]
    shape = np.shape(line.coefficients)[:-2]
    position, value = (np.reshape(x, shape) for x in zip(*found, strict=True))
    return WorstPosition(position, sign * value)


def moving_load(
    structure: Structure,
    phases: Phase | Sequence[Phase] | Solution | State,
    train: Train,
    positions: Float[ArrayLike, " n"],
    method: Newton | Incremental | None = None,
) -> Solution:
    """Analyse a train at many positions, all at once (`jax.vmap`), each from the same state.

    Args:
        structure, method: as for `solve`.
        phases: phases that lead to the state before the train comes, or a `Solution` or `State`.
        train: `loads.Train`, at any position.
        positions: of its first axle from the beginning of its path, [n], m.

    Returns:
        `Solution` with a leading axis [n] in every array.

    Raises:
        ValueError: not a train, or wrong positions.

    Example:
        The end of a cantilever of 2 m under a force of 100 N in its middle and at its end; the
        first is 5/16 of the second:

        >>> section = jc.Section.rectangle(0.04, 0.1, jc.Elastic(20e9))
        >>> beam = jc.Beams([[0, 1]], section=section)
        >>> structure = jc.Structure([[0, 0, 0], [2.0, 0, 0]], beam, supports=jc.clamped([0]))
        >>> train = jc.loads.Train([0], 0.0, (0.0, 0.0, -100.0))
        >>> solutions = jc.design.moving_load(structure, jc.Phase(), train, [1.0, 2.0])
        >>> print(solutions.status, jnp.round(1e3 * solutions.displacement[:, 1, 2], 2))  # mm
        [0 0] [-1.25 -4.  ]
    """
    require_structure(structure)
    if not isinstance(train, Train):
        raise ValueError(f"train: expected loads.Train, got {type(train).__name__}")
    positions = checks.as_floats(positions, "positions")
    if positions.ndim != 1:
        raise ValueError(f"positions: expected shape [n], got {positions.shape}")
    start = phases
    if not isinstance(phases, Solution | State):
        start = solve(structure, as_phases(structure, phases), method)

    def one(position):
        case = Phase(loads=replace(train, position=position))
        return solve(structure, [case], method, start=start)

    return jax.vmap(one)(jnp.asarray(positions))


def _ordinates_at(stations, own, x):
    """Return the ordinates of an influence line at distances `x`, m; zero beyond the path.

    `own` has the coefficients of its cubics, lowest power first, [n_piece, 4], between
    `stations` [n_piece + 1], m.
    """
    piece = np.clip(np.searchsorted(stations, x, side="right") - 1, 0, len(own) - 1)
    part = (x - stations[piece]) / (stations[piece + 1] - stations[piece])
    inside = (x >= stations[0]) & (x <= stations[-1])
    return np.where(inside, ((own[piece] * part[..., None] ** np.arange(4)).sum(axis=-1)), 0.0)


def _best_position(stations, own, forces, behind):
    """Return the position of the first axle, m, at which a result is largest, and this result.

    Args:
        stations, own: influence line, as of `_ordinates_at`.
        forces: of the axles, [n_axle], N, by the direction of the line.
        behind: distances of the axles behind the first one, [n_axle], m.

    Returns:
        Two numbers; NaN if the line is not finite.
    """
    if not np.isfinite(own).all():
        return np.nan, np.nan
    meets = np.unique((stations[None] + behind[:, None]).ravel())
    scale = stations[-1] - stations[0]
    meets = meets[np.append(True, np.diff(meets) > 1e-12 * scale)]
    begin, width = meets[:-1], np.diff(meets)
    at = begin[:, None] + width[:, None] * SAMPLES
    values = np.zeros_like(at)
    for force, back in zip(forces, behind, strict=True):
        values += force * _ordinates_at(stations, own, at - back)
    cubics = values @ TO_CUBIC.T
    places = [np.zeros(len(begin)), np.ones(len(begin)), *_stationary_points(cubics)]
    # places are NaN where a cubic has fewer stationary points: these are left out below
    reached = [_evaluate_each_cubic(cubics, np.nan_to_num(x)) for x in places]
    reached = np.where(np.isnan(places), -np.inf, reached)
    kind, k = np.unravel_index(int(reached.argmax()), reached.shape)
    x = places[kind][k]
    if kind < 2:  # beside a jump: on the better side of it
        beside = reached[1 - kind, k + (1 if kind else -1)] if 0 < k + kind < len(begin) else 0.0
        if abs(beside - reached[kind, k]) > 1e-9 * np.abs(own).max() * np.abs(forces).sum():
            x = x + (1e-9 * scale / width[k]) * (-1 if kind else 1)
    return begin[k] + x * width[k], reached[kind, k]


def _evaluate_each_cubic(cubics, x):
    """Return the k-th cubic at the k-th `x`, [n]; coefficients are [n, 4], constant first."""
    return (cubics * x[:, None] ** np.arange(4)).sum(axis=-1)


def _stationary_points(cubics):
    """Return both places from 0 to 1 where the slope of n cubics [n, 4] is zero, two arrays [n].

    Entries are NaN where a cubic has fewer of them.
    """
    _, c, b, a = cubics.T
    a, b = 3 * a, 2 * b
    with np.errstate(invalid="ignore", divide="ignore"):
        root = np.sqrt(b * b - 4 * a * c)
        half = -0.5 * (b + np.where(b < 0, -root, root))
        found = half / a, c / half
    return [np.where((x > 0) & (x < 1), x, np.nan) for x in found]
