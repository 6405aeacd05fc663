"""What is zero beside the others of its kind, in vectors, tables, and texts of numbers."""

import numpy as np
import pytest

import jaxcable as jc
from jaxcable.common.negligible import NEGLIGIBLE, vector_text, zero_negligible
from jaxcable.reporting import Report, Table
from jaxcable.reporting.table import tables_without_noise


def test_a_number_is_zero_beside_the_largest_of_its_kind():
    values = np.array([1.0, -0.9 * NEGLIGIBLE, 1.1 * NEGLIGIBLE, np.nan])
    np.testing.assert_array_equal(zero_negligible(values), [1.0, 0.0, 1.1 * NEGLIGIBLE, np.nan])
    np.testing.assert_array_equal(zero_negligible(values, 1e9), [0.0, 0.0, 0.0, np.nan])
    np.testing.assert_array_equal(zero_negligible(np.zeros(2)), [0.0, 0.0])


@pytest.mark.parametrize("degrees, text", [(90.0, "(0, 1, 0)"), (180.0, "(-1, 0, 0)")])
def test_a_wind_along_an_axis_has_no_component_across(degrees, text):
    """The cosine of 90 degrees is 6.1e-17 in double precision."""
    angle = np.radians(degrees)
    towards = [np.cos(angle), np.sin(angle), 0.0]
    wind = jc.WindLoads(towards, jc.EurocodeWind(24.0, "II"), 0.9, 0.3, on="mast")
    assert vector_text(towards) == text and f"towards {text}" in wind.describe()
    assert f"sum {text} N" in jc.NodalLoads([0], np.array(towards)).describe()


def test_a_table_is_compared_with_those_of_its_unit():
    """A torsional moment of rounding has a table of its own; a small displacement is none."""
    tables = {
        "My": Table("My", ("x/L", "My"), ("-", "N m"), [[1e-9, 2e5], [0.5, -3e-4]]),
        "T": Table("T", ("element", "T"), ("", "N m"), [[0, 1e-3], [1, None], [2, 5.0]]),
        "u": Table("u", ("ux", "uy"), ("m", "m"), [[1e-6, 1e-14]]),
        "own": Table("own", ("unit", "min"), ("", ""), [["N m", 1e-4], ["Pa", 1e-3], ["m", 1e-4]]),
    }
    found = tables_without_noise(tables)
    assert found["My"].rows == [[1e-9, 2e5], [0.5, 0.0]]  # a ratio has no others of its kind
    assert found["T"].rows == [[0, 0.0], [1, None], [2, 5.0]]
    assert found["u"].rows == [[1e-6, 0.0]]
    assert found["own"].rows == [["N m", 0.0], ["Pa", 1e-3], ["m", 1e-4]]


def test_texts_have_decimals_of_the_largest_number():
    rows = [[134e3, 1e-4], [-0.07, 2e-4]]
    table = Table("Forces", ("N", "A"), ("N", "m2"), rows)
    lines = Report(0, (), {"forces": table}).text().splitlines()
    assert [line.split() for line in lines[-2:]] == [["134.000", "0.0001"], ["0.000", "0.0002"]]
