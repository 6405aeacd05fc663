"""Statements and loads of a phase for elements that are not there: refused, or a warning.

A statement changes what is there. It is lost on an element that is not there, because this element
is unstressed when it is added. So what names such an element, by `only` or by its group, is refused
(with traced masks the phase ends in INVALID_INPUT). One number for all cables and bars, or numbers
for all elements of a group, are for those that are there.
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
from ..elements.stated import Stated
from ..loads.groups import OnGroups
from ..loads.load import Acting
from ..model.structure import Structure
from .by_group import is_scalar, spread
from .phases import ABSOLUTE, INCREMENTS, Phase, all_stated
from .presence import Presence


def require_present(
    structure: Structure,
    phases: Sequence[Phase],
    statements: Sequence[Sequence[dict[str, Stated]]],
    presence: Presence,
    earlier: int = 0,
) -> Presence:
    """Refuse statements that name elements which are not there: the presence, with its `sound`.

    Args:
        structure, phases: of the analysis.
        statements: statements of every phase and group, as `Phase.statements` gives them.
        presence: which elements are there in which phase.
        earlier: number of phases solved before, by which messages number the phases.

    Raises:
        ValueError: a statement names an element that is known not to be there.
    """
    sound = presence.sound
    for k, phase in enumerate(phases):
        there = [present[k] for present in presence.present]
        for name, value in all_stated(phase).items():
            label = f"phases[{earlier + k}].{name}"
            if is_scalar(value):
                _judge_scalar(name, label, [name in own for own in statements[k]], there)
                continue
            values = spread(value, structure, name)
            parts = zip(values, structure.named_groups(), there, strict=True)
            for number, (given, (where, group), own) in enumerate(parts):
                if given is None or _states_nothing(name, given):
                    continue
                wrong = _named_absent(label, where, given, group, own)
                if isinstance(wrong, jax.core.Tracer):
                    sound = jnp.ones(len(phases), bool) if sound is None else sound
                    sound = sound.at[k].set(sound[k] & ~wrong)
                later = [of_phase[number] for of_phase in statements[k + 1 :]]
                _judge_array(name, label, where, given, presence.present[number][k:], later)
    return presence._replace(sound=sound)


def loads_that_never_act(
    along: Sequence[Sequence[Acting]], presence: Presence, earlier: int = 0
) -> None:
    """Warn of loads on elements none of which is there from the phase of the load on.

    Args:
        along: element loads of every phase, after `among`.
        presence: which elements are there in which phase.
        earlier: number of phases solved before, by which messages number the phases.
    """
    for k, loads in enumerate(along):
        for acting in loads:
            if not isinstance(acting, OnGroups) or not acting.on:  # or a load on stated faces
                continue
            on: Any = acting.on  # numbers of groups, after `among`
            if any(isinstance(presence.present[number], jax.core.Tracer) for number in on):
                continue
            part = acting.part or {}
            acts = [presence.present[n][k:] & _loaded(part.get(n)) for n in on]
            if not any(np.any(one) for one in acts):
                checks.warn_user(
                    f"loads of phases[{earlier + k}]: {acting} acts on elements that are not "
                    "there, neither in this phase nor in a later one"
                )


def _loaded(factors):
    """Which elements a load acts on by its factors, [n_elem, ...] or None: all if not known."""
    known = checks.array_if_known(factors)
    return True if known is None else (known != 0).reshape(len(known), -1).any(axis=1)


def _states_nothing(name, given):
    """Whether a statement is an increment that is known to be zero."""
    values = checks.array_if_known(given.values if isinstance(given, Only) else given)
    return name in INCREMENTS and values is not None and not np.any(values)


def _judge_scalar(name, label, concerned, there):
    """Warn of one number for the whole structure if nothing that it concerns is there."""
    known = [own for own, ours in zip(there, concerned, strict=True) if ours]
    if name == "temperature" or any(isinstance(own, jax.core.Tracer) for own in known):
        return
    if not any(own.any() for own in known):
        checks.warn_user(f"{label}: none of the elements that it is for is there in this phase")


def _named_absent(label, where, given, group, there) -> bool | Bool[jax.Array, ""]:
    """Whether a statement for a group names absent elements; ValueError if that is known."""
    hint = "state it in the phase that adds it, or later"
    if isinstance(given, Only):
        lost = given.element_mask(len(group.links), label) & ~there
        if isinstance(lost, jax.core.Tracer):
            return jnp.any(lost)
        if lost.any():
            of = f" of elements{where}" if where else ""
            raise ValueError(
                f"{label}: element {int(lost.argmax())}{of} is not there in this phase; {hint}"
            )
        return False
    if isinstance(there, jax.core.Tracer):
        return ~jnp.any(there)
    if not there.any():
        raise ValueError(f"{label}{where}: no element of the group is there in this phase; {hint}")
    return False


def _judge_array(name, label, where, given, present, later):
    """Warn of a number for an absent element that a later phase adds without a statement.

    Args:
        name, label, where: of the statement and its group, for messages.
        given: what is stated for the group.
        present: elements that are there in this phase and in all later ones, [n, n_elem] bool.
        later: statements for the group in the later phases, dicts from name to `Stated`.
    """
    values = None if isinstance(given, Only) else checks.array_if_known(given)
    known = values is not None and not isinstance(present, jax.core.Tracer)
    if name == "temperature" or not known or np.ndim(values) < 1:
        return
    nonzero = (values != 0).reshape(len(values), -1).any(axis=1)
    waits, lost = ~present[0], np.zeros(len(present[0]), bool)
    for comes, statements in zip(present[1:], later, strict=True):
        for other, stated in statements.items():
            if other == name or other in ABSOLUTE:
                chosen = True if stated.chosen is None else stated.chosen
                waits = waits & ~(comes & chosen)
        lost |= waits & comes
        waits = waits & ~comes
    lost &= True if name in ABSOLUTE else nonzero
    if lost.any():
        k = int(lost.argmax())
        shown = ", ".join(f"{number:.6g}" for number in np.atleast_1d(values[k]))
        checks.warn_user(
            f"{label}{where}[{k}] = {shown}: the element is not there in this phase, and "
            "the phase that adds it states nothing for it: the number has no effect"
        )
