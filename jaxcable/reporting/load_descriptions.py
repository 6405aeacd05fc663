"""Loads and actions in words, in a line each."""

from __future__ import annotations

import functools

import jax
import numpy as np

from ..common.negligible import vector_text, zero_negligible
from ..common.types import ArrayLike, Bool, Float, Int, PyTree
from ..common.units import SI, Units
from ..design.actions import Action
from ..elements.abilities import STATEMENTS
from ..loads import LineLoads, SelfWeight, as_list
from ..loads.load import Load

_MOST_LISTED = 8  # numbers of elements in a text


def describe_action(action: Action, units: Units | None) -> str:
    """Return what acts by an action: its loads and changes, in `units`, or SI if that is None."""
    parts = [describe_load(load, units) for load in as_list(action.loads)]
    for name in ("temperature", "shortening"):
        values = [np.ravel(np.asarray(x, float)) for x in jax.tree.leaves(getattr(action, name))]
        if values:
            unit = STATEMENTS[name].unit
            where = getattr(action, name)
            where = f" on {', '.join(map(str, where))}" if isinstance(where, dict) else ""
            parts.append(f"{name} {range_with_unit(np.concatenate(values), unit, units)}{where}")
    if lost := lost_elements_text(action.removes):
        parts.append(lost)
    return "; ".join(parts) or "what the phases state"


def lost_elements_text(removes: PyTree[Bool[ArrayLike, " n_elem"]] | None) -> str:
    """Return how many elements an action removes, and which: "1 element lost: stays 2"; or ""."""
    keystr = functools.partial(jax.tree_util.keystr, simple=True, separator=".")
    count, parts = 0, []
    for path, mask in jax.tree_util.tree_leaves_with_path(removes):
        numbers = np.flatnonzero(mask)
        if len(numbers):
            count += len(numbers)
            parts.append(f"{keystr(path)} {_numbers_text(numbers)}".strip())
    word = "element" if count == 1 else "elements"
    return f"{count} {word} lost: {'; '.join(parts)}" if count else ""


def describe_load(load: Load, units: Units | None) -> str:
    """Return a load in words, with its values, in `units` or SI, where these are one vector."""
    if isinstance(load, SelfWeight | LineLoads):
        where = "" if load.on is None else f" on {load.on}"
        where += "" if load.elements is None else f" ({elements_text(load.elements.elements)})"
    if isinstance(load, SelfWeight):
        direction = np.asarray(load.direction, float)
        plain = np.array_equal(direction, [0.0, 0.0, -1.0])
        return f"self-weight{where}" + ("" if plain else f", times {vector_text(direction)}")
    if isinstance(load, LineLoads):
        forces = np.asarray(load.forces, float) * np.asarray(load.factor, float)[..., None]
        size = range_with_unit(forces, "N/m", units, is_vector=forces.ndim == 1)
        return f"line load {size}{where} (per {load.per} length)"
    return load.describe(units or SI)


def elements_text(elements: Int[ArrayLike, " n"]) -> str:
    """Return the numbers of elements as text, "elements 0, 3"; their count, of many."""
    count = len(elements)
    if count > _MOST_LISTED:
        return f"{count} elements"
    return f"{'element' if count == 1 else 'elements'} {_numbers_text(elements)}"


def _numbers_text(elements):
    """Return the numbers of elements as text; of many the first and the last one."""
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
