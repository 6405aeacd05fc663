"""What elements tell, by name: which of it are fields of results, and a dict of all of it."""

from __future__ import annotations

from typing import Any

from ..common.types import Array, Float, PyTree

_FIELDS = {
    "tension": "tension",
    "peak_tension": "peak_tension",
    "section_forces": "section_forces",
    "section_strain": "strain",
}
"""What elements tell and results have as a field: its name in elements, and the field."""


def named(found: dict[str, list[Float[Array, " ..."] | None]]) -> dict[str, Any]:
    """Fields of a `Told` from lists of what elements tell, by name."""
    fields = {field: found[name] for name, field in _FIELDS.items() if name in found}
    others = {name: values for name, values in found.items() if name not in _FIELDS}
    return fields | {"results": others}


class Told:
    """Base of results that contain what elements tell.

    Attributes:
        results: what elements tell beside tensions, section forces and strains, by name, in the
            shape of `elements`: `present` where elements come and go, and what elements of your
            own tell.
    """

    results: dict[str, PyTree[Float[Array, "n_elem ..."]]] | None

    @property
    def told(self) -> dict[str, PyTree[Float[Array, "n_elem ..."]]]:
        """All that elements tell, a dict by name, each in the shape of `elements`.

        These are ``tension``, ``peak_tension``, ``section_forces``, ``section_strain`` as far as
        there are such elements, and `results`.

        Example:
            >>> structure, phases = jc.scenes.flat_net(load=15.0)
            >>> solution = jc.solve(structure, phases)
            >>> print(solution.status, list(solution.told))
            0 ['tension', 'peak_tension']
        """
        fields = {name: getattr(self, field, None) for name, field in _FIELDS.items()}
        present = {name: value for name, value in fields.items() if value is not None}
        return present | (self.results or {})

    @property
    def present(self) -> PyTree[Float[Array, " n_elem"]] | None:
        """Which elements are there: 1, or 0 for one that a phase has yet to add, or has removed.

        In the shape of `elements`, as in `told`; None if elements neither come nor go.

        Example:
            >>> bars = jc.Bars([[0, 1], [1, 2]], axial_stiffness=1e6)
            >>> guide = jc.pinned([0]) + jc.restrained([1, 2], "xy")
            >>> chain = jc.Structure([[0, 0, 0], [0, 0, -1.0], [0, 0, -2.0]], bars, supports=guide)
            >>> solution = jc.solve(chain, [jc.Phase(), jc.Phase(adds=jc.only([1]))])
            >>> print(solution.status, *(phase.present for phase in solution.phases))
            0 [1. 0.] [1. 1.]
        """
        return (self.results or {}).get("present")
