"""Elongations to nearly twice the working precision.

The rounding of a displacement u changes a length by ``eps |u|``, and the force of a cable by ``EA
eps |u| / l``, which can exceed the force itself. A motion with a *low-order part* has six columns:
the displacement is the sum of the first three and the last three (double-double arithmetic). The
elongation follows from it with an error of ``eps`` of itself, and ``eps^2 |u|``.
"""

from __future__ import annotations

import jax
import jax.numpy as jnp
from jax import lax

from ..common.types import Array, Bool, Float
from ..numerics import compensated


@jax.jit  # one function in a program, however often it is called
def elongation_and_moved_ends(
    elongation: Float[Array, ""],
    ends: Float[Array, "n_end 3"],
    motion_with_low_part: Float[Array, "n_end 6"],
    precise: Bool[Array, ""],
) -> tuple[Float[Array, ""], Float[Array, "n_end 3"]]:
    """Return the elongation of a cable after a motion, m, and its moved ends, [n_end, 3], m.

    These are relative to the first end.

    Args:
        elongation: length over all `ends` before the motion minus unstressed length, m.
        ends: positions before the motion, m.
        motion_with_low_part: displacements, the sum of columns 0 to 2 and of their low-order part,
            small numbers in columns 3 to 5, m.
        precise: whether the elongation is needed beyond the working precision.

    Derivatives, of any order, are those of the same formulas in working precision.
    """
    motion = motion_with_low_part
    chord, moved = (
        _successive_differences(ends),
        _successive_differences(motion[:, :3]) + _successive_differences(motion[:, 3:]),
    )
    vector = chord + moved
    both = _segment_lengths(chord) + _segment_lengths(vector)
    square = jnp.sum((2 * chord + moved) * moved, axis=1, keepdims=True)
    # The barriers keep these numbers the same in all of their uses: recomputed beside other things,
    # they may be rounded in another way, and the remainder is that of one of them.
    change = lax.optimization_barrier(square / jnp.where(both > 0, both, 1.0))
    longer = lax.optimization_barrier(elongation + jnp.sum(change))
    given = lax.stop_gradient((elongation, ends, motion, change, longer))
    left = lax.cond(precise, _elongation_remainder, lambda *_: jnp.zeros_like(longer), *given)
    places = vector if len(vector) == 1 else jnp.cumsum(vector, axis=0)
    return longer + left, jnp.concatenate([jnp.zeros_like(vector[:1]), places])


def _elongation_remainder(elongation, ends, motion, change, longer):
    """Return the elongation in nearly twice the working precision minus `longer`, m, a scalar.

    `longer` is this elongation in working precision, `change` the change of length of each segment
    between successive ends, [n, 1], m; other arguments are as of `elongation_and_moved_ends`.
    """
    chord, (step, lost) = (compensated.two_sum(at[1:], -at[:-1]) for at in (ends, motion[:, :3]))
    moved = compensated.two_sum(step, lost + _successive_differences(motion[:, 3:]))
    more = compensated.elongation_correction(chord, moved, change)
    if len(more) == 1:
        return (compensated.two_sum(elongation[None, None], change)[1] + more)[0, 0]
    terms = [change[:, 0], jnp.stack([elongation, -longer, jnp.sum(more)])]
    return compensated.compensated_sum(jnp.concatenate(terms))


def _successive_differences(places):
    """Return each position [3] minus the one before: from `places`, [n, 3], to [n - 1, 3]."""
    return places[1:] - places[:-1]


def _segment_lengths(pieces):
    """Return the lengths [n, 1], m, of vectors [n, 3]; a zero length has derivative zero."""
    square = jnp.sum(pieces**2, axis=1, keepdims=True)
    return jnp.where(square > 0, jnp.sqrt(jnp.where(square > 0, square, 1.0)), 0.0)
