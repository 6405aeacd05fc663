"""Reports of results: reactions, forces and stresses of elements, lengths, what is slack."""

from .report import report
from .result_report import Report
from .table import Table

__all__ = ["Report", "Table", "report"]
