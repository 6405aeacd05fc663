"""What a phase does, in words: prestress, loads, supports, and which elements come and go."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from ..analysis.activation import Activation
from ..analysis.phases import Phase, all_phase_inputs
from ..common.types import Float, Int
from ..common.units import Units
from ..elements.abilities import PHASE_INPUTS, Hanging, accepted_inputs
from ..elements.phase_input import InputValues
from ..loads import as_list
from ..model.result_parts import named_groups_of
from ..model.structure import Structure
from .load_descriptions import describe_load, elements_text, numbers_text, range_with_unit

_WORDS = {"rest_length": "unstressed length"}
"""What reports call inputs of phases, where it is not their name."""


def describe_phase_inputs(
    phase: Phase, structure: Structure, units: Units | None, *, name_others: bool = False
) -> list[str]:
    """Return the prestress and other values that a phase states, a line each: values by group.

    If `name_others`, groups without values are named, too, and inputs as in a scene. Numbers are in
    `units`, None for SI.
    """
    stated = phase.inputs(structure)
    hangs = any(isinstance(group, Hanging) for group in structure.groups)
    lines = []
    for name in all_phase_inputs(phase):
        jacked = hangs and name in ("end_tension", "jacking")
        place = f" (of catenaries at the {phase.tension_at} end)" if jacked else ""
        values = [of.get(name) for of in stated]
        described, others = _describe_values(name, values, structure, units)
        word = name if name_others else _WORDS.get(name, name.replace("_", " "))
        lines.append(f"{word}{place} {'; '.join(described + (others if name_others else []))}")
    return lines


def describe_loads(phase: Phase, structure: Structure, units: Units | None) -> list[str]:
    """Return the loads of a phase in words, a line for each; numbers in `units`, None for SI."""
    return [describe_load(load, structure, units) for load in as_list(phase.loads)]


def describe_activation(k: int, structure: Structure, presence: Activation) -> list[str]:
    """Return which elements the phase of index `k` adds and removes, and how many are active.

    `presence` is the result of `make_activation`: which elements are active in each phase.
    """
    names = [label for label, _ in named_groups_of(structure)]
    lines = []
    for word, change in (("adds", 1), ("removes", -1)):
        parts = []
        for label, first, present in zip(
            names, presence.present_at_start, presence.present, strict=True
        ):
            before = present[k - 1] if k else first
            changed = np.flatnonzero(present[k].astype(int) - before.astype(int) == change)
            if len(changed):
                parts.append(_chosen_elements_text(label, changed, len(before)))
        if parts:
            lines.append(f"{word} {', '.join(parts)}")
    total = sum(present.shape[1] for present in presence.present)
    active = sum(int(present[k].sum()) for present in presence.present)
    return [*lines, f"{active} of {total} elements active"]


def _chosen_elements_text(label: str, elements: Int[np.ndarray, " n"], count: int) -> str:
    """Return a text for some elements of a group: its name, and which of `count` unless all."""
    if len(elements) == count:
        return label or "all elements"
    some = f"{elements_text(elements)} of {count}"
    return f"{label} ({some})" if label else some


def _describe_values(
    name: str, inputs: Sequence[InputValues | None], structure: Structure, units: Units | None
) -> tuple[list[str], list[str]]:
    """Return texts on the values of an input such as "pretension", and on groups without any.

    `inputs` has the stated values of each group, or None. Both results are lists.
    """
    parts: dict[str, list[str]] = {}
    without, cold = [], []
    for (label, group), stated in zip(named_groups_of(structure), inputs, strict=True):
        if stated is None and name not in PHASE_INPUTS and name not in accepted_inputs(group):
            continue  # only groups of one class may know it
        if stated is None:
            lacks = name == "temperature" and group.expansion is None
            (cold if lacks else without).append(label)
            continue
        values = np.asarray(stated.values)
        meant = np.arange(len(values))
        if stated.chosen is not None:
            meant = np.flatnonzero(stated.chosen)
        unit = accepted_inputs(group)[name].unit
        text = range_with_unit(values[meant], unit, units).removesuffix(" -")
        if name == "clamped" and np.ptp(values[meant]):
            text = _clamps_text(group.links.array[meant], values[meant])
        parts.setdefault(text, []).append(_chosen_elements_text(label, meant, len(values)))
    single = len(inputs) == 1
    described = [
        text if single and names == ["all elements"] else f"{text} on {', '.join(names)}"
        for text, names in parts.items()
    ]
    others = [f"none on {', '.join(without)}"] if without else []
    others += [f"{', '.join(cold)} has no expansion"] if cold else []
    return described, others


def _clamps_text(
    links: Int[np.ndarray, "n n_end"], clamped: Float[np.ndarray, "n n_deviator"]
) -> str:
    """Return at which nodes some cables are clamped, and at which they are not, as text."""
    inner = links[:, 1:-1]
    nodes = (inner[(clamped == value) & (inner != links[:, -1:])] for value in (1, 0))  # no fillers
    closed, opened = (numbers_text(np.unique(some)) for some in nodes)
    return f"at {closed}, open at {opened} (nodes)"
