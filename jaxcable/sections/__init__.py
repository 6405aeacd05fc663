"""Fibre sections: a cross-section as areas with a uniaxial law each."""

from .section import Section
from .strains import SectionState

__all__ = ["Section", "SectionState"]
