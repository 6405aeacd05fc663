"""The tables of checks in a report: one line for each check, and the items of each."""

from __future__ import annotations

import math
from collections.abc import Collection

import numpy as np

from ..design.checks import CheckResult, Checks
from .table import Column, Table, make_table

_LONGEST = 60
"""Characters of the name of a check in that of its table, which is a part of names of files."""


def check_tables(checks: Checks) -> dict[str, Table]:
    """Return the table ``checks``, the most utilized first, and one of the items of each check.

    The name of that is ``check_`` and the name of the check, with underscores.
    """
    found = {"checks": _overview(checks)}
    for one in checks.results:
        found[table_name(one.name, found)] = _items(checks, one)
    return found


def table_name(check: str, taken: Collection[str] = ()) -> str:
    """Return the name of the table of a check; with underscores behind it if it is `taken`."""
    plain = "".join(c if c.isalnum() else "_" for c in check.lower()).strip("_")
    name = f"check_{plain[:_LONGEST].rstrip('_') or 'own'}"
    while name in taken:
        name += "_"
    return name


def check_sentences(checks: Checks) -> list[str]:
    """Return sentences on whether all checks have passed, and which have not."""
    count = len(checks.results)
    exceeded = [one.name for one in checks.results if not float(one.largest) <= 1.0]
    lines = []
    if exceeded:
        lines.append(f"{len(exceeded)} of {count} checks NOT passed: {', '.join(exceeded)}")
    if checks.failed:
        lines.append(f"NOT CHECKED, because the analysis failed: {', '.join(checks.failed)}")
    if checks.unstable:
        lines.append(f"NOT passed, UNSTABLE at the end: {', '.join(checks.unstable)}")
    if not lines:
        lines.append(f"all {count} checks passed, largest utilization {float(checks.largest):.3f}")
    if checks.not_made:
        lines.append(f"NOT MADE: {'; '.join(checks.not_made)}")
    for one in checks.results:
        if one.not_covered:
            lines.append(f"not covered by {one.name}: {one.not_covered}")
    lines.append("not covered: all that has no check")
    return lines


def _largest_utilization(result: CheckResult) -> tuple[float, int]:
    """Return the largest utilization and the index of its item; infinity counts, NaN does not."""
    used = np.asarray(result.utilization, float)
    k = int(np.argmax(np.where(np.isnan(used), -np.inf, used)))
    return float(used[k]), k


def _verdict(utilization):
    """Return what is said of a utilization."""
    if math.isnan(utilization):
        return "NOT CHECKED"
    return "passed" if utilization <= 1.0 else "NOT passed"


def _overview(checks):
    """Return the table of one line for each check, sorted by utilization."""
    most = [_largest_utilization(one) for one in checks.results]
    order = sorted(range(len(most)), key=lambda k: -np.nan_to_num(most[k][0], nan=np.inf))
    results = [checks.results[k] for k in order]
    where = [most[k] for k in order]
    pairs = list(zip(results, where, strict=True))
    columns = [
        Column("check", "", [one.name for one in results]),
        Column("utilization", "-", [used for used, _ in where], governs=True),
        Column("item", "", [one.items[k] for one, (_, k) in pairs]),
        Column("in", "", [checks.governing(one.name)[k] for one, (_, k) in pairs], heading="case"),
        Column("verdict", "", [_verdict(float(one.largest)) for one in results]),
        Column("clause", "", [one.clause for one in results]),
    ]
    return make_table("Checks, largest utilization of each", columns)


def _items(checks, result):
    """Return the table of the items of a check, sorted by utilization, with its input in notes."""
    used = np.asarray(result.utilization, float)
    order = np.argsort(-np.nan_to_num(used, nan=np.inf), kind="stable")
    governing = checks.governing(result.name)
    columns = [
        Column("item", "", [result.items[k] for k in order]),
        *(Column(name, unit, np.asarray(result.terms[name])[order]) for name, unit in result.units),
        Column("utilization", "-", used[order], governs=True),
        Column("in", "", [governing[k] for k in order], heading="case"),
    ]
    notes = [f"utilization = {result.formula}"] if result.formula else []
    if result.clause:
        notes.append(f"source: {result.clause}")
    if result.inputs:
        notes.append("input: " + "; ".join(f"{name} = {value}" for name, value in result.inputs))
    notes.append(f"counted: {', '.join(result.of) if result.of else 'all cases'}")
    if result.not_covered:
        notes.append(f"not covered: {result.not_covered}")
    return make_table(f"Check: {result.name}", columns, notes)
