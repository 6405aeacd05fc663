"""Guys on site: tensions from frequencies and sags, and which turnbuckle to turn by how much."""

from __future__ import annotations

from collections.abc import Sequence

import jax.numpy as jnp
import numpy as np

from ..analysis.phases import Phase
from ..analysis.solver import solve
from ..common import checks, status
from ..common.selection import only
from ..common.tree import copy_with, pytree
from ..common.types import Array, ArrayLike, Float, Int
from ..design.fit import fit
from ..dynamics import modes
from ..elements import Cables, Catenaries
from ..forms import end_tensions
from ..loads import SelfWeight
from ..model.structure import Structure
from ..model.supports import pinned
from .guyed_mast import GuyedMast
from .mast_analysis import erect

_CHAIN = 32  # elements of a guy whose modes are found
_ROUNDS = 20
_AGREED = 1e-9  # of a frequency


def _guy(mast, guy):
    """Return the numbers of a guy: ends as drawn, in its vertical plane from x, weight and EA."""
    structure = mast.structure()
    own = structure.elements["guys"]
    low, high = np.asarray(structure.nodes)[own.links.array[mast.index_of_guy(guy)]]
    reach = float(np.hypot(*(high - low)[:2]))
    ends = np.array([[0.0, 0.0, 0.0], [reach, 0.0, high[2] - low[2]]])
    return ends, float(own.weight[guy]), float(own.stiffness_with_spring[guy])


def tension_from_frequency(
    mast: GuyedMast, guy: int, frequency: float, half_waves: int = 1
) -> Float[Array, " 2"]:
    """Return the tensions of a guy at anchor and mast, [2], N, from a measured natural frequency.

    The frequency is that of vibrations sideways, across the vertical plane of the guy, to which the
    sag adds no stiffness; those in the plane with two half waves, four and so on are nearly as
    fast. It is found as `dynamics.modes` of a chain of 32 cables between fixed ends has it. Of a
    taut guy this is ``n / 2L sqrt(T / m)``, with an error of some 1e-4.

    Args:
        mast: `GuyedMast`, as drawn; the tensions it states have no effect.
        guy: index of the guy, as of `GuyedMast.guy_names`.
        frequency: natural frequency, Hz.
        half_waves: number of half waves of the mode, at most 8.

    Returns:
        Tensions, [2], N.

    Raises:
        ValueError: no such guy, a frequency that is not positive, or no such tension below the
            strength.

    Example:
        >>> part = jc.masts.tube_section(20.0, "CHS 168.3x6.3")
        >>> guys = [jc.masts.guy_level(19.0, 12.0, [0, 120, 240], "Galfan spiral strand 12")]
        >>> mast = jc.masts.GuyedMast([part], guys)
        >>> print(jc.masts.tension_from_frequency(mast, 0, 3.1).round(0), "N")
        [14358. 14496.] N
    """
    if not frequency > 0:
        raise ValueError(f"frequency = {frequency}: must be positive")
    if not 1 <= half_waves <= 8:
        raise ValueError(f"half_waves = {half_waves}: expected 1 to 8")
    ends, weight, stiffness = _guy(mast, guy)
    points = np.linspace(ends[0], ends[1], _CHAIN + 1)
    chain = Cables(
        np.stack([np.arange(_CHAIN), np.arange(1, _CHAIN + 1)], axis=1), stiffness, weight=weight
    )
    structure = Structure(points, chain, pinned([0, _CHAIN]))
    fixed = np.ones((_CHAIN + 1, 3), bool)
    fixed[1:-1, 1] = False  # sideways only
    length = float(np.linalg.norm(ends[1] - ends[0]))
    tension = weight / 9.80665 * (2 * length * frequency / half_waves) ** 2
    strength = float(mast.of_guys("strength")[guy])
    if tension > strength:
        text = f"of a tension of {tension:.4g} N, above the strength of guy {guy}, {strength:.4g} N"
        raise ValueError(f"frequency = {frequency} Hz: {text}")
    for _ in range(_ROUNDS):
        solution = solve(structure, Phase(pretension=tension, loads=SelfWeight()))
        with checks.without_warnings():  # of supports that `fixed` frees: it frees none
            found = modes(structure, solution, half_waves, fixed=fixed)
        ratio = frequency / float(found.frequency[-1])
        if int(solution.status) != status.OK or not np.isfinite(ratio):
            break
        if abs(ratio - 1) < _AGREED:
            return np.linalg.norm(np.asarray(solution.reactions)[[0, -1]], axis=1)
        tension *= ratio**2
    raise ValueError(f"frequency = {frequency} Hz: no tension of guy {guy} gives it")


def tension_from_sag(mast: GuyedMast, guy: int, sag: float) -> Float[Array, " 2"]:
    """Return the tensions of a guy at anchor and mast, [2], N, from a measured sag.

    Args:
        mast, guy: as for `tension_from_frequency`.
        sag: vertical distance from the chord at midspan, m.

    Returns:
        Tensions, [2], N.

    Raises:
        ValueError: no such guy, or a sag that is not positive.

    Example:
        >>> part = jc.masts.tube_section(20.0, "CHS 168.3x6.3")
        >>> guys = [jc.masts.guy_level(19.0, 12.0, [0, 120, 240], "Galfan spiral strand 12")]
        >>> mast = jc.masts.GuyedMast([part], guys)
        >>> print(jc.masts.tension_from_sag(mast, 0, 0.03).round(0), "N")
        [15266. 15404.] N
    """
    if not sag > 0:
        raise ValueError(f"sag = {sag}: must be positive")
    ends, weight, stiffness = _guy(mast, guy)
    cable = Catenaries([[0, 1]], axial_stiffness=stiffness, weight=weight)
    structure = Structure(ends, cable, pinned([0, 1]))
    solution = solve(structure, Phase(built_sag=sag, loads=SelfWeight()))
    return end_tensions(structure, solution)[0]


@pytree
class Retensioning:
    """How to bring the guys of a mast to their initial tensions: the result of `retension`.

    Attributes:
        shortening: by how much each guy is shortened, [n_guy], m; negative: let out.
        turns: of its turnbuckle, [n_guy]; NaN without a pitch.
        fitted: tensions at the anchors in the mast that fits the measurements, [n_guy], N.
        lean: horizontal displacements at guy levels in this mast, along x and y, [n_level, 2], m.
        order: indices of guys in the order of turning, [n_guy].
        readings: tensions of all guys at their anchors after each step, [n_guy (steps), n_guy], N.
        status: integer code.

    Example:
        >>> part = jc.masts.tube_section(20.0, "CHS 168.3x6.3")
        >>> guys = [jc.masts.guy_level(19.0, 12.0, [0, 120, 240], "Galfan spiral strand 12")]
        >>> mast = jc.masts.GuyedMast([part], guys)
        >>> found = jc.masts.retension(mast, [11.9e3, 12.1e3, 12.0e3])
        >>> print(found.status, found.fitted.round(-1), found.readings[-1].round(-1))
        0 [12000. 12000. 12000.] [15000. 15000. 15000.]
    """

    shortening: Float[Array, " n_guy"]
    turns: Float[Array, " n_guy"]
    fitted: Float[Array, " n_guy"]
    lean: Float[Array, "n_level 2"]
    order: Int[Array, " n_guy"]
    readings: Float[Array, "n_guy n_guy"]
    status: Int[Array, ""]


def retension(
    mast: GuyedMast,
    measured: Float[ArrayLike, " n_guy"],
    lean: Float[ArrayLike, "n_level 2"] | None = None,
    *,
    scatter: float = 0.02,
    lean_scatter: float | None = None,
    pitch: float | None = None,
    order: Sequence[int] | None = None,
) -> Retensioning:
    """Find by how much to shorten which guy, from measured tensions, to those stated of a mast.

    The mast is nearly free to lean: tensions of one level must almost balance each other, and do
    not tell the lengths of its guys. So these are fitted to tensions and to the lean of the axis
    by least squares, each with its scatter (`fit`); then every turnbuckle takes in what its guy is
    longer than in the mast as stated, which stands plumb if its guys are symmetric. Readings of the
    steps between tell the crew what to expect while they turn one after another.

    Args:
        mast: `GuyedMast`, with the tensions that its guys shall have.
        measured: tensions at the anchors in calm air, all of one day, [n_guy], N.
        lean: measured horizontal displacements of the axis at the guy levels, along x and y,
            [n_level, 2], m; default zero.

    Options:
        scatter: standard deviation of measured tensions, over these.
        lean_scatter: standard deviation of `lean`, m; default a thousandth of the height of each
            level where it is not measured, else 5 mm.
        pitch: by how much one turn shortens a guy, m (both threads of a turnbuckle).
        order: indices of guys; default from the lowest level upwards.

    Returns:
        `Retensioning`; NaN where its status is not 0.

    Raises:
        ValueError: another number of tensions than guys, or of leans than levels; a tension,
            scatter or pitch that is not positive, an order that does not name each guy once.

    Example:
        >>> part = jc.masts.tube_section(20.0, "CHS 168.3x6.3")
        >>> guys = [jc.masts.guy_level(19.0, 12.0, [0, 120, 240], "Galfan spiral strand 12")]
        >>> mast = jc.masts.GuyedMast([part], guys)
        >>> found = jc.masts.retension(mast, [14.4e3] * 3, [[0.03, 0.0]], pitch=0.004)
        >>> print(found.status, found.turns.round(1))
        0 [-3.7  2.2  2.2]
    """
    count, heights = len(mast.guy_names), np.array([float(x.height) for x in mast.guys])
    measured = checks.floats_of_shape(measured, "measured", (count,))
    usual = 1e-3 * heights[:, None] if lean is None else 5e-3
    of_lean = usual if lean_scatter is None else lean_scatter
    lean = np.zeros((len(heights), 2)) if lean is None else lean
    lean = checks.floats_of_shape(lean, "lean", (len(heights), 2))
    order = list(range(count)) if order is None else [int(k) for k in order]
    if sorted(order) != list(range(count)):
        raise ValueError(f"order = {order}: expected each of the guys 0 to {count - 1} once")
    for name, value in (
        ("measured", measured),
        ("scatter", scatter),
        ("lean_scatter", of_lean),
        ("pitch", pitch),
    ):
        if value is not None and not np.all(np.asarray(value) > 0):
            raise ValueError(f"{name} = {value}: must be positive")
    built = erect(mast)
    structure, at = built.structure, np.array(mast.layout.guys)

    def readings_of(state):
        """Return tensions at anchors, [n_guy], N, and leans, [n_level, 2], m."""
        return end_tensions(structure, state)["guys"][:, 0], state.displacement[at, :2]

    def residuals(longer, start):
        solution = solve(structure, Phase(shortening={"guys": -longer}), start=start)
        tensions, leans = readings_of(solution)
        off = (tensions - measured) / (scatter * measured), (leans - lean) / of_lean
        return off, solution

    found = fit(residuals, np.zeros(count), args=(built.solution.last,))
    longer = found.params
    changes = [Phase(shortening={"guys": -longer})]
    changes += [Phase(shortening={"guys": only([k], longer[k : k + 1])}) for k in order]
    solution = solve(structure, changes, start=built.solution)
    tensions, leans = zip(*map(readings_of, solution.phases), strict=True)
    codes = jnp.stack([built.status, found.status, solution.status])
    turns = jnp.full(count, jnp.nan) if pitch is None else longer / pitch
    code = jnp.max(codes)

    def known(x):
        return jnp.where(code == status.OK, x, jnp.nan)

    fitted = known(tensions[0]), known(leans[0])
    steps = known(jnp.stack(tensions[1:]))
    return Retensioning(known(longer), known(turns), *fitted, jnp.array(order), steps, code)


def with_tensions(mast: GuyedMast, tensions: Float[ArrayLike, " n_guy"]) -> GuyedMast:
    """Return a mast whose guys have other tensions as built, such as measured ones.

    Args:
        mast: `GuyedMast`.
        tensions: at the anchors, [n_guy], N.

    Example:
        >>> part = jc.masts.tube_section(20.0, "CHS 168.3x6.3")
        >>> guys = [jc.masts.guy_level(19.0, 12.0, [0, 120, 240], "Galfan spiral strand 12")]
        >>> mast = jc.masts.with_tensions(jc.masts.GuyedMast([part], guys), [12e3, 15e3, 15e3])
        >>> print(mast.guys[0].tension)
        [12000. 15000. 15000.]
    """
    levels, at, tensions = [], 0, checks.as_floats(tensions, "tensions")
    for level in mast.guys:
        count = len(level.azimuths)
        levels.append(copy_with(level, tension=tensions[at : at + count]))
        at += count
    return copy_with(mast, guys=levels)
