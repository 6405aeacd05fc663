"""Profiles and cables by name, from tables with their sources, and by formulas of standards.

Each number has a source, which the records name. A manufacturer's certificate replaces a table:
`load` reads one of your own.
"""

from .cables import CableData, cable, cable_names, load
from .conductors import Conductor, Layer, conductor
from .profiles import ProfileData, profile, profile_data, profile_names
from .ropes import rope

__all__ = [
    "CableData",
    "Conductor",
    "Layer",
    "ProfileData",
    "cable",
    "cable_names",
    "conductor",
    "load",
    "profile",
    "profile_data",
    "profile_names",
    "rope",
]
