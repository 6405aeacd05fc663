"""Motion about and from a loaded state: natural modes, response in time, wind."""

from .damping import Dashpots, ModalDamping, Rayleigh
from .dynamic_factors import dynamic_factors
from .energy_balance import EnergyBalance
from .response import Transient
from .transient import Removal, transient

__all__ = [
    "Dashpots",
    "EnergyBalance",
    "ModalDamping",
    "Rayleigh",
    "Removal",
    "Transient",
    "dynamic_factors",
    "transient",
]
