"""Find prestress forces or lengths so that results of any phase meet their targets."""

from __future__ import annotations

import contextlib
import functools
from collections.abc import Callable, Sequence
from typing import Any, ClassVar

import jax
import jax.numpy as jnp
import numpy as np

from ..analysis.as_built_inputs import find_as_built_inputs
from ..analysis.phases import Phase, all_phase_inputs, as_phases, with_phase_input
from ..analysis.sensitivity import MeasuredAnalysis
from ..analysis.solution import Solution, State
from ..analysis.solver import solve
from ..common import checks, status
from ..common import jax_internals as internals
from ..common.compilation import is_top_level_call
from ..common.progress import Trial, as_listener
from ..common.tree import copy_with, pytree
from ..common.types import Array, Bool, Float, Int, PyTree
from ..elements.abilities import PHASE_INPUTS
from ..equilibrium.incremental import Incremental
from ..equilibrium.newton import Newton
from ..model.result_parts import named_groups_of, present_elements, slack_elements, values_per_group
from ..model.structure import Structure
from ..programs.program_calls import as_program
from .bars_for_cables import replace_cables_by_bars
from .bounds import check_search_arguments, flat_vector, make_bounds, unflatten_params
from .fit import fit, fit_on_host
from .length_bounds import add_default_bounds, describe_bounds_reached
from .targets import Target, deviations, require_targets, result_names_for_targets

_SAME = 1e-3  # part of a target's tolerance within which cables and bars in their place agree
_MAX_FORWARD = 256  # unknowns up to which forward mode is used; beyond, `fit` takes reverse mode
_NEARLY_SLACK = 0.05  # part of the largest force of a group below which a cable is nearly slack


@pytree(static=("remarks",))
class Tuned:
    """Result of `tune`: phases with the prestress found, their solution, and which targets are met.

    Attributes:
        phases: the phases with the prestress inputs found.
        values: the prestress inputs found, a list with an item for each pair in `unknowns`.
        solution: the `Solution` of these phases.
        deviation: deviation of every target, measured minus wanted, a list of arrays [n], m, N or
            N m.
        met: whether each target is met within its tolerance, list of bool.
        influence: derivative of all targets, one after the other, by all unknowns, one after the
            other, [n_target, n_unknown].
        free: True for values that no bound blocks, a list like `values`.
        without_influence: True for values on which no target depends, to rounding, a list like
            `values`; they are as in the given phases.
        status: status code of the search, 0 (OK) if it has converged, also where the least squares
            miss targets: look at `met`, or call `raise_if_failed`, which raises then, too.
            `describe` has the texts.
        steps: number of trial points after the start, of both searches if there were two.
        remarks: sentences on what an engineer should look at, a tuple of str, empty under jit and
            vmap: values that ended at a bound (see `tune`); targets that are missed, and by
            how much; and groups of cables of which some are nearly slack in the first phase with a
            target or later, with less than 5 % of the largest force that the group has in any
            phase. What can be done there is in the second example of `tune`.

    Example:
        By how much a bar of 2 m is to be shortened so that its end rises by 1 mm:

        >>> bar = jc.Bars([[0, 1]], axial_stiffness=1e6)
        >>> guide = jc.pinned([0]) + jc.restrained([1], "xy")
        >>> structure = jc.Structure([[0, 0, 0], [0, 0, -2.0]], bar, supports=guide)
        >>> lifted = jc.design.Target("positions", -1.999, at=(1, 2), within=1e-6)
        >>> phases = [jc.Phase(shortening=0.0)]
        >>> tuned = jc.design.tune(structure, phases, [(0, "shortening")], lifted)
        >>> print(tuned.values[0].round(6), tuned.influence.round(6))
        0.001 [[1.]]
    """

    _shown: ClassVar[str] = "met, stable, values, deviation, without_influence, steps, remarks"

    phases: list[Phase]
    values: list[PyTree[Float[Array, " ..."]]]
    solution: Solution
    deviation: list[Float[Array, " n"]]
    met: list[Bool[Array, ""]]
    influence: Float[Array, "n_target n_unknown"]
    free: list[PyTree[Bool[Array, " ..."]]]
    without_influence: list[PyTree[Bool[Array, " ..."]]]
    status: Int[Array, ""]
    steps: Int[Array, ""]
    remarks: tuple[str, ...] = ()

    @property
    def stable(self) -> Bool[Array, ""]:
        """Whether the end of the last phase is stable: `stable` of the `Solution`."""
        return self.solution.stable

    @property
    def targets_missed(self) -> str:
        """Which targets are missed, such as "targets missed: number 0", or ""."""
        missed = [str(k) for k, met in enumerate(self.met) if not np.all(np.asarray(met))]
        return f"targets missed: number {', '.join(missed)}" if missed else ""


def tune(
    structure: Structure,
    phases: Phase | Sequence[Phase],
    unknowns: Sequence[tuple[int, str]],
    targets: Target | Sequence[Target],
    bounds: tuple[PyTree[Any] | None, PyTree[Any] | None] | None = None,
    *,
    method: Newton | Incremental | None = None,
    start: Solution | State | None = None,
    smooth: bool = True,
    steps: int = 100,
    tol: float | None = None,
    progress: bool | Callable[[Trial], Any] | None = None,
) -> Tuned:
    """Find prestress forces or lengths so that results of any phase meet their targets.

    Targets are met exactly where that is possible, else in the sense of least squares, weighted by
    their tolerances (`Target.within`). With fewer targets than unknowns the values stay near those
    in the given phases, which are the start. This is the search of `fit` with exact derivatives
    through all phases, hence also through stages with activation and deactivation of elements.

    The first call traces programs of results and derivatives, which takes about three times as
    long as the first `solve`, and longer if a cable goes slack (see `smooth`). Other numbers, and
    other targets of displacements, positions and tensions, do not trace them again. (Inside of
    jit and vmap, and with more than 256 unknowns, it is `fit`, which traces at each call.)

    Args:
        structure, phases: as for `solve`.
        unknowns: pairs (number of a phase, name of a prestress input of it) such as
            ``(0, "pretension")`` or ``(3, "jacking")``. Every number of the input is an unknown: a
            scalar is one for all elements, an array [n_elem] has one each. For some elements
            ``only(elements, 18e3)`` is one for all, ``only(elements, [18e3, 18e3])`` one each.
        targets: one `Target`, or a list.
        bounds: (lower, upper) of the unknowns, each None, a number, or a prefix pytree of the list
            of inputs. Give those of the turnbuckles and jacks. Lengths without a bound have a
            default one, which also holds the start: an element with the length L, unstressed or as
            drawn, is shortened or let out by at most L (`shortening`), and has an unstressed length
            of at most 2 L (`rest_length`), a sag of at most L, a prestrain of -0.5 to 1. A value
            that ends there gets an `InputWarning` and a remark.

    Options:
        method, start: as for `solve`.
        smooth: whether to begin with bars in place of cables, which also bear compression, where
            the structure has beams or bars, too. Where cables go slack results have kinks, at which
            a search from far away can get stuck. The phases found are analysed with cables, and the
            search goes on with them where results differ.
        steps, tol, progress: as for `fit`.

    Returns:
        `Tuned`.

    Raises:
        ValueError: no unknown or target, an unknown phase or prestress input, a start outside of
            the bounds.

    Example:
        A mast with two stays. It shall stand upright under a pull of 10 kN at its top, with 60 kN
        left in the stay that the pull unloads:

        >>> nodes = [[0.0, 0.0, 0.0], [0.0, 0.0, 20.0], [-15.0, 0.0, 0.0], [15.0, 0.0, 0.0]]
        >>> mast = jc.Bars([[0, 1]], axial_stiffness=1e9)
        >>> stays = jc.Cables([[2, 1], [3, 1]], axial_stiffness=5e7)
        >>> supports = jc.pinned([0, 2, 3]) + jc.restrained([1], "y")
        >>> structure = jc.Structure(nodes, {"mast": mast, "stays": stays}, supports=supports)
        >>> pull = jc.NodalLoads([1], (10e3, 0.0, 0.0))
        >>> forces = {"mast": None, "stays": np.array([50e3, 50e3])}
        >>> phases = [jc.Phase(pretension=forces, loads=pull)]
        >>> upright = jc.design.Target("positions", 0.0, at=(1, 0), within=1e-3)
        >>> enough = jc.design.Target("tension", 60e3, at=1, on="stays", within=100.0)
        >>> tuned = jc.design.tune(structure, phases, [(0, "pretension")], [upright, enough])
        >>> print(jc.describe(tuned.status), [bool(met) for met in tuned.met])
        converged [True, True]
        >>> print(tuned.solution.tension["stays"].round(1))  # N
        [76665.5 60000. ]

        If a deck is exactly level, a cable may be left nearly slack; `Tuned.remarks` says so. A
        least force can be a second target; their `within` decide which of them gives way:

        >>> nodes = [[x, 0.0, 0.0] for x in (0.0, 4.0, 8.0, 9.6)]
        >>> nodes += [[x, 0.0, 9.0] for x in (4.0, 8.0, 9.6)]
        >>> tube = jc.Section.box(0.6, 0.3, 0.01, jc.Elastic(210e9))
        >>> deck = jc.Beams([[0, 1], [1, 2], [2, 3]], section=tube)
        >>> hangers = jc.Cables([[1, 4], [2, 5], [3, 6]], axial_stiffness=4e7)
        >>> supports = jc.pinned([4, 5, 6]) + jc.clamped([0])
        >>> bridge = jc.Structure(nodes, {"deck": deck, "hangers": hangers}, supports=supports)
        >>> weight = jc.LineLoads((0.0, 0.0, -3e3), on="deck")
        >>> jacks = {"deck": None, "hangers": np.array([8e3, 8e3, 8e3])}
        >>> stage = jc.Phase(jacking=jacks, loads=weight)
        >>> level = jc.design.Target("positions", 0.0, at=([1, 2, 3], 2), within=5e-4)
        >>> keep = jc.design.Target("tension", 3e3, at=[2], on="hangers", within=500.0)
        >>> tuned = jc.design.tune(bridge, stage, [(0, "jacking")], [level, keep])
        >>> print([bool(met) for met in tuned.met], tuned.solution.tension["hangers"].round(-1))
        [True, True] [14830.  5960.  3000.]
        >>> print(f"{1e3 * abs(tuned.deviation[0]).max():.2f} mm", tuned.remarks)
        0.07 mm ()
    """
    phases = as_phases(structure, phases)
    if not isinstance(targets, Target | list | tuple):
        given = checks.describe_type(targets, "Target(...)")
        raise ValueError(f"targets: expected a list of Target, got {given}")
    targets = [targets] if isinstance(targets, Target) else list(targets)
    values = _check_unknowns(phases, unknowns)
    require_targets(targets, len(phases))
    asked = make_bounds(bounds, values)
    box = add_default_bounds(asked, structure, unknowns, values)
    bounds = unflatten_params(box.lower, values), unflatten_params(box.upper, values)

    def phases_with(values):
        found = list(phases)
        for (k, name), value in zip(unknowns, values, strict=True):
            found[k] = with_phase_input(found[k], name, value)
        return found

    def fit_values(structure, values):
        phases, inputs = phases_with(values), [t.value for t in targets]
        leaves = jax.tree.leaves((structure, phases, inputs, bounds, start))
        # lengths of elements as built are found in `solve`
        within = find_as_built_inputs(structure, phases, start) or not is_top_level_call(leaves)
        if within or flat_vector(values).size > _MAX_FORWARD:

            def residuals(values):
                solution = solve(structure, phases_with(values), method, start=start)
                return _weighted_deviations(targets, solution), solution

            return fit(residuals, values, bounds, steps=steps, tol=tol, progress=progress)
        own = as_program(lambda x: unflatten_params(x, values))
        measure = functools.partial(_weighted_deviations, targets)
        given = measure, result_names_for_targets(targets), method, start
        analyse = MeasuredAnalysis(structure, lambda x: phases_with(own(x)), *given)
        checks.require_whole_number(steps, "steps")
        box = check_search_arguments(values, bounds, tol)
        return internals.as_jax_arrays(
            fit_on_host(analyse, *box, int(steps), as_listener(progress))
        )

    solution, spent = None, []
    plain = smooth and start is None and not find_as_built_inputs(structure, phases)
    pressing = replace_cables_by_bars(structure) if plain else None
    if pressing is not None:
        found = fit_values(pressing, values)
        spent.append(found.steps)
        xp = checks.numpy_or_jax(found.status)
        good = xp.asarray(found.status) == status.OK
        reached = jax.tree.map(functools.partial(xp.where, good), found.params, values)
        with contextlib.suppress(ValueError):  # forces below zero, which bars take
            solution = solve(structure, phases_with(reached), method)
            values = reached
    if solution is None or not _cables_act_like_bars(targets, solution, found):
        found = fit_values(structure, values)
        spent.append(found.steps)
        solution = solve(structure, phases_with(found.params), method, start=start)
    tuned = _make_tuned(structure, phases_with(found.params), targets, solution, found, spent)
    far, at_given = describe_bounds_reached(unknowns, tuned.values, asked, box)
    for text in far:
        checks.warn_user(text)
    return copy_with(tuned, remarks=(*far, *at_given, *tuned.remarks))


def _make_tuned(structure, phases, targets, solution, found, spent):
    """Return the `Tuned` of `found`, the `Fit` of the search, and of the solution of its `phases`.

    `spent` are the numbers of trial points of all searches.
    """
    deviation = deviations(targets, solution)
    within = np.repeat([t.within for t in targets], [len(own) for own in deviation])
    met = [(abs(own) <= t.within).all() for own, t in zip(deviation, targets, strict=True)]
    influence = checks.as_numpy_if_known(found.jacobian) * within[:, None]
    first_phase = min(t.phase % len(phases) for t in targets)
    remarks = _describe_nearly_slack(structure, solution, first_phase)
    remarks = _describe_missed_targets(targets, deviation, solution) + remarks
    steps = sum(map(checks.as_numpy_if_known, spent))
    numbers = internals.as_jax_arrays((deviation, met, influence))
    flags = found.free, found.without_influence, found.status, internals.as_jax_arrays(steps)
    return Tuned(phases, found.params, solution, *numbers, *flags, remarks)


def _weighted_deviations(targets, solution):
    """Return the deviations of all targets, each over its tolerance, as one array [n_target]."""
    found = deviations(targets, solution)
    parts = [d / t.within for d, t in zip(found, targets, strict=True)]
    return checks.numpy_or_jax(parts).concatenate(parts)


def _describe_missed_targets(targets, deviation, solution):
    """Return a sentence for each missed target, a tuple, from measured minus wanted values.

    `deviation` has these for each target, [n]. It is empty if the analysis failed or is traced.
    """
    code = solution.status
    if checks.numpy_or_jax(code, deviation) is not np or np.any(np.asarray(code) != status.OK):
        return ()
    off = [np.max(np.abs(own)) for own in deviation]
    return tuple(
        f"targets[{number}] is missed: off by up to {most:.3g}, its tolerance is {t.within:.3g}"
        for number, (most, t) in enumerate(zip(off, targets, strict=True))
        if most > t.within
    )


def _describe_nearly_slack(structure, solution, first_phase):
    """Return sentences on cables that are slack at the end, or nearly so in a phase.

    They are a tuple, empty if the analysis failed or is traced. Phases count from `first_phase`
    on; nearly slack is a force below 5 % of the largest one of the group in any phase.
    """
    if isinstance(solution.status, jax.core.Tracer) or int(solution.status) != status.OK:
        return ()
    stages = [values_per_group(structure, phase.tension) for phase in solution.phases]
    words, present = [], present_elements(structure, solution.present)
    for k, (name, group) in enumerate(named_groups_of(structure)):
        if not group.tension_only:
            continue
        force = np.stack([forces[k] for forces in stages])  # [n_phase, n_elem]
        slack = np.flatnonzero(slack_elements(group, force[-1], present[k]))
        if len(slack):
            shown = ", ".join(map(str, slack[:12])) + ", ..." * (len(slack) > 12)
            count = f"{len(slack)} of {len(group.links)}"
            words.append(f"{name or 'cables'}: {count} SLACK at the end: elements {shown}")
        later = force[first_phase:]
        bears = np.where(later > 0, later, np.inf)  # without absent elements
        least, small = bears.min(), (bears < _NEARLY_SLACK * force.max()).any(axis=0)
        if small.any():
            number, i = np.unravel_index(bears.argmin(), bears.shape)
            words.append(
                f"{name or 'cables'}: {small.sum()} of {len(small)} nearly slack; the least is "
                f"element {i}, {least:.3g} N at the end of phase {first_phase + number}"
            )
    return tuple(words)


def _cables_act_like_bars(targets, solution, found):
    """Return whether `solution`, with cables, equals the one with bars that the `Fit` has `found`.

    It does if all deviations are the same and no cable is slack at the end of any phase; the
    influence matrix of the bars then also is that of the cables. False while traced.
    """
    slack = [phase.path.n_slack for phase in solution.phases]
    every = _weighted_deviations(targets, solution), found.residual, solution.status, slack
    if checks.numpy_or_jax(every) is not np:
        return False
    apart, residual, code, slack = jax.tree.map(np.asarray, every)
    same = np.all(np.abs(apart - residual) <= _SAME)
    return bool(code == status.OK and same and not any(each[-1] for each in slack))


def _check_unknowns(phases, unknowns):
    """Check the unknowns, pairs (number of a phase, prestress input); return their start values.

    These are a list of pytrees of floats; ValueError if a phase has no such input.
    """
    if not isinstance(unknowns, list | tuple):
        got = type(unknowns).__name__
        raise ValueError(f"unknowns: expected a list of pairs such as (0, 'pretension'), got {got}")
    if not unknowns:
        raise ValueError("unknowns: none; give pairs such as (0, 'pretension')")
    values = []
    for number, unknown in enumerate(unknowns):
        if not isinstance(unknown, tuple) or len(unknown) != 2:
            raise ValueError(f"unknowns[{number}] = {unknown!r}: expected (phase, prestress input)")
        k, name = unknown
        if isinstance(k, bool) or not isinstance(k, int | np.integer) or not 0 <= k < len(phases):
            raise ValueError(
                f"unknowns[{number}]: phase {k!r}; there are phases 0 to {len(phases) - 1}"
            )
        known = [*PHASE_INPUTS, *(phases[k].own or ())]
        if name not in known:
            there = checks.suggest_names(name, known)
            raise ValueError(f"unknowns[{number}] = {name!r}: not a prestress input{there}")
        if unknown in unknowns[:number]:
            raise ValueError(f"unknowns[{number}] = {unknown!r}: is there twice")
        value = all_phase_inputs(phases[k]).get(name)
        if value is None:
            raise ValueError(
                f"unknowns[{number}]: phases[{k}] has no {name}; give start values there"
            )
        values.append(
            jax.tree.map(lambda x: jnp.asarray(checks.as_numpy_if_known(x), float), value)
        )
    return values
