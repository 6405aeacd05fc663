"""``solve``: analyse a scene through its phases."""

from __future__ import annotations

from argparse import Namespace
from dataclasses import replace
from typing import Any

from .. import plots
from ..analysis import solver
from ..analysis.solution import Solution
from ..common import status
from ..equilibrium.incremental import Incremental
from ..equilibrium.newton import Newton
from ..files.opensees import require_exportable
from ..reporting import report
from . import derived, inputs, outputs
from .guard import refusing, require_writable, say

_STAGED = "no balance of work and energy: elements come or go"


def run(options: Namespace) -> int | None:
    """Analyse the scene that `options` name; returns the exit status, 1 if the analysis fails."""
    for path in options.save:
        outputs.check_suffix(path, outputs.RESULTS, "--save")
    outputs.check_suffix(options.plot, outputs.PICTURES, "--plot")
    if options.report not in (None, "-"):
        outputs.check_suffix(options.report, outputs.REPORTS, "--report")
    report_path = None if options.report == "-" else options.report
    results = [file for path in options.save for file in derived.files(path, derived.RESULT)]
    reports = derived.files(report_path, derived.REPORT)
    require_writable(options.plot, *results, *reports, inputs=[options.scene])
    structure, phases = inputs.scene(options)
    with refusing(options.scene):
        if any(path.lower().endswith(".py") for path in options.save):
            require_exportable(structure)
        solution = solver.solve(structure, phases, _method(options), progress=not options.quiet)
        # energies take time: they are computed for a report only
        staged = any(phase.adds is not None or phase.removes is not None for phase in phases)
        energy = options.report is not None and not staged
        findings = report(structure, solution, phases, energy=energy)
    if options.report is not None and staged:
        findings = replace(findings, summary=(*findings.summary, _STAGED))
    wrote = _write(options, structure, solution, findings)  # before printing: the reader may end
    print(findings.text() if options.report == "-" else "\n".join(findings.summary))
    print("\n".join([*highlights(solution), *(f"wrote {path}" for path in wrote)]))
    return outputs.ended(options.scene, solution)


def _write(options, structure, solution, findings):
    """Write the files that the options ask for; returns their paths."""
    wrote = [] if options.report in (None, "-") else findings.save(options.report)
    for path in options.save:
        wrote += outputs.result(path, structure, solution)
    if options.plot is not None:
        if int(solution.status) == status.OK:
            outputs.picture(plots.net(solution, structure=structure), options.plot)
            wrote.append(options.plot)
        else:
            say(f"{options.plot}: not drawn: the analysis failed")
    return wrote


def _method(options):
    """The method of analysis that the options ask for."""
    if options.corrections is not None:
        return Incremental(options.corrections, linear_solver=options.linear_solver)
    return Newton(tol=options.tol, linear_solver=options.linear_solver)


def highlights(solution: Solution) -> list[str]:
    """Lines of text with the largest displacements, since the last phase began and in all."""
    if int(solution.status) != status.OK:
        return []
    parts: dict[str, Any] = {"in phase 1": solution}
    if len(solution.phases) > 1:
        last = f"in phase {len(solution.phases)}"
        parts = {last: solution.phases[-1], "in all phases": solution}
    moved = [
        f"largest displacement {name}: {inputs.farthest(part.displacement)[1]}"
        for name, part in parts.items()
    ]
    return [*moved, f"forces: {inputs.spread(solution.peak_tension)} N"]
