"""Texts of whole reports, kept in `golden`: a change of any word, unit, digit or order is seen.

``WRITE_GOLDEN=1 python -m pytest tests/reporting`` writes them anew; `git diff` shows what a reader
of reports will see. They say nothing of whether a number is right: other tests do.
"""

import os
import pathlib
import re

FOLDER = pathlib.Path(__file__).parent / "golden"
SMALL = re.compile(r"\d\.\de[+-]\d\d")  # residuals: rounding errors, which no two machines share
NUMBER = re.compile(r"\d+\.\d+")


def assert_golden(name, text):
    """Compare a text with the file `name`, numbers to one unit of their last digit."""
    text, path = SMALL.sub("#", text), FOLDER / name
    if "WRITE_GOLDEN" in os.environ:
        path.write_text(text, encoding="utf-8")
    kept = path.read_text(encoding="utf-8")
    assert NUMBER.sub("0.0", text).splitlines() == NUMBER.sub("0.0", kept).splitlines()
    for found, expected in zip(NUMBER.findall(text), NUMBER.findall(kept), strict=True):
        last_digit = 10.0 ** -len(expected.partition(".")[2])
        assert abs(float(found) - float(expected)) < 1.01 * last_digit, (found, expected)
