"""Factorise and solve: the only place that knows matrix formats."""

from .dense import Factor, factorize, solve_definite

__all__ = ["Factor", "factorize", "solve_definite"]
