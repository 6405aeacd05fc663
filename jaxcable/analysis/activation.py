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
from .group_values import value_per_group
from .phases import Phase


class Activation(NamedTuple):
    """Which elements of every group are active (there) in which phase.

    Attributes:
        present_at_start: before the first phase, per group [n_elem] bool.
        present: in every phase, per group [n_phase, n_elem] bool.
        is_consistent: whether a phase adds only what is not there, and removes only what is,
            [n_phase] bool, traced; None if that is known (contradictions have been refused).
    """

    present_at_start: list[Bool[ArrayLike, " n_elem"]]
    present: list[Bool[ArrayLike, "n_phase n_elem"]]
    is_consistent: Bool[Array, " n_phase"] | None = None

    def on_bundles(self, bundles: Bundles) -> Activation:
        """Return the same masks joined for bundles (groups evaluated as one) in place of groups."""
        if bundles.are_groups:
            return self

        def one(parts, axis):
            return [
                checks.numpy_or_jax(parts).concatenate([parts[k] for k in numbers], axis=axis)
                for numbers in bundles.group_indices
            ]

        return Activation(one(self.present_at_start, 0), one(self.present, 1), self.is_consistent)

    def inactive_dofs(
        self, structure: Structure, groups: Sequence[Element]
    ) -> Bool[ArrayLike, "1+n_phase n_row n_freedom"]:
        """Find degrees of freedom that no active element has, before and in every phase.

        Args:
            structure: `Structure`.
            groups: the groups of `self` with links that are rows of motion.

        Returns:
            True where inactive, [1 + n_phase, n_row, n_freedom].
        """
        (rows, _), width = structure.motion_rows(), structure.space.n_freedom
        n_row = structure.n_node if rows is None else len(rows.node_of_row)
        pack = checks.numpy_or_jax(self.present_at_start, self.present)
        shape = 1 + len(self.present[0]), n_row, width
        touched = pack.zeros(shape, bool)
        for group, first, present in zip(groups, self.present_at_start, self.present, strict=True):
            there = pack.concatenate([first[None], present])
            links = group.links.array
            over = pack.broadcast_to(there[:, :, None, None], (*there.shape, links.shape[1], 1))
            own = width if group.gives_rotations else 3
            if pack is jnp:
                touched = touched.at[:, links, :own].max(over)
            else:
                for k in range(shape[0]):
                    touched[k, links[there[k]].ravel(), :own] = True
        return ~_extend_active_dofs_to_joined_nodes(touched, structure, rows, pack)


def _extend_active_dofs_to_joined_nodes(touched, structure, rows, pack):
    """Extend a mask of active degrees of freedom from hinged ends and rigid links to their nodes.

    `touched` says what active elements have, [1 + n_phase, n_row, n_freedom], `rows` are the
    `MotionRows` or None, `pack` is NumPy or jax.numpy.
    """
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


def make_activation(
    structure: Structure,
    phases: Sequence[Phase],
    states: Sequence[ElementState] | None,
    earlier: int = 0,
) -> Activation | None:
    """Find which elements are there in which phase; None if all are there in all phases.

    An element is absent before the phase that adds it.

    Args:
        structure, phases: of the analysis.
        states: element states at the start if the analysis continues another one, else None.
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
        if type(group).state_at_activation is Element.state_at_activation:
            number = asked.index(True) if any(asked) else 0
            raise ValueError(
                f"phases[{earlier + number}].adds, removes: elements{where} "
                f"({type(group).__name__}) cannot be added or removed; write "
                "its method `state_at_activation`, and "
                "give its state the field `present` (see jaxcable.extend)"
            )
    changes = [
        (
            element_masks(phase.adds, structure, f"phases[{earlier + k}].adds"),
            element_masks(phase.removes, structure, f"phases[{earlier + k}].removes"),
        )
        for k, phase in enumerate(phases)
    ]
    first, present = [], []
    sound: Any = np.ones(len(phases), bool)
    for number, (where, group) in enumerate(named):
        own = [(adds[number], removes[number]) for adds, removes in changes]
        pack = checks.numpy_or_jax(own)
        count = len(group.links)
        if states is None:
            there = pack.ones(count, bool)
            for adds, removes in reversed(own):
                there = pack.where(adds, False, pack.where(removes, True, there))
        elif known is None or known[number] is None:
            there = pack.ones(count, bool)
        else:
            there = checks.as_numpy_if_known(known[number])
            pack = checks.numpy_or_jax(there, own)
        first.append(there)
        rows = []
        for k, (adds, removes) in enumerate(own):
            wrong = _contradicts_presence(earlier + k, where, there, adds, removes)
            if wrong is not None:
                sound = jnp.asarray(sound).at[k].set(sound[k] & ~wrong)
            there = (there | adds) & ~removes
            rows.append(there)
        present.append(pack.stack(rows))
    return Activation(first, present, sound if isinstance(sound, jax.core.Tracer) else None)


def find_inactive_dofs(
    structure: Structure, states: Sequence[ElementState]
) -> Bool[np.ndarray, "n_row n_freedom"] | None:
    """Find degrees of freedom that no active element has, by element `states` of all groups.

    Returns:
        True where inactive, [n_row, n_freedom]; None if all elements are there.

    Raises:
        ValueError: which elements are there is being traced.
    """
    present = [state.present for state in states]
    if all(there is None for there in present):
        return None
    if any(isinstance(there, jax.core.Tracer) for there in present):
        raise ValueError("state: is being traced, so that it is not known which elements are there")
    first = [np.asarray(there) for there in present]
    presence = Activation(first, [there[None] for there in first])
    return presence.inactive_dofs(structure, structure.motion_rows()[1])[0]


def attached_placement_mask(phases: Sequence[Phase]) -> Bool[np.ndarray, " n_phase"] | None:
    """Return which phases have ``placed="attached"``, [n_phase] bool; None if none of them has.

    In these phases nodes that new elements bring have moved rigidly with active nodes.
    """
    found = np.array([phase.placed == "attached" for phase in phases])
    return found if found.any() else None


def element_masks(value: Any, structure: Structure, name: str) -> list[Bool[ArrayLike, " n_elem"]]:
    """Convert a choice of elements to masks, [n_elem] bool for each group of the structure.

    Args:
        value: `WholeGroups`; or selections and booleans in the shape of the elements; None: no
            element.
        name: of the argument, for messages.

    Raises:
        ValueError: anything else, unknown groups or elements.
    """
    counts = [len(group.links) for group in structure.groups]
    if value is None:
        return [np.zeros(count, bool) for count in counts]
    if isinstance(value, WholeGroups):
        return _masks_of_whole_groups(value, structure, name)
    found = []
    keys = [key for key, _ in structure.named_groups()]
    for given, count, key in zip(
        value_per_group(value, structure, name), counts, keys, strict=True
    ):
        if given is None:
            found.append(np.zeros(count, bool))
        elif isinstance(given, Selection):
            found.append(given.element_mask(count, f"{name}{key}"))
        elif isinstance(given, Only):
            raise ValueError(f"{name}{key}: only(...) has values here; give only(elements)")
        elif isinstance(given, WholeGroups):
            raise ValueError(f"{name}: give keys of groups alone, not inside a dict or list")
        else:
            found.append(_as_element_mask(given, count, f"{name}{key}"))
    return found


def _as_element_mask(given, count, name):
    """Return booleans [count], or one for all, as a mask [count], NumPy where they are known.

    ValueError, which begins with `name`, for anything else.
    """
    mask = checks.as_numpy_if_known(given)
    if mask.dtype != bool or mask.shape not in ((), (count,)):
        raise ValueError(
            f"{name}: expected keys of groups, only(elements), or {count} booleans, got "
            f"{mask.dtype} of shape {mask.shape}"
        )
    return checks.numpy_or_jax(mask).broadcast_to(mask, (count,))


def _masks_of_whole_groups(value, structure, name):
    """Convert `WholeGroups` to masks, [n_elem] bool for every group: true for groups it names.

    ValueError, which begins with `name`, for a key that the structure's elements do not have.
    """
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


def _contradicts_presence(k, where, there, adds, removes):
    """Return whether phase `k` adds what is there, or removes what is not, traced scalar bool.

    None if nothing is traced.

    Raises:
        ValueError: it does so, and that is known.
    """
    wrong = None
    for mask, not_so, name, text in (
        (adds & removes, True, "adds, removes", "is in both; give it in one of them"),
        (adds, there, "adds", "is there already; leave it out"),
        (removes, ~there, "removes", "is not there; leave it out"),
    ):
        bad = mask & not_so
        if isinstance(bad, jax.core.Tracer):
            wrong = jnp.any(bad) if wrong is None else wrong | jnp.any(bad)
        elif bad.any():
            raise ValueError(
                f"phases[{k}].{name}: element {int(bad.argmax())} of elements{where} {text}"
            )
    return wrong
