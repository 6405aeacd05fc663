"""Loads and actions in words, in a line each."""

from __future__ import annotations

import functools
from collections.abc import Sequence

import jax
import numpy as np

from ..common import checks
from ..common.negligible import vector_text, zero_negligible
from ..common.tree import index_field
from ..common.types import ArrayLike, Bool, Float, Int, PyTree
from ..common.units import SI, Units
from ..design.actions import Action
from ..elements.abilities import PHASE_INPUTS
from ..files.codec import TYPES, user_fields
from ..files.field_docs import field_units
from ..loads import Varying, WindLoads, as_list
from ..loads.faces import OnFaces
from ..loads.groups import OnGroups
from ..loads.load import Load, OnNodes, PrescribedMovement
from ..model.structure import Structure
from ..programs.traced_function import evaluate_at_once

SUM_OF_LOADS = "sum F: of the forces on all nodes, in the initial geometry"
_LONG = 40  # characters of a text that is not repeated
_MOST_LISTED = 8  # numbers of elements in a text


def describe_actions(
    actions: Sequence[Action], structure: Structure, units: Units | None
) -> list[str]:
    """Return the loads and changes of each action in words, a list of texts.

    Numbers are in `units`, None for SI. Long texts of loads, such as those of wind from several
    directions, are there once: other actions refer to the first one that has them.
    """
    first: dict[str, str] = {}
    return [_describe_action(action, structure, units, first) for action in actions]


def _describe_action(action, structure, units, first):
    """Return the loads and changes of an action in words.

    `first` is a dict from long texts to the name of the first action that has them; it is completed
    here, and a later action refers to this name. Numbers are in `units`, None for SI.
    """
    parts = []
    for load in as_list(action.loads):
        text = describe_load(load, structure, units)
        where, _, long = text.partition(": ")
        known = first.setdefault(long, action.name) if len(long) > _LONG else action.name
        parts.append(text if known == action.name else f"{where}, as {known}")
    for name in ("temperature", "shortening"):
        values = [np.ravel(np.asarray(x, float)) for x in jax.tree.leaves(getattr(action, name))]
        if values:
            unit = PHASE_INPUTS[name].unit
            where = getattr(action, name)
            where = f" on {', '.join(map(str, where))}" if isinstance(where, dict) else ""
            parts.append(f"{name} {range_with_unit(np.concatenate(values), unit, units)}{where}")
    if lost := removed_elements_text(action.removes):
        parts.append(lost)
    return "; ".join(parts) or "what the phases state"


def removed_elements_text(removes: PyTree[Bool[ArrayLike, " n_elem"]] | None) -> str:
    """Return how many elements an action removes, and which: "1 element lost: stays 2".

    `removes` has masks [n_elem] in the shape of the elements; "" if none is removed.
    """
    keystr = functools.partial(jax.tree_util.keystr, simple=True, separator=".")
    count, parts = 0, []
    for path, mask in jax.tree_util.tree_leaves_with_path(removes):
        numbers = np.flatnonzero(mask)
        if len(numbers):
            count += len(numbers)
            parts.append(f"{keystr(path)} {numbers_text(numbers)}".strip())
    word = "element" if count == 1 else "elements"
    return f"{count} {word} lost: {'; '.join(parts)}" if count else ""


def describe_load(load: Load, structure: Structure, units: Units | None) -> str:
    """Return a load in words, with its numbers in `units`, or SI if that is None.

    Of loads on nodes these are the sum and the largest one; of `WindLoads` the velocity pressure at
    the loaded nodes is among them.
    """
    if isinstance(load, Varying):
        amplitude = load.describe(units or SI).removeprefix(load.load.describe(units or SI))
        return describe_load(load.load, structure, units) + amplitude
    described = load.describe(units or SI)
    if isinstance(load, OnNodes):
        return described
    numbers = [own for own in _numbers_of_load(load, units or SI) if own[1] not in described]
    if isinstance(load, WindLoads):
        pressure = range_text(_velocity_pressures(load, structure), "N/m2", units)
        numbers.append(("velocity pressure", f"{pressure} at its nodes"))
    if isinstance(load, OnGroups) and load.elements is not None:
        described += f" ({elements_text(load.elements.elements)})"
    if (per := vars(load).get("per")) is not None:
        described += f" (per {per} {'area' if isinstance(load, OnFaces) else 'length'})"
    if isinstance(load, PrescribedMovement) and (nodes := index_field(load, "nodes")) is not None:
        described += f" of {'node' if len(nodes) == 1 else 'nodes'} {numbers_text(nodes[:])}"
    return "; ".join([described, ", ".join(map(" ".join, numbers))]).removesuffix("; ")


def _numbers_of_load(load, units):
    """Generate pairs (name, text) of the numbers that a load is given by, in `units`.

    Of many vectors the text has the range of their lengths.
    """
    found = field_units(type(load), TYPES)
    for field in user_fields(type(load)):
        value = checks.array_if_known(getattr(load, field.name))
        if value is None or not value.size or field.name not in found:
            continue
        name, unit, is_vector = field.name, found[field.name], "3'" in str(field.type)
        if np.array_equal(value, field.default) and (unit == "-" or not value.any()):
            continue  # factors and directions that nobody has stated
        if is_vector and value.ndim > 1:
            name, value, is_vector = f"size of {name}", np.linalg.norm(value, axis=-1), False
        yield name, range_with_unit(value, unit, units, is_vector).removesuffix(" -")


def _velocity_pressures(load, structure):
    """Return the velocity pressures at the nodes of elements that `WindLoads` act on, N/m2, [n]."""
    numbers, mask = load.loaded_groups(structure)
    chosen = slice(None) if mask is None else mask
    links = [structure.groups[k].links.array[chosen].ravel() for k in numbers]
    nodes = np.asarray(structure.nodes)[np.unique(np.concatenate(links))]
    upwards = np.asarray(load.vertical) / np.linalg.norm(load.vertical)
    return evaluate_at_once(load.profile.pressure_at, nodes @ upwards - np.asarray(load.ground))


def elements_text(elements: Int[ArrayLike, " n"]) -> str:
    """Return which elements, as text: "elements 0, 3"; of more than eight their count."""
    count = len(elements)
    if count > _MOST_LISTED:
        return f"{count} elements"
    return f"{'element' if count == 1 else 'elements'} {numbers_text(elements)}"


def numbers_text(elements):
    """Return indices of elements or nodes as text; of more than eight the first and the last."""
    numbers = [str(k) for k in np.asarray(elements)]
    if len(numbers) > _MOST_LISTED:
        return f"{numbers[0]} ... {numbers[-1]}"
    return ", ".join(numbers)


def range_with_unit(
    values: Float[ArrayLike, " ..."], unit: str, units: Units | None, is_vector: bool = False
) -> str:
    """Return the range of some numbers, or one vector, as text with unit in `units`.

    Without these, `units` being None, forces are in N, kN or MN.
    """
    values = np.asarray(values, float)
    write = vector_text if is_vector else format_range
    if units is not None:
        return f"{write(units.from_si(values, unit))} {units.shown(unit)}"
    largest = np.abs(values).max(initial=0.0)
    prefix, factor = "", 1.0
    if unit.startswith("N") and largest >= 1e3:
        prefix, factor = ("M", 1e-6) if largest >= 1e6 else ("k", 1e-3)
    return f"{write(factor * values)} {prefix}{unit}"


def range_text(
    arrays: PyTree[Float[ArrayLike, " ..."]], unit: str, units: Units | None = None
) -> str:
    """Return the range of numbers, given in the SI unit `unit`, as text with unit in `units`."""
    units = units or SI
    converted = jax.tree.map(lambda a: units.from_si(np.asarray(a, float), unit), arrays)
    return f"{format_range(converted)} {units.shown(unit)}"


def format_number(value: float) -> str:
    """Return a number as text, with six digits."""
    return f"{value:.6g}"


def format_range(arrays: PyTree[Float[ArrayLike, " ..."]]) -> str:
    """Return the range of the numbers in arrays as text, "1 to 2"; one number if all are equal."""
    if not jax.tree.leaves(arrays):
        return "none"
    every = [np.ravel(np.asarray(a, float)) for a in jax.tree.leaves(arrays)]
    flat = zero_negligible(np.concatenate(every))
    low, high = format_number(float(flat.min())), format_number(float(flat.max()))
    return low if low == high else f"{low} to {high}"
