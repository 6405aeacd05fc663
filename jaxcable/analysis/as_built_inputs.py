"""As-built inputs, read from the phases and checked."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, NamedTuple

import numpy as np

from ..common import checks
from ..common.rules import are_rules_kept
from ..common.types import Array, Bool, Float, Int
from ..elements.abilities import Hanging
from ..loads import as_list
from ..loads.load import PersistentLoad
from ..loads.varying import Varying
from ..model.structure import Structure
from .phase_inputs import AS_BUILT_INPUTS, may_have_as_built_inputs
from .phases import Phase
from .prestress_rules import phase_input_rules
from .solution import Solution, State


class AsBuiltInput(NamedTuple):
    """As-built input of a phase for some cables, or bars, of one group.

    Attributes:
        phase, group: indices.
        name: "end_tension", "horizontal_tension" or "built_sag".
        given: how a user writes it, for messages: ``phases[0].jacking['guys']``.
        elements: the cables, [n], NumPy.
        values: stated values, [n], N or m.
        at_first: of end tensions, whether they are those of the first end, [n] bool.
        allowed: whether the values keep their rules, scalar bool.
        loaded: whether any load may act along the cables, as far as the phases say.
    """

    phase: int
    group: int
    name: str
    given: str
    elements: Int[np.ndarray, " n"]
    values: Float[Array, " n"]
    at_first: Bool[Array, " n"]
    allowed: Bool[Array, ""]
    loaded: bool


def refuse_as_built(
    structure: Structure, phases: Sequence[Phase], function: str, before: int = 0
) -> None:
    """Raise ValueError if a phase states something as built of catenaries.

    Args:
        structure, phases: as for `solve`.
        function: what does not take it, for the message.
        before: number of phases before these.
    """
    stated = find_as_built_inputs(structure, phases, before=before)
    if stated:
        raise ValueError(
            f"{stated[0].given}: {function} takes no prestress "
            "as built; solve the phases, and state the `rest_length` of the solution"
        )


def find_as_built_inputs(
    structure: Structure,
    phases: Sequence[Phase],
    start: Solution | State | None = None,
    before: int = 0,
    straight: bool = False,
) -> list[AsBuiltInput]:
    """Return the as-built inputs of all phases for hanging cables.

    Args:
        structure, phases, start: as for `solve`.
        before: number of phases before these, for messages.
        straight: whether end tensions of straight elements are meant, too.

    Raises:
        ValueError: as of `Phase.inputs`; a stated sag where no load acts along the cables.
    """
    found = []
    loaded = start is not None or before > 0
    for k, phase in enumerate(phases):
        path = f"phases[{before + k}]."
        loaded = loaded or any(_acts_on_elements(load) for load in as_list(phase.loads))
        inputs = phase.inputs(structure, path) if may_have_as_built_inputs(phase) else ()
        for number, own in enumerate(inputs):
            cables: Any = structure.groups[number]
            names: tuple[str, ...] = (*AS_BUILT_INPUTS, "jacking")
            if not isinstance(cables, Hanging):
                names = ("end_tension",) if straight else ()
            for name in names:
                if name not in own:
                    continue
                chosen = np.flatnonzero(own[name].element_mask())
                xp = checks.numpy_or_jax(own[name].values)
                values = xp.asarray(own[name].values, structure.nodes.dtype)[chosen]
                rules = phase_input_rules(name, own[name], cables, structure.nodes, cables.capacity)
                allowed = are_rules_kept(rules)
                given = path + name + structure.named_groups()[number][0]
                if name == "built_sag" and not loaded:
                    raise ValueError(
                        f"{given}: no load acts along the cables in this phase, and without its "
                        "weight a cable has no sag; give loads=SelfWeight() in this phase or "
                        "before it"
                    )
                name = "end_tension" if name == "jacking" else name
                first = _is_first_end(phase.tension_at, structure, cables, chosen)
                numbers = chosen, values, first, allowed
                found.append(AsBuiltInput(k, number, name, given, *numbers, loaded))
    return found


def _acts_on_elements(given):
    """Return whether a load of a phase acts on elements, not on nodes; also if it is `Varying`."""
    return isinstance(given.load if isinstance(given, Varying) else given, PersistentLoad)


def _is_first_end(tension_at, structure, cables, chosen):
    """Return whether an end tension is that of the first end of each `chosen` element, [n] bool.

    `tension_at` is that of `Phase`: "first", "second", or the "lower" or "upper" initial end.
    """
    if tension_at in ("first", "second"):
        return np.full(len(chosen), tension_at == "first")
    heights = checks.as_numpy_if_known(structure.nodes)[:, 2][cables.links.array[chosen]]
    lower = heights[:, 0] <= heights[:, 1]
    return lower if tension_at == "lower" else ~lower


def refuse_lengths_beyond_digits(
    stated: Sequence[AsBuiltInput], m: Float[np.ndarray, " n"]
) -> None:
    """Raise ValueError for a stated number that asks for a length of no end.

    Args:
        stated: what phases state as built.
        m: guessed logarithms of lengths over chords, [n]. A prestrain exp(-m) - 1 that rounds to -1
            has no length.
    """
    wrong = np.expm1(-m) <= -1
    if wrong.any():
        label, value, unit = _label_value_and_unit(stated, int(wrong.argmax()))
        raise ValueError(
            f"{label} = {value:.6g}: the cable would be {np.exp(m[wrong.argmax()]):.1e} times as "
            f"long as its chord; is it in {unit}?"
        )


def describe_unmet(stated: Sequence[AsBuiltInput], errors: Float[np.ndarray, " n"]) -> str:
    """Return in words which stated number is farthest from what the search has found.

    Args:
        stated: what phases state as built.
        errors: relative errors that are left, [n], as `as_built` defines them; NaN if unknown.
    """
    known = np.isfinite(errors).all()
    worst = int(np.abs(errors).argmax()) if known else 0
    label, value, unit = _label_value_and_unit(stated, worst)
    text = f"{label} = {value:.6g} {unit}: no unstressed length is found with which it holds"
    if not known:
        return f"{text}; the analysis has no results for the lengths that the search begins with"
    found = value / (1 + errors[worst]) if unit == "m" else value * (1 + errors[worst])
    return (
        f"{text}; for the nearest lengths that the search has come to it is {found:.6g} {unit}. Is "
        f"the number in {unit}, and can the cable have it under its loads?"
    )


def _label_value_and_unit(stated, k):
    """Return label, stated value and unit of the unknown with index k, for messages.

    The label is how a user states it, such as ``phases[0].jacking[2]``; the unit is "N" or "m".
    """
    one, row = [(one, row) for one in stated for row in range(len(one.elements))][k]
    unit = "m" if one.name == "built_sag" else "N"
    return f"{one.given}[{one.elements[row]}]", float(one.values[row]), unit
