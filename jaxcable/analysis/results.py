"""Results that the last state, the end of a phase and a solution have in common."""

from __future__ import annotations

import dataclasses
from collections.abc import Callable
from typing import Any, TypeVar

from ..common.tree import copy_with, pytree
from ..common.types import Array, Float, PyTree
from ..numerics.rotations import rotation_vectors
from ..programs.program_calls import as_program

_FIELD_OF_RESULT = {
    "tension": "tension",
    "peak_tension": "peak_tension",
    "section_forces": "section_forces",
    "section_strain": "strain",
}
"""Results of elements that have a field of their own: their names in elements, and the fields."""

_ELEMENT_FIELDS = (*_FIELD_OF_RESULT.values(), "rest_length", "began")

Part = TypeVar("Part", bound="ElementResults")


class ElementResults:
    """Base of results that contain results of elements.

    Attributes:
        results: results of elements beside tensions, section forces and strains, by name, in the
            shape of `elements`: `present` where elements come and go, and those that elements of
            your own state.
    """

    results: dict[str, PyTree[Float[Array, "n_elem ..."]]] | None

    @property
    def element_results(self) -> dict[str, PyTree[Float[Array, "n_elem ..."]]]:
        """All results of elements, a dict by name, each in the shape of `elements`.

        These are ``tension``, ``peak_tension``, ``section_forces``, ``section_strain`` as far as
        there are such elements, and `results`.

        Example:
            >>> structure, phases = jc.scenes.flat_net(load=15.0)
            >>> solution = jc.solve(structure, phases)
            >>> print(solution.status, list(solution.element_results))
            0 ['tension', 'peak_tension']
        """
        fields = {name: getattr(self, field, None) for name, field in _FIELD_OF_RESULT.items()}
        present = {name: value for name, value in fields.items() if value is not None}
        return present | (self.results or {})

    @property
    def present(self) -> PyTree[Float[Array, " n_elem"]] | None:
        """Which elements are there: 1, or 0 for one that a phase has yet to add, or has removed.

        In the shape of `elements`, as in `element_results`; None if elements neither come nor go.

        Example:
            >>> bars = jc.Bars([[0, 1], [1, 2]], axial_stiffness=1e6)
            >>> guide = jc.pinned([0]) + jc.restrained([1, 2], "xy")
            >>> chain = jc.Structure([[0, 0, 0], [0, 0, -1.0], [0, 0, -2.0]], bars, supports=guide)
            >>> solution = jc.solve(chain, [jc.Phase(), jc.Phase(adds=jc.only([1]))])
            >>> print(solution.status, *(phase.present for phase in solution.phases))
            0 [1. 0.] [1. 1.]
        """
        return (self.results or {}).get("present")


@pytree
class StateResults(ElementResults):
    """Results at one state of the structure; `Solution` describes its fields.

    `State`, `PhaseResult` and `Solution` derive from it.
    """

    displacement: Float[Array, "n_node 3"]
    positions: Float[Array, "n_node 3"]
    tension: PyTree[Float[Array, " n_elem"]]
    rest_length: PyTree[Float[Array, " n_elem"]]
    reactions: Float[Array, "n_node 3"]
    load: Float[Array, "n_node 3"]
    rotation: Float[Array, "n_node 4"] | None = None
    reaction_moments: Float[Array, "n_node 3"] | None = None
    section_forces: PyTree[Float[Array, "n_elem n_point 6"]] | None = None
    peak_tension: PyTree[Float[Array, " n_elem"]] = None
    results: dict[str, PyTree[Float[Array, "n_elem ..."]]] | None = None

    @property
    def rotation_vector(self) -> Float[Array, "n_node 3"] | None:
        """Rotations of the nodes against the initial geometry as rotation vectors, rad.

        The direction is the axis of a rotation, the length its angle from 0 to pi. None without
        beams. `results.node_tilts` and `results.element_tilts` have tilt and twist.

        Example:
            >>> section = jc.Section.rectangle(0.1, 0.2, jc.Elastic(10e9))
            >>> nodes = [[0.0, 0.0, 0.0], [2.0, 0.0, 0.0]]
            >>> beam = jc.Beams([[0, 1]], section=section)
            >>> structure = jc.Structure(nodes, beam, supports=jc.clamped([0]))
            >>> moment = jc.NodalLoads([1], (0.0, 0.0, 0.0), moments=(0.0, 1e4, 0.0))
            >>> solution = jc.solve(structure, jc.Phase(loads=moment))
            >>> print(solution.status, f"{solution.phases[0].rotation_vector[1, 1]:.6f}")  # M L/EI
            0 0.030000
        """
        return None if self.rotation is None else _rotation_vectors(self.rotation)


_rotation_vectors = as_program(rotation_vectors)

RESULT_NAMES = tuple(field.name for field in dataclasses.fields(StateResults))
"""Names of the results that a `State`, a `PhaseResult` and a `Solution` have."""


def result_fields(part: StateResults) -> dict[str, Any]:
    """Return the `StateResults` of a state, phase result or solution, a dict by name."""
    return {name: getattr(part, name) for name in RESULT_NAMES}


def fields_of_element_results(
    found: dict[str, list[Float[Array, " ..."] | None]],
) -> dict[str, Any]:
    """Sort results of elements by the field of `ElementResults` that holds them: return a dict.

    `found` has, for each name of a result, a list with an array per group. Results without a field
    of their own are a dict in the field `results`.
    """
    fields = {field: found[name] for name, field in _FIELD_OF_RESULT.items() if name in found}
    others = {name: values for name, values in found.items() if name not in _FIELD_OF_RESULT}
    return fields | {"results": others}


def map_element_fields(
    part: Part, function: Callable[[PyTree[Array]], PyTree[Array]], **changes: Any
) -> Part:
    """Return a copy with `function` applied to every field that has an item for each group.

    `changes` are values for other fields.
    """
    fields = vars(part)
    there = [name for name in _ELEMENT_FIELDS if fields.get(name) is not None]
    others = {name: function(values) for name, values in (part.results or {}).items()}
    changes |= {name: function(fields[name]) for name in there}
    return copy_with(part, **changes, results=others)


def fill_peak_tensions(part: Part) -> Part:
    """Return a copy in which groups without peak tension have their tension as peak tension."""
    fields = vars(part)
    pairs = zip(fields["tension"], fields["peak_tension"], strict=True)
    return copy_with(part, peak_tension=[own if peak is None else peak for own, peak in pairs])
