"""Reports of results: reactions, forces and stresses of elements, lengths, what is slack."""

from .report import Report, report
from .table import Table

__all__ = ["Report", "Table", "report"]
