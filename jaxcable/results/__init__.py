"""Results of analyses, and quantities derived from them: section forces, stresses, energies."""

from ..analysis.phase_results import Path, PhaseResult, PhaseResults
from ..analysis.solution import Solution, State
from .energy import EnergyBalance, energy_balance
from .internal_forces import section_forces
from .stresses import fibre_stress

__all__ = [
    "EnergyBalance",
    "Path",
    "PhaseResult",
    "PhaseResults",
    "Solution",
    "State",
    "energy_balance",
    "fibre_stress",
    "section_forces",
]
