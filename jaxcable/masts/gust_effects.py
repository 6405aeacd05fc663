"""Effects of gusts on patches of a mast, combined as EN 1993-3-1 does."""

from __future__ import annotations

import jax
import jax.numpy as jnp

from ..programs.program_calls import as_program
from .mast_analysis import MastForces, MastResults


def extremes(results: MastResults) -> tuple[MastForces, MastForces]:
    """Return the smallest and largest effects of the gusts, in every state and direction.

    ``S_M -+ sqrt(sum (S_i - S_M)^2)`` over the patches i, with the effect S_M of the mean wind and
    S_i of that with gusts on one patch (EN 1993-3-1, B.4.3.2.5). Without gusts both are S_M.

    Args:
        results: `MastResults`.

    Returns:
        Smallest and largest `MastForces`, [n_state, n_direction, ...].

    Example:
        >>> part = jc.masts.tube_section(20.0, "CHS 168.3x6.3")
        >>> guys = [jc.masts.guy_level(19.0, 12.0, [0, 120, 240], "Galfan spiral strand 12")]
        >>> built = jc.masts.erect(jc.masts.GuyedMast([part], guys))
        >>> found = jc.masts.analyse(built, {"wind": jc.masts.eurocode_state(22.0)}, [0.0])
        >>> low, high = jc.masts.extremes(found)
        >>> print((high.tensions[0, 0, :, 1] / 1e3).round(2), "kN")
        [17.54 16.78 16.78] kN
    """
    return _extremes(results.forces)


@as_program
def _extremes(forces):
    """Return the `MastForces` of `extremes`; a program."""

    def spread(x):
        total = jnp.sum((x[:, :, 1:] - x[:, :, :1]) ** 2, axis=2)
        some = jnp.where(total == 0, 1.0, total)  # the root of zero has no derivative
        return jnp.where(total == 0, 0.0, jnp.sqrt(some))

    mean = jax.tree.map(lambda x: x[:, :, 0], forces)
    off = jax.tree.map(spread, forces)
    low = jax.tree.map(lambda x, y: x - y, mean, off)
    return low, jax.tree.map(lambda x, y: x + y, mean, off)
