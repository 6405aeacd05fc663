"""Tables of checks: figures of the result, sorted; verdicts; what is input and not covered."""

import numpy as np
import pytest
from golden_files import assert_golden
from oracles.convergence import converged

import jaxcable as jc
from jaxcable.reporting.check_tables import table_name
from jaxcable.reporting.table import Column, make_table, show_table

ROPE = jc.Cables([[0, 1], [0, 2]], axial_stiffness=1e7, strength=[300e3, 200e3])
HOOKS = jc.Structure(
    [[0.0, 0, 0], [0, 0, -2.0], [1.0, 0, -2.0]], {"rope": ROPE}, supports=jc.pinned([0])
)


@pytest.fixture(scope="module")
def written():
    """Two loads on two ropes, one of which is above the limit of one check."""
    hung = jc.Phase(loads=jc.NodalLoads([1, 2], (0.0, 0.0, -1e3)))
    cases = [
        jc.Phase(loads=jc.NodalLoads([1, 2], [(0.0, 0, -p), (0.0, 0, -q)]))
        for p, q in ((90e3, 100e3), (150e3, 30e3))
    ]
    solutions = jc.design.solve_cases(HOOKS, hung, cases)
    assert not np.asarray(solutions.status).any()
    rules = [jc.design.CableResistance(), jc.design.CableSafety(factor=1.5, name="a: =safety")]
    found = jc.design.checks(HOOKS, solutions, rules, names=["snow", "crane"])
    prestressed = jc.solve(HOOKS, hung)
    return found, jc.report(
        HOOKS, prestressed, cases=solutions, names=["snow", "crane"], checks=found, units="kN, m"
    )


def test_the_report_says_what_was_checked(written):
    """Sentences, verdicts, clauses, input, and what is not covered; all cases count."""
    assert_golden("checks.txt", written[1].text())
    tables = written[1].tables
    overview = tables["checks"]
    assert {row[overview.columns.index("counted")] for row in overview.rows} == {"all cases"}
    assert "counted: all cases" in tables["check_cable_resistance"].notes


def test_checks_are_sorted_and_have_their_terms_in_the_units_of_the_report(written):
    """By hand: 101 / (200 / 1.5) of rope 1, the most utilized; forces in kN."""
    found, report = written
    first, second = report.tables["checks"].rows
    # the rope at node 2 hangs at the same height under its load: its length grows by 1 %
    np.testing.assert_allclose(first[1], 101 / (200 / 1.5), rtol=1e-9)
    assert first[2:4] == ["rope 1", "snow"] and second[1] <= first[1]
    table = report.tables["check_cable_resistance"]
    assert table.units[1:4] == ("kN", "kN", "kN")
    rows = {row[0]: row for row in table.rows}
    np.testing.assert_allclose(rows["rope 0"][2:4], [300.0, 200.0])
    np.testing.assert_allclose(rows["rope 0"][4], found["cable resistance"].utilization[0])
    used = [row[4] for row in table.rows]
    assert used == sorted(used, reverse=True)


def test_a_check_that_is_not_passed_stands_in_the_summary():
    """Infinite utilization is a number, and text, CSV and JSON are written."""
    solution = converged(jc.solve(HOOKS, jc.Phase(loads=jc.NodalLoads([1, 2], (0.0, 0.0, -1e3)))))
    uplift = jc.design.ReactionLimit([0], lower=0.0, direction=(0, 0, -1), name="uplift")
    found = jc.design.checks(HOOKS, solution, [uplift, jc.design.CableResistance()])
    report = jc.report(HOOKS, solution, checks=found)
    assert any("1 of 2 checks NOT passed: uplift" in line for line in report.summary)
    assert report.tables["checks"].rows[0][4] == "NOT passed"
    assert "uplift" in report.text() and "uplift" in report.csv()["checks"]
    assert report.dict()["tables"]["checks"]["rows"][0][0] == "uplift"


def test_names_of_tables_differ():
    """Two checks may have names that differ in signs only."""
    assert table_name("Cable, 1") == "check_cable__1"
    assert table_name("cable; 1", {"check_cable__1"}) == "check_cable__1_"
    assert table_name("=") == "check_own"
    long = table_name(200 * "x")  # a part of names of files, which have at most 255 characters
    assert len(long) < 80 and table_name(200 * "x" + "y", {long}) == long + "_"


def test_equal_values_stay_in_their_order():
    """Rounding errors sort no rows, neither in a check nor in a long table."""
    noisy = 0.5 * (1.0 + 1e-12 * np.array([0.0, 3.0, 1.0, 2.0]))
    columns = Column("item", "", [*"abcd"]), Column("utilization", "-", noisy, governs=True)
    shown = show_table(make_table("Equal", columns), 3, {})
    assert [row[0] for row in shown.rows] == ["a", "b", "c"]
