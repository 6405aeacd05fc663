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
def rebase(
    elongation: Float[Array, ""],
    ends: Float[Array, "n_end 3"],
    motion: Float[Array, "n_end 6"],
    wanted: Bool[Array, ""],
) -> tuple[Float[Array, ""], Float[Array, "n_end 3"]]:
    """Return elongation, m, and positions [n_end, 3] relative to the first end, m, after a motion.

    Args:
        elongation: length over all `ends` before the motion less unstressed length, m.
        ends: positions before the motion, m.
        motion: displacements with a low-order part.
        wanted: whether digits beyond the working precision are needed.

    Derivatives, of any order, are those of the same formulas in working precision.
    """
    chord, moved = _differences(ends), _differences(motion[:, :3]) + _differences(motion[:, 3:])
    vector = chord + moved
    both = _piece_lengths(chord) + _piece_lengths(vector)
    square = jnp.sum((2 * chord + moved) * moved, axis=1, keepdims=True)
    # The barriers keep these numbers the same in all of their uses: recomputed beside other things,
    # they may be rounded in another way, and the remainder is that of one of them.
    change = lax.optimization_barrier(square / jnp.where(both > 0, both, 1.0))
    longer = lax.optimization_barrier(elongation + jnp.sum(change))
    given = lax.stop_gradient((elongation, ends, motion, change, longer))
    left = lax.cond(wanted, _elongation_remainder, lambda *_: jnp.zeros_like(longer), *given)
    places = vector if len(vector) == 1 else jnp.cumsum(vector, axis=0)
    return longer + left, jnp.concatenate([jnp.zeros_like(vector[:1]), places])


def _elongation_remainder(elongation, ends, motion, change, longer):
    """Return the exact elongation less `longer`, from the length changes of pieces, [n, 1]."""
    chord, (step, lost) = (compensated.two_sum(at[1:], -at[:-1]) for at in (ends, motion[:, :3]))
    moved = compensated.two_sum(step, lost + _differences(motion[:, 3:]))
    more = compensated.elongation_correction(chord, moved, change)
    if len(more) == 1:
        return (compensated.two_sum(elongation[None, None], change)[1] + more)[0, 0]
    terms = [change[:, 0], jnp.stack([elongation, -longer, jnp.sum(more)])]
    return compensated.compensated_sum(jnp.concatenate(terms))


def _differences(places):
    """Return the differences of successive rows, [n - 1, 3]."""
    return places[1:] - places[:-1]


def _piece_lengths(pieces):
    """Return lengths of pieces [n, 3], [n, 1]; a zero length has a finite derivative."""
    square = jnp.sum(pieces**2, axis=1, keepdims=True)
    return jnp.where(square > 0, jnp.sqrt(jnp.where(square > 0, square, 1.0)), 0.0)
