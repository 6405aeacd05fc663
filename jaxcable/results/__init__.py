"""Results of analyses, and quantities derived from them: section forces, stresses, energies."""

from ..analysis.phase_results import Path, PhaseResult, PhaseResults
from ..analysis.solution import Solution, State
from .cable_sags import horizontal_tensions, nodes_along, sags
from .clearances import (
    Clearance,
    clearance_over_ground,
    clearance_to_plane,
    distance_to_line,
)
from .energy import EnergyBalance, energy_balance
from .internal_forces import section_forces
from .rotations import Tilt, element_tilts, node_tilts, rotation_vectors
from .sag import Sag
from .stresses import fibre_stress

__all__ = [
    "Clearance",
    "EnergyBalance",
    "Path",
    "PhaseResult",
    "PhaseResults",
    "Sag",
    "Solution",
    "State",
    "Tilt",
    "clearance_over_ground",
    "clearance_to_plane",
    "distance_to_line",
    "element_tilts",
    "energy_balance",
    "fibre_stress",
    "horizontal_tensions",
    "node_tilts",
    "nodes_along",
    "rotation_vectors",
    "sags",
    "section_forces",
]
