"""Fibre sections: a cross-section as areas with a uniaxial law each."""

from .section import Section
from .strains import SectionState
from .torsion import bredt_torsion

__all__ = ["Section", "SectionState", "bredt_torsion"]
