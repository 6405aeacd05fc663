"""``form``: find the form of a net of cables and bars under loads of the scene; other phases are
kept.
"""

from __future__ import annotations

import dataclasses
import itertools
from argparse import Namespace
from typing import Any, NamedTuple

import numpy as np

from ..analysis.group_values import value_per_group
from ..analysis.phases import ABSOLUTE_INPUTS, Phase
from ..common import status
from ..common.selection import Only
from ..common.tree import replace
from ..common.units import SI
from ..elements.straight import Straight
from ..files import save_scene
from ..files.omissions import Omissions
from ..files.reading import parse_integer
from ..forms import find_form, force_density
from ..loads import Load, SupportMovement, Varying, as_list
from ..model.result_parts import named_groups_of
from ..model.supports import pinned
from ..reporting.load_descriptions import range_text
from . import inputs, outputs
from .guard import BadInput

_SETTINGS = ("increments", "placed", "tension_at")
"""Fields of a phase that do nothing by themselves."""

NOT_IN_FORM = (SupportMovement, Varying)
"""Classes of loads that act after the form: they depend on a history, or move what it has moved."""


class _FormLoads(NamedTuple):
    """The loads that act while a form is found.

    Attributes:
        loads: loads that act in the form.
        remaining: for each phase the list of its other loads, which act after the form.
        description: where the loads come from, in words.
    """

    loads: list[Load]
    remaining: list[list[Load]]
    description: str


def run(options: Namespace) -> None:
    """Find the form of a net that the options ask for, print its numbers, write it as a scene."""
    outputs.check_output_file(options.save, (".json",), inputs=[options.scene])
    scene = inputs.read_scene(options)
    units, (structure, phases) = scene.units, scene
    table = Omissions(options.scene)
    if phases[0].supports is not None:
        structure = replace(structure, supports=phases[0].supports)
    acting = _select_form_loads(options, scene, table)
    lengths = _parse_lengths(options.length, structure, units)
    densities = _form_force_densities(options, scene, lengths, table)
    print(f"loads in the form: {acting.description}")
    stated: dict[str, Any]
    given: dict[str, Any] = {}
    bends = not all(isinstance(group, Straight) for group in structure.groups)
    try:
        if (options.tension, options.free, lengths) == (None, None, None):
            form, stated = None, {"force_density": densities}
            positions = _force_density_positions(structure, densities, acting.loads)
        else:
            given = _values_by_group(options, structure, units, densities, lengths)
            if options.tension is None and options.free is None:
                form = _find_form_with_lengths(structure, given, acting.loads)
            else:
                form = find_form(structure, loads=acting.loads, **given)
    except ValueError as error:
        hint = "; masts and guys may have --length" if "has no force density" in str(error) else ""
        raise BadInput(f"{options.scene}: {error}{hint}") from None
    if form is not None:
        status.raise_if_failed(form)
        positions, stated = form.positions, {"pretension": form.tension}
        if bends:
            lengths = _lengths_of_stated_groups(structure, form, given)
            positions, stated = structure.nodes, {"rest_length": lengths}
        print(
            f"status {int(form.status)}: {status.describe(form.status)}, "
            f"{int(form.iterations)} iterations, relative residual "
            f"{float(form.relative_residual):.1e}"
        )
    shape = positions if form is None else form.positions
    moved = np.linalg.norm(np.asarray(shape) - np.asarray(structure.nodes), axis=1)
    found = replace(structure, nodes=np.asarray(positions))
    flat = "" if acting.loads or not _is_planar(shape) else "; it lies in a plane, without loads"
    print(f"nodes moved by up to {inputs.number_text(moved.max(), 'm', units)}{flat}")
    forces = stated if form is None else {"pretension": form.tension}
    _print_group_tensions(replace(structure, nodes=np.asarray(shape)), forces, units)
    first = Phase(**stated, loads=acting.loads or None, increments=phases[0].increments)
    table.warn()
    if options.save is not None:
        later = _phases_after_form(phases, acting.remaining)
        formed = scene._replace(structure=found, phases=[first, *later.values()])
        save_scene(options.save, formed.with_phase_names(_names_after_form(scene, later)))
        what = "the structure as drawn, unstressed lengths" if bends else "the form, its prestress"
        print(f"wrote {options.save}: {what} and loads, and the other phases")


def _select_form_loads(options, scene, table):
    """Return the `_FormLoads` of the phases in ``--loads``, or else of the first phase.

    Loads that form finding cannot take stay in their phase, and are added to `table`, the
    omissions.
    """
    phases, units = scene.phases, scene.units or SI
    words, per_phase = options.loads, [as_list(phase.loads) for phase in phases]
    if words is None:
        chosen = [0] if per_phase[0] else []
        text = "those of {}; --loads names other phases, or none"
    elif words == ["none"]:
        chosen, text = [], "none"
    else:
        chosen, text = _parse_phase_numbers(words, len(phases)), "those of {}"
    acting, remaining = [], []
    for k, loads in enumerate(per_phase):
        taken = [load for load in loads if k in chosen and not isinstance(load, NOT_IN_FORM)]
        remaining.append([load for load in loads if not any(load is other for other in taken)])
        acting += taken
        for load in remaining[-1] if k in chosen else ():
            why = "form finding cannot take it; it acts after the form, in its phase"
            table.add(type(load).__name__, f"phase {k + 1}", why)
    told = ["; ".join(load.describe(units) for load in loads) for loads in per_phase]
    where = ", ".join(f"phase {k + 1} ({told[k]})" for k in chosen)
    description = text.format(where)
    if not (chosen or words):
        others = ", ".join(str(k) for k, loads in enumerate(per_phase, 1) if loads)
        where = f"; --loads takes those of others, which have some: {others}" if others else ""
        description = f"none, as phase 1 has none{where}"
    return _FormLoads(acting, remaining, description)


def _parse_phase_numbers(words, count):
    """Return the indices, from 0, of phases written as "1", "2" and so on, sorted, each once.

    Raise `BadInput` for a number that is not from 1 to `count`.
    """
    try:
        numbers = {parse_integer(word) for word in words}
    except ValueError:
        numbers = {0}
    if not numbers <= set(range(1, count + 1)):
        raise BadInput(f"--loads: expected numbers of phases, 1 to {count}, or none")
    return sorted(number - 1 for number in numbers)


def _form_force_densities(options, scene, lengths, table):
    """Return the force densities of the form in the shape of the elements; None with tensions.

    They are those of ``--force-density``, and for groups that it does not name those of the first
    phase that has any, in N/m. All other prestress in the scene is replaced by that of the form,
    and added to `table`, the omissions. `lengths` are those of ``--length``, or None. Raise
    BadInput if there is neither a force density nor a tension.
    """
    structure, phases = scene
    names = [name for name, _ in named_groups_of(structure)]
    own = next((k for k, phase in enumerate(phases) if phase.force_density is not None), None)
    given: Any = None
    if options.force_density is not None:
        read = inputs.number_parser(scene.units, "N/m")
        given = inputs.parse_group_values(
            options.force_density, structure, "--force-density", read=read
        )
    elif own is None and options.tension is None and options.free is None:
        raise BadInput(
            f"{options.scene}: no phase has force densities; give --force-density or --tension"
        )
    words = value_per_group(given, structure, "--force-density")
    drawn = value_per_group(lengths, structure, "--length")
    of_scene = None if own is None else phases[own].force_density
    scene = value_per_group(of_scene, structure, "force_density")
    used = [
        options.tension is None and q is not None and word is None and length is None
        for q, word, length in zip(scene, words, drawn, strict=True)
    ]
    if any(used):
        some = "" if all(used) else ", " + ", ".join(itertools.compress(names, used))
        print(f"force densities: those of phase {own + 1}{some}")
    whole_phase = used == [q is not None for q in scene]
    _record_replaced_inputs(phases, own if whole_phase else None, table)
    if not any(used):
        return given
    return structure.arrange(
        [q if use else word for use, q, word in zip(used, scene, words, strict=True)]
    )


def _values_by_group(options, structure, units, densities, lengths):
    """Return {"tension": N, "force_density": N/m, "length": m} in the shape of the elements.

    One number is for all groups of straight elements that have no other value and are not free.
    Raise BadInput for a group with several of them, or with none that is not free. `densities` and
    `lengths` are results of `_form_force_densities` and `_parse_lengths`.
    """
    names = [name for name, _ in named_groups_of(structure)]
    free = options.free or []
    for name in free:
        if name not in names:
            raise BadInput(f"--free: no group {name!r}; there are {', '.join(names)}")
    tension = None
    if options.tension is not None:
        read = inputs.number_parser(units, "N")
        tension = inputs.parse_group_values(options.tension, structure, "--tension", read=read)
    given = {"tension": tension, "force_density": densities, "length": lengths}
    found = {key: value_per_group(value, structure, key) for key, value in given.items()}
    for key, value in given.items():
        if isinstance(value, float):
            others = [found[other] for other in given if not isinstance(given[other], float)]
            for k, name in enumerate(names):
                if name in free or any(other[k] is not None for other in others):
                    found[key][k] = None
    for k, name in enumerate(names):
        count = sum(values[k] is not None for values in found.values())
        if count != (name not in free):
            what = "none" if count == 0 else "more than one"
            hint = "; --free lets it keep its stiffness" if count == 0 else "; give one"
            if name in free:
                what, hint = "one", ", and is named by --free"
            raise BadInput(
                f"group {name!r} has {what} of --tension, --force-density and --length{hint}"
            )
    return {key: structure.arrange(values) for key, values in found.items()}


def _lengths_of_stated_groups(structure, form, given):
    """Return unstressed lengths of a form, m, in the shape of the elements.

    Groups without a value in `given`, the result of `_values_by_group`, have None: they keep
    theirs.
    """
    trees = (form.rest_length, *given.values())
    per_group = zip(*map(structure.group_tree.flatten_up_to, trees), strict=True)
    return structure.arrange(
        [
            None if all(value is None for value in values) else np.asarray(rest)
            for rest, *values in per_group
        ]
    )


def _record_replaced_inputs(phases, own, table):
    """Add to `table`, the omissions, what the form replaces: prestress, and additions of elements.

    The force density of the phase with index `own` is kept; None keeps none.
    """
    for k, phase in enumerate(phases):
        for field in ABSOLUTE_INPUTS:
            if getattr(phase, field) is not None and (field, k) != ("force_density", own):
                why = "the prestress of the form replaces it"
                table.add(field, f"phase {k + 1}", why)
        if phase.adds is not None:
            why = "the form is that of all elements, which exist from the start"
            table.add("adds", f"phase {k + 1}", why)


def _is_planar(positions):
    """Return whether all positions, [n_node, 3], lie in one plane up to rounding."""
    places = np.asarray(positions, float)
    sizes = np.linalg.svd(places - places.mean(axis=0), compute_uv=False)
    return len(sizes) < 3 or sizes[2] <= 1e-9 * sizes[0]


def _phases_after_form(phases, remaining_loads):
    """Return the phases after the form with `remaining_loads`, as a dict by index in the scene.

    Left out are what the form has (prestress, `adds`, supports of the first phase) and phases that
    are then empty. Raise BadInput if a phase adds elements after one that has removed some.
    """
    later, removed = {}, False
    for k, (phase, loads) in enumerate(zip(phases, remaining_loads, strict=True)):
        if removed and phase.adds is not None:
            raise BadInput(
                f"phase {k + 1}: adds elements after an earlier phase has removed some; the form "
                "is that of all elements, and does not tell which of them are added again"
            )
        removed = removed or phase.removes is not None
        gone = dict.fromkeys((*ABSOLUTE_INPUTS, "adds", *(("supports",) if k == 0 else ())))
        phase = replace(phase, **gone, loads=loads or None)
        names = [field.name for field in dataclasses.fields(phase)]
        if any(getattr(phase, n) is not None for n in names if n not in _SETTINGS):
            later[k] = phase
    return later


def _names_after_form(scene, later):
    """Return the names of the phase of the form and of those after it; None without names.

    The first name is that of the first phase, unless a part of this phase follows the form. `later`
    is the result of `_phases_after_form`.
    """
    if scene.phase_names is None:
        return None
    kept = [scene.phase_names[k] for k in later]
    first = scene.phase_names[0]
    while first in kept:
        first = f"form of {first}"
    return [first, *kept]


def _parse_lengths(words, structure, units):
    """Return the lengths that ``--length`` gives, m, in the shape of the elements; None without.

    `words` are those behind the option, with numbers in `units`.
    """
    if words is None:
        return None
    drawn = inputs.element_lengths(structure)
    read = inputs.number_parser(units, "m")
    return inputs.parse_group_values(words, structure, "--length", drawn, read)


def _force_density_positions(structure, densities, loads):
    """Return the positions of the nodes that force densities give, [n_node, 3], m.

    `densities` have the shape of the elements, in N/m. Raise `AnalysisError` if these force
    densities have no equilibrium shape.
    """
    positions = force_density(structure, densities, loads)
    if not np.isfinite(np.asarray(positions)).all():
        raise status.AnalysisError(
            "these force densities have no equilibrium shape: a part of the net is not connected "
            "to supports, or tension and compression cancel at a node"
        )
    return positions


def _find_form_with_lengths(structure, given, loads):
    """Find the `Form` of a net by force densities, and of its masts and guys by lengths.

    First the ends of elements with given lengths are fixed, and force densities give the shape of
    the net. Then the tensions of the net are kept, and `find_form` finds the forces in the masts
    and guys. `given` is from `_values_by_group`.
    """
    values = structure.group_tree.flatten_up_to(given["force_density"])
    named, ends = named_groups_of(structure), []
    for (name, group), q in zip(named, values, strict=True):
        if q is None:
            ends.append(group.links.array.ravel())
        if isinstance(q, Only):
            raise BadInput(
                f"group {name!r}: only some elements have a force density in the scene; give "
                "--force-density"
            )
    held = structure.supports + pinned(np.unique(np.concatenate(ends)))
    numbers = structure.arrange([0.0 if q is None else q for q in values])
    positions = _force_density_positions(replace(structure, supports=held), numbers, loads)
    shaped = replace(structure, nodes=np.asarray(positions))
    tensions = [
        None if q is None else np.asarray(q) * length
        for q, length in zip(values, inputs.element_lengths(shaped), strict=True)
    ]
    return find_form(shaped, structure.arrange(tensions), loads, length=given["length"])


def _print_group_tensions(found, stated, units):
    """Print the tensions and lengths of each group of a structure in its form, in `units`.

    `stated` is its prestress, {"force_density": ...} or {"pretension": ...}.
    """
    (values,) = stated.values()
    given = value_per_group(values, found, "form")
    named = named_groups_of(found)
    for (name, _), length, value in zip(named, inputs.element_lengths(found), given, strict=True):
        if value is None:  # elements without an axial force
            continue
        force = np.asarray(value) * (length if "force_density" in stated else 1.0)
        print(
            f"{name or 'all'}: tension {range_text(force, 'N', units)}, lengths "
            f"{range_text(length, 'm', units)}, "
            f"{inputs.number_text(length.sum(), 'm', units)} in total"
        )
