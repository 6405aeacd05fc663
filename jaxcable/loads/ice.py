"""Weight of ice around members, a dead load along them."""

from __future__ import annotations

from typing import Any, Self

import numpy as np

from ..common import checks
from ..common.rules import Rule, not_negative, refuse_if_broken
from ..common.selection import Selection
from ..common.tree import pytree, set_fields
from ..common.types import Array, ArrayLike, Float
from ..model.structure import Structure
from .along import AlongElements
from .groups import Key
from .masses import STANDARD_GRAVITY
from .member_values import check_member_values, require_members, with_member_factors

_PER_MEMBER = ("thickness", "diameter")
_THICKEST = 0.3  # m, beyond which ice is most likely in millimeters


@pytree(static=("on",))
class IceLoads(AlongElements):
    """Weight of ice of an even thickness around cables, bars, catenaries and beams.

    The weight per unstressed length is that of a hollow cylinder, ``gravity density pi thickness
    (diameter + thickness)``. Half of that of an element acts at each of its ends; beams bend and
    catenaries hang under it. On sliding cables it slides along, as `SelfWeight` does. It acts on
    elements whenever they are there (`Phase`).

    The ice does not fall off, has no stiffness, and no mass: `dynamics.modes` does
    not know of it. Ice on half of the guys is a case of its own:
    give a thickness to each element. Wind blows at iced members by `ice` of `WindLoads`.

    Args:
        thickness: thickness of the ice, scalar or [n_elem], m.
        diameter: diameter of the members without ice, scalar or [n_elem], m.
        density: density of the ice, kg/m3; default 900, that of glaze. ISO 12494 has 600 to 900
            for hard rime, 300 to 600 for wet snow, 200 to 600 for soft rime.
        on: key of the loaded group in the structure's elements, such as "guys", or its place from 0
            where these are a list; None loads all groups whose elements have a length.
        elements: `Selection` of the elements of that group that are iced; None means all.
        direction: direction and factor of the weight, [3], without unit; default (0, 0, -1).
        gravity: acceleration of gravity, m/s2; default 9.80665.

    Raises:
        ValueError: wrong shapes, negative thickness, diameter or density (traced ones end in
            INVALID_INPUT); where a phase is analysed, a group or element that the structure does
            not have, or a group without length.

    Source: ISO 12494:2001, Atmospheric icing of structures, Table 1 (densities).

    Example:
        Glaze of 20 mm on a guy of 20 mm: ``9.80665 * 900 * pi * 0.02 * 0.04`` is 22.18 N/m.

        >>> nodes = [[0.0, 0.0, 0.0], [60.0, 0.0, 0.0]]
        >>> guy = jc.Catenaries([[0, 1]], axial_stiffness=30e6, rest_length=60.0)
        >>> structure = jc.Structure(nodes, guy, supports=jc.pinned([0, 1]))
        >>> solution = jc.solve(structure, jc.Phase(loads=jc.IceLoads(0.02, 0.02)))
        >>> print(solution.status, f"{-solution.load[:, 2].sum() / 60.0:.2f} N/m")
        0 22.18 N/m
    """

    thickness: Float[ArrayLike, ""] | Float[ArrayLike, " n_elem"]
    diameter: Float[ArrayLike, ""] | Float[ArrayLike, " n_elem"]
    density: Float[ArrayLike, ""] = 900.0
    on: Key = None
    elements: Selection | None = None
    direction: Float[ArrayLike, " 3"] = (0.0, 0.0, -1.0)
    gravity: Float[ArrayLike, ""] = STANDARD_GRAVITY
    element_factors: dict[int, Float[Array, " n_elem"]] | None = (
        None  # by index of group: area of the ice, m2; set by the analysis
    )

    scales = ("direction",)

    def __post_init__(self):
        self._check_selection()
        check_member_values(self, _PER_MEMBER)
        for name in ("density", "gravity"):
            set_fields(self, **{name: checks.as_scalar(getattr(self, name), name)})
        set_fields(self, direction=checks.floats_of_shape(self.direction, "direction", (3,)))
        refuse_if_broken(self.rules())

    def rules(self) -> list[Rule]:
        """Return the rules that thickness, diameter and density are not negative, a list."""
        names = ("thickness", "diameter", "density")
        return [not_negative(name, getattr(self, name)) for name in names]

    def check(self, structure: Structure) -> None:
        """Raise ValueError if the structure lacks the loaded group, or it has no lengths."""
        require_members(self, structure, _PER_MEMBER)

    def with_group_indices(self, structure: Structure) -> Self:
        """Return the load in the form of an analysis: `on` becomes indices of groups.

        The area of the ice, m2, becomes `element_factors`, zero where the load does not act.
        """
        load = super().with_group_indices(structure)
        return with_member_factors(load, structure, _PER_MEMBER, _ice_area)

    def _distributed_amounts(self, number, group, state, nodes):
        """Return the length of every element of a group, [n_elem], m; None without lengths."""
        return state.load_bearing_length if group.has_length else None

    def _vector_per_amount(self):
        """Return the weight of the ice per volume as a vector, [3], N/m3."""
        return self.density * self.gravity * self.direction


def warn_of_thick_ice(thickness: Float[ArrayLike, "*n"]) -> None:
    """Warn of a known thickness of ice, m, that is most likely in millimeters."""
    known = checks.array_if_known(thickness)
    if known is not None and (known > _THICKEST).any():
        checks.warn_user(f"ice = {known.max():g}: more than {_THICKEST:g} m; it is in meters")


def _ice_area(load: Any) -> Any:
    """Return the cross-sectional area of the ice around members, a scalar or [n_elem], m2."""
    return np.pi * load.thickness * (load.diameter + load.thickness)
