"""Element laws, one a file: internal force from end state.

`element` is the contract: the base class `Element`. `abilities` has further base classes for what
only some elements can do (`Prestressable`, `Jacked`, `Sagging`, `Secant`, `Rounding`, `Bending`).
`prestress` has the state of elements with an unstressed length.
"""

from .bar import Bars
from .beam import Beams
from .cable import Cables
from .catenary import Catenaries
from .prestress import AxialState
from .sliding import SlidingCables

__all__ = [
    "AxialState",
    "Bars",
    "Beams",
    "Cables",
    "Catenaries",
    "SlidingCables",
]
