"""Form finding: shapes, tensions and unstressed lengths that an analysis can begin with."""

from .feasible import Prestress, feasible_prestress
from .force_density import force_density
from .form import Form
from .hanging import catenary_curves, end_tensions, hanging_chain
from .prescribed import find_form
from .relaxation import dynamic_relaxation
from .self_stress import SelfStress, self_stress
from .statements import Statements, statements
from .symmetry import symmetric_groups

__all__ = [
    "Form",
    "Prestress",
    "SelfStress",
    "Statements",
    "catenary_curves",
    "dynamic_relaxation",
    "end_tensions",
    "feasible_prestress",
    "find_form",
    "force_density",
    "hanging_chain",
    "self_stress",
    "statements",
    "symmetric_groups",
]
