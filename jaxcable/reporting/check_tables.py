"""The tables of checks in a report: one line for each check, and the items of each."""

from __future__ import annotations

import math
from collections.abc import Collection

import numpy as np

from ..design.checks import CheckResult, Checks
from .table import Column, Table, columns_of_rows, make_table

_EQUAL = 6  # decimals up to which utilizations are compared
_LONGEST = 60  # characters of a check in the name of its table, which is a part of names of files


def check_tables(checks: Checks) -> dict[str, Table]:
    """Return the table ``checks``, the largest utilization first, and one table for each check.

    The name of the latter is that of `table_name`; it has the items of the check.
    """
    found = {"checks": _overview_table(checks)}
    for one in checks.results:
        found[table_name(one.name, found)] = _check_table(checks, one)
    return found


def table_name(check: str, taken: Collection[str] = ()) -> str:
    """Return the name of the table of a check: ``check_`` and its name in lower case.

    Other characters than letters and digits become underscores; underscores follow a name that is
    `taken`.
    """
    plain = "".join(c if c.isalnum() else "_" for c in check.lower()).strip("_")
    name = f"check_{plain[:_LONGEST].rstrip('_') or 'own'}"
    while name in taken:
        name += "_"
    return name


def check_sentences(checks: Checks) -> list[str]:
    """Return sentences on whether all checks have passed, which have not, and what none covers."""
    count = len(checks.results)
    exceeded = [one.name for one in checks.results if not float(one.largest) <= 1.0]
    lines = []
    if exceeded:
        lines = [f"{len(exceeded)} of {count} checks NOT passed: {', '.join(exceeded)}"]
    elif not (checks.failed or checks.unstable):
        lines = [f"all {count} checks passed, largest utilization {float(checks.largest):.3f}"]
    lines += checks.remarks()
    given = [one for one in checks.results if one.not_covered]
    lines += [f"not covered by {one.name}: {one.not_covered}" for one in given]
    return [*lines, "not covered: all that has no check"]


def _largest_utilization(result: CheckResult) -> tuple[float, int]:
    """Return the largest utilization of a check, and the index of its item.

    NaN does not count, unless all are NaN; infinity does.
    """
    used = np.asarray(result.utilization, float)
    k = int(np.argmax(np.where(np.isnan(used), -np.inf, used)))
    return float(used[k]), k


def _verdict(utilization):
    """Return "passed" for a utilization up to 1, "NOT passed" above, "NOT CHECKED" for NaN."""
    if math.isnan(utilization):
        return "NOT CHECKED"
    return "passed" if utilization <= 1.0 else "NOT passed"


def _overview_table(checks):
    """Return the table of all `Checks`, a row for each, the largest utilization first."""
    rows = []
    for one in checks.results:
        used, k = _largest_utilization(one)
        case, verdict = checks.governing(one.name)[k], _verdict(float(one.largest))
        counted = ", ".join(one.of) or "all cases"
        rows.append((one.name, used, one.items[k], case, verdict, counted, one.clause))
    rows.sort(key=lambda row: -np.nan_to_num(row[1], nan=np.inf))
    columns = columns_of_rows(
        rows,
        *("check", ("utilization", "-"), "item", ("in", "", "case"), "verdict"),
        *(("counted", "", "counted cases"), "clause"),
    )
    columns[1] = columns[1]._replace(governs=True)
    return make_table("Checks, largest utilization of each", columns)


def _check_table(checks, result):
    """Return the table of a `CheckResult`: a row for each item, the largest utilization first.

    Formula, source and input of the check are notes. `checks` are the `Checks` that it is part of,
    which name the governing cases.
    """
    used = np.asarray(result.utilization, float)
    # equal items stay in their order, whatever their rounding errors; those without a value first
    rounded = [float(f"{value:.{_EQUAL}e}") for value in used]
    order = np.argsort(-np.nan_to_num(rounded, nan=np.inf), kind="stable")
    governing = checks.governing(result.name)
    columns = [
        Column("item", "", [result.items[k] for k in order]),
        *(Column(name, unit, np.asarray(result.terms[name])[order]) for name, unit in result.units),
        Column("utilization", "-", used[order], governs=True),
        Column("in", "", [governing[k] for k in order], "case"),
    ]
    parts = (
        ("utilization = ", result.formula),
        ("source: ", result.clause),
        ("input: ", "; ".join(f"{name} = {value}" for name, value in result.inputs)),
        ("counted: ", ", ".join(result.of) if result.of else "all cases"),
        ("not covered: ", result.not_covered),
    )
    notes = [word + text for word, text in parts if text]
    return make_table(f"Check: {result.name}", columns, notes)
