"""Sag-tension tables of one span by tension limits, and ruling spans beside the exact answer."""

from __future__ import annotations

import functools
from collections.abc import Mapping, Sequence
from typing import Literal, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jax import lax
from scipy.optimize import brentq

from ..catalogue.conductors import Conductor
from ..common import checks
from ..common.tree import copy_with, pytree
from ..common.types import Array, Float
from ..programs.joining import stack_trees
from ..programs.program_calls import as_program
from .conductor_law import ConductorLaw
from .line_analysis import LineResults, analyse, stretch
from .line_section import LineSection
from .line_states import LineState
from .stringing import Stringing

TENSIONS = "support", "mean", "horizontal"
"""Tensions of a span that a table shows: the largest, its mean with the horizontal one, this."""

_BISECTIONS = 60
_SHORTEST, _LONGEST = 0.98, 1.05  # conductor over chord, between which limits are sought


@pytree(static=("names", "governing"))
class SagTension:
    """Sags and tensions of one level or inclined span: the result of `sag_tension`.

    Arrays [n_state, 2] are of the conductor before and after stretch.

    Attributes:
        names: of the states.
        governing: name of the limit that governs.
        length: of the conductor without stress, m.
        permanent: permanent strains of the layers after stretch, [1, n_layer].
        load: resultant load per length, [n_state], N/m.
        sag: of the exact elastic catenary, in the plane of the load, [n_state, 2], m.
        tension: of the exact elastic catenary, as asked for, [n_state, 2], N.
        parabola, catenary: sag and tension of the parabola and of the catenary with one strain,
            from the same governing state, each [n_state, 2, 2], m and N.
        initial, final: `LineResults` before and after stretch.

    Example:
        >>> states = {"15 C": jc.lines.LineState(15.0)}
        >>> drake = jc.catalogue.conductor("Drake")
        >>> found = jc.lines.sag_tension(drake, 300.0, states, {"15 C": 28e3})
        >>> print(found.governing, f"{found.sag[0, 0]:.2f} m, {found.tension[0, 0] / 1e3:.2f} kN")
        15 C 6.44 m, 28.00 kN
    """

    names: tuple[str, ...]
    governing: str
    length: Float[Array, ""]
    permanent: Float[Array, "1 n_layer"]
    load: Float[Array, " n_state"]
    sag: Float[Array, "n_state 2"]
    tension: Float[Array, "n_state 2"]
    parabola: Float[Array, "n_state 2 2"]
    catenary: Float[Array, "n_state 2 2"]
    initial: LineResults
    final: LineResults


def sag_tension(
    conductor: Conductor,
    span: float,
    states: Mapping[str, LineState],
    limits: Mapping[str, float | tuple[float, Literal["initial", "final"]]],
    *,
    stretched_by: Sequence[str] = (),
    creep: str | None = None,
    rise: float = 0.0,
    tension: Literal["support", "mean", "horizontal"] = "support",
) -> SagTension:
    """Compute a sag-tension table: the span is strung as tight as limits of tension allow.

    Args:
        conductor: `Conductor`.
        span: horizontal distance of the supports, m: that of one span, or a ruling span.
        states: `LineState` by name; their conditions do not count.
        limits: largest tensions, N, by names of states; of the new conductor, or, as ``(tension,
            "final")``, after stretch.

    Options:
        stretched_by: names of states whose load stretches the conductor for good.
        creep: name of the state in which it creeps for ten years; None: it does not.
        rise: of the second support above the first one, m.
        tension: which tension counts in limits and table: that at the higher "support", its "mean"
            with the horizontal tension, as in tables of the SAG10 program, or the "horizontal" one.

    Returns:
        `SagTension`; loads count per stretched length, as in published tables.

    Raises:
        ValueError: an unknown state, no limits, or none that can be met.

    Source: Southwire, Overhead Conductor Manual (2007), chapter 2.

    Example:
        Drake over 700 ft, 6300 lbf at 60 F as new: published are 10.65 ft then, and 12.36 ft after
        ten years (Grigsby, 2007, table 14.5).

        >>> heavy = jc.lines.LineState(-17.78, 0.0127, 191.5, extra=4.378, ice_density=913.0)
        >>> states = {"heavy": heavy, "60 F": jc.lines.LineState(15.56)}
        >>> found = jc.lines.sag_tension(
        ...     jc.catalogue.conductor("Drake"), 213.36, states, {"60 F": 28024.0},
        ...     stretched_by=["heavy"], creep="60 F", tension="mean",
        ... )
        >>> print(found.initial.status, (found.sag[1] / 0.3048).round(2))
        [0 0] [10.65 12.36]
    """
    checks.require_one_of(tension, "tension", TENSIONS)
    for name in (*limits, *stretched_by, *([] if creep is None else [creep])):
        if name not in states:
            raise ValueError(f"{name!r}: is no state{checks.suggest_names(name, states)}")
    if not limits:
        raise ValueError("limits: give at least one tension, by the name of a state")
    section = LineSection(conductor, [0.0, span], [0.0, 0.0], [0.0, rise], "post")
    plain = {n: copy_with(s, condition="initial", broken=None) for n, s in states.items()}
    of = _OneSpan(section, plain, tuple(stretched_by), creep)
    chord, lengths = float(np.hypot(span, rise)), {}
    stated = {n: x if isinstance(x, tuple) else (x, "initial") for n, x in limits.items()}
    for name, (value, condition) in stated.items():

        def excess(length, name=name, value=value, final=condition == "final"):
            found = of.solve(length, [name], final)[int(final)]
            return float(np.log(np.asarray(_shown_tension(found, tension))[0] / value))

        try:
            bracket = _SHORTEST * chord, _LONGEST * chord
            lengths[name] = brentq(excess, *bracket, xtol=1e-9 * chord, rtol=1e-12)
        except ValueError:
            text = f"limits[{name!r}] = {value:g} N: no length of a span of {span:g} m meets it"
            raise ValueError(text) from None
    governing = max(lengths, key=lengths.__getitem__)
    *both, left = of.solve(lengths[governing], list(states), True)
    load, parabola, catenary = of.simple_methods(both, left, governing, stated[governing][1])
    sag = jnp.stack([x.deflection[:, 0] for x in both], axis=1)
    shown = jnp.stack([_shown_tension(x, tension) for x in both], axis=1)
    length = jnp.asarray(lengths[governing])
    exact = length, left, load, sag, shown
    return SagTension(tuple(states), governing, *exact, parabola, catenary, *both)


class _OneSpan(NamedTuple):
    """A span of posts with states, names of those that stretch, and that of creep or None."""

    section: LineSection
    states: dict[str, LineState]
    stretched_by: tuple[str, ...]
    creep: str | None

    def solve(self, length, names, final):
        """Return `LineResults` of some states, initial and final, and the permanent strains.

        `length` is without stress, m; without `final` the initial results are there twice.
        """
        section, own = self.section, {name: self.states[name] for name in names}
        strung = Stringing(np.full(1, length), np.zeros(1), 0.0, np.zeros((), int), np.zeros(()))
        left = section.never_loaded
        before = analyse(section, strung, own, stretched=True)
        if not final:
            return before, before, left
        loads = {name: self.states[name] for name in self.stretched_by}
        creep = None if self.creep is None else self.states[self.creep]
        if loads or creep is not None:
            left = stretch(section, strung, loads, creep, stretched=True)
        after = {name: copy_with(state, condition="final") for name, state in own.items()}
        return before, analyse(section, strung, after, permanent=left, stretched=True), left

    def simple_methods(self, both, left, governing, condition):
        """Return resultant loads, [n_state], and tables by parabola and catenary, [n_state, 2, 2].

        They have the level tension of the governing state in its `condition`.
        """
        section, at = self.section, list(self.states).index(governing)
        loads, warmth, _ = _stated_loads(section, stack_trees(list(self.states.values())))
        loads = loads[:, 0]
        permanent = {"initial": section.never_loaded[0], "final": left[0]}
        level = _level_tension(both[int(condition == "final")])[at]
        anchor = loads[at], warmth[at], permanent[condition]
        given = section.conductor, section.span_lengths[0], level, anchor, loads, warmth

        def table(is_parabola):
            return [
                _simple_spans(*given, own, is_parabola=is_parabola, stretched=True)[:, :2]
                for own in (jnp.tile(x, (len(warmth), 1)) for x in permanent.values())
            ]

        both = (jnp.stack(table(is_parabola), axis=1) for is_parabola in (True, False))
        return jnp.linalg.norm(loads, axis=1), *both


@as_program
def _stated_loads(section, states):
    """Return loads of states on spans, [n_state, n_span, 2], N/m, temperatures, chords of spans.

    `states` is a `LineState` with arrays [n_state, ...].
    """
    ends = section.nodes()[np.array(section.layout.spans)]
    loads = jax.vmap(lambda state: state.load_per_length(section))(states)
    return loads, jnp.asarray(states.temperature), ends[:, 1] - ends[:, 0]


def _level_tension(results):
    """Return the tension across the load of the first span, [n_state], N."""
    whole = jnp.sqrt(jnp.sum(results.span_load[:, 0] ** 2, axis=-1))
    first, last = results.tensions[:, 0, 0], results.tensions[:, 0, 1]
    along = 0.5 * (whole + (first**2 - last**2) / whole)
    return jnp.sqrt(first**2 - along**2)


def _shown_tension(results, kind):
    """Return the tension of a `kind` of `TENSIONS` of the first span, [n_state], N."""
    largest, level = jnp.max(results.tensions[:, 0], axis=-1), _level_tension(results)
    return {"support": largest, "mean": 0.5 * (largest + level), "horizontal": level}[kind]


@functools.partial(as_program, static=("is_parabola", "stretched"))
def _simple_spans(
    conductor, span, level, anchor, loads, warmth, permanent, *, is_parabola, stretched
):
    """Return sag, mean and level tension, and load per length, of states of a level span, [n, 4].

    Args:
        conductor: `Conductor`.
        span: m.
        level: level tension, N, at the `anchor`: loads [2], temperature, permanent strains
            [n_layer], from which the method finds the length without stress.
        loads: on the states, across and downwards, [n, 2], N/m.
        warmth: temperatures, [n], degrees C.
        permanent: permanent strains of the layers, [n, n_layer].
        is_parabola: whether the method is the parabola, of which the mean tension is the horizontal
            one; else the catenary.
        stretched: whether loads count per stretched length.
    """

    def shape(level, load):
        """Return length, sag and mean tension of the span under a level tension, and the load."""
        slope = 0.5 * load * span / level
        if is_parabola:
            return span * (1 + slope**2 / 6), 0.25 * slope * span, level, load
        sag = level / load * (jnp.cosh(slope) - 1)
        return 2 * level / load * jnp.sinh(slope), sag, level + 0.5 * load * sag, load

    def shape_under(level, loads, unstressed):
        """Return the same under the loads across and downwards, [..., 2]."""
        across, down = loads[..., 0], loads[..., 1]
        whole = jnp.hypot(across, down)
        if not stretched:  # the mass stays, and the wind counts per length of the chord
            length = shape(level, whole)[0]
            whole = jnp.hypot(across * span / length, down * unstressed / length)
        return shape(level, whole)

    def halve(_, bracket):
        low, high = bracket
        middle = jnp.sqrt(low * high)
        length, _, mean, _ = shape_under(middle, loads, unstressed)
        above = law.tension(length / unstressed - 1) > mean
        return jnp.where(above, middle, low), jnp.where(above, high, middle)

    law, first = ConductorLaw(conductor, warmth, permanent), ConductorLaw(conductor, *anchor[1:])
    length, _, mean, _ = shape(level, jnp.hypot(*anchor[0]))
    for _ in range(3):
        length, _, mean, _ = shape_under(level, anchor[0], length / (1 + first.strain(mean)))
    unstressed = length / (1 + first.strain(mean))
    strength = jnp.full(len(warmth), conductor.strength, float)
    low, high = lax.fori_loop(0, _BISECTIONS, halve, (1e-3 * strength, 2.0 * strength))
    level = jnp.sqrt(low * high)
    _, sag, mean, whole = shape_under(level, loads, unstressed)
    return jnp.stack([sag, mean, level, whole], axis=-1)


@pytree
class RulingSpan:
    """Spans by their ruling span, beside the exact answer: the result of `ruling_span`.

    Attributes:
        horizontal: horizontal tension of the ruling span of each span, [n_state, n_span], N.
        sag: vertical sags with it, at midspan, [n_state, n_span], m.
        sag_error: ``sag`` minus that of the exact answer, [n_state, n_span], m.

    Example:
        >>> drake = jc.catalogue.conductor("Drake")
        >>> section = jc.lines.LineSection(drake, [0.0, 300.0], [0.0, 0.0], [20.0, 20.0], "post")
        >>> strung = jc.lines.string(section, parameter=1500.0, temperature=15.0)
        >>> states = {"hot": jc.lines.LineState(75.0)}
        >>> found = jc.lines.analyse(section, strung, states)
        >>> ruling = jc.lines.ruling_span(section, strung, states, found)
        >>> print(bool(abs(ruling.sag_error[0, 0]) < 1e-3))
        True
    """

    horizontal: Float[Array, "n_state n_span"]
    sag: Float[Array, "n_state n_span"]
    sag_error: Float[Array, "n_state n_span"]


def ruling_span(
    section: LineSection,
    strung: Stringing,
    states: Mapping[str, LineState],
    results: LineResults,
    *,
    permanent: Float[Array, "n_span n_layer"] | None = None,
) -> RulingSpan:
    """Compute states by ruling spans: one horizontal tension in all spans of a tension section.

    Args:
        section, strung, states: as of `analyse`; uneven ice and broken conductors, for which a
            ruling span has no meaning, give NaN.
        results: `LineResults` of these states.

    Options:
        permanent: as of `analyse`; the mean of the spans counts.

    Returns:
        `RulingSpan`.

    Raises:
        ValueError: as of `analyse`.

    Example:
        >>> drake = jc.catalogue.conductor("Drake")
        >>> section = jc.lines.LineSection(
        ...     drake, [0.0, 150.0, 600.0], [0.0] * 3, [30.0] * 3, ["post", "suspension", "post"],
        ...     string_length=2.5, string_weight=900.0,
        ... )
        >>> strung = jc.lines.string(section, parameter=1500.0, temperature=15.0)
        >>> states = {"hot": jc.lines.LineState(75.0)}
        >>> found = jc.lines.analyse(section, strung, states)
        >>> ruling = jc.lines.ruling_span(section, strung, states, found)
        >>> print(found.status, (100 * ruling.sag_error / found.sag).round(2), "%")
        [0] [[-1.19  0.09]] %
    """
    own, every = section.layout, list(states.values())
    level, sag = np.full((2, len(every), len(own.spans)), np.nan)
    even = [k for k, s in enumerate(every) if s.broken is None and np.ptp(np.asarray(s.ice)) == 0]
    plain = [
        copy_with(s, ice=np.max(np.asarray(s.ice)), condition="initial")
        for s in (LineState(strung.temperature), *(every[k] for k in even))
    ]
    loads, warmth, chords = (np.asarray(x) for x in _stated_loads(section, stack_trees(plain)))
    virgin = np.asarray(section.never_loaded)
    left = virgin if permanent is None else np.asarray(permanent)
    final = np.array([[every[k].condition == "final"] for k in even])
    for spans, length in zip(own.tension_sections, section.ruling_spans(), strict=True):
        own_loads = loads[:, spans[0]]
        found = _simple_spans(
            *(section.conductor, length, strung.horizontal[spans[0]]),
            *((own_loads[0], warmth[0], virgin[0]), own_loads[1:], warmth[1:]),
            np.where(final, left[spans].mean(axis=0), virgin[0]),
            is_parabola=False,
            stretched=False,
        )
        tension, whole = np.asarray(found)[:, 2:, None].swapaxes(0, 1)
        down = own_loads[1:, 1:] / np.linalg.norm(own_loads[1:], axis=1, keepdims=True)
        parameter, place = tension / whole, np.ix_(even, spans)
        half = np.hypot(chords[spans, 0], chords[spans, 1]) / (2 * parameter)
        incline = np.hypot(1.0, chords[spans, 2] / (2 * parameter * np.sinh(half)))
        level[place] = tension
        sag[place] = parameter * (np.cosh(half) - 1) * incline * down
    return RulingSpan(jnp.asarray(level), jnp.asarray(sag), jnp.asarray(sag - results.sag))
