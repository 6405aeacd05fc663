"""Sections: a cross-section as many small areas with a uniaxial law each, or by its stiffnesses."""

from .lattices import lattice
from .linear_section import LinearSection
from .section import Section
from .shear import shear_coefficient
from .strains import SectionState
from .torsion import bredt_torsion

__all__ = [
    "LinearSection",
    "Section",
    "SectionState",
    "bredt_torsion",
    "lattice",
    "shear_coefficient",
]
