"""Reliability: random quantities, probabilities of failure, tolerances that they allow."""

from .distributions import Distribution, Gumbel, Lognormal, Normal, Uniform
from .first_order import first_order
from .first_order_result import DesignPoints, FirstOrder
from .quantities import Quantities
from .sampling import SamplingResult, importance_sampling
from .systems import SeriesSystem, series_system
from .tolerance_budget import ToleranceBudget, tolerance_budget
from .value_correlation import normal_correlation

__all__ = [
    "DesignPoints",
    "Distribution",
    "FirstOrder",
    "Gumbel",
    "Lognormal",
    "Normal",
    "Quantities",
    "SamplingResult",
    "SeriesSystem",
    "ToleranceBudget",
    "Uniform",
    "first_order",
    "importance_sampling",
    "normal_correlation",
    "series_system",
    "tolerance_budget",
]
