"""Combinations of the actions of a scene, and the checks that the scene states."""

from __future__ import annotations

import operator
import time
from argparse import Namespace
from collections.abc import Sequence
from dataclasses import replace

import jax
import numpy as np

from ..analysis.phases import Phase
from ..analysis.solution import Solution
from ..common import status
from ..common.tree import copy_with
from ..common.units import Units
from ..design import checks, combination_rules, combinations, solve_cases
from ..design.check import Check
from ..design.checks import Checks
from ..design.combinations import Combinations
from ..design.member_buckling import MemberBuckling
from ..equilibrium.incremental import Incremental
from ..equilibrium.newton import Newton
from ..model.structure import Structure
from ..reporting.load_descriptions import range_text
from ..scenes import Scene
from . import inputs
from .guard import BadInput, print_message, refuse_value_errors
from .solving import is_long_analysis

_NAMED = 8
"""Failed combinations that a message names."""


def combine_actions(options: Namespace, scene: Scene) -> Combinations | None:
    """Return the combinations that options or a scene ask for, of its actions; None for none.

    A command without options for combinations asks for those of the scene.

    Raises:
        BadInput: the scene has no actions, or the rules cannot combine them.
    """
    names = ("combinations", "which", "case_increments")
    options = Namespace(**dict.fromkeys(names) | vars(options))
    standard = options.combinations or scene.combination_rules
    if standard is None:
        why = "is for combinations: give --combinations RULES, too"
        inputs.refuse_options_without_effect(options, ("which", "case_increments"), why)
        return None
    if not scene.actions:
        raise BadInput(
            f'{options.scene}: has no actions to combine; list them beside the phases: "actions": '
            '[{"name": "snow", "kind": "snow", "loads": ...}]'
        )
    with refuse_value_errors("--combinations"):
        rules = combination_rules(standard)
    with refuse_value_errors(options.scene):
        increments = options.case_increments or 1
        found = combinations(scene.actions, rules, which=options.which, increments=increments)
        # errors of actions that cannot have their factors come before long work
        return found if found.cases is not None else None


def solve_combinations(
    options: Namespace,
    structure: Structure,
    phases: Sequence[Phase],
    found: Combinations,
    method: Newton | Incremental | None,
) -> Solution:
    """Analyse all combinations as one batch; say on stderr that a long analysis runs.

    Args:
        options: options of the command.
        structure, phases: those of the scene, in which cases begin.
        found: the `Combinations`.
        method: method of the analysis, None for the default.

    Returns:
        `Solution` with a leading axis of cases.
    """
    increments = sum(phase.increments for phase in phases) + len(found) * found.increments
    long = is_long_analysis(options, structure, increments)
    begin = time.monotonic()
    if long:
        print_message(f"analyzing {len(found)} combinations as one batch")
    solutions = solve_cases(structure, phases, found, method)
    jax.block_until_ready(solutions.status)
    if long:
        print_message(f"{len(found)} combinations took {time.monotonic() - begin:.0f} s")
    return solutions


def make_checks(
    scene: Scene,
    solution: Solution,
    cases: Solution | None,
    found: Combinations | None,
    chosen: Sequence[str] | None,
) -> Checks | None:
    """Make the checks of a scene; None if it has none, or if the analysis failed.

    They are made for all combinations, or without them (None) for the end of the phases. Where
    `chosen` (the option --which) leaves combinations out, checks for which none is left are not
    made, and `Checks.not_made` names them; None if these are all.
    """
    if not scene.checks or int(solution.status) != status.OK:
        return None
    if cases is not None:
        rules = [  # the last phase of a case begins at the end of the phases
            replace(one, reference=solution)
            if isinstance(one, MemberBuckling) and isinstance(one.reference, str)
            else one
            for one in scene.checks
        ]
        assert found is not None  # with their results
        there = {*found.limit_states, *found.rules}
        own = [one for one in rules if chosen and isinstance(one, Check)]  # not those of standards
        idle = {one.name: one.of for one in own if one.of and not there & {*one.of}}
        rules = [one for one in rules if isinstance(one, str) or one.name not in idle]
        if not rules:
            return None
        made = checks(scene.structure, cases, rules, combinations=found)
        words = [f"{name}, without {' or '.join(of)}" for name, of in idle.items()]
        return copy_with(made, not_made=(*made.not_made, *words))
    last = len(solution.phases)
    name = f"phase {last}" if scene.phase_names is None else scene.phase_names[-1]
    return checks(scene.structure, solution, scene.checks, names=[name])


def describe_largest_values_of_cases(
    structure: Structure,
    solutions: Solution,
    found: Combinations,
    units: Units | None,
    begin: Solution,
) -> list[str]:
    """Return lines on the largest displacements and the axial forces over all converged cases.

    Displacements are from the start, and from the end of the phases, `begin`. Numbers are in
    `units`, None for SI.
    """
    good = np.flatnonzero(np.asarray(solutions.status) == status.OK)
    if not len(good):
        return []
    lines = []
    for name, moved in (
        ("from the start", solutions.displacement),
        ("from the end of the phases", solutions.displacement - begin.displacement[None]),
    ):
        largest = {}
        for k in good:
            present = jax.tree.map(operator.itemgetter(k), solutions.present)
            largest[k] = inputs.largest_displacement(structure, moved[k], present, units)
        case = max(largest, key=lambda k: largest[k][0])
        where = f"{largest[case][1]} in {found.names[case]}"
        lines.append(f"largest displacement over the combinations {name}: {where}")
    forces = [np.asarray(x)[good] for x in jax.tree.leaves(solutions.peak_tension)]
    if forces:
        text = range_text(forces, "N", units)
        lines.append(f"axial forces over the combinations: {text}")
    return lines


def report_failed_combinations(
    options: Namespace, solutions: Solution, found: Combinations
) -> bool:
    """Print the names of the combinations that have failed; return whether there are any."""
    codes = np.asarray(solutions.status)
    failed = np.flatnonzero(codes != status.OK)
    if not len(failed):
        return False
    for code in np.unique(codes[failed]):
        own = [found.names[k] for k in failed if codes[k] == code]
        more = f" and {len(own) - _NAMED} more" if len(own) > _NAMED else ""
        print_message(
            f"{options.scene}: {len(own)} of {len(found)} combinations failed: "
            f"{', '.join(own[:_NAMED])}{more}: status {code}: {status.describe(int(code))}"
        )
    return True
