"""Design: objectives on solutions, and ways to reach them by exact gradients."""

from .actions import Action
from .cable_checks import CableFatigue, CableResistance, CableSafety, CableService
from .cable_loss import loss_of_cable
from .check import Check
from .checks import CheckResult, Checks, checks
from .combination_rules import combination_rules
from .combinations import Combinations, combinations
from .confidence import Confidence, confidence
from .constrained import ConstrainedDesign, minimize_subject_to
from .fit import Fit, FitHistory, fit
from .influence import adjustment, flat_matrix, influence, propagate_tolerances
from .influence_line import InfluenceLine, influence_line
from .kinks import nearest_kink, slack_distance, slack_margin
from .limit_checks import DisplacementLimit, OwnCheck, ReactionLimit, TensionLimit
from .load_cases import Envelope, envelope, solve_cases, utilization
from .member_buckling import MemberBuckling, buckling_factors
from .member_checks import MemberSection
from .minimize import Design, History, minimize
from .moving_loads import WorstPosition, moving_load, worst_position
from .objectives import (
    largest_deflection,
    material_use,
    mean_over_cases,
    shape_distance,
    smooth_max,
    smooth_min,
    tension_distance,
    tension_spread,
    total_prestress,
)
from .result_envelopes import ResultEnvelope
from .targets import Target
from .tune import Tuned, tune

__all__ = [
    "Action",
    "CableFatigue",
    "CableResistance",
    "CableSafety",
    "CableService",
    "Check",
    "CheckResult",
    "Checks",
    "Combinations",
    "Confidence",
    "ConstrainedDesign",
    "Design",
    "DisplacementLimit",
    "Envelope",
    "Fit",
    "FitHistory",
    "History",
    "InfluenceLine",
    "MemberBuckling",
    "MemberSection",
    "OwnCheck",
    "ReactionLimit",
    "ResultEnvelope",
    "Target",
    "TensionLimit",
    "Tuned",
    "WorstPosition",
    "adjustment",
    "buckling_factors",
    "checks",
    "combination_rules",
    "combinations",
    "confidence",
    "envelope",
    "fit",
    "flat_matrix",
    "influence",
    "influence_line",
    "largest_deflection",
    "loss_of_cable",
    "material_use",
    "mean_over_cases",
    "minimize",
    "minimize_subject_to",
    "moving_load",
    "nearest_kink",
    "propagate_tolerances",
    "shape_distance",
    "slack_distance",
    "slack_margin",
    "smooth_max",
    "smooth_min",
    "solve_cases",
    "tension_distance",
    "tension_spread",
    "total_prestress",
    "tune",
    "utilization",
    "worst_position",
]
