"""What is prescribed of elements in a form: forces, stresses, densities or lengths, by group."""

from __future__ import annotations

import numpy as np

from ..analysis.group_values import is_single_number
from ..common import checks
from ..common.selection import Only
from ..common.tree import Indices, pytree
from ..common.types import Array, ArrayLike, Bool, Float, Int, PyTree
from ..model.result_parts import group_path
from ..model.structure import Structure
from .input_checks import (
    is_straight,
    require_single_input,
    require_straight_elements,
    values_by_group,
)

_NAMES = ("tension", "stress", "force_density", "length")


@pytree(static=("sought",))
class PrescribedValues:
    """Prescribed forces, force densities and lengths of a form, lists with an item for each group.

    Of a group either all elements have a prescribed value or none: then its items are None, and the
    group keeps its own law.

    Attributes:
        forces: prescribed forces, [n_elem], N; zero where something else is prescribed.
        densities: force densities, [n_elem], N/m, zero where none is prescribed.
        lengths: given lengths, [n_elem], m, with 1 where none is prescribed.
        sought: whether the length is given and the force sought, `Indices` [n_elem] of bool.
    """

    forces: list[Float[Array, " n_elem"] | None]
    densities: list[Float[Array, " n_elem"] | None]
    lengths: list[Float[Array, " n_elem"] | None]
    sought: tuple[Indices, ...]

    @property
    def is_prescribed(self) -> list[bool]:
        """Whether the elements of a group have prescribed values, a bool for every group."""
        return [force is not None for force in self.forces]

    @property
    def has_lengths(self) -> bool:
        """Whether the length of any element is given."""
        return any(mask.array.any() for mask in self.sought)

    @property
    def given_elements(self) -> list[Int[np.ndarray, " n_given"]]:
        """Indices of the elements of given length, a NumPy array [n_given] for each group."""
        return [np.flatnonzero(mask.array) for mask in self.sought]

    @property
    def given_lengths(
        self,
    ) -> list[tuple[Float[Array, " n_elem"] | None, Bool[np.ndarray, " n_elem"]]]:
        """For each group the pair of lengths, [n_elem], m, and whether they are given, [n_elem]."""
        pairs = zip(self.lengths, self.sought, strict=True)
        return [(length, mask.array) for length, mask in pairs]


def read_prescribed_values(
    structure: Structure,
    tension: PyTree[Float[ArrayLike, " ..."] | Only] | None,
    stress: PyTree[Float[ArrayLike, " ..."] | Only] | None = None,
    length: PyTree[Float[ArrayLike, " ..."] | Only] | None = None,
    force_density: PyTree[Float[ArrayLike, " ..."] | Only] | None = None,
) -> PrescribedValues:
    """Check what `find_form` is told of elements, and return the `PrescribedValues`.

    A single number is for all groups of straight elements with two ends.

    Raises:
        ValueError: nothing is prescribed; an element has two values, or none although others of its
            group have one; a value of elements that are not straight; wrong values.
    """
    values, chosen = {}, {}
    given = (tension, stress, force_density, length)
    for name, value in zip(_NAMES, given, strict=True):
        if value is not None and is_single_number(value):
            kinds = [value if is_straight(group) else None for group in structure.groups]
            value = structure.arrange(kinds)
        is_length = name == "length"
        values[name], chosen[name] = values_by_group(value, structure, name, is_length)
    prescribed = [any(mask.any() for mask in masks) for masks in zip(*chosen.values(), strict=True)]
    if not any(prescribed):
        raise ValueError(
            "tension: nothing is prescribed; give tension, stress, force_density or length of one "
            "or more groups"
        )
    require_straight_elements(structure, prescribed)
    missing = "has neither tension, stress, force_density nor length"
    masks = [chosen[name] for name in _NAMES]
    require_single_input(structure, _NAMES, masks, missing, prescribed)
    return PrescribedValues(
        _prescribed_forces(structure, values, chosen, prescribed),
        _values_where_chosen(values["force_density"], chosen["force_density"], prescribed, 0.0),
        _values_where_chosen(values["length"], chosen["length"], prescribed, 1.0),
        tuple(map(Indices, chosen["length"])),
    )


def _values_where_chosen(values, chosen, prescribed, otherwise):
    """Return values per group where they are `chosen`, else the number `otherwise`.

    An item is None if the group has no prescribed value. Masks `chosen` are [n_elem] bool.
    """
    filled = [otherwise if value is None else value for value in values]
    return [
        checks.numpy_or_jax(value).where(mask, value, otherwise) if own else None
        for value, mask, own in zip(filled, chosen, prescribed, strict=True)
    ]


def _prescribed_forces(structure, values, chosen, prescribed):
    """Return forces by tensions and stresses, per group, [n_elem], N; None unless `prescribed`.

    `values` and `chosen` are dicts of the values and of where they are given, by name.
    """
    found = []
    for k, group in enumerate(structure.groups):
        if not prescribed[k]:
            found.append(None)
            continue
        forces: ArrayLike = np.zeros(len(group.links))
        if values["tension"][k] is not None:
            stated = values["tension"][k]
            forces = checks.numpy_or_jax(stated).where(chosen["tension"][k], stated, forces)
        if chosen["stress"][k].any():
            area = group._stiffness_law_and_area()[2]
            if area is None:
                raise ValueError(f"stress: {group_path(structure, k)} has no area; give tension")
            given = chosen["stress"][k], values["stress"][k] * area, forces
            forces = checks.numpy_or_jax(given).where(*given)
        found.append(forces)
    return found
