"""``form``: find the form of a net of cables and bars under loads of the scene; other phases are
kept.
"""

from __future__ import annotations

import dataclasses
import itertools
from argparse import Namespace
from typing import Any, NamedTuple

import numpy as np

from ..analysis.by_group import spread
from ..analysis.phases import ABSOLUTE, Phase
from ..common import status
from ..common.progress import SHOW, announce_compilation
from ..common.selection import Only
from ..common.tree import replace
from ..files import save_scene
from ..files.omissions import Omissions
from ..files.reading import whole
from ..forms import find_form, force_density
from ..loads import AreaLoads, LineLoads, Load, NodalLoads, SelfWeight, as_list
from ..model.parts import groups_by_name
from ..model.supports import pinned
from ..scenes import Scene
from . import inputs, outputs
from .guard import Refused

FOUND = (NodalLoads, SelfWeight, LineLoads, AreaLoads)
"""Kinds of loads that form finding takes."""


class _Acting(NamedTuple):
    """The loads of a form.

    Attributes:
        loads: those that act in it, a list.
        left: the loads of every phase that do not, a list of lists.
        told: where those that act come from, in words.
    """

    loads: list[Load]
    left: list[list[Load]]
    told: str


def run(options: Namespace) -> None:
    """Find the form that `options` ask for, print its numbers, write it."""
    outputs.target(options.save, (".json",), inputs=[options.scene])
    structure, phases = inputs.scene(options)
    table = Omissions(options.scene)
    if phases[0].supports is not None:
        structure = replace(structure, supports=phases[0].supports)
    acting = _acting(options, phases, table)
    lengths = _lengths(options.length, structure)
    densities = _densities(options, structure, phases, lengths, table)
    print(f"loads in the form: {acting.told}")
    stated: dict[str, Any]
    try:
        with announce_compilation(None if options.quiet else SHOW):
            if options.tension is not None:
                tension = inputs.values(options.tension, structure, "--tension")
                form = find_form(structure, tension, acting.loads, length=lengths)
            elif lengths is not None:
                form = _guyed(structure, densities, lengths, acting.loads)
            else:
                form, stated = None, {"force_density": densities}
                positions = _shape(structure, densities, acting.loads)
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
    flat = "" if acting.loads or not _in_plane(positions) else "; it lies in a plane, without loads"
    print(f"nodes moved by up to {inputs.short(float(moved.max()))} m{flat}")
    _print_groups(found, stated)
    first = Phase(**stated, loads=acting.loads or None, increments=phases[0].increments)
    table.warn()
    if options.save is not None:
        save_scene(options.save, Scene(found, [first, *_later(phases, acting.left)]))
        print(f"wrote {options.save}: the form, its prestress and loads, and the other phases")


def _acting(options, phases, table):
    """The `_Acting` loads: of the phases that ``--loads`` names, or of the first that has any."""
    words, per_phase = options.loads, [as_list(phase.loads) for phase in phases]
    if words is None:
        numbers = [k for k, loads in enumerate(per_phase) if loads][:1]
        told = "those of the first phase that has any, {}; --loads names others, or none"
    elif words == ["none"]:
        numbers, told = [], "none"
    else:
        numbers, told = _numbers(words, len(phases)), "those of {}"
    kinds = FOUND if options.length is None else (NodalLoads,)
    acting, left = [], []
    for k, loads in enumerate(per_phase):
        taken = [load for load in loads if k in numbers and isinstance(load, kinds)]
        left.append([load for load in loads if not any(load is other for other in taken)])
        acting += taken
        for load in left[-1] if k in numbers else ():
            why = "form finding cannot take it; it acts after the form, in its phase"
            if isinstance(load, FOUND):
                why = "with --length the form is found for NodalLoads only; it acts after the form"
            table.add(type(load).__name__, f"phase {k + 1}", why)
    text = ", ".join(f"phase {k + 1} ({'; '.join(map(str, per_phase[k]))})" for k in numbers)
    return _Acting(acting, left, told.format(text) if numbers or words else "none in the scene")


def _numbers(words, count):
    """Numbers of phases from 0, of words such as "1"; every phase once, in their order."""
    try:
        numbers = {whole(word) for word in words}
    except ValueError:
        numbers = {0}
    if not numbers <= set(range(1, count + 1)):
        raise Refused(f"--loads: expected numbers of phases, 1 to {count}, or none")
    return sorted(number - 1 for number in numbers)


def _densities(options, structure, phases, lengths, table):
    """Force densities of the form in the shape of the elements, or None if tensions are given.

    They are those of ``--force-density``, and for groups that it does not name those of the first
    phase that states any. All other prestress in the scene is replaced by the form, and counted.
    """
    names = [name for name, _ in groups_by_name(structure)]
    own = next((k for k, phase in enumerate(phases) if phase.force_density is not None), None)
    given: Any = None
    if options.force_density is not None:
        given = inputs.values(options.force_density, structure, "--force-density")
    elif own is None and options.tension is None:
        raise Refused(
            f"{options.scene}: states no force densities; give --force-density or --tension"
        )
    words = spread(given, structure, "--force-density")
    drawn = spread(lengths, structure, "--length")
    of_scene = None if own is None else phases[own].force_density
    scene = spread(of_scene, structure, "force_density")
    used = [
        options.tension is None and q is not None and word is None and length is None
        for q, word, length in zip(scene, words, drawn, strict=True)
    ]
    if any(used):
        some = "" if all(used) else ", " + ", ".join(itertools.compress(names, used))
        print(f"force densities: those of phase {own + 1}{some}")
    whole_phase = used == [q is not None for q in scene]
    _count_replaced(phases, own if whole_phase else None, table)
    if options.tension is not None:
        return None
    if not any(used):
        return given
    return structure.arrange(
        [q if use else word for use, q, word in zip(used, scene, words, strict=True)]
    )


def _count_replaced(phases, own, table):
    """Count the prestress of the scene that the form replaces; phase `own` has that of the form."""
    for k, phase in enumerate(phases):
        for field in ABSOLUTE:
            if getattr(phase, field) is not None and (field, k) != ("force_density", own):
                why = "the prestress of the form replaces it"
                table.add(field, f"phase {k + 1}", why)
        if phase.adds is not None:
            why = "the form is that of all elements; they are there from the beginning"
            table.add("adds", f"phase {k + 1}", why)


def _in_plane(positions):
    """Whether all nodes lie in a plane, but for rounding."""
    places = np.asarray(positions, float)
    sizes = np.linalg.svd(places - places.mean(axis=0), compute_uv=False)
    return len(sizes) < 3 or sizes[2] <= 1e-9 * sizes[0]


def _later(phases, left):
    """The phases after the form, a list: without what the form has of them; none that is empty."""
    later, removed = [], False
    for k, (phase, loads) in enumerate(zip(phases, left, strict=True)):
        if removed and phase.adds is not None:
            raise Refused(
                f"phase {k + 1}: adds elements after an earlier phase has removed some; the form "
                "is that of all elements, and cannot say which of them come back"
            )
        removed = removed or phase.removes is not None
        gone = dict.fromkeys((*ABSOLUTE, "adds", *(("supports",) if k == 0 else ())))
        phase = replace(phase, **gone, loads=loads or None)
        names = [field.name for field in dataclasses.fields(phase)]
        if any(getattr(phase, n) is not None for n in names if n not in ("increments", "placed")):
            later.append(phase)
    return later


def _lengths(words, structure):
    """The lengths of ``--length``, a list in the shape of the elements, or None if not given."""
    if words is None:
        return None
    return inputs.values(words, structure, "--length", drawn=inputs.lengths(structure))


def _shape(structure, densities, loads):
    """Positions for force densities; raises `AnalysisError` if they hold no shape."""
    positions = force_density(structure, densities, loads)
    if not np.isfinite(np.asarray(positions)).all():
        raise status.AnalysisError(
            "force densities hold no shape: a part of the net is free, or they cancel"
        )
    return positions


def _guyed(structure, densities, lengths, loads):
    """The `Form` of a net by force densities, and of its masts and guys by lengths.

    First the nodes of elements of given lengths are held where they are, and the net takes its
    shape. The tensions in it are then kept, and the forces in the others follow.
    """
    given = spread(lengths, structure, "--length")
    values = spread(densities, structure, "--force-density")
    if isinstance(densities, float):  # one for all groups without lengths
        values = [q if length is None else None for q, length in zip(values, given, strict=True)]
    named, ends = groups_by_name(structure), []
    for (name, group), length, q in zip(named, given, values, strict=True):
        if length is not None:
            ends.append(group.links.array.ravel())
        if (length is None) != (q is not None):
            count = "neither" if length is None else "both"
            raise Refused(f"group {name!r} has {count} of --force-density and --length; give one")
        if isinstance(q, Only):
            raise Refused(
                f"group {name!r}: the scene states it of some elements; give --force-density"
            )
    held = structure.supports + pinned(np.unique(np.concatenate(ends)))
    numbers = structure.arrange([0.0 if q is None else q for q in values])
    positions = _shape(replace(structure, supports=held), numbers, loads)
    shaped = replace(structure, nodes=np.asarray(positions))
    tensions = [
        None if q is None else np.asarray(q) * length
        for q, length in zip(values, inputs.lengths(shaped), strict=True)
    ]
    return find_form(shaped, structure.arrange(tensions), loads, length=lengths)


def _print_groups(found, stated):
    """Print tensions and lengths of a form, group by group."""
    (values,) = stated.values()
    given = spread(values, found, "form")
    named = groups_by_name(found)
    for (name, _), length, value in zip(named, inputs.lengths(found), given, strict=True):
        force = np.asarray(value) * (length if "force_density" in stated else 1.0)
        print(
            f"{name or 'all'}: tension {inputs.spread(force)} N, lengths "
            f"{inputs.spread(length)} m, {inputs.short(length.sum())} m in total"
        )
