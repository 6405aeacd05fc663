"""Profiles and cables by name, from tables with their sources, and by formulas of standards.

Each number has a source, which the records name. A manufacturer's certificate replaces a table:
`load` reads one of your own.
"""

from .cables import CableRecord, cable, cable_names, load
from .profiles import ProfileRecord, profile, profile_names, profile_record
from .ropes import rope

__all__ = [
    "CableRecord",
    "ProfileRecord",
    "cable",
    "cable_names",
    "load",
    "profile",
    "profile_names",
    "profile_record",
    "rope",
]
