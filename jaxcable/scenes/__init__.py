"""Ready scenes: a structure and its phases, `jc.solve(*scene)`."""

from .accuracy import accuracy_cable
from .hypar import hypar_net
from .nets import Scene, flat_net, saddle

__all__ = ["Scene", "accuracy_cable", "flat_net", "hypar_net", "saddle"]
