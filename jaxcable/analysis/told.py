"""What elements tell, by name: what of it results have as fields, and all of it."""

from __future__ import annotations

from typing import Any

from ..common.types import Array, Float, PyTree

_FIELDS = {
    "tension": "tension",
    "peak_tension": "peak_tension",
    "section_forces": "section_forces",
    "section_strain": "strain",
}
"""What elements tell that has a field of its own, and this field."""


def named(found: dict[str, list[Float[Array, " ..."] | None]]) -> dict[str, Any]:
    """What elements tell, by name, as fields of a `Told`."""
    fields = {field: found[name] for name, field in _FIELDS.items() if name in found}
    others = {name: own for name, own in found.items() if name not in _FIELDS}
    return fields | {"results": others}


class Told:
    """What has results of elements.

    Attributes:
        results: what elements tell beside tensions, section forces and strains, by the name that
            they give it, in the shape of `elements`; none of those of this package does.
    """

    results: dict[str, PyTree[Float[Array, "n_elem ..."]]] | None

    @property
    def told(self) -> dict[str, PyTree[Float[Array, "n_elem ..."]]]:
        """All that elements tell, by name, each in the shape of `elements`, a dict.

        ``tension``, ``peak_tension``, ``section_forces``, ``section_strain`` as far as there are
        such elements, and `results`.

        Example:
            >>> structure, phases = jc.scenes.flat_net(load=15.0)
            >>> solution = jc.solve(structure, phases)
            >>> print(solution.status, list(solution.told))
            0 ['tension', 'peak_tension']
        """
        fields = {name: getattr(self, field, None) for name, field in _FIELDS.items()}
        own = {name: value for name, value in fields.items() if value is not None}
        return own | (self.results or {})
