"""The tangent stiffness of a state and what follows: modes, vibration, flexibility, buckling."""

from .buckling import Buckling, buckling_factor
from .flexibility import flexibility
from .imperfections import Modes, imperfect, modes
from .tangent import tangent_stiffness
from .vibration import STANDARD_GRAVITY, Vibration, natural_frequencies

__all__ = [
    "STANDARD_GRAVITY",
    "Buckling",
    "Modes",
    "Vibration",
    "buckling_factor",
    "flexibility",
    "imperfect",
    "modes",
    "natural_frequencies",
    "tangent_stiffness",
]
