"""``form``: find the form of a net and write it as a scene."""

from __future__ import annotations

from argparse import Namespace
from typing import Any

import numpy as np

from ..analysis.phases import ABSOLUTE, Phase, spread
from ..common import status
from ..common.progress import SHOW, compiling
from ..common.tree import replace
from ..files import save_scene
from ..forms import find_form, force_density
from ..model.parts import groups_by_name
from ..model.supports import pinned
from ..scenes import Scene
from . import inputs, outputs
from .guard import Refused, require_writable


def run(options: Namespace) -> None:
    """Find the form that `options` ask for, print its numbers, write it."""
    outputs.check_suffix(options.save, (".json",), "--save")
    require_writable(options.save, inputs=[options.scene])
    structure, phases = inputs.scene(options)
    stated: dict[str, Any]
    try:
        lengths = _lengths(options.length, structure)
        with compiling(None if options.quiet else SHOW):
            if options.tension is not None:
                tension = inputs.values(options.tension, structure, "--tension")
                form = find_form(structure, tension, length=lengths)
            elif lengths is not None:
                form = _guyed(structure, options.force_density, lengths)
            else:
                form = None
                words = inputs.values(options.force_density, structure, "--force-density")
                positions, stated = _shape(structure, words), {"force_density": words}
    except ValueError as error:
        hint = "; masts and guys may have --length" if "has no force density" in str(error) else ""
        raise Refused(f"{options.scene}: {error}{hint}") from None
    if form is not None:
        status.raise_if_failed(form)
        positions, stated = form.positions, {"pretension": form.tension}
        print(
            f"status {int(form.status)}: {status.describe(form.status)}, "
            f"{int(form.iterations)} iterations, residual {float(form.residual):.1e} N "
            f"({float(form.relative_residual):.1e})"
        )
    moved = np.linalg.norm(np.asarray(positions) - np.asarray(structure.nodes), axis=1)
    found = replace(structure, nodes=np.asarray(positions))
    print(f"nodes moved by up to {inputs.short(float(moved.max()))} m")
    _print_groups(found, stated)
    later = [phase for phase in (_without(phase) for phase in phases) if phase is not None]
    scene = Scene(found, [Phase(**stated, increments=phases[0].increments), *later])
    if options.save is not None:
        save_scene(options.save, scene)
        print(f"wrote {options.save}: the form, its prestress, and the other phases")


def _lengths(words, structure):
    """The lengths of ``--length``, a list in the shape of the elements, or None if not given."""
    if words is None:
        return None
    own = dict(_by_name(structure))
    drawn = [word.removesuffix("=drawn") for word in words if word.endswith("=drawn")]
    rest = [word for word in words if not word.endswith("=drawn")]
    given = inputs.numbers(rest, "--length") if rest else {}
    if not isinstance(given, dict):
        raise Refused("--length: expected group=drawn, or group=number, m")
    for name in (*drawn, *given):
        if name not in own:
            raise Refused(f"--length: no group {name!r}; there are {', '.join(own)}")
    return structure.arrange([own[name] if name in drawn else given.get(name) for name in own])


def _by_name(structure):
    """Pairs (name, lengths [n_elem]) of all groups, m."""
    nodes = np.asarray(structure.nodes)
    return [
        (name, np.linalg.norm(np.diff(nodes[group.links.array], axis=1), axis=2).sum(axis=1))
        for name, group in groups_by_name(structure)
    ]


def _shape(structure, densities):
    """Positions for force densities; raises `AnalysisError` if they hold no shape."""
    positions = force_density(structure, densities)
    if not np.isfinite(np.asarray(positions)).all():
        raise status.AnalysisError(
            "force densities hold no shape: a part of the net is free, or they cancel"
        )
    return positions


def _guyed(structure, words, lengths):
    """The `Form` of a net by force densities, and of its masts and guys by lengths.

    First the nodes of elements of given lengths are held where they are, and the net takes its
    shape. The tensions in it are then kept, and the forces in the others follow.
    """
    given = spread(lengths, structure, "--length")
    densities = inputs.numbers(words, "--force-density")
    names = [name for name, _ in groups_by_name(structure)]
    if not isinstance(densities, dict):
        densities = {
            name: densities for name, length in zip(names, given, strict=True) if length is None
        }
    inputs.values([f"{name}={q}" for name, q in densities.items()], structure, "--force-density")
    stated = list(zip(structure.groups, given, names, strict=True))
    for _, length, name in stated:
        if (length is None) != (name in densities):
            count = "neither" if length is None else "both"
            raise Refused(f"group {name!r} has {count} of --force-density and --length; give one")
    ends = [group.links.array for group, length, _ in stated if length is not None]
    held = structure.supports + pinned(np.unique(np.concatenate([e.ravel() for e in ends])))
    numbers = [densities.get(name, 0.0) for name in names]
    positions = _shape(replace(structure, supports=held), structure.arrange(numbers))
    shaped = replace(structure, nodes=np.asarray(positions))
    tensions = [
        densities[name] * length if name in densities else None for name, length in _by_name(shaped)
    ]
    return find_form(shaped, structure.arrange(tensions), length=lengths)


def _print_groups(found, stated):
    """Print tensions and lengths of a form, group by group."""
    (values,) = stated.values()
    given = spread(values, found, "form")
    for (name, length), value in zip(_by_name(found), given, strict=True):
        force = np.asarray(value) * (length if "force_density" in stated else 1.0)
        print(
            f"{name or 'all'}: tension {inputs.spread(force)} N, lengths "
            f"{inputs.spread(length)} m, {inputs.short(length.sum())} m in total"
        )


def _without(phase):
    """A phase without its absolute prestress, which the form replaces; None if nothing is left."""
    left = replace(phase, **dict.fromkeys(ABSOLUTE))
    empty = all(
        getattr(left, name) is None for name in ("loads", "supports", "shortening", "temperature")
    )
    return None if empty else left
