"""Motion about and from a loaded state: natural modes, response in time, wind."""

from ..loads.masses import STANDARD_GRAVITY
from .gust_response import GustResponse, gust_response, peak_factor
from .load_histories import falling_load, wind_forces, wind_velocities
from .modes import NaturalModes, modes
from .turbulence import Turbulence

__all__ = [
    "STANDARD_GRAVITY",
    "GustResponse",
    "NaturalModes",
    "Turbulence",
    "falling_load",
    "gust_response",
    "modes",
    "peak_factor",
    "wind_forces",
    "wind_velocities",
]
