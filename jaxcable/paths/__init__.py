"""To failure: paths followed by arc length, and the events on them."""

from .events import (
    BIFURCATION,
    FAILURES,
    LIMIT_POINT,
    MATERIAL_FAILURE,
    NAMES,
    SLACKENING,
    SLIP,
    TIGHTENING,
    Events,
)
from .result import TracedPath
from .trace import trace_path

__all__ = [
    "BIFURCATION",
    "FAILURES",
    "LIMIT_POINT",
    "MATERIAL_FAILURE",
    "NAMES",
    "SLACKENING",
    "SLIP",
    "TIGHTENING",
    "Events",
    "TracedPath",
    "trace_path",
]
