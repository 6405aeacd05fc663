"""Rupture of a guy, by a static substitute for its impact."""

from __future__ import annotations

import jax
import jax.numpy as jnp

from ..analysis.phases import Phase
from ..analysis.solver import solve
from ..common.types import ArrayLike, Float
from ..design import loss_of_cable
from .mast_analysis import ErectedMast, MastResults, forces_of_solution, patterns_and_guy_shares
from .mast_states import MastState

_INCREMENTS = 10


def rupture(
    built: ErectedMast,
    guy: int,
    state: MastState | None = None,
    direction: Float[ArrayLike, ""] = 0.0,
    *,
    dynamic_factor: Float[ArrayLike, ""] = 2.0,
) -> MastResults:
    """Analyse the rupture of a guy, in calm air or under the mean wind of a state.

    The guy goes, and the forces that it exerted act on the mast reversed, times the dynamic factor
    minus one (`design.loss_of_cable`): the static substitute for the impact. EN 1993-3-1, Annex E,
    asks for it as an accidental action; its text was not at hand when this was written.

    Args:
        built: `ErectedMast`.
        guy: index of the guy, as of `GuyedMast.guy_names`.
        state: `MastState`; None: calm air.
        direction: towards which the wind blows, degrees.

    Options:
        dynamic_factor: at least 1; 1 is the state after the mast has come to rest.

    Returns:
        `MastResults` of one case; NaN where the mast falls.

    Raises:
        ValueError: there is no such guy.

    Example:
        >>> part = jc.masts.tube_section(20.0, "CHS 168.3x6.3")
        >>> cable = "Galfan spiral strand 12"
        >>> guys = [jc.masts.guy_level(h, 12.0, [0, 90, 180, 270], cable) for h in (10.0, 19.0)]
        >>> built = jc.masts.erect(jc.masts.GuyedMast([part], guys))
        >>> found = jc.masts.rupture(built, 0, dynamic_factor=1.0)
        >>> print(found.status, (found.forces.tensions[0, 0, 0, :4, 1] / 1e3).round(2), "kN")
        [[[0]]] [ 0.   15.12  0.3  15.12] kN
    """
    mast, structure, start = built.mast, built.structure, built.solution
    name = f"rupture of guy {mast.guy_names[mast.index_of_guy(guy)]}"
    if state is not None:
        none = patterns_and_guy_shares(mast)
        loads = state.loads(mast, direction, none[0][0], none[1][0])
        start = solve(structure, Phase(loads=loads, temperature=state.temperature), start=start)
    loss = loss_of_cable(structure, start, {"guys": [guy]}, dynamic_factor=dynamic_factor)
    phase = Phase(loads=loss.loads, removes=loss.removes, increments=_INCREMENTS)
    solution = solve(structure, phase, start=start)
    one = forces_of_solution(mast, structure, solution, direction), solution.status, solution.stable
    angles = jnp.atleast_1d(jnp.asarray(direction, float))
    return MastResults(
        (name,), angles, ("mean",), *jax.tree.map(lambda x: jnp.asarray(x)[None, None, None], one)
    )
