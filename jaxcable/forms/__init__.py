"""Form finding: shapes, tensions and unstressed lengths that an analysis can begin with."""

from .equivalent_prestress import EquivalentPrestress, equivalent_prestress
from .feasible_prestress import Prestress, feasible_prestress
from .force_density import force_density
from .form import Form
from .hanging_cables import catenary_curves, end_tensions, hanging_chain
from .prescribed_forces import find_form
from .relaxation import dynamic_relaxation
from .self_stress import SelfStress, self_stress
from .symmetry import symmetric_groups

__all__ = [
    "EquivalentPrestress",
    "Form",
    "Prestress",
    "SelfStress",
    "catenary_curves",
    "dynamic_relaxation",
    "end_tensions",
    "equivalent_prestress",
    "feasible_prestress",
    "find_form",
    "force_density",
    "hanging_chain",
    "self_stress",
    "symmetric_groups",
]
