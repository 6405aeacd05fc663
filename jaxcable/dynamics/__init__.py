"""Motion about and from a loaded state: natural modes, response in time, wind."""

from ..loads.masses import STANDARD_GRAVITY
from .modes import NaturalModes, modes

__all__ = ["STANDARD_GRAVITY", "NaturalModes", "modes"]
