"""The table of combinations of actions in a report: what each is, and whether it has converged."""

from __future__ import annotations

import collections
import itertools
from collections.abc import Collection, Iterable, Mapping

import numpy as np

from ..analysis.load_resultants import load_resultants
from ..common.status import describe
from ..common.types import Float
from ..design.combination_rules import ActionKindFactors
from ..design.combinations import Combinations
from ..loads import as_list
from ..model.result_parts import present_elements
from .load_descriptions import SUM_OF_LOADS, describe_actions
from .states import ReportedAnalysis
from .table import Table, columns_of_rows, make_table


def combination_table(
    combinations: Combinations,
    failed: Mapping[str, int],
    unstable: Collection[str],
    tables: Iterable[Table],
    reactions: Mapping[str, Float[np.ndarray, " 3"]],
) -> Table:
    """Return the table of combinations: actions, status, sums of reactions, and clause.

    Its text shows those that other tables name most often, if it is long.

    Args:
        combinations: `Combinations`, in the order of the cases.
        failed: status codes of the cases that have failed, by name.
        unstable: names of the cases that end in an unstable equilibrium.
        tables: other tables, which name the cases that govern.
        reactions: sums of the reactions in the cases that have converged, N, by name.
    """
    names, nothing = combinations.names, (None,) * 3
    cells = itertools.chain.from_iterable(row for table in tables for row in table.rows)
    words = (cell.split(" to ") for cell in cells if isinstance(cell, str))  # a range names two
    count = collections.Counter(itertools.chain.from_iterable(words))
    unsound = dict.fromkeys(unstable, "UNSTABLE") | {k: describe(v) for k, v in failed.items()}
    rows = [
        [
            *(name, state, combinations.formula(k), unsound.get(name, ""), count[name]),
            *map(_as_float, reactions.get(name, nothing)),
            clause,
        ]
        for k, (name, state, clause) in enumerate(
            zip(names, combinations.limit_states, combinations.clauses, strict=True)
        )
    ]
    columns = columns_of_rows(
        rows,
        *("combination", "limit state", "actions", "status", ("named", "", "governs in")),
        *((f"sum R{axis}", "N") for axis in "xyz"),
        "clause",
    )
    columns[4] = columns[4]._replace(governs=True)
    columns[-1] = columns[-1]._replace(detail=True)
    every = combinations.rules, combinations.rule_factors, combinations.clauses
    notes = ["governs in: number of rows of other tables in which the combination governs"]
    notes.append("sum R: of all reactions, which the loads of the case and those before have")
    if any(one.in_phases for one in combinations.actions):
        notes.append(
            "an action in the phases acts there by factor 1, as their stages say; a case adds the "
            "rest of its factor on the structure as the phases leave it"
        )
    for rule, factors, clause in dict.fromkeys(zip(*every, strict=True)):
        notes.append(f"{rule}: {factors}" + (f" ({clause})" if clause else ""))
    return make_table("Combinations of actions", columns, notes)


def action_table(combinations: Combinations, of: ReportedAnalysis) -> Table:
    """Return the table of the actions that are combined: kind, loads in words, their sums, factors.

    `of` is the analysis of the phases, whose elements are active.
    """
    actions = combinations.actions
    by_kind = {factors.kind: factors for factors in combinations.kind_factors}
    own = [by_kind.get(one.kind, ActionKindFactors(one.kind, *(None,) * 4)) for one in actions]
    texts = describe_actions(actions, of.structure, of.units)
    loads = [as_list(one.loads) for one in actions]
    present = present_elements(of.structure, of.state.present)
    sums = load_resultants(of.structure, [load for some in loads for load in some], present)
    each = np.split(sums, np.cumsum([len(some) for some in loads])[:-1])
    rows = [
        [
            *(one.name, one.kind, text),
            *(resultant.sum(axis=0).tolist() if len(resultant) else (None,) * 3),
            *map(_as_float, factors[1:]),
            *("yes" if one.in_phases else None, _acting_conditions(one)),
        ]
        for one, text, factors, resultant in zip(actions, texts, own, each, strict=True)
    ]
    columns = columns_of_rows(
        rows,
        *("action", "kind", ("acts", "", "what acts")),
        *((f"sum F{axis}", "N") for axis in "xyz"),
        *((name, "-") for name in ActionKindFactors._fields[1:]),
        *("in phases", ("together", "", "acts together")),
    )
    notes = ["characteristic values, which the factors of the combinations multiply", SUM_OF_LOADS]
    if by_kind:
        notes.append(
            "gamma: partial factor; psi0, psi1, psi2: combination, frequent, quasi-permanent value"
        )
    if any(one.in_phases for one in actions):
        notes.append("in phases: the phases before the cases apply the action by factor 1")
    return make_table("Actions", columns, notes)


def _as_float(value):
    """Return a number as a float, which a table prints by its unit; None stays."""
    return None if value is None else float(value)


def _acting_conditions(action):
    """Return in words with which other actions an `Action` may or may not act; None for any."""
    words = [f"never with others of {action.exclusive!r}"] if action.exclusive else []
    words += [f"only with {name}" for name in action.needs]
    words += [f"never with {name}" for name in action.excludes]
    words += [f"one factor for all of {action.source!r}"] if action.source else []
    return "; ".join(words) or None


def combination_sentences(
    combinations: Combinations, failed: Mapping[str, int], unstable: Collection[str]
) -> list[str]:
    """Return sentences on the number of combinations, and which are unstable, a list.

    If there are several limit states, a sentence says that envelopes mix them. Arguments as of
    `combination_table`.
    """
    count = len(combinations)
    lines = [f"{count} combinations of actions, {count - len(failed)} converged"]
    if combinations.source:
        lines.append(f"factors of actions: {combinations.source}")
    if unstable:
        lines.append(f"UNSTABLE at their ends, but in the envelopes: {', '.join(sorted(unstable))}")
    states = list(dict.fromkeys(combinations.limit_states))
    if len(states) > 1:
        lines.append(
            f"envelopes are over all limit states together ({', '.join(states)}); for one of them "
            "make a report of its combinations alone (select_limit_states, or --which of the "
            "command); each check counts those of its own"
        )
    return lines
