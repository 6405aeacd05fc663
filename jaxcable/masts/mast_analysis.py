"""Analysis of a mast: erected with its guys as built, then all directions, states and patches."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import jax
import jax.numpy as jnp
import numpy as np

from ..analysis.batches import batched
from ..analysis.phases import Phase
from ..analysis.solution import Solution
from ..analysis.solver import solve
from ..common import checks
from ..common.tree import copy_with, pytree
from ..common.types import Array, ArrayLike, Bool, Float, Int
from ..design import loss_of_cable
from ..forms import end_tensions
from ..loads import PointMasses, SelfWeight
from ..loads.masses import STANDARD_GRAVITY
from ..model.structure import Structure
from ..programs.program_calls import as_program
from ..results import rotation_vectors
from .guyed_mast import GuyedMast
from .mast_states import MastState

_DIRECTIONS = 12
_BREAKING_INCREMENTS = 10


@pytree
class ErectedMast:
    """A mast with its guys as built, in calm air: the result of `erect`.

    Attributes:
        mast: the `GuyedMast`.
        structure: its `Structure`.
        solution: its `Solution`, from which cases start.
        tensions: of guys at anchors and at the mast, [n_guy, 2], N.
        rest_length: unstressed lengths of guys, [n_guy], m.
        status: integer code.

    Example:
        >>> part = jc.masts.tube_section(20.0, "CHS 168.3x6.3")
        >>> guys = [jc.masts.guy_level(19.0, 12.0, [0, 120, 240], "Galfan spiral strand 12")]
        >>> built = jc.masts.erect(jc.masts.GuyedMast([part], guys))
        >>> print(built.status, built.tensions[0].round(1), f"{built.rest_length[0]:.3f} m")
        0 [14500.  14636.6] 22.446 m
    """

    mast: GuyedMast
    structure: Structure
    solution: Solution
    tensions: Float[Array, "n_guy 2"]
    rest_length: Float[Array, " n_guy"]
    status: Int[Array, ""]


@pytree
class MastForces:
    """Movements and forces of a mast, for each case or as envelopes; leading axes are those of it.

    Components "along" and "across" are with the wind and to its left. Those of section forces act
    from the part above on the part below, at the lower end, the middle and the upper end of each
    element; the derivative of `moment` over the height is `shear`.

    Attributes:
        displacement: of the nodes on the axis, along, across and up, [n, 3], m.
        rotation: of these nodes: sway along and across (by how much the axis leans), and twist,
            counterclockwise from above, [n, 3], rad.
        axial: axial force of the mast, tension positive, [n_element, 3], N.
        shear: along and across, [n_element, 3, 2], N.
        moment: bending moment in the plane along the wind and across it, [n_element, 3, 2], N m.
        torsion: [n_element, 3], N m.
        tensions: of guys at anchors and at the mast, [n_guy, 2], N.
        base: force of the mast on its base, along, across and downwards, [3], N.
        base_moment: its moment about the axes across and along (bending as `moment`), and torsion,
            [3], N m; zero at a hinge but for torsion.
        anchors: force of each guy on its anchor: towards the axis of the mast, to the left of that,
            and upwards, [n_guy, 3], N.

    Example:
        >>> part = jc.masts.tube_section(20.0, "CHS 168.3x6.3")
        >>> guys = [jc.masts.guy_level(19.0, 12.0, [0, 120, 240], "Galfan spiral strand 12")]
        >>> calm = jc.masts.forces_of(jc.masts.erect(jc.masts.GuyedMast([part], guys)))
        >>> print(f"base {calm.base[2]:.0f} N, anchor", calm.anchors[0].round(0) + 0)
        base 43084 N, anchor [ 7698.     0. 12288.]
    """

    displacement: Float[Array, "*case n 3"]
    rotation: Float[Array, "*case n 3"]
    axial: Float[Array, "*case n_element 3"]
    shear: Float[Array, "*case n_element 3 2"]
    moment: Float[Array, "*case n_element 3 2"]
    torsion: Float[Array, "*case n_element 3"]
    tensions: Float[Array, "*case n_guy 2"]
    base: Float[Array, "*case 3"]
    base_moment: Float[Array, "*case 3"]
    anchors: Float[Array, "*case n_guy 3"]


@pytree(static=("names", "patches"))
class MastResults:
    """All cases of a mast: the result of `analyse`.

    Attributes:
        names: names of the states.
        directions: towards which the wind blows, [n_direction], degrees from x to y.
        patches: names of the cases of each direction: "mean", then those of the patches.
        forces: `MastForces`, [n_state, n_direction, n_patch, ...]; NaN where a case has failed.
        status: integer codes, [n_state, n_direction, n_patch].
        stable: whether each state is stable, likewise.

    Example:
        >>> part = jc.masts.tube_section(20.0, "CHS 168.3x6.3")
        >>> guys = [jc.masts.guy_level(19.0, 12.0, [0, 120, 240], "Galfan spiral strand 12")]
        >>> built = jc.masts.erect(jc.masts.GuyedMast([part], guys))
        >>> wind = {"wind": jc.masts.eurocode_state(22.0)}
        >>> found = jc.masts.analyse(built, wind, directions=[0.0, 180.0])
        >>> print(found.status.max(), found.patches, found.forces.tensions.shape)
        0 ('mean', 'span 1', 'span 2', 'to mid-span 1', 'about guys 1') (1, 2, 5, 3, 2)
    """

    names: tuple[str, ...]
    directions: Float[Array, " n_direction"]
    patches: tuple[str, ...]
    forces: MastForces
    status: Int[Array, "n_state n_direction n_patch"]
    stable: Bool[Array, "n_state n_direction n_patch"]


def erect(mast: GuyedMast) -> ErectedMast:
    """Erect a mast in calm air, with the tensions of its guys at their anchors as stated.

    The unstressed lengths of all guys are found together, with the mast as it stands then.

    Args:
        mast: `GuyedMast`.

    Returns:
        `ErectedMast`; NaN where there is none with these tensions.

    Raises:
        ValueError: as of `solve`.

    Example:
        >>> part = jc.masts.tube_section(20.0, "CHS 168.3x6.3")
        >>> guys = [jc.masts.guy_level(19.0, 12.0, [0, 120, 240], "Galfan spiral strand 12")]
        >>> built = jc.masts.erect(jc.masts.GuyedMast([part], guys))
        >>> print(built.status, f"the mast is {-1e3 * built.solution.displacement[7, 2]:.2f} mm lower")
        0 the mast is 1.02 mm lower
    """
    structure = mast.structure()
    loads = [SelfWeight(), *ancillary_masses(mast)]
    phase = Phase(end_tension={"guys": mast.of_guys("tension")}, loads=loads, tension_at="first")
    return _as_erected(mast, structure, solve(structure, phase))


def ancillary_masses(mast: GuyedMast) -> list[PointMasses]:
    """Return the masses of ancillaries, without ice, as loads and for `dynamics.modes`.

    Args:
        mast: `GuyedMast`.

    Example:
        >>> part = jc.masts.tube_section(20.0, "CHS 168.3x6.3")
        >>> guys = [jc.masts.guy_level(19.0, 12.0, [0, 120, 240], "Galfan spiral strand 12")]
        >>> mast = jc.masts.GuyedMast([part], guys, [jc.masts.Ancillary(19.0, weight=980.665)])
        >>> print(jc.masts.ancillary_masses(mast)[0].masses)
        [100.]
    """
    if not mast.ancillaries:
        return []
    xp = checks.numpy_or_jax(mast)
    weights = xp.stack([xp.asarray(one.weight, float) for one in mast.ancillaries])
    return [PointMasses(mast.ancillary_nodes(), weights / STANDARD_GRAVITY)]


def _as_erected(mast, structure, solution):
    """Return the `ErectedMast` of a solution in calm air."""
    ends = end_tensions(structure, solution)["guys"]
    rest = solution.rest_length["guys"]
    return ErectedMast(mast, structure, solution, ends, rest, solution.status)


def analyse(
    built: ErectedMast,
    states: Mapping[str, MastState],
    directions: int | Sequence[float] | Float[ArrayLike, " n"] = _DIRECTIONS,
) -> MastResults:
    """Analyse a mast in all states, under wind in all directions, on the whole mast and on patches.

    States of one kind are one batch. Everything is differentiable by the numbers of mast and
    states. The mast of each case has the guys' lengths of `built`.

    Args:
        built: `ErectedMast`, of `erect`.
        states: `MastState` by name.
        directions: number of directions, from x on, or the angles towards which the wind blows,
            degrees from x to y.

    Returns:
        `MastResults`; for its envelope see `extremes`.

    Raises:
        ValueError: no states, no directions; as of `solve`.

    Example:
        >>> part = jc.masts.tube_section(20.0, "CHS 168.3x6.3")
        >>> guys = [jc.masts.guy_level(19.0, 12.0, [0, 120, 240], "Galfan spiral strand 12")]
        >>> built = jc.masts.erect(jc.masts.GuyedMast([part], guys))
        >>> found = jc.masts.analyse(built, {"ice": jc.masts.tia_state(18.0, ice=0.01)}, 4)
        >>> print(found.status.max(), f"{found.forces.tensions.max() / 1e3:.1f} kN")
        0 17.9 kN
    """
    if not states:
        raise ValueError("states: give at least one, by name")
    if isinstance(directions, int | np.integer) and not isinstance(directions, bool):
        checks.require_whole_number(directions, "directions")
        directions = np.arange(directions) * 360.0 / directions
    angles = checks.as_floats(directions, "directions")
    if angles.ndim != 1 or not len(angles):
        raise ValueError(f"directions: expected a number of them, or angles, got {directions!r}")
    mast = built.mast
    patterns, shares = _patterns(mast)
    found: dict = {}
    for tree in dict.fromkeys(jax.tree.structure(state) for state in states.values()):
        own = {k: s for k, s in states.items() if jax.tree.structure(s) == tree}
        with_gusts = next(iter(own.values())).gust is not None
        n_patch = len(patterns) if with_gusts else 1
        shape = len(own), len(angles), n_patch
        k, d, p = (x.ravel() for x in np.indices(shape))
        xp = checks.numpy_or_jax(list(own.values()), angles, shares)
        stacked = jax.tree.map(lambda *x: xp.stack([xp.asarray(y, float) for y in x]), *own.values())
        case = jax.tree.map(lambda x, k=k: x[k], stacked), angles[d], patterns[p], shares[p]
        # all cases in front of the same numbers: then no number is a constant of the program
        start = mast, built.solution.last
        start = jax.tree.map(lambda x, n=len(k): jnp.broadcast_to(x, (n, *jnp.shape(x))), start)
        every = batched(_analyse_case)(*start, *case)
        every = jax.tree.map(lambda x, s=shape: x.reshape((*s, *x.shape[1:])), every)
        if not with_gusts:  # every patch is the mean
            every = jax.tree.map(lambda x: jnp.repeat(x, len(patterns), axis=2), every)
        found |= {name: jax.tree.map(lambda x, j=j: x[j], every) for j, name in enumerate(own)}
    forces, status, stable = jax.tree.map(lambda *x: jnp.stack(x), *(found[n] for n in states))
    names = "mean", *(patch.name for patch in mast.layout.patches)
    return MastResults(tuple(states), angles, names, forces, status, stable)


def _patterns(mast):
    """Return which elements are in each patch, [1 + n_patch, n_element], and shares of guys.

    The first row is that of the mean wind, without a patch.
    """
    patches, count = mast.layout.patches, len(mast.layout.sections)
    patterns = np.zeros((1 + len(patches), count))
    for k, patch in enumerate(patches):
        patterns[1 + k, slice(*patch.elements)] = 1.0
    every = [mast.guy_share(patch) for patch in patches]
    xp = checks.numpy_or_jax(every)
    return patterns, xp.stack([xp.zeros_like(every[0]), *every])


def _analyse_case(mast, start, state, direction, pattern, shares):
    """Return `MastForces`, status and stability of one case, under wind to a direction, degrees."""
    structure = mast.structure()
    phase = Phase(loads=state.loads(mast, direction, pattern, shares), temperature=state.temperature)
    solution = solve(structure, phase, start=start)
    forces = _forces(mast, structure, solution, direction)
    return forces, solution.status, solution.stable


def forces_of(built: ErectedMast, direction: Float[ArrayLike, ""] = 0.0) -> MastForces:
    """Return the forces of a mast in calm air, with the axis "along" in a direction, degrees.

    Args:
        built: `ErectedMast`.
        direction: from x to y, degrees.

    Returns:
        `MastForces` without leading axes.

    Example:
        >>> part = jc.masts.tube_section(20.0, "CHS 168.3x6.3")
        >>> guys = [jc.masts.guy_level(19.0, 12.0, [0, 120, 240], "Galfan spiral strand 12")]
        >>> calm = jc.masts.forces_of(jc.masts.erect(jc.masts.GuyedMast([part], guys)))
        >>> print(f"{calm.axial[0, 0]:.0f} N")
        -43084 N
    """
    return _forces(built.mast, built.structure, built.solution, direction)


@as_program
def _arranged_forces(nodes, values, direction):
    """Return the fields of `MastForces` from results in axes x, y, z; a program.

    `values` are displacement, rotation vectors, section forces, reaction and moment at the base,
    reactions of anchors, and the initial nodes of these.
    """
    displacement, rotation, sections, base, base_moment, reactions, anchors = values
    angle = jnp.radians(direction)
    c, s = jnp.cos(angle), jnp.sin(angle)

    def turned(x, y):
        """Return the components along and across of a vector, on a last axis."""
        return jnp.stack([c * x + s * y, c * y - s * x], axis=-1)

    def with_last(pair, last):
        return jnp.concatenate([pair, last[..., None]], axis=-1)

    # local axes of an upright beam: x upwards, y against the global y, z along the global x
    N, Vy, Vz, T, My, Mz = jnp.moveaxis(sections, -1, 0)
    inward = -anchors[:, :2] / jnp.sqrt(jnp.sum(anchors[:, :2] ** 2, axis=1, keepdims=True))
    pull = -reactions
    towards = jnp.sum(pull[:, :2] * inward, axis=1)
    left = pull[:, 1] * inward[:, 0] - pull[:, 0] * inward[:, 1]
    return {
        "displacement": with_last(turned(*displacement[:, :2].T), displacement[:, 2]),
        "rotation": with_last(turned(rotation[:, 1], -rotation[:, 0]), rotation[:, 2]),
        "axial": N,
        "shear": turned(Vz, -Vy),
        "moment": turned(My, Mz),
        "torsion": T,
        "base": with_last(turned(-base[0], -base[1]), base[2]),
        "base_moment": with_last(turned(-base_moment[1], base_moment[0]), -base_moment[2]),
        "anchors": jnp.stack([towards, left, pull[:, 2]], axis=1),
    }


def _forces(mast, structure, solution, direction):
    """Return the `MastForces` of a solution, along and across a direction, degrees."""
    count, ends = len(mast.layout.nodes), structure.elements["guys"].links.array[:, 0]
    groups = [solution.section_forces[f"section {k + 1:02d}"] for k in range(len(mast.sections))]
    xp = checks.numpy_or_jax(groups)
    values = (
        solution.displacement[:count],
        rotation_vectors(structure, solution)[:count],
        xp.concatenate(groups),
        solution.reactions[0],
        solution.reaction_moments[0],
        solution.reactions[ends],
        structure.nodes[ends],
    )
    fields = _arranged_forces(structure.nodes, values, direction)
    return MastForces(**fields, tensions=end_tensions(structure, solution)["guys"])


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
        [14.04 18.32 18.32] kN
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
        [[[0]]] [ 0.   14.54  3.84 14.54] kN
    """
    mast, structure, start = built.mast, built.structure, built.solution
    if not 0 <= guy < len(built.rest_length):
        raise ValueError(f"guy = {guy}: there are guys 0 to {len(built.rest_length) - 1}")
    name = f"rupture of guy {mast.guy_names[guy]}"
    if state is not None:
        none = _patterns(mast)
        loads = state.loads(mast, direction, none[0][0], none[1][0])
        start = solve(structure, Phase(loads=loads, temperature=state.temperature), start=start)
    loss = loss_of_cable(structure, start, {"guys": [guy]}, dynamic_factor=dynamic_factor)
    phase = Phase(loads=loss.loads, removes=loss.removes, increments=_BREAKING_INCREMENTS)
    solution = solve(structure, phase, start=start)
    one = _forces(mast, structure, solution, direction), solution.status, solution.stable
    angles = np.atleast_1d(np.asarray(direction, float))
    return MastResults(
        (name,), angles, ("mean",), *jax.tree.map(lambda x: jnp.asarray(x)[None, None, None], one)
    )
