"""Ready scenes: a structure and its phases, `jc.solve(*scene)`."""

from .accuracy_study import accuracy_cable
from .building_blocks import Scene
from .hypar import hypar_net
from .masts import guyed_mast
from .nets import flat_net, saddle
from .saddle_net import saddle_net
from .snap_through import von_mises_truss
from .spoked_wheels import roof_ring
from .suspension_bridges import suspension_footbridge
from .tensegrity import simplex

__all__ = [
    "Scene",
    "accuracy_cable",
    "flat_net",
    "guyed_mast",
    "hypar_net",
    "roof_ring",
    "saddle",
    "saddle_net",
    "simplex",
    "suspension_footbridge",
    "von_mises_truss",
]
