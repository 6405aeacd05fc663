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
from ..model.result_parts import (
    named_groups_of,
    present_elements,
    slack_elements,
    values_per_group,
)
from ..reporting.load_descriptions import range_text
from . import inputs, outputs
from .guard import BadInput, print_message, refuse_value_errors
from .solving import solve_scene

_WIDTH = 0.02
"""Width of the smooth maximum of deflections, relative to their limit.

The maximum over n nodes is overestimated by at most the width times log n, 9 % for a hundred nodes
that move alike. Half the width halves that, but makes the maximum less smooth.
"""
_ROUNDING = 1e-9  # relative to a limit: two analyses of the same numbers differ by less
_NO_PRESTRESS = 1e-9
"""Sum of the pretensions over that of the start below which the optimum has none."""
_MOST_NAMED = 12
"""Largest number of slack elements of a group that are named."""
_MEANING = (
    "pretension: the force that a cable would have in the drawn geometry; it fixes the cutting "
    "length, and is not the jacking force"
)


def run(options: Namespace) -> None:
    """Optimize the pretension of the first phase that has one, print it, and write the scene.

    If the search does not converge, or a limit is violated, the best values found are printed with
    the cause, and the exit status is 1; they are written with `options.keep` only. If the analysis
    fails at the start, nothing is written.
    """
    if (options.deflection, options.lowest) == (None, None):
        if options.target is None:
            raise BadInput("optimize: give --target, or --deflection and/or --lowest")
    elif options.target is not None:
        raise BadInput("optimize: --target cannot be combined with --deflection or --lowest")
    outputs.check_output_file(options.save, (".json",), inputs=[options.scene])
    scene = inputs.read_scene(options)
    units, (structure, phases) = scene.units, scene
    options = _options_in_si(options, units)
    number = next((k for k, p in enumerate(phases) if p.pretension is not None), None)
    if number is None:
        raise BadInput(f"{options.scene}: no phase has a pretension to optimize")
    start, pretension_of = _parametrize_pretension(structure, phases[number], options)

    def phases_with(pretension):
        phase = replace(phases[number], pretension=pretension)
        return [*phases[:number], phase, *phases[number + 1 :]]

    def analyse(parameters):
        return solve(structure, phases_with(pretension_of(parameters)))

    low, high = options.bounds
    shown = units or SI
    bounds = " to ".join(f"{shown.from_si(bound, 'N'):g}" for bound in options.bounds)
    if not low <= high:
        raise BadInput(f"--bounds {bounds}: the first is above the second".replace(" to ", " "))
    inside = jnp.clip(start, low, high)
    if (inside != start).any():
        text = (
            "the pretension of the scene is outside the bounds; the search starts at the nearest "
            f"values within {bounds} {shown.force}"
        )
        warnings.warn(text, InputWarning, stacklevel=1)
    start = inside
    with refuse_value_errors(options.scene):
        if options.target is None:
            found = _minimize_pretension(analyse, start, (low, high), options)
        else:
            found, description = _match_target_tension(analyse, start, (low, high), options, shown)
        solution = solve_scene(options, structure, phases_with(pretension_of(found.params)))
    code = int(found.status)
    if code in (status.STATIONARY, status.STALLED) and _target_is_met(found, start, options):
        code = status.OK
    if int(solution.status) != status.OK:  # there is no design: the analysis fails at the start
        if options.save is not None:
            print_message(
                f"{options.save}: not written: the analysis fails with the pretension of the start"
            )
        status.raise_if_failed(solution)
    limits = _describe_limits(solution, options, shown)
    if options.target is None:
        description = _describe_sum(found, start, limits, options, shown)
    lines = [
        f"status {code}: {status.describe(code)}",
        f"{description}, {int(found.evaluations)} analyses",
        f"pretension {range_text(_zero_rounding_errors(found.params, start), 'N', units)}",
        f"final axial forces {range_text(solution.last.peak_tension, 'N', units)}",
        *limits,
        _describe_movement(solution, number, shown),
        *_describe_slack_elements(structure, solution),
        *_describe_exceeded_strength(structure, solution),
        _MEANING,
    ]
    good = code == status.OK or options.keep
    violated = code == status.CONSTRAINTS_VIOLATED
    cause = "the limits are violated" if violated else "the search did not converge"
    if options.save is not None and good:
        best = jax.tree.map(np.asarray, pretension_of(found.params))
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


def _parametrize_pretension(structure, phase, options):
    """Return the start of the search, [n], N, and a function from such vectors to pretensions.

    Pretensions have the shape of the elements. With `options.same_in_group` there is one parameter
    for each group, otherwise one for each element.
    """
    given = [statements.get("pretension") for statements in phase.statements(structure)]
    if any(statement is not None and statement.chosen is not None for statement in given):
        raise BadInput(f"{options.scene}: a pretension of only some elements cannot be optimized")
    values = [None if one is None else np.asarray(one.values, float) for one in given]
    if options.same_in_group:
        values = [None if value is None else value.mean(keepdims=True) for value in values]
    start, by_group = ravel_pytree(values)

    def pretension_of(parameters):
        parts = zip(by_group(parameters), structure.groups, strict=True)
        return structure.arrange(
            [
                None if own is None else jnp.broadcast_to(own, (len(of.links), *own.shape[1:]))
                for own, of in parts
            ]
        )

    return start, pretension_of


def _options_in_si(options, units):
    """Return options whose forces and lengths, in the `units` of the scene, are in N and m."""
    if units is None:
        return options
    given = {"target": "N", "deflection": "m", "lowest": "N"}
    found = {
        name: value if (value := getattr(options, name)) is None else units.to_si(value, unit)
        for name, unit in given.items()
    }
    bounds = tuple(units.to_si(bound, "N") for bound in options.bounds)
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
    """Return whether the tensions equal the target up to rounding, so that no search can go on."""
    if options.target is None:
        return False
    return float(found.loss) <= start.size * (_ROUNDING * options.target) ** 2


def _minimize_pretension(analyse, start, bounds, options):
    """Find the smallest sum of pretensions that keeps deflections and tensions within limits.

    The limits are `options.deflection`, m, and `options.lowest`, N. Other arguments are those of
    `_match_target_tension`. Return the `Design` found.
    """
    limits = options.deflection, options.lowest

    def problem(parameters):
        solution = analyse(parameters)
        broken = []
        if limits[0] is not None:
            deflection = design.largest_deflection(solution, _WIDTH * limits[0])
            broken.append(jnp.atleast_1d(deflection / limits[0] - 1.0))
        if limits[1] is not None:
            forces = jnp.concatenate([jnp.ravel(v) for v in jax.tree.leaves(solution.tension)])
            broken.append(1.0 - forces / limits[1])
        return jnp.sum(parameters), jnp.concatenate(broken), solution

    return design.minimize_subject_to(
        problem, start, bounds, steps=options.steps, progress=not options.quiet
    )


def _describe_sum(found, start, limits, options, units):
    """Return the sum of the pretensions of a `Design`, or that there are none, as text.

    `start` has those at the start, [n], N, and `limits` the lines of `_describe_limits`.
    """
    words = f"sum of the pretensions {units.text(found.loss, 'N')}"
    if float(found.loss) <= _NO_PRESTRESS * float(jnp.abs(start).sum()):
        words = "no pretension is needed: the limits below are met without any"
        if any("violated" in line for line in limits):
            words = "the best design found has no pretension"
    if options.details:
        words += f", optimality residual (KKT) {found.kkt_residual:.1e}"
    return words


def _describe_limits(solution, options, units):
    """Return lines on the largest displacement, and on each limit: met, or violated by how much.

    Numbers are in `units`.
    """
    reached, where = inputs.largest_displacement(solution.phases[-1].displacement_in_phase, units)
    if options.deflection is None:
        lines = [f"largest displacement of the last phase {where}"]
    else:
        limit = units.text(options.deflection, "m")
        limit = f"limit on displacements of the last phase: {limit}"
        verdict = _limit_verdict(reached / options.deflection - 1.0)
        lines = [f"{limit}, reached {where}: {verdict}"]
    if options.lowest is not None:
        forces = np.concatenate(
            [np.ravel(np.asarray(v, float)) for v in jax.tree.leaves(solution.tension)]
        )
        reached = float(forces.min())
        limit = f"limit on the lowest tension at the end: {units.text(options.lowest, 'N')}"
        words = _limit_verdict(1.0 - reached / options.lowest)
        lines.append(f"{limit}, reached {units.text(reached, 'N')}: {words}")
    return lines


def _zero_rounding_errors(pretension, start):
    """Return pretensions, [n], N, with zero for those that are rounding errors beside the start."""
    pretension = np.asarray(pretension, float)
    return np.where(np.abs(pretension) <= _NO_PRESTRESS * np.abs(start).max(), 0.0, pretension)


def _describe_movement(solution, number, units):
    """Return a line on how far phase `number`, which has the pretension, moves the drawn form."""
    moved = solution.phases[number].displacement_in_phase
    _, where = inputs.largest_displacement(moved, units)
    return f"the pretension moves the form in phase {number + 1} by up to {where}"


def _describe_slack_elements(structure, solution):
    """Return lines on the slack elements of each group at the end of all phases."""
    parts = (
        named_groups_of(structure),
        values_per_group(structure, solution.tension),
        present_elements(structure, solution.present),
    )
    lines = []
    for (name, group), force, present in zip(*parts, strict=True):
        slack = np.flatnonzero(slack_elements(group, force, present))
        if len(slack):
            shown = [*map(str, slack[:_MOST_NAMED]), *["..."] * (len(slack) > _MOST_NAMED)]
            where = f" of {name!r}" if name else ""
            lines.append(
                f"SLACK at the end: {len(slack)} of {len(group.links)} elements{where}: "
                f"{', '.join(shown)}"
            )
    return lines


def _describe_exceeded_strength(structure, solution):
    """Return a line on elements above their strength in the final state, in a list; or []."""
    try:
        used = design.utilization(structure, solution.last)
    except ValueError:  # no group has a strength
        return []
    ratios = [np.ravel(np.asarray(ratio, float)) for ratio in jax.tree.leaves(used)]
    over = np.concatenate([ratio[ratio > 1.0] for ratio in ratios])
    if not len(over):
        return []
    count = "1 element" if len(over) == 1 else f"{len(over)} elements"
    most = f"up to {over.max():.3g} times of it"
    return [f"STRENGTH EXCEEDED: {count} above the breaking force: {most}"]


def _limit_verdict(excess):
    """Return "met" or "violated by 4.9 %"; `excess` is the excess over the limit, divided by it."""
    return "met" if excess <= _ROUNDING else f"violated by {100 * excess:.2g} %"
