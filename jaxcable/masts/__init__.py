"""Guyed masts: sections and guys, wind by direction with gusts on patches, ice, tensions on site.

A `GuyedMast` is made of sections and levels of guys, `erect` finds the lengths of its guys, and
`analyse` its cases: states times directions times patches; `study_mast` does a whole job.
"""

from .guyed_mast import Ancillary, GuyedMast, GuyLevel, MastSection
from .mast_analysis import (
    ErectedMast,
    MastForces,
    MastResults,
    analyse,
    ancillary_masses,
    erect,
    extremes,
    forces_of,
    rupture,
)
from .mast_parts import guy_level, lattice_drag, lattice_section, tube_section
from .mast_states import MastState, eurocode_state, tia_state

__all__ = [
    "Ancillary",
    "ErectedMast",
    "GuyLevel",
    "GuyedMast",
    "MastForces",
    "MastResults",
    "MastSection",
    "MastState",
    "analyse",
    "ancillary_masses",
    "erect",
    "eurocode_state",
    "extremes",
    "forces_of",
    "guy_level",
    "lattice_drag",
    "lattice_section",
    "rupture",
    "tia_state",
    "tube_section",
]
