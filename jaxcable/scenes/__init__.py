"""Ready scenes: a structure and its phases, `jc.solve(*scene)`."""

from .accuracy import accuracy_cable
from .hypar import hypar_net
from .masts import guyed_mast, strung_arch
from .nets import Scene, flat_net, saddle
from .saddle_net import saddle_net

__all__ = [
    "Scene",
    "accuracy_cable",
    "flat_net",
    "guyed_mast",
    "hypar_net",
    "saddle",
    "saddle_net",
    "strung_arch",
]
