"""``optimize``: find the pretension for a purpose, with gradients through all phases."""

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
from ..files import save_scene
from ..scenes import Scene
from . import inputs, outputs
from .guard import Refused, refusing, say

_WIDTH = 0.02  # width of the smooth maximum of deflections, relative to their limit
_ROUNDING = 1e-9  # relative to a limit: two analyses of the same numbers differ by less


def run(options: Namespace) -> None:
    """Optimize the pretension of the first phase that states one.

    If the search does not converge, or a limit is violated, the best numbers that it has found are
    printed, with the cause and exit status 1; they are written if `options.keep` asks for it. If
    the analysis fails at the start, there is no design, and nothing is written.
    """
    if (options.deflection, options.lowest) == (None, None):
        if options.target is None:
            raise Refused("optimize: give --target, or --deflection and/or --lowest")
    elif options.target is not None:
        raise Refused("optimize: --target has no limits; leave out --deflection and --lowest")
    outputs.target(options.save, (".json",), inputs=[options.scene])
    structure, phases = inputs.scene(options)
    number = next((k for k, p in enumerate(phases) if p.pretension is not None), None)
    if number is None:
        raise Refused(f"{options.scene}: no phase has a pretension to optimize")
    start, spread_out = _parameters(structure, phases[number], options)

    def changed(pretension):
        phase = replace(phases[number], pretension=pretension)
        return [*phases[:number], phase, *phases[number + 1 :]]

    def analysed(parameters, progress=False):
        return solve(structure, changed(spread_out(parameters)), progress=progress)

    low, high = options.bounds
    if not low <= high:
        raise Refused(f"--bounds {low:g} {high:g}: the first is above the second")
    inside = jnp.clip(start, low, high)
    if (inside != start).any():
        text = f"the search starts within {low:g} to {high:g} N, where the scene does not"
        warnings.warn(text, InputWarning, stacklevel=1)
    start = inside
    with refusing(options.scene):
        search = _least if options.target is None else _to_target
        found, description = search(analysed, start, (low, high), options)
        solution = analysed(found.params, progress=not options.quiet)
    code = int(found.status)
    if code in (status.STATIONARY, status.STALLED) and _is_met(found, start, options):
        code = status.OK
    if int(solution.status) != status.OK:  # there is no design: the analysis fails at the start
        if options.save is not None:
            say(f"{options.save}: not written: the analysis fails with the pretension of the start")
        status.raise_if_failed(solution)
    lines = [
        f"status {code}: {status.describe(code)}",
        f"{description}, {int(found.evaluations)} analyses",
        f"pretension {inputs.spread(found.params)} N",
        f"forces at the end {inputs.spread(solution.last.peak_tension)} N",
        *_limits(solution, options),
    ]
    good = code == status.OK or options.keep
    violated = code == status.CONSTRAINTS_VIOLATED
    cause = "the limits are violated" if violated else "the search has not come to its end"
    if options.save is not None and good:
        best = jax.tree.map(np.asarray, spread_out(found.params))
        save_scene(options.save, Scene(structure, changed(best)))
        ended = "the scene with this pretension"
        if code != status.OK:
            ended += f", the best one found: {cause}"
        lines.append(f"wrote {options.save}: {ended}")
    print("\n".join(lines))
    if options.save is not None and not good:
        sys.stdout.flush()
        say(f"{options.save}: not written: {cause}; --keep writes it")
    if code != status.OK:
        status.raise_if_failed(found)


def _parameters(structure, phase, options):
    """Start of the search, a vector, and the function from such a vector to a pretension."""
    stated = [statements.get("pretension") for statements in phase.statements(structure)]
    if any(statement is not None and statement.chosen is not None for statement in stated):
        raise Refused(f"{options.scene}: a pretension of some elements only cannot be optimized")
    values = [None if one is None else np.asarray(one.values, float) for one in stated]
    if options.one:
        values = [None if value is None else value.mean(keepdims=True) for value in values]
    start, by_group = ravel_pytree(values)

    def spread_out(parameters):
        parts = zip(by_group(parameters), structure.groups, strict=True)
        return structure.arrange(
            [
                None if own is None else jnp.broadcast_to(own, (len(of.links), *own.shape[1:]))
                for own, of in parts
            ]
        )

    return start, spread_out


def _to_target(analysed, start, bounds, options):
    """Search for tensions at the end as near to a target as the bounds allow.

    Returns:
        Outcome of the search, and a description of it in words.
    """

    def loss(parameters):
        solution = analysed(parameters)
        return design.tension_distance(solution, options.target), solution

    found = design.minimize(loss, start, bounds, steps=options.steps, progress=not options.quiet)
    n = sum(v.size for v in jax.tree.leaves(jax.eval_shape(analysed, start).tension))
    distance = float(np.sqrt(float(found.loss) / n))
    return found, f"root mean square distance from {options.target:g} N: {distance:.6g} N"


def _is_met(found, start, options):
    """Whether the tensions are the target but for rounding: no sum of squares is less than zero."""
    if options.target is None:
        return False
    return float(found.loss) <= start.size * (_ROUNDING * options.target) ** 2


def _least(analysed, start, bounds, options):
    """Search for the least sum of pretensions that keeps deflections and tensions within limits.

    Returns:
        Outcome of the search, and a description of it in words.
    """
    limits = options.deflection, options.lowest

    def problem(parameters):
        solution = analysed(parameters)
        broken = []
        if limits[0] is not None:
            deflection = design.largest_deflection(solution, _WIDTH * limits[0])
            broken.append(jnp.atleast_1d(deflection / limits[0] - 1.0))
        if limits[1] is not None:
            forces = jnp.concatenate([jnp.ravel(v) for v in jax.tree.leaves(solution.tension)])
            broken.append(1.0 - forces / limits[1])
        return jnp.sum(parameters), jnp.concatenate(broken), solution

    found = design.minimize_subject_to(
        problem, start, bounds, steps=options.steps, progress=not options.quiet
    )
    words = f"sum of the pretensions {inputs.short(float(found.loss))} N"
    return found, f"{words}, KKT residual {found.kkt_residual:.1e}"


def _limits(solution, options):
    """The largest displacement, and for every limit what is reached and whether it is violated."""
    reached, where = inputs.farthest(solution.phases[-1].displacement)
    if options.deflection is None:
        lines = [f"largest displacement of the last phase {where}"]
    else:
        limit = f"limit on displacements of the last phase: {inputs.short(options.deflection)} m"
        lines = [f"{limit}, reached {where}: {_violated(reached / options.deflection - 1.0)}"]
    if options.lowest is not None:
        forces = np.concatenate(
            [np.ravel(np.asarray(v, float)) for v in jax.tree.leaves(solution.tension)]
        )
        reached = float(forces.min())
        limit = f"limit on the lowest tension at the end: {inputs.short(options.lowest)} N"
        words = _violated(1.0 - reached / options.lowest)
        lines.append(f"{limit}, reached {inputs.short(reached)} N: {words}")
    return lines


def _violated(excess):
    """Whether a limit is kept, in words; `excess` is relative to the limit, above 0 if not."""
    return "met" if excess <= _ROUNDING else f"violated by {100 * excess:.2g} %"
