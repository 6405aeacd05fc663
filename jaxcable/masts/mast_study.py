"""A whole job: erect a mast of a file, analyse all cases, report envelopes, draw them."""

from __future__ import annotations

import dataclasses
import operator
from os import PathLike
from typing import TYPE_CHECKING

import jax
import numpy as np

from ..common import checks, status
from ..loads import WindPowerLaw
from ..reporting import Report
from ..reporting.table import columns_of_rows, make_table
from .gust_effects import extremes
from .mast_analysis import ErectedMast, MastForces, MastResults, analyse, erect, wind_directions
from .mast_files import MastJob

if TYPE_CHECKING:
    from matplotlib.figure import Figure

_NOTE = "V, M, displacement, sway: resultants of largest components along and across the wind"
_SLACK = (
    "below zero: the guy goes slack in gusts, which the root of the sum of squares does not know"
)
_SHARED = "of guys on one anchor add the forces; their largest ones may not act together"
_FALLEN = 10.0  # degrees by which no mast leans that stands

_INPUT = {
    "sections": "Sections of the mast; top, m; EA, N; EI, N m2; GJ, N m2; weight, N/m; "
    "drag area, m2/m",
    "levels": "Levels of guys; height, m; radius, m; azimuths, deg; anchor height, m; EA, N; "
    "weight, N/m; diameter, m; strength, N; arm, m",
    "ancillaries": "Ancillaries; name; height, m; drag area, m2; weight, N; iced drag area, m2; "
    "iced weight, N; offset, m; azimuth, deg",
}
_STATES = "States; state; wind; wind factor, -; weight factor, -; ice, m, ice at 10 m"
_LAW = "power law: velocity at this height; TIA-222: with the roots of all factors of its pressure"
_GUYS = "Tensions of guys; guy; length, m, unstressed length; as built, N, at anchor; at mast, N; \
largest, N; utilization, -, of strength; largest in; smallest, N; smallest in"
_MAST = "Envelope of the mast; height, m; displacement, m, horizontal; largest in; sway, deg; \
twist, deg; N, N, smallest N; V, N; M, N m; M in"
_FOUNDATIONS = "Forces on foundations; at; component; force, N, largest; moment, N m, largest; in"


@dataclasses.dataclass(frozen=True)
class MastStudy:
    """Everything on a mast: the result of `study_mast`.

    Attributes:
        job: the `MastJob`.
        built: `ErectedMast`.
        results: `MastResults` of all cases.
        low, high: `MastForces` of `extremes`, [n_state, n_direction, ...].

    Example:
        >>> part = jc.masts.tube_section(20.0, "CHS 168.3x6.3")
        >>> guys = [jc.masts.guy_level(19.0, 12.0, [0, 120, 240], "Galfan spiral strand 12")]
        >>> states = {"wind": jc.masts.eurocode_state(22.0)}
        >>> job = jc.masts.MastJob(jc.masts.GuyedMast([part], guys), states, [0.0, 60.0])
        >>> print(jc.masts.study_mast(job).report().summary[2])
        largest tension over strength: 11.7% of guy 1 at 0, state 'wind', wind to 0
    """

    job: MastJob
    built: ErectedMast
    results: MastResults
    low: MastForces
    high: MastForces

    @property
    def status(self) -> int:
        """The first status of the mast as built and of cases that is not OK; OK if all are."""
        codes = np.append(self.built.status, np.ravel(self.results.status))
        return int(next((code for code in codes if code != status.OK), status.OK))

    @property
    def holds(self) -> bool:
        """Whether all cases are stable, no guy exceeds its strength and the mast does not fall."""
        return bool(np.all(self.results.stable)) and not _overloads(self)

    def envelopes(self) -> dict[str, np.ndarray]:
        """Return envelopes over the height for each state and direction, [n_state, n_direction, n].

        "displacement", "sway" and "twist" (rad) of the nodes; "N" (smallest), "V" and "M" at both
        ends of each element, n is twice their number. All but N are sizes.
        """
        both = (jax.tree.map(np.asarray, x) for x in (self.low, self.high))
        most = jax.tree.map(lambda x, y: np.maximum(np.abs(x), np.abs(y)), *both)
        found = {
            "displacement": np.hypot(*np.moveaxis(most.displacement, -1, 0)[:2]),
            "sway": np.hypot(*np.moveaxis(most.rotation, -1, 0)[:2]),
            "twist": most.rotation[..., 2],
            "N": np.asarray(self.low.axial),
            "V": np.hypot(*np.moveaxis(most.shear, -1, 0)),
            "M": np.hypot(*np.moveaxis(most.moment, -1, 0)),
        }
        ends = (*found["N"].shape[:2], -1)
        return found | {k: found[k][..., [0, 2]].reshape(ends) for k in "NVM"}

    def report(self) -> Report:
        """Return tables of input, guys, mast and foundations, and sentences on what governs."""
        found, tables = self.results, _tables(self)
        gusts = np.array([x.gust is not None for x in self.job.states.values()])
        count, directions, patches = np.shape(found.status)
        own = gusts[:, None, None] | (np.arange(patches) == 0)  # else every patch is the mean
        own = np.broadcast_to(own, np.shape(found.status))
        blown = f"the mean wind and gusts on {patches - 1} patches" if gusts.any() else "no gusts"
        sentences = [
            f"status {self.status}: {status.describe(self.status)}",
            f"{own.sum()} cases: {count} states, {directions} directions, {blown}",
            *_overloads(self),
        ]
        if not self.built.solution.stable:
            sentences.append("the mast as built is not stable in calm air")
        failed = own & (np.asarray(found.status) != status.OK)
        unstable = own & ~failed & ~np.asarray(found.stable)
        for text, bad in (("no results of", failed), ("not stable:", unstable)):
            if bad.any():
                k, d, p = np.argwhere(bad)[0]
                first = f"{_describe_case(found, k, d)}, {found.patches[p]}"
                sentences.append(f"{text} {bad.sum()} cases, the first {first}")
        guys, mast = tables["guys"].rows, tables["mast"].rows
        if guys[0][5] is not None:
            most, least = max(guys, key=lambda x: x[5]), min(guys, key=lambda x: x[7])
            moved, sway, twist = (max(mast, key=operator.itemgetter(k)) for k in (1, 3, 4))
            sentences += [
                f"largest tension over strength: {most[5]:.1%} of guy {most[0]}, {most[6]}",
                f"smallest tension of a guy: {least[7] / 1e3:.4g} kN of guy {least[0]}, {least[8]}",
                f"largest displacement: {moved[1]:.3f} m at {moved[0]:.4g} m, {moved[2]}",
                f"largest sway of the axis: {sway[3]:.2f} degrees at {sway[0]:.4g} m",
                f"largest twist: {twist[4]:.2f} degrees at {twist[0]:.4g} m",
            ]
        return Report(self.status, tuple(sentences), tables)


def study_mast(job: MastJob) -> MastStudy:
    """Erect a mast, analyse all its cases, combine the effects of gusts.

    Args:
        job: `MastJob`, as of `load_mast`.

    Returns:
        `MastStudy`; its `report` has all tables.

    Guys above their strength, and a mast that leans by more than 10 degrees, are results all the
    same; an `InputWarning` names the states, and so does the report.

    Raises:
        ValueError: no states; as of `erect` and `analyse`.

    Example:
        >>> part = jc.masts.tube_section(20.0, "CHS 168.3x6.3")
        >>> guys = [jc.masts.guy_level(19.0, 12.0, [0, 120, 240], "Galfan spiral strand 12")]
        >>> states = {"wind": jc.masts.tia_state(30.0)}
        >>> job = jc.masts.MastJob(jc.masts.GuyedMast([part], guys), states, [0.0])
        >>> print(jc.masts.study_mast(job).status)
        0
    """
    angles = wind_directions(job.directions)  # wrong ones are refused before the work
    built = erect(job.mast)
    results = analyse(built, job.states, angles)
    study = MastStudy(job, built, results, *extremes(results))
    if checks.numpy_or_jax(study.high) is np:
        for text in _overloads(study):
            checks.warn_user(text)
    return study


def _overloads(study):
    """Return sentences on states that break guys, or that the mast does not stand, a list."""
    used = np.asarray(study.high.tensions).max(-1) / np.asarray(study.job.mast.of_guys("strength"))
    lean = study.envelopes()["sway"]
    over, lean = "guys above their strength, analysed as if they held,", np.degrees(lean)
    fallen = "the mast falls, or has numbers in other units: its axis leans, degrees,"
    found = []
    for text, values, limit, shown in ((over, used, 1, ".0%"), (fallen, lean, _FALLEN, ".0f")):
        most = np.fmax.reduce(values, axis=(1, 2))  # NaN: failed, which the status says
        pairs = [*zip(study.results.names, most, strict=True)]
        if states := [f"{name!r} ({x:{shown}})" for name, x in pairs if x > limit]:
            found.append(f"{text} in the states {', '.join(states)}")
    return found


def _describe_case(results, state, direction):
    """Return a case in words: its state and its direction."""
    return f"state {results.names[state]!r}, wind to {results.directions[direction]:g}"


def _governing(study, values, pick=np.nanargmax):
    """Return the governing values over all states and directions, and their cases in words.

    Args:
        study: `MastStudy`.
        values: results in every state and direction, [n_state, n_direction, n].
        pick: which index governs: that of the largest value (default), or ``np.nanargmin``.

    Returns:
        n values, NaN where all are NaN, else without regard to NaN; n cases, of state and wind.
    """
    flat = np.where(np.isnan(values).all((0, 1)), 0.0, values).reshape(-1, values.shape[-1])
    at = pick(flat, axis=0)
    cases = [_describe_case(study.results, *divmod(int(k), values.shape[1])) for k in at]
    return values.reshape(flat.shape)[at, np.arange(len(at))].tolist(), cases


def _cell(value):
    """Return a field for a table: a number, a text, or numbers that differ as a text."""
    if value is None or isinstance(value, str):
        return value
    different = np.unique(value)
    return float(different[0]) if len(different) == 1 else " ".join(f"{x:g}" for x in value)


def _at_nodes(values, pick):
    """Return at nodes what is known at both ends of elements, [..., 2 n_element] to [..., n]."""
    upper = np.concatenate([values[..., :1], values[..., 1::2]], axis=-1)
    lower = np.concatenate([values[..., ::2], values[..., -1:]], axis=-1)
    return pick(upper, lower)


def _tables(study):
    """Return the tables of a study by name: sections, states, guys, mast, foundations."""
    mast, every = study.job.mast, study.envelopes()
    low, high = (jax.tree.map(np.asarray, x) for x in (study.low, study.high))
    tables = {}
    for key, every_part in zip(_INPUT, (mast.sections, mast.guys, mast.ancillaries), strict=True):
        fields = [x.split(", ")[0].replace(" ", "_") for x in _INPUT[key].split("; ")[1:]]
        if rows := [[_cell(getattr(x, k)) for k in fields] for x in every_part]:
            tables[key] = _table_by_spec(_INPUT[key], rows)
    factors = "wind_factor", "weight_factor", "ice"
    states = study.job.states.items()
    rows = [[n, x.wind.describe(), *(float(getattr(x, k)) for k in factors)] for n, x in states]
    laws = any(isinstance(x.wind, WindPowerLaw) for _, x in states)
    tables["states"] = _table_by_spec(_STATES, rows, *[_LAW] * laws)
    largest = _governing(study, high.tensions.max(-1))
    least = _governing(study, low.tensions.min(-1), np.nanargmin)
    used = np.array(largest[0]) / np.asarray(mast.of_guys("strength"))
    built, names = np.asarray(study.built.tensions), mast.guy_names
    lengths = np.asarray(study.built.rest_length).tolist()
    guys = names, lengths, *built.T.tolist(), largest[0], used.tolist(), largest[1], *least
    tables["guys"] = _table_by_spec(_GUYS, zip(*guys, strict=True), *[_SLACK] * (min(least[0]) < 0))
    heights = np.asarray(mast.node_heights()).tolist()
    columns = [*_governing(study, every["displacement"])]
    columns += [np.degrees(_governing(study, every[k])[0]).tolist() for k in ("sway", "twist")]
    for k, pick in (("N", np.nanargmin), ("V", np.nanargmax), ("M", np.nanargmax)):
        at_nodes = _at_nodes(every[k], np.fmin if k == "N" else np.fmax)
        columns += _governing(study, at_nodes, pick)[: 2 if k == "M" else 1]
    tables["mast"] = _table_by_spec(_MAST, zip(heights, *columns, strict=True), _NOTE)
    size = jax.tree.map(lambda x, y: np.maximum(np.abs(x), np.abs(y)), low, high)
    bending = np.hypot(size.base_moment[..., 0], size.base_moment[..., 1])
    parts = {("base", "downwards"): high.base[..., 2]}
    parts["base", "horizontal"] = np.hypot(size.base[..., 0], size.base[..., 1])
    for j, text in ((0, "towards the mast"), (2, "upwards")):
        parts |= {(f"anchor {n}", text): high.anchors[..., k, j] for k, n in enumerate(names)}
    moments = {} if mast.base == "hinged" else {("base", "bending"): bending}
    moments["base", "torsion"] = size.base_moment[..., 2]
    values, cases = _governing(study, np.stack([*parts.values(), *moments.values()], axis=-1))
    sizes = [(x, None) for x in values[: len(parts)]] + [(None, x) for x in values[len(parts) :]]
    at = zip(*(parts | moments), strict=True)
    rows = zip(*at, *zip(*sizes, strict=True), cases, strict=True)
    tables["foundations"] = _table_by_spec(_FOUNDATIONS, rows, _SHARED)
    return tables


def _table_by_spec(heads, rows, *notes):
    """Return a table of rows, with notes, from a text that specifies title and columns.

    `heads` is "title; name, unit, heading; ..." with a part for each column, or its name only.
    """
    title, *heads = heads.split("; ")
    named = [tuple(x.split(", ")) if ", " in x else x for x in heads]
    return make_table(title, columns_of_rows([*rows], *named), notes)


def plot_mast(study: MastStudy, path: str | PathLike[str] | None = None) -> Figure:
    """Draw a mast and its guys by their distance from the axis, with envelopes of each state.

    Args:
        study: `MastStudy`.
        path: where to save the picture, in the format of the suffix, or None.

    Returns:
        The matplotlib figure.

    Example:
        >>> part = jc.masts.tube_section(20.0, "CHS 168.3x6.3")
        >>> guys = [jc.masts.guy_level(19.0, 12.0, [0, 120, 240], "Galfan spiral strand 12")]
        >>> states = {"wind": jc.masts.tia_state(30.0)}
        >>> job = jc.masts.MastJob(jc.masts.GuyedMast([part], guys), states, [0.0])
        >>> figure = jc.masts.plot_mast(jc.masts.study_mast(job))
        >>> print([axes.get_xlabel() for axes in figure.axes])
        ['distance, m', 'displacement, mm', 'sway, degrees', 'N, kN', 'V, kN', 'M, kN m']
    """
    from ..plots import style  # slow to import: matplotlib

    mast, curves, built = study.job.mast, study.envelopes(), study.built.structure
    heights = np.asarray(mast.node_heights())
    wide = 0.3 + 4.6 * np.clip(np.max(mast.of_guys("radius")) / heights[-1], 0.2, 1.5)
    figure = style.new_figure(wide + 8.0, 5.2)
    axes = figure.subplots(1, 6, sharey=True, width_ratios=[wide, *[1.4] * 5])
    for ends in np.asarray(built.nodes)[built.elements["guys"].links.array]:
        axes[0].plot(np.hypot(*ends.T[:2]), ends[:, 2], color="0.55", linewidth=0.8)
    axes[0].plot(0 * heights, heights, color="0.1", linewidth=2.0)
    for one in mast.ancillaries:
        axes[0].plot(0.0, float(one.height), "s", color="0.1", markersize=5)
    axes[0].set(xlabel="distance, m", ylabel="height, m", aspect="equal", adjustable="datalim")
    units = {"displacement": ("mm", 1e3), "sway": ("degrees", 180 / np.pi)}
    units |= {"N": ("kN", 1e-3), "V": ("kN", 1e-3), "M": ("kN m", 1e-3)}
    for own, (name, (unit, factor)) in zip(axes[1:], units.items(), strict=True):
        places = heights if name in ("displacement", "sway") else np.repeat(heights, 2)[1:-1]
        for k, values in enumerate(
            (np.fmin if name == "N" else np.fmax).reduce(curves[name], axis=1)
        ):
            color = style.SERIES[k % len(style.SERIES)]
            label = study.results.names[k] if name == "M" else None
            own.plot(factor * values, places, color=color, label=label)
        own.set_xlabel(f"{name}, {unit}")
    figure.legend(loc="outside lower center", ncols=4, **style.LEGEND)
    return style.finish_figure(figure, path)
