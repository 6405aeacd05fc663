"""Inputs and loads of a phase for elements that are not there: refused, or a warning.

An input is what a phase states of elements, such as a pretension or a temperature. It changes
what is there. It is lost on an element that is not there, because this element is unstressed when
it is added. So what names such an element, by `only` or by its group, is refused (with traced masks
the phase ends in INVALID_INPUT). One number for all cables and bars, or numbers for all elements of
a group, are for those that are there.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np

from ..common import checks
from ..common.selection import Only
from ..common.types import Bool
from ..elements.phase_input import InputValues
from ..loads.groups import OnGroups
from ..loads.load import PersistentLoad
from ..model.structure import Structure
from .activation import Activation
from .group_values import is_single_number, value_per_group
from .phase_inputs import ABSOLUTE_INPUTS, INCREMENTAL_INPUTS, phase_input_label
from .phases import Phase, all_phase_inputs


def refuse_absent_elements(
    structure: Structure,
    phases: Sequence[Phase],
    inputs: Sequence[Sequence[dict[str, InputValues]]],
    presence: Activation,
    earlier: int = 0,
) -> Activation:
    """Refuse inputs (pretension, temperature, ...) for elements that are not there.

    Args:
        structure, phases: of the analysis.
        inputs: inputs of every phase and group, as `Phase.inputs` returns them.
        presence: which elements are there in which phase.
        earlier: number of phases solved before, by which messages number the phases.

    Returns:
        `presence`, in which phases that traced masks make wrong are marked as not consistent.

    Raises:
        ValueError: an input names an element that is known not to be there.
    """
    sound = presence.is_consistent
    for k, phase in enumerate(phases):
        there = [present[k] for present in presence.present]
        for name, value in all_phase_inputs(phase).items():
            label = f"phases[{earlier + k}].{phase_input_label(name)}"
            if is_single_number(value):
                _warn_if_all_absent(name, label, [name in own for own in inputs[k]], there)
                continue
            values = value_per_group(value, structure, label)
            parts = zip(values, structure.named_groups(), there, strict=True)
            for number, (given, (where, group), own) in enumerate(parts):
                if given is None or _is_zero_increment(name, given):
                    continue
                wrong = _concerns_absent_element(label, where, given, group, own)
                if isinstance(wrong, jax.core.Tracer):
                    sound = jnp.ones(len(phases), bool) if sound is None else sound
                    sound = sound.at[k].set(sound[k] & ~wrong)
                later = [of_phase[number] for of_phase in inputs[k + 1 :]]
                _warn_of_lost_value(name, label, where, given, presence.present[number][k:], later)
    return presence._replace(is_consistent=sound)


def warn_of_idle_loads(
    along: Sequence[Sequence[PersistentLoad]], presence: Activation, earlier: int = 0
) -> None:
    """Warn of loads on elements none of which is there in the phase of the load or later.

    Args:
        along: element loads of every phase, in the form of an analysis.
        presence: which elements are there in which phase.
        earlier: number of phases solved before, by which messages number the phases.
    """
    for k, loads in enumerate(along):
        for acting in loads:
            if not isinstance(acting, OnGroups) or not acting.on:  # or a load on stated faces
                continue
            on: Any = acting.on  # numbers of groups, after `with_group_indices`
            if any(isinstance(presence.present[number], jax.core.Tracer) for number in on):
                continue
            part = acting.element_factors or {}
            is_acting = [presence.present[n][k:] & _is_loaded(part.get(n)) for n in on]
            if not any(np.any(one) for one in is_acting):
                checks.warn_user(
                    f"phases[{earlier + k}].loads: {acting} acts on nothing: its elements are not "
                    "there in this phase, nor in a later one"
                )


def _is_loaded(factors):
    """Return which elements have a nonzero load factor, [n_elem] bool.

    True, a scalar, if the factors are None (the load acts on all elements) or traced.
    """
    known = checks.array_if_known(factors)
    return True if known is None else (known != 0).reshape(len(known), -1).any(axis=1)


def _is_zero_increment(name, given):
    """Return whether the input `name` is a shortening or temperature known to be zero."""
    values = checks.array_if_known(given.values if isinstance(given, Only) else given)
    return name in INCREMENTAL_INPUTS and values is not None and not np.any(values)


def _warn_if_all_absent(name, label, concerned, there):
    """Warn if a number for the whole structure has no effect: no element that takes it is there.

    For each group, `concerned` says whether it takes the number (input `name`), and `there`
    which elements are there in the phase, [n_elem] bool.
    """
    known = [own for own, ours in zip(there, concerned, strict=True) if ours]
    if name == "temperature" or any(isinstance(own, jax.core.Tracer) for own in known):
        return
    if not any(own.any() for own in known):
        checks.warn_user(
            f"{label}: has no effect: none of the elements that take it is there in this phase"
        )


def _concerns_absent_element(label, where, given, group, there) -> bool | Bool[jax.Array, ""]:
    """Return whether values `given` for a group concern elements that are not `there`.

    ValueError if that is known (not traced).
    """
    hint = "give the value in the phase that adds it, or in a later one"
    if isinstance(given, Only):
        lost = given.element_mask(len(group.links), f"{label}{where}") & ~there
        if isinstance(lost, jax.core.Tracer):
            return jnp.any(lost)
        if lost.any():
            raise ValueError(
                f"{label}{where}: element {int(lost.argmax())} is not there in this phase; {hint}"
            )
        return False
    if isinstance(there, jax.core.Tracer):
        return ~jnp.any(there)
    if not there.any():
        raise ValueError(f"{label}{where}: no element of the group is there in this phase; {hint}")
    return False


def _warn_of_lost_value(name, label, where, given, present, later):
    """Warn of a value for an element that is absent now and added later without an input.

    Args:
        name, label, where: name of the input, how a user writes it, and its group.
        given: values for the group.
        present: elements that are there in this phase and in all later ones, [n, n_elem] bool.
        later: inputs for the group in later phases, dicts from name to `InputValues`.
    """
    values = None if isinstance(given, Only) else checks.array_if_known(given)
    known = values is not None and not isinstance(present, jax.core.Tracer)
    if name == "temperature" or not known or np.ndim(values) < 1:
        return
    nonzero = (values != 0).reshape(len(values), -1).any(axis=1)
    waits, lost = ~present[0], np.zeros(len(present[0]), bool)
    for comes, inputs in zip(present[1:], later, strict=True):
        for other, stated in inputs.items():
            if other == name or other in ABSOLUTE_INPUTS:
                waits = waits & ~(comes & stated.element_mask())
        lost |= waits & comes
        waits = waits & ~comes
    lost &= True if name in ABSOLUTE_INPUTS else nonzero
    if lost.any():
        k = int(lost.argmax())
        shown = ", ".join(f"{number:.6g}" for number in np.atleast_1d(values[k]))
        checks.warn_user(
            f"{label}{where}[{k}] = {shown}: has no effect: the element is not there in this "
            "phase; give the value in the phase that adds it"
        )
