"""Factorise and solve: the only place that knows matrix formats."""

from .dense import Factor, factorize, solve_definite, solve_general

__all__ = ["Factor", "factorize", "solve_definite", "solve_general"]
