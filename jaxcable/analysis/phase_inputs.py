"""Phase inputs, what a phase gives for elements: checked, and expanded to all of every group.

Inputs are a pretension, a temperature and others that `Phase` lists, and what only a class of
elements knows, such as the friction of a saddle.
"""

from __future__ import annotations

import itertools
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np

from ..common import checks
from ..common.rules import refuse_if_broken
from ..common.selection import Only, Selection
from ..common.types import ArrayLike, Float, PyTree
from ..elements.abilities import (
    PHASE_INPUTS,
    Hanging,
    Jackable,
    Prestressable,
    accepted_inputs,
    component_names,
)
from ..elements.element import Element
from ..elements.phase_input import InputValues
from ..model import phase_plausibility
from ..model.structure import Structure
from ..programs.joining import broadcast
from .group_values import describe_columns, is_single_number, value_per_group
from .prestress_rules import phase_input_rules

AS_BUILT_INPUTS = ("end_tension", "horizontal_tension", "built_sag")
"""Inputs of what holds in equilibrium, at the end of a phase (`as_built`)."""
ABSOLUTE_INPUTS = (
    *("pretension", "force_density", "prestrain", "rest_length", "sag", "jacking"),
    *AS_BUILT_INPUTS,
)
"""Inputs that replace the prestress of an element."""
INCREMENTAL_INPUTS = ("shortening", "temperature")
"""Inputs that change the prestress of an element."""
CLASS_INPUTS = ("clamped", "stressed_ends")
"""Arguments of `Phase` that only classes take which declare a `PhaseInput` of that name."""


def check_phase_inputs(
    given: dict[str, Any], structure: Structure, where: str = ""
) -> list[dict[str, InputValues]]:
    """Check what a phase states of elements, and expand it to the elements of every group.

    Prestress that no cable bears gets a warning.

    Args:
        given: inputs by name, as `Phase` takes them.
        structure: `Structure`.
        where: what messages put before the name of an input, such as "phases[0].".

    Returns:
        For every group a dict from name to `InputValues`.

    Raises:
        ValueError: a group cannot take an input, or two inputs contradict each other.
    """
    named = structure.named_groups()
    found: list[dict[str, InputValues]] = [{} for _ in named]
    for name, values in given.items():
        path = where + phase_input_label(name)
        by_group = _values_by_group(values, structure, name, path)
        for inputs, (key, group), value in zip(found, named, by_group, strict=True):
            if value is not None:
                inputs[name] = _check_input_value(value, group, name, path + key, structure)
    for inputs, (key, group) in zip(found, named, strict=True):
        _require_compatible(inputs, where, key, group)
        for name, stated in inputs.items():
            if not component_names(group, name):
                path = where + phase_input_label(name) + key
                phase_plausibility.warn_of_prestress(name, stated, group, path, structure.nodes)
    return found


def values_of_elements(
    given: PyTree[Any], structure: Structure, name: str
) -> list[InputValues | None]:
    """Expand an input to the elements of every group, None for groups that it does not concern.

    Arguments are those of `check_phase_inputs`; whether the values are plausible is not checked.
    """
    path = phase_input_label(name)
    by_group = zip(
        structure.named_groups(), _values_by_group(given, structure, name, path), strict=True
    )
    return [
        None if value is None else _expand_to_elements(value, group, name, path + key)
        for (key, group), value in by_group
    ]


def phase_input_label(name: str) -> str:
    """Return an input as a user writes it in a phase: ``pretension``, ``own['friction']``."""
    return name if name in (*PHASE_INPUTS, *CLASS_INPUTS) else f"own[{name!r}]"


def may_have_as_built_inputs(phase: Any, hangs: bool = True) -> bool:
    """Return whether a phase may state as-built prestress, for which lengths have to be found.

    `hangs` says whether the structure has catenaries.

    The `jacking` of straight elements is a force that they keep, and nothing has to be found.
    """
    names = (*AS_BUILT_INPUTS, *(("jacking",) if hangs else ()))
    return any(getattr(phase, name) is not None for name in names)


def depends_on_weight(phase: Any) -> bool:
    """Return whether a phase has loads, or states what depends on a weight: a sag, or as built."""
    return any(getattr(phase, name) is not None for name in ("loads", "sag", *AS_BUILT_INPUTS))


def end_tensions_as_jacking(
    structure: Structure, inputs: list[dict[str, InputValues]]
) -> list[dict[str, InputValues]]:
    """Return inputs by group; an end tension of straight elements becomes that of a jack."""
    return [
        own if isinstance(group, Hanging) else _end_tension_as_jacking(own)
        for group, own in zip(structure.groups, inputs, strict=True)
    ]


def _end_tension_as_jacking(own):
    """Return the inputs of a group of straight elements with "end_tension" as "jacking".

    `own` is a dict from name to `InputValues`; both inputs are joined if there are both.
    """
    if "end_tension" not in own:
        return own
    found = {name: stated for name, stated in own.items() if name != "end_tension"}
    end = own["end_tension"]
    if "jacking" in own:  # of other elements: neither is of all
        of_end, of_jack = (np.asarray(x.chosen) for x in (end, own["jacking"]))
        values = jnp.where(of_end, end.values, own["jacking"].values)
        end = InputValues(values, of_end | of_jack)
    return found | {"jacking": end}


def _values_by_group(given, structure, name, path):
    """Assign what is `given` for the input `name` to the groups: an item per group, or None.

    ValueError, which begins with `path`, if no group has the input, or keys are unknown.
    """
    groups = structure.groups
    if name not in PHASE_INPUTS:
        _require_known_input(name, path, groups)
    if any(map(_is_sag, jax.tree.leaves(given, is_leaf=_is_sag))):
        raise ValueError(f"{path}: got a Sag of results.sags; give the `midspan` of it, a number")
    if is_single_number(given):
        return [None if _skips_single_number(group, name, structure) else given for group in groups]
    return value_per_group(given, structure, path)


def _is_sag(given):
    """Return whether a value that a user gives is a `results.Sag` (it has a `midspan`)."""
    return hasattr(given, "midspan")


def _require_known_input(name, path, groups):
    """Raise ValueError if no group can take an input called `name`."""
    known = {phase_input: type(group) for group in groups for phase_input in accepted_inputs(group)}
    if name not in known:
        own = [f"{s!r} of {kind.__name__}" for s, kind in known.items() if s not in PHASE_INPUTS]
        others = f"; there are {', '.join(own)}" if own else ""
        raise ValueError(f"{path}: no group of the structure has an input {name!r}{others}")


def _require_compatible(inputs, where, key, group):
    """Raise ValueError if two inputs for the same element of a group contradict each other.

    These are two that state its prestress, and one that changes it beside a jack, which keeps the
    force. `key` is that of the group in the elements, as text; `where` as in `check_phase_inputs`.
    """
    absolute = [name for name in inputs if name in ABSOLUTE_INPUTS]
    for number, name in enumerate(absolute):
        for other in absolute[:number]:
            if (both := _describe_overlap(inputs[name], inputs[other], key)) is None:
                continue
            raise ValueError(
                f"{where}{other}, {name}: both state the prestress of {both}; give one of them, or "
                "give them to different elements by only(elements, values)"
            )
    kept = () if isinstance(group, Hanging) else ("jacking", "end_tension")
    for force, name in itertools.product(kept, INCREMENTAL_INPUTS):
        if force not in inputs or name not in inputs:
            continue
        both = _describe_overlap(inputs[name], inputs[force], key)
        if both is not None:
            raise ValueError(
                f"{where}{force}, {name}: a jack keeps the force of {both} in this phase; give "
                f"{name} in another phase"
            )


def _describe_overlap(one, other, key):
    """Return in words the first element of a group that two inputs concern; None without.

    `key` is that of the group in the elements, as text.
    """
    if one.chosen is None and other.chosen is None:
        return f"elements{key}"
    both = one.element_mask() & other.element_mask()
    return f"element {int(both.argmax())} of elements{key}" if both.any() else None


def _skips_single_number(group, name, structure):
    """Return whether one number for the whole structure does not apply to `group`.

    It skips groups that cannot take it, if another group can; and beams, and groups that take
    several components, beside cables or bars.
    """

    def takes(any_group):
        return name in accepted_inputs(any_group)

    def differs(any_group):  # its numbers mean something else than those of cables and bars
        return any_group.rotates or bool(component_names(any_group, name))

    if not takes(group):
        return any(map(takes, structure.groups))
    if name not in PHASE_INPUTS:
        return False
    mixed = any(takes(other) and not differs(other) for other in structure.groups)
    warms = name == "temperature" and group.expansion is not None
    return differs(group) and mixed and not warms


def _check_input_value(
    value: Any, group: Element, name: str, path: str, structure: Structure
) -> InputValues:
    """Check the value of an input for a group, and return it as `InputValues`.

    Raises:
        ValueError: the group cannot take it; the message begins with `path`, the input and the
            key of the group as a user writes them.
    """
    if isinstance(value, Selection):
        raise ValueError(f"{path}: only(...) has no values here; give only(elements, values)")
    _require_ability(group, name, path, structure)
    stated = _expand_to_elements(value, group, name, path)
    refuse_if_broken(phase_input_rules(name, stated, group, structure.nodes, group.capacity, path))
    return stated


def _expand_to_elements(value, group, name, path):
    """Expand the value of an input to all elements of a group, as `InputValues`.

    It may be one number, numbers [n_elem] (with components [n_elem, n_component]), or `Only`.
    ValueError, which begins with `path`, for other shapes.
    """
    count, components = len(group.links), component_names(group, name)
    chosen = None
    if isinstance(value, Only):
        chosen = value.element_mask(count, path)
        given = _values_per_element(value.values, len(value.elements), path, components)
        value = Only(value.elements, given).merged_with(np.zeros((count, *given.shape[1:])))
    else:
        value = _values_per_element(value, count, path, components)
    return InputValues(value, chosen)


def _require_ability(group, name, path, structure):
    """Raise ValueError unless the class of a group can take an input called `name`."""
    known, kind = accepted_inputs(group), type(group).__name__
    if name not in known and name not in PHASE_INPUTS:
        having = [type(g).__name__ for g in structure.groups if name in accepted_inputs(g)]
        kinds = ", ".join(dict.fromkeys(having))
        raise ValueError(f"{path}: an input of {kinds}; this group is made of {kind}")
    if not isinstance(group, Prestressable):
        raise ValueError(f"{path}: a group of {kind} cannot be prestressed")
    if name not in known:
        raise ValueError(f"{path}: {kind} have no {name}; they take {', '.join(known)}")
    hangs = isinstance(group, Hanging)
    if name in ("sag", "built_sag") and (not hangs or group.weight is None):
        raise ValueError(
            f"{path}: only catenaries with a weight can have a stated sag; for a chain of straight "
            "elements use forms.hanging_chain"
        )
    if name == "horizontal_tension" and not hangs:
        raise ValueError(
            f"{path}: only catenaries have a stated horizontal tension; {kind} pull along their "
            "chord, give end_tension"
        )
    if name in ("jacking", "end_tension") and not (hangs or isinstance(group, Jackable)):
        raise ValueError(f"{path}: {kind} cannot be jacked")
    if name == "temperature" and group.expansion is None:
        raise ValueError(
            f"{path}: the group has no coefficient of expansion; give {kind}(expansion=...) in 1/K"
        )


def _values_per_element(
    value: Any, count: int, path: str, components: tuple[str, ...]
) -> Float[ArrayLike, "n_elem ..."]:
    """Return values as floats [count], or [count, n_component] if there are components.

    One number is for all of them. If there is one element or one component, its numbers may be a
    flat list. `path` begins the messages.
    """
    array, shape = checks.as_floats(value, path), (count, len(components))
    if not components:
        if isinstance(array, jax.core.Tracer) and array.ndim == 0:
            return broadcast(array, shape=(count,))
        return checks.floats_per_element(array, count, path)
    pack = jnp if isinstance(array, jax.Array) else np
    if 1 in shape and array.shape == (max(shape),):
        array = array.reshape(shape)
    if array.shape not in ((), shape):
        flat = f" or ({max(shape)},)" if 1 in shape else ""
        raise ValueError(
            f"{path}: expected one number, or shape {shape}{flat} with "
            f"{describe_columns(components)}, got shape {array.shape}"
        )
    return pack.broadcast_to(array, shape)
