"""Fibre sections: a cross-section as many small areas, each with a uniaxial law."""

from .section import Section
from .strains import SectionState
from .torsion import bredt_torsion

__all__ = ["Section", "SectionState", "bredt_torsion"]
