"""All that is needed to write an element, a uniaxial law, a load or a linear solver of your own.

A class derives from a base class below, which says what to write and has defaults for the rest; an
analysis, derivatives, pictures and reports then treat it as they treat those of the package.

- An element derives from `Element`, or `Straight`; for more from `Prestressable`, `Jackable`, ...
- Its state is an `ElementState`, or `AxialState` for an unstressed length. `check` tries both.
- A uniaxial law derives from `Law`.
- A load derives from `OnNodes`, `PrescribedMovement`, `DeadLoad`, `LoadPerGeometry`,
  `FollowerLoad`; and `OnGroups`. A wind profile for `WindLoads` derives from `WindProfile`.
- A linear solver consists of `Solver`, `Analysis` and `NumericFactor`; `register_solver` tries it.

Elements, states, laws and loads are pytrees: decorate them by `pytree`, which makes them frozen
dataclasses whose fields are arrays; fields with topology are `Indices`. `copy_with` changes fields
without the constructor. `register` lets files hold a class. Results of an element are named by
`Result`, inputs of phases that it knows alone by `PhaseInput`. A constructor converts numbers
(`as_floats`, `floats_per_element`) and refuses those that break a rule (`refuse_if_broken`); with a
method ``rules()`` an analysis also ends in INVALID_INPUT where traced numbers break one.

The classes in `tests/extensions` of the source are complete: springs, links, a membrane, a rope
over a saddle, laws with memory, a wind load, a solver.

Example:
    A linear spring between two nodes, without a length of its own:

    >>> from jaxcable import extend
    >>> @extend.pytree
    ... class Nothing(extend.ElementState):
    ...     '''Phases change nothing in it.'''
    >>> @extend.pytree(indices=("links",))
    ... class Springs(extend.Element):
    ...     links: object
    ...     stiffness: object
    ...     per_element = ("stiffness",)
    ...
    ...     def __post_init__(self):
    ...         count = len(self.links)
    ...         extend.set_fields(self, links=extend.Indices(self.links))
    ...         values = extend.floats_per_element(self.stiffness, count, "stiffness")
    ...         extend.set_fields(self, stiffness=values)
    ...         extend.refuse_if_broken(self.rules())
    ...
    ...     def rules(self):
    ...         return [extend.not_negative("stiffness", self.stiffness)]
    ...
    ...     def start(self, ends):
    ...         return Nothing()
    ...
    ...     def end_forces(self, state, ends, motion):
    ...         pull = self.stiffness * (ends[1] + motion[1] - ends[0] - motion[0])
    ...         return jnp.stack([-pull, pull])
    ...
    ...     def energy(self, state, ends, motion):
    ...         way = ends[1] + motion[1] - ends[0] - motion[0]
    ...         return 0.5 * self.stiffness * way @ way

    Two of them, 200 and 300 N/m, between nodes 5 m apart share it as 3 m to 2 m:

    >>> nodes = [[0.0, 0.0, 0.0], [1.0, 0.0, 0.0], [5.0, 0.0, 0.0]]
    >>> springs = Springs([[0, 1], [1, 2]], [200.0, 300.0])
    >>> extend.check(springs, nodes)
    >>> solution = jc.solve(jc.Structure(nodes, springs, jc.pinned([0, 2])), jc.Phase())
    >>> print(solution.status, jnp.round(solution.positions[1], 9))
    0 [3. 0. 0.]
    >>> Springs([[0, 1]], -1.0)
    Traceback (most recent call last):
    ValueError: stiffness[0] = -1.0: must not be negative
"""

from .common.checks import as_floats, as_indices, floats_per_element
from .common.rules import Rule, not_negative, positive, refuse_if_broken
from .common.tree import Indices, copy_with, pytree, set_fields
from .elements.abilities import (
    Bending,
    Hanging,
    Jackable,
    Prestressable,
    RoundingEstimate,
    SecantStiffness,
    Uniaxial,
)
from .elements.contract import check
from .elements.element import (
    PEAK_TENSION,
    SECTION_FORCES,
    SECTION_STRAIN,
    TENSION,
    Element,
    Result,
)
from .elements.element_state import ElementLoad, ElementState
from .elements.phase_input import InputValues, PhaseInput
from .elements.prestress import AxialState
from .elements.straight import Straight
from .files.codec import register
from .linear.solver import Analysis, NumericFactor, Solver
from .linear.solver import register as register_solver
from .loads.groups import OnGroups
from .loads.load import DeadLoad, FollowerLoad, LoadPerGeometry, OnNodes, PrescribedMovement
from .loads.wind_profiles import WindProfile
from .materials.law import Law
from .numerics import rotations

__all__ = [
    "PEAK_TENSION",
    "SECTION_FORCES",
    "SECTION_STRAIN",
    "TENSION",
    "Analysis",
    "AxialState",
    "Bending",
    "DeadLoad",
    "Element",
    "ElementLoad",
    "ElementState",
    "FollowerLoad",
    "Hanging",
    "Indices",
    "InputValues",
    "Jackable",
    "Law",
    "LoadPerGeometry",
    "NumericFactor",
    "OnGroups",
    "OnNodes",
    "PhaseInput",
    "PrescribedMovement",
    "Prestressable",
    "Result",
    "RoundingEstimate",
    "Rule",
    "SecantStiffness",
    "Solver",
    "Straight",
    "Uniaxial",
    "WindProfile",
    "as_floats",
    "as_indices",
    "check",
    "copy_with",
    "floats_per_element",
    "not_negative",
    "positive",
    "pytree",
    "refuse_if_broken",
    "register",
    "register_solver",
    "rotations",
    "set_fields",
]
