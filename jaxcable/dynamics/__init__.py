"""Motion about and from a loaded state: natural modes, response in time, wind."""

from ..loads.masses import STANDARD_GRAVITY
from .damping import Dashpots, ModalDamping, Rayleigh
from .dynamic_factors import dynamic_factors
from .energy_balance import EnergyBalance
from .gust_response import GustResponse, gust_response, peak_factor
from .load_histories import falling_load, wind_forces, wind_velocities
from .modes import NaturalModes, modes
from .response import Transient
from .transient import Removal, transient
from .turbulence import Turbulence

__all__ = [
    "STANDARD_GRAVITY",
    "Dashpots",
    "EnergyBalance",
    "GustResponse",
    "ModalDamping",
    "NaturalModes",
    "Rayleigh",
    "Removal",
    "Transient",
    "Turbulence",
    "dynamic_factors",
    "falling_load",
    "gust_response",
    "modes",
    "peak_factor",
    "transient",
    "wind_forces",
    "wind_velocities",
]
