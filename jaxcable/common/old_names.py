"""Old names: refuse them in a contract, and take them as arguments with a warning.

An analysis would ignore a method of an old name, and use the default of the base class instead.
"""

from __future__ import annotations

import functools
import warnings
from collections.abc import Callable, Mapping
from typing import Any, TypeVar

Function = TypeVar("Function", bound=Callable[..., Any])

ELEMENT = {
    "remembers": "has_memory",
    "rising": "monotone",
    "breaks": "has_rupture",
    "size": "absolute_force",
    "settle": "commit_memory",
    "settled": "committed_memory",
    "beyond": "is_ruptured",
    "extended": "extrapolated",
    "risen": "without_softening",
    "found": "state_at_activation",
    "partly": "with_activation",
    "unstressed": "unstressed_state",
    "reading": "results_by_name",
    "linearized": "forces_and_tangent",
    "finds_both": "evaluates_forces_with_tangent",
    "end_forces_about": "end_forces_after_step",
    "slid": "sliding_load_forces",
    "oriented": "with_fixed_axes",
    "stiffness_along": "linear_axial_stiffness",
    "at_ends": "split_among_ends",
    "inner": "inner_unknowns",
    "restate": "apply_statements",
    "between": "interpolate_states",
    "lock": "lock_off",
    "rounding": "rounding_error",
    "deflected": "end_slopes_and_axes",
    "pulls": "has_tension_unknown",
    "fits_cones": "suits_cone_solver",
    "pulled": "tension_response",
    "brought": "rebased_element",
    "room": "length_slack",
    "bent": "geometric_stiffness",
}
"""New names by old ones, of methods and attributes of elements."""
STATE = {
    "loaded": "load_bearing_length",
    "only_present": "zero_where_absent",
    "warmth": "thermal_stretch",
}
"""New names by old ones, of members of element states."""
LAW = {
    "rising": "monotone",
    "breaks": "has_rupture",
    "settle": "commit_memory",
    "beyond": "is_ruptured",
    "extended": "extrapolated",
    "risen": "without_softening",
    "falls": "softening_stresses",
    "softened": "in_series_with_spring",
    "size_at": "stress_scale_at",
    "corners": "corner_strains",
    "limits": "strain_limits",
}
"""New names by old ones, of methods and attributes of laws."""

LOAD = {
    "among": "with_group_numbers",
    "bundled": "on_bundles",
    "touched": "with_bundle_numbers",
    "asks_begun": "needs_begin_nodes",
    "per_length": "load_per_length",
    "pressing": "bending_pressure",
    "partly": "apply_factors",
    "touches": "coupled_nodes",
    "steps": "nodal_movements",
    "at_nodes": "forces_at_nodes",
    "measured": "measuring_positions",
    "selected": "loaded_groups",
}
"""New names by old ones, of methods of loads."""


def refuse_old_names(cls: type, renamed: Mapping[str, str]) -> None:
    """Raise TypeError if a user's class still defines a method under its former name.

    Args:
        cls: class that derives from a base class of the package.
        renamed: present names of methods by former ones. A field of the class may have such a name.
    """
    for base in cls.__mro__:
        if base.__module__.split(".")[0] == __package__.split(".")[0]:
            continue
        for name, value in vars(base).items():
            if name in renamed and (isinstance(value, bool | property) or callable(value)):
                raise TypeError(f"{cls.__name__}: `{name}` is now called `{renamed[name]}`")


def takes_old_argument(old: str, new: str) -> Callable[[Function], Function]:
    """Return a decorator: the function takes an argument by its former name, too.

    That causes a DeprecationWarning; with both names the function raises TypeError.

    Args:
        old, new: former and present name of the argument.
    """

    def decorate(function: Function) -> Function:
        @functools.wraps(function)
        def translated(*args, **options):
            if old in options and new not in options:
                text = f"{function.__name__}: {old} is called {new} now"
                warnings.warn(text, DeprecationWarning, stacklevel=2)
                options[new] = options.pop(old)
            return function(*args, **options)

        return translated  # type: ignore[return-value]  # of the same signature

    return decorate
