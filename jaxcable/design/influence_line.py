"""Influence lines along a path of beams, and the parts of the path on which they are adverse.

An influence line is the derivative of a result by a force at any place of a path. One adjoint solve
gives the whole line of a result: the derivative by forces at many places, all zero, in one more
phase (`loads.PointLoads`).
"""

from __future__ import annotations

import itertools
from collections.abc import Callable, Sequence
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np

from ..analysis.phases import Phase, as_phases
from ..analysis.solution import Solution, State
from ..analysis.solver import solve
from ..common import checks
from ..common.rules import Rule, nan_if_broken
from ..common.tree import Indices, pytree
from ..common.types import Array, ArrayLike, Float, Int
from ..elements.bending import gauss_lobatto
from ..equilibrium.incremental import Incremental
from ..equilibrium.newton import Newton
from ..loads import PointLoads
from ..loads.groups import Key
from ..loads.path_loads import ROUNDING, path_along_elements
from ..model.structure import Structure
from .arguments import require_structure

SAMPLES = 0.5 + 0.5 * np.polynomial.legendre.leggauss(4)[0]
"""Places on each piece of a line at which it is computed: inside, without kinks and jumps."""
TO_CUBIC = np.linalg.inv(np.vander(SAMPLES, 4, increasing=True))
"""Coefficients of a cubic from its values there."""

_MOST_LOADS = 256
"""Places on an element whose forces are taken together: each pair of them has terms of its own."""


@pytree(static=("on",), indices=("path",))
class InfluenceLine:
    """A result by the place of a unit force on a path: the result of `influence_line`.

    Attributes:
        stations: distances of the ends of its pieces from the beginning of the path, [n_piece + 1],
            m.
        coefficients: of 1, x, x^2, x^3 on each piece, with x from 0 to 1, [..., n_piece, 4]; the
            leading axes are those of the result.
        direction: of the unit force, [3]; its length scales the line.
        path: indices of the elements of the path.
        on: key of their group.

    Example:
        >>> line = jc.design.InfluenceLine(  # of the moment in the middle of a beam of 8 m
        ...     np.array([0.0, 4.0, 8.0]), np.array([[0, 2.0, 0, 0], [2.0, -2.0, 0, 0]]),
        ...     np.array([0.0, 0.0, -1.0]), None)
        >>> print(line.at([2.0, 4.0, 7.0]), line.area())
        [1.  2.  0.5] 8.0
    """

    stations: Float[ArrayLike, " n_piece+1"]
    coefficients: Float[ArrayLike, "... n_piece 4"]
    direction: Float[ArrayLike, " 3"]
    path: Int[ArrayLike, " n"] | None
    on: Key = None

    def at(
        self, distances: Float[ArrayLike, ""] | Float[ArrayLike, " n"]
    ) -> Float[Array, " ..."] | Float[Array, "... n"]:
        """Return the line at distances from the beginning of the path, [..., n]; zero beyond it.

        At one distance, a scalar, its shape is that of the result. Where the line has a jump, its
        value is that beyond the jump.
        """
        x = jnp.asarray(checks.as_floats(distances, "distances"))
        if x.ndim == 0:
            return self.at(x[None])[..., 0]
        if x.ndim != 1:
            raise ValueError(f"distances: expected a number or shape [n], got {x.shape}")
        stations, coefficients = jnp.asarray(self.stations), jnp.asarray(self.coefficients)
        count = stations.shape[0] - 1
        piece = jnp.clip(jnp.searchsorted(stations, x, side="right") - 1, 0, count - 1)
        begin, end = stations[piece], stations[piece + 1]
        powers = ((x - begin) / (end - begin))[:, None] ** jnp.arange(4.0)[None]
        own = jnp.take(coefficients, piece, axis=-2)
        powers = powers.reshape((1,) * (own.ndim - 2) + powers.shape)
        near = ROUNDING * jnp.finfo(own.dtype).eps * stations[-1]
        inside = ((x >= stations[0] - near) & (x <= stations[-1] + near)).astype(own.dtype)
        return jnp.sum(own * powers, axis=-1) * inside.reshape((1,) * (own.ndim - 2) + x.shape)

    def area(self) -> Float[Array, " ..."]:
        """Return the integral of the line: the result of a unit load per metre, [...]."""
        lengths = jnp.diff(jnp.asarray(self.stations))
        own = jnp.asarray(self.coefficients) @ (1 / jnp.arange(1.0, 5.0))
        return own @ lengths

    def adverse_parts(self, sign: int = 1) -> list[tuple[Float[np.ndarray, "n_part 2"], float]]:
        """Find the parts of the path on which a load makes a result larger, or smaller.

        Args:
            sign: 1 for parts on which the line is positive, -1 for those on which it is negative.

        Returns:
            For each entry of the result (in the order of its flattened axes) a pair: the begin and
            the end of each part, [n_part, 2], m (`loads.Crowd` takes them), and the result of a
            unit load per length on all of them.

        Raises:
            ValueError: another sign, or the line is traced.
        """
        if sign not in (1, -1):
            raise ValueError(f"sign = {sign!r}: expected 1 or -1")
        stations, every = self.known_stations_and_coefficients()
        return [_positive_parts_and_area(stations, sign * own, sign) for own in every]

    def known_stations_and_coefficients(
        self,
    ) -> tuple[Float[np.ndarray, " n_piece+1"], Float[np.ndarray, "n_entry n_piece 4"]]:
        """Return `stations`, and `coefficients` with all results on one axis, as NumPy arrays.

        Raises ValueError if they are traced.
        """
        found: list[Any] = [checks.array_if_known(x) for x in (self.stations, self.coefficients)]
        if any(x is None for x in found):
            raise ValueError(
                "line: is traced; find positions outside of jit and grad, and differentiate the "
                "analysis at a position that is known"
            )
        return found[0], found[1].reshape(-1, *found[1].shape[-2:])


def influence_line(
    structure: Structure,
    phases: Phase | Sequence[Phase] | Solution | State,
    path: Int[ArrayLike, " n"],
    of: str | Callable[[Solution], Any],
    *,
    direction: Float[ArrayLike, " 3"] = (0.0, 0.0, -1.0),
    breaks: Float[ArrayLike, " n_break"] | None = None,
    on: Key = None,
    method: Newton | Incremental | None = None,
) -> InfluenceLine:
    """Compute influence lines: results by the place of a unit force on a path of beams.

    They are derivatives at the state that the phases lead to: exact for any load of a structure
    that responds linearly, and for small loads of any other. One adjoint solve for each number of
    the result gives the whole line, whatever the number of places.

    Args:
        structure: `Structure`.
        phases: phases that lead to the state, or a `Solution` or `State`.
        path: indices of the elements of one group of beams, in order, end to end.
        of: function of the `Solution` to an array of results, or the name of one: "reactions",
            "displacement", "tension", "section_forces" and so on.

    Options:
        direction: of the unit force, [3]; its length scales the line.
        breaks: places from 0 to 1 on each element, first 0 and last 1, between which the line is a
            cubic. In linear theory it is one wherever nothing but the ends of an element is asked
            for; section forces within it have a kink or a jump at their place, which must be among
            the breaks. Default: the points of the group at which section forces are given.
        on: key of the group of beams; None means the only one.
        method: as for `solve`.

    Returns:
        `InfluenceLine`, NaN if the analysis fails.

    Raises:
        ValueError: an unknown `of`, elements that are no path, breaks that do not increase from 0
            to 1.

    Example:
        A beam of 8 m on two supports, in two elements: the moment in its middle (``L / 4``; My is
        negative where it pulls the lower side), and the smallest under two axles of 60 kN and
        100 kN, 1 m apart:

        >>> section = jc.Section.rectangle(0.4, 0.8, jc.Elastic(30e9))
        >>> beam = jc.Beams([[0, 1], [1, 2]], section=section)
        >>> ends = jc.restrained([0], "xyz", "x") + jc.restrained([2], "yz")
        >>> structure = jc.Structure([[0, 0, 0], [4.0, 0, 0], [8.0, 0, 0]], beam, supports=ends)
        >>> line = jc.design.influence_line(
        ...     structure, jc.Phase(), [0, 1], lambda s: s.section_forces[0, 2, 4])
        >>> print(line.at([2.0, 4.0, 7.0]).round(6))
        [-1.  -2.  -0.5]
        >>> train = jc.loads.Train([0, 1], 0.0, [[0, 0, -60e3], [0, 0, -100e3]], spacings=[1.0])
        >>> worst = jc.design.worst_position(line, train, largest=False)
        >>> print(f"{worst.position:.3f} m: {worst.value / 1e3:.1f} kN m")
        5.000 m: -290.0 kN m
    """
    require_structure(structure)
    start = phases
    if not isinstance(phases, Solution | State):
        start = solve(structure, as_phases(structure, phases), method)
    direction = checks.floats_of_shape(direction, "direction", (3,))
    text = "is zero; give the direction of the unit force, such as (0, 0, -1)"
    direction = nan_if_broken(Rule("direction", direction, lambda v: (v == 0).all(), text))
    numbers = checks.as_indices(path, "path", things="element")
    index = PointLoads(numbers[:1], 0.5, direction, on=on).group_index(structure)
    found = path_along_elements(structure, numbers, index)
    beams: Any = structure.groups[index]
    at = _checked_breaks(gauss_lobatto(beams.points)[0] if breaks is None else breaks)
    inside = (at[:-1, None] + np.diff(at)[:, None] * SAMPLES[None]).ravel()

    def slopes_at(inside):
        """Return the derivatives by forces at these places of all elements, [..., n, n_inside]."""
        places = np.where(found.backwards[:, None], 1 - inside, inside)
        elements = np.repeat(numbers, inside.size)

        def final(amounts):
            forces = amounts[:, None] * jnp.asarray(direction)[None]
            load = PointLoads(elements, places.ravel(), forces, on=on)
            solution = solve(structure, [Phase(loads=load)], method, start=start)
            return of(solution) if callable(of) else getattr(solution, of)

        slopes = _jacobian_by_rows(
            final, jnp.zeros(len(elements), jnp.asarray(structure.nodes).dtype)
        )
        return slopes.reshape(*slopes.shape[:-1], *places.shape)

    count = -(-inside.size // _MOST_LOADS)
    each = -(-inside.size // count)
    filled = np.pad(inside, (0, count * each - inside.size), mode="edge").reshape(count, each)
    slopes = jnp.concatenate([slopes_at(part) for part in filled], axis=-1)[..., : inside.size]
    shape = (*slopes.shape[:-2], len(numbers) * (len(at) - 1), 4)
    coefficients = slopes.reshape(shape) @ jnp.asarray(TO_CUBIC.T, slopes.dtype)
    ends = found.stations
    lengths = ends[1:] - ends[:-1]
    each = ends[:-1, None] + lengths[:, None] * np.asarray(at)[None, :-1]
    pack = jnp if isinstance(ends, jax.Array) else np
    stations = pack.concatenate([each.ravel(), ends[-1:]])
    return InfluenceLine(stations, coefficients, direction, Indices(numbers), on)


def _jacobian_by_rows(function, x):
    """Return the derivatives of a function's result, [...], by x, [n]: an array [..., n].

    Known numbers take an adjoint solve after the other: memory does not grow with their number.
    """
    value, pull = jax.vjp(function, x)
    if isinstance(value, dict | list | tuple) or value is None:
        raise ValueError("of: expected a function of the solution to one array of floats")
    rows = np.eye(value.size, dtype=value.dtype).reshape(-1, *value.shape)
    if isinstance(value, jax.core.Tracer):
        found = jax.vmap(pull)(rows)[0]
    else:
        found = np.stack([pull(row)[0] for row in rows])
    return found.reshape(*value.shape, x.size)


def _checked_breaks(breaks):
    """Return the places `breaks` as a NumPy array; ValueError unless they increase from 0 to 1."""
    at = checks.array_if_known(checks.as_floats(breaks, "breaks"))
    if at is None:
        raise ValueError("breaks: cannot be traced; give known numbers")
    increasing = at.ndim == 1 and len(at) > 1 and bool((np.diff(at) > 0).all())
    if not increasing or at[0] != 0 or at[-1] != 1:
        raise ValueError("breaks: must increase from 0 to 1, such as [0, 0.5, 1]")
    return at


def _positive_parts_and_area(stations, own, sign):
    """Return the parts where piecewise cubics `own` are positive, [n_part, 2], m, and their area.

    Args:
        stations: ends of the intervals, [n_piece + 1], m.
        own: coefficients on each interval, lowest power first, [n_piece, 4].
        sign: 1 or -1, by which the area is multiplied.
    """
    begin, width, found, area = stations[:-1], np.diff(stations), [], 0.0
    small = 1e-12 * np.abs(own).max(initial=0.0)
    for start, length, cubic in zip(begin, width, own, strict=True):
        if np.abs(cubic).max() <= small:
            continue
        roots = np.polynomial.polynomial.polyroots(np.trim_zeros(cubic, "b"))
        real = roots.real[(np.abs(roots.imag) < 1e-9) & (roots.real > 0) & (roots.real < 1)]
        cuts = np.concatenate([[0.0], np.sort(real), [1.0]])
        for low, high in itertools.pairwise(cuts):
            if np.polynomial.polynomial.polyval(0.5 * (low + high), cubic) <= small:
                continue
            whole = np.polynomial.polynomial.polyint(cubic)
            own_area = np.diff(np.polynomial.polynomial.polyval([low, high], whole))[0]
            area += length * own_area
            part = start + low * length, start + high * length
            if found and part[0] - found[-1][1] <= 1e-9 * stations[-1]:
                found[-1] = found[-1][0], part[1]
            else:
                found.append(part)
    return np.array(found).reshape(-1, 2), sign * float(area)
