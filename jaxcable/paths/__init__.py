"""To failure: paths followed by arc length, stability, buckling, vibration, flexibility."""

from .buckling import Buckling, buckling_factor
from .events import (
    BIFURCATION,
    FAILURES,
    LIMIT_POINT,
    MATERIAL_FAILURE,
    NAMES,
    SLACKENING,
    TIGHTENING,
    Events,
)
from .flexibility import flexibility
from .result import TracedPath
from .trace import trace_path
from .vibration import Vibration, natural_frequencies

__all__ = [
    "BIFURCATION",
    "FAILURES",
    "LIMIT_POINT",
    "MATERIAL_FAILURE",
    "NAMES",
    "SLACKENING",
    "TIGHTENING",
    "Buckling",
    "Events",
    "TracedPath",
    "Vibration",
    "buckling_factor",
    "flexibility",
    "natural_frequencies",
    "trace_path",
]
