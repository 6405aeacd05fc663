"""``form``: find the form of a net and write it as a scene."""

from __future__ import annotations

from argparse import Namespace

import numpy as np

from ..analysis.phases import ABSOLUTE, Phase
from ..common import status
from ..common.progress import SHOW, compiling
from ..common.tree import replace
from ..files import save_scene
from ..forms import find_form, force_density
from ..scenes import Scene
from . import inputs, outputs
from .guard import Refused, require_writable


def run(options: Namespace) -> None:
    """Find the form that `options` ask for, print its numbers, write it."""
    outputs.check_suffix(options.save, (".json",), "--save")
    require_writable(options.save)
    structure, phases = inputs.scene(options)
    show = None if options.quiet else SHOW
    try:
        if options.tension is not None:
            tension = inputs.values(options.tension, structure, "--tension")
            with compiling(show):
                form = find_form(structure, tension)
            status.raise_if_failed(form)
            positions, stated = form.positions, {"pretension": form.tension}
            print(
                f"status {int(form.status)}: {status.describe(form.status)}, "
                f"{int(form.iterations)} iterations, residual {float(form.residual):.1e} N "
                f"({float(form.relative_residual):.1e})"
            )
        else:
            words = inputs.values(options.force_density, structure, "--force-density")
            with compiling(show):
                positions, stated = force_density(structure, words), {"force_density": words}
            if not np.isfinite(np.asarray(positions)).all():
                raise status.AnalysisError(
                    "force densities hold no shape: a part of the net is free, or they cancel"
                )
    except ValueError as error:
        raise Refused(f"{options.scene}: {error}") from None
    moved = np.linalg.norm(np.asarray(positions) - np.asarray(structure.nodes), axis=1)
    found = replace(structure, nodes=np.asarray(positions))
    lengths = [
        np.linalg.norm(np.diff(np.asarray(positions)[g.links.array], axis=1), axis=2).sum(axis=1)
        for g in found.groups
    ]
    print(f"nodes moved by up to {inputs.short(float(moved.max()))} m")
    print(f"lengths {inputs.spread(lengths)} m, {inputs.short(sum(v.sum() for v in lengths))} m")
    later = [phase for phase in (_without(phase) for phase in phases) if phase is not None]
    scene = Scene(found, [Phase(**stated, increments=phases[0].increments), *later])
    if options.save is not None:
        save_scene(options.save, scene)
        print(f"wrote {options.save}: the form, its prestress, and the other phases")


def _without(phase):
    """A phase without its absolute prestress, which the form replaces; None if nothing is left."""
    left = replace(phase, **dict.fromkeys(ABSOLUTE))
    empty = all(
        getattr(left, name) is None for name in ("loads", "supports", "shortening", "temperature")
    )
    return None if empty else left
