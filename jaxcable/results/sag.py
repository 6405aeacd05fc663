"""The sag of a chain of segments, straight or hanging, below the chord between its ends."""

from __future__ import annotations

import jax
import jax.numpy as jnp
import numpy as np

from ..analysis.element_shapes import ElementShapes
from ..common.tree import pytree
from ..common.types import Array, Float
from ..numerics import scaled
from ..numerics.roots import bracketed_root
from ..numerics.vectors import scalar_product


@pytree
class Sag:
    """How far a cable hangs below the chord between its ends: the result of `sags`.

    Axes are [n_elem] for the elements of a group, [n_elem, n_segment] for cables that slide, none
    for a chain; batches have theirs in front.

    Attributes:
        midspan: vertical distance below the chord at midspan, half of the horizontal distance of
            the ends, m; negative above the chord, as under wind from below. It says little where
            the chord is nearly upright: take `deflection`.
        largest: largest vertical distance below the chord, m.
        largest_at: where it is on the cable, [..., 3], m.
        deflection: largest distance from the chord, at right angles to it and in any direction, m:
            under wind that of the whole load, of which the sag is the vertical part.
        deflection_at: where it is on the cable, [..., 3], m.
        lowest: lowest point, [..., 3], m; it may be an end.
        span: horizontal distance of the ends, m.

    Example:
        >>> line = jc.Catenaries([[0, 1]], axial_stiffness=33e6, weight=16.0)
        >>> nodes = [[0.0, 0.0, 0.0], [300.0, 0.0, 0.0]]
        >>> structure = jc.Structure(nodes, line, supports=jc.pinned([0, 1]))
        >>> strung = jc.solve(structure, jc.Phase(sag=8.0, loads=jc.SelfWeight()))
        >>> sag = jc.results.sags(structure, strung)
        >>> print(strung.status, sag.midspan.round(6), sag.lowest.round(6))
        0 [8.] [[150.   0.  -8.]]
    """

    midspan: Float[Array, " *case"]
    largest: Float[Array, " *case"]
    largest_at: Float[Array, "*case 3"]
    deflection: Float[Array, " *case"]
    deflection_at: Float[Array, "*case 3"]
    lowest: Float[Array, "*case 3"]
    span: Float[Array, " *case"]


def sag_of_segments(segments: ElementShapes) -> Sag:
    """Return the `Sag` of a chain, `ElementShapes` with arrays [n_segment, ...]."""
    begin, end = segments.first[0], segments.last[-1]
    chord = end - begin
    span = jnp.sqrt(scalar_product(chord[:2], chord[:2]))
    level = chord * np.array([1.0, 1.0, 0.0]) / span
    up = jnp.array([0.0, 0.0, 1.0], chord.dtype)
    below = (
        chord[2] / span * level - up
    )  # vertical distance below the chord, for a point from begin
    largest_at = _farthest_point(segments, below)
    middle = _point_at_station(segments, begin, level, 0.5 * span)
    deflection, deflection_at = _largest_deflection(segments, begin, chord)
    return Sag(
        midspan=scalar_product(middle - begin, below),
        largest=scalar_product(largest_at - begin, below),
        largest_at=largest_at,
        deflection=deflection,
        deflection_at=deflection_at,
        lowest=_farthest_point(segments, -up),
        span=span,
    )


def _largest_deflection(segments, begin, chord):
    """Return the largest distance of a chain from its chord, m, and its place, [3].

    A single catenary lies in a plane with its chord, so that the direction is known. `begin` is
    the first end, `chord` the vector to the last one.
    """
    along = chord / jnp.sqrt(scalar_product(chord, chord))

    def across(point):
        return point - begin - scalar_product(point - begin, along) * along

    if len(segments.hangs) == 1:
        one = jax.tree.map(lambda x: x[0], segments)
        aside = across(one.point(jnp.full((), 0.5, chord.dtype)))
        place = _farthest_point(segments, aside)
    else:

        def nearness(point):
            return -scalar_product(across(point), across(point))

        parts = jax.vmap(lambda one: one.argmin_along(nearness))(segments)
        points = jax.vmap(lambda one, part: one.point(part))(segments, parts)
        place = points[jnp.argmin(jax.lax.stop_gradient(jax.vmap(nearness)(points)))]
    return scaled.safe_norm(across(place)), place  # zero of straight lines


def _farthest_point(segments, direction):
    """Return the point of a chain that is farthest along a direction [3], a position [3], m."""
    ends = jnp.zeros((), direction.dtype), jnp.ones((), direction.dtype)
    parts = jax.vmap(lambda one: one.highest_part(direction, *ends))(segments)
    points = jax.vmap(lambda one, part: one.point(part))(segments, parts)
    return points[jnp.argmax(jax.lax.stop_gradient(points @ direction))]


def _point_at_station(segments, begin, level, station):
    """Return the point [3], m, of a chain at a horizontal distance `station`, m, from `begin`."""
    first, last = (ends @ level - begin @ level for ends in (segments.first, segments.last))
    k = jnp.argmax(jax.lax.stop_gradient((first <= station) & (station <= last)))
    one = jax.tree.map(lambda x: x[k], segments)
    guess = (station - first[k]) / (last[k] - first[k])

    def balance(part):
        return (scalar_product(one.point(part) - begin, level) - station) / station

    # beyond its ends a catenary goes on, so that a root at an end is inside of the bracket
    bracket = jnp.full_like(guess, -0.25), jnp.full_like(guess, 1.25)
    return one.point(bracketed_root(balance, guess, *bracket))
