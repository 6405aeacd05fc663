"""Limits on displacements and tensions in ``optimize``: how far off, and what is said of them.

States are given by the name of their case in words, such as " in ULS 6.10-2"; "" for the phases.
"""

from __future__ import annotations

from argparse import Namespace
from collections.abc import Mapping

import jax
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
_STRAIN = 1e-3
"""What strains of cables are divided by: a gross violation of a limit is then about 1."""


def _limited_groups(structure, values, lowest):
    """Return the values [n_elem], by group, of the groups that limits on tensions are for.

    These are cables; `lowest`, N, if not None, limits all elements of a structure without cables.
    """
    cables = [group.tension_only for group in structure.groups]
    limited = cables if any(cables) or lowest is None else [True] * len(cables)
    pairs = zip(items_per_group(structure, values), limited, strict=True)
    return [value if chosen else None for value, chosen in pairs]


def tension_margins(
    structure: Structure, solution: Solution, lowest: float | None
) -> list[Float[Array, " n_elem"]]:
    """Return how far tensions are above `lowest`, N, over it; None: how far cables are from slack.

    These are arrays [n_elem], without unit, for each group that is limited. Of a slack cable it is
    the strain, over 1e-3, from that at which it goes slack, since its force has no derivative.
    """
    margins = []
    parts = (
        _limited_groups(structure, solution.tension, lowest),
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


def describe_limits(
    structure: Structure, ends: Mapping[str, Solution], options: Namespace, units: Units
) -> list[str]:
    """Return lines on the largest displacement, and on each limit: met, or violated by how much.

    `ends` has the `Solution` of each case by its name in words; numbers are in `units`.
    """
    moved = {
        name: inputs.largest_displacement(end.phases[-1].displacement_in_phase, units)
        for name, end in ends.items()
    }
    name = max(moved, key=lambda name: moved[name][0])
    reached, where = moved[name]
    of = "the last phase" if len(ends) == 1 else f"{len(ends)} combinations"
    if options.deflection is None:
        lines = [f"largest displacement of {of} {where}{name}"]
    else:
        limit = units.text(options.deflection, "m")
        limit = f"limit on displacements of {of}: {limit}"
        verdict = _limit_verdict(reached / options.deflection - 1.0)
        lines = [f"{limit}, reached {where}{name}: {verdict}"]
    if options.lowest is not None:
        lowest = {
            name: min(
                float(np.min(force))
                for force in _limited_groups(structure, end.tension, options.lowest)
                if force is not None
            )
            for name, end in ends.items()
        }
        name = min(lowest, key=lambda name: lowest[name])
        limit = f"limit on the lowest tension at the end: {units.text(options.lowest, 'N')}"
        words = _limit_verdict(1.0 - lowest[name] / options.lowest)
        lines.append(f"{limit}, reached {units.text(lowest[name], 'N')}{name}: {words}")
    return lines


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


def describe_exceeded_strength(structure: Structure, ends: Mapping[str, Solution]) -> list[str]:
    """Return a line on elements above their strength, of the case with the largest; or []."""
    try:
        used = {
            name: np.concatenate(
                [
                    np.ravel(np.asarray(ratio, float))
                    for ratio in jax.tree.leaves(design.utilization(structure, end.last))
                ]
            )
            for name, end in ends.items()
        }
    except ValueError:  # no group has a strength
        return []
    name = max(used, key=lambda name: used[name].max())
    over = used[name][used[name] > 1.0]
    if not len(over):
        return []
    count = "1 element" if len(over) == 1 else f"{len(over)} elements"
    most = f"up to {over.max():.3g} times of it"
    return [f"STRENGTH EXCEEDED{name}: {count} above the breaking force: {most}"]


def _limit_verdict(excess):
    """Return "met" or "violated by 4.9 %"; `excess` is the excess over the limit, divided by it."""
    return "met" if excess <= ROUNDING else f"violated by {100 * excess:.2g} %"
