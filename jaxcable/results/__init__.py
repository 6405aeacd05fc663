"""Results of analyses, and quantities derived from them: section forces, stresses, energies."""

from ..analysis.phase_results import Path, PhaseResult, PhaseResults
from ..analysis.solution import Solution, State
from ..analysis.streamed import Study
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
    "Study",
    "energy_balance",
    "fibre_stress",
    "section_forces",
]
