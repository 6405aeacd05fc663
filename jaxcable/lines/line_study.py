"""A whole job: string a line of a file, analyse its states, report tables and a profile."""

from __future__ import annotations

import dataclasses
import itertools

import numpy as np

from ..common import checks, status
from ..common.tree import copy_with
from ..common.types import Array, Float
from ..reporting import Report
from .line_analysis import LineResults, analyse, stretch
from .line_files import Line
from .line_tables import section_tables
from .span_tables import RulingSpan, ruling_span
from .stringing import PulleyStates, Stringing, pulleys, string


@dataclasses.dataclass(frozen=True)
class LineStudy:
    """Everything on a line: the result of `study_line`.

    Attributes:
        line: the `Line`, in which final states have the condition "final".
        strung: `Stringing`.
        permanent: permanent strains of the layers, [n_span, n_layer]; None: no state stretches.
        results: `LineResults` of all states.
        pulleys: `PulleyStates`: sags on pulleys and offsets.
        ruling: `RulingSpan`.

    Example:
        >>> drake = jc.catalogue.conductor("Drake")
        >>> section = jc.lines.LineSection(drake, [0.0, 300.0], [0.0, 0.0], [20.0, 20.0], "post")
        >>> states = {"hot": jc.lines.LineState(75.0)}
        >>> line = jc.lines.Line(section, {"parameter": 1500.0}, states, temperatures=(15.0,))
        >>> study = jc.lines.study_line(line)
        >>> print(study.report().summary[1])
        least height above the ground: 10.74 m in span 1-2, state 'hot'
    """

    line: Line
    strung: Stringing
    permanent: Float[Array, "n_span n_layer"] | None
    results: LineResults
    pulleys: PulleyStates
    ruling: RulingSpan

    @property
    def status(self) -> int:
        """The first status of stringing, states and pulleys that is not OK; OK if all are."""
        parts = self.strung, self.results, self.pulleys
        codes = np.concatenate([np.ravel(part.status) for part in parts])
        return int(next((code for code in codes if code != status.OK), status.OK))

    def report(self) -> Report:
        """Return the tables of `section_tables` and sentences on what governs, as a `Report`."""
        section, found = self.line.section, self.results
        tables = section_tables(section, self.line.states, found, self.pulleys, self.ruling)
        sentences = [f"status {self.status}: {status.describe(self.status)}"]
        codes = zip(found.names, np.asarray(found.status).tolist(), strict=True)
        if failed := [name for name, code in codes if code != status.OK]:
            sentences.append(f"no results of the states {', '.join(failed)}")
        spans = [f"{a}-{b}" for a, b in itertools.pairwise(section.names)]

        def extreme(values, pick, text):
            """Add a sentence with the extreme value of [n_state, n_span] numbers."""
            values = np.asarray(values)
            finite = np.where(np.isfinite(values), values, np.nan)
            if not np.isnan(finite).all():
                k, j = np.unravel_index(pick(finite), values.shape)
                where = f"in span {spans[j]}, state {found.names[k]!r}"
                sentences.append(f"{text.format(values[k, j])} {where}")

        extreme(found.clearance, np.nanargmin, "least height above the ground: {:.2f} m")
        for name, near in found.crossings.items():
            extreme(near, np.nanargmin, f"least distance from {name}: {{:.2f}} m")
        extreme(found.utilization, np.nanargmax, "largest tension over rated strength: {:.1%}")
        loads = tables["tower_loads"].rows
        if uplift := [f"{row[1]} ({row[0]})" for row in loads if row[-1] == "uplift"]:
            sentences.append(f"uplift at towers {', '.join(dict.fromkeys(uplift))}")
        sentences += self._remarks(spans)
        return Report(self.status, tuple(sentences), tables)

    def _remarks(self, spans):
        """Return sentences on the stringing, the conductor and what is not known, a list."""
        section, states = self.line.section, self.line.states
        one, given = section.conductor, self.line.stringing
        texts = {
            "parameter": "catenary parameter {:.4g} m",
            "horizontal_tension": "horizontal tension {:.6g} N",
            "sag": f"sag {{:.4g}} m in span {spans[given.get('span', 0)]}",
        }
        (condition,) = (text.format(float(given[k])) for k, text in texts.items() if k in given)
        found = [
            f"strung with {condition} at {float(given.get('temperature', 15.0)):g} degC",
            f"conductor {one.name}: weight {one.weight:.2f} N/m, "
            f"EA {one.area * one.final_modulus / 1e6:.2f} MN, "
            f"diameter {1e3 * one.diameter:.2f} mm, rated strength {one.strength / 1e3:.1f} kN",
        ]
        if section.profile is not None:
            first, last = np.asarray(section.profile)[[0, -1], 0].tolist()
            ends = itertools.pairwise(np.asarray(section.station).tolist())
            bare = [
                name
                for name, (low, high) in zip(spans, ends, strict=True)
                if low < first or high > last
            ]
            if bare:
                found.append(
                    f"the ground is known from {first:g} to {last:g} m only: "
                    f"clearances leave out all or part of spans {', '.join(bare)}"
                )
        final = [name for name, state in states.items() if state.condition == "final"]
        if final and len(one.layers) == 1 and one.layers[0].creep is None:
            curve = np.asarray(one.layers[0].initial)
            if np.allclose(curve[1], one.layers[0].modulus) and not curve[2:].any():
                found.append(
                    f"the conductor {one.name} is elastic, without permanent stretch: "
                    f"the final states {', '.join(final)} are as initial ones"
                )
        return found


def study_line(line: Line) -> LineStudy:
    """String a line, stretch it, analyse all its states, find its stringing chart and ruling span.

    Args:
        line: `Line`, as of `load_line`.

    Returns:
        `LineStudy`; its `report` has all tables.

    Tensions above the rated strength, and strains beyond the measured curves of the conductor, are
    results all the same; an `InputWarning` names the states.

    Raises:
        ValueError: as of `string` and `analyse`; final states, but none that stretches the line.

    Example:
        >>> drake = jc.catalogue.conductor("Drake")
        >>> section = jc.lines.LineSection(drake, [0.0, 300.0], [0.0, 0.0], [20.0, 20.0], "post")
        >>> states = {"heavy": jc.lines.LineState(-18.0, ice=0.0127)}
        >>> line = jc.lines.Line(section, {"sag": 7.5}, states, temperatures=(15.0,))
        >>> print(jc.lines.study_line(line).status)
        0
    """
    section, states = line.section, line.states
    stretches = line.loads or line.creep is not None
    if not stretches and (final := [k for k, s in states.items() if s.condition == "final"]):
        text = "give a state the role stretches or creeps"
        raise ValueError(f"states[{final[0]!r}]: is final, but no state stretches the line; {text}")
    _warn_of_low_tension(section, line.stringing.get("horizontal_tension"))
    strung, permanent = string(section, **line.stringing), None
    if stretches:
        creep = None if line.creep is None else copy_with(states[line.creep], broken=None)
        permanent = stretch(section, strung, {name: states[name] for name in line.loads}, creep)
    results = analyse(section, strung, states, permanent=permanent)
    _warn_of_overloads(section, states, results)
    chart = pulleys(section, strung, line.temperatures)
    ruling = ruling_span(section, strung, states, results, permanent=permanent)
    return LineStudy(line, strung, permanent, results, chart, ruling)


def _warn_of_low_tension(section, tension):
    """Warn of a stated tension, or None, below a thousandth of the strength, such as one in kN."""
    if tension is not None and 0 < float(tension) < 1e-3 * float(section.conductor.strength):
        text = f"horizontal tension of {float(tension):.4g} N: below 0.1 % of the rated strength"
        checks.warn_user(f"{text}; is it in N?")


def _warn_of_overloads(section, states, results):
    """Warn of states whose tension is above the strength or whose strain is beyond the curves."""
    one = section.conductor
    # NaN are states that failed, which the status says; infinite: the strength is not known, zero
    most = np.nan_to_num(np.asarray(results.utilization), posinf=0.0).max(axis=1)
    over = [f"{name!r} ({x:.0%})" for name, x in zip(results.names, most, strict=True) if x > 1]
    if over:
        checks.warn_user(f"tension above the rated strength in the states {', '.join(over)}")
    strains = np.nan_to_num(np.asarray(results.strain)).max(axis=1)  # NaN: failed, as above
    warmer = [states[name].temperature - one.temperature for name in results.names]
    beyond = [
        repr(name)
        for name, strain, warm in zip(results.names, strains, warmer, strict=True)
        if any(strain - layer.expansion * warm > layer.limit for layer in one.layers)
    ]
    if beyond:
        text = f"strain beyond the curves of {one.name} in the states {', '.join(beyond)}"
        checks.warn_user(text + "; the law goes on along its tangent")
