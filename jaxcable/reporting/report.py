"""Report a result for engineers: make the tables and sentences of a `Report`."""

from __future__ import annotations

import dataclasses
from collections.abc import Mapping, Sequence

from ..analysis.phases import Phase
from ..analysis.solution import Solution, State
from ..common import checks as arguments
from ..common.units import SI, UnitsLike, as_units
from ..design.checks import Checks
from ..design.combinations import Combinations
from ..dynamics.modes import NaturalModes
from ..dynamics.response import Transient
from ..model.result_parts import require_single_case
from ..model.structure import Structure
from ..model.topology import require_same_topology
from ..results.reference_phase import begin_at_end, reference_phase, reference_words
from . import stability, states
from .axial_forces import axial_force_table, exceeded_strength_sentence, group_tables
from .cable_sags import check_chains, sag_tables
from .check_tables import check_sentences, check_tables
from .combination_table import action_table, combination_sentences, combination_table
from .displacements import (
    displacement_tables,
    displacement_tables_since,
    large_displacement_sentence,
    largest_displacement_sentence,
    rotation_tables,
    tilt_tables,
)
from .element_results import element_result_tables
from .energies import energy_table
from .lengths import cable_tables, cutting_list_table
from .mode_table import mode_table
from .model_tables import model_tables
from .motion_tables import motion_tables
from .phase_tables import phase_tables
from .reactions import (
    equilibrium_table,
    reaction_envelope_table,
    reaction_table,
    total_reaction,
)
from .result_report import Report
from .section_forces import section_force_tables
from .slackness import slackness_tables
from .stresses import stress_tables
from .summary import has_no_result, summary_sentences
from .surfaces import surface_tables
from .table import table_in_units, tables_without_noise

# Which numbers of a table over cases are of the state before them, and which are envelopes; tables
# that have a row for each case, whether it governs or not, need no such note.
_FINAL = "equilibrium", "stresses", "cutting_list", "cables", "surfaces"
_ENVELOPES = "groups", "reaction_envelope", "displacement_envelope", "stress_envelope"
_BOTH = "reactions", "members", "tilts", "sags", "results", "N", "Vy", "Vz", "T", "My", "Mz"
_OF_EACH_CASE = "displacements", "displacements_since", "rotations"


def report(
    structure: Structure,
    solution: Solution,
    phases: Phase | Sequence[Phase] | Mapping[str, Phase] | None = None,
    *,
    cases: Solution | None = None,
    names: Sequence[str] | None = None,
    buckling: bool | Solution | State = False,
    energy: bool | Solution | State = False,
    units: UnitsLike | None = None,
    since: int | str | None = None,
    chains: Mapping[str, Sequence[int]] | None = None,
    combinations: Combinations | None = None,
    checks: Checks | None = None,
    modes: NaturalModes | None = None,
    motion: Transient | None = None,
    model: bool = False,
) -> Report:
    """Report a result: displacements, reactions, forces and stresses with envelopes, cutting list.

    Args:
        structure: `Structure` that was analysed.
        solution: its `Solution`; if it has failed, the report is on the last converged state, and
            says so, or has no tables if no increment has converged.
        phases: the phases of the analysis, as many as the solution has; `energy` needs them, and
            the table ``phases`` of the `model`. A dict gives their names, too.

    Options:
        cases: `Solution` with a leading axis [n_case], as from `design.solve_cases`, for envelopes
            over these cases, in which `solution` itself does not count; default: envelopes over the
            ends of the phases. Failed cases are named and left out.
        names: names of the cases, default "case 0", "case 1" and so on; without cases those of the
            phases, default "phase 1", "phase 2" and so on.
        buckling: True to add to the summary the factor on its loads at which the state would buckle
            (`stiffness.buckling_factor`, an eigenproblem); or the `Solution` or `State` of the
            prestress, to which the factor does not apply.
        energy: True to add the balance of work and energy of every phase (`energy_balance`; it
            compiles another program, which takes a second for nets and some for beams); or the
            `Solution` or `State` from which the analysis started. It needs `phases`, and is refused
            where they add or remove elements.
        units: units of all numbers, such as "kN, m" or "kip, ft" (see `files.Units`), such as the
            ``units`` of a scene that `load_scene` has read; its text has displacements in mm or in,
            and stresses in MPa, kip/in2, lbf/in2 or kgf/cm2. Default: SI units, of which the text
            has large forces in kN.
        since: phase, by its number from 0 or by its name, from whose beginning there are further
            tables of displacements: for deflections under load, without those of prestressing and
            erection. "last phase", or the only phase, of cases that begin at the end of `solution`:
            from this end. Titles of the tables say from where they count.
        chains: node numbers of cables of several elements by name, as for `results.sags`; they get
            rows in the table ``sags``.
        combinations: the `design.Combinations` that `cases` are the results of: gives their names,
            and a table of them.
        checks: the `design.Checks` of the cases: the table ``checks``, and one for each of them.
        modes: result of `dynamics.modes` about the final state: the table ``modes``.
        motion: result of `dynamics.transient`: the tables ``motion_forces`` and
            ``motion_displacements`` of its extremes.
        model: whether there are tables of what was analysed: ``geometry`` with supports,
            ``properties`` of elements, and, if they are given, ``phases``.

    Returns:
        `Report`; its class lists the tables. Forces in ``members`` are the largest along an
        element; compression is compared with strength alone, without buckling. Displacements are
        from the start, that is from the initial geometry (the nodes of the structure). Reactions
        act on the structure; a component that is not supported has no value. Section forces of
        beams are given at both ends, with the smallest and the largest along the element, and their
        envelope over the ends of phases or the cases; stresses over all load steps, because every
        increment records strains. Inactive elements have no values. Numbers that are rounding
        errors beside the others of their kind are zero, also in files. Unstressed lengths are at
        the temperature before the first phase.

    Raises:
        ValueError: `solution` is no `Solution`, a batch, or belongs to another structure; another
            number of names than of cases or phases; errors of `stiffness.buckling_factor` and of
            `energy_balance` if these are asked for; unknown units.

    Example:
        >>> structure, phases = jc.scenes.flat_net(load=15.0)
        >>> print(jc.report(structure, jc.solve(structure, phases)).summary[0])
        status 0: converged

        A beam of 6 m on two supports under 1 kN/m: q L^2 / 8 = 4.5 kN m in the middle:

        >>> section = jc.Section.rectangle(0.1, 0.2, jc.Elastic(10e9))
        >>> ends = jc.restrained([0], "xyz", "x") + jc.restrained([1], "yz")
        >>> beam = jc.Beams([[0, 1]], section=section)
        >>> level = jc.Structure([[0.0, 0.0, 0.0], [6.0, 0.0, 0.0]], beam, supports=ends)
        >>> hung = jc.solve(level, jc.Phase(loads=jc.LineLoads((0.0, 0.0, -1e3))))
        >>> moment = jc.report(level, hung).tables["My"]
        >>> for name, value in zip(moment.columns[6:8], moment.rows[0][6:8]):
        ...     print(name, f"{value:.4g}")
        lowest -4500
        at 0.5

        Work of the prestress and of the loads on four nodes, and the stored energy:

        >>> full = jc.report(structure, jc.solve(structure, phases), phases, energy=True)
        >>> table = full.tables["energy"]
        >>> for name in ("dead", "prestress", "stored", "imbalance"):
        ...     k = table.columns.index(name)
        ...     print(name, *(f"{row[k]:.4f}" for row in table.rows), table.units[k])
        dead 0.0000 0.3576 J
        prestress 0.9779 0.0000 J
        stored 0.9779 0.3574 J
        imbalance 0.0000 0.0003 J
    """
    shown = None if units is None else as_units(units)
    require_single_case(solution)
    require_same_topology(structure, solution.last.topology, "solution")
    own_names = names if cases is None else None
    if isinstance(phases, Mapping) and own_names is None:
        own_names = list(phases)
    listed = _checked_phase_list(phases, solution)
    check_chains(structure, chains)
    balanced = energy is not False and energy is not None
    if balanced and listed is None:
        raise ValueError("energy: the balance needs the phases of the analysis, too: phases=...")
    if combinations is not None:
        names = _check_combinations(combinations, cases, names)
    labels = states.phase_names_or_defaults(solution, own_names)
    ends, failed = states.converged_phases(solution, labels)
    of = states.ReportedAnalysis(structure, solution, ends, None, labels, shown or SI)
    if cases is not None:
        good, failed = states.converged_cases(cases, names)
        of = of._replace(envelope=states.envelope_states_of_cases(good), cases=good)
    heads = [f"phase {k}" for k in range(1, len(labels) + 1)]
    if own_names is not None:
        heads = [f"{head}, {name}" for head, name in zip(heads, labels, strict=True)]
    summary = summary_sentences(structure, solution, heads, failed)
    if has_no_result(solution):
        return _finish_report(solution, summary, {}, shown)
    if buckling is not False and buckling is not None:
        reference = None if buckling is True else buckling
        summary.append(stability.buckling_sentence(structure, solution.last, reference))
    tables = _make_tables(of, chains) | phase_tables(of, ends)
    if since is not None:
        begin = reference_phase(since, labels, solution, cases)
        after = cases is not None and begin_at_end(cases, solution)
        where = reference_words(begin, heads)
        more = displacement_tables_since(of, begin, where, after)
        summary.append(largest_displacement_sentence(more, where, of.units))
        tables = _insert_after("displacements", tables, more)
    if checks is not None:
        summary, tables = _add_checks(summary, tables, checks)
    if combinations is not None:
        summary, tables = _add_combinations(summary, tables, combinations, of, failed)
    if modes is not None:
        tables["modes"] = mode_table(modes)
    if motion is not None:
        tables |= motion_tables(structure, motion)
    if model:
        tables = {**model_tables(structure, listed, labels, shown, of.state), **tables}
    findings = exceeded_strength_sentence(tables["members"]), large_displacement_sentence(of)
    summary += [sentence for sentence in findings if sentence is not None]
    if balanced:
        start = None if energy is True else energy  # not False here
        tables["energy"] = energy_table(of, listed, start, own_names)  # type: ignore[arg-type]
    return _finish_report(solution, summary, tables, shown)


def _make_tables(of, chains):
    """Return the tables of a `Report` on results by name, a dict of `Table`, with notes on cases.

    `of` is the `ReportedAnalysis`, `chains` as for `report`.
    """
    forces = axial_force_table(of)
    tables = {
        **group_tables(forces),
        "reactions": reaction_table(of),
        **reaction_envelope_table(of),
        "equilibrium": equilibrium_table(of),
        "members": forces,
        **displacement_tables(of),
        **rotation_tables(of),
        **tilt_tables(of),
        **sag_tables(of, chains),
        **section_force_tables(of),
        **stress_tables(of),
        "cutting_list": cutting_list_table(of),
        **cable_tables(of),
        **surface_tables(of),
        **slackness_tables(of),
        **element_result_tables(of),
    }
    if of.cases is None:
        return tables
    cases = f"over {len(of.cases)} case" + "s" * (len(of.cases) != 1)
    final = "state at the end of the phases, without loads and factors of the cases"
    notes = {
        **dict.fromkeys(_FINAL, f"of the {final}"),
        **dict.fromkeys(_ENVELOPES, f"envelope {cases}"),
        **dict.fromkeys(
            _BOTH,
            f"with a case beside it, or min. or max.: envelope {cases}; other numbers: {final}",
        ),
    }
    return {
        name: dataclasses.replace(table, notes=(*table.notes, notes[name]))
        if name in notes
        else table
        for name, table in tables.items()
    }


def _add_checks(summary, tables, checks):
    """Return summary and tables of a report with those of checks.

    Raise ValueError unless `checks` are `design.Checks`.
    """
    if not isinstance(checks, Checks):
        kind = arguments.describe_type(checks, "design.checks(structure, solutions)")
        raise ValueError(f"checks: expected the Checks of design.checks, got {kind}")
    summary = [summary[0], *check_sentences(checks), *summary[1:]]  # behind the status
    return summary, {**check_tables(checks), **tables}


def _add_combinations(summary, tables, combinations, of, failed):
    """Return summary and tables of a report with those of combinations of actions.

    Args:
        summary, tables: sentences, and `Table` by name.
        combinations: `Combinations`.
        of: `ReportedAnalysis` of its cases.
        failed: status codes of failed cases by name.
    """
    unstable = [name for name, case in of.cases.items() if not bool(case.stable)]
    named = [table for name, table in tables.items() if name not in _OF_EACH_CASE]
    sums = {name: total_reaction(of.structure, case.last) for name, case in of.cases.items()}
    own = {
        "actions": action_table(combinations, of),
        "combinations": combination_table(combinations, failed, unstable, named, sums),
    }
    return summary + combination_sentences(combinations, failed, unstable), {**own, **tables}


def _check_combinations(combinations, cases, names):
    """Return the names of the cases of `combinations`.

    Raise ValueError unless they are `design.Combinations`, and given with `cases` and without
    `names`.
    """
    if not isinstance(combinations, Combinations):
        kind = arguments.describe_type(combinations, "design.combinations(actions)")
        raise ValueError(f"combinations: expected Combinations, got {kind}")
    if cases is None or names is not None:
        raise ValueError("combinations: come with cases=..., their results, and without names")
    return combinations.names


def _finish_report(solution, summary, tables, units):
    """Return the `Report` of sentences and tables; numbers that are rounding errors become zero.

    Tables are given in SI, and converted to `units` unless these are None.
    """
    tables = tables_without_noise(tables)
    if units is not None:
        tables = {name: table_in_units(table, units) for name, table in tables.items()}
    return Report(int(solution.status), tuple(summary), tables, units)


def _checked_phase_list(phases, solution):
    """Return the phases of an analysis (one, several, a dict) as a list; None stays.

    Raise ValueError for another number of phases than the solution has.
    """
    if phases is None:
        return None
    if isinstance(phases, Mapping):
        phases = list(phases.values())
    phases = list(phases) if isinstance(phases, list | tuple) else [phases]
    if len(phases) != len(solution.phases):
        raise ValueError(
            f"phases: {len(phases)} of them, the solution has {len(solution.phases)}; give "
            "those of this analysis, without those that it was started from"
        )
    return phases


def _insert_after(name, tables, more):
    """Return tables by name with the tables `more` behind the table `name` and its envelope."""
    before = [key for key in tables if key in (name, name.removesuffix("s") + "_envelope")]
    keys = list(tables)
    first = keys[: keys.index(before[-1]) + 1] if before else keys
    return {key: tables[key] for key in first} | more | tables
