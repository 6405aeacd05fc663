"""``optimize``: the pretension for a purpose, by exact gradients; written as a scene."""

from __future__ import annotations

import itertools
from argparse import Namespace

import jax
import jax.numpy as jnp
import numpy as np

from .. import design
from ..analysis.solver import solve
from ..common import status
from ..common.tree import replace
from ..files import save_scene
from ..scenes import Scene
from . import inputs, outputs
from .guard import Refused, require_writable, say

_WIDTH = 0.02  # of the smooth maximum of deflections, as a part of the limit


def run(options: Namespace) -> None:
    """Optimize the pretension of the first phase that states one.

    A search that does not come to its end leaves its last good design: it is told and written, with
    exit status 1. Where the analysis fails at the start there is none, and nothing is written.
    """
    outputs.check_suffix(options.save, (".json",), "--save")
    require_writable(options.save)
    structure, phases = inputs.scene(options)
    number = next((k for k, p in enumerate(phases) if p.pretension is not None), None)
    if number is None:
        raise Refused(f"{options.scene}: no phase has a pretension to optimize")
    start, spread_out = _parameters(structure, phases[number], options)

    def analysed(parameters):
        own = replace(phases[number], pretension=spread_out(parameters))
        return solve(structure, [*phases[:number], own, *phases[number + 1 :]])

    low, high = options.bounds
    if not low <= high:
        raise Refused(f"--bounds {low:g} {high:g}: the first is above the second")
    inside = jnp.clip(start, low, high)
    if (inside != start).any():
        say(f"warning: the search starts within {low:g} to {high:g} N, where the scene does not")
    start = inside
    try:
        if options.target is not None:
            found, told = _to_target(analysed, start, (low, high), options)
        else:
            found, told = _least(analysed, start, (low, high), options)
        solution = analysed(found.params)
    except ValueError as error:
        raise Refused(f"{options.scene}: {error}") from None
    code = int(found.status)
    if int(solution.status) != status.OK:  # then there is no design: it fails where it starts
        if options.save is not None:
            say(f"{options.save}: not written: the analysis fails with the pretension of the start")
        status.raise_if_failed(solution)
    moved = np.linalg.norm(np.asarray(solution.last.displacement), axis=1).max()
    lines = [
        f"status {code}: {status.describe(code)}",
        f"{told}, {int(found.evaluations)} analyses",
        f"pretension {inputs.spread(found.params)} N",
        f"forces at the end {inputs.spread(solution.last.peak_tension)} N",
        f"largest displacement {inputs.short(float(moved))} m",
    ]
    if options.save is not None:
        best = jax.tree.map(np.asarray, spread_out(found.params))
        own = replace(phases[number], pretension=best)
        save_scene(options.save, Scene(structure, [*phases[:number], own, *phases[number + 1 :]]))
        ended = "the scene with this pretension"
        if code != status.OK:
            ended += ", the last good one: the search has not come to its end"
        lines.append(f"wrote {options.save}: {ended}")
    if not options.quiet:
        print("\n".join(lines))
    status.raise_if_failed(found)


def _parameters(structure, phase, options):
    """Start of the search and the function from its vector to a statement of pretension."""
    stated = [inputs.get("pretension") for inputs in phase.inputs(structure)]
    if any(own is not None and own.chosen is not None for own in stated):
        raise Refused(f"{options.scene}: a pretension of some elements only cannot be optimized")
    sizes = [0 if own is None else len(group.links) for own, group in _pairs(stated, structure)]
    if options.one:
        start = [np.mean(np.asarray(own.values, float)) for own in stated if own is not None]
        ends = np.cumsum([0, *(min(size, 1) for size in sizes)])
    else:
        start = np.concatenate([np.asarray(own.values, float) for own in stated if own is not None])
        ends = np.cumsum([0, *sizes])

    def spread_out(parameters):
        parts = [parameters[a:b] for a, b in itertools.pairwise(ends)]
        return structure.arrange(
            [
                jnp.broadcast_to(part, (size,)) if size else None
                for part, size in zip(parts, sizes, strict=True)
            ]
        )

    return jnp.asarray(start), spread_out


def _pairs(stated, structure):
    return zip(stated, structure.groups, strict=True)


def _to_target(analysed, start, bounds, options):
    """Tensions at the end as near to a target as the bounds allow."""

    def loss(parameters):
        solution = analysed(parameters)
        return design.tension_distance(solution, options.target), solution

    found = design.minimize(loss, start, bounds, steps=options.steps, progress=not options.quiet)
    n = sum(v.size for v in jax.tree.leaves(analysed(start).tension))
    apart = float(np.sqrt(float(found.loss) / n))
    return found, f"root mean square distance from {options.target:g} N: {apart:.6g} N"


def _least(analysed, start, bounds, options):
    """The least sum of pretensions that keeps deflections and tensions within their limits."""
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

    if limits == (None, None):
        raise Refused("optimize: give --target, or --deflection and/or --lowest")
    found = design.minimize_subject_to(
        problem, start, bounds, steps=options.steps, progress=not options.quiet
    )
    worst = float(np.max(found.constraints))
    return found, f"least pretension, its limits met within {worst:.1e}"
