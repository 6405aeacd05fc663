"""``optimize``: find the pretension for a limit on deflection or cable force."""

from __future__ import annotations

import sys
import warnings
from argparse import Namespace

import jax
import jax.numpy as jnp
import numpy as np
from jax.flatten_util import ravel_pytree

from .. import design
from ..analysis.solver import solve
from ..common import status
from ..common.checks import InputWarning
from ..common.tree import replace
from ..common.units import SI
from ..files import save_scene
from ..model.result_parts import values_per_group
from ..reporting.load_descriptions import range_text
from . import inputs, outputs
from .combining import combine_actions, solve_combinations
from .guard import BadInput, print_message, refuse_value_errors
from .limits import (
    ROUNDING,
    describe_limits,
    describe_slack_elements,
    tension_margins,
    utilization_bound,
)
from .solving import solve_scene

_WIDTH = 0.02
"""Width of the smooth maximum of deflections, relative to their limit.

The maximum over n nodes is overestimated by at most the width times log n, 9 % for a hundred nodes
that move alike. Half the width halves that, but makes the maximum less smooth.
"""
_NO_PRESTRESS = 1e-9
"""Sum of the pretensions over that of the start below which the optimum has none."""
_NO_BOUNDS = [0.0, np.inf]
"""Default of ``--bounds``: pretensions are then at most the strength, where there is one."""
_SCATTER = 100
"""Ratio of the largest to the smallest pretension of a group from which a hint is given."""
_MEANING = (
    "pretension: the force that a cable would have in the drawn geometry; it fixes the cutting "
    "length, and is not the jacking force"
)
_FROM_DENSITIES = (
    "the scene states force densities: the search began at these times the drawn lengths, and the "
    "pretension replaces them"
)


def run(options: Namespace) -> None:
    """Optimize the pretension of the first phase that has one, print it, and write the scene.

    Without any pretension, the first force densities become one.

    If the search does not converge, or a limit is violated, the best values found are printed with
    the cause, and the exit status is 1; they are written with `options.keep` only. If the analysis
    fails at the start, nothing is written.
    """
    _require_target_or_limits(options)
    outputs.check_output_file(options.save, (".json",), inputs=[options.scene])
    scene = inputs.read_scene(options)
    units, (structure, phases) = scene.units, scene
    combined = None if options.target is not None else combine_actions(options, scene)
    options = _options_in_si(options, units)
    number, name = _find_prestress(options, phases)
    parts = _parametrize_pretension(structure, phases[number], name, options)
    start, strength, pretension_of = parts

    def phases_with(pretension):
        phase = replace(phases[number], **{name: None, "pretension": pretension})
        return [*phases[:number], phase, *phases[number + 1 :]]

    def analyse(parameters):
        stated = phases_with(pretension_of(parameters))
        if combined is None:
            return solve(structure, stated)
        return design.solve_cases(structure, stated, combined)

    shown = units or SI
    start, bounds = _start_within_bounds(start, strength, options.bounds, shown)
    with refuse_value_errors(options.scene):
        if options.target is None:
            found = _minimize_pretension(structure, analyse, pretension_of, start, bounds, options)
        else:
            found, description = _match_target_tension(analyse, start, bounds, options, shown)
        best = jax.tree.map(np.asarray, pretension_of(found.params))
        solution, ends = _solve_with_cases(options, structure, phases_with(best), combined)
    code = int(found.status)
    if code in (status.STATIONARY, status.STALLED) and _target_is_met(found, start, options):
        code = status.OK
    failed = [end for end in ends.values() if int(end.status) != status.OK]
    if failed:  # there is no design: the analysis fails at the start
        if options.save is not None:
            print_message(
                f"{options.save}: not written: the analysis fails with the pretension of the start"
            )
        status.raise_if_failed(failed[0])
    slack_governs = _only_slack_governs(found, structure, options, bounds[1], len(ends))
    limits = describe_limits(structure, ends, options, shown, slack_governs=slack_governs)
    if options.target is None:
        total = float(_sum_of_pretensions(pretension_of(start)))
        description = _describe_sum(found, total, limits, options, shown)
    lines = [
        f"status {code}: {status.describe(code)}",
        f"{description}, {int(found.evaluations)} analyses",
        f"pretension {range_text(_zero_rounding_errors(found.params, start), 'N', units)}",
        _describe_forces(ends, units),
        *limits,
        _describe_movement(structure, solution, number, shown),
        *describe_slack_elements(structure, ends),
        *_describe_scatter(structure, best, options),
        *[_FROM_DENSITIES] * (name == "force_density"),
        _MEANING,
    ]
    good = code == status.OK or options.keep
    violated = code == status.CONSTRAINTS_VIOLATED
    cause = "the limits are violated" if violated else "the search did not converge"
    if options.save is not None and good:
        save_scene(options.save, scene._replace(phases=phases_with(best)))
        ended = "the scene with this pretension"
        if code != status.OK:
            ended += f", the best one found: {cause}"
        lines.append(f"wrote {options.save}: {ended}")
    print("\n".join(lines))
    if options.save is not None and not good:
        sys.stdout.flush()
        print_message(f"{options.save}: not written: {cause}; --keep writes it")
    if code != status.OK:
        status.raise_if_failed(found)


def _solve_with_cases(options, structure, phases, combined):
    """Return the `Solution` of phases, and a dict of the solutions that limits are judged by.

    These are its cases, combined by `combined`, by name in words (" in NAME"); or without
    combinations, and if it has failed, the solution itself by "".
    """
    solution = solve_scene(options, structure, phases)
    if combined is None or int(solution.status) != status.OK:
        return solution, {"": solution}
    cases = solve_combinations(options, structure, phases, combined, None)
    cases = jax.tree.map(np.asarray, cases)
    return solution, {
        f" in {name}": jax.tree.map(lambda x, k=k: x[k], cases)
        for k, name in enumerate(combined.names)
    }


def _describe_forces(ends, units):
    """Return a line on the axial forces of all cases, with their range in `units`.

    `ends` has the `Solution` of each case by its name in words.
    """
    of = "final axial forces" if "" in ends else f"axial forces over {len(ends)} combinations"
    return f"{of} {range_text([end.peak_tension for end in ends.values()], 'N', units)}"


def _start_within_bounds(start, strength, bounds, units):
    """Return the start of a search, [n], N, moved into the bounds, and the bounds, N.

    A warning says if it was moved. `bounds` are those on the command line; if these are the
    default, pretensions are at most the `strength`, [n], N. Raise BadInput if the lower bound is
    above the upper one. `units` are those of texts.
    """
    low, high = bounds
    words = " to ".join(f"{units.from_si(bound, 'N'):g}" for bound in (low, high))
    if not low <= high:
        raise BadInput(f"--bounds {words}: the first is above the second".replace(" to ", " "))
    words += f" {units.force}"
    if bounds == _NO_BOUNDS:
        high, words = strength, "0 and the strength"
    inside = jnp.clip(start, low, high)
    if (inside != start).any():
        text = (
            "the pretension of the scene is outside the bounds; the search starts at the nearest "
            f"values within {words}"
        )
        warnings.warn(text, InputWarning, stacklevel=1)
    return inside, (low, high)


def _require_target_or_limits(options):
    """Raise BadInput unless options state either a target or limits, and nothing of the other."""
    has_limits = (options.deflection, options.lowest) != (None, None)
    if options.target is None and not has_limits:
        raise BadInput("optimize: give --target, or --deflection and/or --lowest")
    if options.target is not None:
        if has_limits:
            raise BadInput("optimize: --target cannot be combined with --deflection or --lowest")
        names = "combinations", "which", "case_increments", "allow_slack"
        inputs.refuse_options_without_effect(options, names, "is for --deflection and --lowest")
    if options.lowest is not None:
        why = "contradicts --lowest, with which all cables are taut"
        inputs.refuse_options_without_effect(options, ("allow_slack",), why)


def _find_prestress(options, phases):
    """Return the index of the phase to optimize, and "pretension" or "force_density".

    It is the first phase with a pretension, or else the first with force densities; BadInput
    without any.
    """
    for name in ("pretension", "force_density"):
        for number, phase in enumerate(phases):
            if getattr(phase, name) is not None:
                return number, name
    raise BadInput(
        f"{options.scene}: no phase has a pretension (or force densities) to optimize; state one "
        'from which the search begins, such as "pretension": 1000.0 in the first phase'
    )


def _parametrize_pretension(structure, phase, name, options):
    """Return start and strength, [n], N, and a function from such vectors to pretensions.

    The start is that of the search, from the field `name` of the phase; the strength is infinite
    where none is stated. Pretensions have the shape of the elements. With `options.same_in_group`
    there is one parameter for each group, otherwise one for each element.
    """
    given = [inputs.get(name) for inputs in phase.inputs(structure)]
    if any(phase_input is not None and phase_input.chosen is not None for phase_input in given):
        raise BadInput(f"{options.scene}: a {name} of only some elements cannot be optimized")
    values = [None if one is None else np.asarray(one.values, float) for one in given]
    if name == "force_density":
        lengths = inputs.element_lengths(structure)
        values = [None if q is None else q * own for q, own in zip(values, lengths, strict=True)]
    strengths = [
        None
        if value is None
        else np.broadcast_to(np.inf if group.strength is None else group.strength, value.shape)
        for value, group in zip(values, structure.groups, strict=True)
    ]
    if options.same_in_group:
        values = [None if value is None else value.mean(keepdims=True) for value in values]
        strengths = [None if value is None else value.min(keepdims=True) for value in strengths]
    start, by_group = ravel_pytree(values)

    def pretension_of(parameters):
        parts = zip(by_group(parameters), structure.groups, strict=True)
        return structure.arrange(
            [
                None if own is None else jnp.broadcast_to(own, (len(of.links), *own.shape[1:]))
                for own, of in parts
            ]
        )

    return start, ravel_pytree(strengths)[0], pretension_of


def _options_in_si(options, units):
    """Return options with forces and lengths converted from `units` (None: SI) to N and m."""
    if units is None:
        return options
    given = {"target": "N", "deflection": "m", "lowest": "N"}
    found = {
        name: value if (value := getattr(options, name)) is None else units.to_si(value, unit)
        for name, unit in given.items()
    }
    bounds = [units.to_si(bound, "N") for bound in options.bounds]
    return Namespace(**{**vars(options), **found, "bounds": bounds})


def _match_target_tension(analyse, start, bounds, options, units):
    """Find the pretension with which the final tensions are nearest to `options.target`.

    Args:
        analyse: function from parameters to a `Solution`.
        start: parameters at the start, [n], N.
        bounds: smallest and largest parameter, N.
        options: options of the command, in SI units.
        units: `Units` of texts.

    Returns:
        The `Design` found, and the outcome in words.
    """

    def loss(parameters):
        solution = analyse(parameters)
        return design.tension_distance(solution, options.target), solution

    found = design.minimize(loss, start, bounds, steps=options.steps, progress=not options.quiet)
    n = sum(v.size for v in jax.tree.leaves(jax.eval_shape(analyse, start).tension))
    distance = float(np.sqrt(float(found.loss) / n))
    target, distance = units.text(options.target, "N", "g"), units.text(distance, "N")
    return found, f"root mean square distance from {target}: {distance}"


def _target_is_met(found, start, options):
    """Return whether the tensions of the `Design` `found` equal `options.target` up to rounding."""
    if options.target is None:
        return False
    return float(found.loss) <= start.size * (ROUNDING * options.target) ** 2


def _sum_of_pretensions(pretension):
    """Return the sum of the pretensions of all elements, given in the shape of the elements, N."""
    return sum(jnp.sum(one) for one in jax.tree.leaves(pretension))


def _minimize_pretension(structure, analyse, pretension_of, start, bounds, options):
    """Find the smallest sum of pretensions that keeps deflections and tensions within limits.

    The limits are `options.deflection`, m, `options.lowest`, N, and the strength, in all cases.
    `pretension_of` maps parameters to pretensions, N, in the shape of the elements; other arguments
    are those of `_match_target_tension`. Return the `Design`.
    """

    def excess(solution):
        parts = []
        if options.deflection is not None:
            bound = design.largest_deflection(solution, _WIDTH * options.deflection)
            parts.append(jnp.atleast_1d(bound / options.deflection - 1.0))
        if not options.allow_slack:
            parts += [-margin for margin in tension_margins(structure, solution, options.lowest)]
        parts += [jnp.atleast_1d(used - 1.0) for used in utilization_bound(structure, solution)]
        return jnp.concatenate(parts)

    def problem(parameters):
        solution = analyse(parameters)
        several = jnp.ndim(solution.status) > 0
        broken = jax.vmap(excess)(solution) if several else excess(solution)
        return _sum_of_pretensions(pretension_of(parameters)), jnp.ravel(broken), solution

    return design.minimize_subject_to(
        problem, start, bounds, steps=options.steps, progress=not options.quiet
    )


def _only_slack_governs(found, structure, options, upper, n_case):
    """Return whether a search has converged where only limits on slack are active.

    The multipliers of `found`, in each of the `n_case` cases, are in the order of
    `_minimize_pretension`. `upper` are the largest pretensions, N: one that is reached governs,
    too.
    """
    stated = options.target, options.lowest
    if stated != (None, None) or options.allow_slack or int(found.status) != status.OK:
        return False
    if bool((found.params >= (1 - ROUNDING) * upper).any()):
        return False
    multipliers = np.asarray(found.multipliers).reshape(n_case, -1)
    first = 0 if options.deflection is None else 1
    count = sum(len(group.links) for group in structure.groups if group.tension_only)
    slack, total = multipliers[:, first : first + count].sum(), multipliers.sum()
    return slack > 0 and total - slack <= ROUNDING * total


def _describe_scatter(structure, pretension, options):
    """Return a line if pretensions differ by more than 100 times within a group, in a list, or [].

    `pretension` has [n_elem], N, by group in the shape of the elements.
    """
    groups = [one for one in values_per_group(structure, pretension) if one is not None]
    if options.same_in_group or all(one.max() <= _SCATTER * one.min() for one in groups):
        return []
    text = f"pretensions within a group differ by a factor of more than {_SCATTER}"
    return [f"{text}: --same-in-group gives all elements of a group the same"]


def _describe_sum(found, total, limits, options, units):
    """Return the sum of the pretensions of a `Design`, or that there are none, as text.

    `total` is the sum at the start, N, and `limits` are the lines of `describe_limits`.
    """
    words = f"sum of the pretensions {units.text(found.loss, 'N')}"
    if float(found.loss) <= _NO_PRESTRESS * total:
        words = "no pretension is needed: the limits below are met without any"
        if any("violated" in line for line in limits):
            words = "the best design found has no pretension"
    if options.details:
        words += f", optimality residual (KKT) {found.kkt_residual:.1e}"
    return words


def _zero_rounding_errors(pretension, start):
    """Return pretensions, [n], N, with zeros for those below 1e-9 of the largest of the start."""
    pretension = np.asarray(pretension, float)
    return np.where(np.abs(pretension) <= _NO_PRESTRESS * np.abs(start).max(), 0.0, pretension)


def _describe_movement(structure, solution, number, units):
    """Return a line on the largest displacement in phase `number`, which has the pretension."""
    phase = solution.phases[number]
    moved = phase.displacement_in_phase, phase.present
    _, where = inputs.largest_displacement(structure, *moved, units)
    return f"the pretension moves the form in phase {number + 1} by up to {where}"
