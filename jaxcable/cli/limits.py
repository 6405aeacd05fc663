"""Limits on displacements and tensions in ``optimize``: how far off, and what is said of them.

States are given by the name of their case in words, such as " in ULS 6.10-2"; "" for the phases.
"""

from __future__ import annotations

from argparse import Namespace
from collections.abc import Mapping

import jax.numpy as jnp
import numpy as np

from .. import design
from ..analysis.solution import Solution
from ..common.types import Array, Float
from ..common.units import Units
from ..model.result_parts import (
    items_per_group,
    named_groups_of,
    present_elements,
    slack_elements,
    values_per_group,
)
from ..model.structure import Structure
from . import inputs

ROUNDING = 1e-9
"""Relative to a limit: two analyses of the same numbers differ by less."""
_MOST_NAMED = 12
"""Largest number of slack elements of a group, and of cases with such, that are named."""
_NEARLY_SLACK = 0.01
"""Tension over the largest of all cables below which a cable is slack in practice.

Prestress is never installed so precisely that less remains for sure.
"""
_STRENGTH_WIDTH = 0.005
"""Width of the smooth maximum of utilizations, -."""
_STRAIN = 1e-3
"""What strains of cables are divided by: a gross violation of a limit is then about 1."""


def _limited_values(structure, values, lowest):
    """Return element values by group, a list, with None for groups without a limit on tensions.

    Limited are cables; with `lowest`, N, not None, all elements of a structure without cables.
    `values` are [n_elem] in the shape of the elements.
    """
    cables = [group.tension_only for group in structure.groups]
    limited = cables if any(cables) or lowest is None else [True] * len(cables)
    pairs = zip(items_per_group(structure, values), limited, strict=True)
    return [value if chosen else None for value, chosen in pairs]


def tension_margins(
    structure: Structure, solution: Solution, lowest: float | None
) -> list[Float[Array, " n_elem"]]:
    """Return the margins of tensions above a limit, relative to it, [n_elem] by limited group.

    With `lowest`, N, a margin is tension / lowest - 1; with None it is the distance of a cable from
    slack. A slack cable has its (negative) strain from where it goes slack, over 1e-3, since its
    force has no derivative. Inactive elements have margin 1.
    """
    margins = []
    parts = (
        _limited_values(structure, solution.tension, lowest),
        items_per_group(structure, design.slack_distance(structure, solution)),
        items_per_group(structure, solution.present),
    )
    for force, strain, present in zip(*parts, strict=True):
        if force is None:
            continue
        strain = 0.0 * force if strain is None else strain / _STRAIN
        above = strain if lowest is None else force / lowest
        margin = jnp.where(strain < 0, strain, above) - (0.0 if lowest is None else 1.0)
        margins.append(margin if present is None else jnp.where(present > 0, margin, 1.0))
    return margins


def utilization_bound(structure: Structure, solution: Solution) -> list[Float[Array, ""]]:
    """Return a smooth upper bound of the largest utilization of active elements, -, in a list.

    The list is empty if no element has a strength. The bound is above the largest of n utilizations
    by at most 0.005 log n.
    """
    used = zip(
        _utilizations(structure, solution),
        items_per_group(structure, solution.present),
        strict=True,
    )
    counted = [
        one if present is None else jnp.where(present > 0, one, 0.0)
        for one, present in used
        if one is not None
    ]
    return [design.smooth_max(counted, _STRENGTH_WIDTH)] if counted else []


def _utilizations(structure, solution):
    """Return force / strength by group, [n_elem] each; None for groups without a strength."""
    if all(group.strength is None and not group.has_rupture for group in structure.groups):
        return [None] * len(structure.groups)
    return items_per_group(structure, design.utilization(structure, solution))


def describe_limits(
    structure: Structure,
    ends: Mapping[str, Solution],
    options: Namespace,
    units: Units,
    *,
    slack_governs: bool = False,
) -> list[str]:
    """Return lines on the largest displacement, and on each limit: met, or violated by how much.

    `ends` has the `Solution` of each case by its name in words; numbers are in `units`.
    `slack_governs`: of the limits, only that no cable is slack restricts the search.
    """
    lasts = {name: end.phases[-1] for name, end in ends.items()}
    moved = {
        name: inputs.largest_displacement(structure, p.displacement_in_phase, p.present, units)
        for name, p in lasts.items()
    }
    name = max(moved, key=lambda name: moved[name][0])
    reached, where = moved[name]
    of = "the last phase"
    if "" not in ends:
        of = f"{len(ends)} combinations, from the prestressed state"
    if options.deflection is None:
        lines = [f"largest displacement of {of}: {where}{name}"]
    else:
        limit = units.text(options.deflection, "m")
        limit = f"limit on displacements of {of}: {limit}"
        verdict = _limit_verdict(reached / options.deflection - 1.0)
        lines = [f"{limit}, reached {where}{name}: {verdict}"]
    lowest = _extreme_element(
        structure, ends, lambda end: _limited_values(structure, end.tension, options.lowest), -1
    )
    if lowest is not None and options.target is None and not options.allow_slack:
        lines.append(_describe_lowest_tension(structure, ends, lowest, options, units))
        if slack_governs:
            lines[-1] += "; no other limit governs"
    used = _extreme_element(structure, ends, lambda end: _utilizations(structure, end), 1)
    if used is not None:
        most = f"{used[0]:.3g}, {used[1]}"
        if options.target is None:
            verdict = _limit_verdict(used[0] - 1.0)
            lines.append(f"limit on force / strength: 1, reached {most}: {verdict}")
        elif used[0] > 1.0 + ROUNDING:  # a target has no limits
            lines.append(f"STRENGTH EXCEEDED: largest force / strength {most}")
    return lines


def _describe_lowest_tension(structure, ends, lowest, options, units):
    """Return a line on the lowest tension of all cases, and whether its limit is met.

    `lowest` is a pair: this tension, N, and where it occurs, in words; `ends` are as of
    `describe_limits`.
    """
    force, where = lowest
    reached = f"{units.text(force, 'N')}, {where}"
    if options.lowest is not None:
        limit = f"limit on the lowest tension at the end: {units.text(options.lowest, 'N')}"
        return f"{limit}, reached {reached}: {_limit_verdict(1.0 - force / options.lowest)}"
    if describe_slack_elements(structure, ends):
        return f"limit on slack: no cable may be slack, lowest tension {reached}: violated"
    doubt = _nearly_slack_warning(structure, ends, units)
    return f"cables are kept taut: lowest tension {reached}: met{doubt}"


def _nearly_slack_warning(structure, ends, units):
    """Return a text on cables that are nearly slack in any case; "" if there are none.

    They are those with less than 1 % of the largest tension of all cables and cases. `ends` has the
    `Solution` of each case; numbers are in `units`.
    """
    cases = []
    for end in ends.values():
        limited = _limited_values(structure, end.tension, None)
        pairs = zip(limited, present_elements(structure, end.present), strict=True)
        known = [np.where(there, force, np.nan) for force, there in pairs if force is not None]
        cases.append(np.concatenate(known))
    forces = np.array(cases)
    most, lowest = np.nanmax(forces), np.fmin.reduce(forces)
    count = int((lowest < _NEARLY_SLACK * most).sum())
    if not count:
        return ""
    return (
        f", BUT ONLY JUST: {count} of {int(np.isfinite(lowest).sum())} cables have less than "
        f"{_NEARLY_SLACK:.0%} of the largest tension, {units.text(most, 'N')}, and are slack in "
        "practice; --lowest FORCE keeps more"
    )


def _extreme_element(structure, ends, values_of, sign):
    """Return the largest value of all active elements in all cases, and where; None without any.

    Args:
        structure: `Structure`.
        ends: `Solution` of each case by its name in words.
        values_of: function of a `Solution` to a list, [n_elem] or None for each group.
        sign: 1 for the largest value, -1 for the smallest.
    """
    found = []
    for case, end in ends.items():
        parts = (
            named_groups_of(structure),
            values_of(end),
            present_elements(structure, end.present),
        )
        for (name, _), values, present in zip(*parts, strict=True):
            if values is None or not present.any():
                continue
            k = int(np.where(present, sign * np.asarray(values, float), -np.inf).argmax())
            where = f"element {k} of {name!r}{case}" if name else f"element {k}{case}"
            found.append((float(values[k]), where))
    return max(found, key=lambda one: sign * one[0], default=None)


def describe_slack_elements(structure: Structure, ends: Mapping[str, Solution]) -> list[str]:
    """Return lines on the slack elements of each group at the end of all phases, or of each case.

    `ends` has the `Solution` of each case by its name in words.
    """
    lines = []
    for case, solution in ends.items():
        parts = (
            named_groups_of(structure),
            values_per_group(structure, solution.tension),
            present_elements(structure, solution.present),
        )
        for (name, group), force, present in zip(*parts, strict=True):
            slack = np.flatnonzero(slack_elements(group, force, present))
            if len(slack):
                shown = [*map(str, slack[:_MOST_NAMED]), *["..."] * (len(slack) > _MOST_NAMED)]
                where = f" of {name!r}" if name else ""
                lines.append(
                    f"SLACK at the end{case}: {len(slack)} of {len(group.links)} elements{where}: "
                    f"{', '.join(shown)}"
                )
    more = len(lines) - _MOST_NAMED
    return [*lines[:_MOST_NAMED], *[f"and {more} more such lines"] * (more > 0)]


def _limit_verdict(excess):
    """Return "met" or "violated by 4.9 %"; `excess` is the excess over the limit, divided by it."""
    return "met" if excess <= ROUNDING else f"violated by {100 * excess:.2g} %"
