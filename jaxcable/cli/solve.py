"""``solve``: analyse a scene through its phases."""

from __future__ import annotations

import sys
from argparse import Namespace
from dataclasses import replace
from pathlib import Path
from typing import Any

from ..analysis.solution import Solution
from ..common import status
from ..common.units import Units
from ..equilibrium.incremental import Incremental
from ..equilibrium.newton import Newton
from ..files.opensees import require_exportable
from ..model.structure import Structure
from ..reporting import report
from ..reporting.load_descriptions import range_text
from ..reporting.result_report import require_writer
from ..results.reference_phase import LAST_PHASE
from . import file_names, inputs, outputs
from .combining import (
    combine_actions,
    describe_largest_values_of_cases,
    make_checks,
    report_failed_combinations,
    solve_combinations,
)
from .guard import (
    FAILED,
    NOT_PASSED,
    BadInput,
    print_message,
    refuse_value_errors,
    require_writable,
)
from .solving import solve_scene

_STAGED = "energy check not available with construction stages (adds, removes)"


def run(options: Namespace) -> int | None:
    """Analyse the scene in `options.scene`, print a summary and write the files that options name.

    Return exit status 1 if an analysis fails, 3 if checks are not passed, else None.
    """
    for path in options.save:
        outputs.check_suffix(path, outputs.RESULTS, "--save")
    outputs.check_suffix(options.plot, outputs.PICTURES, "--plot")
    report_paths = [path for path in options.report if path != "-"]
    for path in report_paths:
        outputs.check_suffix(path, outputs.REPORTS, "--report")
        with refuse_value_errors("--report"):
            require_writer(path)
    paths: list[tuple[str, Any]] = [(path, file_names.RESULT) for path in options.save]
    paths += [(path, file_names.REPORT) for path in report_paths]
    files = [file for pair in paths for file in file_names.files_to_write(*pair)]
    require_writable(options.plot, *files, inputs=[options.scene])
    scene = inputs.read_scene(options)
    units, (structure, phases) = inputs.shown_units(options, scene), scene
    since = _phase_since(options, scene)
    combinations = combine_actions(options, scene)
    method = _choose_method(options)
    with refuse_value_errors(options.scene):
        if any(path.lower().endswith(".py") for path in options.save):
            require_exportable(structure)
        solution = solve_scene(options, structure, phases, method)
        cases = None
        if int(solution.status) != status.OK:
            combinations = None
        elif combinations is not None:
            cases = solve_combinations(options, structure, phases, combinations, method)
        checks = make_checks(scene, solution, cases, combinations, options.which)
        # energies take time: they are computed for a report only
        staged = any(phase.adds is not None or phase.removes is not None for phase in phases)
        energy = bool(options.report) and not staged
        names = scene.phase_names
        findings = report(
            structure,
            solution,
            phases if names is None else dict(zip(names, phases, strict=True)),
            energy=energy,
            units=units,
            since=since,
            model=bool(report_paths),  # for the screen there is `info`
            checks=checks,
            cases=cases,
            combinations=combinations,
        )
    notes = [_STAGED] if options.report and staged else []
    if scene.checks and checks is None:
        failed = int(solution.status) != status.OK
        why = "the analysis failed" if failed else "no combination of --which counts for a check"
        notes.append(f"NOT CHECKED, because {why}")
    findings = replace(findings, summary=(*findings.summary, *notes))
    # before anything is printed, because the reader of a pipe may end
    wrote = _write_files(options, scene, solution, findings, cases, combinations, since)
    findings = replace(findings, summary=_summary_without_cause(findings.summary, solution))
    print(findings.text() if "-" in options.report else "\n".join(findings.summary))
    largest = [] if checks is None else str(checks).splitlines()
    largest += describe_largest_values(structure, solution, units)
    if combinations is not None and cases is not None:
        largest += describe_largest_values_of_cases(structure, cases, combinations, units, solution)
    print("\n".join([*largest, *(f"wrote {path}" for path in wrote)]))
    if (
        combinations is not None
        and cases is not None
        and report_failed_combinations(options, cases, combinations)
    ):
        return FAILED
    if checks is not None and (checks.unstable or not checks.passed):
        sys.stdout.flush()
        print_message(f"{options.scene}: checks are not passed")
        return NOT_PASSED
    return outputs.report_failure(options, solution)


def _write_files(options, scene, solution, findings, cases, combinations, since):
    """Write report, results and picture to the files that options name; return their paths.

    `scene` is the `Scene`, `findings` the `Report`; `cases` and `combinations` are None without
    combinations; `since` is that of `report`.
    """
    wrote = []
    for path in options.report:
        if path == "-":
            continue
        wrote += findings.save(
            path,
            pictures=_pictures_for_report(
                path, scene, solution, findings, cases, combinations, since
            ),
            title=options.title or Path(options.scene).stem,
            author=options.author,
            date=options.date,
        )
    for path in options.save:
        wrote += outputs.save_solution(path, scene.structure, solution, findings.units)
    if options.plot is not None:
        if int(solution.status) == status.OK:
            from .. import plots  # slow to import: matplotlib

            names, units = scene.phase_names, findings.units
            figure = plots.net(solution, structure=scene.structure, names=names, units=units)
            outputs.save_picture(figure, options.plot)
            wrote.append(options.plot)
        else:
            print_message(f"{options.plot}: not drawn: the analysis failed")
    return wrote


def _pictures_for_report(path, scene, solution, findings, cases, combinations, since):
    """Return the pictures of a report by their captions; None for formats without pictures.

    `path` is that of the report, `scene` the `Scene`, `findings` the `Report`; `cases` and
    `combinations` may be None; `since` is that of `report`.
    """
    if not path.lower().endswith((".pdf", *outputs.PAGES)):
        return None
    from .. import plots  # slow to import: matplotlib

    names = None if combinations is None else combinations.names
    known = {"names": names, "phase_names": scene.phase_names, "units": findings.units}
    return plots.for_report(scene.structure, solution, cases=cases, since=since, **known)


def _phase_since(options, scene):
    """Return the option --since as `report` takes it: an index from 0, a name, or None.

    Raise BadInput if the `scene` has no such phase.
    """
    since, names = options.since, [*(scene.phase_names or ()), LAST_PHASE]
    if since is None or since in names:
        return since
    count = len(scene.phases)
    if not since.isdecimal() or not 1 <= int(since) <= count:
        named = ", ".join(map(repr, names))
        raise BadInput(f"--since: {since!r} is no phase; give 1 to {count}, or one of {named}")
    return int(since) - 1


def _choose_method(options):
    """Return the method that options ask for: `Incremental` with corrections, or `Newton`."""
    if options.corrections is not None:
        return Incremental(options.corrections, linear_solver=options.linear_solver)
    return Newton(tol=options.tol, linear_solver=options.linear_solver)


def _summary_without_cause(summary, solution):
    """Return the summary of a report; of a failed analysis without the cause, which stderr gets."""
    code = int(solution.status)
    if code == status.OK:
        return summary
    failed = [k for k, p in enumerate(solution.phases, 1) if int(p.status) != status.OK]
    return (f"status {code}: the analysis failed in phase {failed[0]}", *summary[1:])


def describe_largest_values(
    structure: Structure, solution: Solution, units: Units | None = None
) -> list[str]:
    """Return lines on the largest displacements, of the last phase and of all, and axial forces.

    Numbers are in `units`, None for SI.
    """
    if int(solution.status) != status.OK:
        return []
    last = len(solution.phases)
    parts = {"from the start": solution.displacement}
    if last > 1:
        total = f"from the start (phases 1 to {last})"
        alone = solution.phases[-1].displacement_in_phase
        parts = {f"in phase {last} alone": alone, total: solution.displacement}
    known = solution.present, units
    found = {k: inputs.largest_displacement(structure, x, *known)[1] for k, x in parts.items()}
    moved = [f"largest displacement {name}: {text}" for name, text in found.items()]
    forces = range_text(solution.peak_tension, "N", units)
    return [*moved, f"final axial forces: {forces}"]
