"""Reports of results: reactions, equilibrium, forces, lengths to cut, what is slack."""

from .report import Report, report
from .table import Table

__all__ = ["Report", "Table", "report"]
