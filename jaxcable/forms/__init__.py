"""Form finding: shapes, tensions and unstressed lengths that an analysis can begin with."""

import warnings
from typing import Any

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

_RENAMED = {"Statements": "EquivalentPrestress", "statements": "equivalent_prestress"}


def __getattr__(name: str) -> Any:
    """Return what an old public name stands for, with a warning that tells the new name."""
    if name not in _RENAMED:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    text = f"forms.{name} is now called forms.{_RENAMED[name]}; the old name will be removed"
    warnings.warn(text, DeprecationWarning, stacklevel=2)
    return globals()[_RENAMED[name]]
