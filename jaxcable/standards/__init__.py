"""Formulas of standards: resistances of cables and of steel members, pure functions of numbers."""

from .cables import (
    FATIGUE_CATEGORIES,
    SERVICE_FRACTIONS,
    TERMINATIONS,
    cable_fatigue_strength,
    cable_resistance,
)
from .steel_members import (
    IMPERFECTION_FACTORS,
    SteelSection,
    buckling_reduction,
    critical_force,
    section_utilization,
    steel_section,
)

__all__ = [
    "FATIGUE_CATEGORIES",
    "IMPERFECTION_FACTORS",
    "SERVICE_FRACTIONS",
    "TERMINATIONS",
    "SteelSection",
    "buckling_reduction",
    "cable_fatigue_strength",
    "cable_resistance",
    "critical_force",
    "section_utilization",
    "steel_section",
]
