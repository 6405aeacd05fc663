"""Guyed masts: sections and guys, wind by direction with gusts on patches, ice, tensions on site.

A `GuyedMast` is made of sections and levels of guys, `erect` finds the lengths of its guys, and
`analyse` its cases: states times directions times patches; `study_mast` does a whole job.
"""

from .gust_effects import extremes
from .guy_rupture import rupture
from .guyed_mast import GuyedMast
from .mast_analysis import (
    ErectedMast,
    MastForces,
    MastResults,
    analyse,
    ancillary_masses,
    erect,
    forces_of,
)
from .mast_components import Ancillary, GuyLevel, MastSection
from .mast_files import MastJob, load_mast, save_mast
from .mast_parts import guy_level, lattice_drag, lattice_section, tube_section
from .mast_site import (
    Retensioning,
    retension,
    tension_from_frequency,
    tension_from_sag,
    with_tensions,
)
from .mast_states import MastState, eurocode_state, tia_state
from .mast_study import MastStudy, plot_mast, study_mast

__all__ = [
    "Ancillary",
    "ErectedMast",
    "GuyLevel",
    "GuyedMast",
    "MastForces",
    "MastJob",
    "MastResults",
    "MastSection",
    "MastState",
    "MastStudy",
    "Retensioning",
    "analyse",
    "ancillary_masses",
    "erect",
    "eurocode_state",
    "extremes",
    "forces_of",
    "guy_level",
    "lattice_drag",
    "lattice_section",
    "load_mast",
    "plot_mast",
    "retension",
    "rupture",
    "save_mast",
    "study_mast",
    "tension_from_frequency",
    "tension_from_sag",
    "tia_state",
    "tube_section",
    "with_tensions",
]
