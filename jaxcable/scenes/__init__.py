"""Ready scenes: a structure and its phases, `jc.solve(*scene)`."""

from .accuracy import accuracy_cable
from .bridges import cable_stayed_bridge
from .cables import isolated_cable, suspended_cable
from .domes import geiger_dome, levy_dome
from .hypar import hypar_net
from .masts import guyed_mast, strung_arch
from .nets import Scene, flat_net, saddle
from .saddle_net import saddle_net
from .snapping import lee_frame, toggle_frame, von_mises_truss
from .suspended_bridges import suspension_footbridge
from .tensegrity import simplex
from .tents import tent_edge
from .trusses import cable_truss
from .wheels import roof_ring

__all__ = [
    "Scene",
    "accuracy_cable",
    "cable_stayed_bridge",
    "cable_truss",
    "flat_net",
    "geiger_dome",
    "guyed_mast",
    "hypar_net",
    "isolated_cable",
    "lee_frame",
    "levy_dome",
    "roof_ring",
    "saddle",
    "saddle_net",
    "simplex",
    "strung_arch",
    "suspended_cable",
    "suspension_footbridge",
    "tent_edge",
    "toggle_frame",
    "von_mises_truss",
]
