"""``solve``: analyse a scene, tell what came out, write results."""

import sys

import jax
import numpy as np

from .. import plots, solver, status
from ..equilibrium import Newton
from ..incremental import Incremental
from ..reports import report
from . import inputs, outputs
from .guard import FAILED, Refused, require_writable, say


def run(options):
    """Analyse the scene of `options`; the exit status is 1 if the analysis fails."""
    for path in options.save:
        outputs.check_suffix(path, outputs.RESULTS, "--save")
    outputs.check_suffix(options.plot, outputs.PICTURES, "--plot")
    if options.report not in (None, "-"):
        outputs.check_suffix(options.report, outputs.REPORTS, "--report")
    require_writable(options.plot, *options.save, None if options.report == "-" else options.report)
    structure, phases = inputs.scene(options)
    try:
        solution = solver.solve(structure, phases, _method(options), progress=not options.quiet)
    except ValueError as error:
        raise Refused(f"{options.scene}: {error}") from None
    jax.block_until_ready(solution)
    told = report(structure, solution, phases)
    if options.report == "-":
        print(told.text())
    elif not options.quiet:
        print("\n".join(told.summary))
    if not options.quiet:
        for line in highlights(solution):
            print(line)
    if options.report not in (None, "-"):
        _wrote(told.save(options.report), options)
    for path in options.save:
        _wrote(outputs.result(path, structure, solution), options)
    code = int(solution.status)
    if options.plot is not None:
        if code == status.OK:
            outputs.picture(plots.net(solution, structure=structure), options.plot)
            _wrote([options.plot], options)
        else:
            say(f"{options.plot}: not drawn: the analysis failed")
    if code != status.OK:
        sys.stdout.flush()
        try:
            status.raise_if_failed(solution)
        except status.AnalysisError as error:
            say(f"{options.scene}: {error}")
        return FAILED


def _method(options):
    """The method that the options name."""
    if options.corrections is not None:
        return Incremental(options.corrections, linear_solver=options.linear_solver)
    return Newton(tol=options.tol, linear_solver=options.linear_solver)


def highlights(solution):
    """Lines with the largest displacement of the last phase and the range of forces."""
    if int(solution.status) != status.OK:
        return []
    moved = np.linalg.norm(np.asarray(solution.phases[-1].displacement), axis=1)
    node = int(moved.argmax())
    where = f"{inputs.short(float(moved[node]))} m at node {node}"
    name = "in phase 1" if len(solution.phases) == 1 else f"in phase {len(solution.phases)}"
    return [
        f"largest displacement {name}: {where}",
        f"forces: {inputs.spread(solution.tension)} N",
    ]


def _wrote(paths, options):
    if not options.quiet:
        for path in paths:
            print(f"wrote {path}")
