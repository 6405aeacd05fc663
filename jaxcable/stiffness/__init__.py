"""The tangent stiffness of a state and what follows: modes, flexibility, buckling."""

from .buckling import Buckling, buckling_factor
from .flexibility import flexibility
from .imperfections import Modes, imperfect, modes
from .tangent import tangent_stiffness

__all__ = [
    "Buckling",
    "Modes",
    "buckling_factor",
    "flexibility",
    "imperfect",
    "modes",
    "tangent_stiffness",
]
