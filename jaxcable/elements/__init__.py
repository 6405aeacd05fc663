"""Element laws, one a file: internal force from end state.

`element` is the contract: the base class `Element`. `abilities` has further base classes for what
only some elements can do (`Prestressable`, `Uniaxial`, `Jackable`, `Hanging`,
`SecantStiffness`, `RoundingEstimate`, `Bending`); `check` tries whether a class of your own keeps
to it. `prestress` has the state of elements with an unstressed length.
"""

from .bar import Bars
from .beam import Beams
from .cable import Cables
from .catenary import Catenaries
from .contact import Contacts
from .contract import check
from .friction_cables import FrictionCables
from .prestress import AxialState
from .sliding import SlidingCables
from .sliding_catenaries import SlidingCatenaries
from .spring import GroundContacts, Springs

__all__ = [
    "AxialState",
    "Bars",
    "Beams",
    "Cables",
    "Catenaries",
    "Contacts",
    "FrictionCables",
    "GroundContacts",
    "SlidingCables",
    "SlidingCatenaries",
    "Springs",
    "check",
]
