"""Stringing a section: lengths of the conductor, pulleys, offsets at which it is clamped."""

from __future__ import annotations

import functools

import jax
import jax.numpy as jnp
import numpy as np
from jax import lax

from ..analysis.phases import Phase
from ..analysis.solver import solve
from ..common import checks
from ..common.rules import positive, refuse_if_broken
from ..common.tree import copy_with, pytree
from ..common.types import Array, ArrayLike, Float, Int
from ..elements import SlidingCatenaries
from ..loads import SelfWeight
from ..model.structure import Structure
from ..model.supports import pinned
from ..programs.joining import stack_trees
from ..programs.program_calls import as_program
from ..results import horizontal_tensions, sags
from .conductor_law import ConductorLaw, mean_tension
from .line_analysis import LineResults, analyse
from .line_section import LineSection
from .line_states import LineState

_SAG_ROUNDS = 8  # of the tension that gives a sag; Newton's method needs two or three
_AGREED = 1e-6  # relative step of this tension after which one more is exact
_ROUNDS = 2  # tangents of the law; the difference of mean and horizontal tension is small


@pytree
class Stringing:
    """A section as strung: the result of `string`.

    Attributes:
        length: of the conductor in each span, without stress at the temperature of its curves,
            [n_span], m.
        horizontal: horizontal tension of each span as strung, [n_span], N.
        temperature: of the conductor when it was strung, degrees C.
        status: status code.
        clamps: where strings hang as strung, positions of all nodes, [n_node, 3], m.

    Example:
        >>> drake = jc.catalogue.conductor("Drake")
        >>> section = jc.lines.LineSection(drake, [0.0, 300.0], [0.0, 0.0], [20.0, 20.0], "post")
        >>> strung = jc.lines.string(section, parameter=1500.0, temperature=15.0)
        >>> print(strung.status, f"{strung.length[0]:.3f} m, {strung.horizontal[0] / 1e3:.2f} kN")
        0 300.208 m, 23.95 kN
    """

    length: Float[Array, " n_span"]
    horizontal: Float[Array, " n_span"]
    temperature: Float[ArrayLike, ""]
    status: Int[Array, ""]
    clamps: Float[Array, "n_node 3"]


def string(
    section: LineSection,
    *,
    parameter: Float[ArrayLike, ""] | None = None,
    horizontal_tension: Float[ArrayLike, ""] | None = None,
    sag: Float[ArrayLike, ""] | None = None,
    span: int = 0,
    temperature: Float[ArrayLike, ""] = 15.0,
    stretched: bool = False,
) -> Stringing:
    """String a section so that its strings hang plumb along the line, with one horizontal tension.

    The new conductor, without ice and wind, has the stated horizontal tension in every span. (So it
    is clamped at its offsets, see `pulleys`; at towers where the line turns, strings swing.)

    Args:
        section: `LineSection`.

    Options:
        parameter: catenary parameter, horizontal tension over weight, m.
        horizontal_tension: N.
        sag: vertical at midspan of the span `span`, m, with strings as they swing at towers where
            the line turns. One of the three is given.
        span: index of the span that has the `sag`.
        temperature: of the conductor, degrees C.
        stretched: as of `analyse`.

    Returns:
        `Stringing`, differentiable by all numbers.

    Raises:
        ValueError: none or several of the three, or one that is not positive; no such span.

    Example:
        >>> drake = jc.catalogue.conductor("Drake")
        >>> section = jc.lines.LineSection(drake, [0.0, 300.0], [0.0, 0.0], [20.0, 20.0], "post")
        >>> strung = jc.lines.string(section, sag=8.0, temperature=15.0)
        >>> print(strung.status, f"{strung.horizontal[0]:.0f} N")
        0 22453 N
    """
    stated = {"parameter": parameter, "horizontal_tension": horizontal_tension, "sag": sag}
    given = {name: value for name, value in stated.items() if value is not None}
    if len(given) != 1:
        raise ValueError(f"{', '.join(stated)}: give one of them, got {len(given)}")
    ((name, value),) = given.items()
    value = checks.as_scalar(value, name)
    refuse_if_broken([positive(name, value)])
    if not 0 <= span < len(section.layout.spans):
        raise ValueError(f"span = {span}: there are {len(section.layout.spans)} spans")
    at = checks.as_scalar(temperature, "temperature")
    return _string(section, value, at, name=name, span=span, stretched=stretched)


@functools.partial(as_program, static=("name", "span", "stretched"))
def _string(section, value, temperature, *, name, span, stretched):
    """Return the `Stringing` of a section; `name` says what `value` is, as `string` has it."""
    level, data = jnp.asarray(value), (section, temperature, stretched)
    if name == "parameter":
        level = level * section.conductor.weight
    if name == "sag":
        level = _tension_of_sag(data, level, span)
    structure, hung, free = _hang(*data, level)
    length = hung.rest_length["conductor"] / (1 + free)
    horizontal = horizontal_tensions(structure, hung)["conductor"]
    return Stringing(length, horizontal, temperature, hung.status, hung.positions)


def _hang(section, temperature, stretched, level):
    """Return structure, solution and strains without tension of a section with a tension, N."""
    law = ConductorLaw(section.conductor, temperature, section.never_loaded)
    strain = law.strain(level)
    tensions = {"conductor": jnp.broadcast_to(level, strain.shape)}
    for _ in range(_ROUNDS):
        strain = lax.stop_gradient(strain)
        free, stiffness = law.tangent(strain)
        heavier = 1 + strain if stretched else 1.0
        weight = section.conductor.weight * heavier / (1 + free)
        structure = section.structure(stiffness * (1 + free), weight)
        hung = solve(structure, Phase(horizontal_tension=tensions, loads=SelfWeight()))
        strain = free + mean_tension(hung.element_results["end_pull"]["conductor"]) / stiffness
    return structure, hung, free


def _tension_of_sag(data, sag, span):
    """Return the horizontal tension at which a span of the section has its stated sag, N.

    Newton's method for one over the sag, which is nearly proportional to the tension. Its last step
    is differentiable by all numbers, as the tension is.
    """

    def flatness(level, data):
        structure, hung, _ = _hang(*data, level)
        return 1 / sags(structure, hung)["conductor"].midspan[span]

    def goes_on(carry):
        return (carry[1] > _AGREED) & (carry[2] < _SAG_ROUNDS)

    def agree(carry):
        level, one = carry[0], jnp.ones_like(carry[0])
        value, slope = jax.jvp(lambda x: flatness(x, fixed), (level,), (one,))
        change = (1 / lax.stop_gradient(sag) - value) / slope
        return level + change, jnp.abs(change / level), carry[2] + 1, slope

    fixed = (*lax.stop_gradient(data[:2]), data[2])
    section = fixed[0]
    weight = section.conductor.weight * section.chord_lengths()[span]
    start = weight * section.span_lengths[span] / (8 * lax.stop_gradient(sag))  # a parabola
    begun = start, jnp.ones_like(start), jnp.zeros((), int), jnp.ones_like(start)
    level, _, _, slope = lax.while_loop(goes_on, agree, begun)
    level, slope = lax.stop_gradient((level, slope))
    return level + (1 / sag - flatness(level, data)) / slope


@pytree
class PulleyStates:
    """A section on stringing pulleys: the result of `pulleys`; arrays [n_temperature, ...].

    Attributes:
        status: of each temperature, integer codes.
        sag: vertical at midspan on pulleys, [n_span], m.
        horizontal: horizontal tension of each span on pulleys, [n_span], N.
        tensions: at both ends of each span on pulleys, [n_span, 2], N.
        offsets: by how much the conductor is moved forward over each pulley before it is clamped,
            along the line, [n_span - 1], m; zero at strain towers.
        clamped: `LineResults` of the same temperatures after clamping.

    Example:
        >>> drake = jc.catalogue.conductor("Drake")
        >>> section = jc.lines.LineSection(
        ...     drake, [0.0, 300.0, 500.0], [0.0, 40.0, 10.0], [25.0] * 3,
        ...     ["post", "suspension", "post"], string_length=2.5, string_weight=900.0,
        ... )
        >>> strung = jc.lines.string(section, parameter=1500.0, temperature=15.0)
        >>> found = jc.lines.pulleys(section, strung, [15.0])
        >>> print(found.status, f"{1e3 * found.offsets[0, 0]:.0f} mm")
        [0] 2 mm
    """

    status: Int[Array, " n_temperature"]
    sag: Float[Array, "n_temperature n_span"]
    horizontal: Float[Array, "n_temperature n_span"]
    tensions: Float[Array, "n_temperature n_span 2"]
    offsets: Float[Array, "n_temperature n_inner"]
    clamped: LineResults


def pulleys(
    section: LineSection,
    strung: Stringing,
    temperatures: Float[ArrayLike, " n_temperature"],
    *,
    stretched: bool = False,
) -> PulleyStates:
    """Find sags on stringing pulleys, and offsets at which the conductor is clamped.

    On pulleys the conductor of a tension section is one cable without friction: its tension is the
    same on both sides of a pulley, its horizontal tension is not. Pulleys hang where the clamps
    will be. Clamped at the offsets, the strings hang plumb (offset clipping, Winkelman 1959).

    Args:
        section, strung: as of `analyse`.
        temperatures: of the new conductor, [n_temperature], degrees C.

    Options:
        stretched: as of `analyse`.

    Returns:
        `PulleyStates`.

    Raises:
        ValueError: temperatures that are no list of numbers.

    Example:
        As that of `PulleyStates`, on a level line: on pulleys as clamped.

        >>> drake = jc.catalogue.conductor("Drake")
        >>> section = jc.lines.LineSection(
        ...     drake, [0.0, 300.0, 600.0], [0.0] * 3, [25.0, 27.5, 25.0],
        ...     ["post", "suspension", "post"], string_length=2.5, string_weight=900.0,
        ... )
        >>> strung = jc.lines.string(section, parameter=1500.0, temperature=15.0)
        >>> found = jc.lines.pulleys(section, strung, [15.0])
        >>> print(found.status, bool(jnp.allclose(found.sag, found.clamped.sag, rtol=1e-6)))
        [0] True
    """
    values = checks.as_floats(temperatures, "temperatures")
    if values.ndim != 1 or not len(values):
        raise ValueError(f"temperatures: expected shape [n], n >= 1, got {values.shape}")
    states = {f"{float(t):g} C": LineState(t) for t in values}
    clamped = analyse(section, strung, states, stretched=stretched)
    found = [
        _on_pulleys(section, strung, jax.tree.map(lambda x, k=k: x[k], clamped))
        for k in range(len(values))
    ]
    return copy_with(jax.tree.map(jnp.asarray, stack_trees(found)), clamped=clamped)


@as_program
def _on_pulleys(section, strung, clamped):
    """Return the `PulleyStates` of one clamped state, a `LineResults` without leading axis."""
    own, codes = section.layout, [clamped.status]
    # of a span without a pulley between its ends: as clamped
    sag, level, ends = clamped.sag, clamped.horizontal, clamped.tensions
    offsets = jnp.zeros(len(own.spans) - 1)
    unstressed = clamped.span_load[:, 2] / clamped.rest_length
    for spans in (np.array(x) for x in own.tension_sections if len(x) > 1):
        chain = np.array([own.spans[spans[0]][0], *(own.spans[k][1] for k in spans)])
        cable = SlidingCatenaries(
            links=[list(range(len(chain)))],
            axial_stiffness=jnp.mean(clamped.stiffness[spans])[None],
            weight=-jnp.mean(unstressed[spans])[None],
            rest_length=jnp.sum(clamped.rest_length[spans])[None],
        )
        line = Structure(strung.clamps[chain], {"line": cable}, pinned(range(len(chain))))
        hung = solve(line, Phase(loads=SelfWeight()))
        sag = sag.at[spans].set(sags(line, hung)["line"].midspan[0])
        level = level.at[spans].set(horizontal_tensions(line, hung)["line"][0])
        ends = ends.at[spans].set(hung.element_results["end_tensions"]["line"][0])
        moved = hung.element_results["segment_length"]["line"][0] - clamped.rest_length[spans]
        offsets = offsets.at[spans[:-1]].set(jnp.cumsum(moved)[:-1])
        codes.append(hung.status)
    return PulleyStates(jnp.max(jnp.stack(codes)), sag, level, ends, offsets, clamped)
