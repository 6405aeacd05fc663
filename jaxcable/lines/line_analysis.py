"""States of a section: equilibrium of all spans and strings, with the law of the conductor.

A catenary is elastic. In each span it has the tangent of the conductor's law at the mean tension
along the span, which is iterated until both agree; so the elongation is that of the law, to second
order in the difference of the tensions along the span.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
from jax import lax

from ..analysis.batches import batched
from ..analysis.phases import Phase
from ..analysis.solver import solve
from ..common import checks, status
from ..common.selection import only
from ..common.tree import copy_with, pytree
from ..common.types import Array, ArrayLike, Float, Int
from ..forms import catenary_curves
from ..programs.joining import stack_trees
from ..programs.program_calls import as_program
from ..results import clearance_over_ground, distance_to_line, horizontal_tensions, sags
from .conductor_law import ConductorLaw, mean_tension
from .line_section import LineSection, unit
from .line_states import STRING_DRAG, LineState

_ROUNDS = 40  # of the law of the conductor; Newton's method needs three to six
_USUAL_ROUNDS = 8  # after which the iteration is taken for one that cycles about a corner
_AHEAD = 1e-5  # strain, by which slopes lie ahead then: on the branch of first loading
_AGREED = 1e-10  # difference of tension and law, over the tension
_POINTS = 41  # of a curve in pictures and drawings
_BREAKING_INCREMENTS = 2
_USUAL = 0.2  # tension over strength with which the iteration begins
_FEW, _MANY = 8, 64  # states, traced ones and known ones, up to which they are no batch


@pytree(static=("names",))
class LineResults:
    """States of a section: the result of `analyse`; arrays have the axis [n_state] in front.

    Attributes:
        names: names of the states.
        status: of each state, integer codes.
        positions: of all nodes (`LineSection.layout`), [n_node, 3], m.
        tensions: at both ends of each span, [n_span, 2], N.
        mean_tension: mean along the unstressed length, [n_span], N.
        horizontal: horizontal tension of each span, [n_span], N.
        sag: vertical, at midspan, [n_span], m.
        deflection: largest distance from the chord, under wind that of the whole load, [n_span], m.
        lowest: lowest point of each span, [n_span, 3], m.
        strain: of the conductor, from its length without stress, [n_span].
        permanent: permanent strains that the state leaves in the layers, [n_span, n_layer].
        rest_length, stiffness: of tangent catenaries, unstressed length, m, and EA, N, [n_span].
        span_load: whole load along each span, [n_span, 3], N.
        attachment_forces: of the line on its towers, [n_attachment, 3], N: along the bisector of
            the tower, across it to the left, and downwards; negative downwards is uplift.
        swing: of strings from the plumb line, [n_attachment, 2], degrees: across the line to the
            left, and along it; NaN without a hanging string.
        clearance: least height of each span above the ground, [n_span], m; inf beside no ground.
        clearance_at: where it is, [n_span, 3], m.
        crossings: least distances of each span from the lines that are crossed, by name, [n_span].
        curves: points along each span, for pictures, [n_span, n, 3], m.
        utilization: largest tension over rated strength, [n_span].

    Example:
        >>> drake = jc.catalogue.conductor("Drake")
        >>> section = jc.lines.LineSection(drake, [0.0, 300.0], [0.0, 0.0], [20.0, 20.0], "post")
        >>> strung = jc.lines.string(section, parameter=1500.0, temperature=15.0)
        >>> found = jc.lines.analyse(section, strung, {"hot": jc.lines.LineState(75.0)})
        >>> print(found.status, f"{found.sag[0, 0]:.2f} m, {found.clearance[0, 0]:.2f} m")
        [0] 9.26 m, 10.74 m
    """

    names: tuple[str, ...]
    status: Int[Array, " n_state"]
    positions: Float[Array, "n_state n_node 3"]
    tensions: Float[Array, "n_state n_span 2"]
    mean_tension: Float[Array, "n_state n_span"]
    horizontal: Float[Array, "n_state n_span"]
    sag: Float[Array, "n_state n_span"]
    deflection: Float[Array, "n_state n_span"]
    lowest: Float[Array, "n_state n_span 3"]
    strain: Float[Array, "n_state n_span"]
    permanent: Float[Array, "n_state n_span n_layer"]
    rest_length: Float[Array, "n_state n_span"]
    stiffness: Float[Array, "n_state n_span"]
    span_load: Float[Array, "n_state n_span 3"]
    attachment_forces: Float[Array, "n_state n_attachment 3"]
    swing: Float[Array, "n_state n_attachment 2"]
    clearance: Float[Array, "n_state n_span"]
    clearance_at: Float[Array, "n_state n_span 3"]
    crossings: dict[str, Float[Array, "n_state n_span"]]
    curves: Float[Array, "n_state n_span n 3"]
    utilization: Float[Array, "n_state n_span"]


def analyse(
    section: LineSection,
    strung: Any,
    states: Mapping[str, LineState],
    *,
    permanent: Float[Array, "n_span n_layer"] | None = None,
    stretched: bool = False,
) -> LineResults:
    """Analyse the states of a section that has been strung.

    States of one kind are one batch. Everything is differentiable by the numbers of section, states
    and stringing: clearances by heights and attachments, tensions by temperature.

    Args:
        section: `LineSection`.
        strung: `Stringing`, of `string`: lengths of the conductor in the spans.
        states: `LineState` by name.

    Options:
        permanent: permanent strains of the layers in each span, [n_span, n_layer], of `stretch`,
            for states whose condition is "final"; None: those of no load.
        stretched: whether weight, ice and wind count per length of the stretched conductor, as in
            published tables; derivatives neglect the change of this length. Otherwise the mass
            stays when the conductor stretches, which is up to 0.3 % less, ice counts per
            unstressed length, and the wind per length of the chord.

    Returns:
        `LineResults`; NaN where a state has failed.

    Raises:
        ValueError: no states, a thickness of ice for another number of spans, a final state without
            `permanent`, a broken span that there is not.

    Example:
        Ice of 20 mm more than doubles the tension of Drake.

        >>> drake = jc.catalogue.conductor("Drake")
        >>> section = jc.lines.LineSection(drake, [0.0, 300.0], [0.0, 0.0], [20.0, 20.0], "post")
        >>> strung = jc.lines.string(section, parameter=1500.0, temperature=15.0)
        >>> states = {"calm": jc.lines.LineState(-5.0), "ice": jc.lines.LineState(-5.0, ice=0.02)}
        >>> found = jc.lines.analyse(section, strung, states)
        >>> print(found.status, (found.horizontal[:, 0] / 1e3).round(2), "kN")
        [0 0] [26.1  52.05] kN
    """
    count = len(section.layout.spans)
    if not states:
        raise ValueError("states: give at least one, by name")
    for name, state in states.items():
        if state.ice.ndim and len(state.ice) != count:
            raise ValueError(f"states[{name!r}].ice: {len(state.ice)} values, {count} spans")
        if state.condition == "final" and permanent is None:
            raise ValueError(f"states[{name!r}]: is final; give permanent=stretch(...)")
        if state.broken is not None and not 0 <= state.broken < count:
            raise ValueError(f"states[{name!r}].broken = {state.broken}: there are {count} spans")
    found: dict[str, LineResults] = {}
    for broken in dict.fromkeys(state.broken for state in states.values()):
        own = [name for name, state in states.items() if state.broken == broken]
        cases = [_case_of(section, states[name], permanent, stretched) for name in own]
        found |= zip(own, _analyse_each(section, strung.length, cases), strict=True)
    every = jax.tree.map(jnp.asarray, stack_trees([found[name] for name in states]))
    return copy_with(every, names=tuple(states))


@pytree(static=("stretched",))
class _Case:
    """A state, permanent strains before it, whether the conductor creeps (1), and `stretched`."""

    state: LineState
    permanent: Float[Array, "n_span n_layer"] | None
    creeps: Float[ArrayLike, ""]
    stretched: bool


def _case_of(section, state, permanent, stretched):
    """Return the `_Case` of a state with ice of each span, in floats, of NumPy where known."""
    shape, kind = (len(section.layout.spans),), jnp.result_type(float)
    ice = checks.numpy_or_jax(state.ice).broadcast_to(state.ice, shape)
    plain = copy_with(state, condition="initial", ice=ice)
    before = permanent if state.condition == "final" else section.never_loaded
    case = _Case(plain, before, float(state.condition == "creep"), stretched)
    return jax.tree.map(lambda x: checks.numpy_or_jax(x).asarray(x, dtype=kind), case)


def _analyse_each(section, length, cases):
    """Return the `LineResults` of cases with one broken span, or none, a list.

    Few ones are run one after another, which is traced sooner than a batch.
    """
    known = [checks.array_if_known(x) for x in jax.tree.leaves((section, length, cases))]
    if len(cases) <= (_FEW if any(x is None for x in known) else _MANY):
        return [_analyse_case(section, length, case) for case in cases]
    count = len(cases)
    same = jax.tree.map(lambda x: jnp.broadcast_to(x, (count, *jnp.shape(x))), (section, length))
    found = batched(lambda data, case: _analyse_case(*data, case))(same, stack_trees(cases))
    return [jax.tree.map(lambda x, k=k: x[k], found) for k in range(count)]


def stretch(
    section: LineSection,
    strung: Any,
    loads: Mapping[str, LineState],
    creep: LineState | None = None,
    *,
    stretched: bool = False,
) -> Float[Array, "n_span n_layer"]:
    """Return the permanent strains of the layers after the heaviest loads and ten years of creep.

    Args:
        section: `LineSection`.
        strung: `Stringing`, of `string`.
        loads: states that stretch the conductor, by name; on its curves of first loading.
        creep: state at whose temperature and loads the conductor creeps; None: none.

    Options:
        stretched: as of `analyse`.

    Returns:
        Permanent strains, [n_span, n_layer]: of each layer the largest. `analyse` takes them as
        `permanent`.

    Raises:
        ValueError: as of `analyse`.

    Example:
        >>> drake = jc.catalogue.conductor("Drake")
        >>> section = jc.lines.LineSection(drake, [0.0, 300.0], [0.0, 0.0], [20.0, 20.0], "post")
        >>> strung = jc.lines.string(section, parameter=1500.0, temperature=15.0)
        >>> heavy = {"heavy": jc.lines.LineState(-18.0, ice=0.0127, wind=190.0)}
        >>> left = jc.lines.stretch(section, strung, heavy, jc.lines.LineState(15.0))
        >>> print(left.shape, f"aluminum {1e3 * left[0, 0]:.2f} mm/m")
        (1, 2) aluminum 1.05 mm/m
    """
    states = {name: copy_with(state, condition="initial") for name, state in loads.items()}
    if creep is not None:
        states["creep"] = copy_with(creep, condition="creep")
    return jnp.max(analyse(section, strung, states, stretched=stretched).permanent, axis=0)


@as_program
def _analyse_case(section, length, case):
    """Return the `LineResults` of a `_Case`; `length` without stress in each span, [n_span], m."""

    def solve_with(data, strain, rounds):
        section, length, case = data
        # at a corner of the law each branch has its equilibrium on the other one: choose one branch
        ahead = jnp.where(rounds < _USUAL_ROUNDS, 0.0, _AHEAD)
        free, stiffness = _law_of(section, case).tangent(strain, ahead)
        rest, scale, wind_scale = length * (1 + free), 1.0, 1.0
        weight = section.conductor.weight / (1 + free)
        if case.stretched:  # loads per length of the stretched conductor
            whole = length * (1 + lax.stop_gradient(strain))
            scale, wind_scale = whole / rest, whole / section.chord_lengths()
            weight = section.conductor.weight * scale
        of_catenary = stiffness * (1 + free)
        structure = section.structure(of_catenary, weight)
        loads = case.state.loads(section, scale, wind_scale)
        phases = [Phase(rest_length={"conductor": rest}, loads=loads)]
        if broken is not None:
            gone = {"conductor": only([broken])}
            phases.append(Phase(removes=gone, increments=_BREAKING_INCREMENTS))
        solution = solve(structure, phases)
        tension = mean_tension(solution.element_results["end_pull"]["conductor"])
        return structure, solution, free + tension / stiffness, tension, of_catenary

    def agree(carry):
        strain, _, rounds = carry
        _, _, new, tension, _ = solve_with(fixed, strain, rounds)
        error = jnp.abs(law.tension(new) - tension) / jnp.maximum(jnp.abs(tension), 1.0)
        if broken is not None:
            there = np.arange(len(new)) != broken
            new, error = jnp.where(there, new, strain), jnp.where(there, error, 0.0)
        return new, jnp.max(error), rounds + 1

    def goes_on(carry):
        return (carry[1] > _AGREED) & (carry[2] < _ROUNDS)

    data, broken = (section, length, case), case.state.broken
    fixed = lax.stop_gradient(data)
    law = _law_of(fixed[0], fixed[2])
    begun = law.strain(_USUAL * fixed[0].conductor.strength), jnp.ones(()), jnp.zeros((), int)
    strain, error, rounds = lax.while_loop(goes_on, agree, begun)
    structure, solution, strain, _, stiffness = solve_with(data, strain, rounds - 1)
    agreed = error < 1e-8
    code = jnp.where(agreed, solution.status, status.NOT_CONVERGED)
    found = _results_of(section, case, structure, solution, strain, stiffness)
    factor = jnp.where(agreed, 1.0, jnp.nan)
    return copy_with(jax.tree.map(lambda x: x * factor, found), status=code)


def _law_of(section, case):
    """Return the `ConductorLaw` of a section in a `_Case`."""
    return ConductorLaw(section.conductor, case.state.temperature, case.permanent, case.creeps > 0)


def _results_of(section, case, structure, solution, strain, stiffness):
    """Return the `LineResults` of one solved state; its status is that of the solution."""
    pulls = solution.element_results["end_pull"]["conductor"]
    sag = sags(structure, solution)["conductor"]
    ends = jnp.sqrt(jnp.sum(pulls**2, axis=-1))
    clear = clearance_over_ground(structure, solution, section.ground_points(), on="conductor")
    near = {
        name: distance_to_line(structure, solution, points, on="conductor").distance["conductor"]
        for name, points in section.crossing_points().items()
    }
    forces, swing = _attachments(section, case.state, solution, pulls)
    return LineResults(
        names=(),
        status=solution.status,
        positions=solution.positions,
        tensions=ends,
        mean_tension=mean_tension(pulls),
        horizontal=horizontal_tensions(structure, solution)["conductor"],
        sag=sag.midspan,
        deflection=sag.deflection,
        lowest=sag.lowest,
        strain=strain,
        permanent=_law_of(section, case).permanent_after(strain),
        rest_length=solution.rest_length["conductor"],
        stiffness=stiffness,
        span_load=jnp.sum(pulls, axis=1),
        attachment_forces=forces,
        swing=swing,
        clearance=clear.distance["conductor"],
        clearance_at=clear.places["conductor"],
        crossings=near,
        curves=catenary_curves(structure, solution, _POINTS)["conductor"],
        utilization=jnp.max(ends, axis=1) / section.conductor.strength,
    )


def _attachments(section, state, solution, pulls):
    """Return forces on towers, [n_attachment, 3], N, and swings of strings, [n_attachment, 2].

    `pulls` are the forces of spans on the nodes at their ends, [n_span, 2, 3], N. A tower carries
    what acts on the clamp, and the weight and the wind of the string.
    """
    own, every = section.layout, section.layout.attachments
    tower, count = np.array([one.tower for one in every]), len(own.spans)
    begins = [k for k, one in enumerate(every) if one.side != "back"][:count]
    ends = [k for k, one in enumerate(every) if one.side != "ahead"][-count:]
    pulls = jnp.where(jnp.isnan(pulls), 0.0, pulls)  # of a broken span
    force = jnp.zeros((len(every), 3)).at[np.array(begins)].add(pulls[:, 0])
    force = force.at[np.array(ends)].add(pulls[:, 1])
    along = jnp.pad(section.bisectors()[tower], ((0, 0), (0, 1)))
    left = jnp.stack([-along[:, 1], along[:, 0], jnp.zeros(len(every))], axis=1)
    swing = jnp.full((len(every), 2), jnp.nan)
    if own.strings:
        hung = np.array([k for k, one in enumerate(every) if one.string is not None])
        first, last = np.array(own.strings).T
        at, drawn = tower[hung], section.nodes()
        weight = jnp.asarray(section.string_weight)[at, None] * jnp.asarray([[0.0, 0.0, 1.0]])
        wind = _string_wind(section, state, unit(drawn[last] - drawn[first]), at)
        force = force.at[hung].add(wind - weight)
        drop = solution.positions[last] - solution.positions[first]
        both = jnp.stack([jnp.sum(drop * left[hung], 1), jnp.sum(drop * along[hung], 1)], axis=1)
        angles = jnp.degrees(jnp.arctan2(both, -drop[:, 2:]))
        plumb = np.array([section.kinds[k] == "suspension" for k in at])
        swing = swing.at[hung].set(jnp.where(plumb[:, None], angles, jnp.nan))
    parts = jnp.sum(force * along, 1), jnp.sum(force * left, 1), -force[:, 2]
    return jnp.stack(parts, axis=1), swing


def _string_wind(section, state, axis, at):
    """Return the force of the wind on strings along unit vectors at towers, [n_string, 3], N."""
    blows = state.blows[None]
    across = blows - jnp.sum(blows * axis, axis=1, keepdims=True) * axis
    size = jnp.sqrt(jnp.sum(across**2, axis=1, keepdims=True))
    return STRING_DRAG * state.wind * jnp.asarray(section.string_area)[at, None] * size * across
