"""State and results of cables that slide with friction."""

from __future__ import annotations

from ..common.tree import pytree
from ..common.types import Array, Float
from .element import Result
from .prestress import AxialState
from .slip_search import Jack

SEGMENT_TENSION = Result("segment_tension", "N")
"""Tension of every straight segment of a cable between successive nodes; 0 for fillers."""
SLIP = Result("slip", "m")
"""Unstressed length that has slipped over every deviator so far, towards the next segment."""
FRICTION_USED = Result("friction_used", "-")
"""Logarithm of the ratio of tensions at every deviator over the largest that friction allows: 1
where the cable slips towards the next segment, -1 where it slips back, beyond at a clamp."""
CLAMP_FORCE = Result("clamp_force", "N")
"""Difference of the tensions at every clamp, that of the next segment less that before; else 0."""
CONTACT_ARC = Result("contact_arc", "m")
"""Length of a cable on every saddle that has a radius; negative where it would lift off."""
CONTACT_PRESSURE = Result("contact_pressure", "N/m")
"""Force per length of a cable on every saddle, the larger of the tensions over the radius."""
SADDLE_MOMENT = Result("saddle_moment", "N m", ("x", "y", "z"))
"""Moment of a cable on every node with a saddle that has a radius, about x, y, z."""
CONTACT_RESULTS = CONTACT_ARC, CONTACT_PRESSURE, SADDLE_MOMENT
"""Results of saddles with a radius."""
DEVIATOR_RESULTS = SLIP, FRICTION_USED, CLAMP_FORCE, *CONTACT_RESULTS
"""Results that have a number for every deviator."""


@pytree
class FrictionState(AxialState):
    """State of cables that slide with friction: also clamps, stressed ends and lengths fed in.

    Attributes:
        clamped: 1 where a cable is clamped to a deviator, else 0, [n_elem, n_deviator].
        fed_length: unstressed length fed in at the first and the last end, where a jack or a
            shortening acts: it is in the first or the last segment only, [n_elem, 2], m, at the
            reference temperature; negative where the cable is pulled out.
        stressed_ends: 1 for the ends, first and last, at which jacks pull and shortenings are taken
            out, [n_elem, 2].
        initial_slip: slip over each deviator, relative to the initial nodes and towards the next
            segment, with which a cable of the initial length is added to the displaced nodes, so
            that all segments have one strain, [n_elem, n_deviator], m.
    """

    clamped: Float[Array, "n_elem n_deviator"] = None  # type: ignore[assignment]  # always given
    fed_length: Float[Array, "n_elem 2"] = None  # type: ignore[assignment]  # always given
    stressed_ends: Float[Array, "n_elem 2"] = None  # type: ignore[assignment]  # always given
    initial_slip: Float[Array, "n_elem n_deviator"] = None  # type: ignore[assignment]  # always given

    @property
    def jack(self) -> Jack | None:
        """Jacks at the ends of one cable in this phase; None without a jack."""
        if self.jack_force is None:
            return None
        at = self.stressed_ends > 0
        at = at if self.jacked is None else at & self.jacked
        return Jack(self.jack_force, at[0], at[1])

    @property
    def thermal_stretch_or_one(self) -> float | Float[Array, " n_elem"]:
        """Thermal stretch, unstressed length over that at the reference temperature; 1 for None."""
        return 1.0 if self.thermal_stretch is None else self.thermal_stretch
