"""Elements that phases add and remove: which are there in which phase, and which nodes wait.

Masks are NumPy arrays, or traced: a batch of building sequences is one program.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np

from ..common import checks
from ..common.selection import Only, Selection, WholeGroups
from ..common.types import Array, ArrayLike, Bool
from ..elements.element import Element
from ..elements.element_state import ElementState
from ..mechanics.bundles import Bundles
from ..model.structure import Structure
from .by_group import spread
from .phases import Phase


class Presence(NamedTuple):
    """Which elements are there, per group.

    Attributes:
        first: before the first phase, [n_elem] bool.
        present: in every phase, [n_phase, n_elem] bool.
        sound: whether a phase adds only what is not there, and removes only what is, [n_phase]
            bool, traced; None if that is known (else it has been refused).
    """

    first: list[Bool[ArrayLike, " n_elem"]]
    present: list[Bool[ArrayLike, "n_phase n_elem"]]
    sound: Bool[Array, " n_phase"] | None = None

    def bundled(self, bundles: Bundles) -> Presence:
        """The same for bundles of groups."""
        if bundles.plain:
            return self

        def one(parts, axis):
            return [
                _package(parts).concatenate([parts[k] for k in numbers], axis=axis)
                for numbers in bundles.members
            ]

        return Presence(one(self.first, 0), one(self.present, 1), self.sound)

    def idle(
        self, structure: Structure, groups: Sequence[Element]
    ) -> Bool[ArrayLike, "1+n_phase n_row n_freedom"]:
        """Freedoms that no element touches, before the first phase and in every phase.

        Args:
            structure: `Structure`.
            groups: the groups of `self` with links that are rows of motion.
        """
        (rows, _), width = structure.rows(), structure.space.n_freedom
        n_row = structure.n_node if rows is None else len(rows.node_of_row)
        pack = _package([*self.first, *self.present])
        shape = 1 + len(self.present[0]), n_row, width
        touched = pack.zeros(shape, bool)
        for group, first, present in zip(groups, self.first, self.present, strict=True):
            there = pack.concatenate([first[None], present])
            links = group.links.array
            over = pack.broadcast_to(there[:, :, None, None], (*there.shape, links.shape[1], 1))
            if pack is jnp:
                touched = touched.at[:, links, : group.n_freedom].max(over)
            else:
                for k in range(shape[0]):
                    touched[k, links[there[k]].ravel(), : group.n_freedom] = True
        return ~_shared(touched, structure, rows, pack)


def _shared(touched, structure, rows, pack):
    """Touched freedoms, where hinged ends touch their nodes, and carried nodes their carriers."""
    if rows is not None:
        more = np.arange(structure.n_node, len(rows.node_of_row))
        ends = more[~rows.inner[more]]  # they move with their nodes, and need no hold
        node = rows.node_of_row[ends]
        if pack is jnp:
            touched = touched.at[:, node, :3].max(touched[:, ends, :3])
            touched = touched.at[:, ends, :3].set(True)
        else:
            for k in range(len(touched)):
                touched[k, node[touched[k, ends, 0]], :3] = True
            touched[:, ends, :3] = True
    if structure.rigid is not None:
        carrier, carried = structure.rigid.array.T
        if pack is jnp:
            touched = touched.at[:, carrier].max(touched[:, carried])
            touched = touched.at[:, carried].set(True)
        else:
            for k in range(len(touched)):
                np.logical_or.at(touched[k], carrier, touched[k, carried])
            touched[:, carried] = True
    return touched


def presence_of(
    structure: Structure,
    phases: Sequence[Phase],
    states: Sequence[ElementState] | None,
    earlier: int = 0,
) -> Presence | None:
    """The `Presence` of the elements of a structure; None if all are there in all phases.

    An element is absent before the phase that adds it.

    Args:
        structure, phases: of the analysis.
        states: of the groups, if the analysis continues another one.
        earlier: number of phases solved before, by which messages number the phases.

    Raises:
        ValueError: a phase adds what is there, or removes what is not; an unknown group or element.
    """
    asked = [phase.adds is not None or phase.removes is not None for phase in phases]
    known = None if states is None else [state.present for state in states]
    if known is not None and all(present is None for present in known):
        known = None
    if not any(asked) and known is None:
        return None
    named = structure.named_groups()
    for where, group in named:
        if type(group).found is Element.found:
            raise ValueError(
                f"adds, removes: elements{where} ({type(group).__name__}) cannot come and go; it "
                "needs a method `found`, and a state with `present`"
            )
    changes = [
        (
            _masks(phase.adds, structure, f"phases[{earlier + k}].adds"),
            _masks(phase.removes, structure, f"phases[{earlier + k}].removes"),
        )
        for k, phase in enumerate(phases)
    ]
    first, present, sound = [], [], jnp.ones(len(phases), bool)
    for number, (where, group) in enumerate(named):
        own = [(adds[number], removes[number]) for adds, removes in changes]
        pack = _package([mask for pair in own for mask in pair])
        count = len(group.links)
        if states is None:
            there = pack.ones(count, bool)
            for adds, removes in reversed(own):
                there = pack.where(adds, False, pack.where(removes, True, there))
        elif known is None or known[number] is None:
            there = pack.ones(count, bool)
        else:
            there = known[number]
            pack = _package([there, *(mask for pair in own for mask in pair)])
        first.append(there)
        rows = []
        for k, (adds, removes) in enumerate(own):
            wrong = _wrong(earlier + k, where, there, adds, removes)
            if wrong is not None:
                sound = sound.at[k].set(sound[k] & ~wrong)
            there = (there | adds) & ~removes
            rows.append(there)
        present.append(pack.stack(rows))
    return Presence(first, present, sound if isinstance(sound, jax.core.Tracer) else None)


def idle_of(
    structure: Structure, states: Sequence[ElementState]
) -> Bool[np.ndarray, "n_row n_freedom"] | None:
    """Freedoms that no element touches in these states of the groups; None if all are there.

    Raises:
        ValueError: which elements are there is being traced.
    """
    present = [state.present for state in states]
    if all(there is None for there in present):
        return None
    if any(isinstance(there, jax.core.Tracer) for there in present):
        raise ValueError("state: which elements are there is being traced")
    first = [np.asarray(there) for there in present]
    presence = Presence(first, [there[None] for there in first])
    return presence.idle(structure, structure.rows()[1])[0]


def attached_of(phases: Sequence[Phase]) -> Bool[np.ndarray, " n_phase"] | None:
    """Which phases place new nodes "attached", [n_phase] bool; None if none does."""
    found = np.array([phase.placed == "attached" for phase in phases])
    return found if found.any() else None


def _package(masks):
    """The module that computes with masks: NumPy unless one is traced."""
    return jnp if any(isinstance(mask, jax.core.Tracer) for mask in masks) else np


def _masks(value: Any, structure, name):
    """Masks of all groups, a list of [n_elem] bool, from what a phase adds or removes."""
    counts = [len(group.links) for group in structure.groups]
    if value is None:
        return [np.zeros(count, bool) for count in counts]
    if isinstance(value, WholeGroups):
        return _named(value, structure, name)
    found = []
    for given, count in zip(spread(value, structure, name), counts, strict=True):
        if given is None:
            found.append(np.zeros(count, bool))
        elif isinstance(given, Selection):
            found.append(given.element_mask(count, name))
        elif isinstance(given, Only):
            raise ValueError(f"{name}: only(...) has values here; give only(elements)")
        elif isinstance(given, WholeGroups):
            raise ValueError(f"{name}: give keys of groups alone, not inside of a tree")
        else:
            found.append(_mask(given, count, name))
    return found


def _mask(given, count, name):
    """A mask [n_elem] from booleans [n_elem], or one for all."""
    mask = given if isinstance(given, jax.Array) else np.asarray(given)
    if mask.dtype != bool or mask.shape not in ((), (count,)):
        raise ValueError(
            f"{name}: expected keys of groups, only(elements), or booleans [{count}], got "
            f"{mask.dtype} {mask.shape}"
        )
    return (jnp if isinstance(mask, jax.Array) else np).broadcast_to(mask, (count,))


def _named(value, structure, name):
    """Masks of whole groups, by their keys."""
    numbers = structure.arrange(list(range(len(structure.groups))))
    found = [np.zeros(len(group.links), bool) for group in structure.groups]
    for key in value.names:
        try:
            chosen = jax.tree.leaves(numbers[key])
        except (KeyError, IndexError, TypeError):
            keys = numbers if isinstance(numbers, dict) else ()
            raise ValueError(
                f"{name} = {key!r}: no such key in the structure's elements"
                f"{checks.suggest_names(key, keys)}"
            ) from None
        for k in chosen:
            found[k] = np.ones_like(found[k])
    return found


def _wrong(k, where, there, adds, removes):
    """Whether a phase adds what is there, or removes what is not, scalar bool, traced.

    None if that is known and not so; ValueError if it is so.
    """
    wrong = None
    for mask, not_so, name, text in (
        (adds & removes, True, "adds, removes", "both name"),
        (adds, there, "adds", "is there already:"),
        (removes, ~there, "removes", "is not there:"),
    ):
        bad = mask & not_so
        if isinstance(bad, jax.core.Tracer):
            wrong = jnp.any(bad) if wrong is None else wrong | jnp.any(bad)
        elif bad.any():
            raise ValueError(
                f"phases[{k}].{name}: {text} element {int(bad.argmax())} of elements{where}"
            )
    return wrong
