"""Analysis of a mast: erected with its guys as built, then all directions, states and patches."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np

from ..analysis.batches import batched
from ..analysis.phases import Phase
from ..analysis.solution import Solution
from ..analysis.solver import solve
from ..common import checks
from ..common.status import OK
from ..common.tree import pytree
from ..common.types import Array, ArrayLike, Bool, Float, Int
from ..forms import end_tensions
from ..loads import PointMasses, SelfWeight
from ..loads.masses import STANDARD_GRAVITY
from ..model.structure import Structure
from ..programs.program_calls import as_program
from ..results import rotation_vectors
from .guyed_mast import GuyedMast
from .mast_states import MastState

_DIRECTIONS = 12
_FEW = 8  # cases up to which they are no batch


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
        0 [15000.  15138.5] 22.447 m
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
        base 43404 N, anchor [ 8047.     0. 12659.]
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
        >>> print(built.status, f"{1e3 * built.solution.displacement[9, 2]:.2f} mm at the top")
        0 -1.16 mm at the top
    """
    structure = mast.structure()
    loads = [SelfWeight(), *ancillary_masses(mast)]
    phase = Phase(end_tension={"guys": mast.of_guys("tension")}, loads=loads, tension_at="first")
    solution = solve(structure, phase)
    ends, rest = end_tensions(structure, solution)["guys"], solution.rest_length["guys"]
    return ErectedMast(mast, structure, solution, ends, rest, solution.status)


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
        0 15.9 kN
    """
    if not states:
        raise ValueError("states: give at least one, by name")
    angles = wind_directions(directions)
    mast = built.mast
    patterns, shares = patterns_and_guy_shares(mast)
    found: dict[str, Any] = {}
    kinds: dict[Any, dict[str, MastState]] = {}
    for name, state in states.items():
        kinds.setdefault(jax.tree.structure(state), {})[name] = state
    for own in kinds.values():
        with_gusts = next(iter(own.values())).gust is not None
        n_patch = len(patterns) if with_gusts else 1
        shape = len(own), len(angles), n_patch
        k, d, p = (x.ravel() for x in np.indices(shape))
        stacked = jax.tree.map(_stack_floats, *own.values())
        case = jax.tree.map(lambda x, k=k: x[k], stacked), angles[d], patterns[p], shares[p]
        every = _analyse_each(mast, built.solution.last, case, len(k))
        every = jax.tree.map(lambda x, s=shape: x.reshape((*s, *x.shape[1:])), every)
        if not with_gusts:  # every patch is the mean
            every = jax.tree.map(lambda x: jnp.repeat(x, len(patterns), axis=2), every)
        found |= {name: jax.tree.map(lambda x, j=j: x[j], every) for j, name in enumerate(own)}
    forces, status, stable = jax.tree.map(lambda *x: jnp.stack(x), *(found[n] for n in states))
    # an erection that has failed has a last converged state, from which no case may start
    erected = jnp.asarray(built.status) == OK
    forces = jax.tree.map(lambda x: jnp.where(erected, x, jnp.nan), forces)
    status, stable = jnp.where(erected, status, built.status), stable & erected
    names = "mean", *(patch.name for patch in mast.layout.patches)
    return MastResults(tuple(states), angles, names, forces, status, stable)


def wind_directions(directions):
    """Return the angles of a number of directions, or those given, [n], degrees."""
    if isinstance(directions, int | np.integer) and not isinstance(directions, bool):
        checks.require_whole_number(directions, "directions")
        directions = np.arange(directions) * 360.0 / directions
    angles = checks.as_floats(directions, "directions")
    if angles.ndim != 1 or not len(angles):
        raise ValueError(f"directions: expected a number of them, or angles, got {directions!r}")
    return angles


def _stack_floats(*values):
    """Return numbers as one array of floats, of NumPy where all are known."""
    xp = checks.numpy_or_jax(values)
    return xp.stack([xp.asarray(x, float) for x in values])


def _analyse_each(mast, start, cases, count):
    """Return what `_analyse_case` does of `count` cases; few ones one by one, traced sooner."""
    if count > _FEW:
        # all cases in front of the same numbers: then no number is a constant of the program
        same = jax.tree.map(lambda x: jnp.broadcast_to(x, (count, *jnp.shape(x))), (mast, start))
        return batched(_analyse_case)(*same, *cases)
    each = [
        _analyse_one(mast, start, *jax.tree.map(lambda x, k=k: x[k], cases)) for k in range(count)
    ]
    return jax.tree.map(lambda *x: jnp.stack(x), *each)


def patterns_and_guy_shares(mast):
    """Return which elements, and which shares of the guys, are in the patch of each wind pattern.

    A pattern is the mean wind, in the first row, and then one patch of gusts in each row.

    Returns:
        1 for elements of the mast in the patch, else 0, [1 + n_patch, n_element]; shares of the
        guys in it, from 0 to 1, [1 + n_patch, n_guy]. The first rows are zero.
    """
    patches, count = mast.layout.patches, len(mast.layout.sections)
    patterns = np.zeros((1 + len(patches), count))
    for k, patch in enumerate(patches):
        patterns[1 + k, slice(*patch.elements)] = 1.0
    every = [mast.guy_share(patch) for patch in patches]
    xp = checks.numpy_or_jax(every)
    return patterns, xp.stack([xp.zeros_like(every[0]), *every])


@as_program
def _analyse_one(mast, start, state, direction, pattern, shares):
    """Return what `_analyse_case` does; a program."""
    return _analyse_case(mast, start, state, direction, pattern, shares)


def _analyse_case(mast, start, state, direction, pattern, shares):
    """Return `MastForces`, status and stability of one case, under wind to a direction, degrees."""
    structure = mast.structure()
    phase = Phase(
        loads=state.loads(mast, direction, pattern, shares), temperature=state.temperature
    )
    solution = solve(structure, phase, start=start)
    forces = forces_of_solution(mast, structure, solution, direction)
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
        -43404 N
    """
    return forces_of_solution(built.mast, built.structure, built.solution, direction)


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
        "base_moment": with_last(turned(base_moment[1], -base_moment[0]), -base_moment[2]),
        "anchors": jnp.stack([towards, left, pull[:, 2]], axis=1),
    }


def forces_of_solution(mast, structure, solution, direction):
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
