"""The table of combinations of actions in a report: what each is, and whether it has converged."""

from __future__ import annotations

from collections.abc import Mapping

from ..common.status import describe
from ..design.combinations import Combinations
from .table import Column, Table, make_table


def combination_table(combinations: Combinations, failed: Mapping[str, int]) -> Table:
    """Return the table of combinations.

    Args:
        combinations: `Combinations`, in the order of the cases.
        failed: status codes of the cases that have failed, by name.
    """
    names = combinations.names
    columns = [
        Column("combination", "", list(names)),
        Column("limit state", "", list(combinations.limit_states)),
        Column("actions", "", [combinations.formula(k) for k in range(len(names))]),
        Column("status", "", [describe(failed[name]) if name in failed else "" for name in names]),
        Column("clause", "", list(combinations.clauses), detail=True),
    ]
    clauses = dict.fromkeys(zip(combinations.rules, combinations.clauses, strict=True))
    notes = [f"{rule}: {clause}" for rule, clause in clauses if clause]
    return make_table("Combinations of actions", columns, notes)
