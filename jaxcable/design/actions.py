"""A named action: loads or changes of an element that a rule multiplies by a factor."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import jax
import numpy as np

from ..common import checks
from ..common.selection import Only, Selection, WholeGroups
from ..common.tree import pytree, set_fields
from ..common.types import ArrayLike, Bool, Float, PyTree
from ..loads import as_list
from ..loads.load import Load

_CHOICES = str, Selection, Only, WholeGroups
"""What a `Phase` takes for lost elements, and the cases of a batch cannot share."""


@pytree(static=("name", "kind", "in_phases", "exclusive", "source", "needs", "excludes"))
class Action:
    """An action with a name and a kind, which `combinations` multiplies by partial factors.

    Args:
        name: of the action, such as "wind from west".
        kind: by which the rules give its factors: "permanent", "prestress", "accidental",
            "seismic", or a variable action such as "snow" and "wind"
            (the rules have all of them under "kinds", see `combination_rules`).
        loads: one load or a list, by their characteristic values.
        temperature: change of the temperature by its characteristic value, as a phase states it, K.
        shortening: of the unstressed length by a turnbuckle, by its characteristic value, as a
            phase states it, m.
        removes: elements that are lost, an accidental action: booleans [n_elem], by group as in a
            phase. They are lost if the factor is not zero. The loss is static: forces for the
            dynamic effect of a sudden one are loads, and `loss_of_cable` returns an action with
            both.
        in_phases: whether the phases before the cases apply the action already, by factor 1, as
            they do a self-weight. A combination with factor 1.35 then adds 0.35 of it. An action
            without loads and changes, such as a prestress, has to be in the phases.
        exclusive: name of a set of variable actions that never act together, such as the
            directions of the wind.
        source: permanent actions of one source have one factor together, unfavourable or
            favourable for all of them (EN 1990, table A1.2, set B, note 3); without a name each
            action is a source of its own. Variable actions of one source are parts of one action,
            such as the imposed load on each of several floors: each part is there or absent, and
            all that are there lead, or accompany another action, together.
        needs: names of actions without which this one does not act: wind on iced members needs ice.
        excludes: names of actions with which this one does not act.

    Raises:
        ValueError: wrong arguments, named.

    Example:
        >>> snow = jc.NodalLoads([1], (0.0, 0.0, -1e3))
        >>> print(jc.design.Action("snow", "snow", snow))
        snow (snow)
    """

    name: str
    kind: str
    loads: Load | Sequence[Load] | None = None
    temperature: PyTree[Float[ArrayLike, ""] | Float[ArrayLike, " n_elem"]] | None = None
    shortening: PyTree[Float[ArrayLike, ""] | Float[ArrayLike, " n_elem"]] | None = None
    removes: PyTree[Bool[ArrayLike, " n_elem"]] | None = None
    in_phases: bool = False
    exclusive: str | None = None
    source: str | None = None
    needs: Sequence[str] = ()
    excludes: Sequence[str] = ()

    def __post_init__(self):
        for name in ("name", "kind"):
            value = getattr(self, name)
            if not isinstance(value, str) or not value.strip():
                raise ValueError(f"{name} = {value!r}: expected a text that is not empty")
        for name in ("needs", "excludes"):
            value = getattr(self, name)
            value = (value,) if isinstance(value, str) else tuple(value)
            if not all(isinstance(other, str) for other in value):
                raise ValueError(f"{name} = {value!r}: expected names of actions")
            set_fields(self, **{name: value})
        as_list(self.loads)
        for name in ("temperature", "shortening"):
            for leaf in jax.tree.leaves(getattr(self, name)):
                checks.as_floats(leaf, name)
        for leaf in jax.tree.leaves(self.removes, is_leaf=lambda x: isinstance(x, _CHOICES)):
            known = None if isinstance(leaf, _CHOICES) else checks.array_if_known(leaf)
            is_wrong = known is not None and (np.ndim(known) != 1 or known.dtype != bool)
            if isinstance(leaf, _CHOICES) or is_wrong:
                raise ValueError(
                    "removes: expected booleans [n_elem], by group, and neither names nor only(): "
                    "the cases of a batch differ in them"
                )
        if not self.has_effects and not self.in_phases:
            raise ValueError(
                f"{self.name!r} has no loads and no changes; give some, or in_phases=True if the "
                "phases before the cases apply it"
            )

    @property
    def has_effects(self) -> bool:
        """Whether the action has loads, a temperature, a shortening or lost elements to apply."""
        parts = self.loads, self.temperature, self.shortening, self.removes
        return any(part is not None and not (isinstance(part, list) and not part) for part in parts)

    def __str__(self) -> str:
        return f"{self.name} ({self.kind})"


def check_actions(actions: Sequence[Any]) -> list[Action]:
    """Return actions as a list.

    Raises ValueError if something else is among them, if two have the same name, or if an action
    needs or excludes one that is unknown, or itself.
    """
    if isinstance(actions, Action):
        actions = [actions]
    if not isinstance(actions, list | tuple) or not actions:
        raise ValueError(
            f"actions: expected a list of Action, got {checks.describe_type(actions, '[Action()]')}"
        )
    for k, one in enumerate(actions):
        if not isinstance(one, Action):
            kind = checks.describe_type(one, 'Action("snow", "snow", loads)')
            raise ValueError(f"actions[{k}]: expected an Action, got {kind}")
    names = [one.name for one in actions]
    for k, one in enumerate(actions):
        if one.name in names[:k]:
            raise ValueError(
                f"actions[{k}]: {one.name!r} is the name of actions[{names.index(one.name)}], too"
            )
        for argument in ("needs", "excludes"):
            for other in getattr(one, argument):
                if other not in names or other == one.name:
                    hint = checks.suggest_names(other, names)
                    raise ValueError(
                        f"actions[{k}]: {argument} = {other!r}: is no other action{hint}"
                    )
    return list(actions)
